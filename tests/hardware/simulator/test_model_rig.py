"""Taps drawn from fitted models."""

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from solidtouch.hardware.simulator.model_rig import ModelRig, bin_tables, draw_from_prior, draw_session, draw_taps
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, K, B, J = 5, 2, 3, 7, 4
RECORD = Preprocessing(samples=J, rate_hz=50.0)
EDGES = np.linspace(-12.3, 40.1, B + 1)


@pytest.fixture
def tables(rng):
    """Histograms of which every other bin of the first class is empty."""
    p = rng.dirichlet(np.ones(B), size=(L, M, K))
    p[0, 0, :, ::2] = 0.0
    return p / p.sum(axis=-1, keepdims=True)


def bins_of(values, edges=EDGES):
    return np.searchsorted(edges, values, side="right") - 1


@pytest.mark.parametrize("low", [-12.3, 1e6, -1e-6])
def test_drawn_values_bin_back_exactly(grid, tables, low):
    """Every value is the centre of a bin of its own taxel, whatever the scale."""
    edges = np.array([np.linspace(low, low + width, B + 1) for width in (1e-3, 1.0, 300.0)])
    taps = draw_taps(grid, tables, edges, RECORD, 50, seed=0)

    for k in range(K):
        bins = bins_of(taps.taps[..., k], edges[k])
        assert set(range(B)) == set(bins.ravel())
        np.testing.assert_array_equal((edges[k][bins] + edges[k][bins + 1]) / 2, taps.taps[..., k])


def test_bin_frequencies_match_the_tables(grid, tables):
    """Counts lie within five binomial standard deviations, and empty bins stay empty."""
    n = 2000
    taps = draw_taps(grid, tables, EDGES, RECORD, n, seed=1)
    bins = bins_of(taps.taps).reshape(L, M, n * J, K)
    frequency = (bins[..., np.newaxis] == np.arange(B)).mean(axis=2)
    error = np.sqrt(tables * (1 - tables) / (n * J))

    assert (np.abs(frequency - tables) <= 5 * error).all()


def test_samples_of_a_tap_are_independent(grid, tables):
    """Samples and taxels of the same tap are uncorrelated."""
    taps = draw_taps(grid, tables, EDGES, RECORD, 4000, seed=2).taps[-4000:].reshape(4000, J * K)
    correlation = np.corrcoef(taps.T) - np.eye(J * K)

    assert np.abs(correlation).max() < 5 / np.sqrt(4000)


def test_the_rig_draws_from_the_class_where_it_stands(grid, tables):
    """The distribution of its taps is the table's row after a move, too."""
    rig = ModelRig(grid, tables, EDGES, RECORD, 0, 1, np.random.default_rng(0))
    rig.move(3)
    bins = bins_of(np.array([rig.tap() for _ in range(3000)]))
    frequency = (bins[..., np.newaxis] == np.arange(B)).mean(axis=(0, 1))

    assert (np.abs(frequency - tables[3, 1]) < 5 * np.sqrt(0.25 / 12000)).all()


def test_drawn_taps_stand_at_the_values_of_their_classes(grid, tables):
    """A drawn session has the classes of the grid, n taps each, and says that it is simulated."""
    taps = draw_taps(grid, tables, EDGES, RECORD, 3, seed=0, session=2)
    where, what = taps.indices(taps.grid())

    assert taps.taps.shape == (30, J, K)
    assert grid.differences(taps.grid()) == []
    assert (np.bincount(where * M + what) == 3).all()
    assert set(taps.session) == {2}
    assert RECORD.differences(taps.preprocessing) == []
    assert "simulated" in taps.dataset.attrs["source"]


def test_untrained_classes_are_left_out(grid, tables):
    """Only trained classes are drawn from."""
    trained = np.ones((L, M), dtype=bool)
    trained[1, 0] = trained[4, 1] = False
    where, what = draw_taps(grid, tables, EDGES, RECORD, 2, seed=0, trained=trained).indices(grid)

    assert (trained * 2).ravel().tolist() == np.bincount(where * M + what, minlength=L * M).tolist()


def test_sessions_and_seeds_are_drawn_independently(grid, tables):
    """Seed and session decide the taps."""
    taps = {key: draw_taps(grid, tables, EDGES, RECORD, 2, *key).taps for key in ((0, 0), (0, 1), (1, 0))}

    np.testing.assert_array_equal(taps[0, 1], draw_taps(grid, tables, EDGES, RECORD, 2, 0, 1).taps)
    assert not np.array_equal(taps[0, 0], taps[0, 1])
    assert not np.array_equal(taps[0, 0], taps[1, 0])


@pytest.fixture(scope="module")
def fitted(make_taps):
    """A function that fits a model to small random taps, one class of which has none."""
    taps = make_taps(L=3, M=2, J=6, K=5, repeats=12)
    taps = taps.select((taps.what != 1) | (taps.where > 0))

    def make(name, **more):
        return fit_model(name, taps, taps.grid(), FitSettings(bins=30, **more)).model

    return make


@pytest.mark.parametrize("name", ["gaussian", "profile", "profile-ar", "profile-mvn", "matrix-normal", "session"])
def test_taps_drawn_from_a_model_are_as_probable_as_it_says(fitted, name):
    """Their mean log probability is that of other taps drawn from its form, within five standard errors."""
    model = fitted(name, gain_sd=0.0, offset_sd=0.0)
    taps = draw_session(model, 300, seed=1)
    where, what = taps.indices(model.grid)
    other = model.form.sample(where, what, model.edges, 6, np.random.default_rng(5))
    values = [model.form.own(samples, model.edges, where, what) for samples in (taps.taps, other)]
    error = np.sqrt(sum(value.var() for value in values) / len(where))

    assert abs(values[0].mean() - values[1].mean()) < 5 * error
    assert sorted(set(zip(where.tolist(), what.tolist(), strict=True))) == [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1)]


@pytest.mark.parametrize("name", ["session", "session:profile"])
def test_a_session_is_drawn_in_one_state(fitted, name):
    """Named in its source, another one for another session; its taps are most probable in it."""
    model = fitted(name, gain_sd=0.4, offset_sd=0.0)
    found = []
    for session in range(5):
        taps = draw_session(model, 20, seed=3, session=session)
        where, what = taps.indices(model.grid)
        fits = [
            model.form.own(taps.taps, model.edges, where, s * model.grid.M + what).mean()
            for s in range(len(model.states.gain))
        ]
        found.append(model.states.gain[np.argmax(fits)])
        assert f"gain {found[-1]:.4g} and offset 0" in taps.dataset.attrs["source"]
    assert len(set(found)) > 1


def test_histograms_draw_as_they_always_did(fitted):
    model = fitted("histogram")
    expected = draw_taps(model.grid, model.probabilities, model.edges, RECORD, 3, 2, 1, model.trained)

    np.testing.assert_array_equal(draw_session(model, 3, 2, 1, J).taps, expected.taps)


def test_models_without_times_draw_any_number_of_samples(fitted):
    assert draw_session(fitted("gaussian"), 2, 0, samples=11).taps.shape == (10, 11, 5)
    with pytest.raises(InputError, match="The profile model describes taps of 6 samples; cannot draw taps of 11"):
        draw_session(fitted("profile"), 2, 0, samples=11)


@pytest.mark.parametrize("name", ["histogram", "profile"])
def test_no_taps_are_refused(fitted, name):
    with pytest.raises(InputError, match="taps_per_class must be at least 1, got 0"):
        draw_session(fitted(name), 0, 0)


BAD_TABLES = {
    "another grid": (np.ones((L, M + 1, K, B)), EDGES, "grid has 5 x 2 classes, but the tables have shape"),
    "too few axes": (np.ones((L, M, B)), EDGES, "but the tables have shape"),
    "too few edges": (np.ones((L, M, K, B)), EDGES[1:], "need 8 edges"),
    "edges of other taxels": (np.ones((L, M, K, B)), np.tile(EDGES, (2, 1)), "need 8 edges"),
    "falling edges": (np.ones((L, M, K, B)), EDGES[::-1], "must increase"),
    "no weight": (np.zeros((L, M, K, B)), EDGES, "non-negative weights"),
    "negative weight": (np.linspace(-1, 9, L * M * K * B).reshape(L, M, K, B), EDGES, "non-negative weights"),
    "not a number": (np.full((L, M, K, B), np.nan), EDGES, "non-negative weights"),
}


@pytest.mark.parametrize(("probabilities", "edges", "message"), BAD_TABLES.values(), ids=BAD_TABLES.keys())
def test_tables_that_do_not_fit_are_refused(probabilities, edges, message):
    """The message says what fails to fit."""
    with pytest.raises(InputError, match=message):
        bin_tables(probabilities, edges, (L, M))


def test_a_start_off_the_grid_is_refused(grid, tables):
    """The message names the class."""
    with pytest.raises(InputError, match=r"Class \(5, 0\) is outside"):
        ModelRig(grid, tables, EDGES, RECORD, 5, 0, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("n", "trained", "message"), [(0, True, "taps_per_class must be at least 1"), (1, False, "no trained class")]
)
def test_nothing_to_draw_is_refused(grid, tables, n, trained, message):
    """At least one tap of one class must come out."""
    with pytest.raises(InputError, match=message):
        draw_taps(grid, tables, EDGES, RECORD, n, seed=0, trained=np.full((L, M), trained))


@pytest.mark.slow
def test_taps_from_a_prior_share_latent_variables_but_those_of_sessions():
    """Levels of two sessions agree, and differ from those of another seed; shifts of a session are its own."""
    like = TapSet.from_arrays(
        np.zeros((L * M, J, K)),
        np.tile(np.arange(M), L),
        ["a", "b"],
        where=np.repeat(np.arange(float(L)), M),
        preprocessing=RECORD,
    )

    def means(story, seed, session):
        """Of classes and taxels; taps stand in the order of the classes."""
        taps = draw_from_prior(story, like, 30, seed, session)
        return taps.taps.mean(axis=1).reshape(*taps.grid().shape, 30, -1).mean(axis=2)

    one, two, other = (means(sharp, *pair) for pair in ((0, 0), (0, 1), (1, 0)))
    np.testing.assert_allclose(one, two, atol=0.07)
    assert np.abs(one - other).mean() > 0.5
    shift = means(sharp_shifted, 0, 1) - means(sharp_shifted, 0, 0)
    assert np.abs(shift).mean() > 0.2
    assert shift.std(axis=(0, 1)).max() < 0.05


def sharp(where, what, taps=None, *, L, M, J, K, shift=0.0):
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 1.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("taps", dist.Normal((loc[where, what] + shift)[:, None], 0.1), obs=taps)


def sharp_shifted(where, what, taps=None, *, L, M, J, K, session):
    with numpyro.plate("S", int(session.max()) + 1, dim=-2), numpyro.plate("K", K, dim=-1):
        shift = numpyro.sample("shift", dist.Normal(0.0, 1.0))
    sharp(where, what, taps, L=L, M=M, J=J, K=K, shift=shift[session])
