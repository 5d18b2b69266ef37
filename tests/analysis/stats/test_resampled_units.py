"""Resamples of the test taps as units of a comparison."""

import numpy as np
import pytest
from scipy.stats import t
from solidtouch.analysis.stats.jackknife import jackknife
from solidtouch.analysis.stats.resampled_units import (
    RESAMPLES,
    left_out_units,
    resampled_sentence,
    resampled_table,
    resampled_tables,
    units_of,
)
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.trials.resampling import Spread, spread
from solidtouch.models.grid import tap_pool

L, M, N = 2, 3, 12


@pytest.fixture
def table(rng):
    """N taps of each class, in an order of their own."""
    cell = rng.permutation(np.repeat(np.arange(L * M), N))
    pool = tap_pool(cell // M, cell % M, (L, M))
    return TapTable(np.zeros((len(cell), L, M)), pool, np.zeros((L, M)), session=np.zeros(len(cell), int))


def test_their_standard_error_is_that_of_a_mean_of_taps(table, rng):
    """Of one number for each tap: the root of the sum of squares over classes, over the taps of each."""
    value = rng.normal(size=L * M * N) * (1 + np.arange(L * M * N) % 2)
    tables = resampled_tables(table, 2000, 3)
    units = units_of([np.array([value[one.pool.order].mean()]) for one in tables], spread(tables[0]))
    mean, error = jackknife([units], lambda means: means)
    of_class = [value[table.pool.order[f : f + N]] for f in table.pool.first.flat]
    expected = np.sqrt(np.sum([own.var(ddof=1) / N for own in of_class])) / (L * M)

    np.testing.assert_allclose(mean, value.mean())
    np.testing.assert_allclose(error, expected, rtol=0.06)


def test_without_resamples_the_estimate_is_the_only_unit(table):
    tables = resampled_tables(table, 0, 0)
    assert len(tables) == 1
    assert tables[0].pool is table.pool
    np.testing.assert_array_equal(units_of([np.arange(3.0)], spread(tables[0])), [[0, 1, 2]])


def test_a_nonlinear_statistic_keeps_its_value(table, rng):
    """Units are spread around the estimate, not around the mean of resamples."""
    samples = [np.array([2.0, 4.0]), *rng.normal((3, 5), 0.01, (RESAMPLES, 2))]
    value, error = jackknife([units_of(samples, spread(table))], lambda m: m[:1] / m[1:])

    np.testing.assert_allclose(value, 0.5)
    slope = np.array([1 / 4, -2 / 16])
    drawn = np.array(samples[1:])
    np.testing.assert_allclose(error, np.sqrt(N / (N - 1)) * (drawn @ slope).std(ddof=1), rtol=0.01)


def test_few_taps_are_said(make_taps):
    few, enough = (make_taps(repeats=repeats, sessions=1) for repeats in (6, 20))
    assert "Too few test taps, about 6 per class" in resampled_sentence(few, few.grid())
    assert resampled_sentence(enough, enough.grid()).endswith("not another session or recording.")
    several = make_taps(repeats=3, sessions=2)
    assert "the 2 test sessions, left out one at a time" in resampled_sentence(several, several.grid())
    assert "Too few test sessions, 2" in resampled_sentence(several, several.grid())


def test_one_tap_of_a_class_gives_the_estimate_as_the_only_unit():
    """There is no interval then, and no number is lost."""
    pool = tap_pool(np.zeros(2, int), np.arange(2), (1, 2))
    table = TapTable(np.zeros((2, 1, 2)), pool, np.zeros((1, 2)))
    samples = [np.array([2.0, 4.0])] * 5
    np.testing.assert_array_equal(units_of(samples, spread(table)), [[2, 4]])


@pytest.mark.parametrize("number", [0, 1, 4])
def test_a_resample_by_its_number(table, number):
    one = resampled_table(table, number, 7).pool
    np.testing.assert_array_equal(one.order, resampled_tables(table, number, 7)[number].pool.order)


def test_units_lie_further_apart_where_sessions_are_of_unequal_sizes():
    """As far as Student's t of the fewer degrees of freedom asks for."""
    how = Spread(2.0, freedom=1.5, sessions=5)
    samples = [np.array(0.0), *map(np.array, (1.0, -1.0, 2.0, 0.5, 3.0))]
    wide, plain = (units_of(samples, one) for one in (how, how._replace(freedom=4.0)))
    np.testing.assert_allclose(wide, plain * t.isf(0.025, 1.5) / t.isf(0.025, 4))


def test_sessions_are_units_where_several_test():
    """With the jackknife's standard error of a mean over sessions."""
    pool = tap_pool(np.zeros(18, int), np.repeat([0, 1], 9), (1, 2))
    table = TapTable(np.zeros((18, 1, 2)), pool, np.zeros((1, 2)), session=np.arange(18) % 3)
    score = np.random.default_rng(0).normal(size=len(table.log_likelihood)) + table.session
    tables = resampled_tables(table, 6, 0)
    units = units_of([np.array(score[one.pool.order].mean()) for one in tables], spread(tables[0]))
    own = [score[table.pool.order][table.session[table.pool.order] == s].mean() for s in range(3)]
    assert len(units) == 3
    assert units.mean() == pytest.approx(np.mean(own))
    assert units.std(ddof=1) == pytest.approx(np.std(own, ddof=1))


@pytest.mark.parametrize("F", [2, 3, 12])
def test_sessions_left_out_in_turn_are_further_apart_than_their_means(F, rng):
    """Their mean stays, and its variance is 1 / F + 1 / (F - 1) times theirs."""
    means = rng.normal(size=(F, 4, 2))
    value, error = jackknife([left_out_units(means)], lambda mean: mean)
    np.testing.assert_allclose(value, means.mean(axis=0))
    np.testing.assert_allclose(error**2, (1 / F + 1 / (F - 1)) * means.var(axis=0, ddof=1))
