"""Model of gains and offsets that vary between taps, between sessions, and between classes within a session.

A tap `i` of class `c` in session `r` is the mean tap of its class times a gain plus an offset. Both have the parts

    value[i] = level[c] + common[r] + mounting[r, c] + tap[i] + error[i]

of which all but the level, which is flat, are normal around 0. The variance of the error is known: it is what noise of
single taxels makes of the value of one tap. `common` is what a session does to all classes alike, `mounting` what it
does to one class.

Nothing but the three standard deviations is drawn. Levels, sessions, mountings and taps are integrated out, and what is
left of the taps is the mean of each (session, class) cell and its sum of squares, which together are sufficient; so
the work does not grow with the number of taps. Searle, Casella and McCulloch, "Variance components" (1992), ch. 3, 6.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax.scipy.linalg import solve_triangular
from numpy.typing import NDArray

COMPONENTS = ("session", "mounting", "tap")
"""Components of variance: between sessions, between classes of a session, between taps."""

PRIOR_SD = 0.2
"""Scale of the half-normal priors of all components: about 20% for gains, 20% of the signal for offsets."""


class GainCells(NamedTuple):
    """Sufficient statistics of values of taps in R sessions and C classes.

    Attributes:
        taps: How many, shape (R, C); cells may be empty.
        mean: Mean of the values of the taps of a cell, shape (Q, R, C) for Q quantities; 0 in an empty cell.
        square: Sum of squared deviations from it, shape (Q, R, C).
        error: Variance of the error of a single tap of the cell, shape (Q, R, C).
    """

    taps: NDArray[Any]
    mean: NDArray[Any]
    square: NDArray[Any]
    error: NDArray[Any]


def components(cells: GainCells) -> None:
    """Standard deviations between sessions, between classes of a session, and between taps."""
    sd: dict[str, Any] = {}
    with numpyro.plate("quantity", len(cells.mean)):
        for name in COMPONENTS:
            sd[name] = numpyro.sample(name, dist.HalfNormal(PRIOR_SD))
    tap_variance = sd["tap"][:, None, None] ** 2 + cells.error
    variance = sd["mounting"][:, None, None] ** 2 + tap_variance / jnp.maximum(cells.taps, 1)
    numpyro.factor("mean", means_log_density(cells.mean, cells.taps > 0, sd["session"], variance).sum())
    freedom = cells.taps - 1.0
    squares = dist.Gamma(jnp.maximum(freedom, 1) / 2, 0.5 / tap_variance).mask(freedom > 0)
    numpyro.sample("square", squares, obs=jnp.where(freedom > 0, cells.square, 1.0))


def means_log_density(mean: Any, present: Any, session_sd: Any, variance: Any) -> Any:
    """Log density of cell means up to a constant, with levels and session effects integrated out.

    Given the parts common to the sessions, what is left of a class under a flat level is quadratic in them; so they are
    integrated out by completing a square of R by R.

    Args:
        mean: Shape (Q, R, C).
        present: Which cells have a tap, shape (R, C).
        session_sd: Standard deviation of what is common to a session, shape (Q,).
        variance: Variance of a cell mean around level and session, shape (Q, R, C).

    Returns:
        Shape (Q,).
    """
    precision = jnp.where(present, 1 / variance, 0.0)
    total = jnp.where(present.any(axis=0), precision.sum(axis=1), 1.0)
    level = (precision * mean).sum(axis=1) / total
    residual = mean - level[:, None]
    quadratic = (precision * residual**2).sum(axis=(1, 2))
    linear = (precision * residual).sum(axis=2)
    R = mean.shape[1]
    matrix = jnp.eye(R) * precision.sum(axis=2)[:, None] - jnp.einsum(
        "qrc,qsc->qrs", precision / total[:, None], precision
    )
    root = jnp.linalg.cholesky(jnp.eye(R) + session_sd[:, None, None] ** 2 * matrix)
    explained = (session_sd[:, None] * solve_triangular(root, linear[..., None], lower=True)[..., 0]) ** 2
    normaliser = jnp.where(present, jnp.log(variance), 0.0).sum(axis=(1, 2)) + jnp.log(total).sum(axis=1)
    determinant = 2 * jnp.log(jnp.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    return -0.5 * (quadratic - explained.sum(axis=1) + normaliser + determinant)
