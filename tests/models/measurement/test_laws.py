"""Laws that every built-in model keeps: what it does fast is what its generative model says."""

from dataclasses import replace
from importlib import import_module

import arviz as az
import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.models.measurement.generic import fit as generic_fit
from solidtouch.models.measurement.generic.contract import StoryFunction
from solidtouch.models.measurement.generic.form import GenericForm
from solidtouch.models.measurement.generic.runs import Given, Program
from solidtouch.models.measurement.generic.story import GenericModel, batch_of
from solidtouch.models.measurement.generic.structure import structure_of
from solidtouch.models.measurement.likelihood.bins import TableForm
from solidtouch.models.measurement.likelihood.story_likelihood import log_likelihoods
from solidtouch.models.measurement.registry import KINDS, fit_model, model_name
from solidtouch.models.measurement.scaling import Scaling
from solidtouch.models.measurement.shared_gain import state_grid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, J, K = 3, 2, 5, 4
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


def story_of(kind):
    """Generative model of a name."""
    return import_module(f"solidtouch.models.measurement.{kind.replace('-', '_')}").story


def by_story(model):
    """Form that runs the generative model at the fitted parameters; of several places in a class, at the first one."""
    if model.kind != "histogram":
        return model.by_story(model.parameters)[0]
    batch = batch_of(model.grid, model.preprocessing, K)
    story = StoryFunction.of(story_of("histogram"), "histogram")
    program = Program(story, structure_of(story, batch), batch)
    given = Given({"p": model.probabilities}, {"edges": model.edges})
    return GenericForm(program, (given,), Scaling(np.zeros(K), np.ones(K)))


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


IN_STATES = ("histogram", "profile", "matrix-normal")
"""Models that are judged in states alone; the others also are, integrated over draws, and here where tests are slow."""


@pytest.mark.parametrize(
    ("kind", "states"),
    [
        *(pytest.param(kind, False, id=kind) for kind in KINDS),
        *(
            pytest.param(kind, True, id=f"{kind}-session", marks=[pytest.mark.slow] * (kind not in IN_STATES))
            for kind in KINDS
        ),
    ],
)
def test_the_fast_likelihood_is_that_of_the_story(fitted, taps, kind, states):
    """Under every trained class and state, for taps near and far, of models fitted to correlated taps."""
    model = in_states(fitted[kind].model) if states else fitted[kind].model

    assert gap(model, np.concatenate([taps.taps[::9], taps.taps[:1] + 40.0])) < TOLERANCE


@pytest.mark.parametrize("kind", slow_but(("histogram", "profile-mvn"), KINDS))
def test_so_is_the_likelihood_that_is_integrated_over_draws(fitted, taps, rng, kind):
    """In states, too."""
    assert gap(in_states(integrated(fitted[kind], rng)), taps.taps[::17]) < TOLERANCE


@pytest.mark.parametrize("value_range", slow_but(["taxel"], ("global", "taxel")))
def test_tables_of_histograms_are_those_of_their_story(taps, value_range):
    """`crosscheck` takes the tables as they are, as draws of rare bins are too small for plain probabilities."""
    model = fit_model("histogram", taps, taps.grid(), FitSettings(bins=9, value_range=value_range)).model
    story, own = by_story(model), (taps.taps, model.edges, *taps.indices(model.grid))

    np.testing.assert_allclose(story.table(model.edges)[model.trained], model.log_prob[model.trained], rtol=1e-9)
    np.testing.assert_allclose(story.own(*own), model.form.own(*own), rtol=1e-9)


# The contract ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", slow_but(("histogram", "gaussian", "smooth"), KINDS))
def test_a_story_keeps_the_contract_of_own_models(fitted, taps, kind):
    """Run with its defaults and nothing known of it, it has the structure that its file says."""
    structure = structure_of(StoryFunction.of(story_of(kind), kind), batch_of(taps.grid(), taps.preprocessing, K))

    assert structure.exchangeable == isinstance(fitted[kind].model.plain_form, TableForm)
    assert structure.measure == "bins"
    assert not any((structure.swapped, structure.enumerated, structure.by_session))


@pytest.mark.parametrize("kind", slow_but(["profile-ar"], KINDS))
def test_a_story_without_taps_simulates_what_the_model_draws(fitted, kind, rng):
    """Mean and covariance over time and taxels of taps of one class, by the story and by the fast form."""
    model, n = fitted[kind].model, 20_000
    where, what = np.full(n, 2), np.ones(n, dtype=int)
    forms = by_story(model), model.plain_form
    drawn = [form.sample(where, what, model.edges, J, rng).reshape(n, -1) for form in forms]
    means, covariances = [one.mean(axis=0) for one in drawn], [np.cov(one.T) for one in drawn]
    spread = np.sqrt(np.diagonal(covariances[1]))

    np.testing.assert_allclose((means[0] - means[1]) / spread, 0, atol=0.05)
    if kind != "student":  # which has hardly a variance
        np.testing.assert_allclose((covariances[0] - covariances[1]) / np.outer(spread, spread), 0, atol=0.07)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["gaussian", "profile"])
def test_a_built_in_story_is_a_model_of_its_own(taps, kind, monkeypatch):
    """Fitted by the methods of own models, here to its most probable values, it has the levels of the fast fit."""
    monkeypatch.setattr(generic_fit, "check_prior", lambda _: "")
    settings = FitSettings(bins=40, power="none", unconverged=True)
    own = fit_model(model_name(story_of(kind)), taps, taps.grid(), settings.changed(method="map")).model
    fast = fit_model(kind, taps, taps.grid(), settings).model
    levels = [model.parameters["level"][fast.trained] for model in (own, fast)]

    assert isinstance(own, GenericModel)
    assert gap(own, taps.taps[::17]) < TOLERANCE
    np.testing.assert_allclose(*levels, atol=0.05)


# Fits --------------------------------------------------------------------------------------------------------------

EXACT = {"gaussian", "profile", "profile-ar"}
"""Models whose fast posterior is exact given the prior of the variances; the histogram has a test of its own."""
WIDTHS = {"student": 1.0}
"""By how many posterior deviations means may be off in fits that are not exact."""


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "J"), [*((kind, 2) for kind in KINDS if kind != "histogram"), ("matrix-normal", 1)])
def test_the_fast_fit_is_that_of_chains_on_the_story(kind, J, rng):
    """Posterior means of all parameters: within five Monte Carlo errors, or a quarter of the posterior's width.

    Variational inference of `student` takes its hierarchy for independent, and chains diverge in it now and then.
    """
    taps = correlated(n=8, J=J, K=2)
    settings = FitSettings(bins=20, unconverged=True)
    fast, slow = (fit_model(kind, taps, taps.grid(), settings.changed(method=method)) for method in ("closed", "nuts"))
    draws = [fast.posterior.draw(rng) for _ in range(2000)]

    assert slow.convergence.sentence.startswith("NUTS")
    assert slow.convergence.converged or kind == "student"
    np.testing.assert_array_equal(slow.model.basis, fast.model.basis)
    for name, dims in fast.model.dims.items():
        chains, drawn = slow.posterior.samples[name], np.stack([draw[name] for draw in draws])
        if dims[:2] == ("where", "what"):
            chains, drawn = chains[:, :, fast.model.trained], drawn[:, fast.model.trained]
        gap, spread = np.abs(chains.mean(axis=(0, 1)) - drawn.mean(axis=0)), chains.std(axis=(0, 1))
        effective = az.ess(az.from_dict({"posterior": {"it": chains}})["posterior"].dataset)["it"].values
        error = np.sqrt(spread**2 / effective + drawn.var(axis=0) / len(drawn))
        allowed = 5 * error if kind in EXACT or J == 1 else WIDTHS.get(kind, 0.25) * spread
        assert np.all((gap <= allowed) | (spread == 0)), name
