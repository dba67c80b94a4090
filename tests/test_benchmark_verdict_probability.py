"""How the constants of the probability of chatter are fitted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from benchmarks.verdict.generator import cut
from benchmarks.verdict.probability import Example, examples, fit, wrong_where_forced


def test_weights_that_made_the_examples_are_found():
    """Of 100,000 intervals each weight is known to some percent."""
    rng = np.random.default_rng(7)
    x = np.column_stack([rng.normal(-3.0, 2.0, 100_000), rng.uniform(0.0, 2.0, (2, 100_000)).T])
    chatters = rng.random(100_000) < expit(x @ [0.5, 2.0, 1.0] - 1.0)
    assert fit(x, chatters) == pytest.approx((0.5, 2.0, 1.0, -1.0), abs=0.06)


def test_examples_of_a_cut_that_suddenly_chatters():
    """It chatters from the crossing on; alarms are of chatter, and louder than what was calm before."""
    made = cut("development", 1)
    seen = list(examples(made, speed_known=True))
    since = made.truth.unstable[0].crossing_s
    chatter = sum(example.chatters for _, example in seen)
    assert chatter == pytest.approx((made.truth.start_s > since).sum(), abs=2)
    alarms = [example for grounds, example in seen if grounds == "alarm"]
    calm = [example for grounds, example in seen if grounds == "calm" and not example.chatters]
    assert np.mean([example.chatters for example in alarms]) > 0.9
    louder = [np.median([example.measures[1] for example in some]) for some in (alarms, calm)]
    assert louder[0] > louder[1] + 0.5


def test_how_many_warnings_are_wrong_where_it_seems_forced():
    """Of those that do not chatter; three in five of what is forced for certain, three in ten of what is by half."""
    calm = [Example((0.0, 0.0, 0.0), False, seems, n < 6 * seems) for seems in (1.0, 0.5) for n in range(10)]
    chatter = Example((0.0, 0.0, 0.0), True, 1.0, False)
    assert wrong_where_forced([*calm, chatter]) == pytest.approx(0.6)
