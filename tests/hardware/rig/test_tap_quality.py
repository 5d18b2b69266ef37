"""A tap that no finger can make is recognised, a tap that one can is let through."""

import numpy as np
import pytest
from solidtouch.hardware.skin.monitor import implausible

J, K, LEAD, LIMIT = 30, 4, 7, 5.0


@pytest.fixture
def tap(rng):
    """A smooth press on two of the taxels with the noise of an idle sensor."""
    press = np.clip(np.sin(np.linspace(-0.8, 4.0, J)), 0, None)
    press[:LEAD] = 0
    return rng.normal(scale=1.5, size=(J, K)) + press[:, np.newaxis] * [90.0, 0.0, 40.0, 0.0]


def test_a_press_that_comes_back_is_plausible(tap):
    assert implausible(tap, LEAD, LIMIT) is None


@pytest.mark.parametrize("jump", [16.0, -16.0, 128.0])
@pytest.mark.parametrize("j", [1, 15, J - 2])
def test_a_value_off_for_one_reading_is_named(tap, j, jump):
    tap[:, 1] = np.round(tap[:, 1] / 10)
    tap[j, 1] += jump

    assert "taxel 1 jumped" in implausible(tap, LEAD, LIMIT)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("step", [1, -1])
def test_a_steady_rise_to_the_turning_point_is_plausible(sign, step):
    """On one side the line through two neighbours ends in it, and what lies beyond it is the jump."""
    tap = sign * np.array([0.0, 40, 80, 120, 100, 100, 100])[::step, np.newaxis]
    assert implausible(tap, 0, LIMIT) is None

    tap[3] += sign * 16
    assert implausible(tap, 0, LIMIT) == "taxel 0 jumped by 16 for one reading"


@pytest.mark.parametrize("shift", [20.0, -20.0])
def test_a_taxel_that_rests_elsewhere_afterwards_is_named(tap, shift):
    tap[12:, 3] += shift

    assert "taxel 3 returned to" in implausible(tap, LEAD, LIMIT)


def test_without_a_limit_everything_is_plausible(tap):
    assert implausible(1000 * tap, LEAD, np.inf) is None


@pytest.mark.parametrize("size", [1, 2, 3])
def test_short_taps_are_no_error(rng, size):
    assert implausible(rng.normal(size=(size, K)), 0, LIMIT) is None
