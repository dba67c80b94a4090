"""A running signal beside the simulation of its machine: what the simulation lacks, once there is evidence for it.

An *epoch* is a stretch in which the machine stays what it is. At its start, and whenever it is half as old again, the
linear base is fitted to all of it, and the signal runs once more through the new observer; until it has caught up, the
last one goes on watching. Two kinds of evidence accumulate over the newest 1, 2, 4, ... blocks: that the errors have
changed since before, which begins another epoch, and that signatures of missing forces are in them. What is older than
the longest window is forgotten.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.live.decimate import Decimator
from chatter_monitor.discrepancy.live.found import Found, of_force, of_omission, of_parameters
from chatter_monitor.discrepancy.live.history import History
from chatter_monitor.discrepancy.live.refit import Refit, refit
from chatter_monitor.discrepancy.live.run import WINDOWS, Run
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Spindle

FASTEST = 0.45  # mode, over the rate of the signal
FIRST_FIT_S = 1.0
FIRST_FIT_PERIODS = 300.0  # of the first mode, at least
FIT_AGAIN = 1.5  # times as old
LAST_FIT_S = 32.0
LEAST_PRESENT = 0.5  # share of the samples of an epoch
CATCH_UP = 4  # blocks that go through a new observer with each piece of the signal, at least
STEPS = 2  # of the work of a fit, likewise
RETUNED_P = 1e-8  # of the parameters of the model file
MATERIAL = 0.15  # change of the damping over itself, or of the frequency over half the bandwidth, worth a word
_BEFORE_BLOCKS = 4  # that are kept of what comes before the longest window, for an observer to settle in
_NEVER = 1 << 62  # sample number


@dataclass(eq=False)
class _Epoch:
    """A stretch in which the machine stays what it is.

    While the signal runs through a new observer (`next`), the last one (`run`) goes on watching.
    """

    first: int
    fit_due: int
    run: Run | None = None
    next: Run | None = None


class Watch:
    """One channel beside a model.

    Parameters
    ----------
    system : MachiningSystem
        The model; its spindle speed counts.
    rate_hz : float
        Of the signal.

    Raises
    ------
    InputError
        If the model's modes are too fast for it.
    """

    def __init__(self, system: MachiningSystem, rate_hz: float) -> None:
        highest = max(mode.frequency_hz for mode in system.modes)
        if highest > FASTEST * rate_hz:
            raise InputError(
                "the signal does not reach the model's modes",
                got=f"{highest:g} Hz",
                allowed=f"<= {FASTEST * rate_hz:g} Hz",
                remedy="Raise [tracker] sample_rate_hz, or leave the mode out.",
            )
        self._decimator = Decimator(rate_hz, highest)
        self._rate_hz = rate = self._decimator.rate_hz
        self._system = system
        self._block = block = self._decimator.block
        self._history = History((WINDOWS[-1] + _BEFORE_BLOCKS) * block, rate)
        first_fit_s = max(FIRST_FIT_S, FIRST_FIT_PERIODS / system.modes[0].frequency_hz)
        self._first_fit = block * round(first_fit_s * rate / block)
        self._last_fit = round(LAST_FIT_S * rate)
        self._work: Iterator[Refit | None] | None = None
        self._begin(0)

    def set_spindle(self, spindle: Spindle) -> None:
        """Go by another speed from now on."""
        if spindle != self._system.spindle:
            self._system = replace(self._system, spindle=spindle)
            self._begin(self._history.end + self._block)  # of the block that has begun a part is at the last speed

    def sample_of(self, number: int) -> int:
        """Number of the sample of the signal at sample `number` of what is watched."""
        return int(number / self._decimator.ratio)

    def take(self, samples: NDArray[np.float64]) -> Found | None:
        """Take samples, NaN where they are missing.

        Returns
        -------
        Found or None
            How things stand; None while it is not known.
        """
        blocks = self._decimator.take(samples)
        for lowered, missing in blocks:
            self._history.append(lowered / self._system.sensor.gain, missing)
        if not blocks and not self._is_busy():
            return None
        try:
            return self._follow(max(1, len(blocks)))
        except np.linalg.LinAlgError:  # what this stretch says cannot be computed: monitoring goes on, with another one
            self._begin(self._history.end)
            return None

    def _is_busy(self) -> bool:
        """Whether there is something to do though no block has come."""
        run = self._epoch.run
        return self._work is not None or self._epoch.next is not None or (run is not None and run.looks_again)

    def _follow(self, pieces: int) -> Found | None:
        """Go on through what has come; what has to catch up, by so many pieces of a few blocks."""
        epoch, found = self._epoch, None
        for run, most in ((epoch.run, WINDOWS[-1]), (epoch.next, CATCH_UP * pieces)):
            for _ in range(most):
                if run is None or self._is_at_end(run):
                    break
                found = self._advance(run) or found
                if self._epoch is not epoch:
                    return None
        if epoch.next is not None and self._is_at_end(epoch.next):
            epoch.run, epoch.next = epoch.next, None
            epoch.run.may_rest = epoch.fit_due == _NEVER  # its base is the last of the epoch
        if epoch.run is not None and epoch.run.look_again(self._history, CATCH_UP * pieces):
            epoch.run.name()
            found = self._judge(epoch.run)
        self._fit(epoch)
        return found

    def _is_at_end(self, run: Run) -> bool:
        """Whether what has come makes no further block."""
        return run.position + run.samples > self._history.end

    def _begin(self, first: int) -> None:
        self._work = None
        self._epoch = _Epoch(first, first + self._first_fit)

    def _fit(self, epoch: _Epoch) -> None:
        """Some steps of fitting the base, where it is due: to all of the epoch."""
        end = self._history.end
        if self._work is not None:
            for result in islice(self._work, STEPS):
                if result is not None:
                    self._work = None
                    self._adopt(epoch, result)
            return
        if end < epoch.fit_due or epoch.next is not None:
            return
        age = end - epoch.first
        due = self._block * round(FIT_AGAIN * age / self._block)
        epoch.fit_due = epoch.first + due if due <= self._last_fit else _NEVER
        recorded = self._history.between(max(epoch.first, self._history.start), end)
        present = ~recorded.missing
        if np.mean(present) < LEAST_PRESENT or float(np.std(recorded.samples[present])) == 0.0:
            self._begin(end)
            return
        mean = float(np.mean(recorded.samples[present]))
        recorded = replace(recorded, samples=np.where(present, recorded.samples - mean, 0.0))
        regeneration = next((a for a in self._system.terms if a.term.name == "regenerative_delay"), None)
        others = tuple(applied for applied in self._system.terms if applied is not regeneration)
        self._work = refit(recorded, Linear.of(self._system, regeneration), others)

    def _adopt(self, epoch: _Epoch, result: Refit) -> None:
        """Let the epoch run through the new observer."""
        epoch.next = Run(result, epoch.first, self._block, self._rate_hz)

    def _advance(self, run: Run) -> Found | None:
        """One block on; how things stand, if it is the last that has come."""
        if not run.advance(self._history):
            return None
        quiet = run.is_quiet()
        onset = None if quiet else run.changed()
        if onset is not None:
            self._begin(onset)
            return None
        if not self._is_at_end(run):
            return None  # it is still catching up
        if not quiet:
            run.name()
        return self._judge(run)

    def _judge(self, run: Run) -> Found:
        """How things stand at the end of a block."""
        result, blocks = run.refit, run.blocks
        if run.named:
            size, named = max(run.named.items(), key=lambda item: item[1].evidence_nats)
            if named.evidence_nats > result.gain_nats:
                return of_force(named, blocks.firsts[-size], result.rms)
        since = blocks.firsts[0]
        if result.omission is not None:
            return of_omission(result, since)
        if result.retuned_p < RETUNED_P and self._material(result.linear):
            return of_parameters(result, since)
        return Found("none", since, amplitude=result.rms)

    def _material(self, linear: Linear) -> bool:
        """Whether the fitted modes differ from those of the model by enough to be worth a word."""
        for given, now in zip(self._system.modes, linear.modes, strict=False):
            half_width = given.damping_ratio * given.frequency_hz
            if abs(now.frequency_hz - given.frequency_hz) > MATERIAL * half_width:
                return True
            if abs(now.damping_ratio / given.damping_ratio - 1.0) > MATERIAL:
                return True
        return False
