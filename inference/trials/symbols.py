"""Taps of a fitted model quantised to a few symbols, for exact computations.

Taps drawn from the model are sorted into groups that say nearly the same about the class. The symbol of a tap is its
group, and the channel is how often each class gives each symbol among the very taps that trials are then played on: as
these draw from them with replacement, the channel is exactly right.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...hardware.simulator.model_rig import draw_session
from ...models.errors import InputError
from ...models.grid import tap_pool
from ...models.measurement.model import TapModel
from ...models.seeds import Purpose, generator
from .records import TapTable

type Floats = NDArray[np.float64]

_ROUNDS = 200  # of sorting; it ends by itself long before
_TINY = np.finfo(np.float64).tiny


class TapSymbols(NamedTuple):
    """Quantised taps, S symbols.

    Attributes:
        channel: P(symbol | class), shape (L, M, S).
        table: N taps to play on, as the channel sees them.
        kept: Information of a symbol about where and what, as a share of that of the tap; all classes as likely.
    """

    channel: Floats
    table: TapTable
    kept: float


def quantised(model: TapModel, symbols: int, seed: int, taps: int = 1000, starts: int = 1) -> TapSymbols:
    """Quantised taps drawn from a model.

    Groups are found as k-means finds them, with the relative entropy between what a tap and what its group say about
    the class in place of the distance; each round raises the information that is kept, and of several starts the one is
    taken that keeps most. There are fewer than asked for where the taps need no more.

    Args:
        model: Measurement model; it must be right about the taps that are drawn from it, so without the paper's root.
        symbols: How many, at most.
        seed: Random seed of the taps and the groups.
        taps: Number of taps per class.
        starts: From how many random groups to begin.

    Raises:
        InputError: Less than one symbol, tap or start is asked for, or a class of the model was not trained.
    """
    if symbols < 1 or starts < 1:
        raise InputError(f"symbols and starts must be at least 1, got {symbols} and {starts}.")
    if not model.trained.all():
        raise InputError("Symbols require a model with training taps in all classes.")
    session = draw_session(model, taps, seed)
    where, what = session.indices(model.grid)
    posterior = np.exp(model.log_likelihood(session.taps))
    L, M = model.grid.shape
    if posterior.shape[1:] != (L, M):
        raise InputError("Symbols require a model without states.")
    posterior = posterior.reshape(-1, L * M) / posterior.sum(axis=(1, 2))[:, np.newaxis]
    chance = generator(seed, Purpose.SYMBOLS)
    channels = []
    for _ in range(starts):
        symbol = _groups(posterior, symbols, chance)
        S = int(symbol.max()) + 1
        counts = np.bincount((where * M + what) * S + symbol, minlength=L * M * S).reshape(L, M, S)
        channel = counts / counts.sum(axis=-1, keepdims=True)
        channels.append((_kept(channel, posterior), channel, symbol))
    kept, channel, symbol = max(channels, key=lambda found: found[0])
    with np.errstate(divide="ignore"):
        log_likelihood = np.moveaxis(np.log(channel), -1, 0)[symbol]
    table = TapTable(log_likelihood, tap_pool(where, what, (L, M)), np.full((L, M), -np.log(L * M)))
    return TapSymbols(channel, table, kept)


def _groups(posterior: Floats, symbols: int, generator: np.random.Generator) -> NDArray[np.intp]:
    """Group of each tap from P(class | tap), shape (N, C); group numbers have no gaps."""
    mean = posterior[_spread_out(posterior, symbols, generator)]
    group = np.full(len(posterior), -1)
    for _ in range(_ROUNDS):
        nearest = (posterior @ np.log(np.maximum(mean, _TINY)).T).argmax(axis=1)
        _, nearest = np.unique(nearest, return_inverse=True)
        if np.array_equal(nearest, group):
            break
        group = nearest
        mean = np.array([posterior[group == number].mean(axis=0) for number in range(int(group.max()) + 1)])
    return group


def _spread_out(posterior: Floats, symbols: int, generator: np.random.Generator) -> list[int]:
    """Initial taps, each drawn in proportion to its distance from the previous ones, as in k-means++."""
    own = (posterior * np.log(np.maximum(posterior, _TINY))).sum(axis=1)
    chosen = [int(generator.integers(len(posterior)))]
    distance = np.full(len(posterior), np.inf)
    while len(chosen) < symbols:
        distance = np.minimum(distance, own - posterior @ np.log(np.maximum(posterior[chosen[-1]], 1e-9)))
        distance = np.maximum(distance, 0.0)
        if not distance.sum() > 0:
            break
        chosen.append(int(generator.choice(len(posterior), p=distance / distance.sum())))
    return chosen


def _kept(channel: Floats, posterior: Floats) -> float:
    """Information of symbols relative to that of taps, for uniform classes."""
    given = channel.reshape(-1, channel.shape[-1])
    symbol = given.mean(axis=0)
    of_symbols = (given * np.log(np.maximum(given, _TINY) / symbol)).sum() / len(given)
    of_taps = np.log(len(given)) + (posterior * np.log(np.maximum(posterior, _TINY))).sum(axis=1).mean()
    return float(of_symbols / of_taps) if of_taps > 0 else 1.0
