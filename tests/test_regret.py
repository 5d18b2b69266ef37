"""The study of regrets runs, and its costs are those that were paid."""

import importlib
from pathlib import Path

import numpy as np
import pytest
from solidtouch.inference.bayes_risk import exact_rule
from solidtouch.inference.exact_cost import course, expected_cost
from solidtouch.inference.risk_bounds import known_place_bound
from solidtouch.inference.stopping import after, what_above

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(scope="module")
def study():
    """The module of the study, with fewer taps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        module = importlib.import_module("regret")
        patch.setattr(module, "DRAWN", 200)
        patch.setattr(module, "THETAS", (0.7, 0.9))
        yield module


@pytest.fixture(scope="module")
def tiny(study):
    """Three places, two rods, four symbols, four taps."""
    return study.world(study.Case("5mm", range(3), (1, 3), 1, 4, 4))


def test_costs_of_drawn_trials_agree_with_exact_ones(study, tiny):
    """Within five standard errors, of every policy."""
    problem = study.problem_of(tiny, 0.05)
    assert problem.class_cost == pytest.approx(5 * study.WAY_COST)
    for name, (policy, chances) in study.policies(tiny, problem).items():
        record = study.play(
            tiny.symbols.table, study.plan_trials(tiny.symbols.table.pool, 3000, 1), policy, border="clamp", deadline=4
        )
        for rule in (after(3), what_above(0.8)):
            each = study.trial_costs(problem, record, rule)
            exact = expected_cost(problem, course(policy, rule), chances).total
            assert abs(each.mean() - exact) < 5 * each.std() / np.sqrt(3000), name


def test_tables_say_what_each_policy_costs_above_the_least(study, tiny):
    problem = study.problem_of(tiny, 0.05)
    least = exact_rule(problem).value
    prices = study.exact_prices(tiny, problem)
    page = study.price_table(prices, least)

    assert min(price.cost for price in prices) >= least - 1e-12
    assert len(page.splitlines()) == 2 + len(study.policies(tiny, problem))
    assert f"{min(price.cost for price in prices) - least:.3f}" in page
    assert page.count("**") >= 2
    assert "The exact rule costs" in study.small_page(tiny, 0.05)


def test_the_larger_case_is_held_against_its_bound(study, tiny):
    """Here as small as the other; at each cost of taps there is a price of each policy with each kind of rule."""
    prices = study.drawn_prices(tiny, 200, "passive")
    page = study.large_page(tiny, 0.02, prices[0], 200)

    assert f"No strategy costs less than {known_place_bound(study.problem_of(tiny, 0.02), 2, 60):.4f} mm" in page
    assert "100 trials each" in page
    assert [len(of) for of in prices] == [len(study.RULES)] * len(study.TAP_COSTS)
    assert all(cheap.cost < dear.cost for cheap, dear in zip(*prices, strict=True))
