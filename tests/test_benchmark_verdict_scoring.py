"""The benchmark's scores on verdicts that are made up, so that the right score is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from benchmarks.verdict.curves import (
    Detector,
    at_equal_false_alarms,
    curve,
    recall,
    threshold,
    threshold_of_all_families,
)
from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ, Cut, Label, Stretch, Truth
from benchmarks.verdict.monitor import Opinions
from benchmarks.verdict.peers import PEERS
from benchmarks.verdict.report import as_results, show
from benchmarks.verdict.scoring import Heard, by_event, by_interval, lags, reliability, warnings
from chatter_monitor.records import Verdict

ONSET = 60  # interval of the crossing
LABELS = np.repeat(
    np.array([Label.UNSCORED, Label.FORCED, Label.OTHER, Label.UNSCORED, Label.SELF_EXCITED], np.int8),
    (6, 30, 24, 3, 57),
)
ONES = np.ones(LABELS.size)
TRUTH = Truth(
    label=LABELS,
    damping_ratio=np.where(np.arange(LABELS.size) < ONSET, 0.01, -0.01),
    frequency_hz=1000.0 * ONES,
    kappa=0.4 * ONES,
    kappa_critical=ONES,
    synchronous_share=0.0 * ONES,
    limited=0.0 * ONES,
    vibration_rms=ONES,
    unstable=(Stretch(zero_s=ONSET * INTERVAL_S - 0.02, crossing_s=ONSET * INTERVAL_S + 0.01, doubled_s=3.4),),
)


def made_up(family="step", samples=None):
    return Cut(
        name=family,
        family=family,
        samples=np.zeros(LABELS.size * INTERVAL_SAMPLES) if samples is None else samples,
        rate_hz=RATE_HZ,
        nominal_rpm=1200.0,
        teeth=3,
        speed_times_s=np.array([0.0]),
        speed_rpm=np.array([1200.0]),
        snr_db=20.0,
        sensor="velocity",
        truth=TRUTH,
    )


def heard(state, family="step", confidence=0.9):
    said = Opinions(np.array(state), confidence * ONES, 0.0 * ONES)
    return Heard(made_up(family), said)


PERFECT = ["stable"] * 6 + ["forced"] * 30 + ["stable"] * 24 + ["self_excited"] * 60


def test_perfect_verdicts_score_perfectly():
    """Verdicts that equal the labels have full recall, no false alarm, and every forced interval named."""
    score = by_interval([heard(PERFECT)])
    assert (score["recall"], score["false_alarm_share"], score["forced_accuracy"]) == (1.0, 0.0, 1.0)
    assert (score["self_excited"], score["not_self_excited"]) == (57, 54)
    assert by_event([heard(PERFECT)]) == {"chatter": 1, "found": 1.0, "alarms": 1, "false_alarm_share": 0.0}


def test_false_alarms_are_counted_where_they_are():
    """Two alarms of three intervals in calm ones are 6/54 of them, two an hour's share, and false events."""
    state = list(PERFECT)
    state[10:13] = state[20:23] = ["self_excited"] * 3
    score = by_interval([heard(state)])
    assert score["false_alarm_share"] == pytest.approx(6 / 54)
    assert score["false_alarms_per_hour"] == pytest.approx(2 / (54 * INTERVAL_S / 3600))
    assert score["early_share"] == 0.0
    assert by_event([heard(state)])["false_alarm_share"] == pytest.approx(2 / 3)


def test_what_is_not_scored_changes_nothing():
    """Alarms in intervals that the truth leaves open are neither recalled nor false."""
    state = list(PERFECT)
    state[0:6] = ["self_excited"] * 6
    assert by_interval([heard(state)]) == by_interval([heard(PERFECT)])


@pytest.mark.parametrize(("first", "lag_s"), [(ONSET, 0.04), (ONSET + 4, 0.24)])
def test_lag_is_from_the_crossing_to_the_end_of_the_interval(first, lag_s):
    """An interval's verdict is known at its end; the lag is counted from the crossing to there."""
    alarm = np.arange(LABELS.size) >= first
    found = lags([(made_up(), alarm)])
    assert found["median_ms"] == pytest.approx(1e3 * lag_s)
    assert found["median_over_limit"] == pytest.approx(lag_s / 0.05)


def test_chatter_without_alarm_has_an_infinite_lag_and_an_early_alarm_none():
    """What is never found is not left out of the percentiles, and what was on before is not counted as quick."""
    never, always = np.zeros(LABELS.size, bool), np.ones(LABELS.size, bool)
    assert lags([(made_up(), never)])["median_ms"] == np.inf
    assert lags([(made_up(), always)]) == {**lags([]), "early": 1}


def test_warning_counts_only_before_the_amplitude_has_doubled():
    """`approaching` before the doubling is a warning, after it is none, far from the limit it is a false one."""
    state = ["stable"] * LABELS.size
    assert warnings([heard(state, "ramp")])["warned_before_doubling"] == 0.0
    state[70:] = ["approaching"] * 50
    assert warnings([heard(state, "ramp")])["warned_before_doubling"] == 0.0
    state[50:60] = ["approaching"] * 10
    found = warnings([heard(state, "ramp")])
    assert (found["warned_before_doubling"], found["raised_below_half_the_limit"]) == (1.0, 10 / 54)


def test_reliability_finds_overconfidence():
    """Verdicts of which half are right are shown with half beside their confidence of 0.9."""
    state = np.where(np.arange(LABELS.size) % 2, PERFECT, "stable")
    state[LABELS == Label.OTHER] = "forced"
    row = next(r for r in reliability([heard(state)]) if r["verdicts"])
    scored = LABELS != Label.UNSCORED
    right = np.isin(LABELS, (Label.FORCED, Label.SELF_EXCITED)) & (np.arange(LABELS.size) % 2 == 1)
    assert row["verdicts"] == scored.sum()
    assert row["right"] == pytest.approx(right[scored].mean())


def test_a_tone_called_forced_is_neither_right_nor_wrong():
    """Of a cut with a tone from elsewhere `forced` counts only where the spindle forces most."""
    state = np.full(LABELS.size, "forced")
    row = next(r for r in reliability([heard(state, "hum")]) if r["verdicts"])
    assert (row["verdicts"], row["right"]) == (np.sum(LABELS == Label.FORCED), 1.0)


def test_the_score_is_what_the_monitor_tells():
    """The probability of chatter, whatever the word; where it is unknown none is claimed."""
    about = {"channel": 0, "t0": 0.0, "t1": 0.05, "sample0": 0, "sample1": 640}
    told = (("self_excited", 0.99, 0.99), ("forced", 0.7, 0.2), ("unknown", 0.0, None))
    verdicts = [Verdict(**about, state=state, confidence=sure, chatter_probability=p) for state, sure, p in told]
    said = Opinions.of(verdicts)
    assert said.state.tolist() == ["self_excited", "forced", "unknown"]
    assert (said.confidence.tolist(), said.score.tolist()) == ([0.99, 0.7, 0.0], [0.99, 0.2, 0.0])


def test_curve_of_a_score_that_knows_and_of_one_that_does_not():
    """A score equal to the truth has full recall without false alarms; a constant one has nothing before everything."""
    listened = [heard(PERFECT)]
    _, false, recall = curve(Detector("knows", [(LABELS == Label.SELF_EXCITED).astype(float)]), listened)
    assert (false[0], recall[0]) == (0.0, 1.0)
    constant = Detector("constant", [0.0 * ONES])
    _, false, recall = curve(constant, listened)
    assert (false.tolist(), recall.tolist()) == ([1.0], [1.0])
    assert at_equal_false_alarms(constant, listened)[0]["recall"] == 0.0


@pytest.mark.parametrize("peer", PEERS)
def test_peers_tell_a_chatter_line_from_cutting_noise(peer):
    """Every peer scores a loud line between the orders higher than the noise and tooth lines before it."""
    rng = np.random.default_rng(4)
    t = np.arange(LABELS.size * INTERVAL_SAMPLES) / RATE_HZ
    samples = 0.3 * rng.standard_normal(t.size) + np.sin(2 * np.pi * 61.2 * t) + 0.5 * np.sin(2 * np.pi * 122.4 * t)
    samples += np.where(t > ONSET * INTERVAL_S, 6.0, 0.0) * np.sin(2 * np.pi * 873.0 * t)
    score = PEERS[peer](replace(made_up(), samples=samples))
    assert np.median(score[90:]) > 1.2 * np.median(score[20:50])
    assert score[90:].min() > score[20:50].max()


def test_a_warning_is_told_before_an_alarm():
    """Onsets have a lag until the first warning besides that until the alarm."""
    state = list(PERFECT)
    state[ONSET:] = ["stable", *["approaching"] * 3, *["self_excited"] * (LABELS.size - ONSET - 4)]
    scores = as_results([heard(state)], [])["groups"]["all"]
    assert scores["lags"]["median_ms"] == pytest.approx(240.0)
    assert scores["lags_of_warnings"]["median_ms"] == pytest.approx(90.0)


def test_lags_and_warnings_are_told_by_family_and_noise():
    """A row for each that has an onset, and one for each of warnings."""
    console = Console(record=True, width=200)
    made = [heard(PERFECT), heard(PERFECT, "ramp"), heard(PERFECT, "forced")]
    show(console, "made up", as_results(made, []))
    printed = console.export_text()
    onsets, warned = (_rows(printed, title) for title in ("Alarms at sudden onsets", "Warnings or alarms"))
    assert set(onsets) == {"all", "step", "SNR 18-27 dB"}
    assert onsets["step"][:4] == ["1", "0", "0", "40"]
    assert set(warned) == {"all", "step", "ramp", "forced", "SNR 18-27 dB"}
    assert warned["step"][:4] == ["1", "0", "0", "40"]
    assert warned["ramp"][-3:-1] == ["1", "100 %"]


def _rows(printed, title):
    """Cells of the rows of a table by their first one."""
    table = printed.split(title)[1].split("└")[0]
    rows = ([cell.strip() for cell in row.split("│")] for row in table.splitlines())
    return {cells[1]: cells[2:-1] for cells in rows if len(cells) > 2}


def test_no_family_has_more_false_alarms_than_are_allowed():
    """One false alarm of a family with few intervals is too many there, and few enough among all."""
    rare, often = heard(PERFECT, "step"), [heard(PERFECT, "forced")] * 9
    score = (LABELS == Label.SELF_EXCITED).astype(float)
    rare_score = score.copy()
    rare_score[10] = 2.0  # of 54 intervals
    detector, made = Detector("some", [rare_score] + [score] * 9), [rare, *often]
    assert threshold(detector, made, 0.01) == 1.0
    assert recall(detector, made, 1.0) == 1.0
    assert threshold_of_all_families(detector, made, 0.01) == np.inf
    assert recall(detector, made, np.inf) == 0.0
    assert threshold_of_all_families(detector, made, 0.02) == 1.0
