"""Naive twins of the kernels: slow, short, to be checked by eye against the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import argrelmax
from scipy.special import expit
from scipy.stats import linregress, rayleigh

from chatter_monitor.kernels import comb, rarma, slots, vibrations
from chatter_monitor.kernels.kinds import CONVINCING, PRIOR, Chain, measures
from chatter_monitor.kernels.prominence import AROUND, LOBE


@dataclass
class NaiveRarma:
    """RPEM for RARMA(p, q), eq. (18) and (22), with a plain covariance matrix. theta = [c, a]."""

    p: int
    q: int
    forgetting: float
    theta: NDArray[np.float64] = field(init=False)
    covariance: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        n = self.p + self.q
        self.theta = np.zeros(n)
        self.covariance = rarma.PRIOR_VARIANCE * np.eye(n)
        self.y: list[float] = [0.0] * 8
        self.e: list[float] = [0.0] * 8
        self.y_filtered: list[float] = [0.0] * 8
        self.e_filtered: list[float] = [0.0] * 8
        self.power = self.variance = self.scatter = self.window = self.window_squared = 0.0
        self.adapted = 0

    def regressor(self, e: list[float], y: list[float]) -> NDArray[np.float64]:
        return np.array([e[-i] for i in range(1, self.q + 1)] + [-y[-i] for i in range(1, self.p + 1)])

    def step(self, sample: float) -> None:
        forgetting, speed = self.forgetting, rarma.VARIANCE_SPEED * (1 - self.forgetting)
        phi, psi = self.regressor(self.e, self.y), self.regressor(self.e_filtered, self.y_filtered)
        error = sample - self.theta @ phi
        self.power += speed * (sample**2 - self.power)
        if self.adapted == 0:
            self.variance = sample**2 + self.power
        variance = max(self.variance, rarma.PREDICTABLE_SHARE * self.power)
        noise = max(variance, (error / rarma.OUTLIER_SD) ** 2)
        total = forgetting * noise + psi @ self.covariance @ psi
        gain = self.covariance @ psi / total
        self.theta = self.theta + gain * error
        self.covariance = (self.covariance - np.outer(gain, gain) * total) / forgetting
        zeros = np.roots([1, *self.theta[: self.q]])
        if np.any(abs(zeros) >= forgetting):
            radius = rarma.CONTRACTION * forgetting
            self.theta[: self.q] = np.poly(zeros / np.maximum(1, abs(zeros) / radius)).real[1:]
        explained = min(error**2 * forgetting * noise / total, rarma.OUTLIER_SD**2 * variance)
        self.variance = variance + speed * (explained - variance)
        if self.adapted < rarma.SAMPLES_PER_COEFFICIENT * (self.p + self.q):
            self.usual = self.variance
        if self.variance > rarma.SURPRISE * self.usual:
            self.distrust(self.variance / self.usual)
            self.usual = self.variance
        self.usual += (1 - forgetting) * (self.variance - self.usual)
        self.window = forgetting * self.window + 1
        self.window_squared = forgetting**2 * self.window_squared + 1
        self.scatter += (explained / noise - self.scatter) / self.window
        self.adapted += 1
        residual = sample - self.theta @ phi
        c = self.theta[: self.q]
        # (1/C) y and (1/C) e: what is filtered now plus C's memory of what was filtered before
        y_filtered = sample - sum(c[i] * self.y_filtered[-1 - i] for i in range(self.q))
        e_filtered = residual - sum(c[i] * self.e_filtered[-1 - i] for i in range(self.q))
        for history, value in (
            (self.y, sample), (self.e, residual), (self.y_filtered, y_filtered), (self.e_filtered, e_filtered)
        ):  # fmt: skip
            history.append(value)

    def distrust(self, factor: float) -> None:
        """Multiply the D of P = U D U' by the factor, but nothing beyond the prior."""
        root = np.linalg.cholesky(self.covariance[::-1, ::-1])[::-1, ::-1]  # upper triangular: P = root root'
        d = np.diag(root) ** 2
        u = root / np.diag(root)
        self.covariance = u @ np.diag(np.maximum(d, np.minimum(d * factor, rarma.PRIOR_VARIANCE))) @ u.T

    def odps(self, rate_hz: float) -> list[tuple[float, float, float, float]]:
        """(frequency Hz, damping, their standard deviations) of each complex pair, by numerical differentiation."""
        a = self.theta[self.q :]
        covariance = self.scatter * self.window_squared / self.window * self.covariance[self.q :, self.q :]
        roots = np.roots([1, *a])
        upper = sorted(roots[roots.imag > 0], key=lambda mu: float(abs(np.log(mu))))

        def meaning(mu: complex) -> NDArray[np.float64]:
            s = np.log(mu)
            return np.array([abs(s) * rate_hz / (2 * np.pi), -s.real / abs(s)])  # eq. (25), (24) corrected

        result = []
        for mu in upper:
            gradient = np.zeros((2, self.p))
            for i in range(self.p):
                h = 1e-7
                moved = []
                for sign in (1, -1):
                    shifted = a.copy()
                    shifted[i] += sign * h
                    candidates = np.roots([1, *shifted])
                    moved.append(meaning(candidates[np.argmin(abs(candidates - mu))]))
                gradient[:, i] = (moved[0] - moved[1]) / (2 * h)
            sd = np.sqrt(np.einsum("ki,ij,kj->k", gradient, covariance, gradient))
            result.append((*meaning(mu), *sd))
        return result


def prominence(power: NDArray[np.float64], lowest: int) -> NDArray[np.float64]:
    """Logarithm of each bin less the mean logarithm of the bins around it, its own lobe left out."""
    level = np.log(power)
    result = np.zeros(len(power))
    for b in range(lowest, len(power)):
        away = abs(np.arange(len(power)) - b)
        around = (away > LOBE) & (away <= LOBE + AROUND) & (np.arange(len(power)) >= lowest)
        result[b] = level[b] - level[around].mean()
    return result


def repeating(samples: NDArray[np.float64], size: int, thinned: int, averaging: float, louder: float) -> float:
    """Largest of the averaged correlations of each frame with what was one to two frames before.

    A frame that is so many times as powerful as the average counts by its share of that.
    """
    thin = samples.reshape(-1, thinned).mean(axis=1)
    size //= thinned
    average, power = np.zeros((2, size + 1))
    thin = np.concatenate([np.zeros(2 * size), thin])
    for begin in range(2 * size, len(thin), size):
        here = thin[begin : begin + size]
        for lag in range(size, 2 * size + 1):
            before = thin[begin - lag : begin - lag + size]
            now = np.corrcoef(here, before)[0, 1] if before.any() else 0.0
            norm = size * np.std(here) * np.std(before)
            power[lag - size] += averaging * (norm - power[lag - size])
            times = norm / power[lag - size] if norm > 0.0 else 0.0
            average[lag - size] += averaging * (times if times > louder else 1.0) * (now - average[lag - size])
    return float(max(average.max(), 0.0))


def coherence(amplitudes: NDArray[np.complex128], valid: NDArray[np.bool_], lag: int) -> float:
    """Modulus of the correlation coefficient of amplitudes (oldest first) a lag apart, where both are known."""
    both = valid[lag:] & valid[:-lag]
    late, early = amplitudes[lag:][both], amplitudes[:-lag][both]
    return float(abs(np.vdot(early, late)) / np.sqrt(np.vdot(early, early).real * np.vdot(late, late).real))


def variation(amplitudes: NDArray[np.complex128]) -> float:
    """Coefficient of variation of the modulus."""
    return float(np.std(abs(amplitudes)) / np.mean(abs(amplitudes)))


def growth(amplitudes: NDArray[np.complex128]) -> float:
    """Slope of the logarithm of the modulus for each step, by least squares."""
    return float(linregress(np.arange(len(amplitudes)), np.log(abs(amplitudes))).slope)


def rise(
    reliefs: NDArray[np.float64],
    levels: NDArray[np.float64],
    cutting: NDArray[np.bool_],
    since: int,
    b: int,
    powers: NDArray[np.float64] | None = None,
) -> float:
    """Logarithm of the newest amplitude of a line (oldest row first) over its upper median, by its prominence.

    With the powers of all bins, what stands out on the slope of another line is nothing, unless the line is on one yet.
    Rows in which nothing was cut, and whose level (logarithm of the power) is 25 dB below the newest, do not count.
    It is the smaller of the rise above the rows since the tool entered, and above all.
    """
    heights = reliefs[:, b - 1 : b + 2].max(axis=1)
    if powers is not None:
        slope = [not set(argrelmax(row)[0]) & {b - 1, b, b + 1} for row in powers]
        heights = np.where(slope, np.minimum(heights, 0.0), heights) if not slope[-1] else heights
    counts = cutting & (levels > levels[-1] - 5.8)
    last = np.arange(len(heights)) >= len(heights) - since
    usual = [np.sort(heights[some])[np.sum(some) // 2] for some in (counts, counts & last)]
    return float(0.5 * (heights[-1] - max(usual)))


@dataclass
class NaiveVibration:
    """A vibration from interval to interval, by the rules of decision 13, with the chain as a matrix."""

    hertz: float
    odds: float
    dominance: float
    power: float
    told: float = 0.0
    level: float = -np.inf  # of the last line
    heights: list[float] = field(default_factory=lambda: [0.0])  # of the running climb
    kinds: NDArray[np.float64] = field(default_factory=lambda: np.array(PRIOR))
    alarm_for: int = 0
    chattered: bool = False
    missed: int = 0
    over: int = 0
    own: int = 0  # since an alarm that no memory of another helped to begin
    recalled: bool = False
    unexplained: float = 0.0
    heard: int = 0
    late: bool = False
    jitter: float = 0.0
    place: float = 0.0
    glide: float = 0.0
    glides: list[bool] = field(default_factory=list)
    rise: float = 0.0
    on_order: float = np.nan  # where it was on one last
    calm: float = -np.inf

    @property
    def self_excited(self) -> float:
        return float(self.kinds[1] + self.kinds[2]) * self.unexplained

    @property
    def glided(self) -> bool:
        last = self.glides[-109:]
        return any(all(last[i : i + 10]) for i in range(len(last) - 9))

    def is_it(self, line: np.void) -> bool:
        away = abs(np.log(line["frequency_hz"] / self.hertz))
        near = max(0.06, 25.0 / self.hertz) if self.missed < vibrations.FORGOTTEN else max(0.03, 6.0 / self.hertz)
        return bool(away < near)

    def interval(self, line: np.void | None, rules: vibrations.Rules, weights: NDArray[np.float64]) -> None:
        seen, news, arrival = np.array(vibrations.NOT_HEARD), 0.0, 0.0
        self.missed += 1
        if line is not None:
            self.missed, self.hertz = 0, line["frequency_hz"]
            if line["carrier"]:
                self.glides = []
            had_glided = self.glided
            self.follow_frequency()
            if had_glided and not self.glided:
                self.kinds, self.chattered = np.array(vibrations.CALMED), False
            odds, known = line["order_odds"], line["order_odds"] != rules.odds.unknown_speed
            if known and odds < -1.0:
                self.on_order = self.hertz
            elif not known and self.odds < -1.0 and abs(np.log(self.hertz / self.on_order)) < 0.01:
                odds = self.odds
            self.odds += vibrations.AVERAGING * (odds - self.odds)
            a = vibrations.AVERAGING
            own = (1.0 - a) * self.dominance * self.power + a * line["dominance"] * line["power"]
            self.power = (1.0 - a) * self.power + a * line["power"]
            keeps = self.alarm_for and self.odds > vibrations.SURELY_ON
            self.dominance = max(own / self.power, self.dominance if keeps else 0.0)
            rise = min(line["long_rise"], line["absolute_rise"])
            self.rise = (1.0 - a) * self.rise + a * rise
            self.heights = [0.0] if rise < 0.3 else [*self.heights, max(rise, self.heights[-1])]
            self.late |= self.heard == vibrations.ARRIVED and self.kinds[0] > 0.5
            unforced = line["carrier"] or (self.odds >= vibrations.SURELY_OFF and not self.late)
            arrival = line["arrival"] if unforced else 0.0
            seen = self.likeness(line, weights, arrival)
            news = self.news(line) if seen[0] > 0.0 else -self.told
            news = min(news, np.inf if line["absolute_rise"] >= self.level - 0.35 else 0.0)
            self.level = line["absolute_rise"]
            self.told += news
        self.kinds = self.forward(seen, news, rules.chain, unforced=self.chattered or arrival > 0.8)
        risen = self.kinds[1] + self.kinds[2]
        odds = self.odds
        if self.glided:
            odds = min(odds, rules.odds.unknown_speed) - 6.0
        else:
            steps = [0.0, *np.diff(self.heights)]
            odds += 2.0 * (sum(steps) - max(map(sum, pairwise([*steps, 0.0]))) > 1.0)
        self.unexplained = float(expit(odds + rules.odds.offset + rules.odds.dominance * self.dominance))
        before = self.alarm_for
        alarm = self.self_excited >= (rules.calm_probability if before else rules.alarm_probability)
        rest = line is not None and line["carrier"]
        alarm = alarm and (self.chattered or rest or self.dominance >= 0.2)
        self.alarm_for = before + 1 if alarm else 0
        self.recalled = self.recalled if before else self.chattered
        self.over, self.own = (0 if alarm else self.over + 1), (0 if alarm and not self.recalled else self.own + 1)
        self.chattered = alarm or (self.chattered and self.own < vibrations.FORGOTTEN_CHATTER)
        self.told *= not alarm
        if line is not None and self.alarm_for == 1 and not self.recalled:
            self.calm = self.amplitude(line) - rise if rise >= 0.8 else -np.inf  # of the amplitude, as a logarithm
        if before and not alarm and risen < 0.5:
            self.kinds = np.array(vibrations.CALMED)

    def amplitude(self, line: np.void) -> float:
        return 0.5 * math.log(line["share"] * line["power"])

    def follow_frequency(self) -> None:
        if not self.heard:
            self.place = float(np.log(self.hertz))
        miss = float(np.log(self.hertz)) - self.place - self.glide
        self.heard += 1
        gain = max(0.35, 1.0 / self.heard)
        self.place += self.glide + gain * miss
        self.glide += 0.074 * miss * (self.heard > 2)
        self.jitter = (1.0 - gain) * self.jitter + gain * miss**2
        self.glides.append(bool(abs(self.glide) > max(1e-3, 0.4 * np.sqrt(self.jitter))))

    def news(self, line: np.void) -> float:
        if self.chattered and self.over < 40:
            return 0.0
        absolute = line["absolute_rise"]
        own = np.clip(absolute - line["long_rise"], 0.0, max(0.15 * absolute, 0.0))  # of what the surroundings rose
        risen = max(min(line["rise"] + own, line["long_rise"] + own, absolute), 0.0)
        by_chance = rayleigh.logpdf(np.exp(risen), scale=1.0 / np.sqrt(2.0 * np.log(2.0))) + risen  # of the logarithm
        tells = np.clip(-np.log(3.5) - by_chance, 0.0, 24.0) * min(line["dominance"], 1.0)
        return float(tells - self.told)

    def likeness(self, line: np.void, weights: NDArray[np.float64], arrival: float) -> NDArray[np.float64]:
        if line["growth"] >= (0.25 if self.chattered else 0.5):
            return np.array([CONVINCING, CONVINCING, -CONVINCING])
        fallen = [rise for rise in (line["absolute_rise"], line["long_rise"]) if rise < vibrations.DIED_DOWN]
        calm_again = self.amplitude(line) < self.calm + (0.0 if self.alarm_for else 0.4)
        if self.chattered and ((fallen and line["absolute_rise"] < 0.0) or calm_again):
            return np.full(3, -CONVINCING)
        growth, calm = np.clip(weights @ [*measures(line), 1.0], -CONVINCING, CONVINCING)
        calm = CONVINCING if line["carrier"] else calm
        risen = max(min(line["long_rise"], line["absolute_rise"]), arrival)
        seen = np.array([growth, calm, max(calm - 8.0 * max(risen - 0.8, 0.0), -CONVINCING)])
        least = np.exp(-vibrations.COHERENT_DAMPING * 2.0 * np.pi * line["frequency_hz"] * 0.025)
        if line["coherence"] < max(least, vibrations.LEAST_COHERENCE):
            seen[0] = min(seen[0], 0.0)
        return seen

    def forward(self, seen: NDArray[np.float64], news: float, chain: Chain, *, unforced: bool) -> NDArray[np.float64]:
        change = np.zeros((4, 4))  # from noise, growing, saturated, steady
        change[0, 1], change[0, 2 if unforced else 3] = chain.begins_to_grow, chain.begins_steady
        change[1, 0], change[1, 2] = chain.dies_while_growing, chain.saturates
        change[2, 0] = chain.ends
        change[3, 0], change[3, 1] = chain.ends, chain.grows_when_steady
        change += np.diag(1.0 - change.sum(axis=1))
        likelihood = np.exp(chain.evidence * np.array([0.0, *seen]) + np.array([0.0, news, 0.0, 0.0]))
        posterior = self.kinds @ change * likelihood
        return np.asarray(posterior / posterior.sum())


def arrival(history: NDArray[np.float64], cutting: NDArray[np.bool_], since: int, b: int, least: int) -> float:
    """How much higher a bin is than the upper medians of all that was before the tool entered and of cuts in it."""
    heights = history[:, b - 1 : b + 2].max(axis=1)
    before, cut = heights[: len(heights) - since], cutting[: len(heights) - since]
    usual = [np.sort(heard)[len(heard) // 2] for heard in (before, before[cut]) if len(heard) >= least]
    return 0.5 * float(heights[-1] - max(usual)) if usual else 0.0


def news(history: NDArray[np.float64], cutting: NDArray[np.bool_], since: int, b: int, least: int) -> float:
    """How much higher a bin is than before the tool entered: the larger upper median in cuts, and in the last air.

    Rows of `history` are frames, the newest last; the tool entered `since` frames ago.
    """
    heights = history[:, b - 1 : b + 2].max(axis=1)
    before, in_a_cut = heights[: len(heights) - since], cutting[: len(heights) - since]
    cut, air = before[in_a_cut], before[~in_a_cut][-least:]
    if not cutting[-1] or min(len(cut), len(air)) < least:
        return 0.0
    return 0.5 * float(heights[-1] - max(np.sort(some)[len(some) // 2] for some in (cut, air)))


def follow_all(
    before: list[NaiveVibration], lines: list[np.void], rules: vibrations.Rules, weights: NDArray[np.float64]
) -> list[NaiveVibration]:
    """Vibrations after another interval, the most suspicious first: pairs of them and lines, the nearest first.

    Those that an alarm is about choose before the others. For two seconds after an alarm another one is as easily had.
    """
    if any(v.chattered and v.over < 40 for v in before):
        rules = rules._replace(alarm_probability=rules.calm_probability)
    away = [
        (vibration.alarm_for == 0, abs(np.log(line["frequency_hz"] / vibration.hertz)), v, n)
        for v, vibration in enumerate(before)
        for n, line in enumerate(lines)
        if vibration.is_it(line)
    ]
    own: dict[int, int] = {}
    for _, _, v, n in sorted(away):
        if v not in own and n not in own.values():
            own[v] = n
    for v, vibration in enumerate(before):
        vibration.interval(lines[own[v]] if v in own else None, rules, weights)
    for line in (line for n, line in enumerate(lines) if n not in own.values()):
        before.append(NaiveVibration(line["frequency_hz"], line["order_odds"], line["dominance"], line["power"]))
        before[-1].interval(line, rules, weights)
    return sorted((v for v in before if v.chattered or v.missed < vibrations.FORGOTTEN), key=lambda v: -v.self_excited)


def crests(power: NDArray[np.float64], line_to_noise: float, lowest: int) -> NDArray[np.int64]:
    """Local maxima beyond a multiple of the noise: the median of every second bin of their stretch over ln 2."""
    noise = np.repeat(np.median(power.reshape(-1, comb.FLOOR_BINS)[:, ::2], axis=1) / np.log(2.0), comb.FLOOR_BINS)
    inner = power[1:-1]
    found = (inner > power[:-2]) & (inner >= power[2:]) & (inner > line_to_noise * noise[1:-1])
    peaks = np.flatnonzero(found) + 1
    return peaks[peaks >= lowest]


def crests_beside(power: NDArray[np.float64], line_to_noise: float, lowest: int, least: float) -> list[int]:
    """Local maxima of so much power and a multiple of the noise: upper median of 16 bins on either side over ln 2."""

    def noise(b: int) -> float:
        beside = np.sort(power[max(b - 16, 0) : b + 17])
        return float(beside[len(beside) // 2]) / math.log(2.0)

    return [
        b
        for b in range(max(lowest, 1), len(power) - 1)
        if power[b - 1] < power[b] >= power[b + 1] and power[b] >= max(least, line_to_noise * noise(b))
    ]


def explained(
    hertz: NDArray[np.float64], off: NDArray[np.float64], *places: tuple[NDArray[np.float64], float]
) -> float:
    """Log odds against chance that lines are at sets of places, each with the mean distance from one to the next.

    One line made the places and is there for certain: the rarest. Which lines are there is a choice, and at which set.
    """
    surprises: list[float] = []
    hits = [0] * len(places)
    for line, exact in zip(hertz, off, strict=True):
        there = [number for number, (at, _) in enumerate(places) if np.min(np.abs(line - at)) <= exact]
        if there:
            hits[there[0]] += 1
            surprises.append(max(0.0, math.log(places[there[0]][1] / (2.0 * exact))))
    total, lines = sum(hits), len(hertz) - 1
    choices = math.comb(lines, min(max(total - 1, 0), lines)) * math.comb(total, hits[0])
    return sum(surprises) - max(surprises, default=0.0) - math.log(choices)


def family(
    hertz: NDArray[np.float64], off: NDArray[np.float64], carrier: float, spacing: float
) -> tuple[set[int], set[int]]:
    """Lines that a carrier with sidebands brings along, and those among all of it that are forced ones."""
    brought, forced = set(), set()
    for i, line in enumerate(hertz):
        for overtone in range(1, comb.OVERTONES + 1):
            for sideband in range(-comb.SIDEBANDS, comb.SIDEBANDS + 1):
                if abs(line - overtone * carrier - sideband * spacing) <= 2.0 * off[i]:
                    brought.add(i)
        if any(abs(line - k * spacing) <= 2.0 * off[i] for k in range(1, comb.FORCED + 1)):
            forced.add(i)
    return brought, forced


@dataclass(frozen=True)
class NaiveMode:
    """One mode of one octave in a frame."""

    octave: int
    mode: int
    hertz: float
    power: float

    def distance(self, later: NaiveMode) -> float:
        return float(abs(np.log(later.hertz / self.hertz)))


class NaiveSlots:
    """Slots of a frame by sorting: all candidates by power, all pairs of slot and candidate by rank."""

    def __init__(self, homes: NDArray[np.float64], count: int) -> None:
        self.homes = homes
        self.last: list[NaiveMode | None] = [None] * count
        self.present = [False] * count

    def assign(self, hertz: NDArray[np.float64], powers: NDArray[np.float64]) -> list[NaiveMode | None]:
        chosen = self.distinct(hertz, powers)[: len(self.last)]
        found: list[NaiveMode | None] = [None] * len(self.last)
        known = [(slot, mode) for slot, mode in enumerate(self.last) if mode is not None]
        pairs = sorted((*self.rank(slot, mode, new), slot, i) for slot, mode in known for i, new in enumerate(chosen))
        for *_, slot, i in pairs:
            if found[slot] is None and chosen[i] not in found:
                found[slot] = chosen[i]
        for new in chosen:
            if new not in found:
                found[found.index(None)] = new
        self.last = [new or mode for new, mode in zip(found, self.last, strict=True)]
        self.present = [new is not None for new in found]
        return found

    def rank(self, slot: int, known: NaiveMode, new: NaiveMode) -> tuple[int, float]:
        distance = known.distance(new)
        if not self.present[slot] or distance > slots.LOYALTY:
            return 2, distance
        same = (known.octave, known.mode) == (new.octave, new.mode)
        return (0, distance) if same else (1, -new.power)

    def distinct(self, hertz: NDArray[np.float64], powers: NDArray[np.float64]) -> list[NaiveMode]:
        owned = {(mode.octave, mode.mode) for mode in self.last if mode is not None}
        candidates = [
            NaiveMode(octave, mode, hertz[octave, mode], powers[octave, mode])
            for octave, (low, high) in enumerate(self.homes)
            for mode in range(hertz.shape[1])
            for spread in [slots.LOYALTY if (octave, mode) in owned else 0.0]
            if low * (1.0 - spread) <= hertz[octave, mode] <= high * (1.0 + spread)
        ]
        distinct: list[NaiveMode] = []
        for new in sorted(candidates, key=lambda mode: -mode.power):
            others = [known for known in distinct if known.octave != new.octave]
            if all(abs(new.hertz - known.hertz) > slots.SAME_VIBRATION * known.hertz for known in others):
                distinct.append(new)
        return distinct
