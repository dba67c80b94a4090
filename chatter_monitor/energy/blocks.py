"""Block bootstrap: the record in blocks longer than its memory, resampled as weights of per-block sums.

Every estimate of this package is a function of sums over the record, so a bootstrap replicate is one row of integer
weights applied to the sums of the blocks: no sample is touched twice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from chatter_monitor.energy.kinematics import Motion

MEMORIES = 6.0  # length of a block in memories 1/h of the energy
FEWEST, MOST = 8, 100


def count(motion: Motion, peak_hz: float) -> int:
    """Into how many blocks to cut a motion, from the decay of its autocovariance over one period.

    Pooled over all energies, the velocity's covariance falls by exp(-h T / 2) a period, eq. (15); the energy forgets
    itself as exp(-h t).
    """
    period = round(motion.rate_hz / peak_hz)
    half = period // 2
    v = motion.v[: motion.v.size - half - period]
    near = float(np.abs(np.dot(v, motion.v[half : half + v.size])))
    far = float(np.abs(np.dot(v, motion.v[half + period : half + period + v.size])))
    damping = max(2.0 * np.log(near / far) * peak_hz, 0.0)
    return int(np.clip(motion.v.size / motion.rate_hz * damping / MEMORIES, FEWEST, MOST))


def weights(blocks: int, replicates: int, seed: int) -> NDArray[np.float64]:
    """How often each block is drawn in each replicate.

    Returns
    -------
    ndarray, shape (replicates, blocks)
        Row sums are `blocks`.
    """
    draws = np.random.default_rng(seed).multinomial(blocks, np.full(blocks, 1.0 / blocks), size=replicates)
    return draws.astype(np.float64)


def interval_factor(blocks: int) -> float:
    """Half-width of a 95 % interval in bootstrap standard deviations: Student's t, since few blocks know it badly."""
    return float(stats.t.ppf(0.975, blocks - 1)) * float(np.sqrt(blocks / (blocks - 1)))
