"""Plain scenes: chatter that is there as soon as the tool enters is told with a speed and without."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdict.entries import announced, chattering_pass, states
from chatter_monitor.tracking.tracker import INTERVAL_S

SEED = 110  # of a set that the rules were developed on


@pytest.mark.parametrize("known", [True, False])
def test_chatter_from_the_first_contact_on_is_told_after_two_calm_passes(known):
    """Within a second; and nothing before."""
    signal, jobs, begins_s = chattering_pass(SEED)
    alarms = np.array(states(signal, [(0.0, announced(jobs[0]))] if known else [])) == "self_excited"
    ends_s = INTERVAL_S * (1 + np.arange(alarms.size))
    assert not alarms[ends_s <= begins_s].any()
    assert alarms[ends_s > begins_s + 1.0].all()
