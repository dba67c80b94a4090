"""Engines for the tests of the proof: functions of a module, so that other processes can run them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import soundfile

from chatter_monitor.discrepancy.report import Calibration, Fit, Located, Report, Statistic


def report(verdict="none", terms=(), located=None, gain_nats=0.0):
    """A report with no more in it than the score looks at."""
    return Report(
        verdict=verdict,
        summary="",
        located=located or Located(maps=[Statistic("time", 1.0, 0.5)]),
        terms=list(terms),
        alternatives=[],
        information=[],
        fit=Fit([(0.0, 10.0)], 0.0, 0.0, gain_nats, 0.0, 0.5, 0.5),
        calibration=Calibration({}, {}),
        elapsed_s=0.1,
    )


def says_nothing(recording: Path, model: Path, out: Path) -> None:
    """Answer `none` to everything; leaves beside its report what it was given to see."""
    seen = sorted(str(path.name) for path in recording.parent.iterdir())
    (out / "seen.txt").write_text("\n".join([*seen, *tomllib.loads(model.read_text())]))
    (out / "report.json").write_bytes(report().to_json())


def fails(recording: Path, model: Path, out: Path) -> None:  # noqa: ARG001 - an engine's arguments
    """Fail on short recordings."""
    if soundfile.info(recording).duration < 10.0:
        raise ValueError("too short for me")
    (out / "report.json").write_bytes(report("unknown").to_json())
