"""What a vibration is, from how its line behaves: a hidden Markov chain of four kinds.

Noise drives it (`noise`), it grows by itself (`growing`), it has grown and is limited by the tool leaving the cut
(`saturated`), or something forces it (`steady`). Saturated chatter and a forced line look the same: narrow, coherent,
steady. What tells them apart is how they came about. A line that was seen to grow out of its surroundings by itself
goes on being self-excited for as long as it stays, whatever its damping reads by then (MATHS section 3); one that was
there from the start, or that came where an order of the spindle is, is forced.

The likelihoods of a frame come from a logistic regression on the line's measures (`benchmarks.verdict.train`). Frames
that overlap in their history are no independent evidence, so only a share of the logarithm of the likelihood counts.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# What a frame looks like says no more than this; by how much it has risen may say more (`MOST_TELLING`).
CONVINCING = 8.0
# What is louder by so much than it has been for seconds (natural logarithm of the amplitude), in itself and beyond its
# surroundings, has hardly been there from the start: by so much less likely for each e-fold beyond.
LOUDER, UNLIKELY = 0.8, 8.0
# The amplitude of a mode that noise drives is beyond its median by r e-folds with a probability of 2^-exp(2r)
# (Rayleigh); one that grows may have come to any rise up to so much. What that tells is bounded.
LARGEST_RISE, MOST_TELLING = 3.5, 24.0
# A lone line lifts the level around it by 0.12 to 0.17 of its own rise (logarithms).
SKIRTS = 0.15

# What chatters lifts its surroundings by up to so much of its own rise, with its sidebands and the noise of the tool.
LIFTED = 0.4

# Coefficient of variation of the modulus of narrow-band noise, which is Rayleigh distributed.
NOISE_VARIATION = math.sqrt(4.0 / math.pi - 1.0)

MEASURES = 11
# Lag of the coherence of a line.
COHERENCE_LAG_S = 0.025

# A line of the short-time spectrum (`tracking.spectrum.Line`), with how much of its rise counts as its own, the damping
# ratio of the tracker's mode at it, or its own where there is none, its log odds for self-excitation by its place among
# the orders, the share of the power that its vibration takes, by how much it has grown from rotation to rotation
# (natural logarithm), that power, by how much it stands out more than before the tool entered, where nothing that turns
# explains that, and whether it has sidebands of which it is no multiple.
LINE = np.dtype(
    [
        ("frequency_hz", float),
        ("share", float),
        ("prominence_db", float),
        ("variation", float),
        ("growth_per_s", float),
        ("rise", float),
        ("long_rise", float),
        ("absolute_rise", float),
        ("own_rise", float),
        ("coherence", float),
        ("damping_ratio", float),
        ("order_odds", float),
        ("dominance", float),
        ("growth", float),
        ("power", float),
        ("arrival", float),
        ("carrier", np.bool_),
    ]
)


class Chain(NamedTuple):
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


class Likeness(NamedTuple):
    """Logarithm of the likelihood of a frame over that under noise.

    Attributes
    ----------
    growth, calm : float
        Under growth, and under a calm coherent line.
    steady : float
        Under one that has been there from the start: the same, less where it is louder than it was.
    """

    growth: float
    calm: float
    steady: float


NOTHING = Likeness(-CONVINCING, -CONVINCING, -CONVINCING)
# What has grown from rotation to rotation was not there from the start, and is no noise, however unsteady its lines.
REGENERATED = Likeness(CONVINCING, CONVINCING, -CONVINCING)


@njit(**OPTIONS)
def measures(line):
    """Bounded measures of a line, a record of `LINE`, in the order of the weights.

    Prominence (10 dB), log odds of the share of power, coherence after 25 ms (as -log(1 - c)) and the damping ratio
    that it would come from (as -log10), variation of the amplitude, rise within one second and within eight, and as
    much of the latter with that of the surroundings as is its own (natural logarithm), decay and growth (as damping
    ratios in percent), logarithm of the damping ratio.
    """
    share = min(max(line.share, 0.01), 0.99)
    growth = line.growth_per_s / (2.0 * math.pi * line.frequency_hz)
    return (
        min(max(line.prominence_db, 0.0), 40.0) / 10.0,
        math.log(share / (1.0 - share)),
        -math.log(1.01 - min(line.coherence, 1.0)),
        -math.log10(min(max(coherence_damping(line.coherence, line.frequency_hz), 2e-4), 0.03)),
        min(line.variation, 1.0),
        min(max(line.rise, -1.5), LARGEST_RISE),
        min(max(line.long_rise, -1.5), LARGEST_RISE),
        min(max(line.own_rise, -1.5), LARGEST_RISE),
        100.0 * min(max(growth, -0.02), 0.0),
        100.0 * min(max(growth, 0.0), 0.02),
        math.log10(min(max(line.damping_ratio, 0.0), 0.1) + 0.001),
    )


@njit(**OPTIONS)
def coherence_damping(coherence, frequency_hz):
    """Damping ratio of a mode that noise drives and that is as coherent: exp(-zeta omega t)."""
    return -math.log(min(max(coherence, 1e-6), 1.0)) / (2.0 * math.pi * frequency_hz * COHERENCE_LAG_S)


@njit(**OPTIONS)
def steady_share(share, variation):
    """Share of the power that is in a line and does not come and go as that of noise does.

    The modulus of noise varies by `NOISE_VARIATION`; that of a tone in noise is Rician, and of a tone that has the
    share s of the line about s^2 is heard as steady. So what noise looks like by chance counts little.
    """
    return share * (1.0 - (variation / NOISE_VARIATION) ** 2) if 0.0 < variation < NOISE_VARIATION else 0.0


@njit(**OPTIONS)
def likeness(line, weights):
    """How much a line looks like growth, like something calm, and like something steady from the start.

    Parameters
    ----------
    line : record of `LINE`
    weights : ndarray of float64, shape (2, MEASURES + 1)
        Of growth and of calm: one for each measure, and what is added.
    """
    growth = 0.0
    calm = 0.0
    x = measures(line)
    for i in range(MEASURES):
        growth += weights[0, i] * x[i]
        calm += weights[1, i] * x[i]
    # what has sidebands is coherent over the seconds in which they were told apart; they make it unsteady
    calm = CONVINCING if line.carrier else _bounded(calm + weights[1, MEASURES])
    risen = max(min(line.long_rise, line.absolute_rise), line.arrival)
    growth = _bounded(growth + weights[0, MEASURES])
    return Likeness(growth, calm, _bounded(calm - UNLIKELY * max(risen - LOUDER, 0.0)))


@njit(**OPTIONS)
def own_rise(long_rise, absolute_rise):
    """By how much a line is louder than it has been, but for what its surroundings are and it did not lift itself."""
    return min(absolute_rise, long_rise + LIFTED * absolute_rise)


@njit(**OPTIONS)
def beyond_chance(line):
    """Log likelihood of how far a line has risen within a second, if it grows, over that if noise drives a mode.

    The densities of the rise r are 1 / `LARGEST_RISE` and 2 ln 2 exp(2r) 2^-exp(2r). Positive from 0.8 on. What its
    surroundings have risen is a load's, but for as much as a line lifts them by itself.
    """
    lifted = min(max(line.absolute_rise - line.long_rise, 0.0), SKIRTS * line.absolute_rise)
    risen = max(min(line.rise + lifted, line.long_rise + lifted, line.absolute_rise), 0.0)
    chance = math.log(2.0 * math.log(2.0) * LARGEST_RISE) + 2.0 * risen - math.log(2.0) * math.exp(2.0 * risen)
    return min(max(-chance, 0.0), MOST_TELLING)


@njit(**OPTIONS)
def follow(before, seen, news, chain, unforced):
    """Probabilities after another frame: the forward recursion of the chain.

    Parameters
    ----------
    before : Kinds
    seen : Likeness
        What the frame looks like.
    news : float
        What it says besides, for growth, that no frame before has said: it counts in full.
    chain : Chain
    unforced : bool
        Whether it has chattered before, or came with the tool where nothing forces it: what is calm and coherent then
        is saturated, not steady from the start.
    """
    noise, growing, saturated, steady = before
    begun, begun_when_steady = noise * chain.begins_to_grow, steady * chain.grows_when_steady
    died = growing * chain.dies_while_growing
    grown = growing * chain.saturates
    ended_saturated, ended_steady = saturated * chain.ends, steady * chain.ends
    begun_calm = noise * chain.begins_steady
    noise += died + ended_saturated + ended_steady - begun - begun_calm
    growing += begun + begun_when_steady - died - grown
    saturated += grown - ended_saturated + (begun_calm if unforced else 0.0)
    steady -= ended_steady + begun_when_steady - (0.0 if unforced else begun_calm)

    grows = chain.evidence * seen.growth + news
    calm = chain.evidence * seen.calm
    most = max(0.0, grows, calm)
    noise *= math.exp(-most)
    growing *= math.exp(grows - most)
    saturated *= math.exp(calm - most)
    steady *= math.exp(chain.evidence * seen.steady - most)
    total = noise + growing + saturated + steady
    return Kinds(noise / total, growing / total, saturated / total, steady / total)


@njit(**OPTIONS)
def _bounded(value):
    return min(max(value, -CONVINCING), CONVINCING)
