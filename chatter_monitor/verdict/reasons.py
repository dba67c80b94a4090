"""Why a verdict is what it is, in words for who stands at the machine."""

from __future__ import annotations

import math

from chatter_monitor.kernels.testimony import CARRIER_HZ
from chatter_monitor.tracking.comb import is_mains
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.verdict.evidence import ModeEvidence, Vibration
from chatter_monitor.verdict.same_cut import New
from chatter_monitor.verdict.vibrations import Followed

# Said of every interval in which something is cut.
DOUBTED = "what turns is not at the spindle speed that was told"
# Said once, in the interval after an alarm.
WITHDRAWN = "the alarm is withdrawn, for what it was about came at once and is on an order of what is heard to turn now"
CAME_WITH_TOOL = "the alarm is withdrawn, for what it was about came at once, and with the tool"


def warned(suspect: Followed) -> str:
    """What is not certain: whether it grows, or what makes it."""
    if suspect.kinds.risen < suspect.unexplained:
        return f"{_line(suspect)} begins to grow; not certain yet"
    return f"{_line(suspect)} has risen; it may grow by itself, or come from something that turns"


def louder(riser: Followed) -> str:
    """That a vibration is louder than it has been."""
    return f"{_line(riser)} is louder than it has been for seconds"


def surging(vibration: Vibration, surge: float) -> str:
    """That the cut has become louder by so much (natural logarithm of the amplitude), and a vibration with it."""
    risen = f"the vibration at {vibration.line.frequency_hz:.0f} Hz has risen"
    return f"{risen}, and the cut is {math.exp(surge):.1f} times as loud as half a second ago"


def chatter(alarm: Followed, orders: Orders) -> tuple[str, ...]:
    """What an alarm is about."""
    if alarm.heard is None:
        return ("the vibration has not died down since the alarm",)
    line, mode = alarm.heard.line, alarm.heard.mode
    told = [f"{_line(alarm)} {'grows' if alarm.kinds.growing > alarm.kinds.saturated else 'has grown'} by itself"]
    if orders.growth > 0.0:
        told.append(grown(orders.growth))
    if line.absolute_rise > 0.5:
        told.append(f"{math.exp(line.absolute_rise):.1f} times its amplitude of the last seconds")
    elif line.news > 0.5:
        told.append(f"it stands out {math.exp(line.news):.1f} times as much as in the cuts before")
    elif line.arrival > 0.5:
        told.append("it came with the tool")
    apart_hz = None if orders.sidebands is None else orders.sidebands.apart_hz(alarm.frequency_hz, CARRIER_HZ)
    if apart_hz is not None:
        told.append(f"it has sidebands {apart_hz:.1f} Hz apart and is no multiple of that")
    told.append(f"it takes {100 * line.share:.0f} % of the power that is not in multiples of a rotation")
    if mode is not None:
        told.append(f"damping {damping(mode)}")
    return tuple(told)


def loud(suspect: Followed, rise: float) -> str:
    """That what is suspected is an alarm, because the power is so many times what is usual."""
    return f"{_line(suspect)} has risen, and the cut is {_decibels(rise)} louder than before"


def irregular(rise: float) -> str:
    """That the cut is in no order any more, and has so many times its usual power."""
    return f"no two rotations are alike any more, and the cut is {_decibels(rise)} louder than before"


def cycle(frequency_hz: float, rise: float) -> str:
    """That a vibration keeps its amplitude and not its phase, in a cut that has so many times its lowest power."""
    steady = f"the vibration at {frequency_hz:.0f} Hz is steadier than noise, and no force keeps its phase"
    return f"{steady}; the cut is {_decibels(rise)} louder than it was"


def new(new: New, *, within: bool) -> str:
    """That a pass is as it was itself, or as the ones before, but for what is new in it."""
    same = f"what forces the cut is the same as {'before' if within else 'in the passes before'}"
    return f"{same}, but {100 * new.share:.0f} % of the power is new, most of it at {new.hertz:.0f} Hz"


def still_loud(rise: float) -> str:
    """That an alarm goes on, because the power is so many times what it was before."""
    return f"the vibration has not died down since the alarm: {_decibels(rise)} above the cut before it"


def grown(growth: float) -> str:
    """That what repeats from rotation to rotation has grown by so many e-folds."""
    return f"the waves come back after each rotation out of step, and grew {math.exp(growth):.1f} times"


def turning(orders: Orders) -> str:
    """How much of the power turns, and at which orders: of the spindle, or of another comb where that is not heard."""
    if orders.lines or orders.other_hz is None:
        hertz, whose, lines = orders.rotation_hz, str(orders.source), orders.lines
    else:
        whose = "the mains" if is_mains(orders.other_hz) else "not the spindle that was told"
        hertz, lines = orders.other_hz, orders.other_lines
    listed = ", ".join(f"{line.order} x" for line in lines[:3])
    multiples = "" if hertz is None else f" of {hertz:.1f} Hz ({whose}): {listed}"
    return f"{100 * orders.synchronous_share:.0f} % of the power is in multiples{multiples}"


def repeating(share: float) -> str:
    """How much of the power repeats."""
    return f"{100 * share:.0f} % of the power repeats after a rotation or several"


def steady(forced: Followed) -> str:
    """Which vibration is forced, and why it is taken for that."""
    on_order = forced.heard is not None and forced.heard.on_order
    if forced.kinds.risen > forced.kinds.steady:
        where = "is on an order of the spindle" if on_order else "may come from something that turns"
        return f"{_line(forced)} has risen, but {where}"
    if on_order:
        return f"{_line(forced)} is steady and on an order of the spindle"
    return f"{_line(forced)} is steady and was not seen to grow: something forces it"


def damping(mode: ModeEvidence) -> str:
    """Damping ratio of a mode with its 95 % interval."""
    return f"{100 * mode.damping_ratio:.2f} % ± {196 * mode.damping_sd:.2f} %"


def _decibels(times: float) -> str:
    return f"{10.0 * math.log10(times):.0f} dB"


def _line(vibration: Followed) -> str:
    return f"the vibration at {vibration.frequency_hz:.0f} Hz"
