"""Which sound devices there are, what they can, and which one the configuration means."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from chatter_monitor.acquisition.portaudio import COMMON_RATES_HZ, Choice, Device, PortAudio
from chatter_monitor.config import Settings
from chatter_monitor.errors import EnvironmentFault

HEADINGS = ("", "index", "name", "interface", "channels", "opens at (kHz)")


class Listed(msgspec.Struct, frozen=True):
    """A device for a program: ``--json``."""

    index: int
    name: str
    host_api: str
    channels: int
    sample_rates_hz: list[float]
    chosen: bool


class Listing(msgspec.Struct, frozen=True):
    """All inputs, and why none of them is the configuration's, if so."""

    devices: list[Listed]
    chosen_sample_rate_hz: float | None
    trouble: str | None


def listing(settings: Settings) -> Listing:
    """Look at the inputs that there are now.

    Raises
    ------
    EnvironmentFault
        If PortAudio does not work.
    """
    rate_hz = settings.tracker.sample_rate_hz
    audio = PortAudio(settings.input, rate_hz)
    choice: Choice | None = None
    trouble = None
    try:
        choice = audio.choose()
    except EnvironmentFault as fault:
        trouble = str(fault)
    rates = dict.fromkeys((rate_hz, *COMMON_RATES_HZ, settings.input.sample_rate_hz or rate_hz))
    devices = audio.devices()
    chosen = None if choice is None else choice.device.index
    return Listing(
        devices=[
            Listed(
                d.index,
                d.name,
                d.host_api,
                d.channels,
                audio.rates_hz(d, _asked(d, settings), rates),
                d.index == chosen,
            )
            for d in devices
        ],
        chosen_sample_rate_hz=None if choice is None else choice.sample_rate_hz,
        trouble=trouble,
    )


def lines(found: Listing) -> list[str]:
    """Table for a person."""
    rows = [HEADINGS, *(_cells(device) for device in found.devices)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADINGS))]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    if found.trouble is not None:
        return [*(table if found.devices else []), f"The configuration chooses none: {found.trouble}"]
    rate_khz = (found.chosen_sample_rate_hz or 0.0) / 1000
    return [*table, f"> is what the configuration chooses ([input] device), at {rate_khz:g} kHz."]


def _asked(device: Device, settings: Settings) -> int:
    """Channels to ask the device for; what it does not have it cannot refuse."""
    return min(device.channels, max(settings.input.channels or (0,)) + 1)


def _cells(device: Listed) -> Sequence[str]:
    rates = " ".join(f"{rate / 1000:g}" for rate in device.sample_rates_hz) or "none: is another program using it?"
    mark = ">" if device.chosen else ""
    return (mark, str(device.index), device.name, device.host_api, str(device.channels), rates)
