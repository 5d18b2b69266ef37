"""Learners of fixation point and threshold: planted problems, regret, resuming, and real episodes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from solidtouch.hardware.model_rig import draw_session
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference.engine import make_engine
from solidtouch.inference.episode_costs import episode_cost, held_out_costs, trial_costs
from solidtouch.inference.gaussian_process import (
    Smoothness,
    arm_posterior,
    covariance,
    fitted_smoothness,
    log_likelihood,
    places,
)
from solidtouch.inference.held_out import held_out
from solidtouch.inference.online_learning import (
    METHODS,
    Learner,
    beliefs,
    choose,
    interval,
    learn,
    load_learner,
    recommended,
    save_learner,
    told,
)
from solidtouch.inference.trial_plan import plan_trials, tap_table, trial_uniforms
from solidtouch.models.errors import InputError
from solidtouch.models.histogram import fit
from solidtouch.models.seeds import Purpose, generator

FIXATIONS, THETA = tuple(range(5)), (0.5, 0.9, 0.99)
A = len(FIXATIONS) * len(THETA)


def planted(best=7, noise=1.0):
    """Mean costs of 5 x 3 arms that grow with the distance from one, and a function that draws costs."""
    l, h = np.divmod(np.arange(A), len(THETA))
    mean = 3 + (l - best // len(THETA)) ** 2 + 2.0 * (h - best % len(THETA)) ** 2

    def cost(episode, arm):
        return mean[arm] + noise * np.random.default_rng([99, episode, arm]).normal()

    return mean, cost


def played(learner, episodes, cost):
    """The learner after episodes, and the arms that it chose."""
    arms = []
    return learn(learner, episodes, cost, lambda _, arm: arms.append(arm)), arms


@pytest.mark.parametrize("method", METHODS)
def test_the_best_arm_is_found_and_regret_grows_ever_slower(method):
    """Of 15 arms, with noise as large as the step to the next one."""
    mean, cost = planted()
    learner, arms = played(Learner.new(method, FIXATIONS, THETA, 1), 512, cost)
    regret = np.cumsum(mean[arms] - mean.min())

    assert recommended(learner) == mean.argmin()
    assert np.mean(np.array(arms[-100:]) == mean.argmin()) > 0.75
    assert regret[511] - regret[255] < 0.25 * regret[255]
    assert regret[511] < 0.15 * 512 * (mean - mean.min()).mean()


def test_neighbours_teach_the_process_and_not_the_arms():
    """With a budget of two episodes for each arm, the process has lost less on average."""
    mean, cost = planted()
    lost = {
        method: np.mean(
            [np.sum(mean[played(Learner.new(method, FIXATIONS, THETA, s), 2 * A, cost)[1]]) for s in range(12)]
        )
        for method in METHODS
    }
    assert lost["gp"] < lost["thompson"]


@pytest.mark.parametrize("method", METHODS)
def test_a_resumed_learner_goes_on_as_an_uninterrupted_one(method, tmp_path):
    """Through a file, at any episode, to the last bit."""
    _, cost = planted()
    whole, arms = played(Learner.new(method, FIXATIONS, THETA, 4), 60, cost)
    for stop in (0, 1, 7, 33):
        first, before = played(Learner.new(method, FIXATIONS, THETA, 4), stop, cost)
        save_learner(first, tmp_path / "learner.json", force=True)
        second, after = played(load_learner(tmp_path / "learner.json"), 60 - stop, cost)
        assert before + after == arms
        for name in ("count", "mean", "squares", "theta", "fixation"):
            np.testing.assert_array_equal(getattr(second, name), getattr(whole, name))
        assert second.smoothness == whole.smoothness


@pytest.mark.parametrize("method", METHODS)
def test_the_seed_alone_decides(method):
    _, cost = planted()
    runs = [played(Learner.new(method, FIXATIONS, THETA, seed), 30, cost)[1] for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


@pytest.mark.parametrize("method", METHODS)
def test_from_the_third_episode_on_arms_are_not_drawn_blindly(method):
    _, cost = planted()
    learners = [played(Learner.new(method, FIXATIONS, THETA, seed), 2, cost)[0] for seed in range(20)]
    blind = [int(generator(seed, Purpose.ARM, 2).integers(A)) for seed in range(20)]
    assert [choose(learner) for learner in learners] != blind


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_units_of_costs_do_not_matter(method, scale):
    """Costs in other units, from another zero, lead to the same arms."""
    _, cost = planted()
    _, arms = played(Learner.new(method, FIXATIONS, THETA, 3), 40, cost)
    _, others = played(Learner.new(method, FIXATIONS, THETA, 3), 40, lambda e, a: scale * (cost(e, a) - 7))
    assert np.mean(np.array(arms) == others) > 0.9


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("fixations", "theta"), [((0,), (0.9,)), ((0, 1), (0.9,)), ((0,), (0.5, 0.9))])
def test_one_place_or_one_threshold_is_enough(method, fixations, theta):
    learner, arms = played(Learner.new(method, fixations, theta), 20, lambda _, arm: 1.0 + arm)
    assert learner.count.sum() == 20 == len(arms)
    assert recommended(learner) == 0


@pytest.mark.parametrize("method", METHODS)
def test_equal_costs_are_no_trouble(method):
    learner, _ = played(Learner.new(method, FIXATIONS, THETA), 20, lambda *_: 5.0)
    mean, deviation = beliefs(learner)
    np.testing.assert_allclose(mean, 5)
    assert np.isfinite(deviation).all()


def test_running_sums_are_those_of_the_costs(rng):
    """Number, mean and squared deviations of each arm."""
    learner, costs = Learner.new("thompson", (0, 1), (0.9,)), rng.normal(size=(2, 9)) + 1e3
    for row in costs.T:
        for arm, value in enumerate(row):
            learner = told(learner, arm, value)
    np.testing.assert_allclose(learner.mean, costs.mean(axis=1))
    np.testing.assert_allclose(learner.squares, costs.var(axis=1) * 9)
    assert learner.count.tolist() == [9, 9]
    assert learner.episodes == 18


def test_a_lucky_arm_is_not_recommended():
    """One cheap episode beside two hundred that are nearly as cheap."""
    learner = Learner.new("thompson", (0, 1, 2), (0.9,))
    learner = replace(
        learner,
        count=np.array([1, 200, 200]),
        mean=np.array([0.8, 1.0, 3.0]),
        squares=np.array([0.0, 100.0, 100.0]),
    )
    assert recommended(learner) == 1


@pytest.mark.parametrize("episodes", [3, 12, 60])
def test_intervals_of_arms_apart_are_those_of_students_posterior(rng, episodes):
    """Against draws from it; where little was played they are wider than normal ones."""
    learner = Learner.new("thompson", (0, 1), (0.9,))
    for episode in range(episodes):
        learner = told(learner, episode % 2, rng.normal(10.0, 2.0))
    low, high = interval(learner, 0, 0.95)
    mean, deviation = (values[0] for values in beliefs(learner))
    freedom = 4.0 + learner.count[0]
    drawn = mean + deviation * np.sqrt((freedom - 2) / freedom) * rng.standard_t(freedom, 400_000)

    assert np.quantile(drawn, [0.025, 0.975]) == pytest.approx([low, high], abs=0.02 * deviation)
    assert drawn.std() == pytest.approx(deviation, rel=0.02)


def test_the_interval_of_a_process_is_normal():
    learner = Learner.new("gp", FIXATIONS, THETA)
    for episode in range(20):
        learner = told(learner, episode % A, float(episode % 5))
    mean, deviation = (values[2] for values in beliefs(learner))
    assert interval(learner, 2, 0.95) == pytest.approx((mean - 1.959964 * deviation, mean + 1.959964 * deviation))


def test_the_process_is_conditioned_on_every_cost(rng):
    """Means and numbers of costs say as much as the costs themselves, conditioned on one by one."""
    x = places([0, 0, 1, 1, 2], [0.5, 0.9, 0.5, 0.99, 0.9])
    arms = rng.integers(4, size=25)  # the last arm is never played
    costs = rng.normal(size=25) + arms
    count = np.bincount(arms, minlength=5)
    mean = np.bincount(arms, costs, 5) / np.maximum(count, 1)
    squares = np.bincount(arms, (costs - mean[arms]) ** 2, 5)
    smoothness = Smoothness(0.4, 0.6, 0.7, 0.8)
    unit, z = costs.std(), (costs - costs.mean()) / costs.std()
    prior = covariance(x, smoothness)
    own = prior[np.ix_(arms, arms)] + 0.64 * np.eye(25)
    cross = prior[:, arms]
    found, spread = arm_posterior(x, count, mean, squares, smoothness)

    np.testing.assert_allclose(found, costs.mean() + unit * cross @ np.linalg.solve(own, z), rtol=1e-6)
    np.testing.assert_allclose(spread, unit**2 * (prior - cross @ np.linalg.solve(own, cross.T)), rtol=1e-5, atol=1e-7)
    density = multivariate_normal(np.zeros(25), own).logpdf(z)
    assert log_likelihood(x, count, mean, squares, smoothness) == pytest.approx(density, rel=1e-6)


def test_the_smoothness_of_a_process_is_recovered(rng):
    """Within a factor of two, from 20 costs at each of 60 arms."""
    x = places(*(axis.ravel() for axis in np.meshgrid(np.arange(12), (0.5, 0.8, 0.95, 0.99, 0.999))))
    truth = Smoothness(0.15, 0.5, 1.0, 0.5)
    ratios = []
    for _ in range(5):
        value = np.linalg.cholesky(covariance(x, truth) + 1e-9 * np.eye(60)) @ rng.normal(size=60)
        costs = value[:, np.newaxis] + 0.5 * rng.normal(size=(60, 20))
        mean, squares = costs.mean(axis=1), costs.var(axis=1) * 20
        found = fitted_smoothness(x, np.full(60, 20), mean, squares)
        ratios.append([found.fixation / 0.15, found.noise * costs.std() / 0.5])
    assert np.abs(np.log(np.median(ratios, axis=0))).max() < np.log(2)


# Episodes ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drawn(make_model):
    """A model, and taps that were drawn from it."""
    model = make_model(L=4, M=3, K=2, J=3, B=6, taps=20, pseudocount=0.5)
    return model, draw_session(model, 8, 2)


def test_a_rig_and_trials_cost_the_same(drawn):
    """Episode by episode through `perceive` on replayed taps, for arms with different points and thresholds."""
    model, taps = drawn
    table, engine = tap_table(model, taps), make_engine("numpy", model)
    arms = [(0, 0.6), (3, 0.6), (2, 0.95)]
    costs = trial_costs(table, model.grid, *zip(*arms, strict=True), 7.0, 6, deadline=12, seed=3, first_stream=5)
    plan = plan_trials(table.pool, 6, 3, first_stream=5)
    for a, (point, theta) in enumerate(arms):
        for i in range(6):
            numbers = iter(trial_uniforms(3, int(plan.stream[i]), 12))
            rig = ReplayRig(taps, model.grid, int(plan.where[i]), int(plan.what[i]), numbers)
            cost = episode_cost(rig, engine, int(plan.what[i]), point, theta, 7.0, deadline=12)
            assert cost == costs[a, i]


def test_episodes_of_a_learner_go_round_the_parts(drawn):
    """Taken up later, they go on with the trials that would have followed."""
    model, taps = drawn
    parts = held_out(taps, model.grid, lambda part, grid: fit(part, grid, bins=6, pseudocount=0.5))
    new = Learner.new("thompson", (0, 3), (0.6, 0.9))
    whole = held_out_costs(parts, new, 9, 5.0, deadline=10, seed=1)
    part = parts.parts[1]
    own = trial_costs(part.table, parts.grid, new.fixation, new.theta, 5.0, 4, deadline=10, seed=1)
    np.testing.assert_array_equal(whole[:, 1::2], own)
    later, _ = played(new, 4, lambda *_: 1.0)
    np.testing.assert_array_equal(held_out_costs(parts, later, 5, 5.0, deadline=10, seed=1), whole[:, 4:])


# What is refused ---------------------------------------------------------------------------------------------------


def test_bad_arguments_are_refused():
    """Each in a sentence."""
    with pytest.raises(InputError, match="one of thompson, gp, got 'ucb'"):
        Learner.new("ucb", FIXATIONS, THETA)
    with pytest.raises(InputError, match="at least one fixation point"):
        Learner.new("gp", (), THETA)
    with pytest.raises(InputError, match="threshold and none twice"):
        Learner.new("gp", FIXATIONS, (0.9, 0.9))
    with pytest.raises(InputError, match="must lie between 0 and 1"):
        Learner.new("gp", FIXATIONS, (0.9, 1.0))
    learner = Learner.new("gp", FIXATIONS, THETA)
    with pytest.raises(InputError, match="must be a number, got nan"):
        told(learner, 0, float("nan"))
    with pytest.raises(InputError, match="At least 2 episodes"):
        recommended(learner)
    assert 0 <= choose(learner) < A


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": 2}, "its key format is not 1"),
        ({"method": "ucb"}, "no whole learner: .*ucb"),
        ({"count": [1]}, "the length of a list is wrong"),
        ({"count": [-1] * 12}, "no whole learner: .*count"),
        ({"count": [1.5] * 12}, "no whole learner: .*count"),
        ({"count": [10**30] * 12}, "no whole learner: .*count"),
        ({"seed": 1e400}, "no whole learner: .*seed"),
        ({"seed": -1}, "no whole learner: .*seed"),
        ({"mean": "none"}, "no whole learner: .*mean"),
        ({"mean": [float("nan")] * 12}, "a number is not finite"),
        ({"squares": [float("inf")] * 12}, "a number is not finite"),
        ({"squares": [-1.0] * 12}, "no whole learner: .*squares"),
        ({"smoothness": "rough"}, "no whole learner: .*smoothness"),
        ({"smoothness": {"fixation": 1.0}}, "no whole learner"),
        ({"smoothness": {"fixation": -1.0, "theta": 1.0, "size": 1.0, "noise": 1.0}}, "no whole learner"),
        ({"smoothness": {"fixation": 1e300, "theta": 1.0, "size": 1.0, "noise": 1.0}}, "no whole learner"),
        ({"setup": None}, "no whole learner: .*setup"),
    ],
)
def test_a_file_that_holds_no_learner_is_refused(tmp_path, change, said):
    path = tmp_path / "learner.json"
    save_learner(Learner.new("gp", FIXATIONS, THETA), path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=said):
        load_learner(path)
