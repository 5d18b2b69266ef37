"""Accuracy after fixed numbers of contacts, on tables whose answers are known."""

import numpy as np
import pytest
from scipy.stats import norm, t
from solidtouch.analysis.contacts import Accuracy, accuracy, accuracy_interval_sentence, summarise
from solidtouch.hardware.pool import tap_pool
from solidtouch.inference.trial_plan import TapTable

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
    monkeypatch.setattr("solidtouch.analysis.contacts._ENOUGH", 0.5)
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
    """3 taps at 1/3, 1 at 1 and 4 at 1/2 are 4 of 8 right; in one data set the classes vary."""
    hits = np.array([[1 / 3, 1.0, 0.0], [1.0, 1.0, 0.0], [0.5, 1.0, 1.0]])
    summary = summarise([Accuracy(1, 3, hits, np.array([3.0, 1.0, 4.0]))])
    deviations = np.array([3 * (1 / 3 - 0.5), 1 * (1.0 - 0.5), 0.0]) / 8
    half = norm.ppf(0.975) * np.sqrt((deviations**2).sum() * 3 / 2)

    assert (summary["contacts"], summary["classes"]) == (1, 3)
    assert (summary["joint"], summary["where"], summary["what"]) == (0.5, 1.0, 0.5)
    assert summary["joint_low"] == pytest.approx(0.5 - half)
    assert summary["joint_high"] == pytest.approx(0.5 + half)
    assert (summary["where_low"], summary["where_high"]) == (1.0, 1.0)


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
    assert "3 data sets" in accuracy_interval_sentence(3)
    assert "classes as the units" in accuracy_interval_sentence(1)


def test_intervals_stay_between_zero_and_one():
    """However few classes there are."""
    summary = summarise([Accuracy(5, 2, np.array([[1.0, 0.9, 0.1], [0.6, 1.0, 0.0]]), np.array([1.0, 1.0]))])

    for name in ("joint", "where", "what"):
        assert 0.0 <= summary[f"{name}_low"] <= summary[name] <= summary[f"{name}_high"] <= 1.0


def test_a_single_class_has_no_spread():
    """Its interval is a point instead of a division by zero."""
    summary = summarise([Accuracy(2, 1, np.array([[0.75, 1.0, 0.75]]), np.array([6.0]))])

    assert (summary["joint_low"], summary["joint_high"]) == (0.75, 0.75)
