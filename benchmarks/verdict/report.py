"""Tables of the scores."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from benchmarks.verdict.curves import Detector, at_equal_false_alarms
from benchmarks.verdict.families import FAMILIES
from benchmarks.verdict.scoring import (
    SNR_BANDS_DB,
    Heard,
    by_event,
    by_interval,
    lags,
    reliability,
    warnings,
)


def as_results(heard: list[Heard], found: list[Detector]) -> dict[str, Any]:
    """All scores of one way to run the monitor and of its peers."""
    groups = {"all": heard}
    groups |= {family: [h for h in heard if h.cut.family == family] for family in FAMILIES}
    groups |= {
        f"SNR {low:.0f}-{high:.0f} dB": [h for h in heard if low <= h.cut.snr_db < high] for low, high in SNR_BANDS_DB
    }
    return {
        "groups": {name: _scores(part) for name, part in groups.items() if part},
        "reliability": reliability(heard),
        "peers": {detector.name: at_equal_false_alarms(detector, heard) for detector in found},
    }


def _scores(heard: list[Heard]) -> dict[str, Any]:
    """Of one family, or of one range of noise."""
    return {
        **by_interval(heard),
        "event": by_event(heard),
        "lags": lags((h.cut, h.alarm) for h in heard),
        "lags_of_warnings": lags((h.cut, h.raised) for h in heard),
        "warnings": warnings(heard),
    }


def show(console: Console, name: str, results: dict[str, Any]) -> None:
    """Print the scores of one way to run the monitor."""
    table = Table(title=f"Intervals and events, {name}")
    for heading in ("", "self", "recall", "others", "false", "of these early", "/h", "forced", "as forced", "unscored"):
        table.add_column(heading, justify="right" if heading else "left")
    table.add_column("events found", justify="right")
    table.add_column("false events", justify="right")
    for group, score in results["groups"].items():
        table.add_row(
            group,
            str(score["self_excited"]),
            _percent(score["recall"], 1),
            str(score["not_self_excited"]),
            _percent(score["false_alarm_share"], 2),
            _percent(score["early_share"], 2),
            "" if score["false_alarms_per_hour"] is None else f"{score['false_alarms_per_hour']:.0f}",
            str(score["forced"]),
            _percent(score["forced_accuracy"], 1),
            _percent(score["unscored_share"], 1),
            _percent(score["event"]["found"], 0),
            _percent(score["event"]["false_alarm_share"], 0),
        )
    console.print(table)
    console.print(_onsets(name, results["groups"]))
    console.print(_warnings(name, results["groups"]))
    table = Table(title=f"Reliability of the confidence, {name}")
    for heading in ("confidence", "verdicts", "mean", "right"):
        table.add_column(heading, justify="right")
    for row in results["reliability"]:
        if row["verdicts"]:
            span = f"{row['from']:.2f}-{row['to']:.2f}"
            table.add_row(span, str(row["verdicts"]), f"{row['mean_confidence']:.3f}", f"{row['right']:.3f}")
    console.print(table)
    table = Table(title=f"At equal false alarms, {name}")
    for heading in ("detector", "false alarms allowed", "recall", "never", "median lag", "over the limit", "95 %"):
        table.add_column(heading, justify="right" if heading != "detector" else "left")
    for detector, rows in results["peers"].items():
        for row in rows:
            lag = row["lags"]
            table.add_row(
                detector,
                _percent(row["false_alarms_allowed"], 1),
                _percent(row["recall"], 1),
                f"{lag['never']}/{lag['cuts']}",
                f"{_number(lag['median_ms'])} ms",
                _number(lag["median_over_limit"]),
                _number(lag["p95_over_limit"]),
            )
    console.print(table)


def _onsets(name: str, groups: dict[str, Any]) -> Table:
    """How soon sudden onsets are told; where there are any."""
    table = Table(title=f"Alarms at sudden onsets, {name}")
    for heading in ("", "onsets", "early", "never", "median lag, ms", "95 %", "over the limit", "95 %"):
        table.add_column(heading, justify="right" if heading else "left")
    for group, score in groups.items():
        told = score["lags"]
        if told["cuts"]:
            table.add_row(
                group,
                *(str(told[key]) for key in ("cuts", "early", "never")),
                *(_number(told[key]) for key in ("median_ms", "p95_ms", "median_over_limit", "p95_over_limit")),
            )
    return table


def _warnings(name: str, groups: dict[str, Any]) -> Table:
    """How soon sudden onsets and slow ramps are warned of at least, and how often for nothing."""
    table = Table(title=f"Warnings or alarms, {name}")
    onsets = ("onsets", "early", "never", "median lag, ms", "over the limit")
    for heading in ("", *onsets, "ramps", "in time", "below half the limit"):
        table.add_column(heading, justify="right" if heading else "left")
    for group, score in groups.items():
        told, warned = score["lags_of_warnings"], score["warnings"]
        table.add_row(
            group,
            *(str(told[key]) for key in ("cuts", "early", "never")),
            *(_number(told[key]) for key in ("median_ms", "median_over_limit")),
            str(warned["ramps"]),
            _percent(warned["warned_before_doubling"], 0),
            _percent(warned["raised_below_half_the_limit"], 1),
        )
    return table


def _percent(value: float | None, digits: int) -> str:
    return "" if value is None else f"{100.0 * value:.{digits}f} %"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
