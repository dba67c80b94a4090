"""Places in a ring, without a division for each: that would take longer than all that is done there."""

from numba import njit

from chatter_monitor.kernels.options import OPTIONS


@njit(**OPTIONS)
def before(column, columns):
    """Column before another."""
    return column - 1 if column > 0 else columns - 1


@njit(**OPTIONS)
def after(column, columns):
    """Column after another."""
    return column + 1 if column + 1 < columns else 0
