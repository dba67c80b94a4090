"""Weights of `kernels.kinds`, from cuts of the development split: ``python -m benchmarks.verdict.train``.

Every line of every interval is an example of one of three classes: growth (the vibration of an unstable cut while it
rises out of its surroundings), calm (something coherent and steady, forced or saturated), noise (everything else). A
multinomial logistic regression tells them apart; the classes weigh the same. Of noise nearly all is faint and easily
told from growth, but for the vibration of a cut near its limit, which noise drives far at times: so that has a share of
that class's weight that does not depend on how rare it is. Signs that physics knows are imposed. Half of the cuts are
heard with the spindle's speed known, half without.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track
from scipy.optimize import minimize

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import Cut, Label
from chatter_monitor.kernels.kinds import measures
from chatter_monitor.kernels.vibrations import Odds, Rules
from chatter_monitor.tracking.channel import Channel
from chatter_monitor.tracking.orders import OrderSettings
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import TrackerSettings
from chatter_monitor.verdict import weights
from chatter_monitor.verdict.evidence import Evidence, weigh
from chatter_monitor.verdict.settings import JudgeSettings
from chatter_monitor.verdict.vibrations import Following, lines_of

NOISE, GROWTH, CALM, NEAR = range(4)  # what is near the limit is noise, with a weight of its own
CLASSES = 3
MEASURES = (
    *("prominence", "share", "coherence", "tightness", "variation", "rise", "long_rise", "own_rise"),
    *("decay", "growth", "log_damping"),
)
# Growth makes these larger, or smaller.
GROWS_WITH = dict.fromkeys(MEASURES, 1) | {"share": 0, "variation": 0, "log_damping": -1}

GROWING_RISE = 0.5
GROWING_S = 3.0  # after the damping has become negative
SAME_VIBRATION = 0.06  # as the truth's, relatively
CALM_COHERENCE = 0.85
CALM_VARIATION = 0.3
CALM_RISE = 0.35
CALM_PROMINENCE_DB = 12.0
NEAR_LIMIT = 0.85  # of the regeneration at the limit
NEAR_WEIGHT = 0.03  # of that of noise, in all
RIDGE = 1e-3


def evidence_of(cut: Cut, *, speed_known: bool) -> Iterator[Evidence]:
    """What the monitor sees in each interval of a cut."""
    spindle = SpindleSettings(cut.nominal_rpm, cut.teeth) if speed_known else SpindleSettings()
    channel = Channel(TrackerSettings(), OrderSettings(), spindle)
    for observation in channel.process(0, cut.samples):
        yield weigh(observation, spindle)


Example = tuple[tuple[float, ...], int]
Heard = tuple[Cut, list[Evidence], bool]  # without samples; with the speed known, or not


def examples(cut: Cut, intervals: list[Evidence]) -> Iterator[Example]:
    """Measures and class of the lines that have one."""
    return ((measures(line), kind) for lines in classified(cut, intervals) for line, kind in lines if kind is not None)


def classified(cut: Cut, intervals: list[Evidence]) -> Iterator[list[tuple[np.void, int | None]]]:
    """Lines of each interval, records of `kinds.LINE`, with their class; None where they are no example of any."""
    truth = cut.truth
    since = truth.unstable_for_s
    for i, evidence in enumerate(intervals[: len(truth)]):
        found: list[tuple[np.void, int | None]] = []
        for line in () if evidence.starting else lines_of(evidence, Odds()):
            own = abs(np.log(line["frequency_hz"] / truth.frequency_hz[i])) < SAME_VIBRATION
            calm = (
                line["coherence"] > CALM_COHERENCE
                and line["variation"] < CALM_VARIATION
                and abs(line["rise"]) < CALM_RISE
                and line["prominence_db"] > CALM_PROMINENCE_DB
            )
            rise = max(line["rise"], line["long_rise"], line["absolute_rise"])
            kind = None
            if truth.damping_ratio[i] < 0.0 and own and rise > GROWING_RISE:
                kind = GROWTH if since[i] < GROWING_S else None
            elif truth.label[i] == Label.SELF_EXCITED:
                kind = CALM if own and calm else None
            elif truth.label[i] in (Label.OTHER, Label.FORCED):
                near = own and rise > GROWING_RISE and truth.kappa[i] > NEAR_LIMIT * truth.kappa_critical[i]
                kind = CALM if calm else NEAR if near else NOISE
            found.append((line, kind))
        yield found


def fit(x: NDArray[np.float64], kind: NDArray[np.int64]) -> NDArray[np.float64]:
    """Weights and offsets of growth and calm against noise, shape (2, measures + 1), of `MEASURES` and any others."""
    centre, scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    columns = np.column_stack([(x - centre) / scale, np.ones(len(x))])
    weights_of_kinds = np.array([1.0 - NEAR_WEIGHT, 1.0, 1.0, NEAR_WEIGHT]) / CLASSES
    share = (weights_of_kinds / np.maximum(np.bincount(kind, minlength=NEAR + 1), 1))[kind]
    kind = np.where(kind == NEAR, NOISE, kind)

    def loss(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        table = flat.reshape(2, -1)
        logits = np.column_stack([np.zeros(len(x)), columns @ table.T])
        norm = np.logaddexp.reduce(logits, axis=1)
        value = share @ (norm - logits[np.arange(len(x)), kind]) + RIDGE * np.sum(table[:, :-1] ** 2)
        surplus = np.exp(logits - norm[:, np.newaxis])
        surplus[np.arange(len(x)), kind] -= 1.0
        slope = (share[:, np.newaxis] * surplus[:, 1:]).T @ columns
        slope[:, :-1] += 2.0 * RIDGE * table[:, :-1]
        return float(value), slope.ravel()

    free = (None, None)
    signs = {1: (0.0, None), -1: (None, 0.0)}
    start = np.zeros(2 * columns.shape[1])
    bounds = [signs.get(GROWS_WITH.get(name, 0), free) for name in MEASURES] + [free] * (len(start) - len(MEASURES))
    table = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x.reshape(2, -1)
    table[:, :-1] /= scale
    table[:, -1] -= table[:, :-1] @ centre
    return table


def alarms(intervals: list[Evidence], rules: Rules) -> NDArray[np.bool_]:
    """Intervals that are called self-excited, but for idling, which only ever ends an alarm."""
    following = Following()
    found = np.zeros(len(intervals), bool)
    for i, evidence in enumerate(intervals):
        if evidence.held:
            following.rest()
        elif not evidence.starting:
            found[i] = following.follow(evidence, rules).alarm is not None
    return found


def variations() -> Iterator[tuple[str, Rules]]:
    """The rules as they are, and with one constant changed."""
    settings = JudgeSettings()
    rules = Rules(settings.alarm_probability, settings.calm_probability)
    yield "as it is", rules
    for name in ("evidence", "begins_to_grow", "grows_when_steady", "begins_steady", "saturates", "ends"):
        for factor in (0.5, 1.5) if name == "evidence" else (0.1, 10.0) if name != "saturates" else (0.3, 3.0):
            value = factor * getattr(rules.chain, name)
            yield f"{name} {value:.2g}", rules._replace(chain=rules.chain._replace(**{name: value}))
    for name, old in rules.odds._asdict().items():
        for step in (-1.0, 1.0):
            value = old + step
            yield f"{name} {value:.2g}", rules._replace(odds=rules.odds._replace(**{name: value}))


def search(heard: list[Heard]) -> None:
    """Print what other constants would do."""
    for name, rules in track(list(variations()), description="constants"):
        counts = np.zeros(4)
        for cut, intervals, _ in heard:
            label = cut.truth.label
            found = alarms(intervals, rules)[: len(label)]
            chatter, other = label == Label.SELF_EXCITED, np.isin(label, (Label.OTHER, Label.FORCED))
            counts += [np.sum(found & chatter), np.sum(chatter), np.sum(found & other), np.sum(other)]
        recall, false = counts[0] / counts[1], counts[2] / counts[3]
        print(f"{name:24s} recall {recall:.3f}, false alarms {100 * false:.3f} %")


def main() -> None:
    """Fit the weights, print them, and write them where the monitor reads them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cuts", type=int, default=1050)
    parser.add_argument("--cache", type=Path, help="directory that keeps the cuts")
    parser.add_argument("--write", action="store_true", help="into chatter_monitor/verdict/weights.py")
    arguments = parser.parse_args()
    heard: list[Heard] = []
    cuts = cached_cuts("development", arguments.cuts, arguments.cache)
    for number, cut in enumerate(track(cuts, total=arguments.cuts, description="cuts of the development split")):
        known = number // 15 % 2 == 0
        seen = list(evidence_of(cut, speed_known=known))
        heard.append((cut.without_samples(), seen, known))
    x, kind = map(np.array, zip(*(e for cut, intervals, _ in heard for e in examples(cut, intervals)), strict=True))
    print("examples of noise, growth, calm, near the limit:", np.bincount(kind, minlength=NEAR + 1).tolist())
    table = fit(x, kind)
    text = [
        f"{name} = Weights({tuple(round(float(value), 3) for value in row[:-1])}, {float(row[-1]):.3f})"
        for name, row in zip(("GROWTH", "CALM"), table, strict=True)
    ]
    print(MEASURES)
    print("\n".join(text))

    for known in (True, False):
        print(f"speed {'known' if known else 'unknown'}, with the weights as they are")
        search([each for each in heard if each[2] is known])
    if arguments.write:
        path = Path(weights.__file__)
        head = path.read_text().split("\nGROWTH = ", maxsplit=1)[0]
        path.write_text(head + "\n" + "\n".join(text) + "\n")


if __name__ == "__main__":
    main()
