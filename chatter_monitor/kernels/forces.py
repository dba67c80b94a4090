"""Physics terms as function pointers: any combination of terms runs at compiled speed without a new compilation.

A term is a plain function ``force(x, v, lagged, angle, w, memory, p)`` of numbers. It is compiled once (and cached on
disk) to a C function; a kernel gets the addresses of the functions that a model is made of and calls them through
`call_force`. So one compiled integrator, filter or signature engine serves every model, and a new term needs no
change in any kernel. A call costs a few nanoseconds.
"""

from collections.abc import Callable
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import cfunc, njit, types
from numba.extending import intrinsic

_number = types.float64
_numbers = types.CPointer(types.float64)
_SIGNATURE = _number(_number, _number, _number, _number, _number, _number, _numbers)
_ROW_SIGNATURE = types.void(
    _numbers, _numbers, _numbers, _numbers, _number, _numbers, _numbers, types.intp, _numbers
)  # fmt: skip
_LANES_SIGNATURE = types.void(*[_number] * 5, _numbers, _numbers, types.intp, types.intp, _numbers)
MOST_PARAMETERS = 4  # of a term, where rows are evaluated: that many are read


def compile_force(function: Callable[..., float]) -> Any:
    """Compile a term's function for `call_force`; keep the returned object alive as long as its ``address`` is used.

    Parameters
    ----------
    function : callable
        ``f(x, v, lagged, angle, w, memory, p) -> float``; `p` can be indexed, nothing else.
    """
    return cfunc(_SIGNATURE, cache=True)(function)


def _row(x, v, lagged, angle, w, memory, p, n, out):
    parameters = (p[0], p[1], p[2], p[3])
    for i in range(n):
        out[i] = law(x[i], v[i], lagged[i], angle[i], w, memory[i], parameters)  # type: ignore[name-defined] # noqa: F821


def _lanes(x, v, lagged, angle, w, memory, p, apart, n, out):
    for j in range(n):
        parameters = (p[j], p[apart + j], p[2 * apart + j], p[3 * apart + j])
        out[j] = law(x, v, lagged, angle, w, memory[j], parameters)  # type: ignore[name-defined] # noqa: F821


def _gated(x, v, lagged, angle, w, memory, p):
    if x * x + v * v / (w * w) < p[last] * p[last]:  # type: ignore[name-defined] # noqa: F821
        return 0.0
    return law(x, v, lagged, angle, w, memory, p)  # type: ignore[name-defined] # noqa: F821


def above_amplitude(function: Callable[..., float], last: int) -> Callable[..., float]:
    """The term's function where the amplitude sqrt(x^2 + (v / w)^2) is at least its parameter number `last`, else 0."""
    return _around(function, _gated, last=last)


def compile_row(function: Callable[..., float]) -> Any:
    """Compile a term's function for `call_row`: inlined into a loop, which the compiler turns into vector operations.

    Parameters
    ----------
    function : callable
        As for `compile_force`.
    """
    return cfunc(_ROW_SIGNATURE, cache=True)(_around(function, _row))


def compile_lanes(function: Callable[..., float]) -> Any:
    """Compile a term's function for `call_lanes`, inlined in the same way.

    Parameters
    ----------
    function : callable
        As for `compile_force`.
    """
    return cfunc(_LANES_SIGNATURE, cache=True)(_around(function, _lanes))


def _around(function: Callable[..., float], outer: Callable[..., Any], **known: int) -> FunctionType:
    """A function that calls a term's function by the name `law`, and knows some numbers.

    Numba finds what it has compiled before by the file, the line and the name of a function: this one gets those of
    the term's function, with its own name before it.
    """
    of = function.__code__
    code = outer.__code__.replace(
        co_filename=of.co_filename,
        co_firstlineno=of.co_firstlineno,
        co_qualname=f"{outer.__name__}_{of.co_qualname}",
    )
    law = njit(error_model="numpy", fastmath={"contract", "nsz"})(function)
    return FunctionType(code, {"law": law, "__name__": function.__module__, **known})


def _call_at(context, builder, signature, arguments):
    """Call the compiled function at the first argument; pointers are given as addresses."""
    kinds = [context.get_value_type(kind) for kind in signature.args]
    function_type = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
    function = builder.inttoptr(arguments[0], function_type.as_pointer())
    given = zip(arguments[1:], kinds, strict=True)
    passed = [builder.inttoptr(value, kind) if isinstance(kind, ir.PointerType) else value for value, kind in given]
    return builder.call(function, passed)


def _call_force(_typing, _address, _x, _v, _lagged, _angle, _w, _memory, _parameters):
    """Call the compiled term at an address; the last argument is the address of its first parameter."""

    def codegen(context, builder, _signature, arguments):
        return _call_at(context, builder, _SIGNATURE, arguments)

    return _number(types.int64, *[_number] * 6, types.int64), codegen


def _call_row(_typing, _address, _x, _v, _lagged, _angle, _w, _memory, _parameters, _n, _out):
    """Call a term compiled by `compile_row` at an address, with the addresses of contiguous arrays of n states."""

    def codegen(context, builder, _signature, arguments):
        _call_at(context, builder, _ROW_SIGNATURE, arguments)
        return context.get_dummy_value()

    address = types.int64
    return types.void(*[address] * 5, _number, address, address, types.intp, address), codegen


def _call_lanes(_typing, _address, _x, _v, _lagged, _angle, _w, _memory, _parameters, _apart, _n, _out):
    """Call a term compiled by `compile_lanes` for n lanes: one state, but each with its own memory and parameters.

    Memory and out are addresses of n values; each parameter has a row of values, `apart` from that of the one before.
    """

    def codegen(context, builder, _signature, arguments):
        _call_at(context, builder, _LANES_SIGNATURE, arguments)
        return context.get_dummy_value()

    address = types.int64
    return types.void(address, *[_number] * 5, address, address, types.intp, types.intp, address), codegen


call_force: Any = intrinsic(_call_force)
call_row: Any = intrinsic(_call_row)
call_lanes: Any = intrinsic(_call_lanes)


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
