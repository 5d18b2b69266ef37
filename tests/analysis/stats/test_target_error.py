"""Thresholds for a wanted error: predictions that cover new sessions, and the choice against one made by hand."""

import json

import numpy as np
import pytest
from scipy.stats import t
from solidtouch.analysis.stats.target_error import (
    FEWEST,
    Curves,
    choose,
    leave_out,
    predicted,
    prediction_interval,
    session_curves,
    target_error,
    threshold_grid,
)
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.settings import PlaySettings

L, M, J = 4, 3, 6


@pytest.fixture(scope="module")
def fitted(make_taps):
    """A model of one session, and six other sessions."""
    taps = make_taps(L=L, M=M, J=J, K=2, sessions=7, repeats=6)
    sessions = [taps.select(taps.session == s) for s in range(7)]
    model = fit(sessions[0], sessions[0].grid(), bins=9, pseudocount=0.5)
    return model, sessions[1:]


@pytest.fixture(scope="module")
def result(fitted):
    model, sessions = fitted
    return target_error(
        model, sessions[:5], 0.3, model.grid, seed=2, trials=150, play=PlaySettings(deadline=20, fixation=1)
    )


def curves_of(error, taps=None):
    """Curves with these errors (n, H), of two objects that share them."""
    error = np.asarray(error, dtype=np.float64)
    theta = 1 - np.geomspace(0.5, 1e-3, error.shape[1])
    taps = np.tile(1.0 + np.arange(error.shape[1]), (len(error), 1)) if taps is None else np.asarray(taps)
    return Curves(theta, error, np.repeat(error[..., np.newaxis], 2, axis=2), taps, np.ones_like(error))


def test_the_interval_is_that_of_student_with_a_session_more():
    """On the scale arcsin sqrt, with the sum of squares enlarged by the prior's one."""
    error = np.array([0.1, 0.3, 0.05, 0.2, 0.4, 0.0])
    angle = np.arcsin(np.sqrt(error))
    spread = np.sqrt((((angle - angle.mean()) ** 2).sum() + 0.15**2) / 6)
    half = t.ppf(0.95, 6) * spread * np.sqrt(7 / 6)
    low, high = prediction_interval(error)

    assert high == pytest.approx(np.sin(angle.mean() + half) ** 2)
    assert low == pytest.approx(np.sin(max(angle.mean() - half, 0)) ** 2)


def test_sessions_without_an_error_do_not_promise_that_there_is_none():
    """More of them promise more; the same holds at an error of 1."""
    highs = [prediction_interval(np.zeros(n))[1] for n in (5, 10, 40)]
    assert 0.02 < highs[0] < 0.03
    assert highs[0] > highs[1] > highs[2] > 0
    low, high = prediction_interval(np.ones((5, 2)))
    assert high.tolist() == [1, 1]
    assert low == pytest.approx(1 - highs[0])


@pytest.mark.parametrize("spread", [0.05, 0.2, 0.5])
@pytest.mark.parametrize("middle", [0.02, 0.15, 0.5])
def test_a_new_session_lies_in_the_interval_nine_times_of_ten(middle, spread, rng):
    """Or more often, where sessions differ less than the prior says; errors move in steps of a fifth of an object."""
    angle = np.arcsin(np.sqrt(middle)) + spread * rng.normal(size=(6, 4000))
    error = np.round(25 * np.sin(np.clip(angle, 0, np.pi / 2)) ** 2) / 25
    low, high = prediction_interval(error[:5])
    held = ((low <= error[5]) & (error[5] <= high)).mean()

    assert held > 0.86


def test_the_smallest_threshold_that_keeps_the_target_is_chosen():
    """It is found among all by looking at each alone."""
    error = np.array([[0.5, 0.3, 0.12, 0.02, 0.01, 0.0]]) + 0.01 * np.arange(5)[:, np.newaxis]
    for target in (0.05, 0.15, 0.3, 0.5, 0.9):
        h, reachable = choose(error, target)
        keeping = [i for i in range(6) if prediction_interval(error[:, i])[1] <= target]
        assert reachable == bool(keeping)
        assert h == (keeping[0] if keeping else 5)


def test_out_of_reach_the_fastest_of_the_lowest_is_chosen():
    """Differences of less than half a percent are none."""
    mean = np.array([0.9, 0.5, 0.304, 0.31, 0.3, 0.302])
    error = np.clip(mean + np.linspace(-0.2, 0.2, 5)[:, np.newaxis], 0, 1)
    assert choose(error, 0.1) == (2, False)


def test_errors_are_those_of_trials_of_each_session(fitted, result):
    """At every threshold, of all decisions and of each object; the reaction times as well."""
    model, sessions = fitted
    curves = result.curves
    assert curves.error.shape == (5, len(curves.theta))
    assert 0.95 in curves.theta
    for s, h in ((0, 3), (4, 30), (2, len(curves.theta) - 1)):
        table = tap_table(model, sessions[s])
        plan = plan_trials(table.pool, 150, 2, 1)
        trials = run_trials(table, plan, (curves.theta[h],), play=PlaySettings(theta_x=0.0, deadline=20), seed=2)
        wrong = trials.what[:, 0] != plan.what
        assert curves.error[s, h] == wrong.mean()
        assert curves.taps[s, h] == trials.taps.mean()
        assert curves.stopped[s, h] == trials.stopped.mean()
        for m in range(M):
            assert curves.each[s, h, m] == wrong[plan.what == m].mean()


def test_the_result_says_what_its_curves_say(result):
    """Chosen and default threshold, error with interval, reaction time; and in words."""
    h, reachable = choose(result.curves.error, 0.3)
    low, high = prediction_interval(result.curves.error[:, h])

    assert result.reachable == reachable
    assert result.chosen.theta == result.curves.theta[h]
    means = (values[:, h].mean() for values in (result.curves.error, result.curves.taps))
    assert (result.chosen.error, result.chosen.taps) == pytest.approx(tuple(means))
    assert (result.chosen.low, result.chosen.high) == pytest.approx((low, high))
    assert result.default.theta == 0.95
    assert result.policy == "active"
    assert result.names == ("rod 2 mm", "rod 4 mm", "rod 6 mm")
    assert f"{result.chosen.error:.1%} of the decisions are wrong" in result.sentence
    assert ("not reachable" in result.sentence) == (not reachable)
    assert json.loads(json.dumps(result.to_dict(), allow_nan=False))["chosen"]["taps"] == result.chosen.taps


def test_left_out_sessions_are_judged_by_thresholds_of_the_others():
    """One by one."""
    error = np.random.default_rng(3).uniform(0, 0.3, (6, 1)) * np.linspace(1.5, 0.2, 9)
    curves = curves_of(error)
    left = leave_out(curves, 0.25)
    for i in range(6):
        others = np.array([row for j, row in enumerate(error) if j != i])
        h, reachable = choose(others, 0.25)
        low, high = prediction_interval(others[:, h])
        assert left.theta[i] == curves.theta[h]
        assert left.error[i] == error[i, h]
        assert left.expected[i] == pytest.approx(others[:, h].mean())
        assert left.taps[i] == h + 1
        assert left.reachable[i] == reachable
        assert left.covered[i] == (low <= error[i, h] <= high)
    assert len(set(left.theta.tolist())) > 1


def test_a_prediction_is_of_one_threshold():
    """Means over sessions."""
    curves = curves_of([[0.5, 0.1], [0.3, 0.1], [0.4, 0.4]], [[1, 5], [1, 7], [1, 9.0]])
    at = predicted(curves, 1)
    assert (at.theta, at.error, at.taps, at.stopped) == pytest.approx((0.999, 0.2, 7, 1))
    assert at.low < 0.2 < at.high


def test_thresholds_reach_from_one_tap_to_near_certainty():
    """In equal steps of the logarithm."""
    grid = threshold_grid(4)
    assert grid[0] == pytest.approx(0.25)
    assert 1 - grid[-1] == pytest.approx(1e-6)
    np.testing.assert_allclose(np.diff(np.log(1 - grid), n=2), 0, atol=1e-6)


def test_a_right_model_reaches_its_target(make_model):
    """Sessions drawn from it are alike, and fresh ones keep the target."""
    model = make_model(L=3, M=2, K=3, J=4, B=6, taps=30, pseudocount=0.5)
    sessions = [draw_session(model, 60, 1, s) for s in range(9)]
    found = target_error(model, sessions[:5], 0.1, model.grid, trials=400)
    fresh, *_ = session_curves(model, sessions[5:], model.grid, trials=400)
    at = int(np.searchsorted(fresh.theta, found.chosen.theta))

    assert found.reachable
    assert (fresh.error[:, at] <= 0.1).all()
    assert found.default.error > 0 or found.default.taps > found.chosen.taps


def test_passive_trials_and_one_object_do_not_move(fitted, make_taps):
    """With one object, decisions are about the place."""
    model, sessions = fitted
    assert (
        target_error(model, sessions[:5], 0.3, model.grid, trials=30, play=PlaySettings(theta_x=1.0)).policy
        == "passive"
    )
    taps = make_taps(L=5, M=1, J=J, K=2, sessions=6, repeats=4)
    single = [taps.select(taps.session == s) for s in range(6)]
    model = fit(single[0], single[0].grid(), bins=9, pseudocount=0.5)
    found = target_error(model, single[1:], 0.3, model.grid, trials=30)
    assert found.policy == "passive"
    assert found.curves.each.shape[2] == 5


def test_bad_arguments_are_refused(fitted):
    """Each in a sentence."""
    model, sessions = fitted
    with pytest.raises(InputError, match=r"requires at least 5 sessions that did not train the model, got 4\."):
        target_error(model, sessions[: FEWEST - 1], 0.1, model.grid)
    with pytest.raises(InputError, match=r"target error must lie between 0 and 1, got 1\.5"):
        target_error(model, sessions, 1.5, model.grid)
    with pytest.raises(InputError, match="default threshold must lie between 0 and 1, got 1"):
        target_error(model, sessions, 0.1, model.grid, play=PlaySettings(threshold=1))
    with pytest.raises(InputError, match="from 0 to 3, got 9"):
        target_error(model, sessions, 0.1, model.grid, play=PlaySettings(fixation=9))


def test_a_session_that_trained_the_model_does_not_tune(fitted, make_taps):
    """It is told by its taps."""
    model, sessions = fitted
    taps = make_taps(L=L, M=M, J=J, K=2, sessions=7, repeats=6)
    own = taps.select(taps.session == 0)
    with pytest.raises(InputError, match="Tuning session 4 trained the model: 72 of its 72 taps"):
        target_error(model, [*sessions[:4], own], 0.1, model.grid)


def test_the_grid_is_that_of_the_model(fitted):
    """Another one is refused."""
    model, sessions = fitted
    other = ClassGrid(np.arange(9.0), "mm", None, tuple((f"{m}",) for m in range(2)))
    with pytest.raises(InputError, match="classes of the table do not match the grid of 9 x 2"):
        target_error(model, sessions, 0.1, other)
