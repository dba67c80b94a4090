"""A ring of transforms that tests look at."""

import numpy as np

HOPS, BINS, LOWEST = 80, 65, 2


def ring(seed: int, missing: tuple[int, ...] = ()):
    """Random transforms, oldest first, which of them are valid; and the same as a ring with its head."""
    rng = np.random.default_rng(seed)
    ordered = rng.standard_normal((HOPS, BINS)) + 1j * rng.standard_normal((HOPS, BINS))
    valid = np.ones(HOPS, bool)
    valid[list(missing)] = False
    head = HOPS + int(rng.integers(HOPS))
    return ordered, valid, (np.roll(ordered, head, axis=0).T.copy(), np.roll(valid, head), head)
