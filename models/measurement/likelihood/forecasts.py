"""Predictive log probability of new taps with parameters integrated out, shared by several models."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, stdtr

from ..fits.cells import Cells
from .forms import GaussianForm, bin_gaps
from .shapes import Measure, Parameters
from .true_class import Own


def log_normal_probability(lower: ArrayLike, upper: ArrayLike) -> NDArray[np.float64]:
    """Log probability of a standard normal between `lower` and `upper`, arrays that broadcast."""
    return _log_probability(lower, upper, log_ndtr)


def log_student_probability(lower: ArrayLike, upper: ArrayLike, freedom: ArrayLike) -> NDArray[np.float64]:
    """Log probability of Student's t with `freedom` degrees of freedom, as `log_normal_probability`."""

    def log_cdf(x: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(divide="ignore"):
            return np.log(stdtr(np.broadcast_to(freedom, x.shape), x))

    return _log_probability(lower, upper, log_cdf)


def _log_probability(lower: ArrayLike, upper: ArrayLike, log_cdf: Any) -> NDArray[np.float64]:
    lower, upper = np.broadcast_arrays(np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64))
    with np.errstate(invalid="ignore"):
        right = lower + upper > 0  # mirrored, because distribution functions are exact near 0 and not near 1
    low, high = np.where(right, -upper, lower), np.where(right, -lower, upper)
    log_high = log_cdf(high)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = log_cdf(low) - log_high
        return np.where(np.isneginf(log_high), -np.inf, log_high + np.log(-np.expm1(gap)))


DRAWS = 16
"""Number of draws of shared parameters."""


class Unseen(NamedTuple):
    """Taps that did not train the model.

    Attributes:
        taps: Shape (N, J, K).
        edges: Edges of the bins.
        own: Their classes.
    """

    taps: NDArray[np.floating]
    edges: NDArray[np.float64]
    own: Own


def cells_integrated(
    form: Callable[[Parameters, Measure], GaussianForm],
    parameters: Parameters,
    cells: Cells,
    frame: Measure,
    unseen: Unseen,
) -> NDArray[np.float64]:
    """Log probability of the bins of taps, levels and variances of cells integrated out, shape (N,)."""
    variance = cells.b / cells.a * (1 + 1 / np.maximum(cells.strength, 1.0))
    return log_t_probability(form({**parameters, "variance": variance}, frame), 0, 2 * cells.a, unseen)


def slopes_integrated(
    form: Callable[[Parameters, Measure], GaussianForm],
    posterior: Any,
    slopes: str,
    frame: Measure,
    unseen: Unseen,
    generator: np.random.Generator,
) -> NDArray[np.float64]:
    """As `cells_integrated`, averaged over draws of the slopes, given which cells are conjugate."""

    def one() -> NDArray[np.float64]:
        slope = posterior.draw(generator)[slopes]
        cells = posterior.cells(slope)
        return cells_integrated(form, {slopes: slope, **cells.point()}, cells, frame, unseen)

    return over_draws(one)


def log_t_probability(form: GaussianForm, q: int, freedom: NDArray[np.float64], unseen: Unseen) -> NDArray[np.float64]:
    """Log probability of the bins of taps, with Student's t for each normal of Gaussian `q`, shape (N,)."""
    taps, edges, own = unseen
    samples, below, above = bin_gaps(taps, edges, form.independent)
    innovation = form.innovations(samples, *own, q)
    scale = form.scale[q][own]
    freedom = np.broadcast_to(freedom, form.scale.shape[1:])[own]
    return log_student_probability((below + innovation) / scale, (above + innovation) / scale, freedom).sum(axis=(1, 2))


def over_draws(one: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log of the mean probability over draws."""
    return log_mean([one() for _ in range(DRAWS)])


def log_mean(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log of the mean of exponentials."""
    return np.logaddexp.reduce(parts, axis=0) - np.log(len(parts))
