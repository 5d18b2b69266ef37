"""The route from raw taps, against numbers worked out by hand."""

import numpy as np
import pytest
from solidtouch.inference import reference
from solidtouch.inference.raw import LabelledTaps, Options, RawFilter

L, M, J, K, B = 3, 2, 2, 2, 4
TRAIN = LabelledTaps(
    np.array(
        [[[0.0, 8.0], [1.0, 4.0]], [[3.9, 4.1], [4.0, 8.0]], [[2.0, 2.0], [6.0, 6.0]], [[9.0, -9.0], [9.0, -9.0]]]
    ),
    np.array([0, 2, 2, -1]),
    np.array([0, 0, 1, 1]),
)
"""Three taps of three classes in a range from 0 to 8, and one outside the grid."""


@pytest.fixture
def learned():
    return RawFilter.learn(TRAIN, (L, M), Options(bins=B, pseudocount=0.5))


def test_edges_span_the_taps_of_the_grid(learned):
    np.testing.assert_array_equal(learned.edges, [0, 2, 4, 6, 8])


def test_edges_of_each_taxel():
    learned = RawFilter.learn(TRAIN, (L, M), Options(bins=2, value_range="taxel"))

    np.testing.assert_array_equal(learned.edges, [[0, 3, 6], [2, 5, 8]])


@pytest.mark.parametrize(("value", "margin"), [(3.0, 0.5), (2.0**60, 8 * 4 * 2.0**8)])
def test_a_constant_range_is_widened(value, margin):
    """By half a unit, or by what it takes to tell edges apart."""
    edges = reference.bin_edges(np.full((2, J, K), value), 4)

    assert (edges[0], edges[-1]) == (value - margin, value + margin)
    assert (np.diff(edges) > 0).all()


@pytest.mark.parametrize(("bins", "value_range"), [(0, "global"), (4, "all")])
def test_edges_that_cannot_be_are_refused(bins, value_range):
    with pytest.raises(ValueError, match="B must be at least 1 and value_range global or taxel"):
        reference.bin_edges(TRAIN.samples, bins, value_range)


def test_histograms_are_those_of_the_classes(learned):
    """Counts per class and taxel, half a count more in each bin; the axes are where, what, taxel, bin."""
    expected = np.full((L, M, K, B), -np.inf)
    expected[0, 0] = np.log([[2.5, 0.5, 0.5, 0.5], [0.5, 0.5, 1.5, 1.5]]) - np.log(4)
    expected[2, 0] = np.log([[0.5, 1.5, 1.5, 0.5], [0.5, 0.5, 1.5, 1.5]]) - np.log(4)
    expected[2, 1] = np.log([[0.5, 1.5, 0.5, 1.5], [0.5, 1.5, 0.5, 1.5]]) - np.log(4)

    np.testing.assert_allclose(learned.log_prob, expected, rtol=1e-15)


def test_the_prior_is_flat_over_trained_classes(learned):
    np.testing.assert_array_equal(learned.trained, [[True, False], [False, False], [True, True]])
    np.testing.assert_allclose(np.exp(learned.log_prior), learned.trained / 3)


@pytest.mark.parametrize(("power", "exponent"), [("J", 1 / J), ("JK", 1 / (J * K)), ("none", 1.0), (0.3, 0.3)])
def test_a_tap_is_judged_by_its_bins_under_the_power(power, exponent):
    """By Eq. 1 and 3 written out; samples beyond the range count for the end bins."""
    learned = RawFilter.learn(TRAIN, (L, M), Options(bins=B, pseudocount=0.5, power=power))
    log_belief, log_evidence = learned.update(learned.log_prior, np.array([[-5.0, 2.5], [5.0, 9.0]]))
    product = np.array([[5 * 1 * 1 * 3, 0], [0, 0], [1 * 3 * 1 * 3, 1 * 3 * 1 * 3]]) / 8.0**4
    weight = product**exponent / 3

    np.testing.assert_allclose(np.exp(log_belief), weight / weight.sum(), rtol=1e-13)
    np.testing.assert_allclose(np.exp(log_evidence), weight.sum(), rtol=1e-13)


@pytest.mark.parametrize("border", ["uniform", "clamp"])
def test_a_move_carries_the_belief(border):
    """Within the trained classes, under the border of the options."""
    learned = RawFilter.learn(TRAIN, (L, M), Options(bins=B, border=border))
    log_prior = learned.log_prior

    expected = reference.shift_log(log_prior, 1, border, learned.trained)
    np.testing.assert_array_equal(learned.shift(log_prior, 1), expected)


@pytest.mark.parametrize(("taps", "limit", "power"), [(1, 2.0, 1.0), (2, 2.0, 1.0), (8, 2.0, 0.25), (5, np.inf, 1.0)])
def test_a_belief_is_read_with_a_limit(taps, limit, power):
    belief = np.array([[0.1, 0.2], [0.7, 0.0]])
    with np.errstate(divide="ignore"):
        read = np.exp(reference.saturated(np.log(belief), taps, limit))

    np.testing.assert_allclose(read, belief**power / (belief**power).sum())


CLEAR = LabelledTaps(
    np.array([0.5, 1.5, 2.5, 3.5, 4.5, 5.5])[:, None, None] * np.ones((6, J, 1)),
    np.array([0, 1, 2, 0, 1, 2]),
    np.array([0, 0, 0, 1, 1, 1]),
)
"""One tap of each class, no two alike."""


def test_a_trial_goes_where_it_should():
    """The first tap tells all, and the finger moves to the fixation point."""
    learned = RawFilter.learn(CLEAR, (3, 2), Options(bins=6, power="none"))
    early, late = learned.trial(CLEAR, (0, 1), 2, iter([0.0, 0.0]), [0.9, 1.0], 2)

    assert early[:5] == (1, 1, 0, 0, True)
    assert late[:5] == (2, 1, 2, 2, False)
    assert 0.99 < early.belief < late.belief <= 1


def test_a_trial_picks_its_taps_by_the_numbers():
    """In the order of the recording; a class without a tap gives those of the nearest with one, the lower of two."""
    taps = LabelledTaps(np.arange(5.0)[:, None, None], np.array([0, 2, 2, 2, 0]), np.array([0, 0, 0, 0, 1]))
    learned = RawFilter.learn(taps, (3, 2), Options(bins=5, pseudocount=0.01, power="none"))
    seen = []
    object.__setattr__(learned, "update", lambda belief, tap: (seen.append(tap.item()), (belief, 0.0))[1])
    learned.trial(taps, (1, 0), 2, iter([0.0, 0.0, 0.34, 0.99]), [1.0], 4)

    assert seen == [0.0, 1.0, 2.0, 3.0]


def test_a_trial_ends_where_no_class_is_left():
    """Undecided, with what was believed before the tap."""
    learned = RawFilter.learn(CLEAR, (3, 2), Options(bins=6, pseudocount=0.0, power="none"))
    strange = CLEAR._replace(samples=np.where(CLEAR.samples == 5.5, [[0.5], [5.5]], CLEAR.samples))
    (end,) = learned.trial(strange, (0, 1), 2, iter([0.0, 0.0]), [1.0], 9)

    assert end == (2, 1, 2, 2, False, True, 1.0)


def test_saturation_delays_a_trial():
    """What is read after n taps is never surer than after the limit."""
    samples = np.array([0.0, 1.0, 0.0, 1.0, 0.0])[:, None, None]
    taps = LabelledTaps(samples, np.zeros(5, dtype=int), np.array([0, 0, 1, 1, 0]))
    free, limited = (
        RawFilter.learn(taps, (1, 2), Options(bins=2, power="none", saturation=limit)) for limit in (np.inf, 1.0)
    )
    ends = [learned.trial(taps, (0, 0), 0, iter([0.0] * 9), [0.9], 9)[0] for learned in (free, limited)]

    assert ends[0].stopped
    assert (ends[1].taps, ends[1].stopped) == (9, False)
    assert ends[1].belief == pytest.approx(2.01 / 3.02 / (2.01 / 3.02 + 0.5))


@pytest.mark.parametrize("limit", [np.inf, 0.5])
def test_a_first_tap_may_leave_no_class(limit):
    """Then the answer is the prior's, whatever the saturation."""
    learned = RawFilter.learn(CLEAR, (3, 2), Options(bins=6, pseudocount=0.0, power="none", saturation=limit))
    strange = CLEAR._replace(samples=np.broadcast_to([[0.5], [5.5]], CLEAR.samples.shape))
    (end,) = learned.trial(strange, (1, 1), 2, iter([0.0]), [1.0], 9)

    assert end[:6] == (1, 0, 0, 1, False, True)
    assert end.belief == pytest.approx(0.5)
