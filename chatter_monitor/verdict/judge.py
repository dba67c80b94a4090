"""From evidence to a state: whether the machine idles, cuts, is forced, comes near chatter, or chatters.

What each vibration is, is followed by `verdict.vibrations`; what an interval is called by that, is in
`verdict.opinion`; here is what lasts from one interval to the next.
"""

from __future__ import annotations

import math

from chatter_monitor.kernels.kinds import LOUDER, own_rise
from chatter_monitor.kernels.vibrations import Rules
from chatter_monitor.records import Flag, Verdict
from chatter_monitor.tracking.comb import is_mains
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.margin_tracker import FRAMES_TO_RENEW
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.verdict import reasons
from chatter_monitor.verdict.arrival import Arrival
from chatter_monitor.verdict.earlier import Earlier
from chatter_monitor.verdict.evidence import Evidence, ModeEvidence, spindle_order
from chatter_monitor.verdict.irregularity import Irregularity
from chatter_monitor.verdict.level import Level
from chatter_monitor.verdict.limit_cycle import LimitCycle
from chatter_monitor.verdict.loudness import Loudness
from chatter_monitor.verdict.opinion import Memory, Opinion, alarm_about, entering, is_undamped, opinion, stands_for
from chatter_monitor.verdict.origin import Origin
from chatter_monitor.verdict.probability import Signs, chatter_probability, told_by_vibrations
from chatter_monitor.verdict.same_cut import BAND_HZ
from chatter_monitor.verdict.settings import JudgeSettings
from chatter_monitor.verdict.surge import Surge
from chatter_monitor.verdict.vibrations import Followed, Following, Told, repeating_share, steady_share
from chatter_monitor.verdict.withdrawal import Withdrawal, newly_found

# States in which a cut has no margin: none is made, nothing is known, or there is nothing left of it.
WITHOUT_MARGIN = ("idle", "unknown", "self_excited")
# It is that of a linear machine driven by noise: a window of the signal with chatter in it says nothing.
AFTER_CHATTER = Margin(reason="the cut chattered just now")
# Flags under which nothing is claimed. Clipping alone bends the waveform but leaves frequency and damping readable.
DEAF = Flag.GAP | Flag.OVERFLOW | Flag.NON_FINITE | Flag.DEAD_CHANNEL

# Weight of an interval in the average of the shares: what is said does not flicker.
AVERAGING = 0.15


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

    Attributes
    ----------
    memory : Memory
        What is remembered of the last interval.
    """

    def __init__(self, settings: JudgeSettings, channel: int = 0, interval_s: float = 0.05) -> None:
        self._settings = settings
        self._channel = channel
        self._forgetting = 1.0 - interval_s / 60.0
        self.memory = Memory()
        self._following = Following()
        self._loudness = Loudness(interval_s)
        self._irregularity = Irregularity(interval_s)
        self._cycle = LimitCycle(interval_s)
        self._to_renew = 0  # intervals of cutting until no margin is of chatter any more
        self._earlier = Earlier(interval_s)
        self._arrival = Arrival(interval_s)
        self._surge = Surge(interval_s)
        self._level = Level(interval_s)
        self._origin = Origin(interval_s)
        self._withdrawal = Withdrawal()

    def set_thresholds(self, settings: JudgeSettings) -> None:
        """Judge by other thresholds, from the next interval on; what is remembered stays."""
        self._settings = settings

    def begin_job(self) -> None:
        """Another speed or another cutter is told: it is another cut than before."""
        self._earlier.begin_job()

    def verdict(self, evidence: Evidence, first_sample: int, samples: int, sample_rate_hz: float) -> Verdict:
        """Judge the next interval."""
        settings = self._settings
        deaf = bool(evidence.flags) and bool(evidence.flags & DEAF)  # joining enumerations takes its time
        power = evidence.rms**2
        memory = self._hear(0.0 if deaf else evidence.rms)  # what is not to be trusted sets no level
        if self._to_renew:
            evidence = evidence._replace(margin=AFTER_CHATTER)
        if deaf:
            view = Opinion("unknown", 0.0, ("samples are missing or not to be trusted",))
        elif (quiet := _quiet(evidence, memory, settings)) is not None:
            self._rest(forget=self._arrival.came_with_tool(power, alone=evidence.alone))
            self._earlier.rest(evidence.orders.spectrum)
            self._irregularity.idle(power, evidence.orders.recurring_share)
            memory = memory._replace(told=Told())
            view = Opinion("idle", 0.95, (quiet,))
        elif evidence.starting:
            view = Opinion("unknown", 0.0, ("too few samples yet",))
        elif evidence.entering:
            self._earlier.cut(evidence.orders.spectrum, power, None, calm=memory.calm, entering=True)
            by_tool = self._arrival.began_with_tool()
            self._rest(forget=by_tool)
            repeating = repeating_share(evidence.orders, Told())
            since_alarm = math.inf if by_tool else memory.since_alarm
            memory = memory._replace(told=Told(), repeating=repeating, forced_share=repeating, since_alarm=since_alarm)
            view = entering(memory, settings)
            if by_tool:
                self._to_renew = 0
                view = view._replace(reasons=(reasons.CAME_WITH_TOOL, *view.reasons))
        else:
            self._earlier.cut(evidence.orders.spectrum, power, _heard_hz(evidence.orders), calm=memory.calm)
            same_cut = self._earlier.turns_the_same(evidence.orders.rotation_hz)
            memory = self._follow(memory, evidence._replace(same_cut=same_cut))
            view = opinion(evidence, memory, settings)
            alarm = {"by_line": view.state == "self_excited", "goes_on": memory.since_alarm == 0.0}
            self._origin.hear(evidence.grown_hz, memory.told, is_cut=self._loudness.is_cut, **alarm)
            outlasts = self._origin.outlasts(evidence.orders)
            sources = memory.source, evidence.orders.source
            if self._withdrawal.hear(sources, memory.told, **alarm, outlasts=outlasts):
                view = self._withdraw(view)
            view = self._by_loudness(view, evidence, memory, outlasts=outlasts)
            self._arrival.hear(power, alarm=view.state == "self_excited", recalled=memory.told.recalls)
        if view.grounds not in (None, "alarm"):
            self._level.remember(power)
        undamped = view.state != "unknown" and is_undamped(evidence, settings)
        chatters = view.state == "self_excited"
        self._to_renew = FRAMES_TO_RENEW if chatters else max(0, self._to_renew - evidence.cutting)
        signs = _signs(view, evidence, memory)
        self.memory = memory._replace(
            signs=signs,
            forced=view.state == "forced",
            undamped=undamped,
            since_alarm=0.0 if chatters else memory.since_alarm + 1.0,
            alarm_hz=view.frequency_hz if chatters else memory.alarm_hz,
            source=evidence.orders.source,
        )
        return self._record(view, evidence, first_sample, samples, sample_rate_hz)

    def _follow(self, memory: Memory, evidence: Evidence) -> Memory:
        """Follow what an interval shows."""
        settings, unheard = self._settings, evidence.orders.spindle_unheard
        rules = Rules(settings.alarm_probability, settings.calm_probability, unheard=unheard)
        told = self._following.follow(evidence, rules, self._loudness.usual, calm=memory.calm)
        synchronous = evidence.orders.synchronous_share
        steady = memory.steady + AVERAGING * (steady_share(synchronous, told) - memory.steady)
        repeating = repeating_share(evidence.orders, told)
        forced_share, power = max(stands_for(steady), repeating), evidence.rms**2
        return memory._replace(
            told=told,
            synchronous=memory.synchronous + AVERAGING * (synchronous - memory.synchronous),
            steady=steady,
            repeating=repeating,
            forced_share=forced_share,
            surge=self._surge.hear(power, forced_share),
        )

    def _rest(self, *, forget: bool) -> None:
        """Nothing is cut, or a cut begins: what has chattered in the one before is remembered, if that."""
        self._following.rest(forget=forget)
        self._arrival.rest()
        self._origin.rest()
        self._surge.rest()
        self._loudness.rest()
        self._irregularity.rest()
        self._cycle.rest()

    def _withdraw(self, view: Opinion) -> Opinion:
        """What an interval is called in which the alarm before it turns out to be wrong: a word about that, too."""
        self._following.withdraw()
        self._loudness.forget()
        return view._replace(reasons=(reasons.WITHDRAWN, *view.reasons))

    def _by_loudness(self, view: Opinion, evidence: Evidence, memory: Memory, *, outlasts: bool) -> Opinion:
        """What an interval of cutting is called: how loud it is makes an alarm of a warning, and ends one."""
        told, orders, alarm = memory.told, evidence.orders, view.state == "self_excited"
        chattered = told.chattered
        explained = newly_found(memory.source, orders.source) and not outlasts
        if not alarm and (explained or (chattered is not None and chattered.glided)):  # by what turns, or it may be
            self._loudness.forget()
        suspect = _grown_suspect(told, unheard=orders.spindle_unheard)
        calm = told.overview.suspicion < self._settings.warning_probability
        odds = 0.0 if suspect is None else suspect.self_excited / max(1.0 - suspect.self_excited, 1e-6)
        goes_on_hz = memory.alarm_hz if memory.since_alarm == 0.0 else None
        without_line = self._without_line(evidence, goes_on_hz, calm=memory.calm and not alarm)
        heard = evidence.power, evidence.turning, orders.repeating_share
        loud = self._loudness.hear(
            *heard,
            alarm=alarm or without_line is not None,
            odds=odds,
            calm=calm and without_line is None,
            outlasts=outlasts,
        )
        if without_line is not None and not alarm:
            return without_line
        if alarm or not loud:
            return view
        about = suspect if chattered is None else chattered
        rise = self._loudness.rise
        why = (reasons.still_loud(rise) if suspect is None else reasons.loud(suspect, rise),)
        return Opinion("self_excited", 1.0, why, hertz=memory.alarm_hz) if about is None else alarm_about(about, why)

    def _without_line(self, evidence: Evidence, goes_on_hz: float | None, *, calm: bool) -> Opinion | None:
        """An alarm that is about no line that was seen to rise: where no line is coherent, one may chatter yet.

        If one goes on at a frequency, it keeps that while nothing else is heard in the same band or beside it.
        """
        power, orders, vibrations = evidence.rms**2, evidence.orders, evidence.vibrations
        turning = orders.recurring_share, orders.repeating_share, orders.rotation_hz
        times = self._irregularity.hear(power, *turning, calm=calm, turns=orders.rotation_heard)
        rise = self._cycle.hear(evidence.cycle, power, evidence.power, orders.repeating_share)
        new = self._earlier.new
        if new is not None:
            why = reasons.new(new, within=self._earlier.within)
            # in that band or beside it, or it is about no line
            nearest = vibrations.nearest(new.hertz, BAND_HZ)
            same = goes_on_hz is not None and abs(goes_on_hz - new.hertz) <= BAND_HZ
            return Opinion("self_excited", 1.0, (why,), nearest, hertz=goes_on_hz if same else new.hertz)
        if rise > 0.0 and evidence.cycle is not None:
            nearest = vibrations.nearest(evidence.cycle.frequency_hz)
            hertz = evidence.cycle.frequency_hz if nearest is None else nearest.line.frequency_hz
            return Opinion("self_excited", 1.0, (reasons.cycle(hertz, rise),), nearest, hertz=hertz)
        if times > 0.0:
            return Opinion("self_excited", 1.0, (reasons.irregular(times),), vibrations.loudest)
        return None

    def _hear(self, level: float) -> Memory:
        """Take note of how loud it is."""
        loudest = self.memory.loudest
        # it at most doubles with each interval, so that one click does not make a quiet cut look idle for minutes
        credible = min(level, 2.0 * loudest) if loudest > 0.0 else level
        louder = self._level.louder(level**2)
        return self.memory._replace(loudest=max(credible, loudest * self._forgetting), louder=louder)

    def _record(
        self, view: Opinion, evidence: Evidence, first_sample: int, samples: int, sample_rate_hz: float
    ) -> Verdict:
        frequency_hz, mode = _meant(view, evidence)
        signs = self.memory.signs
        chatter = 0.0 if signs is None else chatter_probability(signs)
        claimed = chatter if view.state == "self_excited" else 1.0 - chatter
        # while nothing is cut what turns may be another machine
        doubted = evidence.orders.doubted and view.state != "idle"
        margin = Margin() if view.state in WITHOUT_MARGIN else evidence.margin
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
            confidence=round(view.right * claimed, 4),
            chatter_probability=None if view.state == "unknown" else round(chatter, 4),
            margin_percent=margin.margin_percent,
            margin_percent_ci95=margin.margin_ci95,
            reasons=[*view.reasons, reasons.DOUBTED] if doubted else list(view.reasons),
            flags=evidence.flags.names(),
        )


def _signs(view: Opinion, evidence: Evidence, memory: Memory) -> Signs | None:
    """What tells how likely an interval is chatter; None where nothing is cut, or nobody knows."""
    grounds = view.grounds
    if grounds is None:
        return None
    return Signs(grounds, told_by_vibrations(grounds, memory.told), memory.louder, evidence.vibrations.own_rise)


def _grown_suspect(told: Told, *, unheard: bool) -> Followed | None:
    """What may be chatter and has got louder itself, beyond its surroundings: a load makes all of them louder.

    Nothing on the orders of a speed that was told and is not heard yet, nor what is carried by another line: it may be
    what turns.
    """
    suspect = told.suspect
    if suspect is None or suspect.heard is None or suspect.carried or (unheard and suspect.heard.on_order):
        return None
    line = suspect.heard.line
    return suspect if own_rise(line.long_rise, line.absolute_rise) >= LOUDER else None


def _heard_hz(orders: Orders) -> float | None:
    """Rotation of the spindle, as far as it is heard; what nobody told and has the mains' frequency may be a hum."""
    hertz = orders.rotation_hz if orders.rotation_heard else None
    return None if hertz is not None and orders.source == "found" and is_mains(hertz) else hertz


def _quiet(evidence: Evidence, memory: Memory, settings: JudgeSettings) -> str | None:
    """Why nothing is being cut; None where it is."""
    if evidence.held:
        return "nothing moves"
    if evidence.rms <= settings.idle_ratio * memory.loudest:
        return "far below the level of cutting"
    return None if evidence.cutting or evidence.entering else "the tool is not in the cut"


def _meant(view: Opinion, evidence: Evidence) -> tuple[float | None, ModeEvidence | None]:
    """Frequency and mode of the vibration that a verdict is about."""
    if view.state in ("idle", "unknown"):
        return None, None
    if view.vibration is not None:
        return view.frequency_hz, view.vibration.mode
    if view.state == "self_excited":  # no other mode is what the alarm is about
        return view.frequency_hz, None
    if view.state == "forced" and evidence.orders.lines:
        return evidence.orders.lines[0].frequency_hz, None
    return (None, None) if evidence.critical is None else (evidence.critical.frequency_hz, evidence.critical)
