"""How likely an interval is chatter, whatever it is called: one number for whoever sets a limit of their own.

The word comes from what the vibrations do. Beyond that the loudness tells: an alarm of a cut that is as loud as ever is
the likeliest to be false, and what was called calm or forced in one that has got four times as loud the likeliest to be
chatter that was missed; all the more where its strongest line has risen by itself.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from chatter_monitor.verdict.vibrations import Told

Grounds = Literal["alarm", "surge", "warning", "calm"]


class Fit(NamedTuple):
    """A logistic regression: weights of the measures of `Signs`, and what is added."""

    sure: float
    louder: float
    own_rise: float
    offset: float


# Made by ``python -m benchmarks.verdict.probability``, with the code of decision 111.
ALARM = Fit(0.849, 1.617, -0.139, 0.822)
SURGE = Fit(0.431, 0.424, 1.188, 0.223)
WARNING = Fit(0.380, 1.227, 0.134, 0.307)
CALM = Fit(0.283, 2.544, 1.104, -3.676)

# An alarm that no line makes is as sure as one that a line is so sure of.
BY_LOUDNESS = 0.99
# What the vibrations tell is no surer than this, and up to so much louder and so far risen was seen.
LEAST, MOST_LOUDER, MOST_RISEN = 0.001, 2.0, 3.0


class Signs(NamedTuple):
    """What tells of an interval of cutting how likely it is chatter.

    Attributes
    ----------
    grounds : Grounds
        Whether it is called chatter, gets louder from one moment to the next, is warned of otherwise, or none of these.
    sure : float
        How likely it is by what its vibrations do: those of the alarm, or the most suspicious.
    louder : float
        By how much it is louder than usual (natural logarithm of the amplitude).
    own_rise : float
        By how much the line with most of the power is louder than it has been by itself, likewise.
    """

    grounds: Grounds
    sure: float
    louder: float
    own_rise: float

    @property
    def measures(self) -> tuple[float, float, float]:
        """What a fit weighs, each within what was seen: log odds, loudness, rise."""
        sure = min(max(self.sure, LEAST), 1.0 - LEAST)
        louder, risen = min(max(self.louder, 0.0), MOST_LOUDER), min(max(self.own_rise, 0.0), MOST_RISEN)
        return math.log(sure / (1.0 - sure)), louder, risen


def told_by_vibrations(grounds: Grounds, told: Told) -> float:
    """How likely it is chatter by what its vibrations do."""
    alarm = told.alarm
    if alarm is not None:
        return alarm.self_excited
    return BY_LOUDNESS if grounds == "alarm" else told.overview.suspicion


def chatter_probability(signs: Signs) -> float:
    """How likely an interval of cutting is chatter, among cuts like those of the benchmark."""
    match signs.grounds:
        case "alarm":
            fit = ALARM
        case "surge":
            fit = SURGE
        case "warning":
            fit = WARNING
        case "calm":
            fit = CALM
    odds, louder, risen = signs.measures
    return 1.0 / (1.0 + math.exp(-(fit.sure * odds + fit.louder * louder + fit.own_rise * risen + fit.offset)))
