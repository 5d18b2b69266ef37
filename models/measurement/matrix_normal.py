"""`matrix-normal`: covariances in time and across taxels, by coordinate ascent on a factorised posterior.

Given the covariance across taxels that in time has a Wishart posterior of its precision, and the other way round; each
is updated with what is expected of the other until nothing changes ("flip-flop"; Dutilleul, Journal of Statistical
Computation and Simulation 64 (1999) 105, in its variational form, Bishop ch. 10). The Wishart distribution that holds
the taxel precisions of all classes is the one under which these are most probable.

Taps of one sample, such as feature vectors, have no covariance in time. Then the posterior is exact given the prior,
and so is the predictive distribution, Student's t of several dimensions; for the prior see `fits.covariances`.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import brentq
from scipy.special import psi  # pyright: ignore[reportAttributeAccessIssue] - missing in the stubs

from .fits.cells import CELL
from .fits.covariances import inverse_wishart, shrinking_prior, strength_of_means, unit_triangular
from .fits.posterior import EXACT_COVARIANCES, Convergence, Sites, ascent, check_covariances
from .fits.priors import Taps
from .likelihood.forecasts import Unseen, log_student_vectors, over_draws
from .likelihood.forms import GaussianForm
from .likelihood.shapes import Measure, Parameters, chain_form
from .likelihood.true_class import OwnTaps
from .model import Row
from .scaling import Moments
from .states import ONE_STATE
from .story import Story

_ROUNDS, _STILL = 200, 1e-5  # rounds at most, and the change at which they end
_SETTLING = 10  # rounds after which the prior stays as it is
_WEAK = 0.01  # taps that the prior of a mean is worth where none is given
_MOST_FREEDOM = 1e4  # of the distribution that the taxel precisions of all classes come from


class KroneckerPrior(NamedTuple):
    """Wishart priors of two precision matrices, and a normal prior of the means.

    Attributes:
        time_freedom: Degrees of freedom in time.
        time_scale: Inverse of the Wishart's scale, shape (J, J).
        taxel_freedom: Degrees of freedom across taxels.
        taxel_scale: Inverse of that Wishart's scale, shape (K, K).
        strength: How many taps the prior of the mean, at 0, is worth; 0 for a flat prior.
    """

    time_freedom: float
    time_scale: NDArray[np.float64]
    taxel_freedom: float
    taxel_scale: NDArray[np.float64]
    strength: float


def story(
    where: Any, what: Any, taps: Any = None, *, L: int, M: int, J: int, K: int, prior: KroneckerPrior | None = None
) -> None:
    """Generative model: residuals correlated in time, equally in all classes, and across taxels, per class.

    The covariance of two samples is the product of one in time (J, J) and one across taxels (K, K). One Wishart
    distribution holds the taxel precisions of all classes. Without a `prior` it is a weak one. The covariance in
    time of taps of one sample is 1.
    """
    from .fits.story_parts import dist, jnp, numpyro, plates

    prior = prior or weak_prior(J, K)._replace(strength=_WEAK)
    time: Any = jnp.eye(1)
    if J > 1:
        time = numpyro.sample("time", dist.Wishart(prior.time_freedom, jnp.linalg.inv(prior.time_scale)))
    with plates(("L", L, -2), ("M", M, -1)):
        taxel_scale = jnp.linalg.inv(prior.taxel_scale)
        taxel: Any = numpyro.sample("taxel", dist.Wishart(prior.taxel_freedom, taxel_scale))
        rows = jnp.linalg.cholesky(jnp.linalg.inv(time))
        columns = jnp.linalg.cholesky(jnp.linalg.inv(taxel))
        flat = dist.ImproperUniform(dist.constraints.real_matrix, (), (J, K))
        known = dist.MatrixNormal(jnp.zeros((J, K)), rows / (prior.strength or 1.0) ** 0.5, columns)
        level: Any = numpyro.sample("level", known if prior.strength else flat)
    own = where, what
    with numpyro.plate("tap", len(where)):
        numpyro.sample("taps", dist.MatrixNormal(level[own], rows, columns[own]), obs=taps)


class KroneckerPosterior(NamedTuple):
    """Factorised Wishart posterior of both precisions; with one sample per tap that in time is 1 and this one exact.

    Attributes:
        time_freedom: Degrees of freedom in time.
        time_scale: Inverse of the Wishart's scale, expected sum of squares in time, shape (J, J).
        taxel_freedom: Degrees of freedom across taxels, shape (L, M).
        taxel_scale: Expected sums of squares across taxels, shape (L, M, K, K).
        level: Expected means, shape (L, M, J, K).
        strength: Taps that they are worth, shape (L, M).
        prior: Prior of precisions and means.
        rounds: How many rounds it took.
        change: Largest change of the covariance in time in the last one, relative to its variances.
    """

    time_freedom: float
    time_scale: NDArray[np.float64]
    taxel_freedom: NDArray[np.float64]
    taxel_scale: NDArray[np.float64]
    level: NDArray[np.float64]
    strength: NDArray[np.float64]
    prior: KroneckerPrior
    rounds: int
    change: float

    def point(self) -> dict[str, NDArray[np.float64]]:
        """Expected means, and covariances from expected precisions, the one in time scaled to trace J.

        With one sample per tap the covariance across taxels is the scale of the distribution of a new tap, Student's t,
        so that it does not matter how many taxels there are besides.
        """
        if self.single:
            taxel = self.taxel_scale / self.tails[..., None, None]
            return {"level": self.level, "time_covariance": np.eye(1), "taxel_covariance": taxel}
        time = self.time_scale / self.time_freedom
        unit = np.trace(time) / len(time)
        taxel = self.taxel_scale / self.taxel_freedom[..., None, None]
        return {"level": self.level, "time_covariance": time / unit, "taxel_covariance": taxel * unit}

    @property
    def single(self) -> bool:
        """Whether taps have one sample."""
        return len(self.time_scale) == 1

    @property
    def tails(self) -> NDArray[np.float64]:
        """Degrees of freedom of a new tap of one sample, shape (L, M)."""
        return self.taxel_freedom - self.taxel_scale.shape[-1] + 1

    def convergence(self) -> Convergence:
        """Convergence of the coordinate ascent, if there was one."""
        if self.single:
            return EXACT_COVARIANCES
        return ascent(self.rounds, self.change, _STILL)

    def draw(self, generator: np.random.Generator) -> dict[str, NDArray[np.float64]]:
        """Draw of the parameters, scaled as in `point`."""
        time = np.eye(1)
        if not self.single:
            time = inverse_wishart(self.time_scale, np.asarray(self.time_freedom), generator)
        taxel = inverse_wishart(self.taxel_scale, self.taxel_freedom, generator)
        rows, columns = np.linalg.cholesky(time), np.linalg.cholesky(taxel)
        noise = rows @ generator.standard_normal(self.level.shape) @ columns.swapaxes(-1, -2)
        level = self.level + noise / np.sqrt(np.maximum(self.strength, 1.0))[..., None, None]
        unit = np.trace(time) / len(time)
        return {"level": level, "time_covariance": time / unit, "taxel_covariance": taxel * unit, "unit": unit}


def weak_prior(J: int, K: int) -> KroneckerPrior:
    """Weak prior that expects independent samples of variance 1 in units of `Scaling`; flat means."""
    return KroneckerPrior(J + 2.0, (J + 2.0) * np.eye(J), K + 2.0, (K + 2.0) * np.eye(K), 0.0)


def fit(taps: Taps, prior: KroneckerPrior | None = None) -> KroneckerPosterior:
    """Factorised posterior of `story`; without a given prior, that of the taxels is estimated."""
    if taps.samples.shape[1] == 1:
        return _of_vectors(taps, prior)
    residuals, (L, M), (_, J, K) = _Residuals(taps, Moments.of(taps)), taps.shape, taps.samples.shape
    count, known = residuals.moments.taps, prior
    prior = known or weak_prior(J, K)
    freedom = count.ravel() if prior.strength else np.maximum(count.ravel() - 1, 0.0)
    time_freedom = prior.time_freedom + K * float(freedom.sum())
    time = np.eye(J)
    taxel_scale, taxel_freedom = np.broadcast_to(prior.taxel_scale, (L * M, K, K)), prior.taxel_freedom + J * freedom
    time_scale, shape, change, rounds = prior.time_scale, time, np.inf, 0
    while change > _STILL and rounds < _ROUNDS:
        taxel_scale, taxel_freedom = residuals.across_taxels(prior, time), prior.taxel_freedom + J * freedom
        root = np.linalg.cholesky(np.linalg.inv(taxel_scale) * taxel_freedom[:, None, None])
        time_scale = residuals.in_time(prior, root)
        time = time_scale / time_freedom
        # A factor taken from one covariance and given to the other changes next to nothing and drifts on for long.
        before, shape = shape, time * (J / np.trace(time))
        deviation = np.sqrt(np.diag(shape))
        change, rounds = float(np.abs((shape - before) / np.outer(deviation, deviation)).max()), rounds + 1
        if known is None and rounds <= _SETTLING:
            prior = _estimated(prior, taxel_scale[freedom > 0], taxel_freedom[freedom > 0])
    across = taxel_freedom.reshape(L, M), taxel_scale.reshape(L, M, K, K)
    return KroneckerPosterior(
        time_freedom, time_scale, *across, *residuals.means(prior.strength), prior, rounds, change
    )


def _of_vectors(taps: Taps, known: KroneckerPrior | None) -> KroneckerPosterior:
    """Posterior for taps of one sample, exact given the prior."""
    residuals, (L, M), (_, J, K) = _Residuals(taps, Moments.of(taps)), taps.shape, taps.samples.shape
    count, mean = residuals.moments.taps.ravel(), residuals.moments.mean.reshape(L * M, K)
    flat = weak_prior(J, K)._replace(taxel_scale=np.zeros((K, K)))
    scale = residuals.across_taxels(flat, np.eye(J))
    prior = _learned(flat, scale, count, mean) if known is None else known
    freedom = count if prior.strength else np.maximum(count - 1, 0.0)
    for c, weight in enumerate(prior.strength * count / np.maximum(prior.strength + count, 1.0)):
        scale[c] += prior.taxel_scale
        scale[c] += weight * np.outer(mean[c], mean[c])
    across = (prior.taxel_freedom + freedom).reshape(L, M), scale.reshape(L, M, K, K)
    return KroneckerPosterior(1.0, np.eye(J), *across, *residuals.means(prior.strength), prior, 0, 0.0)


def _learned(
    flat: KroneckerPrior, scatter: NDArray[np.float64], count: NDArray[np.float64], mean: NDArray[np.float64]
) -> KroneckerPrior:
    """Prior for taps of one sample from scatters (C, K, K), numbers (C,) and means (C, K) of the taps of classes."""
    freedom, scale = shrinking_prior(scatter, np.maximum(count - 1, 0.0))
    strength = strength_of_means(mean, count, scale / (freedom - len(scale) - 1))
    return flat._replace(taxel_freedom=freedom, taxel_scale=scale, strength=strength)


def _estimated(prior: KroneckerPrior, scale: NDArray[np.float64], freedom: NDArray[np.float64]) -> KroneckerPrior:
    """Empirical-Bayes prior of the taxel precisions.

    The weak prior counts as one class more, without which few classes would confirm themselves.

    Args:
        prior: The one before, which keeps what it says of time and means.
        scale: Inverse scales of the posteriors, shape (C, K, K).
        freedom: Their degrees of freedom, shape (C,).
    """
    K = scale.shape[-1]
    weak = weak_prior(len(prior.time_scale), K)
    scale, freedom = np.concatenate([scale, weak.taxel_scale[None]]), np.append(freedom, weak.taxel_freedom)
    covariance = np.linalg.inv((np.linalg.inv(scale) * freedom[:, None, None]).mean(axis=0))
    log_precision = psi(0.5 * (freedom[:, None] - np.arange(K))).sum(axis=1) + K * np.log(2) - _log_det(scale)
    gap = float(log_precision.mean() + _log_det(covariance))

    def slope(log_freedom: float) -> float:  # of the log density, which has one mode
        half = 0.5 * float(np.exp(log_freedom))
        return float(gap + K * np.log(half) - psi(half - 0.5 * np.arange(K)).sum())

    low, high = np.log(K + 2.0), np.log(_MOST_FREEDOM)
    mode: Any = low if slope(low) < 0 else high if slope(high) > 0 else brentq(slope, low, high)
    nu = float(np.exp(mode))
    return prior._replace(taxel_freedom=nu, taxel_scale=nu * covariance)


def _log_det(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.slogdet(matrices)[1]


class _Residuals(NamedTuple):
    """Residual matrices (J, K) of all taps, and of the means from the one that the prior expects.

    Attributes:
        taps: The taps.
        moments: Of the taps.
    """

    taps: Taps
    moments: Moments

    def means(self, strength: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Expected means (L, M, J, K) where the prior at 0 is worth `strength` taps, and what they are worth (L, M)."""
        worth = self.moments.taps + strength
        return (self.moments.taps / np.maximum(worth, 1e-300))[..., None, None] * self.moments.mean, worth

    def across_taxels(self, prior: KroneckerPrior, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Expected sums of squares across taxels given the covariance in time, shape (L M, K, K)."""
        root = np.linalg.cholesky(time)

        def squares(rows: NDArray[np.float64], own: NDArray[np.intp]) -> list[tuple[int, NDArray[np.float64]]]:
            n, J, K = rows.shape
            flat = rows.swapaxes(0, 1).reshape(J, n * K)
            white = solve_triangular(root, flat, lower=True, overwrite_b=True, check_finite=False).reshape(J, n, K)
            parts = ((c, white[:, members].reshape(-1, K)) for c, members in _by_class(own))
            return [(c, part.T @ part) for c, part in parts]

        total = np.tile(prior.taxel_scale, (self.moments.taps.size, 1, 1))
        for found in self._over_blocks(squares, prior.strength):
            for c, square in found:
                total[c] += square
        return total

    def in_time(self, prior: KroneckerPrior, root: NDArray[np.float64]) -> NDArray[np.float64]:
        """Expected sums of squares in time given roots of the taxel precisions (L M, K, K), shape (J, J)."""

        def squares(rows: NDArray[np.float64], own: NDArray[np.intp]) -> NDArray[np.float64]:
            mixed = np.empty((rows.shape[1], len(rows), rows.shape[2]))
            for c, members in _by_class(own):
                mixed[:, members] = (rows[members] @ root[c]).swapaxes(0, 1)
            flat = mixed.reshape(len(mixed), -1)
            return flat @ flat.T

        total = prior.time_scale.copy()
        for square in self._over_blocks(squares, prior.strength):
            total += square
        return total

    def _over_blocks[T](
        self, work: Callable[[NDArray[np.float64], NDArray[np.intp]], T], strength: float
    ) -> Iterator[T]:
        """Results of work on residuals (n, J, K) and their classes (n,), in order."""
        taps, moments = self
        own = taps.where * taps.shape[1] + taps.what
        yield from taps.over_blocks(lambda block, which: work(moments.residual(taps, block, which), own[which]))
        if strength:  # the prior of a mean is a residual more
            weight = np.sqrt(strength * moments.taps / (strength + moments.taps))
            extra = weight[..., None, None] * moments.mean
            yield work(extra.reshape(-1, *extra.shape[2:]), np.arange(weight.size))


def _by_class(own: NDArray[np.intp]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Each class that taps are of, and the indices of these."""
    order = np.argsort(own, kind="stable")
    for members in np.split(order, np.flatnonzero(np.diff(own[order])) + 1):
        yield int(own[members[0]]), members


def arguments(_: Taps, posterior: KroneckerPosterior) -> dict[str, KroneckerPrior]:
    """Arguments of `story`: the prior that the fit estimated."""
    return {"prior": posterior.prior}


def parameters_of(sites: Sites) -> Sites:
    """Parameters from draws: covariances from precisions, the one in time scaled to trace J."""
    taxel = np.linalg.inv(sites["taxel"])
    time = np.linalg.inv(sites["time"]) if "time" in sites else np.ones((*taxel.shape[:-4], 1, 1))
    unit = np.trace(time, axis1=-2, axis2=-1) / time.shape[-1]
    return {
        "level": sites["level"],
        "time_covariance": time / unit[..., None, None],
        "taxel_covariance": taxel * unit.reshape(*unit.shape, *([1] * (taxel.ndim - unit.ndim))),
        "unit": unit,
    }


def sites_of(parameters: Parameters) -> Parameters:
    """Sites of `story`: precisions."""
    unit = parameters.get("unit", 1.0)
    time, taxel = parameters["time_covariance"] * unit, parameters["taxel_covariance"] / unit
    sites = {"level": parameters["level"], "taxel": np.linalg.inv(taxel)}
    return sites if len(time) == 1 else sites | {"time": np.linalg.inv(time)}


def form(parameters: Parameters, frame: Measure) -> GaussianForm:
    """Likelihood of bins under `story`: V and W from the Cholesky factors of both covariances."""
    time, time_variance = unit_triangular(parameters["time_covariance"])
    taxel, taxel_variance = unit_triangular(parameters["taxel_covariance"])
    variance = time_variance[:, None] * taxel_variance[:, :, None, :]
    return chain_form(parameters["level"][None], variance, time[None], taxel, frame)


def integrated(
    posterior: KroneckerPosterior, frame: Measure, unseen: Unseen, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Predictions widened by the uncertainty of the means, averaged over draws of both covariances.

    Those of taps of one sample are exact.
    """
    inflation = np.sqrt(1 + 1 / np.maximum(posterior.strength, 1.0))[..., None, None]
    if posterior.single:
        point = form(posterior.point(), frame)
        return log_student_vectors(point._replace(scale=point.scale * inflation), posterior.tails, unseen)

    known = OwnTaps(unseen.taps, unseen.own, unseen.edges, ONE_STATE)

    def one() -> NDArray[np.float64]:
        drawn = form({**posterior.draw(generator), "level": posterior.level}, frame)
        return known.log_probability(drawn._replace(scale=drawn.scale * inflation))

    return over_draws(one)


MODEL = Story(
    name="matrix-normal",
    row=Row("independence in time and of taxels", "one covariance in time times one across taxels"),
    story=story,
    dims={
        "level": CELL,
        "time_covariance": ("sample", "other_sample"),
        "taxel_covariance": ("where", "what", "taxel", "other_taxel"),
    },
    check=check_covariances,
    closed=fit,
    form=form,
    arguments=arguments,
    parameters=parameters_of,
    sites=sites_of,
    trained_only=True,
    integrated=integrated,
    kept=KroneckerPosterior,
)
