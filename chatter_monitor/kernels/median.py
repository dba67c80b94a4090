"""Median by selection: half of the values need not be sorted to find the one in their middle."""

from numba import njit

from chatter_monitor.kernels.options import OPTIONS


@njit(**OPTIONS)
def median(values):
    """Median (upper one of two) of values without NaN, which are put into another order (Hoare's selection)."""
    middle = values.shape[0] // 2
    left, right = 0, values.shape[0] - 1
    while left < right:
        pivot = values[middle]
        i, j = left, right
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        # up to j there is nothing above the pivot, from i on nothing below it
        if j < middle:
            left = i
        if middle < i:
            right = j
    return values[middle]
