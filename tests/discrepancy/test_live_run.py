"""Forces that rest beside a running signal while nothing shows, and wake."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.live import joined, linear
from chatter_monitor.discrepancy.live.decimate import Decimator
from chatter_monitor.discrepancy.live.history import History
from chatter_monitor.discrepancy.live.refit import refit
from chatter_monitor.discrepancy.live.run import Run
from chatter_monitor.discrepancy.live.watch import Watch
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE

RATE_HZ = 12800.0
FRAME = 640
BEGINS_S = 50.0
MODE = Mode(300.0, 0.02)
BEFORE = linear(2400.0, 0.0, MODE)


@pytest.fixture(scope="module")
def machine():
    """A machine that gets a spring of even force after 50 s, which changes neither its frequency nor its damping."""
    first = simulate(BEFORE, BEGINS_S, 4, settle_s=1.0).signal
    even = AppliedTerm(CATALOGUE["quadratic_stiffness"], {"coefficient": 0.04 / float(np.std(first))})
    second = simulate(replace(BEFORE, terms=(even,)), 15.0, 5, settle_s=1.0).signal
    return joined(first, second, MODE.frequency_hz)


@pytest.fixture(scope="module")
def fitted(machine):
    """The signal in the band of the modes, and the base of its first ten seconds."""
    decimator = Decimator(RATE_HZ, MODE.frequency_hz)
    blocks = decimator.take(machine[: int(30.0 * RATE_HZ)])
    history = History(len(blocks) * decimator.block, decimator.rate_hz)
    for samples, missing in blocks:
        history.append(samples, missing)
    work = refit(history.between(0, round(10.0 * decimator.rate_hz)), Linear.of(BEFORE, None), ())
    return history, next(each for each in work if each is not None), decimator.block


def gone_through(fitted, rests):
    """Twenty blocks, the tenth and those after it with scouts alone if forces may rest."""
    history, base, block = fitted
    run = Run(base, 4 * block, block, history.between(0, 1).rate_hz)
    while len(run.blocks) < 20:
        run.may_rest = rests and len(run.blocks) >= 9
        run.advance(history)
    return run


def test_forces_rest_and_wake(machine):
    """Beside a base that is settled few blocks have all forces in them; one that sets in is named as soon as ever."""
    watch = Watch(BEFORE, RATE_HZ)
    told = []
    for at in range(0, machine.size, FRAME):
        found = watch.take(machine[at : at + FRAME])
        if found is not None:
            told.append(((at + FRAME) / RATE_HZ, found))
        if at == int(BEGINS_S * RATE_HZ) - FRAME:
            blocks = watch._epoch.run.blocks
            assert sum(blocks.whole(size) for size in (1, 2, 4, 8, 16)) < 3
    assert {found.outcome for t, found in told if t < BEGINS_S} == {"none"}
    assert min(t for t, found in told if found.effect == "quadratic_stiffness") < BEGINS_S + 2.0


def test_what_is_gone_through_again_is_as_if_forces_had_never_rested(fitted):
    """Blocks that had scouts alone say after a second look what they say where all forces were tried at once."""
    history, _, _ = fitted
    always, rested = gone_through(fitted, rests=False), gone_through(fitted, rests=True)
    assert not rested.blocks.whole(1)
    [few], [all_forces] = rested.blocks.most_of_scouts([8]), always.blocks.newest([8])
    assert few == pytest.approx(all_forces.gains[: rested._scouts].max(), rel=0.1, abs=0.3)
    rested._stir([8])
    assert rested.look_again(history, 1000)
    assert rested.blocks.whole(8)
    assert not rested.blocks.whole(12)
    [again] = rested.blocks.newest([8])
    np.testing.assert_allclose(again.gains, all_forces.gains, rtol=1e-2, atol=1e-2)


def test_a_block_begins_when_the_observer_has_settled(fitted):
    """An observer that begins from nothing has errors like any other in its first block."""
    history, base, block = fitted
    run = Run(base, 10 * block, block, history.between(0, 1).rate_hz)
    while not len(run.blocks):
        run.advance(history)
    assert run.blocks.firsts == [10 * block]
    late = Run(base, 2 * block, block, history.between(0, 1).rate_hz)
    while len(late.blocks) < 9:
        late.advance(history)
    [first], [same] = run.blocks.newest([1]), late.blocks.newest([1])
    np.testing.assert_allclose(first.gains, same.gains, rtol=1e-2, atol=1e-2)
