"""Lines of mean taps of a session against those of all others, and what they leave unknown."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..scaling import Moments
from .priors import Taps

_FLAT = 0.1  # signal over noise below which taps say nothing of a gain


def live_taxels(extremes: NDArray[np.float64], session: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the taxels that say something of differences between sessions, shape (K,).

    Dead ones, which are constant in every session, do not, unless all are.
    """
    live = np.zeros(extremes.shape[2], dtype=bool)
    for number in np.unique(session):
        low, high = extremes[session == number].swapaxes(0, 1)
        live |= np.fmax.reduce(high, axis=0) > np.fmin.reduce(low, axis=0)
    return live if live.any() else ~live


class SessionLine(NamedTuple):
    """A session's mean taps against those of the others.

    Attributes:
        gain: Slope.
        offset: Difference of the means over all classes, times and taxels.
        level: Their mean in the others.
        signal: Variance of the others' mean taps without their noise.
        weights: Times the sums in `scatter` gives the sampling errors of slope and offset, shape (2, 2).
        scatter: Sum over taps of the products of two weighted sums of their deviations, shape (2, 2).
        freedom: Degrees of freedom of `scatter`.
    """

    gain: float
    offset: float
    level: float
    signal: float
    weights: NDArray[np.float64]
    scatter: NDArray[np.float64]
    freedom: float


def session_line(taps: Taps, every: Moments, live: NDArray[np.bool_]) -> SessionLine | None:
    """Line of a session by its live taxels; `None` without a class in both, or two taps in the others to tell noise."""
    this = Moments.of(taps)
    others = every.without(this)
    n, count = this.samples, others.samples
    used, freedom = (n > 0) & (count > 0), np.maximum(count - 1, 0).sum(axis=(0, 1)).mean()
    if not (used & live).any() or not freedom:
        return None
    square = others.square.sum(axis=(0, 1)).mean()
    noise = float(square / freedom * np.broadcast_to(1 / np.maximum(count, 1), used.shape).mean(where=used))
    used = np.broadcast_to(used & live, this.mean.shape)
    mean, rest = this.mean[used], others.mean[used]
    level, signal = float(rest.mean()), float(rest.var()) - noise
    flat = signal <= _FLAT * noise
    gain = 1.0 if flat else float(((mean - mean.mean()) * (rest - level)).mean()) / signal
    # Each tap adds to the sums by which slope and offset are found; its samples need not be independent.
    classes, number, rest_number = used.any(axis=(2, 3)), n.mean(axis=(2, 3)), count.mean(axis=(2, 3))
    whole = np.where(used, number[..., None, None] / np.maximum(n, 1), 0.0)
    sums = np.stack([whole * (others.mean - level), whole])

    def products(block: NDArray[np.float64], which: slice) -> NDArray[np.float64]:
        deviation = np.nan_to_num(this.residual(taps, block, which))
        own = taps.where[which], taps.what[which]
        each = np.stack([np.einsum("njk,njk->n", deviation, weight[own]) for weight in sums])
        return each @ each.T

    taken = (1 / number[classes] + 1 / rest_number[classes]).sum()
    scale = np.array([0.0 if flat else 1 / signal, 1.0]) * np.sqrt(taken) / used.sum()
    scatter = np.asarray(sum(taps.over_blocks(products)))
    freedom = float(np.maximum(number[classes] - 1, 0).sum())
    return SessionLine(gain, float(mean.mean()) - level, level, max(signal, 0.0), np.diag(scale), scatter, freedom)
