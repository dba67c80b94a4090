"""The margin in the verdict's steady stable cuts: what is compared, and how it is summed up."""

import math

import numpy as np
import pytest

from benchmarks.verdict.cut import INTERVAL_SAMPLES
from benchmarks.verdict.generator import cut
from benchmarks.verdict.margin import Told, in_passes, summary, told_of


def told(ratio, true_ratio, half=0.1, damping=0.01):
    return Told("a cut", ratio, ratio - half, ratio + half, damping, true_ratio, 0.012)


def test_errors_are_of_the_ratio_and_signed():
    """Less is told than is true: there is less room than was told."""
    assert told(0.4, 0.5).error == pytest.approx(-0.2)
    text = summary([told(0.4, 0.5), told(0.5, 0.5), told(0.9, 0.5), told(0.5, 0.5, damping=0.02)])
    assert "median 10.0 %" in text
    assert "within 15 % in 50 %, too good by more in 25 %, too bad in 25 %" in text
    assert "interval holds in 75 %, the rightmost damping is within 0.005 in 75 %" in text
    assert "0.90 (0.80 to 1.00), true 0.50" in text.splitlines()[4]


def test_a_cut_is_heard_through_the_whole_channel():
    """Development cut 434, at half of its limit: told within its interval."""
    heard = told_of(cut("development", 434))
    assert heard is not None
    assert heard.low < heard.true_ratio < heard.high
    assert abs(heard.error) < 0.15
    assert math.isfinite(heard.damping)


def test_in_passes_a_second_before_the_tool_leaves_is_compared():
    """Each of 6 s, with 2 s of air after it in which the room is heard, 34 dB below the cut."""
    made = cut("development", 434)
    samples, compared = in_passes(made)
    rms = np.sqrt((samples.reshape(-1, INTERVAL_SAMPLES) ** 2).mean(axis=1)) / np.std(made.samples)
    assert rms.size == compared.size == 160 * (made.samples.size // (120 * INTERVAL_SAMPLES))
    for first in range(0, rms.size, 160):
        assert set(np.flatnonzero(compared[first : first + 160])) == set(range(98, 118))
        assert rms[first + 2 : first + 118].min() > 0.3
        assert rms[first + 120 : first + 160] == pytest.approx(0.02, rel=0.2)
