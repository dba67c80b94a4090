"""Settings of the simulation that runs beside a signal: the table ``[model]`` of a machine configuration."""

from __future__ import annotations

from typing import Annotated

import msgspec


class ModelSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The simulation that the signal is compared with while it runs: the table ``[model]`` of a machine configuration.

    Attributes
    ----------
    file : str or None
        Model file of the machine (docs/live.md); None for no comparison. The speed of ``[spindle]``, where it is given,
        replaces that of the model.
    channels : tuple of int, or None
        Which of the channels listened to are compared, counted from 0; None for all.
    """

    file: Annotated[str, msgspec.Meta(min_length=1)] | None = None
    channels: tuple[Annotated[int, msgspec.Meta(ge=0)], ...] | None = None
