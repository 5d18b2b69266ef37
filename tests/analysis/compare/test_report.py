"""The report of a comparison: what ArviZ takes of it."""

import json
import warnings
from copy import deepcopy
from dataclasses import replace

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr
from slow_cases import slow_but
from solidtouch.analysis.compare import report as compare_report
from solidtouch.analysis.compare.report import compare
from solidtouch.analysis.tasks.crew import on_runner
from solidtouch.models.settings import FitSettings
from task_runners import through_pickle


@pytest.fixture(scope="module")
def report(make_taps):
    """Models of taps whose samples depend on the object and the position, but not on the time."""
    taps = make_taps(L=3, M=2, J=12, K=3, sessions=2, repeats=6)
    first = taps.session == 0
    models = ["histogram", "gaussian", "profile"]
    parts = (taps.select(first), taps.select(~first))
    return compare(*parts, models=models, fit=FitSettings(bins=20), draws=0, trials=40, thresholds=[0.5, 0.9])


def test_the_first_note_names_overconfident_models(report):
    """With a link to the figure of all factors; nothing is said where there are none."""
    said, silent = (
        replace(report, summary={**report.summary, "overconfident": sentence}).page for sentence in ("Own is.", "")
    )

    assert "Own is. See [Calibration of decisions](#calibration)." in said.intro[0].block.blocks
    assert "Calibration" not in repr(silent.intro)


FOUR_TAPS = {"fit": FitSettings(bins=10, method="map", unconverged=True), "trials": 20, "thresholds": [0.5]}


def by_object(where, what, taps=None, *, M, J, K):
    """A level of each object."""
    with numpyro.plate("M", M):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc[what][:, None, None], 1.0), obs=taps)


@pytest.mark.parametrize(
    ("models", "draws"),
    [
        (["histogram", "gaussian", "session:gaussian"], 100),
        ([by_object], 0),
    ],
    ids=["built-in", "own"],
)
def test_models_fitted_and_judged_elsewhere_have_the_same_numbers(make_taps, monkeypatch, models, draws):
    """In all tables, to the last bit."""
    taps = make_taps(L=2, M=2, J=3, K=2, sessions=3, repeats=6)
    first = taps.session < 2
    parts = taps.select(first), taps.select(~first)
    here = compare(*parts, models=models, draws=draws, **FOUR_TAPS)
    monkeypatch.setattr(compare_report, "crew_of", lambda *_: on_runner(through_pickle))
    there = compare(*parts, models=models, draws=draws, scheduler="tcp://elsewhere:1", **FOUR_TAPS)

    assert timeless(here) == timeless(there)
    for name, group in here.tree.subtree_with_keys:
        xr.testing.assert_identical(group.to_dataset().drop_attrs(), there.tree[name].to_dataset().drop_attrs())


def timeless(report):
    """The summary without what differs from run to run."""
    models = [{**row, "seconds": None} for row in report.summary["models"]]
    return json.dumps({**report.summary, "models": models, "elapsed_s": None})


def compared(elpd):
    import arviz as az  # where it comes before NumPyro, it leaves a lazy one behind that lacks submodules

    return az.compare(elpd, round_to="none")


def plotted(table):
    import arviz as az

    return az.plot_compare(table, backend="none")


def test_arviz_compares_what_the_report_holds(report):
    """Without a warning, with the order and the differences of the report and a weight that is right."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        table = compared(report.elpd)
    mean = report.taps["integrated"].to_series()
    taps = report.taps.attrs["taps"]

    assert list(table.index) == list(mean.sort_values(ascending=False).index)
    np.testing.assert_allclose(table["elpd_diff"] / taps, (mean - mean.max())[table.index], atol=1e-9)
    assert table.loc["gaussian", "weight"] > 0.8
    assert table["weight"].sum() == pytest.approx(1)
    assert "plot" in plotted(table).viz


def test_absolute_log_probabilities_of_taps_would_have_no_weights(report):
    """The same taps with the log probabilities that taps of hundreds of samples have: exp() is 0 for all models."""
    absolute = deepcopy(report.elpd)
    for values in absolute.values():
        values.elpd_i = values.elpd_i - 2000.0
    with pytest.warns(RuntimeWarning):
        table = compared(absolute)

    assert np.ptp(table["weight"]) < 0.01


@pytest.mark.parametrize(
    ("unit", "other"), slow_but([("position", "object")], [("position", "object"), ("object", "position")])
)
def test_new_positions_and_objects_have_a_table_of_their_own(make_taps, unit, other):
    """What is predicted, with what units, and what a tap tells of the other kind."""
    taps = make_taps(L=3, M=2, J=6, K=2, sessions=2, repeats=6)
    first = taps.session == 0
    report = compare(
        taps.select(first),
        taps.select(~first),
        models=["histogram", "gaussian"],
        fit=FitSettings(bins=10),
        draws=0,
        trials=20,
        thresholds=[0.5],
        leave_out=unit,
    )
    page = repr(report.page)
    bounded = report.taps[["integrated_high", "plug_in_high", "belief_high"]].fillna(0.0)

    assert (bounded <= 0).to_array().all()
    assert (report.taps["error_low"].fillna(0.0) >= 0).all()
    assert report.taps.attrs["unit"] == unit
    assert {"integrated", "plug_in", "belief", "error_difference_low"} <= set(report.taps)
    assert report.taps["belief"].attrs["long_name"] == f"mean log belief in the true {other} after one tap"
    assert f"{unit}s_left_out" in report.tree
    assert f"leaving out each fold of {unit}s" in page
    assert f"{other.capitalize()} after one tap at left-out {unit}s" in page


def test_a_model_that_fails_without_a_group_is_named_in_the_warnings(make_taps):
    """With its reason, as its row has no value."""
    taps = make_taps(L=4, M=2, J=6, K=2, sessions=2, repeats=6)
    first = taps.session == 0
    few = {"fit": FitSettings(bins=10), "draws": 0, "trials": 20, "thresholds": [0.5], "leave_out": "position"}
    report = compare(taps.select(first), taps.select(~first), models=["gaussian", "smooth"], folds=2, **few)
    (told,) = [text for text in report.summary["warnings"] if text.startswith("smooth has no value")]

    assert "smooth has no value for left-out positions: without position " in told
    assert "three positions" in told or "3 positions" in told
    assert "gaussian has no value" not in repr(report.summary["warnings"])


@pytest.mark.slow
def test_a_function_with_sessions_is_compared_in_every_way(make_taps):
    """Single taps left out and predictive checks are those of their own sessions."""

    def shifted(where, what, taps=None, *, M, J, K, session):
        with numpyro.plate("M", M):
            loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
        with numpyro.plate("S", int(session.max()) + 1):
            shift = numpyro.sample("shift", dist.Normal(0.0, 1.0))
        level = (loc[what] + shift[session])[:, None, None]
        with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
            numpyro.sample("taps", dist.Normal(level, 1.0), obs=taps)

    taps = make_taps(L=2, M=2, J=3, K=2, sessions=3, repeats=6)
    first = taps.session == 0
    fitting = FitSettings(bins=10, method="map", unconverged=True)
    report = compare(
        taps.select(first),
        taps.select(~first),
        models=["gaussian", shifted],
        fit=fitting,
        draws=100,
        trials=20,
        thresholds=[0.5],
    )

    assert list(report.tree["checks"]["model"].values) == ["gaussian", "shifted"]
    assert list(report.tree["taps_left_out"]["model"].values) == ["gaussian", "shifted"]
    assert np.isfinite(report.taps["integrated"].sel(model="shifted"))
    assert any("Each trial draws taps of all 2 test sessions" in text for text in report.summary["warnings"])
