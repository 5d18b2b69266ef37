"""Likelihoods by the NumPyro stories: errors of the compiled loops are found; numbers to 40 digits."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import numpyro.distributions as dist
import pytest
from scipy.stats import norm, uniform
from slow_cases import slow_but
from solidtouch.models.measurement.generic.observed import Binned, InBin
from solidtouch.models.measurement.likelihood import shapes
from solidtouch.models.measurement.likelihood.story_likelihood import in_state, log_likelihoods
from solidtouch.models.measurement.registry import fit_model, measurement_model
from solidtouch.models.measurement.scaling import least_deviation
from solidtouch.models.measurement.shared_gain import state_grid
from solidtouch.models.measurement.story import ParametricModel
from solidtouch.models.settings import FitSettings

L, M, J, K = 3, 2, 4, 3
KINDS = ["histogram", "gaussian", "student", "profile", "profile-ar", "profile-mvn", "matrix-normal", "smooth"]
TABLES = ["histogram", "gaussian", "student"]
TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def fitted(make_taps, as_student):
    """Every kind of model with parameters that all differ; those of slow fits are made from others."""
    taps = make_taps(L=L, M=M, J=J, K=K)
    rng = np.random.default_rng(0)
    taps.dataset["taps"][:] += rng.normal(size=(len(taps), J, K))
    fast = [kind for kind in KINDS if kind not in ("student", "smooth", "matrix-normal")]
    models = {kind: fit_model(kind, taps, taps.grid(), FitSettings(bins=20)).model for kind in fast}
    profile = models["profile"]
    models["student"] = as_student(models["gaussian"])
    basis = np.stack([np.eye(L), 0.8 * np.eye(L) + 0.2 * np.roll(np.eye(L), 1, axis=1)])
    weight = {"weight": np.moveaxis(profile.parameters["level"], 0, -1), "variance": profile.parameters["variance"]}
    models["smooth"] = replace(profile, story=measurement_model("smooth"), basis=basis, parameters=weight)
    roots = rng.normal(size=(L, M, K, K)), rng.normal(size=(J, J))
    covariances = [root @ root.swapaxes(-1, -2) / len(root.T) + np.eye(len(root.T)) for root in roots]
    parameters = {
        "level": profile.parameters["level"],
        "taxel_covariance": covariances[0],
        "time_covariance": covariances[1],
    }
    models["matrix-normal"] = replace(profile, story=measurement_model("matrix-normal"), parameters=parameters)
    return models, np.concatenate([taps.taps[:6], taps.taps[:1] + 40.0])


def gap(model, taps):
    """Largest relative difference between compiled loops and story."""
    compiled = np.empty((len(taps), *model.form.shape))
    model.prepared.log_likelihood(taps, model.edges, 1.0, compiled)
    story = log_likelihoods(model, taps)
    assert story.shape == compiled.shape
    return (np.abs(story - compiled) / np.maximum(1.0, np.abs(compiled))).max()


def in_states(model):
    return replace(model, states=state_grid(0.1, 0.3, 3, 2))


@pytest.mark.parametrize("kind", slow_but(["histogram", "student", "profile-ar", "matrix-normal"], KINDS))
def test_bins_of_each_taxel(fitted, kind):
    """With edges of their own."""
    model, taps = fitted[0][kind], fitted[1]
    edges = np.linspace(-3.0, 9.0, 21) * np.array([[1.0], [1.3], [0.8]])

    assert gap(in_states(replace(model, edges=edges)), taps) < TOLERANCE


@pytest.mark.parametrize("kind", ["gaussian", "student", "profile", "matrix-normal"])
def test_a_taxel_at_rest(fitted, kind):
    """Its deviation counts as that of a uniform draw from a bin."""
    model, taps = fitted[0][kind], fitted[1]
    name = {"student": "scale", "matrix-normal": "taxel_covariance"}.get(kind, "variance")
    parameters = {**model.parameters, name: model.parameters[name] * 1e-6}
    model = replace(model, parameters=parameters)

    assert gap(in_states(model), taps) < TOLERANCE


@pytest.mark.parametrize("kind", ["gaussian", "histogram"])
def test_one_of_everything(make_taps, kind):
    """One class, taxel and sample."""
    taps = make_taps(L=1, M=1, J=1, K=1)
    model = fit_model(kind, taps, taps.grid(), FitSettings(bins=5)).model

    assert gap(model, taps.taps[:3]) < TOLERANCE


@pytest.mark.parametrize("kind", slow_but(["matrix-normal"], ["profile-mvn", "matrix-normal"]))
@pytest.mark.parametrize("wide", slow_but([100], [2, 100]))
def test_one_sample_of_dependent_taxels(make_taps, monkeypatch, kind, wide):
    """Such as a feature vector, whitened by a loop of its own or by products of matrices."""
    monkeypatch.setattr("solidtouch.models.measurement.likelihood.forms._WIDE", wide)
    taps = make_taps(L=2, M=3, J=1, K=6)
    taps.dataset["taps"][:] += np.random.default_rng(1).normal(size=(len(taps), 1, 1))  # so that taxels go together
    model = fit_model(kind, taps, taps.grid(), FitSettings(bins=20, unconverged=True)).model
    wrong = replace(model)
    wrong.__dict__["plain_form"] = bent(model.plain_form, "taxel")

    assert gap(in_states(model), taps.taps[:5]) < TOLERANCE
    assert gap(wrong, taps.taps[:5]) > TOLERANCE


def test_a_bin_that_never_occurred_is_impossible_for_both(make_taps):
    """In a histogram without pseudocount."""
    taps = make_taps(L=2, M=1)
    model = fit_model("histogram", taps, taps.grid(), FitSettings(bins=30, pseudocount=0.0)).model
    story, compiled = log_likelihoods(model, taps.taps), model.log_likelihood(taps.taps) / model.exponent

    np.testing.assert_array_equal(np.isneginf(story), np.isneginf(compiled))
    assert np.isneginf(story).any()


def bent(form, part):
    """The form with one class or factor a millionth off."""
    values = np.array(getattr(form, part))
    values[(..., -1, 0) if part in ("time", "taxel") else 0] += 1e-6
    return form._replace(**{part: values})


ERRORS = [("gaussian", "log_prob"), ("student", "log_prob")]
ERRORS += [(kind, part) for kind in KINDS if kind not in TABLES for part in ("mean", "scale", "log_weight")]
ERRORS += [("profile-ar", "time"), ("profile-mvn", "taxel"), ("matrix-normal", "time"), ("matrix-normal", "taxel")]


TOLD_APART = [("gaussian", "log_prob"), ("student", "log_prob"), *ERRORS[-4:]]
TOLD_APART += [("smooth", "log_weight"), ("profile", "mean"), ("profile-ar", "scale"), ("matrix-normal", "log_weight")]


@pytest.mark.parametrize(("kind", "part"), slow_but(TOLD_APART, ERRORS))
def test_an_error_in_the_form_is_found(fitted, kind, part):
    """Engines share it, so that they agree on it."""
    model, taps = replace(fitted[0][kind]), fitted[1]
    model.__dict__["plain_form"] = bent(model.plain_form, part)

    assert gap(model, taps) > TOLERANCE


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("part", ["gain", "offset"])
def test_an_error_in_a_state_is_found(fitted, kind, part):
    model, taps = in_states(fitted[0][kind]), fitted[1]
    states = model.states
    wrong = replace(model, states=states._replace(**{part: getattr(states, part) + 1e-6}))
    wrong.__dict__["form"] = wrong.form
    object.__setattr__(wrong, "states", states)

    assert gap(wrong, taps) > TOLERANCE


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "histogram"])
def test_an_error_in_the_units_is_found(fitted, monkeypatch, kind):
    """The origin of a taxel, as the form has it."""
    model, taps = replace(fitted[0][kind]), fitted[1]
    scaling = model.scaling
    frame = shapes.Measure(scaling._replace(centre=scaling.centre + 1e-6), model.edges, model.basis)
    monkeypatch.setattr(ParametricModel, "frame", frame)

    assert gap(model, taps) > TOLERANCE


def test_the_least_deviation_is_that_of_a_uniform_draw_from_a_bin():
    """Both likelihoods take it from here."""
    edges = np.array([0.0, 1.0, 2.0]) * np.array([[1.0], [3.0]])

    np.testing.assert_allclose(least_deviation(edges, 2), [uniform(0, 1).std(), uniform(0, 3).std()])
    np.testing.assert_allclose(least_deviation(edges[0], 2), uniform(0, 1).std())


def test_an_error_in_the_least_deviation_is_found(fitted, monkeypatch):
    model, taps = fitted[0]["profile"], fitted[1]
    variance = model.parameters["variance"] * 1e-6
    right = shapes.least_deviation
    monkeypatch.setattr(shapes, "least_deviation", lambda edges, K: 1.001 * right(edges, K))

    assert gap(replace(model, parameters={**model.parameters, "variance": variance}), taps) > TOLERANCE


@jax.jit
def of_bin(lower, upper):
    """Log probability of a bin under a normal and a Student's t."""
    bases = dist.Normal(0.0, 1.0), dist.StudentT(4.0, 0.0, 1.0)
    taps = Binned(*map(jnp.asarray, (lower, lower, upper, upper - lower)))
    return jnp.stack([InBin(base, taps).log_prob(0.0) for base in bases])


@pytest.mark.parametrize(("lower", "upper"), [(-0.1, 0.2), (4.0, 4.1), (-12.1, -12.0), (30.0, 30.2), (19.95, 20.05)])
def test_the_probability_of_a_bin(lower, upper):
    """Near and far out, under a normal and a Student's t."""
    with mpmath.workdps(40), jax.enable_x64(True):
        low, high = sorted((abs(lower), abs(upper))) if lower * upper > 0 else (lower, upper)
        normal = mpmath.log(mpmath.ncdf(-low) - mpmath.ncdf(-high))

        def tail(z):
            return mpmath.betainc(2, 0.5, 0, 4 / (4 + mpmath.mpf(z) ** 2), regularized=True) / 2

        student = mpmath.log(tail(low) - tail(high) if low > 0 else 1 - tail(low) - tail(high))
        np.testing.assert_allclose(of_bin(lower, upper), [float(normal), float(student)], rtol=3e-10)


def test_bins_in_a_state():
    """Samples uniform within their bins, moved and stretched: a quarter of the first bin goes to the second, ..."""
    edges, log_prob = np.array([[0.0, 1.0, 2.0]]), np.log([[[0.8, 0.2]]])
    with jax.enable_x64(True):
        moved, stretched = (np.exp(in_state(log_prob, jnp.asarray(edges), *state)) for state in ((1, 0.25), (1.5, 0)))

    # By 0.25 to the right: the gap on the left is filled at the density of the first bin.
    np.testing.assert_allclose(moved[0, 0], np.array([0.8, 0.25 * 0.8 + 0.2]) / 1.2)
    np.testing.assert_allclose(stretched[0, 0], [0.8 * 2 / 3, 0.8 / 3 + 0.2])


def test_the_story_of_one_sample(make_taps):
    """By the normal distribution function, in the unit of the samples."""
    taps = make_taps(L=2, M=2, J=1, K=1)
    model = fit_model("gaussian", taps, taps.grid(), FitSettings(bins=6)).model
    centre, unit = model.scaling
    level = model.parameters["level"][:, :, 0, 0] * unit[0] + centre[0]
    deviation = np.sqrt(model.parameters["variance"][:, :, 0, 0]) * unit[0]
    low, high = model.edges[2:4]

    expected = np.log(norm.cdf(high, level, deviation) - norm.cdf(low, level, deviation))
    np.testing.assert_allclose(log_likelihoods(model, np.array([[[0.5 * (low + high)]]]))[0], expected, rtol=1e-10)
