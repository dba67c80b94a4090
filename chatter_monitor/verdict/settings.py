"""Thresholds of the verdict."""

from __future__ import annotations

from typing import Annotated

import msgspec

Probability = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Positive = Annotated[float, msgspec.Meta(gt=0)]


class JudgeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Thresholds of the verdict: the table ``[verdict]`` of a machine configuration.

    Attributes
    ----------
    alarm_probability : float
        Probability of self-excitation from which on it is an alarm.
    calm_probability : float
        Probability below which a running alarm ends. It may not be above `alarm_probability`.
    warning_probability : float
        Probability of self-excitation from which on it is `approaching`.
    approaching_damping : float
        Damping below which little is left: the early warning, too.
    approaching_margin_percent : float
        Margin below which little is left, where it is known.
    certainty : float
        Probability with which damping or margin has to be below its threshold.
    forced_share : float
        Share of the power that is forced from which on the cut is called forced.
    idle_ratio : float
        Below this share of the loudest level of the last minute, nothing is being cut.
    """

    alarm_probability: Probability = 0.8
    calm_probability: Probability = 0.5
    warning_probability: Probability = 0.1
    approaching_damping: Positive = 0.003
    approaching_margin_percent: Positive = 15.0
    certainty: Probability = 0.9
    forced_share: Probability = 0.45
    idle_ratio: Probability = 0.003

    def __post_init__(self) -> None:
        if self.calm_probability > self.alarm_probability:  # an alarm would end with the interval that it begins with
            msg = (
                f"calm_probability must not be above alarm_probability ({self.alarm_probability}),"
                f" got {self.calm_probability}"
            )
            raise ValueError(msg)
