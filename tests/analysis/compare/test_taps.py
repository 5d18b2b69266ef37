"""Models compared by taps: groups and single taps left out, stacking, predictive checks."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.compare.groups import folds_of, score_sessions
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


@pytest.mark.parametrize("name", ["histogram", "gaussian"])
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
    counted = []
    result = leave_one_tap_out(fitted, few, 400, 0, counted.append)
    found = _single(result)

    assert result["looked_at"].sum() == found["psis_taps"] == looked_at
    assert found["psis_ranks"] == (looked_at == 300)
    assert (found["psis"] is None) == (looked_at < 300)  # a mean over some taps beside exact ones over all
    assert np.isfinite(result["psis"]).sum() == looked_at
    assert np.isfinite(result["exact"]).all()
    assert sum(counted) == 400


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
    train, test = make_taps(0, 1, rho=0.8), make_taps(1, 1, first=1, rho=0.8)
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
    means = mean_scores(scores, "profile", "integrated", seed=0)
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
    means = mean_scores(scores, "a", "x", seed=1)
    assert float(means["x"].sel(model="a")) == pytest.approx(values.mean())
    for end in ("", "_low", "_high"):
        assert float(means[f"x_difference{end}"].sel(model="b")) == pytest.approx(1.0)


def test_taps_of_a_session_and_class_are_drawn_together():
    """Ten taps that err alike are worth one: intervals stay the same, however often a cluster's tap is repeated."""
    values = np.random.default_rng(3).normal(size=(2, 8))
    one, ten = (
        mean_scores(
            {n: TapScores(v.repeat(k), np.arange(8).repeat(k)) for n, v in zip("ab", values, strict=True)},
            "a",
            "x",
            seed=4,
        )
        for k in (1, 10)
    )
    assert float((one["x_high"] - one["x_low"]).min()) > 0.3
    for name in one:
        np.testing.assert_allclose(one[name], ten[name], err_msg=name)


def test_clusters_are_sessions_and_classes():
    """Taps share a cluster where they share both, and clusters of different folds stay apart."""
    taps = make_taps(0, 2)
    fitted = fit_model("histogram", taps, taps.grid(), SETTINGS)
    part = score_sessions(fitted, taps, 0)["plug_in"]
    label = 2 * taps.session + taps.indices(taps.grid())[1]
    assert len(np.unique(part.cluster)) == len(np.unique(label)) == 4
    assert len(np.unique(np.stack([part.cluster, label]), axis=1).T) == 4

    none = TapScores(np.empty(0), np.empty(0, dtype=np.intp))
    joined = join_scores([part, none, part, part])
    assert len(joined.values) == 3 * len(taps)
    assert len(np.unique(joined.cluster)) == joined.cluster.max() + 1 == 12


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


@pytest.mark.parametrize("clusters", [4, 8, 40])
def test_intervals_of_mean_scores_hold_the_truth(clusters):
    """Of 300 sets of clusters whose taps share what their session and class did, and of a model half as good."""
    rng, held = np.random.default_rng(3), []
    cluster = np.repeat(np.arange(clusters), 5)
    for number in range(300):
        shared, own = rng.normal(-10, 1, clusters)[cluster], rng.normal(0, 1, 5 * clusters)
        values = {"a": shared + own, "b": shared - 2 + rng.normal(0, 0.5, clusters)[cluster]}
        means = mean_scores({name: TapScores(one, cluster) for name, one in values.items()}, "a", "x", number)
        held.append(
            [
                float(means.x_low.sel(model="a")) <= -10 <= float(means.x_high.sel(model="a")),
                float(means.x_difference_low.sel(model="b")) <= -2 <= float(means.x_difference_high.sel(model="b")),
            ]
        )
    assert (np.mean(held, axis=0) > 0.91).all()
    assert (np.mean(held, axis=0) < 0.985).all()
