"""Kernels that are called often, bound to the types of their arguments.

Numba finds out the types of all arguments in every call. For a state of thirty arrays that takes 9 us, for the call
itself is left 1 us.
"""

from collections.abc import Callable
from typing import Any

import numba


def bound(kernel: Any, *arguments: object) -> Callable[..., Any]:
    """Machine code of a kernel for arguments of these types; not to be called with any others."""
    machine_code: Callable[..., Any] = kernel.compile(tuple(numba.typeof(argument) for argument in arguments))
    return machine_code
