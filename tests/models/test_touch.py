"""The NumPyro models of a tap and of a move."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from solidtouch.inference import reference
from solidtouch.inference.enumeration import log_joint, touch_tables
from solidtouch.models.touch import KERNEL_BORDERS, TapCounts, move_kernel, split_prior


@pytest.mark.parametrize("border", KERNEL_BORDERS)
@pytest.mark.parametrize("delta", [-7, -5, -2, 0, 1, 4, 5, 9])
def test_kernels_move_certain_beliefs_as_the_reference_does(border, delta):
    """Row by row: where the mass goes, and whether the object is drawn anew."""
    L, M = 5, 3
    kernel = move_kernel(L, delta, border)

    np.testing.assert_allclose(kernel.where.sum(axis=1), 1.0)
    for l in range(L):
        for m in range(M):
            certain = np.zeros((L, M))
            certain[l, m] = 1.0
            what = np.full(M, 1 / M) if kernel.redraws_what[l] else certain[l]
            expected = reference.shift(certain, delta, border)
            np.testing.assert_allclose(kernel.where[l][:, None] * what, expected, atol=1e-15)


@pytest.mark.parametrize("border", ["prior", "wall"])
def test_borders_that_are_no_kernel_are_refused(border):
    """`prior` renormalises the belief."""
    with pytest.raises(ValueError, match=f"border '{border}' is no Markov kernel"):
        move_kernel(3, 1, border)


def test_a_split_prior_is_the_prior(rng):
    """p(where) times p(what | where), also where a whole position is impossible."""
    prior = rng.dirichlet(np.ones(12)).reshape(4, 3)
    prior[2], prior[0, 1] = 0.0, 0.0
    prior /= prior.sum()
    with jax.enable_x64(True):
        log_where, log_what = split_prior(jnp.log(jnp.asarray(prior)))
        joint = np.exp(np.asarray(log_where)[:, None] + np.asarray(log_what))

    np.testing.assert_allclose(joint, prior, atol=1e-16)
    assert not np.isnan(log_what).any()


def test_counts_that_are_zero_do_not_see_impossible_bins():
    """0 times log 0 is 0, one time log 0 is impossible."""
    table = jnp.array([[-jnp.inf, -1.0], [-2.0, -jnp.inf]])

    counts = TapCounts(table, validate_args=False)

    assert counts.log_prob(jnp.array([[0, 3], [2, 0]])) == -7.0
    assert counts.log_prob(jnp.array([[1, 2], [2, 0]])) == -jnp.inf


@pytest.mark.parametrize("power", ["J", "JK", "none", 0.7])
@pytest.mark.parametrize("pseudocount", [0.0, 0.01])
def test_the_log_joint_of_a_tap_is_prior_times_likelihood(make_model, draw_samples, power, pseudocount):
    """Eq. 1 and 3 at every class, with untrained classes impossible."""
    model = make_model(power=power, pseudocount=pseudocount, untrained=[(1, 3)])
    tap = draw_samples(model, 1)
    expected = model.log_prior + model.log_likelihood(tap)[0]
    with jax.enable_x64(True):
        actual = log_joint(touch_tables(model), jnp.asarray(model.log_prior), jnp.asarray(model.bins(tap)[0]))

    np.testing.assert_allclose(actual, expected, rtol=1e-12)
