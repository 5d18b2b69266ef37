"""The NumPyro models of a tap and of a move."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro import handlers
from solidtouch.inference import reference
from solidtouch.inference.engines import enumeration
from solidtouch.inference.engines.enumeration import log_joint, log_likelihoods, observed, touch_tables
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.measurement.states import States
from solidtouch.models.settings import FitSettings
from solidtouch.models.touch import KERNEL_BORDERS, TapCounts, move_kernel, one_tap, split_prior


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
    with pytest.raises(ValueError, match=f"border '{border}' is not a Markov kernel"):
        move_kernel(3, 1, border)


def test_a_split_prior_is_the_prior(rng):
    """p(session) p(where | session) p(what | session, where), also where a position or a session is impossible."""
    prior = rng.dirichlet(np.ones(4 * 5 * 3)).reshape(4, 5, 3)
    prior[2], prior[:, 3], prior[0, 1, 2] = 0.0, 0.0, 0.0
    prior /= prior.sum()
    with jax.enable_x64(True):
        split = jax.jit(lambda some: split_prior(jnp.log(some)))(prior)
        joint = np.exp(split.log_session[:, None, None] + split.log_where[:, :, None] + split.log_what)
        given_where = np.exp(split.log_what).sum(axis=2)

    np.testing.assert_allclose(np.moveaxis(joint, 0, 1), prior, atol=1e-16)
    np.testing.assert_allclose(np.exp(split.log_session), prior.sum(axis=(0, 2)), atol=1e-15)
    np.testing.assert_allclose(given_where[[0, 1, 2, 4]][:, [0, 1, 3]], 1.0)
    assert not any(np.isnan(part).any() for part in split)


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
    tap, (L, M) = draw_samples(model, 1), model.grid.shape
    expected = model.log_prior + model.log_likelihood(tap)[0]
    with jax.enable_x64(True):
        tables = touch_tables(model)
        log_prior = np.full(tables.log_trained.shape, -np.inf)
        log_prior[:L, :M] = model.log_prior
        actual = np.array(log_joint(tables, jnp.asarray(log_prior), jnp.asarray(observed(model, tap[0]))))

    np.testing.assert_allclose(actual[:L, :M], expected, rtol=1e-12)
    actual[:L, :M] = -np.inf
    assert np.isneginf(actual).all()


STATES = States(np.array([1.0, 1.3, 0.8, 1.1, 1.0]), np.array([0.0, 0.2, -0.1, 0.5, 0.3]), np.log(np.full(5, 0.2)))


@pytest.mark.parametrize(
    ("name", "at_once"),
    [
        pytest.param("histogram", 2**23, marks=pytest.mark.slow),
        pytest.param("profile-ar", 2**23, marks=pytest.mark.slow),
        pytest.param("matrix-normal", 2**23, marks=pytest.mark.slow),
        pytest.param("histogram", 300, marks=pytest.mark.slow),
        ("matrix-normal", 300),
    ],
)
def test_any_model_is_enumerated_over_where_session_and_what(make_taps, monkeypatch, name, at_once):
    """Whether all hypotheses fit into memory at once or a few at a time; with a belief that tells states apart."""
    monkeypatch.setattr(enumeration, "_AT_ONCE", at_once)
    log_joint.clear_cache()
    enumeration._of_taps.clear_cache()
    taps = make_taps(L=3, M=2, J=7, K=4)
    model = replace(fit_model(name, taps, taps.grid(), FitSettings(bins=6)).model, states=STATES)
    log_belief = np.log(np.random.default_rng(1).dirichlet(np.ones(3 * 5 * 2))).reshape(3, 10)
    log_belief[1, 4:6], log_belief[:, 2:4] = -np.inf, -np.inf
    with jax.enable_x64(True):
        tables = touch_tables(model)
        for tap in taps.taps[:3]:
            seen = jnp.asarray(observed(model, tap))
            expected = model.log_likelihood(tap[None])[0]
            actual = log_joint(tables, jnp.asarray(log_belief), seen)
            alone = log_likelihoods(model, tap[None])[0]
            total = np.logaddexp.reduce(log_belief.ravel())
            np.testing.assert_allclose(actual, log_belief - total + expected, rtol=1e-10)
            np.testing.assert_allclose(model.exponent * alone, expected, rtol=1e-10)
        assert log_likelihoods(model, tap[None][:0]).shape == (0, *alone.shape)


def test_sites_have_the_names_of_what_is_unknown(make_model, draw_samples):
    """Where, what and session are drawn, the samples are observed."""
    model, trace = replace(make_model(), states=STATES), {}
    with jax.enable_x64(True):
        tap = observed(model, draw_samples(make_model(), 1)[0])
        arguments = touch_tables(model), model.log_prior.reshape(3, 5, 4), tap
        traced = handlers.trace(handlers.seed(one_tap, 0))
        jax.eval_shape(lambda *some: trace.update(traced.get_trace(*some)), *arguments)

    drawn = {name for name, site in trace.items() if site["type"] == "sample" and not site["is_observed"]}
    assert drawn == {"session", "where", "what"}
    assert trace["bins"]["fn"].batch_shape == (5, 4)
    assert (trace["J"]["type"], trace["K"]["type"]) == ("plate", "plate")
