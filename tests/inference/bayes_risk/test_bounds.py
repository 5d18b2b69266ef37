"""Lower bounds lie below what the exact rule costs, in the order they should, and on it where nothing is lost."""

import numpy as np
import pytest
from solidtouch.inference.bayes_risk.bounds import (
    alpha_bound,
    alpha_cost_bound,
    corners,
    fast_informed,
    known_place,
    known_place_bound,
    qmdp,
    simplex,
)
from solidtouch.inference.bayes_risk.problem import risk_problem, stop_loss
from solidtouch.inference.bayes_risk.risk import exact_rule
from solidtouch.models.errors import InputError

L, M, S, T = 3, 2, 4, 4


def problem_of(rng, taps=T, L=L, M=M, S=S, **costs):
    channel = rng.dirichlet(np.full(S, 0.6), size=(L, M))
    arguments = {"tap_cost": 0.02, "class_cost": 0.01} | costs
    return risk_problem(channel, rng.uniform(0.5, 2, (M, M)) * (1 - np.eye(M)), most_taps=taps, **arguments)


@pytest.mark.parametrize("seed", range(4))
def test_bounds_lie_below_the_exact_cost_and_deeper_ones_are_closer(seed):
    """At the last tap nothing is told that is not known, so the bound is the cost."""
    problem = problem_of(np.random.default_rng(seed), M=2 + seed % 2)
    exact = exact_rule(problem).value
    place = [known_place_bound(problem, depth, 12) for depth in range(1, T + 1)]
    alpha = [alpha_cost_bound(problem, qmdp(problem), depth) for depth in range(1, T + 1)]

    for bounds in (place, alpha):
        assert (np.diff(bounds) >= -1e-12).all()
        assert max(bounds) <= exact + 1e-12
    assert place[-1] == pytest.approx(exact, abs=1e-12)
    assert place[0] > alpha[0]


def test_bounds_hold_at_every_belief_and_not_only_at_the_first(rng):
    """Further costs that the exact rule knows, after each number of taps."""
    problem = problem_of(rng)
    rule, alphas = exact_rule(problem), qmdp(problem)
    for taps, (belief, choice) in enumerate(zip(rule.belief, rule.choice, strict=True), 1):
        assert (known_place(problem, taps, 9)(belief) <= choice.value + 1e-12).all()
        assert (alpha_bound(alphas, belief) <= choice.value + 1e-12).all()


def test_the_fast_informed_bound_is_that_of_qmdp(rng):
    """It is never below it; and as moves are certain and objects stay, never above."""
    for sizes in ((3, 2, 4), (5, 3, 6)):
        problem = problem_of(rng, 6, *sizes)
        np.testing.assert_allclose(fast_informed(problem), qmdp(problem), rtol=1e-12)


def test_qmdp_costs_one_tap_or_the_decision(rng):
    """The class known after it, nothing further is paid."""
    problem, beliefs = problem_of(rng), rng.dirichlet(np.full(L * M, 0.2), size=30).reshape(30, L, M)
    expected = np.minimum(stop_loss(problem, beliefs), problem.tap_cost)

    np.testing.assert_allclose(alpha_bound(qmdp(problem), beliefs), expected, rtol=1e-12)


def test_with_one_place_the_bound_is_the_cost_but_for_the_grid(rng):
    """And comes closer as the grid gets finer."""
    problem = problem_of(rng, 5, L=1, M=3)
    exact = exact_rule(problem).value
    gaps = [exact - known_place_bound(problem, 1, parts) for parts in (3, 12, 48, 192)]

    assert (np.diff(gaps) < 0).all()
    assert 0 <= gaps[-1] < 1e-3 * exact


def test_taps_that_give_away_the_class_leave_no_gap(rng):
    channel = np.eye(L * M).reshape(L, M, L * M)
    problem = risk_problem(channel, 1 - np.eye(M), tap_cost=0.1, class_cost=0.01, most_taps=3)

    assert exact_rule(problem).value == pytest.approx(0.1)
    assert known_place_bound(problem, 1, 5) == pytest.approx(0.1)
    assert alpha_cost_bound(problem, qmdp(problem)) == pytest.approx(0.1)


def test_taps_that_tell_nothing_leave_no_gap_but_to_qmdp():
    """Which still hopes to know everything after the next tap."""
    problem = risk_problem(np.ones((L, M, 1)), 1 - np.eye(M), tap_cost=0.1, class_cost=0.01, most_taps=3)

    assert exact_rule(problem).value == pytest.approx(0.6)
    assert known_place_bound(problem, 1, 4) == pytest.approx(0.6)
    assert alpha_cost_bound(problem, qmdp(problem)) == pytest.approx(0.2)


@pytest.mark.parametrize("M", [2, 3, 5])
def test_weights_of_the_grid_mix_its_points_to_what_was_asked_for(rng, M):
    """They are no less than zero and sum to one, also at the points and at the corners."""
    grid = simplex(M, 7)
    p = np.concatenate([rng.dirichlet(np.ones(M), size=200), np.eye(M), grid.point])
    point, weight = corners(grid, p)

    np.testing.assert_allclose((weight[..., np.newaxis] * grid.point[point]).sum(axis=1), p, rtol=0, atol=1e-12)
    assert (weight >= -1e-12).all()
    np.testing.assert_allclose(weight.sum(axis=1), 1, rtol=1e-12)
    assert len(grid.point) == len(np.unique(grid.point, axis=0))


def test_interpolation_lies_below_a_concave_function(rng):
    """The least of some linear ones, which is what costs are."""
    grid, linear = simplex(3, 6), rng.random((8, 3))
    p = rng.dirichlet(np.ones(3), size=500)
    point, weight = corners(grid, p)
    below = (weight * (grid.point @ linear.T).min(axis=1)[point]).sum(axis=1)

    gap = (p @ linear.T).min(axis=1) - below
    assert (gap >= -1e-12).all()
    assert gap.max() > 1e-3


def test_what_makes_no_sense_is_refused(rng):
    with pytest.raises(InputError, match="must be 1 to 4, got 5"):
        known_place(problem_of(rng), 5, 9)
    with pytest.raises(InputError, match="at least 1 part and 2 objects, got 0 and 2"):
        known_place(problem_of(rng), 1, 0)
    with pytest.raises(InputError, match="at least 1 part and 2 objects, got 5 and 1"):
        simplex(1, 5)
