"""Costs of strategies by enumeration against trees written down, drawn trials and trials in step."""

import numpy as np
import pytest
from sampled_costs import sampled_costs
from solidtouch.inference import reference
from solidtouch.inference.bayes_risk.exact_cost import Acts, Cost, course, expected_cost, expected_costs
from solidtouch.inference.bayes_risk.problem import risk_problem
from solidtouch.inference.moves.control import fixation, passive, random_place, random_step
from solidtouch.inference.moves.expected_gain import gain_watch
from solidtouch.inference.stopping import stopping
from solidtouch.inference.stopping.recorded import stops
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.records import plan_trials
from solidtouch.inference.trials.symbols import quantised
from solidtouch.models.errors import InputError

L, M, S = 3, 2, 3


def problem_of(rng, taps=4, **more):
    channel = rng.dirichlet(np.full(S, 0.7), size=(L, M))
    arguments = {"loss": [[0.0, 3.0], [2.0, 0.0]], "tap_cost": 0.05, "class_cost": 0.02} | more
    return risk_problem(channel, arguments.pop("loss"), most_taps=taps, **arguments)


def tree(problem, policy, threshold, belief, number, chances):
    """Expected further cost of a policy with a threshold, symbol by symbol and chance by chance."""
    what = belief.sum(axis=0)
    if number == problem.most_taps or (number and what.max() > threshold):
        return min(row @ what for row in problem.loss)
    cost = 0.0
    for chance in chances if number else chances[:1]:
        share = 1 / len(chances) if number else 1.0
        delta = int(policy(belief, np.float64(chance))) if number else 0
        moved = reference.shift(belief, delta, "clamp")
        cost += share * (
            problem.tap_cost
            + problem.class_cost * sum(belief[l].sum() * abs(min(max(l + delta, 0), L - 1) - l) for l in range(L))
        )
        for symbol in range(S):
            joint = moved * problem.channel[:, :, symbol]
            rest = tree(problem, policy, threshold, joint / joint.sum(), number + 1, chances)
            cost += share * joint.sum() * rest
    return cost


@pytest.mark.parametrize(
    ("policy", "chances"),
    [(passive(), 1), (fixation(1), 1), (fixation(2, 0.6), 1), (random_place(), L), (random_step(1), 3)],
)
@pytest.mark.parametrize("threshold", [0.7, 1.0])
def test_cost_is_that_of_a_tree(rng, policy, chances, threshold):
    problem = problem_of(rng)
    middles = (np.arange(chances) + 0.5) / chances
    expected = tree(problem, policy, threshold, problem.prior, 0, middles)
    cost = expected_cost(problem, course(policy, stopping.what_above(threshold)), chances)

    assert cost.total == pytest.approx(expected, abs=1e-12)
    assert cost.total == pytest.approx(cost.loss + 0.05 * cost.taps + 0.02 * cost.steps, abs=1e-12)


def test_a_fixed_number_of_taps_without_moves_costs_these_and_the_errors(rng):
    cost = expected_cost(problem_of(rng), course(passive(), stopping.after(3)))

    assert cost[2:] == pytest.approx((3, 0, 0))


@pytest.mark.parametrize(("policy", "chances"), [(fixation(1), 1), (random_place(), L)])
def test_costs_of_several_rules_are_those_of_each_alone(rng, policy, chances):
    problem = problem_of(rng, loss=[[0.0, 3.0], [2.0, 0.0], [0.3, 0.3]])
    watch = gain_watch(problem.outcomes, problem.loss, border="clamp")
    rules = [
        stopping.what_above(0.6),
        stopping.what_above(0.95),
        stopping.after(3),
        stopping.lookahead(0.05),
        stopping.or_give_up(stopping.what_above(0.9), 2, 0.7),
    ]
    expected = [expected_cost(problem, course(policy, rule, watch), chances) for rule in rules]

    np.testing.assert_allclose(expected_costs(problem, policy, rules, watch, chances), expected, rtol=1e-12, atol=1e-12)
    assert len({cost.total for cost in expected}) == len(rules)


def test_cost_with_drawn_trials_agrees(rng):
    """Within five standard errors, also at random and with giving up."""
    problem = problem_of(rng, loss=[[0.0, 3.0], [2.0, 0.0], [0.3, 0.3]])
    rule = stopping.or_give_up(stopping.what_above(0.9), 3, 0.7)
    for policy, chances in ((fixation(1), 1), (random_place(), L)):
        act = course(policy, rule)
        exact, costs = expected_cost(problem, act, chances), sampled_costs(problem, act, 20000, rng)
        assert 0 < exact.gave_up < 1
        assert abs(costs.mean() - exact.total) < 5 * costs.std() / np.sqrt(len(costs))


def test_trials_in_step_on_the_taps_behind_the_symbols_cost_the_same(make_model):
    """What `lockstep` records of real draws, priced afterwards, has the exact cost as its mean."""
    model = make_model(L, M, 1, 1, 5, taps=40, power="none", pseudocount=1.0)
    symbols = quantised(model, S, 0, 500)
    problem = risk_problem(symbols.channel, 1 - np.eye(M), tap_cost=0.02, class_cost=0.01, most_taps=5)
    watch = gain_watch(problem.outcomes, problem.loss, step_cost=problem.class_cost, border="clamp")
    plan = plan_trials(symbols.table.pool, 20000, 0)
    for policy, chances, rule in (
        (fixation(1), 1, stopping.what_above(0.8)),
        (random_place(), L, stopping.lookahead(problem.tap_cost)),
    ):
        record = play(symbols.table, plan, policy, border="clamp", deadline=5, watch=watch)
        found, rows = stops(rule, record), np.arange(20000)
        last = rows, found.taps - 1
        costs = (record.what[last] != record.held) + 0.02 * found.taps + 0.01 * record.travelled[last]
        exact = expected_cost(problem, course(policy, rule, watch), chances)
        assert abs(costs.mean() - exact.total) < 5 * costs.std() / np.sqrt(len(costs))
        assert abs(found.taps.mean() - exact.taps) < 5 * found.taps.std() / np.sqrt(len(costs)) + 1e-9


def test_giving_up_needs_a_loss(rng):
    def give_up(number, beliefs, chance):
        return Acts(np.zeros(len(beliefs), np.int64), np.full(len(beliefs), stopping.GIVE_UP))

    with pytest.raises(InputError, match="gives up, but the loss has no row"):
        expected_cost(problem_of(rng), give_up)
    cost = expected_cost(problem_of(rng, loss=[[0.0, 3.0], [2.0, 0.0], [0.25, 0.75]]), give_up)
    assert cost == pytest.approx(Cost(0.05 + 0.5, 0.5, 1, 0, 1))


def test_a_random_number_has_a_part(rng):
    with pytest.raises(InputError, match="chances must be at least 1, got 0"):
        expected_cost(problem_of(rng), course(passive(), stopping.after(1)), 0)
