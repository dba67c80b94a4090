"""Settings of the input: the table ``[input]`` of a machine configuration."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec


class InputSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which samples to listen to and what they mean.

    Attributes
    ----------
    device : str
        Name of the sound device. Read by the daemon to come; `replay` has a file instead and ignores it.
    sample_rate_hz : float
        Rate to open the device at. Read by the daemon to come; `replay` takes the rate of its file and ignores it.
    channels : tuple of int, or None
        Channels to listen to, counted from 0, in this order; None for all.
    sensor : str
        What the samples measure: sound pressure, acceleration, velocity or displacement, in this order of the names.
    full_scale_per_unit : float
        Reading of the file or card, as a fraction of its full scale, for one unit of the sensor (Pa, m/s², m/s, m).
        1.0 leaves the samples as they are.
    """

    device: Annotated[str, msgspec.Meta(min_length=1)] = "default"
    sample_rate_hz: Annotated[float, msgspec.Meta(gt=0)] = 48000.0
    channels: Annotated[tuple[Annotated[int, msgspec.Meta(ge=0)], ...], msgspec.Meta(min_length=1)] | None = None
    sensor: Literal["microphone", "accelerometer", "vibrometer", "displacement"] = "microphone"
    full_scale_per_unit: Annotated[float, msgspec.Meta(gt=0)] = 1.0

    def __post_init__(self) -> None:
        if self.channels is not None and len(set(self.channels)) < len(self.channels):
            msg = f"channels must differ from each other, got {list(self.channels)}"
            raise ValueError(msg)
        if not math.isfinite(self.full_scale_per_unit):
            msg = f"full_scale_per_unit must be finite, got {self.full_scale_per_unit}"
            raise ValueError(msg)
