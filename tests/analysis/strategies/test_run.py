"""A whole comparison of strategies on a small simulated rig, on a right model and on recorded taps."""

import json
from dataclasses import replace

import numpy as np
import pytest
from solidtouch.analysis.page import html
from solidtouch.analysis.page.numbers import STORED_ONLY
from solidtouch.analysis.stats.resampled_units import RESAMPLES
from solidtouch.analysis.strategies import figures as figure_strategies
from solidtouch.analysis.strategies import run as strategies_run
from solidtouch.analysis.strategies import summary as strategies_summary
from solidtouch.analysis.strategies.curves import differences, families
from solidtouch.analysis.strategies.data import (
    RIGHT,
    StrategyData,
    Unit,
    pool_of,
    recorded_bench,
    simulated_bench,
)
from solidtouch.analysis.strategies.figures_trust import trust
from solidtouch.analysis.strategies.findings import FIXED, LOOK, PAPER, TAPS, findings, source_findings
from solidtouch.analysis.strategies.page import strategies_page
from solidtouch.analysis.strategies.report import StrategiesReport
from solidtouch.analysis.strategies.run import BASE, TRUSTED, StrategySettings, playable, strategy_study
from solidtouch.analysis.strategies.summary import summarise
from solidtouch.analysis.tasks.crew import on_runner, on_threads
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PAPER_RODS, preset
from solidtouch.inference.information import tap_outcomes
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.progress import no_progress
from task_runners import through_pickle

RIG = replace(preset("paper"), rods=PAPER_RODS[:3], start_mm=2.0, end_mm=10.0, spacing_mm=0.125)
FEW = ("passive", "random", BASE, "info-what", "info-what-per-mm", "table")
DESCRIBED = {"title": "A small comparison", "command": "solidtouch strategies"}
SETTINGS = StrategySettings(trials=50, deadline=12, pool=100, seed=1, strategies=FEW)


def load(number):
    return Unit(*(simulate_session(RIG, number, session) for session in range(3)))


@pytest.fixture(scope="module")
def bench():
    """Four small simulated data sets of 8 x 3 classes."""
    grid = load(0).train.grid()
    return StrategyData("small rig", True, 4, load, grid, "Units are 4 data sets.", ("J", "learned"), "uniform")


@pytest.fixture(scope="module")
def study(bench):
    return strategy_study(bench, SETTINGS, no_progress, on_threads(1))


@pytest.fixture(scope="module")
def summary(study):
    return summarise([study], SETTINGS, DESCRIBED)


@pytest.fixture
def two_families(monkeypatch):
    """Stopping rules of the paper and after a number of taps."""

    def two(*arguments):
        return tuple(family for family in families(*arguments) if family.name in (PAPER, FIXED))

    monkeypatch.setattr(strategies_run, "families", two)


def equal(summary, family, strategy):
    rows = summary["sources"][0]["powers"][0]["equal"][family]
    return [row for row in rows if row["strategy"] == strategy]


@pytest.mark.slow
def test_the_fixation_point_differs_from_itself_by_nothing(summary):
    for family in (PAPER, FIXED):
        for row in equal(summary, family, BASE):
            assert row["what_error_difference"] in (0.0, None)
    assert [row["what_error_difference"] for row in equal(summary, FIXED, BASE)] == [0.0] * len(TAPS)


def test_all_strategies_begin_alike(summary):
    """They share starts and first taps, so after one tap they err alike; and passive ones stay."""
    curves = summary["sources"][0]["powers"][0]["curves"][FIXED]
    assert len({points[0]["what_error"] for points in curves.values()}) == 1
    assert all(point["way"] == 0 for point in curves["passive"])
    paths = summary["sources"][0]["paths"]
    assert len({tuple(row[0] for row in path) for path in paths.values()}) == 1
    assert all(len(set(row) - {-1}) == 1 for row in paths["passive"])


def test_random_moves_go_farther_than_those_to_the_fixation_point(summary):
    """At any number of taps, and surely after more than one move."""
    rows = equal(summary, FIXED, "random")
    assert all(row["way_difference"] > 0 for row in rows)
    assert all(row["way_difference_low"] > 0 for row in rows if row["taps"] > 2)


def test_a_number_of_taps_is_that_number(summary):
    for points in summary["sources"][0]["powers"][0]["curves"][FIXED].values():
        assert [point["taps"] for point in points] == list(range(1, SETTINGS.deadline + 1))
        assert all(point["given_up"] == 0 for point in points)


def test_intervals_of_stopping_rules_hold_for_all_of_them_together(monkeypatch, study):
    """As many comparisons as there are rules beside the paper's, at each number of taps."""
    asked = []

    def counting(*words):
        asked.append(words[-1])
        return differences(*words)

    monkeypatch.setattr(strategies_summary, "differences", counting)
    played = study.played[0]
    strategies_summary._rules(played)
    assert asked == [(len(played.families) - 1) * len(strategies_summary.TAPS)] * len(played.families)


def test_trust_is_read_after_the_same_taps(summary):
    """The gain over oneself is nothing, and what was promised beyond what was told is the difference of both."""
    for power in summary["sources"][0]["powers"]:
        for row in power["trust"]:
            assert row["excess"] == pytest.approx(row["expected"] - row["told"])
            if row["strategy"] == BASE:
                assert (row["gain"], row["excess_difference"], row["factor_ratio"]) == (0.0, 0.0, 1.0)
            elif row["strategy"] in ("info-what", "random"):
                own = power["curves"][FIXED][row["strategy"]][LOOK - 1]["wrong"]
                base = power["curves"][FIXED][BASE][LOOK - 1]["wrong"]
                assert row["gain"] == pytest.approx(base - own)


def test_other_roots_have_the_strategies_that_are_trusted_most(study):
    assert list(study.played[1].nats) == [name for name in FEW if name in TRUSTED]
    assert study.played[0].exponents == pytest.approx(1 / 50)
    assert study.played[1].exponents != study.played[0].exponents


def test_the_same_seed_gives_the_same_numbers_on_any_number_of_threads_and_elsewhere(bench):
    """And another seed gives others."""
    few = replace(SETTINGS, strategies=("random", BASE, "info-what"), trials=50)
    small = bench._replace(folds=2, powers=("J",))
    crews = on_threads(1), on_threads(2), on_runner(through_pickle)
    one, two, elsewhere, other = (
        summarise([strategy_study(small, one, no_progress, crew)], few, DESCRIBED)["sources"]
        for one, crew in (*((few, crew) for crew in crews), (replace(few, seed=9), crews[0]))
    )
    assert json.dumps(one) == json.dumps(two) == json.dumps(elsewhere)
    assert json.dumps(one) != json.dumps(other)


def test_strategies_see_training_taps_only(bench):
    """The pool has as many taps of every class, and is made of taps that trained the model."""
    unit = load(0)
    model = fit(unit.train, bench.grid)
    pool = pool_of(model, unit.train, 100)
    assert pool.given.shape == (8, 3, 24 * 4)
    whole = pool_of(model, unit.train, 10**6)
    assert whole.given.shape[-1] == len(unit.train)
    expected = tap_outcomes(model.log_likelihood(unit.train.taps))
    np.testing.assert_allclose(np.sort(whole.given, axis=-1), np.sort(expected.given, axis=-1))


def test_a_right_model_perceives_its_own_taps():
    """Taps are drawn from it, sessions are independent, and its belief is clamped."""
    bench = simulated_bench(RIGHT, 2, 3)
    unit = bench.load(0)
    assert (bench.border, bench.powers) == ("clamp", ("none",))
    assert unit.model("none", bench.grid, 0) is unit.right
    assert unit.right.power == "none"
    assert unit.train.taps.shape[1] == unit.right.preprocessing.samples
    assert not np.array_equal(unit.train.taps[:100], unit.test.taps[:100])


def test_ways_in_other_units_have_no_price(bench):
    """Where places are no millimetres, strategies per millimetre and second are left out."""
    counts = bench._replace(grid=replace(bench.grid, where_unit="encoder counts"))
    assert playable(counts, FEW, True) == tuple(name for name in FEW if name != "info-what-per-mm")
    assert playable(bench, FEW, True) == FEW
    assert playable(bench, FEW, False) == tuple(name for name in FEW if name in TRUSTED)


def test_the_page_shows_every_strategy_and_rule(summary):
    """Every finding stands there, and every table has null decisions."""
    page = html.render_page(strategies_page(summary))
    for name in (*FEW, "lookahead", "msprt", "what, at 6 taps give up"):
        assert f">{name}<" in page
    assert page.count("<table") == page.count("null decisions</th>")
    for sentence in (*summary["findings"], *summary["sources"][0]["findings"]):
        assert sentence.split(":")[0][:40] in page
    assert "Stored taps: test taps are drawn with replacement" in page
    assert STORED_ONLY in summary["rules"]


def test_tables_hold_the_numbers_of_the_summary(summary):
    """Curves by what a rule is set with, all else by the keys of the summary."""
    report, (source,) = StrategiesReport((), summary), summary["sources"]
    levels = {"theta": "theta", "taps": "number_of_taps", "cost": "cost"}
    for power in source["powers"]:
        at = {"source": source["name"], "power": power["power"]}
        for family in power["families"]:
            name, level = family["parameter"], levels[family["parameter"]]
            curves = report.curves[name].to_dataset()
            points = power["curves"][family["name"]]
            known = [point["level"] for point in points[BASE]]
            one = curves.sel({**at, "rule": family["name"], "strategy": list(points), level: known})
            for end in ("what_error", "what_error_high", "taps_low", "way", "factor"):
                expected = np.array([[point[end] for point in of] for of in points.values()], dtype=float)
                np.testing.assert_array_equal(one[end].transpose("strategy", level), expected)
        ends = ("what_error", "what_error_difference", "what_error_difference_least")
        equal_taps = report.equal_taps[list(ends)].sel(at)
        for rule, found in power["equal"].items():
            for row in found:
                one = equal_taps.sel(rule=rule, strategy=row["strategy"], taps=row["taps"])
                np.testing.assert_array_equal([one[end] for end in ends], np.array([row[end] for end in ends], float))
        for row in power["rules"]:
            one = report.rules.sel({**at, "rule": row["rule"], "taps": row["taps"]})
            np.testing.assert_array_equal(one["given_up"], np.array(row["given_up"], dtype=float))
        for row in power["trust"]:
            one = report.trust.sel({**at, "strategy": row["strategy"]})
            np.testing.assert_array_equal(one["factor_ratio_low"], np.array(row["factor_ratio_low"], dtype=float))
        for row in power["shown"]:
            one = report.at_threshold.sel({**at, "strategy": row["strategy"]})
            np.testing.assert_array_equal(one["way_difference_high"], np.array(row["way_difference_high"], dtype=float))
    assert report.at_threshold.attrs["theta"] == summary["theta"]
    assert report.equal_taps["what_error_difference_low"].attrs["units"] == source["what_unit"]
    assert report.trust["told_low"].attrs["units"] == "nats"
    assert report.regret is None


@pytest.mark.slow
def test_the_folder_holds_page_numbers_and_figures(summary, tmp_path):
    """All of them or nothing; with five presets, as by default, a page has less than 3 MB."""
    StrategiesReport((), summary).save(tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    drawn = ("curves-1", "equal-taps-1", "stopping-1", "trajectories-1", "trust")
    assert names == {*(f"{name}.svg" for name in drawn), "report.html", "strategies.json"}
    assert json.loads((tmp_path / "out" / "strategies.json").read_text()) == json.loads(json.dumps(summary))
    page = (tmp_path / "out" / "report.html").read_text()
    assert all(f'id="figure-{name}"' in page for name in drawn)
    assert 5 * len(page) < 3_000_000


def test_figures_show_every_strategy(summary):
    """A row for each but the fixation point, a panel for each trajectory, and all points of trust."""
    (source,) = summary["sources"]
    figure = figure_strategies.equal_taps(source)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == [name for name in FEW if name != BASE]
    assert len(figure.axes) == 2 * len(TAPS)
    shown = [axes for axes in figure_strategies.trajectories(source).axes if axes.get_visible()]
    assert [axes.get_title() for axes in shown] == list(FEW)
    known = [row for power in source["powers"] for row in power["trust"] if row["strategy"] == "info-what"]
    marks = [line for line in trust([source]).axes[2].get_lines() if line.get_marker() not in ("None", "")]
    assert len(marks) == len(known)


def test_interrupted_data_sets_do_not_go_on(bench, monkeypatch):
    """Those that are under way play no strategy to its end."""
    ended = []
    play = strategies_run.play
    monkeypatch.setattr(strategies_run, "play", lambda *a, **b: ended.append(play(*a, **b)) or ended[-1])
    after = []

    def progress(name, total):
        def advance(number):
            after.append(len(ended))
            raise KeyboardInterrupt

        return advance

    with pytest.raises(KeyboardInterrupt):
        strategy_study(bench, SETTINGS, progress, on_threads(2))
    assert len(after) == 1
    assert len(ended) <= after[0] + 2


def test_what_is_sure_is_told(summary):
    """Of strategies and numbers of taps, by the intervals that hold together."""
    source = json.loads(json.dumps(summary["sources"][0]))
    for row in source["powers"][0]["equal"][FIXED]:
        for end, value in (("", 1.0), ("_low", 0.7), ("_high", 1.3), ("_least", 0.5), ("_most", 1.5)):
            row[f"what_error_difference{end}"] = value if row["strategy"] == "random" else 0.0
    after = "the object error is significantly higher for random (2, 3, 5, 10 taps) than with the fixation point"
    assert after in source_findings(source)[2]
    assert findings([source])[0].startswith("No strategy has significantly lower object error")
    assert any(
        "random moves have significantly higher object error at 2, 3, 5 and 10 taps" in said
        for said in findings([source])
    )
    for row in source["powers"][0]["equal"][FIXED]:
        row["what_error_difference_least"] = -0.1
    assert "no strategy differs significantly from the fixation point in the object error" in source_findings(source)[2]
    assert any(
        "higher object error at 2, 3, 5 and 10 taps (by individual intervals only)" in said
        for said in findings([source])
    )
    for row in source["powers"][0]["equal"][FIXED]:
        row["what_error_difference_most"] = -0.1 if row["strategy"] in ("table", "info-what") else 0.1
    names = [name for name in ("info-what", "table") if name in source["strategies"]]
    assert findings([source])[0].startswith(" and ".join(f"{name} on {source['name']}" for name in names))


def test_intervals_end_where_quantities_do_and_are_left_out_where_all_units_are_alike(summary):
    """A share is none below 0; what has no spread is no certainty."""
    for source in summary["sources"]:
        for power in source["powers"]:
            points = [point for curves in power["curves"].values() for of in curves.values() for point in of]
            points += power["equal"][FIXED]
            for point in points:
                for name in ("what_error", "taps", "way", "wrong"):
                    low, high = (point.get(f"{name}{end}") for end in ("_low", "_high"))
                    assert (low is None) == (high is None)
                    if low is not None:
                        assert 0 <= low < high
                        assert name != "wrong" or high <= 1


def test_taps_and_way_at_the_shown_threshold_are_paired(summary):
    """The difference is that of the means; its interval is not that of two independent ones."""
    power = summary["sources"][0]["powers"][0]
    at = {
        name: next(point for point in points if point["level"] == summary["theta"])
        for name, points in power["curves"][PAPER].items()
    }
    for row in power["shown"]:
        for name in ("taps", "way"):
            expected = at[row["strategy"]][name] - at[BASE][name]
            assert row[f"{name}_difference"] == pytest.approx(expected, abs=1e-9)
    assert any(row["taps_difference_low"] is not None for row in power["shown"])


def test_data_that_allow_no_comparison_are_refused(make_taps, tmp_path):
    """A single place, a cell without a tap, one data set, no such preset."""
    make_taps(L=1, sessions=3).save(tmp_path / "one.nc")
    with pytest.raises(InputError, match=r"one\.nc has a single position or a single object"):
        recorded_bench(tmp_path / "one.nc")
    taps = make_taps(sessions=3)
    where, what = taps.indices(taps.grid())
    taps.select(~((where == 1) & (what == 2) & (taps.session == 2))).save(tmp_path / "hole.nc")
    with pytest.raises(InputError, match=r"hole\.nc has no test tap in 1 of 12 classes"):
        recorded_bench(tmp_path / "hole.nc")
    with pytest.raises(InputError, match="At least two data sets are required, got 1"):
        simulated_bench("paper", 1, 0)
    with pytest.raises(InputError, match=r"Unknown preset 'nowhere'; choose from .*model"):
        simulated_bench("nowhere", 3, 0)


@pytest.mark.slow
def test_recordings_are_compared_over_sessions_or_resampled_taps(make_taps, tmp_path, two_families):
    """Three sessions are left out in turn, and each pair of the others can teach a power; two are one fold."""
    for sessions in (2, 3):
        make_taps(sessions=sessions).save(tmp_path / f"{sessions}.nc")
    two, three = (recorded_bench(tmp_path / f"{sessions}.nc") for sessions in (2, 3))
    assert (two.folds, two.resamples, two.powers) == (1, RESAMPLES, ("J", "none"))
    assert (three.folds, three.resamples, three.powers) == (3, 0, ("J", "learned", "none"))
    few = replace(SETTINGS, strategies=("random", BASE))
    two = two._replace(powers=("J",))
    summary = summarise([strategy_study(two, few, no_progress)], few, DESCRIBED)
    assert equal(summary, FIXED, "random")[0]["way_low"] > 0


def test_sessions_left_out_in_turn_share_their_training(make_taps, tmp_path):
    """So they are further apart than data sets of their own would be; means are the same."""
    make_taps(sessions=3).save(tmp_path / "three.nc")
    bench = recorded_bench(tmp_path / "three.nc")._replace(powers=("J",))
    few = StrategySettings(trials=20, deadline=4, strategies=("passive", BASE))
    (left_out,), (apart,) = (
        strategy_study(bench._replace(simulated=simulated), few, no_progress).played for simulated in (False, True)
    )
    for name in ("means", "nats"):
        for key, units in getattr(apart, name).items():
            mean = units.mean(axis=0)
            np.testing.assert_allclose(getattr(left_out, name)[key], mean + np.sqrt(2.5) * (units - mean), atol=1e-9)


@pytest.mark.slow
def test_intervals_of_one_recording_hold_its_taps_and_not_only_trials(make_taps, tmp_path, two_families):
    """With four test taps of a class: 0.11 mm would be that of 400 trials."""
    make_taps(sessions=2, repeats=4).save(tmp_path / "two.nc")
    bench, passive = (
        recorded_bench(tmp_path / "two.nc")._replace(powers=("J",)),
        StrategySettings(trials=400, deadline=10, strategies=("passive", BASE)),
    )
    rows = equal(summarise([strategy_study(bench, passive, no_progress)], passive, DESCRIBED), FIXED, "passive")
    assert all(row["where_error_high"] - row["where_error"] > 0.17 for row in rows)


@pytest.mark.slow
def test_random_moves_err_more_than_the_fixation_point_on_paper():
    """At equal numbers of taps, as a baseline should."""
    settings = StrategySettings(trials=200, strategies=("passive", "random", BASE))
    bench = simulated_bench("paper", 10, 0)._replace(powers=("J",))
    rows = equal(summarise([strategy_study(bench, settings, no_progress)], settings, DESCRIBED), FIXED, "random")
    assert all(row["what_error_difference_low"] > 0 for row in rows if row["taps"] <= LOOK)


@pytest.mark.slow
def test_a_recorded_set_runs_through(shared_data, tmp_path):
    """All strategies but those that need millimetres."""
    settings = StrategySettings(trials=50)
    bench = recorded_bench(shared_data / "barrett_ballcyl.npz")
    summary = summarise([strategy_study(bench, settings, no_progress)], settings, DESCRIBED)
    assert "info-what-per-mm" not in summary["sources"][0]["strategies"]
    StrategiesReport((), summary).save(tmp_path / "out")
