"""Taps of a grid whose classes all have as many, told better than by chance."""

import numpy as np
from solidtouch.inference.trials.records import TapTable
from solidtouch.models.grid import tap_pool


def even_table(L: int, M: int, repeats: int, seed: int = 0, skill: float = 1.0, states: int = 1) -> TapTable:
    """Random log-likelihoods, those of the tap's own class raised by `skill`, in every state."""
    rng = np.random.default_rng(seed)
    where, what, _ = (index.ravel() for index in np.indices((L, M, repeats)))
    log_likelihood = rng.normal(size=(len(where), L, states * M))
    for s in range(states):
        log_likelihood[np.arange(len(where)), where, s * M + what] += skill
    return TapTable(log_likelihood, tap_pool(where, what, (L, M)), np.full((L, states * M), -np.log(L * M * states)))
