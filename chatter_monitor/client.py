"""What a program imports to read the monitor's messages from its ZeroMQ socket."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np
import zmq
from numpy.typing import NDArray

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.certificates import KeyPair, read_public, read_secret
from chatter_monitor.outlets.wire import (
    DEFAULT_ENDPOINT,
    DEFAULT_HIGH_WATER_MARK,
    PAYLOAD_DTYPES,
    SCHEMA_MAJOR,
    SIGNAL_DTYPES,
    Header,
    OdpHeader,
    Received,
    SignalHeader,
    schema_name,
    topic_of,
)
from chatter_monitor.records import Event, Flag, Health, Mismatch, OdpFrame, SignalFrame, Verdict

__all__ = ["Received", "Subscriber"]

BODIES: dict[str, type[Verdict | Event | Health | Mismatch]] = {
    "verdict": Verdict,
    "event": Event,
    "health": Health,
    "mismatch": Mismatch,
}
KINDS = ("odp", "signal", *BODIES)


class Subscriber:
    """Receives what a monitor publishes: iterate over it, or call `receive`.

    The monitor need not run yet, and may be restarted: the connection is made, and made again, in the background.

    Parameters
    ----------
    endpoint : str
        Where the monitor publishes.
    topics : sequence of str
        Topics to receive: ``verdict.0``, or ``verdict`` for all channels; an empty string means everything but
        ``signal``, which has to be asked for.
    high_water_mark : int
        Messages kept on this side while the program is busy with others.
    server_public_key, client_secret_key : path, optional
        Certificate files, both or neither: the monitor's public one and this program's secret one, for a monitor that
        encrypts. Whoever is not on its allow-list receives nothing, as if it did not run.

    Attributes
    ----------
    lost : Counter of str
        Messages lost so far, by topic. What was published before the first message received does not count.
    restarts : int
        How often another run of the publisher took over.
    malformed : int
        Messages that could not be read, and were skipped. They count as lost too.

    Raises
    ------
    InputError
        If the endpoint is malformed, a certificate cannot be used, or others could read the secret one.
    EnvironmentFault
        By `receive` and iteration, if the publisher speaks a later version of the protocol.
    """

    def __init__(
        self,
        endpoint: str = DEFAULT_ENDPOINT,
        topics: Sequence[str] = ("",),
        high_water_mark: int = DEFAULT_HIGH_WATER_MARK,
        *,
        server_public_key: Path | str | None = None,
        client_secret_key: Path | str | None = None,
    ) -> None:
        self.lost: Counter[str] = Counter()
        self.restarts = 0
        self.malformed = 0
        self._topics = tuple(topics)
        self._session: str | None = None
        self._expected: dict[str, int] = {}
        keys = _keys(server_public_key, client_secret_key)
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.rcvhwm = high_water_mark
        self._socket.linger = 0
        self._socket.ipv6 = "[" in endpoint
        for topic in self._topics:
            self._socket.setsockopt_string(zmq.SUBSCRIBE, topic)
        if keys is not None:
            server, own = keys
            self._socket.curve_serverkey = server
            self._socket.curve_publickey, self._socket.curve_secretkey = own.public, own.secret
        try:
            self._socket.connect(endpoint)
        except zmq.ZMQError as error:
            self.close()
            raise InputError(
                f"cannot subscribe: {zmq.strerror(error.errno or 0)}",
                got=endpoint,
                allowed="such as " + DEFAULT_ENDPOINT,
            ) from error

    def receive(self, timeout_s: float | None = None) -> Received | None:
        """Return the next message, or None if there is none within the timeout (None: wait for ever)."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            left_ms = None if deadline is None else max(0, int((deadline - time.monotonic()) * 1000))
            if not self._socket.poll(left_ms):
                return None
            parts = self._socket.recv_multipart()
            try:
                received = _read(parts)
            except (ValueError, RecursionError):  # of msgspec, numpy, UTF-8 and our own checks alike
                self.malformed += 1
                continue
            if self._wanted(received.topic):
                self._account(received.topic, received.header)
                return received

    def __iter__(self) -> Iterator[Received]:
        while (received := self.receive()) is not None:
            yield received

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()
        self._context.term()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _wanted(self, topic: str) -> bool:
        """Whether the topic was asked for: ZeroMQ matches prefixes, so ``odp.1`` brings ``odp.10`` as well."""
        return any(
            topic == asked or topic.startswith(asked + ".") or (asked == "" and not topic.startswith("signal."))
            for asked in self._topics
        )

    def _account(self, topic: str, header: Header) -> None:
        """Count what is missing before this message."""
        if header.session != self._session:
            self.restarts += self._session is not None
            self._session = header.session
            self._expected = dict.fromkeys(self._expected, 0)  # the new run began while we were listening
        self.lost[topic] += max(0, header.seq - self._expected.get(topic, header.seq))
        self._expected[topic] = header.seq + 1


def _keys(server: Path | str | None, client: Path | str | None) -> tuple[bytes, KeyPair] | None:
    """Read the certificates, if there are any: the server's public key and our pair."""
    if server is None and client is None:
        return None
    if server is None or client is None:
        raise InputError("server_public_key and client_secret_key go together, and one of them is missing")
    return read_public(Path(server)), read_secret(Path(client))


class _Version(msgspec.Struct):
    schema: str


def _read(parts: list[bytes]) -> Received:
    """Read a multipart message; ValueError if it is malformed, EnvironmentFault if it is of a later version."""
    if len(parts) < 3:
        raise ValueError("a topic, a header and a payload are needed")
    topic = parts[0].decode()
    kind = topic.partition(".")[0]
    _check_version(kind, msgspec.json.decode(parts[1], type=_Version).schema)
    header: Header
    body: OdpFrame | SignalFrame | Verdict | Event | Health | Mismatch
    if kind == "odp":
        header = msgspec.json.decode(parts[1], type=OdpHeader)
        body = _frame(header, parts[2:])
    elif kind == "signal":
        header = msgspec.json.decode(parts[1], type=SignalHeader)
        body = _signal_frame(header, parts[2:])
    else:
        header = msgspec.json.decode(parts[1], type=Header)
        body = msgspec.json.decode(parts[2], type=BODIES[kind])
    if topic != topic_of(body):
        raise ValueError("topic and body are of different channels")
    return Received(topic, header, body)


def _check_version(kind: str, schema: str) -> None:
    if kind not in KINDS:
        raise ValueError("a topic of a kind that this client does not know")
    family, _, major = schema.rpartition("/")
    if f"{family}/{SCHEMA_MAJOR}" != schema_name(kind) or not major.isdecimal():
        raise ValueError("the schema does not belong to the topic")
    if int(major) != SCHEMA_MAJOR:
        raise EnvironmentFault(
            "the publisher speaks another version of the protocol",
            got=schema,
            allowed=schema_name(kind),
            remedy="Install the same version of chatter_monitor on both sides.",
        )


def _arrays(header: OdpHeader | SignalHeader, payload: list[bytes], dtypes: dict[str, str]) -> dict[str, NDArray[Any]]:
    """Arrays out of the payload; those of a later minor version have no place here and are left out."""
    known = {
        about.name: (about, data) for about, data in zip(header.payloads, payload, strict=True) if about.name in dtypes
    }
    if [known[name][0].dtype for name in dtypes if name in known] != list(dtypes.values()):
        raise ValueError("payload frames are missing, or of another type")
    return {name: np.frombuffer(data, about.dtype).reshape(about.shape) for name, (about, data) in known.items()}


def _signal_frame(header: SignalHeader, payload: list[bytes]) -> SignalFrame:
    """Frame out of the payload."""
    arrays = _arrays(header, payload, SIGNAL_DTYPES)
    if arrays["extremes"].shape[1:] != (2,) or len(arrays["level_db"].shape) != 2:
        raise ValueError("payload frames are of another shape")
    return SignalFrame(
        channel=header.channel,
        first_sample=header.sample0,
        samples=header.samples,
        sample_rate_hz=header.fs,
        **arrays,
        rotation_hz=header.rotation_hz,
        orders_hz=header.orders_hz,
    )


def _frame(header: OdpHeader, payload: list[bytes]) -> OdpFrame:
    """Frame out of the payload."""
    arrays = _arrays(header, payload, PAYLOAD_DTYPES)
    if {array.shape[1:] for array in arrays.values()} != {(len(header.odp.modes),)}:
        raise ValueError("payload frames and summary are of different modes")
    if len({len(array) for array in arrays.values()}) != 1:
        raise ValueError("payload frames are of different lengths")
    return OdpFrame(
        channel=header.odp.channel,
        first_sample=header.sample0,
        sample_rate_hz=header.fs,
        **arrays,
        share=np.array([mode.share for mode in header.odp.modes]),
        rms=header.rms,
        lost=header.lost,
        flags=_flags(header.flags),
    )


def _flags(names: list[str]) -> Flag:
    """Flags by their names; those of a later minor version have none here and are left out."""
    flags = Flag.NONE
    for flag in Flag:
        if flag.name and flag.name.lower() in names:
            flags |= flag
    return flags
