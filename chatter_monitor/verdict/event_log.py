"""Intervals of an alarm joined to an event, with advice."""

from __future__ import annotations

import statistics

from chatter_monitor.physics.lobes import Recommendation
from chatter_monitor.records import Event, Verdict
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.advice import advise
from chatter_monitor.verdict.opinion import SAME_VIBRATION
from chatter_monitor.verdict.reasons import CAME_WITH_TOOL, DOUBTED, WITHDRAWN

# A speed so near to the one that was told is that one, as it is in truth; another comb may be the chatter's own.
AS_TOLD = 0.05
# Advice rests on the speed and the teeth, and neither is what was told, most likely.
TELL_THE_SPEED = Recommendation((), f"tell the spindle's speed and teeth: {DOUBTED}")
LESS_DEPTH = Recommendation((), "reduce the depth of cut: no speed can be advised where no frequency is heard")


class EventLog:
    """Joins the intervals of an alarm to an event when it ends.

    Parameters
    ----------
    prefix : str
        Start of the events' names, unique to this run of the monitor.
    spindle : SpindleSettings
        Speed, teeth and range of the machine, for advice.
    """

    def __init__(self, prefix: str, spindle: SpindleSettings) -> None:
        self._prefix = prefix
        self._spindle = spindle
        self._intervals: dict[int, list[Verdict]] = {}
        self._count = 0

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Advise for another speed or number of teeth."""
        self._spindle = spindle

    def follow(self, verdict: Verdict) -> Event | None:
        """Take the next verdict of a channel; returns the event that it ends."""
        if verdict.state == "self_excited":
            self._intervals.setdefault(verdict.channel, []).append(verdict)
            return None
        if verdict.state == "unknown":  # deaf for a moment: neither goes on nor ends
            return None
        withdrawn = [reason for reason in (WITHDRAWN, CAME_WITH_TOOL) if reason in verdict.reasons]
        return self.finish(verdict.channel, withdrawn=withdrawn[0] if withdrawn else None)

    def finish(self, channel: int, *, withdrawn: str | None = None) -> Event | None:
        """End the event that is under way on a channel, if there is one; it may turn out to have been none, and why."""
        intervals = self._intervals.pop(channel, [])
        if not intervals:
            return None
        frequency_hz, lasting = _that_lasts(intervals)
        if withdrawn is not None:
            recommendation = Recommendation((), f"nothing: {withdrawn}")
        elif DOUBTED in intervals[-1].reasons:
            recommendation = TELL_THE_SPEED
        elif frequency_hz is None:
            recommendation = LESS_DEPTH
        else:
            recommendation = advise(frequency_hz, self._spindle, _rotation_hz(intervals, self._spindle.speed_rpm))
        self._count += 1
        return Event(
            id=f"{self._prefix}-{channel}-{self._count:04d}",
            channel=channel,
            kind="chatter",
            onset_s=intervals[0].t0,
            end_s=intervals[-1].t1,
            peak_frequency_hz=frequency_hz,
            min_damping_ratio=min((v.damping_ratio for v in lasting if v.damping_ratio is not None), default=None),
            advice=list(recommendation.speeds),
            remedy=recommendation.text,
            withdrawn=withdrawn is not None,
        )


def _that_lasts(intervals: list[Verdict]) -> tuple[float | None, list[Verdict]]:
    """Frequency of the vibration that lasts, where any is heard, and the intervals that are about it.

    Another may be meant for an interval, such as after a gap. An event is called by where it mostly was: that with the
    least damping may be an interval in which it was hardly told.
    """
    heard = [(v.frequency_hz, v) for v in intervals if v.frequency_hz is not None]
    if not heard:
        return None, intervals
    usual_hz = statistics.median(hertz for hertz, _ in heard)
    lasting = [each for each in heard if abs(each[0] - usual_hz) <= SAME_VIBRATION * usual_hz] or heard
    return statistics.median(hertz for hertz, _ in lasting), [v for _, v in lasting]


def _rotation_hz(intervals: list[Verdict], told_rpm: float | None) -> float | None:
    """Speed that was heard during an alarm; None where it was not, or was another than the one that was told."""
    if told_rpm is None:
        return None
    heard = [v.frequency_hz / v.order for v in intervals if v.frequency_hz is not None and v.order]
    near = [rotation_hz for rotation_hz in heard if abs(60.0 * rotation_hz / told_rpm - 1.0) <= AS_TOLD]
    return statistics.median(near) if near else None
