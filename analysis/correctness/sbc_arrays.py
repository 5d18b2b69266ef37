"""Many simulated episodes at once with the array code of the Monte Carlo, every tap drawn anew; see `sbc`.

What `inference.trials.gpu` does to one belief is done here to all of them, tap by tap. It is the fastest way to beliefs
over all classes, which whole trials do not return.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from ...hardware.simulator.model_rig import BinTables, bin_tables
from ...inference.engines.compiled import border_number
from ...inference.moves.control import default_fixation
from ...inference.trials import gpu as device
from .sbc_chain import PASSIVE, Beliefs, Checkpoints, World, empty_beliefs

_ROWS = 64  # the least number of rows that is compiled for

_update = jax.jit(jax.vmap(device.update))


@partial(jax.jit, static_argnums=2)
def _shift(log_belief: jax.Array, delta: jax.Array, border: int) -> jax.Array:
    return jax.vmap(partial(device.shift, border=border))(log_belief, delta)


def array_beliefs(
    world: World,
    policy: str,
    trials: int,
    moments: Checkpoints,
    generator: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> Beliefs:
    """Episodes side by side; arguments as of `sbc_chain.engine_beliefs`."""
    truth, (L, M) = world.truth, world.truth.grid.shape
    tables = bin_tables(truth.probabilities, truth.edges, (L, M))
    found = empty_beliefs(trials, moments, (L, M))
    found.what[:] = generator.integers(M, size=trials)
    open_, where = np.arange(trials), generator.integers(L, size=trials)
    noted = np.zeros(found.where.shape, dtype=bool)
    log_belief = np.broadcast_to(world.believed.log_prior, (trials, L, M))
    for number in range(1, moments.deadline + 1):
        taps = draw(tables, where, found.what[open_], truth.preprocessing.samples, generator)
        log_belief = _padded(lambda *parts: _update(*parts)[0], log_belief, world.believed.log_likelihood(taps))
        belief = np.exp(log_belief)
        new = moments.reached(number, belief) & ~noted[open_]
        row, w = np.nonzero(new)
        i = open_[row]
        found.belief[i, w], found.where[i, w], found.taps[i, w] = belief[row], where[row], number
        noted[i, w] = True
        left = ~noted[open_].all(axis=1)
        if progress is not None:
            progress(int((~left).sum()))
        open_, where, log_belief, belief = open_[left], where[left], log_belief[left], belief[left]
        if not len(open_):
            break
        if policy != PASSIVE:
            delta = default_fixation(L) - belief.sum(axis=2).argmax(axis=1)
            log_belief = _padded(partial(_shift_by, border_number(world.border)), log_belief, delta)
            where = np.clip(where + delta, 0, L - 1)
    return found


def draw(
    tables: BinTables, where: NDArray[np.intp], what: NDArray[np.intp], samples: int, generator: np.random.Generator
) -> NDArray[np.float64]:
    """A tap of `samples` samples of each class (n,), shape (n, J, K)."""
    uniform = generator.random((len(where), samples, len(tables.centre)))
    taps = np.empty_like(uniform)
    M = tables.cumulative.shape[1]
    cell = where * M + what
    for c in np.unique(cell):
        own = cell == c
        taps[own] = tables.values(int(c) // M, int(c) % M, uniform[own])
    return taps


def _shift_by(border: int, log_belief: jax.Array, delta: jax.Array) -> jax.Array:
    return _shift(log_belief, delta, border)


def _padded(of: Callable[..., Any], *parts: NDArray[Any]) -> NDArray[np.float64]:
    """What a compiled function makes of rows, filled up to one of few sizes, as it is compiled anew for each."""
    n = len(parts[0])
    size = _ROWS
    while size < n:
        size *= 4
    rows = np.minimum(np.arange(size), n - 1)
    with jax.enable_x64(True):
        return np.asarray(of(*(part[rows] for part in parts)))[:n]
