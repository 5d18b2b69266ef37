"""Classes about which a function says something, although none of their taps trained it."""

from collections.abc import Mapping
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .contract import StoryCall
from .runs import Program
from .structure import shapes_of


def known_classes(
    program: Program, latents: Mapping[str, NDArray[np.float64]], covered: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Mask of the classes of which all latent variables belong to classes with taps, shape (L, M).

    A function without latent variables of positions knows all positions, one without those of objects all objects.

    Args:
        program: The model.
        latents: Its latent variables, by name.
        covered: Classes with training taps, shape (L, M).
    """
    if covered.all():
        return covered
    where, what = (_with_axis(program, latents, axis) for axis in (0, 1))
    if where & what:
        return covered
    known = np.ones_like(covered)
    if where:
        known &= covered.any(axis=1, keepdims=True)
    if what:
        known &= covered.any(axis=0, keepdims=True)
    return known


def _with_axis(program: Program, latents: Mapping[str, NDArray[np.float64]], axis: int) -> set[str]:
    """Names of the latent variables that are others with one position (axis 0) or object (axis 1) more."""
    sessions, own = program.structure.by_session, {}
    for name, values in latents.items():
        shape = list(np.shape(values))
        if name in sessions:
            shape[sessions[name]] = 1
        own[name] = tuple(shape)
    try:
        more = shapes_of(program.story, _with_one_more(program.batch, axis))
    except InputError:  # its sizes are fixed
        return set(own)
    return set(own) if more.keys() != own.keys() else {name for name, shape in own.items() if more[name] != shape}


def _with_one_more(batch: StoryCall, axis: int) -> StoryCall:
    L, M, J, K = batch.shape
    with jax.enable_x64(True):
        if axis == 0:
            return replace(batch, shape=(L + 1, M, J, K), where_value=_one_more(batch.where_value))
        values = None if batch.what_value is None else _one_more(batch.what_value)
        return replace(batch, shape=(L, M + 1, J, K), what_value=values)


def _one_more(values: NDArray[np.float64] | None) -> jax.Array:
    found = jnp.asarray(values)
    return jnp.append(found, found[-1] + 1.0)
