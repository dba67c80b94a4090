"""The heap of a process that runs for a year."""

from __future__ import annotations

import ctypes

# From this size on an array has pages of its own, which go back when it goes.
OWN_PAGES_BYTES = 1 << 20
_M_MMAP_THRESHOLD = -3  # malloc.h of the GNU C library


def keep_flat() -> None:
    """Keep large arrays out of the heap.

    The GNU C library raises its threshold whenever such an array is freed, up to 32 MB. What the flight recorder writes
    then comes to lie on the heap among what lives on, and leaves gaps that the next recording does not quite fit: the
    process grows with every event. A threshold that is set stays. Other libraries know no such call.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, OWN_PAGES_BYTES)
