"""Predictive log probability of new taps with parameters integrated out, shared by several models."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtr

from ...errors import InputError
from ..fits.cells import Cells
from ..fits.closed_form import once
from .bins import NOT_FINITE
from .forms import AT_ONCE, BinGaps, GaussianForm, bin_gaps
from .shapes import Measure, Parameters
from .true_class import Own


def log_normal_probability(lower: ArrayLike, upper: ArrayLike) -> NDArray[np.float64]:
    """Log probability of a standard normal between `lower` and `upper`, arrays that broadcast."""
    from .innovations import log_probabilities

    low, high = np.broadcast_arrays(np.asarray(lower, np.float64), np.asarray(upper, np.float64))
    out = np.empty(low.shape)
    log_probabilities(low.ravel(), high.ravel(), out.reshape(-1))
    return out


def log_student_probability(
    lower: ArrayLike, upper: ArrayLike, freedom: ArrayLike, which: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Log probability of Student's t, as `log_normal_probability`; for its error see `student_intervals`.

    Args:
        lower: Lower ends.
        upper: Upper ends.
        freedom: Degrees of freedom.
        which: Index of the degrees of freedom of each interval, if these are a list of different ones.
    """
    from .student_intervals import LEAST_FREEDOM, log_probabilities, tails

    if which is None:
        freedom, which = np.unique(np.asarray(freedom, dtype=np.float64), return_inverse=True)
    freedom = np.asarray(freedom)
    low, high, group = np.broadcast_arrays(np.asarray(lower, np.float64), np.asarray(upper, np.float64), which)
    if (freedom < LEAST_FREEDOM).any():
        return _log_probability(low, high, freedom[group])
    out = np.empty(low.shape)
    log_probabilities(low.ravel(), high.ravel(), group.ravel(), freedom, *tails(freedom), out.reshape(-1))
    return out


def _log_probability(
    lower: NDArray[np.float64], upper: NDArray[np.float64], freedom: NDArray[np.float64]
) -> NDArray[np.float64]:
    """`log_student_probability` by SciPy, for any degrees of freedom."""
    right = lower + upper > 0  # mirrored, because distribution functions are exact near 0 and not near 1
    low, high = np.where(right, -upper, lower), np.where(right, -lower, upper)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_high = np.log(stdtr(freedom, high))
        gap = np.log(stdtr(freedom, low)) - log_high
        return np.where(np.isneginf(log_high), -np.inf, log_high + np.log(-np.expm1(gap)))


DRAWS = 16
"""Number of draws of shared parameters."""


@dataclass(frozen=True, eq=False)
class Unseen:
    """Taps that did not train the model.

    Attributes:
        taps: Shape (N, J, K).
        edges: Edges of the bins.
        own: Their classes.
    """

    taps: NDArray[np.floating]
    edges: NDArray[np.float64]
    own: Own

    @cached_property
    def gaps(self) -> BinGaps:
        """See `bin_gaps`; the same for all draws."""
        return bin_gaps(self.taps, self.edges, may_miss=True)


class LeftOut(NamedTuple):
    """Log probability of training taps given all others, shape (N,) each.

    Attributes:
        integrated: Over the posterior of the parameters, exact given their prior.
        plug_in: At its mean; `None` where unknown.
    """

    integrated: NDArray[np.float64]
    plug_in: NDArray[np.float64] | None = None


def cells_integrated(
    form: Callable[[Parameters, Measure], GaussianForm],
    parameters: Parameters,
    cells: Cells,
    frame: Measure,
    unseen: Unseen,
) -> NDArray[np.float64]:
    """Log probability of the bins of taps, levels and variances of cells integrated out, shape (N,)."""
    variance = cells.b / cells.a * (1 + 1 / np.maximum(cells.strength, 1.0))
    return log_t_probability(form({**parameters, "variance": variance}, frame), 0, 2 * once(cells.a), unseen)


def cells_left_out(
    cells: Cells, frame: Measure, known: Unseen, least: NDArray[np.float64] | float = 0.0
) -> NDArray[np.float64]:
    """Log probability of training taps given all others, taken out of the posterior of their cells, shape (N,).

    Exact given the prior. NaN for a tap that is alone in a cell of flat level.

    Args:
        cells: Posterior given all training taps; samples are independent given the cells.
        frame: Units of the cells.
        known: Some of the training taps.
        least: Lower bound of the scales of forecasts, in the unit of the samples, broadcast to (K,).
    """
    samples, below, above = known.gaps
    centre, unit = frame.scaling
    samples, below, above, there = (samples - centre) / unit, below / unit, above / unit, ~np.isnan(known.taps)
    level, strength, a, b = (array[known.own].astype(np.float64) for array in cells)
    J = samples.shape[1]
    # Samples that share a cell go one by one, so that the first of a tap is predicted without the later ones.
    steps = [slice(None)] if level.shape[1] == J else [slice(j, j + 1) for j in reversed(range(J))]
    total = np.zeros(len(samples))
    with np.errstate(divide="ignore", invalid="ignore"):
        for step in steps:
            one = there[:, step]
            # From the level without the sample.
            gap = np.where(one, (samples[:, step] - level) * strength / (strength - 1), 0.0)
            level, strength, a = np.where(one, samples[:, step] - gap, level), strength - one, a - 0.5 * one
            b = np.maximum(b - 0.5 * strength / (strength + 1) * gap**2, np.finfo(float).eps * b)
            scale = np.maximum(np.sqrt(b / a * (1 + 1 / strength)), least / unit)
            lower, upper = (below[:, step] + gap) / scale, (above[:, step] + gap) / scale
            total += np.where(one, log_student_probability(lower, upper, 2 * a), 0.0).sum(axis=(1, 2))
    return total


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
    if not (form.independent or np.isfinite(unseen.taps).all()):
        raise InputError(NOT_FINITE)
    values, which = np.unique(freedom, return_inverse=True)
    which = np.broadcast_to(which, form.scale.shape[1:])
    total = np.empty(len(unseen.taps))
    for start in range(0, len(total), AT_ONCE):  # so that they stay in cache
        part = slice(start, start + AT_ONCE)
        samples, below, above = (each[part] for each in unseen.gaps)
        where, what = (each[part] for each in unseen.own)
        innovation, scale = form.innovations(samples, where, what, q), form.scale[q, where, what]
        lower, upper = (below + innovation) / scale, (above + innovation) / scale
        total[part] = log_student_probability(lower, upper, values, which[where, what]).sum(axis=(1, 2))
    return total


def log_student_vectors(form: GaussianForm, freedom: NDArray[np.float64], unseen: Unseen) -> NDArray[np.float64]:
    """Log probability of the bins of taps of one sample, with Student's t of K dimensions for the normal, shape (N,).

    As a chain: given the taxels before it each is Student's t, with a degree of freedom more for each of them and a
    scale that follows how far they were from what was expected.

    Args:
        form: Of one Gaussian, whose covariance becomes the scale of the t.
        freedom: Degrees of freedom of each hypothesis, shape (L, H).
        unseen: The taps.

    Raises:
        InputError: A sample is missing.
    """
    if not np.isfinite(unseen.taps).all():
        raise InputError(NOT_FINITE)
    (samples, below, above), own = unseen.gaps, unseen.own
    innovation, scale = np.empty(samples.shape), form.scale[0][own]
    for l, m in np.unique(np.stack(own), axis=1).T:  # with one matrix at a time, as they may be large
        members = np.flatnonzero((own[0] == l) & (own[1] == m))
        innovation[members] = form.innovations(samples[members], np.array([l]), np.array([m]))
    size = (innovation / scale) ** 2
    before = np.cumsum(size, axis=2) - size
    known = freedom[own][:, None, None] + np.arange(samples.shape[2])
    scale = scale * np.sqrt((freedom[own][:, None, None] + before) / known)
    return log_student_probability((below + innovation) / scale, (above + innovation) / scale, known).sum(axis=(1, 2))


def over_draws(one: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log of the mean probability over draws."""
    return log_mean([one() for _ in range(DRAWS)])


def log_mean(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log of the mean of exponentials."""
    return np.logaddexp.reduce(parts, axis=0) - np.log(len(parts))
