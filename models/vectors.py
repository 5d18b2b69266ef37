"""Operations of compiled loops on runs of numbers, by vector instructions however short a run is.

The compiler makes vector instructions of long loops only; the rows of a belief over 16 positions are too short for it.
Here a run is cut into parts of 16, 8, 4, 2 and 1 numbers, and each part is one value, in as many registers as the
processor needs. The order of sums depends on the length alone.

Arrays are handed over whole with the index of the first number, because making a slice costs as much as the work. They
must be contiguous, and nothing is checked.
"""

# ruff: noqa: ARG001 - arguments of intrinsics are named for their types

from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.cgutils import alloca_once
from numba.core.errors import TypingError
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from .seeds import PER_BLOCK, philox

_intrinsic: Any = intrinsic
_FLOAT, _WORD, _LANE = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_TAILS = 8, 4, 2, 1

PART = 16
"""Numbers of the largest part."""
BLOCKS = 8
"""Blocks of random words that are made at a time."""


@_intrinsic
def multiply_rows(_: Any, values: Any, factors: Any, first: Any, rows: Any, length: Any, sums: Any) -> Any:
    """Multiplies rows of numbers by factors and sums each row.

    Args:
        values: The numbers, changed in place, `rows` x `length` of them.
        factors: Where the factors are.
        first: Index of the first of these.
        rows: Number of rows.
        length: Numbers in each.
        sums: Receives the sum of each row.

    Returns:
        The sum of all.
    """

    def built(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data, by, out = (_data(context, builder, signature, given, i) for i in (0, 1, 5))
        _, _, start, n, size, _ = given

        def all_rows(tail: bool) -> Any:
            def row(m: Any, total: Any) -> Any:
                begin = builder.mul(m, size)

                def part(offset: Any, width: int, sum_: Any) -> Any:
                    at = builder.add(begin, offset)
                    factor = _load(builder, by, builder.add(start, at), width)
                    product = builder.fmul(_load(builder, data, at, width), factor)
                    _store(builder, product, data, at)
                    return builder.fadd(sum_, _widened(builder, product))

                sum_ = _total(builder, _parts(builder, size, tail, _zeros(PART), part))
                builder.store(sum_, builder.gep(out, [m]))
                return builder.fadd(total, sum_)

            return _repeat(builder, n, _FLOAT(0.0), row)

        even = builder.icmp_unsigned("==", builder.urem(size, _number(PART)), _number(0))
        return _choose(builder, even, lambda: all_rows(tail=False), lambda: all_rows(tail=True))

    integer = types.int64
    return types.float64(values, factors, integer, integer, integer, sums), built


@_intrinsic
def multiply_narrow_rows(_: Any, values: Any, factors: Any, first: Any, rows: Any, sums: Any, columns: Any) -> Any:
    """`multiply_rows` of rows of `PART` numbers, with the sums of `sum_rows`, which stay in registers meanwhile.

    Args:
        values: The numbers, changed in place, `rows` x `PART` of them.
        factors: Where the factors are.
        first: Index of the first of these.
        rows: Number of rows.
        sums: Receives the sum of each row.
        columns: Receives the sums over rows, `PART` of them.

    Returns:
        The sum of all.
    """

    def built(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data, by, out, across = (_data(context, builder, signature, given, i) for i in (0, 1, 4, 5))
        total = alloca_once(builder, _FLOAT)
        builder.store(_FLOAT(0.0), total)

        def row(m: Any, column: Any) -> Any:
            at = builder.mul(m, _number(PART))
            factor = _load(builder, by, builder.add(given[2], at), PART)
            product = builder.fmul(_load(builder, data, at, PART), factor)
            _store(builder, product, data, at)
            sum_ = _total(builder, product)
            builder.store(sum_, builder.gep(out, [m]))
            builder.store(builder.fadd(builder.load(total), sum_), total)
            return builder.fadd(column, product)

        _store(builder, _repeat(builder, given[3], _zeros(PART), row), across, _number(0))
        return builder.load(total)

    integer = types.int64
    return types.float64(values, factors, integer, integer, sums, columns), built


@_intrinsic
def sum_rows(_: Any, values: Any, first: Any, rows: Any, length: Any, sums: Any) -> Any:
    """Adds up rows of numbers.

    Args:
        values: Where the numbers are.
        first: Index of the first of them.
        rows: Number of rows.
        length: Numbers in each.
        sums: Receives the sums, `length` of them.
    """

    def built(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data, out = (_data(context, builder, signature, given, i) for i in (0, 4))
        _, start, n, size, _ = given

        def part(offset: Any, width: int, nothing: Any) -> Any:
            begin = builder.add(start, offset)

            def row(m: Any, sum_: Any) -> Any:
                return builder.fadd(sum_, _load(builder, data, builder.add(begin, builder.mul(m, size)), width))

            _store(builder, _repeat(builder, n, _zeros(width), row), out, offset)
            return nothing

        _parts(builder, size, True, _number(0), part)
        return context.get_dummy_value()

    integer = types.int64
    return types.void(values, integer, integer, integer, sums), built


@_intrinsic
def largest(_: Any, values: Any, length: Any) -> Any:
    """Index of the largest of some numbers that are not negative, the first of equal ones.

    Args:
        values: The numbers, followed by zeros up to a multiple of `PART`.
        length: Numbers without these zeros, at least 1.
    """

    def built(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        data, parts = _data(context, builder, signature, given, 0), _number_of_parts(builder, given[1])

        def larger(k: Any, most: Any) -> Any:
            return _larger(builder, _load(builder, data, builder.mul(k, _number(PART)), PART), most)

        most = _folded(builder, _repeat(builder, parts, _zeros(PART), larger), _larger)
        everywhere = builder.shuffle_vector(
            builder.insert_element(_zeros(PART), most, _LANE(0)), _zeros(PART), _lanes([0] * PART)
        )
        before, searching, found = builder.block, *(builder.append_basic_block() for _ in range(2))
        builder.branch(searching)
        builder.position_at_end(searching)
        at = builder.phi(_WORD)
        equal = builder.fcmp_ordered("==", _load(builder, data, at, PART), everywhere)
        mask = builder.bitcast(equal, ir.IntType(PART))
        at.add_incoming(_number(0), before)
        at.add_incoming(builder.add(at, _number(PART)), searching)
        builder.cbranch(builder.icmp_unsigned("==", mask, mask.type(0)), searching, found)
        builder.position_at_end(found)
        return builder.add(at, builder.cttz(builder.zext(mask, _WORD), ir.IntType(1)(1)))

    return types.int64(values, types.int64), built


@_intrinsic
def copy(_: Any, target: Any, to: Any, source: Any, first: Any, length: Any) -> Any:
    """Copies numbers of 64 bits from index `first` of a source to index `to` of a target that is not the same run."""

    def built(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        out, data = (_data(context, builder, signature, given, i) for i in (0, 2))

        def part(offset: Any, width: int, nothing: Any) -> Any:
            value = _load(builder, data, builder.add(given[3], offset), width)
            _store(builder, value, out, builder.add(given[1], offset))
            return nothing

        _parts(builder, given[4], True, _number(0), part)
        return context.get_dummy_value()

    integer = types.int64
    return types.void(target, integer, source, integer, integer), built


@_intrinsic
def flat(_: Any, values: Any) -> Any:
    """The numbers of an array as a run, without the cost of `reshape`; it must not outlive the array."""
    run = types.Array(values.dtype, 1, "C")
    if values.layout != "C":
        raise TypingError("The numbers of this array do not lie side by side.")

    def built(context: Any, builder: Any, _: Any, given: Any) -> Any:
        whole, made = context.make_array(values)(context, builder, given[0]), context.make_array(run)(context, builder)
        size = whole.itemsize
        populate_array(made, whole.data, (whole.nitems,), (size,), size, None)
        return made._getvalue()

    return run(values), built


@_intrinsic
def random_blocks(_: Any, words: Any, first: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> Any:
    """`seeds.philox` for `BLOCKS` counters in a row, all in vector instructions.

    Args:
        words: Receives the words, `PER_BLOCK` x `BLOCKS` of them: word w of block b at index w `BLOCKS` + b.
        first: Counter of the first block.
        c1: The other counter words, as in `seeds.philox`.
        c2: Likewise.
        c3: Likewise.
        k0: The key words.
        k1: Likewise.
    """

    def built(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        out = _data(context, builder, signature, given, 0)
        vector = ir.VectorType(_WORD, BLOCKS)

        def spread(word: Any) -> "_Words":
            one = builder.insert_element(ir.Constant(vector, [0] * BLOCKS), word, _LANE(0))
            return _Words(builder, builder.shuffle_vector(one, one, _lanes([0] * BLOCKS)))

        counters = spread(given[1]) + _Words(builder, ir.Constant(vector, list(range(BLOCKS))))
        for w, found in enumerate(philox(counters, *map(spread, given[2:]))):
            _store(builder, found.value, out, _number(w * BLOCKS))
        return context.get_dummy_value()

    word = types.uint64
    return types.void(words, word, word, word, word, word, word), built


WORDS = PER_BLOCK * BLOCKS
"""Words of one call of `random_blocks`."""


class _Words:
    """Words of a vector, for functions written for arrays."""

    def __init__(self, builder: Any, value: Any) -> None:
        self._builder, self.value = builder, value

    def _with(self, operation: str, other: Any) -> "_Words":
        value = (
            other.value
            if isinstance(other, _Words)
            else ir.Constant(self.value.type, [int(other)] * self.value.type.count)
        )
        return _Words(self._builder, getattr(self._builder, operation)(self.value, value))

    def __add__(self, other: Any) -> "_Words":
        return self._with("add", other)

    def __mul__(self, other: Any) -> "_Words":
        return self._with("mul", other)

    def __xor__(self, other: Any) -> "_Words":
        return self._with("xor", other)

    def __and__(self, other: Any) -> "_Words":
        return self._with("and_", other)

    def __rshift__(self, other: Any) -> "_Words":
        return self._with("lshr", other)

    __rmul__ = __mul__


def _data(context: Any, builder: Any, signature: Any, given: Any, i: int) -> Any:
    """Pointer to the first number of an array."""
    return context.make_array(signature.args[i])(context, builder, given[i]).data


def _number(value: int) -> Any:
    return _WORD(value)


def _zeros(width: int) -> Any:
    return ir.Constant(ir.VectorType(_FLOAT, width), [0.0] * width)


def _lanes(order: Sequence[int]) -> Any:
    return ir.Constant(ir.VectorType(_LANE, len(order)), list(order))


def _load(builder: Any, data: Any, at: Any, width: int) -> Any:
    kind = ir.VectorType(data.type.pointee, width)
    return builder.load(builder.bitcast(builder.gep(data, [at]), kind.as_pointer()), align=8)


def _store(builder: Any, value: Any, data: Any, at: Any) -> None:
    builder.store(value, builder.bitcast(builder.gep(data, [at]), value.type.as_pointer()), align=8)


def _widened(builder: Any, value: Any) -> Any:
    """A vector followed by zeros up to `PART`."""
    width = value.type.count
    if width == PART:
        return value
    return builder.shuffle_vector(value, _zeros(width), _lanes([min(i, width) for i in range(PART)]))


def _folded(builder: Any, value: Any, combined: Callable[[Any, Any, Any], Any]) -> Any:
    """The numbers of a vector combined to one."""
    width = value.type.count
    while width > 1:
        width //= 2
        halves = (builder.shuffle_vector(value, value, _lanes(range(first, first + width))) for first in (0, width))
        value = combined(builder, *halves)
    return builder.extract_element(value, _LANE(0))


def _total(builder: Any, value: Any) -> Any:
    return _folded(builder, value, lambda builder, a, b: builder.fadd(a, b))


def _larger(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


def _number_of_parts(builder: Any, length: Any) -> Any:
    return builder.udiv(builder.add(length, _number(PART - 1)), _number(PART))


def _parts(builder: Any, length: Any, tail: bool, carried: Any, part: Callable[[Any, int, Any], Any]) -> Any:
    """Runs `part(offset, width, carried)` for each part of a run, and returns what it carried last.

    Args:
        builder: Of the code.
        length: Numbers of the run.
        tail: Whether it may be no multiple of `PART`.
        carried: Given to the first part.
        part: Returns what is given to the next.
    """
    whole = builder.udiv(length, _number(PART))
    carried = _repeat(builder, whole, carried, lambda k, value: part(builder.mul(k, _number(PART)), PART, value))
    offset = builder.mul(whole, _number(PART))
    for width in _TAILS if tail else ():
        there = builder.and_(length, _number(width))
        kept, at = carried, offset
        carried = _choose(
            builder,
            builder.icmp_unsigned("!=", there, _number(0)),
            lambda at=at, width=width, kept=kept: part(at, width, kept),
            lambda kept=kept: kept,
        )
        offset = builder.add(offset, there)
    return carried


def _repeat(builder: Any, times: Any, carried: Any, body: Callable[[Any, Any], Any]) -> Any:
    """Runs `body(i, carried)` so many times, and returns what it carried last."""
    before, loop, behind = builder.block, *(builder.append_basic_block() for _ in range(2))
    builder.cbranch(builder.icmp_unsigned("==", times, _number(0)), behind, loop)
    builder.position_at_end(loop)
    i, value = builder.phi(_WORD), builder.phi(carried.type)
    made = body(i, value)
    next_ = builder.add(i, _number(1))
    for phi, first, later in ((i, _number(0), next_), (value, carried, made)):
        phi.add_incoming(first, before)
        phi.add_incoming(later, builder.block)
    last = builder.block
    builder.cbranch(builder.icmp_unsigned("<", next_, times), loop, behind)
    builder.position_at_end(behind)
    found = builder.phi(carried.type)
    found.add_incoming(carried, before)
    found.add_incoming(made, last)
    return found


def _choose(builder: Any, condition: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
    """The value of one of two pieces of code."""
    branches, end = [builder.append_basic_block() for _ in range(2)], builder.append_basic_block()
    builder.cbranch(condition, *branches)
    values = []
    for block, made in zip(branches, (then, otherwise), strict=True):
        builder.position_at_end(block)
        values.append((made(), builder.block))
        builder.branch(end)
    builder.position_at_end(end)
    found = builder.phi(values[0][0].type)
    for value in values:
        found.add_incoming(*value)
    return found
