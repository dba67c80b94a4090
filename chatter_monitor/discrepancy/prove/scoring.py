"""What the answers are worth: each case judged, then counted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal

import msgspec
import numpy as np
from scipy import stats

from chatter_monitor.discrepancy.report import Report

Outcome = Literal["right", "missed", "abstained", "wrong", "failed"]
OVERLAP = 0.8  # of the stretch located with the true one, for "located"
TELLING_NATS = 10.0  # held-out gain from which an effect has to be named
BINS = (0.0, 0.02, 0.05, 1.0)  # of strength

Interval = tuple[float, float]


class Judged(msgspec.Struct, frozen=True):
    """One case with its truth and its answer.

    Attributes
    ----------
    case, kind, family : str
        Directory, and what was hidden.
    truth, answer : str
        Name of the effect, or the verdict where there is none to name. Several names are joined by " + ".
    outcome : str
        "right"; "missed": called `none` or `parameters` though something was hidden; "abstained": `unknown` though the
        catalogue has it; "wrong": anything else said; "failed": no answer.
    leads : bool
        The right name stands first, whatever stands beside it.
    sense_right : bool, optional
        Where a sense was due and the name is right.
    strength : float, optional
        Of a hidden force.
    concealed : bool
        Neither spectrum nor distribution gave it away.
    distance, band95, normality_p : float
        Log-spectral distance from the best linear simulation, the 95 % quantile of linear recordings, and the p-value
        of the test for normality.
    inside : dict of str to bool
        For each true parameter of a term rightly named, whether the 95 % interval holds it.
    ratios : dict of str to float
        Estimate over truth of the same.
    overlap : float, optional
        Intersection over union of the stretch located and the true one; of the times at which a Gaussian motion swings
        beyond the amplitude located and the true one.
    gain_nats : float, optional
        Held-out gain.
    bound_nats : float, optional
        Most that the true model can gain on the held-out half (`information_nats`).
    beyond_nats : float, optional
        Most that the whole recording can tell of it from the nearest other law of the catalogue.
    true_gain_nats : float, optional
        What the true model gains there on the same recording, band and blocks.
    p_values : dict of str to float
        Of the maps of the base model.
    residual_white_p : float, optional
        Of the augmented model.
    elapsed_s : float, optional
        Of the diagnosis.
    """

    case: str
    kind: str
    family: str
    truth: str
    answer: str
    outcome: Outcome
    leads: bool
    sense_right: bool | None
    strength: float | None
    seconds: float
    quantity: str
    concealed: bool
    distance: float
    band95: float
    normality_p: float
    inside: dict[str, bool] = {}
    ratios: dict[str, float] = {}
    overlap: float | None = None
    gain_nats: float | None = None
    bound_nats: float | None = None
    beyond_nats: float | None = None
    true_gain_nats: float | None = None
    p_values: dict[str, float] = {}
    residual_white_p: float | None = None
    elapsed_s: float | None = None


class Rate(msgspec.Struct, frozen=True):
    """A share with its 95 % interval (Wilson)."""

    hits: int
    of: int
    share: float | None
    ci95: Interval | None


class Score(msgspec.Struct, frozen=True):
    """All that is counted.

    Attributes
    ----------
    rates : dict of str to Rate
        By what they are shares of.
    confusion : dict of str to dict of str to int
        Answers by truth.
    by_kind : dict of str to dict of str to dict of str to int
        Outcomes by what was hidden and bin of strength.
    p_uniform : dict of str to float
        p-value of the Kolmogorov-Smirnov test that a map's p-values are uniform over the linear cases.
    elapsed_s : dict of str to float
        Median and largest time of a diagnosis.
    gain_share : dict of str to float
        Median and quartiles of the gain over its bound, of effects named right.
    true_gain_share : dict of str to float
        The same over the gain of the true model, of those where that gains `TELLING_NATS`.
    """

    rates: dict[str, Rate]
    confusion: dict[str, dict[str, int]]
    by_kind: dict[str, dict[str, dict[str, int]]]
    p_uniform: dict[str, float]
    elapsed_s: dict[str, float]
    gain_share: dict[str, float]
    true_gain_share: dict[str, float] = {}


def information_nats(truth: Mapping[str, Any], seconds: float) -> float | None:
    """Expected log-likelihood ratio of the true model over the best linear one, if the motion itself were known.

    By Girsanov's theorem it is half the integral of r^2 / q, with r what no spring and damper can imitate of the hidden
    force and q the intensity of the white force. With strength s, rms displacement d (the linear motion has 1) and
    q = 4 zeta w^3 it is s^2 d^2 w T / (8 zeta). A sensor with noise and a limited band sees less of it.

    Parameters
    ----------
    truth : mapping
        Of a case.
    seconds : float
        Length of the stretch.

    Returns
    -------
    float or None
        None where nothing was hidden that is a force all along.
    """
    if truth["strength"] is None or truth["family"] == "part":
        return None
    w = 2.0 * math.pi * truth["frequency_hz"]
    amplitude = truth["strength"] * truth["rms_displacement"]
    return float(amplitude**2 * w * seconds / (8.0 * truth["damping_ratio"]))


def _beyond_nats(truth: Mapping[str, Any]) -> float | None:
    """`information_nats` of the share that no other law of the catalogue could stand for."""
    everything, share = information_nats(truth, truth["seconds"]), truth.get("beyond_nearest")
    return None if everything is None or share is None else everything * share


def judge(case: str, truth: Mapping[str, Any], report: Report | None, true_gain_nats: float | None = None) -> Judged:
    """Judge one answer; `report` is None where the diagnosis failed, the true model's gain where there is none."""
    expected = " + ".join(truth["names"]) or truth["verdict"]
    fixed = {
        "case": case,
        "kind": truth["kind"],
        "family": truth["family"],
        "truth": expected,
        "strength": truth["strength"],
        "seconds": truth["seconds"],
        "quantity": truth["quantity"],
        "concealed": truth["concealed"],
        **{name: truth["concealment"][name] for name in ("distance", "band95", "normality_p")},
        "bound_nats": information_nats(truth, 0.5 * truth["seconds"]),
        "beyond_nats": _beyond_nats(truth),
        "true_gain_nats": true_gain_nats,
    }
    if report is None:
        return Judged(answer="failed", outcome="failed", leads=False, sense_right=None, **fixed)
    names = [term.name for term in report.terms] if report.verdict == "missing_physics" else []
    answer = " + ".join(names) or report.verdict
    leads = bool(names) and names[0] in truth["names"]
    outcome: Outcome = "wrong"
    if answer == expected:
        outcome = "right"
    elif report.verdict == "unknown" and truth["verdict"] == "missing_physics":
        outcome = "abstained"
    elif report.verdict in ("none", "parameters") and truth["verdict"] in ("missing_physics", "unknown"):
        outcome = "missed"
    sense, inside, ratios = None, {}, {}
    if leads:
        found = report.terms[0]
        for name, value in truth["parameters"].items():
            if name in found.parameters:
                if truth["sense"] and name == "coefficient":  # two senses are two signs, whatever they are called
                    sense = found.parameters[name].value * value > 0.0
                low, high = found.parameters[name].ci95
                inside[name] = low <= value <= high
                ratios[name] = found.parameters[name].value / value
    return Judged(
        answer=answer,
        outcome=outcome,
        leads=leads,
        sense_right=sense,
        inside=inside,
        ratios=ratios,
        overlap=_located(report, truth),
        gain_nats=report.fit.gain_nats,
        p_values={m.name: m.p_value for m in report.located.maps},
        residual_white_p=report.fit.residual_white_p_after,
        elapsed_s=report.elapsed_s,
        **fixed,
    )


def _located(report: Report, truth: Mapping[str, Any]) -> float | None:
    """Overlap of what is located with where it acts; None where it acts all along."""
    if truth["time_s"]:
        return overlap(report.located.time_s, truth["time_s"])
    if not truth.get("amplitude_above"):
        return None
    found = report.located.amplitude
    both = sorted((found[0] if found else 0.0, truth["amplitude_above"]))
    low, high = (each / truth["rms_displacement"] for each in both)
    return math.exp(0.5 * (low**2 - high**2))


def overlap(found: Sequence[Sequence[float]], true: Sequence[Sequence[float]]) -> float:
    """Intersection over union of two sets of disjoint stretches."""

    def length(stretches: Sequence[Sequence[float]]) -> float:
        return sum(end - begin for begin, end in stretches)

    shared = sum(max(0.0, min(a[1], b[1]) - max(a[0], b[0])) for a in found for b in true)
    union = length(found) + length(true) - shared
    return shared / union if union > 0.0 else 0.0


def count(judged: Sequence[Judged]) -> Score:
    """Count the answers."""
    hidden = [j for j in judged if j.family in ("catalogue", "part")]
    linear = [j for j in judged if j.family == "linear"]
    outside = [j for j in judged if j.family == "outside"]
    faults = [j for j in judged if j.family == "fault"]
    telling = [j for j in hidden if (j.bound_nats or 0.0) >= TELLING_NATS]
    tellable = [j for j in hidden if (j.true_gain_nats or 0.0) >= TELLING_NATS]
    found = ("wrong",)
    rates = {
        "effects named": _rate(j.outcome == "right" for j in hidden),
        "effects named, right one first": _rate(j.leads for j in hidden),
        "effects named, concealed cases": _rate(j.outcome == "right" for j in hidden if j.concealed),
        "effects named, visible cases": _rate(j.outcome == "right" for j in hidden if not j.concealed),
        "effects named where 10 nats or more could be gained": _rate(j.outcome == "right" for j in telling),
        "effects named where the true model gains 10 nats": _rate(j.outcome == "right" for j in tellable),
        "of those, named where the nearest other law is 10 nats away": _rate(
            j.outcome == "right" for j in tellable if _apart(j)
        ),
        "effects named wrongly": _rate(j.outcome == "wrong" for j in hidden),
        "effects answered unknown": _rate(j.outcome == "abstained" for j in hidden),
        "effects missed": _rate(j.outcome == "missed" for j in hidden),
        "sense right where the name is": _rate(j.sense_right for j in hidden if j.sense_right is not None),
        "none and parameters with a finding": _rate(j.outcome in found and j.answer not in _LINEAR for j in linear),
        "none and parameters answered right": _rate(j.outcome == "right" for j in linear),
        "outside the catalogue answered unknown": _rate(j.outcome == "right" for j in outside),
        "of those, unknown where the nearest law is 10 nats away": _rate(
            j.outcome == "right" for j in outside if _apart(j)
        ),
        "outside the catalogue named wrongly": _rate(j.outcome == "wrong" for j in outside),
        "faults named": _rate(j.outcome == "right" for j in faults),
        "faults named as another thing": _rate(j.outcome == "wrong" for j in faults),
        "parameters inside their 95 % intervals": _rate(hit for j in hidden for hit in j.inside.values()),
        "effects in part located": _rate(j.overlap >= OVERLAP for j in judged if j.overlap is not None),
        "cases concealed": _rate(j.concealed for j in judged),
        "linear cases that look concealed": _rate(j.concealed for j in linear),
        "diagnoses that failed": _rate(j.outcome == "failed" for j in judged),
    }
    times = [j.elapsed_s for j in judged if j.elapsed_s is not None]
    shares = [j.gain_nats / j.bound_nats for j in telling if j.outcome == "right" and j.gain_nats and j.bound_nats]
    return Score(
        rates=rates,
        confusion=_confusion(judged),
        by_kind=_by_kind(judged),
        p_uniform={
            name: float(stats.kstest([j.p_values[name] for j in linear if name in j.p_values], "uniform").pvalue)
            for name in sorted({name for j in linear for name in j.p_values})
        },
        elapsed_s={"median": float(np.median(times)), "largest": max(times)} if times else {},
        gain_share=_quartiles(shares),
        true_gain_share=_quartiles(
            [
                j.gain_nats / j.true_gain_nats
                for j in tellable
                if j.outcome == "right" and j.gain_nats and j.true_gain_nats
            ]
        ),
    )


_LINEAR = ("none", "parameters")


def _apart(judged: Judged) -> bool:
    """Whether the recording tells it from the nearest other law, if an engine misses nothing."""
    return (judged.beyond_nats or 0.0) >= TELLING_NATS


def _rate(hits: Iterable[bool | None]) -> Rate:
    listed = [bool(hit) for hit in hits]
    if not listed:
        return Rate(0, 0, None, None)
    interval = stats.binomtest(sum(listed), len(listed)).proportion_ci(method="wilson")
    return Rate(sum(listed), len(listed), sum(listed) / len(listed), (float(interval.low), float(interval.high)))


def _quartiles(shares: Sequence[float]) -> dict[str, float]:
    if not shares:
        return {}
    return dict(zip(("q25", "median", "q75"), np.quantile(shares, (0.25, 0.5, 0.75)).tolist(), strict=True))


def _confusion(judged: Sequence[Judged]) -> dict[str, dict[str, int]]:
    table: dict[str, dict[str, int]] = {}
    for truth in sorted({j.truth for j in judged}):
        table[truth] = dict(Counter(j.answer for j in judged if j.truth == truth).most_common())
    return table


def strength_bin(strength: float | None) -> str:
    """The bin as text."""
    if strength is None:
        return "-"
    for low, high in pairwise(BINS):
        if strength < high:
            return f"{100 * low:g}-{100 * high:g} %" if high < 1.0 else f"over {100 * low:g} %"
    return "-"


def _by_kind(judged: Sequence[Judged]) -> dict[str, dict[str, dict[str, int]]]:
    table: dict[str, dict[str, dict[str, int]]] = {}
    for j in judged:
        row = table.setdefault(j.kind, {}).setdefault(strength_bin(j.strength), {})
        row[j.outcome] = row.get(j.outcome, 0) + 1
    return table
