"""Model of gains and offsets that vary between taps, between sessions, and between classes within a session.

A tap `i` of class `c` in session `r` is the mean tap of its class times a gain plus an offset. Both have the parts

    value[i] = level[c] + common[r] + mounting[r, c] + tap[i] + error[i]

of which all but the level, which is flat, are normal around 0. The variance of the error is known: it is what noise of
single taxels makes of the value of one tap. `common` is what a session does to all classes alike, `mounting` what it
does to one class. The three standard deviations have half-normal priors.

Levels, sessions, mountings and taps are integrated out, and what is left of the taps is the mean of each
(session, class) cell and its sum of squares, which together are sufficient; so the work does not grow with the number
of taps. Searle, Casella and McCulloch, "Variance components" (1992), ch. 3, 6. The posterior of the three standard
deviations of a quantity is on a grid, by the trapezoidal rule, which is exact to rounding for smooth densities that
vanish at the ends or are even there (Trefethen and Weideman, SIAM Review 56, 2014, 385).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

COMPONENTS = ("session", "mounting", "tap")
"""Components of variance: between sessions, between classes of a session, between taps."""

PRIOR_SD = 0.2
"""Scale of the half-normal priors of all components: about 20% for gains, 20% of the signal for offsets."""

POINTS = 65
"""Of the grid, for each component."""
_COARSE = 17, 33  # points while the posterior is being found
_DROP = 12.0  # of the log density from its largest value, beyond which the posterior is left out
_ZOOM = 0.8  # a range that is narrowed less is found
_FINEST = 1e-9  # standard deviations below it are as good as 0; the grid is even below and logarithmic above
_LARGEST = 1e3 * PRIOR_SD
_CLOSE = 0.01  # of the spread: by how much a grid of every second point may differ


class GainCells(NamedTuple):
    """Sufficient statistics of values of taps in R sessions and C classes.

    Attributes:
        taps: How many, shape (R, C); cells may be empty.
        mean: Mean of the values of the taps of a cell, shape (Q, R, C) for Q quantities; 0 in an empty cell.
        square: Sum of squared deviations from it, shape (Q, R, C).
        error: Variance of the error of a single tap of the cell, shape (Q, R, C); above 0.
    """

    taps: NDArray[np.integer]
    mean: NDArray[np.float64]
    square: NDArray[np.float64]
    error: NDArray[np.float64]

    @property
    def told(self) -> tuple[bool, bool, bool]:
        """Which `COMPONENTS` the taps can tell of at all; the others are taken to be 0."""
        several = bool(((self.taps > 0).sum(axis=0) > 1).sum() > 1)
        return several, several, bool((self.taps > 1).any())


class GainPosterior(NamedTuple):
    """Posterior of the standard deviations of one quantity.

    Attributes:
        sd: Values of each of `COMPONENTS` on the grid, ascending.
        weight: Their probabilities, shape (len(sd[0]), len(sd[1]), len(sd[2])), sum 1.
        converged: Whether a grid of half as many points gives the same means and spreads.
    """

    sd: list[NDArray[np.float64]]
    weight: NDArray[np.float64]
    converged: bool

    def marginal(self, component: int) -> NDArray[np.float64]:
        """Probabilities of the values of one component."""
        return _marginal(self.weight, component)


def gain_posteriors(cells: GainCells) -> list[GainPosterior]:
    """The posterior of each quantity."""
    return [_posterior(cells, quantity) for quantity in range(len(cells.mean))]


def log_density(cells: GainCells, quantity: int, sd: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Log density of prior and values of one quantity, up to a constant, with levels and effects integrated out.

    Given the parts common to the sessions, what is left of a class under a flat level is quadratic in them; so they are
    integrated out by completing a square of R by R, whose eigenvectors do for all standard deviations of sessions.

    Args:
        cells: Of all quantities.
        quantity: Index of the quantity.
        sd: Standard deviations, of lengths S, M and T for `COMPONENTS`.

    Returns:
        Shape (S, M, T), of all their combinations.
    """
    session, mounting, tap = (np.asarray(values, dtype=np.float64) for values in sd)
    mean, square, error = cells.mean[quantity], cells.square[quantity], cells.error[quantity]
    present, freedom = cells.taps > 0, np.maximum(cells.taps - 1, 0)
    tap_variance = tap[:, None, None] ** 2 + error
    within = np.where(freedom > 0, freedom * np.log(tap_variance) + square / tap_variance, 0.0).sum(axis=(1, 2))
    ratio = (session**2)[:, None, None]
    found = np.empty((len(session), len(mounting), len(tap)))
    for index, value in enumerate(mounting):
        variance = value**2 + tap_variance / np.maximum(cells.taps, 1)
        precision = np.where(present, 1 / variance, 0.0)
        total = np.where(present.any(axis=0), precision.sum(axis=1), 1.0)
        weighted = precision * (mean - ((precision * mean).sum(axis=1) / total)[:, None])
        quadratic = (weighted**2 * variance).sum(axis=(1, 2))
        normaliser = np.where(present, np.log(variance), 0.0).sum(axis=(1, 2)) + np.log(total).sum(axis=1)
        matrix = -(precision / total[:, None]) @ precision.swapaxes(1, 2)
        diagonal = np.arange(len(mean))
        matrix[:, diagonal, diagonal] += precision.sum(axis=2)
        roots, vectors = np.linalg.eigh(matrix)
        projected = (weighted.sum(axis=2)[:, None] @ vectors)[:, 0] ** 2
        spread = ratio * np.maximum(roots, 0.0)
        between = (np.log1p(spread) - ratio * projected / (1 + spread)).sum(axis=2)
        found[:, index] = -0.5 * (quadratic + normaliser + within + between)
    prior = [-0.5 * (values / PRIOR_SD) ** 2 for values in (session, mounting, tap)]
    return found + prior[0][:, None, None] + prior[1][:, None] + prior[2]


def _posterior(cells: GainCells, quantity: int) -> GainPosterior:
    ends = np.array([[0.0, _LARGEST] if told else [0.0, 0.0] for told in cells.told])
    scale = np.full(len(COMPONENTS), _FINEST)
    for points in _COARSE:
        ends, scale = _found(cells, quantity, ends, scale, points)
    sd = _grid(ends, scale, POINTS)
    log_weight = _log_weight(cells, quantity, sd, scale)
    for axis, values in enumerate(sd):
        if len(values) > 1:
            log_weight[_at(axis, [0, -1])] -= np.log(2)
    weight = np.exp(log_weight - log_weight.max())
    coarse = weight[::2, ::2, ::2]  # its ends have half the weight too
    moments = [
        [_moments(values[::step], _marginal(part, axis)) for axis, values in enumerate(sd)]
        for part, step in ((weight, 1), (coarse, 2))
    ]
    (mean, spread), (other_mean, other_spread) = (np.transpose(each) for each in moments)
    gap = np.maximum(np.abs(mean - other_mean), np.abs(spread - other_spread))
    return GainPosterior(sd, weight / weight.sum(), bool((gap <= _CLOSE * spread).all()))


def _found(
    cells: GainCells, quantity: int, ends: NDArray[np.float64], scale: NDArray[np.float64], points: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the posterior is, as far as a grid of so many points shows it: ends and a scale of each component."""
    width = np.inf
    while (np.ptp(ends, axis=1) < _ZOOM * width).any():
        width, sd = np.ptp(ends, axis=1), _grid(ends, scale, points)
        log_weight = _log_weight(cells, quantity, sd, scale)
        weight, ends = np.exp(log_weight - log_weight.max()), _narrowed(log_weight, sd)
        low = np.array([_low(values, _marginal(weight, axis)) for axis, values in enumerate(sd)])
        scale = np.maximum(low, _FINEST)
    return ends, scale


def _grid(ends: NDArray[np.float64], scale: NDArray[np.float64], points: int) -> list[NDArray[np.float64]]:
    """Standard deviations of each component, at even steps of their inverse hyperbolic sine in units of a scale."""
    return [
        unit * np.sinh(np.linspace(np.arcsinh(low / unit), np.arcsinh(high / unit), points if high > low else 1))
        for (low, high), unit in zip(ends, scale, strict=True)
    ]


def _log_weight(
    cells: GainCells, quantity: int, sd: list[NDArray[np.float64]], scale: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Log density at points of a grid, times the distance between points."""
    found = log_density(cells, quantity, sd)
    for axis, (values, unit) in enumerate(zip(sd, scale, strict=True)):
        found += np.log(np.hypot(values, unit))[_along(axis)]
    return found


def _narrowed(found: NDArray[np.float64], sd: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """The range of each axis outside which the density is negligible, were it a parabola between the points."""
    top = np.unravel_index(found.argmax(), found.shape)
    drop = _DROP
    for axis, values in enumerate(sd):
        if len(values) > 1:
            line = found[(*top[:axis], slice(None), *top[axis + 1 :])]
            inner = min(max(int(top[axis]), 1), len(values) - 2)
            drop += 0.5 * abs(line[inner - 1] - 2 * line[inner] + line[inner + 1])
    ends = []
    for axis, values in enumerate(sd):
        others = tuple(other for other in range(len(sd)) if other != axis)
        kept = np.flatnonzero(found.max(axis=others) >= found.max() - drop)
        ends.append([values[max(kept[0] - 1, 0)], values[min(kept[-1] + 1, len(values) - 1)]])
    return np.array(ends)


def _marginal(weight: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    return weight.sum(axis=tuple(other for other in range(weight.ndim) if other != axis))


def _moments(values: NDArray[np.float64], weight: NDArray[np.float64]) -> tuple[float, float]:
    mean = np.average(values, weights=weight)
    return float(mean), float(np.sqrt(np.average((values - mean) ** 2, weights=weight)))


def _low(values: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    """The value below which a tenth of the posterior is."""
    cumulative = weight.cumsum()
    return float(values[np.searchsorted(cumulative, cumulative[-1] * 0.1)])


def _at(axis: int, index: list[int]) -> tuple[slice | list[int], ...]:
    return (*[slice(None)] * axis, index)


def _along(axis: int) -> tuple[slice | None, ...]:
    """Index that lays a vector along one of three axes."""
    return tuple(slice(None) if other == axis else None for other in range(3))
