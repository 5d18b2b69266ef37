"""Very many episodes at once: the same as one by one, and calibrated where the model is right."""

from functools import cache

import numpy as np
import pytest
from array_device import ARRAYS, PLATFORM
from slow_cases import slow_but
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import perceive
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials import gpu as device
from solidtouch.inference.trials import kernel
from solidtouch.inference.trials import run as montecarlo
from solidtouch.inference.trials.records import (
    TapTable,
    TrialPlan,
    checked_plan,
    join_plans,
    plan_trials,
    tap_table,
    trial_uniforms,
)
from solidtouch.inference.trials.run import empty_trials, make_player, make_rule, run_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import tap_pool
from solidtouch.models.settings import PlaySettings

COUNT = np.array([[2, 0, 5], [1, 4, 3], [0, 6, 2], [3, 1, 0], [2, 2, 7]])
"""Test taps of each of 5 x 3 classes: unequal, and some without any."""
TRIALS, DEADLINE, SEED = 30, 23, 6
THETAS = (0.9, 0.35, 1.0, 0.6, 0.0, 0.97)


@pytest.fixture(scope="module")
def model(make_model):
    return make_model(5, 3, 2, 4, 6, seed=1, taps=20, pseudocount=0.5, power=0.15)


@pytest.fixture(scope="module")
def taps(model, taps_of_counts):
    return taps_of_counts(model, COUNT)


@pytest.fixture(scope="module")
def table(model, taps):
    return tap_table(model, taps)


@pytest.fixture(scope="module")
def plan(table):
    """Trials that start anywhere, also in classes without a tap, and aim for all classes."""
    rng = np.random.default_rng(3)
    return TrialPlan(
        rng.integers(5, size=TRIALS),
        rng.integers(3, size=TRIALS),
        rng.integers(5, size=TRIALS),
        rng.permutation(100)[:TRIALS],
        np.zeros(TRIALS, int),
    )


@pytest.fixture(scope="module")
def play(table, plan):
    """Runs the planned trials, each variant once."""

    @cache
    def run(theta_x=0.0, border="uniform", thetas=THETAS, deadline=DEADLINE, device="cpu", fresh=False):
        return run_trials(
            table,
            plan,
            thetas,
            play=PlaySettings(theta_x=theta_x, border=border, deadline=deadline),
            seed=SEED,
            device=device,
            fresh=fresh,
        )

    return run


def assert_same(expected, actual):
    for name in expected._fields:
        compare = np.testing.assert_allclose if name == "belief" else np.testing.assert_array_equal
        compare(getattr(actual, name), getattr(expected, name), err_msg=name)


VARIANTS = [(0.0, border) for border in BORDERS] + [(0.3, "uniform"), (0.6, "clamp"), (1.0, "uniform")]


@pytest.mark.parametrize(
    ("theta_x", "border"), slow_but([(0.0, "uniform"), (0.0, "prior"), (0.6, "clamp"), (1.0, "uniform")], VARIANTS)
)
def test_trials_are_episodes_on_the_same_taps(model, taps, plan, play, theta_x, border):
    """Every trial at every threshold is `perceive` on a replay rig with the numbers of its stream."""
    trials = play(theta_x, border)
    engine = make_engine("numpy", model, border)
    for i, (where, what, point, stream, _) in enumerate(zip(*plan, strict=True)):
        uniforms = trial_uniforms(SEED, stream, DEADLINE).tolist()
        for h, theta in enumerate(THETAS):
            rig = ReplayRig(taps, model.grid, where, what, iter(uniforms))
            episode = perceive(rig, engine, theta, fixation(point, theta_x), DEADLINE)
            expected = (
                episode.taps,
                episode.what,
                episode.where,
                rig.where_index,
                episode.stopped,
                rig.clamped,
                rig.substituted,
            )
            belief = np.exp(episode.log_beliefs[-1]).sum(axis=0).max()

            assert expected == tuple(field[i, h] for field in trials[:7])
            assert not trials.no_class_left[i, h]
            assert belief == pytest.approx(trials.belief[i, h], abs=1e-9)


def test_the_cases_above_are_not_trivial(play):
    """Some trials stop and some reach the deadline, some moves are clamped and some starts and moves substituted."""
    trials = play()
    passive = play(1.0)

    assert 0 < passive.stopped[:, 5].mean() < 1
    assert trials.clamped.max() > 0
    assert trials.substituted.max() > passive.substituted.max() == 1
    assert len(set(trials.taps[:, 0])) > 5
    assert passive.clamped.max() == 0


@pytest.mark.parametrize("fresh", [False, True])
@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("piece", [1, 7])
def test_trials_do_not_depend_on_pieces_and_threads(monkeypatch, table, plan, play, piece, workers, fresh):
    """How trials are cut into pieces and who plays them changes the speed only."""
    monkeypatch.setattr(montecarlo, "_AT_ONCE", piece)
    options = {"play": PlaySettings(theta_x=0.0, deadline=DEADLINE), "seed": SEED, "workers": workers, "fresh": fresh}

    assert_same(play(fresh=fresh), run_trials(table, plan, THETAS, **options))


def test_trials_are_played_by_class_some_at_a_time(table):
    """Of two blocks each trial is played once, and as in pieces that are shorter than one."""
    n = kernel._SORTED + 3
    plan = plan_trials(table.pool, n, SEED)
    order = kernel._by_class(checked_plan(plan, table.pool), 2, n, 5, 3)
    player = make_player(table, make_rule(THETAS, PlaySettings(deadline=3), SEED))
    whole, parts = (empty_trials(n, len(THETAS)) for _ in range(2))
    player(plan, 0, n, whole)
    for first in range(0, n, 1000):
        player(plan, first, min(first + 1000, n), parts)

    np.testing.assert_array_equal(np.sort(order[: kernel._SORTED]), 2 + np.arange(kernel._SORTED))
    np.testing.assert_array_equal(order[kernel._SORTED :], [n - 1])
    assert (np.diff(5 * plan.what[order] + plan.where[order])[: kernel._SORTED - 1] >= 0).all()
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("n", [1, 2, 1500, 4096, 100_000])
@pytest.mark.parametrize("threads", [1, 2, 5])
def test_pieces_get_smaller_to_the_end(n, threads):
    """All trials are in one; the last ones are not much longer than what is worth the way to a thread."""
    pieces = list(montecarlo._pieces(n, threads, 30_000))
    sizes = [last - first for first, last in pieces]

    assert [first for first, _ in pieces] + [n] == [0] + [last for _, last in pieces]
    assert sizes == sorted(sizes, reverse=True)
    assert 0 < max(sizes) <= 30_000
    assert len(sizes) >= min(n, threads)
    assert threads == 1 or sizes[-1] <= montecarlo._FEWEST


@pytest.mark.parametrize("theta_x", [0.0, 1.0])
def test_the_first_fresh_tap_is_that_of_trials_with_replacement(play, theta_x):
    """Later ones differ."""
    fresh, replaced = (play(theta_x, deadline=1, fresh=value) for value in (True, False))
    assert_same(fresh, replaced)
    assert not np.array_equal(play(theta_x, fresh=True).taps, play(theta_x).taps)


def test_fresh_trials_end_where_a_class_is_used_up(table, plan, play):
    """A passive trial has as many taps as its class at most, and with enough of them none is used up."""
    passive = play(1.0, fresh=True)
    count = table.pool.count[0, table.pool.nearest[0, plan.where, plan.what], plan.what]
    never = THETAS.index(1.0)

    assert passive.taps[:, never].tolist() == count.tolist()
    assert passive.used_up[:, never].all()
    assert not (passive.used_up & passive.stopped).any()
    assert not play(1.0).used_up.any()
    most = play(1.0, deadline=2, fresh=True)
    assert most.used_up[:, never].tolist() == (count < 2).tolist()
    where = np.where(np.arange(COUNT.sum()) < 35, np.arange(COUNT.sum()) % 5, -1)
    enough = table._replace(pool=tap_pool(where, 0 * where, (5, 3)))  # seven of each class
    start = plan._replace(what=0 * plan.what)
    for deadline, some in ((7, False), (8, True)):
        found = run_trials(
            enough, start, THETAS, play=PlaySettings(theta_x=1.0, deadline=deadline), seed=SEED, fresh=True
        )
        assert found.used_up.any() == some


def test_fresh_trials_are_played_on_the_processor_only(table, plan):
    with pytest.raises(InputError, match="on fresh taps require device cpu, got 'xla-cpu'"):
        run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.0), fresh=True, device="xla-cpu")


@pytest.mark.parametrize(
    ("theta_x", "border", "slots"),
    slow_but(
        [(0.0, "prior", 7), (*VARIANTS[-1], 64)], [*((*variant, 7) for variant in VARIANTS[:-1]), (*VARIANTS[-1], 64)]
    ),
)
def test_arrays_decide_as_loops_do(monkeypatch, play, theta_x, border, slots):
    """The code for GPUs: in slots that are refilled and in more slots than trials."""
    pytest.importorskip("jax")
    monkeypatch.setitem(device._SLOTS, PLATFORM, slots)

    assert_same(play(theta_x, border), play.__wrapped__(theta_x, border, device=ARRAYS))


@pytest.mark.parametrize("fresh", [False, True])
def test_trials_do_not_depend_on_their_company(table, plan, play, fresh):
    """A part of the plan gives that part of the trials; random numbers belong to streams, not to places."""
    chosen = np.arange(TRIALS)[::-2]
    part = run_trials(
        table,
        TrialPlan(*(field[chosen] for field in plan)),
        THETAS,
        play=PlaySettings(theta_x=0.0, deadline=DEADLINE),
        seed=SEED,
        fresh=fresh,
    )

    assert_same(type(part)(*(field[chosen] for field in play(fresh=fresh))), part)


@pytest.mark.parametrize("fresh", [False, True])
def test_one_trajectory_answers_every_threshold(play, fresh):
    """Each threshold alone gives its column."""
    together = play(fresh=fresh)
    for h, theta in enumerate(THETAS):
        alone = play(thetas=(theta,), fresh=fresh)
        assert_same(type(alone)(*(field[:, [h]] for field in together)), alone)


def test_thresholds_come_in_any_order(play):
    """Reversed thresholds give reversed columns."""
    assert_same(type(play())(*(field[:, ::-1] for field in play())), play(thetas=THETAS[::-1]))


def test_higher_thresholds_take_longer(play):
    """Trial by trial, along one trajectory."""
    taps = play().taps[:, np.argsort(THETAS)]

    assert (np.diff(taps, axis=1) >= 0).all()
    assert set(taps[:, 0]) == {1}
    assert set(taps[:, -1]) == {DEADLINE}


@pytest.mark.parametrize("theta", [1.0, 1.5, np.inf])
def test_thresholds_of_one_never_stop(play, theta):
    """The most probable classes are taken at the deadline."""
    trials = play(thetas=(theta,))

    assert not trials.stopped.any()
    assert (trials.taps == DEADLINE).all()


def test_a_deadline_of_one_tap(play):
    """Every trial ends with its first tap; those above the threshold count as stopped."""
    trials = play(deadline=1)

    assert (trials.taps == 1).all()
    np.testing.assert_array_equal(trials.stopped, trials.belief > np.where(np.array(THETAS) < 1, THETAS, np.inf))


def test_the_seed_decides(table, plan, play):
    """Another seed draws other taps."""
    other = run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.0, deadline=DEADLINE), seed=SEED + 1)

    assert not np.array_equal(other.taps, play().taps)


def test_progress_counts_every_trial(monkeypatch, table, plan):
    """The calls sum to the number of trials."""
    monkeypatch.setattr(montecarlo, "_AT_ONCE", 4)
    finished = []
    run_trials(
        table, plan, THETAS, play=PlaySettings(theta_x=0.0, deadline=DEADLINE), seed=SEED, progress=finished.append
    )

    assert sum(finished) == TRIALS
    assert len(finished) > 1


def test_trial_uniforms_are_prefixes_of_one_sequence():
    """Number t of a stream does not depend on how many are asked for."""
    numbers = trial_uniforms(4, 9, 7)

    assert numbers.dtype == np.float64
    assert ((numbers >= 0) & (numbers < 1)).all()
    np.testing.assert_array_equal(trial_uniforms(4, 9, 3), numbers[:3])
    assert len({*numbers, *trial_uniforms(4, 8, 7), *trial_uniforms(5, 9, 7)}) == 21


def test_one_class_is_decided_at_once(make_model):
    """With L = M = 1 the first tap settles it, unless the threshold is 1."""
    model = make_model(1, 1)
    table = TapTable(model.log_likelihood(np.zeros((2, 5, 2))), tap_pool([0, 0], [0, 0], (1, 1)), model.log_prior)
    trials = run_trials(table, plan_trials(table.pool, 3, 0), (0.995, 1.0), play=PlaySettings(theta_x=0.0, deadline=4))

    assert trials.taps.tolist() == [[1, 4]] * 3
    assert (trials.what == 0).all()
    assert trials.stopped.tolist() == [[True, False]] * 3


def impossible_table():
    """Two objects at one place: each tap of the second is impossible under one class or both."""
    log_likelihood = np.array([[[0.0, -np.inf]], [[-np.inf, 0.0]], [[0.0, -1.0]]])
    return TapTable(log_likelihood, tap_pool([0, 0, 0], [1, 1, 0], (1, 2)), np.log([[0.5, 0.5]]))


@pytest.mark.parametrize(
    ("deadline", "where_to"),
    slow_but([(2, "cpu"), (60, ARRAYS)], [(2, "cpu"), (2, ARRAYS), (60, "cpu"), (60, ARRAYS)]),
)
def test_an_impossible_tap_ends_the_trial_undecided(where_to, deadline):
    """With what was most probable before it, which may be the last tap before the deadline."""
    table = impossible_table()
    plan = TrialPlan(*np.array([[0] * 64, [1] * 64, [0] * 64, range(64), [0] * 64]))
    trials = run_trials(table, plan, (1.0, 0.4), play=PlaySettings(theta_x=1.0, deadline=deadline), device=where_to)
    drawn = [(2 * trial_uniforms(0, stream, deadline)).astype(int) for stream in range(64)]
    differ = np.array([len(set(taps)) > 1 for taps in drawn])
    first_other = np.array([(taps != taps[0]).argmax() + 1 for taps in drawn])

    assert 0 < differ.sum() < 64 or deadline > 2
    assert trials.no_class_left[:, 0].tolist() == differ.tolist()
    assert trials.taps[:, 0].tolist() == np.where(differ, first_other, deadline).tolist()
    assert trials.what[:, 0].tolist() == [taps[0] for taps in drawn]  # what the first tap left possible
    assert trials.belief[:, 0] == pytest.approx(1)
    assert not trials.stopped[:, 0].any()
    assert (trials.taps[:, 1] == 1).all()  # a threshold crossed before keeps its decision
    assert trials.stopped[:, 1].all()
    assert not trials.no_class_left[:, 1].any()


@pytest.mark.parametrize("where_to", ["cpu", ARRAYS])
def test_a_first_tap_may_be_impossible(where_to):
    """Also where it would have decided at once."""
    table = impossible_table()._replace(log_prior=np.array([[-np.inf, 0.0]]))
    table.log_likelihood[:] = [[0.0, -np.inf]]
    plan = TrialPlan(*np.array([[0] * 64, [1] * 64, [0] * 64, range(64), [0] * 64]))
    trials = run_trials(table, plan, (-1.0, 0.5), play=PlaySettings(theta_x=1.0, deadline=1), device=where_to)

    assert trials.no_class_left.all()
    assert (trials.taps == 1).all()
    assert (trials.what == 1).all()  # by the prior
    assert not trials.stopped.any()


def test_taps_after_the_decision_do_not_matter():
    """A trial that has decided never sees the impossible tap that would have followed."""
    trials = run_trials(
        impossible_table(),
        TrialPlan(*np.array([[0] * 4, [1] * 4, [0] * 4, range(4), [0] * 4])),
        (0.9,),
        play=PlaySettings(theta_x=1.0, deadline=60),
    )

    assert (trials.taps == 1).all()


def flat_table(L, M):
    """Two taps of every class that say nothing."""
    where, what = np.indices((L, M)).reshape(2, -1).repeat(2, axis=1)
    prior = np.full((L, M), -np.log(L * M))
    return TapTable(np.zeros((2 * L * M, L, M)), tap_pool(where, what, (L, M)), prior)


def first_class(trials):
    """A plan of trials that start in the first class and aim for the second position."""
    return TrialPlan(*np.array([[0] * trials, [0] * trials, [1] * trials, range(trials), [0] * trials]))


def test_a_threshold_that_is_met_exactly_goes_on():
    """The comparison is strict."""
    table = flat_table(2, 3)
    belief = run_trials(table, first_class(1), (1.0,), play=PlaySettings(theta_x=1.0, deadline=1)).belief[0, 0]
    trials = run_trials(
        table, first_class(1), (belief, np.nextafter(belief, 0.0)), play=PlaySettings(theta_x=1.0, deadline=1)
    )

    assert trials.stopped.tolist() == [[False, True]]


def test_a_move_needs_more_belief_than_its_threshold():
    """The sensor stays while the where belief is exactly theta_X."""
    table = flat_table(2, 3)
    theta_x = 0.5
    stays, moves = (
        run_trials(table, first_class(1), (1.0,), play=PlaySettings(theta_x=theta, deadline=2)).true_where[0, 0]
        for theta in (theta_x, theta_x - 1e-9)
    )

    assert (stays, moves) == (0, 1)


@pytest.mark.parametrize("where_to", ["cpu", ARRAYS])
def test_a_single_object_does_not_cross_a_threshold_of_one(where_to):
    """Every belief in it is one, up to the last digit, which may lie above."""
    rng = np.random.default_rng(0)
    log_likelihood = rng.normal(size=(400, 7, 1))
    table = TapTable(log_likelihood, tap_pool(np.arange(400) % 7, [0] * 400, (7, 1)), np.full((7, 1), -np.log(7)))
    trials = run_trials(
        table, plan_trials(table.pool, 300, 0), (1.0,), play=PlaySettings(theta_x=1.0, deadline=2), device=where_to
    )

    np.testing.assert_allclose(trials.belief, 1.0, rtol=1e-12)
    assert not trials.stopped.any()


def test_plans_start_uniformly_in_the_classes_with_a_tap(table):
    """Frequencies lie within five standard deviations, empty classes are never drawn."""
    n = 6000
    plan = plan_trials(table.pool, n, seed=1, fixation=2, first_stream=50)
    share = np.bincount(plan.where * 3 + plan.what, minlength=15).reshape(5, 3) / n
    expected = (COUNT > 0) / (COUNT > 0).sum()

    assert (np.abs(share - expected) <= 5 * np.sqrt(expected * (1 - expected) / n)).all()
    assert set(plan.fixation) == {2}
    assert plan.stream.tolist() == list(range(50, 50 + n))


def test_plans_of_one_position_start_there(table):
    """With all objects that have a tap there."""
    plan = plan_trials(table.pool, 50, seed=1, where=2)

    assert set(plan.where) == {2}
    assert set(plan.what) == {1, 2}


def test_joined_plans_stand_behind_one_another(table):
    """Field by field."""
    first, second = plan_trials(table.pool, 3, 0), plan_trials(table.pool, 4, 1, fixation=1, first_stream=3)
    joined = join_plans([first, second])

    assert joined.stream.tolist() == list(range(7))
    assert joined.fixation.tolist() == [0] * 3 + [1] * 4
    assert joined.where.tolist() == [*first.where, *second.where]


def test_plans_without_trials_or_taps_are_refused(table):
    """The message says which."""
    with pytest.raises(InputError, match="trials must be at least 1, got 0"):
        plan_trials(table.pool, 0, 0)
    with pytest.raises(InputError, match="Position 1 has no test tap"):
        plan_trials(tap_pool([0, 2], [0, 0], (3, 1)), 5, 0, where=1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"where": [0, 5]}, r"Trial 1 starts in class \(5, 1\), outside the 5 x 3 classes"),
        ({"what": [-1, 1]}, r"Trial 0 starts in class \(0, -1\)"),
        ({"where": [0]}, "columns of a plan differ in shape"),
    ],
)
def test_plans_that_cannot_be_played_are_refused(table, change, message):
    plan = TrialPlan(*np.array([[0, 4], [1, 1], [0, 0], [0, 1], [0, 0]]))._replace(**change)
    with pytest.raises(InputError, match=message):
        run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.0))


def test_objects_without_a_tap_are_refused():
    table = TapTable(np.zeros((1, 1, 2)), tap_pool([0], [0], (1, 2)), np.log([[0.5, 0.5]]))
    with pytest.raises(InputError, match="Trial 2 uses object 1, which has no test tap"):
        run_trials(
            table,
            TrialPlan(*np.array([[0] * 3, [0, 0, 1], [0] * 3, [0] * 3, [0] * 3])),
            (0.5,),
            play=PlaySettings(theta_x=0.0),
        )


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("part", ["log_likelihood", "log_prior"])
def test_tables_of_what_is_no_likelihood_are_refused(table, plan, part, value):
    wrong = getattr(table, part).copy()
    wrong.flat[3] = value
    with pytest.raises(InputError, match="contains NaN or"):
        run_trials(table._replace(**{part: wrong}), plan, THETAS, play=PlaySettings(theta_x=0.0))


@pytest.mark.parametrize("seed", [-1, 2**64, 0.5])
def test_seeds_out_of_range_are_refused(table, plan, seed):
    with pytest.raises(InputError, match="seed must be an integer from 0 to 18446744073709551615"):
        run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.0), seed=seed)


def test_streams_out_of_range_are_refused(table):
    with pytest.raises(InputError, match="Streams must be from 0 to"):
        plan_trials(table.pool, 2, 0, first_stream=2**63 - 2)
    assert plan_trials(table.pool, 2, 2**64 - 1, first_stream=2**63 - 3).stream[1] == 2**63 - 2


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"thresholds": ()}, "thresholds must have at least one value"),
        ({"thresholds": (0.5, np.nan)}, "and no NaN"),
        ({"device": "tpu"}, "device must be cpu, gpu or xla-cpu, got 'tpu'"),
        ({"workers": 0}, "workers must be at least 1, got 0"),
    ],
)
def test_arguments_out_of_range_are_refused(table, plan, more, message):
    """The message shows what was given."""
    arguments = {"thresholds": THETAS, "play": PlaySettings(theta_x=0.0, deadline=DEADLINE)} | more
    with pytest.raises(InputError, match=message):
        run_trials(table, plan, **arguments)


@pytest.mark.parametrize("theta_x", [0.0, 1.0], ids=["active", "passive"])
def test_belief_at_stopping_is_the_chance_of_being_right(make_model, theta_x):
    """On data that fulfil the model, with power 1 and clamped moves, errors are as frequent as the beliefs say.

    By Bayes' rule P(wrong) = E[1 - belief at stopping] for any stopping rule and any moves that depend on past taps
    only, and so at most 1 - theta among the trials that stopped.
    """
    n, thetas = 6000, (0.5, 0.8, 0.95)
    model = make_model(5, 3, 2, 4, 6, seed=2, taps=50, pseudocount=100.0, power="none")
    taps = draw_taps(model.grid, model.probabilities, model.edges, model.preprocessing, 1500, seed=1)
    table = tap_table(model, taps)
    plan = plan_trials(table.pool, n, seed=2, fixation=2)
    trials = run_trials(table, plan, thetas, play=PlaySettings(theta_x=theta_x, border="clamp"), seed=4)
    wrong = trials.what != plan.what[:, None]
    doubt = 1 - trials.belief

    for h, theta in enumerate(thetas):
        stopped = trials.stopped[:, h]
        difference = (wrong[:, h] - doubt[:, h])[stopped]
        assert stopped.mean() > 0.9
        assert wrong[stopped, h].sum() > 30
        assert abs(difference.mean()) < 4 * difference.std() / np.sqrt(stopped.sum())
        assert doubt[stopped, h].max() < 1 - theta
