"""Resampled test taps: what is drawn anew, what pairs, and how resamples turn into intervals."""

import numpy as np
import pytest
from solidtouch.hardware.pool import TapPool, pool_of, tap_pool
from solidtouch.inference import resampling
from solidtouch.inference.montecarlo import run_trials
from solidtouch.inference.resampling import (
    RESAMPLES,
    Spread,
    planned_trials,
    play_resamples,
    resampled_pools,
    share_beyond,
    spread,
    taps_per_class,
    too_few,
    widened,
)
from solidtouch.inference.trial_plan import TapTable, plan_trials

L, M = 3, 2
COUNT = np.array([[4, 1], [0, 7], [5, 2]])


def table_of(seed=0, count=COUNT, session=None, skill=1.0):
    """Taps of classes in no order, of which two lie outside the grid."""
    rng = np.random.default_rng(seed)
    where, what = np.repeat(np.argwhere(count >= 0), count.ravel(), axis=0).T
    order = rng.permutation(len(where))
    where, what = np.append(where[order], [-1, -1]), np.append(what[order], [0, 1])
    values = rng.normal(size=(len(where), *count.shape))
    inside = where >= 0
    values[np.flatnonzero(inside), where[inside], what[inside]] += skill
    flat = np.full(count.shape, -np.log(count.size))
    session = None if session is None else session(np.arange(len(where)))
    return TapTable(values, tap_pool(where, what, count.shape), flat, session=session)


def taps_of(pool: TapPool, l: int, m: int):
    return pool.order[pool.first[l, m] : pool.first[l, m] + pool.count[l, m]]


def cells(pool):
    """The class of every tap of a pool, by its number."""
    return {int(tap): (l, m) for l, m in np.ndindex(*pool.count.shape) for tap in taps_of(pool, l, m)}


def test_the_first_pool_is_that_of_the_taps():
    table = table_of()
    first, *others = resampled_pools(table, 4, 0)
    assert first is table.pool
    assert len(others) == 4
    assert len(list(resampled_pools(table, 0, 0))) == 1


def test_each_resample_has_as_many_taps_of_each_class():
    """Of that class only, some of them several times."""
    table = table_of()
    own = cells(table.pool)
    repeated = 0
    for pool in list(resampled_pools(table, 20, 0))[1:]:
        np.testing.assert_array_equal(pool.count, table.pool.count)
        np.testing.assert_array_equal(pool.first, table.pool.first)
        np.testing.assert_array_equal(pool.nearest, table.pool.nearest)
        for l, m in np.ndindex(L, M):
            assert all(own[int(tap)] == (l, m) for tap in taps_of(pool, l, m))
        repeated += len(set(pool.order)) < len(pool.order)
    assert repeated == 20


def test_every_tap_of_a_class_is_drawn_as_often():
    """Five standard deviations of a share at most; taps outside the grid never."""
    table, n = table_of(), 3000
    drawn = np.bincount(np.concatenate([pool.order for pool in list(resampled_pools(table, n, 1))[1:]]), minlength=21)
    assert drawn[19:].tolist() == [0, 0]
    for l, m in np.argwhere(COUNT > 0):
        own = drawn[taps_of(table.pool, l, m)]
        assert own.sum() == n * COUNT[l, m]
        assert (np.abs(own - n) <= 5 * np.sqrt(n)).all()


def test_sessions_are_drawn_anew_where_several_test():
    """As many as there are, each with as many taps of a class as it has, times how often it is drawn."""
    table = table_of(count=6 * np.ones((L, M), int), session=lambda i: np.array([0, 7, 9])[i % 3])
    session = table.session
    own = cells(table.pool)
    has = {(s, c): sum(session[t] == s and own[t] == c for t in own) for s in (0, 7, 9) for c in set(own.values())}
    patterns = set()
    for pool in list(resampled_pools(table, 60, 0))[1:]:
        found = cells_with_repeats(pool)
        times = []
        for s in (0, 7, 9):
            ratios = {
                sum(session[t] == s for t, cell in found if cell == c) / n
                for (of, c), n in has.items()
                if of == s and n
            }
            assert len(ratios) == 1  # the same session in every class
            times.append(ratios.pop())
        assert sum(times) == 3
        patterns.add(tuple(times))
    assert len(patterns) == 10  # every way to draw three of three


def cells_with_repeats(pool):
    return [(int(tap), (l, m)) for l, m in np.ndindex(*pool.count.shape) for tap in taps_of(pool, l, m)]


def test_a_resample_may_lose_a_class_with_its_session():
    """The finger then takes the nearest class that is left, and plays on."""
    table = table_of(count=np.array([[3, 3], [3, 3]]), session=lambda i: i)
    own = cells(table.pool)
    table = table._replace(session=np.array([own.get(tap, (1, 0))[0] for tap in range(len(table.log_likelihood))]))
    pools = list(resampled_pools(table, 30, 0))
    lost = [pool for pool in pools if (pool.count.sum(axis=1) == 0).any()]
    assert lost
    for pool in lost:
        assert (pool.count.max(axis=1) == [0, 6]).all() or (pool.count.max(axis=1) == [6, 0]).all()
        assert len(np.unique(pool.nearest)) == 1
    kept = play_resamples(table, (0.9,), lambda t, _: t.taps.mean(), trials=30, theta_x=0.0, resamples=30, deadline=5)
    assert np.isfinite(kept).all()


def test_tables_of_the_same_taps_share_their_resamples():
    """Whatever their likelihoods; another seed gives others."""
    one, other, again = (
        list(resampled_pools(table_of(skill=skill), 5, seed)) for skill, seed in ((1.0, 3), (1.0, 4), (2.0, 3))
    )
    assert all(np.array_equal(a.order, b.order) for a, b in zip(one, again, strict=True))
    assert not any(np.array_equal(a.order, b.order) for a, b in zip(one[1:], other[1:], strict=True))


def test_a_pool_of_repeated_taps():
    """In the order given within a class; the nearest class is that of a plain search."""
    cell = np.array([5, 0, 5, 3, 0])
    pool = pool_of(np.array([9, 4, 9, 2, 1]), cell, (3, 2))
    assert pool.count.tolist() == [[2, 0], [0, 1], [0, 2]]
    assert [taps_of(pool, l, m).tolist() for l, m in ((0, 0), (1, 1), (2, 1))] == [[4, 1], [2], [9, 9]]
    assert pool.nearest.tolist() == [[0, 1], [0, 1], [0, 2]]
    assert pool_of(np.array([3]), np.array([4]), (3, 2)).nearest.tolist() == [[2, -1]] * 3


SAMPLES = np.arange(101.0)
"""Resamples 0 to 100, of mean 50."""


def with_estimate(value, samples=SAMPLES):
    return np.concatenate([[value], samples])


def test_an_interval_lies_about_the_estimate():
    """By how far the ends of the resamples lie from their mean, enlarged."""
    for factor in (1.0, 1.5):
        low, high = Spread(factor).interval(with_estimate(80.0))
        assert (low, high) == pytest.approx((80 + factor * (2 - 50), 80 + factor * (98 - 50)))
    skewed = with_estimate(1.0, SAMPLES**2)
    low, high = Spread(1.0).interval(skewed)
    assert (low, high) == pytest.approx((1 + 4 - np.mean(SAMPLES**2), 1 + 98**2 - np.mean(SAMPLES**2)))


def test_an_interval_ends_where_the_quantity_does():
    low, high = Spread(1.0).interval(np.stack([with_estimate(20.0), with_estimate(90.0)]), 0.0, [60.0, 100.0])
    assert low.tolist() == pytest.approx([0, 42])
    assert high.tolist() == pytest.approx([60, 100])


def test_few_undefined_resamples_are_left_out_and_many_leave_no_interval():
    """Up to one in twenty; without an estimate there is none either."""
    few, many = SAMPLES[1:].copy(), SAMPLES[1:].copy()
    few[::20], many[:6] = np.nan, np.nan
    assert np.isnan(few).sum() == 5
    low, high = Spread(1.0).interval(np.stack([with_estimate(x, y) for x, y in ((0, few), (0, many), (np.nan, few))]))
    defined = few[~np.isnan(few)]
    assert low[0] == pytest.approx(np.sort(defined)[2] - defined.mean())
    assert high[0] == pytest.approx(np.sort(defined)[92] - defined.mean())
    assert np.isnan(low[1:]).all()
    assert np.isnan(high[1:]).all()


def test_infinite_resamples_may_be_ends():
    """The others are about the mean of the finite ones; an infinite estimate has the ends of its resamples."""
    some = SAMPLES.copy()
    some[:5] = -np.inf
    low, high = Spread(1.0).interval(with_estimate(60.0, some))
    assert low == -np.inf
    assert high == pytest.approx(60 + 98 - some[5:].mean())
    low, high = Spread(2.0).interval(with_estimate(-np.inf, some))
    assert (low, high) == (-np.inf, 98)


def test_deviations_are_enlarged_by_the_number_of_draws():
    """Taps of a class, the median over those that have some; sessions where several test."""
    table = table_of()
    assert taps_per_class(table.pool) == 4
    assert spread(table).factor == pytest.approx(np.sqrt(4 / 3))
    sessions = table_of(session=lambda i: i % 3)
    assert spread(sessions).factor == pytest.approx(np.sqrt(3 / 2))
    assert spread(table_of(session=lambda i: 0 * i + 5)).factor == pytest.approx(np.sqrt(4 / 3))
    outside = table_of(session=lambda i: np.where(i < 19, 0, i))
    assert spread(outside).factor == pytest.approx(np.sqrt(4 / 3))
    single = spread(table_of(count=np.eye(2, dtype=int)))
    assert np.isnan(single.factor)
    assert "too few for an interval" in single.few
    assert np.isnan(single.interval(with_estimate(20.0))).all()


def test_too_few_taps_are_said():
    """Below ten of a class, or where more than one trial in twenty used them up."""
    assert (
        spread(table_of()).few
        == too_few(4)
        == "There are too few test taps, 4 or so of each class: intervals are rough."
    )
    assert too_few(9).startswith("There are too few test taps, 9")
    assert too_few(10) == too_few(10, 0.05) == ""
    assert too_few(10, 0.06).startswith("There are too few test taps: 6% of the decisions were made because the 10")
    assert spread(table_of(), 0.5).few == too_few(4, 0.5)


def test_resamples_enlarged_vary_as_the_quantity_itself():
    """The variance of a mean over resampled taps, enlarged, is that over data sets: 400 of three taps each."""
    rng, values = np.random.default_rng(0), []
    for seed in range(400):
        table = table_of(count=np.full((1, 2), 3))
        score = rng.normal(size=len(table.log_likelihood))
        means = np.array([score[pool.order].mean() for pool in resampled_pools(table, 40, seed)])
        values.append([means[0], (spread(table).factor ** 2) * means[1:].var(ddof=1)])
    mean, variance = np.array(values).T
    assert variance.mean() == pytest.approx(mean.var(), rel=0.15)
    assert variance.mean() == pytest.approx(1 / 6, rel=0.1)


def means(trials, plan):
    return np.concatenate([trials.taps.mean(axis=0), (trials.what == plan.what[:, None]).mean(axis=0)])


OPTIONS = {"trials": 60, "theta_x": 0.0, "fixation": 1, "deadline": 9, "seed": 4, "resamples": 6, "resample_trials": 25}


def test_resamples_are_trials_on_resampled_pools():
    """Those of the taps first; each resample has streams of its own."""
    table = table_of()
    kept = play_resamples(table, (0.5, 0.9), means, **OPTIONS)
    for number, (pool, result) in enumerate(zip(resampled_pools(table, 6, 4), kept, strict=True)):
        n = 25 if number else 60
        plan = plan_trials(pool, n, 4, 1, first_stream=60 + 25 * (number - 1) if number else 0)
        trials = run_trials(table._replace(pool=pool), plan, (0.5, 0.9), theta_x=0.0, deadline=9, seed=4, fresh=True)
        np.testing.assert_array_equal(result, means(trials, plan))


def test_resamples_do_not_depend_on_workers_and_count_their_progress():
    told = []
    one = play_resamples(table_of(), (0.5,), means, **OPTIONS, workers=1, progress=told.append)
    several = play_resamples(table_of(), (0.5,), means, **OPTIONS, workers=3)
    np.testing.assert_array_equal(one, several)
    assert told == [60, *[25] * 6]
    assert sum(told) == planned_trials(60, 6, 25)
    assert planned_trials(10) == 10 * (1 + RESAMPLES)
    assert planned_trials(5000) == 5000 + RESAMPLES * resampling.RESAMPLE_TRIALS


def test_models_differ_by_nothing_from_themselves():
    """In every resample; better ones do better in most of them."""
    weak, same, good = (
        np.array(play_resamples(table_of(skill=skill), (0.5,), means, **OPTIONS))[:, 1] for skill in (0.5, 0.5, 3.0)
    )
    np.testing.assert_array_equal(weak, same)
    assert (good > weak).mean() > 0.7


def test_taps_may_be_drawn_again():
    """With `fresh` off no trial uses a class up."""
    fresh, again = (
        play_resamples(table_of(), (1.0,), lambda t, _: t.used_up.mean(), **OPTIONS, fresh=value)
        for value in (True, False)
    )
    assert min(fresh) > 0.5
    assert max(again) == 0


def test_an_interval_reaches_as_far_as_what_was_never_seen_could():
    """The exact two-sided bound of a proportion without a case."""
    assert share_beyond(100) == pytest.approx(0.03622, abs=1e-5)
    assert 1 - (1 - share_beyond(37)) ** 37 == pytest.approx(0.975)
    low, high = widened(np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.5, 1.0]), 100)
    assert low.tolist() == pytest.approx([0, 0.4, 1 - share_beyond(100)])
    assert high.tolist() == pytest.approx([share_beyond(100), 0.5, 1])


def test_an_interval_of_which_resamples_know_nothing_is_wide_open():
    """From 0 to 1."""
    low, high = widened(np.array([np.nan, 0.5]), np.array([np.nan, 0.6]), [50, 50], opened=True)
    assert low.tolist() == [0, 0.5]
    assert high.tolist() == [1, 0.6]


def test_mean_errors_in_millimetres_are_widened_by_one_class_and_never_from_above():
    """There is no greatest mean; an undefined interval stays so."""
    low, high = widened(np.array([0.0, 9.0, np.nan]), np.array([0.0, 9.5, np.nan]), 100, 2.0, np.inf)
    assert high[:2].tolist() == pytest.approx([2 * share_beyond(100), 9.5])
    assert low[:2].tolist() == [0, 9]
    assert np.isnan([low[2], high[2]]).all()
