"""Windows over the newest blocks against linear algebra that is easy to read."""

import numpy as np
import pytest

from chatter_monitor.kernels import live_windows as kernel

BLOCKS, COLUMNS, BANDS, FINE = 20, 7, 24, 120
SIZES = np.array([2, 5, 12])


@pytest.fixture(scope="module")
def blocks():
    """Products of seven correlated columns of noise in each of twenty blocks, and powers of errors."""
    rng = np.random.default_rng(3)
    mix = rng.standard_normal((COLUMNS, COLUMNS))
    rows = rng.standard_normal((BLOCKS, 100, COLUMNS)) @ mix
    powers, fine_powers = (rng.exponential(size=(BLOCKS, bands)) for bands in (BANDS, FINE))
    return np.swapaxes(rows, 1, 2) @ rows, powers, 1.0 + fine_powers


def summed(values):
    """Sums up to each block, none first."""
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])


def test_what_is_always_in_is_taken_out_of_the_newest_blocks(blocks):
    """The rest is that of a least-squares fit of the columns that are always in, over the blocks of each window."""
    products = blocks[0]
    out = np.empty((SIZES.size, COLUMNS, COLUMNS))
    kernel.newest(summed(products), BLOCKS, SIZES, 1e-8, 0.0, 3, out)
    others = np.array([0, 4, 5, 6])
    for size, found in zip(SIZES, out, strict=True):
        total = products[-size:].sum(axis=0)
        inner = total[1:4][:, others]
        expected = total[np.ix_(others, others)] - inner.T @ np.linalg.solve(total[1:4, 1:4], inner)
        np.testing.assert_allclose(found[np.ix_(others, others)], expected, rtol=1e-9)


def test_a_column_that_is_next_to_nothing_now_is_zero(blocks):
    """What rounding has left of a column that was large before is not taken for a signature."""
    products = blocks[0].copy()
    products[2:, 5], products[2:, :, 5] = 0.0, 0.0
    out = np.empty((1, COLUMNS, COLUMNS))
    kernel.newest(summed(products), BLOCKS, np.array([4]), 1e-8, 1e-9, 3, out)
    assert abs(out[0, 0, 5]) < 1e-290
    assert abs(out[0, 4, 5]) < 1e-290


def test_a_change_is_measured_as_by_hand(blocks):
    """The statistics are as by the formulas: of two fits' difference, of log ratios of mean powers, how these vary."""
    products, powers, fine_powers = blocks
    retuned, coloured, shaped = np.empty((3, SIZES.size))
    shapes = np.linalg.qr(np.random.default_rng(4).standard_normal((FINE, 3)))[0].T
    sums = kernel.Sums(
        summed(products), summed(products), summed(np.stack([powers, powers**2], axis=1)), summed(fine_powers)
    )
    kernel.changed(sums, BLOCKS, SIZES, 2, 3, 5.0, shapes, 2.0, retuned, coloured, shaped)
    for i, size in enumerate(SIZES):
        at = BLOCKS - size
        fits = []
        for part in (products[:at].sum(axis=0), products[at:].sum(axis=0)):
            covariance = np.linalg.inv(part[2:5, 2:5])
            fits.append((covariance @ part[2:5, 0], covariance))
        change, covariance = fits[1][0] - fits[0][0], fits[0][1] + fits[1][1]
        assert retuned[i] == pytest.approx(change @ np.linalg.solve(covariance, change))
        mean = powers[:at].mean(axis=0)
        ratio = np.log(powers[at:].mean(axis=0) / mean)
        varies = np.mean((powers[:at] ** 2).mean(axis=0) / mean**2 - 1.0) * 5.0 * at / (at - 1)
        over = max(varies, 1.0) * (1.0 / at + 1.0 / size)
        assert coloured[i] == pytest.approx(np.sum((ratio - ratio.mean()) ** 2) * 5.0 / over)
        root = 3.0 * np.cbrt(fine_powers[at:].mean(axis=0) / fine_powers[:at].mean(axis=0))
        assert shaped[i] == pytest.approx(np.max((shapes @ root) ** 2) * 2.0 / over)
    # What is just above each of these is not little, in any window.
    told, nats = np.stack([retuned, coloured, shaped]), np.empty(SIZES.size)
    kernel.most(sums.of_scouts, BLOCKS, SIZES, 1e-8, 0.0, 4, nats)
    above = [*1.001 * told.max(axis=1), 1.001 * nats.max()]
    for lower in range(5):
        bounds = [bound * (0.99 if i == lower else 1.0) for i, bound in enumerate(above)]
        nothing = kernel.quiet(
            sums, BLOCKS, SIZES, SIZES, 2, 3, 5.0, shapes, 2.0, np.array(bounds[:3]), 1e-8, 0.0, bounds[3]
        )
        assert nothing == (lower == 4)


def test_the_column_that_explains_most_does_so_by_itself(blocks):
    """The largest gain is that of the best single column beside those that are always in."""
    products = blocks[0]
    gains, rest = np.empty(SIZES.size), np.empty((SIZES.size, COLUMNS, COLUMNS))
    kernel.most(summed(products), BLOCKS, SIZES, 1e-8, 0.0, 3, gains)
    kernel.newest(summed(products), BLOCKS, SIZES, 1e-8, 0.0, 3, rest)
    np.testing.assert_allclose(gains, [max(0.5 * each[0, i] ** 2 / each[i, i] for i in (4, 5, 6)) for each in rest])
