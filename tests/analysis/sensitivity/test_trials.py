"""Trials under any reading: at the defaults those of the compiled loops, elsewhere those of the equations."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.sensitivity.choices import Reading
from solidtouch.analysis.sensitivity.trials import play_open
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.inference import reference
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials.records import TapTable, TrialPlan, plan_trials, tap_table, trial_uniforms
from solidtouch.inference.trials.run import THRESHOLDS, run_trials
from solidtouch.models.grid import tap_pool
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.settings import PlaySettings

L, M, TRIALS, DEADLINE, SEED = 5, 3, 30, 17, 4
COUNT = np.array([[2, 0, 5], [1, 4, 3], [0, 6, 2], [3, 1, 0], [2, 2, 7]])
"""Test taps of each class: unequal, and some without any."""
THETAS = (0.9, 0.35, 1.0, 0.6, 0.97)
READING = Reading(deadline=DEADLINE)


@pytest.fixture(scope="module")
def table():
    """Likelihoods that tell classes apart a little, so that trials last and beliefs are often wrong; two sessions."""
    rng = np.random.default_rng(0)
    cells = rng.permutation(np.repeat(np.argwhere(COUNT >= 0), COUNT.ravel(), axis=0))
    log_likelihood = rng.normal(scale=1.2, size=(len(cells), L, M))
    log_likelihood[np.arange(len(cells)), cells[:, 0], cells[:, 1]] += 0.8
    session = np.arange(len(cells)) % 2 * (cells[:, 0] > 0)
    return TapTable(log_likelihood, tap_pool(*cells.T, (L, M), session), np.full((L, M), -np.log(L * M)))


@pytest.fixture(scope="module")
def plan():
    rng = np.random.default_rng(3)
    return TrialPlan(
        rng.integers(L, size=TRIALS),
        rng.integers(M, size=TRIALS),
        rng.integers(L, size=TRIALS),
        rng.permutation(100)[:TRIALS],
        rng.integers(2, size=TRIALS),
    )


def assert_same(expected, actual):
    for name in expected._fields:
        compare = np.testing.assert_allclose if name == "belief" else np.testing.assert_array_equal
        compare(getattr(actual, name), getattr(expected, name), err_msg=name)


EACH_BORDER = [
    ("uniform", 0.0),
    ("uniform", 1.0),
    ("uniform_what", 0.4),
    ("prior", 1.0),
    ("clamp", 0.0),
    ("circular", 0.4),
]


@pytest.mark.parametrize(("border", "theta_x"), slow_but(EACH_BORDER, product(BORDERS, (0.0, 0.4, 1.0))))
def test_defaults_are_the_compiled_trials(table, plan, border, theta_x):
    """Where the compiled loops know a reading, every number of every trial is theirs."""
    compiled = run_trials(
        table, plan, THETAS, play=PlaySettings(theta_x=theta_x, border=border, deadline=DEADLINE), seed=SEED
    )
    done = play_open(table, plan, THETAS, replace(READING, border=border), theta_x, SEED)
    assert_same(compiled, done.trials)
    assert not done.impossible.any()


@pytest.mark.parametrize("border", BORDERS)
def test_defaults_are_the_compiled_trials_where_classes_are_untrained(table, plan, border):
    trained = np.ones((L, M), np.bool_)
    trained[1, 0] = trained[3, 2] = False
    holed = table._replace(
        log_prior=np.where(trained, -np.log(trained.sum()), -np.inf),
        log_likelihood=np.where(trained, table.log_likelihood, -np.inf),
    )
    compiled = run_trials(holed, plan, THETAS, play=PlaySettings(border=border, deadline=DEADLINE), seed=SEED)
    done = play_open(holed, plan, THETAS, replace(READING, border=border), 0.0, SEED)
    assert compiled.taps.max() > 3
    assert_same(compiled, done.trials)


def test_defaults_decide_the_same_on_the_simulated_rig():
    """So they do at the paper's sizes, at all thresholds."""
    train, test = (simulate_session(preset("paper"), 3, session) for session in (0, 1))
    table = tap_table(fit(train, train.grid()), test)
    plan = plan_trials(table.pool, 200, SEED, 7)
    for theta_x in (0.0, 1.0):
        compiled = run_trials(table, plan, THRESHOLDS, play=PlaySettings(theta_x=theta_x), seed=SEED)
        assert_same(compiled, play_open(table, plan, THRESHOLDS, Reading(), theta_x, SEED).trials)


def slow(table, reading, where, what, point, session, uniforms, theta, theta_x):
    """One trial by the reference equations, a tap at a time: what is decided, where, the place, taps, shifts in all."""
    pool, belief, shifted = table.pool, np.exp(table.log_prior), 0
    at, number, tap = int(pool.nearest[session, where, what]), 0, 0
    for number in range(reading.deadline):
        tap = pool.pick(at, what, uniforms[number], session)
        belief, _ = reference.update(belief, table.log_likelihood[tap])
        last = number == reading.deadline - 1
        stop = reference.what_decision(belief, theta) is not None
        if reading.order == "before" and (stop or last):
            break
        seen = reference.where_decision(belief, theta_x)
        delta = 0 if seen is None else reference.fixation_move(seen, point)
        if reading.clamping == "refused" and not 0 <= at + delta < L:
            delta = 0
        new = int(pool.nearest[session, min(max(at + delta, 0), L - 1), what])
        moved = new - at if reading.clamping == "real" else delta
        if moved:
            belief = reference.shift(belief, moved, reading.border)
        at, shifted = new, shifted + moved
        if reading.order == "after" and (reference.what_decision(belief, theta) is not None or last):
            break
    decided = int(belief.sum(axis=0).argmax()), int(belief.sum(axis=1).argmax())
    return (*decided, at, number + 1, shifted, tap)


@pytest.mark.parametrize("border", ["uniform", "clamp", "prior"])
@pytest.mark.parametrize(
    "change",
    [{"order": "after"}, {"clamping": "real"}, {"clamping": "refused"}, {"order": "after", "clamping": "real"}],
    ids=str,
)
def test_other_readings_are_the_equations_in_another_order(table, plan, change, border):
    """Every trial is what the reference equations give, one tap at a time."""
    reading, theta_x = replace(READING, border=border, **change), 0.3
    done = play_open(table, plan, THETAS, reading, theta_x, SEED)
    default = play_open(table, plan, THETAS, replace(READING, border=border), theta_x, SEED)
    assert (done.trials.where != default.trials.where).any()
    for i, (where, what, point, stream, session) in enumerate(zip(*plan, strict=True)):
        uniforms = trial_uniforms(SEED, stream, DEADLINE)
        for h, theta in enumerate(THETAS):
            expected = slow(table, reading, where, what, point, session, uniforms, theta, theta_x)
            trials = done.trials
            fields = (trials.what, trials.where, trials.true_where, trials.taps, done.shifted, done.tap)
            assert expected == tuple(field[i, h] for field in fields)


def test_taps_without_replacement_come_once_each_and_then_anew(table):
    """Of a class of 5 taps the first five differ, and so do the next five; the first is that with replacement."""
    plan = TrialPlan(np.zeros(20, int), np.full(20, 2), np.zeros(20, int), np.arange(20), np.zeros(20, int))
    reading = Reading(replacement=False)
    drawn = np.column_stack(
        [play_open(table, plan, [1.0], replace(reading, deadline=n), 1.0, SEED).tap[:, 0] for n in range(1, 11)]
    )
    own = np.sort(table.pool.order[table.pool.first[0, 0, 2] :][:5])
    np.testing.assert_array_equal(np.sort(drawn[:, :5], axis=1), np.tile(own, (20, 1)))
    np.testing.assert_array_equal(np.sort(drawn[:, 5:], axis=1), np.tile(own, (20, 1)))
    assert (drawn[:, :5] != drawn[:, 5:]).any()
    first = play_open(table, plan, [1.0], Reading(deadline=1), 1.0, SEED).tap[:, 0]
    np.testing.assert_array_equal(drawn[:, 0], first)


def test_an_impossible_tap_ends_a_trial_with_what_was_believed_before(table):
    """It is counted, and no threshold counts as crossed by it."""
    broken = table.log_likelihood.copy()
    second = table.pool.order[table.pool.first[0, 0, 0] :][:2]
    broken[second[0]] = -np.inf
    plan = TrialPlan(np.zeros(30, int), np.zeros(30, int), np.zeros(30, int), np.arange(30), np.zeros(30, int))
    done = play_open(table._replace(log_likelihood=broken), plan, [0.0, 1.0], READING, 1.0, SEED)
    first_broken = np.array([trial_uniforms(SEED, i, 1)[0] < 0.5 for i in range(30)])
    assert done.impossible.sum() > first_broken.sum() > 0
    np.testing.assert_array_equal(done.trials.stopped[:, 0], ~first_broken)
    assert not done.trials.stopped[done.impossible, 1].any()
    np.testing.assert_allclose(done.trials.belief[first_broken], 1 / M)
    later = done.impossible & ~first_broken
    good = np.exp(table.log_likelihood[second[1]])
    belief = good ** (done.trials.taps[later, 1, None, None] - 1)
    belief = (belief / belief.sum(axis=(1, 2), keepdims=True)).sum(axis=1).max(axis=1)
    np.testing.assert_allclose(done.trials.belief[later, 1], belief)
