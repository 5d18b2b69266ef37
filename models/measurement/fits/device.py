"""Devices that JAX computes on."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import jax

from ...errors import InputError


def jax_device(platform: str) -> Any:
    """The first device of a platform.

    Raises:
        InputError: JAX finds none.
    """
    try:
        return jax.devices(platform)[0]
    except RuntimeError as error:
        raise InputError("JAX finds no GPU; --device gpu requires one and a jax package built for it.") from error


@contextmanager
def on_device(platform: str) -> Iterator[None]:
    """Puts arrays and programs that JAX makes in this thread on the first device of a platform.

    Raises:
        InputError: JAX finds none.
    """
    if platform == jax.default_backend():  # JAX keeps programs by this choice, so they would be compiled again
        yield
        return
    with jax.default_device(jax_device(platform)):
        yield
