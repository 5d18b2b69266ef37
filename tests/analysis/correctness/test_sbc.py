"""Beliefs that are exact pass, beliefs that are not fail, in every route from prior to decision."""

from dataclasses import replace
from io import StringIO
from itertools import pairwise, product

import numpy as np
import pytest
from rich.console import Console
from scipy.stats import binom
from slow_cases import slow_but
from solidtouch.analysis.correctness.page import calibration_page
from solidtouch.analysis.correctness.sbc import ARRAYS, POLICIES, ROUTES, Calibration, CalibrationRow, calibrate
from solidtouch.analysis.correctness.sbc_arrays import array_beliefs
from solidtouch.analysis.correctness.sbc_chain import ACTIVE, PASSIVE, Checkpoints, World, engine_beliefs
from solidtouch.analysis.experiment.sources import right_model
from solidtouch.analysis.page.terminal import show
from solidtouch.analysis.stats.uniformity import (
    Factor,
    count_p,
    equal_doubt,
    error_factor,
    judge,
    p_values,
    poisson_binomial,
    rejected,
)
from solidtouch.inference.moves.control import default_fixation
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import HistogramModel

from benchmarks.studies.beliefs import chain

MOMENTS = Checkpoints(taps=(1, 2, 4), thetas=(0.8,), deadline=30)


@pytest.fixture(scope="module")
def small(make_model) -> HistogramModel:
    """A model of 5 x 3 classes whose taps leave some doubt."""
    return make_model(L=5, M=3, K=3, J=2, B=6, taps=8, power="none", pseudocount=0.5)


def drawn(rng: np.random.Generator, n: int = 4000, C: int = 7, spread: float = 0.6):
    """Beliefs, and true classes that are drawn from them."""
    belief = rng.dirichlet(np.full(C, spread), size=n)
    true = (rng.random(n)[:, None] > belief.cumsum(axis=1)).sum(axis=1)
    return belief, np.minimum(true, C - 1)


def sharpened(belief, power):
    raised = belief**power
    return raised / raised.sum(axis=1, keepdims=True)


def test_the_truth_drawn_from_the_beliefs_passes_every_test(rng):
    found = p_values(judge(*drawn(rng), rng))

    assert set(found) == {"rank", "credible set", "decisions", "decisions by belief"}
    assert min(found.values()) > 1e-4


def test_every_test_holds_its_level_when_the_truth_is_drawn_from_the_beliefs(rng):
    """Over 150 repetitions with 40 trials each; a binomial bound with one chance in a thousand."""
    found = [p_values(judge(*drawn(rng, n=40), rng)) for _ in range(150)]

    for name in found[0]:
        assert sum(one[name] <= 0.1 for one in found) <= binom.isf(1e-3, 150, 0.1), name


@pytest.mark.parametrize("power", [0.7, 1.4])
def test_beliefs_too_sure_or_too_cautious_fail(rng, power):
    belief, true = drawn(rng)
    found = p_values(judge(sharpened(belief, power), true, rng))

    for name in ("credible set", "decisions", "decisions by belief"):
        assert found[name] < 1e-6, name


def test_a_wrong_decision_that_is_held_for_certain_fails(rng):
    """One in a hundred trials is enough."""
    belief = np.tile([1.0, 0.0], (100, 1))
    true = np.zeros(100, dtype=int)
    assert p_values(judge(belief, true, rng))["decisions"] == 1
    true[17] = 1
    assert p_values(judge(belief, true, rng))["decisions"] < 1e-12


def test_ranks_are_the_sums_that_they_are_said_to_be(rng):
    """By brute force, ties by number of the class; the share of the own belief lies between 0 and 1."""
    belief = rng.integers(0, 4, size=(50, 6)) + np.eye(6)[rng.integers(6, size=50)]
    belief /= belief.sum(axis=1, keepdims=True)
    true = rng.integers(6, size=50)
    found = judge(belief, true, np.random.default_rng(1))
    shares = np.random.default_rng(1).random((2, 50))

    for i in range(50):
        own = belief[i, true[i]]
        before = sum(belief[i, : true[i]])
        order = sorted(range(6), key=lambda c, i=i: (-belief[i, c], c))
        surer = sum(belief[i, c] for c in order[: order.index(true[i])])
        assert found.rank[i] == pytest.approx(before + shares[0, i] * own)
        assert found.credible[i] == pytest.approx(surer + shares[1, i] * own)
        assert found.belief[i] == max(belief[i])
        assert found.right[i] == (order[0] == true[i])


def test_credible_sets_and_decisions_do_not_depend_on_the_order_of_classes(rng):
    belief, true = drawn(rng, n=200)
    order = rng.permutation(7)
    one, other = (
        judge(belief, true, np.random.default_rng(3)),
        judge(belief[:, order], np.argsort(order)[true], np.random.default_rng(3)),
    )

    np.testing.assert_allclose(one.credible, other.credible, atol=1e-12)
    np.testing.assert_array_equal(one.right, other.right)
    assert not np.allclose(one.rank, other.rank)


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_the_number_of_errors_has_the_distribution_of_all_outcomes(rng, n):
    p = rng.random(n)
    expected = np.zeros(n + 1)
    for outcome in product((0, 1), repeat=n):
        expected[sum(outcome)] += np.prod(np.where(outcome, p, 1 - p))

    np.testing.assert_allclose(poisson_binomial(p), expected, atol=1e-14)


def test_alike_probabilities_give_the_binomial_distribution():
    np.testing.assert_allclose(
        poisson_binomial(np.full(777, 0.03)), binom.pmf(np.arange(778), 777, 0.03), rtol=0, atol=1e-14
    )


def test_a_p_value_is_below_a_level_no_more_often_than_that(rng):
    """Exactly, over all counts."""
    mass = poisson_binomial(rng.random(30) * 0.3)
    p = np.array([count_p(count, mass) for count in range(31)])

    for level in np.unique(p):
        assert mass[p <= level].sum() <= level + 1e-12


def test_groups_hold_every_trial_once_and_expect_alike_many_errors(rng):
    doubt = rng.random(1000) ** 3
    groups = equal_doubt(doubt, 5)

    assert sorted(np.concatenate(groups)) == list(range(1000))
    expected = [doubt[group].sum() for group in groups]
    np.testing.assert_allclose(expected, doubt.sum() / 5, atol=1)
    ends = [(doubt[group].min(), doubt[group].max()) for group in groups]
    assert all(one[1] <= other[0] for one, other in pairwise(ends))


def test_the_factor_is_wrong_decisions_over_those_announced(rng):
    belief, true = drawn(rng)
    found = judge(belief, true, rng)
    factor = error_factor(found)

    assert factor.value == pytest.approx((~found.right).mean() / (1 - found.belief).mean())
    assert factor.low < factor.value < factor.high


def test_holm_rejects_from_the_smallest_p_on_until_one_is_large_enough():
    p = [0.04, 0.002, 0.012, 0.6]
    assert rejected(p, 0.05).tolist() == [False, True, True, False]
    assert rejected(p, 0.005).tolist() == [False, False, False, False]
    assert rejected([0.001] * 3, 0.01).all()


def test_moments_are_reached_in_time():
    """A number of taps when it is made, a threshold when it is exceeded, and the last when the deadline comes."""
    moments = Checkpoints(taps=(1, 3), thetas=(0.6, 0.9), deadline=5)
    belief = np.array([[[0.1, 0.5], [0.2, 0.2]]])  # 0.7 for the second object

    assert moments.names == ["1 tap", "3 taps", "theta 0.6", "theta 0.9"]
    assert moments.reached(1, belief).tolist() == [[True, False, True, False]]
    assert moments.reached(4, belief).tolist() == [[True, True, True, False]]
    assert moments.reached(5, belief).all()


def play(route: str, world: World, policy: str, n: int):
    rng = np.random.default_rng(5)
    if route == ARRAYS:
        return array_beliefs(world, policy, n, MOMENTS, rng)
    return engine_beliefs(route, world, policy, n, MOMENTS, rng)


@pytest.mark.parametrize("route", ["numpy", "filter", ARRAYS])
def test_fingers_move_as_beliefs_say_and_stop_at_the_ends(small, route):
    """The place at the second tap follows from that at the first and the belief there."""
    found = play(route, World(small, small, "clamp"), ACTIVE, 60)
    believed = found.belief[:, 0].sum(axis=2).argmax(axis=1)
    aimed = found.where[:, 0] + default_fixation(5) - believed

    assert (found.where[:, 1] == np.clip(aimed, 0, 4)).all()
    assert ((aimed < 0) | (aimed > 4)).any()
    still = play(route, World(small, small, "clamp"), PASSIVE, 20)
    assert (still.where == still.where[:, :1]).all()


@pytest.mark.parametrize("route", ["numpy", ARRAYS])
def test_beliefs_are_those_at_their_moments(small, route):
    """Normalised; at a threshold above it, and not above it at any moment before."""
    found = play(route, World(small, small, "clamp"), ACTIVE, 60)
    sure = found.belief.sum(axis=2).max(axis=2)

    np.testing.assert_allclose(found.belief.sum(axis=(2, 3)), 1, atol=1e-9)
    assert (found.taps[:, :3] == [1, 2, 4]).all()
    stopped = found.taps[:, 3] < MOMENTS.deadline
    assert stopped.any()
    assert (sure[stopped, 3] > 0.8).all()
    for w in range(3):
        assert not (sure[:, w] > 0.8)[found.taps[:, w] < found.taps[:, 3]].any()


SIZES = {"numpy": 150, "numpyro": 80, "filter": 150, ARRAYS: 1500, "cpu": 1500, "xla-cpu": 500}


@pytest.mark.parametrize("route", slow_but(("filter", "cpu"), ROUTES))
def test_every_route_is_calibrated_where_all_is_right(small, route):
    """Passive and active; there are errors enough that it might not be."""
    told: list[int] = []
    moments = MOMENTS._replace(taps=(2,)) if route == "xla-cpu" else MOMENTS  # it compiles for every number of taps
    result = calibrate(small, {route: SIZES[route]}, moments=moments, seed=2, progress=told.append)

    assert result.passed, result.failed
    assert sum(told) == 2 * SIZES[route]
    assert {row.policy for row in result.rows} == set(POLICIES)
    assert {row.moment for row in result.rows} == set(moments.names)
    first = [row.factor for row in result.rows if row.quantity == "what" and row.moment == moments.names[0]]
    assert all(factor.high - factor.low < 1 for factor in first)


@pytest.mark.parametrize("route", slow_but(("numpy", ARRAYS), ("numpy", "filter", ARRAYS, "cpu", "numpyro")))
def test_the_root_of_the_likelihood_is_found_in_a_hundred_trials(small, route):
    """Power J where the world has none: decisions are right more often than believed."""
    result = calibrate(small, {route: 120}, believed=replace(small, power="J"), moments=MOMENTS)

    assert not result.passed
    row, _ = min(result.failed, key=lambda pair: pair[0].p[pair[1]])
    assert row.factor.high < 1


@pytest.mark.slow
def test_the_border_uniform_is_found(small):
    """In active episodes only: passive ones make no move."""
    result = calibrate(small, {ARRAYS: 4000}, border="uniform", moments=MOMENTS)

    assert {row.policy for row, _ in result.failed} == {ACTIVE}
    assert {row.moment for row, _ in result.failed}.isdisjoint({"1 tap"})


def test_the_same_seed_gives_the_same_result(small):
    one, other, third = (calibrate(small, {ARRAYS: 50}, moments=MOMENTS, seed=seed) for seed in (1, 1, 2))

    assert [row.p for row in one.rows] == [row.p for row in other.rows]
    assert [row.p for row in one.rows] != [row.p for row in third.rows]


@pytest.mark.parametrize(
    ("trials", "more", "message"),
    [
        ({"funsor": 10}, {}, "got funsor"),
        ({}, {}, "got none"),
        ({ARRAYS: 0}, {}, "needs a trial"),
        ({ARRAYS: 5}, {"level": 1.0}, "level between 0 and 1"),
    ],
)
def test_wrong_requests_are_refused(small, trials, more, message):
    with pytest.raises(InputError, match=message):
        calibrate(small, trials, **more)


def test_untrained_classes_are_refused(make_model):
    with pytest.raises(InputError, match="not trained"):
        calibrate(make_model(power="none", untrained=[(0, 1)]), {ARRAYS: 1})


def result_of(*p: float) -> Calibration:
    factor = Factor(1.0, 0.9, 1.1)
    return Calibration(
        tuple(CalibrationRow("numpy", PASSIVE, f"{i} taps", "what", 9, {"rank": x}, factor) for i, x in enumerate(p)),
        0.01,
    )


@pytest.mark.parametrize(
    ("p", "verdict"), [((0.2, 0.04), "are calibrated: 0 of 2"), ((0.2, 1e-15), "are NOT calibrated")]
)
def test_the_verdict_is_printed(p, verdict):
    out = StringIO()
    show(calibration_page(result_of(*p)), Console(file=out, width=140))

    assert verdict in out.getvalue()
    assert ("1 taps: rank of what, p < 1e-12" in out.getvalue()) == (min(p) < 1e-12)
    assert result_of(*p).least == min(1, 2 * min(p))


def test_the_right_model_has_the_samples_asked_for_and_no_root():
    model = right_model(3, samples=2)
    assert model.preprocessing.samples == 2
    assert model.exponent == 1


def test_an_exchanged_peak_changes_two_bins_at_the_fixation_point(small):
    """And nothing else; exchanging costs information, by the divergence over all samples of a tap."""
    wrong = chain.exchanged(small, 1, 2)
    where = np.argwhere(wrong.counts != small.counts)
    l = default_fixation(5)

    assert len(where) == 2
    assert (where[:, :3] == [l, 1, 2]).all()
    assert abs(where[0, 3] - where[1, 3]) == 1
    assert small.counts[l, 1, 2].argmax() in where[:, 3]
    p, q = small.probabilities[l, 1, 2], wrong.probabilities[l, 1, 2]
    assert chain.cost(small, wrong) == pytest.approx(2 * sum(a * np.log(a / b) for a, b in zip(p, q, strict=True)))


def test_planted_peaks_are_ordered_by_their_cost(small):
    costs = [chain.cost(small, error.believed) for error in chain.exchanged_peaks(small)]
    assert costs == sorted(costs)
    assert costs[-1] == max(chain.cost(small, chain.exchanged(small, m, k)) for m in range(3) for k in range(3))


@pytest.mark.slow
def test_rates_count_repetitions_that_fail(small):
    """The root always, no error never; the page shows both with intervals."""
    none, _, power, *_ = chain.planted_errors(small)
    rates = [chain.rate(small, error, 120, 2, 1) for error in (none, power)]

    assert [one.found for one in rates] == [0, 2]
    assert max(rates[0].kinds.values()) == 0
    page = chain.planted_page(rates, 1)
    assert "| none | 120 | 2 | 0.000 [0.000, 0.658] |" in page
    assert "| power J | 120 | 2 | 1.000 [0.342, 1.000] |" in page


def test_the_page_has_a_line_for_each_route_and_policy(small):
    result = calibrate(small, {ARRAYS: 100, "cpu": 100})
    page = chain.right_page(result, chain.Sizes(trials=100), 0)

    assert page.count(f"| {ARRAYS} |") == page.count("| cpu |") == 2
    assert "Of 168 tests, 0 fail" in page


@pytest.mark.slow
def test_the_figure_has_a_column_for_each_filter(small):
    errors = chain.planted_errors(small)[:2]
    panels = [chain.panel(error, small, 60, 1) for error in errors]
    figure = chain.calibration_figure(panels, Checkpoints().names)

    assert len(figure.axes) == 4
    assert [axes.get_title() for axes in figure.axes[:2]] == ["no error", "border uniform"]
    for panel in panels:
        assert set(panel.curves) == set(panel.factors) == {"what", "where", "joint"}
        assert (panel.low <= panel.high).all()
