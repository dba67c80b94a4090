"""The subscriber, against sockets that send what a monitor should and should not send."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime

import msgspec
import numpy as np
import pytest
import zmq

from chatter_monitor.client import Subscriber
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.outlets.wire import PAYLOAD_DTYPES, OdpHeader
from chatter_monitor.records import Flag, Mode, Odp, OdpFrame
from tests.messages import health
from tests.messages import verdict as make_verdict

WAIT_S = 200.0
FS = 12_800.0
CLOCK = Clock(FS, datetime(2026, 3, 1, 8, 30, tzinfo=UTC))


def make_frame(n: int = 640) -> tuple[OdpFrame, Odp]:
    rng = np.random.default_rng(2)
    arrays = [rng.standard_normal((n, 2)).astype(np.float32) for _ in range(4)]
    arrays[0][::7] = np.nan
    share = np.array([0.6, 0.3])
    frame = OdpFrame(
        3, 6400, FS, *arrays, rng.integers(0, 4, (n, 2), np.uint8), share, 0.5, 12, Flag.GAP | Flag.CLIPPED
    )
    return frame, Odp(channel=3, t=0.55, modes=[Mode(None, None, None, part) for part in share])


def header(seq: int = 0, kind: str = "verdict", **other) -> dict:
    about = {
        "schema": f"chatter-monitor/{kind}/1",
        "session": "one",
        "seq": seq,
        "sample0": 0,
        "fs": FS,
        "utc": "2026-03-01T08:30:00.000000+00:00",
        "machine": "lathe-3",
    }
    return about | other


class Sender:
    """A publisher that sends whatever it is told to one subscriber."""

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        self._socket = socket
        self.endpoint = socket.getsockopt_string(zmq.LAST_ENDPOINT)

    def wait(self) -> None:
        assert self._socket.poll(WAIT_S * 1000)
        self._socket.recv()

    def send(self, topic: str, about: dict | bytes, *payload: bytes) -> None:
        text = about if isinstance(about, bytes) else msgspec.json.encode(about)
        self._socket.send_multipart([topic.encode(), text, *payload])

    def verdict(self, **about) -> None:
        self.send("verdict.0", header(**about), msgspec.json.encode(make_verdict()))


@pytest.fixture
def sender() -> Iterator[Sender]:
    with zmq.Context() as context, context.socket(zmq.XPUB) as socket:
        socket.bind("tcp://127.0.0.1:*")
        yield Sender(socket)


@pytest.fixture
def subscriber(sender) -> Iterator[Subscriber]:
    with Subscriber(sender.endpoint) as subscriber:
        sender.wait()
        yield subscriber


def publisher_at(bind: str) -> Publisher:
    return Publisher(PublishSettings(bind=bind), clock=CLOCK, machine="lathe-3")


def test_a_frame_arrives_as_it_was_published():
    """All fields and all bits of a frame arrive, in arrays that cannot be written to."""
    frame, odp = make_frame()
    with publisher_at("tcp://127.0.0.1:0") as publisher, Subscriber(publisher.endpoint) as subscriber:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.frame(frame, odp)
        publisher.digest()
        received = subscriber.receive(WAIT_S)
    assert received is not None
    assert received.topic == "odp.3"
    assert isinstance(received.header, OdpHeader)
    body = received.body
    assert isinstance(body, OdpFrame)
    for name in OdpFrame.__dataclass_fields__:
        was, came = getattr(frame, name), getattr(body, name)
        if isinstance(was, np.ndarray):
            assert came.dtype == was.dtype
            assert came.shape == was.shape
            assert came.tobytes() == was.tobytes()
        else:
            assert came == was
    for name in PAYLOAD_DTYPES:
        with pytest.raises(ValueError, match="read-only"):
            getattr(body, name)[0, 0] = 0


def test_an_empty_frame_arrives():
    """A frame without samples is no special case."""
    with publisher_at("tcp://127.0.0.1:0") as publisher, Subscriber(publisher.endpoint) as subscriber:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.frame(*make_frame(n=0))
        publisher.digest()
        body = subscriber.receive(WAIT_S).body
    assert body.status.shape == (0, 2)


def test_only_the_topics_asked_for_arrive():
    """A topic stands for itself and for what follows it after a dot: channel 1 is not channel 10."""
    published = [make_verdict(channel=channel) for channel in (0, 1, 10, 1)]

    def receive(topics: tuple[str, ...]) -> list[str]:
        with publisher_at("tcp://127.0.0.1:0") as publisher, Subscriber(publisher.endpoint, topics) as subscriber:
            assert publisher.wait_for_subscriber(WAIT_S)
            for verdict in published:
                publisher.message(verdict)
            publisher.message(health())
            publisher.close()
            received = []
            for message in subscriber:
                received.append(message.topic)
                if message.topic == "health":
                    break
            assert not any(subscriber.lost.values())
        return received

    assert receive(("verdict.1", "health")) == ["verdict.1", "verdict.1", "health"]
    assert receive(("verdict", "health")) == ["verdict.0", "verdict.1", "verdict.10", "verdict.1", "health"]
    assert receive(("health",)) == ["health"]


def test_losses_are_counted_per_topic(sender, subscriber):
    """A gap in seq is a loss of that topic; what was sent before the first message received is none."""
    for seq in (5, 6, 9, 10):
        sender.verdict(seq=seq)
    sender.send("verdict.1", header(0), msgspec.json.encode(make_verdict(channel=1)))
    for _ in range(5):
        assert subscriber.receive(WAIT_S) is not None
    assert subscriber.lost == {"verdict.0": 2, "verdict.1": 0}
    assert subscriber.restarts == 0


def test_a_restart_is_no_loss(sender, subscriber):
    """A new session starts counting anew: only what the new session had sent before counts as lost."""
    for session, seq in [("one", 7), ("two", 0), ("two", 1), ("three", 2)]:
        sender.verdict(session=session, seq=seq)
        subscriber.receive(WAIT_S)
    assert subscriber.restarts == 2
    assert subscriber.lost == {"verdict.0": 2}


def test_a_restarted_publisher_is_followed():
    """The subscriber finds a publisher that comes later, and one that takes over from it."""
    with publisher_at("tcp://127.0.0.1:0") as publisher:
        endpoint = publisher.endpoint
    with Subscriber(endpoint) as subscriber:
        for _ in range(2):
            with publisher_at(endpoint) as publisher:
                deadline = time.monotonic() + WAIT_S
                while not publisher.wait_for_subscriber(0.01) and time.monotonic() < deadline:
                    assert subscriber.receive(0.01) is None  # while it receives it subscribes anew
                publisher.message(make_verdict())
                assert subscriber.receive(WAIT_S).body == make_verdict()
        assert subscriber.restarts == 1
        assert subscriber.lost == {"verdict.0": 0}


def test_receive_gives_up_after_its_timeout(subscriber):
    """Without a message None is returned."""
    assert subscriber.receive(0.01) is None


BODY = msgspec.json.encode(make_verdict())
FRAME, ODP = make_frame(n=4)
ODP_HEADER = header(
    kind="odp",
    odp=msgspec.to_builtins(ODP, enc_hook=float),
    rms=0.5,
    lost=0,
    flags=[],
    payloads=[{"name": name, "dtype": dtype, "shape": [4, 2]} for name, dtype in PAYLOAD_DTYPES.items()],
)
PARTS = [getattr(FRAME, name).tobytes() for name in PAYLOAD_DTYPES]


def with_payload(**change) -> dict:
    return ODP_HEADER | {"payloads": [ODP_HEADER["payloads"][0] | change, *ODP_HEADER["payloads"][1:]]}


@pytest.mark.parametrize(
    ("topic", "about", "payload"),
    [
        ("verdict.0", header(), []),
        ("verdict.0", b"", [BODY]),
        ("verdict.0", b"\xff\xfe", [BODY]),
        ("verdict.0", b'{"surprise":' + b"[" * 100_000, [BODY]),
        ("verdict.0", {"schema": "chatter-monitor/verdict/1"}, [BODY]),
        ("verdict.0", header(seq=-1), [BODY]),
        ("verdict.0", header(kind="health"), [BODY]),
        ("verdict.0", header(kind="verdict/x"), [BODY]),
        ("verdict.0", header(), [b"{}"]),
        ("verdict.0", header(), [b"\x00" * 10]),
        ("verdict.0", header(), [BODY.replace(b"stable", b"angry")]),
        ("verdict.1", header(), [BODY]),
        ("weather", header(kind="weather"), [BODY]),
        ("odp.3", header(kind="odp"), PARTS),
        ("odp.0", ODP_HEADER, PARTS),
        ("odp.3", ODP_HEADER, PARTS[:-1]),
        ("odp.3", ODP_HEADER, [PARTS[0][:-1], *PARTS[1:]]),
        ("odp.3", with_payload(dtype="object"), PARTS),
        ("odp.3", with_payload(shape=[2, 4]), PARTS),
        ("odp.3", with_payload(shape=[-1, 2]), PARTS),
        ("odp.3", with_payload(shape=[3, 2]), [PARTS[0][:24], *PARTS[1:]]),
        ("odp.3", with_payload(shape=[8]), PARTS),
        ("odp.3", with_payload(shape=[]), PARTS),
        ("odp.3", with_payload(name="surprise"), PARTS),
        ("odp.3", ODP_HEADER | {"odp": ODP_HEADER["odp"] | {"modes": []}}, PARTS),
    ],
)
def test_malformed_messages_are_counted_and_skipped(sender, subscriber, topic, about, payload):
    """What cannot be read never raises, is counted, and does not keep the next message from being read."""
    sender.send(topic, about, *payload)
    sender.verdict()
    assert subscriber.receive(WAIT_S).body == make_verdict()
    assert subscriber.malformed == 1


def test_additions_of_a_later_minor_version_are_ignored(sender, subscriber):
    """New fields, flags and payload frames do not keep an older client from reading the rest."""
    about = ODP_HEADER | {
        "surprise": 1,
        "flags": ["gap", "surprise"],
        "payloads": [{"name": "surprise", "dtype": "<f8", "shape": [4]}, *ODP_HEADER["payloads"]],
    }
    sender.send("odp.3", about, b"12345678" * 4, *PARTS)
    body = subscriber.receive(WAIT_S).body
    assert subscriber.malformed == 0
    assert body.flags is Flag.GAP
    np.testing.assert_array_equal(body.frequency_hz, FRAME.frequency_hz)


def test_another_major_version_is_an_error(sender, subscriber):
    """A publisher of another major version is told apart from nonsense, with both versions named."""
    sender.send("verdict.0", {"schema": "chatter-monitor/verdict/2"}, b"of another form")
    with pytest.raises(EnvironmentFault, match="got 'chatter-monitor/verdict/2'; allowed: chatter-monitor/verdict/1"):
        subscriber.receive(WAIT_S)
    assert subscriber.malformed == 0


@pytest.mark.parametrize("endpoint", ["", "5557", "tcp://127.0.0.1", "http://127.0.0.1:5557"])
def test_a_malformed_endpoint(endpoint):
    """An endpoint that cannot be connected to is the user's error."""
    with pytest.raises(InputError, match=r"cannot subscribe.*such as tcp://127\.0\.0\.1:5557"):
        Subscriber(endpoint)


def test_importing_the_client_is_light():
    """A program that only reads messages does not load what only the monitor needs."""
    heavy = ("numba", "scipy", "soundfile", "soxr", "matplotlib", "pyarrow", "rich", "rerun")
    code = f"import sys, chatter_monitor.client; print([name for name in {heavy} if name in sys.modules])"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert output == "[]\n"
