"""The heap of a process that runs for a year."""

from __future__ import annotations

import ctypes

# From this size on an array has pages of its own, which go back when it goes.
OWN_PAGES_BYTES = 1 << 20
# What is free at the end of the heap stays up to this size: the next interval wants it again.
KEPT_BYTES = 1 << 25
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # malloc.h of the GNU C library


def keep_flat() -> None:
    """Keep large arrays out of the heap.

    The GNU C library raises its threshold whenever such an array is freed, up to 32 MB. What the flight recorder writes
    then comes to lie on the heap among what lives on, and leaves gaps that the next recording does not quite fit: the
    process grows with every event. A threshold that is set stays. But then the other one that it would raise along
    stays at 128 KB, too, more than which is never kept free: pages that each interval gave back and asked for again
    took a tenth of the chain's time. So that one is set as well. Other libraries know no such call.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, OWN_PAGES_BYTES)
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
