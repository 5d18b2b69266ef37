"""The learner of fixation point and threshold: planted problems, regret, resuming, and real episodes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.trials.records import plan_trials, tap_table, trial_uniforms
from solidtouch.inference.tuning.costs import episode_cost, held_out_costs, trial_costs
from solidtouch.inference.tuning.held_out import held_out
from solidtouch.inference.tuning.online import (
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
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.seeds import Purpose, generator
from solidtouch.models.settings import PlaySettings

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
    return learn(learner, episodes, cost, lambda _, arm, __: arms.append(arm)), arms


def test_the_best_arm_is_found_and_regret_grows_ever_slower():
    """Of 15 arms, with noise as large as the step to the next one."""
    mean, cost = planted()
    learner, arms = played(Learner.new("thompson", FIXATIONS, THETA, 1), 512, cost)
    regret = np.cumsum(mean[arms] - mean.min())

    assert recommended(learner) == mean.argmin()
    assert np.mean(np.array(arms[-100:]) == mean.argmin()) > 0.75
    assert regret[511] - regret[255] < 0.25 * regret[255]
    assert regret[511] < 0.15 * 512 * (mean - mean.min()).mean()


def test_a_resumed_learner_goes_on_as_an_uninterrupted_one(tmp_path):
    """Through a file, at any episode, to the last bit."""
    _, cost = planted()
    whole, arms = played(Learner.new("thompson", FIXATIONS, THETA, 4), 60, cost)
    for stop in (0, 1, 7, 33):
        first, before = played(Learner.new("thompson", FIXATIONS, THETA, 4), stop, cost)
        save_learner(first, tmp_path / "learner.json", force=True)
        second, after = played(load_learner(tmp_path / "learner.json"), 60 - stop, cost)
        assert before + after == arms
        for name in ("count", "mean", "squares", "theta", "fixation"):
            np.testing.assert_array_equal(getattr(second, name), getattr(whole, name))


def test_the_seed_alone_decides():
    _, cost = planted()
    runs = [played(Learner.new("thompson", FIXATIONS, THETA, seed), 30, cost)[1] for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]


def test_from_the_third_episode_on_arms_are_not_drawn_blindly():
    _, cost = planted()
    learners = [played(Learner.new("thompson", FIXATIONS, THETA, seed), 2, cost)[0] for seed in range(20)]
    blind = [int(generator(seed, Purpose.ARM, 2).integers(A)) for seed in range(20)]
    assert [choose(learner) for learner in learners] != blind


@pytest.mark.parametrize("scale", [1e-3, 1e4])
def test_units_of_costs_do_not_matter(scale):
    """Costs in other units, from another zero, lead to the same arms."""
    _, cost = planted()
    _, arms = played(Learner.new("thompson", FIXATIONS, THETA, 3), 40, cost)
    _, others = played(Learner.new("thompson", FIXATIONS, THETA, 3), 40, lambda e, a: scale * (cost(e, a) - 7))
    assert np.mean(np.array(arms) == others) > 0.9


@pytest.mark.parametrize(("fixations", "theta"), [((0,), (0.9,)), ((0, 1), (0.9,)), ((0,), (0.5, 0.9))])
def test_one_place_or_one_threshold_is_enough(fixations, theta):
    learner, arms = played(Learner.new("thompson", fixations, theta), 20, lambda _, arm: 1.0 + arm)
    assert learner.count.sum() == 20 == len(arms)
    assert recommended(learner) == 0


def test_equal_costs_are_no_trouble():
    learner, _ = played(Learner.new("thompson", FIXATIONS, THETA), 20, lambda *_: 5.0)
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
    costs = trial_costs(
        table, model.grid, *zip(*arms, strict=True), 7.0, 6, play=PlaySettings(deadline=12), seed=3, first_stream=5
    )
    plan = plan_trials(table.pool, 6, 3, first_stream=5)
    for a, (point, theta) in enumerate(arms):
        for i in range(6):
            numbers = iter(trial_uniforms(3, int(plan.stream[i]), 12))
            rig = ReplayRig(taps, model.grid, int(plan.where[i]), int(plan.what[i]), numbers)
            cost = episode_cost(rig, engine, int(plan.what[i]), point, theta, 7.0, play=PlaySettings(deadline=12))
            assert cost == costs[a, i]


def test_episodes_of_a_learner_go_round_the_parts(drawn):
    """Taken up later, they go on with the trials that would have followed."""
    model, taps = drawn
    parts = held_out(taps, model.grid, lambda part, grid: fit(part, grid, bins=6, pseudocount=0.5))
    new = Learner.new("thompson", (0, 3), (0.6, 0.9))
    whole = held_out_costs(parts, new, 9, 5.0, play=PlaySettings(deadline=10), seed=1)
    part = parts.parts[1]
    own = trial_costs(part.table, parts.grid, new.fixation, new.theta, 5.0, 4, play=PlaySettings(deadline=10), seed=1)
    np.testing.assert_array_equal(whole[:, 1::2], own)
    later, _ = played(new, 4, lambda *_: 1.0)
    np.testing.assert_array_equal(
        held_out_costs(parts, later, 5, 5.0, play=PlaySettings(deadline=10), seed=1), whole[:, 4:]
    )


# What is refused ---------------------------------------------------------------------------------------------------


def test_bad_arguments_are_refused():
    """Each in a sentence."""
    with pytest.raises(InputError, match="one of thompson, got 'gp'"):
        Learner.new("gp", FIXATIONS, THETA)
    with pytest.raises(InputError, match="at least one fixation point"):
        Learner.new("thompson", (), THETA)
    with pytest.raises(InputError, match="threshold and no duplicates"):
        Learner.new("thompson", FIXATIONS, (0.9, 0.9))
    with pytest.raises(InputError, match="must be between 0 and 1"):
        Learner.new("thompson", FIXATIONS, (0.9, 1.0))
    learner = Learner.new("thompson", FIXATIONS, THETA)
    with pytest.raises(InputError, match="must be a number, got nan"):
        told(learner, 0, float("nan"))
    with pytest.raises(InputError, match="At least 2 episodes"):
        recommended(learner)
    assert 0 <= choose(learner) < A


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": 2}, "of format 2; this version reads format 1"),
        ({"method": "ucb"}, "damaged learner file: .*ucb"),
        ({"method": "gp", "smoothness": {"fixation": 1.0}}, "damaged learner file: .*'gp'"),
        ({"count": [1]}, "a list has the wrong length"),
        ({"count": [-1] * 12}, "damaged learner file: .*count"),
        ({"count": [1.5] * 12}, "damaged learner file: .*count"),
        ({"count": [10**30] * 12}, "damaged learner file: .*count"),
        ({"seed": 1e400}, "damaged learner file: .*seed"),
        ({"seed": -1}, "damaged learner file: .*seed"),
        ({"mean": "none"}, "damaged learner file: .*mean"),
        ({"mean": [float("nan")] * 12}, "a number is not finite"),
        ({"squares": [float("inf")] * 12}, "a number is not finite"),
        ({"squares": [-1.0] * 12}, "damaged learner file: .*squares"),
        ({"smoothness": "rough"}, "damaged learner file: .*smoothness"),
        ({"setup": None}, "damaged learner file: .*setup"),
    ],
)
def test_a_file_that_holds_no_learner_is_refused(tmp_path, change, said):
    path = tmp_path / "learner.json"
    save_learner(Learner.new("thompson", FIXATIONS, THETA), path)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=said):
        load_learner(path)


def test_a_file_of_a_version_with_more_learners_is_taken_up(tmp_path):
    """It says of arms apart that they have no smoothness."""
    path, (_, cost) = tmp_path / "learner.json", planted()
    learner, _ = played(Learner.new("thompson", FIXATIONS, THETA, 4), 20, cost)
    save_learner(learner, path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"smoothness": None}))
    assert choose(load_learner(path)) == choose(learner)
