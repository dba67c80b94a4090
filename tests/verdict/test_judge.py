"""From numbers to a verdict, and from verdicts to events."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.records import Flag, Verdict
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.evidence import Evidence, ModeEvidence
from chatter_monitor.verdict.judge import DEAF, EventLog, Judge, JudgeSettings, Memory, forced_order, opinion

MILL = SpindleSettings(speed_rpm=1656.0, teeth=6)  # tooth passing at 165.6 Hz
ON_HARMONIC_HZ, OFF_HARMONIC_HZ = 993.6, 1067.0


def evidence(damping=0.02, *, frequency=OFF_HARMONIC_HZ, sd=0.0005, rms=1.0, flags=Flag.NONE, **about):
    mode = None if damping is None else ModeEvidence(frequency, damping, sd, 0.9)
    return Evidence(
        critical=mode, held=about.get("held", False), starting=about.get("starting", False), rms=rms, flags=flags
    )


CALM, NEAR, CHATTER = evidence(0.02), evidence(0.005), evidence(0.0)
LOST = evidence(0.0, flags=Flag.GAP)
SILENCE = evidence(None, rms=1e-4)


def judged(*intervals, spindle=MILL, **thresholds):
    judge = Judge(JudgeSettings(**thresholds), spindle, channel=2)
    return [judge.verdict(each, 640 * i, 640, 12_800.0) for i, each in enumerate(intervals)]


def states(*intervals, **about):
    return [verdict.state for verdict in judged(*intervals, **about)]


@pytest.mark.parametrize(
    ("interval", "state", "reason"),
    [
        (CALM, "stable", "damping 2.00 % ± 0.10 % at 1067 Hz"),
        (evidence(None), "stable", "no mode stands out"),
        (NEAR, "approaching", "damping 0.50 % ± 0.10 % at 1067 Hz"),
        (evidence(0.0, frequency=ON_HARMONIC_HZ), "forced", "spindle order 36"),
        (evidence(0.0, held=True), "idle", "nothing moves"),
        (evidence(None, rms=0.0), "idle", "far below the level of cutting"),
        (evidence(0.0, starting=True), "unknown", "too few samples yet"),
        (evidence(0.0, sd=0.01), "stable", "damping"),  # nobody knows: no alarm from chance
        (evidence(-0.004), "approaching", "damping -0.40 %"),  # one interval alone raises no alarm
    ],
)
def test_an_interval_by_itself(interval, state, reason):
    """Each state but the alarm follows from one interval, with its reason in words."""
    (verdict,) = judged(interval)
    assert verdict.state == state
    assert reason in verdict.reasons[0]


@pytest.mark.parametrize("flag", [flag for flag in Flag if flag & DEAF])
@pytest.mark.parametrize("damping", [None, 0.02, 0.005, -0.01])
def test_loss_is_never_stable(flag, damping):
    """Whatever the numbers say, an interval with loss is unknown, claims nothing, and says so by its flags."""
    (verdict,) = judged(evidence(damping, flags=flag))
    assert (verdict.state, verdict.confidence, verdict.damping_ratio, verdict.frequency_hz) == (
        "unknown",
        0,
        None,
        None,
    )
    assert verdict.flags == [flag.name.lower()]


def test_every_flag_but_clipping_is_loss():
    """Clipping alone leaves frequency and damping readable."""
    assert {flag for flag in Flag if flag and not flag & DEAF} == {Flag.CLIPPED}
    (verdict,) = judged(evidence(flags=Flag.CLIPPED))
    assert (verdict.state, verdict.flags) == ("stable", ["clipped"])


def test_record_of_an_interval():
    """A verdict carries its interval in samples and seconds, the mode with its 95 % interval, and its order."""
    verdict = judged(CALM, NEAR)[1]
    assert (verdict.channel, verdict.sample0, verdict.sample1) == (2, 640, 1280)
    assert (verdict.t0, verdict.t1) == (0.05, 0.1)
    assert verdict.frequency_hz == OFF_HARMONIC_HZ
    assert verdict.damping_ratio_ci95 == pytest.approx((0.005 - 0.00098, 0.005 + 0.00098))
    assert verdict.order == pytest.approx(1067.0 / 27.6)
    assert verdict.confidence == pytest.approx(1.0, abs=1e-3)


def test_the_alarm_needs_its_intervals_in_a_row():
    """Two intervals of three are a warning, the third raises the alarm; a calm one in between starts anew."""
    assert states(*[CHATTER] * 4) == ["approaching", "approaching", "self_excited", "self_excited"]
    assert "self_excited" not in states(CHATTER, CHATTER, CALM, CHATTER, CHATTER, NEAR, CHATTER)


def test_an_interval_that_nobody_heard_does_not_start_anew():
    """Loss between suspicious intervals neither counts nor absolves."""
    assert states(CHATTER, CHATTER, LOST, CHATTER) == ["approaching", "approaching", "unknown", "self_excited"]


def test_the_alarm_stays_while_the_level_does():
    """The damping of a saturated vibration rises by itself: as long as it is as loud, the alarm is not withdrawn."""
    verdicts = judged(*[CHATTER] * 3, *[CALM] * 40)
    assert {verdict.state for verdict in verdicts[2:]} == {"self_excited"}
    assert verdicts[-1].reasons[0] == "the vibration has not died down since the alarm"
    assert verdicts[-1].damping_ratio == 0.02
    assert verdicts[-1].confidence < verdicts[2].confidence


def test_the_alarm_ends_when_it_is_calm_and_quiet():
    """After the calm intervals at less than half of the largest level the alarm is over, not before."""
    quiet = evidence(0.02, rms=0.49)
    assert states(*[CHATTER] * 3, *[quiet] * 5) == [
        *["approaching"] * 2,
        *["self_excited"] * 4,
        *["stable"] * 2,
    ]
    assert set(states(*[CHATTER] * 3, *[evidence(0.02, rms=0.51)] * 5)[2:]) == {"self_excited"}


def test_the_level_to_fall_from_is_the_largest_of_the_alarm():
    """A vibration that grew after the alarm was raised has to fall from where it came to."""
    grown = [evidence(0.0, rms=4.0)]
    assert states(*[CHATTER] * 3, *grown, *[evidence(0.02, rms=1.9)] * 4)[-1] == "stable"
    assert states(*[CHATTER] * 3, *grown, *[evidence(0.02, rms=2.1)] * 4)[-1] == "self_excited"


def test_chatter_in_between_keeps_the_alarm():
    """One suspicious interval among the calm ones and the alarm goes on, however quiet."""
    quiet, murmur = evidence(0.02, rms=0.1), evidence(0.0, rms=0.1)
    assert set(states(*[CHATTER] * 3, *[quiet, quiet, quiet, murmur] * 5)[2:]) == {"self_excited"}


@pytest.mark.parametrize("after", [SILENCE, evidence(0.0, frequency=ON_HARMONIC_HZ), evidence(0.0, held=True)])
def test_the_alarm_ends_when_the_tool_leaves_the_cut(after):
    """Silence, a channel that is held, or a forced line in its place end the alarm after the calm intervals."""
    assert states(*[CHATTER] * 3, *[after] * 5)[-3:-1] == ["self_excited", states(CALM, after)[1]]


def test_loss_during_an_alarm_is_unknown_and_the_alarm_goes_on_after_it():
    """While nothing is heard nothing is claimed, and the alarm is not forgotten however long it takes."""
    assert states(*[CHATTER] * 3, *[LOST] * 100, CALM) == [
        *["approaching"] * 2,
        "self_excited",
        *["unknown"] * 100,
        "self_excited",
    ]


def test_loss_sets_no_level():
    """The level of samples that are not to be trusted neither makes the cut look idle nor ends an alarm."""
    glitch = evidence(0.0, rms=1e6, flags=Flag.NON_FINITE)
    assert states(CALM, glitch, CALM) == ["stable", "unknown", "stable"]
    assert states(*[CHATTER] * 3, glitch, *[CALM] * 5)[-1] == "self_excited"


def test_a_new_alarm_needs_its_intervals_again():
    """After an alarm has ended the next one is raised like the first."""
    quiet = [evidence(0.02, rms=0.1)] * 4
    assert states(*[CHATTER] * 3, *quiet, *[CHATTER] * 3)[-3:] == ["approaching", "approaching", "self_excited"]


def test_idle_is_relative_to_the_loudest_of_the_last_minute():
    """What is far below the level of cutting is idle, whatever its damping, until the loudness is forgotten."""
    quiet = evidence(0.0, rms=1.5e-3)
    result = states(evidence(0.02, rms=1.0), *[quiet] * 20 * 60)
    assert set(result[1 : 20 * 40]) == {"idle"}
    assert result[-1] == "self_excited"  # after a minute 1 has become 1 / e; 0.003 / e is below it


@pytest.mark.parametrize(
    ("frequency_hz", "order"),
    [
        (165.6, 6),
        (993.6, 36),
        (993.6 * 1.0099, 36),
        (993.6 * 0.9901, 36),
        (993.6 * 1.011, None),
        (27.6, None),  # once per revolution is not a tooth passing
        (10.0, None),
        (165.6 * 25, 150),
        (165.6 * 26, None),  # here 1 % of the frequency is a quarter of the spacing: everything is near a harmonic
        (165.6 * 60, None),
    ],
)
def test_a_line_on_a_tooth_passing_harmonic_is_forced(frequency_hz, order):
    """The order is that of the nearest harmonic within the tolerance, as long as that tells harmonics apart."""
    assert forced_order(ModeEvidence(frequency_hz, 0.0, 0.0005, 1.0), MILL, 0.01) == order


@settings(max_examples=200, derandomize=True, deadline=None)
@given(st.floats(10, 6400), st.floats(50, 40_000), st.integers(1, 12), st.floats(1e-4, 0.4))
def test_never_forced_where_every_frequency_would_be(frequency_hz, speed_rpm, teeth, tolerance):
    """A forced verdict leaves at least half of the spectrum around it that would not be called forced."""
    spindle = SpindleSettings(speed_rpm=speed_rpm, teeth=teeth)
    order = forced_order(ModeEvidence(frequency_hz, 0.0, 0.0005, 1.0), spindle, tolerance)
    if order is not None:
        line_hz, spacing_hz = order * speed_rpm / 60, teeth * speed_rpm / 60
        assert abs(frequency_hz - line_hz) <= tolerance * line_hz * (1 + 1e-9)
        assert 2 * tolerance * line_hz <= spacing_hz / 2 * (1 + 1e-9)


def test_forced_needs_the_speed():
    """Without the spindle speed a line is no forced vibration, and the reason says that it reads the same."""
    verdict = judged(*[evidence(0.0, frequency=ON_HARMONIC_HZ)] * 3, spindle=SpindleSettings())[-1]
    assert (verdict.state, verdict.order) == ("self_excited", None)
    assert "without the spindle speed a forced line reads the same" in verdict.reasons[0]


def test_forced_carries_its_order():
    """A forced verdict has the harmonic as its order, and does not raise an alarm however long it lasts."""
    verdicts = judged(*[evidence(0.0, frequency=ON_HARMONIC_HZ * 1.005)] * 20)
    assert {(verdict.state, verdict.order) for verdict in verdicts} == {("forced", 36)}


def test_thresholds_are_those_of_the_settings():
    """Each threshold of the settings moves its border."""
    assert states(*[NEAR] * 3, chatter_damping=0.006)[-1] == "self_excited"
    assert states(NEAR, approaching_damping=0.004) == ["stable"]
    assert states(evidence(0.0025), certainty=0.8) == ["approaching"]
    assert states(CHATTER, alarm_intervals=1) == ["self_excited"]
    assert states(*[CHATTER] * 3, evidence(0.02, rms=0.1), calm_intervals=1)[-1] == "stable"
    assert states(*[CHATTER] * 3, *[evidence(0.02, rms=0.8)] * 4, release_ratio=0.9)[-1] == "stable"
    assert states(CALM, evidence(0.02, rms=0.05), idle_ratio=0.1)[-1] == "idle"
    assert states(evidence(0.0, frequency=ON_HARMONIC_HZ * 1.005), order_tolerance=0.001)[-1] == "approaching"


def test_an_opinion_is_a_function_of_its_arguments():
    """The same interval and memory give the same opinion, and leave the memory as it was."""
    memory = Memory(loudest=1.0)
    opinions = [opinion(CHATTER, memory, MILL, JudgeSettings()) for _ in range(2)]
    assert opinions[0] == opinions[1]
    assert opinions[0].state == "self_excited"
    assert memory == Memory(loudest=1.0)


intervals = st.builds(
    evidence,
    st.sampled_from([None, 0.02, 0.005, 0.0, -0.01]),
    frequency=st.sampled_from([ON_HARMONIC_HZ, OFF_HARMONIC_HZ]),
    rms=st.sampled_from([0.0, 1e-4, 0.3, 1.0]),
    flags=st.sampled_from(list(Flag)),
    held=st.booleans(),
    starting=st.booleans(),
)


@settings(max_examples=200, derandomize=True, deadline=None)
@given(st.lists(intervals, max_size=40))
def test_whatever_happens(history):
    """For any history: deaf is unknown and unknown has a cause, alarms have their three reasons, intervals join."""
    verdicts = judged(*history)
    for verdict, interval in zip(verdicts, history, strict=True):
        if interval.flags & DEAF:
            assert verdict.state == "unknown"
        if verdict.state == "unknown":
            assert interval.flags & DEAF or interval.starting
    for before, after in pairwise(verdicts):
        assert before.sample1 == after.sample0
    alarmed = [i for i, verdict in enumerate(verdicts) if verdict.state == "self_excited"]
    if alarmed:
        suspicious = [each for each in history[: alarmed[0] + 1] if each.critical and each.critical.damping_ratio <= 0]
        assert len(suspicious) >= 3


def verdict_of(state, index, *, channel=0, damping=0.001, frequency=1067.0):
    return Verdict(
        channel=channel, t0=index * 0.05, t1=(index + 1) * 0.05, sample0=index * 640, sample1=(index + 1) * 640,
        state=state, damping_ratio=damping, frequency_hz=frequency,
    )  # fmt: skip


def test_an_event_is_a_stretch_of_alarm():
    """It lasts from the first to the last interval of the alarm and tells the least damping with its frequency."""
    log = EventLog("cut")
    assert log.follow(verdict_of("stable", 0)) is None
    assert log.follow(verdict_of("self_excited", 1)) is None
    assert log.follow(verdict_of("self_excited", 2, damping=-0.002, frequency=1064.0)) is None
    assert log.follow(verdict_of("unknown", 3, damping=None, frequency=None)) is None
    assert log.follow(verdict_of("self_excited", 4)) is None
    event = log.follow(verdict_of("stable", 5))
    assert (event.kind, event.channel, event.id) == ("chatter", 0, "cut-0-0001")
    assert (event.onset_s, event.end_s) == pytest.approx((0.05, 0.25))
    assert (event.min_damping_ratio, event.peak_frequency_hz) == (-0.002, 1064.0)
    assert log.follow(verdict_of("stable", 6)) is None


def test_an_event_is_about_the_vibration_that_lasts():
    """One interval in which another mode reads less damping changes neither the event's frequency nor its damping."""
    log = EventLog("cut")
    for i in range(5):
        log.follow(verdict_of("self_excited", i))
    log.follow(verdict_of("self_excited", 5, damping=-0.1, frequency=1249.0))
    event = log.finish(0)
    assert (event.min_damping_ratio, event.peak_frequency_hz) == (0.001, 1067.0)


def test_events_of_channels_are_apart():
    """Each channel has events of its own, all with different names."""
    log = EventLog("cut")
    for channel in (0, 1):
        log.follow(verdict_of("self_excited", 0, channel=channel))
    first = log.follow(verdict_of("stable", 1, channel=1))
    log.follow(verdict_of("self_excited", 2, channel=1))
    second = log.follow(verdict_of("stable", 3, channel=1))
    last = log.finish(0)
    assert [event.channel for event in (first, second, last)] == [1, 1, 0]
    assert len({event.id for event in (first, second, last)}) == 3


def test_the_end_of_the_recording_ends_the_event():
    """What is under way at the end becomes an event once, what is not does not."""
    log = EventLog("cut")
    assert log.finish(0) is None
    log.follow(verdict_of("self_excited", 0))
    assert log.finish(0).end_s == pytest.approx(0.05)
    assert log.finish(0) is None


LINE = evidence(0.0, frequency=ON_HARMONIC_HZ)  # a narrow line, forced if the spindle turns as `MILL` does


def states_around(change, before, after):
    """States of intervals before and after another spindle is set, the judge knowing none at first."""
    judge = Judge(JudgeSettings(), SpindleSettings())
    seen = []
    for i, each in enumerate([*before, *after]):
        if i == len(before):
            judge.set_spindle(change)
        seen.append(judge.verdict(each, 640 * i, 640, 12_800.0).state)
    return seen[len(before) - 1 :]


@pytest.mark.parametrize(("lines", "state"), [(1, "approaching"), (5, "self_excited")])
def test_the_spindle_speed_makes_a_line_forced_at_once(lines, state):
    """A warning or an alarm about a line ends with the first interval that is judged by the right speed."""
    assert states_around(MILL, [LINE] * lines, [LINE] * 2) == [state, "forced", "forced"]


def test_loss_puts_off_what_the_spindle_speed_says():
    """An interval that nobody heard right after the speed was set does not cost the withdrawal of the alarm."""
    assert states_around(MILL, [LINE] * 5, [LOST, LINE]) == ["self_excited", "unknown", "forced"]


@pytest.mark.parametrize(
    ("change", "after"),
    [
        (SpindleSettings(), LINE),  # the same as before
        (SpindleSettings(speed_rpm=1600.0, teeth=6), LINE),  # a speed that does not explain the line
        (MILL, CHATTER),
        (MILL, CALM),  # nothing says that what was loud is over
    ],
)
def test_another_spindle_speed_alone_ends_no_alarm(change, after):
    """Unless it explains the line, a new speed leaves an alarm as it is."""
    assert set(states_around(change, [evidence(0.0, frequency=after.critical.frequency_hz)] * 5, [after] * 9)) == {
        "self_excited"
    }


def test_only_the_first_interval_at_a_new_speed_ends_an_alarm():
    """Once an interval was judged by the new speed, an alarm ends by its usual rules again."""
    assert states_around(MILL, [CHATTER] * 5, [CHATTER, LINE, LINE]) == ["self_excited"] * 4


def test_one_click_does_not_hide_a_quiet_cut():
    """After a single interval ten thousand times as loud, the cut is not taken for idle."""
    quiet, click = evidence(0.02, rms=1e-4), evidence(0.02, rms=1.0)
    assert set(states(quiet, quiet, click, *[quiet] * 20)) == {"stable"}


def test_idle_is_known_soon_after_a_start_from_silence():
    """The level of cutting is learned within a second, however quiet it was before."""
    loud = evidence(0.02, rms=1.0)
    assert states(*[evidence(None, rms=1e-6)] * 3, *[loud] * 20, evidence(None, rms=1e-4))[-1] == "idle"
