"""``docs/asyncapi.yaml`` against the records and against real messages."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import jsonschema
import msgspec
import numpy as np
import pytest
import yaml
import zmq

from chatter_monitor.outlets.wire import (
    DEFAULT_ENDPOINT,
    PAYLOAD_DTYPES,
    SIGNAL_DTYPES,
    Header,
    OdpHeader,
    Payload,
    SignalHeader,
)
from chatter_monitor.records import Advice, Event, Flag, Health, Mismatch, Mode, Odp, State, Verdict

WAIT_S = 200.0
DOCUMENT: dict[str, Any] = yaml.safe_load((Path(__file__).parents[2] / "docs/asyncapi.yaml").read_text())
SCHEMAS = DOCUMENT["components"]["schemas"]
MISMATCH = Mismatch(
    channel=0,
    t=31.5,
    sample=403200,
    since_s=29.8,
    outcome="missing_physics",
    effect="clearance",
    parameters={"coefficient": 0.17, "gap": 0.8},
    evidence_nats=31.0,
    runner_up="cubic_stiffness",
    distance_nats=4.0,
    band_hz=(396.0, 404.0),
    amplitude=1.1,
)
STRUCTS = (Header, OdpHeader, SignalHeader, Payload, Odp, Mode, Verdict, Event, Advice, Health, Mismatch)


def validate(text: bytes, reference: str) -> None:
    """Check a JSON text against a schema of the document."""
    schema = {**DOCUMENT, "$ref": reference}
    jsonschema.validate(msgspec.json.decode(text), schema, jsonschema.Draft202012Validator)


def channel_of(topic: str) -> str:
    """Name of the document's channel whose address fits the topic."""
    fits = [
        name
        for name, channel in DOCUMENT["channels"].items()
        if re.fullmatch(re.escape(channel["address"]).replace(r"\{channel\}", r"\d+"), topic)
    ]
    assert len(fits) == 1
    return fits[0]


@pytest.mark.parametrize("struct", STRUCTS)
def test_the_document_has_the_fields_of_the_records(struct):
    """Each record and its schema have the same fields in the same order, all present in every message."""
    schema = SCHEMAS[struct.__name__]
    tag = ["type"] if struct.__struct_config__.tag else []
    assert list(schema["properties"]) == tag + list(struct.__struct_encode_fields__)
    assert schema["required"] == list(schema["properties"])
    assert schema["additionalProperties"] is False


def test_the_document_has_the_names_of_the_records():
    """States, flags and payload frames are those of the code."""
    assert SCHEMAS["Verdict"]["properties"]["state"]["enum"] == list(get_args(State))
    assert SCHEMAS["Flags"]["items"]["enum"] == [flag.name.lower() for flag in Flag if flag]
    assert SCHEMAS["Payload"]["properties"]["name"]["enum"] == list(PAYLOAD_DTYPES)
    assert set(SCHEMAS["Payload"]["properties"]["dtype"]["enum"]) == set(PAYLOAD_DTYPES.values())
    assert SCHEMAS["SignalPayload"]["properties"]["name"]["enum"] == list(SIGNAL_DTYPES)
    assert set(SCHEMAS["SignalPayload"]["properties"]["dtype"]["enum"]) == set(SIGNAL_DTYPES.values())
    assert set(SCHEMAS) == {struct.__name__ for struct in STRUCTS} | {"Flags", "Interval95", "SignalPayload"}


def test_real_messages_are_as_documented(publisher, make_interval, make_block, orders, messages):
    """Every message off a real socket fits the header and payload of the channel that its topic belongs to."""
    intervals = [make_interval(), make_interval(channel=1, modes=1, lost=7), make_interval(n=0)]
    seen = set()
    with zmq.Context() as context, context.socket(zmq.SUB) as subscriber:
        subscriber.rcvtimeo = int(WAIT_S * 1000)
        subscriber.subscribe("signal")
        subscriber.subscribe("")
        subscriber.connect(publisher.endpoint)
        assert publisher.wait_for_subscriber(WAIT_S)
        for interval in intervals:
            publisher.frame(*interval)
            publisher.digest()
        publisher.block(make_block())
        publisher.turning(0, orders)
        publisher.frame(*make_interval())  # now with a signal
        publisher.digest()
        for message in messages:
            publisher.message(message)
        publisher.message(MISMATCH)
        for _ in range(len(intervals) + 3 + len(messages)):
            topic, header, *payload = subscriber.recv_multipart()
            name = channel_of(topic.decode())
            seen.add(name)
            described = DOCUMENT["components"]["messages"][name]
            validate(header, described["headers"]["$ref"])
            if described.get("contentType") == "application/octet-stream":
                for about, part in zip(msgspec.json.decode(header)["payloads"], payload, strict=True):
                    assert len(part) == np.prod(about["shape"]) * np.dtype(about["dtype"]).itemsize
            else:
                assert len(payload) == 1
                validate(payload[0], described["payload"]["$ref"])
                assert msgspec.json.decode(payload[0])["type"] == name
    assert seen == set(DOCUMENT["channels"])


def test_a_message_that_is_not_as_documented_is_found(messages):
    """The check above can fail: a field too many, one too few and a wrong type are all refused."""
    health = msgspec.to_builtins(messages[4])
    validate(msgspec.json.encode(health), "#/components/schemas/Health")
    one_too_few = {name: value for name, value in health.items() if name != "lost"}
    for broken in (health | {"surprise": 1}, one_too_few, health | {"lost": "many"}):
        with pytest.raises(jsonschema.ValidationError):
            validate(msgspec.json.encode(broken), "#/components/schemas/Health")


def test_references_resolve():
    """Every reference in the document leads somewhere in it."""
    text = (Path(__file__).parents[2] / "docs/asyncapi.yaml").read_text()
    for reference in re.findall(r'\$ref: "#/([^"]+)"', text):
        node = DOCUMENT
        for part in reference.split("/"):
            node = node[part]


def test_the_example_works(publisher, make_interval):
    """The subscriber printed in the document runs as it stands, but for the port, and reads a frame."""
    example = re.search(r"```python\n(.*?)```", DOCUMENT["info"]["description"], re.DOTALL).group(1)
    assert DEFAULT_ENDPOINT in example
    code = example.replace(DEFAULT_ENDPOINT, publisher.endpoint)
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.frame(*make_interval(first_sample=1280))
        publisher.digest()
        assert process.communicate(timeout=WAIT_S)[0] == "odp.0 1280 (640, 2)\n"
