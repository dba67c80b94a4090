"""Physics terms as function pointers: any combination of terms runs at compiled speed without a new compilation.

A term is a plain function ``force(x, v, lagged, angle, w, memory, p)`` of numbers. It is compiled once (and cached on
disk) to a C function; a kernel gets the addresses of the functions that a model is made of and calls them through
`call_force`. So one compiled integrator, filter or signature engine serves every model, and a new term needs no
change in any kernel. A call costs a few nanoseconds.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped] # Numba's own code generator
from numba import cfunc, njit, types
from numba.extending import intrinsic

_number = types.float64
_numbers = types.CPointer(types.float64)
_SIGNATURE = _number(_number, _number, _number, _number, _number, _number, _numbers)


def compile_force(function: Callable[..., float]) -> Any:
    """Compile a term's function for `call_force`; keep the returned object alive as long as its ``address`` is used.

    Parameters
    ----------
    function : callable
        ``f(x, v, lagged, angle, w, memory, p) -> float``; `p` can be indexed, nothing else.
    """
    return cfunc(_SIGNATURE, cache=True)(function)


def _call_force(_typing, _address, _x, _v, _lagged, _angle, _w, _memory, _parameters):
    """Call the compiled term at an address; the last argument is the address of its first parameter."""

    def codegen(context, builder, _signature, arguments):
        kinds = [context.get_value_type(kind) for kind in _SIGNATURE.args]
        function_type = ir.FunctionType(context.get_value_type(_number), kinds)
        function = builder.inttoptr(arguments[0], function_type.as_pointer())
        return builder.call(function, [*arguments[1:7], builder.inttoptr(arguments[7], kinds[6])])

    return _number(types.int64, *[_number] * 6, types.int64), codegen


call_force: Any = intrinsic(_call_force)


@njit(cache=True, nogil=True)
def force_along(address, x, v, lagged, angle, w, memory, p, out):
    """Evaluate one term at many states, for signatures, plots and reports.

    Parameters
    ----------
    address : int
        Of the compiled term.
    x, v, lagged, angle, memory, out : ndarray of float64, shape (n,)
        The states, and where the force per unit mass goes.
    w : float
        Angular frequency of the reference mode in rad/s.
    p : ndarray of float64, shape (k,)
        Parameters of the term, contiguous.
    """
    for i in range(x.size):
        out[i] = call_force(address, x[i], v[i], lagged[i], angle[i], w, memory[i], p.ctypes.data)
