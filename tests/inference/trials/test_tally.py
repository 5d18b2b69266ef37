"""Counting trials is the same as keeping them."""

import numpy as np
import pytest
from array_device import ARRAYS
from solidtouch.inference.trials import run as montecarlo
from solidtouch.inference.trials.records import TapTable, plan_trials
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.tally import Tally, tally, tally_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import tap_pool
from solidtouch.models.settings import PlaySettings

L, M, TRIALS, DEADLINE = 4, 3, 200, 9
THETAS = (0.8, 0.3, 1.0)
RULE = {"play": PlaySettings(theta_x=0.2, deadline=DEADLINE), "fixation": 1, "seed": 5, "first_stream": 17}


@pytest.fixture(scope="module")
def table():
    rng = np.random.default_rng(0)
    where, what = rng.integers(L, size=60), rng.integers(M, size=60)
    prior = np.full((L, M), -np.log(L * M))
    return TapTable(rng.normal(size=(60, L, M)), tap_pool(where, what, (L, M)), prior)


def assert_equal(expected, actual):
    for name, value in expected._asdict().items():
        compare = np.testing.assert_allclose if name == "belief" else np.testing.assert_array_equal
        compare(getattr(actual, name), value, err_msg=name)


@pytest.fixture(scope="module")
def kept(table):
    plan = plan_trials(table.pool, TRIALS, 5, fixation=1, first_stream=17)
    return plan, run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.2, deadline=DEADLINE), seed=5)


def test_a_tally_counts_the_trials_of_the_plan(table, kept):
    plan, trials = kept
    counts = tally_trials(table, THETAS, TRIALS, **RULE)

    assert counts.trials == TRIALS
    for h in range(len(THETAS)):
        what = np.zeros((M, M), dtype=int)
        where = np.zeros((L, L), dtype=int)
        np.add.at(what, (plan.what, trials.what[:, h]), 1)
        np.add.at(where, (trials.true_where[:, h], trials.where[:, h]), 1)
        np.testing.assert_array_equal(counts.what[h], what)
        np.testing.assert_array_equal(counts.where[h], where)
        np.testing.assert_array_equal(counts.taps[h], np.bincount(trials.taps[:, h], minlength=DEADLINE + 1))
    np.testing.assert_array_equal(counts.stopped, trials.stopped.sum(axis=0))
    np.testing.assert_array_equal(counts.clamped, (trials.clamped > 0).sum(axis=0))
    np.testing.assert_array_equal(counts.substituted, (trials.substituted > 0).sum(axis=0))
    np.testing.assert_allclose(counts.belief, trials.belief.sum(axis=0))
    assert counts.clamped.max() > 0


def test_taps_of_a_neighbour_are_counted_where_a_class_has_none(table):
    """A quarter of the classes have no test tap, so moves end beside them."""
    where, what = (index.ravel() for index in np.indices((L, M)))
    held = np.flatnonzero((where + what) % 4 > 0)
    gaps = table._replace(pool=tap_pool(np.repeat(where[held], 5), np.repeat(what[held], 5), (L, M)))
    plan = plan_trials(gaps.pool, TRIALS, 5, fixation=1)
    trials = run_trials(gaps, plan, THETAS, play=PlaySettings(theta_x=0.0, deadline=DEADLINE), seed=5)
    counts = tally(trials, plan, (L, M))

    np.testing.assert_array_equal(counts.substituted, (trials.substituted > 0).sum(axis=0))
    assert counts.substituted.max() > 0


@pytest.mark.parametrize("piece", [1, 64, 1000])
@pytest.mark.parametrize("workers", [1, 3])
def test_pieces_and_threads_do_not_matter(monkeypatch, table, piece, workers):
    expected = tally_trials(table, THETAS, TRIALS, **RULE)
    monkeypatch.setattr(montecarlo, "_AT_ONCE", piece)

    assert_equal(expected, tally_trials(table, THETAS, TRIALS, **RULE, workers=workers))


def test_threads_change_no_bit(monkeypatch, table):
    """Sums of beliefs are taken in the order of the trials, whoever played them."""
    monkeypatch.setattr(montecarlo, "_AT_ONCE", 16)
    one, three = (tally_trials(table, THETAS, TRIALS, **RULE, workers=workers) for workers in (1, 3))

    np.testing.assert_array_equal(one.belief, three.belief)


def test_arrays_count_as_loops_do(table):
    expected = tally_trials(table, THETAS, TRIALS, **RULE)

    assert_equal(expected, tally_trials(table, THETAS, TRIALS, **RULE, device=ARRAYS))


def test_parts_add_up(table, kept):
    plan, trials = kept
    parts = [
        tally(type(trials)(*(field[rows] for field in trials)), type(plan)(*(c[rows] for c in plan)), (L, M))
        for rows in (slice(0, 70), slice(70, 71), slice(71, None))
    ]
    none = Tally.empty(len(THETAS), L, M)

    assert none.trials == 0
    assert_equal(tally_trials(table, THETAS, TRIALS, **RULE), none.plus(parts[0]).plus(parts[1]).plus(parts[2]))


def test_progress_sees_the_counts_grow(monkeypatch, table):
    monkeypatch.setattr(montecarlo, "_AT_ONCE", 50)
    seen = []
    tally_trials(table, THETAS, TRIALS, **RULE, progress=lambda counts: seen.append(counts.trials))

    assert seen == [50, 100, 150, 200]


def test_only_one_start_can_be_asked_for(table):
    """Passive trials that start in a class stay there."""
    counts = tally_trials(table, THETAS, 50, play=PlaySettings(theta_x=1.0), where=2)

    assert counts.where.sum(axis=(0, 2)).tolist() == [0, 0, 3 * 50, 0]


def test_bad_arguments_are_refused(table):
    with pytest.raises(InputError, match="trials must be at least 1, got 0"):
        tally_trials(table, THETAS, 0, play=PlaySettings(theta_x=0.0))
    with pytest.raises(InputError, match="Position 9 has no test tap"):
        tally_trials(table, THETAS, 5, play=PlaySettings(theta_x=0.0), where=9)


def test_memory_does_not_grow_with_the_deadline(table):
    """Reaction times are counted up to the longest that was seen."""
    counts = tally_trials(table, (0.5,), 20, play=PlaySettings(theta_x=0.0, deadline=10**6))

    assert counts.trials == 20
    assert counts.taps.shape[1] < 1000
    assert counts.taps[0, -1] > 0


@pytest.mark.parametrize("device", ["cpu", "xla-cpu"])
def test_trials_in_which_no_class_is_left_are_counted(device):
    """Two objects at one place; each tap of the second excludes one of them."""
    log_likelihood = np.array([[[0.0, -np.inf]], [[-np.inf, 0.0]]])
    table = TapTable(log_likelihood, tap_pool([0, 0], [1, 1], (1, 2)), np.log([[0.5, 0.5]]))
    counts = tally_trials(table, (1.0, 0.9), 5, play=PlaySettings(theta_x=1.0, deadline=60), device=device)

    assert counts.no_class_left.tolist() == [5, 0]
    assert counts.stopped.tolist() == [0, 5]
