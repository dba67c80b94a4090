"""The monitor beside its peers: recall against false alarms over all thresholds, and lag at equal false alarms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cut import Label
from benchmarks.verdict.peers import PEERS
from benchmarks.verdict.scoring import Heard, lags

Floats = NDArray[np.float64]

# False alarms in so many of the intervals that are not self-excited: what the issue allows, and ten times that.
ALLOWED = (0.001, 0.01)


@dataclass(frozen=True, eq=False)
class Detector:
    """A name, and a score for every interval of every cut."""

    name: str
    scores: list[Floats]


def detectors(heard: list[Heard], *, speed_known: bool) -> list[Detector]:
    """Return the monitor and its peers; without the speed only peers that need none."""
    needing_speed = ("once-per-revolution variance", "spectral line off the orders")
    found = [Detector("this monitor", [h.said.score for h in heard])]
    for name, peer in PEERS.items():
        if speed_known or name not in needing_speed:
            found.append(Detector(name, [peer(h.cut) for h in heard]))
    return found


def curve(detector: Detector, heard: list[Heard]) -> tuple[Floats, Floats, Floats]:
    """Thresholds, share of false alarms and recall, from the strictest threshold on; shape (thresholds,) each."""
    label = np.concatenate([h.cut.truth.label for h in heard])
    score = np.concatenate(detector.scores)
    chosen = label != Label.UNSCORED
    score, positive = score[chosen], label[chosen] == Label.SELF_EXCITED
    order = np.argsort(-score, kind="stable")
    last_of_its_value = np.append(np.flatnonzero(np.diff(score[order])), score.size - 1)
    true = np.cumsum(positive[order])[last_of_its_value]
    false = np.cumsum(~positive[order])[last_of_its_value]
    shares = (n / max(1, int(n[-1])) for n in (false, true))
    return (score[order][last_of_its_value], *shares)


def threshold(detector: Detector, heard: list[Heard], allowed: float) -> float:
    """Return the lowest threshold with at most so large a share of false alarms; infinite where there is none."""
    thresholds, false, _ = curve(detector, heard)
    usable = np.flatnonzero(false <= allowed)
    return float(thresholds[usable[-1]]) if usable.size else np.inf


def threshold_of_all_families(detector: Detector, heard: list[Heard], allowed: float) -> float:
    """Return the same, but that no family has a larger share."""
    return max(threshold(*of_family, allowed) for of_family in by_family(detector, heard).values())


def by_family(detector: Detector, heard: list[Heard]) -> dict[str, tuple[Detector, list[Heard]]]:
    """Return the cuts of each family, and the detector's scores of these."""
    families: dict[str, tuple[Detector, list[Heard]]] = {}
    for h, score in zip(heard, detector.scores, strict=True):
        scores, cuts = families.setdefault(h.cut.family, (Detector(detector.name, []), []))
        scores.scores.append(score)
        cuts.append(h)
    return families


def recall(detector: Detector, heard: list[Heard], least: float) -> float:
    """Share of the self-excited intervals whose score is so much or more; 0 where there are none."""
    found = [score[h.cut.truth.label == Label.SELF_EXCITED] for h, score in zip(heard, detector.scores, strict=True)]
    scores = np.concatenate(found)
    return float(np.sum(scores >= least)) / max(1, scores.size)


def lags_at(detector: Detector, heard: list[Heard], least: float) -> dict[str, float | None]:
    """Lags of alarms from so high a score on, as in `scoring.lags`."""
    return lags((h.cut, score >= least) for h, score in zip(heard, detector.scores, strict=True))


def at_equal_false_alarms(detector: Detector, heard: list[Heard]) -> list[dict[str, Any]]:
    """Recall and lag with the threshold that makes best use of the false alarms that are allowed."""
    rows = []
    for allowed in ALLOWED:
        at = threshold(detector, heard, allowed)
        found = {"recall": recall(detector, heard, at), "lags": lags_at(detector, heard, at)}
        rows.append({"false_alarms_allowed": allowed} | found)
    return rows
