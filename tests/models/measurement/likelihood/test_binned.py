"""The distribution of a tap's bins in JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import log_ndtr
from solidtouch.models.measurement.likelihood.binned import BinnedTap, bin_of, log_interval
from solidtouch.models.measurement.likelihood.bins import find_bins

Q, J, K, B = 2, 3, 4, 5


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def log_scipy(a, b):
    """The smaller of both tails, by SciPy."""
    low, high = np.where(a + b > 0, -b, a), np.where(a + b > 0, -a, b)
    return log_ndtr(high) + np.log(-np.expm1(log_ndtr(low) - log_ndtr(high)))


def test_no_interval_loses_digits(rng):
    """In the middle, at the switch to tails and far out on both sides, open or narrow."""
    centre = np.concatenate([3 * rng.normal(size=400), rng.uniform(-60, 60, size=300), [6.0, -6.0, 5.99, 1e3, -1e4]])
    width = 10 ** rng.uniform(-2, 1, size=len(centre))
    a, b = centre - width / 2, centre + width / 2
    a[::17], b[5::17] = -np.inf, np.inf

    np.testing.assert_allclose(jax.jit(log_interval)(a, b), log_scipy(a, b), rtol=1e-13, atol=2e-13)


def test_the_whole_line_is_certain():
    """Where there is one bin only."""
    assert jax.jit(log_interval)(-np.inf, np.inf) == 0.0


@pytest.mark.parametrize("shape", [(B + 1,), (K, B + 1)])
def test_bins_are_those_of_the_model(rng, shape):
    """On edges too, which belong to the bin above, and outside the range."""
    edges = np.sort(rng.normal(size=shape))
    samples = 2 * rng.normal(size=(30, K))
    samples[:6] = np.broadcast_to(edges, (K, B + 1)).T
    rows, index = np.broadcast_to(edges, (K, B + 1)).copy(), find_bins(samples, edges)
    rows[:, 0], rows[:, -1] = -np.inf, np.inf
    lower, upper = jax.jit(bin_of)(samples, edges)

    np.testing.assert_array_equal(lower, rows[np.arange(K), index])
    np.testing.assert_array_equal(upper, rows[np.arange(K), index + 1])


def binned(rng, mean=0.0, mixes=True):
    def unit(*shape):
        return np.tril(0.3 * rng.normal(size=(*shape, shape[-1])), -1) + np.eye(shape[-1])

    return BinnedTap(
        jnp.asarray(rng.normal(size=(Q, J, K)) + mean),
        jnp.asarray(rng.uniform(0.4, 1.5, size=(Q, J, K))),
        jnp.asarray(unit(K, J)),
        jnp.asarray(unit(K)) if mixes else jnp.zeros((0, 0)),
        jnp.log(jnp.asarray([0.3, 0.7])),
        jnp.linspace(-1.0, 1.0, B + 1),
        validate_args=True,
    )


def test_a_tap_is_the_mixture_of_its_parts(rng):
    """Each part alone, weighed."""
    tap, whole = rng.normal(size=(J, K)), binned(rng)

    @jax.jit
    def log_prob(loc, scale, log_weight):
        return BinnedTap(loc, scale, whole.time, whole.taxel, log_weight, whole.edges).log_prob(tap)

    loc, scale, log_weight = (np.asarray(values) for values in (whole.loc, whole.scale, whole.log_weight))
    separate = [log_weight[q] + log_prob(loc[q, None], scale[q, None], np.zeros(1)) for q in range(Q)]

    assert float(log_prob(loc, scale, log_weight)) == pytest.approx(float(np.logaddexp(*separate)))


def test_a_scale_of_zero_is_refused(rng):
    """Where arguments are checked."""
    right = binned(rng)

    with pytest.raises(ValueError, match="scale"):
        BinnedTap(
            right.loc, 0 * right.scale, right.time, right.taxel, right.log_weight, right.edges, validate_args=True
        )
