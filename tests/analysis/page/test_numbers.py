"""Numbers as text."""

import doctest

import numpy as np
import pytest
from solidtouch.analysis.page import numbers
from solidtouch.analysis.page.numbers import bounded, factor, interval, number, percent


@pytest.mark.parametrize(
    ("value", "printed"),
    [(0.0098, "0.0098"), (12.345, "12.3"), (1234.5, "1234"), (2e7, "2e+07"), (10**7, "10000000"), (np.int64(3), "3"),
     (np.float32(0.5), "0.5"), (0.0, "0"), (True, "True"), ("J", "J"), (float("inf"), "–")],
)  # fmt: skip
def test_numbers_have_sensible_digits(value, printed):
    """Three significant digits; whole numbers are exact."""
    assert printed == number(value)


@pytest.mark.parametrize(
    ("value", "low", "high", "printed"),
    [
        (0.43217, 0.401, 0.463, "0.43 [0.40, 0.46]"),
        (0.0012, 0.0, 0.0043, "0.0012 [0.0000, 0.0043]"),
        (1.0, 1.0, 1.0, "1 [1, 1]"),
        (1240.2, 1010.7, 1500.1, "1240 [1011, 1500]"),
        (0.77, 0.0, 4.553, "0.8 [0.0, 4.6]"),
        (-0.7, -3.2, 5.2, "−1 [−3, 5]"),
        (2.345, None, 3.0, "2.35"),
        (2.345, float("nan"), 3.0, "2.35"),
    ],
)
def test_intervals_set_the_digits(value, low, high, printed):
    """A value has the digits that its interval supports; without one, three."""
    assert printed == interval({"x": value, "x_low": low, "x_high": high}, "x") == bounded(value, low, high)


@pytest.mark.parametrize(
    ("values", "printed"),
    [
        ((0.77, 0.0, 4.553), "0.8 [0.0, 4.6]"),
        ((7.1, 1.46, 41.3), "7.1 [1.5, 41.3]"),
        ((0.06, 7.9e-05, 27.0), "0.1 [0.0, 27.0]"),
        ((1.02, 0.981, 1.043), "1.02 [0.98, 1.04]"),
        ((0.2, 0.0, 1e9), "0.2 [0.0, >99]"),
        ((1.5, 1.5, 1.5), "1.5 [1.5, 1.5]"),
    ],
)
def test_factors_follow_the_same_rule(values, printed):
    """The interval sets the decimals, of which a factor keeps one at least."""
    assert factor(values) == printed


def test_fractions_are_printed_in_per_cent():
    """One decimal at most."""
    assert [percent(0.0481), percent(1), percent(None)] == ["4.8%", "100%", "–"]


def test_the_examples_of_the_docstrings_hold():
    """Examples are what the functions really return."""
    assert doctest.testmod(numbers).failed == 0
