"""What travels over ZeroMQ: topics, headers, payload frames. The publisher writes it, the client reads it.

A message is multipart: topic, header (JSON), payload frames. ``docs/asyncapi.yaml`` describes the same for users of
other languages; a test holds the two together. JSON bodies are encoded here for ``--jsonl`` as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import msgspec
import numpy as np

from chatter_monitor.records import Event, Health, Mismatch, Odp, OdpFrame, SignalFrame, Verdict

DEFAULT_ENDPOINT = "tcp://127.0.0.1:5557"
# At 20 verdict intervals a second, each one ODP and one verdict message: 100 s of one channel before anything is lost,
# at about 50 MB (two modes). It is also what a subscriber may fall behind a replay at full speed.
DEFAULT_HIGH_WATER_MARK = 4096

# Raised when a reader of the old form would misread the new one; a new field is no reason.
SCHEMA_MAJOR = 1

# Payload frames of odp.<channel>, in their order, with their types: little-endian whatever the machine.
PAYLOAD_DTYPES = {
    "frequency_hz": "<f4",
    "damping_ratio": "<f4",
    "damping_sd": "<f4",
    "frequency_sd_hz": "<f4",
    "status": "|u1",
}
# The same of signal.<channel>.
SIGNAL_DTYPES = {"extremes": "<f4", "level_db": "<f4"}


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """Second frame of every message.

    Attributes
    ----------
    schema : str
        ``chatter-monitor/<kind>/<major version>``.
    session : str
        Random name of this run of the publisher; `seq` starts anew with it.
    seq : int
        Number of the message within its topic, from 0.
    sample0 : int
        Index of the first sample that the message is about.
    fs : float
        Samples of that index per second.
    utc : str
        Time of `sample0`, ISO 8601 with microseconds.
    machine : str
        Name of the machine.
    """

    schema: str
    session: str
    seq: Annotated[int, msgspec.Meta(ge=0)]
    sample0: int
    fs: float
    utc: str
    machine: str


class Payload(msgspec.Struct, frozen=True):
    """Name, numpy dtype and shape, such as (samples, modes), of one payload frame, C order."""

    name: str
    dtype: str
    shape: tuple[Annotated[int, msgspec.Meta(ge=0)], ...]


class OdpHeader(Header, frozen=True, kw_only=True):
    """Header of ``odp.<channel>``: the interval's summary, its loss and flags, and what the payload frames hold.

    `odp` is the 20 Hz message of ``--jsonl``: whoever wants no more than that need not look at the payload.
    """

    odp: Odp
    rms: float
    lost: int
    flags: list[str]
    payloads: list[Payload]


class SignalHeader(Header, frozen=True, kw_only=True):
    """Header of ``signal.<channel>``: what turned in the interval, and what the payload frames hold."""

    channel: int
    samples: int
    rotation_hz: float | None
    orders_hz: tuple[float, ...]
    payloads: list[Payload]


@dataclass(frozen=True, slots=True)
class Received:
    """One message off a monitor's socket.

    Attributes
    ----------
    topic : str
        Such as ``odp.0`` or ``health``.
    header : Header
        An `OdpHeader` on ``odp.<channel>``, with the interval's summary in ``odp``.
    body : OdpFrame, SignalFrame, Verdict, Event, Health or Mismatch
        The arrays of a frame are read-only views of the received buffers.
    """

    topic: str
    header: Header
    body: OdpFrame | SignalFrame | Verdict | Event | Health | Mismatch


def topic_of(result: OdpFrame | SignalFrame | Verdict | Event | Health | Mismatch) -> str:
    """Topic of a frame or a message; up to the first dot it is the kind."""
    match result:
        case SignalFrame():
            return f"signal.{result.channel}"
        case OdpFrame():
            return f"odp.{result.channel}"
        case Verdict():
            return f"verdict.{result.channel}"
        case Mismatch():
            return f"mismatch.{result.channel}"
        case Event():
            return "event"
        case Health():
            return "health"


def schema_name(kind: str) -> str:
    """Name and version of the messages of one kind (odp, signal, verdict, event, mismatch, health)."""
    return f"chatter-monitor/{kind}/{SCHEMA_MAJOR}"


def _plain(value: Any) -> Any:
    """Python's number for one of numpy's, which type checkers let pass for a float."""
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


def encode(message: msgspec.Struct) -> bytes:
    """JSON of a message or a header; a number that is not finite becomes null."""
    return _ENCODER.encode(message)
