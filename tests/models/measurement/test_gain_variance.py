"""Variance components: their collapsed density is that of all taps, their posterior exact and calibrated."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats
from slow_cases import slow_but
from solidtouch.models.measurement import gain_variance as module
from solidtouch.models.measurement.gain_variance import COMPONENTS, PRIOR_SD, GainCells, gain_posteriors, log_density


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


def drawn(rng, sds, *, R, C, n, error=0.03):
    """Cells of as many quantities as there are standard deviations, each of shape (Q,), with n taps each."""
    session_sd, mounting_sd, tap_sd = (np.reshape(sd, (-1, 1, 1, 1)) for sd in sds)
    Q = len(session_sd)
    value = (
        rng.normal(size=(Q, 1, C, 1))
        + session_sd * rng.normal(size=(Q, R, 1, 1))
        + mounting_sd * rng.normal(size=(Q, R, C, 1))
        + np.sqrt(tap_sd**2 + error**2) * rng.normal(size=(Q, R, C, n))
    )
    mean = value.mean(axis=-1)
    square = ((value - mean[..., None]) ** 2).sum(axis=-1)
    return GainCells(np.full((R, C), n), mean, square, np.full((Q, R, C), error**2))


def restricted_density(value, session, own, error, sds):
    """Log density of the contrasts of all taps that no level enters, by their full covariance."""
    same_session = session[:, None] == session
    same_cell = same_session & (own[:, None] == own)
    covariance = sds[0] ** 2 * same_session + sds[1] ** 2 * same_cell
    covariance = covariance + np.diag(sds[2] ** 2 + error[session, own])
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
    sds = [rng.uniform(0.05, 0.6, size=size) for size in (2, 3, 4)]
    for q in range(Q):
        brute = [
            restricted_density(value[q], session, own, error[q], sd) + stats.halfnorm(scale=PRIOR_SD).logpdf(sd).sum()
            for sd in np.stack(np.meshgrid(*sds, indexing="ij"), axis=-1).reshape(-1, 3)
        ]
        gaps = log_density(cells, q, sds).ravel() - brute
        np.testing.assert_allclose(gaps, gaps[0], atol=1e-9)


def test_levels_do_not_matter(rng):
    """Any constant may be added to a class, and to a session where it is free to be anything."""
    cells = drawn(rng, [[0.1], [0.1], [0.1]], R=3, C=5, n=2)

    def density(mean, session):
        return log_density(cells._replace(mean=mean), 0, [np.array([session]), np.array([0.1]), np.array([0.1])]).item()

    assert density(cells.mean + rng.normal(size=5), 0.7) == pytest.approx(density(cells.mean, 0.7))
    assert density(cells.mean + 3.0, 0.0) == pytest.approx(density(cells.mean, 0.0))
    shifted = cells.mean + np.array([2.0, 0.0, -2.0])[:, None]
    assert density(shifted, 0.0) < density(cells.mean, 0.0) - 5
    assert density(shifted, 1e4) == pytest.approx(density(cells.mean, 1e4), abs=1e-3)


@dataclass(frozen=True)
class Design:
    """Standard deviations of sessions, mountings and taps, sizes, and the error of a tap."""

    session: float
    mounting: float
    tap: float
    R: int
    C: int
    n: int
    error: float = 0.03

    def cells(self, rng):
        return drawn(rng, [[self.session], [self.mounting], [self.tap]], R=self.R, C=self.C, n=self.n, error=self.error)


DESIGNS = {
    "small": Design(0.1, 0.1, 0.1, R=2, C=2, n=2),
    "three sessions": Design(0.05, 0.03, 0.1, R=3, C=80, n=20),
    "nothing but error": Design(0.0, 0.0, 0.0, R=4, C=6, n=3),
    "one tap in a cell": Design(0.05, 0.05, 0.0, R=6, C=8, n=1),
    "one session": Design(0.0, 0.0, 0.1, R=1, C=6, n=5),
    "far beyond the prior": Design(1.0, 1.0, 1.0, R=3, C=4, n=4),
    "sessions ten times as far": Design(10.0, 0.01, 0.01, R=6, C=8, n=4),
    "everything thirty times as far": Design(30.0, 30.0, 30.0, R=6, C=8, n=4),
    "many sessions": Design(0.02, 0.1, 0.05, R=30, C=5, n=2),
    "nearly exact": Design(1e-3, 1e-4, 1e-3, R=3, C=20, n=50, error=1e-5),
    "without noise": Design(0.0, 0.0, 0.0, R=5, C=5, n=1000, error=1e-6),
    "hardly any cells without noise": Design(0.0, 0.0, 0.0, R=2, C=2, n=2, error=1e-6),
}


@pytest.mark.parametrize("name", slow_but({*DESIGNS} - {"many sessions"}, DESIGNS))
def test_the_posterior_is_that_of_a_grid_of_another_kind(name, rng):
    """Means and medians, by Gauss-Legendre over logarithms of standard deviations between far apart ends."""
    cells = DESIGNS[name].cells(rng)
    (posterior,) = gain_posteriors(cells)
    assert posterior.converged
    assert posterior.weight.sum() == pytest.approx(1)
    nodes, base = [], []
    for told, sd in zip(cells.told, posterior.sd, strict=True):
        assert (len(sd) > 1) == told
        x, w = np.polynomial.legendre.leggauss(160)
        low, high = np.log(max(sd[0] / 2, 1e-10)), np.log(min(2 * sd[-1], 300.0)) if told else 0.0
        nodes.append(np.exp((low + high) / 2 + (high - low) / 2 * x) if told else np.zeros(1))
        base.append(w * nodes[-1] if told else np.ones(1))
    found = log_density(cells, 0, nodes)
    weight = np.exp(found - found.max()) * base[0][:, None, None] * base[1][:, None] * base[2]
    weight /= weight.sum()
    for axis in np.flatnonzero(cells.told):
        other = weight.sum(axis=tuple({0, 1, 2} - {axis}))
        mean = other @ nodes[axis]
        spread = np.sqrt(other @ (nodes[axis] - mean) ** 2)
        own = posterior.marginal(axis)
        assert own @ posterior.sd[axis] == pytest.approx(mean, abs=0.01 * spread), COMPONENTS[axis]
        assert own @ (posterior.sd[axis] - mean) ** 2 == pytest.approx(spread**2, rel=0.02), COMPONENTS[axis]


def test_components_that_taps_cannot_tell_are_none(rng):
    """Of one session, of cells of one tap, and of classes of one session each."""
    assert DESIGNS["small"].cells(rng).told == (True, True, True)
    assert DESIGNS["one session"].cells(rng).told == (False, False, True)
    assert DESIGNS["one tap in a cell"].cells(rng).told == (True, True, False)
    apart = DESIGNS["small"].cells(rng)._replace(taps=2 * np.eye(2, dtype=int))
    assert apart.told == (False, False, True)
    (posterior,) = gain_posteriors(apart)
    assert posterior.sd[0].tolist() == posterior.sd[1].tolist() == [0.0]


def test_too_few_points_are_noticed(monkeypatch, rng):
    """A grid that steps over the posterior says that it did not converge."""
    monkeypatch.setattr(module, "POINTS", 9)

    assert not gain_posteriors(DESIGNS["far beyond the prior"].cells(rng))[0].converged


@pytest.mark.parametrize("sets", [40, pytest.param(300, marks=pytest.mark.slow)])
def test_intervals_hold_what_the_prior_drew(sets, rng):
    """Intervals of 90% of data sets of 4 sessions, 7 classes and 3 taps, as a calibrated one does."""
    sds = [PRIOR_SD * np.abs(rng.normal(size=sets)) for _ in COMPONENTS]
    held = np.zeros(len(COMPONENTS), dtype=int)
    for quantity, posterior in enumerate(gain_posteriors(drawn(rng, sds, R=4, C=7, n=3))):
        for axis, sd in enumerate(posterior.sd):
            below = posterior.marginal(axis)[sd < sds[axis][quantity]].sum()
            held[axis] += 0.05 < below < 0.95
    lowest, highest = stats.binom(3 * sets, 0.9).ppf([0.001, 0.999])

    assert lowest <= held.sum() <= highest, held
    assert held.min() >= stats.binom(sets, 0.9).ppf(0.001), held


@pytest.mark.slow
def test_the_posterior_is_that_of_the_story_by_nuts(rng):
    """The same model written in NumPyro, with effects of sessions and cells drawn instead of integrated out."""
    import jax
    import jax.numpy as jnp
    import numpyro
    import numpyro.distributions as dist
    from numpyro.infer import MCMC, NUTS

    R, C, n, error = 5, 8, 4, 0.03
    cells = drawn(rng, [[0.15], [0.08], [0.1]], R=R, C=C, n=n, error=error)

    def story():
        sd = [numpyro.sample(name, dist.HalfNormal(PRIOR_SD)) for name in COMPONENTS]
        level = numpyro.sample("level", dist.Normal(0, 100).expand([C]))
        common = numpyro.sample("common", dist.Normal(0, 1).expand([R])) * sd[0]
        variance = sd[2] ** 2 + error**2
        spread = jnp.sqrt(sd[1] ** 2 + variance / n)
        numpyro.sample("mean", dist.Normal(level + common[:, None], spread), obs=cells.mean[0])
        freedom = R * C * (n - 1)
        numpyro.sample("square", dist.Gamma(freedom / 2, 0.5 / variance), obs=cells.square[0].sum())

    with jax.enable_x64(True):
        sampler = MCMC(NUTS(story), num_warmup=500, num_samples=8000, progress_bar=False)
        sampler.run(jax.random.key(3))
        draws = {name: np.asarray(values) for name, values in sampler.get_samples().items()}
    (posterior,) = gain_posteriors(cells)
    for axis, name in enumerate(COMPONENTS):
        mean = posterior.marginal(axis) @ posterior.sd[axis]
        assert draws[name].mean() == pytest.approx(mean, abs=0.08 * draws[name].std())
        assert draws[name].std() == pytest.approx(
            np.sqrt(posterior.marginal(axis) @ (posterior.sd[axis] - mean) ** 2), rel=0.1
        )
