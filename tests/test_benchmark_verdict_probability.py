"""How the constants of the probability of chatter are fitted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import expit

from benchmarks.verdict.generator import cut
from benchmarks.verdict.probability import examples, fit


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
    chatter = sum(chatters for _, (_, chatters) in seen)
    assert chatter == pytest.approx((made.truth.start_s > since).sum(), abs=2)
    alarms = [example for grounds, example in seen if grounds == "alarm"]
    calm = [x for grounds, (x, chatters) in seen if grounds == "calm" and not chatters]
    assert np.mean([chatters for _, chatters in alarms]) > 0.9
    assert np.median([louder for (_, louder, _), _ in alarms]) > 0.5 + np.median([louder for _, louder, _ in calm])
