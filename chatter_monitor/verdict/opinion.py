"""What an interval is called, given what has been followed so far: one word, how sure, and why."""

from __future__ import annotations

import math
from typing import NamedTuple

from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.vibrations import JUST_NOW
from chatter_monitor.records import State
from chatter_monitor.tracking.orders import Source
from chatter_monitor.verdict import reasons
from chatter_monitor.verdict.evidence import Evidence, Vibration, probability_below
from chatter_monitor.verdict.probability import Grounds, Signs
from chatter_monitor.verdict.settings import JudgeSettings
from chatter_monitor.verdict.vibrations import Followed, Told

# From this share of the power on, what turns with the spindle comes before a warning, but for what has got louder.
MOST = 0.5
# How likely more than half of the power is forced, by the share that is heard as such, fitted to development cuts
# without tones from elsewhere: with none of it; the share half-way to certainty, and how far from it the odds change
# e-fold.
FORCED_WITH_NONE = 0.01
HALF_WAY, SHARE_DOUBT = 0.645, 0.11
# Where most of the power is forced for certain, and there is no chatter, so many of the warnings are wrong: it is
# forced in truth (``python -m benchmarks.verdict.probability``).
WRONG_WHERE_FORCED = 0.65
# Of what is forced so much is heard as steady: the rest is unsteady, or in lines too weak to stand out.
HEARD_AS_STEADY = 0.67
# By so much the share may be below the border before what was called forced is not any more, and the other way round.
HYSTERESIS = 0.05

# Relative distance within which frequencies belong to one vibration.
SAME_VIBRATION = 0.1


class Memory(NamedTuple):
    """What the judge remembers from one interval to the next.

    Attributes
    ----------
    loudest : float
        Largest rms, forgotten with a time constant of a minute.
    told : Told
        What is told of the vibrations that are followed.
    synchronous : float
        Share of the power that turns with the spindle, averaged over some intervals.
    steady : float
        That of all that is heard as forced because it turns or is steady, averaged likewise.
    repeating : float
        Share of the power that repeats from rotation to rotation.
    forced_share : float
        Share of the power that is forced: what repeats, or what is steady and what stands for it, if that is more.
    forced : bool
        Whether the last interval was called forced.
    undamped : bool
        Whether its damping was surely as good as none.
    since_alarm : float
        Intervals since the last one that was called chatter.
    alarm_hz : float or None
        Where that was.
    source : str or None
        How the speed was known in the last interval.
    louder, surge : float
        By how much it is louder than in the last cuts, and than half a second ago (natural logarithm of the amplitude).
    signs : Signs or None
        What told how likely the last interval was chatter, if something was cut.
    """

    loudest: float = 0.0
    told: Told = Told()
    synchronous: float = 0.0
    steady: float = 0.0
    repeating: float = 0.0
    forced_share: float = 0.0
    forced: bool = False
    undamped: bool = False
    since_alarm: float = math.inf
    alarm_hz: float | None = None
    source: Source | None = None
    louder: float = 0.0
    surge: float = 0.0
    signs: Signs | None = None

    @property
    def calm(self) -> bool:
        """Whether there has been no alarm just now."""
        return self.since_alarm >= JUST_NOW


class Opinion(NamedTuple):
    """What an interval is called.

    Attributes
    ----------
    state : State
        The word.
    right : float
        How likely that is right if it chatters, of an alarm, or if it does not, of all other words.
    reasons : tuple of str
        Why.
    vibration : Vibration or None
        Which one is meant.
    surging : bool
        Whether that is because it gets louder from one moment to the next.
    hertz : float or None
        Where an alarm is that is about none of the lines of this interval, as far as that is known.
    """

    state: State
    right: float
    reasons: tuple[str, ...]
    vibration: Vibration | None = None
    surging: bool = False
    hertz: float | None = None

    @property
    def frequency_hz(self) -> float | None:
        """Where what is meant is."""
        return self.hertz if self.vibration is None else self.vibration.line.frequency_hz

    @property
    def grounds(self) -> Grounds | None:
        """What its probability of chatter is to be told from; None where nothing is cut, or nobody knows."""
        match self.state:
            case "self_excited":
                return "alarm"
            case "approaching":
                return "surge" if self.surging else "warning"
            case "stable" | "forced":
                return "calm"
            case "idle" | "unknown":
                return None


def opinion(evidence: Evidence, memory: Memory, settings: JudgeSettings) -> Opinion:
    """What an interval is, given what has been followed so far."""
    told = memory.told
    alarm = told.alarm
    if alarm is not None:
        return alarm_about(alarm, reasons.chatter(alarm, evidence.orders))
    forced = forced_by(memory.forced_share)
    suspect = told.suspect if told.overview.heard_suspicion >= settings.warning_probability else None
    riser = told.riser
    surging = _surging(evidence, memory)
    if memory.synchronous > MOST and riser is None and surging is None:
        return Opinion("forced", forced, *_why_forced(evidence, memory, settings))
    if suspect is not None:
        return _warning(forced, reasons.warned(suspect), suspect.heard)
    if riser is not None:
        return _warning(forced, reasons.louder(riser), riser.heard)
    if evidence.orders.growth > 0.0:
        return _warning(forced, reasons.grown(evidence.orders.growth))
    if surging is not None:
        return _warning(forced, reasons.surging(surging, memory.surge), surging)._replace(surging=True)
    if _is_mostly_forced(memory, settings):
        return Opinion("forced", forced, *_why_forced(evidence, memory, settings))
    return _stable_or_near(evidence, memory, forced, settings)


def alarm_about(followed: Followed, why: tuple[str, ...]) -> Opinion:
    """An alarm about a vibration, whether its line is heard in this interval or not."""
    return Opinion("self_excited", 1.0, why, followed.heard, hertz=followed.frequency_hz)


def _surging(evidence: Evidence, memory: Memory) -> Vibration | None:
    """That with most power, where it has got louder by itself, and the cut with it, from one moment to the next."""
    surging = memory.surge >= LOUDER and evidence.vibrations.own_rise >= LOUDER
    return evidence.vibrations.loudest if surging else None


def _warning(forced: float, why: str, vibration: Vibration | None = None) -> Opinion:
    """An early warning, where so likely most of the power is forced."""
    return Opinion("approaching", 1.0 - WRONG_WHERE_FORCED * forced, (why,), vibration)


def entering(memory: Memory, settings: JudgeSettings) -> Opinion:
    """What a cut is that begins: of its lines nothing is known yet, but whether it repeats is heard."""
    forced = forced_by(memory.forced_share)
    if _is_mostly_forced(memory, settings):
        return Opinion("forced", forced, ("the tool enters the cut", reasons.repeating(memory.repeating)))
    return Opinion("stable", 1.0 - forced, ("the tool enters the cut",))


def _is_mostly_forced(memory: Memory, settings: JudgeSettings) -> bool:
    """Whether the share that is forced is beyond the border."""
    return memory.forced_share > settings.forced_share + (-HYSTERESIS if memory.forced else HYSTERESIS)


def stands_for(steady: float) -> float:
    """Share of the power that is forced, by that which is heard as steady."""
    return min(steady / HEARD_AS_STEADY, 1.0)


def forced_by(share: float) -> float:
    """Probability that more than half of the power is forced, by the share that is heard as such."""
    return FORCED_WITH_NONE + (1.0 - FORCED_WITH_NONE) / (1.0 + math.exp((HALF_WAY - share) / SHARE_DOUBT))


def _stable_or_near(evidence: Evidence, memory: Memory, forced: float, settings: JudgeSettings) -> Opinion:
    """Among what neither is chatter nor forced: how much is left."""
    margin, mode = evidence.margin, evidence.critical
    if margin.margin_ci95 is not None and margin.margin_ci95[1] < settings.approaching_margin_percent:
        why = f"only {max(margin.margin_percent or 0.0, 0.0):.0f} % more depth before it chatters"
        return _warning(forced, why)
    if mode is None:
        return Opinion("stable", 1.0 - forced, ("no mode stands out",))
    where = f"damping {reasons.damping(mode)} at {mode.frequency_hz:.0f} Hz"
    # One interval, the second of a recording above all, says little that the next does not take back.
    # What something forces reads as undamped.
    undamped = memory.undamped and is_undamped(evidence, settings)
    if undamped and not memory.told.is_forced(mode.frequency_hz, SAME_VIBRATION):
        return _warning(forced, where)
    return Opinion("stable", 1.0 - forced, (where,))


def is_undamped(evidence: Evidence, settings: JudgeSettings) -> bool:
    """Whether little damping is left, as far as one interval tells."""
    mode = evidence.critical
    return mode is not None and probability_below(mode, settings.approaching_damping) >= settings.certainty


def _why_forced(
    evidence: Evidence, memory: Memory, settings: JudgeSettings
) -> tuple[tuple[str, ...], Vibration | None]:
    """Why most of the power is forced, and by which vibration: what is steady, where that alone would be enough."""
    strongest = memory.told.steadiest
    turns = strongest is None or memory.synchronous > 0.5 * memory.forced_share
    vibration = None if strongest is None or turns else strongest.heard
    if stands_for(memory.steady) > settings.forced_share:
        if turns and evidence.orders.heard:
            return (reasons.turning(evidence.orders),), None
        if strongest is not None:
            return (reasons.steady(strongest),), strongest.heard
    if memory.repeating > memory.synchronous:
        return (reasons.repeating(memory.repeating),), vibration
    return ("most of the power was steady until just now",), vibration
