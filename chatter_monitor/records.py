"""The nouns that the parts hand to each other: blocks of samples, ODPs, verdicts, events, health.

Those with arrays inside are dataclasses and stay within the process. The rest are the JSON messages of the
public contract (``--jsonl`` and ZeroMQ bodies are the same objects): the field order is the order in the message,
``type`` first.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

State = Literal["idle", "stable", "forced", "approaching", "self_excited", "unknown"]


class Flag(enum.IntFlag):
    """What is wrong with a stretch of samples. Any of them but CLIPPED makes the verdict ``unknown``."""

    NONE = 0
    GAP = 1
    OVERFLOW = 2
    CLIPPED = 4
    NON_FINITE = 8
    DEAD_CHANNEL = 16

    def names(self) -> list[str]:
        """Lower-case names of the flags that are set, in a fixed order."""
        return [member.name.lower() for member in self if member.name] if self else []


class ModeStatus(enum.IntEnum):
    """What a mode's values at one sample stand for."""

    OSCILLATORY = 0
    REAL_PAIR = 1  # two real poles: no frequency, its fields are NaN
    HELD = 2  # adaptation frozen (silence, missing samples): values are those of the last adapted sample
    STARTING = 3  # too few samples since the start or a gap: values are NaN


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Consecutive samples of all channels of a source.

    Attributes
    ----------
    first_sample : int
        Index of ``samples[0]`` on the source's clock (counts at `sample_rate_hz` from the start, lost ones included).
    samples : ndarray of float64, shape (n, channels)
        Full scale is ±1 for sound; physical units where the source knows them.
    sample_rate_hz : float
        Rate of `first_sample` and `samples`.
    lost : int
        Samples lost between the previous block and this one.
    flags : tuple of Flag, one per channel
        What is wrong with these samples; empty for nothing.
    arrived_s : float or None
        When the last of these samples came out of the device, on a steady clock; None for what no device delivered.
    """

    first_sample: int
    samples: NDArray[np.float64]
    sample_rate_hz: float
    lost: int = 0
    flags: tuple[Flag, ...] = ()
    arrived_s: float | None = None

    def channel_flags(self, channel: int) -> Flag:
        """Flags of one channel, a gap before the block included."""
        flags = self.flags[channel] if self.flags else Flag.NONE
        return flags | Flag.GAP if self.lost else flags


@dataclass(frozen=True, slots=True, eq=False)
class OdpFrame:
    """Operational dynamic parameters of one channel at every sample of one verdict interval.

    Attributes
    ----------
    channel, first_sample : int
        Which channel, and the index of the first row.
    sample_rate_hz : float
        Rate of the tracker.
    frequency_hz, damping_ratio, frequency_sd_hz, damping_sd : ndarray of float32, shape (n, modes)
        Undamped natural frequency and damping ratio of each mode slot with their standard deviations; NaN where
        `status` says that there is none.
    status : ndarray of uint8, shape (n, modes)
        A `ModeStatus` each.
    share : ndarray of float64, shape (modes,)
        Share of the signal's power that each mode carries, at the end of the frame; sums to at most 1.
    rms : float
        Root mean square of the samples in the frame, in the source's units.
    lost : int
        Samples of the source lost in this frame or just before it.
    flags : Flag
        What is wrong with the frame's samples.
    signal : ndarray of float64, shape (n,)
        What the model was fitted to: without offset, in the source's units; NaN where samples are missing. It stays in
        the process: frames that a subscriber receives have none.
    hold : ndarray of int64, shape (modes,)
        For how many rows in a row a value of each mode slot stands, because it comes from a recursion at a lower rate.
        It stays in the process, too.
    """

    channel: int
    first_sample: int
    sample_rate_hz: float
    frequency_hz: NDArray[np.float32]
    damping_ratio: NDArray[np.float32]
    frequency_sd_hz: NDArray[np.float32]
    damping_sd: NDArray[np.float32]
    status: NDArray[np.uint8]
    share: NDArray[np.float64]
    rms: float
    lost: int = 0
    flags: Flag = field(default=Flag.NONE)
    signal: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    hold: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    def __len__(self) -> int:
        return int(self.frequency_hz.shape[0])


@dataclass(frozen=True, slots=True, eq=False)
class SignalFrame:
    """What one channel sounded like in one verdict interval, before anything is taken out, reduced for the eye.

    Attributes
    ----------
    channel, first_sample, samples : int
        Which channel, index of the interval's first sample, and how many it has.
    sample_rate_hz : float
        Rate of that index.
    extremes : ndarray of float32, shape (n, 2)
        Smallest and largest sample in each of n equal parts of the interval, in the source's units; NaN where samples
        are missing.
    level_db : ndarray of float32, shape (1, bins)
        Amplitude spectrum of the last tenth of a second, in decibels over an rms of one unit; bins are 10 Hz apart,
        from 0. NaN where samples are missing.
    rotation_hz : float or None
        What the spindle turns at, or the strongest comb where nobody knows the speed.
    orders_hz : tuple of float
        Where lines of combs were taken out before the tracker, strongest first.
    """

    channel: int
    first_sample: int
    samples: int
    sample_rate_hz: float
    extremes: NDArray[np.float32]
    level_db: NDArray[np.float32]
    rotation_hz: float | None = None
    orders_hz: tuple[float, ...] = ()


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="type"):
    """Base of the messages of the public contract."""


class Mode(msgspec.Struct, frozen=True):
    """One mode in an ODP message; frequency and damping are null while the mode has no frequency."""

    frequency_hz: float | None
    damping_ratio: float | None
    damping_ratio_ci95: tuple[float, float] | None
    share: float


class Odp(Message, frozen=True, tag="odp"):
    """Operational dynamic parameters at one instant (20 per second; every sample goes to Parquet and binary)."""

    channel: int
    t: float
    modes: list[Mode]


class Verdict(Message, frozen=True, tag="verdict"):
    """What the machine does between two samples. The intervals of a channel are contiguous."""

    channel: int
    t0: float
    t1: float
    sample0: int
    sample1: int
    state: State
    frequency_hz: float | None = None
    damping_ratio: float | None = None
    damping_ratio_ci95: tuple[float, float] | None = None
    order: float | None = None
    confidence: float = 0.0
    chatter_probability: float | None = None
    margin_percent: float | None = None
    margin_percent_ci95: tuple[float, float] | None = None
    reasons: list[str] = []
    flags: list[str] = []


class Advice(msgspec.Struct, frozen=True):
    """A spindle speed between two lobes, with so many whole waves of the chatter between two teeth."""

    spindle_rpm: float
    lobe: int


class Event(Message, frozen=True, tag="event"):
    """Something that happened and ended, such as a stretch of chatter; ``withdrawn`` if it turned out to be none.

    Its frequency and damping are None where it was in no line.
    """

    id: str
    channel: int
    kind: Literal["chatter"]
    onset_s: float
    end_s: float
    peak_frequency_hz: float | None
    min_damping_ratio: float | None
    advice: list[Advice] = []
    remedy: str = ""
    recording: str | None = None
    withdrawn: bool = False


class Mismatch(Message, frozen=True, tag="mismatch"):
    """How the running simulation and the signal stand to each other, when that changes and while they differ."""

    channel: int
    t: float
    sample: int
    since_s: float
    outcome: Literal["none", "parameters", "missing_physics", "unknown"]
    effect: str | None = None
    sense: str | None = None
    parameters: dict[str, float] = {}
    evidence_nats: float = 0.0
    runner_up: str | None = None
    distance_nats: float | None = None
    band_hz: tuple[float, float] | None = None
    amplitude: float | None = None
    summary: str = ""


class Health(Message, frozen=True, tag="health"):
    """How well the monitor hears, every second and when it stops or begins to hear."""

    t: float
    state: Literal["hearing", "not_hearing", "finished"]
    samples_in: int
    lost: int
    overflows: int
    clipped: int
    non_finite: int
    publications_dropped: int
    ring_fill: float
    latency_ms_p50: float | None
    latency_ms_p99: float | None
    clock_ppm: float | None = None
    reasons: list[str] = []


# What outlets are told beside frames.
Announcement = Verdict | Event | Mismatch | Health
