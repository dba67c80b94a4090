"""What a vibration is, from how its line behaves: a hidden Markov chain of four kinds.

Noise drives it (`NOISE`), it grows by itself (`GROWING`), it has grown and is limited by the tool leaving the cut
(`SATURATED`), or something forces it (`FORCED`). Saturated chatter and a forced line look the same: narrow, coherent,
steady. What tells them apart is how they came about. A line that was seen to grow out of its surroundings by itself
goes on being self-excited for as long as it stays, whatever its damping reads by then (MATHS section 3); one that was
there from the start, or that came where an order of the spindle is, is forced.

The likelihoods of a frame come from a logistic regression on the line's measures (`benchmarks.verdict.train`). Frames
that overlap in their history are no independent evidence, so only a share of the logarithm of the likelihood counts.
"""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import NamedTuple

from chatter_monitor.tracking.spectrum import Line
from chatter_monitor.verdict.weights import CALM, GROWTH

# No single frame says more than this.
CONVINCING = 8.0


@dataclass(frozen=True, slots=True)
class Chain:
    """Constants of the chain, chosen on development cuts; `benchmarks.verdict.train` shows what others would do.

    Attributes
    ----------
    evidence : float
        Share at which a frame's logarithmic likelihood counts: its history overlaps with that of the frames before.
    begins_to_grow, grows_when_steady, begins_steady, saturates, dies_while_growing, ends : float
        Probabilities of a change in one frame.
    """

    evidence: float = 0.4
    begins_to_grow: float = 1e-5
    grows_when_steady: float = 1e-6
    begins_steady: float = 3e-3
    saturates: float = 0.1
    dies_while_growing: float = 0.1
    ends: float = 3e-3


CHAIN = Chain()


class Kinds(NamedTuple):
    """Probability of each kind."""

    noise: float
    growing: float
    saturated: float
    steady: float

    @property
    def risen(self) -> float:
        """That it has risen out of its surroundings, or does."""
        return self.growing + self.saturated


# Before anything is known.
PRIOR = Kinds(noise=0.98, growing=2e-4, saturated=2e-4, steady=0.0196)


@dataclass(frozen=True, slots=True)
class Likeness:
    """Logarithm of the likelihood of a frame under growth, and under a calm coherent line, over that under noise."""

    growth: float
    calm: float


def measures(line: Line, damping_ratio: float | None) -> tuple[float, ...]:
    """Bounded measures of a line, in the order of the weights.

    Prominence (10 dB), log odds of the share of power, coherence after 25 ms (as -log(1 - c)), variation of the
    amplitude, rise within one second and within eight (natural logarithm), decay and growth (as damping ratios in
    percent), logarithm of the damping ratio that the tracker reads, or the loss of coherence where it has no mode.
    """
    share = min(max(line.share, 0.01), 0.99)
    growth = line.growth_per_s / (2.0 * math.pi * line.frequency_hz)
    damping = line.damping_ratio if damping_ratio is None else damping_ratio
    return (
        min(max(line.prominence_db, 0.0), 40.0) / 10.0,
        math.log(share / (1.0 - share)),
        -math.log(1.01 - min(line.coherence, 1.0)),
        min(line.variation, 1.0),
        min(max(line.rise, -1.5), 3.5),
        min(max(line.long_rise, -1.5), 3.5),
        100.0 * min(max(growth, -0.02), 0.0),
        100.0 * min(max(growth, 0.0), 0.02),
        math.log10(min(max(damping, 0.0), 0.1) + 0.001),
    )


def likeness(line: Line, damping_ratio: float | None) -> Likeness:
    """How much the line looks like growth, and like something coherent and steady."""
    x = measures(line, damping_ratio)
    growth, calm = (sum(map(operator.mul, weights.per_measure, x)) + weights.offset for weights in (GROWTH, CALM))
    return Likeness(_bounded(growth), _bounded(calm))


NOTHING = Likeness(-CONVINCING, -CONVINCING)


def follow(before: Kinds, seen: Likeness, chain: Chain = CHAIN, *, again: bool = False) -> Kinds:
    """Probabilities after another frame: the forward recursion of the chain.

    What has chattered before and is calm and coherent ``again`` is saturated, not steady from the start.
    """
    noise, growing, saturated, steady = before
    begun, begun_when_steady = noise * chain.begins_to_grow, steady * chain.grows_when_steady
    died = growing * chain.dies_while_growing
    grown = growing * chain.saturates
    ended_saturated, ended_steady = saturated * chain.ends, steady * chain.ends
    begun_calm = noise * chain.begins_steady
    predicted = (
        noise - begun - begun_calm + died + ended_saturated + ended_steady,
        growing - died - grown + begun + begun_when_steady,
        saturated - ended_saturated + grown + (begun_calm if again else 0.0),
        steady - ended_steady - begun_when_steady + (0.0 if again else begun_calm),
    )
    most = max(0.0, seen.growth, seen.calm)
    likelihoods = [math.exp(chain.evidence * (log - most)) for log in (0.0, seen.growth, seen.calm, seen.calm)]
    posterior = [probability * likelihood for probability, likelihood in zip(predicted, likelihoods, strict=True)]
    total = sum(posterior)
    return Kinds(*(probability / total for probability in posterior))


def _bounded(value: float) -> float:
    return min(max(value, -CONVINCING), CONVINCING)
