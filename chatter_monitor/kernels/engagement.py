"""Whether the tool is in the cut, from how loud it is between the lines.

The mean logarithm of the power of all bins minds no line, however strong: it is the level of the noise, that of cutting
or that of the room. When the tool leaves the cut it falls at once, and the whole becomes quieter; as long as both stay
so, nothing is being cut. What it falls to next time is learned anew, for a room changes. As long as nothing has fallen
the tool is taken to be in the cut: who does not know misses nothing. When the room itself gets louder it is taken to be
in the cut, too; but what begins at once where all was fainter than the cut before, its comb included, is the tool that
enters. Where it was as loud as that, before it chattered, it is the next cut, and nothing enters it. As long as no cut
is known, the tool is what begins where nothing but noise was heard, and maybe the one steady tone of a pump, if it
lifts the noise at once as well, or is several lines: a vibration that grows by itself comes before the noise that it
makes, takes nearly all of the power, and is below its overtones. So is what is there at once, noise or not: growth
takes time. But where a mode had sounded, in a machine that rings, it has to be far louder than that, and where teeth
were heard the tool is in the cut.
Lines that stay as they were while all else gets louder are a pump's and count as silence, and so they do when the whole
falls and nothing else is left. Of a cut in a loud room nothing but its comb may have been heard: the tool has left when
all of the signal falls, comb and all, nothing repeats any more, and nothing but noise is left. What falls while most of
what is heard goes on, fainter, is a cut that gets lighter, or one whose comb is taken out from then on. Until there is
enough of that to compare with, the tool has left when all of the signal falls, between the lines, too.

A tool brings its lines with its noise. Where a line goes on to stand out more and more after the noise of what was
taken for the first tool to enter has come, that is taken back: it grows by itself, and out of all that was before.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.median import median
from chatter_monitor.kernels.multiples import LARGEST_CHANCE, by_chance
from chatter_monitor.kernels.options import OPTIONS, WITHIN
from chatter_monitor.kernels.prominence import LOBE, TINY, crest, share
from chatter_monitor.kernels.rise import height

DECIBEL = math.log(10.0) / 10.0
# The level falls by so much when the tool leaves the cut; the whole signal does, too, or is a tone that goes on.
FALL = 8.0 * DECIBEL
# How near to the level of the air it is air, and how quickly that is followed, in a frame.
NEAR, FOLLOWING = 4.0 * DECIBEL, 0.02
# Frames that a fall may take, and frames before it that it is measured from; half of them do at the start.
FALLING, BEFORE = 4, 16
# Nothing but noise is heard as long as no line stands out by so much: the highest of 250 bins of noise does by 6 dB.
NOISE = 7.0 * DECIBEL
# A lone line with its skirts lifts the level, too, by a sixth of its height at most; a tool that enters by more.
LONE = 0.2
# What stands out by less is faint, a tenth of the power of noise at most.
FAINT = 15.0 * DECIBEL
# What is louder by so much within so many transforms is the tool: to grow by that out of a tenth of the power in 25 ms,
# a vibration would have to grow e-fold in 10 ms.
LEAP, AT_ONCE = 12.0 * DECIBEL, 2
# A line is one of several where it has so much of the power, which is enough for chatter, too.
LOUD = 0.2
# What grows alone has most of what is so much louder by then.
MOST = 0.6
# A line that is alone has so much.
NEARLY_ALL = 0.9
# How near to a multiple of another a line is one, in bins, as a frame tells; and how far the other has to stand out.
MULTIPLE, FUNDAMENTAL = 0.12, 12.0 * DECIBEL
# An idle machine may ring, too, but so far below its cut.
RINGING = 20.0 * DECIBEL
# Teeth are heard, whether any of their lines stands out or not, where so much of the power repeats.
TEETH = 0.2
# What goes on to rise by so much in two frames, out of noise that has come, grows by itself.
GOES_ON = 10.0 * DECIBEL
# The tool has entered when the level has not risen by so much in so many frames; it takes a second at most.
STILL, ENTERING, LONGEST = 1.5 * DECIBEL, 3, 20

# Indices of what is known of the air: its level, the logarithm of the power that it does not reach, that of the cut
# before it, and frames since it ended, those in which the tool enters and all; frames since the cut has got lighter;
# whether the cut before it was no louder between the lines; the whole power before it fell, as long as it has not
# come back, without what turns and with it; that with what turns which it does not reach, if beside a pump; and the
# power of this cut where it was lightest, for it is louder where it chatters. That is also what is kept of the one
# before. Of both once more with what turns.
LEVEL, LIMIT, CUT, ENTERED, SINCE, ALIKE, ALONE, RESIDUAL, WHOLE, WHOLE_LIMIT, LIGHTEST = range(11)
WHOLE_LIGHTEST, WHOLE_CUT = range(11, 13)
# And whether what stood out most when the tool seemed to enter had been a mode before.
FAMILIAR = 13


def new_air():
    """Nothing is known of it; the tool is in the cut."""
    air = np.full(FAMILIAR + 1, -math.inf)
    air[[SINCE, WHOLE_LIMIT, LIGHTEST, WHOLE_LIGHTEST]] = math.inf
    air[ENTERED], air[ALIKE], air[ALONE], air[FAMILIAR] = LONGEST, 0.0, 0.0, 0.0
    return air


class Rings(NamedTuple):
    """What has been heard of the latest frames, shape (frames,) each; powers as their natural logarithms.

    Attributes
    ----------
    levels, powers : ndarray
        Mean over the bins of the logarithm of their power, and the whole power.
    wholes : ndarray
        Power with what turns, before it is taken out.
    crests : ndarray
        How far the line that stands out most does, infinite where something turns.
    repeating : ndarray
        Share of the power that repeats (`kernels.repeats`).
    """

    levels: np.ndarray
    powers: np.ndarray
    wholes: np.ndarray
    crests: np.ndarray
    repeating: np.ndarray


class Signs(NamedTuple):
    """What else tells, in the newest frame, whether the tool enters or leaves.

    Attributes
    ----------
    fainter : bool
        Whether it has got fainter though most of what is heard goes on, or is taken out of it from now on.
    pump : bool
        Whether all that stands out was there, as loud, before a fall (`is_pump`).
    leapt : bool
        Whether the whole became louder at once (`has_leapt`).
    beside : tuple of float
        By how much all has got louder beside a pump, and how far a line of it stands out (`louder_beside_pump`).
    familiar : bool
        Whether what stands out most by now did so, less, before all got louder (`kernels.hump`).
    several : bool
        Whether several lines have come (`are_several`).
    quiet : bool
        Whether nothing was heard above the noise before that, but for a steady tone.
    largest : float
        Share of the power of the line that stands out most.
    """

    fainter: bool
    pump: bool
    leapt: bool
    beside: tuple[float, float]
    familiar: bool
    several: bool
    quiet: bool
    largest: float


@njit(**OPTIONS)
def engaged(rings, signs, head, air, scratch):
    """Whether the tool is in the cut and has been for a moment.

    Parameters
    ----------
    rings : Rings
    signs : Signs
    head : int
        Column of the rings after the newest, counted from the start without wrapping.
    air : ndarray of float64, shape (14,)
        What is known of the air, changed in place.
    scratch : ndarray, shape (>= BEFORE,)
        Work space.
    """
    levels, powers = rings.levels, rings.powers
    columns = levels.shape[0]
    newest, last = (head - 1) % columns, (head - 2) % columns
    level, power = levels[newest], powers[newest]
    air[ALIKE] += 1.0
    whole = rings.wholes[newest]
    out = level <= air[LEVEL] + NEAR and power <= air[LIMIT] and whole <= air[WHOLE_LIMIT]
    noise = max(rings.crests[newest], rings.crests[last]) < NOISE
    gone = not out and rings.repeating[newest] < TEETH and _fallen(rings.wholes, head, head, scratch)
    if out:
        air[LEVEL] += (level - air[LEVEL]) * (1.0 if level < air[LEVEL] else FOLLOWING)
        # what had still to die out when it fell is not the air
        air[LIMIT] += min(0.0, max(air[CUT] - FALL, power + NEAR) - air[LIMIT]) * FOLLOWING
    elif air[ALIKE] >= FALLING + BEFORE // 2:
        alike = air[ALIKE]
        whole_before = _before(rings.wholes, head, alike, scratch)
        if air[SINCE] >= FALLING + BEFORE:
            air[LIGHTEST] = min(air[LIGHTEST], _before(powers, head, alike, scratch))
            air[WHOLE_LIGHTEST] = min(air[WHOLE_LIGHTEST], whole_before)
        fell_between = _fallen(levels, head, alike, scratch)
        only_noise = noise and _fallen(powers, head, alike, scratch)
        only_pump = signs.pump and _fallen(rings.wholes, head, alike, scratch)
        if fell_between or only_noise or only_pump or (noise and gone):
            out = not signs.fainter
            air[ALIKE] = alike if out else 0.0
        if out:
            _leave(rings, fell_between, fell_between or only_noise, head, alike, air, scratch)
        elif air[ENTERED] >= LONGEST:
            out = _enters(rings, signs, whole_before, head, air, scratch)
            air[FAMILIAR] = signs.familiar
    elif gone:
        fell_between = _fallen(levels, head, head, scratch)
        out = fell_between or noise
        if out:
            _leave(rings, fell_between, fell_between, head, head, air, scratch)
    if out:
        air[ENTERED] = air[SINCE] = 0.0
        return False
    if air[SINCE] == 0.0:
        air[LIGHTEST] = air[WHOLE_LIGHTEST] = math.inf
    air[SINCE] += 1.0
    if air[ENTERED] < LONGEST:
        air[ENTERED] += 1.0
        first, before = air[LEVEL] == -math.inf, _before(levels, head, air[ALIKE], scratch)
        alone = air[FAMILIAR] and signs.largest >= NEARLY_ALL and air[ENTERED] >= ENTERING
        if first and (_goes_on(levels, rings.crests, before, head) or (alone and _no_noise_came(rings, before, head))):
            air[ENTERED], air[SINCE], air[ALIKE] = LONGEST, math.inf, 0.0
            return True
        rises = level - levels[(head - 1 - ENTERING) % columns] > STILL
        if air[ENTERED] > ENTERING and not rises:
            air[ENTERED] = LONGEST
    return bool(air[ENTERED] >= LONGEST)


@njit(**OPTIONS)
def _leave(rings, fell_between, fell_without, head, alike, air, scratch):
    """Learn of the air, and of the cut before it, when the tool leaves: what fell between the lines, or without a comb.

    Beside a pump, or in a loud room, a cut whose comb is taken out may be as quiet as the air; with it, it is not.
    """
    newest = (head - 1) % rings.levels.shape[0]
    air[CUT] = min(air[LIGHTEST], _before(rings.powers, head, alike, scratch))
    air[WHOLE_CUT] = min(air[WHOLE_LIGHTEST], _before(rings.wholes, head, alike, scratch))
    air[LEVEL] = rings.levels[newest]
    air[LIMIT] = max(air[CUT] - FALL, rings.powers[newest] + NEAR)
    air[WHOLE_LIMIT] = math.inf if fell_without else rings.wholes[newest] + NEAR
    air[ALONE] = not fell_between


@njit(**OPTIONS)
def _enters(rings, signs, whole_before, head, air, scratch):
    """Whether the tool has just come, though it was taken to be in the cut: what was heard, so loud, was the room."""
    levels, powers, crests = rings.levels, rings.powers, rings.crests
    columns = levels.shape[0]
    newest, then = (head - 1) % columns, (head - 1 - FALLING) % columns
    louder = powers[newest] - powers[then] >= FALL
    rise, (louder_beside, crest_beside) = levels[newest] - levels[then], signs.beside
    pump = louder_beside >= FALL
    rose = louder and rise >= max(NEAR, LONE * crests[newest])
    if air[CUT] > -math.inf:
        if whole_before > air[WHOLE_CUT] - FALL:
            return False
        if rose:
            return True
    if not (louder or pump):
        return False
    crest = _before(crests, head, air[ALIKE], scratch)
    repeats = _before(rings.repeating, head, air[ALIKE], scratch)
    pump &= crest < math.inf
    quiet = signs.quiet and crest < math.inf
    out_of_noise = louder and (rose or signs.several) and (crest < NOISE or quiet) and not signs.familiar
    beside_pump = pump and rise >= max(NEAR, LONE * crest_beside)
    faint = (crest < FAINT or pump) and repeats < TEETH and powers[newest] - powers[then] >= RINGING
    return out_of_noise or beside_pump or (signs.leapt and (quiet or faint))


@njit(**OPTIONS)
def are_several(relief, power, total, peaks):
    """Whether of these bins, the one that stands out most first, several are lines of a tool that has come.

    Two are loud, and none has most of the power; or another stands out, too, at a lower frequency, and is loud, or the
    first one a multiple of it. Teeth bring several lines at once. What grows by itself takes nearly all of the power;
    its overtones are above it.
    """
    loud, most, below = 0, False, False
    for b in peaks:
        part = share(power, total, b)
        loud += part >= LOUD
        most |= part >= MOST
        if b < peaks[0]:
            below |= relief[b] >= FAINT and part >= LOUD
            below |= relief[b] >= FUNDAMENTAL and _is_multiple(peaks[0] + crest(power, peaks[0]), b + crest(power, b))
    return below or (loud > 1 and not most)


@njit(**OPTIONS)
def _is_multiple(highest, lower):
    """Whether a line is at a multiple of another, as it would hardly be by chance; both in bins."""
    times = round(highest / lower)
    hardly = by_chance(times, MULTIPLE, lower) < LARGEST_CHANCE
    return times > 1 and hardly and abs(highest - times * lower) < times * MULTIPLE


@njit(**OPTIONS)
def _goes_on(levels, crests, before, head):
    """Whether the line that stands out most does so more and more, faster and faster, though the noise has come.

    What a force drives slows down from the start on. Before it came, the level was so high.
    """
    columns = crests.shape[0]
    now, last, then = (head - 1) % columns, (head - 2) % columns, (head - 3) % columns
    come = levels[then] >= before + NEAR and levels[now] <= levels[then] + STILL
    if not (come and max(crests[now], crests[then]) < math.inf):
        return False
    first, second = crests[last] - crests[then], crests[now] - crests[last]
    return STILL <= first <= second and first + second >= GOES_ON


@njit(**OPTIONS)
def _no_noise_came(rings, before, head):
    """Whether all is as loud between the lines as before, beyond what a lone line lifts, and that does not die down."""
    columns = rings.levels.shape[0]
    now, last, then = (head - 1) % columns, (head - 2) % columns, (head - 3) % columns
    stays = rings.powers[now] >= max(rings.powers[last], rings.powers[then]) - STILL
    crest = rings.crests[now]
    return stays and crest < math.inf and rings.levels[now] - before < max(FALL, LONE * crest)


@njit(**OPTIONS)
def has_leapt(spectra, valid, taken, hops, lowest, powers, head):
    """Whether the whole has become louder at once within the last two frames, out of what it was before them.

    Parameters
    ----------
    spectra, valid : ndarray, shapes (bins, columns) and (columns,)
        Ring of transforms, and whether they are of whole stretches; bins count from ``lowest`` on.
    taken, hops : int
        Transforms in it, counted from the start, and those of a frame.
    powers, head
        As of `Rings` and `engaged`.
    """
    if head < 3 or taken < 3 * hops:
        return False
    before = powers[(head - 3) % powers.shape[0]]
    if powers[(head - 1) % powers.shape[0]] - before < LEAP:
        return False
    for hop in range(taken - 2 * hops, taken):
        column, earlier = hop % valid.shape[0], (hop - AT_ONCE) % valid.shape[0]
        calm = valid[column] and valid[earlier] and _whole(spectra, earlier, lowest) <= before + STILL
        if calm and _whole(spectra, column, lowest) >= before + LEAP:
            return True
    return False


@njit(**OPTIONS)
def louder_beside_pump(reliefs, powers, levels, lowest, head):
    """By how much all but the lines has got louder, and how far its highest line stands out by now.

    Nothing where a line that stood out is not as loud as it was, or none did, or the noise between them has not risen.

    Parameters
    ----------
    reliefs, powers : ndarray, shape (bins, frames)
        Rings of prominences and of logarithms of the power; bins count from ``lowest`` on.
    levels
        As of `Rings`.
    lowest, head
        As of `has_leapt`.

    Returns
    -------
    tuple of float
        Both natural logarithms of the power.
    """
    if head < FALLING + 2:
        return 0.0, 0.0
    now, then = (head - 1) % levels.shape[0], (head - 1 - FALLING) % levels.shape[0]
    if levels[now] - levels[then] < NEAR or not _go_on(reliefs, powers, lowest, FAINT, head - 1 - FALLING, now):
        return 0.0, 0.0
    after = before = TINY
    crest = 0.0
    for b in range(lowest, reliefs.shape[0]):
        if not _is_line(reliefs[:, then], lowest, b):
            after += math.exp(powers[b, now])
            before += math.exp(powers[b, then])
            crest = max(crest, reliefs[b, now])
    return math.log(after / before), crest


@njit(**OPTIONS)
def is_pump(reliefs, powers, crests, lowest, head):
    """Whether lines stand out, each of them as loud as before a fall, one of them all the time.

    Not where something that turns is taken out. Parameters as of `louder_beside_pump` and `Rings`.
    """
    now, then = (head - 1) % powers.shape[1], (head - 1 - BEFORE) % powers.shape[1]
    if head <= BEFORE or crests[now] == math.inf or crests[now] < NOISE:
        return False
    return _go_on(reliefs, powers, lowest, NOISE, head - 1, then)


@njit(**OPTIONS)
def _go_on(reliefs, powers, lowest, least, frame, other):
    """Whether lines stand out by so much in a frame, counted from the start, each of them as loud in another column.

    One of them has to be steady. A mode in noise stands out as far at times, and may be as loud again, but not always.
    """
    here, found = frame % powers.shape[1], False
    for b in range(lowest + 1, reliefs.shape[0] - 1):
        if reliefs[b, here] >= max(least, height(reliefs, b, here)):
            if abs(height(powers, b, other) - height(powers, b, here)) > STILL:
                return False
            steady = True
            for earlier in range(max(0, frame - BEFORE), frame, FALLING):
                column = earlier % powers.shape[1]
                steady &= abs(height(powers, b, column) - height(powers, b, here)) <= STILL
            found |= steady
    return found


@njit(**OPTIONS)
def _is_line(relief, lowest, b):
    """Whether a bin is within the lobe of a line."""
    line = False
    for i in range(max(lowest, b - LOBE), min(relief.shape[0], b + LOBE + 1)):
        line |= relief[i] >= FAINT
    return line


@njit(**WITHIN)
def _whole(spectra, column, lowest):
    """Logarithm of the whole power of a transform."""
    power = 0.0
    for b in range(lowest, spectra.shape[0]):
        power += spectra[b, column].real ** 2 + spectra[b, column].imag ** 2
    return math.log(power + TINY)


@njit(**OPTIONS)
def fell(powers, wholes, head, air, scratch):
    """Whether the whole has fallen at once, and not come back since: with what turns, or what is left without it.

    What rises by itself comes on top of all else; what stands out when all else has become fainter has come to light.
    Parameters as of `Rings` and `engaged`.
    """
    return _stays_fallen(powers, RESIDUAL, head, air, scratch) | _stays_fallen(wholes, WHOLE, head, air, scratch)


@njit(**OPTIONS)
def _stays_fallen(powers, index, head, air, scratch):
    """Whether one of both has; the power that it had before is at this index of what is known."""
    air[index] = max(air[index], _before_fall(powers, head, head, scratch))
    if powers[(head - 1) % powers.shape[0]] > air[index] - NEAR:
        air[index] = -math.inf
    return air[index] > -math.inf


@njit(**OPTIONS)
def _before_fall(values, head, alike, scratch):
    """Median of the frames before, as of `_before`, if both of the last are far below it; else minus infinity."""
    if alike < FALLING + BEFORE // 2:
        return -math.inf
    last = max(values[(head - 1) % values.shape[0]], values[(head - 2) % values.shape[0]])
    before = _before(values, head, alike, scratch)
    return before if last <= before - FALL else -math.inf


@njit(**OPTIONS)
def _fallen(values, head, alike, scratch):
    """Whether both of the last frames are far below those before, of so many that are alike."""
    return _before_fall(values, head, alike, scratch) > -math.inf


@njit(**OPTIONS)
def _before(values, head, alike, scratch):
    """Median of the frames before a fall, of so many that are alike."""
    count = min(BEFORE, int(alike) - FALLING)
    for i in range(count):
        scratch[i] = values[(head - 1 - FALLING - i) % values.shape[0]]
    return median(scratch[:count])
