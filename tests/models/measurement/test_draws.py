"""Draws of parameters, and what they say of the training taps."""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from solidtouch.inference.filter import log_fold
from solidtouch.models.errors import InputError
from solidtouch.models.measurement import registry
from solidtouch.models.measurement.draws import posterior_draws
from solidtouch.models.measurement.fits.posterior import SamplePosterior
from solidtouch.models.measurement.likelihood.bins import TableForm
from solidtouch.models.measurement.model import in_states
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings

L, M, J, K, B = 3, 4, 6, 5, 9
CHAINS, DRAWS = 2, 3
NAMES = [*registry.NAMES, "session:profile-mvn"]


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(L, M, J, K, sessions=2, repeats=2)


class Varied(NamedTuple):
    """A posterior of all parameters within some percent."""

    parameters: dict[str, NDArray[np.float64]]

    def draw(self, generator):
        return {k: v * np.exp(0.03 * generator.standard_normal(v.shape)) for k, v in self.parameters.items()}


@pytest.fixture(scope="module")
def fitted(taps, as_student):
    """All models by name; `student`, whose fit takes long, with the parameters of `gaussian`."""
    settings = FitSettings(bins=B, unconverged=True, gain_sd=0.05, offset_sd=0.4)
    models = {name: fit_model(name, taps, taps.grid(), settings) for name in NAMES if name != "student"}
    student = as_student(models["gaussian"].model)
    return models | {"student": models["gaussian"]._replace(model=student, posterior=Varied(student.parameters))}


@pytest.mark.parametrize("name", NAMES)
def test_every_tap_has_its_probability_under_the_drawn_parameters(fitted, taps, name):
    """That of its class in the model's form, each state weighted as before any tap."""
    model = fitted[name].model
    counted = []
    draws = posterior_draws(fitted[name], taps, CHAINS, DRAWS, 5, counted.append)
    where, what = taps.indices(model.grid)

    assert draws.log_likelihood.shape == (CHAINS, DRAWS, len(taps))
    assert draws.log_likelihood.dtype == np.float32
    assert set(draws.parameters) == set(model.dims)
    assert counted == [1] * (CHAINS * DRAWS)
    for chain, number in np.ndindex(CHAINS, DRAWS):
        parameters = {key: values[chain, number].astype(float) for key, values in draws.parameters.items()}
        form = (
            TableForm(parameters["log_prob"])
            if model.kind == "histogram"
            else model.story.form(parameters, model.frame)
        )
        joint = np.empty((len(taps), L, M * len(model.states.gain)))
        every = in_states(form, model.states, model.edges)
        every.prepare(np.zeros(joint.shape[1:], bool)).log_likelihood(taps.taps, model.edges, 1.0, joint)
        expected = log_fold(joint + np.repeat(model.states.log_prior, M), M)[np.arange(len(taps)), where, what]
        np.testing.assert_allclose(draws.log_likelihood[chain, number], expected, rtol=2e-5, atol=2e-4)


@pytest.mark.parametrize("name", ["histogram", "profile-ar", "student"])
def test_draws_follow_their_seed(fitted, taps, name):
    """The same draws for one seed, whatever is asked for besides; all of them different from each other."""
    few, more, others = (
        posterior_draws(fitted[name], taps, *arguments) for arguments in ((1, 2, 0), (1, 4, 0), (1, 2, 1))
    )
    for key, values in few.parameters.items():
        np.testing.assert_array_equal(values, more.parameters[key][:, :2])
        assert len(np.unique(more.parameters[key].reshape(4, -1)[:, 0])) == 4
        assert not np.array_equal(values, others.parameters[key])


@pytest.mark.parametrize("name", ["gaussian", "profile"])
def test_draws_gather_around_the_parameters_that_decide(fitted, taps, name):
    """Their mean level is the expected one within five standard errors."""
    draws = posterior_draws(fitted[name], taps, 4, 60, 0).parameters["level"].reshape(240, -1).astype(float)
    error = draws.std(axis=0, ddof=1) / np.sqrt(240)

    assert (np.abs(draws.mean(axis=0) - fitted[name].model.parameters["level"].ravel()) < 5 * error).all()


@pytest.mark.parametrize(("draws", "kept"), [(4, [0, 3, 6, 10]), (30, range(11))])
def test_markov_chains_stay_chains(fitted, taps, draws, kept):
    """Evenly thinned, or all of them; what is said of their mixing would else be of independent draws."""
    model = fitted["gaussian"].model
    spread = np.exp(0.03 * np.random.default_rng(0).normal(size=(5, 11)))
    known = {name: np.multiply.outer(spread, values) for name, values in model.parameters.items()}
    chains = fitted["gaussian"]._replace(posterior=SamplePosterior(known, {}))
    found = posterior_draws(chains, taps, CHAINS, draws * 5 // CHAINS, 0)

    np.testing.assert_allclose(found.parameters["level"], known["level"][:, kept], rtol=1e-6)
    assert found.log_likelihood.shape == (5, len(kept), len(taps))


def test_taps_of_no_trained_class_are_left_out(fitted, taps, make_taps):
    other = make_taps(L + 1, M, J, K, sessions=2, repeats=2)

    assert posterior_draws(fitted["gaussian"], other, 1, 1, 0).log_likelihood.shape == (1, 1, len(taps))


def test_an_improper_posterior_has_no_draws(taps):
    fitted = fit_model("histogram", taps, taps.grid(), FitSettings(bins=B, pseudocount=0.0))

    with pytest.raises(InputError, match="A histogram model without a pseudocount has no posterior to draw from"):
        posterior_draws(fitted, taps, 4, 5, 0)


@pytest.mark.parametrize(("chains", "draws"), [(0, 3), (2, 0)])
def test_there_is_a_draw_and_a_chain_at_least(fitted, taps, chains, draws):
    with pytest.raises(InputError, match=f"at least 1, got {draws} and {chains}"):
        posterior_draws(fitted["gaussian"], taps, chains, draws, 0)
