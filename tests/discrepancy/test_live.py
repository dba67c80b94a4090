"""A running signal beside a simulation: what is said about it, and when."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.live import joined, linear
from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.live.decimate import Decimator
from chatter_monitor.discrepancy.live.found import Found
from chatter_monitor.discrepancy.live.refit import refit
from chatter_monitor.discrepancy.live.watch import Watch
from chatter_monitor.discrepancy.live.windows import FINE_BANDS
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.kernels.live_signatures import FEW
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE
from tests.discrepancy.machine import Machine, coefficient, record

RATE_HZ = 12800.0
FRAME = 640
BEGINS_S = 12.0
MODEL = MachiningSystem(modes=(Mode(400.0, 0.02),), sensor=Sensor("displacement"))


@cache
def recorded(effect: str) -> np.ndarray:
    """A machine to which something happens after 12 s of 24 s."""
    return record(Machine(effect=effect, seconds=24.0, between_s=(BEGINS_S, 24.0)), 7)


def lowered(decimator: Decimator, parts: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """A signal that comes in parts, at the lower rate, and what of it is missing."""
    blocks = [block for part in parts for block in decimator.take(part)]
    return np.concatenate([b[0] for b in blocks]), np.concatenate([b[1] for b in blocks])


def said(samples: np.ndarray, model: MachiningSystem = MODEL) -> list[tuple[float, Found]]:
    """What is said, and when, about a recording that comes in intervals."""
    watch = Watch(model, RATE_HZ)
    answers = []
    for at in range(0, samples.size, FRAME):
        found = watch.take(samples[at : at + FRAME])
        if found is not None:
            answers.append(((at + FRAME) / RATE_HZ, found))
    return answers


@pytest.mark.parametrize("up_to", [120.0, 700.0, 5000.0])
def test_pieces_are_decimated_as_the_whole(up_to):
    """Resampling in pieces of any length gives what one piece gives, and a sine stays where it was in time."""
    rng = np.random.default_rng(1)
    n = 20000
    sine = np.sin(2.0 * np.pi * 0.5 * up_to / RATE_HZ * np.arange(n))
    whole = Decimator(RATE_HZ, up_to)
    expected, missing = lowered(whole, [sine])
    cuts = np.sort(rng.integers(0, n, 40))
    in_pieces, missing_too = lowered(Decimator(RATE_HZ, up_to), np.split(sine, cuts))
    np.testing.assert_array_equal(in_pieces, expected)
    np.testing.assert_array_equal(missing_too, missing)
    t = np.arange(expected.size) / whole.rate_hz
    np.testing.assert_allclose(expected[~missing], np.sin(np.pi * up_to * t)[~missing], atol=2e-3)


@pytest.mark.parametrize("up_to", [3.0, 40.0, 120.0, 5000.0])
def test_a_block_has_ordinates_for_every_band(up_to):
    """However slow a machine is, the spectrum of a block fills the bands in which a second mode would show."""
    decimator = Decimator(RATE_HZ, up_to)
    assert decimator.block % FEW == 0
    assert decimator.block // 2 >= 2 * FINE_BANDS
    assert decimator.block / decimator.rate_hz == pytest.approx(0.5, rel=0.1) or decimator.block == 512


def test_missing_samples_are_missing_after_decimation():
    """Whatever a lost sample would have been in is marked, and nothing else."""
    samples = np.ones(8000)
    samples[4000] = np.nan
    decimator = Decimator(RATE_HZ, 400.0)
    made, missing = lowered(decimator, [samples])
    centre = 4000 * float(decimator.ratio)
    away = abs(np.arange(missing.size) - centre)
    assert missing[away < 15].all()
    assert not missing[(away > 19) & (np.arange(missing.size) > 20)].any()
    assert np.isfinite(made).all()


def test_a_machine_like_its_simulation_is_no_mismatch():
    """Nothing is said about a signal that the simulation explains, but that it does."""
    answers = said(recorded("none"))
    assert answers
    assert {found.outcome for _, found in answers} == {"none"}


@pytest.mark.parametrize(
    ("effect", "name"),
    [("hardening", "cubic_stiffness"), ("coulomb", "coulomb_friction"), ("clearance", "clearance")],
)
def test_what_begins_while_it_runs_is_named(effect, name):
    """Nothing is said before an effect begins; then it is named, from when it began, and stays named to the end."""
    answers = said(recorded(effect))
    assert {found.outcome for t, found in answers if t < BEGINS_S} == {"none"}
    _, last = answers[-1]
    assert (last.outcome, last.effect) == ("missing_physics", name)
    rate_hz = Decimator(RATE_HZ, 400.0).rate_hz
    assert abs(last.since / rate_hz - BEGINS_S) < 2.5


def test_another_gain_is_no_mechanics():
    """A sensor that shows three times as much from some moment on, or nothing for a second, is no mismatch."""
    samples = recorded("none").copy()
    samples[int(14.0 * RATE_HZ) :] *= 3.0
    samples[int(8.0 * RATE_HZ) : int(9.0 * RATE_HZ)] = np.nan
    answers = said(samples)
    assert {found.outcome for _, found in answers} == {"none"}
    assert any(t > 20.0 for t, _ in answers)


def test_a_weak_second_mode_is_told():
    """A mode of participation 0.24 that is there from some moment on is told within six seconds, where it is."""
    one, other = Mode(300.0, 0.03), Mode(470.0, 0.03, 0.24)
    before, after = linear(2400.0, 0.0, one), linear(2400.0, 0.0, one, other)
    runs = [simulate(system, seconds, 5, settle_s=1.0).signal for system, seconds in ((before, 12.0), (after, 14.0))]
    answers = said(joined(*runs, 300.0), before)
    assert {found.outcome for t, found in answers if t < 12.0} == {"none"}
    told = [(t, found) for t, found in answers if found.outcome != "none"]
    assert told[0][0] < 18.0
    assert {found.effect for _, found in told} == {"second_mode"}
    assert told[-1][1].parameters["frequency_hz"] == pytest.approx(470.0, rel=0.02)


def test_a_machine_is_watched_while_its_base_is_fitted_anew():
    """What begins just when a new base is due is told as soon as at any other time."""
    after_s = []
    for begins_s in (11.6, 12.4):
        samples = record(Machine(effect="hardening", seconds=16.0, between_s=(begins_s, 16.0)), 7)
        after_s.append(next(t for t, found in said(samples) if found.effect == "cubic_stiffness") - begins_s)
    assert max(after_s) < 2.0


def test_wrong_parameters_are_parameters():
    """A mode that is not where the model has it is found there, and no physics is named for it."""
    model = MachiningSystem(modes=(Mode(408.0, 0.03),), sensor=Sensor("displacement"))
    _, last = said(recorded("none"), model)[-1]
    assert last.outcome == "parameters"
    assert last.parameters["mode.1.frequency_hz"] == pytest.approx(400.0, rel=2e-3)
    assert last.parameters["mode.1.damping_ratio"] == pytest.approx(0.02, rel=0.15)


def test_a_sensor_of_the_acceleration_does_not_feel_a_constant_force():
    """What a constant force would do to the errors is over soon; nothing is said of a machine like its simulation."""
    model = MachiningSystem(modes=(Mode(400.0, 0.02),), sensor=Sensor("acceleration"))
    answers = said(record(Machine(effect="none", seconds=24.0, quantity="acceleration"), 7), model)
    assert {found.outcome for _, found in answers} == {"none"}
    assert answers[-1][0] > 23.0


def test_a_cut_at_another_speed_is_told():
    """A cut that regenerates goes on 4 % faster than configured: said to be at that speed within four seconds."""
    before, after = (linear(speed_rpm, 0.05, Mode(470.0, 0.035)) for speed_rpm in (2364.0, 2459.0))
    runs = [simulate(system, seconds, 3, settle_s=1.0).signal for system, seconds in ((before, 9.0), (after, 9.0))]
    answers = said(joined(*runs, 470.0), before)
    assert {found.outcome for t, found in answers if t < 9.0} == {"none"}
    told = [(t, found) for t, found in answers if found.effect == "regenerative_delay"]
    assert told[0][0] < 13.0
    assert {found.outcome for _, found in told} == {"parameters"}
    assert told[-1][1].parameters["spindle.speed_rpm"] == pytest.approx(2459.0, rel=5e-3)


def test_a_narrow_peak_is_not_smeared():
    """Regeneration near its limit narrows a peak; that does not read as another damping."""
    mode = Mode(506.0, 0.0107)
    delay = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": 0.0177})
    system = MachiningSystem((mode,), (delay,), spindle=Spindle(1558.0), sensor=Sensor("displacement", noise_rms=0.02))
    decimator = Decimator(RATE_HZ, mode.frequency_hz)
    samples, missing = lowered(decimator, [simulate(system, 12.0, 2, settle_s=1.0).signal])
    given = Linear(system.modes, "displacement", 1e-3, 20.0, system.spindle, None, system.spindle.delay_s, 0.0177)
    result = next(each for each in refit(Recorded(samples, missing, decimator.rate_hz), given, ()) if each is not None)
    assert result.retuned_p > 1e-3
    assert result.linear.modes[0].damping_ratio == pytest.approx(0.0107, rel=0.1)


@pytest.mark.parametrize("effect", ["hardening", "clearance"])
def test_a_force_that_the_model_has_is_no_mismatch(effect):
    """The very model of the machine, its spring included, is told from the running signal by nothing."""
    machine = Machine(effect, 0.08, seconds=24.0)
    known = {"hardening": ("cubic_stiffness", {}), "clearance": ("clearance", {"gap": 1.0})}
    name, shapes = known[effect]
    force = AppliedTerm(CATALOGUE[name], {"coefficient": coefficient(machine), **shapes})
    samples = record(machine, 155)
    told = said(samples, MachiningSystem(MODEL.modes, (force,), sensor=MODEL.sensor))
    assert {found.outcome for _, found in told} == {"none"}
    assert "missing_physics" in {found.outcome for _, found in said(samples)}  # without the spring there is one
