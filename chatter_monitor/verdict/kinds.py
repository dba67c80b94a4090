"""What a vibration is, from how its line behaves: a hidden Markov chain of four kinds.

Noise drives it (`NOISE`), it grows by itself (`GROWING`), it has grown and is limited by the tool leaving the cut
(`SATURATED`), or something forces it (`FORCED`). Saturated chatter and a forced line look the same: narrow, coherent,
steady. What tells them apart is how they came about. A line that was seen to grow out of its surroundings by itself
goes on being self-excited for as long as it stays, whatever its damping reads by then (MATHS section 3); one that was
there from the start, or that came where an order of the spindle is, is forced.

The likelihoods of a frame come from a logistic regression on the line's measures (`benchmarks.verdict.train`). Frames
that overlap in their history are no independent evidence, so the logarithm of the likelihood counts `EVIDENCE` times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from chatter_monitor.tracking.spectrum import Line
from chatter_monitor.verdict.weights import CALM, GROWTH

# Share at which a frame's logarithmic likelihood counts: its history overlaps with that of the frames before.
EVIDENCE = 0.4
# No single frame says more than this.
CONVINCING = 8.0
# Probabilities of a change in one frame.
BEGINS_TO_GROW = 1e-6
GROWS_ON_FORCED = 1e-5
BEGINS_FORCED = 3e-3
SATURATES = 0.1
DIES_WHILE_GROWING = 0.1
ENDS = 3e-4
# A vibration on an order of the spindle is less likely to be self-excited by this factor.
ON_ORDER = math.exp(-5.0)

# Damping taken for granted where the tracker has no mode at the line.
NO_MODE_DAMPING = 0.03


class Kinds(NamedTuple):
    """Probability of each kind."""

    noise: float
    growing: float
    saturated: float
    forced: float

    @property
    def self_excited(self) -> float:
        """That it is chatter, grown or growing."""
        return self.growing + self.saturated


# Before anything is known.
PRIOR = Kinds(noise=0.98, growing=2e-4, saturated=2e-4, forced=0.0196)


@dataclass(frozen=True, slots=True)
class Likeness:
    """Logarithm of the likelihood of a frame under growth, and under a calm coherent line, over that under noise."""

    growth: float
    calm: float


def measures(line: Line, damping_ratio: float | None) -> tuple[float, ...]:
    """Bounded measures of a line, in the order of the weights.

    Prominence (10 dB), log odds of the share of power, coherence after 25 ms (as -log(1 - c)), variation of the
    amplitude, rise within one second and within six (natural logarithm), decay and growth (as damping ratios in
    percent), logarithm of the damping ratio that the tracker reads.
    """
    share = min(max(line.share, 0.01), 0.99)
    growth = line.growth_per_s / (2.0 * math.pi * line.frequency_hz)
    damping = NO_MODE_DAMPING if damping_ratio is None else min(max(damping_ratio, 0.0), 0.1) + 0.001
    return (
        min(max(line.prominence_db, 0.0), 40.0) / 10.0,
        math.log(share / (1.0 - share)),
        -math.log(1.01 - min(line.coherence[0], 1.0)),
        min(line.variation, 1.0),
        min(max(line.rise, -1.5), 3.5),
        min(max(line.long_rise, -1.5), 3.5),
        100.0 * min(max(growth, -0.02), 0.0),
        100.0 * min(max(growth, 0.0), 0.02),
        math.log10(damping),
    )


def likeness(line: Line, damping_ratio: float | None) -> Likeness:
    """How much the line looks like growth, and like something coherent and steady."""
    x = measures(line, damping_ratio)
    growth, calm = (
        sum(weight * value for weight, value in zip(weights.per_measure, x, strict=True)) + weights.offset
        for weights in (GROWTH, CALM)
    )
    return Likeness(_bounded(growth), _bounded(calm))


NOTHING = Likeness(-CONVINCING, -CONVINCING)


def follow(before: Kinds, seen: Likeness, *, on_order: bool) -> Kinds:
    """Probabilities after another frame: the forward recursion of the chain."""
    favour = ON_ORDER if on_order else 1.0
    noise, growing, saturated, forced = before
    begun = noise * BEGINS_TO_GROW * favour
    begun_on_forced = forced * GROWS_ON_FORCED * favour
    predicted = np.array(
        [
            noise * (1.0 - BEGINS_FORCED) - begun + growing * DIES_WHILE_GROWING + (saturated + forced) * ENDS,
            growing * (1.0 - SATURATES - DIES_WHILE_GROWING) + begun + begun_on_forced,
            saturated * (1.0 - ENDS) + growing * SATURATES,
            forced * (1.0 - ENDS) - begun_on_forced + noise * BEGINS_FORCED,
        ]
    )
    logarithm = EVIDENCE * np.array([0.0, seen.growth, seen.calm, seen.calm])
    posterior = predicted * np.exp(logarithm - logarithm.max())
    return Kinds(*(posterior / posterior.sum()).tolist())


def _bounded(value: float) -> float:
    return min(max(value, -CONVINCING), CONVINCING)
