"""The hidden Markov chain of what a vibration is, with likelihoods made up: no trained weight takes part."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.kernels import kinds as kernel
from chatter_monitor.kernels.kinds import CONVINCING, LINE, NOTHING, PRIOR, Chain, Kinds, Likeness, measures
from chatter_monitor.kernels.vibrations import CALMED

FRAMES_PER_S = 20
GROWS = Likeness(growth=CONVINCING, calm=0.0, steady=0.0)
STEADY = Likeness(growth=-CONVINCING, calm=CONVINCING, steady=CONVINCING)
# Of no regression: whatever is measured counts a lot.
WEIGHTS = 100.0 * np.random.default_rng(0).standard_normal((2, kernel.MEASURES + 1))


def follow(before, seen):
    """Another frame of a vibration that has not chattered before."""
    return kernel.follow(before, seen, 0.0, Chain(), False)


def line(**about):
    """A line that is this and otherwise unremarkable."""
    usual = {
        "frequency_hz": 1000.0, "share": 0.5, "prominence_db": 20.0, "variation": 0.3, "growth_per_s": 20.0,
        "rise": 0.7, "long_rise": 1.5, "absolute_rise": 1.7, "own_rise": 1.7, "coherence": 0.9, "damping_ratio": 0.02,
        "order_odds": 0.0, "dominance": 0.5, "growth": 0.0, "power": 1.0, "arrival": 0.0,
        "carrier": False,
    }  # fmt: skip
    return np.array([tuple((usual | about)[name] for name in LINE.names)], LINE)[0]


def followed(*frames, begin=PRIOR):
    """Probabilities after each frame."""
    history = []
    for seen in frames:
        begin = follow(begin, seen)
        history.append(begin)
    return history


def frames_until(condition, seen, *, begin=PRIOR, most=1000):
    """Number of equal frames until a condition holds."""
    for count in range(1, most):
        begin = follow(begin, seen)
        if condition(begin):
            return count
    return most


def test_before_anything_is_known_it_is_noise():
    """The prior is a distribution in which noise is likely and chatter is not."""
    assert sum(PRIOR) == pytest.approx(1.0)
    assert PRIOR.noise > 0.9 > 0.01 > PRIOR.risen


def test_a_frame_that_says_nothing_moves_little():
    """Where every kind is as likely, a frame only lets the chain take its step: no probability jumps."""
    step = follow(PRIOR, Likeness(0.0, 0.0, 0.0))
    np.testing.assert_allclose(step, PRIOR, atol=5e-3)


def test_a_calm_line_from_the_start_is_steady():
    """What is coherent and steady from the first frame on was not seen to grow, however long it lasts."""
    history = followed(*[STEADY] * 60 * FRAMES_PER_S)
    assert all(kinds.steady > 0.9 for kinds in history[FRAMES_PER_S:])
    assert all(kinds.risen < 0.1 for kinds in history)


def test_growth_makes_it_risen():
    """Growth for half a second out of noise has risen, and is growing until it is calm."""
    history = followed(*[GROWS] * 10)
    assert history[-1].risen > 0.95
    assert history[-1].growing > history[-1].saturated


def test_growth_then_calm_stays_risen():
    """What was seen to grow has risen for as long as it stays, though it looks like a forced line by then."""
    history = followed(*[GROWS] * 10, *[STEADY] * 10 * 60 * FRAMES_PER_S)[10:]
    assert min(kinds.risen for kinds in history) > 0.9
    assert history[-1].saturated > 0.9


def test_growth_of_a_steady_line_counts():
    """A line that was steady for a minute and then grows has risen within half a second."""
    forced = followed(*[STEADY] * 60 * FRAMES_PER_S)[-1]
    assert frames_until(lambda k: k.risen > 0.8, GROWS, begin=forced) <= FRAMES_PER_S // 2


@pytest.mark.parametrize("before", [[GROWS] * 20, [GROWS] * 20 + [STEADY] * 1200, [STEADY] * 1200])
def test_silence_ends_it(before):
    """When the line is gone it is noise again within half a second, whatever it was and however long."""
    last = followed(*before)[-1]
    assert frames_until(lambda k: k.noise > 0.9, NOTHING, begin=last) <= FRAMES_PER_S // 2


def test_one_frame_is_not_enough():
    """A single frame of whatever looks most like growth does not make it more likely than not."""
    assert followed(GROWS)[0].risen < 0.5


@pytest.mark.parametrize(
    "extreme",
    [
        [Likeness(CONVINCING, CONVINCING, CONVINCING)],
        [NOTHING],
        [GROWS, NOTHING, STEADY],
        [STEADY] * 100 + [GROWS] * 3 + [NOTHING] * 100,
    ],
)
def test_an_hour_of_extreme_evidence(extreme):
    """After an hour of it every kind still has a probability above zero, and they sum to one."""
    history = np.array(followed(*extreme * (3600 * FRAMES_PER_S // len(extreme))))
    assert np.isfinite(history).all()
    assert (history > 0.0).all()
    np.testing.assert_allclose(history.sum(axis=1), 1.0, atol=1e-12)


bounded = st.floats(-CONVINCING, CONVINCING)
seen = st.builds(Likeness, bounded, bounded, bounded)


@settings(max_examples=300, derandomize=True, deadline=None)
@given(st.lists(seen, min_size=1, max_size=60))
def test_always_a_distribution(history):
    """For any history the probabilities are finite, within 0 and 1, and sum to one."""
    kinds = PRIOR
    for each in history:
        kinds = follow(kinds, each)
        assert all(0.0 < p < 1.0 for p in kinds)
        assert sum(kinds) == pytest.approx(1.0, abs=1e-12)


@settings(max_examples=300, derandomize=True, deadline=None)
@given(st.tuples(*[st.floats(1e-6, 1.0)] * 4), seen, st.floats(0.1, 4.0))
def test_more_growth_is_more_growing(weights, before, more):
    """Of two frames alike but for growth, the one with more of it makes growing likelier, and nothing else."""
    kinds = Kinds(*(w / sum(weights) for w in weights))
    less, grown = (follow(kinds, before._replace(growth=g)) for g in (before.growth, before.growth + more))
    assert grown.growing > less.growing
    assert all(a <= b for a, b in zip(grown[::2] + grown[3:], less[::2] + less[3:], strict=True))


def test_what_is_calm_and_louder_than_before_has_risen():
    """A line that is calm from its first frame on has risen if it is e-fold louder than before, else it is steady."""

    def kinds(long_rise, absolute_rise, arrival=0.0):
        about = line(long_rise=long_rise, absolute_rise=absolute_rise, arrival=arrival)
        calm = kernel.likeness(about, np.eye(2, kernel.MEASURES + 1, 5))
        return followed(*[calm._replace(growth=2.0, calm=3.0, steady=3.0 + calm.steady - calm.calm)] * 40)[-1]

    assert kinds(1.0 + kernel.LOUDER, 1.0 + kernel.LOUDER).risen > 0.8
    assert kinds(1.0 + kernel.LOUDER, 0.0).steady > 0.8
    assert kinds(0.0, 1.0 + kernel.LOUDER).steady > 0.8
    assert kinds(0.0, 0.0).steady > 0.8
    assert kinds(0.0, 0.0, arrival=1.0 + kernel.LOUDER).risen > 0.8


def test_what_has_sidebands_is_calm():
    """However unsteady they make it; steady from the start only if it is no louder than it was."""
    unsteady = {"long_rise": 0.0, "absolute_rise": 0.0, "carrier": True}
    assert kernel.likeness(line(**unsteady), -(WEIGHTS**2))[1:] == (CONVINCING, CONVINCING)
    assert kernel.likeness(line(**unsteady, arrival=1.0 + kernel.LOUDER), -(WEIGHTS**2))[1:] == (CONVINCING, 0.0)
    assert kernel.likeness(line(**unsteady | {"carrier": False}), -(WEIGHTS**2)).calm == -CONVINCING


def test_measures_are_what_the_docstring_says():
    """Each measure of a line by hand."""
    growth_percent = 100.0 * 20.0 / (2.0 * math.pi * 1000.0)
    tightness = -math.log10(-math.log(0.9) / (2.0 * math.pi * 1000.0 * 0.025))
    expected = (2.0, 0.0, -math.log(0.11), tightness, 0.3, 0.7, 1.5, 1.7, 0.0, growth_percent, math.log10(0.021))
    assert measures(line()) == pytest.approx(expected)
    assert measures(line(growth_per_s=-20.0))[8:10] == pytest.approx((-growth_percent, 0.0))


values = st.floats(allow_nan=False)


@settings(max_examples=300, derandomize=True, deadline=None)
@given(
    st.builds(
        line,
        frequency_hz=st.floats(50.0, 6400.0),
        share=st.floats(0.0, 1.0),
        prominence_db=values,
        variation=st.floats(0.0),
        growth_per_s=values,
        rise=values,
        long_rise=values,
        coherence=st.floats(0.0, 1.0),
        damping_ratio=values,
    )
)
def test_no_line_says_more_than_a_frame_may(anything):
    """Whatever is measured, the likeness is finite and bounded."""
    growth, *calm = kernel.likeness(anything, WEIGHTS)
    assert -CONVINCING <= growth <= CONVINCING
    assert all(-CONVINCING <= value <= CONVINCING for value in calm)


@pytest.mark.parametrize("name", ["rise", "absolute_rise"])
@pytest.mark.parametrize(("risen", "expected"), [(-1.0, 0.0), (0.7, 0.0), (1.0, 1.54), (1.5, 9.34), (3.0, 24.0)])
def test_a_rise_tells_as_much_as_noise_hardly_does(name, risen, expected):
    """The least of the rises, over what the amplitude of narrow-band noise has of it: by hand and by draws."""
    told = kernel.beyond_chance(line(**({"rise": 3.5, "long_rise": 3.5, "absolute_rise": 3.5} | {name: risen})))
    assert told == pytest.approx(expected, abs=0.01)
    if risen == 1.0:
        rises = np.log(np.random.default_rng(1).rayleigh(1.0 / math.sqrt(2.0 * math.log(2.0)), 1_000_000))
        density = np.mean(abs(rises - risen) < 0.02) / 0.04
        assert told == pytest.approx(math.log(1.0 / 3.5 / density), abs=0.15)


@pytest.mark.parametrize(("absolute_rise", "risen"), [(0.9, 0.9), (1.2, 1.2), (2.0, 1.4), (3.0, 1.55)])
def test_what_its_own_skirts_lift_counts_as_its_own(absolute_rise, risen):
    """A line an e-fold out of its surroundings has risen by more where these rose with it, by 0.15 of all at most."""
    told = kernel.beyond_chance(line(rise=1.1, long_rise=1.1, absolute_rise=absolute_rise))
    assert told == pytest.approx(kernel.beyond_chance(line(rise=risen, long_rise=risen, absolute_rise=risen)))


def test_news_counts_in_full():
    """What no frame has said before is no repetition: it counts as much as that much growth without the discount."""
    chain = Chain()
    told = kernel.follow(PRIOR, Likeness(2.0, 1.0, 0.5), 3.0, chain, False)
    assert told == pytest.approx(follow(PRIOR, Likeness(2.0 + 3.0 / chain.evidence, 1.0, 0.5)))


def test_what_has_chattered_is_saturated_when_calm():
    """What has chattered before and is calm again was not steady from the start: it is saturated."""
    kinds = CALMED
    for _ in range(FRAMES_PER_S):
        kinds = kernel.follow(kinds, STEADY, 0.0, Chain(), True)
    assert kinds.saturated > 0.9
