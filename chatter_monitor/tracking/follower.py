"""One comb in a signal: found, followed, and let go when it is gone."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.conditioning import copy_present
from chatter_monitor.kernels.heard import WANDER
from chatter_monitor.tracking.comb import (
    ENOUGH,
    HUMS_BELOW_HZ,
    Comb,
    Led,
    Lines,
    Spectrum,
    Target,
    find_any_comb,
    find_told_comb,
    is_locked,
    is_mains,
    speaks_against,
    speaks_for,
)
from chatter_monitor.tracking.harmonics import Harmonics
from chatter_monitor.tracking.sidebands import Sidebands, find_sidebands, may_be_sidebands
from chatter_monitor.tracking.turns import TURNS, Piecemeal, in_turn

OFTEN = 5  # times within a window that a comb of unknown speed is looked for, while none is known
CHECK_FRAMES = 5  # from one look at whether it still is a comb to the next
ANOTHER_SPEED = 0.01  # relatively: more than a spindle wanders
CATCH_UP_FRAMES = 16  # of the past that a new comb is followed through while one comes in


class Beside(NamedTuple):
    """What is known of the rest while a comb is looked for; each field as in `CombFollower.end_frame`."""

    taken_hz: float | None = None
    rotation_hz: float | None = None
    mains_only: bool = False
    sidebands: Sidebands | None = None

    @property
    def nothing(self) -> bool:
        """Whether any comb may be that of what forces the cut, for none has been taken out."""
        return self.taken_hz is None and not self.mains_only


class Candidate(NamedTuple):
    """A comb that was found, a target that it has to go on being, and whether by faint lines or in step with one."""

    comb: Comb
    target: Target
    faint: bool = False
    led: Led | None = None


# Goes on frame by frame, to harmonics that stand, and what they were found as.
Search = Piecemeal[tuple[Harmonics, Target] | None]


class CombFollower:
    """Looks for a comb in a long stretch of the signal, and takes it out of what comes.

    What is found is followed through that stretch first. Only if its harmonics were steady there is it taken out, and
    then it is known when the next sample comes. The search for a known speed is shared out over frames
    (`tracking.turns`). A speed is not known any more, though it was told, when there is a comb that speaks against it:
    that is followed instead, until what was told is heard, or another speed is told.

    Parameters
    ----------
    target : Target
        What to look for.
    anything : Target
        What comb may speak against the speed that was told.
    frame : int
        Samples of a frame, the grid on which it looks and learns.
    sample_rate_hz, window_s, memory_s, lowest_hz, lost_s : float
        As in `OrderSettings`.
    turn : int
        Frame of a round in which it looks.
    """

    def __init__(
        self,
        target: Target,
        anything: Target,
        frame: int,
        sample_rate_hz: float,
        *,
        window_s: float,
        memory_s: float,
        lowest_hz: float,
        lost_s: float,
        turn: int = 0,
    ) -> None:
        self.harmonics: Harmonics | None = None
        self.frames = 0  # that have been heard
        self._target = self._followed = target
        self._anything = anything
        self._rate_hz = sample_rate_hz
        self._memory_s = memory_s
        self._lowest_hz = lowest_hz
        self._turn = turn
        self._window = max(2, math.floor(window_s * sample_rate_hz / frame))
        self._past = np.zeros((self._window + TURNS, frame))
        self._heard = 0  # frames of the past that can be looked through
        self._rest = 0  # frames until the next search
        self._search: Search | None = None
        self._spectra: dict[int, Spectrum] = {}
        self._transformed: dict[int, int] = {}  # up to which frame, for each of them
        self._patience = lost_s * sample_rate_hz / frame
        self._doubtful_frames = 0
        self._clear = math.inf  # lines of what is followed at a told speed

    def aim(self, target: Target) -> None:
        """Look for something else; what is followed stays if it is that, too."""
        self._target = self._followed = target
        self._search = None
        if self.harmonics is not None and not target.admits(self.harmonics.rotation_hz):
            self.harmonics = None

    @property
    def doubts(self) -> bool:
        """Whether what turns spoke against the speed that was told, when something was heard last."""
        return self._followed is not self._target

    @property
    def stands(self) -> bool:
        """Whether what was clear of it last is a comb of its fundamental."""
        return self._doubtful_frames == 0

    @property
    def _has_few(self) -> bool:
        """Whether what is followed at a told speed has fewer clear lines than a comb at any other needs."""
        return _is_told(self._followed) and self._clear < self._anything.fewest

    def forget(self) -> None:
        """Listen anew: the past is no longer like what comes."""
        self._heard = 0
        self._search = None

    def subtract(self, samples: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write to ``out`` what remains of samples, shape (n,) both; missing samples are not finite."""
        if self.harmonics is None:
            out[:] = samples
        else:
            self.harmonics.subtract(samples, out)

    def end_frame(
        self,
        samples: NDArray[np.float64],
        taken_hz: float | None = None,
        sidebands: Sidebands | None = None,
        *,
        rotation_hz: float | None = None,
        mains_only: bool = False,
    ) -> bool:
        """Learn from a full frame of samples, and look for a comb when it is time.

        Parameters
        ----------
        samples : ndarray of float64, shape (frame,)
            The signal; missing samples are not finite.
        taken_hz : float, optional
            Fundamental of a comb that has been taken out of it; what may be left of its lines does not count.
        sidebands : Sidebands, optional
            Of a vibration in it that is no comb's, whose sidebands tell it: that of a known speed apart, a comb that
            has it among its lines is given up, and these lines are no evidence for another.
        rotation_hz : float, optional
            Of a spindle of told speed that has been heard; a comb that has locked to it counts neither for nor against.
        mains_only : bool
            Whether no comb counts now but that of the mains.

        Returns
        -------
        bool
            Whether a new comb was found.
        """
        self.frames += 1
        if self.harmonics is not None:
            self.harmonics.learn()
            self._check(self.harmonics, sidebands)
        if copy_present(samples, math.inf, self._past[self.frames % len(self._past)]) == len(samples):
            self._heard = min(self._heard + 1, self._window)
        else:
            self.forget()
        self._rest -= 1
        # What was told may be heard again beside what is followed; and few lines near the teeth may be those of a pump.
        looks = self.harmonics is None or self.doubts or self._has_few
        if looks and self._rest <= 0 and self._search is None:
            self._search = self._begin(Beside(taken_hz, rotation_hz, mains_only, sidebands))
        return self._search is not None and self._go_on(self._search)

    def _begin(self, beside: Beside) -> Search | None:
        """Begin a search, if enough has been heard."""
        # A range that is narrow needs less to be sure. A speed that wanders blurs a line the more the longer one looks,
        # and is steady enough at one time or another.
        wanted = [self._window // 2, self._window] if self._known else [self._window]
        lengths = [frames for frames in wanted if frames <= self._heard]
        if not lengths:
            return None
        if self.harmonics is None and self._known:
            self._rest = 0
        else:
            self._rest = self._window // (OFTEN if beside.nothing and not self._known else 2)
        return self._look(lengths, beside)

    def _go_on(self, search: Search) -> bool:
        """Do a frame's part of a search; tell whether it has found a comb that was not followed before."""
        try:
            next(search)
        except StopIteration as over:
            self._search = None
            if over.value is not None:
                return self._take_up(*over.value)
        return False

    def _take_up(self, found: Harmonics, target: Target) -> bool:
        """Follow what was found, if that is at another speed, or has enough clear lines at the same; tell which."""
        another = (
            self.harmonics is None
            or self._followed is not target
            or abs(found.rotation_hz / self.harmonics.rotation_hz - 1.0) > ANOTHER_SPEED
        )
        if another or len(found.clear()) >= self._anything.fewest:
            self.harmonics, self._followed = found, target
            self._doubtful_frames = 0
        return another

    def _check(self, harmonics: Harmonics, sidebands: Sidebands | None) -> None:
        """Give up a comb that has a vibration with sidebands among its lines, or has not been one for too long.

        Where the speed changes, it stays one. The mains have a high multiple near anything: that is left to the
        vibration, and they hum on.
        """
        rotation_hz = harmonics.rotation_hz
        order = None if sidebands is None or _is_told(self._followed) else sidebands.order(rotation_hz)
        by_chance = order is not None and order * rotation_hz > HUMS_BELOW_HZ and is_mains(rotation_hz)
        harmonics.leave(order if by_chance else None)
        if order is not None and not by_chance:
            self.harmonics = None
            self._rest = self._window // 2  # or it would be found again in what has not changed
            return
        if self.frames % CHECK_FRAMES == 0:
            clear = harmonics.clear()
            self._clear = len(clear)
            if self._followed.stands(clear, harmonics.rotation_hz):
                self._doubtful_frames = 0
            else:
                self._doubtful_frames += CHECK_FRAMES
        if self._doubtful_frames > self._patience:
            self.harmonics = None

    @property
    def has_heard_enough(self) -> bool:
        """Whether the latest window is whole."""
        return self._heard == self._window

    def faint_lines(self, last: int, part: int = 1, known_hz: float | None = None) -> Lines:
        """Lines of the last such part of the window up to a frame, one of the latest few, faint ones among them.

        Few of them are of a comb of known fundamental.
        """
        return self._spectrum(self._window // part, last).faint_lines(known_hz)

    def lines_in_step(self, last: int, part: int = 1) -> Lines | None:
        """Lines of the same, read in step with the strongest."""
        led = self._led(self._window // part, last)
        return None if led is None else led.lines

    def _spectrum(self, frames: int, last: int) -> Spectrum:
        """Spectrum of so many frames of the past, up to one."""
        spectrum = self._spectrum_of(frames)
        if self._transformed.get(frames) != last:  # a search asks for the same one twice
            self._transformed[frames] = last
            spectrum.transform(*self._pieces(frames, last))
        return spectrum

    def _spectrum_of(self, frames: int) -> Spectrum:
        """What transforms so many frames, whatever it has transformed last."""
        if frames not in self._spectra:  # there are few lengths: the window, and halves of it
            samples = frames * self._past.shape[1]
            self._spectra[frames] = Spectrum(samples, self._rate_hz, self._lowest_hz)
        return self._spectra[frames]

    def _pieces(self, frames: int, last: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Samples of so many frames of the past, up to one: the past is a ring."""
        first = (last - frames + 1) % len(self._past)
        before_the_end = self._past[first : first + frames]
        return before_the_end.ravel(), self._past[: frames - len(before_the_end)].ravel()

    def _latest(self, frames: int) -> NDArray[np.float64]:
        return self._past[np.arange(self.frames - frames + 1, self.frames + 1) % len(self._past)]

    def _look(self, lengths: list[int], beside: Beside) -> Search:
        """Look for a comb in so many of the last frames, and follow it from there to now."""
        for frames in lengths:
            begun = self.frames
            search = partial(self._candidate, frames, begun, beside)
            found = (yield from in_turn(self._turn, search)) if self._known else search()
            if found is not None and (is_mains(found.comb.fundamental_hz) or not beside.mains_only):
                harmonics = yield from self._follow(found, frames, self.frames - begun)
                if harmonics is not None:
                    return harmonics, found.target
        return None

    @property
    def _known(self) -> bool:
        """Whether it is after the comb of a known speed. Any other is worth a long frame: waiting costs alarms."""
        return _is_told(self._target)

    def _candidate(self, frames: int, last: int, beside: Beside) -> Candidate | None:
        """The comb of so many frames, if there is one: of the lines that stand out, or else with those beside them.

        Or else, while no comb is known, of the lines that are seen in step with the strongest.
        """
        spectrum = self._spectrum(frames, last)
        found = self._among(spectrum.lines(), frames, last, beside)
        if found is not None:
            return found
        found = self._among(spectrum.faint_lines(), frames, last, beside)
        if found is not None and found.comb.evidence > ENOUGH:
            return found._replace(faint=True)
        led = None if self._known or not beside.nothing else self._led(frames, last)
        if led is None:
            return None
        comb = self._any_comb(led.evidence(), lambda: led.lines, self._target, beside)
        if comb is None or not led.admits(comb.fundamental_hz):
            return None
        return Candidate(comb, self._target, led=led)

    def _led(self, frames: int, last: int) -> Led | None:
        """Lines of so many frames up to one, read in step with the strongest."""
        strongest = self._spectrum(frames, last).lines().frequency_hz[:1].tolist()
        return self._in_step(strongest[0], frames, last) if strongest else None

    def _in_step(self, leader_hz: float, frames: int, last: int) -> Led | None:
        """Lines of so many frames up to one, read in step with one of them."""
        self._transformed.pop(frames, None)
        return self._spectrum_of(frames).lines_in_step(leader_hz, *self._pieces(frames, last))

    def _among(self, lines: Lines, frames: int, last: int, beside: Beside) -> Candidate | None:
        """The comb among lines of so many frames."""
        if beside.taken_hz is not None:
            lines = lines.without(lines.on(beside.taken_hz))
        if not self._known:
            comb = self._any_comb(lines, partial(self.faint_lines, last), self._target, beside)
            return None if comb is None else Candidate(comb, self._target)
        comb = find_told_comb(lines, self._target)
        # half a window is enough to doubt what was told, but not to believe anything else
        new = frames == self._window and self.harmonics is None
        if comb is None and not new:
            return None
        followed = self.harmonics is not None and not self.doubts
        if followed and comb is not None and comb.evidence < ENOUGH:
            return None  # too little to take the place of what is followed
        rival = self._any_comb(lines, partial(self.faint_lines, last), self._anything, beside)
        if rival is not None and speaks_against(rival, comb, lines, self._target):
            return Candidate(rival, self._anything) if new else None
        if comb is None or (self.doubts and not speaks_for(comb, rival, lines, self._target)):
            return None
        return Candidate(comb, self._target)

    def _any_comb(self, lines: Lines, faint: Callable[[], Lines], target: Target, beside: Beside) -> Comb | None:
        """A comb among lines that is not that of a vibration with sidebands, or one that has locked to the spindle.

        Sidebands are looked for among faint lines, which cost more.
        """
        comb = find_any_comb(lines, target)
        if comb is not None and beside.rotation_hz is not None and is_locked(comb.fundamental_hz, beside.rotation_hz):
            lines = lines.without(lines.on(comb.fundamental_hz))
            comb = find_any_comb(lines, target)
        if comb is None or not self.has_heard_enough:
            return comb
        with_sidebands = faint()
        sidebands = find_sidebands(with_sidebands, target.low_hz) or beside.sidebands
        if sidebands is not None and sidebands.order(comb.fundamental_hz) is not None:
            comb = find_any_comb(lines.without(sidebands.of(lines)), target)
        if comb is None or is_mains(comb.fundamental_hz):
            return comb
        return None if may_be_sidebands(with_sidebands, comb.fundamental_hz, target.low_hz) else comb

    def _follow(self, found: Candidate, frames: int, ago: int) -> Piecemeal[Harmonics | None]:
        """Follow a comb through the frames in which it was found, so many frames ago, and on to now."""
        comb, target = found.comb, found.target
        start_hz = comb.fundamental_hz * (1.0 if found.led is None else found.led.start)
        sd_hz = max(comb.fundamental_sd_hz, WANDER * comb.fundamental_hz)
        harmonics = Harmonics(start_hz, sd_hz, self._rate_hz, memory_s=self._memory_s, lowest_hz=self._lowest_hz)
        nothing = np.empty(self._past.shape[1])
        lately = frames - frames // 2
        speeds_hz = deque[float](maxlen=lately)
        behind = frames + ago
        at_once = CATCH_UP_FRAMES if self._known else behind
        while behind:
            for samples in self._latest(behind)[:at_once]:
                harmonics.subtract(samples, nothing)
                harmonics.learn()
                speeds_hz.append(harmonics.rotation_hz)
                behind -= 1
            if behind:
                yield
                behind += 1
        # A self-excited vibration that crosses an order takes the harmonics along, away from where the other lines are.
        # These are at multiples of the mean speed.
        mean_hz = sum(speeds_hz) / lately
        orders = self._lines_like(found, mean_hz, lately).orders(mean_hz)
        stands = target.stands(harmonics.clear(), harmonics.rotation_hz) and target.stands(orders, mean_hz)
        return harmonics if stands else None

    def _lines_like(self, found: Candidate, mean_hz: float, frames: int) -> Lines:
        """Lines of the latest frames, told as those were by which a comb was found; its mean speed is that by now."""
        if found.led is not None:
            led = self._in_step(found.led.leader_hz * mean_hz / found.comb.fundamental_hz, frames, self.frames)
            if led is not None:
                return led.lines
        spectrum = self._spectrum(frames, self.frames)
        return spectrum.faint_lines() if found.faint else spectrum.lines()


def _is_told(target: Target) -> bool:
    """Whether it is the comb of a spindle whose speed was told."""
    return target.teeth is not None
