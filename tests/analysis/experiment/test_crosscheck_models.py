"""Every measurement model goes through every engine, and all of them agree."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.experiment import trial_check
from solidtouch.analysis.experiment.crosscheck import STORY, crosscheck_model
from solidtouch.inference import reference_models as plain
from solidtouch.inference.engines import enumeration
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.reference import BORDERS
from solidtouch.models.errors import InputError
from solidtouch.models.measurement import registry
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.touch import KERNEL_BORDERS

L, M, J, K, B = 4, 3, 6, 5, 8
UNTRAINED = (1, 2)
NAMES = [*registry.NAMES, "session:profile"]
IN_STATES = ["session", "session:profile"]
BY_HAND = ["student", "smooth"]
LENGTH, SEQUENCE = 5, 2


def by_hand(name, fitted):
    """The two models whose fits take long, from parameters of others."""
    profile, gaussian = fitted["profile"], fitted["gaussian"]
    if name == "student":
        level, variance = gaussian.parameters["level"], gaussian.parameters["variance"]
        parameters = {"level": level, "scale": np.sqrt(variance), "freedom": np.linspace(2.5, 9.0, K)}
        return replace(gaussian, story=registry.measurement_model(name), parameters=parameters)
    basis = np.stack([np.eye(L), 0.7 * np.eye(L) + 0.3 * np.roll(np.eye(L), 1, axis=1)])
    weight = np.moveaxis(profile.parameters["level"], 0, -1)
    return replace(
        profile,
        story=registry.measurement_model(name),
        basis=basis,
        parameters={"weight": weight, "variance": profile.parameters["variance"]},
    )


@pytest.fixture
def compiled_loops_alone(monkeypatch):
    """Trials without XLA, which compiles for every number of them."""
    monkeypatch.setattr(trial_check, "DEVICES", ("cpu",))


@pytest.fixture(scope="module")
def taps(make_taps):
    """Noisy taps, so that classes are mistaken for each other."""
    made = make_taps(L=L, M=M, J=J, K=K)
    made.dataset["taps"][:] += 2 * np.random.default_rng(1).normal(size=(len(made), J, K))
    where, what = made.indices(made.grid())
    return made.select((where != UNTRAINED[0]) | (what != UNTRAINED[1]))


@pytest.fixture(scope="module")
def models(taps):
    """All models of the catalogue, by name, with an untrained class."""
    fast = [name for name in NAMES if name not in BY_HAND]
    fitted = {name: fit_model(name, taps, taps.grid(), FitSettings(bins=B)).model for name in fast}
    return fitted | {name: by_hand(name, fitted) for name in BY_HAND}


def follow(engine, taps, deltas):
    log_belief, log_beliefs, log_evidence = engine.model.log_prior, [], []
    for tap, delta in zip(taps, deltas, strict=True):
        log_belief, evidence = engine.update(engine.shift(log_belief, delta), tap)
        log_beliefs.append(log_belief)
        log_evidence.append(evidence)
    return np.array(log_beliefs), np.array(log_evidence)


def failed(check):
    return {row.routes for row in check.rows if not row.passed}


@pytest.mark.parametrize("name", NAMES)
def test_models_are_what_their_names_say(models, name):
    """In states where the name says so, and with an untrained class everywhere."""
    model = models[name]

    assert model.name == name
    assert (len(model.states.gain) > 1) == (name in IN_STATES)
    assert not model.trained[UNTRAINED]
    assert model.trained.sum() == L * M - 1


PAIRS = [pair for pair in product(NAMES, BORDERS) if pair[0] not in IN_STATES or pair[1] != "prior"]
BY_DEFAULT = [
    ("histogram", "uniform"),
    ("gaussian", "prior"),
    ("student", "circular"),
    ("profile", "uniform_what"),
    ("session", "uniform"),
    ("session", "clamp"),
]
"""Every border, two of them in states, and models of every kind that compile in a few seconds."""


@pytest.mark.parametrize(("name", "border"), slow_but(BY_DEFAULT, PAIRS))
def test_engines_agree_on_every_model(models, taps, name, border):
    """On taps with outliers and moves beyond the range; the posterior moves, and never to the untrained class."""
    model, rng = models[name], np.random.default_rng(3)
    recorded = taps.taps[rng.integers(len(taps), size=9)].astype(np.float64)
    recorded[4, 2, 3] += 40.0
    deltas = [0, 2, -1, 0, -L - 1, 1, 3, -2, L]
    engines = [make_engine(e, model, border) for e in ("numpy", "filter", "numpyro")[: 2 + (border in KERNEL_BORDERS)]]
    (expected, evidence), *others = [follow(engine, recorded, deltas) for engine in engines]

    for log_beliefs, log_evidence in others:
        np.testing.assert_allclose(np.exp(log_beliefs), np.exp(expected), rtol=0, atol=1e-10)
        np.testing.assert_allclose(log_beliefs, expected, rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(log_evidence, evidence, rtol=0, atol=1e-10)
    assert np.isneginf(expected[:, UNTRAINED[0], UNTRAINED[1] :: M]).all()
    assert 0.01 < np.exp(expected).max(axis=(1, 2)).min() < 0.9


@pytest.mark.parametrize(
    ("engine", "message"),
    [
        ("numpy", "border 'prior' does not support models that carry a state"),
        ("filter", "border 'prior' does not support models that carry a state"),
        ("numpyro", "The NumPyro models do not support border 'prior'"),
    ],
)
@pytest.mark.parametrize("name", IN_STATES)
def test_prior_does_not_go_with_states(models, name, engine, message):
    with pytest.raises(InputError, match=message):
        make_engine(engine, models[name], "prior")


@pytest.mark.parametrize("name", slow_but(["histogram"], NAMES))
def test_all_routes_agree_on_every_model(models, taps, name):
    """The whole sequence too, and trials on both devices."""
    check = crosscheck_model(models[name], taps, episodes=2, length=LENGTH, sequence_taps=SEQUENCE)

    assert failed(check) == set()
    assert check.passed
    assert (check.sequence_taps, check.notes) == (SEQUENCE, ())
    assert {row.routes for row in check.rows} == {
        STORY,
        "numpy, numpyro",
        "numpy, filter",
        "numpy, numpyro sequence",
        "numpy, cpu trials",
        "numpy, xla-cpu trials",
    }


def bent(form):
    """The form with one class a millionth off."""
    if hasattr(form, "log_prob"):
        log_prob = np.array(form.log_prob)
        log_prob[2, 0] *= 1 + 1e-6
        return form._replace(log_prob=log_prob)
    mean = np.array(form.mean)
    mean[:, 2, 0] += 1e-6
    return form._replace(mean=mean)


@pytest.mark.parametrize("name", slow_but(["student"], NAMES))
def test_an_error_of_a_millionth_in_one_engine_is_found(models, taps, monkeypatch, compiled_loops_alone, name):
    """In the tables of the NumPyro model, of the compiled loops and of the yardstick, on every model."""
    model = models[name]
    sizes = {"episodes": 1, "length": LENGTH, "sequence_taps": 0}

    with monkeypatch.context() as patch:
        right = enumeration.touch_tables
        patch.setattr(enumeration, "touch_tables", lambda m: right(m)._replace(form=bent(m.form)))
        assert failed(crosscheck_model(model, taps, **sizes)) == {"numpy, numpyro"}

    wrong = replace(model)
    wrong.__dict__["prepared"] = bent(model.form).prepare(np.isneginf(model.log_prior))
    found = failed(crosscheck_model(wrong, taps, **sizes))
    assert "numpy, filter" in found
    assert "numpy, numpyro" not in found

    if name != "histogram":
        right_likelihood = plain.log_likelihood
        monkeypatch.setattr(plain, "log_likelihood", lambda tap, form, *more: right_likelihood(tap, bent(form), *more))
        assert {"numpy, numpyro", "numpy, filter"} <= failed(crosscheck_model(model, taps, **sizes))


def test_an_error_that_all_engines_share_is_found(models, taps, compiled_loops_alone):
    """In the form of the model: only the story knows better."""
    for name in ("gaussian", "profile-mvn"):
        wrong = replace(models[name])
        wrong.__dict__["plain_form"] = bent(wrong.plain_form)
        check = crosscheck_model(wrong, taps, episodes=1, length=LENGTH, sequence_taps=0, border="prior")

        assert failed(check) == {STORY}


def test_a_route_that_leaks_between_states_is_found(models, taps, monkeypatch, compiled_loops_alone):
    """Moves that mix the belief of two states a little."""
    right = enumeration.NumpyroEngine.shift

    def leaking(self, log_belief, delta):
        belief = np.exp(right(self, log_belief, delta))
        with np.errstate(divide="ignore"):
            return np.log(0.999999 * belief + 1e-6 * np.roll(belief, M, axis=1))

    monkeypatch.setattr(enumeration.NumpyroEngine, "shift", leaking)
    check = crosscheck_model(models["session"], taps, episodes=1, length=LENGTH, sequence_taps=0)

    assert failed(check) == {"numpy, numpyro"}


def test_a_likelihood_is_not_compared_with_itself(models, taps, monkeypatch):
    """A model that runs its story has no row of it, but a note."""
    monkeypatch.setattr(type(models["gaussian"]), "runs_story", True)
    check = crosscheck_model(models["gaussian"], taps, episodes=2, length=LENGTH, sequence_taps=SEQUENCE)

    assert STORY not in {row.routes for row in check.rows}
    assert "gaussian runs its function for every tap" in check.notes[0]
