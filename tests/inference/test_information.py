"""Expected information of the next tap against sums over taps and classes written as loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.inference import reference
from solidtouch.inference.information import (
    ABOUT,
    information,
    information_of_moves,
    moves_to_all,
    shifted,
    tap_outcomes,
)
from solidtouch.models.errors import InputError

L, M, N = 4, 3, 11


def entropy(p):
    """Of a distribution in nats, term by term."""
    return -sum(value * np.log(value) for value in np.ravel(p) if value > 0)


def brute_force(log_likelihood, belief, about):
    """Entropy now less the mean entropy of the posteriors after each tap of the pool; also of impossible classes."""
    marginal = {
        "joint": lambda b: b,
        "where": reference.where_marginal,
        "what": reference.what_marginal,
    }[about]
    size, (l_count, m_count) = len(log_likelihood), belief.shape
    likelihood = np.zeros((size, l_count, m_count))
    believed = np.zeros((l_count, m_count))
    for l in range(l_count):
        for m in range(m_count):
            total = sum(np.exp(log_likelihood[i, l, m]) for i in range(size))
            if total > 0:
                believed[l, m] = belief[l, m]
                for i in range(size):
                    likelihood[i, l, m] = np.exp(log_likelihood[i, l, m]) / total
    if believed.sum() == 0:
        return 0.0
    believed /= believed.sum()
    expected = entropy(marginal(believed))
    for i in range(size):
        probability = (believed * likelihood[i]).sum()
        if probability > 0:
            expected -= probability * entropy(marginal(believed * likelihood[i] / probability))
    return expected


@pytest.fixture
def pool(rng):
    """Log-likelihoods with some impossible taps."""
    log_likelihood = rng.normal(-3, 2, size=(N, L, M))
    log_likelihood[rng.random(log_likelihood.shape) < 0.2] = -np.inf
    return log_likelihood


def beliefs_of(rng, *lead):
    return rng.dirichlet(np.full(L * M, 0.4), size=lead).reshape(*lead, L, M)


@pytest.mark.parametrize("about", ABOUT)
@pytest.mark.parametrize("sizes", [(N, L, M), (1, L, M), (N, 1, M), (N, L, 1), (N, 1, 1), (2, 5, 7)])
def test_information_is_that_of_a_loop_over_taps(rng, about, sizes):
    """For any sizes, with impossible taps and with classes under which no tap is possible."""
    log_likelihood = rng.normal(-3, 2, size=sizes)
    log_likelihood[rng.random(sizes) < 0.3] = -np.inf
    log_likelihood[:, -1, -1] = -np.inf
    beliefs = rng.dirichlet(np.ones(sizes[1] * sizes[2]), size=9).reshape(9, *sizes[1:])
    expected = [brute_force(log_likelihood, belief, about) for belief in beliefs]

    np.testing.assert_allclose(information(tap_outcomes(log_likelihood), beliefs, about), expected, rtol=0, atol=1e-10)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(ABOUT), st.floats(0, 30), st.floats(0.01, 3))
def test_information_lies_between_nothing_and_the_entropy(seed, about, spread, concentration):
    """It agrees with the loop; that about everything is never less than that about one of the two."""
    rng = np.random.default_rng(seed)
    log_likelihood = spread * rng.normal(size=(N, L, M))
    belief = rng.dirichlet(np.full(L * M, concentration)).reshape(L, M)
    outcomes = tap_outcomes(log_likelihood)
    value = float(information(outcomes, belief, about))

    assert value == pytest.approx(brute_force(log_likelihood, belief, about), abs=1e-10)
    assert 0 <= value <= float(information(outcomes, belief)) + 1e-12
    assert value <= entropy(belief) + 1e-12


@pytest.mark.parametrize("border", reference.BORDERS)
def test_beliefs_shift_as_those_of_the_reference(rng, border):
    """By every move at once, also beyond the range, of all beliefs or of each."""
    beliefs = beliefs_of(rng, 2, 3)
    deltas = np.array([0, 1, -1, 3, -3, 4, -4, 9, -1000])
    expected = [[[reference.shift(b, d, border) for d in deltas] for b in row] for row in beliefs]
    own = rng.permuted(np.tile(deltas, (2, 3, 1)), axis=-1)
    expected_own = [[[reference.shift(beliefs[i, j], d, border) for d in own[i, j]] for j in range(3)] for i in (0, 1)]

    np.testing.assert_allclose(shifted(beliefs, deltas, border), expected, rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(shifted(beliefs, own, border), expected_own, rtol=1e-14, atol=1e-17)
    np.testing.assert_allclose(shifted(beliefs[0, 0], deltas, border), expected[0][0], rtol=1e-14, atol=1e-17)


@pytest.mark.parametrize("about", ABOUT)
def test_information_of_a_move_is_that_after_it(pool, rng, about):
    """Counted from the shifted belief, one move at a time."""
    belief, outcomes = beliefs_of(rng), tap_outcomes(pool)
    deltas = moves_to_all(belief)
    expected = [brute_force(pool, reference.shift(belief, d, "clamp"), about) for d in deltas]

    actual = information_of_moves(outcomes, belief, deltas, "clamp", about)
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-10)


def test_moves_to_all_classes_begin_where_the_sensor_most_probably_is(rng):
    beliefs = beliefs_of(rng, 5)
    expected = [[l - reference.where_decision(belief, 0) for l in range(L)] for belief in beliefs]

    assert moves_to_all(beliefs).tolist() == expected


@pytest.mark.parametrize("about", ABOUT)
def test_nothing_is_told_to_the_certain_nor_by_taps_that_are_all_the_same(pool, rng, about):
    """Nor by a pool of one tap, nor by taps that every class gives alike."""
    certain = np.zeros((L, M))
    certain[2, 1] = 1.0
    alike = np.broadcast_to(rng.normal(size=(N, 1, 1)), (N, L, M))

    assert information(tap_outcomes(pool), certain, about) == pytest.approx(0, abs=1e-13)
    assert information(tap_outcomes(np.zeros((N, L, M))), beliefs_of(rng), about) == pytest.approx(0, abs=1e-13)
    assert information(tap_outcomes(pool[:1]), beliefs_of(rng), about) == pytest.approx(0, abs=1e-13)
    assert information(tap_outcomes(alike), beliefs_of(rng), about) == pytest.approx(0, abs=1e-13)


def test_taps_that_give_away_the_class_tell_all_there_is_to_know(rng):
    """The entropy of the belief, of its where and of its what marginal."""
    log_likelihood = np.where(np.eye(L * M) > 0, 0.0, -np.inf).reshape(L * M, L, M)
    belief, outcomes = beliefs_of(rng), tap_outcomes(log_likelihood)

    assert information(outcomes, belief) == pytest.approx(entropy(belief))
    assert information(outcomes, belief, "where") == pytest.approx(entropy(belief.sum(1)))
    assert information(outcomes, belief, "what") == pytest.approx(entropy(belief.sum(0)))


@pytest.mark.parametrize("about", ABOUT)
def test_the_order_of_taps_and_of_classes_does_not_matter(pool, rng, about):
    """Classes are permuted in the belief alike."""
    belief, where, what = beliefs_of(rng), rng.permutation(L), rng.permutation(M)
    expected = information(tap_outcomes(pool), belief, about)
    permuted = tap_outcomes(rng.permutation(pool)[:, where][:, :, what])

    np.testing.assert_allclose(information(permuted, belief[where][:, what], about), expected, rtol=1e-12)


@pytest.mark.parametrize("about", ABOUT)
def test_likelihoods_of_any_scale_are_taken(pool, rng, about):
    """A factor common to all taps of a class drops out, however small; a tap that is there twice tells the same."""
    belief = beliefs_of(rng)
    expected = information(tap_outcomes(pool), belief, about)
    scaled = pool - 1e5 * rng.random((L, M))

    np.testing.assert_allclose(information(tap_outcomes(scaled), belief, about), expected, rtol=1e-9)
    np.testing.assert_allclose(information(tap_outcomes(np.repeat(pool, 2, 0)), belief, about), expected, rtol=1e-12)


def test_belief_in_impossible_classes_alone_learns_nothing(pool):
    """There is no tap to come; with other classes they are left out."""
    pool[:, 1] = -np.inf
    outcomes = tap_outcomes(pool)
    lost = np.zeros((L, M))
    lost[1, 0] = 1.0

    assert [float(information(outcomes, lost, about)) for about in ABOUT] == [0, 0, 0]
    assert not outcomes.possible[1].any()


@pytest.mark.parametrize("about", ABOUT)
def test_other_beliefs_at_the_same_time_change_nothing(pool, rng, about):
    beliefs, outcomes = beliefs_of(rng, 3, 5), tap_outcomes(pool)
    expected = [[information(outcomes, belief, about) for belief in row] for row in beliefs]

    np.testing.assert_allclose(information(outcomes, beliefs, about), expected, rtol=1e-14)
    assert information(outcomes, beliefs[:0], about).shape == (0, 5)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda outcomes: information(outcomes, np.ones((M, L))),
            r"4 x 3 classes, but the beliefs have shape \(3, 4",
        ),
        (
            lambda outcomes: information(outcomes, np.ones((L, M)), "which"),
            "about must be one of joint, where, what, got 'which'",
        ),
        (lambda _: shifted(np.ones((L, M)), [1], "wall"), "border must be one of uniform, .*, got 'wall'"),
        (lambda _: tap_outcomes(np.zeros((0, L, M))), r"at least one tap, got shape \(0, 4, 3\)"),
        (
            lambda _: tap_outcomes(np.zeros((L, M))),
            r"axes \(tap, where, what\) and at least one tap, got shape \(4, 3\)",
        ),
        (lambda _: tap_outcomes(np.full((2, L, M), np.nan)), r"NaN or \+inf"),
        (lambda _: tap_outcomes(np.full((2, L, M), np.inf)), r"NaN or \+inf"),
    ],
)
def test_what_makes_no_sense_is_refused(pool, call, message):
    with pytest.raises(InputError, match=message):
        call(tap_outcomes(pool))


@pytest.mark.parametrize("shape", [(1, 2, 3), (4, 1, 1), (5, 3, 2)])
def test_the_likelihoods_stay_as_they_were(rng, shape):
    """Also of a single tap or class, whose axes are in order already."""
    log_likelihood = rng.normal(size=shape)
    before = log_likelihood.copy()
    tap_outcomes(log_likelihood)
    assert log_likelihood.tolist() == before.tolist()
