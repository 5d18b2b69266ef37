"""Effects of options with their intervals, and the verdicts that follow."""

import numpy as np
import pytest
from scipy.stats import ttest_1samp
from solidtouch.analysis.sensitivity.choices import Reading
from solidtouch.analysis.sensitivity.effects import (
    QUANTITIES,
    SUMS,
    Effect,
    Scale,
    absolute,
    effect,
    interaction,
    limits,
    quantities,
    verdict,
)
from solidtouch.analysis.stats.jackknife import Interval

THETAS = np.array([0.5, 0.9, 0.95])
SCALE = Scale(THETAS, ("passive", "active"), 40)
BASE = Reading()
N = 14


@pytest.fixture
def units(rng):
    """Means of units: errors of two policies that fall with the threshold, more of them passive."""
    means = np.zeros((N, 2, len(THETAS), len(SUMS)))
    level = np.array([3.0, 1.0])[:, np.newaxis] / (1 + np.arange(3))
    means[..., 0] = 1
    means[..., 1] = rng.gamma(20, level / 20, size=(N, 2, 3))
    means[..., 2] = rng.gamma(20, level / 100, size=(N, 2, 3))
    means[..., 3] = np.cumsum(rng.gamma(20, 0.2, size=(N, 2, 3)), axis=-1) + np.array([4.0, 0.0])[:, np.newaxis]
    means[..., 4] = means[..., 1] / 4
    means[..., 5] = rng.gamma(20, 0.002, size=(N, 2, 3))
    return means


def planted(units, policy, quantity, factor):
    changed = units.copy()
    changed[:, policy, :, SUMS.index(quantity)] *= factor
    return changed


def judged(units, other):
    return verdict(effect(units, other, BASE, BASE, SCALE), effect(units, units, BASE, BASE, SCALE).advantage, LIMITS)


LIMITS = {
    (p, q): limit for p in SCALE.policies for q, limit in zip(QUANTITIES, (0.05, 0.02, 0.5, np.log(1.25)), strict=True)
}


def test_the_default_against_itself_changes_nothing(units):
    """Every change is exactly 0 with an interval of no width."""
    found = effect(units, units.copy(), BASE, BASE, SCALE)
    for change in (*found.change.values(), *found.equal_taps.values(), *found.advantage_change.values()):
        assert change == Interval(0, 0, 0, 0, 0)
    assert verdict(found, found.advantage, LIMITS) == ("nothing", [])


def test_quantities_are_those_at_the_threshold(units):
    """Errors and taps per counted trial, and the log of wrong over doubt."""
    mean = units.mean(axis=0)
    mean[..., 0] = 0.8
    for theta, h in ((0.5, 0), (0.95, 2)):
        found = quantities(mean, Reading(read_at=theta), THETAS)
        np.testing.assert_allclose(found[:, :3], mean[:, h, 1:4] / 0.8)
        np.testing.assert_allclose(np.exp(found[:, 3]), mean[:, h, 4] / mean[:, h, 5])


def test_the_best_threshold_of_a_grid_is_that_of_each_policy(units):
    mean = units.mean(axis=0)
    mean[0, :, 1], mean[1, :, 1] = (0.3, 0.1, 0.2), (0.1, 0.2, 0.05)
    best = quantities(mean, Reading(read_at=(0.5, 0.9, 0.95)), THETAS)
    few = quantities(mean, Reading(read_at=(0.5, 0.9)), THETAS)
    np.testing.assert_allclose(best[:, 0], (0.1, 0.05))
    np.testing.assert_allclose(few[:, 0], (0.1, 0.1))
    np.testing.assert_allclose(best[:, 2], (mean[0, 1, 3], mean[1, 2, 3]))


def test_another_threshold_changes_no_error_at_equal_taps(units):
    """All thresholds lie on the same curve of errors against taps."""
    found = effect(units, units, Reading(read_at=0.5), BASE, SCALE)
    assert found.change["active", "what_error"].value != 0
    assert found.equal_taps["active"] == Interval(0, 0, 0, 0, 0)


def test_errors_at_equal_taps_lie_between_those_of_thresholds(units):
    """Twice as many taps for the same errors: at the default's taps the errors of a lower threshold."""
    slow = planted(units, 1, "taps", 2.0)
    found = effect(units, slow, BASE, BASE, SCALE)
    times, errors = units.mean(axis=0)[1, :, 3], units.mean(axis=0)[1, :, 1]
    expected = np.interp(times[2], 2 * times, errors) - errors[2]
    assert found.change["active", "what_error"].value == 0
    assert found.equal_taps["active"].value == pytest.approx(expected)
    slower = planted(units, 1, "taps", 50.0)
    assert np.isnan(effect(units, slower, BASE, BASE, SCALE).equal_taps["active"].value)


def test_a_planted_loss_of_the_advantage_changes_the_conclusion(units):
    """Active errors as large as the passive ones, or larger, which is then said."""
    assert judged(units, planted(units, 1, "what_error", 3.0)) == ("conclusion", ["what_error"])
    assert judged(units, planted(units, 1, "what_error", 6.0)) == ("conclusion", ["what_error reversed"])


def test_a_planted_change_changes_the_numbers(units):
    """Where it is larger than the limit, and the conclusion stays."""
    decided, of = judged(units, planted(units, 1, "what_error", 1.3))
    assert (decided, of) == ("numbers", ["active what_error"])
    assert judged(units, planted(units, 0, "taps", 1.4)) == ("numbers", ["passive taps"])
    assert judged(units, planted(units, 1, "wrong", 1.5)) == ("numbers", ["active factor"])


def test_a_change_below_the_limits_is_nothing(units):
    """However sure it is."""
    changed = planted(units, 1, "what_error", 1.02)
    assert effect(units, changed, BASE, BASE, SCALE).change["active", "what_error"].sure
    assert judged(units, changed) == ("nothing", [])


def test_a_change_that_scatters_is_not_decided(units, rng):
    """An interval that holds both zero and the limit tells neither."""
    scattered = units.copy()
    scattered[:, 1, :, 1] *= np.exp(rng.normal(scale=0.5, size=(N, 1)))
    assert judged(units, scattered) == ("not decided", [])


def test_an_advantage_that_is_not_sure_cannot_be_lost(units):
    """Without a conclusion under the defaults no option changes it."""
    level = planted(units, 1, "what_error", 3.0)
    decided, of = judged(level, planted(level, 1, "what_error", 2.0))
    assert decided == "numbers"
    assert "active what_error" in of


def test_an_advantage_lost_by_chance_is_not_a_change_of_the_conclusion(units):
    """It must be surely smaller, too."""
    found = effect(units, units, BASE, BASE, SCALE)
    lost = {name: Interval(0.1, 0.0, 0.2, -0.1, 0.3) for name in found.advantage}
    unsure = {name: Interval(-0.1, -0.2, 0.0, -0.3, 0.1) for name in found.advantage}
    assert verdict(Effect(found.change, {}, lost, unsure), found.advantage, LIMITS)[0] == "nothing"
    sure = {name: Interval(-0.1, -0.11, -0.09, -0.12, -0.08) for name in found.advantage}
    assert verdict(Effect(found.change, {}, lost, sure), found.advantage, LIMITS)[0] == "conclusion"


def test_an_interaction_is_a_difference_of_differences(units, rng):
    """Zero where effects add up, with the t-interval where they do not."""
    first = planted(units, 1, "what_error", 1.5)
    second = units.copy()
    second[:, 1, :, 1] += 0.25
    both = first.copy()
    both[:, 1, :, 1] += 0.25
    four = [BASE] * 4
    assert interaction([units, first, second, both], four, SCALE).value == pytest.approx(0, abs=1e-12)
    more = rng.normal(0.5, 0.1, size=N)
    both[:, 1, :, 1] += more[:, np.newaxis]
    found = interaction([units, first, second, both], four, SCALE)
    expected = ttest_1samp(more, 0.0).confidence_interval(0.95)
    assert (found.low, found.high) == pytest.approx(tuple(expected))


def test_limits_are_a_tenth_of_the_default_but_not_less_than_the_floor(make_taps):
    """The floor of errors is a hundredth of the distance between classes, which is 2 mm and 1.5 mm here."""
    grid = make_taps().grid()
    values = {"what_error": 1.0, "where_error": 0.01, "taps": 3.0, "factor": 1.4}
    found = limits({("active", name): Interval(value, 0, 0, 0, 0) for name, value in values.items()}, grid)
    assert found["active", "what_error"] == pytest.approx(0.1)
    assert found["active", "where_error"] == pytest.approx(0.015)
    assert found["active", "taps"] == 0.5
    assert found["active", "factor"] == pytest.approx(np.log(1.25))


def test_no_wrong_decision_leaves_calibration_open(units):
    """It is NaN, counts for no verdict, and the rest is judged."""
    right = planted(units, 1, "wrong", 0.0)
    found = absolute(right, BASE, SCALE)
    assert np.isnan(found["active", "factor"].value)
    assert np.isfinite(found["passive", "factor"].value)
    decided, of = verdict(effect(right, right, BASE, BASE, SCALE), {}, LIMITS)
    assert (decided, of) == ("nothing", [])


def test_few_units_are_not_decided(units):
    """Not even that nothing changes."""
    assert judged(units[:4], planted(units, 1, "taps", 9)[:4]) == ("not decided", [])
    assert judged(units[:4], units[:4]) == ("not decided", [])
    assert judged(units[:5], units[:5]) == ("nothing", [])
