"""`profile-mvn`: `profile` with each sample predicted from other taxels at the same time.

Slopes and cells have a factorised posterior by coordinate ascent (Bishop, "Pattern Recognition and Machine Learning",
ch. 10).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .fits.cells import CELL, WEAK_CELLS, Cells, cell_posterior, estimated_prior
from .fits.posterior import Convergence, Sites, ascent, check_taxels
from .fits.priors import CellPrior, Taps
from .likelihood.forecasts import Unseen, slopes_integrated
from .likelihood.forms import GaussianForm
from .likelihood.shapes import Measure, Parameters, chain_form
from .model import Row
from .scaling import Moments
from .story import Story

_ROUNDS, _STILL = 2000, 1e-4  # rounds at most, and the change of a slope at which they end
_SETTLING = 10  # rounds after which the prior of the variances stays as it is


def story(
    where: Any,
    what: Any,
    taps: Any = None,
    *,
    L: int,
    M: int,
    J: int,
    K: int,
    prior: CellPrior = WEAK_CELLS,
    typical: Any = 0.0,
    tightness: Any = 4.0,
) -> None:
    """Generative model: `profile` with each sample predicted from the preceding taxels at the same time.

    The slopes are those of the modified Cholesky factor of the covariance across taxels, one factor per class; those of
    all classes are normal around `typical` ones, with one over `tightness` as their variance, so that a class with few
    taps keeps to what the others do. `prior` is that of the intercepts and of the variances.
    """
    from .fits.story_parts import cells, chain, dist, jnp, numpyro, plates

    with plates(("L", L, -3), ("M", M, -2), ("pair", K * (K - 1) // 2, -1)):
        slope: Any = numpyro.sample("slope", dist.Normal(typical, tightness**-0.5))
    with plates(("L", L, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        level, variance = cells(prior)
    own = where, what
    slopes = jnp.zeros((L, M, K, K)).at[..., *np.tril_indices(K, -1)].set(slope)

    def given(taps: Any) -> Any:
        return dist.Normal(level[own] + jnp.einsum("nki,nji->njk", slopes[own], taps), jnp.sqrt(variance[own]))

    with plates(("tap", len(where), -3), ("time", J, -2), ("taxel", K, -1)):
        chain(given, taps, (len(where), J, K), K)


class MvnPosterior(NamedTuple):
    """Factorised posterior of slopes and cells.

    Attributes:
        slope: Expected slopes from earlier to later taxels, strictly lower triangular, shape (L, M, K, K).
        root: Cholesky factors of the covariance of each row of slopes, shape (L, M, K, K, K).
        mean: Mean of the samples, shape (L, M, J, K).
        scatter: Products of deviations of taxels, shape (L, M, J, K, K).
        taps: How many, shape (L, M, 1, 1).
        prior: Prior of the cells.
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
        """Expected parameters; cells with the expected scatter over the slopes."""
        return {"slope": self.slope, **self.cells(self.slope, _uncertain(self.root, self.scatter)).point()}

    def convergence(self) -> Convergence:
        """Convergence of the coordinate ascent."""
        return ascent(self.rounds, self.change, _STILL)

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Parameters from the posterior."""
        noise = generator.standard_normal(self.slope.shape)
        slope = self.slope + np.einsum("lmkxy,lmky->lmkx", self.root, noise)
        return {"slope": slope, **self.cells(slope).draw(generator)}

    def cells(self, slope: NDArray[np.float64], extra: NDArray[np.float64] | float = 0.0) -> Cells:
        """Posterior of the cells given slopes; `extra` is added to the squared deviations."""
        mean = self.mean - self.mean @ slope.mT
        return cell_posterior(self.taps, mean, _squares(slope, self.scatter) + extra, self.prior)


def fit(taps: Taps, prior: CellPrior | None = None) -> MvnPosterior:
    """Factorised posterior of `story`.

    Args:
        taps: Scaled training taps.
        prior: Prior of the cells, with levels expected at 0; default an estimated one.

    Raises:
        ValueError: The prior expects levels elsewhere.
    """
    if prior is not None and np.any(np.asarray(prior.level) != 0):
        raise ValueError("The prior of profile-mvn must expect levels at 0.")
    moments, (L, M), K = Moments.of(taps), taps.shape, taps.samples.shape[2]
    scatter = _scatter(moments, taps)
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
        square = _squares(slope, full) + _uncertain(root, full)
        if known is None and rounds < _SETTLING:
            prior = estimated_prior(count - 1, square)
        change, rounds = float(np.abs(slope - before).max()), rounds + 1
    return MvnPosterior(slope, root, moments.mean, scatter, count, prior, typical, tightness, rounds, change)


def _uncertain(root: NDArray[np.float64], scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expected squared deviations due to the uncertainty of the slopes, shape (L, M, J, K)."""
    covariance = root @ root.swapaxes(-1, -2)
    return np.einsum("lmkxy,lmjxy->lmjk", covariance, scatter, optimize=True)


def _scatter(moments: Moments, taps: Taps) -> NDArray[np.float64]:
    """Scatter of residuals across taxels, summed per class, shape (L, M, J, K, K)."""
    scatter = np.zeros((*moments.mean.shape, taps.samples.shape[2]))
    for residual, which in taps.over_blocks(lambda block, which: (moments.residual(taps, block, which), which)):
        where, what = taps.where[which], taps.what[which]
        for l, m in np.unique(np.stack((where, what), axis=1), axis=0):
            members = residual[(where == l) & (what == m)].swapaxes(0, 1)
            scatter[l, m] += members.swapaxes(1, 2) @ members
    return scatter


def _slope_rows(
    scatter: NDArray[np.float64],
    precision: NDArray[np.float64],
    typical: NDArray[np.float64],
    tightness: float,
    used: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Expected slopes (L, M, K, K) and Cholesky factors of their covariances (L, M, K, K, K)."""
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
    """Mean of the slopes over classes (K, K), and their expected precision around it."""
    K = slope.shape[-1]
    typical = slope[used].mean(axis=0)
    variance = (slope[used] - typical) ** 2 + (root[used] ** 2).sum(axis=-1)
    pairs = used.sum() * K * (K - 1) / 2
    return typical, float(min(pairs / max(variance.sum(), 1e-9), 1e6))


def _squares(slope: NDArray[np.float64], scatter: NDArray[np.float64]) -> NDArray[np.float64]:
    """Squared deviations of the innovations, shape (L, M, J, K)."""
    from .fits.slope_loops import innovation_squares

    (L, M, J, K), out = scatter.shape[:4], np.empty(scatter.shape[:4])
    innovation_squares(slope.reshape(L * M, K, K), scatter.reshape(L * M, J, K, K), out.reshape(L * M, J, K))
    return out


def arguments(taps: Taps, posterior: MvnPosterior) -> dict[str, Any]:
    """Arguments of `story`: the prior that the fit estimated."""
    pairs = np.tril_indices(taps.samples.shape[2], -1)
    return {"prior": posterior.prior, "typical": posterior.typical[pairs], "tightness": posterior.tightness}


def parameters_of(sites: Sites) -> Sites:
    """Parameters from draws: pairs of taxels as strictly lower triangular matrices."""
    K = sites["level"].shape[-1]
    slope = np.zeros((*sites["slope"].shape[:-1], K, K))
    slope[..., *np.tril_indices(K, -1)] = sites["slope"]
    return {**sites, "slope": slope}


def sites_of(parameters: Parameters) -> Parameters:
    """Sites of `story`: slopes of pairs."""
    return {**parameters, "slope": parameters["slope"][..., *np.tril_indices(parameters["slope"].shape[-1], -1)]}


def form(parameters: Parameters, frame: Measure) -> GaussianForm:
    """Likelihood of bins under `story`: W is 1 minus the slopes."""
    level, slope = parameters["level"], parameters["slope"]
    J, K = level.shape[2:]
    factor = np.eye(K) - slope
    mean = np.linalg.solve(factor, level.mT).mT
    return chain_form(mean[None], parameters["variance"], np.eye(J)[None], factor, frame)


def integrated(
    posterior: MvnPosterior, frame: Measure, unseen: Unseen, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Predictions with levels and variances integrated out, averaged over draws of the slopes."""
    return slopes_integrated(form, posterior, "slope", frame, unseen, generator)


MODEL = Story(
    name="profile-mvn",
    row=Row("independence of taxels", "profile, each sample predicted from other taxels at the same time"),
    story=story,
    dims={"slope": ("where", "what", "taxel", "from_taxel"), "level": CELL, "variance": CELL},
    positive=("variance",),
    check=check_taxels,
    closed=fit,
    form=form,
    arguments=arguments,
    parameters=parameters_of,
    sites=sites_of,
    trained_only=True,
    integrated=integrated,
    kept=MvnPosterior,
)
