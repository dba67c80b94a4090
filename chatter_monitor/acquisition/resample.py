"""From the rate of a source to the rate of the tracker."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import soxr
from numpy.typing import NDArray

from chatter_monitor.acquisition.faults import block_flags, equal_runs
from chatter_monitor.acquisition.source import Source
from chatter_monitor.kernels import conditioning
from chatter_monitor.records import Block, Flag

# libsoxr's best: aliases and rounding stay 28 bits below full scale, beneath the noise of any 24-bit recording, where
# those of "HQ" (20 bits) do not. It costs half as much again, and is still hundreds of times faster than the signal.
_QUALITY = "VHQ"
_REACH = 160  # samples of the slower rate on either side that an output sample depends on; measured: 152 at most
_PIECE_SAMPLES = 65536  # samples, of the faster rate, to convert at once: bounds the memory


@dataclass(frozen=True, slots=True)
class _Mark:
    """What is wrong with the output samples from `first` up to `end`."""

    first: int
    end: int
    flags: NDArray[np.uint8]
    lost: bool = False


class _Converter:
    """Streaming conversion whose output is aligned with the input: sample k is the signal at ``k / to_hz``.

    Where the input has more bandwidth than the output, libsoxr goes to twice the output rate and a half-band filter
    does the rest, because libsoxr alone would leave the uppermost tenth of the band empty, which upsets a model fitted
    to it (docs/decisions/0003-the-band-is-full.md).
    """

    def __init__(self, from_hz: float, to_hz: float, channels: int) -> None:
        self._halvers = [conditioning.new_half_band() for _ in range(channels)] if from_hz > to_hz else []
        between_hz = 2 * to_hz if self._halvers else to_hz
        self._soxr = soxr.ResampleStream(from_hz, between_hz, channels, dtype="float64", quality=_QUALITY)
        self.reach = _REACH * max(Fraction(1), Fraction(from_hz) / Fraction(between_hz))  # in input samples
        if self._halvers:
            self.reach += conditioning.HALF_BAND_DELAY * Fraction(from_hz) / Fraction(between_hz)
        # The filter's delay is odd. With one zero ahead it is even, and dropping outputs takes it out: that of the zero
        # and then half the delay.
        self._delay = conditioning.HALF_BAND_DELAY // 2
        for state in self._halvers:
            conditioning.halve(np.zeros(1), state, np.empty(1))

    def push(self, samples: NDArray[np.float64], last: bool = False) -> NDArray[np.float64]:
        """Take the next input samples, shape (n, channels), and return what has become ready."""
        converted: NDArray[np.float64] = self._soxr.resample_chunk(samples, last=last)
        return converted if not self._halvers else self._halve(converted, last)

    def _halve(self, samples: NDArray[np.float64], last: bool) -> NDArray[np.float64]:
        if last:
            samples = np.concatenate([samples, np.zeros((conditioning.HALF_BAND_TAPS, samples.shape[1]))])
        halved = np.empty((len(samples) // 2 + 1, len(self._halvers)), order="F")
        written = 0
        for channel, state in enumerate(self._halvers):
            written = conditioning.halve(np.ascontiguousarray(samples[:, channel]), state, halved[:, channel])
        dropped = min(self._delay, written)
        self._delay -= dropped
        return halved[dropped:written]


class Resampled(Source):
    """A source at another sample rate.

    Output sample k is the signal at ``k / sample_rate_hz`` exactly, the filter being linear-phase and its delay taken
    out; n input samples make n times the ratio of the rates, rounded. Samples and flags do not depend on how
    the source cuts its blocks. Flags reach every output sample that the flagged ones touch through the filter.
    The filter sees zeros where samples are lost; the output samples that fall there are lost too, and those that it
    touches carry `Flag.GAP`. With equal rates the blocks pass untouched.

    Parameters
    ----------
    source : Source
        Where the samples come from, all of them finite; closed with this one.
    sample_rate_hz : float
        Rate to convert to.
    """

    def __init__(self, source: Source, sample_rate_hz: float = 12800.0) -> None:
        self.sample_rate_hz = float(sample_rate_hz)
        self.channels = source.channels
        self._source = source
        self._ratio = Fraction(self.sample_rate_hz) / Fraction(source.sample_rate_hz)
        self._converter = _Converter(source.sample_rate_hz, self.sample_rate_hz, source.channels)
        self.length = None if source.length is None else math.floor(source.length * self._ratio + Fraction(1, 2))
        self._marks: deque[_Mark] = deque()
        self._end = 0  # of the last block given
        self._arrived_s: float | None = None  # of the last block taken

    def blocks(self) -> Iterator[Block]:
        """Yield the converted signal; blocks end where the flags change."""
        if self._ratio == 1:
            yield from self._source.blocks()
            return
        converter = self._converter
        # Output waits here until every input sample that it depends on has been seen, with its flags.
        waiting = np.empty((0, self.channels))
        taken = given = 0
        for piece in self._pieces():
            taken += len(piece)
            waiting = np.concatenate([waiting, converter.push(piece)])
            settled = max(0, min(len(waiting), math.ceil((taken - self._converter.reach) * self._ratio) - given))
            yield from self._cut(given, waiting[:settled])
            given += settled
            waiting = waiting[settled:]
        waiting = np.concatenate([waiting, converter.push(np.empty((0, self.channels)), last=True)])
        total = math.floor(taken * self._ratio + Fraction(1, 2))
        yield from self._cut(given, waiting[: total - given])

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def _pieces(self) -> Iterator[NDArray[np.float64]]:
        """Yield the input in pieces of bounded size, zeros for what was lost, and mark what is wrong with it."""
        piece_samples = max(1, int(_PIECE_SAMPLES * min(Fraction(1), 1 / self._ratio)))
        position = 0
        for block in self._source.blocks():
            end = block.first_sample + len(block.samples)
            self._arrived_s = block.arrived_s
            if block.first_sample > position:
                self._mark_gap(position, block.first_sample)
            if block.flags:
                self._mark(block.first_sample, end, np.array(block.flags, dtype=np.uint8))
            for start in range(position, block.first_sample, piece_samples):
                yield np.zeros((min(piece_samples, block.first_sample - start), self.channels))
            for start in range(0, len(block.samples), piece_samples):
                yield block.samples[start : start + piece_samples]
            position = end

    def _mark(self, first: int, end: int, flags: NDArray[np.uint8]) -> None:
        """Mark every output sample that the input samples from `first` up to `end` touch."""
        out_first = math.ceil((first - self._converter.reach) * self._ratio)
        out_end = math.floor((end - 1 + self._converter.reach) * self._ratio) + 1
        self._marks.append(_Mark(out_first, out_end, flags))

    def _mark_gap(self, first: int, end: int) -> None:
        flags = np.full(self.channels, Flag.GAP, dtype=np.uint8)
        self._mark(first, end, flags)
        self._marks.append(_Mark(math.ceil(first * self._ratio), math.ceil(end * self._ratio), flags, lost=True))

    def _cut(self, first: int, samples: NDArray[np.float64]) -> Iterator[Block]:
        """Yield output samples from index `first` on as blocks with their flags, without the lost ones."""
        while self._marks and self._marks[0].end <= first:
            self._marks.popleft()
        flags = np.zeros((len(samples), self.channels + 1), dtype=np.uint8)  # the last column: lost or not
        for mark in self._marks:
            marked = slice(max(0, mark.first - first), max(0, mark.end - first))
            flags[marked, :-1] |= mark.flags
            flags[marked, -1] |= mark.lost
        for run in equal_runs(flags):
            if flags[run.start, -1]:
                continue
            start = first + run.start
            yield Block(
                start,
                samples[run],
                self.sample_rate_hz,
                lost=start - self._end,
                flags=block_flags(flags[run.start, :-1]),
                arrived_s=self._arrived_s,
            )
            self._end = first + run.stop
