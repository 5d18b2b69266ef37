"""Regrets: what is paid is what is counted, nobody is cheaper than the exact rule or a bound, and pages say so."""

import json

import numpy as np
import pytest
from solidtouch.analysis.page import html
from solidtouch.analysis.strategies import regret, regret_cases
from solidtouch.analysis.strategies.figures_regret import regret as regret_figure
from solidtouch.analysis.strategies.figures_regret import shown
from solidtouch.analysis.strategies.page import strategies_page
from solidtouch.analysis.strategies.regret import (
    RegretSettings,
    drawn_regrets,
    exact_regrets,
    regret_study,
    trial_costs,
)
from solidtouch.analysis.strategies.regret_cases import (
    KINDS,
    LARGE,
    SMALL,
    TAP_COSTS,
    WAY_COST,
    ProblemSize,
    policies,
    policy_of,
    problem_of,
    watch_of,
    world,
)
from solidtouch.analysis.strategies.regret_summary import summarise_regret
from solidtouch.analysis.strategies.report import StrategiesReport
from solidtouch.analysis.strategies.run import BASE, STRATEGIES, StrategySettings
from solidtouch.analysis.strategies.summary import summarise
from solidtouch.analysis.tasks.crew import on_runner, on_threads
from solidtouch.inference.bayes_risk.exact_cost import course, expected_cost
from solidtouch.inference.bayes_risk.risk import exact_rule
from solidtouch.inference.stopping.stopping import after, lookahead, what_above
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.records import plan_trials
from solidtouch.models.errors import InputError
from solidtouch.models.progress import no_progress
from task_runners import through_pickle

TINY = ProblemSize("5mm", range(3), (1, 3), 1, 4, 4)
SETTINGS = RegretSettings(40, 1)


@pytest.fixture(scope="module", autouse=True)
def few():
    """Fewer taps and thresholds, and cases of four taps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regret_cases, "DRAWN", 200)
        patch.setattr(regret_cases, "THETAS", (0.7, 0.9))
        patch.setattr(regret, "SMALL", (TINY,))
        patch.setattr(regret, "LARGE", TINY._replace(exact=False))
        patch.setattr(regret, "_AT_ONCE", 15)
        patch.setattr(regret, "_GRID_STEPS", 10)
        yield


@pytest.fixture(scope="module")
def tiny(few):
    """Three places, two rods, four symbols, four taps."""
    return world(TINY)


@pytest.fixture(scope="module")
def told():
    """How much progress there was to be, and what was made of it, below zero."""
    return []


@pytest.fixture(scope="module")
def study(few, told):
    def progress(stage, total):
        told.append((stage, total))
        return lambda done: told.append((stage, -done))

    return regret_study(SETTINGS, progress, on_threads(1))


@pytest.fixture(scope="module")
def summary(study):
    return summarise_regret(study, SETTINGS)


def test_costs_of_drawn_trials_agree_with_exact_ones(tiny):
    """Within five standard errors, of every policy."""
    problem = problem_of(tiny, 0.05)
    assert problem.class_cost == pytest.approx(5 * WAY_COST)
    table = tiny.symbols.table
    for name in policies(tiny):
        policy, chances = policy_of(name, tiny, problem)
        plan = plan_trials(table.pool, 3000, 1)
        record = play(table, plan, policy, border="clamp", deadline=4, watch=watch_of(problem))
        for rule in (after(3), what_above(0.8), lookahead(0.05)):
            each = trial_costs(problem, record, rule)
            exact = expected_cost(problem, course(policy, rule, watch_of(problem)), chances).total
            assert abs(each.mean() - exact) < 5 * each.std() / np.sqrt(3000), name


def test_finer_parts_of_the_chance_change_no_exact_cost(tiny):
    """Each policy does the same throughout each part of its random number."""
    problem = problem_of(tiny, 0.05)
    for name in policies(tiny):
        policy, chances = policy_of(name, tiny, problem)
        one, two = (expected_cost(problem, course(policy, after(3)), chances * finer).total for finer in (1, 2))
        assert one == pytest.approx(two, abs=1e-12), name


def test_every_strategy_of_the_comparison_is_priced(tiny):
    """And a fixation point at every place, and the mover that minds the costs."""
    names = policies(tiny)
    assert set(STRATEGIES) - {BASE} < set(names)
    assert [name for name in names if name.startswith(f"{BASE} at")] == [
        f"{BASE} at {place} mm" for place in (2.5, 7.5, 12.5)
    ]
    assert names[-1] == "risk"


@pytest.mark.parametrize("tap_cost", [0.001, 0.02, 0.1, 1.0])
def test_nobody_is_cheaper_than_the_exact_rule(tiny, tap_cost):
    """Whatever a tap costs; and of each kind of rule there is one price."""
    (found,) = exact_regrets([tiny], [tap_cost], on_threads(1), no_progress("", 0))
    assert found.least == exact_rule(found.problem).value
    assert found.best.total == pytest.approx(found.least)
    assert min(price.cost for price in found.prices) >= found.least - 1e-12
    assert [(price.policy, price.kind) for price in found.prices] == [
        (name, kind) for name in policies(tiny) for kind in KINDS
    ]


def test_nobody_is_cheaper_than_the_bounds(tiny):
    """Which are below the exact rule themselves; trials priced are the half that did not choose."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regret, "_AT_ONCE", 1000)
        cheap, dear = drawn_regrets(tiny, RegretSettings(3000), on_threads(1), no_progress("", 0))
    for found in (cheap, dear):
        assert found.least == max(found.bounds.values())
        assert found.least <= exact_rule(found.problem).value + 1e-12
        for price in found.prices:
            assert price.each.shape == (1500,)
            assert price.cost > found.least - 5 * price.each.std() / np.sqrt(1500)
    assert all(one.cost < other.cost for one, other in zip(cheap.prices, dear.prices, strict=True))


def test_prices_are_the_same_in_pieces_and_on_threads(study):
    """Pieces of 15 trials on one thread, or all of them on two."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regret, "_AT_ONCE", 1000)
        other = regret_study(SETTINGS, no_progress, on_threads(2))
        elsewhere = regret_study(SETTINGS, no_progress, on_runner(through_pickle))
    assert [one.bounds for one in elsewhere] == [two.bounds for two in other]
    for one, two in zip(elsewhere, other, strict=True):
        assert [price.each.tolist() for price in one.prices] == [price.each.tolist() for price in two.prices]
    for one, two in zip(study, other, strict=True):
        assert one.bounds == two.bounds
        for first, second in zip(one.prices, two.prices, strict=True):
            assert first[:3] == second[:3]
            np.testing.assert_allclose(first.each, second.each, rtol=1e-9)


def test_the_seed_changes_trials_and_no_case(study):
    other = regret_study(RegretSettings(40, 2), no_progress, on_threads(1))
    assert [one.bounds for one in study] == [one.bounds for one in other]
    assert [price.cost for price in study[0].prices] == [price.cost for price in other[0].prices]
    assert [price.cost for price in study[-1].prices] != [price.cost for price in other[-1].prices]


def test_progress_counts_to_its_end(study, told):
    assert {stage for stage, _ in told} == {"regret"}
    assert sum(number for _, number in told) == 0


def test_too_few_trials_are_refused():
    with pytest.raises(InputError, match="4 trials or more, got 3"):
        regret_study(RegretSettings(3), no_progress)


def test_the_summary_holds_what_was_paid(study, summary):
    """In every case; what is as cheap as the cheapest is bold; exact costs have no interval."""
    assert [case["tap_cost"] for case in summary["cases"]] == [*TAP_COSTS, *TAP_COSTS]
    assert [case["exact"] for case in summary["cases"]] == [True, True, False, False]
    for case, found in zip(summary["cases"], study, strict=True):
        assert [row["cost"] for row in case["prices"]] == [price.cost for price in found.prices]
        best = [row for row in case["prices"] if row["best"]]
        assert found.cheapest.policy in {row["strategy"] for row in best}
        assert all(abs(row["more"]) < 5e-5 for row in best)
        for row in case["prices"]:
            assert row["regret"] == pytest.approx(row["cost"] - found.least, abs=1e-8)
            shown = row["shown"].split()[0].replace("−", "-")
            last_digit = 10.0 ** -len(shown.partition(".")[2])
            assert float(shown) == pytest.approx(row["regret"], abs=0.5001 * last_digit)
            assert (row["regret_low"] is None) == case["exact"]
            if not case["exact"]:
                assert row["regret_low"] <= row["regret"] <= row["regret_high"]
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_sentences_say_what_the_least_is(study, summary):
    exact, bounded = summary["cases"][0], summary["cases"][-1]
    assert f"The exact rule costs {study[0].least:.4f} mm" in exact["said"]
    assert f"No strategy costs less than {study[-1].least:.4f} mm" in bounded["said"]
    assert "3 positions 5 mm apart, rods of 6, 10 mm, 1 sample per tap" in exact["described"]
    assert bounded["caption"].endswith("20 trials each")
    assert len(summary["findings"]) == 2
    near, gap = summary["findings"]
    assert "info-what" in near
    assert "passive" not in near
    assert gap.count("mm per tap") == len(TAP_COSTS)


def test_the_page_shows_every_price(summary):
    """A table for each case and cost of taps, the best bold; data of no kind leave no other section."""
    whole = summarise([], StrategySettings(), {"title": "Regret", "command": ""}, summary)
    page = html.render_page(strategies_page(whole))
    assert page.count("<table") == len(summary["cases"])
    best = sum(row["best"] for case in summary["cases"] for row in case["prices"])
    assert page.count("<strong>") == best + 1  # the first finding
    assert "#regret-section" in page
    assert "#trust-section" not in page
    assert whole["findings"] == summary["findings"]
    table = StrategiesReport((), whole).regret
    assert table is not None
    for case in summary["cases"]:
        for row in case["prices"]:
            at = table.sel(case=f"{case['name']}, {'exact' if case['exact'] else 'bound'}", tap_cost=case["tap_cost"])
            one = at.sel(strategy=row["strategy"], kind=row["kind"])
            assert (float(one["regret"]), one["rule"].item()) == (row["regret"], row["rule"])
            assert bool(one["best"]) == row["best"]
    without = html.render_page(strategies_page({**whole, "regret": None}))
    assert "regret-section" not in without


def test_the_figure_has_a_panel_for_each_case(summary):
    """A mark for each kind and strategy; of fixation points the best and the worst."""
    figure = regret_figure(summary)
    assert len(figure.axes) == len(summary["cases"])
    case = summary["cases"][0]
    names = [name for name in shown(case) if name.startswith("fixation,")]
    assert names == ["fixation, best position", "fixation, worst position"]
    best, worst = (shown(case)[name][0]["regret"] for name in names)
    assert best < worst
    marks = [line for line in figure.axes[0].get_lines() if line.get_marker() not in ("None", "")]
    assert len(marks) == len(KINDS) * len(shown(case))


@pytest.mark.slow
def test_the_cases_themselves_are_worth_looking_at():
    """Symbols keep most of what taps tell, errors occur, and nobody beats the exact rule there either."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regret_cases, "DRAWN", 2000)
        for case in (*SMALL, LARGE):
            found = world(case)
            assert found.symbols.kept > 0.8
            if case.exact:
                (regrets,) = exact_regrets([found], TAP_COSTS[:1], on_threads(1), no_progress("", 0))
                assert 0.1 < regrets.best.loss < 0.5
                assert regrets.cheapest.cost >= regrets.least - 1e-12
