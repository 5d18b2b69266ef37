"""The jackknife over units and its intervals."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import t, ttest_1samp
from solidtouch.analysis.stats.jackknife import interval, jackknife

N = 14


def test_the_jackknife_of_a_mean_is_the_t_interval(rng):
    """Also of a paired difference."""
    first, second = rng.normal(size=(2, N))
    value, error = jackknife([first, second], lambda a, b: np.array([b - a]))
    expected = ttest_1samp(second - first, 0.0).confidence_interval(0.95)
    found = interval(value[0], error[0], N, 7)
    assert (found.low, found.high) == pytest.approx(tuple(expected))
    wide = t.ppf(1 - 0.025 / 7, N - 1) * error[0]
    assert (found.least, found.most) == pytest.approx((value[0] - wide, value[0] + wide))


def test_the_jackknife_of_a_ratio_leaves_out_one_unit_at_a_time(rng):
    above, below = rng.gamma(4, size=(2, N))
    value, error = jackknife([above, below], lambda a, b: np.array([a / b]))
    left = [np.delete(above, i).mean() / np.delete(below, i).mean() for i in range(N)]
    assert value[0] == above.mean() / below.mean()
    assert error[0] == pytest.approx(np.sqrt((N - 1) * np.var(left)))


def test_one_unit_has_no_interval():
    value, error = jackknife([np.array([2.0])], lambda mean: np.array([mean]))
    assert value == [2.0]
    assert np.isnan(interval(value[0], error[0], 1, 3).low)


def test_wider_for_more_intervals():
    """Intervals that hold together widen with their number."""
    widths = [np.ptp(interval(0.0, 1.0, N, n)[3:]) for n in (1, 10, 1000)]
    assert all(a < b for a, b in pairwise(widths))
    assert interval(0.0, 1.0, N, 1)[1:3] == interval(0.0, 1.0, N, 1)[3:]


def test_below_five_units_nothing_is_sure():
    """However small the error: the simultaneous interval has no ends, that of one number has."""
    few, enough = (interval(3.0, 1e-9, n, 8) for n in (4, 5))
    assert not few.sure
    assert (few.least, few.most) == (-np.inf, np.inf)
    assert few.high - few.low < 1e-7
    assert enough.sure
