"""What turns: speed and teeth, as far as anybody told."""

from __future__ import annotations

from typing import Annotated

import msgspec

# What a control tells of a speed that stays the same differs by less, from one moment to the next.
STEADY = 0.01


class SpindleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What turns: the table ``[spindle]`` of a machine configuration.

    Attributes
    ----------
    speed_rpm : float or None
        Spindle speed; None where nobody knows.
    teeth : int
        Cutting edges that pass in one revolution; 1 for turning.
    min_rpm, max_rpm : float or None
        What the spindle can do, for advice on other speeds. The first may not be above the second.
    """

    speed_rpm: Annotated[float, msgspec.Meta(gt=0)] | None = None
    teeth: Annotated[int, msgspec.Meta(ge=1)] = 1
    min_rpm: Annotated[float, msgspec.Meta(gt=0)] | None = None
    max_rpm: Annotated[float, msgspec.Meta(gt=0)] | None = None

    def __post_init__(self) -> None:
        if self.min_rpm is not None and self.max_rpm is not None and self.min_rpm > self.max_rpm:
            msg = f"min_rpm must not be above max_rpm, got {self.min_rpm} and {self.max_rpm}"
            raise ValueError(msg)

    def turns_as(self, other: SpindleSettings) -> bool:
        """Whether as many teeth are told to turn as fast, or nobody knows how fast of either."""
        if self.speed_rpm is None or other.speed_rpm is None:
            return self.speed_rpm is other.speed_rpm and self.teeth == other.teeth
        return abs(self.speed_rpm / other.speed_rpm - 1.0) < STEADY and self.teeth == other.teeth
