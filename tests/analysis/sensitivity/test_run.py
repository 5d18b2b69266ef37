"""A whole sensitivity study on a small simulated rig and on recorded taps."""

import io
import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from solidtouch.analysis.experiment.sources import Source, recorded_source, simulated_source
from solidtouch.analysis.page.numbers import STORED_ONLY
from solidtouch.analysis.page.terminal import show
from solidtouch.analysis.sensitivity import figures as figure_sensitivity
from solidtouch.analysis.sensitivity import summary as sensitivity_summary
from solidtouch.analysis.sensitivity.choices import CHOICES, Choice, Option, Reading
from solidtouch.analysis.sensitivity.effects import SUMS
from solidtouch.analysis.sensitivity.findings import VERDICTS, findings, lists_of, worded
from solidtouch.analysis.sensitivity.page import sensitivity_page
from solidtouch.analysis.sensitivity.report import SensitivityReport
from solidtouch.analysis.sensitivity.run import SensitivitySettings, play_reading, sensitivity_study
from solidtouch.analysis.sensitivity.summary import blind_error, summarise
from solidtouch.analysis.stats.jackknife import Interval
from solidtouch.analysis.stats.resampled_units import RESAMPLES
from solidtouch.analysis.tasks.crew import on_runner, on_threads
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PAPER_RODS, preset
from solidtouch.inference.trials.records import tap_table
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.progress import no_progress
from solidtouch.models.splits import Fold
from task_runners import through_pickle

RIG = replace(preset("paper"), rods=PAPER_RODS[:3], start_mm=2.0, end_mm=10.0, spacing_mm=0.125)
SAME = Choice("no choice", "nothing.", "none", "as it is", (Option("the same", {}), Option("the same again", {})))
DESCRIBED = {"title": "A small study", "command": "solidtouch sensitivity"}


def load(number, highpass_hz):
    rig = replace(RIG, highpass_hz=highpass_hz)
    return Fold(*(simulate_session(rig, number, session) for session in (0, 1)), f"seed {number}")


@pytest.fixture(scope="module")
def source():
    """Five small simulated data sets of 8 x 3 classes."""
    return Source("small rig", True, 5, load, load(0, 0.1).train.grid(), 50, "Units are 5 data sets.")


def settings(*names, more=(), **changes):
    chosen = tuple(choice for choice in CHOICES if choice.name in names)
    return SensitivitySettings(**{"trials": 120, "seed": 2, "strongest": 3, "choices": (*more, *chosen)} | changes)


FEW = (
    "root of the likelihood",
    "pseudocount",
    "fixation point",
    "position error",
    "high-pass",
    "threshold that is read",
)


@pytest.fixture(scope="module")
def study(source):
    return sensitivity_study(source, settings(*FEW, more=(SAME,)), no_progress)


@pytest.fixture(scope="module")
def summary(study):
    return summarise([study], settings(*FEW), DESCRIBED)


def rows(summary):
    return {
        (choice["name"], option["name"]): option
        for choice in summary["sources"][0]["choices"]
        for option in choice["options"]
    }


def test_tables_hold_the_numbers_of_the_summary(summary):
    """Under names that say what is a difference; a second source of the same name is another."""
    report = SensitivityReport((), {**summary, "sources": [summary["sources"][0]] * 2})
    (source, _), ends = report.summary["sources"], ("", "_low", "_high", "_least", "_most")
    effects, defaults = report.effects, report.defaults
    assert effects["source"].values.tolist() == defaults["source"].values.tolist() == ["small rig", "small rig (2)"]

    for (choice, option), row in rows(summary).items():
        at = effects.sel(source="small rig (2)", choice=choice, option=option)
        assert at["verdict"].item() == row["verdict"]
        assert float(at["stopped"]) == row["stopped"]
        for end in ends:
            found = [
                *(at[f"{name}_difference{end}"] for name in ("what_error", "where_error", "taps")),
                *(at[f"factor_ratio{end}"], at[f"what_error_at_equal_taps_difference{end}"]),
                at[f"taps_advantage{end}"],
            ]
            names = *(f"active_{name}" for name in ("what_error", "where_error", "taps", "factor")), "equal_taps"
            values = [row[f"{name}{end}"] for name in (*names, "advantage_taps")]
            actual = [float(value.sel(policy="active") if "policy" in value.dims else value) for value in found]
            np.testing.assert_array_equal(actual, np.array(values, dtype=float))
    for row in source["default"]:
        at = defaults.sel(source="small rig", policy=row["policy"])
        np.testing.assert_array_equal([at[f"taps{end}"] for end in ends], [row[f"taps{end}"] for end in ends])
    gain = source["advantage"]["what_error"]
    assert float(defaults["what_error_advantage_low"].sel(source="small rig")) == gain["value_low"]
    for pair in source["pairs"]:
        first, second = (f"{one['choice']}: {one['option']}" for one in (pair["first"], pair["second"]))
        at = report.pairs.sel(source="small rig", first=first, second=second)
        assert (float(at["beyond_high"]), bool(at["sure"])) == (pair["beyond_high"], pair["sure"])
    assert effects["what_error_difference_low"].attrs["units"] == source["what_unit"]
    assert effects["taps_difference"].attrs["units"] == "taps"


def test_the_default_as_an_option_changes_exactly_nothing(study, summary):
    for (choice, _), found in zip(study.catalogue.options, study.effects, strict=True):
        if choice.name == "no choice":
            assert set(found.change.values()) == {Interval(0, 0, 0, 0, 0)}
    assert rows(summary)["no choice", "the same"]["verdict"] == "nothing"


def test_strong_options_are_found_and_named(summary):
    """Eq. 2 as printed ruins trials, the likelihood without a root ends them at once."""
    options = rows(summary)
    raw, none = options["pseudocount", "0"], options["root of the likelihood", "none"]
    assert raw["impossible_trials"] > 0.1
    assert raw["impossible_taps"] > 0.05
    assert raw["active_where_error_low"] > 0
    assert none["active_taps_high"] < 0
    assert all(option["impossible_trials"] == 0 for key, option in options.items() if key[1] != "0")


def test_impossible_taps_are_shares_of_all_data_sets(source, study):
    """Without a pseudocount, the mean over the data sets of the share of taps with a bin that no training tap has."""
    index = next(i for i, (choice, option) in enumerate(study.catalogue.options) if option.name == "0")
    shares = []
    for number in range(source.folds):
        unit = source.load(number, 0.1)
        model = fit(unit.train, source.grid, pseudocount=0.0)
        where, what = unit.test.indices(source.grid)
        own = model.log_likelihood(unit.test.taps)[np.arange(len(where)), where, what]
        shares.append(np.isneginf(own).mean())
    assert study.impossible[index] == pytest.approx(np.mean(shares))


@pytest.mark.parametrize(("taps", "more"), [(0.5, " with more taps"), (-0.5, "")])
def test_what_an_option_does_better_is_told_with_what_it_costs(taps, more):
    """Of the last policy at its own reaction time, where that is longer; not at equal taps, nor of other policies."""

    def by(value):
        return Interval(value, value - 0.1, value + 0.1, value - 0.3, value + 0.3)

    change = {(p, "what_error"): by(value) for p, value in (("passive", -1.0), ("active", -0.5))}
    change |= {("active", "where_error"): by(-0.2), ("active", "taps"): by(taps)}
    study = SimpleNamespace(scale=SimpleNamespace(policies=("passive", "active")))
    found = SimpleNamespace(change=change, equal_taps={"active": by(-0.4)})
    limit = {(p, q): 0.1 for p in ("passive", "active") for q in ("what_error", "where_error")}
    better = sensitivity_summary._better(study, found, limit)
    assert better["surely"] == [
        "passive object error",
        f"active object error{more}",
        "active object error at equal taps",
    ]
    assert better["perhaps"] == [f"active position error{more}"]


def test_definitions_of_the_position_error_change_nothing_else(study):
    """Objects, taps and beliefs are the same; the centre of a class is a quarter of its width from a tap on average."""
    for (choice, option), found in zip(study.catalogue.options, study.effects, strict=True):
        if choice.name == "position error":
            for policy in ("passive", "active"):
                for quantity in ("what_error", "taps", "factor"):
                    assert found.change[policy, quantity].value == pytest.approx(0, abs=1e-9)
            if option.name == "class centre to tap":
                assert 0.15 < found.change["active", "where_error"].value < 0.3
            else:
                assert found.change["passive", "where_error"].value == 0


def test_other_thresholds_move_along_the_same_curve(study):
    for (choice, _), found in zip(study.catalogue.options, study.effects, strict=True):
        if choice.name == "threshold that is read":
            assert found.equal_taps["active"].value == pytest.approx(0, abs=1e-12)


def test_choices_are_ranked_by_their_strongest_option(study, summary):
    """By the size of its change of the active object error; pairs are those of the three first."""
    ranked = summary["sources"][0]["choices"]
    strength = [max(abs(option["active_what_error"]) for option in choice["options"]) for choice in ranked]
    assert strength == sorted(strength, reverse=True)
    named = {pair[side]["choice"] for pair in summary["sources"][0]["pairs"] for side in ("first", "second")}
    assert named == {choice["name"] for choice in ranked[:3]}
    assert len(study.pairs) == 3


def test_a_pair_is_both_options_at_once(source, study):
    """Together they change what one option with the changes of both does, and beyond the sum is the rest."""
    pair = study.pairs[0]
    alone = [study.effects[study.catalogue.options.index(one)] for one in (pair.first, pair.second)]
    rest = sum(found.change["active", "what_error"].value for found in alone)
    assert pair.beyond.value == pytest.approx(pair.together.value - rest)
    merged = Choice("both", "x.", "none", "d", (Option("both", {**pair.first[1].changes, **pair.second[1].changes}),))
    again = sensitivity_study(source, settings(choices=(merged,)), no_progress)
    assert pair.together.value == again.effects[0].change["active", "what_error"].value


def test_the_same_seed_gives_the_same_numbers_on_any_number_of_threads_and_elsewhere(source):
    """And another seed gives others."""
    source = source._replace(folds=2)
    quick = settings("pseudocount", "drawing of test taps", strongest=2, trials=60)
    one, two = (
        summarise([sensitivity_study(source, quick, no_progress, on_threads(workers))], quick, DESCRIBED)
        for workers in (1, 2)
    )
    assert json.dumps(one) == json.dumps(two)
    elsewhere = sensitivity_study(source, quick, no_progress, on_runner(through_pickle))
    assert json.dumps(summarise([elsewhere], quick, DESCRIBED)) == json.dumps(one)
    other = sensitivity_study(source, replace(quick, seed=3), no_progress)
    assert summarise([other], quick, DESCRIBED)["sources"] != one["sources"]


def test_trials_at_the_deadline_can_be_left_out(source):
    """Means are then over those that crossed the threshold."""
    fold = load(0, 0.1)
    table = tap_table(fit(fold.train, source.grid), fold.test)
    base = Reading(deadline=3)
    kept = play_reading(base, table, fold.test, source.grid, 1.0, 200, 0)
    left = play_reading(replace(base, at_deadline="left out"), table, fold.test, source.grid, 1.0, 200, 0)
    stopped = kept[..., SUMS.index("stopped")] == 1
    assert 0 < stopped.mean() < 1
    np.testing.assert_array_equal(left[..., :6], kept[..., :6] * stopped[..., np.newaxis])
    np.testing.assert_array_equal(left[..., 0], stopped)


def test_starts_in_turn_visit_every_class_alike(source):
    """With as many trials as classes each starts once, so passive position errors are those of every class."""
    fold = load(0, 0.1)
    table = tap_table(fit(fold.train, source.grid), fold.test)
    log_likelihood = np.full_like(table.log_likelihood, -50.0)
    log_likelihood[:, 0, 0] = 0.0
    table = table._replace(log_likelihood=log_likelihood)
    sums = play_reading(Reading(start="in turn"), table, fold.test, source.grid, 1.0, 24, 0)
    distance = source.grid.where_error(np.arange(8), 0)
    np.testing.assert_allclose(np.sort(sums[:, 0, SUMS.index("where_error")]), np.repeat(np.sort(distance), 3))


def test_the_page_shows_every_option_and_its_verdict(summary, tmp_path):
    """The folder holds the page, the numbers and the figures; the page names what was not run."""
    source = summary["sources"][0]
    skipped = [{"choice": "trials at the deadline", "option": "left out", "reason": "why not"}]
    summary = {**summary, "sources": [{**source, "skipped": skipped}]}
    SensitivityReport((), summary).save(tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    for choice, option in rows(summary):
        assert choice in page
        assert option in page
    for sentence in (*summary["sources"][0]["findings"], *summary["rules"]):
        assert sentence.split(":")[0][:40] in page
    assert "Stored taps: test taps are drawn with replacement" in page
    assert STORED_ONLY in summary["rules"]
    for options in summary["sources"][0]["lists"]:
        assert options["title"] in page
        assert all(item in page for item in options["items"])
    heads = re.findall(r'<th scope="col">([^<]*)</th>', page)
    assert {"object error (mm)", "position error (mm)", "passive − active: position error (mm)"} <= set(heads)
    assert not {"object error", "position error"} & set(heads)
    assert "at the deadline, left out: why not" in page
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        *(f"{name}-1.svg" for name in ("forest", "pairs")),
        "report.html",
        "sensitivity.json",
    }
    assert json.loads((tmp_path / "out" / "sensitivity.json").read_text()) == json.loads(json.dumps(summary))


def test_the_forest_has_a_row_for_every_option(summary):
    """And one for the name of every choice; what is beyond an axis is cut there."""
    source = summary["sources"][0]
    figure = figure_sensitivity.forest(source)
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert len(labels) == len(rows(summary)) + len(source["choices"])
    assert len(figure.axes) == 4
    for axes in figure.axes:
        low, high = axes.get_xlim()
        for line in axes.get_lines():
            x = np.asarray(line.get_xdata(), dtype=float)
            assert ((x >= low) & (x <= high)).all()


def test_one_huge_pair_leaves_the_colours_of_others_apart(summary):
    """Colours are logarithmic beyond the change that does not matter."""
    source = summary["sources"][0]
    huge, small = ({**pair, "beyond": value} for pair, value in zip(source["pairs"], (80.0, 0.5), strict=False))
    figure = figure_sensitivity.interactions({**source, "pairs": [huge, small]})
    (image,) = figure.axes[0].get_images()
    zero, low, high = (float(image.norm(value)) for value in (0.0, 0.5, 80.0))
    assert zero == pytest.approx(0.5)
    assert high == 1
    assert low - zero > 0.1


def test_without_pairs_there_is_no_picture_of_them(summary):
    assert figure_sensitivity.interactions({**summary["sources"][0], "pairs": []}) is None


def test_verdicts_are_counted_in_the_first_finding(summary):
    said = summary["sources"][0]["findings"][0]
    verdicts = [option["verdict"] for option in rows(summary).values()]
    assert set(verdicts) <= set(VERDICTS)
    assert f"{verdicts.count('nothing')} change nothing" in said


def test_the_conclusion_is_told_where_there_is_one(summary):
    source = summary["sources"][0]
    assert any("ctive perception" in sentence for sentence in findings(source))
    assert not any("ctive perception" in sentence for sentence in findings(source | {"policies": ["passive"]}))


def test_an_advantage_that_is_no_longer_sure_is_told(summary):
    """Though the conclusion stays where it is not surely smaller."""
    source = json.loads(json.dumps(summary["sources"][0]))
    source["advantage"] = {"taps": {"value_least": 1.0}}
    options = [option for choice in source["choices"] for option in choice["options"]]
    for option in options:
        option |= {"advantage_taps_least": 0.5, "verdict": "numbers"}
    assert "unsure" not in [one["key"] for one in lists_of(source)]
    options[0]["advantage_taps_least"] = -0.5
    unsure = next(one["items"] for one in lists_of(source) if one["key"] == "unsure")
    assert unsure == [f"{source['choices'][0]['name']}, {options[0]['name']}: taps"]
    options[0]["verdict"] = "conclusion"
    assert "unsure" not in [one["key"] for one in lists_of(source)]


def test_few_units_decide_nothing(source):
    """Four of them: no verdict, no "surely", and a sentence that says so, on the page and in the terminal too."""
    source = source._replace(folds=4)
    quick = settings("root of the likelihood", "fixation point", trials=60, strongest=2)
    summary = summarise([sensitivity_study(source, quick, no_progress)], quick, DESCRIBED)
    assert {option["verdict"] for option in rows(summary).values()} == {"not decided"}
    assert not any(option["better"]["surely"] for option in rows(summary).values())
    assert not any(pair["sure"] for pair in summary["sources"][0]["pairs"])
    assert summary["sources"][0]["number_of_units"] == 4
    (said,) = (said for said in summary["sources"][0]["findings"] if "With 4 units no verdict is possible" in said)
    assert said in in_terminal(summary)


def in_terminal(summary):
    console = Console(width=400, record=True, file=io.StringIO())
    show(sensitivity_page(summary), console)
    return console.export_text()


def test_the_verdict_is_beside_the_options_that_have_it(summary):
    """In the terminal and on the page; the number beside it is of the strongest option, whose name is there too."""
    shown = in_terminal(summary)
    for choice in summary["sources"][0]["choices"]:
        own = [option["name"] for option in choice["options"] if option["verdict"] == choice["verdict"]]
        every = 1 < len(own) == len(choice["options"])
        assert set(re.split(r", | and ", choice["verdict_of"])) == ({"all"} if every else set(own))
        assert f"{VERDICTS[choice['verdict']]} ({choice['verdict_of']})" in shown


def test_an_option_that_is_no_better_than_no_tap_is_told(summary, source):
    """Always naming the middle one of three rods, 2 mm apart, errs by 4/3 mm."""
    assert blind_error(source.grid) == pytest.approx(4 / 3)
    one = json.loads(json.dumps(summary["sources"][0]))
    raw = next(option for key, option in rows({"sources": [one]}).items() if key == ("pseudocount", "0"))
    for row in one["default"]:
        raw[f"{row['policy']}_what_error"] = 1.5 - row["what_error"]
    assert any(
        "Under pseudocount, 0, objects are perceived no better than without touch:" in said for said in findings(one)
    )
    raw["active_what_error"] -= 0.2
    assert not any("Under pseudocount, 0, objects" in said for said in findings(one))


def test_surely_says_what_it_is_limited_to(summary):
    """Where resamples of one recording are the units."""
    source = {**summary["sources"][0], "scope": "for taps of these sessions"}
    title = next(one["title"] for one in lists_of(source) if one["key"] == "surely")
    assert "significantly (for taps of these sessions) lower errors" in title


def test_words_can_be_made_anew_from_the_numbers(summary):
    bare = {**summary, "rules": [], "sources": [{**one, "findings": [], "lists": []} for one in summary["sources"]]}
    assert worded(json.loads(json.dumps(bare))) == json.loads(json.dumps(summary))


def test_a_recording_of_one_split_has_resamples_of_taps_as_units(tmp_path, make_taps):
    """Two sessions give one fold, three are left out in turn."""
    make_taps(sessions=2).save(tmp_path / "two.nc")
    make_taps(sessions=3).save(tmp_path / "three.nc")
    two, three = (recorded_source(tmp_path / f"{name}.nc") for name in ("two", "three"))
    assert (two.folds, two.resamples, two.scope) == (1, RESAMPLES, "for taps of these sessions")
    assert three.scope == ""
    assert (two.number_of_units, three.number_of_units) == (RESAMPLES, 3)
    assert (three.folds, three.resamples) == (3, 0)
    assert "40 resamples of the test taps within class and session" in two.units
    assert "Too few test taps, about 7 per class" in two.units
    study = sensitivity_study(two, settings("pseudocount", "high-pass", trials=100), no_progress)
    assert np.isfinite(study.default["active", "taps"].low)
    assert [choice.name for choice in study.catalogue.choices] == ["pseudocount"]


def test_sessions_left_out_in_turn_share_their_training(tmp_path, make_taps):
    """So they are further apart than data sets of their own would be; means are the same."""
    make_taps(sessions=3).save(tmp_path / "three.nc")
    source, few = recorded_source(tmp_path / "three.nc"), settings("pseudocount", trials=60)
    left_out, apart = (
        sensitivity_study(source._replace(simulated=simulated), few, no_progress).default["active", "taps"]
        for simulated in (False, True)
    )
    assert left_out.value == pytest.approx(apart.value)
    assert left_out.high - left_out.value == pytest.approx(np.sqrt(2.5) * (apart.high - apart.value))


@pytest.mark.slow
def test_intervals_of_one_recording_hold_its_taps_and_not_only_trials(tmp_path, make_taps):
    """With four test taps of a class many trials leave them wide: 0.04 mm would be that of 3200 trials."""
    make_taps(sessions=2, repeats=4).save(tmp_path / "two.nc")
    study = sensitivity_study(recorded_source(tmp_path / "two.nc"), settings("deadline", trials=3200), no_progress)
    error = study.default["active", "where_error"]
    assert error.high - error.value > 0.12


@pytest.mark.slow
def test_one_position_is_passive_only(tmp_path, make_taps):
    """There is no active perception, and no conclusion to lose."""
    make_taps(L=1, sessions=3).save(tmp_path / "taps.nc")
    only = settings(trials=60, choices=CHOICES, strongest=2)
    source = recorded_source(tmp_path / "taps.nc")
    summary = summarise([sensitivity_study(source, only, no_progress)], only, DESCRIBED)
    assert summary["sources"][0]["policies"] == ["passive"]
    assert summary["sources"][0]["advantage"] == {}
    assert all(choice["verdict"] != "conclusion" for choice in summary["sources"][0]["choices"])
    SensitivityReport((), summary).save(tmp_path / "out")


def test_faultless_decisions_are_named(tmp_path, make_taps):
    """Where nothing is wrong under the defaults, intervals of no width are no evidence."""
    make_taps(sessions=3, M=2).save(tmp_path / "taps.nc")
    few = settings("pseudocount", trials=60, strongest=0)
    summary = summarise([sensitivity_study(recorded_source(tmp_path / "taps.nc"), few, no_progress)], few, DESCRIBED)
    if summary["sources"][0]["default"][-1]["what_error"] == 0:
        assert any("do not apply to other data" in said for said in summary["sources"][0]["findings"])
    else:
        assert not any("do not apply to other data" in said for said in summary["sources"][0]["findings"])


def test_a_preset_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="Unknown preset 'nowhere'"):
        simulated_source("nowhere", 3, 0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["barrett_boxes.npz", "icub_grasp.npz"])
def test_recorded_sets_run_through(shared_data, name, tmp_path):
    """Every option that makes sense there ends in a verdict."""
    quick = SensitivitySettings(trials=100, strongest=2)
    summary = summarise([sensitivity_study(recorded_source(shared_data / name), quick, no_progress)], quick, DESCRIBED)
    assert all(option["verdict"] in VERDICTS for option in rows(summary).values())
    SensitivityReport((), summary).save(tmp_path / "out")
