"""Selections of test taps: what is drawn anew, what pairs, and how much they vary."""

import numpy as np
import pytest
from scattered_taps import COUNT, L, M, table_of, taps_of
from slow_cases import slow_but
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.trials.resampling import play_resamples, spread
from solidtouch.inference.trials.selections import resampled_pools, sessions_drawn, thinned_pools
from solidtouch.models.grid import pool_of, tap_pool
from solidtouch.models.settings import PlaySettings


def cells(pool):
    """The class of every tap of a pool, by its number."""
    return {int(tap): (l, m) for l, m in np.ndindex(*pool.shape) for tap in taps_of(pool, l, m)}


@pytest.mark.parametrize("pools", [resampled_pools, thinned_pools])
def test_the_first_pool_is_that_of_the_taps(pools):
    table = table_of()
    first, *others = pools(table, 4, 0)
    assert first is table.pool
    assert len(others) == 4
    assert len(list(pools(table, 0, 0))) == 1


def test_each_resample_has_as_many_taps_of_each_class():
    """Of that class only, some of them several times."""
    table = table_of(count=np.where(COUNT == 1, 3, COUNT))
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
        own, expected = drawn[taps_of(table.pool, l, m)], n / (1 + (COUNT[l, m] == 1))  # a lone tap in every second
        assert COUNT[l, m] == 1 or own.sum() == n * COUNT[l, m]
        assert (np.abs(own - expected) <= 5 * np.sqrt(n)).all()


@pytest.mark.parametrize("pools", [resampled_pools, thinned_pools])
def test_each_session_is_left_out_in_turn_where_several_test(pools):
    """With all of its taps, and no other tap."""
    table = table_of(count=6 * np.ones((L, M), int), session=lambda i: np.array([0, 7, 9])[i % 3])
    everything = {tap for tap, _ in cells_with_repeats(table.pool)}
    for r, pool in enumerate(list(pools(table, 7, 0))[1:]):
        found = [tap for tap, _ in cells_with_repeats(pool)]
        assert len(found) == len(set(found))
        assert everything - set(found) == {t for t in everything if table.session[t] == (0, 7, 9)[r % 3]}


def shares(pool, taps):
    """The share of every tap in the mean over the classes of a pool of the mean over its taps; one position."""
    share, held = np.zeros(taps), np.flatnonzero(pool.per_class[0])
    for m in held:
        np.add.at(share, taps_of(pool, 0, m), 1 / (len(held) * pool.per_class[0, m]))
    return share


def cells_with_repeats(pool):
    return [(int(tap), (l, m)) for l, m in np.ndindex(*pool.shape) for tap in taps_of(pool, l, m)]


@pytest.mark.parametrize("pools", [resampled_pools, thinned_pools])
def test_no_class_is_lost_with_a_session_of_its_own(pools):
    """Taps are drawn then."""
    table = table_of(count=np.array([[3, 3], [3, 3]]))
    own = cells(table.pool)
    table = table._replace(session=np.array([own.get(tap, (1, 0))[0] for tap in range(len(table.log_likelihood))]))
    for pool in pools(table, 30, 0):
        assert (pool.count > 0).all()


def test_the_finger_plays_on_where_a_class_is_lost_with_a_session():
    """It takes the nearest one that is left; one class in ten may be lost."""
    count = np.full((20, 1), 2)
    table = table_of(count=count, session=lambda i: i % 2)
    alone = taps_of(table.pool, 3, 0)
    session = np.asarray(table.session).copy()
    for l in range(20):
        session[taps_of(table.pool, l, 0)] = 0, 1
    session[alone] = 0
    table = table._replace(session=session)
    lost = [pool for pool in thinned_pools(table, 4, 0) if pool.per_class[3, 0] == 0]
    assert len(lost) == 2
    assert all(pool.nearest[0, 3, 0] in (2, 4) for pool in lost)
    options = {"trials": 30, "play": PlaySettings(theta_x=0.0, deadline=5), "resamples": 4}
    kept = play_resamples(table, (0.9,), lambda t, _: {"taps": t.taps.mean()}, **options)
    assert np.isfinite(kept.samples["taps"]).all()


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
    pool = pool_of(np.array([9, 4, 9, 2, 1]), cell, (1, 3, 2))
    assert pool.count.tolist() == [[[2, 0], [0, 1], [0, 2]]]
    assert [taps_of(pool, l, m).tolist() for l, m in ((0, 0), (1, 1), (2, 1))] == [[4, 1], [2], [9, 9]]
    assert pool.nearest.tolist() == [[[0, 1], [0, 1], [0, 2]]]
    assert pool_of(np.array([3]), np.array([4]), (1, 3, 2)).nearest.tolist() == [[[2, -1]] * 3]


@pytest.mark.parametrize(("pools", "thinned"), [(resampled_pools, False), (thinned_pools, True)])
@pytest.mark.parametrize("taps", slow_but([2], [2, 3, 5]))
def test_selections_enlarged_vary_as_the_quantity_itself(pools, thinned, taps):
    """The variance of a mean over selected taps, enlarged, is that over data sets, for any number of taps."""
    rng, values = np.random.default_rng(0), []
    table = table_of(count=np.full((1, 2), taps))
    for seed in range(400):
        score = rng.normal(size=len(table.log_likelihood))
        of_classes = [[score[taps_of(pool, 0, m)].mean() for m in range(2)] for pool in pools(table, 15, seed)]
        means = np.mean(of_classes, axis=1)
        values.append([means[0], (spread(table, thinned=thinned).factor ** 2) * means[1:].var(ddof=1)])
    mean, variance = np.array(values).T
    assert variance.mean() == pytest.approx(mean.var(), rel=0.2)
    assert variance.mean() == pytest.approx(1 / (2 * taps), rel=0.1)


def test_thinned_pools_hold_no_tap_twice_and_keep_every_class():
    """A quarter of each class is left out, where that is no whole number sometimes one more; of single taps as well."""
    table = table_of()
    own, left_out = cells(table.pool), []
    for pool in list(thinned_pools(table, 200, 0))[1:]:
        found = cells_with_repeats(pool)
        assert len({tap for tap, _ in found}) == len(found)
        assert all(own[tap] == cell for tap, cell in found)
        assert ((pool.per_class > 0) == (COUNT > 0))[COUNT != 1].all()
        left_out.append(COUNT - pool.per_class)
    per_kept = np.mean([out / np.maximum(COUNT - out, 1) for out in left_out], axis=0)
    assert {int(out[0, 0]) for out in left_out} == {1}  # of 4
    assert np.mean([out[0, 1] for out in left_out]) == pytest.approx(0.5, abs=0.1)  # of 1
    assert {int(out[1, 1]) for out in left_out} == {1, 2}  # of 7
    assert per_kept[COUNT > 1] == pytest.approx(1 / 3, abs=0.1)


@pytest.mark.parametrize(("pools", "thinned"), [(resampled_pools, False), (thinned_pools, True)])
def test_classes_of_one_tap_vary_as_they_differ(pools, thinned):
    """Beside classes of eight: the variance of a mean over classes, enlarged, is that over data sets, or larger.

    Where classes differ, and then where they do not.
    """
    rng, values, table = np.random.default_rng(0), [], table_of(count=np.array([[8, 8, 1, 8, 1, 8, 1]]))
    for seed in range(400):
        score, means = rng.normal(size=len(table.log_likelihood)), []
        for pool in pools(table, 15, seed):
            some = np.flatnonzero(pool.per_class[0])
            alike = np.mean([score[taps_of(pool, 0, m)].mean() for m in some])
            means.append([alike + np.mean(some) / 3, alike])
        values.append([means[0], (spread(table, thinned=thinned).factor ** 2) * np.var(means[1:], axis=0, ddof=1)])
    mean, variance = np.moveaxis(values, 1, 0)
    assert (variance.mean(axis=0) > 0.9 * mean.var(axis=0)).all()
    assert variance[:, 1].mean() < 1.4 * mean[:, 1].var()


@pytest.mark.parametrize(("pools", "thinned"), [(resampled_pools, False), (thinned_pools, True)])
@pytest.mark.parametrize("count", [[20] * 9 + [1] * 3, [20] * 11 + [1], [20] * 7 + [1] * 5, [2] * 7 + [1] * 5])
def test_intervals_hold_a_share_where_some_classes_have_one_tap(pools, thinned, count):
    """Of wrong taps, .3 of them in all classes alike: 93% of 300 intervals or more."""
    rng, table = np.random.default_rng(1), table_of(count=np.array([count]))
    taps, how, held = len(table.log_likelihood), spread(table, thinned=thinned), 0
    drawn = np.array([shares(pool, taps) for pool in pools(table, 100, 1)])
    for _ in range(300):
        wrong = rng.random(taps) < 0.3
        low, high = how.interval(drawn @ wrong, 0.0, 1.0)
        held += low <= 0.3 <= high
    assert held / 300 >= 0.93


@pytest.mark.parametrize("pools", [resampled_pools, thinned_pools])
def test_classes_of_one_tap_stay_where_most_have_no_more(pools):
    table = table_of(count=np.array([[1, 1], [1, 2]]))
    assert all((pool.count > 0).all() for pool in pools(table, 40, 0))


@pytest.mark.parametrize("pools", [resampled_pools, thinned_pools])
def test_taps_of_a_class_are_drawn_from_all_sessions_where_these_are_not(pools):
    """Sessions of one tap of each class, one class in a single session: other taps are drawn as of one session."""
    count = np.full((3, 2), 12)
    table = table_of(count=count)
    session = np.zeros(len(table.log_likelihood), int)
    for l, m in np.ndindex(3, 2):
        session[taps_of(table.pool, l, m)] = np.arange(12) * (l + m > 0)
    labelled = table._replace(session=session)
    assert sessions_drawn(labelled) == 1
    for one, other in zip(pools(table, 5, 0), pools(labelled, 5, 0), strict=True):
        np.testing.assert_array_equal(one.order, other.order)


def test_every_tap_is_left_out_as_often():
    """Five standard deviations of a share at most."""
    table, n = table_of(), 2000
    kept = np.bincount(np.concatenate([pool.order for pool in list(thinned_pools(table, n, 1))[1:]]), minlength=21)
    assert kept[19:].tolist() == [0, 0]
    for l, m in np.argwhere(COUNT > 0):
        own = kept[taps_of(table.pool, l, m)]
        assert (np.abs(own - own.mean()) <= 5 * np.sqrt(n / 4)).all()


@pytest.mark.parametrize(
    ("session", "drawn"),
    [
        (lambda i: 0 * i, 1),
        (lambda i: i % 5, 5),
        (lambda i: np.where(i < 30, 0, 1), 1),  # half of the classes in either
        (lambda i: np.where(i % 10 < 9, i % 2, 2), 3),
        (lambda i: np.where(i < 6, 0, i % 3), 3),
    ],
)
def test_sessions_are_drawn_where_they_hold_the_same_classes(session, drawn):
    """Otherwise a class would be lost with a session."""
    count = 10 * np.ones((L, M), int)
    cell = np.repeat(np.arange(L * M), 10)
    pool = tap_pool(*np.divmod(cell, M), (L, M))
    table = TapTable(np.zeros((len(cell), L, M)), pool, np.zeros((L, M)), session=session(np.arange(len(cell))))
    assert (pool.count == count).all()
    assert sessions_drawn(table) == drawn


@pytest.mark.parametrize("lost", [1, 2, 3, 5])
def test_one_class_in_ten_may_be_in_one_session_only(lost):
    """Of twenty two, of nineteen one; rounding does not change that."""
    for classes in (10 * lost, 10 * lost - 1):
        count = np.full((classes, 1), 2)
        table = table_of(count=count)
        session = np.zeros(len(table.log_likelihood), int)
        for l in range(lost, classes):
            session[taps_of(table.pool, l, 0)] = 0, 1
        assert sessions_drawn(table._replace(session=session)) == (2 if classes == 10 * lost else 1)


@pytest.mark.parametrize("sizes", [[200, 200, 1], [200, 200, 1, 1, 1, 1, 1], [100, 25, 25, 25, 25], [60, 20, 20]])
def test_sessions_of_unequal_sizes_leave_fewer_degrees_of_freedom(sizes):
    """A mean of taps over sessions that differ: 95% of 600 intervals or more hold it."""
    rng, hits, taps = np.random.default_rng(2), 0, sum(sizes)
    table = table_of(count=np.full((1, 1), taps))
    session = np.append(np.repeat(np.arange(len(sizes)), sizes), [0, 0])
    order = np.empty(len(session), int)
    order[np.append(table.pool.order, [taps, taps + 1])] = np.arange(len(session))
    table = table._replace(session=session[order])
    how, pools = spread(table, thinned=True), list(thinned_pools(table, 7 * len(sizes), 0))
    assert how.sessions == len(sizes)
    assert 1 <= how.freedom < len(sizes) - 1
    for _ in range(600):
        score = rng.normal(size=len(sizes))[table.session] + 0.1 * rng.normal(size=len(session))
        low, high = how.interval(np.array([score[pool.order].mean() for pool in pools]))
        hits += low <= 0 <= high
    assert hits / 600 > 0.93


@pytest.mark.parametrize("apart", [0.0, 1.0])
@pytest.mark.parametrize("sessions", [2, 3, 8])
def test_intervals_over_sessions_hold_the_truth_whether_these_differ_or_not(sessions, apart):
    """A mean of taps over sessions that differ by so many standard deviations of a tap: 95% of 600 intervals."""
    rng, hits = np.random.default_rng(1), 0
    table = table_of(count=np.full((1, 2), 10 * sessions), session=lambda i: i % sessions)
    taps, how = len(table.log_likelihood), spread(table, thinned=True)
    drawn = np.array([shares(pool, taps) for pool in thinned_pools(table, 40, 0)])
    for _ in range(600):
        score = rng.normal(size=taps) + apart * rng.normal(size=sessions)[table.session]
        low, high = how.interval(drawn @ score)
        hits += low <= 0 <= high
    assert 0.92 <= hits / 600 <= 0.98
