"""What each rule of the verdict earns: the same cuts, judged without it.

Signals are tracked once, and what was seen of them is judged again without each rule in turn: in a process of its own,
where constants are set to values with which the rule never applies before any kernel that knows them is compiled.
Only rules of the judge can be told apart so; what is heard of a signal in the first place is the same for all. Cuts
that are judged one by one say nothing of what a rule does in a shift, in milling or in a real recording.

Run: python -m benchmarks.verdict.rules [--split development|report] [--cuts N] [--first N] [--only NUMBER ...]
    [--cache DIR]
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_SAMPLES, RATE_HZ, Cut
from benchmarks.verdict.monitor import Opinions
from benchmarks.verdict.scoring import Heard, by_interval, lags
from benchmarks.verdict.train import evidence_of
from chatter_monitor.verdict.evidence import Evidence
from chatter_monitor.verdict.judge import Judge
from chatter_monitor.verdict.settings import JudgeSettings

Scores = dict[str, dict[str, Any]]  # by the speed, known or unknown, and the name of the figure

NEVER = 1e9
SPEEDS = ("known", "unknown")


class Constant(NamedTuple):
    """A constant as one module knows it, and its value without the rule."""

    module: str
    name: str
    value: float


class Rule(NamedTuple):
    """What it says, in which decision, and what is to be set for it never to apply."""

    decision: int
    says: str
    constants: tuple[Constant, ...]


def _rule(decision: int, says: str, *constants: tuple[str, str, float]) -> Rule:
    return Rule(
        decision, says, tuple(Constant(f"chatter_monitor.{module}", name, value) for module, name, value in constants)
    )


RULES = (
    _rule(12, "what noise drives is not coherent", ("kernels.vibrations", "COHERENT_DAMPING", NEVER),
          ("kernels.vibrations", "LEAST_COHERENCE", -1.0)),
    _rule(15, "no alarm begins with less than a fifth of the power", ("kernels.vibrations", "SUSPECT_SHARE", 0.0)),
    _rule(15, "overtones count to what they belong to", ("kernels.testimony", "OVERTONES", 1)),
    _rule(32, "louder than for seconds is not steady from the start", ("kernels.kinds", "UNLIKELY", 0.0)),
    _rule(46, "out of step and louder", ("kernels.vibrations", "GROWN", NEVER),
          ("kernels.vibrations", "NO_MORE", NEVER)),
    _rule(48, "how far it has risen by chance", ("kernels.kinds", "MOST_TELLING", 0.0)),
    _rule(59, "chatter that jumps", ("kernels.vibrations", "JUST_NOW", 0)),
    _rule(63, "what came with the tool", ("kernels.testimony", "MOST", NEVER)),
    _rule(68, "what has sidebands is on no order", ("kernels.testimony", "CARRIER_HZ", -1.0),
          ("kernels.testimony", "APART_HZ", 0.0)),
    _rule(73, "off the orders for more than a moment", ("kernels.vibrations", "SURELY_OFF", -NEVER)),
    _rule(77, "orders of clear lines are finer", ("kernels.heard", "CLEAR_TOLERANCE_HZ", 6.0)),
    _rule(78, "until the cut gets quieter", ("verdict.loudness", "STILL_LOUD", NEVER)),
    _rule(79, "what glides follows the spindle", ("kernels.vibrations", "GLIDING", 10**9)),
    _rule(80, "loud enough to be sure", ("verdict.loudness", "LOUD", NEVER)),
    _rule(81, "a told speed that is not heard", ("kernels.testimony", "NOT_THIS", 0.0)),
    _rule(82, "what gets louder is a warning", ("kernels.overview", "RISES", NEVER)),
    _rule(84, "multiples of what is steady", ("kernels.relatives", "MULTIPLES", 1)),
    _rule(85, "orders that were known lately", ("verdict.known_orders", "MATTERS", NEVER)),
    _rule(86, "swings of a calm cut", ("kernels.swings", "LOUDER", NEVER)),
    _rule(87, "caught on the teeth", ("verdict.loudness", "AS_TURNING", NEVER)),
    _rule(91, "a load is no growth", ("kernels.kinds", "LIFTED", NEVER)),
    _rule(93, "in no order", ("verdict.irregularity", "LOUD", NEVER)),
    _rule(97, "what comes back no more", ("verdict.irregularity", "LOUDER", NEVER)),
    _rule(98, "what came with the tool, in hindsight", ("verdict.arrival", "AS_LOUD", 1.0)),
    _rule(99, "what has climbed", ("kernels.vibrations", "CLIMBS", 0.0)),
    _rule(126, "an amplitude and no phase", ("verdict.limit_cycle", "ENOUGH", NEVER)),
    _rule(127, "new power in the same cut", ("verdict.comparison", "ENOUGH", NEVER)),
    _rule(131, "a lost comb's lines stay", ("kernels.vibrations", "STILL_THERE", -1.0)),
    _rule(131, "a load that jumps is no limit cycle", ("verdict.limit_cycle", "JUMPED", NEVER)),
    _rule(132, "like noise in an alarm", ("kernels.swings", "DISPERSED", NEVER)),
    _rule(135, "as loud as before it chattered", ("kernels.vibrations", "STILL", 0.0),
          ("kernels.vibrations", "AGAIN", 0.0)),
    _rule(135, "louder with its family", ("kernels.relatives", "FAMILY", 10**9)),
    _rule(135, "away from where it was steady", ("kernels.relatives", "LEFT", NEVER)),
    _rule(136, "what has gone again", ("verdict.irregularity", "GONE", 1.0 / NEVER)),
    _rule(136, "the speed that was heard in the same cut", ("verdict.earlier", "SAME_ROTATION", NEVER)),
    _rule(137, "in step with what has glided", ("kernels.relatives", "IN_STEP_HZ", 0.0)),
)  # fmt: skip


def keep(cuts: Iterable[Cut], count: int, directory: Path) -> None:
    """Track so many cuts, with the speed known and unknown, and keep what is seen, in a file each."""
    for number, cut in enumerate(track(cuts, total=count, description="cuts", console=Console(stderr=True))):
        seen = {speed: list(evidence_of(cut, speed_known=speed == "known")) for speed in SPEEDS}
        (directory / f"{number:05d}.pickle").write_bytes(pickle.dumps((cut.without_samples(), seen)))


def judged(evidence: list[Evidence]) -> Opinions:
    """Judge what was seen of a cut."""
    judge = Judge(JudgeSettings())
    return Opinions.of(
        [judge.verdict(seen, i * INTERVAL_SAMPLES, INTERVAL_SAMPLES, RATE_HZ) for i, seen in enumerate(evidence)]
    )


def score(directory: Path) -> Scores:
    """Judge all that was kept and count, for each speed."""
    heard: dict[str, list[Heard]] = {speed: [] for speed in SPEEDS}
    for file in sorted(directory.glob("*.pickle")):
        cut, seen = pickle.loads(file.read_bytes())  # noqa: S301  written by `keep`
        for speed, evidence in seen.items():
            heard[speed].append(Heard(cut, judged(evidence)))
    return {
        speed: {**by_interval(told), "median_ms": lags((h.cut, h.alarm) for h in told)["median_ms"]}
        for speed, told in heard.items()
    }


def leave_out(rule: Rule) -> None:
    """Set its constants for the rest of this process, which must not have judged anything yet."""
    for module, name, value in rule.constants:
        loaded = importlib.import_module(module)
        if not hasattr(loaded, name):
            raise AttributeError(f"{module} has no {name}: the rule '{rule.says}' has changed")
        setattr(loaded, name, value)


def _scored_apart(number: int | None, directory: Path) -> Scores:
    """Scores without a rule, from a process and a cache of kernels of its own; of all rules where it is None."""
    command = [sys.executable, "-m", "benchmarks.verdict.rules", "--judge", str(directory)]
    command += [] if number is None else ["--only", str(number)]
    with TemporaryDirectory() as kernels:
        done = subprocess.run(
            command, env={**os.environ, "NUMBA_CACHE_DIR": kernels}, check=True, stdout=subprocess.PIPE, text=True
        )
    found: Scores = json.loads(done.stdout)
    return found


def _show(console: Console, all_rules: Scores, without: dict[int, Scores]) -> None:
    for speed in SPEEDS:
        table = Table(title=f"Without each rule, speed {speed}")
        for heading in ("decision", "rule", "recalled", "false", "as forced", "median lag"):
            table.add_column(heading, justify="left" if heading == "rule" else "right")
        usual = all_rules[speed]
        table.add_row("", "all rules", *(f"{value:.{digits}f}{unit}" for value, digits, unit in _figures(usual)))
        for number, scores in without.items():
            rule = RULES[number]
            changes = [
                "" if math.isclose(now, then, abs_tol=0.5 * 10**-digits) else f"{now - then:+.{digits}f}{unit}"
                for (now, digits, unit), (then, _, _) in zip(_figures(scores[speed]), _figures(usual), strict=True)
            ]
            table.add_row(str(rule.decision), rule.says, *changes)
        console.print(table)


def _figures(scores: dict[str, Any]) -> tuple[tuple[float, int, str], ...]:
    """Recall, false intervals, forced called forced, lag; each with the digits that it is shown with and its unit."""
    false = scores["false_alarm_share"] * scores["not_self_excited"]
    return (
        (100.0 * scores["recall"], 2, " %"),
        (round(false), 0, ""),
        (100.0 * scores["forced_accuracy"], 2, " %"),
        (scores["median_ms"], 0, " ms"),
    )


def main() -> None:
    """Track the cuts once, judge them without each rule, print what that changes."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.rules", description=__doc__)
    parser.add_argument("--split", choices=("development", "report"), default="development")
    parser.add_argument("--cuts", type=int, default=525, help="how many, families in turn (default %(default)s)")
    parser.add_argument("--first", type=int, default=525, help="number of the first (default %(default)s)")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the rules, from 0, instead of all")
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")
    parser.add_argument("--judge", type=Path, help=argparse.SUPPRESS)  # in the process of a rule
    chosen = parser.parse_args()
    if chosen.judge is not None:
        for number in chosen.only or ():
            leave_out(RULES[number])
        print(json.dumps(score(chosen.judge)))
        return
    with TemporaryDirectory() as kept:
        keep(cached_cuts(chosen.split, chosen.cuts, chosen.cache, chosen.first), chosen.cuts, Path(kept))
        all_rules = _scored_apart(None, Path(kept))
        numbers = range(len(RULES)) if chosen.only is None else chosen.only
        without = {
            number: _scored_apart(number, Path(kept))
            for number in track(numbers, description="rules", console=Console(stderr=True))
        }
    _show(Console(), all_rules, without)


if __name__ == "__main__":
    main()
