"""The files of one recorded event: samples (FLAC or WAV), ODPs (Parquet), verdicts (JSON lines), and its JSON."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import soundfile
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.odp_table import OdpTable
from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Block, Event, Flag, OdpFrame, Verdict

SCHEMA = "chatter-monitor/recording/1"

# 24 bits are what converters resolve, and the most that FLAC files of libsndfile hold.
CODES = 2**23
FLAC_CHANNELS = 8


class RecordedEvent(Event, frozen=True, kw_only=True, tag="event"):
    """The event of the public contract and what it takes to read and to replay its recording.

    Attributes
    ----------
    schema : str
        `SCHEMA`.
    recording, odp, verdicts : str
        File names of samples, ODPs and verdicts, beside this one.
    machine : str
        Name of the machine.
    utc : str
        Time of the first sample, ISO 8601.
    first_sample, samples : int
        Index of the recording's first sample on the monitor's clock, and how many there are.
    sample_rate_hz, source_rate_hz : float
        Rate of the recording, which is the tracker's, and rate at which the signal was sampled first.
    full_scale_per_unit : float
        What the samples were multiplied by to fit a sound file; ``[input] full_scale_per_unit`` takes it out again.
    missing_samples : int
        Samples that the monitor never got; they are NaN in the recording.
    truncated : bool
        Whether ``[recorder] max_s`` cut the recording before the event, or what follows it, was over.
    settings : dict
        Tables of the machine configuration that the verdicts depend on.
    """

    schema: str
    odp: str
    verdicts: str
    machine: str
    utc: str
    first_sample: int
    samples: int
    sample_rate_hz: float
    source_rate_hz: float
    full_scale_per_unit: float
    missing_samples: int
    truncated: bool
    settings: dict[str, dict[str, Any]]

    @property
    def onset_utc(self) -> str:
        """Time of the onset, ISO 8601."""
        before_s = self.onset_s - self.first_sample / self.sample_rate_hz
        return (datetime.fromisoformat(self.utc) + timedelta(seconds=before_s)).isoformat()


@dataclass(frozen=True)
class Origin:
    """What all events of a monitor have in common.

    Attributes
    ----------
    settings : mapping
        Tables of the machine configuration that the verdicts depend on.
    sample_rate_hz, source_rate_hz : float
        Rate of blocks and frames, and rate at which the signal was sampled first.
    channels, modes : int
        Columns of the blocks; mode slots of the frames.
    machine : str
        Name of the machine.
    full_scale_per_unit : float
        Reading of a sound file, as a fraction of its full scale, for one unit of the blocks.
    """

    settings: Mapping[str, dict[str, Any]]
    sample_rate_hz: float
    source_rate_hz: float
    channels: int
    modes: int
    machine: str
    full_scale_per_unit: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """An event with the part of the signal that is kept.

    Attributes
    ----------
    event : Event
        What happened.
    origin : Origin
        Where it comes from.
    frames : sequence of OdpFrame
        Of the event's channel, without a gap; their samples are the ones that are kept.
    verdicts : sequence of Verdict
        What was said of these frames.
    blocks : sequence of Block
        In the order of time, all those that hold samples of the frames.
    truncated : bool
        Whether the event, or what was to be kept after it, goes on behind the last frame.
    """

    event: Event
    origin: Origin
    frames: Sequence[OdpFrame]
    verdicts: Sequence[Verdict]
    blocks: Sequence[Block]
    truncated: bool

    @property
    def first_sample(self) -> int:
        """Index of the first sample."""
        return self.frames[0].first_sample

    @property
    def end_sample(self) -> int:
        """Index after the last sample."""
        return self.frames[-1].first_sample + len(self.frames[-1])

    def signal(self) -> tuple[NDArray[np.float64], int]:
        """Samples, shape (n, channels), NaN where there are none, and how many the monitor never got."""
        samples = np.full((self.end_sample - self.first_sample, self.origin.channels), np.nan)
        missing = len(samples)
        for block in self.blocks:
            begin = max(block.first_sample, self.first_sample)
            end = min(block.first_sample + len(block.samples), self.end_sample)
            if end <= begin:
                continue
            missing -= end - begin
            rows = slice(begin - self.first_sample, end - self.first_sample)
            samples[rows] = block.samples[begin - block.first_sample : end - block.first_sample]
            for channel, flags in enumerate(block.flags):
                if flags & Flag.NON_FINITE:  # placeholders, not measurements
                    samples[rows, channel] = np.nan
        return samples, missing


def write(folder: Path, name: str, stretch: Stretch, utc: str) -> None:
    """Write the files of an event, called `name`, into a folder.

    Parameters
    ----------
    folder : Path
        An existing directory.
    name : str
        The event's name in the store, which becomes its id.
    stretch : Stretch
        The event.
    utc : str
        Time of the first sample.

    Raises
    ------
    OSError, ChatterMonitorError
        If the disk is full or fails.
    """
    origin = stretch.origin
    samples, missing = stretch.signal()
    samples *= origin.full_scale_per_unit
    suffix, sound = _sound_file(samples, round(origin.sample_rate_hz))
    (folder / f"{name}{suffix}").write_bytes(sound)
    table = folder / f"{name}.parquet"
    with OdpTable(table, modes=origin.modes, sample_rate_hz=origin.sample_rate_hz, machine=origin.machine) as odps:
        for frame in stretch.frames:
            odps.append(frame)
    verdicts = folder / f"{name}.jsonl"
    verdicts.write_bytes(b"".join(encode(verdict) + b"\n" for verdict in stretch.verdicts))
    recorded = RecordedEvent(
        **msgspec.structs.asdict(msgspec.structs.replace(stretch.event, id=name, recording=f"{name}{suffix}")),
        schema=SCHEMA,
        odp=table.name,
        verdicts=verdicts.name,
        machine=origin.machine,
        utc=utc,
        first_sample=stretch.first_sample,
        samples=len(samples),
        sample_rate_hz=origin.sample_rate_hz,
        source_rate_hz=origin.source_rate_hz,
        full_scale_per_unit=origin.full_scale_per_unit,
        missing_samples=missing,
        truncated=stretch.truncated,
        settings=dict(origin.settings),
    )
    (folder / f"{name}.json").write_bytes(msgspec.json.format(encode(recorded), indent=1) + b"\n")


def read(path: Path) -> RecordedEvent:
    """Read the JSON of an event.

    Raises
    ------
    InputError
        If the file cannot be read or is not the JSON of a recorded event.
    """
    try:
        recorded = msgspec.json.decode(path.read_bytes(), type=RecordedEvent)
    except OSError as error:
        raise InputError(f"the event cannot be read: {error.strerror}", got=str(path)) from error
    except msgspec.DecodeError as error:
        raise InputError(f"this is not the JSON of a recorded event: {error}", got=str(path)) from error
    if recorded.schema != SCHEMA:
        raise InputError("the event was written by another version", got=recorded.schema, allowed=SCHEMA)
    return recorded


def read_verdicts(path: Path) -> list[Verdict]:
    """Read the verdicts that were given while an event was recorded; their times are on the monitor's clock.

    Raises
    ------
    InputError
        If the file cannot be read or holds anything else.
    """
    try:
        return msgspec.json.Decoder(Verdict).decode_lines(path.read_bytes())
    except OSError as error:
        raise InputError(f"the verdicts of the event cannot be read: {error.strerror}", got=str(path)) from error
    except msgspec.DecodeError as error:
        raise InputError(f"these are not the verdicts of an event: {error}", got=str(path)) from error


def recorded_event(recording: Path) -> RecordedEvent | None:
    """Event that a sound file is the recording of, from the JSON beside it; None for any other sound file."""
    try:
        recorded = read(recording.with_suffix(".json"))
    except InputError:
        return None
    return recorded if recorded.recording == recording.name else None


def _sound_file(samples: NDArray[np.float64], rate_hz: int) -> tuple[str, bytes]:
    """Suffix and contents: 24-bit FLAC where it can hold the samples, else WAV of 32-bit floats.

    It is made in memory, because libsndfile does not tell when a disk fills up while it closes a file; a second after
    the other, so that there are no further copies of the whole.
    """
    channels = samples.shape[1]
    seconds = [samples[begin : begin + rate_hz] for begin in range(0, len(samples), rate_hz)]
    file = io.BytesIO()
    if channels <= FLAC_CHANNELS and all(_fits(second) for second in seconds):
        with soundfile.SoundFile(file, "w", rate_hz, channels, format="FLAC", subtype="PCM_24") as flac:
            for second in seconds:
                flac.write(np.rint(second * CODES).astype(np.int32) << 8)  # left-aligned
        return ".flac", file.getvalue()
    with soundfile.SoundFile(file, "w", rate_hz, channels, format="WAV", subtype="FLOAT") as wav:
        for second in seconds:
            wav.write(second.astype(np.float32))
    return ".wav", file.getvalue()


def _fits(samples: NDArray[np.float64]) -> bool:
    """Whether 24 bits hold the samples; NaN they do not."""
    codes = np.rint(samples * CODES)
    return bool(np.all((codes >= -CODES) & (codes < CODES)))
