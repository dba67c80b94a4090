"""Work on all cores at once: kernels, and what is large in numpy, let go of the interpreter."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def each(do: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
    """Answers for all items, in their order, worked out in as many threads as there are cores for this process."""
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(do, items))
