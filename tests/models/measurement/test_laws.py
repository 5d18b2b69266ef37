"""Laws that every built-in model keeps: what it does fast is what its generative model says."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.models.measurement.generic.contract import StoryFunction
from solidtouch.models.measurement.generic.story import batch_of
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.story_likelihood import log_likelihoods
from solidtouch.models.measurement.registry import KINDS, fit_model, measurement_model
from solidtouch.models.measurement.shared_gain import state_grid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, J, K = 3, 2, 5, 4
STORIES = [kind for kind in KINDS if kind != "histogram"]
TOLERANCE = 1e-9


def correlated(n=7, J=J, K=K, seed=0):
    """Taps with n of each class but (1, 1), whose samples depend on those before and on other taxels."""
    rng = np.random.default_rng(seed)
    where, what = (index.ravel() for index in np.indices((L, M, n))[:2])
    used = (where != 1) | (what != 1)
    where, what = where[used], what[used]
    samples = (
        rng.normal(size=(len(where), J, K)).cumsum(axis=1).cumsum(axis=2)
        + where[:, None, None]
        + 2 * what[:, None, None]
    )
    about = {"where_unit": "mm", "preprocessing": Preprocessing(samples=J, rate_hz=50.0)}
    return TapSet.from_arrays(samples, what, ["rod", "plate"], where=1.5 * where, **about)


@pytest.fixture(scope="module")
def taps():
    return correlated()


@pytest.fixture(scope="module")
def fitted(taps, as_student):
    """Every model fitted, but `student`, whose fit takes long."""
    settings, grid = FitSettings(bins=80), taps.grid()
    fits = {kind: fit_model(kind, taps, grid, settings) for kind in KINDS if kind != "student"}
    fits["student"] = fits["gaussian"]._replace(model=as_student(fits["gaussian"].model))
    return fits


def in_states(model):
    return replace(model, states=state_grid(0.1, 0.3, 3, 2))


def integrated(fit, rng):
    """A model that decides by the mean over parameters around the fitted ones."""
    model = fit.model
    if model.kind == "student":
        near = [{name: values * rng.uniform(0.9, 1.1) for name, values in model.parameters.items()} for _ in range(3)]
        return replace(model, draws=tuple(near))
    return fit.integrated(3, 1).model


# Likelihoods -------------------------------------------------------------------------------------------------------


def gap(model, taps):
    """Largest difference between fast likelihoods and those of the generative model, relative above 1."""
    fast = np.empty((len(taps), *model.form.shape))
    model.prepared.log_likelihood(taps, model.edges, 1.0, fast)
    story, trained = log_likelihoods(model, taps), ~np.isneginf(model.log_prior)
    assert story.shape == fast.shape
    fast, story = fast[:, trained], story[:, trained]
    return (np.abs(story - fast) / np.maximum(1.0, np.abs(fast))).max()


@pytest.mark.parametrize("states", [False, True], ids=["", "session"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_fast_likelihood_is_that_of_the_story(fitted, taps, kind, states):
    """Under every trained class and state, for taps near and far, of models fitted to correlated taps."""
    model = in_states(fitted[kind].model) if states else fitted[kind].model

    assert gap(model, np.concatenate([taps.taps[::9], taps.taps[:1] + 40.0])) < TOLERANCE


@pytest.mark.parametrize("kind", KINDS)
def test_so_is_the_likelihood_that_is_integrated_over_draws(fitted, taps, rng, kind):
    """In states, too."""
    assert gap(in_states(integrated(fitted[kind], rng)), taps.taps[::17]) < TOLERANCE


# The contract ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", STORIES)
def test_a_story_keeps_the_contract_of_own_models(taps, kind):
    """Run with its defaults and nothing known of it, it has the structure that its file says."""
    model = measurement_model(kind)
    story = StoryFunction.of(model.story, kind)
    structure = structure_of(story, batch_of(taps.grid(), taps.preprocessing, K))

    assert not structure.swapped
    assert structure.measure == "bins"
    assert structure.exchangeable == model.exchangeable
    assert not structure.enumerated
    assert not structure.by_session


@pytest.mark.parametrize("kind", STORIES)
def test_a_story_without_taps_simulates_what_the_model_draws(fitted, kind, rng):
    """Mean and covariance over time and taxels of taps of one class, by the story and by the fast form."""
    model, n = fitted[kind].model, 20_000
    where, what = np.full(n, 2), np.ones(n, dtype=int)
    (form, *_) = model.by_story(model.parameters)
    drawn = [one.sample(where, what, model.edges, J, rng).reshape(n, -1) for one in (form, model.plain_form)]
    means, covariances = [one.mean(axis=0) for one in drawn], [np.cov(one.T) for one in drawn]
    spread = np.sqrt(np.diagonal(covariances[1]))

    np.testing.assert_allclose((means[0] - means[1]) / spread, 0, atol=0.05)
    if kind != "student":  # which has hardly a variance
        np.testing.assert_allclose((covariances[0] - covariances[1]) / np.outer(spread, spread), 0, atol=0.07)
