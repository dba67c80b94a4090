"""A sound card that is heard for a year: it may be lost, frozen or absent, and comes back.

Threads
-------
PortAudio's thread copies what the device delivers into the ring and counts; nothing else.
The card's own thread ("sound-card") opens and closes devices, again and again, and nothing but it calls PortAudio: a
frozen device makes these calls hang, and they hang there.
The worker's thread takes the blocks. It notices that nothing comes any more, whatever the reason, and goes on with
blocks that hold nothing but the loss, by the clock, so that verdicts keep coming.

What they share: the ring; a queue of devices that have been opened; for each of them an event that says that it is
over; and `_trouble`, the reason in words, which is replaced as a whole.
"""

from __future__ import annotations

import logging
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from chatter_monitor.acquisition.faults import FaultFinder, block_flags, equal_runs
from chatter_monitor.acquisition.index_clock import IndexClock
from chatter_monitor.acquisition.portaudio import Choice, Opener
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.ring import Ring
from chatter_monitor.acquisition.settings import InputSettings
from chatter_monitor.acquisition.source import Condition, Source
from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.records import Block, Flag

RING_S = 4.0  # what the worker may fall behind before samples are lost
START_S = 1.0  # that a device may take to open at the start, before samples count as lost
DEAD_S = 1.0  # an unchanged channel is dead from then on
CLIPPING_SHOWN_S = 10.0
CEILING = 1.0 - 2.0**-15  # the largest code of a 16-bit converter; for one of 24 bits that is near enough
WRONG_RATE_PPM = 5000.0
CLOSE_TIMEOUT_S = 0.5  # for a device that hangs, at the end

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for what.

    Attributes
    ----------
    tick_s : float
        How often to look whether something has happened, and how often blocks come while nothing is heard.
    frozen_s : float
        A device that has delivered nothing for so long is frozen, whatever it says.
    reopen_s : tuple of float
        Before the first attempt to open it again, the second, ...; the last for all that follow.
    """

    tick_s: float = 0.05
    frozen_s: float = 0.5
    reopen_s: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0)


@dataclass(eq=False)
class _Capture:
    """A device that has been opened, until it is over.

    Attributes
    ----------
    choice : Choice
        What was opened.
    ring : Ring
        What it delivers.
    latest_s : float
        When it delivered last; when it was opened, at first.
    over : Event
        Set when it has ended by itself, when the worker has given it up, and at the end of the program.
    why : str
        Why it is over.
    held : Block or None
        Taken from the ring, and not handed on yet.
    """

    choice: Choice
    ring: Ring
    latest_s: float
    over: threading.Event = field(default_factory=threading.Event)
    why: str = ""
    delivered: bool = False
    overflows: int = 0
    held: Block | None = None

    def end(self, why: str) -> None:
        """Say that it is over; the first reason counts."""
        if not self.over.is_set():
            self.why = why
            self.over.set()


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
        patience: Patience = Patience(),
    ) -> None:
        self.sample_rate_hz = float(sample_rate_hz)
        self._columns = list(settings.channels or (0,))
        self.channels = len(self._columns)
        self._settings = settings
        self._opener = opener
        self._index_clock = index_clock
        self._clock = clock
        self._patience = patience
        # The worker's:
        self._faults: FaultFinder | None = None
        self._clipped = self._non_finite = 0  # by the finders before
        self._clipping_until_s = -math.inf
        self._overflows = 0
        self._end = 0  # of the last block given
        self._heard_s = clock()  # when samples came last
        self._capture: _Capture | None = None
        # Shared:
        self._captures: queue.SimpleQueue[_Capture] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._sleep = sleep or self._stopping.wait
        self._trouble = "the device has not been opened yet"
        self._death: BaseException | None = None
        self._thread = threading.Thread(target=self._keep_open, name="sound-card", daemon=True)

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
            why = f"nothing heard for {self.deaf_s:.1f} s: {self._trouble}"
            return Condition(hearing=False, problems=(why,), overflows=self._overflows)
        return Condition(
            hearing=not faults.dead.all(),
            problems=tuple(self._problems(capture, faults)),
            overflows=self._overflows,
            ring_fill=capture.ring.fill,
            clock_ppm=self._index_clock.drift_ppm,
        )

    def _problems(self, capture: _Capture, faults: FaultFinder) -> list[str]:
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
            Whatever the card's thread died of.
        """
        self._index_clock.restart(0, self._clock())
        self._heard_s = self._clock()
        self._thread.start()
        while not self._stopping.is_set():
            if self._death is not None:
                raise self._death
            try:
                capture = self._captures.get(timeout=self._patience.tick_s)
            except queue.Empty:
                if self._end or self.deaf_s > START_S:
                    yield from self._missing(self._clock() - self._patience.tick_s)
                continue
            yield from self._hear(capture)

    def close(self) -> None:
        """Close the device; one that hangs is left to the end of the process."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(CLOSE_TIMEOUT_S)

    # ---- the worker's thread

    def _missing(self, until_s: float) -> Iterator[Block]:
        """Yield the loss up to a time as a block without samples."""
        end = int(self._index_clock.index_at(until_s))
        if end > self._end:
            lost, self._end = end - self._end, end
            yield Block(end, np.empty((0, self.channels)), self.sample_rate_hz, lost)

    def _hear(self, capture: _Capture) -> Iterator[Block]:
        """Yield what a device delivers until it is over."""
        self._clipped, self._non_finite = self.clipped_samples, self.non_finite_samples
        rate_hz = capture.choice.sample_rate_hz
        self._faults = FaultFinder(self.channels, CEILING, dead_after=round(DEAD_S * rate_hz))
        while (first := self._next(capture)) is not None:
            if self._capture is None:
                away_s = self.deaf_s
                self._capture = capture
                _log.info("hearing %s, after %.1f s without", self.device, away_s)
            capture.held = first
            yield from self._stretch(capture, first)
        if self._stopping.is_set():
            return
        # What the converter has not given out yet is lost; the clock goes on from the last delivery.
        self._capture = None
        self._trouble = capture.why

    def _stretch(self, capture: _Capture, first: Block) -> Iterator[Block]:
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

    def _delivered(self, capture: _Capture, origin: int, begin: int) -> Iterator[Block]:
        """Yield what a device delivers, flagged and in the sensor's units, up to the next gap of unknown length."""
        faults = self._faults
        assert faults is not None  # noqa: S101  set by _hear
        ratio = self.sample_rate_hz / capture.choice.sample_rate_hz
        while (block := self._next(capture)) is not None:
            if block.flags:
                if block.first_sample > origin:
                    capture.held = block
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

    def _next(self, capture: _Capture) -> Block | None:
        """Next block of a device; None when it is over and everything has been taken."""
        if capture.held is not None:
            block, capture.held = capture.held, None
            return block
        while not self._stopping.is_set():
            read = capture.ring.read(capture.ring.capacity)
            if read is not None:
                return read
            if capture.over.is_set():
                return None
            silent_s = self._clock() - capture.latest_s
            if silent_s > self._patience.frozen_s:
                capture.end(f"{capture.choice.device.name!r} is frozen: it delivers nothing, and reports no error")
                continue  # to what may have come in between
            capture.ring.wait(self._patience.tick_s)
        return None

    # ---- the card's thread

    def _keep_open(self) -> None:
        try:
            failures = 0
            while not self._stopping.is_set():
                capture = self._open_and_wait()
                if capture is not None and capture.delivered:
                    failures = 0
                waits = self._patience.reopen_s
                self._sleep(waits[min(failures, len(waits) - 1)])
                failures += 1
        except BaseException as death:
            self._death = death

    def _open_and_wait(self) -> _Capture | None:
        """Open the device, wait until it is over, close it; None if it does not open."""
        try:
            choice = self._opener.choose()
            ring = Ring(round(RING_S * choice.sample_rate_hz), choice.channels, choice.sample_rate_hz)
            capture = _Capture(choice, ring, self._clock())

            def deliver(samples: np.ndarray, overflow: bool) -> None:
                capture.latest_s = now_s = self._clock()
                capture.delivered = True
                ring.write(samples, now_s, overflow=overflow)

            stream = self._opener.open(choice, deliver, lambda: capture.end(f"{choice.device.name!r} has gone away"))
        except EnvironmentFault as fault:
            self._trouble = str(fault)
            return None
        capture.latest_s = self._clock()
        self._captures.put(capture)
        while not (capture.over.wait(self._patience.tick_s) or self._stopping.is_set()):
            pass
        stream.close()
        return capture


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
