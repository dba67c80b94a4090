"""Each vibration by itself: the kernel against its naive twin, and what is promised of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.heard import ORDER_TOLERANCE_HZ, place
from chatter_monitor.kernels.kinds import LINE
from chatter_monitor.kernels.swings import LATER
from chatter_monitor.kernels.vibration import NO_LINE, VIBRATION
from chatter_monitor.kernels.vibrations import FORGOTTEN, FORGOTTEN_CHATTER, JUST_NOW, Odds, Rules, follow_all
from chatter_monitor.tracking.orders import OrderLine, Orders
from chatter_monitor.tracking.spectrum import Line
from chatter_monitor.verdict.evidence import Place, Vibration
from chatter_monitor.verdict.vibrations import Following, lines_of
from tests import naive
from tests.verdict.hearing import heard, interval

RULES = Rules(alarm_probability=0.8, calm_probability=0.5)
# Rising and coherent is growth, coherent and steady is calm.
WEIGHTS = np.array([[0, 0, 1, 0, 0, 0, 4, 0, 0, 0, 0, -6], [1, 0, 1, 0, -9, 1, 0, 0, 0, 0, 0, -2]], float)


def _place(rng, cycle):
    """Of a line on an order, until the comb is lost, and for a moment while it is found anew."""
    return rng.normal(-2.0, 0.5) if cycle < 80.0 or 100.0 < cycle < 103.0 else Odds().unknown_speed


def shift(seed, intervals):
    """Lines of intervals: some vibrations come and go, wander, rise and die down, in company of passing noise."""
    rng = np.random.default_rng(seed)
    centres_hz = rng.uniform(60.0, 3000.0, 4)
    phases = rng.uniform(0.0, 200.0, 4)
    for i in range(intervals):
        rows = []
        power = rng.uniform(1.0, 10.0)
        for number, (centre_hz, phase) in enumerate(zip(centres_hz, phases, strict=True)):
            cycle = (i + phase) % 200.0
            if cycle < 150.0:
                rising = 3.0 if 20.0 < cycle < 60.0 else -1.0 if cycle > 130.0 else 0.0
                rows.append(
                    (
                        centre_hz * (1.0 + 0.01 * rng.standard_normal())
                        if number
                        else centre_hz * np.exp(0.003 * min(cycle, 30.0) + 1e-4 * rng.standard_normal()),
                        rng.uniform(0.1, 0.9),
                        25.0,
                        0.1,
                        0.0,
                        rng.uniform(0.0, 3.0) if rising > 0.0 else 0.5,
                        max(rising, 0.0) if number == 1 else rising,  # one dies down with its surroundings
                        -1.0 if number == 1 and rising < 0.0 else rising + 1.0,
                        rising,
                        rng.uniform(0.7, 1.0),
                        0.01,
                        _place(rng, cycle) if number == 1 else rng.normal(0.0, 1.5),
                        rng.choice((1.0, 0.3)),
                        rng.choice((0.0, 0.4, 0.9), p=(0.8, 0.1, 0.1)) if number == 2 else 0.0,
                        power,
                        rng.choice((0.0, 0.7, 1.4)) if number == 3 else 0.0,
                        number == 3 and rng.random() < 0.3,
                    )
                )
        for hertz in rng.uniform(50.0, 6000.0, rng.integers(0, 4)):
            about = (8.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, rng.uniform(0.0, 0.9), 0.03, -0.7, 0.01, 0.0, power, 0.0, False)
            rows.append((hertz, 0.01, *about))
        yield np.array(rows, LINE)


def followed(before, lines, rules=RULES):
    room = len(before) + len(lines)
    vibrations, work = np.zeros((2, room), VIBRATION)
    vibrations[: len(before)] = before
    return vibrations[: follow_all(vibrations, len(before), lines, rules, WEIGHTS, np.empty(room, bool), work)]


@pytest.mark.parametrize("seed", range(3))
def test_following_is_that_of_the_twin(seed):
    """Over a minute of lines that come and go every vibration has the twin's probabilities, alarms and memory."""
    known, twins = np.zeros(0, VIBRATION), []
    alarms = chattered = forgotten = glided = 0
    for lines in shift(seed, 1200):
        count = len(twins)
        known, twins = followed(known, lines.copy()), naive.follow_all(twins, list(lines), RULES, WEIGHTS)
        forgotten += count + len(lines) - len(twins)
        assert known["frequency_hz"].tolist() == [twin.hertz for twin in twins]
        kinds = np.column_stack([known[name] for name in ("noise", "growing", "saturated", "steady")])
        np.testing.assert_allclose(kinds, [twin.kinds for twin in twins], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(known["unexplained"], [twin.unexplained for twin in twins], rtol=1e-9)
        assert known["alarm_for"].tolist() == [twin.alarm_for for twin in twins]
        assert known["chattered"].tolist() == [twin.chattered for twin in twins]
        assert known["missed"].tolist() == [twin.missed for twin in twins]
        np.testing.assert_allclose(known["rise"], [twin.rise for twin in twins], rtol=1e-9, atol=1e-12)
        alarms += np.sum(known["alarm_for"] == 1)
        chattered += np.sum(known["chattered"] & (known["alarm_for"] == 0))
        glided += np.sum(known["glided"] > 0)
    assert min(alarms, chattered, forgotten, glided) > 0  # all of it has been tried


@pytest.mark.parametrize(("chattered", "limit"), [(False, FORGOTTEN), (True, FORGOTTEN_CHATTER)])
def test_what_is_not_heard_is_forgotten(chattered, limit):
    """Half a second without its line and a vibration is forgotten; a minute if it has chattered."""
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["noise"], known["chattered"] = 1000.0, 1.0, chattered
    for missed in range(1, limit):
        known = followed(known, np.empty(0, LINE))
        assert known["missed"].tolist() == [missed]
    assert not len(followed(known, np.empty(0, LINE)))


def test_a_line_that_is_heard_renews_no_memory():
    """What has chattered is known for a minute after the alarm, though some line of noise is near it all the time."""
    known, noise = np.zeros(1, VIBRATION), lines_of(interval(1000.0, rising=False), Odds())
    known["frequency_hz"], known["noise"], known["chattered"] = 1000.0, 1.0, True
    noise["coherence"], noise["variation"] = 0.1, 0.5
    for _ in range(FORGOTTEN_CHATTER - 1):
        known = followed(known, noise)
        assert known["chattered"].tolist() == [True]
    assert followed(known, noise)["chattered"].tolist() == [False]


@pytest.mark.parametrize(("remembered", "renews"), [(True, False), (False, True)])
def test_an_alarm_that_needed_the_memory_does_not_renew_it(remembered, renews):
    """It is forgotten a minute after the first one, unless it comes to another by itself."""
    known, half = np.zeros(1, VIBRATION), FORGOTTEN_CHATTER // 2
    known["frequency_hz"], known["noise"], known["power"], known["chattered"] = 1000.0, 1.0, 1.0, remembered
    known["own"] = known["over"] = half if remembered else 0
    lines = lines_of(interval(1000.0), Odds())
    lines["dominance"], lines["order_odds"] = 1.0, 3.0
    alarms = 0
    for _ in range(40):
        known = followed(known, lines)
        alarms += int(known["alarm_for"][0] > 0)
    assert 10 < alarms <= 40
    for _ in range(half):
        known = followed(known, np.empty(0, LINE))
    assert bool(len(known)) is renews


@pytest.mark.parametrize(
    ("hertz", "missed", "away", "same"),
    [
        (1500.0, 0, 0.05, True),
        (1500.0, 0, 0.07, False),
        (1500.0, 200, 0.025, True),
        (1500.0, 200, 0.04, False),
        (110.0, 0, 0.2, True),
        (110.0, 200, 0.04, True),
        (110.0, 200, 0.07, False),
    ],
)
def test_after_a_silence_the_same_vibration_is_nearer(hertz, missed, away, same):
    """A line is followed for some per cent or 25 Hz; what chattered some passes ago has to come back where it was."""
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["chattered"], known["noise"], known["missed"] = hertz, True, 1.0, missed
    line = lines_of(interval(hertz * np.exp(away)), Odds())
    assert len(followed(known, line)) == (1 if same else 2)


@pytest.mark.parametrize(("unheard", "glided"), [(False, 49), (True, 50)])
def test_a_glide_is_remembered_until_the_spindle_is_heard_again(unheard, glided):
    """Where a speed is known and not heard; else for some seconds."""
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["noise"], known["glided"] = 1000.0, 1.0, 50
    (vibration,) = followed(known, lines_of(interval(1000.0), Odds()), RULES._replace(unheard=unheard))
    assert vibration["glided"] == glided


@pytest.mark.parametrize(("carrier", "alarm"), [(False, False), (True, True)])
def test_what_has_sidebands_glides_with_no_spindle(carrier, alarm):
    """A bar that gives way takes its chatter along; where sidebands tell that no spindle does, it is an alarm."""
    known = np.zeros(0, VIBRATION)
    for i in range(40):
        lines = lines_of(interval(1000.0 * np.exp(-0.003 * i)), Odds())
        lines["carrier"] = carrier
        known = followed(known, lines)
    assert (known["glided"][0] == 0, known["alarm_for"][0] > 0) == (carrier, alarm)


@pytest.mark.parametrize("unheard", [False, True])
@pytest.mark.parametrize(
    ("other_hz", "glided", "along"), [(500.0, 90, True), (2000.0, 90, True), (510.0, 90, False), (500.0, 0, False)]
)
def test_what_is_in_step_with_what_glides_is_taken_along(other_hz, glided, along, unheard):
    """A resonance of the third multiple of the teeth, while the spindle that has the others along changes its speed.

    That counts at once where nothing else tells what turns, as where a told speed is not heard.
    """
    known, rules = np.zeros(2, VIBRATION), RULES._replace(unheard=unheard)
    known["frequency_hz"], known["noise"], known["glided"] = (1000.0, other_hz), 1.0, (0, glided)
    lines = lines_of(interval(1000.0, other_hz), Odds())
    lines["order_odds"] = 2.0
    (first,) = (v for v in followed(known, lines.copy(), rules) if v["frequency_hz"] == 1000.0)
    assert (first["order_odds"] < 0.5) == (along and unheard)
    for _ in range(20):
        known = followed(known, lines.copy(), rules)
    (vibration,) = (v for v in known if v["frequency_hz"] == 1000.0)
    assert (vibration["glided"] > 0, vibration["alarm_for"] > 0) == (along, not along)


@pytest.mark.parametrize(("glided", "chattered", "saturated"), [(2, True, 1.0), (1, False, 0.0)])
def test_what_has_risen_while_it_glided_is_explained(glided, chattered, saturated):
    """When a glide has been long ago, what it explained is no alarm: a calm line has to rise anew."""
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["saturated"], known["chattered"], known["glided"] = 1000.0, 1.0, True, glided
    (vibration,) = followed(known, lines_of(interval(1000.0, rising=False), Odds()))
    assert vibration["chattered"] == chattered
    assert vibration["saturated"] == pytest.approx(saturated, abs=0.01)
    assert vibration["alarm_for"] == 0


def test_a_line_belongs_to_the_vibration_that_is_nearest():
    """A suspicious one that wanders does not take the line of one that was followed there, with its own past."""
    known = np.zeros(2, VIBRATION)
    known["frequency_hz"], known["growing"], known["steady"] = (1050.0, 1000.0), (0.5, 0.0), (0.5, 1.0)
    known["unexplained"], known["glided"] = 0.9, (0, 50)
    both = followed(known, lines_of(interval(1005.0, 1045.0), Odds()))
    assert sorted(both[["frequency_hz", "glided"]].tolist()) == [(1005.0, 49), (1045.0, 0)]
    one = followed(known, lines_of(interval(1005.0), Odds()))
    assert sorted(one[["frequency_hz", "glided", "missed"]].tolist()) == [(1005.0, 49, 0), (1050.0, 0, 1)]


def test_each_is_told_with_the_line_that_is_its_own():
    """However the lines are sorted, each vibration is told with the one near it, and with none when it is silent."""
    following = Following()
    following.follow(interval(500.0, 1000.0, 2000.0), RULES)
    told = following.follow(interval(2010.0, 505.0), RULES)
    assert dict(told.vibrations[["frequency_hz", "line"]].tolist()) == {2010.0: 0, 505.0: 1, 1000.0: NO_LINE}
    assert told.suspect.heard.line.frequency_hz == told.suspect.frequency_hz


def test_what_follows_a_change_of_speed_is_forced():
    """A line that rises is an alarm; not one whose frequency has glided with the spindle, even if it does no more."""

    def alarms(glide):
        following, result = Following(), []
        for i in range(80):
            seen = interval(1000.0 * np.exp(glide * min(i, 30)), rising=i >= 20)
            result.append(following.follow(seen, RULES).alarm is not None)
        return result

    assert all(alarms(0.0)[40:])
    assert not any(alarms(0.002))


@pytest.mark.parametrize(
    ("taken", "away_hz", "share"), [(0.0, 0.0, 1.0), (1.0, 5.0, 0.5), (2.0, 20.0, 0.2), (2.0, 40.0, 1.0)]
)
def test_what_is_left_beside_an_order_is_a_share_of_what_was_there(taken, away_hz, share):
    """Beside an order, the power of a line counts over that and what was taken out there; farther off all of it."""
    orders = Orders(0, 50.0, 0.01, "refined", 0.0, (OrderLine(20, 1000.0 + away_hz, taken * math.sqrt(0.9)),))
    lines = lines_of(interval(1000.0)._replace(orders=orders), Odds())
    assert lines["dominance"] == pytest.approx(0.9 * share)


@pytest.mark.parametrize("taken_before", [False, True])
def test_an_order_that_was_taken_out_in_the_interval_before_is_no_new_line(taken_before):
    """A comb is lost: what is heard where it was, as loud as it was, takes no power of its own."""
    following = Following()
    comb = Orders(0, 50.0, 0.01, "refined", 0.9, (OrderLine(20, 1000.0, math.sqrt(0.9)),))
    if taken_before:
        following.follow(interval()._replace(orders=comb), RULES)
    lost = comb._replace(synchronous_share=0.0, lines=())
    told = following.follow(interval(1000.0)._replace(orders=lost), RULES)
    assert told.vibrations["dominance"] == pytest.approx(0.0 if taken_before else 0.9)


def at_its_place(vibration, rotation_hz):
    """A vibration with its place among the orders of this rotation."""
    if rotation_hz is None:
        return vibration
    found = Place(*place(vibration.line.frequency_hz, (rotation_hz, 1e-4, False), 1, ORDER_TOLERANCE_HZ))
    return vibration._replace(place=found, teeth=found)


@pytest.mark.parametrize(("rotation_hz", "overtones"), [(30.0, 2), (100.0, 0), (None, 0)])
def test_overtones_count_off_the_orders(rotation_hz, overtones):
    """What chatter takes of the power is that of its overtones, too; not so on an order, or if none is known."""
    seen = interval(500.0, 1004.0, 1497.0, 1530.0)
    seen = seen._replace(vibrations=heard(at_its_place(seen.vibrations[0], rotation_hz), *seen.vibrations[1:]))
    shares = [v.line.share for v in seen.vibrations]
    assert lines_of(seen, Odds())["dominance"] == pytest.approx([sum(shares[: 1 + overtones]), *shares[1:]])


@pytest.mark.parametrize(
    ("source", "share", "rotation_hz", "orders", "same_cut", "counts"),
    [
        ("refined", 0.1, 30.0, [1], False, True),
        ("refined", 0.0, 30.0, [], False, False),  # it is not heard
        ("refined", 0.0, 30.0, [], True, True),  # but what forces the cut is the same as before
        ("refined", 0.1, 30.0, [], False, False),  # another comb is, not the spindle's
        ("found", 0.1, 30.0, [1], False, False),  # any comb: a new job brings another
        ("found", 0.1, 30.0, [1], True, True),  # that of the passes before
        ("refined", 0.1, 100.0, [1], False, False),  # on an order
        ("found", 0.1, 100.0, [1], True, False),
    ],
)
def test_what_is_new_in_a_cut_has_risen_off_the_orders_of_a_known_spindle(
    source, share, rotation_hz, orders, same_cut, counts
):
    """A line that was in no cut before, nor in the air, counts as risen by as much where nothing else explains it."""
    seen = interval(495.0, rising=False)
    vibration = at_its_place(seen.vibrations[0], rotation_hz)
    vibration = vibration._replace(line=vibration.line._replace(news=2.0))
    lines = tuple(OrderLine(order, order * rotation_hz, 0.1) for order in orders)
    turning = Orders(0, rotation_hz, 0.01, source, share, lines)
    seen = seen._replace(orders=turning, vibrations=heard(vibration), same_cut=same_cut)
    expected = 2.0 if counts else 0.0
    assert lines_of(seen, Odds())[["long_rise", "absolute_rise"]].tolist() == [(expected, expected)]


@pytest.mark.parametrize(
    ("long_rise", "absolute_rise", "over"),
    [(0.0, 0.0, False), (-1.1, 1.3, False), (-1.1, -0.3, True), (0.3, -0.8, True)],
)
def test_chatter_is_over_when_it_is_fainter(long_rise, absolute_rise, over):
    """It is over far below what it was, in itself or beyond its surroundings; not while it is louder than it was."""
    following = Following()
    for _ in range(40):
        following.follow(interval(1000.0), RULES)
    seen = interval(1000.0, rising=False)
    vibration = seen.vibrations[0]
    line = vibration.line._replace(long_rise=long_rise, absolute_rise=absolute_rise)
    for _ in range(20):
        told = following.follow(seen._replace(vibrations=heard(vibration._replace(line=line))), RULES)
    assert (told.alarm is None) is over


@pytest.mark.parametrize(("times", "again"), [(0.9, False), (1.9, False), (3.0, True)])
def test_what_is_as_loud_as_before_it_chattered_does_not_chatter(times, again):
    """When an alarm is over the mode goes on in the noise, as coherent at times as chatter, but no louder than ever."""
    known = np.zeros(0, VIBRATION)
    grows, calm = (lines_of(interval(475.0, rising=rising), Odds()) for rising in (True, False))
    for lines, intervals in ((grows, 20), (calm, 60)):
        for i in range(intervals):
            seen = lines.copy()
            seen["dominance"], seen["order_odds"], seen["power"] = 0.95, 1.3, 1.0
            if lines is calm:  # for two seconds it is noise, then it looks like something calm
                seen["power"] = times * math.exp(-2.0 * grows["absolute_rise"][0])
                seen["coherence"], seen["variation"] = (0.1, 0.5) if i < 40 else (0.99, 0.02)
            known = followed(known, seen)
        assert bool(known["chattered"][0])
        assert (known["alarm_for"][0] > 0) == (lines is grows or again)


@pytest.mark.parametrize(("times", "goes_on"), [(0.9, False), (1.1, True)])
def test_an_alarm_ends_when_it_has_no_more_power_than_before_it_rose(times, goes_on):
    """However coherent it is: a forced line at its place takes over when it dies down."""
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["saturated"], known["order_odds"] = 475.0, 1.0, 2.9
    known["alarm_for"], known["chattered"], known["power"], known["calm"] = 50, True, 1.0, 0.9
    for _ in range(20):
        lines = lines_of(interval(475.0, rising=False), Odds())
        lines["dominance"], lines["order_odds"], lines["power"] = 0.95, 2.9, times  # of which the line has 0.9
        known = followed(known, lines)
    assert bool(known["alarm_for"][0] > 0) is goes_on


@pytest.mark.parametrize("rests", [False, True])
def test_how_loud_a_cut_was_while_calm_says_nothing_of_the_next(rests):
    """What has chattered is told at once in a lighter pass, as loud as it was in the last one before it chattered."""
    following, fainter = Following(), math.sqrt(0.9 * math.exp(-6.0))
    for _ in range(20):
        following.follow(interval(1000.0), RULES)
    if rests:
        following.rest()
    for _ in range(10):
        told = following.follow(interval(1000.0, rising=False)._replace(rms=fainter), RULES)
    assert (told.alarm is not None) is rests


@pytest.mark.parametrize(
    ("chattered", "over", "risen", "alarm"),
    [
        (True, 0, True, True),
        (True, JUST_NOW - 1, True, True),
        (True, JUST_NOW, True, False),
        (False, 0, True, False),
        (True, 0, False, False),
    ],
)
def test_chatter_that_jumps_stays_an_alarm(chattered, over, risen, alarm):
    """What has risen, between both thresholds, is an alarm for two seconds after another; it is none later."""
    lines = lines_of(interval(475.0), Odds())
    lines["dominance"], lines["order_odds"] = 0.66, -0.4  # 0.77 by its share and place, and 0.8 is asked for
    lines["rise"] = 0.0  # nothing new
    known = np.zeros(2, VIBRATION)
    known["frequency_hz"], known["saturated"], known["noise"] = (645.0, 475.0), (0.0, risen), (1.0, not risen)
    known["dominance"], known["order_odds"], known["missed"] = 0.66, -0.4, (3, 0)
    known["chattered"], known["over"] = (chattered, False), (over, 0)
    after = followed(known, lines)
    assert (after["alarm_for"][after["frequency_hz"] == 475.0] > 0).tolist() == [alarm]


@pytest.mark.parametrize(("dominance", "alarm_for", "alarm"), [(0.1, 0, False), (0.3, 0, True), (0.1, 5, True)])
def test_what_begins_to_chatter_takes_the_power(dominance, alarm_for, alarm):
    """A line off the orders that takes a tenth of the power begins no alarm, however surely it has risen."""
    lines = lines_of(interval(475.0), Odds())
    lines["dominance"], lines["order_odds"], lines["power"] = dominance, 2.9, 1.0
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["saturated"], known["order_odds"], known["power"] = 475.0, 1.0, 2.9, 1.0
    known["dominance"], known["alarm_for"], known["chattered"] = dominance, alarm_for, alarm_for > 0
    assert (followed(known, lines)["alarm_for"] > 0).tolist() == [alarm]


@pytest.mark.parametrize(
    ("steady_hz", "steady", "chattered", "place", "alarm"),
    [
        (950.0 / 3.0, 1.0, False, -0.6, False),
        (321.0, 1.0, False, -0.6, True),  # it is no multiple
        (950.0 / 3.0, 0.5, False, -0.6, True),  # of nothing that is steady for certain
        (950.0 / 3.0, 1.0, True, -0.6, True),  # of chatter
        (950.0 / 3.0, 1.0, False, 0.0, True),  # its place among the orders is known
        (950.0 / 30.0, 1.0, False, -0.6, True),  # as likely by chance
    ],
)
def test_a_multiple_of_what_is_steady_is_forced_where_no_comb_is_known(steady_hz, steady, chattered, place, alarm):
    """Teeth that pass faster than any spindle turns: a resonance of their third multiple is no chatter."""
    both = [interval(hertz).vibrations[0] for hertz in (950.0, steady_hz)]
    known = np.zeros(2, VIBRATION)
    known["frequency_hz"], known["power"], known["dominance"] = [950.0, steady_hz], 1.0, [0.9, 0.05]
    known["saturated"], known["steady"] = [1.0, 1.0 - steady], [0.0, steady]
    known["order_odds"], known["chattered"] = -0.6, [False, chattered]
    for _ in range(20):
        lines = lines_of(interval(950.0)._replace(vibrations=heard(*both)), Odds())
        lines["dominance"], lines["order_odds"], lines["power"] = [0.9, 0.05], [place, -0.6], 1.0
        lines["long_rise"], lines["absolute_rise"], lines["variation"] = [3.0, 0.0], [3.0, 0.0], [0.7, 0.0]
        known = followed(known, lines)
    assert (known["alarm_for"][known["frequency_hz"] == 950.0] > 0).tolist() == [alarm]


@pytest.mark.parametrize(
    ("lower_hz", "share", "wanders", "unheard", "place", "alarm"),
    [
        (475.0, 0.05, 0.004, False, -0.6, False),
        (475.0, 0.05, 0.004, True, 1.3, False),  # at the speed that was told nothing is heard
        (475.0, 0.05, 0.004, False, 1.3, True),  # it is known where the orders are
        (470.0, 0.05, 0.004, False, -0.6, True),  # it is no multiple
        (475.0, 0.97, 0.004, False, -0.6, True),  # that is louder: it may be chatter, with its overtone
        (475.0, 0.05, None, False, -0.6, True),  # now and then
    ],
)
def test_what_is_carried_by_a_fainter_line_is_forced(lower_hz, share, wanders, unheard, place, alarm):
    """Teeth whose second multiple has nearly all of the power, at a speed that wanders: no line is steady."""
    rng = np.random.default_rng(3)
    known = np.zeros(0, VIBRATION)
    for i in range(60):
        together = 1.0 if wanders is None else 1.0 + wanders * rng.standard_normal()
        alone = 1.0 + 0.004 * rng.standard_normal() if wanders is None else together
        both = [interval(hertz).vibrations[0] for hertz in (950.0 * together, lower_hz * alone)]
        lines = lines_of(interval(950.0)._replace(vibrations=heard(*both)), Odds())
        lines["dominance"], lines["order_odds"], lines["power"] = [0.95, share], place, 1.0
        lines["long_rise"] = lines["absolute_rise"] = [3.0 if i > 20 else 0.0, 0.0]
        lines["variation"], lines["coherence"] = 0.7, [1.0, 0.5]  # the lower one is not steady for certain
        known = followed(known, lines, RULES._replace(unheard=unheard))
    upper = abs(known["frequency_hz"] / 950.0 - 1.0) < 0.05
    assert (known["alarm_for"][upper] > 0).tolist() == [alarm]


@pytest.mark.parametrize(("off", "arrives"), [([True], False), ([True, False] * 10, False), ([True] * 20, True)])
def test_what_is_off_the_orders_for_a_moment_has_not_come_with_the_tool(off, arrives):
    """Where the speed wanders, a steady forced line is off its order now and then."""
    lines = lines_of(interval(475.0, rising=False), Odds())
    known = np.zeros(0, VIBRATION)
    for away in [False] * 10 + off:
        lines["dominance"], lines["order_odds"], lines["arrival"] = 1.0, 2.9 if away else -2.7, 2.0 if away else 0.0
        known = followed(known, lines)
    assert bool(known["saturated"][0] > 0.5) is arrives


@pytest.mark.parametrize(("noise", "carrier", "arrives"), [(10, False, True), (30, False, False), (30, True, True)])
def test_what_was_noise_for_a_second_has_not_come_with_the_tool(noise, carrier, arrives):
    """A mode that noise drives is calm by chance for a while; what has sidebands is no such mode."""
    known = np.zeros(0, VIBRATION)
    for i in range(noise + 30):
        lines = lines_of(interval(475.0, rising=False), Odds())
        lines["dominance"], lines["order_odds"], lines["arrival"] = 1.0, 2.9, 2.0
        if i < noise:
            lines["variation"], lines["coherence"] = 0.5, 0.5
        else:
            lines["carrier"] = carrier
        known = followed(known, lines)
    assert bool(known["saturated"][0] > 0.5) is arrives


@pytest.mark.parametrize(
    ("away", "unheard", "silent", "alarm"),
    [
        (0.0, True, 0, False),
        (0.005, True, 0, False),
        (0.02, True, 0, True),
        (0.02, False, 0, False),
        (0.02, True, 1, False),  # nobody has followed it there
    ],
)
def test_what_leaves_the_place_of_a_steady_line_is_not_that_line(away, unheard, silent, alarm):
    """A told speed that is not heard may be off by as much; that which something steady had cannot be."""
    known = np.zeros(0, VIBRATION)
    calm, grows = (lines_of(interval(475.0, rising=rising), Odds()) for rising in (False, True))
    for lines, at, intervals in ((calm, 1.0, 40), (calm[:0], 1.0, silent), (grows, 1.0 + away, 15)):
        for _ in range(intervals):
            seen = lines.copy()
            seen["order_odds"], seen["dominance"] = -2.3, 0.8
            seen["frequency_hz"] *= at
            known = followed(known, seen, RULES._replace(unheard=unheard))
    assert bool(known["growing"][0] > 0.5)
    assert bool(known["alarm_for"].any()) is alarm


@pytest.mark.parametrize(
    ("relatives", "away", "chattered", "alarm"),
    [
        ((2.0, 3.0), 0.0, False, False),
        ((0.2, 2.0), 0.0, False, False),
        ((2.0,), 0.0, False, True),
        ((2.1, 3.1), 0.0, False, True),
        ((2.0, 3.0), 0.02, False, True),
        ((2.0, 3.0), 0.0, True, True),
    ],
)
def test_what_gets_louder_with_its_family_is_forced(relatives, away, chattered, alarm):
    """Teeth that pass faster than a spindle turns are no comb that is looked for, but their multiples are steady.

    What has chattered has overtones, too, where a told speed is not heard.
    """
    place, rules = (0.0, RULES._replace(unheard=True)) if chattered else (Odds().unknown_speed, RULES)
    known = np.zeros(0, VIBRATION)
    for i in range(50):
        louder = 1.0 if i < 30 else 1.0 + away
        several = [interval(663.0 * louder * times).vibrations[0] for times in (1.0, *relatives)]
        lines = lines_of(interval(663.0)._replace(vibrations=heard(*several)), Odds())
        lines["dominance"], lines["order_odds"], lines["power"] = 0.02, place, 1.0
        lines["dominance"][0] = 0.9
        for rise in ("rise", "long_rise", "absolute_rise"):
            lines[rise] = 1.3 if i >= 30 else 0.0
        lines["variation"] = 0.02
        known = followed(known, lines, rules)
        if chattered and i == 29:
            known["chattered"], known["over"] = np.abs(known["frequency_hz"] / 663.0 - 1.0) < 0.03, JUST_NOW
    assert (known["alarm_for"][np.abs(known["frequency_hz"] / 663.0 - 1.0) < 0.03] > 0).tolist() == [alarm]


@pytest.mark.parametrize(("away", "alarm"), [(0.0, False), (0.004, False), (0.03, True)])
def test_a_line_that_was_on_an_order_is_still_when_the_comb_is_lost(away, alarm):
    """While it is where it was: what grows beside an order may have made the comb be lost."""
    calm, grows = (lines_of(interval(475.0, rising=rising), Odds()) for rising in (False, True))
    on_order, unknown = -3.0, Odds().unknown_speed
    known = np.zeros(0, VIBRATION)
    for lines, odds, at, intervals in ((calm, on_order, 1.0, 10), (grows, unknown, 1.0 + away, 15)):
        for _ in range(intervals):
            seen = lines.copy()
            seen["order_odds"], seen["dominance"] = odds, 0.95
            seen["frequency_hz"] *= at
            known = followed(known, seen)
    assert bool(known["growing"][0] > 0.5)
    assert bool(known["alarm_for"].any()) is alarm


def jumped(rises, **about):
    """Of what has risen by so much in each interval: what is followed after the last one."""
    following = Following()
    seen = interval(1000.0)
    vibration = seen.vibrations[0]
    for rise in rises:
        usual = {"rise": rise, "long_rise": rise, "absolute_rise": rise, "variation": 0.5, "coherence": 0.7}
        line = vibration.line._replace(**(usual | about))
        told = following.follow(seen._replace(vibrations=heard(vibration._replace(line=line))), RULES)
    return told.suspect


def test_what_rises_at_once_is_soon_believed():
    """Four times its amplitude within a second is believed sooner than within eight, and sooner than a line of many."""
    at_once = jumped([0.0] * 5 + [1.4] * 2)
    assert at_once.kinds.risen > 30.0 * jumped([0.0] * 5 + [1.4] * 2, rise=0.7).kinds.risen
    assert at_once.kinds.risen > 10.0 * jumped([0.0] * 5 + [1.4] * 2, share=0.2).kinds.risen


def test_a_height_counts_once_and_is_taken_back():
    """What chance may explain has to stay, and is forgotten if it falls; what it cannot is believed at once."""
    assert jumped([0.0] * 5 + [1.4]).kinds.risen < 0.1
    assert jumped([0.0] * 5 + [1.4] * 9).kinds.risen > 0.8
    assert jumped([0.0] * 5 + [1.8]).kinds.risen > 0.99
    assert jumped([0.0] * 5 + [1.4, 0.0] * 20).kinds.risen < 0.1


@pytest.mark.parametrize(("chattered", "over"), [(False, 0), (True, JUST_NOW), (True, JUST_NOW - 1)])
def test_what_has_chattered_before_is_believed_as_soon(chattered, over):
    """How loud it is by now counts once; just after an alarm it has counted."""
    known, lines = np.zeros(1, VIBRATION), lines_of(interval(1000.0, rising=False), Odds())
    known["frequency_hz"], known["noise"], known["power"], known["dominance"] = 1000.0, 1.0, 1.0, 1.0
    known["chattered"], known["over"], known["own"] = chattered, over, over
    lines["coherence"], lines["variation"], lines["dominance"] = 0.7, 0.5, 1.0
    for measure in ("rise", "long_rise", "absolute_rise", "own_rise"):
        lines[measure] = 1.8
    assert bool(followed(known, lines)["growing"][0] > 0.9) is (over == 0 or over >= JUST_NOW)


@pytest.mark.parametrize(
    ("rises", "growing"),
    [
        ([2.9, 1.9, 0.9, 0.0], False),
        ([2.9, 2.4], False),
        ([1.9, 1.9], True),
        ([2.9, 1.9, 1.9], True),  # and stays
    ],
)
def test_a_ring_does_not_grow(rises, growing):
    """A blow is no coherent line as it comes; the ring that it leaves is, and as loud, but dies away."""
    lines = lines_of(interval(663.0), Odds())
    known, grows = np.zeros(0, VIBRATION), False
    for i, rise in enumerate([0.0] * 5 + rises):
        for measure in ("rise", "long_rise", "absolute_rise", "own_rise"):
            lines[measure] = rise
        lines["coherence"], lines["variation"], lines["dominance"] = 0.2 if i < 6 else 0.7, 1.0, 1.0
        known = followed(known, lines)
        grows |= bool(known["growing"][0] > 0.5)
    assert grows is growing


@pytest.mark.parametrize(
    ("rises", "climbs"),
    [
        ([0.5, 1.0, 1.5, 2.0, 2.3], True),  # two intervals explain 1.0 of it
        ([0.5, 1.0, 1.4, 1.9], False),
        ([0.5, 2.5, 2.5, 2.5], False),  # a force that sets in
        ([0.2, 1.2, 2.6, 2.7], False),  # between two intervals
        ([0.5, 1.0, 1.5, 0.2, 2.0], False),  # it was as faint as ever meanwhile
        ([0.5, 1.0, 0.6, 1.5, 2.0, 2.3], True),  # not as faint
    ],
)
def test_what_climbs_is_hardly_forced(rises, climbs):
    """A force sets in at once; a rise that takes more than two intervals is less likely explained by what turns."""
    told = jumped([0.0] * 5 + rises)
    odds = math.log(told.unexplained / (1.0 - told.unexplained))
    at_once = jumped([0.0] * 4 + [rises[-1]] * (1 + len(rises)))
    assert odds - math.log(at_once.unexplained / (1.0 - at_once.unexplained)) == pytest.approx(2.0 * climbs)


@pytest.mark.parametrize(("share", "louder", "expected"), [(0.9, 10.0, 0.76), (0.9, 1.0, 0.315), (0.1, 10.0, 0.084)])
def test_a_share_is_that_of_the_power_of_some_intervals(share, louder, expected):
    """What has nearly all power as soon as it gets loud has it from then on; a faint interval counts less."""
    lines = lines_of(interval(1000.0), Odds())
    known = np.zeros(0, VIBRATION)
    for _ in range(3):
        lines["dominance"], lines["power"] = 0.0, 1.0
        known = followed(known, lines)
    lines["dominance"], lines["power"] = share, louder
    assert followed(known, lines)["dominance"][0] == pytest.approx(expected, abs=0.005)


@pytest.mark.parametrize(("place", "kept"), [(2.9, True), (-0.9, True), (-1.1, False)])
def test_in_an_alarm_the_largest_share_counts_but_on_an_order(place, kept):
    """Chatter may leave its power to other lines; what is on an order had its share before the order was taken out."""
    lines = lines_of(interval(1000.0), Odds())
    lines["dominance"], lines["power"], lines["order_odds"] = 0.2, 1.0, place
    known = np.zeros(1, VIBRATION)
    known["frequency_hz"], known["saturated"], known["order_odds"], known["alarm_for"] = 1000.0, 1.0, place, 5
    known["dominance"], known["power"] = 0.9, 1.0
    assert followed(known, lines)["dominance"][0] == pytest.approx(0.9 if kept else 0.655, abs=0.001)


@pytest.mark.parametrize(("growth", "alarms"), [(1.0, True), (0.7, True), (0.4, False), (0.0, False)])
def test_what_regenerates_is_an_alarm_whatever_its_lines_look_like(growth, alarms):
    """The strongest of several unsteady lines, none of which has risen or takes most of the power; not the others."""
    lines = (
        Vibration(Line(hertz, share, 15.0, 0.6, 0.0, 0.0, 0.0, 0.0, 0.5), None)
        for hertz, share in ((1000.0, 0.3), (1150.0, 0.5), (1300.0, 0.2))
    )
    seen = interval(1000.0)._replace(vibrations=heard(*lines), orders=Orders(0, None, None, None, 0.0, growth=growth))
    following = Following()
    for _ in range(8):
        told = following.follow(seen, RULES)
    assert told.vibrations["frequency_hz"][told.vibrations["alarm_for"] > 0].tolist() == ([1150.0] if alarms else [])


def test_at_rest_only_chatter_is_remembered():
    """While nothing is cut there is no alarm; only what has chattered is known when the cut goes on, for a minute."""
    following = Following()
    for _ in range(40):
        following.follow(interval(1000.0), RULES)
    assert following.follow(interval(1000.0, 300.0, rising=False), RULES).alarm.frequency_hz == 1000.0
    following.rest()
    told = following.follow(interval(), RULES)
    assert told.vibrations[["frequency_hz", "chattered"]].tolist() == [(1000.0, True)]
    assert told.vibrations["noise"][0] > 0.99
    for _ in range(FORGOTTEN_CHATTER - 4):
        following.rest()
    assert len(following.follow(interval(), RULES).vibrations) == 1
    following.rest()
    assert not len(following.follow(interval(), RULES).vibrations)


def test_what_is_heard_nearby_as_the_tool_leaves_is_not_what_has_chattered():
    following = Following()
    for _ in range(40):
        following.follow(interval(1000.0), RULES)
    (left,) = interval(1050.0, rising=False).vibrations
    left = left._replace(line=left.line._replace(share=0.01, long_rise=-3.0, absolute_rise=-3.0))
    told = following.follow(interval()._replace(vibrations=heard(left)), RULES)
    assert told.vibrations["frequency_hz"].tolist() == [1050.0]
    following.rest()
    assert following.follow(interval(), RULES).vibrations["frequency_hz"].tolist() == [1000.0]


def test_what_ends_with_the_cut_has_not_come_down_by_itself():
    following = Following()
    for _ in range(40):
        told = following.follow(interval(1000.0), RULES)
    told.vibrations["dispersion"], told.vibrations["crest"] = 1.0, 1.0
    following.rest()
    (next_cut,) = following.follow(interval(), RULES).vibrations
    assert (next_cut["dispersion"], next_cut["crest"]) == (1.0, -math.inf)


def test_what_came_and_left_with_the_tool_is_forgotten():
    """Of a cut of which only its lines were heard none has grown in the cut."""
    following = Following()
    for _ in range(40):
        told = following.follow(interval(1000.0), RULES)
    assert told.alarm is not None
    following.rest(forget=True)
    assert not len(following.follow(interval(), RULES).vibrations)


@pytest.mark.parametrize("calm", [True, False])
def test_what_is_taken_out_with_the_teeth_in_an_alarm_is_not_theirs_later(calm):
    """Of a calm cut it is heard again at its order; chatter that caught on the teeth is no order of theirs."""
    taken = Orders(0, 23.0, 0.01, "refined", 0.9, (OrderLine(9, 207.0, 3.0),))
    following = Following()
    following.follow(interval()._replace(orders=taken), RULES, calm=calm)
    then = interval(207.0)._replace(orders=Orders(0, 23.0, 0.05, "refined", 0.0))
    (vibration,) = following.follow(then, RULES).vibrations
    assert bool(vibration["dominance"] > 0.5) is not calm


@pytest.mark.parametrize("chatters", [True, False])
def test_what_swung_before_it_chattered_does_not_hold_it_back_in_the_next_cut(chatters):
    """Out of a cut that stayed calm, what is no louder than its swings has not risen."""
    following = Following()
    quiet, loud = (interval(1000.0, rising=False)._replace(rms=rms) for rms in (0.1, 1.0))
    for each in [*[quiet] * 5, loud, *[quiet] * (2 * LATER)]:
        following.follow(each, RULES)
    for _ in range(20 if chatters else 0):
        following.follow(interval(1000.0)._replace(rms=30.0), RULES, calm=False)
    following.rest(forget=True)
    for _ in range(20):
        told = following.follow(interval(1000.0)._replace(rms=0.5), RULES)
    assert (told.alarm is not None) is chatters
