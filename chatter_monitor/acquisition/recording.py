"""Recordings on disk: WAV, FLAC and whatever else libsndfile reads, never more than a block in memory."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from chatter_monitor.acquisition.faults import FaultFinder, block_flags, equal_runs
from chatter_monitor.acquisition.source import Source
from chatter_monitor.errors import InputError
from chatter_monitor.records import Block

_PCM_BYTES = {"PCM_S8": 1, "PCM_U8": 1, "PCM_16": 2, "PCM_24": 3, "PCM_32": 4}
_SAMPLE_BYTES = _PCM_BYTES | {"FLOAT": 4, "DOUBLE": 8, "ULAW": 1, "ALAW": 1}
_CONVERTER_BITS = 24  # no converter resolves more; in a 32-bit file its largest code stands short of the format's

# What libsndfile logs about a file that is shorter than its header says: bytes for WAV, samples for RF64 and AIFF.
_PROMISED_BYTES = re.compile(r"^data : (\d+) \(should be \d+\)", re.MULTILINE)
_PROMISED_SAMPLES = re.compile(r"(?:does not match value from 'ds64' chunk of |read from 'COMM' chunk \()(\d+)")
# Programs that write WAV into a pipe cannot know its size and promise the largest one: 2 or 4 GB less some header.
_SIZE_UNKNOWN = (range(0x7FFFF000, 0x80000001), range(0xFFFFF000, 0x100000000))
_FRAMES_UNKNOWN = 2**63 - 1  # libsndfile's word for a FLAC stream that was written into a pipe

_ALLOWED = "a WAV, FLAC or other sound file with samples in it"


class Recording(Source):
    """Samples of a sound file, at the file's own rate.

    Full scale is ±1 for integer formats; floating-point formats yield what they hold. Samples that are not finite
    are replaced by 0. Stretches with them, or with clipping, come as blocks of their own under
    `Flag.NON_FINITE` and `Flag.CLIPPED`, the same whatever the block size.

    Parameters
    ----------
    path : Path
        The file.
    channels : sequence of int, optional
        Channels to read, counted from 0; all by default.
    full_scale_per_unit : float
        Reading, as a fraction of full scale, for one unit of the sensor; samples are divided by it.
    block_samples : int
        Largest number of samples in a block.

    Attributes
    ----------
    missing_samples : int
        Samples that the header promises and the file does not hold; for compressed formats known at the end.

    Raises
    ------
    InputError
        If the file cannot be opened, is not a sound file, holds no samples, or lacks a channel that was asked for.
    """

    def __init__(
        self,
        path: Path,
        *,
        channels: Sequence[int] | None = None,
        full_scale_per_unit: float = 1.0,
        block_samples: int = 4096,
    ) -> None:
        self._path = path
        self._file = _open(path)
        try:
            self._columns = _select(path, channels, self._file.channels)
            if self._file.frames == 0:
                raise _without_samples(path)
        except InputError:
            self._file.close()
            raise
        self.sample_rate_hz = float(self._file.samplerate)
        self.channels = len(self._columns)
        self.length = None if self._file.frames == _FRAMES_UNKNOWN else int(self._file.frames)
        self._promised = _promised_samples(self._file)
        self.missing_samples = 0 if self._promised is None or self.length is None else self._promised - self.length
        self._full_scale_per_unit = full_scale_per_unit
        self._block_samples = block_samples
        self._faults = FaultFinder(self.channels, _ceiling(self._file.subtype))

    @property
    def clipped_samples(self) -> int:
        """Samples in runs at full scale so far, over all channels."""
        return self._faults.clipped_samples

    @property
    def non_finite_samples(self) -> int:
        """Samples so far that were NaN or infinite, over all channels."""
        return self._faults.non_finite_samples

    def blocks(self) -> Iterator[Block]:
        """Yield the recording block by block; what cannot be decoded any more ends it and counts as missing.

        Raises
        ------
        InputError
            If not a single sample can be decoded.
        """
        position = 0
        while len(samples := self._read()):
            flags = self._faults.inspect(samples)
            samples /= self._full_scale_per_unit
            for run in equal_runs(flags):
                yield Block(
                    position + run.start, samples[run], self.sample_rate_hz, flags=block_flags(flags[run.start])
                )
            position += len(samples)
        if position == 0:
            raise _without_samples(self._path)
        if self._promised is not None:
            self.missing_samples = self._promised - position

    def _read(self) -> NDArray[np.float64]:
        """Next samples of the selected channels; none at the end."""
        # What a decoder that fails has not reached stays NaN, and so tells how far it came.
        samples = np.full((self._block_samples, self._file.channels), np.nan)
        try:
            samples = self._file.read(out=samples)
        except soundfile.LibsndfileError:
            decoded = np.flatnonzero(~np.isnan(samples).all(axis=1))
            samples = samples[: decoded[-1] + 1 if decoded.size else 0]
        if self._columns == list(range(self._file.channels)):
            return samples
        return np.take(samples, self._columns, axis=1)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _open(path: Path) -> soundfile.SoundFile:
    try:
        with path.open("rb"):
            pass
    except OSError as error:
        what = f"the recording cannot be opened: {error.strerror}"
        raise InputError(what, got=str(path), allowed=_ALLOWED, remedy="Check the path.") from error
    try:
        return soundfile.SoundFile(path)
    except soundfile.LibsndfileError as error:
        if path.is_file() and path.stat().st_size == 0:
            raise _without_samples(path) from error
        raise InputError(
            f"the recording is not a sound file: {error.error_string.rstrip('.')}",
            got=str(path),
            allowed=_ALLOWED,
            remedy="Convert it to WAV or FLAC.",
        ) from error


def _without_samples(path: Path) -> InputError:
    return InputError(
        "the recording holds no samples", got=str(path), allowed=_ALLOWED, remedy="Record or copy the file again."
    )


def _select(path: Path, channels: Sequence[int] | None, available: int) -> list[int]:
    if channels is None:
        return list(range(available))
    absent = [channel for channel in channels if not 0 <= channel < available]
    if absent:
        raise InputError(
            f"the recording {str(path)!r} lacks a channel that [input] channels asks for",
            got=absent,
            allowed=f"0 to {available - 1}",
            remedy="Channels are counted from 0.",
        )
    return list(channels)


def _ceiling(subtype: str) -> float:
    """Magnitude of the largest code; 1 exactly for formats that are not integers."""
    if subtype not in _PCM_BYTES:
        return 1.0
    bits = min(8 * _PCM_BYTES[subtype], _CONVERTER_BITS)
    return 1.0 - 2.0 ** (1 - bits)


def _promised_samples(file: soundfile.SoundFile) -> int | None:
    """Samples that the file holds according to its header; None where the header does not know."""
    if file.frames == _FRAMES_UNKNOWN:
        return None
    if match := _PROMISED_SAMPLES.search(file.extra_info):
        return int(match[1])
    match = _PROMISED_BYTES.search(file.extra_info)
    if match and file.subtype in _SAMPLE_BYTES:
        size = int(match[1])
        if any(size in sizes for sizes in _SIZE_UNKNOWN):
            return None
        return size // int(file.channels * _SAMPLE_BYTES[file.subtype])
    return int(file.frames)
