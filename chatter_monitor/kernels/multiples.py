"""Whether a line is where it is because it is a multiple of another, or by chance."""

from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Where more lines than this would be near such a multiple by chance, none is one for that.
LARGEST_CHANCE = 0.1
# Shares of forced lines that are at multiples of the passing of teeth, of the rotation, and at neither.
FORCED_AT_TEETH, FORCED_AT_ROTATION, FORCED_OFF_ORDERS = 0.75, 0.2, 0.05


@njit(**OPTIONS)
def by_chance(times, reach, fundamental):
    """How likely any line is within so many times a reach of that multiple of a fundamental; both in the same unit."""
    return 2.0 * times * reach / fundamental
