"""Laws that every model obeys, and what it refuses."""

from functools import cache

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.models.errors import InputError, NotConvergedError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement import smooth
from solidtouch.models.measurement.fits.posterior import check_places
from solidtouch.models.measurement.fits.priors import Taps
from solidtouch.models.measurement.likelihood.bins import TableForm, bin_edges
from solidtouch.models.measurement.registry import NAMES, fit_model, split_name
from solidtouch.models.measurement.shared_gain import session_spread, state_grid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, J, K, B = 4, 3, 6, 5, 20
FAST = [name for name in NAMES if name not in ("student", "session")]
WRAPPED = ["session", "session:gaussian", "session:profile-mvn"]
SETTINGS = FitSettings(bins=B, power="none")


@pytest.fixture(scope="module", autouse=True)
def few_length_scales():
    """Fits of `smooth` choose among three of their eight length scales, each of which takes long."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smooth, "LENGTHS", smooth.LENGTHS[::3])
        yield


def taps_of(
    *, L=L, M=M, J=J, K=K, repeats=5, drop=(), once=(), noise=1.0, dead=(), edges=False, spread=0.0, seed=0, sessions=1
):
    """Taps whose means are waves over time, taxel and place; without the classes `drop`, one each of `once`."""
    rng = np.random.default_rng(seed)
    cells = [(l, m) for l in range(L) for m in range(M) for _ in range(repeats * sessions) if (l, m) not in drop]
    cells = [cell for n, cell in enumerate(cells) if cell not in once or cell not in cells[:n]]
    where, what = np.array(cells).T
    place = 1.5 * where + spread * rng.uniform(-0.7, 0.7, size=len(where))
    samples = 5 * np.sin(
        place[:, None, None] / 2 + what[:, None, None] + 0.3 * np.arange(J)[:, None] + 0.5 * np.arange(K)
    ) + noise * rng.normal(size=(len(where), J, K))
    samples[:, :, list(dead)] = 3.0
    return TapSet.from_arrays(
        samples,
        what,
        [f"object {m}" for m in range(M)],
        where=place,
        where_value=1.5 * np.arange(L),
        where_edges=1.5 * (np.arange(L + 1) - 0.5) if edges or spread else None,
        where_unit="mm",
        session=np.arange(len(where)) % sessions,
        preprocessing=Preprocessing(samples=J),
    )


def changed(taps, samples=None, order=None):
    """Other samples, or other taps of the same set."""
    dataset = taps.dataset if order is None else taps.dataset.isel(tap=order)
    return TapSet(dataset if samples is None else dataset.assign(taps=(dataset["taps"].dims, samples)))


def own_log_likelihood(model, taps):
    where, what = taps.indices(model.grid)
    return model.form.own(taps.taps, model.edges, where, what)


@cache
def plain(name):
    taps = taps_of()
    return fit_model(name, taps, taps.grid(), SETTINGS)


# Laws


@pytest.mark.parametrize("name", slow_but([*FAST, *WRAPPED], [*NAMES, *WRAPPED[1:]]))
def test_own_probabilities_are_those_among_all(name):
    """`own` is the column of the own hypothesis; likelihoods are probabilities, and training taps fit their classes."""
    taps, model = taps_of(), plain(name).model
    log_likelihood = model.log_likelihood(taps.taps)
    where, what = taps.indices(model.grid)
    H = model.form.shape[1]

    assert log_likelihood.shape == (len(taps), L, H)
    assert np.isfinite(log_likelihood).all()
    assert log_likelihood.max() <= 1e-9
    for s in range(0, H, M):
        own = model.form.own(taps.taps, model.edges, where, s + what)
        np.testing.assert_allclose(own, log_likelihood[np.arange(len(taps)), where, s + what], rtol=1e-9)
    decided = model.log_prior + log_likelihood
    best = np.logaddexp.reduce(decided.reshape(len(taps), L, -1, M), axis=2).reshape(len(taps), -1).argmax(axis=1)
    assert (best == where * M + what).mean() > 0.9
    assert model.name == name
    assert model.kind == split_name(name)[0]
    assert model.groups()["constant_data"].sizes["state"] == len(model.states.gain)  # parameters have their dims, too


@pytest.mark.parametrize("name", slow_but(FAST, [*FAST, "student"]))
def test_probabilities_of_all_bins_sum_to_one(name):
    """The last sample is forecast from all others and forecasts none: over its bins it adds up to their probability.

    That does not depend on where in its bins the sample lies; tables add up to one.
    """
    model = plain(name).model
    totals = []
    for share in (0.5, 0.9):
        taps = np.repeat(taps_of().taps[:1], B, axis=0)
        taps[:, -1, -1] = (1 - share) * model.edges[:-1] + share * model.edges[1:]
        totals.append(np.logaddexp.reduce(model.log_likelihood(taps), axis=0))
    np.testing.assert_allclose(totals[0], totals[1], rtol=1e-12)
    if isinstance(model.plain_form, TableForm):
        np.testing.assert_allclose(np.exp(model.plain_form.log_prob).sum(axis=-1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("name", FAST)
def test_the_order_of_taps_does_not_matter(name, rng):
    """Nor how the labels are interleaved."""
    taps = taps_of()
    mixed = changed(taps, order=rng.permutation(len(taps)))
    other = fit_model(name, mixed, taps.grid(), SETTINGS).model

    np.testing.assert_allclose(
        other.log_likelihood(taps.taps), plain(name).model.log_likelihood(taps.taps), rtol=1e-3, atol=1e-3
    )


UNITS = [(*unit, name) for unit in [(1e-6, 0.0), (1e6, 0.0), (1.0, 1e4), (-1.0, 0.0)] for name in FAST]


@pytest.mark.parametrize(("unit", "offset", "name"), slow_but(UNITS[::2], UNITS))
def test_units_do_not_matter(name, unit, offset):
    """Samples in other units, un-tared or upside down, with edges to match, have the same probabilities.

    The classes are decided alike, too. A sign change reverses the bins.
    """
    taps = taps_of()
    edges = plain(name).model.edges
    moved = edges * unit + offset
    other = changed(taps, taps.taps * unit + offset)
    settings = SETTINGS.changed(edges=moved if unit > 0 else moved[::-1].copy())
    actual = fit_model(name, other, taps.grid(), settings).model.log_likelihood(other.taps)

    np.testing.assert_allclose(actual, plain(name).model.log_likelihood(taps.taps), rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("name", ["histogram", "gaussian", "profile", "profile-ar", "matrix-normal", "smooth"])
def test_the_order_of_taxels_does_not_matter(name):
    """Where none is forecast from others; a matrix normal has the same density in any order, and almost the same bins.

    Only `profile-mvn` depends on the order, through its prior.
    """
    taps = taps_of(noise=3.0)
    order = np.array([3, 0, 4, 1, 2])
    expected, actual = (
        fit_model(
            name, changed(taps, taps.taps[:, :, o]), taps.grid(), SETTINGS.changed(bins=200)
        ).model.log_likelihood(taps.taps[:, :, o])
        for o in (np.arange(K), order)
    )
    tolerance = 0.3 if name == "matrix-normal" else 1e-4

    np.testing.assert_allclose(actual, expected, rtol=1e-3, atol=tolerance)


SIZES = {
    "one sample": ({"J": 1}, ("profile", "profile-ar")),
    "one taxel": ({"K": 1}, ("profile-mvn",)),
    "one place": ({"L": 1}, ("smooth",)),
    "one object": ({"M": 1}, ()),
    "one class": ({"L": 1, "M": 1}, ("smooth",)),
    "two taps": ({"repeats": 2}, ()),
    "three places": ({"L": 3}, ()),
    "dead taxel": ({"dead": (2,)}, ()),
    "nothing but dead taxels": ({"dead": tuple(range(K))}, ()),
    "identical taps": ({"noise": 0.0}, ()),
    "a class with one tap": ({"once": ((1, 2),)}, ()),
    "single precision": ({}, ()),
}


EXTREME = [(name, case) for case in SIZES for name in FAST]
REFUSED = [(name, case) for case, (_, refused) in SIZES.items() for name in refused]


@pytest.mark.parametrize(("name", "case"), slow_but([*EXTREME[::3], *REFUSED], EXTREME))
def test_extreme_sets_give_finite_likelihoods(name, case):
    """Or one sentence that says why not."""
    sizes, refused = SIZES[case]
    taps = taps_of(**sizes)
    if case == "single precision":
        taps = changed(taps, (taps.taps + 1e4).astype(np.float32))
    if name in refused:
        with pytest.raises(InputError, match=f"{name} needs"):
            fit_model(name, taps, taps.grid(), SETTINGS)
        return
    model = fit_model(name, taps, taps.grid(), SETTINGS).model
    log_likelihood = model.log_likelihood(taps.taps)

    assert np.isfinite(log_likelihood).all()
    np.testing.assert_allclose(
        own_log_likelihood(model, taps),
        log_likelihood[np.arange(len(taps)), *taps.indices(model.grid)],
        rtol=1e-9,
        atol=1e-9,
    )


@pytest.mark.parametrize("name", ["gaussian", "histogram"])
def test_one_tap_per_class_is_enough_without_times(name):
    """Its samples differ, so there is a variance."""
    taps = taps_of(repeats=1)
    model = fit_model(name, taps, taps.grid(), SETTINGS).model

    assert np.isfinite(model.log_likelihood(taps.taps)).all()


@pytest.mark.parametrize("name", FAST)
def test_untrained_classes_are_impossible(name):
    """At the ends of the range; between trained places `smooth` knows the class from its neighbours."""
    taps = taps_of(drop=((1, 1), (3, 0)))
    model = fit_model(name, taps, taps.grid(), SETTINGS).model
    expected = np.ones((L, M), dtype=bool)
    expected[3, 0] = False
    expected[1, 1] = name == "smooth"
    log_likelihood = model.log_likelihood(taps.taps)

    np.testing.assert_array_equal(model.trained, expected)
    np.testing.assert_array_equal(np.isneginf(log_likelihood), np.broadcast_to(~expected, log_likelihood.shape))
    assert model.log_prior[expected] == pytest.approx(-np.log(expected.sum()))
    assert len(model.left_out) == (~expected).sum()


def test_smooth_knows_a_place_without_taps():
    """Taps there are more probable under its own class than under both neighbours, though none trained it."""
    everywhere = taps_of(L=8, seed=1)
    at = np.isclose(everywhere.where, 1.5 * 4)
    training, new = everywhere.select(~at), everywhere.select(at)
    model = fit_model("smooth", training, everywhere.grid(), SETTINGS).model
    log_likelihood = model.log_likelihood(new.taps)[np.arange(len(new)), :, new.what]

    assert (log_likelihood.argmax(axis=1) == 4).mean() > 0.8


def test_smooth_takes_the_mean_over_places_in_a_class():
    """Where taps of a class lie at several places; at listed positions each class is its place."""
    spread, listed = taps_of(spread=1.0), taps_of()
    several = fit_model("smooth", spread, spread.grid(), SETTINGS).model.plain_form
    single = fit_model("smooth", listed, listed.grid(), SETTINGS).model.plain_form

    assert np.exp(several.log_weight) == pytest.approx(np.full(4, 0.25))
    assert len(single.log_weight) == 1
    assert np.ptp(several.mean[:, 1, 0], axis=0).max() > 0.5


# Refusals


def test_places_are_counted():
    """Two are no curve."""
    with pytest.raises(InputError, match="smooth needs at least 3 positions, got 2"):
        fit_model("smooth", taps_of(L=2), taps_of(L=2).grid(), SETTINGS)
    taps = Taps(np.zeros((3, 2, 2)), np.zeros(3, int), np.zeros(3, int), (1, 1), place=np.zeros(3))
    with pytest.raises(InputError, match="at least 3 positions, got 1"):
        check_places("smooth", taps)


@pytest.mark.parametrize("name", ["profile", "profile-ar", "profile-mvn", "matrix-normal", "smooth"])
def test_single_taps_say_nothing_of_differences(name):
    """The sentence gives both numbers."""
    taps = taps_of(repeats=1)
    with pytest.raises(InputError, match=rf"{name} needs at least two taps per class, got {L * M} taps for {L * M}"):
        fit_model(name, taps, taps.grid(), SETTINGS)


@pytest.mark.parametrize("name", ["gaussian", "student"])
def test_single_samples_of_single_taps_say_nothing_of_differences(name):
    """For models without times."""
    taps = taps_of(repeats=1, J=1)
    with pytest.raises(InputError, match=f"{name} with one sample per tap needs at least two taps per class"):
        fit_model(name, taps, taps.grid(), SETTINGS)


@pytest.mark.parametrize("name", FAST)
@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"bins": 0}, "bins must be an integer from 1 to 65536, got 0"),
        ({"power": "K"}, "power must be J, JK, none or a positive number, got 'K'"),
        ({"value_range": "all"}, "value_range must be one of global, taxel, got 'all'"),
    ],
)
def test_settings_out_of_range_are_refused(name, settings, message):
    """By every model alike."""
    taps = taps_of()
    with pytest.raises(InputError, match=message):
        fit_model(name, taps, taps.grid(), SETTINGS.changed(**settings))


@pytest.mark.parametrize("name", FAST)
def test_taps_outside_the_grid_are_refused(name):
    """Where none is left."""
    taps, grid = taps_of(), taps_of().grid()
    with pytest.raises(InputError, match="No training tap belongs to a class of the grid"):
        fit_model(name, taps, ClassGrid(grid.where_value + 1000.0, "mm", None, grid.what_members), SETTINGS)


def test_fits_that_did_not_converge_are_errors(monkeypatch):
    """Unless this is allowed; the model then says so."""
    monkeypatch.setattr("solidtouch.models.measurement.profile_mvn._ROUNDS", 1)
    taps = taps_of()
    with pytest.raises(NotConvergedError, match=r"profile-mvn did not converge: Factorised .* 1 rounds"):
        fit_model("profile-mvn", taps, taps.grid(), SETTINGS)
    fitted = fit_model("profile-mvn", taps, taps.grid(), SETTINGS.changed(unconverged=True))

    assert not fitted.convergence.converged
    assert np.isfinite(fitted.model.log_likelihood(taps.taps)).all()


# Posteriors


@pytest.mark.parametrize("name", slow_but(FAST, [*FAST, "student"]))
def test_draws_are_parameters_of_the_same_model(name):
    """Every draw makes a form that knows the taps about as well as the point."""
    fitted, taps = plain(name), taps_of()
    point = fitted.posterior.point()
    drawn = fitted.posterior.draw(np.random.default_rng(1))
    again, other = (fitted.posterior.draw(np.random.default_rng(seed)) for seed in (1, 2))

    assert {n: drawn[n].shape for n in point} == {n: v.shape for n, v in point.items()}
    for key in point:
        value = drawn[key]
        np.testing.assert_array_equal(again[key], value)
        assert not np.array_equal(value, point[key])
        assert not np.array_equal(value, other[key])
    own = fitted.model.form_of(drawn).own(taps.taps, fitted.model.edges, *taps.indices(fitted.model.grid))
    assert own.mean() > own_log_likelihood(fitted.model, taps).mean() - 1.5 * J * K


@pytest.mark.parametrize("name", slow_but(FAST, [*FAST, "student"]))
def test_convergence_is_a_sentence_with_numbers(name):
    """Exact, by ascent, or by variational inference."""
    convergence = plain(name).convergence
    exact = name in ("histogram", "gaussian", "profile", "profile-ar")

    assert convergence.converged
    assert convergence.sentence.endswith(".")
    assert convergence.sentence.startswith("The posterior is exact") == exact
    assert bool(convergence.stats) != exact


def test_without_a_pseudocount_there_is_no_posterior():
    """The prior of the histogram is improper then, and the model works all the same."""
    taps = taps_of()
    fitted = fit_model("histogram", taps, taps.grid(), SETTINGS.changed(pseudocount=0.0))

    assert fitted.posterior is None
    assert fitted.convergence.converged


# States


@pytest.mark.parametrize("name", ["histogram", "gaussian", "profile", "matrix-normal"])
def test_a_single_state_is_the_plain_model(name):
    """No spread between sessions, no difference: not even in the name."""
    taps = taps_of()
    wrapped = "session" if name == "histogram" else f"session:{name}"
    model = fit_model(wrapped, taps, taps.grid(), SETTINGS.changed(gain_sd=0.0, offset_sd=0.0)).model

    np.testing.assert_array_equal(model.log_likelihood(taps.taps), plain(name).model.log_likelihood(taps.taps))
    assert model.name == name


@pytest.mark.parametrize("name", WRAPPED)
def test_states_recognise_a_changed_gain(name):
    """Taps 12% stronger than the training taps are more probable under states than without."""
    taps = taps_of(noise=0.5)
    settings = SETTINGS.changed(gain_sd=0.06, offset_sd=0.0)
    model = fit_model(name, taps, taps.grid(), settings).model
    strong = 1.12 * taps.taps
    where, what = taps.indices(taps.grid())
    log_likelihood = model.log_likelihood(strong)[np.arange(len(taps)), where].reshape(len(taps), -1, M)
    by_state = log_likelihood[np.arange(len(taps)), :, what].sum(axis=0)
    states = model.states

    assert states.gain[by_state.argmax()] == pytest.approx(np.exp(0.12), rel=0.05)
    assert by_state.max() > by_state[np.isclose(states.gain, 1.0)].max() + 10


def test_states_are_a_grid_with_normal_weights():
    """Centre 1 and 0, prior that sums to one."""
    states = state_grid(0.1, 2.0, 5, 3)

    assert states.gain.shape == (15,)
    assert np.exp(states.log_prior).sum() == pytest.approx(1.0)
    assert np.ptp(np.log(states.gain)) == pytest.approx(0.4)
    assert np.ptp(states.offset) == pytest.approx(8.0)
    best = states.log_prior.argmax()
    assert (states.gain[best], states.offset[best]) == (1.0, 0.0)


def test_the_spread_between_sessions_is_found():
    """Planted log gains and offsets of many sessions."""
    rng, sessions = np.random.default_rng(5), 30
    taps = taps_of(sessions=sessions, repeats=4, noise=0.2)
    gain, offset = np.exp(0.08 * rng.normal(size=sessions)), 0.5 * rng.normal(size=sessions)
    moved = changed(taps, taps.taps * gain[taps.session, None, None] + offset[taps.session, None, None])
    gain_sd, offset_sd, *_ = session_spread(moved, taps.grid(), bin_edges(moved.taps, B, "global"))

    assert gain_sd == pytest.approx(0.08, rel=0.35)
    assert offset_sd == pytest.approx(0.5, rel=0.35)
