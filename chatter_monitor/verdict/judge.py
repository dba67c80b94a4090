"""From evidence to a state: a first rule, on damping and its confidence.

It cannot tell a forced line from self-excited vibration when the spindle speed is unknown: both have damping near zero
(docs/decisions/0004-first-verdict.md). With the speed known, a line that sits on a tooth passing harmonic is forced.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace
from typing import Annotated

import msgspec

from chatter_monitor.records import Event, Flag, State, Verdict
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.evidence import Evidence, ModeEvidence, probability_below, spindle_order

# Flags under which nothing is claimed. Clipping alone bends the waveform but leaves frequency and damping readable.
DEAF = Flag.GAP | Flag.OVERFLOW | Flag.NON_FINITE | Flag.DEAD_CHANNEL

# Relative distance within which frequencies belong to one vibration.
SAME_VIBRATION = 0.1

Probability = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Positive = Annotated[float, msgspec.Meta(gt=0)]


class JudgeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Thresholds of the verdict: the table ``[verdict]`` of a machine configuration.

    Attributes
    ----------
    chatter_damping : float
        Damping below which a vibration sustains itself. Above zero, because the estimate of a vibration at its limit
        scatters around zero.
    approaching_damping : float
        Damping below which little is left: the early warning.
    certainty : float
        Probability with which the damping has to be below a threshold.
    alarm_intervals : int
        Intervals in a row that raise the alarm: one alone is chance once in a while.
    calm_intervals : int
        Intervals in a row without a reason that end it.
    release_ratio : float
        A running alarm ends only after the level has fallen below this share of its largest: the damping of a
        saturated vibration rises by itself, and that is no reason to withdraw the alarm.
    idle_ratio : float
        Below this share of the loudest level of the last minute, nothing is being cut.
    order_tolerance : float
        Relative distance from a tooth passing harmonic within which a line counts as being on it; real speeds are 1 %
        off their nominal value and more.
    """

    chatter_damping: Positive = 0.003
    approaching_damping: Positive = 0.008
    certainty: Probability = 0.9
    alarm_intervals: Annotated[int, msgspec.Meta(ge=1)] = 3
    calm_intervals: Annotated[int, msgspec.Meta(ge=1)] = 4
    release_ratio: Probability = 0.5
    idle_ratio: Probability = 0.003
    order_tolerance: Probability = 0.01


@dataclass(frozen=True, slots=True)
class Memory:
    """What the judge remembers from one interval to the next.

    Attributes
    ----------
    loudest : float
        Largest rms, forgotten with a time constant of a minute.
    suspicious, calm : int
        Intervals in a row with, and without, a reason for an alarm.
    alarm_rms : float or None
        Largest level since the alarm was raised; None while there is none.
    spindle_is_new : bool
        Speed or teeth have changed since the last interval that could be judged.
    """

    loudest: float = 0.0
    suspicious: int = 0
    calm: int = 0
    alarm_rms: float | None = None
    spindle_is_new: bool = False


def forced_order(mode: ModeEvidence, spindle: SpindleSettings, tolerance: float) -> int | None:
    """Spindle order of the tooth passing harmonic that the mode's frequency sits on; None for none, or not to tell."""
    order = spindle_order(mode.frequency_hz, spindle)
    if order is None:
        return None
    harmonic = round(order / spindle.teeth)
    # where the tolerance reaches half-way to the next harmonic, every frequency is near one: that says nothing
    if harmonic < 1 or tolerance * harmonic > 0.25:
        return None
    nearest = harmonic * spindle.teeth
    return nearest if abs(order - nearest) <= tolerance * nearest else None


@dataclass(frozen=True, slots=True)
class Opinion:
    """State, how sure, and why."""

    state: State
    confidence: float
    reasons: tuple[str, ...]
    order: int | None = None


def opinion(evidence: Evidence, memory: Memory, spindle: SpindleSettings, settings: JudgeSettings) -> Opinion:
    """What one interval says by itself, the memory giving only the loudness to compare with."""
    if evidence.flags & DEAF:
        return Opinion("unknown", 0.0, ("samples are missing or not to be trusted",))
    if evidence.held or evidence.rms <= settings.idle_ratio * memory.loudest:
        return Opinion("idle", 0.95, ("nothing moves" if evidence.held else "far below the level of cutting",))
    if evidence.starting:
        return Opinion("unknown", 0.0, ("too few samples yet",))
    mode = evidence.critical
    if mode is None:
        return Opinion("stable", 0.9, ("no mode stands out",))
    chatter = probability_below(mode, settings.chatter_damping)
    approaching = probability_below(mode, settings.approaching_damping)
    if max(chatter, approaching) < settings.certainty:
        return Opinion("stable", max(0.5, 1.0 - chatter), (f"damping {_percent(mode)} at {mode.frequency_hz:.0f} Hz",))
    order = forced_order(mode, spindle, settings.order_tolerance)
    if order is not None:
        why = f"narrow line at {mode.frequency_hz:.0f} Hz is spindle order {order}, a tooth passing harmonic"
        return Opinion("forced", 0.8, (why,), order)
    why = f"damping {_percent(mode)} at {mode.frequency_hz:.0f} Hz"
    if spindle.speed_rpm is None:
        why += "; without the spindle speed a forced line reads the same"
    if chatter >= settings.certainty:
        return Opinion("self_excited", chatter, (why,))
    return Opinion("approaching", approaching, (why,))


def _percent(mode: ModeEvidence) -> str:
    return f"{100 * mode.damping_ratio:.2f} % ± {196 * mode.damping_sd:.2f} %"


class Judge:
    """State machine of one channel: opinions in, verdicts and events out, with hysteresis.

    Parameters
    ----------
    settings : JudgeSettings
        Thresholds.
    spindle : SpindleSettings
        Speed and teeth, where known.
    channel : int
        Number that the verdicts carry.
    interval_s : float
        Length of an interval, for forgetting the loudest level.
    """

    def __init__(
        self, settings: JudgeSettings, spindle: SpindleSettings, channel: int = 0, interval_s: float = 0.05
    ) -> None:
        self._settings = settings
        self._spindle = spindle
        self._channel = channel
        self._forgetting = 1.0 - interval_s / 60.0
        self._memory = Memory()

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Judge by another speed or number of teeth, from the next interval on.

        If that interval turns out to be forced, a running alarm ends with it: the alarm was raised for want of the
        right speed, and there is nothing that has to die down first.
        """
        if spindle != self._spindle:
            self._spindle = spindle
            self._memory = replace(self._memory, spindle_is_new=True)

    def set_thresholds(self, settings: JudgeSettings) -> None:
        """Judge by other thresholds, from the next interval on; what is remembered stays."""
        self._settings = settings

    def verdict(self, evidence: Evidence, first_sample: int, samples: int, sample_rate_hz: float) -> Verdict:
        """Judge the next interval."""
        settings = self._settings
        level = 0.0 if evidence.flags & DEAF else evidence.rms  # what is not to be trusted sets no level
        loudest = self._memory.loudest
        # it at most doubles with each interval, so that one click does not make a quiet cut look idle for minutes
        credible = min(level, 2.0 * loudest) if loudest > 0.0 else level
        memory = replace(self._memory, loudest=max(credible, loudest * self._forgetting))
        view = opinion(evidence, memory, self._spindle, settings)
        if view.state == "self_excited":
            memory = replace(memory, suspicious=memory.suspicious + 1, calm=0)
        elif view.state != "unknown":
            memory = replace(memory, suspicious=0, calm=memory.calm + 1)

        if memory.alarm_rms is None and memory.suspicious >= settings.alarm_intervals:
            memory = replace(memory, alarm_rms=evidence.rms)
        elif memory.alarm_rms is not None:
            alarm_rms = max(memory.alarm_rms, level)
            memory = replace(memory, alarm_rms=alarm_rms)
            forced_all_along = memory.spindle_is_new and view.state == "forced"
            if forced_all_along or (
                memory.calm >= settings.calm_intervals
                and (evidence.rms < settings.release_ratio * alarm_rms or view.state in ("forced", "idle"))
            ):
                memory = replace(memory, alarm_rms=None, suspicious=0)
        if view.state != "unknown":
            memory = replace(memory, spindle_is_new=False)

        if memory.alarm_rms is not None and view.state not in ("self_excited", "unknown"):
            view = Opinion("self_excited", 0.7, ("the vibration has not died down since the alarm", *view.reasons))
        elif memory.alarm_rms is None and view.state == "self_excited":
            # not confirmed yet
            view = Opinion("approaching", view.confidence, view.reasons)
        self._memory = memory
        return self._record(view, evidence, first_sample, samples, sample_rate_hz)

    def _record(
        self, view: Opinion, evidence: Evidence, first_sample: int, samples: int, sample_rate_hz: float
    ) -> Verdict:
        mode = None if view.state in ("idle", "unknown") else evidence.critical
        half = 1.96 * mode.damping_sd if mode is not None else 0.0
        order = view.order if mode is None or view.order else spindle_order(mode.frequency_hz, self._spindle)
        return Verdict(
            channel=self._channel,
            t0=first_sample / sample_rate_hz,
            t1=(first_sample + samples) / sample_rate_hz,
            sample0=first_sample,
            sample1=first_sample + samples,
            state=view.state,
            frequency_hz=mode.frequency_hz if mode is not None else None,
            damping_ratio=mode.damping_ratio if mode is not None else None,
            damping_ratio_ci95=(mode.damping_ratio - half, mode.damping_ratio + half) if mode is not None else None,
            order=order,
            confidence=round(view.confidence, 4),
            reasons=list(view.reasons),
            flags=evidence.flags.names(),
        )


class EventLog:
    """Joins the intervals of an alarm to an event when it ends.

    Parameters
    ----------
    prefix : str
        Start of the events' names, unique to this run of the monitor.
    """

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._intervals: dict[int, list[Verdict]] = {}
        self._count = 0

    def follow(self, verdict: Verdict) -> Event | None:
        """Take the next verdict of a channel; returns the event that it ends."""
        if verdict.state == "self_excited":
            self._intervals.setdefault(verdict.channel, []).append(verdict)
            return None
        if verdict.state == "unknown":  # deaf for a moment: neither goes on nor ends
            return None
        return self.finish(verdict.channel)

    def finish(self, channel: int) -> Event | None:
        """End the event that is under way on a channel, if there is one."""
        intervals = self._intervals.pop(channel, [])
        if not intervals:
            return None
        measured = [v for v in intervals if v.damping_ratio is not None and v.frequency_hz is not None]
        # Another mode may read less for an interval, such as after a gap; the event is the vibration that lasts.
        usual_hz = statistics.median([v.frequency_hz or 0.0 for v in measured]) if measured else 0.0
        lasting = [v for v in measured if abs((v.frequency_hz or 0.0) - usual_hz) <= SAME_VIBRATION * usual_hz]
        least = min(lasting or measured, key=lambda v: v.damping_ratio or 0.0, default=None)
        if least is None or least.damping_ratio is None or least.frequency_hz is None:
            return None
        self._count += 1
        return Event(
            id=f"{self._prefix}-{channel}-{self._count:04d}",
            channel=channel,
            kind="chatter",
            onset_s=intervals[0].t0,
            end_s=intervals[-1].t1,
            peak_frequency_hz=least.frequency_hz,
            min_damping_ratio=least.damping_ratio,
        )
