"""Kernels that are called often, bound to the types of their arguments.

Numba finds out the types of all arguments in every call. For a state of thirty arrays that takes 9 us, for the call
itself is left 1 us. To find them out by its slow way, as is done here, takes a millisecond for such a state: once, not
for every channel anew.
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

MachineCode = Callable[..., Any]

_known: dict[tuple[object, ...], MachineCode] = {}


def bound(kernel: Any, *arguments: object) -> MachineCode:
    """Machine code of a kernel for arguments of these types; not to be called with any others."""
    key = (kernel, *map(_kind, arguments))
    machine_code = _known.get(key)
    if machine_code is None:
        machine_code = _known[key] = kernel.compile(tuple(numba.typeof(argument) for argument in arguments))
    return machine_code


def _kind(argument: object) -> object:
    """What the type of an argument depends on."""
    if isinstance(argument, tuple):
        return (type(argument), *map(_kind, argument))
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    return type(argument)
