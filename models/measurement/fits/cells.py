"""Posteriors of the models of cells with a level and a variance: `gaussian`, `profile`, `profile-ar`, `profile-mvn`.

Given what the cells share, each is a normal regression with conjugate prior, so its posterior is normal-inverse-gamma
in closed form (Gelman et al., "Bayesian Data Analysis", 3rd ed., sec. 3.3 and 14.2). What they share is found from all
of them: the prior of the variances by maximal evidence, the slopes in time by summing over a fine grid, the slopes
across taxels by coordinate ascent on a factorised posterior (Bishop, "Pattern Recognition and Machine Learning", ch.
10).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import gammaln

from ..scaling import Moments, sum_by
from .convergence import EXACT_CELLS, Convergence, ascent
from .priors import CellPrior, Taps

_GRID, _REACH = 101, 8.0  # points, and standard deviations to either side of the mode
_ROUNDS, _STILL = 2000, 1e-4  # rounds at most, and the change of a slope at which they end
_SETTLING = 10  # rounds after which the prior of the variances stays as it is
_LEAST = 1e-4  # of the variances that a prior expects, in units of `Scaling`


class Cells(NamedTuple):
    """Normal-inverse-gamma posterior of every cell; arrays of shape (L, M, J, K), J = 1 without times.

    Attributes:
        level: Expected level.
        strength: How many samples that is worth.
        a: Shape of the inverse gamma distribution of the variance.
        b: Its rate.
    """

    level: NDArray[np.float64]
    strength: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected level and variance."""
        return {"level": self.level, "variance": self.b / np.maximum(self.a - 1, 0.5 * self.a)}

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """A level and variance of each cell from the posterior."""
        variance = self.b / generator.standard_gamma(self.a)
        spread = np.sqrt(variance / np.maximum(self.strength, 1.0))  # only cells without a tap have less
        level = self.level + spread * generator.standard_normal(variance.shape)
        return {"level": level, "variance": variance}


def cell_posterior(
    count: NDArray[np.float64], mean: NDArray[np.float64], square: NDArray[np.float64], prior: CellPrior
) -> Cells:
    """The posterior of cells.

    Args:
        count: Samples of each cell, broadcast over the others.
        mean: Their mean.
        square: Sum of squared deviations from it.
        prior: The prior.
    """
    strength = prior.strength + count
    share = prior.strength / np.maximum(strength, 1e-300)
    b = prior.b + 0.5 * (square + share * count * (mean - prior.level) ** 2)
    # A flat level takes one degree of freedom from the variance.
    freedom = count if prior.strength > 0 else np.maximum(count - 1, 0.0)
    return Cells(
        level=share * prior.level + (1 - share) * mean,
        strength=np.broadcast_to(strength, b.shape),
        a=np.broadcast_to(prior.a + 0.5 * freedom, b.shape),
        b=b,
    )


def estimated_prior(freedom: NDArray[np.float64], square: NDArray[np.float64]) -> CellPrior:
    """The inverse gamma prior of each taxel under which its cells' squares are most probable; flat for the levels.

    Args:
        freedom: Degrees of freedom of each cell, broadcast over (L, M, J, K); cells without any are ignored.
        square: Sums of squared deviations, shape (L, M, J, K).
    """
    K = square.shape[-1]
    freedom = np.broadcast_to(freedom, square.shape)
    a, b = np.empty(K), np.empty(K)
    for k in range(K):
        used = freedom[..., k] > 0
        a[k], b[k] = _most_probable(freedom[..., k][used] / 2, square[..., k][used] / 2)
    return CellPrior(0.0, 0.0, a, b)


def _most_probable(freedom: NDArray[np.float64], half: NDArray[np.float64]) -> tuple[float, float]:
    """Shape and rate from half the degrees of freedom and half the squares of cells."""

    def loss(x: NDArray[np.float64]) -> float:
        a, b = np.exp(x[0]), np.exp(x[1]) * np.exp(x[0])
        evidence = a * np.log(b) - gammaln(a) + gammaln(a + freedom) - (a + freedom) * np.log(b + half)
        return -float(evidence.mean())

    typical = np.log(max(float(np.median(half / freedom)), _LEAST))
    bounds = [(np.log(0.25), np.log(1e3)), (np.log(_LEAST), typical + 7.0)]
    found = minimize(loss, np.array([0.0, typical]), method="L-BFGS-B", bounds=bounds).x
    return float(np.exp(found[0])), float(np.exp(found[0] + found[1]))


class CellPosterior(NamedTuple):
    """Posterior of `gaussian` and `profile`.

    Attributes:
        cells: Posterior of the cells.
        prior: Theirs.
    """

    cells: Cells
    prior: CellPrior

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected parameters."""
        return self.cells.point()

    def convergence(self) -> Convergence:
        """Exact."""
        return EXACT_CELLS

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior."""
        return self.cells.draw(generator)


def fit_gaussian(taps: Taps, prior: CellPrior | None = None) -> CellPosterior:
    """Exact posterior of `stories.gaussian`; samples of all times count alike."""
    moments = Moments.of(taps)
    J = taps.samples.shape[1]
    mean = moments.mean.mean(axis=2, keepdims=True)
    square = (moments.square + moments.taps[..., None, None] * (moments.mean - mean) ** 2).sum(axis=2, keepdims=True)
    count = J * moments.taps[..., None, None]
    prior = prior or estimated_prior(count - 1, square)
    return CellPosterior(cell_posterior(count, mean, square, prior), prior)


def fit_profile(taps: Taps, prior: CellPrior | None = None) -> CellPosterior:
    """Exact posterior of `stories.profile`."""
    moments = Moments.of(taps)
    count = moments.taps[..., None, None]
    prior = prior or estimated_prior(count - 1, moments.square)
    return CellPosterior(cell_posterior(count, moments.mean, moments.square, prior), prior)


class ArPosterior(NamedTuple):
    """Posterior of `profile-ar`: slopes on a grid, cells given the slopes.

    Attributes:
        rho: Grid of slopes of each taxel, shape (K, G).
        weight: Their probabilities, shape (K, G).
        series: Sums from which the cells follow.
        prior: Of the cells.
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
        """Exact."""
        return EXACT_CELLS

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior, slopes spread evenly between grid points."""
        cumulative = self.weight.cumsum(axis=1)
        index = (cumulative < generator.random((len(self.rho), 1)) * cumulative[:, -1:]).sum(axis=1)
        step = self.rho[:, 1] - self.rho[:, 0]
        rho = self.rho[np.arange(len(index)), index] + step * (generator.random(len(index)) - 0.5)
        rho = np.clip(rho, -1.0, 1.0)
        return {"rho": rho, **self.cells(rho).draw(generator)}

    def cells(self, rho: NDArray[np.float64]) -> Cells:
        """The cells given the slopes, shape (K,)."""
        return self.series.cells(rho, self.prior)


class Series(NamedTuple):
    """Sums over the taps of each class that any slope in time needs; shapes (L, M, J, K) but for the number of taps.

    Attributes:
        taps: How many, shape (L, M, 1, 1).
        mean: Of the samples.
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
        """Those of training taps."""
        moments, (L, M) = Moments.of(taps), taps.shape
        product = np.zeros_like(moments.residual)
        product[:, 1:] = moments.residual[:, 1:] * moments.residual[:, :-1]
        product = sum_by(taps.where * M + taps.what, product, L * M).reshape(moments.mean.shape)
        return cls(
            moments.taps[..., None, None],
            moments.mean,
            _delayed(moments.mean),
            moments.square,
            _delayed(moments.square),
            product,
        )

    def innovations(self, rho: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean and squared deviations of samples minus slope times the one before; rho has shape (K,)."""
        square = self.square - 2 * rho * self.product + rho**2 * self.square_before
        return self.mean - rho * self.before, np.maximum(square, 0.0)

    def cells(self, rho: NDArray[np.float64], prior: CellPrior) -> Cells:
        """Posterior of the cells given the slopes."""
        return cell_posterior(self.taps, *self.innovations(rho), prior)

    def log_evidence(self, rho: NDArray[np.float64], prior: CellPrior) -> NDArray[np.float64]:
        """Log probability of the samples of each taxel up to a constant, shape (K,)."""
        cells = self.cells(rho, prior)
        return -(cells.a * np.log(cells.b)).sum(axis=(0, 1, 2))


def fit_profile_ar(taps: Taps, prior: CellPrior | None = None) -> ArPosterior:
    """Exact posterior of `stories.profile_ar`, given the prior of the variances."""
    series, K = Series.of(taps), taps.samples.shape[2]
    if prior is not None:
        return _ar_posterior(series, prior, K)
    rho = np.zeros(K)
    for _ in range(2):  # the prior of the variances and the slopes hardly depend on each other
        prior = estimated_prior(series.taps - 1, series.innovations(rho)[1])
        rho = _ar_posterior(series, prior, K).point()["rho"]
    return _ar_posterior(series, estimated_prior(series.taps - 1, series.innovations(rho)[1]), K)


def _ar_posterior(series: Series, prior: CellPrior, K: int) -> ArPosterior:
    """Slopes on a grid that reaches as far as they are probable."""
    low, high = np.full((K, 1), -1.0), np.full((K, 1), 1.0)
    rho, weight = low, high
    for _ in range(4):
        rho = low + (high - low) * np.linspace(0, 1, _GRID)
        log_weight = np.stack([series.log_evidence(column, prior) for column in rho.T], axis=1)
        weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        centre = (rho * weight).sum(axis=1, keepdims=True)
        deviation = np.sqrt((weight * (rho - centre) ** 2).sum(axis=1, keepdims=True))
        reach = np.maximum(_REACH * deviation, rho[:, 1:2] - rho[:, :1])  # a narrow mode may lie between two points
        low, high = np.maximum(centre - reach, -1.0), np.minimum(centre + reach, 1.0)
    return ArPosterior(rho, weight, series, prior)


def _delayed(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (..., J, K) one sample later, 0 at first."""
    later = np.zeros_like(values)
    later[..., 1:, :] = values[..., :-1, :]
    return later


class MvnPosterior(NamedTuple):
    """Posterior of `profile-mvn`, slopes and cells independent of each other.

    Attributes:
        slope: Expected slopes from earlier to later taxels, strictly lower triangular, shape (L, M, K, K).
        root: Cholesky factors of the covariance of each row of slopes, shape (L, M, K, K, K).
        mean: Of the samples, shape (L, M, J, K).
        scatter: Products of deviations of taxels, shape (L, M, J, K, K).
        taps: How many, shape (L, M, 1, 1).
        prior: Of the cells.
        typical: Expected slopes of all classes, shape (K, K).
        tightness: One over the variance of slopes among classes.
        rounds: How many rounds it took.
        change: Largest change of an expected slope in the last one.
    """

    slope: NDArray[np.float64]
    root: NDArray[np.float64]
    mean: NDArray[np.float64]
    scatter: NDArray[np.float64]
    taps: NDArray[np.float64]
    prior: CellPrior
    typical: NDArray[np.float64]
    tightness: float
    rounds: int
    change: float

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected parameters, those of the cells with the scatter expected over the slopes."""
        return {"slope": self.slope, **self.cells(self.slope, _uncertain(self.root, self.scatter)).point()}

    def convergence(self) -> Convergence:
        """Whether the last round changed anything."""
        return ascent(self.rounds, self.change, _STILL)

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior."""
        noise = generator.standard_normal(self.slope.shape)
        slope = self.slope + np.einsum("lmkxy,lmky->lmkx", self.root, noise)
        return {"slope": slope, **self.cells(slope).draw(generator)}

    def cells(self, slope: NDArray[np.float64], extra: NDArray[np.float64] | float = 0.0) -> Cells:
        """The cells given slopes; `extra` is added to the squared deviations."""
        factor = np.eye(slope.shape[-1]) - slope
        mean = np.einsum("lmki,lmji->lmjk", factor, self.mean)
        square = _squares(factor, self.scatter) + extra
        return cell_posterior(self.taps, mean, square, self.prior)


def fit_profile_mvn(taps: Taps, prior: CellPrior | None = None) -> MvnPosterior:
    """Factorised posterior of `stories.profile_mvn`.

    Args:
        taps: Scaled training taps.
        prior: Of the cells, with levels expected at 0; default an estimated one.

    Raises:
        ValueError: The prior expects levels elsewhere.
    """
    if prior is not None and np.any(np.asarray(prior.level) != 0):
        raise ValueError("The prior of profile-mvn must expect levels at 0.")
    moments, (L, M), (_, J, K) = Moments.of(taps), taps.shape, taps.samples.shape
    scatter = _scatter(moments.residual, taps.where * M + taps.what, L * M).reshape(L, M, J, K, K)
    count = moments.taps[..., None, None]
    # With the prior of a level at 0 the mean acts like a sample more, scaled by this.
    strength = 0.0 if prior is None else prior.strength
    weight = strength * count / np.maximum(strength + count, 1.0)
    full = scatter + weight[..., None] * moments.mean[..., :, None] * moments.mean[..., None, :]
    used = moments.taps > 0
    slope, root = np.zeros((L, M, K, K)), np.zeros((L, M, K, K, K))
    typical, tightness, square = np.zeros((K, K)), 4.0, moments.square
    known, change, rounds = prior, np.inf, 0
    prior = known or estimated_prior(count - 1, square)
    while change > _STILL and rounds < _ROUNDS:
        cells = cell_posterior(count, np.zeros_like(square), square, prior)
        before = slope
        slope, root = _slope_rows(full, cells.a / cells.b, typical, tightness, used)
        typical, tightness = _shared(slope, root, used)
        square = _squares(np.eye(K) - slope, full) + _uncertain(root, full)
        if known is None and rounds < _SETTLING:
            prior = estimated_prior(count - 1, square)
        change, rounds = float(np.abs(slope - before).max()), rounds + 1
    return MvnPosterior(slope, root, moments.mean, scatter, count, prior, typical, tightness, rounds, change)


def _uncertain(root: NDArray[np.float64], scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared deviations expected beside those at the expected slopes, shape (L, M, J, K)."""
    covariance = root @ root.swapaxes(-1, -2)
    return np.einsum("lmkxy,lmjxy->lmjk", covariance, scatter, optimize=True)


def _scatter(residual: NDArray[np.float64], own: NDArray[np.intp], groups: int) -> NDArray[np.float64]:
    """Products of the residuals (N, J, K) of taxels summed over the taps of each class, shape (groups, J, K, K)."""
    _, J, K = residual.shape
    scatter = np.zeros((groups, J, K, K))
    for c in np.unique(own):
        members = residual[own == c].swapaxes(0, 1)
        scatter[c] = members.swapaxes(1, 2) @ members
    return scatter


def _slope_rows(
    scatter: NDArray[np.float64],
    precision: NDArray[np.float64],
    typical: NDArray[np.float64],
    tightness: float,
    used: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Expected slopes (L, M, K, K) and the Cholesky factors of their covariances (L, M, K, K, K)."""
    L, M, _, K = precision.shape
    slope, root = np.zeros((L, M, K, K)), np.zeros((L, M, K, K, K))
    for k in range(1, K):
        weighted = np.einsum("lmj,lmjxy->lmxy", precision[..., k], scatter[..., : k + 1, : k + 1], optimize=True)
        information = weighted[..., :k, :k] + tightness * np.eye(k)
        target = weighted[..., :k, k] + tightness * typical[k, :k]
        covariance = np.linalg.inv(information)
        covariance = 0.5 * (covariance + covariance.swapaxes(-1, -2))
        slope[..., k, :k] = (covariance @ target[..., None])[..., 0]
        root[..., k, :k, :k] = np.linalg.cholesky(covariance)
    slope[~used] = typical
    return slope, root


def _shared(
    slope: NDArray[np.float64], root: NDArray[np.float64], used: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], float]:
    """Mean of the slopes over classes (K, K), and one over their expected variance around it."""
    K = slope.shape[-1]
    typical = slope[used].mean(axis=0)
    variance = (slope[used] - typical) ** 2 + (root[used] ** 2).sum(axis=-1)
    pairs = used.sum() * K * (K - 1) / 2
    return typical, float(min(pairs / max(variance.sum(), 1e-9), 1e6))


def _squares(factor: NDArray[np.float64], scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared deviations of the innovations, diagonal of W S W', shape (L, M, J, K)."""
    half = np.einsum("lmki,lmjix->lmjkx", factor, scatter, optimize=True)
    return np.maximum((half * factor[:, :, None]).sum(axis=-1), 0.0)
