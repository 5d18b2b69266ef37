"""Tables that could have made histograms: as rugged as these show, and smooth where these are smooth."""

import numpy as np
import pytest
from scipy.stats import norm
from solidtouch.analysis.plausible_tables import PlausibleTables


def multinomial(rng, n, p):
    return np.array([[rng.multinomial(n, table) for table in row] for row in p])


@pytest.mark.parametrize("a", [0.3, 3.0])
def test_rugged_tables_have_a_flat_prior(a):
    """Of Dirichlet tables of 12 bins the prior is worth 12 a samples, alike in all bins."""
    rng = np.random.default_rng(0)
    counts = multinomial(rng, 30, rng.dirichlet(np.full(12, a), size=(200, 2)))
    found = PlausibleTables.of(counts)
    prior = found.concentration - counts
    assert prior.sum(axis=-1) == pytest.approx(12 * a, rel=0.2)
    assert prior.mean(axis=(0, 1)) == pytest.approx(a, rel=0.3)


def test_smooth_tables_are_smoothed():
    """What few samples of a curve leave out lies beside them, not anywhere."""
    rng = np.random.default_rng(1)
    centre = rng.uniform(0, 40, size=(60, 2, 1))
    p = np.diff(norm.cdf(np.arange(41.0), centre, 3.0), axis=-1)
    p /= p.sum(axis=-1, keepdims=True)
    counts = multinomial(rng, 25, p)
    found = PlausibleTables.of(counts)
    assert 1 <= found.width <= 4
    assert found.strength > 50
    drawn = found.draw(rng)
    flat = (counts + 0.5) / (25 + 20)
    assert np.abs(drawn - p).sum() < 0.6 * np.abs(flat - p).sum()


def test_draws_have_the_moments_of_their_concentration():
    """Sums are 1, also where a bin has next to no concentration."""
    alpha = np.array([[[5.0, 1.0, 0.5, 1e-5]]])
    tables, rng = PlausibleTables(alpha, 1.0, 0.1, 1.0), np.random.default_rng(2)
    drawn = np.array([tables.draw(rng)[0, 0] for _ in range(4000)])
    np.testing.assert_allclose(drawn.sum(axis=1), 1)
    mean = alpha[0, 0] / alpha.sum()
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.01)
    np.testing.assert_allclose(drawn.var(axis=0), mean * (1 - mean) / (alpha.sum() + 1), atol=0.003)


def test_single_samples_take_those_of_all_classes():
    """A histogram of one sample has no others of its own to be judged by."""
    counts = np.zeros((6, 1, 5), dtype=int)
    counts[np.arange(6), 0, [1, 1, 1, 2, 2, 3]] = 1
    found = PlausibleTables.of(counts)
    assert np.isfinite(found.concentration).all()
    assert (found.concentration > 0).all()
    assert np.isfinite(found.draw(np.random.default_rng(0))).all()
