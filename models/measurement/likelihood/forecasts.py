"""Predictive log probability of new taps with parameters integrated out, shared by several models."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..fits.cells import Cells
from .forms import GaussianForm, bin_gaps
from .interval_probability import log_student_probability
from .shapes import Measure, Parameters
from .true_class import Own

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
    samples, below, above = bin_gaps(taps, edges)
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
