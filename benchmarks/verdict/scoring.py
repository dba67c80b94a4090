"""How verdicts are scored against the truth: by interval, by event, by lag, by confidence.

Scoring rules change rankings, so intervals and events are both given. Whatever the truth leaves open is not scored.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cut import INTERVAL_S, Cut, Label
from benchmarks.verdict.monitor import Opinions

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

SUDDEN = ("step", "forced_then_chatter")
WITH_TONE = ("background_tone", "hum")
EARLY_S = 0.5  # a false alarm so shortly before a crossing is named apart: it is early rather than wrong
WARNING_S = 2.0  # a warning counts for so long before the amplitude has doubled
LAG_S, LAG_PERIODS = 0.05, 30.0  # the longer is allowed
SNR_BANDS_DB = ((10.0, 18.0), (18.0, 27.0), (27.0, 35.0))
CONFIDENCE_EDGES = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0001)


@dataclass(frozen=True, eq=False)
class Heard:
    """A cut and what was said of it."""

    cut: Cut
    said: Opinions

    @property
    def alarm(self) -> Bools:
        """Intervals that were called self-excited."""
        return np.asarray(self.said.state == "self_excited")

    @property
    def raised(self) -> Bools:
        """The same, and those that were called near it."""
        return np.asarray((self.said.state == "approaching") | self.alarm)


def by_interval(heard: Iterable[Heard]) -> dict[str, float | None]:
    """Recall of self-excited intervals, false alarms among the others, forced called forced.

    Returns
    -------
    dict
        Counts, `recall`, `false_alarm_share`, `false_alarms_per_hour` (events), `early_share` (false alarms shortly
        before a crossing, contained in the former), `forced_accuracy`, `unscored_share`; None where there is nothing
        to count.
    """
    n = dict.fromkeys(
        ("self", "recalled", "calm", "false", "early", "events", "forced", "called_forced", "unscored"), 0
    )
    total = 0
    for h in heard:
        label = h.cut.truth.label
        calm = (label == Label.OTHER) | (label == Label.FORCED)
        wrong = h.alarm & calm
        n["self"] += int(np.sum(label == Label.SELF_EXCITED))
        n["recalled"] += int(np.sum(h.alarm & (label == Label.SELF_EXCITED)))
        n["calm"] += int(np.sum(calm))
        n["false"] += int(np.sum(wrong))
        n["early"] += int(np.sum(wrong & _shortly_before(h.cut)))
        n["events"] += _beginnings(wrong)
        n["forced"] += int(np.sum(label == Label.FORCED))
        n["called_forced"] += int(np.sum((h.said.state == "forced") & (label == Label.FORCED)))
        n["unscored"] += int(np.sum(label == Label.UNSCORED))
        total += label.size
    hours = n["calm"] * INTERVAL_S / 3600.0
    return {
        "self_excited": n["self"],
        "not_self_excited": n["calm"],
        "forced": n["forced"],
        "recall": _share(n["recalled"], n["self"]),
        "false_alarm_share": _share(n["false"], n["calm"]),
        "early_share": _share(n["early"], n["calm"]),
        "false_alarms_per_hour": n["events"] / hours if hours else None,
        "forced_accuracy": _share(n["called_forced"], n["forced"]),
        "unscored_share": _share(n["unscored"], total),
    }


def by_event(heard: Iterable[Heard]) -> dict[str, float | None]:
    """Stretches of chatter that were alarmed at all, and stretches of alarm that have nothing to do with one."""
    chatter = found = alarms = false = 0
    for h in heard:
        label = h.cut.truth.label
        for first, last in _runs(label == Label.SELF_EXCITED):
            chatter += 1
            found += bool(h.alarm[first:last].any())
        for first, last in _runs(h.alarm):
            alarms += 1
            false += bool(np.isin(label[first:last], (Label.OTHER, Label.FORCED)).all())
    return {
        "chatter": chatter,
        "found": _share(found, chatter),
        "alarms": alarms,
        "false_alarm_share": _share(false, alarms),
    }


def sudden_onset(cut: Cut) -> tuple[float, float] | None:
    """When a cut suddenly becomes unstable, and how long after that it may take to tell (s); or None."""
    crossing_s = cut.truth.unstable[0].crossing_s if cut.truth.unstable else None
    if cut.family not in SUDDEN or crossing_s is None:
        return None
    at = int(crossing_s / INTERVAL_S)
    period_s = 1.0 / float(np.median(cut.truth.frequency_hz[at : at + 10]))
    return crossing_s, max(LAG_S, LAG_PERIODS * period_s)


def lags(alarms: Iterable[tuple[Cut, Bools]]) -> dict[str, float | None]:
    """From a sudden crossing to the end of the first interval of alarm.

    Alarms that were on already are counted as `early` and have no lag; chatter never alarmed has an infinite one.
    """
    seconds, over_limit, early = [], [], 0
    for cut, alarm in alarms:
        onset = sudden_onset(cut)
        if onset is None:
            continue
        crossing_s, limit_s = onset
        at = int(crossing_s / INTERVAL_S)
        if alarm[at - 1]:
            early += 1
            continue
        later = np.flatnonzero(alarm[at:])
        lag = INTERVAL_S * (at + int(later[0]) + 1) - crossing_s if later.size else np.inf
        seconds.append(lag)
        over_limit.append(lag / limit_s)
    median, p95 = _percentile(seconds, 50), _percentile(seconds, 95)
    return {
        "cuts": len(seconds),
        "early": early,
        "never": int(np.sum(np.isinf(seconds))),
        "median_ms": None if median is None else 1e3 * median,
        "p95_ms": None if p95 is None else 1e3 * p95,
        "median_over_limit": _percentile(over_limit, 50),
        "p95_over_limit": _percentile(over_limit, 95),
    }


def warnings(heard: Iterable[Heard]) -> dict[str, float | None]:
    """Slow ramps warned of before the vibration had doubled, and how often far from the limit for nothing."""
    ramps = warned = far = warned_far = 0
    for h in heard:
        raised, truth = h.raised, h.cut.truth
        if h.cut.family == "ramp":
            for stretch in truth.unstable[:1]:
                doubled_s = stretch.doubled_s
                if doubled_s is not None:
                    window = slice(max(0, int((doubled_s - WARNING_S) / INTERVAL_S)), int(doubled_s / INTERVAL_S))
                    ramps += 1
                    warned += bool(raised[window].any())
        calm = np.isin(truth.label, (Label.OTHER, Label.FORCED)) & (truth.kappa < 0.5 * truth.kappa_critical)
        far += int(np.sum(calm))
        warned_far += int(np.sum(calm & raised))
    return {
        "ramps": ramps,
        "warned_before_doubling": _share(warned, ramps),
        "raised_below_half_the_limit": _share(warned_far, far),
    }


def reliability(heard: Iterable[Heard]) -> list[dict[str, float | None]]:
    """Of the verdicts given with a confidence, how many were right.

    Right is: self-excited where it is; forced where the truth is forced; anything else where it is neither.
    ``unknown`` claims nothing and is left out, and so is ``forced`` in cuts with a tone from elsewhere, which is forced
    but not by the spindle: the truth does not tell how much of the power it has.
    """
    confidence, right = [], []
    for h in heard:
        label, state = h.cut.truth.label, h.said.state
        said = np.where(h.alarm, Label.SELF_EXCITED, np.where(state == "forced", Label.FORCED, Label.OTHER))
        chosen = (label != Label.UNSCORED) & (state != "unknown")
        if h.cut.family in WITH_TONE:
            chosen &= (state != "forced") | (label == Label.FORCED)
        confidence.append(h.said.confidence[chosen])
        right.append((said == label)[chosen])
    given, good = (np.concatenate(c) if c else np.zeros(0) for c in (confidence, right))
    table: list[dict[str, float | None]] = []
    for low, high in itertools.pairwise(CONFIDENCE_EDGES):
        inside = (given >= low) & (given < high)
        count = int(inside.sum())
        table.append(
            {
                "from": low,
                "to": min(high, 1.0),
                "verdicts": count,
                "mean_confidence": float(given[inside].mean()) if count else None,
                "right": float(good[inside].mean()) if count else None,
            }
        )
    return table


def _shortly_before(cut: Cut) -> Bools:
    t = cut.truth.start_s
    near = [(t > s.zero_s - EARLY_S) & (t < s.zero_s) for s in cut.truth.unstable]
    return np.any(near, axis=0) if near else np.zeros(t.size, bool)


def _runs(mask: Bools) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _beginnings(mask: Bools) -> int:
    return len(_runs(mask))


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _percentile(values: Sequence[float], percent: float) -> float | None:
    # inverted_cdf takes one of the values: interpolating towards an infinite lag would give no number
    return float(np.percentile(values, percent, method="inverted_cdf")) if len(values) else None
