"""The story of variance components: its collapsed density is that of all taps, and its posterior is calibrated."""

import jax
import numpy as np
import pytest
from numpyro.infer import MCMC, NUTS, init_to_value
from numpyro.infer.util import log_density
from scipy import stats
from solidtouch.models.measurement.gain_variance import COMPONENTS, PRIOR_SD, GainCells, components, means_log_density


def cells_of(value, error, session, own, R, C):
    """Cells of values of taps, shape (Q, N), with errors of each cell, shape (Q, R, C)."""
    count = np.zeros((R, C), dtype=int)
    np.add.at(count, (session, own), 1)
    mean, square = np.zeros(error.shape), np.zeros(error.shape)
    for r, c in np.argwhere(count > 0):
        members = value[:, (session == r) & (own == c)]
        mean[:, r, c] = members.mean(axis=1)
        square[:, r, c] = ((members - members.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
    return GainCells(count, mean, square, error)


def restricted_density(value, session, own, error, sds):
    """Log density of the contrasts of all taps that no level enters, by their full covariance."""
    same_session = session[:, None] == session
    same_cell = same_session & (own[:, None] == own)
    covariance = sds["session"] ** 2 * same_session + sds["mounting"] ** 2 * same_cell
    covariance = covariance + np.diag(sds["tap"] ** 2 + error[session, own])
    levels = (own[:, None] == np.unique(own)).astype(float)
    basis = np.linalg.svd(np.eye(len(own)) - levels @ np.linalg.pinv(levels))[0][:, : len(own) - levels.shape[1]]
    contrasts = basis.T @ value
    return stats.multivariate_normal(np.zeros(len(contrasts)), basis.T @ covariance @ basis).logpdf(contrasts)


def test_the_collapsed_density_is_that_of_all_taps(rng):
    """Up to a constant, for cells of no, one, and several taps, of two quantities with errors of their own."""
    R, C, Q = 3, 4, 2
    count = np.array([[3, 1, 0, 2], [2, 1, 4, 1], [0, 5, 1, 1]])
    session, own = (np.repeat(index.ravel(), count.ravel()) for index in np.indices((R, C)))
    value, error = rng.normal(size=(Q, len(own))), rng.uniform(0.1, 0.6, size=(Q, R, C))
    cells = cells_of(value, error, session, own, R, C)
    collapsed, gaps = jax.jit(lambda sds: log_density(components, (cells,), {}, sds)[0]), []
    for _ in range(5):
        sds = {name: rng.uniform(0.05, 0.6, size=Q) for name in COMPONENTS}
        with jax.enable_x64(True):
            density = collapsed(sds)
        prior = sum(stats.halfnorm(scale=PRIOR_SD).logpdf(sd).sum() for sd in sds.values())
        brute = sum(
            restricted_density(value[q], session, own, error[q], {name: sd[q] for name, sd in sds.items()})
            for q in range(Q)
        )
        gaps.append(float(density) - prior - brute)

    np.testing.assert_allclose(gaps, gaps[0], atol=1e-9)


def test_levels_do_not_matter(rng):
    """Any constant may be added to a class, and to a session where it is free to be anything."""
    R, C = 3, 5
    mean, variance, present = rng.normal(size=(1, R, C)), rng.uniform(0.5, 2, size=(1, R, C)), np.ones((R, C), bool)
    compiled = jax.jit(lambda values, sd: means_log_density(values, present, sd, variance)[0])
    with jax.enable_x64(True):

        def density(values, sd):
            return float(compiled(values, np.array([sd])))

        assert density(mean + rng.normal(size=C), 0.7) == pytest.approx(density(mean, 0.7))
        assert density(mean + 3.0, 0.0) == pytest.approx(density(mean, 0.0))
        shifted = mean + np.array([2.0, 0.0, -2.0])[:, None]
        assert density(shifted, 0.0) < density(mean, 0.0) - 5
        assert density(shifted, 1e4) == pytest.approx(density(mean, 1e4), abs=1e-3)


@pytest.mark.slow
def test_intervals_hold_what_the_prior_drew(rng):
    """Of 90 intervals of 90% nine in ten hold the standard deviation that the prior drew, as a calibrated one does.

    Thirty data sets of 4 sessions, 7 classes and 3 taps each are sampled as so many quantities at once.
    """
    Q, R, C, n = 30, 4, 7, 3
    sds = {name: PRIOR_SD * np.abs(rng.normal(size=(Q, 1, 1, 1))) for name in COMPONENTS}
    value = (
        rng.normal(size=(Q, 1, C, 1))
        + sds["session"] * rng.normal(size=(Q, R, 1, 1))
        + sds["mounting"] * rng.normal(size=(Q, R, C, 1))
        + np.sqrt(sds["tap"] ** 2 + 0.03**2) * rng.normal(size=(Q, R, C, n))
    )
    session, own, _ = (index.ravel() for index in np.indices((R, C, n)))
    cells = cells_of(value.reshape(Q, -1), np.full((Q, R, C), 0.03**2), session, own, R, C)
    start = {name: np.full(Q, 0.1) for name in COMPONENTS}
    with jax.enable_x64(True):
        sampler = MCMC(
            NUTS(components, init_strategy=init_to_value(values=start)),
            num_warmup=200,
            num_samples=400,
            progress_bar=False,
        )
        sampler.run(jax.random.key(5), cells)
        draws = {name: np.asarray(values) for name, values in sampler.get_samples().items()}
    held = {}
    for name, values in draws.items():
        low, high = np.quantile(values, [0.05, 0.95], axis=0)
        held[name] = int(((low <= sds[name].ravel()) & (sds[name].ravel() <= high)).sum())

    lowest, highest = stats.binom(3 * Q, 0.9).ppf([0.001, 0.999])
    assert lowest <= sum(held.values()) <= highest, held
    assert min(held.values()) >= stats.binom(Q, 0.9).ppf(0.001)
