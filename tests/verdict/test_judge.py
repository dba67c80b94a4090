"""From numbers to a verdict. What looks like growth is left to the weights; the lines here look like nothing else."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.kernels.kinds import LINE, Kinds
from chatter_monitor.kernels.overview import Overview, overview
from chatter_monitor.kernels.vibration import VIBRATION
from chatter_monitor.records import Flag
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.margin_tracker import FRAMES_TO_RENEW
from chatter_monitor.tracking.orders import OrderLine, Orders
from chatter_monitor.tracking.sidebands import Sidebands
from chatter_monitor.tracking.spectrum import Cycle, Line
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict import reasons
from chatter_monitor.verdict.event_log import EventLog
from chatter_monitor.verdict.evidence import Evidence, ModeEvidence, Place, Vibration
from chatter_monitor.verdict.judge import DEAF, Judge
from chatter_monitor.verdict.opinion import Memory, opinion
from chatter_monitor.verdict.settings import JudgeSettings
from chatter_monitor.verdict.vibrations import Followed, Told, repeating_share
from tests.verdict.hearing import heard
from tests.verdict.test_same_cut import CHATTER_HZ, PASSING_HZ, noise, spectra, teeth, tone

HZ = 1067.0
UNKNOWN_SPEED = Orders(0, None, None, None, 0.0)
MILL = Orders(0, 27.6, 0.01, "found", 0.0)
TOLD = Orders(0, 27.6, 0.01, "refined", 0.0)
SPINDLE = Orders(0, 27.6, 0.01, "refined", 0.1, (OrderLine(6, 165.6, 0.3),))
TURNING = Orders(0, 27.6, 0.01, "found", 0.9, (OrderLine(36, 993.6, 0.7), OrderLine(6, 165.6, 0.2)))
NO_MARGIN = Margin(reason="too little signal yet")


def mode(damping=0.02, frequency=HZ, sd=0.0005):
    return ModeEvidence(frequency, damping, sd, 0.9)


def growing(frequency=HZ, damping=0.0, *, on_order=False, share=0.9):
    """A line that rises, coherent, tenfold within a second."""
    line = Line(frequency, share, 35.0, 0.7, 60.0, 2.3, 3.0, 3.2, 0.99)
    return Vibration(line, mode(damping, frequency), *[Place(on_order, 0.2)] * 2)


def steady(frequency=HZ, damping=0.0, *, on_order=False, share=0.9):
    """A line as coherent that neither grows nor varies."""
    line = Line(frequency, share, 30.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.99)
    return Vibration(line, mode(damping, frequency), *[Place(on_order, 0.2)] * 2)


def evidence(*vibrations, critical=None, orders=UNKNOWN_SPEED, margin=NO_MARGIN, rms=1.0, flags=Flag.NONE, **about):
    return Evidence(
        critical=critical,
        vibrations=heard(*vibrations),
        orders=orders,
        margin=margin,
        cutting=about.get("cutting", True),
        held=about.get("held", False),
        starting=about.get("starting", False),
        rms=rms,
        flags=flags,
        entering=about.get("entering", False),
        grown=about.get("grown", False),
        cycle=about.get("cycle"),
    )


def remembered(vibration, dominance=1.0):
    """Memory of an interval in which this was the only vibration, with so much of the power."""
    records = np.zeros(1, VIBRATION)
    records["dominance"] = dominance
    for name, probability in vibration.kinds._asdict().items():
        records[name] = probability
    for name in ("frequency_hz", "unexplained", "alarm_for", "chattered"):
        records[name] = getattr(vibration, name)
    return Memory(1.0, Told(Overview(*overview(records, np.zeros(1, LINE))), records, heard(vibration.heard)))


CALM, NEAR = evidence(critical=mode(0.02)), evidence(critical=mode(0.001))
GROWS, STAYS = evidence(growing()), evidence(steady())
LOST = evidence(growing(), flags=Flag.GAP)
SILENCE = evidence(rms=1e-4)
ONSET = [CALM] * 40 + [GROWS] * 20


def judged(*intervals, **thresholds):
    judge = Judge(JudgeSettings(**thresholds), channel=2)
    return [judge.verdict(each, 640 * i, 640, 12_800.0) for i, each in enumerate(intervals)]


def states(*intervals, **thresholds):
    return [verdict.state for verdict in judged(*intervals, **thresholds)]


def whys(*intervals, **thresholds):
    return [verdict.reasons[0] for verdict in judged(*intervals, **thresholds)]


@pytest.mark.parametrize(
    ("interval", "state", "reason"),
    [
        (CALM, "stable", "damping 2.00 % ± 0.10 % at 1067 Hz"),
        (evidence(), "stable", "no mode stands out"),
        (NEAR, "stable", "damping 0.10 % ± 0.10 % at 1067 Hz"),  # not yet
        (evidence(critical=mode(0.0, sd=0.01)), "stable", "damping"),  # nobody knows
        (evidence(margin=Margin(margin_percent=9.0, margin_ci95=(4.0, 14.0))), "approaching", "only 9 % more depth"),
        (evidence(margin=Margin(margin_percent=9.0, margin_ci95=(2.0, 16.0))), "stable", "no mode"),
        (evidence(growing(), held=True), "idle", "nothing moves"),
        (evidence(growing(), cutting=False), "idle", "not in the cut"),
        (evidence(growing(), starting=True), "unknown", "too few samples yet"),
    ],
)
def test_an_interval_by_itself(interval, state, reason):
    """Each state that needs no history follows from one interval, with its reason in words."""
    (verdict,) = judged(interval)
    assert verdict.state == state
    assert reason in verdict.reasons[0]


def test_little_damping_is_a_warning_from_the_second_interval_on():
    """One interval alone warns of nothing, nor do two with one between them that is damped."""
    assert states(NEAR, NEAR, NEAR, CALM, NEAR, CALM) == ["stable", "approaching", "approaching", *["stable"] * 3]


@pytest.mark.parametrize("flag", [flag for flag in Flag if flag & DEAF])
@pytest.mark.parametrize("interval", [CALM, NEAR, GROWS, STAYS])
def test_loss_is_never_stable(flag, interval):
    """Whatever the numbers say, an interval with loss is unknown, claims nothing, and says so by its flags."""
    lossy = evidence(*interval.vibrations, critical=interval.critical, flags=flag)
    verdict = judged(*ONSET, lossy)[-1]
    assert (verdict.state, verdict.confidence) == ("unknown", 0)
    assert verdict.damping_ratio is verdict.frequency_hz is None
    assert verdict.flags == [flag.name.lower()]


def test_every_flag_but_clipping_is_loss():
    """Clipping alone leaves frequency and damping readable."""
    assert {flag for flag in Flag if flag and not flag & DEAF} == {Flag.CLIPPED}
    (verdict,) = judged(evidence(critical=mode(), flags=Flag.CLIPPED))
    assert (verdict.state, verdict.flags) == ("stable", ["clipped"])


def test_record_of_an_interval():
    """A verdict carries its interval in samples and seconds, the mode with its 95 % interval, and its order."""
    verdict = judged(CALM, evidence(critical=mode(0.005), orders=MILL))[1]
    assert (verdict.channel, verdict.sample0, verdict.sample1) == (2, 640, 1280)
    assert (verdict.t0, verdict.t1) == (0.05, 0.1)
    assert verdict.frequency_hz == HZ
    assert verdict.damping_ratio_ci95 == pytest.approx((0.005 - 0.00098, 0.005 + 0.00098))
    assert verdict.order == pytest.approx(HZ / 27.6)


def test_growth_is_a_warning_and_then_an_alarm():
    """What has grown fourfold is `approaching` for at least an interval, then the alarm, within half a second."""
    fourfold = growing()
    line = fourfold.line._replace(long_rise=math.log(4.0), absolute_rise=math.log(4.0))
    grown = states(*[CALM] * 40, *[evidence(fourfold._replace(line=line))] * 20)[40:]
    first = grown.index("self_excited")
    assert 1 <= first <= 10
    assert "approaching" in grown[:first]
    assert set(grown[first:]) == {"self_excited"}


@pytest.mark.parametrize("swung", [True, False])
def test_what_has_swung_as_far_before_is_no_alarm(swung):
    """A mode near its limit gets as loud as this and loses it again; the cut as such is as loud as ever."""
    before = [evidence(steady(), rms=4.0 if swung else 1.0)] * 3 + [evidence(steady())] * 100
    grown = evidence(growing(), rms=4.0)
    then = states(*before, *[grown] * 5)[len(before) :]
    assert ("self_excited" in then) == (not swung)
    assert grown.vibrations[0] == growing()  # what others are told stays as it was heard


def test_chatter_that_is_over_was_no_swing():
    """Minutes later, when it is forgotten, the same vibration is an alarm again."""
    chatter = [evidence(growing(), rms=4.0)] * 20
    seen = states(*[CALM] * 40, *chatter, *[CALM] * 1400, *chatter[:5])
    assert "self_excited" in seen[40:60]
    assert "self_excited" not in seen[1000:1460]
    assert "self_excited" in seen[1460:]


def test_what_leaves_with_the_tool_was_no_swing():
    """A heavy cut, the air, and a light one, in which it chatters as loud as the heavy one was."""
    before = [evidence(steady(), rms=4.0)] * 40 + [SILENCE] * 40 + [evidence(steady())] * 100
    assert "self_excited" in states(*before, *[evidence(growing(), rms=4.0)] * 5)[len(before) :]


def test_an_alarm_goes_on_when_its_line_is_taken_out_with_what_turns():
    """Chatter that catches on the teeth is as loud as it was."""
    caught = evidence(orders=SPINDLE._replace(synchronous_share=0.95), rms=4.0)
    seen = states(*[CALM] * 40, *[evidence(growing(), rms=4.0)] * 20, *[caught] * 60)
    assert seen[60:] == ["self_excited"] * 60


def test_what_dies_down_after_chatter_is_not_forced():
    """A vibration that has chattered rings on, as calm as a forced line; little is left, until its damping is back."""
    dying = steady(damping=0.001)
    dying = dying._replace(line=dying.line._replace(long_rise=-1.0, absolute_rise=-1.0))
    after = states(*ONSET, *[evidence(dying, critical=mode(0.001))] * 20, *[evidence(dying, critical=mode(0.01))] * 20)
    assert "forced" not in after
    assert (after[-30], after[-1]) == ("approaching", "stable")
    assert states(*[CALM] * 40, *[evidence(steady())] * 40)[-1] == "forced"  # what has not chattered is


def test_a_warning_tells_what_is_not_certain():
    """Whether it grows, as long as that is less sure than that nothing else explains it; else what makes it."""
    begins = Followed(HZ, Kinds(0.8, 0.2, 0.0, 0.0), unexplained=0.9, heard=growing())
    risen = Followed(HZ, Kinds(0.0, 0.5, 0.5, 0.0), unexplained=0.3, heard=growing())
    for suspect, why in ((begins, "begins to grow; not certain yet"), (risen, "come from something that turns")):
        view = opinion(GROWS, remembered(suspect), JudgeSettings())
        assert view.state == "approaching"
        assert view.reasons[0].endswith(why)
        assert opinion(GROWS, remembered(suspect, dominance=0.1), JudgeSettings()).state == "stable"  # not the power


@pytest.mark.parametrize(
    ("measure", "kinds", "why"),
    [
        ("news", Kinds(0.0, 0.9, 0.1, 0.0), "it stands out 5.0 times as much as in the cuts before"),
        ("arrival", Kinds(0.0, 0.1, 0.9, 0.0), "it came with the tool"),
    ],
)
def test_an_alarm_from_the_entry_tells_what_is_new(measure, kinds, why):
    """Of a line that has not risen since the tool entered: how new it is, or, without a cut before, when it came."""
    entered = steady()
    entered = entered._replace(line=entered.line._replace(**{measure: math.log(5.0)}))
    alarm = Followed(HZ, kinds, unexplained=0.9, alarm_for=3, heard=entered)
    view = opinion(evidence(entered), remembered(alarm), JudgeSettings())
    assert view.reasons[1] == why


@pytest.mark.parametrize(
    ("sidebands", "told"),
    [
        (Sidebands(HZ + 5.0, 0.5, 165.6, 40.0), True),
        (Sidebands(HZ + 30.0, 0.5, 165.6, 40.0), False),
        (Sidebands(165.6, 0.5, HZ + 5.0, 40.0), False),
        (Sidebands(165.6, 0.5, HZ + 5.0, 40.0, either=True), True),
    ],
)
def test_an_alarm_tells_its_sidebands(sidebands, told):
    """Those of the line that the alarm is about."""
    orders = UNKNOWN_SPEED._replace(sidebands=sidebands)
    alarm = Followed(HZ, Kinds(0.0, 0.1, 0.9, 0.0), unexplained=0.9, alarm_for=3, heard=steady())
    view = opinion(evidence(steady())._replace(orders=orders), remembered(alarm), JudgeSettings())
    assert ("it has sidebands 165.6 Hz apart and is no multiple of that" in view.reasons) is told


def test_growth_beyond_chance_is_an_alarm_at_once():
    """What has grown so far that chance explains it no more is the alarm with its first coherent interval."""
    assert states(*ONSET)[40:].index("self_excited") == 0


def test_the_alarm_tells_frequency_damping_and_why():
    """An alarm names the vibration that grows, its damping, that it grows by itself, by how much, and what it takes."""
    verdict = judged(*ONSET)[-1]
    assert (verdict.frequency_hz, verdict.damping_ratio) == (HZ, 0.0)
    assert verdict.confidence > 0.9
    assert verdict.reasons[0].startswith("the vibration at 1067 Hz")
    assert "by itself" in verdict.reasons[0]
    assert verdict.reasons[1] == f"{math.exp(growing().line.absolute_rise):.1f} times its amplitude of the last seconds"
    assert "takes 90 %" in verdict.reasons[2]
    room = Margin(margin_percent=40.0, margin_ci95=(30.0, 50.0))
    before, alarm = judged(evidence(margin=room), *ONSET[40:], evidence(growing(), margin=room))[:: len(ONSET) - 39]
    assert (before.margin_percent, alarm.state, alarm.margin_percent) == (40.0, "self_excited", None)
    assert (before.margin_percent_ci95, alarm.margin_percent_ci95) == ((30.0, 50.0), None)


@pytest.mark.parametrize("air", [0, 200])
def test_a_margin_after_chatter_is_of_what_came_after(air):
    """Until no window of the cut holds chatter any more, a margin neither warns nor is told; air does not count."""
    near = evidence(margin=Margin(margin_percent=9.0, margin_ci95=(4.0, 14.0)))
    seen = judged(*ONSET, *[evidence(cutting=False)] * air, *[near] * 200)
    end = air + max(k for k, verdict in enumerate(seen) if verdict.state == "self_excited")
    after = {(verdict.state, verdict.margin_percent) for verdict in seen[end + 1 : end + 1 + FRAMES_TO_RENEW]}
    assert after == {("stable", None)}
    assert {(verdict.state, verdict.margin_percent) for verdict in seen[end + 2 + FRAMES_TO_RENEW :]} == {
        ("approaching", 9.0)
    }


def test_the_alarm_stays_while_the_vibration_does():
    """Saturated chatter looks like a forced line: as long as the line is there the alarm is not withdrawn."""
    after = judged(*ONSET, *[STAYS] * 1200)[len(ONSET) :]
    assert {verdict.state for verdict in after} == {"self_excited"}
    assert after[-1].reasons[0] == "the vibration at 1067 Hz has grown by itself"


def test_the_same_line_from_the_start_is_forced():
    """What was never seen to grow is something that forces it, and never an alarm."""
    seen = judged(*[STAYS] * 1200)
    assert {verdict.state for verdict in seen[40:]} == {"forced"}
    assert "self_excited" not in {verdict.state for verdict in seen}
    assert seen[-1].reasons == ["the vibration at 1067 Hz is steady and was not seen to grow: something forces it"]


def test_a_line_on_an_order_says_so():
    """A steady line on an order of the spindle is forced for that reason, and carries its order."""
    verdict = judged(*[evidence(steady(993.6, on_order=True), orders=MILL)] * 60)[-1]
    assert (verdict.state, verdict.order) == ("forced", pytest.approx(36.0))
    assert verdict.reasons == ["the vibration at 994 Hz is steady and on an order of the spindle"]


def test_a_small_line_does_not_make_a_cut_forced():
    """Forced is what carries most of the power: a hum of a tenth of it leaves the cut stable."""
    assert states(*[evidence(steady(share=0.1), critical=mode())] * 60)[-1] == "stable"


def test_mostly_synchronous_is_forced():
    """When most of the power has turned with the spindle for a while, the cut is forced, by its strongest line."""
    seen = judged(*[evidence(orders=TURNING, critical=mode())] * 40)
    assert [verdict.state for verdict in seen[:2]] == ["stable"] * 2
    assert (seen[-1].state, seen[-1].frequency_hz, seen[-1].order) == ("forced", 993.6, pytest.approx(36.0))
    assert seen[-1].reasons == ["90 % of the power is in multiples of 27.6 Hz (found): 36 x, 6 x"]


@pytest.mark.parametrize(("hertz", "whose"), [(59.7, "not the spindle that was told"), (60.01, "the mains")])
def test_what_turns_beside_a_spindle_that_is_not_heard_is_named(hertz, whose):
    """Its multiples, and not those of a speed that was told and is not heard."""
    beside = Orders(0, 45.5, 0.7, "given", 0.8, (), hertz, (OrderLine(2, 2.0 * hertz, 0.7),))
    assert reasons.turning(beside) == f"80 % of the power is in multiples of {hertz:.1f} Hz ({whose}): 2 x"


def test_chatter_under_a_strong_comb_is_an_alarm():
    """However much of the power is synchronous, what grows beside it is reported."""
    loud = [evidence(orders=TURNING)] * 40 + [evidence(growing(), orders=TURNING)] * 20
    assert states(*loud)[-1] == "self_excited"


def test_a_hum_hides_no_chatter():
    """Growth beside a steady line is an alarm once it carries most of the power, and named by what grows."""
    hum, louder = steady(100.0, share=0.85), (steady(100.0, share=0.25), growing(share=0.7))
    verdict = judged(*[evidence(hum)] * 40, *[evidence(*louder)] * 20)[-1]
    assert (verdict.state, verdict.frequency_hz) == ("self_excited", HZ)


def test_what_rises_on_an_order_is_no_alarm_until_it_leaves_it():
    """A new line that rises on an order may come with the tool's entry; if it turns out to be off them, an alarm."""
    on, off = (evidence(growing(on_order=on_order), orders=SPINDLE) for on_order in (True, False))
    assert "self_excited" not in states(*[CALM] * 40, *[on] * 60)
    assert states(*[CALM] * 40, *[on] * 60, *[off] * 20)[-1] == "self_excited"


def test_an_alarm_names_its_vibration_not_its_harmonics():
    """While the alarm runs a harmonic that looks more like chatter does not take its place."""
    both = evidence(steady(HZ + 5.0, damping=0.01, share=0.1), growing(2 * HZ))
    verdict = judged(*ONSET, both)[-1]
    assert (verdict.frequency_hz, verdict.damping_ratio) == (HZ + 5.0, 0.01)


def test_an_alarm_whose_line_is_not_heard_names_no_other():
    """Without its line an alarm that goes on is where it was, has no damping, and says why it goes on."""
    verdict = judged(*ONSET, evidence(steady(2 * HZ), critical=mode(frequency=400.0)))[-1]
    told = (verdict.state, verdict.frequency_hz, verdict.damping_ratio, verdict.order)
    assert told == ("self_excited", HZ, None, None)
    assert verdict.reasons == ["the vibration has not died down since the alarm"]


def test_the_alarm_ends_when_the_line_is_gone():
    """When nothing stands out any more the alarm ends within a second, and the next one is about another line."""
    seen = judged(*ONSET, *[CALM] * 40, *[evidence(growing(400.0))] * 20)
    after = [verdict.state for verdict in seen[len(ONSET) :][:40]]
    assert after[20:] == ["stable"] * 20
    assert (seen[-1].state, seen[-1].frequency_hz) == ("self_excited", 400.0)


def test_an_alarm_goes_on_until_the_cut_gets_quieter():
    """Chatter that gets irregular is not over while the cut is as loud; nor when samples are lost; then it is."""
    irregular = Vibration(Line(HZ, 0.3, 10.0, 0.6, 0.0, -0.2, -0.2, -0.2, 0.2), mode(0.01))
    loud = evidence(irregular, rms=4.0)
    onset = [CALM] * 40 + [evidence(growing(), rms=4.0)] * 20
    seen = judged(*onset, *[loud] * 100, evidence(flags=Flag.GAP), *[loud] * 10, *[CALM] * 40)
    assert [verdict.state for verdict in seen[60:171]] == ["self_excited"] * 100 + ["unknown"] + ["self_excited"] * 10
    assert seen[159].reasons == [reasons.still_loud(16.0)]
    assert seen[159].frequency_hz == HZ
    assert "self_excited" not in [verdict.state for verdict in seen[-20:]]


def test_bursts_in_no_order_are_an_alarm_until_the_tool_has_left():
    """Teeth that repeated and now hit what they find, ten times harder, now and then; no line of that is coherent."""
    milling = Orders(0, None, None, None, 0.0, repeating_share=0.9)
    broken = milling._replace(repeating_share=0.3)
    line = Vibration(Line(HZ, 0.7, 18.0, 1.1, 0.0, 0.0, 0.0, 2.5, 0.3), mode(0.03))
    bursts = [evidence(line, orders=broken, rms=rms) for rms in 10 * (5.0, 20.0, 12.0)]
    verdicts = judged(*[evidence(orders=milling)] * 40, *bursts, *[SILENCE] * 5)
    alarms = [verdict for verdict in verdicts if verdict.state == "self_excited"]
    assert 18 <= len(alarms) < 30
    assert all(verdict.t0 >= 2.0 for verdict in alarms)
    assert {verdict.frequency_hz for verdict in alarms} == {HZ}
    assert alarms[-1].reasons == ["no two rotations are alike any more, and the cut is 22 dB louder than before"]
    assert {verdict.state for verdict in verdicts[-5:]} == {"idle"}


def test_what_keeps_its_amplitude_and_not_its_phase_is_an_alarm_where_the_cut_got_louder():
    """No line of it is coherent; it is called by the one that is nearest, and ends with the tool."""
    broad = [Vibration(Line(hertz, 0.3, 18.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.7), None) for hertz in (HZ, 700.0)]
    kept = {"cycle": Cycle(720.0, 0.7, 0.3, 0.6)}
    calm = [evidence(*broad, **kept)] * 40 + [evidence(*broad, rms=rms) for rms in np.geomspace(1.0, 3.0, 30)]
    assert "self_excited" not in states(*calm, *[evidence(*broad, rms=3.0)] * 40)
    verdicts = judged(*calm, *[evidence(*broad, rms=3.0, **kept)] * 40, *[SILENCE] * 5)
    alarms = [verdict for verdict in verdicts if verdict.state == "self_excited"]
    assert 25 <= len(alarms) <= 35
    assert {verdict.frequency_hz for verdict in alarms} == {700.0}
    (why,) = alarms[-1].reasons
    steady = "the vibration at 700 Hz is steadier than noise, and no force keeps its phase"
    assert why == f"{steady}; the cut is 10 dB louder than it was"
    assert {verdict.state for verdict in verdicts[-5:]} == {"idle"}
    *_, unnamed = judged(*calm, *[evidence(rms=3.0, **kept)] * 40)  # no line stands out of it
    assert (unnamed.state, unnamed.frequency_hz, unnamed.damping_ratio) == ("self_excited", 720.0, None)
    assert unnamed.reasons[0].startswith("the vibration at 720 Hz is steadier than noise")


def test_power_that_is_new_in_the_same_cut_is_an_alarm_and_is_called_by_its_line():
    """After a pass that was calm and air; what repeats and is steady is forced until then, and no speed is known."""
    line = steady(CHATTER_HZ)

    def passing(signal, *vibrations):
        new = iter(spectra(signal))
        return [
            evidence(*vibrations, orders=UNKNOWN_SPEED._replace(spectrum=next(new) if number % 4 == 3 else None))
            for number in range(60)
        ]

    air = [each._replace(rms=1e-4) for each in passing(0.01 * noise(1))]
    calm = [*air, *passing(teeth() + 0.3 * noise(2)), *air]
    verdicts = judged(*calm, *passing(teeth() + 0.3 * noise(3) + 4.0 * tone(CHATTER_HZ), line), *air)
    alarms = [verdict for verdict in verdicts if verdict.state == "self_excited"]
    assert 48 <= len(alarms) <= 52  # all but the first half a second
    assert alarms[0].t0 > 9.0
    assert {verdict.frequency_hz for verdict in alarms} == {CHATTER_HZ}
    (why,) = alarms[0].reasons
    same = "what forces the cut is the same as in the passes before"
    assert why.startswith(f"{same}, but 8")
    assert why.endswith(" % of the power is new, most of it at 738 Hz")
    assert "self_excited" not in states(*calm, *passing(3.0 * teeth() + 0.9 * noise(3), line), *air)
    chatters = teeth() + 0.3 * noise(3) + 4.0 * tone(CHATTER_HZ)
    unheard = judged(*calm, *passing(chatters, line)[:40], *passing(chatters)[40:], *air)  # its line, for a second
    alarms = [verdict for verdict in unheard if verdict.state == "self_excited"]
    assert len(alarms) >= 48
    assert {verdict.frequency_hz for verdict in alarms} == {CHATTER_HZ}
    elsewhere = judged(*calm, *passing(chatters, steady(2000.0)), *air)
    alarms = [verdict for verdict in elsewhere if verdict.state == "self_excited"]
    assert {verdict.frequency_hz for verdict in alarms} == {737.5}  # middle of the band
    assert {verdict.damping_ratio for verdict in alarms} == {None}


@pytest.mark.parametrize(
    ("passing_hz", "orders", "told"),
    [
        (PASSING_HZ, SPINDLE._replace(rotation_hz=PASSING_HZ / 4), True),
        (PASSING_HZ, MILL._replace(rotation_hz=PASSING_HZ / 4), False),  # a comb that is not heard now
        (50.0, SPINDLE._replace(rotation_hz=25.0), True),
        (50.0, SPINDLE._replace(rotation_hz=50.0, source="found"), False),  # a hum, as far as is known
    ],
)
def test_power_that_is_new_within_a_pass_is_an_alarm_where_the_spindle_is_heard(passing_hz, orders, told):
    """Of a recording that begins in the cut nothing else tells what is of the cut."""
    before, after = (
        spectra(teeth(passing_hz) + 0.3 * noise(n) + a * tone(CHATTER_HZ)) for n, a in ((2, 0.0), (3, 4.0))
    )
    new = iter([*before, *after])
    cut = [
        evidence(steady(CHATTER_HZ), orders=orders._replace(spectrum=next(new) if number % 4 == 3 else None))
        for number in range(4 * (len(before) + len(after)))
    ]
    alarms = [verdict for verdict in judged(*cut) if verdict.state == "self_excited"]
    assert bool(alarms) is told
    if told:
        assert alarms[0].t0 == pytest.approx(4.0, abs=0.5)
        assert alarms[0].reasons[0].startswith("what forces the cut is the same as before, but 8")
    cut[4 * len(before)] = cut[4 * len(before)]._replace(entering=True)  # what was before is none of this cut
    assert "self_excited" not in states(*cut)


def test_what_is_suspected_is_an_alarm_when_the_cut_gets_loud():
    """A line that may be forced as well is one in a cut that is 15 dB louder within a moment; it says which and why."""
    doubtful = growing(on_order=True, share=0.5)
    same = judged(*[CALM] * 40, *[evidence(doubtful, orders=SPINDLE)] * 20)
    assert {verdict.state for verdict in same[-5:]} == {"approaching"}
    growth = [evidence(doubtful, orders=SPINDLE, rms=rms) for rms in (1.5, 3.0, *[6.0] * 20)]
    loud = judged(*[CALM] * 40, *growth)[-1]
    assert (loud.state, loud.frequency_hz) == ("self_excited", HZ)
    assert loud.reasons == [f"the vibration at {HZ:.0f} Hz has risen, and the cut is 15 dB louder than before"]


@pytest.mark.parametrize(
    ("beyond", "risen", "state"),
    [(0.7, 0.7, "approaching"), (0.9, 0.9, "self_excited"), (0.6, 0.9, "self_excited"), (0.3, 0.9, "approaching")],
)
def test_a_cut_gets_loud_by_a_line_only_if_that_has_got_louder(beyond, risen, state):
    """One that is as loud as it was for seconds is not why the cut got loud, nor is one whose surroundings are, too."""
    suspicious = [evidence(growing(on_order=True, share=0.5), orders=SPINDLE)] * 20
    line = Line(HZ, 0.5, 30.0, 0.02, 0.0, 0.0, beyond, risen, 0.99)
    stays = Vibration(line, mode(0.0), *[Place(True, 0.2)] * 2)
    loud = [evidence(stays, orders=SPINDLE, rms=rms) for rms in (1.5, 3.0, *[6.0] * 20)]
    assert states(*[CALM] * 40, *suspicious, *loud)[-1] == state


@pytest.mark.parametrize(
    ("orders", "on_order", "alarm"), [(TOLD, True, False), (TOLD, False, True), (SPINDLE, True, True)]
)
def test_a_cut_gets_loud_by_no_order_of_a_speed_that_is_not_heard_yet(orders, on_order, alarm):
    """What is on one may be what turns, until that is heard; a spindle that is heard is taken out by then."""
    share = 0.5 if on_order else 0.35
    suspicious = [evidence(growing(on_order=on_order, share=share), orders=orders)] * 3
    line = Line(HZ, share, 30.0, 0.02, 0.0, 0.0, 0.9, 0.9, 0.99)
    stays = Vibration(line, mode(0.0), *[Place(on_order, 0.2)] * 2)
    loud = [evidence(stays, orders=orders, rms=rms) for rms in (1.5, 3.0, *[6.0] * 20)]
    assert (states(*[CALM] * 40, *suspicious, *loud)[-1] == "self_excited") is alarm


@pytest.mark.parametrize(
    ("about", "orders", "warned"),
    [
        ({}, UNKNOWN_SPEED, True),
        ({"share": 0.1}, UNKNOWN_SPEED, False),
        ({"long_rise": 0.4}, UNKNOWN_SPEED, False),  # its surroundings have risen as well
        ({"absolute_rise": 0.4}, UNKNOWN_SPEED, False),
        ({"coherence": 0.2}, UNKNOWN_SPEED, False),
        ({"on_order": True}, SPINDLE, False),
        ({"on_order": False}, SPINDLE, True),
        ({}, TURNING._replace(lines=()), True),  # what is left of a cut that turns may be on its way, too
    ],
)
def test_what_gets_louder_is_a_warning(about, orders, warned):
    """A narrow line with a fifth of the power, off the orders as far as is known, twice as loud as it was."""
    about = {"share": 0.4, "long_rise": 0.9, "absolute_rise": 0.9, "coherence": 0.6, "on_order": None} | about
    on_order = about.pop("on_order")
    line = Line(HZ, 0.4, 12.0, 0.5, 0.0, 0.2, 0.9, 0.9, 0.6)._replace(**about)
    place = (None, None) if on_order is None else [Place(on_order, 0.2)] * 2
    said = judged(*[CALM] * 10, *[evidence(Vibration(line, mode(0.02), *place), orders=orders)] * 10)[-1]
    assert (said.state == "approaching") == warned
    if warned:
        assert said.reasons == [f"the vibration at {HZ:.0f} Hz is louder than it has been for seconds"]
        assert said.frequency_hz == HZ


def test_what_is_quieter_than_the_cut_before_is_no_alarm():
    """What grows by itself comes on top of the cut: a pump that begins when it is over has a share of what is left."""
    begun, stays = (evidence(line, rms=0.3) for line in (growing(), steady()))
    before = [evidence(rms=1.0)] * 100
    assert "self_excited" not in states(*before, *[begun] * 20, *[stays] * 400)
    assert "self_excited" in states(*[evidence(rms=0.3)] * 100, *[begun] * 20)


@pytest.mark.parametrize("after", [SILENCE, evidence(rms=4.0, entering=True), evidence(rms=4.0, orders=MILL)])
def test_no_alarm_outlasts_what_explains_it(after):
    """Nothing is cut any more; another cut begins; what turns has been found: what was loud needs another alarm."""
    onset = [CALM] * 40 + [evidence(growing(), rms=4.0)] * 20
    loud = [evidence(rms=4.0)] * 100
    going_on = states(*onset, *loud)
    assert going_on[-1] == "self_excited"
    assert "self_excited" not in states(*onset, *loud, after, *[evidence(rms=4.0, orders=after.orders)] * 20)[-20:]


@pytest.mark.parametrize(("alarms", "is_withdrawn"), [(1, True), (2, False)])
def test_an_alarm_is_withdrawn_when_a_tool_is_heard_to_enter(alarms, is_withdrawn):
    """It is heard a moment later; that the line has chattered is not remembered."""
    room = [evidence(rms=0.1)] * 40
    begins = [evidence(growing(), rms=4.0)] * alarms
    enters = [evidence(cutting=False, entering=True, rms=4.0)] * 4
    goes_on = [evidence(steady(), rms=4.0)] * 40
    judge, log = Judge(JudgeSettings()), EventLog("test", SpindleSettings())
    everything = [*room, *begins, *enters, *goes_on]
    seen = [judge.verdict(e, 640 * i, 640, 12_800.0) for i, e in enumerate(everything)]
    assert {verdict.state for verdict in seen[40 : 40 + alarms]} == {"self_excited"}
    assert (reasons.CAME_WITH_TOOL in seen[40 + alarms].reasons) is is_withdrawn
    assert ("self_excited" in {verdict.state for verdict in seen[40 + alarms :]}) is not is_withdrawn
    event, *_ = filter(None, map(log.follow, seen))
    assert event.withdrawn is is_withdrawn


@pytest.mark.parametrize(("on_order", "is_withdrawn"), [(True, True), (False, False)])
def test_an_alarm_is_withdrawn_when_the_spindle_explains_it(on_order, is_withdrawn):
    """A line that came at once is on an order of the told speed when that becomes heard; and it is not remembered."""
    told = Orders(0, 27.6, 0.4, "given", 0.0)
    silence = [evidence(orders=told, rms=1.0)] * 40
    before = [evidence(growing(), orders=told, rms=4.0)] * 20
    after = [evidence(steady(on_order=on_order, share=0.3), orders=SPINDLE, rms=4.0)] * 40
    again = [evidence(orders=SPINDLE, rms=1.0)] * 40 + [evidence(steady(share=0.3), orders=SPINDLE, rms=4.0)] * 5
    judge = Judge(JudgeSettings())
    seen = [judge.verdict(e, 640 * i, 640, 12_800.0) for i, e in enumerate([*silence, *before, *after, *again])]
    assert {verdict.state for verdict in seen[50:60]} == {"self_excited"}
    assert (reasons.WITHDRAWN in [reason for verdict in seen for reason in verdict.reasons]) is is_withdrawn
    assert ("self_excited" in {verdict.state for verdict in seen[80:100]}) is not is_withdrawn
    assert ("self_excited" in {verdict.state for verdict in seen[-5:]}) is not is_withdrawn


def test_an_alarm_whose_line_glides_away_ends():
    """What excites itself stays near its mode: what changes by 3 % a second goes with a spindle, however loud it is."""
    onset = [CALM] * 40 + [evidence(growing(), rms=4.0)] * 20
    stays, glides = ([evidence(steady(HZ * ratio**i), rms=4.0) for i in range(60)] for ratio in (1.0, 0.9985))
    assert set(states(*onset, *stays)[-60:]) == {"self_excited"}
    assert "self_excited" not in states(*onset, *glides)[-30:]


@pytest.mark.parametrize("pause", [CALM, SILENCE])
def test_what_has_chattered_chatters_again(pause):
    """Within a minute the same line, calm and loud again, is an alarm; it need not be seen to grow out of nothing."""
    seen = states(*ONSET, *[pause] * 60, *[STAYS] * 20)
    assert "self_excited" not in seen[len(ONSET) + 20 : len(ONSET) + 60]
    assert seen[-1] == "self_excited"
    assert states(*ONSET, *[pause] * 1300, *[STAYS] * 60)[-1] == "forced"


@pytest.mark.parametrize(("room", "again"), [(0.3, True), (1.0, False)])
def test_what_came_with_the_tool_has_not_chattered(room, again):
    """An alarm out of the same room that the tool leaves behind was the tool that entered: it is not remembered."""
    loud = evidence(growing(), rms=9.0)
    air = evidence(rms=room, cutting=False)
    stays = evidence(steady(), rms=9.0)
    seen = states(*[evidence(rms=1.0)] * 40, *[loud] * 20, *[air] * 10, *[stays] * 20)
    assert "self_excited" in seen[40:60]
    assert ("self_excited" in seen[70:]) is again


@pytest.mark.parametrize("after", [SILENCE, evidence(growing(), held=True), evidence(growing(), cutting=False)])
def test_idle_ends_the_alarm_at_once(after):
    """When the tool has left the cut there is nothing to alarm about, and the next interval is none."""
    assert states(*ONSET, after, CALM)[-2:] == ["idle", "stable"]


def test_loss_during_an_alarm_is_unknown_and_the_alarm_goes_on_after_it():
    """While nothing is heard nothing is claimed, and the alarm is not forgotten however long it takes."""
    assert states(*ONSET, *[LOST] * 100, STAYS)[len(ONSET) :] == ["unknown"] * 100 + ["self_excited"]


def test_loss_sets_no_level():
    """The level of samples that are not to be trusted does not make the cut look idle."""
    glitch = evidence(rms=1e6, flags=Flag.NON_FINITE)
    assert states(CALM, glitch, CALM) == ["stable", "unknown", "stable"]


def test_idle_is_relative_to_the_loudest_of_the_last_minute():
    """What is far below the level of cutting is idle, whatever its damping, until the loudness is forgotten."""
    quiet = evidence(critical=mode(), rms=1.5e-3)
    result = states(CALM, *[quiet] * 20 * 60)
    assert set(result[1 : 20 * 40]) == {"idle"}
    assert result[-1] == "stable"  # after a minute 1 has become 1 / e; 0.003 / e is below it


def test_one_click_does_not_hide_a_quiet_cut():
    """After a single interval ten thousand times as loud, the cut is not taken for idle."""
    quiet, click = evidence(critical=mode(), rms=1e-4), evidence(critical=mode(), rms=1.0)
    assert set(states(quiet, quiet, click, *[quiet] * 20)) == {"stable"}


def test_idle_is_known_soon_after_a_start_from_silence():
    """The level of cutting is learned within a second, however quiet it was before."""
    assert states(*[evidence(rms=1e-6)] * 3, *[CALM] * 20, evidence(rms=1e-4))[-1] == "idle"


def test_thresholds_are_those_of_the_settings():
    """Each threshold of the settings moves its border."""
    count = states(*ONSET).count("self_excited")
    assert states(*ONSET, alarm_probability=0.999999).count("self_excited") < count
    assert states(*ONSET, alarm_probability=0.2, calm_probability=0.1).count("self_excited") >= count
    line = growing().line._replace(rise=1.2, long_rise=1.2, absolute_rise=1.2)
    rises = [CALM] * 40 + [evidence(growing()._replace(line=line))] * 3
    assert any("begins to grow" in why for why in whys(*rises))
    assert not any("begins to grow" in why for why in whys(*rises, warning_probability=0.9))
    ending = [*ONSET, *[CALM] * 20]
    assert states(*ending, calm_probability=1e-9).count("self_excited") > states(*ending).count("self_excited")
    assert states(*[evidence(critical=mode(0.005))] * 2, approaching_damping=0.01)[-1] == "approaching"
    assert states(*[evidence(critical=mode(0.0025))] * 2, certainty=0.8)[-1] == "approaching"
    near = evidence(margin=Margin(margin_percent=20.0, margin_ci95=(15.0, 25.0)))
    assert states(near) + states(near, approaching_margin_percent=30.0) == ["stable", "approaching"]
    assert states(*[evidence(steady(share=0.2))] * 60, forced_share=0.05)[-1] == "forced"
    assert states(CALM, evidence(rms=0.05), idle_ratio=0.1)[-1] == "idle"


def test_an_alarm_cannot_end_before_it_begins():
    """Settings with which an alarm would flicker are refused."""
    with pytest.raises(ValueError, match=r"calm_probability must not be above alarm_probability \(0.3\), got 0.5"):
        JudgeSettings(alarm_probability=0.3)


def test_changed_thresholds_keep_what_is_remembered():
    """Other thresholds count from the next interval on; an alarm that is running goes on."""
    judge = Judge(JudgeSettings())
    for i, each in enumerate(ONSET):
        judge.verdict(each, 640 * i, 640, 12_800.0)
    judge.set_thresholds(JudgeSettings(alarm_probability=0.99))
    assert judge.verdict(STAYS, 640 * len(ONSET), 640, 12_800.0).state == "self_excited"


def test_a_word_is_as_sure_as_that_it_chatters_or_does_not():
    """An alarm has the probability of chatter itself; all else what is left, times how likely the word is then."""
    told = judged(*ONSET, *before(), *[surging()] * 3, *[evidence(orders=TURNING)] * 60)
    for verdict in told:
        if verdict.state == "self_excited":
            assert verdict.confidence == verdict.chatter_probability
        elif verdict.state != "unknown":
            assert verdict.confidence <= 1.0 - verdict.chatter_probability
    assert {verdict.state for verdict in told} >= {"self_excited", "approaching", "stable", "forced"}
    assert max(verdict.confidence for verdict in told if verdict.state == "self_excited") > 0.98
    calm = told[len(ONSET) // 2]  # with nothing heard as forced it is stable, but for one or two in a hundred
    assert calm.confidence == pytest.approx(0.987 * (1.0 - calm.chatter_probability), abs=0.001)


def test_chatter_is_the_likelier_the_louder_it_is():
    """What is called stable in a cut four times as loud as the last ones may well be chatter, in air nothing is."""
    usual, loud, air, lossy = judged(*[evidence()] * 40, evidence(rms=4.0), SILENCE, LOST)[-4:]
    assert [v.state for v in (usual, loud, air, lossy)] == ["stable", "stable", "idle", "unknown"]
    assert usual.chatter_probability < 0.02
    assert 0.05 < loud.chatter_probability < 0.5
    assert (air.chatter_probability, lossy.chatter_probability) == (0.0, None)


def test_an_alarm_is_never_usual():
    """However long it lasts, it is four times as loud as the cut that it began in."""
    judge = Judge(JudgeSettings())
    for i, each in enumerate([*[CALM] * 40, *[evidence(growing(), rms=4.0)] * 500]):
        judge.verdict(each, 640 * i, 640, 12_800.0)
    assert judge.memory.louder == pytest.approx(math.log(4.0))


def test_the_usual_level_is_that_of_the_cuts_before():
    """A cut in which chatter began unheard is held against the one before it."""
    assert judged(*[evidence()] * 40, *[SILENCE] * 10, *[evidence(rms=4.0)] * 15)[-1].chatter_probability > 0.05


REPEATS = UNKNOWN_SPEED._replace(repeating_share=0.45)


def surging(rms=2.7, long_rise=0.8, absolute_rise=1.5, repeating=0.45):
    """A cut, some of which repeats, that is louder from one moment to the next, and its line, not coherent yet."""
    line = Vibration(Line(HZ, 0.6, 20.0, 1.2, 10.0, 0.5, long_rise, absolute_rise, 0.2), None)
    return evidence(line, rms=rms, orders=REPEATS._replace(repeating_share=repeating))


def before(repeating=0.45):
    return [evidence(orders=REPEATS._replace(repeating_share=repeating))] * 10


def test_a_surge_is_a_warning_while_it_is_news():
    """A cut that is 2.7 times as loud, by a line that has risen by itself, is warned of for a quarter of a second."""
    told = judged(*before(), *[surging()] * 8)[10:]
    assert [verdict.state for verdict in told] == ["approaching"] * 5 + ["stable"] * 3
    assert told[0].reasons == [
        "the vibration at 1067 Hz has risen, and the cut is 2.7 times as loud as half a second ago"
    ]
    assert told[0].frequency_hz == HZ


@pytest.mark.parametrize(
    "louder",
    [
        surging(rms=2.0),  # not much
        surging(absolute_rise=0.7),  # the line has not risen
        surging(long_rise=0.0),  # a load: all has
        evidence(rms=2.7, orders=REPEATS),  # no line
    ],
)
def test_what_is_no_surge(louder):
    """Of a cut that is not twice as loud, or louder by no line of its own, nothing is said."""
    assert set(states(*before(), *[louder] * 5)) == {"stable"}


def test_a_tool_that_enters_unheard_is_no_surge():
    """In a room next to nothing repeats; what comes out of that may be a cut that begins."""
    assert "approaching" not in states(*before(repeating=0.08), *[surging()] * 5)


def test_another_cut_is_no_surge():
    """What was heard before the tool left the cut is not what the next one is held against."""
    assert "approaching" not in states(*before(), SILENCE, *[surging()] * 5)


def test_a_surge_is_the_less_sure_where_the_usual_is_known():
    """After half a second nobody knows what is usual; after one and a half it is 2.7 times as loud as that."""
    early, late = (judged(*before() * times, surging())[-1] for times in (1, 3))
    assert (early.state, late.state) == ("approaching", "approaching")
    assert (early.confidence, late.confidence) == (pytest.approx(0.674, abs=0.002), pytest.approx(0.595, abs=0.002))


def test_a_surge_outweighs_what_turns():
    """It is warned of where more than half of the power turned until then."""
    turning = evidence(orders=TURNING._replace(repeating_share=0.9))
    assert states(*[turning] * 10, surging(rms=4.0))[-2:] == ["forced", "approaching"]


def test_a_warning_is_the_less_sure_the_more_is_forced():
    """What warns in a cut that is forced for certain is wrong two times in three, if it is no chatter."""
    vibration = Followed(HZ, Kinds(0.6, 0.2, 0.0, 0.2), unexplained=1.0, heard=steady())
    memories = [remembered(vibration)._replace(forced_share=share) for share in (0.0, 0.645, 1.0)]
    views = [opinion(evidence(steady()), memory, JudgeSettings()) for memory in memories]
    assert {view.state for view in views} == {"approaching"}
    assert [view.right for view in views] == pytest.approx([0.99, 0.67, 0.37], abs=0.01)


def test_forced_and_stable_are_as_sure_as_the_share_tells():
    """With next to nothing heard as forced no cut is, with all of it all are; it does not flicker."""
    border = JudgeSettings().forced_share
    memories = [Memory(1.0, forced_share=share) for share in (0.0, border, 0.7, 1.0)]
    views = [opinion(evidence(), memory, JudgeSettings()) for memory in memories]
    assert [view.state for view in views] == ["stable", "stable", "forced", "forced"]
    assert [view.right for view in views] == pytest.approx([0.99, 0.85, 0.63, 0.96], abs=0.01)
    before = Memory(1.0, forced_share=border - 0.04, forced=True)
    assert opinion(evidence(), before, JudgeSettings()).state == "forced"


def test_what_repeats_is_forced_at_once():
    """Most of the power repeats after a rotation: forced, whatever is known of lines and combs; half of it: stable."""
    for share, state in ((0.9, "forced"), (0.4, "stable")):
        assert states(evidence(orders=UNKNOWN_SPEED._replace(repeating_share=share))) == [state]


def test_what_is_forced_because_it_repeats_says_so():
    """Whether a line is steady beside it or none is: what is said is what the state comes from."""
    orders = UNKNOWN_SPEED._replace(repeating_share=0.9)
    why = ["90 % of the power repeats after a rotation or several"]
    assert judged(evidence(orders=orders))[-1].reasons == why
    faint = judged(*[evidence(steady(share=0.1), orders=orders)] * 60)[-1]
    assert (faint.state, faint.reasons) == ("forced", why)
    loud = judged(*[evidence(steady(share=0.9), orders=orders)] * 60)[-1]
    assert loud.reasons == ["the vibration at 1067 Hz is steady and was not seen to grow: something forces it"]


def test_a_comb_that_is_lost_is_no_reason():
    """What turned until just now is still most of the average, but no multiples are named that are not heard."""
    lost = judged(*[evidence(orders=TURNING)] * 60, evidence(orders=UNKNOWN_SPEED))[-1]
    assert (lost.state, lost.reasons) == ("forced", ["most of the power was steady until just now"])


def test_what_has_chattered_repeats_and_is_not_forced():
    """The share of a vibration that has chattered does not count as forced while it rings on."""
    orders = UNKNOWN_SPEED._replace(repeating_share=0.9)
    assert repeating_share(orders, Told(Overview(chattered_share=0.8))) == pytest.approx(0.1)
    assert repeating_share(orders, Told()) == 0.9


def test_what_regenerates_is_not_forced():
    """It repeats from rotation to rotation, too; it is a warning from the first interval in which it has grown."""
    orders = UNKNOWN_SPEED._replace(repeating_share=0.9)
    assert states(evidence(orders=orders)) == ["forced"]
    assert states(evidence(orders=orders._replace(growth=0.5))) == ["approaching"]


def test_a_tool_that_enters_cuts():
    """While the tool enters it is not idle; forced as soon as it repeats, never an alarm."""
    enters = [evidence(growing(), cutting=False, entering=True)] * 20
    assert set(states(CALM, *enters)) == {"stable"}
    repeats = evidence(cutting=False, entering=True, orders=UNKNOWN_SPEED._replace(repeating_share=0.9))
    assert states(evidence(cutting=False), repeats) == ["idle", "forced"]


vibrations = st.lists(
    st.builds(growing, st.sampled_from([400.0, HZ]), st.floats(-0.01, 0.1), on_order=st.booleans())
    | st.builds(steady, st.sampled_from([400.0, HZ]), st.floats(-0.01, 0.1), on_order=st.booleans()),
    max_size=3,
)
intervals = st.builds(
    lambda lines, **about: evidence(*lines, **about),
    vibrations,
    critical=st.none() | st.builds(mode, st.sampled_from([0.02, 0.001, -0.01])),
    orders=st.sampled_from([UNKNOWN_SPEED, MILL, TURNING]),
    rms=st.sampled_from([0.0, 1e-4, 0.3, 1.0]),
    flags=st.sampled_from(list(Flag)),
    cutting=st.booleans(),
    held=st.booleans(),
    starting=st.booleans(),
)


@settings(max_examples=200, derandomize=True, deadline=None)
@given(st.lists(intervals, max_size=40))
def test_whatever_happens(history):
    """For any history: deaf is unknown and unknown has a cause, every verdict has a reason, intervals join."""
    verdicts = judged(*history)
    for verdict, interval in zip(verdicts, history, strict=True):
        if interval.flags & DEAF:
            assert verdict.state == "unknown"
        if verdict.state == "unknown":
            assert interval.flags & DEAF or interval.starting
        assert verdict.reasons
        assert 0.0 <= verdict.confidence <= 1.0
    for before, after in pairwise(verdicts):
        assert before.sample1 == after.sample0


def test_a_speed_that_is_not_believed_is_told_of_while_something_is_cut():
    """Whatever the state is; what turns while nothing is cut may be another machine."""
    judge = Judge(JudgeSettings())
    doubted = UNKNOWN_SPEED._replace(doubted=True)
    for quiet in (False, True):
        verdict = judge.verdict(evidence(steady(), orders=doubted, cutting=not quiet), 0, 640, 12800.0)
        assert (verdict.state == "idle") is quiet
        assert (reasons.DOUBTED in verdict.reasons) is not quiet
    assert reasons.DOUBTED not in judge.verdict(evidence(steady()), 0, 640, 12800.0).reasons


@pytest.mark.parametrize(
    ("grown", "overtones", "outlasts"), [(True, True, True), (True, False, False), (False, True, False)]
)
def test_no_comb_of_a_vibration_itself_explains_it(grown, overtones, outlasts):
    """It is taken out then, line and all; but it had grown out of a mode, and nothing else turns."""
    beside = OrderLine(2, 2.0 * HZ, 0.1) if overtones else OrderLine(7, 165.6, 0.3)
    order, rotation_hz = (1, HZ) if overtones else (45, HZ / 45.0)
    found = Orders(0, rotation_hz, 0.01, "found", 0.95, (OrderLine(order, HZ, 0.9), beside))
    onset = [evidence(growing(), rms=8.0, grown=grown)] * 3 + [evidence(growing(), rms=8.0)] * 20
    taken_out = [evidence(steady(on_order=True, share=0.1), orders=found, rms=8.0)] * 100
    seen = states(*[CALM] * 40, *onset, *taken_out)
    assert set(seen[50:60]) == {"self_excited"}
    assert (set(seen[-40:]) == {"self_excited"}) is outlasts
