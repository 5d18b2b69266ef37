"""Loops compiled to machine code by numba, cached on disk if the cache folder is writable."""

from collections.abc import Callable
from typing import Any

import numba
from numba.extending import intrinsic

# Sums may be taken in another order and products fused, which vector instructions need; NaN and infinity stay exact.
_OPTIONS: dict[str, Any] = {"nogil": True, "fastmath": {"reassoc", "contract", "nsz"}, "error_model": "numpy"}
_intrinsic: Any = intrinsic


def compiled[F: Callable[..., Any]](function: F) -> F:
    """Decorated function, compiled on its first call, that releases the interpreter's lock.

    Functions that call each other belong in one file: the copy on disk is not renewed when a callee elsewhere changes.
    """
    njit: Any = numba.njit
    try:
        return njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # neither beside the file nor in the user's cache folder can anything be written
        return njit(**_OPTIONS)(function)


@_intrinsic
def ones(_: Any, word: Any) -> Any:
    """The number of bits of a word that are one, for compiled loops."""
    return word(word), lambda _context, builder, _signature, words: builder.ctpop(words[0])
