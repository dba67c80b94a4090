"""Settings of the input: the table ``[input]`` of a machine configuration."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec


class InputSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which samples to listen to and what they mean.

    Attributes
    ----------
    device : str or int
        Sound device to listen to, as `chatter-monitor devices` lists them: part of its name in upper or lower case, a
        pattern with ``*`` and ``?``, or its index, which changes when devices come and go. "default" is the system's
        choice. A recording has no use for it.
    sample_rate_hz : float or None
        Rate to open the device at; None for the tracker's, or the next best that the device can. A recording has its
        own.
    channels : tuple of int, or None
        Channels to listen to, counted from 0, in this order; None for all of a recording, and for the first of a sound
        device, which has as many as its driver likes.
    sensor : str
        What the samples are of: a microphone measures sound pressure, an accelerometer acceleration, a vibrometer
        velocity.
    full_scale_per_unit : float
        Reading of the file or card, as a fraction of its full scale, for one unit of the sensor (Pa, m/s², m/s, m).
        1.0 leaves the samples as they are.
    give_up_s : float
        After so long without a sample the daemon stops feeding the service manager's watchdog, which then starts it
        anew (docs/decisions/0007-when-to-give-up.md).
    """

    device: Annotated[str, msgspec.Meta(min_length=1)] | Annotated[int, msgspec.Meta(ge=0)] = "default"
    sample_rate_hz: Annotated[float, msgspec.Meta(gt=0)] | None = None
    channels: Annotated[tuple[Annotated[int, msgspec.Meta(ge=0)], ...], msgspec.Meta(min_length=1)] | None = None
    sensor: Literal["microphone", "accelerometer", "vibrometer", "displacement"] = "microphone"
    full_scale_per_unit: Annotated[float, msgspec.Meta(gt=0)] = 1.0
    give_up_s: Annotated[float, msgspec.Meta(gt=0)] = 60.0

    def __post_init__(self) -> None:
        if self.channels is not None and len(set(self.channels)) < len(self.channels):
            msg = f"channels must differ from each other, got {list(self.channels)}"
            raise ValueError(msg)
        if not math.isfinite(self.full_scale_per_unit):
            msg = f"full_scale_per_unit must be finite, got {self.full_scale_per_unit}"
            raise ValueError(msg)
