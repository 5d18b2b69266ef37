"""The route from raw taps beside all others: what they share is checked by it, and its own steps by them."""

from dataclasses import replace

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.experiment import trial_check
from solidtouch.analysis.experiment.crosscheck import STORY, crosscheck_model
from solidtouch.analysis.experiment.settings import ExperimentSettings
from solidtouch.inference import raw, reference
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement import histogram, model
from solidtouch.models.measurement.histogram import HistogramModel, trim
from solidtouch.models.settings import Division, FitSettings
from solidtouch.models.splits import load_experiment
from solidtouch.models.taps import TapSet

FIT, RECURSION, TRIALS = "fit, raw taps", "numpy, raw taps", "numpy, raw taps trials"
EMPTY = (1, 2)
SIZES = {"episodes": 3, "length": 5, "sequence_taps": 0, "border": "prior"}
"""Under the border that leaves the NumPyro engines out, which take long to compile."""


@pytest.fixture
def compiled_loops_alone(monkeypatch):
    """Trials without XLA, which compiles for every shape; they stand beside those from raw taps all the same."""
    monkeypatch.setattr(trial_check, "DEVICES", ("cpu",))


@pytest.fixture(scope="module")
def taps(make_taps):
    """Noisy taps of 4 x 3 classes, one of them without any."""
    made = make_taps(L=4, M=3, J=6, K=5)
    made.dataset["taps"][:] += 2 * np.random.default_rng(1).normal(size=(len(made), 6, 5))
    where, what = made.indices(made.grid())
    return made.select((where != EMPTY[0]) | (what != EMPTY[1]))


def fitted_by(**fit):
    return ExperimentSettings(fit=FitSettings(**fit))


def check(taps, *, train=True, settings=None, change=None, **more):
    """Session 0 trains and session 1 tests; `change` is made to the fitted model."""
    settings = settings or fitted_by(bins=8)
    parts = [taps.select(taps.session == session) for session in (0, 1)]
    fitted = settings.fitted(parts[0], taps.grid())
    fitted = fitted if change is None else change(fitted)
    return crosscheck_model(
        fitted, fitted.usable(parts[1]), train=parts[0] if train else None, settings=settings, **(SIZES | more)
    )


def failed(found):
    return {row.routes for row in found.rows if not row.passed}


OPTIONS = [
    ({}, "uniform"),
    ({"bins": 1}, "prior"),
    ({"power": "none"}, "clamp"),
    ({"power": "JK", "value_range": "taxel"}, "circular"),
    ({"power": 0.4, "pseudocount": 1.5}, "uniform_what"),
    ({"saturation": 2.5}, "prior"),
]


@pytest.mark.parametrize(("more", "border"), slow_but([OPTIONS[3], OPTIONS[5]], OPTIONS), ids=str)
def test_all_routes_agree_with_the_one_from_raw_taps(taps, compiled_loops_alone, more, border):
    """Whatever the user chooses."""
    found = check(taps, settings=fitted_by(**({"bins": 8} | more)), border=border)

    assert found.passed
    assert {FIT, RECURSION, TRIALS, STORY} <= {row.routes for row in found.rows}
    assert {row.quantity for row in found.rows if row.routes == FIT} == {
        "bin edges",
        "log histograms",
        "prior",
        "exponent",
    }


@pytest.mark.parametrize(
    ("L", "M", "J", "K"),
    slow_but(
        [(1, 1, 1, 1), (1, 4, 6, 5), (2, 2, 1, 1)],
        [(1, 1, 1, 1), (1, 4, 6, 5), (4, 1, 6, 5), (3, 2, 1, 5), (3, 2, 6, 1), (2, 2, 1, 1)],
    ),
)
def test_small_worlds(make_taps, compiled_loops_alone, L, M, J, K):
    """One position, object, sample or taxel."""
    assert check(make_taps(L=L, M=M, J=J, K=K)).passed


def test_a_grid_with_holes(make_taps, compiled_loops_alone):
    """A checkerboard, and one object with every second position only."""
    made = make_taps(L=6, M=3)
    where, what = made.indices(made.grid())

    assert check(made.select((where + what) % 2 == 0), length=8).passed
    assert check(made.select((what != 1) | (where % 2 == 0)), length=8, border="clamp").passed


def test_without_pseudocount_trials_end_without_a_class(make_taps, compiled_loops_alone):
    """For all routes alike."""
    made = make_taps(L=3, M=2, J=2, K=2)
    found = check(made, settings=fitted_by(bins=40, pseudocount=0.0), length=8)

    assert found.passed
    assert "end early" in " ".join(found.notes)


def test_test_taps_may_lie_beyond_the_training_range(taps, compiled_loops_alone):
    wide = TapSet(taps.dataset.copy(deep=True))
    wide.dataset["taps"][taps.session == 1] *= 2

    assert check(wide).passed


def test_a_learned_exponent_is_taken_over(make_taps, compiled_loops_alone):
    made = make_taps(sessions=3, repeats=3)
    parts = made.select(made.session < 2), made.select(made.session == 2)
    settings = fitted_by(bins=8, power="learned:2")
    fitted = settings.fitted(parts[0], made.grid())
    found = crosscheck_model(fitted, fitted.usable(parts[1]), train=parts[0], settings=settings, **SIZES)

    assert found.passed
    assert "takes the learned exponent" in " ".join(found.notes)


def test_other_models_have_no_such_route(taps, compiled_loops_alone):
    """Their likelihood is checked by their story."""
    found = check(taps, settings=fitted_by(bins=8).changed(model="gaussian"))

    assert found.passed
    assert {FIT, RECURSION, TRIALS}.isdisjoint(row.routes for row in found.rows)


def wider(samples, bins, value_range):
    low, high = float(samples.min()), float(samples.max())
    return np.linspace(low - 0.01 * (high - low), high, bins + 1)


def of_mixed_axes(samples, edges, own, shape):
    """Counts as if classes were stored objects first."""
    right = RIGHT_COUNTS(samples, edges, own, shape)
    return right.swapaxes(0, 1).reshape(right.shape)


RIGHT_COUNTS = histogram.class_counts


class AnyClass(HistogramModel):
    """Takes its prior over all classes, trained or not."""

    @property
    def log_prior(self):
        return np.full(self.grid.shape, -np.log(self.grid.L * self.grid.M))


class Tilted(HistogramModel):
    """Believes in the first trained class a millionth more."""

    @property
    def log_prior(self):
        prior = self.trained / self.trained.sum()
        prior.flat[prior.argmax()] *= 1 + 1e-6
        with np.errstate(divide="ignore"):
            return np.log(prior / prior.sum())


def of(kind):
    return lambda fitted: kind(**vars(fitted))


FITS = {
    "edges": (histogram, "bin_edges", wider, {"bin edges", "log histograms"}),
    "axes": (histogram, "class_counts", of_mixed_axes, {"log histograms", "prior"}),
    "exponent": (model, "likelihood_exponent", lambda *sizes: 1.0 / sizes[-1], {"exponent"}),
}
MODELS = {
    "pseudocount": (lambda fitted: replace(fitted, pseudocount=0.02), {"log histograms"}),
    "pseudocount of a millionth": (lambda fitted: replace(fitted, pseudocount=0.01 + 1e-8), {"log histograms"}),
    "prior": (of(Tilted), {"prior"}),
    "a lost tap": (lambda fitted: replace(fitted, counts=np.maximum(fitted.counts - 1, 0)), {"log histograms"}),
}


@pytest.mark.parametrize("name", FITS)
def test_an_error_in_the_fit_is_found(taps, monkeypatch, compiled_loops_alone, name):
    """All other routes share it and agree."""
    owner, function, wrong, quantities = FITS[name]
    monkeypatch.setattr(owner, function, wrong)
    found = check(taps)

    assert check(taps, train=False).passed
    assert {row.quantity for row in found.rows if row.routes == FIT and not row.passed} == quantities
    assert failed(found) | {TRIALS} == {FIT, RECURSION, TRIALS}


@pytest.mark.parametrize("name", MODELS)
def test_an_error_in_the_model_is_found(taps, compiled_loops_alone, name):
    """Likewise, also where it is small."""
    change, quantities = MODELS[name]
    found = check(taps, change=change)

    assert check(taps, train=False, change=change).passed
    assert {row.quantity for row in found.rows if row.routes == FIT and not row.passed} == quantities
    assert RECURSION in failed(found)


def test_a_prior_over_untrained_classes_is_found(taps, compiled_loops_alone):
    found = check(taps, change=of(AnyClass))

    assert ("prior", False) in {(row.quantity, row.passed) for row in found.rows if row.routes == FIT}


def test_a_wrong_saturation_is_found(taps, compiled_loops_alone):
    """In trials, where beliefs are read with it."""
    settings = fitted_by(bins=8, saturation=2.0)
    found = check(taps, settings=settings, change=lambda fitted: replace(fitted, saturation=1.5), length=8)

    assert check(taps, train=False, settings=settings, length=8).passed
    assert not found.passed
    assert TRIALS in failed(found) or found.differing_decisions


def changed(function, change):
    """What a function answers, changed."""
    return lambda *arguments, **more: change(function(*arguments, **more))


def stretched(values):
    return values * (1 + 1e-6)


STEPS = {
    "bin_edges": stretched,
    "histogram_counts": lambda counts: np.roll(counts, 1, axis=2),
    "trained_classes": np.ones_like,
    "log_flat_prior": lambda log_prior: np.where(np.isneginf(log_prior), -np.log(log_prior.size), log_prior),
    "log_histograms": lambda log_prob: log_prob + 1e-6,
    "exponent": stretched,
    "tap_bins": lambda bins: np.maximum(bins - 1, 0),
    "tap_log_likelihood": stretched,
    "saturated": lambda log_belief: 0.9 * log_belief,
    "fixation_move": lambda delta: delta + 1,
}


class Broken:
    """The reference with one function that answers wrongly."""

    def __init__(self, name):
        setattr(self, name, changed(getattr(reference, name), STEPS[name]))

    def __getattr__(self, name):
        return getattr(reference, name)


@pytest.mark.parametrize("name", STEPS)
def test_an_error_in_a_step_of_the_route_is_found(taps, monkeypatch, compiled_loops_alone, name):
    """The others do without that step here, so that they show it."""
    monkeypatch.setattr(raw, "reference", Broken(name))
    found = check(taps)

    assert not found.passed
    assert failed(found) <= {FIT, RECURSION, TRIALS}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("_pick", lambda tap: tap + 1.0),
        ("_nearest_with_tap", lambda where: max(where - 1, 0)),
    ],
)
def test_another_tap_in_a_trial_is_found(taps, monkeypatch, compiled_loops_alone, name, change):
    monkeypatch.setattr(raw, name, changed(getattr(raw, name), change))
    found = check(taps)

    assert found.differing_decisions or TRIALS in failed(found)


@pytest.mark.parametrize("step", ["update", "shift"])
def test_an_error_in_the_recursion_of_the_route_is_found(taps, monkeypatch, compiled_loops_alone, step):
    def tilt(answer):
        log_belief = (answer[0] if step == "update" else answer).copy()
        log_belief[0, 0] += 1e-6
        log_belief -= np.logaddexp.reduce(log_belief.ravel())
        return (log_belief, answer[1]) if step == "update" else log_belief

    monkeypatch.setattr(raw.RawFilter, step, changed(getattr(raw.RawFilter, step), tilt))
    found = check(taps)

    assert RECURSION in failed(found)
    assert failed(found) <= {RECURSION, TRIALS}


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("icub_grasp", {}),
        pytest.param("braille_icub", {}, marks=pytest.mark.slow),
        pytest.param("eflesh_grid", {}, marks=pytest.mark.slow),
        pytest.param("barrett_boxes", {"split": "leave-one-session-out"}, marks=pytest.mark.slow),
        pytest.param("barrett_ballcyl", {"split": "leave-one-session-out"}, marks=pytest.mark.slow),
    ],
)
def test_recorded_taps(shared_data, compiled_loops_alone, name, more):
    """One object, one position, empty classes, one sample: whatever recordings have."""
    parts, grid = load_experiment([shared_data / f"{name}.npz"], Division(**more))
    fold = parts.folds[0]
    grid: ClassGrid = trim(grid, [fold.train])[0]
    fitted = ExperimentSettings().fitted(fold.train, grid)
    found = crosscheck_model(
        fitted, fitted.usable(fold.test), train=fold.train, episodes=2, length=4, sequence_taps=0, border="clamp"
    )

    assert found.passed
