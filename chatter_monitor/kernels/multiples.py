"""Whether a line is where it is because it is a multiple of another, or by chance."""

from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Where more lines than this would be near such a multiple by chance, none is one for that.
LARGEST_CHANCE = 0.1


@njit(**OPTIONS)
def by_chance(times, reach, fundamental):
    """How likely any line is within so many times a reach of that multiple of a fundamental; both in the same unit."""
    return 2.0 * times * reach / fundamental
