"""Both choices of tuning, the figures of its study, and the regret of learners against the best pair."""

import numpy as np
import pytest
from solidtouch.analysis.tuning.run import Price, check_price, tune_parts, tuning_trials
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.trials.records import tap_table
from solidtouch.inference.tuning.costs import trial_costs
from solidtouch.inference.tuning.held_out import held_out
from solidtouch.inference.tuning.online import Learner
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import concatenate

from benchmarks.studies.strategies import figures, learning_regret

THETA = (0.6, 0.9)


@pytest.fixture(scope="module")
def drawn(make_model):
    """A model, its test taps, and the class grid."""
    model = make_model(L=4, M=3, K=2, J=3, B=6, taps=20, pseudocount=0.5)
    return tap_table(model, draw_session(model, 8, 2)), model.grid


@pytest.fixture(scope="module")
def parts(make_model):
    """Three sessions, each held out."""
    model = make_model(L=4, M=2, K=3, J=2, B=6, taps=30, pseudocount=0.5)
    taps = concatenate([draw_session(model, 15, 1, s) for s in range(3)])
    return held_out(taps, model.grid, lambda part, grid: fit(part, grid, bins=6, pseudocount=0.5))


def test_arms_are_priced_by_trials_and_the_best_without_its_luck(drawn):
    """What one half of the trials calls best is priced by the other, and so no cheaper than the cheapest of all."""
    table, grid = drawn
    learner = Learner.new("thompson", range(4), THETA)
    prices = learning_regret.arm_prices(table, grid, learner, 20.0, 400, play=PlaySettings(deadline=15))
    fresh = trial_costs(
        table, grid, learner.fixation, learner.theta, 20.0, 4000, play=PlaySettings(deadline=15), first_stream=7
    )
    assert np.abs(prices.mean - fresh.mean(axis=1)).max() < 6 * fresh.std(axis=1).max() / np.sqrt(400)
    assert prices.least >= prices.mean.min() - 1e-9
    assert prices.of(2, 0.9) == prices.mean[5]


def test_regret_adds_up_what_chosen_arms_cost_more(drawn):
    """A learner loses less than an arm at random, and what it ends with is no worse."""
    table, grid = drawn
    lost, prices = learning_regret.regrets(
        table, grid, range(4), THETA, 20.0, episodes=200, trials=2000, seed=1, play=PlaySettings(deadline=15)
    )
    steps = prices.mean - prices.least
    np.testing.assert_allclose(lost["random"].regret, steps.mean() * np.arange(1, 201))
    each = np.diff(lost["thompson"].regret, prepend=0.0)
    assert np.abs(each[:, np.newaxis] - steps).min(axis=1).max() < 1e-9
    assert lost["thompson"].regret[-1] < lost["random"].regret[-1]
    assert lost["thompson"].kept < steps.mean()


def test_both_choices_end_in_a_setting_and_in_words(parts):
    """The threshold is chosen for the chosen point, and progress counts all trials."""
    played = []
    found = tune_parts(parts, Setting.of(passive=True), Price(30.0), trials=100, progress=played.append)
    assert sum(played) == tuning_trials(parts, 100) == 3 * (1 + 2) * 5 * 100
    assert found.setting.play.fixation == found.fixation.chosen
    assert found.setting.play.threshold == found.threshold.value
    assert not found.setting.play.passive
    first, second = found.sentences
    assert f"class {found.fixation.chosen}" in first
    assert f"cost {found.threshold.cost.mean[found.chosen]:.1f}" in second


def test_a_target_that_three_sessions_cannot_promise_is_refused(parts):
    with pytest.raises(InputError, match="at least 5 training sessions, got 3"):
        check_price(Price(target=0.1), len(parts.parts))
    with pytest.raises(InputError, match="must lie between 0 and 1, got 0"):
        check_price(Price(target=0.0), 9)


def test_figures_show_every_curve(parts):
    """Every learner has a line for each preset, every part one over positions, before their mean."""
    curves = {"thompson": np.arange(1.0, 21).reshape(2, 10), "random": np.ones((2, 10))}
    both = figures.regret_figure({"paper": curves, "broken": curves}).axes
    assert [axes.get_title() for axes in both] == ["preset paper", "preset broken"]
    for axes in both:
        assert [line.get_label() for line in axes.lines] == ["thompson", "random"]
        np.testing.assert_allclose(axes.lines[0].get_ydata(), np.arange(6.0, 16) / np.arange(1, 11))
    found = tune_parts(parts, Setting(), Price(), trials=100)
    places, thresholds = figures.tuning_figure(found).axes
    drawn = [line.get_ydata() for line in places.lines[: len(found.fixation.errors) + 1]]
    np.testing.assert_array_equal(drawn, [*found.fixation.errors, found.fixation.error.mean])
    assert places.lines[0].get_xdata().tolist() == parts.grid.where_value.tolist()
    assert thresholds.lines[0].get_ydata().tolist() == found.threshold.cost.mean.tolist()
