"""What an interval says: its modes, and its lines with the mode at each and their place among the orders.

A row of ``heard[lines, FIELDS]`` is a line of the short-time spectrum as `kernels.lines` tells it, and what is added.
"""

import math

from numba import njit

from chatter_monitor.kernels.kinds import COHERENCE_LAG_S, coherence_damping
from chatter_monitor.kernels.lines import BIN, COHERENCE, MEASURES, SHARE
from chatter_monitor.kernels.median import medians_where
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.track import HELD, OSCILLATORY, STARTING
from chatter_monitor.kernels.vibrations import LINE_WIDTH_HZ

# Fields that are added: the tracker's mode at the line, `NO_MODE` if it has none there; the mode's damping ratio, or
# that of the line where it has none; whether it is near an order, and how likely that is of any frequency: an order of
# the rotation, or of the teeth where those of the rotation are too dense, NaN where both are; and one of the teeth.
MODE, DAMPING_RATIO, NEAR, BY_CHANCE, NEAR_TEETH, TEETH_BY_CHANCE = range(MEASURES, MEASURES + 6)
FIELDS = MEASURES + 6
HERTZ = BIN  # of a line that has left `tracking.spectrum`
NO_MODE = -1
# Of a mode: medians over the interval, the last one of the standard deviation, and share of the power.
MODE_HERTZ, MODE_DAMPING, MODE_DEVIATION, MODE_SHARE = range(4)

# A mode is looked at when it carries at least this share of the signal's power: the poles of a fit to little more than
# noise wander anywhere, zero damping included.
SIGNIFICANT_SHARE = 0.05
# A line is looked at when it carries at least this share: a sensor hears most of the structure, not all of it loud.
AUDIBLE_SHARE = 0.003
# A mode belongs to a line when their frequencies are this near, relatively or in Hz: lines are 40 Hz wide.
SAME_FREQUENCY = 0.05
# How near to an order a line has to be: the frequency of a line 40 Hz wide is known to some Hz, and the order to so
# many standard deviations of the speed.
ORDER_TOLERANCE_HZ = 6.0
# The frequency of a line that is as coherent as this is known better.
CLEAR_COHERENCE, CLEAR_TOLERANCE_HZ = 0.9, 3.0
SPEED_DEVIATIONS = 2.33
# The speed is an average, the frequency of a line that of now: a spindle wanders by so much in between (relatively).
WANDER = 0.002
# Orders that any frequency is this likely to be near are not told apart.
TELLING = 0.8
# Lines nearer to each other are one line to the short-time spectrum, somewhere between them.
RESOLUTION_HZ = 2.0 / COHERENCE_LAG_S


@njit(**OPTIONS)
def weigh(columns, status, hold, shares, lines, lowest_hz, speed, teeth, values, counts, modes, heard):
    """Summarise the modes of an interval, and place its lines.

    Parameters
    ----------
    columns : tuple of ndarray of float32, shape (samples, slots)
        Frequency, damping ratio and its standard deviation of each mode.
    status : ndarray of uint8, shape (samples, slots)
    hold : ndarray of int64, shape (slots,)
        As of `medians_where`.
    shares : ndarray of float64, shape (slots,)
        Of each mode in the power.
    lines : ndarray of float64, shape (n, MEASURES)
    lowest_hz : float
        The crest of what is below is beside it.
    speed : tuple of float, float and bool
        As of `place`.
    teeth : int
    values, counts : ndarray of float32 and int64, shape (samples,) and (slots, kinds of status)
        Work space.
    modes : ndarray of float64, shape (slots, 4)
        The result; NaN where a mode had no frequency for half of the interval or longer.
    heard : ndarray of float64, shape (>= n, FIELDS)
        The result, a row for each line that counts.

    Returns
    -------
    count, critical : int
        How many lines count; the least damped of the modes with a significant share, or `NO_MODE`.
    held, starting : bool
        Whether no sample could be adapted to; whether the tracker knows too little yet.
    """
    medians_where(columns, status, hold, OSCILLATORY, values, modes[:, :MODE_SHARE], counts)
    critical, held, starting = NO_MODE, True, False
    for m in range(modes.shape[0]):
        modes[m, MODE_SHARE] = shares[m]
        held &= counts[m, HELD] == status.shape[0]
        starting |= counts[m, STARTING] > 0
        significant = shares[m] >= SIGNIFICANT_SHARE and not math.isnan(modes[m, MODE_HERTZ])
        if significant and (critical == NO_MODE or modes[m, MODE_DAMPING] < modes[critical, MODE_DAMPING]):
            critical = m
    count = 0
    for i in range(lines.shape[0]):
        hertz = lines[i, HERTZ]
        if lines[i, SHARE] < AUDIBLE_SHARE or hertz < lowest_hz:
            continue
        line = heard[count]
        count += 1
        for k in range(MEASURES):
            line[k] = lines[i, k]
        mode = _mode_at(hertz, modes)
        line[MODE] = mode
        line[DAMPING_RATIO] = (
            coherence_damping(line[COHERENCE], hertz) if mode == NO_MODE else modes[mode, MODE_DAMPING]
        )
        tolerance_hz = CLEAR_TOLERANCE_HZ if line[COHERENCE] >= CLEAR_COHERENCE else ORDER_TOLERANCE_HZ
        line[NEAR_TEETH], line[TEETH_BY_CHANCE] = place(hertz, speed, teeth, tolerance_hz)
        line[NEAR], line[BY_CHANCE] = place(hertz, speed, 1, tolerance_hz)
        if not line[BY_CHANCE] < TELLING:
            line[NEAR], line[BY_CHANCE] = line[NEAR_TEETH], line[TEETH_BY_CHANCE]
        if not line[BY_CHANCE] < TELLING:
            line[NEAR], line[BY_CHANCE] = 0.0, math.nan
    return count, critical, held, starting


@njit(**OPTIONS)
def _mode_at(hertz, modes):
    """The least damped mode at a line's frequency."""
    reach = max(SAME_FREQUENCY, LINE_WIDTH_HZ / hertz)
    least = NO_MODE
    for m in range(modes.shape[0]):
        if math.isnan(modes[m, MODE_HERTZ]):
            continue
        near = abs(math.log(modes[m, MODE_HERTZ] / hertz)) < reach
        if near and (least == NO_MODE or modes[m, MODE_DAMPING] < modes[least, MODE_DAMPING]):
            least = m
    return least


@njit(**OPTIONS)
def place(hertz, speed, spacing, tolerance_hz):
    """Whether a frequency cannot be told from a multiple of so many times the rotation, and how likely any cannot.

    ``tolerance_hz`` is how exactly it is known. ``speed`` is the rotation in Hz, NaN where it is unknown, its standard
    deviation over it, and whether that is the given speed as it came: as long as the spindle is not heard its lines are
    still in the signal; those that are not resolved may be anywhere.
    """
    rotation_hz, deviation, given = speed
    if math.isnan(rotation_hz):
        return 0.0, math.nan
    spacing_hz = rotation_hz * spacing
    if given and spacing_hz < RESOLUTION_HZ:
        return 1.0, 1.0
    tolerance_hz = max(tolerance_hz, SPEED_DEVIATIONS * max(deviation, WANDER) * hertz)
    order = round(hertz / spacing_hz)
    near = order >= 1 and abs(hertz - order * spacing_hz) < tolerance_hz
    return 1.0 if near else 0.0, min(2.0 * tolerance_hz / spacing_hz, 1.0)
