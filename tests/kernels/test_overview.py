"""What all vibrations come to, against what is defined plainly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.kinds import LINE, NOISE_VARIATION
from chatter_monitor.kernels.overview import NONE, SUSPECT_SHARE, Overview, forced_at, overview
from chatter_monitor.kernels.vibration import NO_LINE, VIBRATION


def some(seed, count):
    """Vibrations and lines, some of the vibrations without one."""
    rng = np.random.default_rng(seed)
    vibrations, lines = np.zeros(count, VIBRATION), np.zeros(count, LINE)
    kinds = rng.dirichlet(np.ones(4), count)
    for i, name in enumerate(("noise", "growing", "saturated", "steady")):
        vibrations[name] = kinds[:, i]
    vibrations["frequency_hz"] = 100.0 * 1.2 ** rng.permutation(count)
    vibrations["unexplained"] = rng.random(count)
    vibrations["chattered"] = rng.random(count) < 0.4
    vibrations["alarm_for"] = np.where(vibrations["chattered"], rng.integers(0, 3, count), 0)
    vibrations["dominance"] = rng.uniform(0.0, 1.0, count)
    vibrations["line"] = np.where(rng.random(count) < 0.3, NO_LINE, rng.permutation(count))
    lines["share"], lines["variation"] = rng.uniform(0.0, 0.3, count), rng.uniform(0.0, 1.0, count)
    return vibrations, lines


def first(values):
    """Number of the first of the largest, if that is more than nothing."""
    return int(np.argmax(values)) if len(values) and np.max(values) > 0 else NONE


@pytest.mark.parametrize("count", [0, 1, 3, 12])
@pytest.mark.parametrize("seed", range(8))
def test_overview_is_what_it_says(seed, count):
    """The alarm is the oldest, the suspect the first with enough power; steady neither varies nor has chattered."""
    vibrations, lines = some(seed, count)
    heard = vibrations["line"] != NO_LINE
    strong = heard & (vibrations["dominance"] >= SUSPECT_SHARE)
    own = lines[vibrations["line"]]
    steady = np.maximum(own["share"] * (1.0 - (own["variation"] / NOISE_VARIATION) ** 2), 0.0)
    steady[~heard | vibrations["chattered"]] = 0.0
    seen = Overview(*overview(vibrations, lines))
    suspicion = (vibrations["growing"] + vibrations["saturated"]) * vibrations["unexplained"]
    assert seen.suspicion == pytest.approx(max(suspicion, default=0.0))
    assert seen.heard_suspicion == pytest.approx(next(iter(suspicion[strong]), 0.0))
    assert seen.alarm == first(vibrations["alarm_for"])
    assert seen.suspect == first(strong)
    assert seen.steadiest == first(steady)
    assert seen.steady_share == pytest.approx(steady.sum())
    assert seen.chattered_share == pytest.approx(own["share"][heard & vibrations["chattered"]].sum())


@pytest.mark.parametrize("seed", range(3))
def test_forced_is_what_was_steady_or_is_explained(seed):
    """A frequency is that of a forced vibration when one near it is rather forced than not."""
    vibrations = some(seed, 12)[0]
    explained = (vibrations["growing"] + vibrations["saturated"]) * (1.0 - vibrations["unexplained"])
    forced = vibrations["steady"] + explained > 0.5
    found = [forced_at(vibrations, hertz * math.exp(0.005), 0.01) for hertz in vibrations["frequency_hz"]]
    assert found == forced.tolist()
    assert not forced_at(vibrations, 9000.0, 0.01)
