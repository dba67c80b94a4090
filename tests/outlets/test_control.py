"""The control socket: requests that are meant, and thousands that are not."""

from __future__ import annotations

import itertools
import json
import random
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import jsonschema
import msgspec
import numpy as np
import pytest
import referencing
import soundfile
import yaml
import zmq

from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.config import Settings, load
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets import control as control_module
from chatter_monitor.outlets.control import (
    BURST,
    LONGEST_FRAME,
    LONGEST_REQUEST,
    REQUESTS_HZ,
    WAITING_COMMANDS,
    AskStatus,
    Control,
    ControlSettings,
    Done,
    Mark,
    Refused,
    SetSpindle,
    Spindle,
    Status,
    StatusReply,
)
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.token_bucket import TokenBucket
from chatter_monitor.records import Health, Verdict
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.tracking.spindle import SpindleSettings

WAIT_S = 200.0
RATE_HZ = 12_800.0
LINE_HZ = 993.6  # the 6th tooth passing harmonic of `MILL`
MILL = {"command": "set_spindle", "rpm": 1656.0, "teeth": 6}

DOCS = Path(__file__).parents[2] / "docs"
DOCUMENT = yaml.safe_load(re.search(r"```yaml\n(.*?)```", (DOCS / "control.md").read_text(), re.DOTALL).group(1))
REGISTRY = referencing.Registry().with_resource(
    "asyncapi.yaml",
    referencing.jsonschema.DRAFT202012.create_resource(yaml.safe_load((DOCS / "asyncapi.yaml").read_text())),
)


def is_documented(value, name: str) -> bool:
    """Whether a JSON value is as the document says."""
    schema = {**DOCUMENT, "$ref": f"#/$defs/{name}"}
    return jsonschema.Draft202012Validator(schema, registry=REGISTRY).is_valid(value)


def as_json(message: msgspec.Struct):
    """Read a message back from its JSON."""
    return json.loads(msgspec.json.encode(message))


class Client:
    """Sends requests, one reply each."""

    def __init__(self, zmq_socket: zmq.Socket[bytes]) -> None:
        self._socket = zmq_socket

    def ask(self, *frames: bytes) -> dict:
        self._socket.send_multipart(frames)
        (reply,) = self._socket.recv_multipart()
        return json.loads(reply)

    def request(self, **about) -> dict:
        return self.ask(json.dumps(about).encode())


@contextmanager
def client_of(endpoint: str) -> Iterator[Client]:
    """Connect a client, whose waits are bounded."""
    with zmq.Context() as context, context.socket(zmq.REQ) as zmq_socket:
        zmq_socket.linger = 0
        zmq_socket.rcvtimeo = int(WAIT_S * 1000)
        zmq_socket.connect(endpoint)
        yield Client(zmq_socket)


def patient_clock():
    """A clock by which there is always time for another request."""
    return itertools.count().__next__


@pytest.fixture
def control() -> Iterator[Control]:
    """A control socket that has no limit on the rate of requests."""
    spindle = SpindleSettings(speed_rpm=1000.0, teeth=2)
    with Control("tcp://127.0.0.1:0", machine="lathe-3", spindle=spindle, clock=patient_clock()) as control:
        yield control


@pytest.fixture
def client(control) -> Iterator[Client]:
    """A client of it."""
    with client_of(control.endpoint) as client:
        yield client


@pytest.fixture
def rng() -> random.Random:
    """The same nonsense every time."""
    return random.Random(20)  # noqa: S311


def test_commands_reach_the_worker_in_order(control, client):
    """Valid commands are answered with ok and come out for the worker once, in the order in which they came."""
    assert client.request(**MILL) == {"ok": True}
    assert client.request(command="mark", text="Werkzeug gewechselt, 6 Zähne") == {"ok": True}
    assert client.request(command="set_spindle", rpm=None, teeth=1) == {"ok": True}
    assert list(control.commands()) == [
        SetSpindle(rpm=1656.0, teeth=6),
        Mark(text="Werkzeug gewechselt, 6 Zähne"),
        SetSpindle(rpm=None, teeth=1),
    ]
    assert list(control.commands()) == []


def test_status(control, client, messages):
    """The status has the last verdict of each channel, the last health, and the spindle once the worker took it."""
    status = client.request(command="status")["status"]
    assert status == {"machine": "lathe-3", "spindle": {"rpm": 1000.0, "teeth": 2}, "verdicts": [], "health": None}
    for message in reversed(messages):
        control.message(message)
    client.request(**MILL)
    assert client.request(command="status")["status"]["spindle"] == {"rpm": 1000.0, "teeth": 2}
    (command,) = control.commands()
    control.spindle(SpindleSettings(command.rpm, command.teeth))
    status = client.request(command="status")["status"]
    assert status["spindle"] == {"rpm": 1656.0, "teeth": 6}
    assert status["verdicts"] == [as_json(message) for message in messages[:2]]
    assert status["health"] == as_json(messages[4])


def test_real_replies_are_as_documented(control, client, messages):
    """Each kind of reply off a real socket fits its schema, and each request that is accepted fits its own."""
    for message in messages:
        control.message(message)
    for about, reply in [
        (MILL, "Done"),
        (MILL | {"rpm": None}, "Done"),
        ({"command": "mark", "text": "x" * 200}, "Done"),
        ({"command": "status"}, "StatusReply"),
        ({"command": "stop"}, "Refused"),
    ]:
        assert is_documented(about, "Request") == (reply != "Refused")
        answer = client.request(**about)
        assert is_documented(answer, "Reply")
        assert is_documented(answer, reply)
    assert not is_documented({"ok": True, "status": {}}, "Reply")
    assert not is_documented({"ok": False}, "Reply")


@pytest.mark.parametrize("struct", [SetSpindle, Mark, AskStatus, Done, Refused, StatusReply, Status, Spindle])
def test_the_document_has_the_fields_of_the_code(struct):
    """Requests and replies in the document have the fields of the code, none of them optional."""
    schema = DOCUMENT["$defs"][struct.__name__]
    tag = ["command"] if struct.__struct_config__.tag else []
    assert list(schema["properties"]) == schema["required"] == tag + list(struct.__struct_encode_fields__)
    assert schema["additionalProperties"] is False


def test_the_limits_in_the_document_are_those_of_the_code():
    """The text names the limits that hold."""
    text = " ".join((DOCS / "control.md").read_text().split())
    for promise in (
        f"at most {LONGEST_REQUEST} bytes",
        f"{REQUESTS_HZ:g} requests a second in the long run, {BURST} at once",
        f"{WAITING_COMMANDS} may wait",
        f"more than {LONGEST_FRAME // 1024} KiB",
        f"waits {1000 * control_module.REST_S:g} ms",
    ):
        assert promise in text


def test_the_example_in_the_document_works(control):
    """The client printed in the document runs as it stands, but for the port."""
    example = re.search(r"```python\n(.*?)```", (DOCS / "control.md").read_text(), re.DOTALL).group(1)
    code = example.replace("tcp://127.0.0.1:5558", control.endpoint)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=WAIT_S, check=True)
    assert done.stdout == "{'ok': True}\n"
    assert list(control.commands()) == [SetSpindle(rpm=1656.0, teeth=6)]


@pytest.mark.parametrize(
    ("request_text", "error"),
    [
        (b"", "truncated"),
        (b"status", "malformed"),
        (b"\xff\xfe", "malformed"),
        (b'{"command":"mark","text":"\xff"}', "utf-8"),
        (b"null", "Expected `object`"),
        (b"[" * 4000, "Expected `object`"),
        (b'{"a":' + b"[" * 4000, "nested too deeply"),
        (b'{"command":"stop"}', "Invalid value 'stop'"),
        (b'{"command":"status","a":1}', "unknown field `a`"),
        (b'{"command":"set_spindle","rpm":1656}', "missing required field `teeth`"),
        (b'{"command":"set_spindle","rpm":NaN,"teeth":1}', "malformed"),
        (b'{"command":"set_spindle","rpm":1e999,"teeth":1}', "out of range"),
        (b'{"command":"set_spindle","rpm":-1,"teeth":1}', "> 0"),
        (b'{"command":"set_spindle","rpm":0,"teeth":1}', "> 0"),
        (b'{"command":"set_spindle","rpm":1000001,"teeth":1}', "<= 1000000"),
        (b'{"command":"set_spindle","rpm":"1656","teeth":1}', "got `str`"),
        (b'{"command":"set_spindle","rpm":true,"teeth":1}', "got `bool`"),
        (b'{"command":"set_spindle","rpm":1,"teeth":0}', ">= 1"),
        (b'{"command":"set_spindle","rpm":1,"teeth":1.5}', "got `float`"),
        (b'{"command":"set_spindle","rpm":1,"teeth":' + b"9" * 3000 + b"}", "$.teeth"),
        (b'{"command":"mark","text":""}', "length >= 1"),
        (b'{"command":"mark","text":"' + b"x" * 201 + b'"}', "length <= 200"),
        (b'{"command":"mark","text":"\\u001b[2J"}', "printable"),
        (b'{"command":"mark","text":"a\\nb"}', "printable"),
        (b'{"command":"mark","text":"\\ud800"}', ""),
        (b'{"command":"status"}' + b" " * LONGEST_REQUEST, "at most 4096 bytes"),
    ],
)
def test_what_is_refused(control, client, request_text, error):
    """A request that is malformed, incomplete, out of range or too much is refused with the reason."""
    reply = client.ask(request_text)
    assert is_documented(reply, "Refused")
    assert error in reply["error"]
    assert list(control.commands()) == []


def test_a_request_is_one_frame(control, client):
    """Several frames are refused, even if each one by itself is a request."""
    reply = client.ask(json.dumps(MILL).encode(), json.dumps(MILL).encode())
    assert reply == {"ok": False, "error": f"a request is one frame of at most {LONGEST_REQUEST} bytes"}
    assert list(control.commands()) == []


VALID = [json.dumps(about).encode() for about in (MILL, {"command": "mark", "text": "hello"}, {"command": "status"})]
# JSON texts, and what only looks like them
VALUES = (
    *("null", "true", "0", "-1", "1.5", "1e308", "1e999", "-1e999", "NaN", "Infinity", "-0.0", "1" * 400, "0x10", "01"),
    *('""', '"1656"', '"\\ud800"', '"\\u0000"', '"status"', '"set_spindle"', '"a\\nb"', "[]", "{}", "[[[]]]", "'x'"),
    *("[" * 900, '{"a":' * 600, "[" * 3000 + "]" * 900, '"' + "x" * 3000 + '"', "1e-400", '"\\x"', "[1,]", "", "nul"),
)
FIELDS = ("command", "rpm", "teeth", "text", "a", "__class__", "ok", "")


def fuzzed(rng: random.Random) -> list[bytes]:
    """Frames of a request by somebody who does not know the protocol, or knows it well and means ill."""
    kind = rng.randrange(6)
    if kind == 0:
        return [rng.randbytes(rng.randrange(600))]
    if kind == 1:
        text = bytearray(rng.choice(VALID))
        for _ in range(rng.randint(1, 4)):
            at = rng.randrange(len(text))
            text[at : at + rng.randrange(3)] = rng.randbytes(rng.randrange(3))
            text = text or bytearray(b"{")
        return [bytes(text)]
    if kind == 2:
        names = [rng.choice(FIELDS) for _ in range(rng.randrange(5))]
        fields = [f'"{name}":{rng.choice(VALUES)}' for name in names]
        start = rng.choice(['"command":"set_spindle"', '"command":"mark"', '"command":"status"', '"command":7'])
        return [("{" + ",".join([start, *fields]) + rng.choice(["}", "", "}}"])).encode()]
    if kind == 3:
        return [rng.choice(VALUES).encode(rng.choice(["utf-8", "utf-16", "utf-32"]))]
    if kind == 4:
        return [rng.choice(VALID) for _ in range(rng.randint(2, 5))]
    return [rng.choice(VALID)[: rng.randrange(20)] + b" " * rng.randrange(2 * LONGEST_REQUEST)]


def test_ten_thousand_malformed_requests(control, client, rng):
    """Each gets a reply; only what the document allows changes anything, and at the end all is as if nothing was."""
    before = client.request(command="status")
    accepted = []
    for _ in range(10_000):
        frames = fuzzed(rng)
        reply = client.ask(*frames)
        commands = list(control.commands())
        if reply["ok"]:  # by chance a valid one
            assert len(frames) == 1
            assert is_documented(json.loads(frames[0].decode()), "Request")
            accepted += commands
        else:
            assert set(reply) == {"ok", "error"}
            assert isinstance(reply["error"], str)
            assert commands == []
    assert len(accepted) < 500
    assert client.request(command="set_spindle", rpm=1000.0, teeth=2) == {"ok": True}
    assert len(list(control.commands())) == 1
    assert client.request(command="status") == before


def test_peers_that_break_the_protocol_below(control, client, rng):
    """Bytes that are no ZeroMQ, envelopes without a delimiter, huge frames and peers that leave: others are served."""
    port = int(control.endpoint.rpartition(":")[2])
    for _ in range(50):
        with socket.create_connection(("127.0.0.1", port)) as raw:
            start = rng.choice([b"", b"GET / HTTP/1.1\r\n\r\n", b"\xff\x00\x00\x00\x00\x00\x00\x00\x01\x7f"])
            raw.sendall(start + rng.randbytes(200))
    with zmq.Context() as context:
        for _ in range(20):
            with context.socket(zmq.DEALER) as dealer:
                dealer.linger = 1000
                dealer.connect(control.endpoint)
                dealer.send_multipart([rng.randbytes(10) for _ in range(rng.randint(1, 4))])  # no delimiter
                dealer.send_multipart([b"", VALID[2]])  # gone before the reply
                dealer.send_multipart([b"", bytes(LONGEST_FRAME + 1)])
    assert client.request(command="status")["ok"]
    assert list(control.commands()) == []


def test_a_peer_without_a_delimiter_that_has_gone_takes_no_reply():
    """Heard only after its peer has left, a request without a delimiter costs a place in the rate, nobody a reply."""
    spindle = SpindleSettings()
    with (
        Control("tcp://127.0.0.1:0", machine="m", spindle=spindle, clock=lambda: 0.0) as control,
        client_of(control.endpoint) as client,
    ):
        assert all(client.request(command="status")["ok"] for _ in range(BURST))
        with zmq.Context() as context, context.socket(zmq.DEALER) as busy, context.socket(zmq.DEALER) as rude:
            for peer in busy, rude:
                peer.linger = int(WAIT_S * 1000)
                peer.connect(control.endpoint)
            for _ in range(30):  # of which each keeps the thread from reading on
                busy.send_multipart([b"", VALID[2]])
            rude.send_multipart([b"no", b"delimiter"])
        assert all("too many" in client.request(command="status")["error"] for _ in range(3))


def test_a_huge_frame_ends_its_connection(control, client):
    """The largest frame is refused with a reply; beyond it the peer is cut off before the frame takes up memory."""
    assert client.ask(bytes(LONGEST_FRAME))["error"].startswith("a request is one frame")
    with zmq.Context() as context, context.socket(zmq.REQ) as other:
        other.linger = 0
        events = other.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        other.connect(control.endpoint)
        other.send(bytes(LONGEST_FRAME + 1))
        assert events.poll(WAIT_S * 1000)
        assert not other.poll(0)
        other.disable_monitor()
        events.close()
    assert client.request(command="status")["ok"]


def test_the_rate_is_limited():
    """A burst goes through, then requests are refused until the clock has moved on; refused ones change nothing."""
    now_s = [0.0]
    with (
        Control("tcp://127.0.0.1:0", machine="m", spindle=SpindleSettings(), clock=lambda: now_s[0]) as control,
        client_of(control.endpoint) as client,
    ):
        assert all(client.request(command="status")["ok"] for _ in range(BURST))
        refused = client.request(**MILL)
        assert is_documented(refused, "Refused")
        assert refused["error"] == "too many requests, allowed: 20 a second"
        now_s[0] = 2.5 / REQUESTS_HZ
        assert [client.request(**MILL)["ok"] for _ in range(3)] == [True, True, False]
        assert len(list(control.commands())) == 2


def test_malformed_requests_count_towards_the_rate():
    """Nonsense costs as much as sense: it cannot keep the monitor busy either."""
    with (
        Control("tcp://127.0.0.1:0", machine="m", spindle=SpindleSettings(), clock=lambda: 0.0) as control,
        client_of(control.endpoint) as client,
    ):
        errors = [client.ask(b"?")["error"] for _ in range(BURST + 1)]
    assert "too many" not in errors[-2]
    assert "too many" in errors[-1]


def test_token_bucket(rng):
    """However requests are spaced, no more pass than the burst and the rate allow, and steady ones at the rate do."""
    now_s = 100.0
    bucket = TokenBucket(10.0, 5, lambda: now_s)
    passed = 0
    for _ in range(5000):
        passed += bucket.take()
        now_s += rng.choice([0.0, 0.01, 0.3])
        assert passed <= 5 + 10.0 * (now_s - 100.0)
    now_s += 1.0
    assert sum(bucket.take() for _ in range(20)) == 5  # a rest saves up no more than the burst
    for _ in range(50):
        now_s += 0.1001
        assert bucket.take()


def test_commands_that_nobody_takes_are_bounded(control, client):
    """While the worker takes nothing, only so many commands wait; further ones are refused, and the status answers."""
    replies = [
        client.request(command="set_spindle", rpm=1000.0 + i, teeth=1)["ok"] for i in range(WAITING_COMMANDS + 3)
    ]
    assert replies == [True] * WAITING_COMMANDS + [False] * 3
    assert "try again" in client.request(command="mark", text="x")["error"]
    assert client.request(command="status")["ok"]
    assert [command.rpm for command in control.commands()] == [1000.0 + i for i in range(WAITING_COMMANDS)]
    assert client.request(command="mark", text="x") == {"ok": True}


def test_closing_ends_the_thread_and_frees_the_port(control):
    """After closing, also twice, no thread is left and the port can be bound again."""
    assert "control" in {thread.name for thread in threading.enumerate()}
    control.close()
    control.close()
    assert "control" not in {thread.name for thread in threading.enumerate()}
    with Control(control.endpoint, machine="m", spindle=SpindleSettings()) as second:
        assert second.endpoint == control.endpoint


def test_a_port_in_use():
    """A port that another program holds is a fault of the environment, with the setting to change."""
    with (
        socket.create_server(("127.0.0.1", 0)) as other,
        pytest.raises(EnvironmentFault, match=r"in use.*\[control\] bind"),
    ):
        Control(f"tcp://127.0.0.1:{other.getsockname()[1]}", machine="m", spindle=SpindleSettings())


@pytest.mark.parametrize("bind", ["tcp://0.0.0.0:5558", "tcp://*:5558", "tcp://192.0.2.7:5558", "tcp://[::]:5558"])
def test_the_network_is_refused(bind):
    """There is no control over the network, whatever is encrypted."""
    with pytest.raises(InputError, match="refused on the network"):
        ControlSettings(bind=bind)


def test_it_is_off_unless_configured(tmp_path):
    """Without an endpoint in the configuration there is no control socket."""
    assert Settings().control.bind is None
    path = tmp_path / "machine.toml"
    path.write_text('[control]\nbind = "tcp://127.0.0.1:5558"\n')
    assert load([path]).control.bind == "tcp://127.0.0.1:5558"
    path.write_text('[control]\nbind = "tcp://0.0.0.0:5558"\n')
    with pytest.raises(InputError, match=r"refused on the network.*machine\.toml"):
        load([path])


class Kept(Outlet):
    """Keeps the messages."""

    def __init__(self) -> None:
        self.messages = []

    def block(self, block):
        pass

    def frame(self, frame, odp):
        pass

    def message(self, message):
        self.messages.append(message)

    def close(self):
        pass

    def take(self, kind):
        """Messages of a kind that have come since the last time."""
        taken = [message for message in self.messages if isinstance(message, kind)]
        self.messages = [message for message in self.messages if not isinstance(message, kind)]
        return taken


def line(samples: int) -> np.ndarray:
    """A steady line in a little noise."""
    noise = np.random.default_rng(1).standard_normal(samples)
    return 0.3 * np.sin(2 * np.pi * LINE_HZ * np.arange(samples) / RATE_HZ) + 0.003 * noise


def test_the_spindle_speed_takes_effect_at_the_next_interval(control, client):
    """Right after `set_spindle` both channels name the line's order; a mark is in the next health message only."""
    signal = line(38_400)
    source = Synthetic.from_array(np.stack([signal, signal], axis=1), RATE_HZ, block_samples=640)
    kept = Kept()
    monitor = Monitor(
        Settings(),
        source,
        [kept, control],
        counts=source,
        source_rate_hz=RATE_HZ,
        session="test",
        clock=time.perf_counter,
        commands=control.commands,
    )
    steps = monitor.run()
    while next(steps) < 16_000:
        pass
    before = kept.take(Verdict)
    assert {verdict.order for verdict in before} == {None}
    assert [verdict.state for verdict in before[-2:]] == ["forced"] * 2  # steady from the start
    assert client.request(command="status")["status"]["verdicts"][1]["state"] == "forced"
    assert client.request(**MILL) == {"ok": True}
    assert client.request(command="mark", text="speed set") == {"ok": True}
    assert kept.take(Health)[0].reasons == []
    list(steps)
    after = kept.take(Verdict)
    assert after[0].sample0 <= 16_000
    assert {verdict.state for verdict in after} == {"forced"}
    assert all(verdict.order == pytest.approx(36, abs=0.05) for verdict in after)
    first, *later = kept.take(Health)
    assert first.reasons == ["mark at 1.25 s: speed set"]
    assert all(health.reasons == [] for health in later)
    status = client.request(command="status")["status"]
    assert status["spindle"] == {"rpm": 1656.0, "teeth": 6}
    assert status["health"]["state"] == "finished"


@pytest.fixture
def recording(tmp_path):
    """Five seconds of the line."""
    path = tmp_path / "line.wav"
    soundfile.write(path, line(64_000), int(RATE_HZ))
    return path


def replay(recording, endpoint: str, *options) -> subprocess.Popen[str]:
    """Replay with a control socket, in a process of its own."""
    config = recording.with_suffix(".toml")
    config.write_text(f'[control]\nbind = "{endpoint}"\n')
    command = [sys.executable, "-m", "chatter_monitor", "replay", recording, "--config", config, *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_replay_at_real_pace_is_controlled(recording, tmp_path):
    """`replay --pace real` answers on its control socket and judges by what it is told."""
    endpoint = f"ipc://{tmp_path / 'control'}"
    out = tmp_path / "out.jsonl"
    with replay(recording, endpoint, "--pace", "real", "--jsonl", out) as process, client_of(endpoint) as client:
        assert client.request(**MILL) == {"ok": True}
        assert client.request(command="status")["status"]["machine"] == "machine"
        _, err = process.communicate(timeout=WAIT_S)
    assert (process.returncode, err) == (0, "")
    verdicts = [about for about in map(json.loads, out.read_text().splitlines()) if about["type"] == "verdict"]
    assert verdicts[-1]["state"] == "forced"


def test_a_replay_at_full_speed_opens_no_control_socket(recording):
    """The monitor's configuration serves for a replay beside it: the control socket in use is not asked for."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with replay(recording, endpoint) as fast, replay(recording, endpoint, "--pace", "real") as real:
            assert fast.communicate(timeout=WAIT_S)[1] == ""
            assert "[control] bind" in real.communicate(timeout=WAIT_S)[1]
    assert (fast.returncode, real.returncode) == (0, 3)
