"""The measurement models as generative stories in NumPyro: how the samples of taps of known class come about.

Each is one function of 10 to 25 lines that says nothing but the story; how a model is fitted stands in `fit_*`, and
what the models assume and relax in docs/reference/models.md. Plates carry the letters of the axes: `L` where classes,
`M` what classes, `J` samples of a tap, `K` taxels.

Levels are intercepts of forecasts: a sample is `level` plus what the samples before it add to it. Samples are in units
of `Scaling`, in which the typical deviation of a taxel within a class is 1. Hyperparameters are given: the same prior
holds for all classes, and `fit_*` estimates it from all of them, which is how classes with few taps share strength.

References: Gelman et al., "Bayesian Data Analysis", 3rd ed., ch. 3 and 5 (conjugate and hierarchical normal models);
Pourahmadi, Biometrika 86 (1999) 677 (covariance as forecasts); Dawid, Biometrika 68 (1981) 265 (matrix normal);
Riutort-Mayol et al., Statistics and Computing 33 (2023) 17 (Gaussian processes on a basis).
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from .fits.priors import CellPrior, CurvePrior, KroneckerPrior, Taps


def _cells(prior: CellPrior) -> tuple[Any, Any]:
    """Level and variance of every cell of the plates around it."""
    variance: Any = numpyro.sample("variance", dist.InverseGamma(prior.a, prior.b))
    flat = dist.ImproperUniform(dist.constraints.real, (), ())
    known = dist.Normal(prior.level, jnp.sqrt(variance / (prior.strength or 1.0)))
    return numpyro.sample("level", known if prior.strength else flat), variance


def gaussian(taps: Taps, prior: CellPrior) -> None:
    """Samples of a class and taxel are normal, whatever their time; exchangeable as in the paper, but without bins.

    The variances of all classes of a taxel come from one inverse gamma distribution.
    """
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    with numpyro.plate("L", L, dim=-4), numpyro.plate("M", M, dim=-3), numpyro.plate("K", K, dim=-1):
        level, variance = _cells(prior)
    own = taps.where, taps.what
    with numpyro.plate("tap", N, dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("sample", dist.Normal(level[own], jnp.sqrt(variance[own])), obs=taps.samples)


def student(taps: Taps, least: Any = 0.0) -> None:
    """As `gaussian` with heavier tails: Student's t, its degrees of freedom shared by all classes of a taxel.

    Locations are normal and scales log-normal around what is typical of the taxel; the classes share the width of both.
    No scale counts for less than `least`, broadcast over (K,), as a taxel at rest would have an unbounded density.
    """
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    with numpyro.plate("K", K, dim=-1):
        freedom: Any = numpyro.sample("freedom", dist.Gamma(2.0, 0.1))
        spread: Any = numpyro.sample("spread", dist.HalfCauchy(5.0))
        typical: Any = numpyro.sample("typical", dist.Normal(0.0, 2.0))
        variety: Any = numpyro.sample("variety", dist.HalfNormal(1.0))
        with numpyro.plate("L", L, dim=-4), numpyro.plate("M", M, dim=-3):
            level: Any = numpyro.sample("level", dist.Normal(0.0, spread))
            scale: Any = numpyro.sample("scale", dist.LogNormal(typical, variety))
    own = taps.where, taps.what
    with numpyro.plate("tap", N, dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("sample", dist.StudentT(freedom, level[own], jnp.maximum(scale[own], least)), obs=taps.samples)


def profile(taps: Taps, prior: CellPrior) -> None:
    """Every class and taxel has a mean and a variance for each time of a tap; residuals are independent.

    The variances of all classes and times of a taxel come from one inverse gamma distribution.
    """
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    plates = ("L", L, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)
    with _plates(*plates):
        level, variance = _cells(prior)
    own = taps.where, taps.what
    with _plates(("tap", N, -3), ("time", J, -2), ("taxel", K, -1)):
        numpyro.sample("sample", dist.Normal(level[own], jnp.sqrt(variance[own])), obs=taps.samples)


def profile_ar(taps: Taps, prior: CellPrior) -> None:
    """As `profile`, but each sample is forecast from the one before it, with one slope per taxel for all classes."""
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    with numpyro.plate("K", K, dim=-1):
        rho: Any = numpyro.sample("rho", dist.Uniform(-1.0, 1.0))
        with _plates(("L", L, -4), ("M", M, -3), ("J", J, -2)):
            level, variance = _cells(prior)
    own = taps.where, taps.what
    before = jnp.pad(taps.samples, ((0, 0), (1, 0), (0, 0)))[:, :-1]
    with _plates(("tap", N, -3), ("time", J, -2), ("taxel", K, -1)):
        forecast = level[own] + rho * before
        numpyro.sample("sample", dist.Normal(forecast, jnp.sqrt(variance[own])), obs=taps.samples)


def profile_mvn(taps: Taps, prior: CellPrior, typical: Any, tightness: Any) -> None:
    """As `profile`, but each sample is forecast from those of the taxels before it at the same time.

    The slopes are those of the modified Cholesky factor of the covariance across taxels, one factor per class; those of
    all classes are normal around the typical ones, so that a class with few taps keeps to what the others do.
    """
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    with _plates(("L", L, -3), ("M", M, -2), ("pair", K * (K - 1) // 2, -1)):
        slope: Any = numpyro.sample("slope", dist.Normal(typical, tightness**-0.5))
    with _plates(("L", L, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        level, variance = _cells(prior)
    own = taps.where, taps.what
    slopes = jnp.zeros((L, M, K, K)).at[..., *np.tril_indices(K, -1)].set(slope)
    forecast = level[own] + jnp.einsum("nki,nji->njk", slopes[own], taps.samples)
    with _plates(("tap", N, -3), ("time", J, -2), ("taxel", K, -1)):
        numpyro.sample("sample", dist.Normal(forecast, jnp.sqrt(variance[own])), obs=taps.samples)


def matrix_normal(taps: Taps, prior: KroneckerPrior) -> None:
    """Residuals are correlated in time, alike in all classes, and across taxels, as each class has it.

    The covariance of two samples is the product of one in time (J, J) and one across taxels (K, K). One Wishart
    distribution holds the taxel precisions of all classes.
    """
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    time: Any = numpyro.sample("time", dist.Wishart(prior.time_freedom, jnp.linalg.inv(prior.time_scale)))
    with _plates(("L", L, -2), ("M", M, -1)):
        taxel_scale = jnp.linalg.inv(prior.taxel_scale)
        taxel: Any = numpyro.sample("taxel", dist.Wishart(prior.taxel_freedom, taxel_scale))
        rows = jnp.linalg.cholesky(jnp.linalg.inv(time))
        columns = jnp.linalg.cholesky(jnp.linalg.inv(taxel))
        flat = dist.ImproperUniform(dist.constraints.real_matrix, (), (J, K))
        known = dist.MatrixNormal(jnp.zeros((J, K)), rows / (prior.strength or 1.0) ** 0.5, columns)
        level: Any = numpyro.sample("level", known if prior.strength else flat)
    own = taps.where, taps.what
    with numpyro.plate("tap", N):
        numpyro.sample("sample", dist.MatrixNormal(level[own], rows, columns[own]), obs=taps.samples)


def smooth(taps: Taps, prior: CurvePrior) -> None:
    """As `profile`, but the mean of an object at a time and taxel is a smooth curve over the position of the tap.

    The curve is a Gaussian process with squared exponential kernel on a basis of sines, so the classes of an object
    share their taps, and positions between them have a mean too.
    """
    (L, M), (N, J, K) = taps.shape, taps.samples.shape
    D = prior.basis.shape[1]
    with _plates(("D", D, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        weight: Any = numpyro.sample("weight", dist.Normal(0.0, prior.width[:, None, None]))
    with _plates(("L", L, -4), ("M", M, -3), ("J", J, -2), ("K", K, -1)):
        variance: Any = numpyro.sample("variance", dist.InverseGamma(prior.a, prior.b))
    curve = jnp.einsum("nd,dnjk->njk", prior.basis, weight[:, taps.what])
    with _plates(("tap", N, -3), ("time", J, -2), ("taxel", K, -1)):
        deviation = jnp.sqrt(variance[taps.where, taps.what])
        numpyro.sample("sample", dist.Normal(curve, deviation), obs=taps.samples)


class _plates:  # noqa: N801 - used like numpyro.plate
    """Several plates as one context."""

    def __init__(self, *plates: tuple[str, int, int]) -> None:
        self._plates = [numpyro.plate(name, size, dim=dim) for name, size, dim in plates]

    def __enter__(self) -> None:
        for plate in self._plates:
            plate.__enter__()

    def __exit__(self, *error: Any) -> None:
        for plate in reversed(self._plates):
            plate.__exit__(*error)
