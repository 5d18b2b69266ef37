"""The compiled trials against the reference equations on log beliefs: any sizes, any depth, any length."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_trials import random_plan, random_table
from slow_cases import slow_but
from solidtouch.inference import reference
from solidtouch.inference.engines.compiled import likelihoods, scaled_belief
from solidtouch.inference.filter import share, temper
from solidtouch.inference.reference import BORDERS, ZeroEvidenceError
from solidtouch.inference.trials import scaled
from solidtouch.inference.trials.records import TapTable, TrialPlan, trial_uniforms
from solidtouch.inference.trials.run import run_trials
from solidtouch.models import seeds
from solidtouch.models.grid import tap_pool
from solidtouch.models.settings import PlaySettings
from solidtouch.models.vectors import PART

NEAR_TIE = 1e-6


def margin(values, threshold):
    """How far a decision on these values is from another one."""
    ordered = np.sort(values)[::-1]
    gap = ordered[0] - ordered[1] if len(ordered) > 1 else np.inf
    return min(gap, abs(ordered[0] - threshold))


class Trial:
    """One trial with the reference equations, until all thresholds have decided."""

    def __init__(self, table, where, what, fixation, stream, session, thresholds, theta_x, border, deadline, seed):
        self.rows, self.margins = {}, []
        uniforms = trial_uniforms(seed, stream, deadline)
        log_belief, at, open_ = table.log_prior, int(table.pool.nearest[session, where, what]), list(thresholds)
        for tap, uniform in enumerate(uniforms):
            none_left = False
            try:
                index = table.pool.pick(at, what, uniform, session)
                log_belief, _ = reference.update_log(log_belief, table.log_likelihood[index])
            except ZeroEvidenceError:
                none_left = True
            belief = np.exp(temper(log_belief, share(tap + 1 - none_left, table.saturation)))
            where_marginal, what_marginal = reference.where_marginal(belief), reference.what_marginal(belief)
            self.margins.append(
                min([margin(what_marginal, theta) for theta in open_] + [margin(where_marginal, theta_x)])
            )
            for theta in list(open_):
                decision = None if none_left else reference.what_decision(belief, theta)
                if decision is not None or none_left or tap == deadline - 1:
                    open_.remove(theta)
                    self.rows[theta] = (
                        tap + 1,
                        int(what_marginal.argmax()),
                        int(where_marginal.argmax()),
                        at,
                        decision is not None,
                        none_left,
                        what_marginal.max(),
                    )
            if not open_:
                return
            believed = reference.where_decision(belief, theta_x)
            if believed is not None:
                delta = reference.fixation_move(believed, fixation)
                log_belief = reference.shift_log(log_belief, delta, border, table.trained)
                at = int(table.pool.nearest[session, min(max(at + delta, 0), len(belief) - 1), what])


def assert_same(table, plan, thresholds, theta_x, border, deadline, seed, tolerance=1e-10):
    """Every trial decides as the reference does; those with a near-tie on their way are counted and returned."""
    trials = run_trials(
        table, plan, thresholds, play=PlaySettings(theta_x=theta_x, border=border, deadline=deadline), seed=seed
    )
    near = 0
    for i, row in enumerate(zip(*plan, strict=True)):
        expected = Trial(table, *(int(v) for v in row), thresholds, theta_x, border, deadline, seed)
        for h, theta in enumerate(thresholds):
            *decision, belief = expected.rows[theta]
            fields = trials.taps, trials.what, trials.where, trials.true_where, trials.stopped, trials.no_class_left
            decided = [int(field[i, h]) for field in fields]
            same = decided == decision
            if not same or trials.belief[i, h] != pytest.approx(belief, abs=tolerance):
                assert min(expected.margins[: max(decision[0], decided[0])]) < NEAR_TIE
                near += 1
    return near


@settings(max_examples=60, deadline=None)
@given(
    L=st.integers(1, 9) | st.just(PART),
    M=st.integers(1, 7),
    depth=st.sampled_from([0.1, 1.0, 30.0, 400.0, 1e4]),
    impossible=st.sampled_from([0.0, 0.0, 0.05, 0.5]),
    empty=st.sampled_from([0.0, 0.2, 0.6]),
    border=st.sampled_from(BORDERS),
    theta_x=st.sampled_from([0.0, 0.0, 0.4, 0.9, 1.0]),
    deadline=st.integers(1, 60),
    saturation=st.sampled_from([np.inf, np.inf, 0.5, 2.0, 10.0]),
    S=st.integers(1, 4),
    seed=st.integers(0, 2**32 - 1),
)
def test_trials_of_any_size_and_depth_are_those_of_the_reference(
    L, M, depth, impossible, empty, border, theta_x, deadline, saturation, S, seed
):
    """Depths reach ten thousand nats between neighbouring classes, far below what a floating-point number holds."""
    rng = np.random.default_rng(seed)
    table = random_table(rng, L, M, depth, impossible, int(rng.integers(1, 30)), empty, S)
    table = table._replace(saturation=saturation)
    plan = random_plan(rng, table, 5)
    thresholds = (0.3, 0.9, 1.0, 0.999)
    assert_same(table, plan, thresholds, theta_x, border, deadline, seed)


@pytest.mark.parametrize("theta_x", [0.4, 0.9])
@pytest.mark.parametrize("depth", [30.0, 400.0])
def test_positions_are_summed_anew_where_a_belief_is_rescaled(depth, theta_x):
    """Sixteen of them are summed with the product, before it is known that the belief has to be scaled up."""
    for seed in (0, 5):
        rng = np.random.default_rng(seed)
        table = random_table(rng, PART, 3, depth, 0.0, int(rng.integers(1, 30)), 0.0, 1)
        plan = random_plan(rng, table, 5)
        assert assert_same(table, plan, (0.3, 0.9, 1.0, 0.999), theta_x, "clamp", 60, seed) == 0


@pytest.mark.parametrize("saturation", [0.3, 1.5])
@pytest.mark.parametrize("depth", [20.0, 60.0])
def test_beliefs_to_a_power_count_the_smallest_classes(depth, saturation):
    """Evidence of many taps leaves classes e^-500 apart, which a power of a thirtieth brings close again."""
    rng = np.random.default_rng(8)
    table = random_table(rng, 6, 3, depth, 0.0, 20)._replace(saturation=saturation)
    plan = random_plan(rng, table, 5)
    for deadline in range(2, 40, 3):
        assert assert_same(table, plan, (1.0,), 0.4, "uniform", deadline, seed=deadline) == 0


def fresh_trial(table, where, what, fixation, stream, session, thresholds, theta_x, border, deadline, seed):
    """A trial on fresh taps by the reference equations: its taps in order, and its row at each threshold.

    Each tap takes one of those that are left of the class, which then stand in the order of Fisher and Yates.
    """
    pool, words = table.pool, seeds.words(seed, stream, seeds.TAPS, 0, deadline)[0]
    L = len(table.log_prior)
    first, count = pool.first[session, :, what], pool.count[session, :, what]
    left = [pool.order[f : f + n].tolist() for f, n in zip(first, count, strict=True)]
    log_belief, at, open_, rows, drawn = (
        table.log_prior,
        int(pool.nearest[session, where, what]),
        list(thresholds),
        {},
        [],
    )
    clamped, substituted, row, near = 0, int(at != where), (), np.inf
    for tap, word in enumerate(words.tolist()):
        if not left[at]:
            return drawn, rows | dict.fromkeys(open_, (*row[:4], False, *row[5:], row[4], True)), near
        chosen = word * len(left[at]) >> 32
        left[at][0], left[at][chosen] = left[at][chosen], left[at][0]
        drawn.append(int(left[at].pop(0)))
        log_belief, _ = reference.update_log(log_belief, table.log_likelihood[drawn[-1]])
        belief = np.exp(log_belief)
        where_marginal, what_marginal = reference.where_marginal(belief), reference.what_marginal(belief)
        near = min([near, margin(where_marginal, theta_x)] + [margin(what_marginal, theta) for theta in open_])
        row = (tap + 1, int(what_marginal.argmax()), int(where_marginal.argmax()), at, what_marginal.max())
        row = (*row, clamped, substituted)  # before this tap; a move that no tap follows is no part of the trial
        for theta in list(open_):
            stops = reference.what_decision(belief, theta) is not None
            if stops or tap == deadline - 1:
                open_.remove(theta)
                rows[theta] = (*row[:4], stops, *row[5:], row[4], False)
        believed = reference.where_decision(belief, theta_x) if open_ else None
        if not open_:
            break
        if believed is not None:
            delta = reference.fixation_move(believed, fixation)
            log_belief = reference.shift_log(log_belief, delta, border)
            reached = min(max(at + delta, 0), L - 1)
            clamped += reached != at + delta
            at = int(pool.nearest[session, reached, what])
            substituted += at != reached
    return drawn, rows, near


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize(("L", "theta_x"), [(6, 0.0), (6, 0.4), (6, 1.0), (PART, 0.0)])
def test_trials_on_fresh_taps_are_those_of_the_reference(border, L, theta_x):
    """Classes of 0, 1, 2, 5 and 9 taps: trials stop, meet the deadline or use their class up; none repeats a tap."""
    rng = np.random.default_rng(11)
    M, deadline, thresholds = 3, 7, (0.97, 0.4, 1.0, 0.8)
    count = rng.permuted(np.tile(np.resize([0, 1, 2, 5, 9, 5], L), (M, 1)), axis=1).T
    where, what = np.repeat(np.argwhere(count >= 0), count.ravel(), axis=0).T
    shuffled = rng.permutation(len(where))
    where, what = where[shuffled], what[shuffled]
    session = np.arange(len(where)) % 4 == 0  # a quarter of the taps, so that many classes have one there, or none
    log_likelihood = 0.8 * rng.normal(size=(len(where), L, M))
    log_likelihood[np.arange(len(where)), where, what] += 0.7
    table = TapTable(log_likelihood, tap_pool(where, what, (L, M), session), np.full((L, M), -np.log(L * M)))
    plan = random_plan(rng, table, 150)
    trials = run_trials(
        table,
        plan,
        thresholds,
        play=PlaySettings(theta_x=theta_x, border=border, deadline=deadline),
        seed=5,
        fresh=True,
        workers=1,
    )
    used, by_deadline, visited = 0, 0, 0
    for i, row in enumerate(zip(*plan, strict=True)):
        drawn, rows, near = fresh_trial(table, *row, thresholds, theta_x, border, deadline, 5)
        assert len(set(drawn)) == len(drawn)
        assert (session[drawn] == plan.session[i]).all()
        assert near > 1e-12
        for h, theta in enumerate(thresholds):
            *decided, belief, used_up = rows[theta]
            fields = (getattr(trials, name)[i, h] for name in trials._fields)
            *actual, actual_belief, actual_used_up, no_class_left = fields
            assert not no_class_left
            assert actual == decided
            assert actual_used_up == used_up
            assert actual_belief == pytest.approx(belief, abs=1e-12)
            used += used_up
            by_deadline += not (rows[theta][4] or used_up)
        visited += len(set(where[drawn])) > 1

    assert used > 50
    assert by_deadline > 20
    assert (visited > 20) == (theta_x < 1)
    assert trials.stopped.any()
    if theta_x == 0:
        assert trials.clamped.max() > 0
        assert trials.substituted.max() > 1


@pytest.mark.parametrize(
    ("border", "theta_x"),
    slow_but([("uniform", 0.0), ("clamp", 0.7)], [(border, 0.7 if border == "clamp" else 0.0) for border in BORDERS]),
)
def test_ten_thousand_taps(border, theta_x):
    """Beliefs stay within 1e-10 of the log domain to the end."""
    rng = np.random.default_rng(1)
    table = random_table(rng, 5, 3, 6.0, 0.0, 90)
    plan = random_plan(rng, table, 1)

    assert assert_same(table, plan, (1.0,), theta_x, border, 10_000, 3) == 0


@pytest.mark.parametrize("step", [3.0, 40.0, 900.0])
def test_classes_come_back_from_any_depth(step):
    """Two objects whose log odds walk at random over thousands of steps: whoever leads at the end is believed.

    A floor under beliefs, or numbers that underflow, would let the last few taps decide.
    """
    table = TapTable(
        np.array([[[0.0, -step]], [[-step, 0.0]]]), tap_pool([0, 0], [0, 0], (1, 2)), np.log(np.full((1, 2), 0.5))
    )
    trials, deadline, seed = 300, 999, 4
    plan = TrialPlan(*np.zeros((3, trials), dtype=int), np.arange(trials), np.zeros(trials, dtype=int))
    decided = run_trials(table, plan, (1.0,), play=PlaySettings(theta_x=1.0, deadline=deadline), seed=seed)
    odds = np.array(
        [step * (deadline - 2 * (trial_uniforms(seed, stream, deadline) >= 0.5).sum()) for stream in range(trials)]
    )
    lowest = -step * np.sqrt(deadline)

    assert odds.min() < lowest
    np.testing.assert_array_equal(decided.what[:, 0], odds < 0)
    np.testing.assert_allclose(decided.belief[:, 0], 1 / (1 + np.exp(-np.abs(odds))), atol=1e-10)


def test_classes_that_lead_in_turn_from_any_depth():
    """Three classes that are worlds apart after one tap and level after the next, against sums of logarithms."""
    unit = np.log(2.0)
    steps = np.array([[0, -240, 0], [-2560, -240, 0], [0, 0, -257.0]]) * unit
    prior = np.array([[0, 0, -257.0]]) * unit
    table = TapTable(steps[:, np.newaxis], tap_pool([0] * 3, [0] * 3, (1, 3)), prior - np.logaddexp.reduce(prior[0]))
    trials, deadline = 20_000, 7
    plan = TrialPlan(*np.zeros((3, trials), dtype=int), np.arange(trials), np.zeros(trials, dtype=int))
    played = run_trials(table, plan, (1.0,), play=PlaySettings(theta_x=1.0, deadline=deadline))
    taps = seeds.below(seeds.words(0, plan.stream, seeds.TAPS, 0, deadline), np.uint64(3)).astype(int)
    log_belief = table.log_prior + steps[taps].sum(axis=1)
    belief = np.exp(log_belief - np.logaddexp.reduce(log_belief, axis=1)[:, np.newaxis])

    np.testing.assert_allclose(played.belief[:, 0], belief.max(axis=1), atol=1e-10)
    assert (np.take_along_axis(belief, played.what, axis=1)[:, 0] >= belief.max(axis=1) - 1e-10).all()


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
@example(15069)  # a class falls from 2^-874 below all numbers, and comes back
def test_random_walks_of_beliefs_over_hundreds_of_units(seed):
    """Passive trials over tables whose steps lie near multiples of the unit, where scales change most."""
    rng = np.random.default_rng(seed)
    M, N = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    steps = -np.log(2.0) * (256 * rng.integers(0, 8, size=(N, 1, M)) + rng.integers(-20, 20, size=(N, 1, M)))
    table = TapTable(steps, tap_pool([0] * N, [0] * N, (1, M)), np.full((1, M), -np.log(M)))
    trials, deadline = 200, 40
    plan = TrialPlan(*np.zeros((3, trials), dtype=int), np.arange(trials), np.zeros(trials, dtype=int))
    played = run_trials(table, plan, (1.0,), play=PlaySettings(theta_x=1.0, deadline=deadline), workers=1)
    taps = seeds.below(seeds.words(0, plan.stream, seeds.TAPS, 0, deadline), np.uint64(N)).astype(int)
    log_belief = steps[taps].sum(axis=(1, 2))
    belief = np.exp(log_belief - np.logaddexp.reduce(log_belief, axis=1)[:, np.newaxis])

    np.testing.assert_allclose(played.belief[:, 0], belief.max(axis=1), atol=1e-9)
    assert (np.take_along_axis(belief, played.what, axis=1)[:, 0] >= belief.max(axis=1) - 1e-9).all()


@pytest.mark.parametrize("depth", [1.0, 1e4])
def test_tables_begin_with_a_line_of_the_cache(depth):
    """Rows of 8 positions and more would otherwise be read from two lines."""
    for taps in (1, 3, 1000):
        table = likelihoods(-depth * np.random.default_rng(taps).random((taps, 4, 3)))
        assert (table.rows.ctypes.data % 64, table.plain.ctypes.data % 64) == (0, 0)


def test_likelihoods_are_held_exactly_however_deep():
    """z 2^(-256 k) is the likelihood over the largest of its tap, z lies above 2^-256, zero is zero."""
    rng = np.random.default_rng(0)
    log_likelihood = -rng.exponential(size=(50, 4, 3)) * 10.0 ** rng.integers(-2, 6, size=(50, 1, 1))
    log_likelihood[0, 1, 1] = -np.inf
    table = likelihoods(log_likelihood)
    depth = (log_likelihood - log_likelihood.max(axis=(1, 2), keepdims=True)).swapaxes(1, 2)

    assert table.units.any(axis=(1, 2)).tolist() == table.wide.tolist()
    possible = np.isfinite(depth)
    np.testing.assert_allclose(
        (np.log(np.where(possible, table.rows, 1.0)) - table.units * 256 * np.log(2))[possible],
        depth[possible],
        rtol=1e-12,
        atol=1e-12,
    )
    assert (table.rows[possible] > 2.0**-257).all()
    assert (table.rows <= 1).all()
    assert (table.rows[~possible] == 0).all()
    np.testing.assert_allclose(table.plain, np.where(table.units < 2, np.exp(depth), 0.0), rtol=1e-9, atol=1e-200)
    assert likelihoods(np.zeros((3, 2, 2))).units.shape == (0, 2, 2)


@given(
    a=st.floats(2.0**-256, 1.0),
    ka=st.integers(0, 3),
    b=st.one_of(st.just(0.0), st.floats(2.0**-256, 1.0)),
    kb=st.integers(0, 3),
)
def test_scaled_numbers_add(a, ka, b, kb):
    """In either order, as their logarithms do."""
    exact = np.logaddexp(*(np.log(v) - 256 * np.log(2) * k if v else -np.inf for v, k in ((a, ka), (b, kb))))
    assert scaled.add(a, 0, 1.0, 2**40) == (a, 0)
    for z, k in (scaled.add(a, ka, b, kb), scaled.add(b, kb, a, ka)):
        assert np.log(z) - 256 * np.log(2) * k == pytest.approx(exact, abs=1e-9)


def test_settling_keeps_the_belief():
    """Proportions stay, the largest classes come to k = 0, all others above 2^-256."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        log_belief = -rng.exponential(size=(4, 3)) * 10.0 ** rng.integers(0, 4)
        z, k = scaled_belief(log_belief)
        drift = rng.integers(0, 600, size=z.shape)
        z, k = z * 2.0**-drift, k + rng.integers(0, 3, size=z.shape)
        before = np.log(z) - 256 * np.log(2) * k
        on = np.empty_like(z)
        least = scaled.settle(z, k, on)
        after = np.log(z) - 256 * np.log(2) * k

        np.testing.assert_allclose(after - after.max(), before - before.max(), rtol=1e-12, atol=1e-9)
        assert least == z.min() >= 2.0**-256
        assert (z[k > 0] < 1).all()
        assert 0.5 <= z[k == 0].sum() <= 2
        np.testing.assert_array_equal(on, k == 0)


def test_nothing_is_left_of_an_impossible_belief():
    """Nor of a tap that no class can give."""
    assert not likelihoods(np.full((1, 2, 2), -np.inf)).rows.any()
    z, k, on = np.zeros((2, 3)), np.zeros((2, 3), dtype=np.int64), np.ones((2, 3))

    assert scaled.settle(z, k, on) == 0
