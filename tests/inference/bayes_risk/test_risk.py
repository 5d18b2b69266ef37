"""The exact rule against a recursion written down, against every strategy there is, and in its limits."""

import itertools

import numpy as np
import pytest
from sampled_costs import sampled_costs
from solidtouch.inference import reference
from solidtouch.inference.bayes_risk.bounds import alpha_cost_bound, known_place_bound, qmdp
from solidtouch.inference.bayes_risk.exact_cost import Acts, course, expected_cost
from solidtouch.inference.bayes_risk.problem import merged, risk_problem
from solidtouch.inference.bayes_risk.risk import exact_rule, solved
from solidtouch.inference.moves.control import fixation, passive, random_place, random_step
from solidtouch.inference.moves.expected_gain import gain_watch, risk_mover
from solidtouch.inference.stopping import stopping
from solidtouch.models.errors import InputError

L, M, S = 3, 2, 4


def problem_of(rng, taps=4, tap_cost=0.02, class_cost=0.004, **more):
    """A random one; the channel tells places and objects apart, and objects at one place better than elsewhere."""
    channel = rng.dirichlet(np.full(S, 0.7), size=(L, M))
    loss = more.pop("loss", 1 - np.eye(M))
    return risk_problem(channel, loss, tap_cost=tap_cost, class_cost=class_cost, most_taps=taps, **more)


def brute_force(problem, belief, taps_left):
    """Least further cost, by trying everything from here on."""
    L = len(belief)
    stop = min(sum(row[m] * belief[:, m].sum() for m in range(belief.shape[1])) for row in problem.loss)
    if taps_left == 0:
        return stop
    ways = []
    for delta in range(-L, L + 1):
        steps = sum(belief[l].sum() * abs(min(max(l + delta, 0), L - 1) - l) for l in range(L))
        moved = reference.shift(belief, delta, "clamp")
        ways.append(problem.class_cost * steps + brute_tap(problem, moved, taps_left))
    return min(stop, *ways)


def brute_tap(problem, belief, taps_left):
    """The same before a tap."""
    cost = problem.tap_cost
    for symbol in range(problem.channel.shape[2]):
        joint = belief * problem.channel[:, :, symbol]
        if joint.sum() > 0:
            cost += joint.sum() * brute_force(problem, joint / joint.sum(), taps_left - 1)
    return cost


@pytest.mark.parametrize("taps", [1, 2, 3])
def test_the_exact_rule_costs_what_trying_everything_finds(rng, taps):
    """With an uneven prior, impossible symbols, and losses that are not alike."""
    problem = problem_of(rng, taps, loss=[[0.0, 2.0], [1.0, 0.0]], prior=rng.dirichlet(np.ones(L * M)).reshape(L, M))
    channel = problem.channel.copy()
    channel[0, :, 1] = channel[2, 1, 3] = 0
    problem = problem._replace(channel=channel / channel.sum(axis=-1, keepdims=True))

    assert exact_rule(problem).value == pytest.approx(brute_tap(problem, problem.prior, taps), abs=1e-12)


@pytest.mark.parametrize("taps", [1, 2, 3])
def test_symbols_that_never_come_change_nothing(rng, taps):
    """Neither one that no class gives nor one of a class that cannot be."""
    prior = np.array([[0.3, 0.2], [0.5, 0.0], [0.0, 0.0]])
    problem = problem_of(rng, taps, prior=prior)
    wider = np.concatenate([problem.channel, np.zeros((L, M, 2))], axis=2)
    wider[1, 1] = np.eye(wider.shape[2])[-1]
    wide = problem._replace(channel=wider)

    assert exact_rule(wide).value == pytest.approx(brute_tap(wide, prior, taps), abs=1e-12)
    assert expected_cost(wide, exact_rule(wide)).total == pytest.approx(exact_rule(wide).value, abs=1e-12)
    for depth in range(1, taps + 1):
        assert known_place_bound(wide, depth) <= exact_rule(wide).value + 1e-12
        assert alpha_cost_bound(wide, qmdp(wide), depth) <= exact_rule(wide).value + 1e-12


def test_other_sizes_are_solved_alike(rng):
    """One place, and four objects."""
    for shape in ((1, 3, 3), (2, 4, 2)):
        channel = rng.dirichlet(np.ones(shape[2]), size=shape[:2])
        problem = risk_problem(channel, 1 - np.eye(shape[1]), tap_cost=0.03, class_cost=0.01, most_taps=3)
        assert exact_rule(problem).value == pytest.approx(brute_tap(problem, problem.prior, 3), abs=1e-12)


@pytest.mark.parametrize("taps", [1, 2, 5])
def test_the_rule_costs_what_it_says_when_it_is_played(rng, taps):
    problem = problem_of(rng, taps)
    rule = exact_rule(problem)

    assert expected_cost(problem, rule).total == pytest.approx(rule.value, abs=1e-12)


def test_the_rule_in_drawn_trials_costs_what_it_says(rng):
    """Within five standard errors."""
    problem = problem_of(rng, 5)
    rule = exact_rule(problem)
    costs = sampled_costs(problem, rule, 20000, rng)

    assert abs(costs.mean() - rule.value) < 5 * costs.std() / np.sqrt(len(costs))


def test_no_strategy_with_any_rule_beats_it(rng):
    """Also not at random, and not by looking ahead; all are exact."""
    for _ in range(2):
        problem = problem_of(rng, 4, tap_cost=rng.uniform(0.002, 0.05), class_cost=rng.uniform(0, 0.02))
        best = exact_rule(problem).value
        policies = {
            "passive": (passive(), 1),
            **{f"fixation {l}": (fixation(l), 1) for l in range(L)},
            "random place": (random_place(), L),
            "random step": (random_step(1), 3),
            "risk": (risk_mover(problem.outcomes, problem.loss, step_cost=problem.class_cost, border="clamp"), 1),
        }
        rules = [
            *(stopping.what_above(theta) for theta in (0.6, 0.8, 0.9, 0.99)),
            *(stopping.after(n) for n in (1, 2, 4)),
            stopping.both_above(0.8, 0.6),
            stopping.lookahead(problem.tap_cost),
        ]
        watch = gain_watch(problem.outcomes, problem.loss, step_cost=problem.class_cost, border="clamp")
        for (policy, chances), rule in itertools.product(policies.values(), rules):
            assert expected_cost(problem, course(policy, rule, watch), chances).total >= best - 1e-12


def test_no_table_of_moves_and_stops_beats_it_on_the_smallest_problem(rng):
    """All deterministic strategies of two taps: for each symbol stop or one of five moves."""
    problem = problem_of(rng, 2)
    best = exact_rule(problem).value
    first = np.array([problem.prior * problem.channel[:, :, s] for s in range(S)])
    first /= first.sum(axis=(1, 2), keepdims=True)

    def act(table):
        def play(number, beliefs, chance):
            symbol = np.abs(beliefs[:, np.newaxis] - first).sum(axis=(2, 3)).argmin(axis=1)
            chosen = np.array([table[s] for s in symbol])
            return Acts(chosen - 2, np.where(chosen > 4, stopping.DECIDE, stopping.GO_ON))

        return play

    costs = [expected_cost(problem, act(table)).total for table in itertools.product(range(6), repeat=S)]
    assert min(costs) == pytest.approx(best, abs=1e-12)


def test_taps_that_tell_nothing_are_not_worth_their_cost(rng):
    """The first one is made, and then the prior decides."""
    channel = np.broadcast_to(rng.dirichlet(np.ones(S)), (L, M, S))
    problem = risk_problem(channel, 1 - np.eye(M), tap_cost=0.1, class_cost=0.0, most_taps=5)

    assert exact_rule(problem).value == pytest.approx(0.1 + 0.5)


def test_taps_that_cost_nothing_are_all_made_if_they_tell_something(rng):
    """Then more taps are never worse, and cost only errors."""
    values = [
        exact_rule(problem_of(np.random.default_rng(3), taps, tap_cost=0, class_cost=0)).value for taps in (1, 2, 3, 4)
    ]
    played = expected_cost(
        problem_of(np.random.default_rng(3), 4, 0, 0), exact_rule(problem_of(np.random.default_rng(3), 4, 0, 0))
    )

    assert (np.diff(values) < 0).all()
    assert played.loss == pytest.approx(values[-1])


def test_dearer_taps_and_ways_never_cost_less_and_are_used_less(rng):
    found = [
        expected_cost(problem, exact_rule(problem))
        for problem in (problem_of(np.random.default_rng(5), 4, tap_cost=cost) for cost in (0.001, 0.01, 0.05, 0.2))
    ]
    assert (np.diff([cost.total for cost in found]) > 0).all()
    assert (np.diff([cost.taps for cost in found]) <= 0).all()
    ways = [
        expected_cost(problem, exact_rule(problem))
        for problem in (problem_of(np.random.default_rng(5), 4, class_cost=cost) for cost in (0.0, 0.01, 0.1, 10.0))
    ]
    assert (np.diff([cost.steps for cost in ways]) <= 0).all()
    assert ways[0].steps > 0
    assert ways[-1].steps == pytest.approx(0, abs=1e-12)


def test_where_errors_cost_more_than_giving_up_it_gives_up(rng):
    """Which is never dearer than to be without that way out."""
    loss = np.vstack([5 * (1 - np.eye(M)), [0.4, 0.4]])
    with_, without = (
        problem_of(np.random.default_rng(8), 4, loss=loss),
        problem_of(np.random.default_rng(8), 4, loss=loss[:M]),
    )
    played = expected_cost(with_, exact_rule(with_))

    assert played.total == pytest.approx(exact_rule(with_).value, abs=1e-12)
    assert played.total < exact_rule(without).value - 0.01
    assert 0 < played.gave_up < 1


@pytest.mark.slow
def test_the_size_that_is_asked_for_is_solved(rng):
    """L = 3, M = 2, four symbols, six taps; and what it costs is what it says."""
    problem = problem_of(rng, 6)
    rule = exact_rule(problem)

    assert len(rule.belief) == 5
    assert expected_cost(problem, rule).total == pytest.approx(rule.value, abs=1e-12)
    assert rule.value < exact_rule(problem._replace(most_taps=5)).value


def test_equal_beliefs_are_merged_and_no_others(rng):
    beliefs = rng.dirichlet(np.ones(6), size=50).reshape(50, 3, 2)
    order = rng.integers(50, size=400)
    distinct, index = merged(beliefs[order] * (1 + 1e-16))

    assert len(distinct) == len(np.unique(order))
    np.testing.assert_allclose(distinct[index], beliefs[order], rtol=0, atol=1e-12)


def test_beliefs_that_share_a_hash_stay_apart(rng, monkeypatch):
    """With factors of zero all of them do."""

    class Zeros:
        def integers(self, *_, size):
            return np.full(size, -0.5)

    monkeypatch.setattr(np.random, "default_rng", lambda _: Zeros())
    beliefs = rng.dirichlet(np.ones(6), size=20).reshape(20, 3, 2)

    assert len(merged(beliefs)[0]) == 20


def test_the_rule_knows_no_belief_that_cannot_be_reached(rng):
    with pytest.raises(InputError, match="cannot be reached after 1 taps"):
        exact_rule(problem_of(rng))(1, np.full((1, L, M), 1 / 6), np.zeros(1))
    with pytest.raises(InputError, match="depth must be at least 1, got 0"):
        solved(problem_of(rng), 0, lambda beliefs: beliefs.sum(axis=(-1, -2)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channel": np.ones((L, M, S))}, "sum to 1 over the last"),
        ({"channel": np.ones((L, S)) / S}, "axes .where, what, symbol."),
        ({"loss": np.ones((M + 2, M))}, "with giving up, got 4"),
        ({"prior": np.ones((L, M))}, r"prior must have shape \(3, 2\)"),
        ({"tap_cost": -1}, "Costs must be at least 0"),
        ({"class_cost": np.inf}, "Costs must be at least 0"),
        ({"most_taps": 0}, "most_taps at least 1"),
    ],
)
def test_what_makes_no_sense_is_refused(change, message):
    arguments = {
        "channel": np.full((L, M, S), 1 / S),
        "loss": 1 - np.eye(M),
        "tap_cost": 1,
        "class_cost": 0,
        "most_taps": 3,
    }
    with pytest.raises(InputError, match=message):
        risk_problem(**arguments | change)
