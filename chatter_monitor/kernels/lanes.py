"""Several numbers side by side in one vector of the processor: what one computes, all do, each for itself.

The compiler leaves loops over eight channels scalar (docs/decisions/0037-lanes.md), so vectors are asked for by name. A
`Lanes` value is a vector of float64; arithmetic, comparison, `abs` and the functions below work lane by lane, and a
plain number stands for one in every lane. A comparison gives a mask, from which `select` chooses. Nothing mixes lanes,
and products are added by `fma` alone, so a lane has the same bits whatever its neighbours are and however many.

Kernels get lanes by `as_lanes`, a view of an array whose last axis is the lanes.
"""

import operator
from collections.abc import Callable
from typing import Any

import numba.extending
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, lower_cast, register_model, type_callable

DOUBLE = ir.DoubleType()
BIT = ir.IntType(1)
intrinsic: Any = numba.extending.intrinsic
NUMBERS = (types.Float, types.Integer)


class Lanes(types.Type):
    """So many float64."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Lanes({count})")


class Mask(types.Type):
    """So many truth values."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Mask({count})")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Lanes) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.count))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Mask) -> None:
        super().__init__(manager, kind, ir.VectorType(BIT, kind.count))


def _splat(builder: Any, value: Any, count: int) -> Any:
    vector = ir.VectorType(value.type, count)
    zero = ir.Constant(ir.IntType(32), 0)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, zero)
    every = ir.Constant(ir.VectorType(ir.IntType(32), count), [0] * count)
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), every)


def _from_number(context: Any, builder: Any, given: types.Type, wanted: Lanes, value: Any) -> Any:
    return _splat(builder, context.cast(builder, value, given, types.float64), wanted.count)


for _number in NUMBERS:
    lower_cast(_number, Lanes)(_from_number)


def _lanes_among(arguments: tuple[types.Type, ...]) -> Lanes | None:
    """Type of the lanes among numbers and lanes."""
    kinds = {a for a in arguments if isinstance(a, Lanes)}
    if len(kinds) == 1 and all(isinstance(a, (Lanes, *NUMBERS)) for a in arguments):
        return kinds.pop()
    return None


def _operator(function: Any, operands: int, result: type[Lanes | Mask], emit: Callable[..., Any]) -> None:
    """Teach an operator to work on lanes."""

    class Template(AbstractTemplate):
        def generic(self, args: tuple[types.Type, ...], kws: object) -> Any:
            lanes = _lanes_among(args) if len(args) == operands else None
            return lanes and signature(result(lanes.count), *[lanes] * operands)

    infer_global(function)(Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)

    lower_builtin(function, *[Lanes] * operands)(lower)


_operator(operator.add, 2, Lanes, lambda builder, x, y: builder.fadd(x, y))
_operator(operator.sub, 2, Lanes, lambda builder, x, y: builder.fsub(x, y))
_operator(operator.mul, 2, Lanes, lambda builder, x, y: builder.fmul(x, y))
_operator(operator.truediv, 2, Lanes, lambda builder, x, y: builder.fdiv(x, y))
_operator(operator.neg, 1, Lanes, lambda builder, x: builder.fneg(x))
_operator(operator.lt, 2, Mask, lambda builder, x, y: builder.fcmp_ordered("<", x, y))
_operator(operator.gt, 2, Mask, lambda builder, x, y: builder.fcmp_ordered(">", x, y))
_operator(operator.eq, 2, Mask, lambda builder, x, y: builder.fcmp_ordered("==", x, y))
_operator(abs, 1, Lanes, lambda builder, x: _call(builder, "llvm.fabs", x))


def _call(builder: Any, name: str, *args: Any) -> Any:
    vector = args[0].type
    kind = ir.FunctionType(vector, [vector] * len(args))
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"{name}.v{vector.count}f64"), args)


class _Both(AbstractTemplate):
    def generic(self, args: tuple[types.Type, ...], kws: object) -> Any:
        return signature(args[0], *args) if isinstance(args[0], Mask) and all(a == args[0] for a in args) else None


infer_global(operator.and_)(_Both)
infer_global(operator.or_)(_Both)
infer_global(operator.invert)(_Both)
lower_builtin(operator.or_, Mask, Mask)(lambda context, builder, sig, args: builder.or_(*args))
lower_builtin(operator.and_, Mask, Mask)(lambda context, builder, sig, args: builder.and_(*args))
lower_builtin(operator.invert, Mask)(lambda context, builder, sig, args: builder.not_(*args))


@intrinsic
def fma(typing_context, x, y, z):
    """``x y + z``, rounded once."""
    lanes = _lanes_among((x, y, z))
    return lanes and (lanes(lanes, lanes, lanes), lambda _, builder, sig, args: _call(builder, "llvm.fma", *args))


@intrinsic
def select(typing_context, mask, x, y):
    """Choose x where the mask is true, y elsewhere."""
    lanes = Lanes(mask.count)
    return lanes(mask, lanes, lanes), lambda _, builder, sig, args: builder.select(*args)


def _first_if(comparison: str, x: types.Type, y: types.Type) -> Any:
    """An intrinsic that takes x where it compares so with y, and y elsewhere."""
    lanes = _lanes_among((x, y))
    return lanes and (
        lanes(lanes, lanes),
        lambda _, builder, sig, args: builder.select(builder.fcmp_ordered(comparison, *args), *args),
    )


@intrinsic
def larger(typing_context, x, y):
    """The larger one; y where one is NaN."""
    return _first_if(">", x, y)


@intrinsic
def smaller(typing_context, x, y):
    """The smaller one; y where one is NaN."""
    return _first_if("<", x, y)


@intrinsic
def bits(typing_context, mask):
    """Mask as an integer: bit k is that of lane k."""

    def emit(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(mask.count)), ir.IntType(64))

    return types.int64(mask), emit


@intrinsic
def floor(typing_context, x):
    """Next whole number below."""
    return x(x), lambda _, builder, sig, args: _call(builder, "llvm.floor", *args)


@intrinsic
def spread(typing_context, number, like):
    """A number in as many lanes as another value has."""
    return like(like, like), lambda _, builder, sig, args: args[0]


def part(array: Any, begin: int, end: int) -> Any:
    """``array[begin:end]`` of a C-contiguous array, which has to have all of these rows.

    A slice begins where the array ends, if that is sooner. So the compiler knows where none of them begins, has to
    suppose that they overlap, and fetches again what it has just put elsewhere.
    """
    return array[begin:end]


@type_callable(part)
def _type_part(context: Any) -> Any:
    return lambda array, begin, end: array if isinstance(array, types.Array) and array.layout == "C" else None


@lower_builtin(part, types.Array, types.Integer, types.Integer)
def _lower_part(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    given = context.make_array(sig.args[0])(context, builder, args[0])
    view = context.make_array(sig.args[0])(context, builder)
    begin, end = (
        context.cast(builder, row, kind, types.intp) for row, kind in zip(args[1:], sig.args[1:], strict=True)
    )
    rows = items = builder.sub(end, begin)
    beside = cgutils.unpack_tuple(builder, given.shape)[1:]
    for size in beside:
        begin, items = builder.mul(begin, size), builder.mul(items, size)
    view.shape = cgutils.pack_array(builder, [rows, *beside])
    view.strides, view.itemsize = given.strides, given.itemsize
    view.nitems = items
    view.data = builder.gep(given.data, [begin], inbounds=True)
    view.meminfo, view.parent = given.meminfo, given.parent
    return view._getvalue()


@intrinsic(prefer_literal=True)
def as_lanes(typing_context, array, count):
    """View of a C-contiguous array of float64 as an array, shape (size / count,), of lanes; `count` is a constant."""
    lanes = types.Array(Lanes(count.literal_value), 1, "C", aligned=False)

    def emit(context, builder, sig, args):
        given = context.make_array(array)(context, builder, args[0])
        view = context.make_array(lanes)(context, builder)
        size = ir.Constant(ir.IntType(64), count.literal_value)
        view.nitems = builder.udiv(given.nitems, size)
        view.itemsize = builder.mul(given.itemsize, size)
        view.shape = cgutils.pack_array(builder, [view.nitems])
        view.strides = cgutils.pack_array(builder, [view.itemsize])
        view.data = builder.bitcast(given.data, view.data.type)
        view.meminfo, view.parent = given.meminfo, given.parent
        return view._getvalue()

    return lanes(array, count), emit
