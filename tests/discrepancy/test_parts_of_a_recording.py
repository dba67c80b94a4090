"""A recording without a stretch of it, a drifting offset beside a stretch, and a machine that changes in one."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.discrepancy.band import FADE_S, Recorded, without
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.faults import slow_drift
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.spectrum import fit, periodogram
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Mode
from chatter_monitor.reports.diagnosis.alone import concluded
from tests.discrepancy.machine import Machine, record

RATE_HZ = 1600.0
MODE_HZ, DAMPING = 110.0, 0.01


@pytest.fixture(scope="module")
def vibration():
    """20 s of a linear machine, 15 samples a period."""
    samples = record(Machine(frequency_hz=MODE_HZ, damping_ratio=DAMPING, snr_db=60.0, rate_hz=RATE_HZ), 140)
    return Recorded(samples, np.zeros(samples.size, dtype=bool), RATE_HZ)


def test_a_recording_without_a_stretch_keeps_its_spectrum(vibration):
    """The joint of two ends leaks nothing: mode and density at high frequencies are those of the whole recording."""
    rest = without(vibration, (6.0, 12.0))
    assert rest.seconds == pytest.approx(14.0 - FADE_S, abs=2.0 / RATE_HZ)
    whole, left = (periodogram(each, 2.0) for each in (vibration, rest))
    high = whole.frequency_hz > 4.0 * MODE_HZ
    assert np.median(left.density[left.frequency_hz > 4.0 * MODE_HZ]) == pytest.approx(
        np.median(whole.density[high]), rel=0.1
    )
    [mode] = fit(left, Linear((Mode(MODE_HZ, DAMPING),), "displacement", 1e-6)).linear.modes
    assert mode.frequency_hz == pytest.approx(MODE_HZ, rel=0.003)
    assert mode.damping_ratio == pytest.approx(DAMPING, rel=0.3)


def test_a_stretch_at_an_end_leaves_one_part(vibration):
    """What begins with the recording leaves the rest of it as it is."""
    rest = without(vibration, (0.0, 5.0))
    np.testing.assert_array_equal(rest.samples, vibration.samples[round(5.0 * RATE_HZ) :])


def test_nothing_is_estimated_beside_what_is_nearly_everywhere(vibration):
    """Three seconds at one end are too little for a machine."""
    assert without(vibration, (0.0, 17.0)) is None


def test_a_mean_beside_a_stretch_is_no_drifting_offset():
    """A sensor whose mean is not zero beside a gap does not drift; one that drifts does, gap or no gap."""
    rng = np.random.default_rng(3)
    n = 20_000
    samples = rng.standard_normal(n) + 0.5
    t = np.linspace(-1.0, 1.0, n)
    weight = np.clip((np.abs(t - 0.2) - 0.3) / 0.05, 0.0, 1.0)
    assert slow_drift(samples, weight, 1.0)[1] > 1e-3
    drifting = samples + 0.4 * t**2
    drift, p = slow_drift(drifting, weight, 1.0)
    assert p < 1e-5
    # Beside the gap the polynomials follow it, to what noise allows.
    beside = weight == 1.0
    assert np.corrcoef(drift[beside], t[beside] ** 2)[0, 1] > 0.8


def test_a_damper_that_alone_changes_in_a_stretch_is_located_and_drawn():
    """Six times the damping from 4 to 6 of 10 s, the spring as before: told, and the page has its picture."""
    rng, rate_hz, fine, w = np.random.default_rng(5), 6400.0, 8, 2.0 * np.pi * 300.0
    step = 1.0 / (rate_hz * fine)
    push = np.sqrt(step) * rng.standard_normal((round(10.0 * rate_hz), fine))
    samples, x, v = np.empty(len(push)), 0.0, 0.0
    for i, pushes in enumerate(push):
        damping_ratio = 0.12 if 4.0 < i / rate_hz < 6.0 else 0.02
        for each in pushes:
            v += each - step * (w * w * x + 2.0 * damping_ratio * w * v)
            x += step * v
        samples[i] = x
    samples += 0.01 * np.std(samples) * rng.standard_normal(samples.size)
    diagnosis, html, _ = concluded(
        examine(recorded_from(samples, rate_hz), MachiningSystem((Mode(300.0, 0.02),))), "a damper"
    )
    assert [(term.name, term.why) for term in diagnosis.report.terms] == [
        ("parameter_drift", "A machine that changes along the recording, from 4.0 to 6.0 s only.")
    ]
    assert "Where they differ" in html
