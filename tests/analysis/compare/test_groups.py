"""Sessions, positions and objects that models predict from the others."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from scipy.special import logsumexp
from solidtouch.analysis.compare.groups import folds_of, said, scorer
from solidtouch.analysis.compare.left_out import _cautions
from solidtouch.analysis.compare.taps import TapScores, mean_scores
from solidtouch.models.measurement.draws import integrated
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.seeds import Purpose, generator
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

from .test_taps import make_taps

SETTINGS = FitSettings(bins=12, pseudocount=0.5, power="none")
L, M = 5, 3


def at_places(seed: int, session: int, repeats: int = 6, lacking: tuple[int, int] | None = None) -> TapSet:
    """Taps of L positions and M objects, whose level tells both; without those of one class."""
    where, what = (a.ravel() for a in np.indices((L, M, repeats))[:2])
    kept = np.ones(len(where), bool) if lacking is None else (where != lacking[0]) | (what != lacking[1])
    where, what = where[kept], what[kept]
    noise = np.random.default_rng(seed).normal(size=(len(where), 4, 2))
    level = np.stack([where, 3.0 * what], axis=-1)[:, None, :]
    return TapSet.from_arrays(
        level + noise,
        what,
        ["a", "b", "c"],
        where=where.astype(float),
        session=np.full(len(where), session),
        preprocessing=Preprocessing(samples=4),
    )


def test_every_session_is_left_out_once():
    """The folds' test taps are all taps, each once, and no training tap is of a session left out."""
    train, test = make_taps(0, 2), make_taps(1, 1, first=2)
    folds, sentence = folds_of("session", train, test, train.grid(), 6)
    assert len(folds) == 3
    assert sum(len(fold.test) for fold in folds) == len(train) + len(test)
    for fold in folds:
        assert not np.isin(fold.train.session, fold.test.session).any()
    assert folds[-1].train is train
    assert "Each session of TRAIN and TEST" in sentence


def test_one_fold_is_the_sessions_of_the_test_taps():
    """So no model is fitted again; unless both sets share a session."""
    train, test = make_taps(0, 2), make_taps(1, 2)
    folds, sentence = folds_of("session", train, test, train.grid(), 1)
    assert [fold.train for fold in folds] == [train]
    assert len(folds[0].test) == len(test)
    assert "none of TRAIN" in sentence
    parts = train.select(np.arange(36)), train.select(np.arange(36, 48))
    shared = folds_of("session", *parts, train.grid(), 1, one_recording=True)[0]
    assert len(shared) == 2


def test_sessions_of_two_recordings_are_told_apart():
    """Session 0 of two files is two sessions, that of one file divided between both is one."""
    whole = make_taps(0, 1)
    assert len(folds_of("session", whole, make_taps(1, 1), whole.grid(), 6)[0]) == 2
    parts = whole.select(np.arange(12)), whole.select(np.arange(12, 24))
    folds, sentence = folds_of("session", *parts, whole.grid(), 6, one_recording=True)
    assert folds == []
    assert "only one" in sentence


@pytest.mark.parametrize("most", [2, 6])
def test_many_sessions_are_left_out_in_groups(most):
    """Never more folds than asked for."""
    train, test = make_taps(0, 9), make_taps(1, 1, first=20)
    folds, sentence = folds_of("session", train, test, train.grid(), most)
    assert len(folds) == most
    assert f"{most} groups of sessions" in sentence


def test_other_objects_in_test_leave_one_direction():
    """Recordings that cannot be pooled are compared from TRAIN to TEST."""
    train = make_taps(0, 1)
    test = TapSet(make_taps(1, 1, first=1).dataset.isel(taxel=slice(0, 2)))
    folds, sentence = folds_of("session", train, test, train.grid(), 6)
    assert [fold.name for fold in folds] == ["TEST"]
    assert "cannot be pooled" in sentence


@pytest.mark.parametrize(("unit", "size"), [("position", L), ("object", M)])
@pytest.mark.parametrize("most", [2, 99])
def test_every_place_is_predicted_without_its_training_taps(unit, size, most):
    """Each test tap once, from training taps of all other places."""
    train, test = at_places(0, 0), at_places(1, 1)
    folds, sentence = folds_of(unit, train, test, train.grid(), most)
    axis = ("position", "object").index(unit)

    assert len(folds) == min(size, most)
    assert sum(len(fold.test) for fold in folds) == len(test)
    for fold in folds:
        there, left_out = (set(taps.indices(train.grid())[axis]) for taps in (fold.train, fold.test))
        assert there == set(range(size)) - left_out
        assert set(fold.train.session) == {0}
        assert set(fold.test.session) == {1}
    assert sentence.startswith(f"Each {unit} of TEST" if most > size else f"Each of 2 groups of {unit}s of TEST")


def test_a_single_object_cannot_be_left_out():
    """Nothing is left to train on, and the sentence says so."""
    taps = at_places(0, 0)
    one = taps.select(taps.indices(taps.grid())[1] == 0)
    folds, sentence = folds_of("object", one, one, one.grid(), 6)

    assert folds == []
    assert "No object can be left out" in sentence


@pytest.mark.parametrize("unit", ["position", "object"])
def test_new_places_are_scored_as_by_a_loop(unit):
    """Histogram: a mean over the trained places of the same other kind, and a belief that sums over all."""
    train, test = at_places(0, 0, lacking=(3, 1)), at_places(1, 1)
    grid = at_places(0, 0).grid()
    folds, _ = folds_of(unit, train, test, grid, 99)
    fold, score = folds[1], scorer(unit, folds, grid, 7)
    fitted = fit_model("histogram", fold.train, grid, SETTINGS)
    scores = score(fitted, fold.test, 0.3)
    table = fitted.model.log_likelihood(fold.test.taps)
    for n, (l, m) in enumerate(zip(*fold.test.indices(grid), strict=True)):
        trained = fitted.model.trained[:, m] if unit == "position" else fitted.model.trained[l]
        classes = [(k, m) if unit == "position" else (l, k) for k in np.flatnonzero(trained)]
        assert scores["plug_in"].values[n] == pytest.approx(
            logsumexp([table[n, *c] for c in classes]) - np.log(len(classes))
        )
        chance = generator(7, Purpose.SCORES)
        each = [integrated(fitted, fold.test.taps[n : n + 1], tuple(np.array([i]) for i in c), chance) for c in classes]
        assert scores["integrated"].values[n] == pytest.approx(logsumexp(each) - np.log(len(classes)))

        belief = np.exp(0.3 * table[n] - logsumexp(0.3 * table[n])).sum(axis=("position", "object").index(unit))
        true = m if unit == "position" else l
        assert np.exp(scores["belief"].values[n]) == pytest.approx(belief[true])
        error = grid.what_error if unit == "position" else grid.where_error
        assert scores["error"].values[n] == error(belief.argmax(), true)


@pytest.mark.parametrize("unit", ["position", "object"])
def test_one_more_group_is_left_out_of_what_a_model_says(unit):
    """As by a model that lacks these classes, in everything that is said of a tap; the tap's own group changes none."""
    train, test = at_places(0, 0), at_places(1, 1)
    grid, axis = train.grid(), ("position", "object").index(unit)
    folds, _ = folds_of(unit, train, test, grid, 3)
    fitted = fit_model("gaussian", folds[0].train, grid, SETTINGS)
    scores = scorer(unit, folds, grid, 0)(fitted, folds[0].test, 1.0)
    second = np.unique(folds[1].test.indices(grid)[axis])
    covered = fitted.model.covered.copy()
    covered[(second, slice(None)) if axis == 0 else (slice(None), second)] = False
    fewer = fitted._replace(model=replace(fitted.model, covered=covered))
    expected = scorer(unit, folds, grid, 0)(fewer, folds[0].test, 1.0)

    assert set(scores) == {"plug_in", "integrated", "belief", "error"}
    for name, found in scores.items():
        assert found.without.shape == (len(folds[0].test), 3)
        np.testing.assert_allclose(found.without[:, 1], expected[name].values, err_msg=name)
        np.testing.assert_allclose(found.without[:, 0], found.values, err_msg=name)
    assert np.ptp(scores["belief"].without, axis=1).max() > 1e-3


def test_intervals_of_places_leave_each_out_as_tap_and_as_what_was_trained():
    """The jackknife by hand; two folds alone say nothing."""
    generator = np.random.default_rng(0)
    cluster = np.repeat(np.arange(4), 5)
    values, without = generator.normal(size=20), generator.normal(size=(20, 4))
    means = mean_scores({"a": TapScores(values, cluster, without)}, "a", "x")
    left = [without[cluster != c, c].mean() for c in range(4)]
    half = stats.t.ppf(0.975, 3) * np.sqrt(3 / 4 * np.square(left - np.mean(left)).sum())

    assert means["x"].item() == pytest.approx(values.mean())
    assert (means["x_high"] - means["x_low"]).item() / 2 == pytest.approx(half)
    two = mean_scores({"a": TapScores(values, cluster // 2, without[:, :2])}, "a", "x")
    assert np.isnan(two["x_low"]).all()


@pytest.mark.parametrize(
    ("unit", "drawn", "clusters", "freedom", "said"),
    [
        ("session", "class", 8, 7.0, "do not cover another session"),
        ("session", "session", 2, 1.0, "Too few test sessions, 2, to estimate"),
        ("session", "session", 9, 1.4, "Too few test sessions, 9 of unequal sizes, to estimate"),
        ("session", "session", 5, 4.0, None),
        ("position", "position", 3, 2.0, None),
    ],
)
def test_what_intervals_of_sessions_do_not_cover_is_said(unit, drawn, clusters, freedom, said):
    """One session tells nothing of others, and a few little; folds of positions have no such sentence."""
    means = xr.Dataset(attrs={"unit": unit, "drawn": drawn, "clusters": clusters, "freedom": freedom})
    cautions = _cautions(means)

    assert len(cautions) == (said is not None)
    assert all(said in caution for caution in cautions)
    assert _cautions(None) == []


def test_a_model_of_all_positions_predicts_new_ones_by_their_own_likelihood():
    """The smooth model interpolates between its positions, which beats the mean of the others."""
    train, test = at_places(0, 0), at_places(1, 1)
    folds, _ = folds_of("position", train, test, train.grid(), 99)
    fold, score = folds[2], scorer("position", folds, train.grid(), 0)
    fitted = {name: fit_model(name, fold.train, train.grid(), SETTINGS) for name in ("smooth", "profile")}
    scores = {name: score(fit, fold.test, 1.0)["plug_in"].values for name, fit in fitted.items()}
    table = fitted["smooth"].model.log_likelihood(fold.test.taps)
    own = table[np.arange(len(table)), *fold.test.indices(train.grid())]

    np.testing.assert_allclose(scores["smooth"], own)
    assert scores["smooth"].mean() > scores["profile"].mean() + 0.2


def test_what_is_said_of_new_places():
    """Something where the same object is trained at any position, or any object at the same position."""
    trained = np.array([[True, False, False], [False, False, False], [True, True, False]])

    np.testing.assert_array_equal(said(trained, "session"), trained)
    np.testing.assert_array_equal(said(trained, "position"), [[True, True, False]] * 3)
    np.testing.assert_array_equal(said(trained, "object"), [[True] * 3, [False] * 3, [True] * 3])
