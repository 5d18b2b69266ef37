"""Prior of means and covariances of feature vectors: classes are shrunk as far as the taps ask for."""

import numpy as np
import pytest
from scipy.special import multigammaln  # pyright: ignore[reportAttributeAccessIssue] - missing in the stubs
from scipy.stats import multivariate_normal
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement import matrix_normal
from solidtouch.models.measurement.fits import covariances
from solidtouch.models.measurement.fits.covariances import MOST_TIES, shrinking_prior, strength_of_means
from solidtouch.models.measurement.fits.posterior import MOST_COVARIANCES, MOST_SLOPES
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

M, K = 5, 12


def vectors(rng, n, roots, mean=0.0):
    """Taps of one sample, n of each class, with these roots of their covariances, shape (M, K, R)."""
    what = np.repeat(np.arange(M), n)
    x = np.einsum("nr,nkr->nk", rng.normal(size=(len(what), roots.shape[2])), roots[what])
    levels = mean * rng.normal(size=(M, roots.shape[1]))
    return Taps((x + levels[what])[:, None], np.zeros(len(what), dtype=int), what, (1, M))


def correlations(rng, alike, K=K):
    """Roots of covariances with two common factors, the same in all classes or one in each."""
    factors = np.broadcast_to(rng.normal(size=(1, K, 2)), (M, K, 2)) if alike else rng.normal(size=(M, K, 2))
    return np.concatenate([factors, np.broadcast_to(0.5 * np.eye(K), (M, K, K))], axis=2)


def distance(covariance, roots):
    """Mean divergence of normal distributions with covariances (M, K, K) from the true ones, in nat."""
    true = roots @ roots.swapaxes(-1, -2)
    ratio = np.linalg.solve(covariance, true)
    return 0.5 * np.mean(np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - len(true[0]))


@pytest.mark.parametrize(("n", "K"), [(4, 12), (6, 40)])
def test_classes_with_fewer_taps_than_taxels_lean_on_the_others(rng, n, K):
    """Much nearer to the truth than the sample variances without any correlation, and than the weak prior."""
    roots = correlations(rng, alike=True, K=K)
    taps = vectors(rng, n, roots)
    shrunk = matrix_normal.fit(taps).point()["taxel_covariance"][0]
    weak = matrix_normal.fit(taps, matrix_normal.weak_prior(1, K)).point()["taxel_covariance"][0]
    residual = taps.samples[:, 0].reshape(M, n, K)
    variance = (residual - residual.mean(axis=1, keepdims=True)).var(axis=(0, 1)) * n / (n - 1)

    assert distance(shrunk, roots) < 0.5 * distance(np.broadcast_to(np.diag(variance), (M, K, K)), roots)
    assert distance(shrunk, roots) < 0.5 * distance(weak, roots)


def test_classes_keep_to_each_other_as_far_as_they_are_alike(rng):
    """The prior counts many taps where all have one covariance, and few where each has its own."""
    alike, apart = (
        matrix_normal.fit(vectors(rng, 40, correlations(rng, same))).prior.taxel_freedom - K - 1
        for same in (True, False)
    )

    assert alike > 300
    assert apart < 30


def test_many_taps_find_the_covariance_of_each_class(rng):
    """Whatever the others have."""
    roots = correlations(rng, alike=False)
    point = matrix_normal.fit(vectors(rng, 4000, roots)).point()

    assert point["time_covariance"] == 1
    np.testing.assert_allclose(point["taxel_covariance"][0], roots @ roots.swapaxes(-1, -2), atol=0.5)
    assert distance(point["taxel_covariance"][0], roots) < 0.05


def test_ties_are_the_most_probable_ones(rng, monkeypatch):
    """The density of each scatter, Wishart of an inverse-Wishart covariance, as written down for full matrices."""
    seen = []
    monkeypatch.setattr(covariances, "_best", lambda evidence, _: seen.append(evidence) or 7.0)
    n, scatter = 4.0, np.empty((3, K, K))
    for c in range(3):
        rows = rng.normal(size=(int(n), K)) * np.linspace(0.5, 2, K)
        scatter[c] = rows.T @ rows
    freedom, scale = shrinking_prior(scatter, np.full(3, n))
    total = scatter.sum(axis=0)
    variance = np.diag((np.diag(total) + 1) / (3 * n + 1))
    common = (7 * variance + total) / (7 + 3 * n)

    def density(mean, square, taps, ties):
        before = K + 1 + ties
        return (
            multigammaln(0.5 * (before + taps), K)
            - multigammaln(0.5 * before, K)
            + 0.5 * before * np.linalg.slogdet(ties * mean)[1]
            - 0.5 * (before + taps) * np.linalg.slogdet(ties * mean + square)[1]
        )

    others = [(7 * variance + total - own) / (7 + 2 * n) for own in scatter]
    exact = [
        lambda ties: density(variance, total, 3 * n, ties),
        lambda ties: sum(density(mean, own, n, ties) for mean, own in zip(others, scatter, strict=True)),
    ]
    for found, expected in zip(seen, exact, strict=True):
        gap = [-found(np.log(ties)) - expected(ties) for ties in (1.5, 8.0, 300.0)]
        np.testing.assert_allclose(gap, gap[0], atol=1e-7)
    assert freedom == K + 1 + 7
    np.testing.assert_allclose(scale, 7 * common, rtol=1e-10)


def test_a_single_class_is_the_pooled_one(rng):
    """There is nothing to tell how far classes differ, and no difference of means."""
    rows = rng.normal(size=(5, K))
    freedom, _ = shrinking_prior((rows.T @ rows)[None], np.array([5.0]))

    assert freedom == K + 1 + MOST_TIES
    assert strength_of_means(np.zeros((1, K)), np.array([5.0]), np.eye(K)) == 0


@pytest.mark.parametrize(("spread", "low", "high"), [(2.0, 0.1, 0.7), (0.0, 30, 1.1e4)])
def test_means_are_shrunk_by_as_much_as_they_differ(rng, spread, low, high):
    """Classes two deviations apart are worth a quarter of a tap; equal ones hold together."""
    strength = matrix_normal.fit(vectors(rng, 10, np.tile(np.eye(40), (M, 1, 1)), spread)).prior.strength

    assert low < strength < high


def test_the_strength_of_means_is_the_most_probable_one(rng):
    """Means from that of all, which is known where classes are many, are normal with the variance of both."""
    C, taps = 400, np.repeat([2.0, 9.0], 200)
    root = rng.normal(size=(3, 3))
    covariance = root @ root.T + np.eye(3)
    spread = 1 / taps + 1 / 4.0
    mean = rng.multivariate_normal(np.zeros(3), covariance, size=C) * np.sqrt(spread)[:, None]
    strengths = np.geomspace(1, 16, 161)
    evidence = [
        sum(
            multivariate_normal(np.zeros(3), covariance * (1 / n + 1 / s)).logpdf(mean[taps == n]).sum()
            for n in (2.0, 9.0)
        )
        for s in strengths
    ]

    assert strength_of_means(mean, taps, covariance) == pytest.approx(strengths[np.argmax(evidence)], rel=0.05)


def test_too_many_features_are_refused():
    """With the number that would do."""
    K = int((MOST_COVARIANCES / 2) ** 0.5) + 1
    taps = TapSet.from_arrays(np.zeros((4, 1, K)), [0, 0, 1, 1], ["a", "b"], preprocessing=Preprocessing(samples=1))
    grid: ClassGrid = taps.grid()
    with pytest.raises(InputError, match=f"for 2 classes it takes at most {K - 1} taxels, got {K}"):
        fit_model("matrix-normal", taps, grid, FitSettings(bins=2))


def test_too_many_taxels_to_predict_each_from_the_others_are_refused():
    """With the number that would do."""
    K = int((MOST_SLOPES / 2) ** 0.25) + 1
    taps = TapSet.from_arrays(np.zeros((4, 2, K)), [0, 0, 1, 1], ["a", "b"], preprocessing=Preprocessing(samples=2))
    with pytest.raises(InputError, match=f"for 2 classes it takes at most {K - 1} taxels, got {K}: use matrix-normal"):
        fit_model("profile-mvn", taps, taps.grid(), FitSettings(bins=2))
