"""From evidence to a state: whether the machine idles, cuts, is forced, comes near chatter, or chatters.

What each vibration is, is followed by `verdict.vibrations`; here the probabilities become one word, with reasons.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import msgspec

from chatter_monitor.kernels.vibrations import Rules
from chatter_monitor.records import Flag, State, Verdict
from chatter_monitor.verdict import reasons
from chatter_monitor.verdict.evidence import Evidence, ModeEvidence, Vibration, probability_below, spindle_order
from chatter_monitor.verdict.vibrations import Following, Told, repeating_share, steady_share

# States in which a cut has no margin: none is made, nothing is known, or there is nothing left of it.
WITHOUT_MARGIN = ("idle", "unknown", "self_excited")
# Flags under which nothing is claimed. Clipping alone bends the waveform but leaves frequency and damping readable.
DEAF = Flag.GAP | Flag.OVERFLOW | Flag.NON_FINITE | Flag.DEAD_CHANNEL

# From this share of the power on, what turns with the spindle comes before a warning.
MOST = 0.5
# How likely more than half of the power is forced, by the share that is heard as such, fitted to development cuts
# without tones from elsewhere: with none of it; the share half-way to certainty, and how far from it the odds change
# e-fold.
FORCED_WITH_NONE = 0.01
HALF_WAY, SHARE_DOUBT = 0.57, 0.11
# Of the warnings that come long before an alarm, so many were right, likewise: the others were late, or forced.
WARNING_RIGHT = 0.4
# Of what is forced so much is heard as steady: the rest is unsteady, or in lines too weak to stand out.
HEARD_AS_STEADY = 0.67
# By so much the share may be below the border before what was called forced is not any more, and the other way round.
HYSTERESIS = 0.05
# Weight of an interval in the average of the shares: what is said does not flicker.
AVERAGING = 0.15

# Relative distance within which frequencies belong to one vibration.
SAME_VIBRATION = 0.1

Probability = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Positive = Annotated[float, msgspec.Meta(gt=0)]


class JudgeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Thresholds of the verdict: the table ``[verdict]`` of a machine configuration.

    Attributes
    ----------
    alarm_probability : float
        Probability of self-excitation from which on it is an alarm.
    calm_probability : float
        Probability below which a running alarm ends. It may not be above `alarm_probability`.
    warning_probability : float
        Probability of self-excitation from which on it is `approaching`.
    approaching_damping : float
        Damping below which little is left: the early warning, too.
    approaching_margin_percent : float
        Margin below which little is left, where it is known.
    certainty : float
        Probability with which damping or margin has to be below its threshold.
    forced_share : float
        Share of the power that is forced from which on the cut is called forced.
    idle_ratio : float
        Below this share of the loudest level of the last minute, nothing is being cut.
    """

    alarm_probability: Probability = 0.8
    calm_probability: Probability = 0.5
    warning_probability: Probability = 0.1
    approaching_damping: Positive = 0.003
    approaching_margin_percent: Positive = 15.0
    certainty: Probability = 0.9
    forced_share: Probability = 0.45
    idle_ratio: Probability = 0.003

    def __post_init__(self) -> None:
        if self.calm_probability > self.alarm_probability:  # an alarm would end with the interval that it begins with
            msg = (
                f"calm_probability must not be above alarm_probability ({self.alarm_probability}),"
                f" got {self.calm_probability}"
            )
            raise ValueError(msg)


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
    """

    loudest: float = 0.0
    told: Told = Told()
    synchronous: float = 0.0
    steady: float = 0.0
    repeating: float = 0.0
    forced_share: float = 0.0
    forced: bool = False
    undamped: bool = False


class Opinion(NamedTuple):
    """State, how sure, why, and which vibration is meant."""

    state: State
    confidence: float
    reasons: tuple[str, ...]
    vibration: Vibration | None = None


def opinion(evidence: Evidence, memory: Memory, settings: JudgeSettings) -> Opinion:
    """What an interval is, given what has been followed so far."""
    told = memory.told
    alarm = told.alarm
    if alarm is not None:
        return Opinion("self_excited", alarm.self_excited, reasons.chatter(alarm, evidence.orders.growth), alarm.heard)
    calm = 1.0 - told.overview.suspicion
    forced = _forced_by(memory.forced_share)
    if memory.synchronous > MOST:
        return Opinion("forced", calm * forced, *_why_forced(evidence, memory, settings))
    suspect = told.suspect if told.overview.heard_suspicion >= settings.warning_probability else None
    if suspect is not None:
        return Opinion("approaching", WARNING_RIGHT * calm, (reasons.warned(suspect),), suspect.heard)
    if evidence.orders.growth > 0.0:
        return Opinion("approaching", WARNING_RIGHT * calm, (reasons.grown(evidence.orders.growth),))
    if _is_mostly_forced(memory, settings):
        return Opinion("forced", calm * forced, *_why_forced(evidence, memory, settings))
    return _stable_or_near(evidence, memory, calm * (1.0 - forced), settings)


def _quiet(evidence: Evidence, memory: Memory, settings: JudgeSettings) -> str | None:
    """Why nothing is being cut; None where it is."""
    if evidence.held:
        return "nothing moves"
    if evidence.rms <= settings.idle_ratio * memory.loudest:
        return "far below the level of cutting"
    return None if evidence.cutting or evidence.entering else "the tool is not in the cut"


def _entering(memory: Memory, settings: JudgeSettings) -> Opinion:
    """What a cut is that begins: of its lines nothing is known yet, but whether it repeats is heard."""
    forced = _forced_by(memory.forced_share)
    if _is_mostly_forced(memory, settings):
        return Opinion("forced", forced, ("the tool enters the cut", reasons.repeating(memory.repeating)))
    return Opinion("stable", 1.0 - forced, ("the tool enters the cut",))


def _is_mostly_forced(memory: Memory, settings: JudgeSettings) -> bool:
    """Whether the share that is forced is beyond the border."""
    return memory.forced_share > settings.forced_share + (-HYSTERESIS if memory.forced else HYSTERESIS)


def _stands_for(steady: float) -> float:
    """Share of the power that is forced, by that which is heard as steady."""
    return min(steady / HEARD_AS_STEADY, 1.0)


def _forced_by(share: float) -> float:
    """Probability that more than half of the power is forced, by the share that is heard as such."""
    return FORCED_WITH_NONE + (1.0 - FORCED_WITH_NONE) / (1.0 + math.exp((HALF_WAY - share) / SHARE_DOUBT))


def _stable_or_near(evidence: Evidence, memory: Memory, sure: float, settings: JudgeSettings) -> Opinion:
    """Among what neither is chatter nor forced: how much is left."""
    margin, mode = evidence.margin, evidence.critical
    if margin.margin_ci95 is not None and margin.margin_ci95[1] < settings.approaching_margin_percent:
        why = f"only {max(margin.margin_percent or 0.0, 0.0):.0f} % more depth before it chatters"
        return Opinion("approaching", WARNING_RIGHT * sure, (why,))
    if mode is None:
        return Opinion("stable", sure, ("no mode stands out",))
    where = f"damping {reasons.damping(mode)} at {mode.frequency_hz:.0f} Hz"
    # One interval, the second of a recording above all, says little that the next does not take back.
    # What something forces reads as undamped.
    undamped = memory.undamped and _is_undamped(evidence, settings)
    if undamped and not memory.told.is_forced(mode.frequency_hz, SAME_VIBRATION):
        return Opinion("approaching", WARNING_RIGHT * sure, (where,))
    return Opinion("stable", sure, (where,))


def _is_undamped(evidence: Evidence, settings: JudgeSettings) -> bool:
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
    if _stands_for(memory.steady) > settings.forced_share:
        if turns and evidence.orders.heard:
            return (reasons.turning(evidence.orders),), None
        if strongest is not None:
            return (reasons.steady(strongest),), strongest.heard
    if memory.repeating > memory.synchronous:
        return (reasons.repeating(memory.repeating),), vibration
    return ("most of the power was steady until just now",), vibration


class Judge:
    """State machine of one channel: evidence in, verdicts out.

    Parameters
    ----------
    settings : JudgeSettings
        Thresholds.
    channel : int
        Number that the verdicts carry.
    interval_s : float
        Length of an interval, for forgetting the loudest level.
    """

    def __init__(self, settings: JudgeSettings, channel: int = 0, interval_s: float = 0.05) -> None:
        self._settings = settings
        self._channel = channel
        self._forgetting = 1.0 - interval_s / 60.0
        self._memory = Memory()
        self._following = Following()

    def set_thresholds(self, settings: JudgeSettings) -> None:
        """Judge by other thresholds, from the next interval on; what is remembered stays."""
        self._settings = settings

    def verdict(self, evidence: Evidence, first_sample: int, samples: int, sample_rate_hz: float) -> Verdict:
        """Judge the next interval."""
        settings = self._settings
        deaf = bool(evidence.flags & DEAF)
        memory = self._hear(0.0 if deaf else evidence.rms)  # what is not to be trusted sets no level
        if deaf:
            view = Opinion("unknown", 0.0, ("samples are missing or not to be trusted",))
        elif (quiet := _quiet(evidence, memory, settings)) is not None:
            self._following.rest(forget=evidence.alone)
            memory = memory._replace(told=Told())
            view = Opinion("idle", 0.95, (quiet,))
        elif evidence.starting:
            view = Opinion("unknown", 0.0, ("too few samples yet",))
        elif evidence.entering:
            self._following.rest(forget=evidence.alone)
            repeating = repeating_share(evidence.orders, Told())
            memory = memory._replace(told=Told(), repeating=repeating, forced_share=repeating)
            view = _entering(memory, settings)
        else:
            memory = self._follow(memory, evidence)
            view = opinion(evidence, memory, settings)
        undamped = view.state != "unknown" and _is_undamped(evidence, settings)
        self._memory = memory._replace(forced=view.state == "forced", undamped=undamped)
        return self._record(view, evidence, first_sample, samples, sample_rate_hz)

    def _follow(self, memory: Memory, evidence: Evidence) -> Memory:
        """Follow what an interval shows."""
        rules = Rules(self._settings.alarm_probability, self._settings.calm_probability)
        told = self._following.follow(evidence, rules)
        synchronous = evidence.orders.synchronous_share
        steady = memory.steady + AVERAGING * (steady_share(synchronous, told) - memory.steady)
        repeating = repeating_share(evidence.orders, told)
        return memory._replace(
            told=told,
            synchronous=memory.synchronous + AVERAGING * (synchronous - memory.synchronous),
            steady=steady,
            repeating=repeating,
            forced_share=max(_stands_for(steady), repeating),
        )

    def _hear(self, level: float) -> Memory:
        """Take note of how loud it is."""
        loudest = self._memory.loudest
        # it at most doubles with each interval, so that one click does not make a quiet cut look idle for minutes
        credible = min(level, 2.0 * loudest) if loudest > 0.0 else level
        return self._memory._replace(loudest=max(credible, loudest * self._forgetting))

    def _record(
        self, view: Opinion, evidence: Evidence, first_sample: int, samples: int, sample_rate_hz: float
    ) -> Verdict:
        frequency_hz, mode = _meant(view, evidence)
        half = 1.96 * mode.damping_sd if mode is not None else 0.0
        meant = mode if view.vibration is None else view.vibration
        damping_ratio = None if meant is None else meant.damping_ratio
        return Verdict(
            channel=self._channel,
            t0=first_sample / sample_rate_hz,
            t1=(first_sample + samples) / sample_rate_hz,
            sample0=first_sample,
            sample1=first_sample + samples,
            state=view.state,
            frequency_hz=frequency_hz,
            damping_ratio=damping_ratio,
            damping_ratio_ci95=(mode.damping_ratio - half, mode.damping_ratio + half) if mode is not None else None,
            order=None if frequency_hz is None else spindle_order(frequency_hz, evidence.orders),
            confidence=round(view.confidence, 4),
            margin_percent=None if view.state in WITHOUT_MARGIN else evidence.margin.margin_percent,
            reasons=list(view.reasons),
            flags=evidence.flags.names(),
        )


def _meant(view: Opinion, evidence: Evidence) -> tuple[float | None, ModeEvidence | None]:
    """Frequency and mode of the vibration that a verdict is about."""
    if view.state in ("idle", "unknown"):
        return None, None
    if view.state == "self_excited" and view.vibration is None:  # no other mode is what the alarm is about
        return None, None
    if view.vibration is not None:
        return view.vibration.line.frequency_hz, view.vibration.mode
    if view.state == "forced" and evidence.orders.lines:
        return evidence.orders.lines[0].frequency_hz, None
    return (None, None) if evidence.critical is None else (evidence.critical.frequency_hz, evidence.critical)
