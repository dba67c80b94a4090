"""The blind generator of the proof against theory that it does not use."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from scipy import signal

from chatter_monitor.discrepancy.prove.blind import laws
from chatter_monitor.discrepancy.prove.blind.case import deal, make_case
from chatter_monitor.discrepancy.prove.blind.chain import QUANTITIES, RATE_HZ, gain_at, measure
from chatter_monitor.discrepancy.prove.blind.concealment import concealment
from chatter_monitor.discrepancy.prove.blind.effects import COUNTS, DECK
from chatter_monitor.discrepancy.prove.blind.machine import Escaped, Machine, move, with_strength
from chatter_monitor.discrepancy.prove.blind.motion import FINITE, Hidden, coarser, march, noise_factor, transition
from chatter_monitor.discrepancy.prove.blind.nearest import beyond_nearest
from chatter_monitor.physics.model_file import read_model

W, ZETA = 2 * np.pi * 400.0, 0.02


def hidden(law=laws.NONE, *p, w=W, **where):
    return Hidden(law, np.array([*p], dtype=float), w, **where)


def run(force, zeta, step_s, increments):
    """Displacement, velocity and hidden force from rest."""
    x, v, f = (np.zeros(increments.shape[0]) for _ in range(3))
    assert march(force, zeta, step_s, increments, np.zeros(0), 0.0, x, v, f) == FINITE
    return x, v, f


def struck(force, seconds, step_s, velocity, zeta=0.0):
    """Free motion after a blow."""
    increments = np.zeros((round(seconds / step_s), 2))
    increments[0, 1] = velocity
    return run(force, zeta, step_s, increments)


@pytest.mark.parametrize(("frequency_hz", "damping_ratio"), [(150.0, 0.04), (412.0, 0.02), (1400.0, 0.008)])
def test_energy_of_the_linear_motion(frequency_hz, damping_ratio):
    """Kinetic and potential energy of the linear motion are those of theory, pi S0 / (4 zeta w) each."""
    machine = Machine(frequency_hz, damping_ratio)
    motion = move(machine, hidden(w=machine.w), 20.0, [1], 8)
    sd = 1.0 / math.sqrt(damping_ratio * machine.w * 20.0)  # of the variance of a narrow-band process
    assert motion.rms_x**2 == pytest.approx(1.0, abs=4 * sd)
    assert (motion.rms_v / machine.w) ** 2 == pytest.approx(1.0, abs=4 * sd)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_spectrum_of_the_chain(quantity):
    """The spectrum of a linear recording is that of theory up to the edge of the band, for every sensor."""
    machine = Machine(412.0, 0.02)
    motion = move(machine, hidden(w=machine.w), 20.0, [2], 8)
    f, got = signal.welch(measure(motion.x, motion.v, quantity, 8), RATE_HZ, nperseg=RATE_HZ)

    def density(f):
        omega = 2 * np.pi * f
        receptance2 = 1.0 / ((machine.w**2 - omega**2) ** 2 + (2 * 0.02 * machine.w * omega) ** 2)
        return 2.0 * machine.intensity * receptance2 * gain_at(f, quantity)

    expected = density(f) + density(RATE_HZ - f)
    for low, high in [(100, 1000), (1000, 3000), (3000, 5000), (5000, 6000), (6000, 6400)]:
        inside = (f >= low) & (f < high)
        assert np.mean(got[inside] / expected[inside]) == pytest.approx(1.0, abs=0.03)


def test_free_decay():
    """Without force and noise a blow rings down with the damped frequency and the decrement of its damping ratio."""
    x, _, _ = struck(hidden(), 0.1, 1 / 102400, 1.0, zeta=ZETA)
    t = np.arange(x.size - 1) / 102400
    wd = W * math.sqrt(1 - ZETA**2)
    np.testing.assert_allclose(x[1:], np.exp(-ZETA * W * t) * np.sin(wd * t) / wd, atol=1e-9 / W)


def test_coulomb_decrement():
    """Dry friction alone takes 4 mu / w^2 from the amplitude in every cycle, and holds the mass still at the end."""
    mu = 0.01 * W**2
    x, v, _ = struck(hidden(laws.DRY, mu), 0.1, 1 / 204800, W)
    tops = x[signal.argrelmax(x)[0]]
    tops = tops[tops > 0.05]
    np.testing.assert_allclose(np.diff(tops), -0.04, rtol=0.02)
    assert np.abs(v[-1000:]).max() < 1e-4 * W
    assert abs(x[-1]) <= 0.01


def test_duffing_frequency():
    """A cubic spring raises the frequency by 3/8 of its share at the amplitude (Lindstedt's first order)."""
    x, _, _ = struck(hidden(laws.CUBE, 0.02), 0.5, 1 / 204800, W)
    amplitude = x.max()
    rising = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    frequency = (rising.size - 1) / ((rising[-1] - rising[0]) / 204800)
    assert frequency / 400.0 == pytest.approx(1 + 3 / 8 * 0.02 * amplitude**2, abs=2e-4)


def test_bouc_wen_saturates_and_dissipates():
    """A slipping joint never exceeds its yield force, and the loop takes energy out of the motion."""
    x, v, f = struck(hidden(laws.MICROSLIP, 0.1, 0.2), 0.5, 1 / 204800, W)
    assert np.abs(f).max() == pytest.approx(0.1 * 0.2 * W**2, rel=0.02)
    energy = 0.5 * (v**2 + (W * x) ** 2)
    assert energy[-2000:].max() < 0.1 * energy[:2000].max()


def test_delayed_force_remembers():
    """The delayed force is the stiffness times the displacement less that of one delay ago."""
    rng = np.random.default_rng(3)
    step_s, delay = 1 / 102400, 1024
    increments = rng.standard_normal((40_000, 2)) @ noise_factor([(W, ZETA)], step_s).T
    x, _, f = run(hidden(laws.DELAY, 0.01, delay * step_s), ZETA, step_s, increments)
    np.testing.assert_allclose(f[delay + 2 :], 0.01 * W**2 * (x[delay + 2 :] - x[2:-delay]), atol=1e-9 * W**2)


@pytest.mark.parametrize(
    ("force", "ratio"),
    [
        (hidden(laws.CUBE, 0.05), 3.0),
        (hidden(laws.GAP, 0.3, 0.8), 3.0),
        (hidden(laws.MICROSLIP, 0.1, 0.8), 1.6),
        (hidden(laws.DRAG, 0.05), 1.6),
        (hidden(laws.DRY, 0.05 * W**2), 1.4),
        (hidden(laws.STRIBECK, 0.04 * W**2, 1.0, 0.4 * W), 1.4),
    ],
    ids=["cubic", "clearance", "bouc-wen", "v|v|", "coulomb", "stribeck"],
)
def test_halving_the_step(force, ratio):
    """On one path of the noise the error falls with the step and is below 0.5 % of the motion at the steps used."""
    # Second order for what depends on the displacement, first for what depends on the velocity, less for what jumps.
    rng = np.random.default_rng(2)
    finest = 64
    step_s = 1 / (RATE_HZ * finest)
    factor = noise_factor([(W, ZETA)], step_s) * math.sqrt(4 * ZETA * W**3)
    increments = rng.standard_normal((finest * RATE_HZ // 2, 2)) @ factor.T
    motion = {}
    for oversampling in (64, 32, 16, 8):
        x, _, _ = run(force, ZETA, 1 / (RATE_HZ * oversampling), increments)
        motion[oversampling] = x[::oversampling]
        increments = coarser(increments, transition(W, ZETA, 1 / (RATE_HZ * oversampling)))
    errors = [float(np.std(motion[o] - motion[2 * o])) for o in (8, 16, 32)]
    assert errors[0] / errors[2] > ratio**2
    assert errors[0] < 0.005 * motion[64].std()


@pytest.mark.parametrize(
    ("law", "amplitude_at_one"),
    # Of Gaussian motion of variance 1, what is left of x^3 after regression on x has rms sqrt(6), of x^2 sqrt(2), of
    # sgn(v) sqrt(1 - 2 / pi).
    [(laws.CUBE, 1 / math.sqrt(6)), (laws.SQUARE, 1 / math.sqrt(2)), (laws.DRY, W**2 / math.sqrt(1 - 2 / math.pi))],
)
def test_strength(law, amplitude_at_one):
    """A weak force gets the amplitude that theory gives for its strength on Gaussian motion."""
    machine = Machine(400.0, 0.04)
    found = with_strength(machine, hidden(law, 0.0), "", 0.01, 1.0, 0.0, [4])
    motion = move(machine, found, 20.0, [5], 8)
    assert motion.strength == pytest.approx(0.01, rel=0.15)
    # Strength is relative to the motion as it is: x^3 / x scales with the variance, sgn(v) / x with its inverse root.
    scale = {laws.CUBE: motion.rms_x**-2, laws.SQUARE: 1 / motion.rms_x, laws.DRY: motion.rms_x}[law]
    assert found.p[0] == pytest.approx(motion.strength * amplitude_at_one * scale, rel=0.08)


def test_what_the_machine_does_not_bear():
    """A softening spring that the motion leaves for good is refused instead of recorded."""
    machine = Machine(400.0, 0.02)
    with pytest.raises(Escaped):
        move(machine, hidden(laws.CUBE, -0.1), 5.0, [6], 8)


def test_concealment_tells():
    """A linear recording passes for linear; a strong one-sided spring is seen in the spectrum."""
    machine = Machine(400.0, 0.02)
    seen = []
    for force in (hidden(), hidden(laws.SQUARE, 0.07)):
        motion = move(machine, force, 20.0, [7], 8)
        samples = measure(motion.x, motion.v, "velocity", 8)
        seen.append(concealment(samples, "velocity", 400.0, 0.02, 60.0, np.random.default_rng(8)))
    assert seen[0].concealed
    assert seen[1].spectrum_p < 0.05
    assert not seen[1].concealed
    impulsive = np.random.default_rng(9).standard_t(2.5, 20 * RATE_HZ)
    assert concealment(impulsive, "velocity", 400.0, 0.02, 60.0, np.random.default_rng(8)).normality_p < 1e-6


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_concealment_of_nothing():
    """Linear recordings look visible by their spectrum in about 5 % of cases and by their distribution in about 5 %."""
    machine = Machine(600.0, 0.02)
    rng = np.random.default_rng(10)
    seen = []
    for seed in range(60):
        motion = move(machine, hidden(w=machine.w), 8.0, [seed], 8)
        clean = measure(motion.x, motion.v, "velocity", 8)
        samples = clean + 0.03 * clean.std() * rng.standard_normal(clean.size)
        seen.append(concealment(samples, "velocity", 600.0, 0.02, 30.0, rng))
    assert sum(s.distance > s.band95 for s in seen) <= 8
    assert sum(s.normality_p < 0.05 for s in seen) <= 8
    assert 0.3 < np.mean([s.spectrum_p for s in seen]) < 0.7


def test_the_deck():
    """A hundred cases hold everything that can be hidden; the order is the draw's, the same for the same seed."""
    assert sum(COUNTS) == 100
    dealt = deal(250, 1)
    assert {effect.kind for effect in dealt[:100]} == {effect.kind for effect in DECK}
    assert dealt[:30] == deal(30, 1)
    assert dealt[:100] != deal(100, 2)


def effect_named(kind):
    return next(effect for effect in DECK if effect.kind == kind)


def test_a_case_is_reproducible():
    """The same seed and number give the same recording, model and truth, others give others."""
    one, again, other = (make_case(effect_named("cubic hardening"), 3, number) for number in (1, 1, 2))
    np.testing.assert_array_equal(one.samples, again.samples)
    assert (one.model, one.truth) == (again.model, again.truth)
    assert one.model != other.model


@pytest.mark.parametrize("kind", ["nothing", "regenerative delay", "clearance for 4 s", "clipping", "second_mode"])
def test_a_case(kind, tmp_path):
    """The base model of a case is one that the program reads, close to the machine, and without the effect."""
    case = make_case(effect_named(kind), 3, 1)
    path = tmp_path / "model.toml"
    path.write_text(case.model)
    base = read_model(path)
    assert not base.terms
    assert base.sensor.quantity == case.truth["quantity"]
    assert base.modes[0].frequency_hz == pytest.approx(case.truth["frequency_hz"], rel=0.006)
    assert case.samples.size == case.truth["seconds"] * RATE_HZ
    assert np.isfinite(case.samples).all()
    if kind == "regenerative delay":
        assert base.spindle.delay_s == pytest.approx(case.truth["amplitude"][1])
    if kind == "clearance for 4 s":
        ((begin, end),) = case.truth["time_s"]
        assert 2.0 <= begin < end == begin + 4.0 <= 18.0
    if kind == "clipping":
        assert 0.002 <= np.mean(np.abs(case.samples) >= np.abs(case.samples).max()) <= 0.035


def test_the_generator_stands_alone():
    """Making a case loads nothing of the program but the generator itself."""
    program = (
        "import sys\n"
        "import chatter_monitor.discrepancy.prove.blind.case\n"
        "ours = {name for name in sys.modules if name.startswith('chatter_monitor')}\n"
        "prefix = 'chatter_monitor.discrepancy.prove.blind'\n"
        "print(sorted(name for name in ours if not prefix.startswith(name) and not name.startswith(prefix)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=200, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("law", "force", "share"),
    [
        (laws.STRIBECK, lambda _x, v: np.sign(v) * (1.0 + 1.3 * np.exp(-((v / 0.35) ** 2))), 0.08),  # dry friction
        (laws.DRY, lambda _x, v: np.sign(v), 0.547),  # drag; not Stribeck friction, which it is
        (laws.GAP, lambda x, _v: x - np.clip(x, -1.0, 1.0), 0.21),  # a cubic spring
        (laws.ROOT, lambda _x, v: np.sign(v) * np.sqrt(np.abs(v)), 0.02),  # Stribeck or dry friction
        (laws.RECTIFIED, lambda _x, v: np.maximum(v, 0.0), 0.125),  # a cutting force
        (laws.INERTIA, lambda x, v: x * v * v, 1.0),  # none
    ],
)
def test_how_much_of_a_force_is_beyond_the_nearest_other_law(law, force, share):
    """Over a Gaussian motion, in any unit."""
    x, v = np.random.default_rng(4).standard_normal((2, 400_000))
    found = beyond_nearest(hidden(law, 1.0), 3.0 * x, 50.0 * v, 7.0 * force(x, v))
    assert found == pytest.approx(share, abs=0.015)
