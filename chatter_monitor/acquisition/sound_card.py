"""A sound card that is heard for a year: it may be lost, frozen or absent, and comes back.

Threads
-------
PortAudio's thread copies what the device delivers into the ring and counts; nothing else.
The card's thread ("sound-card", `Capturing`) opens and closes devices.
The worker's thread takes the blocks. It notices that nothing comes any more, whatever the reason, and goes on with
blocks that hold nothing but the loss, by the clock, so that verdicts keep coming.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from chatter_monitor.acquisition.capture import PATIENCE, Capture, Capturing, Patience
from chatter_monitor.acquisition.faults import FaultFinder, block_flags, equal_runs
from chatter_monitor.acquisition.index_clock import IndexClock
from chatter_monitor.acquisition.portaudio import Opener
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.settings import InputSettings
from chatter_monitor.acquisition.source import Condition, Source
from chatter_monitor.records import Block, Flag

START_S = 1.0  # that a device may take to open at the start, before samples count as lost
DEAD_S = 1.0  # an unchanged channel is dead from then on
CLIPPING_SHOWN_S = 10.0
CEILING = 1.0 - 2.0**-15  # the largest code of a 16-bit converter; for one of 24 bits that is near enough
WRONG_RATE_PPM = 5000.0

_log = logging.getLogger(__name__)


class SoundCard(Source):
    """Samples of a sound device at the tracker's rate, whatever happens to the device.

    The sample index goes on by the clock while nothing is heard; every sample that was not heard counts as lost.

    Parameters
    ----------
    settings : InputSettings
        Which device, which channels, what they mean.
    sample_rate_hz : float
        Rate of the blocks.
    opener : Opener
        Devices.
    index_clock : IndexClock
        Is told when the samples were heard.
    clock : callable
        Seconds on a clock that never jumps; the same as that of `index_clock`.
    sleep : callable, optional
        Waits for some seconds between two attempts to open a device; by default until the card is closed, at most.
    patience : Patience
        How long to wait for what.
    """

    length = None

    def __init__(
        self,
        settings: InputSettings,
        sample_rate_hz: float,
        *,
        opener: Opener,
        index_clock: IndexClock,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], object] | None = None,
        patience: Patience = PATIENCE,
    ) -> None:
        self.sample_rate_hz = float(sample_rate_hz)
        self._columns = list(settings.channels or (0,))
        self.channels = len(self._columns)
        self._settings = settings
        self._index_clock = index_clock
        self._clock = clock
        self._patience = patience
        self._capturing = Capturing(opener, clock, sleep, patience)
        self._faults: FaultFinder | None = None
        self._clipped = self._non_finite = 0  # by the finders before
        self._clipping_until_s = -math.inf
        self._overflows = 0
        self._end = 0  # of the last block given
        self._heard_s = clock()  # when samples came last
        self._capture: Capture | None = None  # that is heard
        self._held: Block | None = None  # taken from its ring, and not handed on yet
        self._why = "the device has not been opened yet"  # nothing is heard
        self._stopping = threading.Event()

    @property
    def deaf_s(self) -> float:
        """For how long no sample has come."""
        return 0.0 if self._capture is not None else self._clock() - self._heard_s

    @property
    def clipped_samples(self) -> int:
        """Samples in runs at full scale so far, over all channels."""
        return self._clipped + (0 if self._faults is None else self._faults.clipped_samples)

    @property
    def non_finite_samples(self) -> int:
        """Samples so far that were NaN or infinite, over all channels."""
        return self._non_finite + (0 if self._faults is None else self._faults.non_finite_samples)

    @property
    def device(self) -> str:
        """What is heard, for a person; the device that is waited for while there is none."""
        if self._capture is None:
            return f"device {self._settings.device!r}"
        choice = self._capture.choice
        return f"{choice.device.name!r} at {choice.sample_rate_hz / 1000:g} kHz"

    def condition(self) -> Condition:
        """How well it hears at the moment: not at all where no sample comes, or all channels are dead."""
        capture, faults = self._capture, self._faults
        if capture is None or faults is None:
            why = self._capturing.trouble or self._why
            problem = f"nothing heard for {self.deaf_s:.1f} s: {why}"
            return Condition(hearing=False, problems=(problem,), overflows=self._overflows)
        return Condition(
            hearing=not faults.dead.all(),
            problems=tuple(self._problems(capture, faults)),
            overflows=self._overflows,
            ring_fill=capture.ring.fill,
            clock_ppm=self._index_clock.drift_ppm,
        )

    def _problems(self, capture: Capture, faults: FaultFinder) -> list[str]:
        problems = [
            f"channel {self._columns[c]} is dead: its samples do not change; is the sensor connected and switched on?"
            for c in np.flatnonzero(faults.dead)
        ]
        if self._clock() < self._clipping_until_s:
            problems.append("the signal is clipped: turn the gain down")
        ppm = self._index_clock.drift_ppm
        if ppm is not None and abs(ppm) > WRONG_RATE_PPM:
            nominal_hz = capture.choice.sample_rate_hz
            problems.append(
                f"the device delivers {nominal_hz * (1 + ppm * 1e-6):.0f} samples a second, not {nominal_hz:.0f}: "
                f"frequencies read {-ppm * 1e-4 / (1 + ppm * 1e-6):+.1f} %"
            )
        return problems

    def stop(self) -> None:
        """Let `blocks` come to its end; for any thread."""
        self._stopping.set()

    def blocks(self) -> Iterator[Block]:
        """Yield what is heard, and while nothing is heard, the loss.

        Raises
        ------
        Exception
            Whatever the card's thread has died of.
        """
        self._index_clock.restart(0, self._clock())
        self._heard_s = self._clock()
        self._capturing.start()
        opened: Capture | None = None  # that has not delivered yet
        while not self._stopping.is_set():
            if opened is None:
                opened = self._capturing.opened()
            elif opened.ring.wait(self._patience.tick_s):
                yield from self._hear(opened)
                opened = None
                continue
            elif self._is_over(opened):
                opened = None
            if self._end or self.deaf_s > START_S:
                yield from self._missing(self._clock() - self._patience.tick_s)

    def close(self) -> None:
        """Close the device; one that hangs is left to the end of the process."""
        self._stopping.set()
        self._capturing.stop()

    def _missing(self, until_s: float) -> Iterator[Block]:
        """Yield the loss up to a time as a block without samples."""
        end = int(self._index_clock.index_at(until_s))
        if end > self._end:
            lost, self._end = end - self._end, end
            yield Block(end, np.empty((0, self.channels)), self.sample_rate_hz, lost)

    def _hear(self, capture: Capture) -> Iterator[Block]:
        """Yield what a device delivers until it is over."""
        self._clipped, self._non_finite = self.clipped_samples, self.non_finite_samples
        rate_hz = capture.choice.sample_rate_hz
        self._faults = FaultFinder(self.channels, CEILING, dead_after=round(DEAD_S * rate_hz))
        away_s = self.deaf_s
        self._capture = capture
        _log.info("hearing %s, after %.1f s without", self.device, away_s)
        while (first := self._next(capture)) is not None:
            self._held = first
            yield from self._stretch(capture, first)
        if not self._stopping.is_set():
            # What the converter has not given out yet is lost; the clock goes on from the last delivery.
            self._capture = None

    def _stretch(self, capture: Capture, first: Block) -> Iterator[Block]:
        """Yield samples without a gap of unknown length in between, at the tracker's rate."""
        rate_hz = capture.choice.sample_rate_hz
        ratio = self.sample_rate_hz / rate_hz
        arrived_s = self._clock() if first.arrived_s is None else first.arrived_s
        begin = 0
        if self._end:  # the clock says how much was lost since; the index never goes back
            begin = max(self._end, round(self._index_clock.index_at(arrived_s) - len(first.samples) * ratio))
        self._index_clock.restart(begin + len(first.samples) * ratio, arrived_s)
        delivered = _Delivered(self._delivered(capture, first.first_sample, begin), rate_hz, self.channels)
        for block in Resampled(delivered, self.sample_rate_hz).blocks():
            if delivered.over:  # what the converter gives up at its end rests on zeros that nobody heard
                return
            position = begin + block.first_sample
            lost, self._end = position - self._end, position + len(block.samples)
            yield replace(block, first_sample=position, lost=lost)

    def _delivered(self, capture: Capture, origin: int, begin: int) -> Iterator[Block]:
        """Yield what a device delivers, flagged and in the sensor's units, up to the next gap of unknown length."""
        faults = self._faults
        assert faults is not None  # noqa: S101  set by _hear
        ratio = self.sample_rate_hz / capture.choice.sample_rate_hz
        while (block := self._next(capture)) is not None:
            if block.flags:
                if block.first_sample > origin:
                    self._held = block
                    return
                self._overflows += 1
            position = block.first_sample - origin
            if block.arrived_s is not None:
                self._heard_s = block.arrived_s
                self._index_clock.observe(begin + (position + len(block.samples)) * ratio, block.arrived_s)
            samples = np.ascontiguousarray(block.samples[:, self._columns])
            clipped_before = faults.clipped_samples
            flags = faults.inspect(samples)
            if faults.clipped_samples > clipped_before:
                self._clipping_until_s = self._clock() + CLIPPING_SHOWN_S
            if block.flags:
                flags |= np.uint8(Flag.OVERFLOW)
            samples /= self._settings.full_scale_per_unit
            for run in equal_runs(flags):
                yield Block(
                    position + run.start,
                    samples[run],
                    block.sample_rate_hz,
                    flags=block_flags(flags[run.start]),
                    arrived_s=block.arrived_s,
                )

    def _next(self, capture: Capture) -> Block | None:
        """Next block of a device; None when it is over and everything has been taken."""
        if self._held is not None:
            block, self._held = self._held, None
            return block
        while not self._stopping.is_set():
            over = self._is_over(capture)  # before looking for what may have come until then
            read = capture.ring.read(capture.ring.capacity)
            if read is not None or over:
                return read
            capture.ring.wait(self._patience.tick_s)
        return None

    def _is_over(self, capture: Capture) -> bool:
        """Whether a device has ended, or is given up now because it is frozen."""
        if self._clock() - capture.latest_s > self._patience.frozen_s:
            capture.end(f"{capture.choice.device.name!r} is frozen: it delivers nothing, and reports no error")
        if capture.over.is_set():
            self._why = capture.why
        return capture.over.is_set()


class _Delivered(Source):
    """What a device delivers, as a source for the converter."""

    length = None

    def __init__(self, blocks: Iterator[Block], sample_rate_hz: float, channels: int) -> None:
        self.sample_rate_hz = sample_rate_hz
        self.channels = channels
        self.over = False
        self._blocks = blocks

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks, and take note of their end."""
        yield from self._blocks
        self.over = True

    def close(self) -> None:
        """Nothing to give back."""
