"""The chosen threshold: least mean cost on held-out trials, against one found by hand."""

import numpy as np
import pytest
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.trials.records import plan_trials
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.tuning.held_out import decision_error, held_out
from solidtouch.inference.tuning.threshold import choose_threshold
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import concatenate

THETA = 1 - np.geomspace(0.5, 1e-5, 15)


def fitted(taps, grid):
    return fit(taps, grid, bins=8, pseudocount=0.5, power="none")


@pytest.fixture(scope="module")
def parts(make_model):
    """Three sessions drawn from one model, each held out."""
    model = make_model(L=3, M=2, K=3, J=2, B=6, taps=30, pseudocount=0.5)
    taps = concatenate([draw_session(model, 30, 1, s) for s in range(3)])
    return held_out(taps, model.grid, fitted)


@pytest.mark.parametrize("cost_error", [0.0, 3.0, 60.0, 1000.0])
def test_the_threshold_with_the_least_mean_cost_is_chosen(parts, cost_error):
    """Found by playing the same trials at each threshold alone; error and reaction time are theirs."""
    found = choose_threshold(parts, THETA, cost_error, trials=200, play=PlaySettings(deadline=30, fixation=1), seed=3)
    cost, error = np.zeros(len(THETA)), np.zeros(len(THETA))
    for h, theta in enumerate(THETA):
        for f, part in enumerate(parts.parts):
            plan = plan_trials(part.table.pool, 200, 3, 1, first_stream=200 * f)
            trials = run_trials(
                part.table, plan, (theta,), play=PlaySettings(theta_x=0.0, deadline=30), seed=3, fresh=True
            )
            wrong = decision_error(parts.grid, trials.what[:, 0], plan.what)
            error[h] += wrong.mean() / 3
            cost[h] += (cost_error * wrong + trials.taps[:, 0]).mean() / 3

    np.testing.assert_allclose(found.cost.mean, cost)
    np.testing.assert_allclose(found.error.mean, error)
    np.testing.assert_allclose(found.wrong.mean(axis=0), error)
    assert found.chosen == cost.argmin()
    assert found.value == THETA[cost.argmin()]
    assert found.excess.mean[found.chosen] == 0
    assert found.alike[found.chosen]


def test_dearer_errors_ask_for_higher_thresholds(parts):
    """From one tap where errors cost nothing; each answer costs no more than any other at its price."""
    chosen = [choose_threshold(parts, THETA, c, trials=300, play=PlaySettings(deadline=40)) for c in (0, 3, 30, 300)]
    values = [found.value for found in chosen]
    assert values[0] == THETA[0]
    assert values == sorted(values)
    assert values[-1] > values[0]


def test_the_interval_is_of_the_paired_difference(parts):
    """Thresholds share their trials, so a difference is known better than either cost."""
    found = choose_threshold(parts, THETA, 30.0, trials=300, play=PlaySettings(deadline=40))
    near = found.chosen + 1
    assert found.excess.error[near] < found.cost.error[near]
    assert not found.alike.all()
    assert (found.alike == (found.excess.low <= 0)).all()


def test_no_interval_reaches_below_what_is_possible(parts):
    """Errors are not negative, and nobody decides before the first tap."""
    found = choose_threshold(parts, THETA, 30.0, trials=60, play=PlaySettings(deadline=40))
    assert found.error.low.min() == 0
    assert found.taps.low.min() == found.cost.low.min() == 1
    assert (found.excess.low < 0).any()


def test_thresholds_may_come_in_any_order(parts):
    first = choose_threshold(parts, THETA, 30.0, trials=100)
    second = choose_threshold(parts, THETA[::-1], 30.0, trials=100)
    np.testing.assert_array_equal(first.theta, second.theta)
    np.testing.assert_array_equal(first.cost.mean, second.cost.mean)


@pytest.mark.parametrize("shape", [(1, 3), (3, 1)])
def test_one_place_and_one_object_have_a_threshold(make_taps, shape):
    """With one object a tap is enough and no error can be made, so the lowest is chosen."""
    taps = make_taps(L=shape[0], M=shape[1], sessions=1, repeats=6)
    found = choose_threshold(
        held_out(taps, taps.grid(), fitted), THETA, 10.0, trials=100, play=PlaySettings(deadline=8)
    )
    assert np.isfinite(found.cost.mean).all()
    if shape[1] == 1:
        assert found.chosen == 0
        assert found.cost.mean.tolist() == [1.0] * len(THETA)


def test_bad_arguments_are_refused(parts):
    """Each in a sentence."""
    with pytest.raises(InputError, match=r"cost of an error must be a number of taps, 0 to 1e\+09, got -1"):
        choose_threshold(parts, THETA, -1.0)
    with pytest.raises(InputError, match=r"0 to .* got nan"):
        choose_threshold(parts, THETA, float("nan"))
    with pytest.raises(InputError, match="from 0 to 2, got 7"):
        choose_threshold(parts, THETA, 1.0, play=PlaySettings(fixation=7))
