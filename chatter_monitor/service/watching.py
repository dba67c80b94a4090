"""Channels beside a simulation: what of it is told, and when."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from chatter_monitor.discrepancy.live.settings import ModelSettings
from chatter_monitor.records import Mismatch, OdpFrame
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S

if TYPE_CHECKING:  # most monitors run without a model, and need not wait for the engine to be loaded
    from chatter_monitor.discrepancy.live.found import Found
    from chatter_monitor.discrepancy.live.watch import Watch

_WARM_UP_S = 4.0
REPEATED_S = 60.0  # after which a difference that stays is told again


class Watching:
    """All channels that are compared with a model.

    Parameters
    ----------
    settings : ModelSettings
        With a file.
    spindle : SpindleSettings
        Its speed and teeth, where known, replace those of the model.
    channels : int
        How many there are.
    rate_hz : float
        Of the frames.

    Raises
    ------
    InputError
        If the model cannot be read, or its modes are too fast for the signal.
    """

    def __init__(self, settings: ModelSettings, spindle: SpindleSettings, channels: int, rate_hz: float) -> None:
        from chatter_monitor.discrepancy.live.watch import Watch
        from chatter_monitor.physics.model_file import read_model

        system = read_model(Path(settings.file or ""))
        self._teeth = system.spindle.teeth if system.spindle else 1
        numbers = range(channels) if settings.channels is None else settings.channels
        self._watches = {number: Watch(system, rate_hz) for number in numbers if number < channels}
        self._told: dict[int, Mismatch] = {}
        self._heard: list[OdpFrame] = []
        _warm_up(Watch(system, rate_hz), rate_hz)
        self.set_spindle(spindle)

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed from now on."""
        from chatter_monitor.physics.parts import Spindle

        if spindle.speed_rpm is not None:
            for watch in self._watches.values():
                watch.set_spindle(Spindle(spindle.speed_rpm, spindle.teeth or self._teeth))

    def hear(self, frame: OdpFrame) -> None:
        """Take the next interval of a channel, without what turns with the spindle: that is not the simulation's."""
        self._heard.append(frame)

    def digest(self) -> Iterator[Mismatch]:
        """Work through what was heard; yields what is new, and from time to time what stays."""
        heard, self._heard = self._heard, []
        for frame in heard:
            yield from self._compare(frame)

    def _compare(self, frame: OdpFrame) -> Iterator[Mismatch]:
        watch = self._watches.get(frame.channel)
        if watch is None:
            return
        signal = np.full(len(frame), np.nan) if frame.flags else frame.signal
        found = watch.take(signal)
        if found is None:
            return
        end = frame.first_sample + len(frame)
        message = message_of(found, frame.channel, watch.sample_of(found.since), end, frame.sample_rate_hz)
        last = self._told.get(frame.channel)
        if last is None and message.outcome == "none":
            return
        stays = last is not None and _kind(last) == _kind(message)
        if last is None or not stays or (message.outcome != "none" and message.t >= last.t + REPEATED_S):
            self._told[frame.channel] = message
            yield message


def _warm_up(watch: Watch, rate_hz: float) -> None:
    """Load the compiled kernels: better before the first sample of a live source than after it."""
    noise = np.random.default_rng(0).standard_normal(round(_WARM_UP_S * rate_hz))
    for part in np.array_split(noise, round(_WARM_UP_S / INTERVAL_S)):
        watch.take(part)


def _kind(message: Mismatch) -> tuple[str, str | None, str | None]:
    return message.outcome, message.effect, message.sense


def message_of(found: Found, channel: int, since: int, end: int, rate_hz: float) -> Mismatch:
    """Message of the public contract for what was found up to sample `end`."""
    return Mismatch(
        channel=channel,
        t=end / rate_hz,
        sample=end,
        since_s=since / rate_hz,
        outcome=found.outcome,
        effect=found.effect,
        sense=found.sense,
        parameters=found.parameters,
        evidence_nats=found.evidence_nats,
        runner_up=found.runner_up,
        distance_nats=found.distance_nats,
        band_hz=found.band_hz,
        amplitude=found.amplitude,
        summary=in_words(found),
    )


def in_words(found: Found) -> str:
    """A sentence for people."""
    from chatter_monitor.discrepancy.findings import IN_WORDS

    values = found.parameters
    speed_rpm = values.get("spindle.speed_rpm")
    at_speed = "" if speed_rpm is None else f", as at {speed_rpm:.0f} rpm"
    match found.outcome:
        case "none":
            return "The simulation explains the signal again."
        case "unknown":
            return (
                "The signal shows a force that the simulation lacks, and that no single term of the catalogue explains."
            )
        case "parameters" if speed_rpm is not None:
            return f"The cut is not at the simulation's speed: it regenerates{at_speed}."
        case "parameters":
            mode = values["mode.1.frequency_hz"], 100.0 * values["mode.1.damping_ratio"]
            return f"The simulation's parameters do not hold: the mode is at {mode[0]:.4g} Hz, {mode[1]:.3g} % damped."
    sense = f" ({found.sense})" if found.sense else ""
    rival = ""
    if found.runner_up is not None and found.distance_nats is not None:
        rival = f"; next best is {found.runner_up}, {found.distance_nats:.0f} nats behind"
    return (
        f"The simulation lacks {IN_WORDS[found.effect or '']}{sense}{at_speed} ({found.evidence_nats:.0f} nats{rival})."
    )
