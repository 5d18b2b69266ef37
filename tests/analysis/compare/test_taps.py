"""Models compared by taps: groups and single taps left out, stacking, predictive checks."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from slow_cases import slow_but
from solidtouch.analysis.compare.groups import folds_of, score_sessions, scorer
from solidtouch.analysis.compare.summary import _single
from solidtouch.analysis.compare.taps import (
    TapScores,
    join_scores,
    leave_one_tap_out,
    mean_scores,
    relative_elpd,
    stacked,
)
from solidtouch.analysis.stats.checks import STATISTICS, predictive_checks
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

J, K = 6, 3
SETTINGS = FitSettings(bins=25, pseudocount=0.5)


def make_taps(seed: int, sessions: int, first: int = 0, rho: float = 0.0) -> TapSet:
    """Taps with a profile in time, residuals of order one with slope rho."""
    generator = np.random.default_rng(seed)
    session = np.repeat(np.arange(sessions), 24)
    what = np.tile(np.repeat([0, 1], 12), sessions)
    noise = generator.normal(size=(len(what), J, K))
    for j in range(1, J):
        noise[:, j] += rho * noise[:, j - 1]
    profile = np.linspace(0, 6, J)[:, None] * (1 + what)[:, None, None]
    return TapSet.from_arrays(
        profile + noise,
        what,
        ["a", "b"],
        session=session + first,
        preprocessing=Preprocessing(samples=J),
    )


def test_histogram_is_left_out_exactly_and_importance_sampling_says_where_it_fails():
    """Pareto k is there for every tap, and the exact value lies below the one that knows the tap."""
    taps = make_taps(0, 1)
    fitted = fit_model("histogram", taps, taps.grid(), SETTINGS)
    result = leave_one_tap_out(fitted, taps, 200, seed=0)
    assert result["pareto_k"].shape == (len(taps),)
    within = score_sessions(fitted, taps, 0)["plug_in"]
    assert float(result["exact_plug_in"].mean()) < within.values.mean()
    assert set(result) == {"psis", "pareto_k", "looked_at", "good_k", "exact", "exact_plug_in"}


@pytest.mark.parametrize("name", slow_but(["gaussian"], ["histogram", "gaussian"]))
def test_importance_sampling_agrees_where_it_can(name):
    """With many taps of few samples it is as good as the exact value."""
    generator = np.random.default_rng(5)
    taps = TapSet.from_arrays(
        generator.normal(size=(300, 1, 1)), np.zeros(300, dtype=int), ["a"], preprocessing=Preprocessing(samples=1)
    )
    fitted = fit_model(name, taps, taps.grid(), SETTINGS.changed(bins=5))
    result = leave_one_tap_out(fitted, taps, 2000, seed=0)
    assert float(result["pareto_k"].max()) < 0.7
    np.testing.assert_allclose(result["psis"], result["exact"], atol=0.02)


@pytest.mark.parametrize(("samples", "looked_at"), [(1, 300), (30, 100)])
def test_a_sample_of_taps_decides_whether_the_others_are_looked_at(samples, looked_at):
    """Only where importance sampling works for all of the sample; where it stops early, nothing is ranked by it."""
    shape = (300, samples, 4)
    taps = TapSet.from_arrays(
        np.random.default_rng(5).normal(size=shape),
        np.arange(300) % 10,
        [*"abcdefghij"],
        preprocessing=Preprocessing(samples=samples),
    )
    few = taps if samples > 1 else TapSet(taps.dataset.isel(taxel=slice(0, 1)).assign(what=("tap", np.zeros(300, int))))
    fitted = fit_model("histogram", few, few.grid(), SETTINGS.changed(bins=5))
    result = leave_one_tap_out(fitted, few, 400, 0)
    found = _single(result)

    assert result["looked_at"].sum() == found["psis_taps"] == looked_at
    assert found["psis_ranks"] == (looked_at == 300)
    assert (found["psis"] is None) == (looked_at < 300)  # a mean over some taps beside exact ones over all
    assert np.isfinite(result["psis"]).sum() == looked_at
    assert np.isfinite(result["exact"]).all()


def test_taps_without_a_pareto_k_are_not_ranked():
    """Where all draws give a tap the same probability, or all good values are those of a sample."""
    k = np.full(5, 0.1)
    whole = xr.Dataset({"psis": ("tap", k), "pareto_k": ("tap", k), "looked_at": ("tap", k > 0), "good_k": 0.7})
    none = whole.assign(pareto_k=("tap", [0.1, np.nan, 0.1, 0.1, 0.1]))
    stopped = whole.assign(looked_at=("tap", np.arange(5) < 3))

    assert [_single(left_out)["psis_ranks"] for left_out in (whole, none, stopped)] == [True, False, False]
    assert [_single(left_out)["bad_k"] for left_out in (whole, none, stopped)] == [0.0, 0.2, 0.0]


def test_the_model_that_made_the_taps_wins():
    """Correlated residuals are predicted better by the model that knows of them, by weight and by interval."""
    train, test = make_taps(0, 2, rho=0.8), make_taps(1, 2, first=2, rho=0.8)
    folds, _ = folds_of("session", train, test, train.grid(), 6)
    scores = {}
    for name in ("profile", "profile-ar"):
        parts = [
            score_sessions(fit_model(name, fold.train, fold.train.grid(), SETTINGS), fold.test, 0) for fold in folds
        ]
        scores[name] = join_scores([part["integrated"] for part in parts])
    table = stacked(relative_elpd(scores, len(folds)))
    assert table.loc["profile-ar", "rank"] == 0
    assert table.loc["profile-ar", "weight"] > 0.8
    means = mean_scores(scores, "profile", "integrated")
    assert float(means["integrated_difference_low"].sel(model="profile-ar")) > 0


def test_weights_do_not_depend_on_a_common_number():
    """Log probabilities of -1000 per tap are weighed like those of -1."""
    generator = np.random.default_rng(0)
    cluster = np.arange(40)
    a, b = generator.normal(size=(2, 40))
    weights = [
        stacked(relative_elpd({"a": TapScores(a + c, cluster), "b": TapScores(b + c, cluster)}, 2)).loc["a", "weight"]
        for c in (0.0, -1000.0)
    ]
    assert weights[0] == pytest.approx(weights[1], abs=1e-6)


def test_means_are_those_of_taps_and_differences_pair():
    """A model that is everywhere 1 nat better is so without doubt."""
    generator = np.random.default_rng(0)
    values, cluster = generator.normal(size=30), np.repeat(np.arange(6), 5)
    scores = {"a": TapScores(values, cluster), "b": TapScores(values + 1, cluster)}
    means = mean_scores(scores, "a", "x")
    assert float(means["x"].sel(model="a")) == pytest.approx(values.mean())
    for end in ("", "_low", "_high"):
        assert float(means[f"x_difference{end}"].sel(model="b")) == pytest.approx(1.0)


def test_taps_of_a_session_are_drawn_together():
    """Ten taps that err alike are worth one: intervals stay the same, however often a session's tap is repeated."""
    values = np.random.default_rng(3).normal(size=(2, 8))
    one, ten = (
        mean_scores(
            {n: TapScores(v.repeat(k), np.arange(8).repeat(k)) for n, v in zip("ab", values, strict=True)}, "a", "x"
        )
        for k in (1, 10)
    )
    for name in one:
        np.testing.assert_allclose(one[name], ten[name], err_msg=name)


def intervals_of(data_sets, taps: int | list[int] = 1):
    """Both ends for data sets of sessions of these means, in which all taps are alike, shape (data sets, 2)."""
    cluster = np.repeat(np.arange(np.shape(data_sets)[1]), taps)
    scores = {str(i): TapScores(np.repeat(sessions, taps), cluster) for i, sessions in enumerate(data_sets)}
    means = mean_scores(scores, "0", "x")
    return np.stack([means["x_low"].values, means["x_high"].values], axis=-1)


@pytest.mark.parametrize(
    "sessions", [[-3.0, -1.0, 0.0, 1.0, 3.0], [-1.0, 0.0, 0.0, 5.0], [-1.0, -1.0, -1.0, -1.0, -1.0]]
)
def test_unskewed_or_few_sessions_have_intervals_of_student(sessions):
    """As all have that are fewer than five."""
    half = stats.t.ppf(0.975, len(sessions) - 1) * stats.sem(sessions)
    expected = np.mean(sessions) + half * np.array([-1, 1])

    np.testing.assert_allclose(intervals_of([sessions])[0], expected, rtol=1e-12)


def test_intervals_of_skewed_sessions_follow_units_and_sign(rng):
    """And solve Hall's equation, his cubic of the t statistic being a quantile of Student's t."""
    sessions, taps = -(rng.normal(size=6) ** 2), [2, 3, 4, 5, 6, 7]
    low, high = intervals_of([sessions], taps)[0]

    np.testing.assert_allclose(intervals_of([7 + 3 * sessions], taps)[0], 7 + 3 * np.array([low, high]))
    np.testing.assert_allclose(intervals_of([-sessions], taps)[0], [-high, -low])
    ends = intervals_of([sessions])[0]
    t = (sessions.mean() - ends) / stats.sem(sessions)
    g = stats.skew(sessions) / 6**0.5
    np.testing.assert_allclose(t + g / 3 * t**2 + g**2 / 27 * t**3 + g / 6, stats.t.ppf([0.975, 0.025], 5))
    assert sessions.mean() - ends[0] > ends[1] - sessions.mean() > 0


@pytest.mark.parametrize("sizes", [[1] * 10, [4] * 5 + [1] * 5])
def test_intervals_of_skewed_sessions_hold_the_mean(sizes, rng):
    """Of minus squares of normal numbers; intervals of Student's t hold .86 and .84. Normal ones stay at .95."""
    normal = rng.normal(size=(2000, 10))
    low, high = intervals_of(-(normal**2), sizes).T
    assert np.mean((low <= -1) & (high >= -1)) > 0.92
    low, high = intervals_of(normal, sizes).T
    assert np.mean((low <= 0) & (high >= 0)) > 0.94


def test_sessions_of_unequal_sizes_have_fewer_degrees_of_freedom():
    """A second session of one tap beside a hundred is worth next to nothing, and one session nothing."""
    values = np.random.default_rng(0).normal(size=101)
    found = [
        mean_scores({"a": TapScores(values, cluster)}, "a", "x")
        for cluster in (np.repeat([0, 1, 2], [50, 50, 1]), np.zeros(101, dtype=np.intp))
    ]

    assert found[0].attrs["freedom"] == pytest.approx(101**2 / 5001 - 1)
    assert np.isfinite(found[0]["x_low"]).all()
    assert np.isnan(found[1]["x_low"]).all()


def test_clusters_are_sessions():
    """Those of different folds stay apart."""
    taps = make_taps(0, 2)
    fitted = fit_model("histogram", taps, taps.grid(), SETTINGS)
    part = score_sessions(fitted, taps, 0)["plug_in"]
    np.testing.assert_array_equal(part.cluster, taps.session)

    none = TapScores(np.empty(0), np.empty(0, dtype=np.intp))
    joined = join_scores([part, none, part, part])
    assert len(joined.values) == 3 * len(taps)
    assert len(np.unique(joined.cluster)) == joined.cluster.max() + 1 == 6


@pytest.mark.parametrize(("sessions", "most", "classes"), [(1, 1, True), (2, 1, False), (1, 6, False)])
def test_clusters_are_classes_where_one_session_is_left_out_alone(sessions, most, classes):
    """Not where it is one fold among several."""
    train, test = make_taps(0, 1), make_taps(1, sessions, first=1)
    folds, _ = folds_of("session", train, test, train.grid(), most)
    fitted = fit_model("histogram", folds[-1].train, train.grid(), SETTINGS)
    part = scorer("session", folds, train.grid(), 0)(fitted, folds[-1].test, 1.0)["plug_in"]
    taps = folds[-1].test
    expected = taps.indices(train.grid())[1] if classes else taps.session - taps.session.min()

    np.testing.assert_array_equal(part.cluster, expected)


def test_checks_show_what_a_model_leaves_out():
    """The profile lies far off for exchangeable samples, the correlation in time for independent residuals."""
    taps = make_taps(0, 2, rho=0.8)
    models = {name: fit_model(name, taps, taps.grid(), SETTINGS) for name in ("histogram", "profile", "profile-ar")}
    checks = predictive_checks(models, taps, seed=0, replicates=12)
    p = checks["p"]
    assert float(p.sel(model="histogram", statistic="profile")) == 0
    assert float(p.sel(model="profile", statistic="lag")) == 0
    assert 0 < float(p.sel(model="profile-ar", statistic="lag")) < 1
    assert "place" not in checks["statistic"].values
    assert set(checks["statistic"].values) < set(STATISTICS)


def test_places_within_a_class_are_replicated_where_the_model_knows_them():
    """Curves over position explain variance within classes that one mean per class leaves to noise."""
    generator = np.random.default_rng(4)
    place = np.linspace(0, 4, 64, endpoint=False)
    taps = TapSet.from_arrays(
        (np.sin(2 * place) * 5)[:, None, None] + generator.normal(size=(64, J, K)),
        np.zeros(64, dtype=int),
        ["a"],
        where=place,
        where_value=np.arange(4) + 0.5,
        where_edges=np.arange(5.0),
        preprocessing=Preprocessing(samples=J),
    )
    models = {n: fit_model(n, taps, taps.grid(), SETTINGS.changed(unconverged=True)) for n in ("profile", "smooth")}
    checks = predictive_checks(models, taps, seed=0, replicates=6).sel(statistic="place")
    replicated = checks["replicated"].mean("replicate")
    assert float(replicated.sel(model="profile")) < 0.5 * float(checks["observed"])
    assert float(replicated.sel(model="smooth")) > 0.7 * float(checks["observed"])


def shifted_taps(sessions: int, seed: int) -> TapSet:
    """Taps of six classes and eight taxels, whose levels each session shifts in common."""
    generator = np.random.default_rng(seed)
    session, what = (a.ravel() for a in np.indices((sessions, 6, 4))[:2])
    level = 3.0 * what[:, None] + generator.normal(size=(sessions, 8))[session]
    return TapSet.from_arrays(
        (level + 0.5 * generator.normal(size=level.shape))[:, None],
        what,
        [*"abcdef"],
        session=session + 10,
        preprocessing=Preprocessing(samples=1),
    )


@pytest.mark.parametrize("sessions", slow_but([2], [2, 5]))
def test_intervals_of_left_out_sessions_hold_the_truth(sessions):
    """Of 100 data sets of sessions that shift all classes; with sessions and classes as units half would."""
    train, held = shifted_taps(6, 0), []
    train = TapSet(train.dataset.assign_coords(session=("tap", train.session - 10)))
    grid = train.grid()
    parts = {"all": train, "half": train.select(train.session < 3)}
    fits = {name: fit_model("gaussian", part, grid, SETTINGS) for name, part in parts.items()}

    def scored(sessions: int, seed: int) -> xr.Dataset:
        folds, _ = folds_of("session", train, shifted_taps(sessions, seed), grid, 1)
        score = scorer("session", folds, grid, 0)
        scores = {name: score(fitted, folds[0].test, 1.0)["plug_in"] for name, fitted in fits.items()}
        return mean_scores(scores, "all", "x")

    truth = scored(1000, 1)
    for seed in range(2, 102):
        means = scored(sessions, seed)
        held.append(
            [
                means[f"{name}_low"].values[-1] <= truth[name].values[-1] <= means[f"{name}_high"].values[-1]
                for name in ("x", "x_difference")
            ]
        )
    assert (np.mean(held, axis=0) > 0.85).all()


@pytest.mark.parametrize("models", [2, 5])
def test_the_best_of_equal_models_is_rarely_said_to_be_better_than_the_second(models, rng):
    """The difference of the best to the second is chosen for its size, and still excludes 0 in 5% at most.

    Of 200 studies of 12 sessions, whose losses differ between sessions; of two models in about 5%, of five in less.
    """
    cluster = np.repeat(np.arange(12), 5)
    excluded = 0
    for _ in range(200):
        own = rng.normal(size=(models, 12))[:, cluster] + rng.normal(size=(models, len(cluster)))
        scores = {f"m{m}": TapScores(values, cluster) for m, values in enumerate(own)}
        means = mean_scores(scores, "m0", "integrated")
        best = int(means["integrated"].values.argmax())
        step = means.isel(model=best)
        order = np.sort(means["integrated"].values)
        assert step["integrated_step"] == pytest.approx(order[-1] - order[-2])
        assert np.isnan(means["integrated_step"].isel(model=int(means["integrated"].values.argmin())))
        excluded += float(step["integrated_step_low"]) > 0

    most, least = stats.binom(200, 0.05).ppf([0.999, 0.001])
    assert excluded <= most
    assert (excluded >= least) == (models == 2)
