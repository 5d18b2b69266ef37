"""Curves of error against taps and way, read from recorded trials."""

import numpy as np
import pytest
from solidtouch.analysis.stats.jackknife import Interval
from solidtouch.analysis.strategies.curves import (
    AT_TAPS,
    QUANTITIES,
    SUMS,
    Family,
    at_taps,
    curve,
    decided_sums,
    differences,
    families,
    nats,
    quantities,
    travelled,
)
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.information import information_of_moves, tap_outcomes
from solidtouch.inference.moves.control import fixation, passive, random_place
from solidtouch.inference.stopping.rules import error_loss
from solidtouch.inference.stopping.stopping import or_give_up, what_above
from solidtouch.inference.trials.lockstep import Record, play
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import THRESHOLDS, run_trials
from solidtouch.models.grid import ClassGrid
from solidtouch.models.settings import PlaySettings

GRID = ClassGrid(np.array([0.0, 1.0, 3.0, 7.0]), "mm", None, (("a",), ("b",), ("c",)), np.array([4.0, 6.0, 10.0]), "mm")
T = 3


@pytest.fixture
def record():
    """Two trials of three taps: the first is sure at the second tap, the second never."""
    what = np.array([[[0.5, 0.3, 0.2], [0.9, 0.1, 0.0], [0.2, 0.8, 0.0]], [[0.2, 0.3, 0.5]] * 3])
    at = np.array([[0, 2, 3], [1, 1, 0]])
    zero = np.zeros((2, T), np.int64)
    return Record(
        what_marginal=what,
        where=np.array([[0, 2, 2], [0, 0, 0]]),
        where_belief=np.full((2, T), 0.6),
        at=at,
        travelled=zero,
        clamped=zero,
        substituted=zero,
        moves=zero,
        length=np.full(2, T),
        held=np.array([1, 0]),
        watched={"expected": np.array([[0.1, 0.2, 0.4], [0.0, 0.3, 0.0]])},
        no_class_left=np.zeros(2, bool),
    )


def family(rule, *levels):
    return Family("one", "level", levels, rule)


def sums(values, name):
    return values[..., SUMS.index(name)]


def test_way_is_counted_in_the_unit_of_the_places(record):
    """Between the values of the classes, not by their numbers, and before the tap."""
    np.testing.assert_array_equal(travelled(record, GRID), [[0, 3, 7], [0, 0, 1]])


def test_a_trial_counts_what_it_decides_when_it_stops(record):
    """The first stops at the second tap, wrong by 2 mm; the second at the deadline, wrong by 6 mm."""
    values = decided_sums(record, family(what_above, 0.8), GRID)[:, 0]
    np.testing.assert_array_equal(sums(values, "taps"), [2, 3])
    np.testing.assert_array_equal(sums(values, "what_error"), [2, 6])
    np.testing.assert_array_equal(sums(values, "where_error"), [0, 0])
    np.testing.assert_array_equal(sums(values, "way"), [3, 1])
    np.testing.assert_array_equal(sums(values, "wrong"), [1, 1])
    np.testing.assert_allclose(sums(values, "doubt"), [0.1, 0.5])
    np.testing.assert_array_equal(sums(values, "unstopped"), [0, 1])
    np.testing.assert_array_equal(sums(values, "given_up"), [0, 0])


def test_null_decisions_are_no_errors_and_no_answers(record):
    """Who gives up has taps and way, but neither error nor doubt, and errors are means of the others."""
    rule = family(lambda level: or_give_up(what_above(level), 3, 1.0), 0.8)
    values = decided_sums(record, rule, GRID)[:, 0]
    np.testing.assert_array_equal(sums(values, "given_up"), [0, 1])
    np.testing.assert_array_equal(sums(values, "answered"), [1, 0])
    for name in ("what_error", "where_error", "wrong", "doubt", "unstopped"):
        assert sums(values, name)[1] == 0
    found = dict(zip(QUANTITIES, quantities(values.mean(axis=0)), strict=True))
    assert found["what_error"] == 2
    assert found["wrong"] == 1
    assert found["taps"] == 2.5
    assert found["given_up"] == 0.5
    assert found["factor"] == pytest.approx(10)


def test_where_nobody_answers_there_is_no_error():
    nothing = np.zeros((1, len(SUMS)))
    nothing[0, SUMS.index("given_up")] = 1
    found = dict(zip(QUANTITIES, quantities(nothing)[0], strict=True))
    assert np.isnan(found["what_error"])
    assert np.isnan(found["factor"])
    assert np.isnan(at_taps(nothing, (1, 2))).all()


def test_expected_and_told_begin_behind_the_first_tap(record):
    """Expectations are of the tap that comes, what was told is the growth of the log belief in the true object."""
    found = nats(record)
    np.testing.assert_allclose(found[0, :, 0], [0, 0.1, 0.3])
    np.testing.assert_allclose(found[0, :, 1], np.log([1, 0.1 / 0.3, 0.8 / 0.3]))
    np.testing.assert_allclose(found[1, :, 1], 0)


def test_points_of_a_curve_are_found_and_interpolated_between(rng):
    """At its own taps it has its own values, half-way the mean of both, and beyond its ends none."""
    mean = np.zeros((3, len(SUMS)))
    mean[:, SUMS.index("answered")] = 1
    mean[:, SUMS.index("what_error")] = [3, 1, 0]
    mean[:, SUMS.index("taps")] = [1, 2, 4]
    mean[:, SUMS.index("way")] = [0, 5, 6]
    found = at_taps(mean, (0.5, 1, 1.5, 2, 3, 4, 5))
    np.testing.assert_allclose(found[:, AT_TAPS.index("what_error")], [np.nan, 3, 2, 1, 0.5, 0, np.nan])
    np.testing.assert_allclose(found[:, AT_TAPS.index("way")], [np.nan, 0, 2.5, 5, 5.5, 6, np.nan])


def test_a_curve_differs_from_itself_by_nothing(rng):
    """Where all units come; beyond that there is no difference."""
    means = rng.uniform(0.5, 1.0, size=(6, 4, len(SUMS)))
    means[..., SUMS.index("taps")] = [1, 2, 3, 4]
    within, beyond = differences(means, means, (1.5, 5.0), 8)
    assert within == [Interval(0, 0, 0, 0, 0)] * len(AT_TAPS)
    assert np.isnan(beyond).all()


def test_intervals_of_plain_means_are_t_intervals(rng):
    """Taps are a plain mean over units."""
    means = rng.uniform(0.5, 1.0, size=(6, 1, len(SUMS)))
    taps = means[:, 0, SUMS.index("taps")]
    found = curve(means)[0][QUANTITIES.index("taps")]
    half = 2.570581835636314 * taps.std(ddof=1) / np.sqrt(6)
    np.testing.assert_allclose(
        (found.value, found.low, found.high), (taps.mean(), taps.mean() - half, taps.mean() + half)
    )


@pytest.fixture(scope="module")
def drawn(make_model):
    """A model of 4 x 3 classes, and taps drawn from it."""
    model = make_model(4, 3, 2, 1, 4, seed=5, taps=60, pseudocount=0.5, power="none")
    return model, draw_session(model, 400, 1, 0)


@pytest.mark.parametrize(("policy", "theta_x"), [(passive(), 1.0), (fixation(1), 0.0)])
def test_under_the_papers_strategies_it_counts_as_the_compiled_trials(drawn, policy, theta_x):
    """Errors, taps and the fraction stopped at every threshold."""
    model, taps = drawn
    table = tap_table(model, taps)
    plan = plan_trials(table.pool, 60, 3, 1)
    trials = run_trials(table, plan, THRESHOLDS, play=PlaySettings(theta_x=theta_x, deadline=9), seed=3)
    what = families(model, 1, 9)[0]
    values = decided_sums(play(table, plan, policy, deadline=9, seed=3, watch=no_gain), what, model.grid)
    np.testing.assert_array_equal(sums(values, "taps"), trials.taps)
    np.testing.assert_array_equal(sums(values, "wrong"), trials.what != plan.what[:, np.newaxis])
    np.testing.assert_allclose(sums(values, "where_error"), model.grid.where_error(trials.where, trials.true_where))
    np.testing.assert_array_equal(sums(values, "unstopped"), ~trials.stopped)


def no_gain(beliefs, moves):
    return {"gain": np.ones(len(moves)), "expected": np.zeros(len(moves))}


def test_dearer_taps_and_lower_thresholds_never_stop_later(drawn):
    """Along the levels of every rule taps grow; levels of give-up and deadline stop at half of it."""
    model, taps = drawn
    table = tap_table(model, taps)
    record = play(table, plan_trials(table.pool, 50, 0, 1), fixation(1), deadline=8, watch=falling_gain)
    for one in families(model, 1, 8):
        taken = sums(decided_sums(record, one, model.grid), "taps")
        assert (np.diff(taken, axis=1) >= 0).all(), one.name
        assert (taken[:, -1] > taken[:, 0]).any(), one.name
        if "at 4 taps" in one.name:
            assert taken.max() == 4


def falling_gain(beliefs, moves):
    """A gain that one tap is worth less the surer one is."""
    return {"gain": 1 - beliefs.sum(axis=1).max(axis=1)}


def test_where_the_model_is_right_taps_tell_what_is_expected_of_them(drawn):
    """With all taps that there are as pool, border clamp and power none."""
    model, taps = drawn
    table = tap_table(model, taps)
    every = np.array([[[a, b]] for a in model.edges[:-1] + 0.1 for b in model.edges[:-1] + 0.1])
    outcomes = tap_outcomes(model.log_likelihood(every))

    def watch(beliefs, moves):
        return {"expected": information_of_moves(outcomes, beliefs, moves[:, np.newaxis], "clamp", "what")[:, 0]}

    plan = plan_trials(table.pool, 4000, 8)
    record = play(table, plan, random_place(), border="clamp", deadline=4, seed=8, watch=watch)
    difference = np.diff(nats(record)[:, -1], axis=1)[:, 0]
    assert nats(record)[:, -1, 0].mean() > 0.1
    assert abs(difference.mean()) < 4 * difference.std() / np.sqrt(len(difference))


def test_losses_are_errors_of_objects():
    np.testing.assert_array_equal(error_loss(GRID), [[0, 2, 6], [2, 0, 4], [6, 4, 0]])
