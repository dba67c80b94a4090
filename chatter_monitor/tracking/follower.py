"""One comb in a signal: found, followed, and let go when it is gone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.tracking.comb import Lines, Spectrum, Target, find_comb
from chatter_monitor.tracking.harmonics import Harmonics

# Doubt about a speed that was averaged over the search window: it wanders.
START_SD = 0.002
CHECK_FRAMES = 5  # from one look at whether it still is a comb to the next, or there is one near a known speed


class CombFollower:
    """Looks for a comb in a long stretch of the signal, and takes it out of what comes.

    What is found is followed through that stretch first. Only if its harmonics were steady there is it taken out, and
    then it is known when the next sample comes.

    Parameters
    ----------
    target : Target
        What to look for.
    frame : int
        Samples of a frame, the grid on which it looks and learns.
    sample_rate_hz, window_s, memory_s, lowest_hz, lost_s : float
        As in `OrderSettings`.
    """

    def __init__(
        self,
        target: Target,
        frame: int,
        sample_rate_hz: float,
        *,
        window_s: float,
        memory_s: float,
        lowest_hz: float,
        lost_s: float,
    ) -> None:
        self.harmonics: Harmonics | None = None
        self._target = target
        self._rate_hz = sample_rate_hz
        self._memory_s = memory_s
        self._lowest_hz = lowest_hz
        self._past = np.zeros((max(2, math.floor(window_s * sample_rate_hz / frame)), frame))
        self._heard = 0  # frames of the past that can be looked through
        self._rest = 0  # frames until the next search
        self._spectra: dict[int, Spectrum] = {}
        self._frames = 0
        self._patience = lost_s * sample_rate_hz / frame
        self._doubtful_frames = 0

    def aim(self, target: Target) -> None:
        """Look for something else; what is followed stays if it is that, too."""
        self._target = target
        if self.harmonics is not None and not target.admits(self.harmonics.rotation_hz):
            self.harmonics = None

    def forget(self) -> None:
        """Listen anew: the past is no longer like what comes."""
        self._heard = 0

    def subtract(self, samples: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write to ``out`` what remains of samples, shape (n,) both; missing samples are not finite."""
        if self.harmonics is None:
            out[:] = samples
        else:
            self.harmonics.subtract(samples, out)

    def end_frame(self, samples: NDArray[np.float64], taken_hz: float | None = None) -> bool:
        """Learn from a full frame of samples, and look for a comb when it is time.

        Parameters
        ----------
        samples : ndarray of float64, shape (frame,)
            The signal; missing samples are not finite.
        taken_hz : float, optional
            Fundamental of a comb that has been taken out of it; what may be left of its lines does not count.

        Returns
        -------
        bool
            Whether a new comb was found.
        """
        self._frames += 1
        if self.harmonics is not None:
            self.harmonics.learn()
            self._check(self.harmonics)
        present = np.isfinite(samples)
        heard = bool(present.all())
        self._past[self._frames % len(self._past)] = samples if heard else np.where(present, samples, 0.0)
        self._heard = min(self._heard + 1, len(self._past)) if heard else 0
        self._rest -= 1
        if self.harmonics is not None or self._rest > 0:
            return False
        # A range that is narrow needs less to be sure. A speed that wanders blurs a line the more the longer one looks,
        # and is steady enough at one time or another.
        known = self._target.teeth is not None
        lengths = [
            n for n in ((len(self._past) // 2, len(self._past)) if known else (len(self._past),)) if n <= self._heard
        ]
        if not lengths:
            return False
        self._rest = CHECK_FRAMES if known else len(self._past) // 2
        return any(self._search(frames, taken_hz) for frames in lengths)

    def _check(self, harmonics: Harmonics) -> None:
        """Give up a comb that has not been one for too long."""
        if self._frames % CHECK_FRAMES == 0:
            if self._target.stands(harmonics.clear(), harmonics.rotation_hz):
                self._doubtful_frames = 0
            else:
                self._doubtful_frames += CHECK_FRAMES
        if self._doubtful_frames > self._patience or not self._target.admits(harmonics.rotation_hz):
            self.harmonics = None

    def _lines(self, past: NDArray[np.float64]) -> Lines:
        if len(past) not in self._spectra:  # there are two lengths, all of the past and half of it
            self._spectra[len(past)] = Spectrum(past.size, self._rate_hz, self._lowest_hz)
        return self._spectra[len(past)].lines(past.ravel())

    def _search(self, frames: int, taken_hz: float | None) -> bool:
        """Look through the last frames for a comb, and follow it from there to now."""
        last = np.arange(self._frames - frames + 1, self._frames + 1) % len(self._past)
        past = self._past[last]
        lines = self._lines(past)
        if taken_hz is not None:
            lines = lines.without(lines.on(taken_hz))
        comb = find_comb(lines, self._target)
        if comb is None:
            return False
        sd_hz = max(comb.fundamental_sd_hz, START_SD * comb.fundamental_hz)
        harmonics = Harmonics(
            comb.fundamental_hz, sd_hz, self._rate_hz, memory_s=self._memory_s, lowest_hz=self._lowest_hz
        )
        for samples in past:
            harmonics.subtract(samples, np.empty(len(samples)))
            harmonics.learn()
        # A self-excited vibration that crosses an order takes the harmonics along, away from where the other lines are.
        now_hz = harmonics.rotation_hz
        on_lines = self._lines(past[len(past) // 2 :]).orders(now_hz)
        if not (self._target.stands(harmonics.clear(), now_hz) and self._target.stands(on_lines, now_hz)):
            return False
        self.harmonics = harmonics
        self._doubtful_frames = 0
        return True
