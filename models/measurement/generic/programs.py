"""Programs of fits, compiled once for all functions and taps from which JAX makes the same program."""

from collections.abc import Callable
from hashlib import blake2b
from typing import Any

import jax
from numpyro.primitives import Messenger

_KEPT: dict[Any, Any] = {}
_MOST = 64  # programs that are kept, the latest


class compiled_once:  # noqa: N801 - a decorator
    """Compiled function of arrays, whose shapes are those of the first call.

    Unlike those of `jax.jit`, programs are shared by functions that do the same, such as fits of folds of equal size:
    constants within a function are part of its program.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._program: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Result of the function."""
        if self._program is None:
            # Without unused arguments the text would not tell which ones are used, nor their shapes.
            lowered = jax.jit(self._function, keep_unused=True).lower(*arguments)
            text = blake2b(lowered.as_text().encode()).digest()
            key = text, lowered.in_tree, lowered.out_tree, jax.config.jax_default_device
            found = _KEPT.pop(key, None) or lowered.compile()
            _KEPT[key] = found
            while len(_KEPT) > _MOST:
                del _KEPT[next(iter(_KEPT))]
            self._program = found
        return self._program(*arguments)

    def __reduce__(self) -> tuple[Any, ...]:
        return compiled_once, (self._function,)


class OfOne(Messenger):
    """Handler that makes arrays of one number, where all plates have one element, the numbers that funsor expects."""

    def process_message(self, msg: dict[str, Any]) -> None:
        """Reshapes what is made a funsor."""
        if msg["type"] == "to_funsor" and not msg["kwargs"]["dim_to_name"]:
            msg["args"] = (jax.numpy.reshape(msg["args"][0], ()),)
