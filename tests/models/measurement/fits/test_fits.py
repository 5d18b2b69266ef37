"""Fits of the stories: planted parameters come back, bounds rise, and classes with few taps stay sane."""

import numpy as np
import pytest
from scipy.integrate import quad
from solidtouch.models.measurement import gaussian, matrix_normal, profile, profile_ar, profile_mvn, smooth, student
from solidtouch.models.measurement.fits.cells import cell_posterior, estimated_prior
from solidtouch.models.measurement.fits.priors import CellPrior, Taps
from solidtouch.models.measurement.matrix_normal import weak_prior
from solidtouch.models.measurement.scaling import Moments, Scaling, sum_by
from solidtouch.models.measurement.smooth import LENGTHS, Basis

L, M, J, K = 2, 3, 6, 4


def planted(rng, n, *, rho=0.0, taxel=None, time=None, J=J, K=K, L=L, M=M):
    """Taps whose residuals have an autoregression, or covariances in time (J, J) and across taxels (K, K)."""
    where, what = (index.ravel() for index in np.indices((L, M, n))[:2])
    x = rng.normal(size=(len(where), J, K))
    if taxel is not None:
        x = x @ np.linalg.cholesky(taxel).T
    if time is not None:
        x = np.linalg.cholesky(time) @ x
    for j in range(1, J):
        x[:, j] += rho * x[:, j - 1]
    return Taps(x + 3 * rng.normal(size=(L, M, J, K))[where, what], where, what, (L, M))


def equicorrelated(D, r):
    return (1 - r) * np.eye(D) + r


def autoregressive(D, r):
    return r ** np.abs(np.subtract.outer(np.arange(D), np.arange(D)))


# Units


def test_sums_by_group_are_a_loop(rng):
    """Groups in any order, some empty."""
    group, values = np.array([3, 0, 3, 1, 0]), rng.normal(size=(5, 2))
    expected = np.array([values[group == g].sum(axis=0) for g in range(5)])

    np.testing.assert_allclose(sum_by(group, values, 5), expected, atol=1e-15)


def test_moments_are_those_of_each_class(rng):
    """Means, squared deviations and degrees of freedom; zeros for a class without a tap."""
    taps = planted(rng, 5)._replace(shape=(L + 1, M))
    moments = Moments.of(taps)
    members = taps.samples[(taps.where == 1) & (taps.what == 2)]

    np.testing.assert_allclose(moments.mean[1, 2], members.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(moments.square[1, 2], 5 * members.var(axis=0), rtol=1e-12)
    assert moments.freedom == L * M * 4
    assert not moments.mean[L].any()
    assert not moments.square[L].any()


@pytest.mark.parametrize("missing", [False, True])
def test_moments_without_some_taps_are_those_of_the_others(rng, missing):
    """With missing samples, a class that only those have, one that only the others have, and one without a tap."""
    taps = planted(rng, 4)._replace(shape=(L + 1, M))
    if missing:
        taps.samples[rng.random(taps.samples.shape) < 0.3] = np.nan
    out = (taps.where * M + taps.what == 0) | (np.arange(len(taps.where)) % 4 == 1)
    out &= taps.where * M + taps.what != 1
    some, others = (Taps(*(part[which] for part in taps[:3]), taps.shape) for which in (out, ~out))

    for found, expected in zip(Moments.of(taps).without(Moments.of(some)), Moments.of(others), strict=True):
        np.testing.assert_allclose(*np.broadcast_arrays(found, expected), rtol=1e-10, atol=1e-12)


def test_scaled_taps_have_unit_deviation_within_classes(rng):
    """Unless the bins are wider, and then the unit is that of a uniform draw from a bin."""
    taps = planted(rng, 40)
    taps = taps._replace(samples=taps.samples * np.array([2.0, 5.0, 9.0, 0.0]) + 1e4)
    fine, wide = (Scaling.of(taps, np.linspace(0, width, 11)) for width in (10.0, 1000.0))

    np.testing.assert_allclose(fine.unit, [2.0, 5.0, 9.0, 1 / np.sqrt(12)], rtol=0.05)
    np.testing.assert_allclose(wide.unit, 100 / np.sqrt(12), rtol=1e-12)
    np.testing.assert_allclose(fine.scaled(taps).samples.mean(axis=(0, 1)), 0.0, atol=1e-9)


def test_single_taps_are_scaled_by_the_bins(rng):
    """One tap per class says nothing of how taps differ; there is no division by zero."""
    scaling = Scaling.of(planted(rng, 1), np.linspace(-5, 5, 11))

    np.testing.assert_allclose(scaling.unit, 1 / np.sqrt(12), rtol=1e-12)


# Priors


@pytest.mark.parametrize(("n", "a", "b"), [(2, 3.0, 2.0), (2, 8.0, 20.0), (9, 1.5, 0.5)])
def test_the_prior_of_variances_is_found_from_many_cells(rng, n, a, b):
    """Two taps per class are enough where there are many classes."""
    variance = b / rng.gamma(a, size=(20, 25, 8, 1))
    square = variance * rng.chisquare(n - 1, size=variance.shape)
    prior = estimated_prior(np.asarray(n - 1.0), square)

    assert prior.a[0] == pytest.approx(a, rel=0.35)
    assert prior.b[0] / prior.a[0] == pytest.approx(b / a, rel=0.1)


def test_two_taps_per_class_share_their_variances(rng):
    """Estimated variances lie nearer to the true ones than those of each cell alone, more than ten times in squares."""
    true = 1 / rng.gamma(5.0, 1 / 5.0, size=(L, M, J, K))
    taps = planted(rng, 2)
    moments = Moments.of(taps)
    level = moments.mean[taps.where, taps.what]
    taps = taps._replace(samples=level + (taps.samples - level) * np.sqrt(true)[taps.where, taps.what])
    point = profile.fit(taps).point()["variance"]
    alone = Moments.of(taps).square

    assert np.square(np.log(point / true)).mean() < 0.1 * np.square(np.log(alone / true)).mean()
    assert 0.5 < np.median(point / true) < 2.0


def test_identical_taps_have_a_small_finite_variance(rng):
    """Nothing is divided by zero, in every fit in closed form."""
    once = planted(rng, 1)
    taps = Taps(*(np.concatenate([part] * 3) for part in once[:3]), once.shape)
    for fitted in (profile.fit, profile_ar.fit, profile_mvn.fit):
        variance = fitted(taps).point()["variance"]
        assert np.isfinite(variance).all()
        assert (variance > 0).all()
        assert (variance < 1e-3).all()


def test_a_cell_without_a_sample_keeps_the_prior():
    """Level, strength and variance."""
    prior = CellPrior(1.5, 2.0, np.array([3.0]), np.array([4.0]))
    cells = cell_posterior(np.zeros((1, 1, 1, 1)), np.zeros((1, 1, 1, 1)), np.zeros((1, 1, 1, 1)), prior)

    assert [float(part.ravel()[0]) for part in cells] == [1.5, 2.0, 3.0, 4.0]


# Slopes in time


@pytest.mark.parametrize("rho", [0.0131, -0.507, 0.951])
def test_narrow_slopes_are_not_tied_to_the_first_grid(rng, rho):
    """Of very many taps, whose posterior is much narrower than the grid it is first sought on: as by regression."""
    taps = planted(rng, 3000, rho=rho, J=40, K=1, L=1, M=1)
    posterior = profile_ar.fit(taps)
    residual = taps.samples - taps.samples.mean(axis=0)
    now, before = residual[:, 1:], residual[:, :-1]
    expected, error = (now * before).sum() / (before**2).sum(), 1 / np.sqrt((before**2).sum())
    mean = posterior.point()["rho"][0]
    spread = np.sqrt((posterior.weight[0] * (posterior.rho[0] - mean) ** 2).sum())

    assert mean == pytest.approx(expected, abs=0.3 * error)
    assert spread == pytest.approx(error, rel=0.05)
    draws = [posterior.draw(rng)["rho"][0] for _ in range(300)]
    assert np.std(draws) == pytest.approx(error, rel=0.25)


@pytest.mark.parametrize(("n", "rho"), [(3, 0.9), (5, -0.9), (40, 0.97), (1, 0.0)])
def test_slopes_that_end_at_one_have_the_moments_of_the_density(rng, n, rho):
    """By adaptive quadrature of the samples' probability, with levels and variances integrated out."""
    taps = planted(rng, n, rho=rho, J=2, K=1)
    level, strength, a, b = prior = CellPrior(0.5, 0.2, np.array([2.0]), np.array([1.5]))

    def log_density(slope):
        total = 0.0
        for l, m in np.ndindex(L, M):
            own = taps.samples[(taps.where == l) & (taps.what == m), :, 0]
            left = own[:, 1] - slope * own[:, 0]
            away = n * strength / (n + strength) * (left.mean() - level) ** 2
            total -= (a[0] + n / 2) * np.log(b[0] + (n * left.var() + away) / 2)
        return total

    top = max(map(log_density, np.linspace(-1, 1, 501)))

    def moment(power, around=0.0):
        return quad(lambda x: (x - around) ** power * np.exp(log_density(x) - top), -1, 1, epsabs=1e-13, limit=400)[0]

    mean = moment(1) / moment(0)
    posterior = profile_ar.fit(taps, prior)
    found = posterior.point()["rho"][0]
    drawn = np.array([posterior.draw(rng)["rho"][0] for _ in range(4000)])

    assert found == pytest.approx(mean, abs=1e-7)
    variance = moment(2, mean) / moment(0)
    assert (posterior.weight[0] * (posterior.rho[0] - mean) ** 2).sum() == pytest.approx(variance, rel=1e-6)
    assert len(np.unique(drawn)) == len(drawn)
    assert np.abs(drawn).max() < 1
    assert drawn.mean() == pytest.approx(mean, abs=4 * np.sqrt(variance / len(drawn)))
    assert drawn.var() == pytest.approx(variance, rel=0.12)


def test_independent_samples_have_no_slope(rng):
    """Then variances and levels are those of `profile`."""
    taps = planted(rng, 40)
    with_slope, without = profile_ar.fit(taps).point(), profile.fit(taps).point()

    np.testing.assert_allclose(with_slope["rho"], 0.0, atol=0.1)
    np.testing.assert_allclose(with_slope["variance"], without["variance"], rtol=0.05)


def test_each_taxel_has_its_slope(rng):
    """Planted slopes come back."""
    rho = np.array([-0.5, 0.0, 0.4, 0.9])
    np.testing.assert_allclose(profile_ar.fit(planted(rng, 60, rho=rho)).point()["rho"], rho, atol=0.06)


# Taxels


def test_slopes_across_taxels_give_the_planted_covariance(rng):
    """Equicorrelation of 0.6, from 30 taps of 6 samples in each class."""
    taxel = equicorrelated(K, 0.6)
    point = profile_mvn.fit(planted(rng, 30, taxel=taxel)).point()
    back = np.linalg.inv(np.eye(K) - point["slope"])
    for l, m in np.ndindex(L, M):
        for j in range(J):
            covariance = back[l, m] @ np.diag(point["variance"][l, m, j]) @ back[l, m].T
            deviation = np.sqrt(np.diag(covariance))
            np.testing.assert_allclose(covariance / np.outer(deviation, deviation), taxel, atol=0.2)


def test_few_taps_take_their_slopes_from_other_classes(rng):
    """Two taps in each of many classes give slopes nearer to the truth than the class alone could."""
    taxel = equicorrelated(K, 0.6)
    posterior = profile_mvn.fit(planted(rng, 2, taxel=taxel, L=5, M=4, J=3))
    root = np.linalg.cholesky(taxel)
    expected = np.eye(K) - np.linalg.inv(root / np.diag(root))

    np.testing.assert_allclose(posterior.slope, np.broadcast_to(expected, posterior.slope.shape), atol=0.3)
    assert posterior.convergence().converged


@pytest.mark.parametrize("sizes", [{"L": 1, "M": 1}, {"J": 1}, {"M": 1}])
def test_small_sets_converge(rng, sizes):
    """One class, or one sample per tap: what the classes share still settles."""
    taps = planted(rng, 5, **sizes)
    assert profile_mvn.fit(taps).convergence().converged
    assert matrix_normal.fit(taps).convergence().converged


def test_matrix_normal_finds_both_covariances(rng):
    """AR(1) in time times equicorrelation across taxels, up to the factor that can move between them."""
    time, taxel = autoregressive(J, 0.7), equicorrelated(K, 0.5)
    point = matrix_normal.fit(planted(rng, 60, time=time, taxel=taxel)).point()

    assert np.trace(point["time_covariance"]) == pytest.approx(J)
    np.testing.assert_allclose(point["time_covariance"], time, atol=0.1)
    np.testing.assert_allclose(point["taxel_covariance"], np.broadcast_to(taxel, (L, M, K, K)), atol=0.2)


def test_matrix_normal_of_few_taps_shares_the_taxel_covariance(rng):
    """With two taps in each of 20 classes it comes nearer to the truth than under the weak prior."""
    taxel = equicorrelated(5, 0.7)
    taps = planted(rng, 2, time=autoregressive(3, 0.6), taxel=taxel, J=3, K=5, L=5, M=4)

    def distance(prior):
        covariance = matrix_normal.fit(taps, prior).point()["taxel_covariance"]
        deviation = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        return np.square(covariance / (deviation[..., :, None] * deviation[..., None, :]) - taxel).mean()

    assert distance(None) < 0.5 * distance(weak_prior(3, 5))


def test_a_weak_prior_says_little(rng):
    """Of independent samples of variance 1 it leaves that, and it is forgotten after some taps."""
    covariance = matrix_normal.fit(planted(rng, 50), weak_prior(J, K)).point()["taxel_covariance"]
    prior = weak_prior(J, K)

    np.testing.assert_allclose(covariance, np.broadcast_to(np.eye(K), covariance.shape), atol=0.2)
    np.testing.assert_array_equal(prior.taxel_scale / prior.taxel_freedom, np.eye(K))


# Curves


def curved(rng, places=7, n=6, skip=()):
    """Taps of one object at places 0, 1, ..., samples a sine of the place."""
    where = np.repeat([l for l in range(places) if l not in skip], n)
    x = 4 * np.sin(where[:, None, None] / 2 + np.arange(3)[:, None] + np.arange(2)) + rng.normal(
        size=(len(where), 3, 2)
    )
    return Taps(x, where, np.zeros(len(where), int), (places, 1))


def test_the_bound_of_curves_never_falls(rng):
    """Round after round of coordinate ascent, once the prior has settled and before."""
    taps = curved(rng)
    basis = Basis.of(taps.where.astype(float))
    sums = smooth._sums(taps, basis.at(taps.where.astype(float)))
    start = smooth._start(sums)
    bounds = [smooth._ascend(sums, start, basis, LENGTHS[4], rounds)[0] for rounds in range(1, 16)]

    assert np.all(np.diff(bounds) > -1e-6)
    assert bounds[-1] > bounds[0]


def test_curves_reach_places_between(rng):
    """The mean at a place without a tap is nearer to the truth than that of either neighbour."""
    taps = curved(rng, skip=(3,))
    posterior = smooth.fit(taps._replace(place=taps.where.astype(float)))
    mean = np.einsum("d,mjkd->mjk", posterior.basis.at(np.array(3.0)), posterior.weight)[0]
    truth = 4 * np.sin(1.5 + np.arange(3)[:, None] + np.arange(2))
    error = np.abs(mean - truth).mean()

    assert error < 0.6
    for l in (2, 4):
        assert error < 0.5 * np.abs(taps.samples[taps.where == l].mean(axis=0) - truth).mean()


def test_length_scales_are_those_of_the_curves(rng):
    """Noise from place to place gives a shorter length than a slow bend."""
    place = np.repeat(np.arange(12.0), 8)
    what = np.zeros(len(place), int)
    lengths = []
    for curve in (np.sin(place / 12)[:, None, None], rng.normal(size=(12, 3, 1))[place.astype(int)]):
        x = 5 * curve + 0.3 * rng.normal(size=(len(place), 3, 1))
        lengths.append(smooth.fit(Taps(x, place.astype(int), what, (12, 1), place)).length)

    assert lengths[0] > 2 * lengths[1]


# Tails


@pytest.mark.slow
def test_student_finds_the_degrees_of_freedom(rng):
    """Of heavy tails and of none; levels and scales of each class as well."""
    taps = planted(rng, 40, K=2, J=10)
    level, scale = 2 * rng.normal(size=(L, M, 2)), np.exp(0.3 * rng.normal(size=(L, M, 2)))
    own = taps.where, taps.what
    white = np.stack([rng.standard_t(3, size=(len(taps.where), 10)), rng.normal(size=(len(taps.where), 10))], axis=-1)
    posterior = student.fit(taps._replace(samples=level[own][:, None] + scale[own][:, None] * white))
    point = posterior.point()

    assert 2.2 < point["freedom"][0] < 4.2
    assert point["freedom"][1] > 12
    np.testing.assert_allclose(point["level"][:, :, 0], level, atol=0.35)
    np.testing.assert_allclose(point["scale"][:, :, 0], scale, rtol=0.25)
    assert posterior.convergence().converged


# Draws


@pytest.mark.parametrize(
    "model", [gaussian, profile, profile_ar, profile_mvn, matrix_normal], ids=lambda m: m.MODEL.name
)
def test_draws_lie_around_the_point(rng, model):
    """Their mean is within six standard errors of it, or within 2% where the point is a mode-like value."""
    posterior = model.fit(planted(rng, 12, taxel=equicorrelated(K, 0.4)))
    drawn, n = [posterior.draw(rng) for _ in range(400)], 400
    for name, value in posterior.point().items():
        values = np.array([draw[name] for draw in drawn])
        tolerance = 6 * values.std(axis=0) / np.sqrt(n) + 0.12 * values.std(axis=0) + 1e-12
        if name != "taxel_covariance":
            assert np.all(np.abs(values.mean(axis=0) - value) < tolerance), name


def test_permuted_taps_change_nothing(rng):
    """The posterior of a set, whatever its order, as closely as the prior of the variances is sought."""
    taps = planted(rng, 5)
    order = rng.permutation(len(taps.where))
    mixed = Taps(taps.samples[order], taps.where[order], taps.what[order], taps.shape)
    for fitted in (gaussian.fit, profile.fit, profile_ar.fit, profile_mvn.fit, matrix_normal.fit):
        before, after = fitted(taps).point(), fitted(mixed).point()
        for name, value in before.items():
            np.testing.assert_allclose(after[name], value, rtol=2e-3, atol=1e-4)
