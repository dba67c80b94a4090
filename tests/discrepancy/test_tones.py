"""Tones in recordings of an independent simulator. Developed on seeds 200 and 300 to 419; these are others."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, in_band, recorded_from
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.tones import loud_tones, without_tones
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Mode, Spindle
from tests.discrepancy.machine import Machine, record

ROTATION_HZ = 27.3
SYSTEM = MachiningSystem((Mode(300.0, 0.02),), spindle=Spindle(60.0 * ROTATION_HZ, 4))


def turned(samples: int, wander: float, seed: int) -> NDArray[np.float64]:
    """Angle of a spindle whose speed wanders."""
    slow = gaussian_filter1d(np.random.default_rng(seed).standard_normal(samples), 6400)
    return np.asarray(2.0 * np.pi * ROTATION_HZ / 12800.0 * np.cumsum(1.0 + wander * slow / np.std(slow)))


def comb(samples: int, wander: float, seed: int) -> NDArray[np.float64]:
    """Orders 1, 4, 8 and 12 of a spindle whose speed wanders, of unit rms."""
    turn = turned(samples, wander, seed)
    made = sum(size * np.cos(order * turn + order) for order, size in ((1, 0.3), (4, 1.0), (8, 0.7), (12, 0.3)))
    return np.asarray(made / np.std(made))


def forced(machine: Machine, ratio: float, wander: float, seed: int) -> NDArray[np.float64]:
    """A machine and a comb so many times as loud."""
    quiet = record(machine, seed)
    return np.asarray(quiet + ratio * np.std(quiet) * comb(quiet.size, wander, seed))


@pytest.mark.parametrize("ratio", [1.0, 10.0])
@pytest.mark.parametrize(
    ("effect", "names"), [("none", ["periodic_forcing"]), ("hardening", ["cubic_stiffness", "periodic_forcing"])]
)
def test_beside_orders_that_wander_the_machine_is_seen(effect, names, ratio):
    """A spindle whose speed wanders by 0.1 % hides neither the mode nor what is missing."""
    machine = Machine(effect, 0.12, frequency_hz=300.0, seconds=10.0)
    report = conclude(examine(recorded_from(forced(machine, ratio, 1e-3, 140), 12800.0), SYSTEM)).report
    assert sorted(term.name for term in report.terms) == names, report.summary
    if effect == "none":
        assert report.calibration.after["mode.1.frequency_hz"].value == pytest.approx(300.0, rel=0.005)
        assert report.calibration.after["mode.1.damping_ratio"].value == pytest.approx(0.02, rel=0.2)


def test_what_is_left_without_the_orders_is_the_machine():
    """All four orders go, 40 dB of them, and the spectrum beside them stays."""
    machine = Machine(frequency_hz=300.0, seconds=10.0)
    _, loud = in_band(recorded_from(forced(machine, 10.0, 3e-3, 141), 12800.0), SYSTEM)
    _, quiet = in_band(recorded_from(record(machine, 141), 12800.0), SYSTEM)
    found = loud_tones(loud, Linear.of(SYSTEM))
    orders = sorted(round(tone.frequency_hz / ROTATION_HZ) for tone in found)
    assert orders == [1, 4, 8, 12]
    rest = without_tones(loud, found)
    there = ~rest.missing
    assert there.mean() > 0.85
    left = np.std((rest.samples - quiet.samples)[there]) / np.std(loud.samples[there])
    assert left < 10.0 ** (-30.0 / 20.0)
    assert np.std(rest.samples[there]) == pytest.approx(np.std(quiet.samples[there]), rel=0.1)


@pytest.mark.parametrize("seed", range(142, 150))
@pytest.mark.parametrize("damping_ratio", [0.002, 0.008])
def test_a_sharp_resonance_is_no_tone(damping_ratio, seed):
    """What noise drives stays, however narrow and loud it is."""
    machine = Machine(frequency_hz=150.0, damping_ratio=damping_ratio, seconds=8.0)
    system = MachiningSystem((Mode(151.0, damping_ratio),))
    _, recorded = in_band(recorded_from(record(machine, seed), 12800.0), system)
    assert loud_tones(recorded, Linear.of(system)) == []


def test_an_order_that_wanders_is_no_hum_of_the_mains():
    """The eleventh order at 300.3 Hz, whose speed wanders, is not taken for the sixth of 50 Hz."""
    machine = Machine(frequency_hz=260.0, seconds=10.0)
    quiet = record(machine, 151)
    loud = quiet + 5.0 * np.std(quiet) * np.cos(11.0 * turned(quiet.size, 1e-3, 151))
    system = MachiningSystem((Mode(260.0, 0.02),), spindle=SYSTEM.spindle)
    report = conclude(examine(recorded_from(loud, 12800.0), system)).report
    assert [term.name for term in report.terms] == ["periodic_forcing"], report.summary


def test_hum_that_is_fainter_than_the_machine_does_not_wander():
    """What the loudest ordinate of a spectrum belongs to is then the machine, and the hum has to be told elsewhere."""
    machine = Machine(frequency_hz=580.0, damping_ratio=0.016)
    system = MachiningSystem((Mode(580.0, 0.016),))
    samples = record(machine, 150)
    hum = 0.1 * np.std(samples) * np.sin(2.0 * np.pi * 50.0 / 12800.0 * np.arange(samples.size))
    _, recorded = in_band(recorded_from(samples + hum, 12800.0), system)
    (found,) = loud_tones(recorded, Linear.of(system))
    assert found.phase is None
    assert found.frequency_hz == pytest.approx(50.0, abs=0.002)
