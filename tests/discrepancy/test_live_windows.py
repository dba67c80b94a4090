"""Changes of what blocks of whitened errors say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chatter_monitor.discrepancy.live.shapes import of_another_mode
from chatter_monitor.discrepancy.live.windows import FINE_BANDS, Blocks, no_summary
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.spectrum import log_densities
from chatter_monitor.physics.parts import Mode

RATE_HZ = 3000.0
SAMPLES = 1536
MACHINE = Linear((Mode(300.0, 0.02),), "displacement", 1e-3, 20.0, None)


def blocks_of(rng: np.random.Generator, gains: list[np.ndarray | None], shapes: np.ndarray) -> Blocks:
    """Blocks of white errors, each with a spectrum of its own (amplitudes by frequency)."""
    blocks = Blocks(64, 0, 0, 2, SAMPLES, shapes)
    for number, gain in enumerate(gains):
        rows = rng.standard_normal((SAMPLES, 3))
        if gain is not None:
            rows[:, 0] = np.fft.irfft(np.fft.rfft(rows[:, 0]) * gain, SAMPLES)
        summary = no_summary(3, SAMPLES)
        summary.products[:] = (rows.T @ rows).reshape(-1)
        summary.sums[:], summary.errors[:] = rows.sum(axis=0), rows[:, 0]
        blocks.append(number * SAMPLES, summary, 3)
    return blocks


def test_shapes_are_alike_in_size_and_none_is_of_the_level():
    """Each has unit length and mean zero; none is at the mode that is there."""
    shapes = of_another_mode(MACHINE, RATE_HZ, FINE_BANDS)
    np.testing.assert_allclose(np.linalg.norm(shapes, axis=1), 1.0)
    np.testing.assert_allclose(shapes.mean(axis=1), 0.0, atol=1e-12)
    width_hz = 0.5 * RATE_HZ / FINE_BANDS
    away = abs((np.arange(FINE_BANDS) + 0.5) * width_hz - 300.0) > 4.0 * 0.02 * 300.0
    assert len(shapes) == np.count_nonzero(away)


def test_chance_is_told_as_rarely_as_it_says():
    """Of windows of the same white errors, one in a hundred and fewer have p < 0.01."""
    rng = np.random.default_rng(1)
    shapes = of_another_mode(MACHINE, RATE_HZ, FINE_BANDS)
    p = [blocks_of(rng, [None] * 16, shapes).changed_p([2, 4]) for _ in range(150)]
    assert np.mean(np.array(p) < 0.01) <= 0.015
    assert np.mean(np.array(p) < 0.3) > 0.03  # and it is not certain of chance either


@pytest.mark.parametrize("frequency_hz", [470.0, 900.0])
def test_a_weak_mode_tells_by_its_shape_what_all_bands_together_do_not(frequency_hz):
    """Sixteen blocks with another mode are a change by its shape, and are none that is sure without it."""
    width_hz = 0.5 * RATE_HZ / FINE_BANDS
    at = (np.arange(FINE_BANDS) + 0.5) * width_hz
    added = Mode(frequency_hz, 0.02, (0.6 * 0.04 * frequency_hz**2 / abs(300.0**2 - frequency_hz**2)) ** 0.5)
    two = replace(MACHINE, modes=(*MACHINE.modes, added))
    after, before = log_densities([two, MACHINE], at, 0.5 * RATE_HZ)
    change = after - before
    gain = np.exp(0.5 * np.interp(np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ), at, change))
    shapes = of_another_mode(MACHINE, RATE_HZ, FINE_BANDS)
    by_shape, without = (
        [
            float(blocks_of(np.random.default_rng(seed), [None] * 24 + [gain] * 16, some).changed_p([16])[0])
            for seed in range(5)
        ]
        for some in (shapes, shapes[:0])
    )
    assert np.median(by_shape) < 1e-9
    assert np.median(by_shape) < 1e-3 * np.median(without)
