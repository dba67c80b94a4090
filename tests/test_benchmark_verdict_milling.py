"""The milling simulator of the benchmark: its limit is one, and what it records is what a mill does."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verdict import milling
from benchmarks.verdict.cut import RATE_HZ
from benchmarks.verdict.monitor import watch

SEEDS = (2, 3, 4)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_linear_cut_grows_beyond_its_limit_and_not_before(seed):
    """Over four times as long as the limit was looked for with."""
    mill = milling.draw(seed)
    depth = milling.limit(mill)
    turn = mill.steps * mill.teeth
    count = 4 * turn * max(12, int(0.35 / (turn * mill.step_s)))

    def growth(share):
        moved = milling._run(mill, np.full(count, share * depth), np.zeros((count, 3)), linear=True)
        size = np.abs(moved[:, :, 0]).max(axis=1)
        return size[-count // 8 :].max() / size[count // 8 : count // 4].max()

    assert growth(0.9) < 0.7
    assert growth(1.1) > 1.4


def off_orders(samples, rotation_hz):
    """Share of the power that is in no multiple of the rotation."""
    power = np.abs(np.fft.rfft(samples * np.hanning(len(samples)))) ** 2
    order = np.fft.rfftfreq(len(samples), 1.0 / RATE_HZ) / rotation_hz
    away_hz = np.abs(order - np.round(order)) * rotation_hz
    return power[(away_hz > 3.0) & (order > 0.5)].sum() / power[order > 0.5].sum()


@pytest.mark.parametrize("seed", SEEDS)
def test_chatter_leaves_the_orders(seed):
    """A stable cut is in the multiples of its rotation, deep beyond the limit it is not; before, there is the room."""
    mill = replace(milling.draw(seed), chatters=True, ramp=False, over=1.8, wander=0.0, derivative=1, unsteady=0.03)
    samples = milling.simulate(mill)
    stable, deep = (samples[int(at_s * RATE_HZ) :][: int(2 * RATE_HZ)] for at_s in (3.0, 8.0))
    assert off_orders(stable, mill.rotation_hz) < 0.3
    assert off_orders(deep, mill.rotation_hz) > 0.4
    assert deep.std() > 3.0 * stable.std() > 9.0 * samples[: int(0.9 * RATE_HZ)].std()
    assert np.array_equal(samples, milling.simulate(mill))


@pytest.mark.parametrize(("under", "cut"), [(0.5, ["stable", "chatters", "calms"]), (1.5, 3 * ["chatters"])])
def test_what_is_deep_from_the_first_contact_on_chatters_all_along(under, cut):
    """It is scored so, and no stable or calming stretch is made of it."""
    mill = replace(milling.draw(2), chatters=True, under=under)
    samples = np.zeros(round(milling.ENDS * RATE_HZ))
    assert [passage.doing for passage in milling.passages(mill, samples)] == ["idle", *cut, "idle"]


def test_chatter_from_the_first_contact_is_told_without_a_speed():
    """By its sidebands, two seconds after the first contact, to the end: no comb that is found in them hides it."""
    mill = milling.draw(519)
    mill = replace(mill, under=mill.over)
    states = [
        state
        for remarks in watch(milling.passages(mill, milling.simulate(mill)), announce=False)
        for state in remarks.states
    ]
    contact, end = (round(at_s / 0.05) for at_s in (milling.ENTERS, milling.LEAVES))
    assert states.index("self_excited", contact) < contact + 45
    assert states[contact + 45 : end].count("self_excited") > 0.98 * (end - contact - 45)
    assert "self_excited" not in states[:contact] + states[end + 6 :]
