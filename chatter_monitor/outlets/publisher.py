"""The monitor's results on a ZeroMQ socket, for dashboards, loggers and bridges in other processes."""

from __future__ import annotations

import time
import uuid
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np
import zmq

from chatter_monitor.acquisition.index_clock import WallClock
from chatter_monitor.errors import ChatterMonitorError, InputError
from chatter_monitor.outlets.curve import Guard
from chatter_monitor.outlets.endpoint import ALLOWED_LOOPBACK, bind, is_local
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.signal_view import SignalView
from chatter_monitor.outlets.wire import (
    DEFAULT_ENDPOINT,
    DEFAULT_HIGH_WATER_MARK,
    PAYLOAD_DTYPES,
    SIGNAL_DTYPES,
    Header,
    OdpHeader,
    Payload,
    SignalHeader,
    encode,
    schema_name,
    topic_of,
)
from chatter_monitor.records import Announcement, Block, Event, Health, Mismatch, Odp, OdpFrame, SignalFrame, Verdict
from chatter_monitor.tracking.orders import Orders

LINGER_MS = 2000  # how long closing may wait for subscribers that are slow to take the last messages

HOW_TO_ENCRYPT = (
    "Run `chatter-monitor keys new server` here and `chatter-monitor keys allow CLIENT.key` for each subscriber; "
    "they print what to set."
)


@dataclass(frozen=True, slots=True)
class PublishSettings:
    """Where to publish, and to whom: the table ``[publish]`` of a machine configuration.

    Attributes
    ----------
    bind : str
        ZeroMQ endpoint: loopback or ``ipc://``, whose path is taken over from an earlier socket; any address with the
        two keys below.
    high_water_mark : int
        Messages kept for a subscriber that does not keep up; what comes after that is lost to it, and to it alone.
        At least 1.
    server_key : str or None
        Path of the monitor's secret certificate: with it, everything is encrypted (CURVE).
    allowed_clients : str or None
        Directory of the public certificates of those who may subscribe.

    Raises
    ------
    InputError
        If the endpoint is malformed, or reachable from the network without both certificates; if only one of them is
        given; or if the mark is below 1 (unbounded).
    """

    bind: str = DEFAULT_ENDPOINT
    high_water_mark: int = DEFAULT_HIGH_WATER_MARK
    server_key: str | None = None
    allowed_clients: str | None = None

    def __post_init__(self) -> None:
        if (self.server_key is None) != (self.allowed_clients is None):
            raise InputError(
                "[publish] server_key and allowed_clients go together, and one of them is missing",
                remedy=HOW_TO_ENCRYPT,
            )
        if not is_local(self.bind) and self.server_key is None:
            raise InputError(
                "publishing to the network is refused without encryption (CURVE), because everybody there could listen",
                got=self.bind,
                allowed=f"{ALLOWED_LOOPBACK}; any address with server_key and allowed_clients",
                remedy=HOW_TO_ENCRYPT,
            )
        if self.high_water_mark < 1:
            raise InputError("the publisher's high-water mark is too low", got=self.high_water_mark, allowed=">= 1")


@dataclass(frozen=True, slots=True)
class Clock:
    """The sample index of a recording, tied to wall time at one sample.

    Attributes
    ----------
    sample_rate_hz : float
        Samples per second.
    utc : datetime
        Time of `sample`, with a time zone.
    sample : int
        The sample at that time.
    """

    sample_rate_hz: float
    utc: datetime
    sample: int = 0

    def utc_of(self, sample: int) -> str:
        """Time of a sample in UTC, ISO 8601 with microseconds."""
        time_of = self.utc + timedelta(seconds=(sample - self.sample) / self.sample_rate_hz)
        return time_of.astimezone(UTC).isoformat(timespec="microseconds")

    def sample_at(self, t: float) -> int:
        """Index of the sample at a time in seconds of signal."""
        return round(t * self.sample_rate_hz)


class Publisher(Outlet):
    """Publishes frames and messages; a subscriber that is slow, stopped or absent never holds it up.

    The socket is an XPUB, which is a PUB that hears of subscriptions: that makes `wait_for_subscriber` possible, and
    with it a replay whose beginning is not lost. The thread that publishes owns the object; handing it over before the
    first message is allowed.

    Attributes
    ----------
    endpoint : str
        Where it is bound, with the port that was found if 0 was asked for.
    dropped : int
        How often a subscriber's queue was found full. A lower bound of the messages lost: while the queue stays full
        ZeroMQ drops silently, and only the subscriber can count them, from ``seq``.

    Raises
    ------
    EnvironmentFault
        If the endpoint cannot be bound, such as a port in use.
    InputError
        If the path of an ``ipc://`` endpoint is a file of another kind, which binding would replace; if a certificate
        cannot be used, or others could read the secret one.
    """

    def __init__(
        self, settings: PublishSettings, *, clock: WallClock, machine: str, linger_ms: int = LINGER_MS
    ) -> None:
        self.dropped = 0
        self._clock = clock
        self._machine = machine
        self._session = uuid.uuid4().hex
        self._seq: Counter[str] = Counter()
        self._subscriptions: set[bytes] = set()
        self._view = SignalView()
        self._turned: dict[int, Orders] = {}
        self._waiting: list[tuple[Orders | None, OdpFrame, Odp]] = []
        self._context = zmq.Context()
        self._guard: Guard | None = None
        self._socket = self._context.socket(zmq.XPUB)
        self._socket.sndhwm = settings.high_water_mark
        self._socket.linger = linger_ms
        self._socket.setsockopt(zmq.XPUB_NODROP, 1)  # a full queue is reported, see _send
        try:
            if settings.server_key is not None and settings.allowed_clients is not None:
                self._guard = Guard(
                    self._context,
                    server_key=Path(settings.server_key),
                    allowed_clients=Path(settings.allowed_clients),
                )
                self._guard.protect(self._socket)
            self.endpoint = bind(self._socket, settings.bind, setting="[publish] bind")
        except ChatterMonitorError:
            self.close()
            raise

    def block(self, block: Block) -> None:
        """Keep the samples until the frames that they complete have come."""
        self._view.block(block)

    def turning(self, channel: int, orders: Orders) -> None:
        """Keep what turned for the frame that comes next."""
        self._turned[channel] = orders

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Keep an interval: ten times the bytes of its verdict, which is not to wait for them."""
        self._waiting.append((self._turned.get(frame.channel), frame, odp))

    def digest(self) -> None:
        """Publish intervals on ``odp.<channel>``, and on ``signal.<channel>`` if anybody has subscribed to that."""
        for orders, frame, odp in self._waiting:
            self._send_odp(frame, odp)
            topic = f"signal.{frame.channel}".encode()
            # Whoever subscribes to everything does not mean this.
            if orders is not None and any(topic.startswith(prefix) for prefix in self._subscriptions if prefix):
                self._view.turning(frame.channel, orders)
                signal = self._view.frame(frame)
                if signal is not None:
                    self._send_signal(signal)
        self._waiting.clear()

    def _send_signal(self, signal: SignalFrame) -> None:
        topic = topic_of(signal)
        arrays, payloads = _payload(signal, SIGNAL_DTYPES)
        header = SignalHeader(
            **msgspec.structs.asdict(self._header(topic, signal.first_sample)),
            channel=signal.channel,
            samples=signal.samples,
            rotation_hz=signal.rotation_hz,
            orders_hz=signal.orders_hz,
            payloads=payloads,
        )
        self._send(topic, header, *arrays)

    def _send_odp(self, frame: OdpFrame, odp: Odp) -> None:
        """Send all samples, the summary in the header."""
        topic = topic_of(frame)
        arrays, payloads = _payload(frame, PAYLOAD_DTYPES)
        header = OdpHeader(
            **msgspec.structs.asdict(self._header(topic, frame.first_sample)),
            odp=odp,
            rms=frame.rms,
            lost=frame.lost,
            flags=frame.flags.names(),
            payloads=payloads,
        )
        self._send(topic, header, *arrays)

    def message(self, message: Announcement) -> None:
        """Publish a message of the public contract; the body is the same JSON object as in ``--jsonl``."""
        match message:
            case Verdict():
                sample0 = message.sample0
            case Event():
                sample0 = self._clock.sample_at(message.onset_s)
            case Mismatch():
                sample0 = message.sample
            case Health():
                sample0 = self._clock.sample_at(message.t)
        topic = topic_of(message)
        self._send(topic, self._header(topic, sample0), encode(message))

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        """Wait until somebody subscribes to anything; tell whether somebody has."""
        deadline = time.monotonic() + timeout_s
        self._hear_subscriptions()
        while not self._subscriptions and (left_s := deadline - time.monotonic()) > 0:
            self._socket.poll(int(left_s * 1000) + 1)
            self._hear_subscriptions()
        return bool(self._subscriptions)

    def close(self) -> None:
        """Give connected subscribers a bounded time to take the last messages, and free the port."""
        self._socket.close()
        if self._guard is not None:
            self._guard.close()
        self._context.term()

    def _header(self, topic: str, sample0: int) -> Header:
        """Header of the topic's next message."""
        seq = self._seq[topic]
        self._seq[topic] += 1
        return Header(
            schema=schema_name(topic.partition(".")[0]),
            session=self._session,
            seq=seq,
            sample0=sample0,
            fs=self._clock.sample_rate_hz,
            utc=self._clock.utc_of(sample0),
            machine=self._machine,
        )

    def _send(self, topic: str, header: Header, *payload: bytes | memoryview) -> None:
        """Send to every subscriber that has room."""
        self._hear_subscriptions()  # they would pile up in the socket
        parts = [topic.encode(), encode(header), *payload]
        try:
            self._socket.send_multipart(parts, zmq.NOBLOCK)
        except zmq.Again:
            # A queue is full. Nobody got the message: send it again to those who have room.
            self.dropped += 1
            self._socket.setsockopt(zmq.XPUB_NODROP, 0)
            self._socket.send_multipart(parts, zmq.NOBLOCK)
            self._socket.setsockopt(zmq.XPUB_NODROP, 1)

    def _hear_subscriptions(self) -> None:
        """Take in who has come and gone."""
        while int(self._socket.getsockopt(zmq.EVENTS)) & zmq.POLLIN:
            note = self._socket.recv()
            if note.startswith(b"\x01"):
                self._subscriptions.add(note[1:])
            elif note.startswith(b"\x00"):
                self._subscriptions.discard(note[1:])


def _payload(frame: OdpFrame | SignalFrame, dtypes: Mapping[str, str]) -> tuple[list[memoryview], list[Payload]]:
    """Arrays of a frame as they travel, and what the header says of them."""
    arrays = {name: np.ascontiguousarray(getattr(frame, name), dtype=dtype) for name, dtype in dtypes.items()}
    about = [Payload(name, dtypes[name], values.shape) for name, values in arrays.items()]
    return [values.data for values in arrays.values()], about
