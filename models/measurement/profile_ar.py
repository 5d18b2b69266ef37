"""`profile-ar`: `profile` with each sample predicted from the previous one.

Given the slopes in time the cells have a posterior in closed form, so the slopes are summed over a fine grid.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .fits.cells import CELL, WEAK_CELLS, Cells, cell_posterior, estimated_prior, prior_of_cells
from .fits.posterior import EXACT_CELLS, Convergence, check_times
from .fits.priors import CellPrior, Taps
from .likelihood.forecasts import Unseen, slopes_integrated
from .likelihood.forms import GaussianForm
from .likelihood.shapes import NO_TAXEL, Measure, Parameters, chain_form
from .model import Row
from .scaling import Moments, class_sums
from .story import Story

_GRID, _REACH = 101, 8.0  # points, and standard deviations to either side of the mode
_END = (95 / 288, 317 / 240, 23 / 30, 793 / 720, 157 / 160)
_SHARE = np.array([*_END, *[1.0] * (_GRID - 2 * len(_END)), *_END[::-1]]) / (_GRID - 1)
"""Of the range, for each point: Gregory's rule, of order 6, as the posterior may end abruptly, at a slope of 1."""


def story(
    where: Any, what: Any, taps: Any = None, *, L: int, M: int, J: int, K: int, prior: CellPrior = WEAK_CELLS
) -> None:
    """Generative model: `profile` with each sample predicted from the previous one, with one slope per taxel.

    `prior` is that of the intercepts and of the variances.
    """
    from .fits.story_parts import cells, chain, dist, jnp, numpyro, plates

    with numpyro.plate("K", K, dim=-1):
        rho: Any = numpyro.sample("rho", dist.Uniform(-1.0, 1.0))
        with plates(("L", L, -4), ("M", M, -3), ("J", J, -2)):
            level, variance = cells(prior)
    own = where, what

    def given(taps: Any) -> Any:
        before = jnp.pad(taps, ((0, 0), (1, 0), (0, 0)))[:, :-1]
        return dist.Normal(level[own] + rho * before, jnp.sqrt(variance[own]))

    with plates(("tap", len(where), -3), ("time", J, -2), ("taxel", K, -1)):
        chain(given, taps, (len(where), J, K), J)


class ArPosterior(NamedTuple):
    """Posterior of slopes on a grid, and of cells given the slopes.

    Attributes:
        rho: Grid of slopes of each taxel, shape (K, G).
        weight: Their probabilities, shape (K, G).
        series: Sums from which the cells follow.
        prior: Prior of the cells.
    """

    rho: NDArray[np.float64]
    weight: NDArray[np.float64]
    series: "Series"
    prior: CellPrior

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected parameters, those of the cells at the expected slopes."""
        rho = (self.rho * self.weight).sum(axis=1)
        return {"rho": rho, **self.cells(rho).point()}

    def convergence(self) -> Convergence:
        """Convergence: always exact."""
        return EXACT_CELLS

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Draw of the parameters; slopes are uniform in the share of a grid point."""
        cumulative = self.weight.cumsum(axis=1)
        index = (cumulative < generator.random((len(self.rho), 1)) * cumulative[:, -1:]).sum(axis=1)
        share = np.append(0.0, _SHARE.cumsum())[index] + _SHARE[index] * generator.random(len(index))
        rho = self.rho[:, 0] + np.ptp(self.rho, axis=1) * share
        return {"rho": rho, **self.cells(rho).draw(generator)}

    def cells(self, rho: NDArray[np.float64]) -> Cells:
        """Posterior of the cells given the slopes, shape (K,)."""
        return self.series.cells(rho, self.prior)


class Series(NamedTuple):
    """Sufficient statistics for any slope in time, per class; shapes (L, M, J, K), except for the number of taps.

    Attributes:
        taps: How many, shape (L, M, 1, 1).
        mean: Mean of the samples.
        before: Mean of the samples before them, 0 for the first.
        square: Squared deviations.
        square_before: Those of the samples before.
        product: Products of both deviations.
    """

    taps: NDArray[np.float64]
    mean: NDArray[np.float64]
    before: NDArray[np.float64]
    square: NDArray[np.float64]
    square_before: NDArray[np.float64]
    product: NDArray[np.float64]

    @classmethod
    def of(cls, taps: Taps) -> "Series":
        """Statistics of training taps."""
        moments = Moments.of(taps)

        def products(block: NDArray[np.float64], which: Any) -> NDArray[np.float64]:
            residual = moments.residual(taps, block, which)
            product = np.zeros_like(residual)
            product[:, 1:] = residual[:, 1:] * residual[:, :-1]
            return product

        return cls(
            moments.taps[..., None, None],
            moments.mean,
            _delayed(moments.mean),
            moments.square,
            _delayed(moments.square),
            class_sums(taps, products),
        )

    def innovations(self, rho: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and squared deviations of samples minus slope times the previous one; rho has shape (K,)."""
        square = self.square - 2 * rho * self.product + rho**2 * self.square_before
        return self.mean - rho * self.before, np.maximum(square, 0.0)

    def cells(self, rho: NDArray[np.float64], prior: CellPrior) -> Cells:
        """Posterior of the cells given the slopes."""
        return cell_posterior(self.taps, *self.innovations(rho), prior)

    def log_evidence(self, rho: NDArray[np.float64], prior: CellPrior) -> NDArray[np.float64]:
        """Log probability of the samples of each taxel at slopes (K, G), up to a constant, shape (K, G)."""
        from .fits.slope_loops import log_evidence

        # Levels away from those that the prior expects act like a sample more.
        cells, gap = self.cells(rho[:, 0], prior), self.mean - prior.level
        weight = self.taps * prior.strength / np.maximum(prior.strength + self.taps, 1e-300)
        constant = self.square + weight * gap**2
        linear = self.product + weight * gap * self.before
        quadratic = self.square_before + weight * self.before**2
        K, out = len(rho), np.empty_like(rho)
        constant, linear, quadratic, shape = (
            np.ascontiguousarray(each).reshape(-1, K) for each in (constant, linear, quadratic, cells.a)
        )
        log_evidence(rho, constant, linear, quadratic, shape, np.broadcast_to(prior.b, K).astype(np.float64), out)
        return out


def fit(taps: Taps, prior: CellPrior | None = None) -> ArPosterior:
    """Exact posterior of `story`, given the prior of the variances."""
    series, K = Series.of(taps), taps.samples.shape[2]
    if prior is not None:
        return _on_grid(series, prior, K)
    rho = np.zeros(K)
    for _ in range(2):  # the prior of the variances and the slopes hardly depend on each other
        prior = estimated_prior(series.taps - 1, series.innovations(rho)[1])
        rho = _on_grid(series, prior, K).point()["rho"]
    return _on_grid(series, estimated_prior(series.taps - 1, series.innovations(rho)[1]), K)


def _on_grid(series: Series, prior: CellPrior, K: int) -> ArPosterior:
    """Grid of slopes over their probable range."""
    low, high = np.full((K, 1), -1.0), np.full((K, 1), 1.0)
    rho, weight = low, high
    for _ in range(4):
        rho = low + (high - low) * np.linspace(0, 1, _GRID)
        log_weight = series.log_evidence(rho, prior)
        weight = _SHARE * np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        centre = (rho * weight).sum(axis=1, keepdims=True)
        deviation = np.sqrt((weight * (rho - centre) ** 2).sum(axis=1, keepdims=True))
        reach = np.maximum(_REACH * deviation, rho[:, 1:2] - rho[:, :1])  # a narrow mode may lie between two points
        low, high = np.maximum(centre - reach, -1.0), np.minimum(centre + reach, 1.0)
    return ArPosterior(rho, weight, series, prior)


def _delayed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (..., J, K) delayed by one sample, 0 at first."""
    later = np.zeros_like(values)
    later[..., 1:, :] = values[..., :-1, :]
    return later


def form(parameters: Parameters, frame: Measure) -> GaussianForm:
    """Likelihood of bins under `story`: V is 1 on the diagonal and -rho below it."""
    level, rho = parameters["level"], parameters["rho"]
    J, K = level.shape[2:]
    time = np.tile(np.eye(J), (K, 1, 1))
    time[:, np.arange(1, J), np.arange(J - 1)] = -rho[:, None]
    mean = np.empty_like(level)
    mean[..., 0, :] = level[..., 0, :]
    for j in range(1, J):
        mean[..., j, :] = level[..., j, :] + rho * mean[..., j - 1, :]
    return chain_form(mean[None], parameters["variance"], time, NO_TAXEL, frame)


def integrated(
    posterior: ArPosterior, frame: Measure, unseen: Unseen, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Predictions with levels and variances integrated out, averaged over draws of the slopes."""
    return slopes_integrated(form, posterior, "rho", frame, unseen, generator)


MODEL = Story(
    name="profile-ar",
    row=Row("independence in time", "profile, each sample predicted from the previous one"),
    story=story,
    dims={"rho": ("taxel",), "level": CELL, "variance": CELL},
    positive=("variance",),
    check=check_times,
    closed=fit,
    form=form,
    arguments=prior_of_cells,
    trained_only=True,
    integrated=integrated,
    kept=ArPosterior,
)
