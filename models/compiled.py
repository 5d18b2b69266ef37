"""Loops compiled to machine code by numba, cached on disk if the cache folder is writable."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numba.core.typing.cffi_utils  # which numba would load with its first program, when commands no longer hide cffi
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic
from numpy.typing import ArrayLike

# Sums may be taken in another order and products fused, which vector instructions need; NaN and infinity stay exact.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "fastmath": {"reassoc", "contract", "nsz"},
    "error_model": "numpy",
    "no_cfunc_wrapper": True,  # nothing calls it, and it takes as long to compile as the one for Python
}
_intrinsic: Any = intrinsic


def compiled[F: Callable[..., Any]](function: F, *, in_order: bool = False) -> F:
    """Decorated function, compiled on its first call, that releases the interpreter's lock.

    Args:
        function: The function.
        in_order: Whether every operation is rounded as it stands, so that results are the same to the last bit wherever
            they are computed.
    """
    options: dict[str, Any] = _OPTIONS | {"fastmath": False} if in_order else _OPTIONS
    dispatcher: Any = numba.njit(**options)(function)
    with suppress(RuntimeError, OSError):  # no folder can be written, or there is no file
        dispatcher._cache = _Cache(function)
    return dispatcher


class _Cache(FunctionCache):
    """Machine code on disk, made again where it cannot be used.

    That is if it is damaged, if it is for types of a module that has moved, or if the file of the function or of one
    that it calls has changed.
    """

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        files = sorted({called.__code__.co_filename for called in _called(function)})
        self._cache_file._source_stamp = [(file, Path(file).stat().st_mtime_ns) for file in files]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # what the compiler knows besides takes a tenth of a second to load
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception:
            self.flush()
            return None


def _called(function: Any) -> Iterator[Any]:
    """A function and all compiled ones that it calls, directly or not."""
    yield function
    names = function.__code__.co_names
    known = {name: function.__globals__.get(name) for name in names}
    parts = [vars(module).get(name) for module in known.values() if isinstance(module, ModuleType) for name in names]
    for called in (*known.values(), *parts):
        inner = getattr(called, "py_func", None) or getattr(called, "_defn", None)
        if inner is not None:
            yield from _called(inner)


@_intrinsic
def ones(_: Any, word: Any) -> Any:
    """The number of bits of a word that are one, for compiled loops."""
    return word(word), lambda _context, builder, _signature, words: builder.ctpop(words[0])


@_intrinsic
def power_of_two(_: Any, exponent: Any) -> Any:  # noqa: ARG001 - named for its type alone
    """2 to a whole number from -1022 to 1023, for compiled loops that use vector instructions."""

    def built(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
        word = given[0].type
        biased = builder.add(given[0], ir.Constant(word, 1023))
        return builder.bitcast(builder.shl(biased, ir.Constant(word, 52)), ir.DoubleType())

    return types.float64(types.int64), built


def polynomial(coefficients: ArrayLike) -> Any:
    """Polynomial by Horner's rule, without a loop, for compiled loops that use vector instructions.

    Args:
        coefficients: Shape (degree + 1,), the highest power's first.
    """
    first, *others = (ir.Constant(ir.DoubleType(), float(value)) for value in np.asarray(coefficients))

    @_intrinsic
    def value(_: Any, x: Any) -> Any:  # noqa: ARG001 - named for its type alone
        def built(_context: Any, builder: Any, _signature: Any, given: Any) -> Any:
            total, fused = first, ("contract",)
            for coefficient in others:
                total = builder.fadd(builder.fmul(total, given[0], flags=fused), coefficient, flags=fused)
            return total

        return types.float64(types.float64), built

    return value
