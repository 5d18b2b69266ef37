"""Log probability of taps left out, integrated over posteriors and at one value of the parameters."""

from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import gammaln
from scipy.stats import multivariate_t
from slow_cases import slow_but
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement import gaussian, profile
from solidtouch.models.measurement.draws import drawn, integrated, plug_in
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.fitted_parameters import ModelOfParameters
from solidtouch.models.measurement.histogram import HistogramPosterior
from solidtouch.models.measurement.registry import NAMES, fit_model
from solidtouch.models.measurement.states import States
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, J, K, PER_CLASS = 3, 2, 4, 5, 6


def make_taps(seed: int, sessions: int = 1) -> TapSet:
    """Taps with a profile, correlated samples and a position."""
    generator = np.random.default_rng(seed)
    rows = np.array(list(product(range(sessions), range(L), range(M), range(PER_CLASS))))
    session, where, what, _ = rows.T
    shape = np.sin(np.arange(1, J + 1))[:, None] * np.arange(1, K + 1)
    noise = generator.normal(size=(len(rows), J, K)).cumsum(axis=1) * 0.4
    taps = (where + 2 * what)[:, None, None] * shape + noise + 0.1 * session[:, None, None]
    place = where + generator.uniform(0, 1, len(rows))
    return TapSet.from_arrays(
        taps,
        what,
        ["a", "b"],
        where=place,
        where_value=np.arange(L) + 0.5,
        where_edges=np.arange(L + 1.0),
        where_unit="mm",
        session=session,
        preprocessing=Preprocessing(samples=J),
    )


TAPS, TEST = make_taps(0), make_taps(1)
GRID: ClassGrid = TAPS.grid()
OWN = TEST.indices(GRID)
SETTINGS = FitSettings(bins=23, pseudocount=0.5)


@pytest.mark.parametrize(
    "name", [n if n != "student" else pytest.param(n, marks=pytest.mark.slow) for n in (*NAMES, "session:profile")]
)
def test_every_model_predicts_taps_left_out(name):
    """Both estimates are finite, below zero, and those of single taps do not depend on the others."""
    fitted = fit_model(name, TAPS, GRID, SETTINGS.changed(unconverged=True))
    for estimate in (
        lambda taps, own: plug_in(fitted, taps, own),
        lambda taps, own: integrated(fitted, taps, own, np.random.default_rng(0)),
    ):
        whole = estimate(TEST.taps, OWN)
        assert whole.shape == (len(TEST),)
        assert (np.isfinite(whole) & (whole < 0)).all()
        part = estimate(TEST.taps[5:9], (OWN[0][5:9], OWN[1][5:9]))
        np.testing.assert_allclose(part, whole[5:9], rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "J"),
    slow_but(
        [("histogram", 2), ("profile-mvn", 2), ("matrix-normal", 2)],
        [
            *((name, 2) for name in ("histogram", "gaussian", "profile", "profile-ar", "profile-mvn", "matrix-normal")),
            ("matrix-normal", 1),
        ],
    ),
)
def test_integrated_is_the_mean_over_draws_where_taps_are_short(name, J, monkeypatch):
    """With few samples per tap the plain mean over many draws of everything comes to the same."""
    monkeypatch.setattr("solidtouch.models.measurement.likelihood.forecasts.DRAWS", 400)
    generator = np.random.default_rng(3)
    small = make_small(generator, J)
    fitted = fit_model(
        name, small, small.grid(), SETTINGS.changed(bins=6 if name == "histogram" else 60, unconverged=True)
    )
    own = small.indices(small.grid())
    rows = np.array([values for _, values in drawn(fitted, small, 1000, seed=1)])
    mean = np.logaddexp.reduce(rows, axis=0) - np.log(len(rows))
    spread = np.exp(rows - mean).std(axis=0) / np.sqrt(len(rows))
    exact = integrated(fitted, small.taps, own, np.random.default_rng(2))
    own_spread = spread * np.sqrt(len(rows) / 400)
    assert (np.abs(exact - mean) < 5 * np.hypot(spread, own_spread) + 0.005).all()


def make_small(generator: np.random.Generator, J: int = 2) -> TapSet:
    """Taps of one or two samples and two taxels, enough of them that posteriors are narrow."""
    n = 60
    what = np.repeat([0, 1], n // 2)
    return TapSet.from_arrays(
        generator.normal(size=(n, J, 2)) + what[:, None, None], what, ["a", "b"], preprocessing=Preprocessing(samples=J)
    )


def test_histogram_leaves_out_taps_exactly():
    """Subtracting a tap's counts gives what fitting without the tap gives."""
    fitted = fit_model("histogram", TAPS, GRID, SETTINGS)
    assert isinstance(fitted.posterior, HistogramPosterior)
    where, what = TAPS.indices(GRID)
    left = fitted.leave_out(TAPS)
    for n in (0, 7, 20):
        rest = TAPS.select(np.arange(len(TAPS)) != n)
        without = fit_model("histogram", rest, GRID, SETTINGS.changed(edges=fitted.model.edges))
        one = (where[n : n + 1], what[n : n + 1])
        expected = integrated(without, TAPS.taps[n : n + 1], one, np.random.default_rng(0))[0]
        assert left.integrated[n] == pytest.approx(expected, abs=1e-9)
        assert left.plug_in[n] == pytest.approx(plug_in(without, TAPS.taps[n : n + 1], one)[0], abs=1e-9)


@pytest.mark.parametrize("module", [gaussian, profile])
@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_cells_leave_out_taps_exactly(module, missing, rng):
    """Taken out of the posterior, a tap has the probability that a fit to the others with the same prior gives it."""
    samples = np.where(rng.random(TAPS.taps.shape) < missing, np.nan, TAPS.taps)
    taps = TapSet(TAPS.dataset.assign(taps=(TAPS.dataset["taps"].dims, samples)).assign_attrs(missing="drop"))
    fitted = fit_model(module.MODEL.name, taps, GRID, SETTINGS)
    model, (where, what) = fitted.model, taps.indices(GRID)
    scaled = model.scaling.scaled(Taps(samples, where, what, GRID.shape))
    left = fitted.leave_out(taps)

    for n in (0, 7, 20):
        rest = np.arange(len(taps)) != n
        without = Taps(scaled.samples[rest], where[rest], what[rest], GRID.shape)
        posterior, one = module.fit(without, fitted.posterior.prior), (where[n : n + 1], what[n : n + 1])
        expected = model.integrated(posterior, samples[n : n + 1], one, rng, 1.0, 0.0)[0]
        assert left.integrated[n] == pytest.approx(expected, abs=1e-9)
    assert left.plug_in is None
    assert (left.integrated < integrated(fitted, samples, (where, what), rng)).mean() > 0.9


@pytest.mark.parametrize("name", ["profile-ar", "student", "session:gaussian"])
def test_models_without_a_closed_form_leave_out_no_tap(name, as_student):
    """Also one whose taps share a state, and one that was sampled."""
    plain = fit_model("gaussian" if name == "student" else name, TAPS, GRID, SETTINGS)

    assert (plain._replace(model=as_student(plain.model)) if name == "student" else plain).leave_out(TAPS) is None


def test_a_tap_that_is_alone_in_a_cell_has_no_value():
    """Its level is flat without it."""
    lone = TAPS.select(np.arange(len(TAPS)) >= PER_CLASS - 1)
    value = fit_model("profile", lone, GRID, SETTINGS).leave_out(lone).integrated

    np.testing.assert_array_equal(np.isnan(value), np.arange(len(lone)) == 0)


def test_histogram_is_dirichlet_multinomial():
    """The samples of a tap, one after the other, each counted before the next, have the same probability."""
    fitted = fit_model("histogram", TAPS, GRID, SETTINGS)
    tap, l, m = TEST.taps[4], OWN[0][4], OWN[1][4]
    counts = fitted.posterior.concentration[l, m].copy()
    expected = 0.0
    for sample in fitted.model.bins(tap):
        for k, b in enumerate(sample):
            expected += np.log(counts[k, b] / counts[k].sum())
            counts[k, b] += 1
    value = integrated(fitted, TEST.taps[4:5], (OWN[0][4:5], OWN[1][4:5]), np.random.default_rng(0))[0]
    assert value == pytest.approx(expected, abs=1e-10)
    assert np.isfinite(gammaln(counts)).all()


def test_gaussian_forecasts_are_a_multivariate_t():
    """On narrow bins the samples of a tap, integrated, have the joint density of a multivariate t distribution."""
    generator = np.random.default_rng(7)
    taps = TapSet.from_arrays(
        generator.normal(size=(3, J, 1)), np.zeros(3, dtype=int), ["a"], preprocessing=Preprocessing(samples=J)
    )
    edges = np.linspace(-8, 8, 16001)
    fitted = fit_model("gaussian", taps, taps.grid(), SETTINGS.changed(bins=16000, edges=edges))
    cells, scaling = fitted.posterior.cells, fitted.model.scaling
    level, strength, a, b = (float(values[0, 0, 0, 0]) for values in cells)
    shape = b / a * (np.eye(J) + 1 / strength)
    width = edges[1] - edges[0]
    new = (np.floor(generator.normal(size=(5, J, 1)) * 1.5 / width) + 0.5) * width  # in the middle of bins
    own = np.zeros(5, dtype=int), np.zeros(5, dtype=int)
    scaled = ((new - scaling.centre) / scaling.unit)[..., 0]
    density = multivariate_t(np.full(J, level), shape, df=2 * a).logpdf(scaled) - J * np.log(scaling.unit[0])
    found = integrated(fitted, new, own, generator) - J * np.log(width)
    np.testing.assert_allclose(found, density, atol=1e-5)


def test_forecasts_of_vectors_are_a_multivariate_t():
    """On narrow bins a tap of one sample, integrated, has the joint density of a multivariate t over its taxels."""
    generator = np.random.default_rng(8)
    K, n, edges = 3, 9, np.linspace(-16, 16, 32001)
    what = np.repeat([0, 1], n)[: n + 5]
    vectors = generator.normal(size=(len(what), 1, K)) @ generator.normal(size=(K, K)) + what[:, None, None]
    taps = TapSet.from_arrays(vectors, what, ["a", "b"], preprocessing=Preprocessing(samples=1))
    fitted = fit_model("matrix-normal", taps, taps.grid(), SETTINGS.changed(bins=len(edges) - 1, edges=edges))
    posterior, scaling, width = fitted.posterior, fitted.model.scaling, edges[1] - edges[0]
    new = (np.floor(generator.normal(size=(8, 1, K)) * 1.5 / width) + 0.5) * width  # in the middle of bins
    own = np.zeros(8, dtype=int), np.repeat([0, 1], 4)
    found = integrated(fitted, new, own, generator) - K * np.log(width)
    scaled = ((new - scaling.centre) / scaling.unit)[:, 0]
    for i, m in enumerate(own[1]):
        freedom = posterior.taxel_freedom[0, m] - K + 1
        shape = posterior.taxel_scale[0, m] / freedom * (1 + 1 / posterior.strength[0, m])
        density = multivariate_t(posterior.level[0, m, 0], shape, df=freedom).logpdf(scaled[i])
        assert found[i] == pytest.approx(density - np.log(scaling.unit).sum(), abs=1e-4)


@pytest.mark.parametrize("name", ["gaussian", "student", "profile", "profile-ar", "profile-mvn"])
def test_draws_are_judged_in_a_state(name, as_student):
    """With a posterior that draws the fitted parameters alone, as these are."""
    fitted = fit_model("gaussian" if name == "student" else name, TAPS, GRID, SETTINGS.changed(unconverged=True))
    if name == "student":
        fitted = fitted._replace(model=as_student(fitted.model))
    model, state = fitted.model, States(np.array([1.4]), np.array([0.2]), np.zeros(1))
    point = SimpleNamespace(draw=lambda _: model.parameters)
    expected = plug_in(fitted._replace(model=replace(model, states=state)), TEST.taps, OWN)
    found = ModelOfParameters.integrated(model, point, TEST.taps, OWN, np.random.default_rng(0), 1.4, 0.2)

    assert np.median(np.abs(expected - plug_in(fitted, TEST.taps, OWN))) > 0.1
    np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize("name", ["histogram", "profile", "matrix-normal"])
def test_states_are_summed_over(name):
    """A single state among impossible ones gives that state's probability, equal states give the plain one."""
    fitted = fit_model(name, TAPS, GRID, SETTINGS.changed(unconverged=True))
    twice = States(np.ones(2), np.zeros(2), np.log([0.3, 0.7]))
    model = replace(fitted.model, states=twice)
    np.testing.assert_allclose(
        plug_in(fitted._replace(model=model), TEST.taps, OWN), plug_in(fitted, TEST.taps, OWN), atol=1e-9
    )
    certain = States(np.array([1.0, 1.4]), np.array([0.0, 0.2]), np.log([1e-300, 1.0]))
    alone = States(certain.gain[1:], certain.offset[1:], np.zeros(1))
    both, one = (replace(fitted.model, states=states) for states in (certain, alone))
    exact = (plug_in, lambda f, t, o: integrated(f, t, o, np.random.default_rng(0)))
    for estimate in exact[: 1 if name == "matrix-normal" else 2]:  # which draws, and other ones in each state
        np.testing.assert_allclose(
            estimate(fitted._replace(model=both), TEST.taps, OWN),
            estimate(fitted._replace(model=one), TEST.taps, OWN),
            atol=1e-6,
        )
