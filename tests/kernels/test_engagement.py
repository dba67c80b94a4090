"""In the cut or in the air, by the level between the lines."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import engagement
from chatter_monitor.kernels.engagement import DECIBEL

CUT, AIR = -20.0, -40.0  # dB
LOUD = 10.0  # how much more the whole power of a cut is than its level
STANDS_OUT, NOISE = 20.0, 6.0  # how far the most prominent line stands out of a cut, and of noise
BESIDE = 10.0 * DECIBEL, 20.0 * DECIBEL  # by how much a cut is louder than the room beside a pump, and its line


def told(
    *stretches,
    columns=160,
    seed=1,
    fainter=(),
    leapt=(),
    pump=(),
    hums=(),
    familiar=(),
    several=(),
    quiet=(),
    alone=(),
    repeating=0.0,
    with_comb=(),
):
    """Whether the tool is in the cut, frame by frame, for stretches of (frames, level, power, crest) in dB.

    In the frames ``fainter`` most of what is heard goes on, fainter; in the frames ``leapt`` all became louder at once,
    in the frames ``pump`` it did, but for the lines that were there, in the frames ``hums`` nothing stands out but such
    lines, in the frames ``familiar`` a hump has grown, in the frames ``several`` several lines have come, in the frames
    ``quiet`` nothing had sounded before but noise and a steady tone, in the frames ``alone`` a line has all power.
    So much of the power repeats, and so loud is the whole where something turns.
    """
    rng = np.random.default_rng(seed)
    repeats = np.zeros(columns)
    (levels, powers, wholes, crests), cutting = np.zeros((4, columns)), np.zeros(columns, bool)
    rings = engagement.Rings(levels, powers, wholes, crests, repeats)
    air, result = engagement.new_air(), []
    for frames, level, power, crest in stretches:
        for _ in range(frames):
            column = len(result) % columns
            levels[column] = DECIBEL * (level + 0.3 * rng.standard_normal())
            powers[column] = DECIBEL * (power + 0.3 * rng.standard_normal())
            crests[column] = DECIBEL * crest
            comb = len(result) < len(with_comb)
            wholes[column] = DECIBEL * with_comb[len(result)] if comb else powers[column]
            repeats[column] = repeating(len(result)) if callable(repeating) else repeating
            head = len(result) + 1
            now = len(result)
            signs = engagement.Signs(
                fainter=now in fainter,
                pump=now in hums,
                leapt=now in leapt,
                beside=BESIDE if now in pump else (0.0, 0.0),
                familiar=now in familiar,
                several=now in several,
                quiet=now in quiet,
                largest=float(now in alone),
            )
            cutting[column] = engagement.engaged(rings, signs, head, air, np.zeros(columns))
            result.append(bool(cutting[column]))
    return result


def cut(frames, level=CUT):
    return frames, level, level + LOUD, STANDS_OUT


def room(frames, level=AIR, tone=-100.0, crest=STANDS_OUT):
    return frames, level, max(level, tone), crest


def test_the_tool_is_in_the_cut_until_something_falls():
    """Without a fall nothing is known of the air: who begins to listen in the cut, or in the air, misses nothing."""
    assert all(told(cut(100)))
    assert all(told(room(100)))


@pytest.mark.parametrize("tone", [-100.0, CUT + LOUD])
def test_a_fall_to_the_room_is_the_air(tone):
    """The tool has left the cut when the level falls, within two frames, though a pump goes on as loud as the cut."""
    after = told(cut(60), room(200, tone=tone))[60:]
    assert sum(after) <= 2
    assert not any(after[2:])


@pytest.mark.parametrize("rise", [5.0, 10.0, 40.0])
def test_what_rises_from_the_air_is_a_tool_that_enters(rise):
    """The tool is in the cut again a moment after the level has left that of the air, and stays in it."""
    after = told(cut(60), room(60), cut(60, AIR + rise))[120:]
    assert not any(after[:3])
    assert all(after[4:])


@pytest.mark.parametrize(("rise", "enters"), [(2.0, False), (6.0, True)])
def test_what_was_far_fainter_than_a_cut_is_entered_when_the_noise_rises(rise, enters):
    """A room that has got louder is taken for a cut; what comes at once then, the noise with it, is the tool."""
    louder = 40, AIR + 10.0, CUT + LOUD - 12.0, STANDS_OUT
    after = told(cut(60), room(60), louder, (20, AIR + 10.0 + rise, CUT + LOUD, STANDS_OUT), columns=240)[160:]
    assert (not all(after)) is enters


@pytest.mark.parametrize("rings", [(), ((2, AIR, CUT + LOUD - 1.0, 40.0), (1, AIR + 7.0, CUT + LOUD - 10.0, 20.0))])
def test_what_is_as_loud_as_the_cut_before_was_is_the_cut(rings):
    """Where it was lightest, before it chattered, ring it out or not: what gets far louder then is no tool."""
    calm, chatters = cut(60), (40, CUT + 8.0, CUT + LOUD + 20.0, STANDS_OUT)
    again = told(calm, chatters, *rings, room(60), calm, chatters, columns=400)
    assert all(again[len(again) - 95 :])


def test_so_it_is_where_its_chatter_was_taken_out_with_the_teeth_until_the_tool_left():
    """There is not enough alike by then to tell how loud it was just now, but where it was lightest is known."""
    calm, chatters = cut(60), (40, CUT + 8.0, CUT + LOUD + 20.0, STANDS_OUT)
    taken, gone, enters = 100, 106, 160
    again = told(
        *(calm, chatters, room(enters - taken), calm, chatters),
        columns=400,
        fainter=range(taken, gone),
        with_comb=[CUT + LOUD + 20.0] * gone + [AIR] * (enters - gone) + [CUT + LOUD + 20.0] * taken,
        repeating=lambda frame: 0.1 if gone <= frame < enters else 0.8,
    )
    assert not any(again[gone + 3 : enters])
    assert all(again[enters + 5 :])


@pytest.mark.parametrize(("air", "heard"), [(4, False), (60, True)])
def test_what_rang_out_when_the_tool_left_is_not_the_air(air, heard):
    """A cut of which only lines are heard, fainter than that, is one after a moment in the air."""
    rings = 3, AIR, CUT + LOUD - 1.0, STANDS_OUT
    after = told(cut(60), rings, room(air), (40, AIR, CUT + LOUD - 2.5, STANDS_OUT), columns=240)
    assert not any(after[62 : 63 + air])
    assert after[-1] is heard


@pytest.mark.parametrize("heard_before", [True, False])
def test_nor_does_what_begins_out_of_nothing_but_noise_enter_such_a_cut(heard_before):
    """A cut in which no mode stands out is heard by how loud it is, if one has been heard before."""
    calm, louder = (60, CUT, CUT + LOUD, NOISE), (40, CUT + 6.0, CUT + LOUD + 10.0, NOISE)
    before = (calm, room(60)) if heard_before else ()
    after = told(*before, calm, louder, columns=400)
    assert all(after[len(after) - 95 :]) is heard_before


@pytest.mark.parametrize(
    ("crest", "louder", "enters"),
    [(NOISE, 12.0, True), (10.0, 12.0, False), (NOISE, 6.0, False)],  # a mode sounded before; hardly louder
)
def test_several_lines_out_of_noise_come_with_the_tool(crest, louder, enters):
    """However little noise they bring; one line alone may have grown."""
    tool = 60, AIR + 2.0, AIR + louder, STANDS_OUT
    assert all(told(room(60, crest=crest), tool))
    heard = told(room(60, crest=crest), tool, several=range(60, 120))
    assert all(heard[:60])
    assert all(heard[:66]) is not enters
    assert all(heard[80:])


@pytest.mark.parametrize(
    ("lines", "several"),
    [
        ({40: (20.0, 0.9)}, False),
        ({40: (20.0, 0.65), 80: (18.0, 0.3)}, False),  # an overtone
        ({40: (20.0, 0.55), 80: (18.0, 0.3)}, True),  # as loud as no overtone
        ({40: (20.0, 0.55), 80: (18.0, 0.15)}, False),
        ({40: (20.0, 0.65), 13: (18.0, 0.3)}, True),
        ({40: (20.0, 0.65), 13: (14.0, 0.3)}, False),  # hardly stands out
        ({40: (20.0, 0.8), 13: (18.0, 0.1)}, False),  # next to no power
        ({80: (20.0, 0.8), 27: (13.0, 0.05)}, False),
        ({81: (20.0, 0.8), 27: (13.0, 0.05)}, True),  # that it is a multiple of
        ({81: (20.0, 0.8), 27: (11.0, 0.05)}, False),
        ({80: (20.0, 0.8), 10: (13.0, 0.05)}, False),  # as it may be of any
        ({27: (20.0, 0.8), 81: (13.0, 0.05)}, False),  # an overtone
        ({}, False),
    ],
)
def test_of_several_lines_the_highest_is_not_the_lowest(lines, several):
    """Chatter and its overtones are otherwise."""
    peaks = np.array(sorted(lines, key=lambda b: -lines[b][0]), np.int64)
    relief, power = np.zeros((2, 100))
    power += 1e-9
    for b, (decibels, part) in lines.items():
        relief[b], power[b] = DECIBEL * decibels, part
    assert engagement.are_several(relief, power, 1.0, peaks) is several


def test_a_tool_that_enters_slowly_is_in_the_cut_when_the_level_stays():
    """As long as it gets louder it enters, but not longer than a second."""
    slowly = [cut(1, AIR + step) for step in range(5, 21)]
    after = told(cut(60), room(60), *slowly, cut(60))[120:]
    assert not any(after[:16])
    assert all(after[22:])
    endless = [cut(1, AIR + step) for step in range(5, 60)]
    assert all(told(cut(60), room(60), *endless)[120 + engagement.LONGEST + 1 :])


def test_a_cut_of_which_only_lines_are_heard_ends_when_nothing_but_noise_is_left():
    """A line may be all that a louder room leaves of a cut; what it leaves behind is the air, if that has no lines."""
    lone = (60, AIR, CUT, STANDS_OUT)
    heard = told(lone, room(60, crest=NOISE), lone)
    assert all(heard[:60])
    assert not any(heard[62:120])
    assert not any(heard[120:123])  # it enters
    assert all(heard[126:])
    assert all(told(lone, room(60), lone))  # lines that go on are those of a cut


@pytest.mark.parametrize(("left", "leaves"), [(NOISE, True), (STANDS_OUT, False)])
def test_so_does_one_of_which_nothing_is_louder_than_the_room_but_its_comb(left, leaves):
    """Without its comb a cut may be as quiet as the room after it; while it is taken out the next one is none."""
    residual = AIR + 6.0
    comb = 60, AIR, residual, np.inf
    loud, air = [CUT + LOUD] * 60, [residual - 3.0] * 60
    heard = told(
        *(comb, room(60, crest=left), comb),
        with_comb=[*loud, *air, *loud],
        repeating=lambda frame: 0.1 if 60 <= frame < 120 else 0.9,
    )
    assert all(heard[:60])
    assert any(heard[62:120]) is not leaves
    assert any(heard[120:123]) is not leaves  # it enters
    assert all(heard[126:])


def test_what_is_far_fainter_than_a_cut_with_its_comb_is_a_room():
    """However quiet the cut was without: what comes at once out of a louder room is the tool."""
    comb, loud = (60, AIR + 10.0, AIR + 12.0, np.inf), [CUT + LOUD] * 60
    louder_room, tool = room(60, AIR + 6.0, crest=NOISE), (20, CUT, CUT + LOUD, STANDS_OUT)
    heard = told(comb, room(60), louder_room, tool, with_comb=loud, columns=240)
    assert not any(heard[62:120])
    assert all(heard[130:180])
    assert not any(heard[181:184])  # it enters
    assert all(heard[190:])


def test_a_blow_is_no_cut():
    """After a blow in the air it is the air again at once."""
    after = told(cut(60), room(60), cut(2), room(60))[120:]
    assert not any(after)


def test_the_air_is_learned_anew():
    """Another room is known when the tool has left its cut once; a drift is followed."""
    louder = AIR + 10.0
    passes = [cut(60), room(60), room(60, louder), cut(60), room(60, louder)]
    assert all(told(*passes)[130:180])  # not known yet
    assert not any(told(*passes)[242:])
    drifting = [room(20, AIR + 0.5 * step) for step in range(20)]
    assert not any(told(cut(60), *drifting)[62:])


def test_a_depth_that_shrinks_is_no_air():
    """A level that falls by less, or slowly, is that of a lighter cut."""
    assert all(told(cut(60), cut(60, CUT - 6.0)))
    assert all(told(cut(60), *[cut(4, CUT - step) for step in range(20)]))


@pytest.mark.parametrize(
    ("whole", "repeating", "leaves"), [(AIR, 0.1, True), (AIR, 0.8, False), (CUT + LOUD - 5.0, 0.1, False)]
)
def test_a_tool_leaves_just_after_its_comb_is_taken_out(whole, repeating, leaves):
    """With what turns the whole falls to the room, and nothing repeats: that is no comb that is taken out."""
    taken, gone = 60, 66
    after = told(
        *(cut(taken), room(60)),
        fainter=range(taken, gone),
        with_comb=[CUT + LOUD] * gone + [whole] * 60,
        repeating=lambda frame: 0.8 if frame < gone else repeating,
    )
    assert all(after[: gone + 1])
    assert any(after[gone + 3 :]) is not leaves


def test_a_cut_that_gets_lighter_at_once_is_no_air():
    """A fall while most of what is heard goes on, fainter, is none; the next one, to the room, is."""
    lighter = [cut(60), cut(60, CUT - 9.0), room(60)]
    assert not all(told(*lighter)[:120])
    heard = told(*lighter, fainter=range(60, 64), repeating=0.8)
    assert all(heard[:120])
    assert not any(heard[122:])


def test_a_vibration_that_grows_in_a_quiet_cut_ends_the_air():
    """What gets as loud as the cut was is none of the air, even if the level between the lines stays."""
    assert told(cut(60), room(60), room(60, tone=CUT + LOUD))[-1]


def test_what_begins_at_once_where_all_was_faint_is_a_tool_that_enters():
    """In a room that got louder, and still is far below the cut before, nothing has risen when the next cut begins."""
    for crest, rise in ((STANDS_OUT, 12.0), (NOISE, 6.0)):
        after = told(cut(60), room(60), room(60, AIR + 8.0, crest=crest), cut(60, AIR + 8.0 + rise))[180:]
        assert not any(after[:3])
        assert all(after[9:])


@pytest.mark.parametrize("heard", [9, 60])
@pytest.mark.parametrize("rise", [6.0, 20.0])
def test_what_begins_at_once_where_nothing_but_noise_was_heard_is_a_tool_that_enters(rise, heard):
    """Before its first cut, too: there is nothing to have risen from but the room, after half a second of it."""
    after = told(room(heard + 4, crest=NOISE), cut(60, AIR + rise))[heard + 4 :]
    assert not any(after[:3])
    assert all(after[9:])


def test_a_line_that_rises_out_of_noise_is_no_tool_that_enters():
    """A vibration that grows comes before the noise that it makes; where lines stood out, something was being cut."""
    lone = room(60, tone=AIR + 30.0)
    assert all(told(room(60, crest=NOISE), lone))
    growing = [(1, AIR + loud / 8.0, AIR + loud, loud) for loud in np.arange(0.0, 45.0, 5.0)]
    assert all(told(room(60, crest=NOISE), *growing))
    sudden = [(1, AIR + 2.0, AIR + 7.0, 26.0), (60, AIR + 35.0 / 8.0, AIR + 20.0, 35.0)]
    assert all(told(room(60, crest=NOISE), *sudden))
    assert all(told(room(60), cut(60)))


@pytest.mark.parametrize(
    ("crest", "repeating", "enters"),
    [(NOISE, 0.0, True), (12.0, 0.1, True), (STANDS_OUT, 0.0, False), (12.0, 0.3, False)],
)
def test_what_leaps_out_of_faint_lines_is_a_tool_that_enters(crest, repeating, enters):
    """Whether it lifts the noise or not; what leaps where lines stood out or teeth were heard is in the cut already."""
    leaps = room(60, tone=AIR + 30.0)
    after = told(room(60, crest=crest), leaps, leapt=(60, 61), repeating=repeating)[60:]
    assert all(after) is not enters
    assert all(after[9:])


def test_a_deeper_cut_is_no_tool_that_enters():
    """Where modes had sounded, as much noise at once as of another depth is that, whether it leaps or not."""
    heard = room(60, crest=12.0), (60, AIR + 14.0, AIR + 18.0, STANDS_OUT)
    for leapt in ((), (60, 61)):
        assert all(told(*heard, leapt=leapt))
        assert not all(told(*heard, leapt=leapt, quiet=range(60, 65)))


@pytest.mark.parametrize(
    ("crest", "rise", "leapt", "familiar", "enters"),
    [
        (STANDS_OUT, 6.0, (), (), True),
        (STANDS_OUT, 3.0, (), (), False),  # a line and its skirts
        (STANDS_OUT, 3.0, (60, 61), (), True),
        (STANDS_OUT, 6.0, (), range(60, 65), False),
        (np.inf, 6.0, (), (), False),  # beside something that turns: teeth, maybe
    ],
)
def test_what_drowns_a_hum_is_a_tool_that_enters(crest, rise, leapt, familiar, enters):
    """Where nothing but that was heard, however much of the power repeats; of growth as where nothing was."""
    heard = room(60, crest=crest), (60, AIR + rise, AIR + rise + 12.0, STANDS_OUT)
    known = {"repeating": 0.8, "leapt": leapt, "familiar": familiar}
    after = told(*heard, quiet=range(60, 65), **known)[60:]
    assert all(after) is not enters
    assert all(after[9:])
    assert all(told(*heard, **known))


def test_as_much_noise_as_a_line_as_high_may_bring_is_no_tool_that_enters():
    """Of a line that stands out by 40 dB its skirts and sidebands may lift the level by 8, if it does not leap."""
    loud = 60, AIR + 7.0, CUT + LOUD, 40.0
    assert all(told(room(60), loud, quiet=range(60, 65)))


@pytest.mark.parametrize("crest", [NOISE, 12.0])
def test_what_grew_out_of_a_hump_is_no_tool_that_enters(crest):
    """What sounded before was in the cut, though its noise lifts the level."""
    heard = room(60, AIR, tone=AIR + 5.0, crest=crest), cut(60, AIR + 20.0)
    assert not all(told(*heard, quiet=range(60, 65)))
    assert all(told(*heard, quiet=range(60, 65), familiar=range(60, 65)))


@pytest.mark.parametrize(
    ("crests", "enters"), [((8.0, 10.0, 15.0), True), ((8.0, 17.0, 22.0), True), ((8.0, 13.0, 20.0), False)]
)
def test_a_line_that_goes_on_to_grow_came_with_no_tool(crests, enters):
    """Taken back as soon as it is known; where a tool has been heard to leave, it has entered all the same."""
    noise = room(60, crest=NOISE)
    growing = [(1, CUT, CUT + crest, crest) for crest in crests]
    after = told(noise, *growing, (20, CUT, CUT + 30.0, crests[-1]))[60:]
    assert not any(after[:2])
    assert after[2] is not enters
    assert all(after[5:])
    silent = [(1, AIR, CUT + crest, crest) for crest in crests]  # no noise has come
    assert not any(told(noise, *silent, leapt=(60, 61))[60:63])
    known = told(cut(60), room(60, crest=NOISE), *growing, (20, CUT, CUT + 30.0, crests[-1]))[120:]
    assert not any(known[:3])


@pytest.mark.parametrize(
    ("familiar", "alone", "noise", "falls", "enters"),
    [
        (True, True, 3.0, 0.0, False),
        (False, True, 3.0, 0.0, True),  # no mode had sounded there
        (True, False, 3.0, 0.0, True),  # it is not alone
        (True, True, 12.0, 0.0, True),  # noise has come with it
        (True, True, 3.0, 2.0, True),  # it rings out
    ],
)
def test_a_mode_that_is_all_at_once_far_louder_by_itself_came_with_no_tool(familiar, alone, noise, falls, enters):
    """Of what grows e-fold in a few milliseconds no growth is seen: it is there, as a tool is that enters."""
    heard = range(60, 80)
    louder = [(1, AIR + noise, AIR + 40.0 - falls * i, STANDS_OUT) for i in range(20)]
    signs = {"leapt": (60, 61), "familiar": heard if familiar else (), "alone": heard if alone else ()}
    after = told(room(60, crest=NOISE), *louder, **signs)[60:]
    assert not any(after[:3])
    assert after[3] is not enters


@pytest.mark.parametrize(("louder", "enters"), [(18.0, False), (22.0, True)])
def test_an_idle_machine_that_rings_is_far_fainter_than_its_cut(louder, enters):
    """A hump, too, but what leaps by more than 20 dB out of it is the tool."""
    heard = room(60, crest=12.0), (60, AIR + 2.0, AIR + louder, STANDS_OUT)
    assert all(told(*heard, leapt=(60, 61), familiar=range(60, 65))) is not enters


def test_a_tool_that_was_heard_to_enter_does_not_enter_again():
    """In the cut that follows, as much noise at once is chatter, or a deeper cut."""
    faint = (*cut(60)[:3], 12.0)
    assert all(told(cut(60), room(60), faint, cut(60, CUT + 14.0))[140:])


@pytest.mark.parametrize(("fall", "hums", "leaves"), [(15.0, True, True), (5.0, True, False), (15.0, False, False)])
def test_a_tool_leaves_beside_a_pump(fall, hums, leaves):
    """The noise falls by 3 dB only; the whole by more, and nothing is left but the pump, or it is a lighter cut."""
    tone, quiet = CUT + LOUD - 14.0, AIR + 3.0
    passes = (60, quiet, CUT + LOUD, STANDS_OUT), room(60, tone=tone)
    comb_taken_out = 60, quiet, tone - 3.0, np.inf  # as quiet as the pump; the whole is not
    loud, faint = [0.0] * 60, [-fall] * 60
    heard = told(*passes, *passes, comb_taken_out, hums=range(60, 360) if hums else (), with_comb=[*loud, *faint] * 3)
    assert all(heard[:60])
    assert any(heard[62:120]) is not leaves
    assert all(heard[125:180])
    assert any(heard[182:240]) is not leaves
    assert all(heard[245:])


@pytest.mark.parametrize(
    ("pump_s", "other_s", "turns", "hums"),
    [(0.0, None, False, True), (1.2, None, False, False), (0.0, 1.2, False, False), (0.0, None, True, False)],
)
def test_what_has_been_as_loud_for_a_while_is_a_pump(pump_s, other_s, turns, hums):
    """Whether something turns, or another line stands out that has not been there, or one alone that has not."""
    frames, bins = 40, 100
    reliefs, powers = np.zeros((2, bins, frames))
    for b, since_s in ((30, pump_s), (60, other_s)):
        if since_s is not None:
            begin = round(since_s / 0.05)
            reliefs[b, begin:] = powers[b, begin:] = STANDS_OUT * DECIBEL
    crests = np.full(frames, np.inf if turns else STANDS_OUT * DECIBEL)
    heard = [engagement.is_pump(reliefs, powers, crests, 2, head) for head in range(engagement.BEFORE + 1, 28)]
    assert all(heard) is hums
    assert any(heard) is (hums or other_s is not None)  # the other was not there at first
    assert not engagement.is_pump(reliefs, powers, np.full(frames, NOISE * DECIBEL), 2, 20)


def test_what_begins_beside_a_pump_is_a_tool_that_enters():
    """Slowly or at once, louder than the pump or not; but not where something turns, nor for a line without noise."""
    slow, at_once = (told(room(60), cut(60), pump=range(60, 65), leapt=leapt)[60:] for leapt in ((), (60, 61)))
    hum = CUT + LOUD + 10.0
    drowned = told(room(60, tone=hum), (60, CUT, hum, STANDS_OUT), pump=range(60, 65))[60:]
    for after in (slow, at_once, drowned):
        assert not any(after[1:3])
        assert all(after[9:])
    assert all(told(room(60, crest=np.inf), cut(60), pump=range(60, 65)))
    assert all(told(room(60), cut(60, AIR + 2.0), pump=range(60, 65)))


@pytest.mark.parametrize(
    ("tone", "rise", "louder", "crest"),
    [
        (40.0, 10.0, 10.0, 20.0),  # decibels
        (40.0, 3.0, 0.0, 0.0),  # of the noise too little
        (42.0, 10.0, 0.0, 0.0),  # the line is louder, too
        (38.0, 10.0, 0.0, 0.0),
        (0.0, 10.0, 0.0, 0.0),  # there is none
    ],
)
def test_a_pump_minds_no_tool(tone, rise, louder, crest):
    """The line that stood out is as loud as before, the rest is louder, and has a line, too."""
    reliefs, powers, levels = np.zeros((50, 9)), np.zeros((50, 9)), np.zeros(9)
    if tone:
        reliefs[20], powers[20] = DECIBEL * 40.0, DECIBEL * 40.0
    powers[:, 8], levels[8], powers[20, 8] = DECIBEL * rise, DECIBEL * rise, DECIBEL * tone
    reliefs[35, 8] = DECIBEL * 20.0
    assert engagement.louder_beside_pump(reliefs, powers, levels, 2, 8) == (0.0, 0.0)
    told = engagement.louder_beside_pump(reliefs, powers, levels, 2, 9)
    assert told == pytest.approx((DECIBEL * louder, DECIBEL * crest))


@pytest.mark.parametrize(("earlier", "pump"), [(40.0, True), (39.0, True), (36.0, False), (44.0, False)])
def test_a_mode_in_noise_is_no_pump(earlier, pump):
    """What stands out as far now and a moment ago, and did not before that, is no pump that goes on."""
    reliefs, powers, levels = np.zeros((50, 20)), np.zeros((50, 20)), np.zeros(20)
    reliefs[20], powers[20], powers[20, 8] = DECIBEL * 40.0, DECIBEL * 40.0, DECIBEL * earlier
    powers[:, 19], levels[19], powers[20, 19] = DECIBEL * 10.0, DECIBEL * 10.0, DECIBEL * 40.0
    louder, _ = engagement.louder_beside_pump(reliefs, powers, levels, 2, 20)
    assert louder == pytest.approx(DECIBEL * 10.0 if pump else 0.0)


def spectra(*decibels):
    """Ring of transforms of a line in noise, the line as loud as that in each of them, and logarithms of frames."""
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((100, 2 * len(decibels))).view(complex)
    noise[30] += 10.0 ** (np.array(decibels) / 20.0)
    return noise, np.log((np.abs(noise) ** 2).sum(axis=0).reshape(-1, 4).mean(axis=1))


def leaps(*decibels):
    ring, powers = spectra(*decibels)
    valid = np.ones(ring.shape[1], bool)
    return [engagement.has_leapt(ring, valid, 4 * head, 4, 2, powers, head) for head in range(1, len(powers) + 1)]


@pytest.mark.parametrize("at", range(8, 12))
def test_a_leap_is_seen_in_the_frame_of_it_or_the_next(at):
    """Wherever in the frame it is; a stretch that holds a half of it is no hindrance."""
    loud = [0.0] * at + [35.0] + [41.0] * (31 - at)
    assert any(leaps(*loud)[2:4])
    assert not any(leaps(*loud)[4:])
    assert not any(leaps(*loud)[:2])


@pytest.mark.parametrize("rate_per_s", [10.0, 30.0, 60.0])
def test_growth_is_no_leap(rate_per_s):
    """A line that grows out of noise takes more than 25 ms from where it is heard to twelve decibels above all else."""
    growth = np.minimum(-10.0 + 8.686 * rate_per_s * 0.0125 * np.arange(64), 41.0)
    assert not any(leaps(*[-10.0] * 16, *growth))


@pytest.mark.parametrize("with_what_turns", [False, True])
def test_what_is_fainter_than_it_was_has_fallen_until_it_comes_back(with_what_turns):
    """Fallen by 8 dB at once, until it is nearly as loud as before; a slow fall is none. With what turns or without."""

    def rings(ring):
        return (np.zeros(160), ring) if with_what_turns else (ring, np.zeros(160))

    rng = np.random.default_rng(3)

    def fallen(*powers):
        ring, air = np.zeros(160), engagement.new_air()
        result = []
        for head, power in enumerate(powers, start=1):
            ring[(head - 1) % 160] = DECIBEL * (power + 0.3 * rng.standard_normal())
            result.append(bool(engagement.fell(*rings(ring), head, air, np.zeros(160))))
        return result

    told = fallen(*[0.0] * 40, *[-12.0] * 60, *[-1.0] * 40)
    assert not any(told[:41])
    assert all(told[41:100])
    assert not any(told[100:])
    assert not any(fallen(*np.linspace(0.0, -20.0, 200)))
