"""Trials in step: under the paper's strategies those of the compiled loops, under any strategy single episodes."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference import reference
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import perceive
from solidtouch.inference.moves.control import bounded, fixation, passive, random_place, random_step
from solidtouch.inference.moves.shifts import log_sum
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.stopping.recorded import stops
from solidtouch.inference.stopping.stopping import DECIDE, GO_ON, what_above
from solidtouch.inference.trials.lockstep import play, shift_beliefs
from solidtouch.inference.trials.records import TapTable, TrialPlan, tap_table, trial_chances, trial_uniforms
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import tap_pool
from solidtouch.models.measurement.states import States
from solidtouch.models.settings import PlaySettings

L, M, S = 5, 3, 2
COUNT = np.array([[2, 0, 5], [1, 4, 3], [0, 6, 2], [3, 1, 0], [2, 2, 7]])
"""Test taps of each class: unequal, and some without any."""
TRIALS, DEADLINE, SEED, POINT = 60, 17, 6, 3
THETAS = (0.9, 0.35, 1.0, 0.6, 0.0, 0.97)
KINDS = ("plain", "states", "saturated", "saturated states")
STRATEGIES = {
    "random place": random_place(),
    "random step": random_step(2),
    "bounded": bounded(fixation(POINT), 1),
    "by the belief in objects": lambda beliefs, chance: np.where(
        chance < 0.8, beliefs.sum(axis=-2).argmax(axis=-1) - 1, 0
    ),
}


@pytest.fixture(scope="module")
def models(make_model):
    model = make_model(L, M, 2, 4, 6, seed=1, taps=20, pseudocount=0.5, power=0.15)
    states = States(np.array([0.8, 1.3]), np.array([0.1, -0.2]), np.log([0.4, 0.6]))
    saturated = replace(model, saturation=3.5)
    made = (model, replace(model, states=states), saturated, replace(saturated, states=states))
    return dict(zip(KINDS, made, strict=True))


@pytest.fixture(scope="module")
def taps(models, taps_of_counts):
    return taps_of_counts(models["plain"], COUNT)


@pytest.fixture(scope="module")
def tables(models, taps):
    return {kind: tap_table(models[kind], taps) for kind in KINDS}


@pytest.fixture(scope="module")
def plan():
    """Trials that start anywhere, also in classes without a tap."""
    rng = np.random.default_rng(3)
    where, what = rng.integers(L, size=TRIALS), rng.integers(M, size=TRIALS)
    return TrialPlan(where, what, np.full(TRIALS, POINT), rng.permutation(100)[:TRIALS], 0 * where)


@pytest.fixture(scope="module")
def played(tables, plan):
    """Plays the plan, each variant once."""

    @cache
    def run(kind="plain", theta_x=0.0, border="uniform"):
        policy = passive() if theta_x == 1 else fixation(POINT, theta_x)
        return play(tables[kind], plan, policy, border=border, deadline=DEADLINE, seed=SEED)

    return run


def at_stop(record, theta):
    """What a record says of the trials at a threshold, as fields of `Trials`."""
    taken, answer = stops(what_above(theta), record)
    at = np.arange(len(taken)), taken - 1
    return {
        "taps": taken,
        "what": record.what[at],
        "where": record.where[at],
        "true_where": record.at[at],
        "stopped": answer == DECIDE,
        "clamped": record.clamped[at],
        "substituted": record.substituted[at],
        "belief": record.what_belief[at],
    }


def assert_same(found, trials, h):
    for name, values in found.items():
        compare = np.testing.assert_allclose if name == "belief" else np.testing.assert_array_equal
        compare(values, getattr(trials, name)[:, h], err_msg=name)


VARIANTS = [
    (kind, border, theta_x)
    for kind in KINDS
    for border in BORDERS
    for theta_x in (0.0, 0.4, 1.0)
    if border != "prior" or "states" not in kind
]


@pytest.mark.parametrize(("kind", "border", "theta_x"), VARIANTS)
def test_the_papers_strategies_play_the_compiled_trials(tables, plan, played, kind, border, theta_x):
    """Every trial at every threshold: taps, decisions, places, beliefs, and what the ends of the range did."""
    compiled = run_trials(
        tables[kind],
        plan,
        THETAS,
        play=PlaySettings(theta_x=theta_x, border=border, deadline=DEADLINE),
        seed=SEED,
        workers=1,
    )
    record = played(kind, theta_x, border)
    for h, theta in enumerate(THETAS):
        assert_same(at_stop(record, theta), compiled, h)


def test_the_trials_above_are_not_trivial(played):
    """Some stop and some do not, moves are cut short, classes are replaced, and what is varied makes a difference."""
    records = [played(kind) for kind in KINDS] + [played(border="clamp"), played(theta_x=0.4), played(theta_x=1.0)]
    stopped = at_stop(records[0], 0.9)["stopped"]

    assert 0.1 < stopped.mean() < 1
    assert records[0].clamped.max() > 0
    assert records[0].substituted.max() > 1
    assert len({record.what_belief.sum() for record in records}) == len(records)


@pytest.mark.parametrize(
    ("name", "border", "kind"),
    slow_but(
        [(name, *case) for name in STRATEGIES for case in [("uniform", "plain"), ("clamp", "saturated states")]],
        list(product(STRATEGIES, ["uniform", "clamp"], ["plain", "saturated states"])),
    ),
)
def test_trials_are_episodes_under_any_strategy(models, taps, tables, plan, kind, border, name):
    """`perceive` on a replay rig with the numbers of the trial's stream, also those that the strategy draws with."""
    policy, theta = STRATEGIES[name], 0.9
    record = play(tables[kind], plan, policy, border=border, deadline=DEADLINE, seed=SEED)
    found, engine = at_stop(record, theta), make_engine("filter", models[kind], border)
    for i, (where, what, _, stream, _) in enumerate(zip(*(column[:20] for column in plan), strict=True)):
        rig = ReplayRig(taps, models[kind].grid, where, what, iter(trial_uniforms(SEED, stream, DEADLINE)))
        began, chance = rig.where_index, iter(trial_chances(SEED, stream, DEADLINE))
        episode = perceive(rig, engine, theta, policy, DEADLINE, chance=chance)
        last = episode.taps - 1
        expected = {
            "taps": episode.taps,
            "what": episode.what,
            "where": episode.where,
            "true_where": rig.where_index,
            "stopped": episode.stopped,
            "clamped": rig.clamped,
            "substituted": rig.substituted,
            "belief": pytest.approx(np.exp(episode.log_beliefs[-1]).sum(axis=0).max(), abs=1e-9),
        }

        assert {field: values[i] for field, values in found.items()} == expected
        assert record.moves[i, :last].tolist() == episode.moves.tolist()
        assert record.travelled[i, last] == np.abs(episode.realised).sum()
        assert record.at[i, last] - began == episode.realised.sum()
        wheres = np.exp(episode.log_beliefs).sum(axis=2).max(axis=1)
        np.testing.assert_allclose(record.where_belief[i, : last + 1], wheres, atol=1e-9)


@pytest.mark.parametrize("border", BORDERS)
def test_shifts_are_those_of_the_reference(rng, border):
    """Each belief by its own move, also one that pushes everything out."""
    delta = np.arange(-L, L + 1)
    delta = delta[delta != 0]
    beliefs = np.log(rng.dirichlet(np.ones(L * M), size=len(delta))).reshape(-1, L, M)
    beliefs[0, 1] = -np.inf
    expected = [reference.shift_log(belief, int(d), border) for belief, d in zip(beliefs, delta, strict=True)]
    shifted = shift_beliefs(beliefs - log_sum(beliefs, (1, 2)), delta, border)
    np.testing.assert_allclose(np.exp(shifted), np.exp(expected), atol=1e-12)


def test_random_numbers_belong_to_the_trial_not_to_the_batch(tables, plan):
    """A part of a plan in another order is played the same, so strategies compare in pairs."""
    rows = np.random.default_rng(1).permutation(TRIALS)[:13]
    part = TrialPlan(*(column[rows] for column in plan))
    whole, some = (play(tables["plain"], p, random_place(), deadline=9, seed=SEED) for p in (plan, part))
    for name in whole._fields[:-2]:
        np.testing.assert_allclose(getattr(some, name), getattr(whole, name)[rows], rtol=1e-12, err_msg=name)


def test_numbers_of_strategies_are_not_those_that_draw_taps():
    """Nor are they the same in every stream, for every seed, and they fill the unit interval."""
    streams = np.array([trial_chances(SEED, stream, 500) for stream in range(20)])

    assert not np.isin(streams, trial_uniforms(SEED, 3, 500)).any()
    assert len(np.unique(streams)) > 0.999 * streams.size
    assert not np.isin(streams, trial_chances(SEED + 1, 3, 500)).any()
    assert streams.mean() == pytest.approx(0.5, abs=4 / np.sqrt(12 * streams.size))


@pytest.mark.parametrize("theta", [0.6, 0.97])
def test_trials_that_end_early_are_the_same_up_to_there(tables, plan, theta):
    """So `enough` only saves work; values behind the last tap are repeated and nothing is commanded there."""
    whole = play(tables["plain"], plan, random_step(1), deadline=DEADLINE, seed=SEED)
    short = play(tables["plain"], plan, random_step(1), deadline=DEADLINE, seed=SEED, enough=theta)
    for smaller in (0.5, theta):
        for name, values in at_stop(short, smaller).items():
            np.testing.assert_allclose(values, at_stop(whole, smaller)[name], rtol=1e-12, err_msg=name)

    assert (short.length < DEADLINE).any()
    assert short.length.tolist() == at_stop(whole, theta)["taps"].tolist()
    behind = np.arange(short.where.shape[1]) >= short.length[:, np.newaxis]
    assert not short.moves[behind].any()
    last = np.take_along_axis(short.what_belief, short.length[:, np.newaxis] - 1, axis=1)
    np.testing.assert_array_equal(np.where(behind, short.what_belief, last), np.broadcast_to(last, behind.shape))
    assert stops(what_above(0.999), short).answer[short.length < DEADLINE].tolist().count(GO_ON) > 0


def test_a_watch_sees_every_belief_and_the_move_that_follows(tables, plan):
    record = play(
        tables["plain"],
        plan,
        fixation(POINT),
        deadline=6,
        seed=SEED,
        watch=lambda beliefs, moves: {"move": moves.astype(float), "where": beliefs.sum(axis=2).max(axis=1)},
    )

    np.testing.assert_array_equal(record.watched["where"], record.where_belief)
    np.testing.assert_array_equal(record.watched["move"], POINT - record.where)
    np.testing.assert_array_equal(record.moves[:, :-1], record.watched["move"][:, :-1])


def test_progress_counts_every_trial_once(tables, plan):
    told = []
    play(tables["plain"], plan, passive(), deadline=9, seed=SEED, enough=0.9, progress=told.append)

    assert sum(told) == TRIALS
    assert len(told) > 1


def test_trials_in_which_no_class_is_left_end():
    """As those of `run_trials` do, with the belief before that tap."""
    log_likelihood = np.zeros((2, L, M))
    log_likelihood[1] = -np.inf
    log_likelihood[1, 0, 0] = 0.0
    prior = np.where(np.arange(L)[:, np.newaxis] > 0, np.full((L, M), -np.log((L - 1) * M)), -np.inf)
    pool = tap_pool(np.array([0, 1]), np.array([0, 1]), (L, M))
    start = np.array([0, 1])
    table, plan = TapTable(log_likelihood, pool, prior), TrialPlan(start, start, start, start, 0 * start)
    record = play(table, plan, passive(), deadline=3)

    assert record.no_class_left.tolist() == [False, True]
    assert record.length.tolist() == [3, 1]
    np.testing.assert_allclose(record.what_marginal[1], np.exp(prior).sum(axis=0)[np.newaxis].repeat(3, axis=0))
    assert stops(what_above(0.0), record).answer.tolist() == [DECIDE, GO_ON]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"deadline": 0}, "deadline must be at least 1 tap, got 0"),
        ({"seed": -1}, "seed must be"),
    ],
)
def test_what_makes_no_sense_is_refused(tables, plan, change, message):
    with pytest.raises(InputError, match=message):
        play(tables["plain"], plan, passive(), **change)


def test_the_border_prior_and_states_do_not_go_together(tables, plan):
    with pytest.raises(InputError, match="does not support models that carry a state"):
        play(tables["states"], plan, passive(), border="prior")
