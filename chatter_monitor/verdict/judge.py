"""From evidence to a state: whether the machine idles, cuts, is forced, comes near chatter, or chatters.

What the vibration is, is followed by `verdict.kinds`; here its probability becomes one word, with reasons.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import msgspec

from chatter_monitor.records import Flag, State, Verdict
from chatter_monitor.verdict.evidence import Evidence, ModeEvidence, Vibration, probability_below, spindle_order
from chatter_monitor.verdict.kinds import NOTHING, PRIOR, Kinds, Likeness, follow, likeness

# Flags under which nothing is claimed. Clipping alone bends the waveform but leaves frequency and damping readable.
DEAF = Flag.GAP | Flag.OVERFLOW | Flag.NON_FINITE | Flag.DEAD_CHANNEL

# A line that rises where nothing stood out before comes with the tool's entry, or is something new. Its kind is open
# until there was time to find out what turns (`tracking.orders`): so many intervals.
UNHEARD_DB = 8.0
ENTRY_RISE = 0.7
ENTRY_INTERVALS = 52
COHERENT = 0.7
# A vibration is over when its amplitude has fallen below half of what it was for seconds (natural logarithm): that of a
# saturated one does not, whatever its damping reads.
DIED_DOWN = -0.7
# For some intervals it may stand out less than its own harmonics; for longer it is over, too.
NOT_HEARD = Likeness(-3.0, -3.0)

# Weight of an interval in the average of the synchronous share: half a second of intervals.
AVERAGING = 0.1

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
        Probability below which a running alarm ends.
    warning_probability : float
        Probability of self-excitation from which on it is `approaching`.
    approaching_damping : float
        Damping below which little is left: the early warning, too.
    approaching_margin_percent : float
        Margin below which little is left, where it is known.
    certainty : float
        Probability with which damping or margin has to be below its threshold.
    forced_share : float
        Share of the power from which on the vibration is forced.
    idle_ratio : float
        Below this share of the loudest level of the last minute, nothing is being cut.
    """

    alarm_probability: Probability = 0.8
    calm_probability: Probability = 0.5
    warning_probability: Probability = 0.1
    approaching_damping: Positive = 0.003
    approaching_margin_percent: Positive = 15.0
    certainty: Probability = 0.9
    forced_share: Probability = 0.5
    idle_ratio: Probability = 0.003

    def __post_init__(self) -> None:
        if self.calm_probability > self.alarm_probability:  # an alarm would end with the interval that it begins with
            msg = (
                f"calm_probability must not be above alarm_probability ({self.alarm_probability}),"
                f" got {self.calm_probability}"
            )
            raise ValueError(msg)


@dataclass(frozen=True, slots=True)
class Memory:
    """What the judge remembers from one interval to the next.

    Attributes
    ----------
    loudest : float
        Largest rms, forgotten with a time constant of a minute.
    kinds : Kinds
        What the vibration is, by all that was seen.
    alarm : bool
        Whether an alarm is running.
    chatter_hz : float or None
        Frequency of the vibration that the running alarm is about, where it was last heard.
    synchronous : float
        Share of the power that turns with the spindle, averaged over the last half second.
    since_entry : int or None
        Intervals since something rose where nothing had stood out.
    """

    loudest: float = 0.0
    kinds: Kinds = PRIOR
    alarm: bool = False
    chatter_hz: float | None = None
    synchronous: float = 0.0
    since_entry: int | None = None


@dataclass(frozen=True, slots=True)
class Opinion:
    """State, how sure, why, and which vibration is meant."""

    state: State
    confidence: float
    reasons: tuple[str, ...]
    vibration: Vibration | None = None


@dataclass(frozen=True, slots=True)
class Suspect:
    """The vibration of an interval that looks most like growth, and what there is to say of all of them."""

    vibration: Vibration | None
    likeness: Likeness


def suspect(evidence: Evidence) -> Suspect:
    """Look at every line: the growth of the one that grows most, the calm of the calmest."""
    if not evidence.vibrations:
        return Suspect(None, NOTHING)
    seen = [
        (vibration, _in_doubt(vibration, likeness(vibration.line, vibration.damping_ratio)))
        for vibration in evidence.vibrations
    ]
    most, growing = max(seen, key=lambda pair: pair[1].growth)
    steady, calm = max(seen, key=lambda pair: pair[1].calm)
    main = most if growing.growth > calm.calm else steady
    return Suspect(main, Likeness(growing.growth, calm.calm))


def heard_again(evidence: Evidence, frequency_hz: float) -> Vibration | None:
    """The vibration that an alarm is about; its harmonics and side lines may look more like chatter than itself."""
    distances = [(abs(math.log(v.line.frequency_hz / frequency_hz)), v) for v in evidence.vibrations]
    distance, vibration = min(distances, key=lambda pair: pair[0], default=(math.inf, None))
    return vibration if distance < SAME_VIBRATION else None


def _is_unheard(vibration: Vibration) -> bool:
    """Whether it rose where nothing stood out before."""
    return vibration.line.usual_db < UNHEARD_DB and vibration.line.long_rise > ENTRY_RISE


def _in_doubt(vibration: Vibration, like: Likeness) -> Likeness:
    """A cut that begins wakes modes that noise drives: what rises out of nothing is growth only if it is coherent."""
    if _is_unheard(vibration) and vibration.line.coherence < COHERENT:
        return Likeness(min(like.growth, 0.0), like.calm)
    return like


def _since_entry(before: int | None, vibration: Vibration | None) -> int | None:
    """Intervals since something rose where nothing had been; None again when that is over and done with."""
    unheard = vibration is not None and _is_unheard(vibration)
    if before is None:
        return 0 if unheard else None
    return before + 1 if before < ENTRY_INTERVALS or unheard else None


def opinion(evidence: Evidence, memory: Memory, found: Suspect, settings: JudgeSettings) -> Opinion:
    """What an interval is, given what has been followed so far."""
    vibration, kinds, alarm = found.vibration, memory.kinds, memory.alarm
    if alarm and vibration is not None:
        return Opinion("self_excited", kinds.self_excited, _why_chatter(vibration, kinds), vibration)
    if alarm:
        return Opinion("self_excited", kinds.self_excited, ("the vibration has not died down since the alarm",))
    doubt = 1.0 - kinds.self_excited
    share = memory.synchronous
    if share > settings.forced_share:
        return Opinion("forced", doubt, _why_forced(evidence))
    if kinds.self_excited >= settings.warning_probability and vibration is not None:
        why = f"{_line(vibration)} begins to grow by itself; not certain yet"
        return Opinion("approaching", doubt, (why,), vibration)
    if vibration is not None and kinds.forced > 0.5 and share + vibration.line.share > settings.forced_share:
        return Opinion("forced", kinds.forced, _why_steady(vibration), vibration)
    return _stable_or_near(evidence, kinds, settings)


def _stable_or_near(evidence: Evidence, kinds: Kinds, settings: JudgeSettings) -> Opinion:
    """Among what neither is chatter nor forced: how much is left."""
    margin, mode = evidence.margin, evidence.critical
    if margin.margin_ci95 is not None and margin.margin_ci95[1] < settings.approaching_margin_percent:
        why = f"only {max(margin.margin_percent or 0.0, 0.0):.0f} % more depth before it chatters"
        return Opinion("approaching", settings.certainty, (why,))
    if mode is None:
        return Opinion("stable", 1.0 - kinds.self_excited, ("no mode stands out",))
    near = probability_below(mode, settings.approaching_damping)
    where = f"damping {_percent(mode)} at {mode.frequency_hz:.0f} Hz"
    if near >= settings.certainty and kinds.forced < 0.5:
        return Opinion("approaching", near, (where,))
    return Opinion("stable", 1.0 - kinds.self_excited, (where,))


def _why_chatter(vibration: Vibration, kinds: Kinds) -> tuple[str, ...]:
    line = vibration.line
    reasons = [f"{_line(vibration)} {'grows' if kinds.growing > kinds.saturated else 'has grown'} by itself"]
    if line.long_rise > 0.5:
        reasons.append(f"{math.exp(line.long_rise):.1f} times its amplitude of the last seconds")
    if vibration.mode is not None:
        reasons.append(f"damping {_percent(vibration.mode)}")
    return tuple(reasons)


def _why_forced(evidence: Evidence) -> tuple[str, ...]:
    orders = evidence.orders
    lines = ", ".join(f"{line.order} x" for line in orders.lines[:3])
    turning = "" if orders.rotation_hz is None else f" of {orders.rotation_hz:.1f} Hz ({orders.source}): {lines}"
    return (f"{100 * orders.synchronous_share:.0f} % of the power is in multiples{turning}",)


def _why_steady(vibration: Vibration) -> tuple[str, ...]:
    if vibration.on_order:
        return (f"{_line(vibration)} is steady and on an order of the spindle",)
    return (f"{_line(vibration)} is steady and was not seen to grow: something forces it",)


def _line(vibration: Vibration) -> str:
    return f"the vibration at {vibration.line.frequency_hz:.0f} Hz"


def _percent(mode: ModeEvidence) -> str:
    return f"{100 * mode.damping_ratio:.2f} % ± {196 * mode.damping_sd:.2f} %"


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
        elif evidence.held or evidence.rms <= settings.idle_ratio * memory.loudest:
            memory = replace(memory, kinds=PRIOR, alarm=False, chatter_hz=None)
            view = Opinion("idle", 0.95, ("nothing moves" if evidence.held else "far below the level of cutting",))
        elif evidence.starting:
            view = Opinion("unknown", 0.0, ("too few samples yet",))
        else:
            found = suspect(evidence)
            memory, heard = self._believe(memory, evidence, found)
            if memory.alarm:
                found = replace(found, vibration=heard)
            view = opinion(evidence, memory, found, settings)
        self._memory = memory
        return self._record(view, evidence, first_sample, samples, sample_rate_hz)

    def _believe(self, memory: Memory, evidence: Evidence, found: Suspect) -> tuple[Memory, Vibration | None]:
        """Follow the probabilities by what an interval shows; also gives what is heard of the alarm's vibration."""
        settings, vibration = self._settings, found.vibration
        since_entry = _since_entry(memory.since_entry, vibration)
        entering = since_entry is not None and since_entry < ENTRY_INTERVALS
        on_order = vibration is not None and vibration.on_order
        chatter_hz = memory.chatter_hz
        seen = found.likeness
        if chatter_hz is not None:
            vibration = heard_again(evidence, chatter_hz)
            if vibration is None:
                seen = NOT_HEARD
            elif vibration.line.long_rise < DIED_DOWN:
                seen = NOTHING
        kinds = follow(memory.kinds, seen, doubted=on_order or entering)
        alarm = kinds.self_excited >= (settings.calm_probability if memory.alarm else settings.alarm_probability)
        if memory.alarm and not alarm:
            kinds = PRIOR  # what is over does not come back for want of evidence against it
        if vibration is not None:
            chatter_hz = vibration.line.frequency_hz
        share = memory.synchronous + AVERAGING * (evidence.orders.synchronous_share - memory.synchronous)
        believed = replace(
            memory,
            kinds=kinds,
            alarm=alarm,
            chatter_hz=chatter_hz if alarm else None,
            synchronous=share,
            since_entry=since_entry,
        )
        return believed, vibration

    def _hear(self, level: float) -> Memory:
        """Take note of how loud it is."""
        loudest = self._memory.loudest
        # it at most doubles with each interval, so that one click does not make a quiet cut look idle for minutes
        credible = min(level, 2.0 * loudest) if loudest > 0.0 else level
        return replace(self._memory, loudest=max(credible, loudest * self._forgetting))

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
            margin_percent=None if view.state in ("idle", "unknown") else evidence.margin.margin_percent,
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
