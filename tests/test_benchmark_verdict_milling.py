"""The milling simulator of the benchmark: its limit is one, and what it records is what a mill does."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verdict import milling
from benchmarks.verdict.cut import INTERVAL_S, RATE_HZ
from benchmarks.verdict.monitor import watch
from chatter_monitor.physics.lobes import stability_limit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.terms import CATALOGUE

SEEDS = (2, 3, 5)


@pytest.mark.parametrize("waves", [2.75, 3.0, 3.3])
@pytest.mark.parametrize("direction", [0, 1])
def test_the_limit_of_a_slot_is_the_closed_form(waves, direction):
    """Four teeth, one mode: a = 4 k kappa / (N K_t K_r), for all of a slot's directional factors but -pi K_r vanish.

    Altintas and Budak 1995, with kappa from the chart of one mode; deflection makes the chip thinner, so that the best
    speed is where whole waves fit between two teeth, and the worst is where a quarter less does.
    """
    mode, teeth, stiffness, rigid = Mode(600.0, 0.03), 4, 1e7, 1e12
    modes = np.full((2, 2), rigid)
    modes[direction, 0] = stiffness
    mill = replace(
        milling.draw(305),
        teeth=teeth,
        rotation_hz=mode.frequency_hz / (teeth * waves),
        begins=0.0,
        ends=math.pi,
        omega=np.full((2, 2), mode.omega),
        zeta=np.full((2, 2), mode.damping_ratio),
        stiffness=modes,
        run_out=np.zeros(teeth),
        direction=direction,
    )
    term = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": 0.01})
    system = MachiningSystem((mode,), (term,), spindle=Spindle(60.0 * mill.rotation_hz, teeth))
    kappa = stability_limit(system, np.array([60.0 * mill.rotation_hz]))[0]
    closed = 4.0 * stiffness * kappa / (teeth * mill.pressure * mill.radial)
    assert milling.limit(mill) == pytest.approx(closed, rel=0.05)


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
    samples, chatters = milling.simulate(mill)
    stable, deep = (samples[int(at_s * RATE_HZ) :][: int(2 * RATE_HZ)] for at_s in (3.0, 8.0))
    assert off_orders(stable, mill.rotation_hz) < 0.3
    assert off_orders(deep, mill.rotation_hz) > 0.4
    assert deep.std() > 3.0 * stable.std() > 9.0 * samples[: int(0.9 * RATE_HZ)].std()
    assert np.array_equal(samples, milling.simulate(mill)[0])
    at = round(milling.DEEPER / INTERVAL_S)
    assert not chatters[round(2.0 / INTERVAL_S) : at - 1].any()
    assert chatters[at + 4 : round(milling.SHALLOW / INTERVAL_S)].mean() > 0.95


def test_what_loses_contact_but_repeats_does_not_chatter():
    """Beyond the limit of a cut whose teeth all stay in the chip, by half: these leave it, and nothing grows."""
    mill = milling.draw(1444)
    samples, chatters = milling.simulate(mill)
    deep = samples[int(8 * RATE_HZ) : int(10 * RATE_HZ)]
    assert mill.chatters
    assert mill.over > 1.5
    assert off_orders(deep, mill.rotation_hz) < 0.15
    assert not chatters[round((milling.DEEPER + 0.5) / INTERVAL_S) : round(milling.SHALLOW / INTERVAL_S) - 1].any()


def test_a_cut_in_which_only_noise_moves_does_not_chatter():
    """Four teeth in a full slot make no force that changes: its twin does not repeat either."""
    mill = milling.draw(1583)
    assert not mill.chatters
    assert milling.simulate(mill)[1].mean() < 0.02


def test_a_score_counts_what_is_due():
    """Chatter from its own onset on, wherever the cut gets deeper; alarms before it are false within the limit only."""
    mill = replace(milling.draw(2), under=0.5, over=1.5, chatters=True, ramp=True)  # beyond it from 7.25 s on, in 145
    chatters, alarm = np.zeros((2, 278), bool)
    chatters[140:215] = True
    alarm[130], alarm[150:212], alarm[211:250] = True, True, True
    score = milling.Score()
    score.add(alarm, chatters, mill)
    assert (score.chatter, score.told) == (67, 60)
    assert (score.stable, score.false, score.beyond, score.early) == (2, 1, 0, 0)
    assert score.lags_s == pytest.approx([0.55])
    chatters[140:155] = False
    alarm[130], alarm[146] = False, True
    score = milling.Score()
    score.add(alarm, chatters, mill)
    assert (score.chatter, score.stable, score.false, score.beyond, score.early) == (52, 2, 0, 1, 1)
    score.add(np.zeros(278, bool), np.zeros(278, bool), mill)
    assert (score.chatter, score.stable, score.beyond, score.early, len(score.lags_s)) == (52, 4, 2, 1, 1)


def test_chatter_from_the_first_contact_is_told_without_a_speed():
    """By its sidebands, two seconds after the first contact, to the end: no comb that is found in them hides it."""
    mill = milling.draw(502)
    mill = replace(mill, under=mill.over)
    passages = milling.passages(mill, milling.simulate(mill)[0])
    states = [state for remarks in watch(passages, announce=False) for state in remarks.states]
    contact, end = (round(at_s / 0.05) for at_s in (milling.ENTERS, milling.LEAVES))
    assert states.index("self_excited", contact) < contact + 45
    assert states[contact + 45 : end].count("self_excited") > 0.98 * (end - contact - 45)
    assert "self_excited" not in states[:contact] + states[end + 6 :]
