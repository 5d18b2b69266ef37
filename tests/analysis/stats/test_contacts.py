"""Accuracy after fixed numbers of contacts, on tables whose answers are known."""

import numpy as np
import pytest
from scipy.stats import t
from solidtouch.analysis.compare.classes import class_scores
from solidtouch.analysis.stats.contacts import Accuracy, accuracy, summarise
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.trials.resampling import Spread, share_beyond, spread
from solidtouch.inference.trials.selections import thinned_pools
from solidtouch.models.grid import tap_pool

L, M = 2, 3


def table_of(taps):
    """A table of taps given as (true class, log-likelihood by class), flat prior."""
    where, what = np.array([true for true, _ in taps]).T
    log_likelihood = np.array([np.broadcast_to(values, (L, M)) for _, values in taps], dtype=float)
    return TapTable(log_likelihood, tap_pool(where, what, (L, M)), np.log(np.full((L, M), 1 / (L * M))))


def for_class(where, what, strength=5.0):
    """The log-likelihood of a tap that speaks for one class."""
    values = np.zeros((L, M))
    values[where, what] = strength
    return values


@pytest.fixture
def table():
    """Three taps of class (0, 1), of which one looks like (0, 2), and two of (1, 0), both of which look like (0, 0)."""
    return table_of(
        [
            ((0, 1), for_class(0, 1)),
            ((1, 0), for_class(0, 0)),
            ((0, 1), for_class(0, 2, 4.0)),
            ((1, 0), for_class(0, 0)),
            ((0, 1), for_class(0, 1)),
        ]
    )


def test_single_contacts_use_every_tap_once(table):
    """Hits by class as joint, where and what, weighed by their taps."""
    (row,) = accuracy(table, seed=0, contacts=(1,))

    np.testing.assert_allclose(row.hits, [[2 / 3, 1.0, 2 / 3], [0.0, 0.0, 1.0]])
    assert row.weight.tolist() == [3.0, 2.0]
    assert (row.contacts, row.classes) == (1, 2)


def test_contacts_are_drawn_without_replacement(table, monkeypatch):
    """Three distinct taps of (0, 1) are all there are: two good ones outweigh the third in every draw."""
    monkeypatch.setattr("solidtouch.analysis.stats.contacts._ENOUGH", 0.5)
    row = accuracy(table, seed=0, contacts=(3,))[0]

    assert row.hits.tolist() == [[1.0, 1.0, 1.0]]
    assert (row.classes, row.weight.tolist()) == (1, [3.0])


def test_two_contacts_are_every_pair_alike(table):
    """Of the three pairs of (0, 1) each speaks for it, as 5 against 4 at worst."""
    row = accuracy(table, seed=0, contacts=(2,))[0]

    assert row.hits.tolist() == [[1.0, 1.0, 1.0], [0.0, 0.0, 1.0]]


def test_contacts_add_up():
    """Two weak taps for one class outweigh a stronger one for another; one of each kind, two pairs of three, do not."""
    taps = [((0, 0), for_class(0, 0, 2.0))] * 2 + [((0, 0), for_class(1, 1, 3.0))]
    pair, triple = accuracy(table_of(taps), seed=1, contacts=(2, 3))

    assert triple.hits.tolist() == [[1.0, 1.0, 1.0]]
    assert 0.05 < pair.hits[0, 0] < 0.65


def test_where_and_what_are_decided_by_their_marginals():
    """The best single class may be of another position and another object than the best marginals."""
    values = np.log([[0.3, 0.2, 0.0 + 1e-9], [0.2, 0.0 + 1e-9, 0.3]])
    values[1] += np.log(1.1)
    (row,) = accuracy(table_of([((1, 0), values)]), seed=0, contacts=(1,))

    assert row.hits.tolist() == [[0.0, 1.0, 1.0]]


def test_numbers_of_contacts_that_too_few_classes_have_are_left_out(table):
    """In whatever order they are asked for; one class of two has three taps, which is not enough."""
    assert [row.contacts for row in accuracy(table, seed=0, contacts=(20, 3, 2, 1))] == [2, 1]
    assert [row.contacts for row in accuracy(table, seed=0)] == [1, 2]


def test_the_prior_takes_part():
    """An impossible class is never the answer."""
    table = table_of([((0, 0), for_class(1, 1))])
    prior = np.full((L, M), np.log(1 / 5))
    prior[1, 1] = -np.inf
    (row,) = accuracy(table._replace(log_prior=prior), seed=0, contacts=(1,))

    assert row.hits.tolist() == [[1.0, 1.0, 1.0]]


def test_taps_that_leave_no_class_count_as_wrong():
    """Also where class 0 would be the answer to nothing."""
    (row,) = accuracy(table_of([((0, 0), -np.inf), ((1, 2), for_class(1, 2))]), seed=0)

    assert row.hits.tolist() == [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]


def test_the_seed_decides_the_draws():
    """And nothing else does."""
    rng = np.random.default_rng(0)
    taps = [((i % L, i % M), rng.normal(size=(L, M))) for i in range(60)]
    first, again, other = (accuracy(table_of(taps), seed, (3,))[0].hits for seed in (0, 0, 1))

    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_summaries_weigh_classes_by_their_taps():
    """3 taps at 1/3, 1 at 1 and 4 at 1/2 are 4 of 8 right; without resamples there is no interval."""
    hits = np.array([[1 / 3, 1.0, 0.0], [1.0, 1.0, 0.0], [0.5, 1.0, 1.0]])
    summary = summarise([Accuracy(1, 3, hits, np.array([3.0, 1.0, 4.0]))])

    assert (summary["contacts"], summary["classes"]) == (1, 3)
    assert (summary["joint"], summary["where"], summary["what"]) == (0.5, 1.0, 0.5)
    assert np.isnan(summary["joint_low"])


def test_one_data_set_has_intervals_of_resamples():
    """Those of the resampled means, between 0 and 1."""
    resampled = np.column_stack([np.linspace(0.3, 0.5, 5), np.ones(5), np.linspace(0.6, 1.0, 5)])
    summary = summarise(
        [Accuracy(1, 1, np.array([[0.5, 1.0, 0.9]]), np.array([4.0]), resampled=resampled)],
        Spread(1.2, taps=1000),
    )

    low, high = Spread(1.2).interval(np.append(0.5, resampled[:, 0]), 0.0, 1.0)
    assert (summary["joint_low"], summary["joint_high"]) == pytest.approx((float(low), float(high)))
    assert (summary["where_low"], summary["where_high"]) == (1 - share_beyond(1000), 1.0)  # never wrong so far
    assert 0.9 < summary["what_high"] < 1.0


@pytest.mark.parametrize("factor", [1.0, 1.5])
def test_several_data_sets_have_t_intervals_between_them(factor):
    """As much wider as sessions that share their training need."""
    shares = np.array([0.5, 0.55, 0.6])
    rows = [Accuracy(1, 1, np.full((1, 3), share), np.array([4.0])) for share in shares]
    summary = summarise(rows, Spread(factor, taps=1000))
    half = factor * t.ppf(0.975, 2) * shares.std(ddof=1) / np.sqrt(3)

    assert (summary["joint_low"], summary["joint_high"]) == pytest.approx((0.55 - half, 0.55 + half))


def test_a_single_position_is_never_wrong():
    """Objects may be, so only their interval reaches below one where every tap is right."""
    pool = tap_pool(np.zeros(12, int), np.arange(12) % 3, (1, 3))
    log_likelihood = 50.0 * (np.arange(3) == np.arange(12)[:, np.newaxis] % 3)[:, np.newaxis]
    table = TapTable(log_likelihood, pool, np.log(np.full((1, 3), 1 / 3)))
    rows = accuracy(table, 0, (1,), pools=list(thinned_pools(table, 5, 0))[1:])
    summary = summarise(rows, spread(table, thinned=True))
    scores = class_scores({"only": table}, 0, (1,), resamples=5).sel(model="only", contacts=1)

    assert (summary["where_low"], summary["where"], summary["where_high"]) == (1.0, 1.0, 1.0)
    assert summary["what_low"] == summary["joint_low"] == pytest.approx(1 - share_beyond(12))
    assert (float(scores.accuracy_where_low), float(scores.accuracy_where_high)) == (1.0, 1.0)
    assert float(scores.accuracy_what_low) == pytest.approx(1 - share_beyond(12))


@pytest.mark.slow
def test_resamples_vary_as_new_taps_would():
    """Of 300 sets of 12 taps that are right half the time, intervals of one and of two contacts hold the truth."""
    rng = np.random.default_rng(5)
    held = np.zeros((300, 2))
    truth = 0.6, 0.36 + 2 * 0.6 * 0.4 * 0.7  # a right tap speaks louder than a wrong one, in seven tenths of the pairs
    for i in range(len(held)):
        right = rng.random(24) < truth[0]
        louder = np.where(right, 2.0, np.where(rng.random(24) < 0.7, 1.0, 3.0))
        taps = [((0, m), for_class(0, m if r else 2, s)) for m, r, s in zip([0, 1] * 12, right, louder, strict=True)]
        table = table_of(taps)
        pools = list(thinned_pools(table, 60, i))[1:]
        for j, row in enumerate(accuracy(table, i, (1, 2), pools)):
            summary = summarise([row], spread(table, thinned=True))
            held[i, j] = summary["joint_low"] <= truth[j] <= summary["joint_high"]

    assert (np.abs(held.mean(axis=0) - 0.95) < 0.05).all()


def test_fewer_draws_on_resamples_do_not_widen_intervals(monkeypatch):
    """Two draws of each class or fifty: the noise of the draws is taken out."""
    rng = np.random.default_rng(2)
    taps = [((i % L, i % M), rng.normal(size=(L, M)) + for_class(i % L, i % M, 1.0)) for i in range(60)]
    table = table_of(taps)
    pools = list(thinned_pools(table, 300, 0))[1:]
    widths = []
    for draws in (1, 300):
        monkeypatch.setattr("solidtouch.analysis.stats.contacts._RESAMPLED_DRAWS", draws)
        summary = summarise(accuracy(table, 0, (2,), pools))
        widths.append(summary["joint_high"] - summary["joint_low"])

    assert widths[0] == pytest.approx(widths[1], rel=0.35)


def test_several_data_sets_are_the_units_that_vary():
    """Their taps are pooled, and the interval is that of their own means."""
    rows = [
        Accuracy(1, 2, np.array([[0.2, 1.0, 0.0], [0.6, 1.0, 0.0]]), np.array([3.0, 1.0])),
        Accuracy(1, 1, np.array([[0.5, 1.0, 1.0]]), np.array([4.0])),
        Accuracy(1, 1, np.array([[0.4, 1.0, 1.0]]), np.array([4.0])),
    ]
    summary = summarise(rows)
    half = t.ppf(0.975, 2) * np.std([0.3, 0.5, 0.4], ddof=1) / np.sqrt(3)

    assert (summary["contacts"], summary["classes"]) == (1, 2)
    assert summary["joint"] == pytest.approx(0.4)
    assert summary["joint_high"] == pytest.approx(0.4 + half)
