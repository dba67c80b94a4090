"""What turns: speed and teeth, as far as anybody told."""

from __future__ import annotations

from typing import Annotated

import msgspec


class SpindleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What turns: the table ``[spindle]`` of a machine configuration.

    Attributes
    ----------
    speed_rpm : float or None
        Spindle speed; None where nobody knows.
    teeth : int
        Cutting edges that pass in one revolution; 1 for turning.
    """

    speed_rpm: Annotated[float, msgspec.Meta(gt=0)] | None = None
    teeth: Annotated[int, msgspec.Meta(ge=1)] = 1
