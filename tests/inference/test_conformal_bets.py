"""Bets that have mean 1 at most given the calibration taps: their bounds, on exact cases, and what they win."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom
from solidtouch.inference.novelty import (
    EXPONENTS,
    calibration_needed,
    log_bets,
    log_mixture,
    ranks,
    soonest,
    upper_bounds,
)

ALPHA = 0.1


def chance_that_all_hold(n, bounds):
    """That of n uniform numbers at least r lie below the r-th bound at every rank, by adding up the ways."""
    left, low = {0: 1.0}, 0.0
    for r, bound in zip(ranks(n), bounds, strict=True):
        share, after = (bound - low) / (1 - low), {}
        for below, chance in left.items():
            for more in range(n - below + 1):
                if below + more >= r:
                    after[below + more] = after.get(below + more, 0) + chance * binom.pmf(more, n - below, share)
        left, low = after, bound
    return sum(left.values())


@pytest.mark.parametrize("classes", [1, 12])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 20, 60])
def test_all_bounds_hold_together_with_the_confidence(n, classes):
    """Exactly as often with one rank, a little more with several; those of all classes by independence."""
    chance = chance_that_all_hold(n, upper_bounds(n, classes, 0.8)) ** classes

    assert chance >= 0.8 - 1e-9
    assert chance == pytest.approx(0.8, abs=1e-9) if len(ranks(n)) == 1 else chance < 0.88


def test_bounds_written_out():
    """Of one calibration tap, and of the worst of two."""
    assert upper_bounds(1, 1, 0.8) == pytest.approx([0.8])
    assert upper_bounds(2, 1, 0.75) == pytest.approx([0.5])
    assert upper_bounds(1, 2, 0.81) == pytest.approx([0.9])
    assert ranks(9).tolist() == [1, 2, 4]
    assert len(upper_bounds(0, 3)) == 0


@given(st.integers(1, 40), st.integers(1, 30), st.integers(0, 10**6))
def test_bets_win_nothing_where_their_bounds_hold(n, classes, seed):
    """The mean given calibration taps is 1 at most for every exponent, and 1 where chances are as large as bounds."""
    bounds = upper_bounds(n, classes)
    won = np.exp(log_bets(bounds))
    chances = bounds * np.random.default_rng(seed).uniform(size=len(bounds))
    chances = np.minimum.accumulate(chances[::-1])[::-1]

    np.testing.assert_allclose(won @ np.diff(np.concatenate([[0], bounds, [1]])), 1)
    assert (won @ np.diff(np.concatenate([[0], chances, [1]])) <= 1 + 1e-12).all()
    assert (np.diff(won, axis=1) < 0).all()
    assert (won[:, 0] > 1).all()


def test_without_calibration_nothing_is_bet():
    assert (log_bets(upper_bounds(0, 5)) == 0).all()


def test_alarms_at_known_taps_keep_the_level_given_calibration():
    """At chances as large as the bounds allow, 2000 episodes of 100 taps: alpha at most, and not far below."""
    bounds = upper_bounds(20, 10)
    won = log_bets(bounds)
    steps = np.searchsorted(bounds, np.random.default_rng(0).uniform(size=(2000, 100)))
    wealth = log_mixture(won[:, steps].cumsum(axis=2))
    alarms = np.mean(wealth.max(axis=1) >= -np.log(ALPHA))

    assert 0.03 < alarms <= ALPHA


def test_a_fixed_calibration_set_needs_the_bounds():
    """The same bets from r / (n + 1): a quarter of the calibration sets give too many alarms, some nearly always."""
    generator, n, alarms = np.random.default_rng(1), 20, []
    usual = ranks(n) / (n + 1)
    for bounds in (usual, upper_bounds(n, 1)):
        found = []
        for _ in range(100):
            chances = np.sort(generator.uniform(size=n))[ranks(n) - 1]
            steps = np.searchsorted(chances, generator.uniform(size=(40, 100)))
            wealth = log_mixture(log_bets(bounds)[:, steps].cumsum(axis=2))
            found.append(np.mean(wealth.max(axis=1) >= -np.log(ALPHA)))
        alarms.append(np.array(found))

    assert np.mean(alarms[0] > ALPHA) > 0.25
    assert alarms[0].max() > 0.9
    assert np.mean(alarms[1] > ALPHA) <= 0.05


def test_the_soonest_alarm():
    """Bets that double come to 20 after five taps, by all exponents alike; those that win nothing never do."""
    assert soonest(np.full(len(EXPONENTS), np.log(2)), 0.05) == 5
    assert soonest(np.zeros(len(EXPONENTS)), 0.05) is None


def test_enough_calibration_taps_are_just_enough():
    needed = calibration_needed(10, 80, 0.05)
    taps = [soonest(log_bets(upper_bounds(n, 80))[:, 0], 0.05) for n in (needed - 1, needed)]

    assert taps[0] > 10 >= taps[1]
