"""Weighted samples in place of many: the same moments, nearly the same densities, and fits that agree."""

import numpy as np
import pytest
from scipy import stats
from solidtouch.models import blocks
from solidtouch.models.blocks import ScaledSamples
from solidtouch.models.measurement import student
from solidtouch.models.measurement.fits import condensed as module
from solidtouch.models.measurement.fits.condensed import Condensed, condensed
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.scaling import Moments

L, M, J, K = 2, 2, 30, 4


@pytest.fixture
def taps(rng):
    """A taxel with tails of infinite variance, one with heavy ones, a normal one and a constant one; gaps everywhere.

    One class has no tap.
    """
    where, what = np.divmod(np.arange(300) % 3, M)
    white = (rng.standard_t(1.5, (300, J)), rng.standard_t(4, (300, J)), rng.normal(size=(300, J)), np.zeros((300, J)))
    samples = np.stack(white, axis=-1) + 2.0 * where[:, None, None] + what[:, None, None]
    samples[rng.random(samples.shape) < 0.1] = np.nan
    return Taps(samples, where, what, (L, M))


def made(taps):
    return condensed(taps, Moments.of(taps))


def test_moments_stay(taps):
    """Number, mean and variance of each class and taxel; a constant taxel needs one sample."""
    few, weight = made(taps)
    assert few.samples.shape == weight.shape == (3, few.samples.shape[1], K)
    assert few.samples.shape[1] < 200
    for c, (l, m) in enumerate(zip(few.where, few.what, strict=True)):
        own = taps.samples[(taps.where == l) & (taps.what == m)].reshape(-1, K)
        mean = (weight[c] * few.samples[c]).sum(axis=0) / weight[c].sum(axis=0)
        variance = (weight[c] * (few.samples[c] - mean) ** 2).sum(axis=0) / weight[c].sum(axis=0)
        np.testing.assert_array_equal(weight[c].sum(axis=0), (~np.isnan(own)).sum(axis=0))
        np.testing.assert_allclose(mean, np.nanmean(own, axis=0), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(variance, np.nanvar(own, axis=0), rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal((weight[..., 3] > 0).sum(axis=1), 1)


@pytest.mark.parametrize("told", [(1.5, 0.0, 1.0), (4.0, 0.3, 0.7), (30.0, -0.5, 1.5)])
def test_densities_are_nearly_the_same(taps, told):
    """Of parameters that suit the samples or do not, to 1e-5 per sample."""
    few, weight = made(taps)
    freedom, shift, scale = told
    for c, (l, m) in enumerate(zip(few.where, few.what, strict=True)):
        own = taps.samples[(taps.where == l) & (taps.what == m)].reshape(-1, K)
        law = stats.t(freedom, 2.0 * l + m + shift, scale)
        exact, found = np.nansum(law.logpdf(own), axis=0), (weight[c] * law.logpdf(few.samples[c])).sum(axis=0)
        np.testing.assert_allclose(found, exact, atol=1e-5 * len(own))


def test_blocks_change_nothing(taps, monkeypatch):
    """The samples of a recording on disk are those in memory, in units of their own."""
    few, weight = made(taps)
    monkeypatch.setattr(blocks, "BLOCK", 7 * J * K * 8)
    large = made(taps._replace(samples=ScaledSamples(10 * taps.samples + 3, 3.0, 10.0)))

    np.testing.assert_array_equal(large.weight, weight)
    np.testing.assert_allclose(large.taps.samples, few.samples, atol=1e-9)


@pytest.mark.slow
def test_student_agrees_with_all_samples(rng, monkeypatch):
    """Within a hundredth of the posterior's standard deviations."""
    where, what = np.divmod(np.arange(400) % 4, M)
    samples = np.stack([rng.standard_t(3, (400, 20)), rng.normal(size=(400, 20))], axis=-1)
    taps = Taps(samples + what[:, None, None], where, what, (L, M), least=np.full(2, 0.01))
    found = student.fit(taps)
    monkeypatch.setattr(module, "condensed", lambda taps, _: Condensed(taps, np.ones(taps.samples.shape)))
    exact = student.fit(taps)
    drawn = [exact.draw(rng) for _ in range(100)]

    assert found.convergence().converged
    for name, expected in exact.point().items():
        deviation = np.std([draw[name] for draw in drawn], axis=0)
        assert (np.abs(found.point()[name] - expected) < 0.01 * deviation).all(), name
