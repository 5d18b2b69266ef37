"""Expected gain of the next tap against sums over taps and decisions written as loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.inference import reference
from solidtouch.inference.information import information, moves_to_all, tap_outcomes
from solidtouch.inference.moves.expected_gain import (
    checked_loss,
    decision_loss,
    expected_gain,
    expected_steps,
    gain_watch,
    representative_outcomes,
    risk_mover,
)
from solidtouch.inference.trials.symbols import quantised
from solidtouch.models.errors import InputError

L, M, N, A = 4, 3, 11, 5


def brute_loss(belief, loss):
    """Of the best decision, of a belief of any sum."""
    return min(sum(loss[a][m] * belief[l][m] for l in range(L) for m in range(M)) for a in range(len(loss)))


def brute_force(log_likelihood, belief, delta, loss, border="clamp"):
    """Loss now less the loss after a move and each tap of the pool; classes without a possible tap are left out."""
    likelihood = np.exp(log_likelihood)
    total = likelihood.sum(axis=0)
    moved = np.where(total > 0, reference.shift(belief, delta, border), 0.0)
    if moved.sum() == 0:
        return 0.0
    moved /= moved.sum()
    likelihood /= np.where(total > 0, total, 1.0)
    return brute_loss(belief, loss) - sum(brute_loss(moved * likelihood[i], loss) for i in range(N))


@pytest.fixture
def pool(rng):
    """Log-likelihoods with some impossible taps, and a class without any possible one."""
    log_likelihood = rng.normal(-3, 2, size=(N, L, M))
    log_likelihood[rng.random(log_likelihood.shape) < 0.2] = -np.inf
    log_likelihood[:, 1, 2] = -np.inf
    return log_likelihood


@pytest.fixture
def loss(rng):
    return rng.uniform(0, 3, size=(A, M))


def beliefs_of(rng, *lead):
    return rng.dirichlet(np.full(L * M, 0.4), size=lead).reshape(*lead, L, M)


@pytest.mark.parametrize("border", reference.BORDERS)
def test_gain_is_that_of_a_loop_over_taps_and_decisions(pool, loss, rng, border):
    """After each move, for any number of beliefs."""
    beliefs, deltas = beliefs_of(rng, 2, 6), np.array([0, 2, -1, -3])
    expected = [[[brute_force(pool, b, d, loss, border) for d in deltas] for b in row] for row in beliefs]

    gain = expected_gain(tap_outcomes(pool), beliefs, deltas, loss, border)
    np.testing.assert_allclose(gain, expected, rtol=0, atol=1e-10)


@settings(max_examples=50)
@given(st.integers(0, 2**32), st.floats(0, 30), st.floats(0.01, 3))
def test_gain_lies_between_nothing_and_the_loss_now(seed, spread, concentration):
    """After any move, under borders that keep what is believed of objects."""
    rng = np.random.default_rng(seed)
    outcomes, loss = tap_outcomes(spread * rng.normal(size=(N, L, M))), rng.uniform(0, 5, size=(A, M))
    belief = rng.dirichlet(np.full(L * M, concentration)).reshape(L, M)
    for border in ("clamp", "uniform_what", "circular"):
        gain = expected_gain(outcomes, belief, [0, 2, -3], loss, border)
        assert (gain >= 0).all()
        assert (gain <= decision_loss(belief, loss) + 1e-12).all()


def test_a_border_that_forgets_counts_against_the_move(rng):
    """After taps that tell nothing the gain of a move is what the shift has lost, and that of staying nothing."""
    belief, loss = beliefs_of(rng), 1 - np.eye(M)
    gain = expected_gain(tap_outcomes(np.zeros((N, L, M))), belief, [0, 2], loss, "uniform")
    lost = decision_loss(belief, loss) - decision_loss(reference.shift(belief, 2, "uniform"), loss)

    assert gain == pytest.approx([0, lost])
    assert lost < -0.01


def test_a_decided_belief_and_taps_that_are_all_alike_gain_nothing(pool, loss, rng):
    """A belief that is sure of the object gains nothing, whatever it knows of the place."""
    loss[:M] = 2 * (1 - np.eye(M))
    decided = np.zeros((L, M))
    decided[:, 1] = rng.dirichlet(np.ones(L))
    alike = np.broadcast_to(rng.normal(size=(N, 1, 1)), (N, L, M))

    assert expected_gain(tap_outcomes(pool), decided, [0, 1, -2], loss, "clamp").tolist() == [0, 0, 0]
    assert expected_gain(tap_outcomes(alike), beliefs_of(rng), [0, 3], loss, "clamp").tolist() == [0, 0]


def test_taps_that_give_away_the_object_gain_all_that_a_decision_costs(rng):
    """Under the clamp, which keeps what is believed of objects."""
    log_likelihood = np.where(np.arange(M)[:, None, None] == np.arange(M), np.zeros((L, 1)), -np.inf)
    belief, loss = beliefs_of(rng), 4 * (1 - np.eye(M))
    gain = expected_gain(tap_outcomes(log_likelihood), belief, [0, 2, -3], loss, "clamp")

    np.testing.assert_allclose(gain, decision_loss(belief, loss), rtol=1e-12)


def test_gain_scales_with_the_loss_and_does_not_mind_the_order_of_taps(pool, loss, rng):
    belief = beliefs_of(rng)
    expected = expected_gain(tap_outcomes(pool), belief, [1], loss)

    np.testing.assert_allclose(expected_gain(tap_outcomes(pool), belief, [1], 7 * loss), 7 * expected, rtol=1e-12)
    permuted = tap_outcomes(rng.permutation(pool))
    np.testing.assert_allclose(expected_gain(permuted, belief, [1], loss[::-1]), expected, rtol=1e-10)


def test_other_beliefs_at_the_same_time_change_nothing(pool, loss, rng):
    beliefs, outcomes = beliefs_of(rng, 3, 5), tap_outcomes(pool)
    expected = [[expected_gain(outcomes, belief, [0, 1], loss) for belief in row] for row in beliefs]

    np.testing.assert_allclose(expected_gain(outcomes, beliefs, [0, 1], loss), expected, rtol=1e-12)
    assert expected_gain(outcomes, beliefs[:0], [0, 1], loss).shape == (0, 5, 2)


def test_a_pool_of_taps_stands_for_all_taps_if_each_counts_as_rarely_as_it_was_drawn(make_model, rng):
    """Taps that come in a class as often as their symbol should, then give what the channel itself gives."""
    symbols = quantised(make_model(L, M, 2, 2, 6, taps=30, power="none", pseudocount=0.5), 7, 0, 150)
    with np.errstate(divide="ignore"):
        exact = tap_outcomes(np.moveaxis(np.log(symbols.channel), -1, 0))
    pool, beliefs, loss = symbols.table.log_likelihood, beliefs_of(rng, 20), 1 - np.eye(M)
    fair, plain = representative_outcomes(pool), tap_outcomes(pool)

    gains = [expected_gain(outcomes, beliefs, [0, 1], loss, "clamp") for outcomes in (exact, fair, plain)]
    np.testing.assert_allclose(gains[1], gains[0], rtol=0, atol=1e-12)
    assert np.abs(gains[2] - gains[0]).max() > 1e-3
    told = [information(outcomes, beliefs) for outcomes in (exact, fair, plain)]
    np.testing.assert_allclose(told[1], told[0], rtol=0, atol=1e-12)
    assert np.abs(told[2] - told[0]).max() > 1e-3


def test_expected_steps_are_those_of_a_sensor_that_stops_at_the_ends(rng):
    beliefs, deltas = beliefs_of(rng, 5), np.array([0, 1, -2, 9])
    expected = [
        [sum(b[l].sum() * abs(min(max(l + d, 0), L - 1) - l) for l in range(L)) for d in deltas] for b in beliefs
    ]

    np.testing.assert_allclose(expected_steps(beliefs, deltas), expected, rtol=1e-12)
    own = np.tile(deltas, (5, 1))[:, ::-1]
    np.testing.assert_allclose(expected_steps(beliefs, own), np.array(expected)[:, ::-1], rtol=1e-12)


def test_the_watch_records_the_gain_of_the_move_that_follows_less_its_way(pool, loss, rng):
    beliefs, moves, outcomes = beliefs_of(rng, 7), np.array([0, 1, -1, 3, 2, 0, -3]), tap_outcomes(pool)
    gain = [expected_gain(outcomes, b, [d], loss, "clamp")[0] for b, d in zip(beliefs, moves, strict=True)]
    way = [expected_steps(b, [d])[0] for b, d in zip(beliefs, moves, strict=True)]

    seen = gain_watch(outcomes, loss, step_cost=0.3, border="clamp")(beliefs, moves)["gain"]
    np.testing.assert_allclose(seen, np.array(gain) - 0.3 * np.array(way), rtol=1e-12)


def test_the_watch_skips_what_a_decision_costs_too_little_for(pool, loss, rng):
    """There it tells what the decision costs, which is no less than the gain and not above what is negligible."""
    beliefs, moves, outcomes = beliefs_of(rng, 40), np.zeros(40, np.int64), tap_outcomes(pool)
    now = decision_loss(beliefs, loss)
    negligible = float(np.median(now))
    gain = expected_gain(outcomes, beliefs, [0], loss)[:, 0]

    seen = gain_watch(outcomes, loss, negligible=negligible)(beliefs, moves)["gain"]
    np.testing.assert_allclose(seen, np.where(now > negligible, gain, now), rtol=1e-12)
    assert ((seen <= negligible) == ((gain <= negligible) | (now <= negligible))).all()


def test_the_mover_goes_where_gain_less_cost_is_largest(pool, loss, rng):
    """And moves the whole batch as it moves one."""
    beliefs, outcomes = beliefs_of(rng, 30), tap_outcomes(pool)
    expected = []
    for belief in beliefs:
        deltas = moves_to_all(belief)
        net = [brute_force(pool, belief, d, loss) - 0.05 * expected_steps(belief, [d])[0] for d in deltas]
        expected.append(deltas[np.argmax(net)])

    move = risk_mover(outcomes, loss, step_cost=0.05, border="clamp")
    assert move(beliefs, np.zeros(30)).tolist() == expected
    assert move(beliefs[3], np.zeros(())).tolist() == expected[3]
    assert len(set(expected)) > 2


@pytest.mark.parametrize("border", reference.BORDERS)
def test_where_nothing_is_gained_the_mover_stays(rng, border):
    """Sure of the object it has nothing to gain, and where ways are too dear nothing is worth going for."""
    outcomes = tap_outcomes(rng.normal(size=(N, L, M)))
    decided = np.zeros((L, M))
    decided[:, 1] = rng.dirichlet(np.ones(L))

    assert risk_mover(outcomes, 1 - np.eye(M), border=border)(decided[np.newaxis], np.zeros(1)).tolist() == [0]
    assert not risk_mover(outcomes, 1 - np.eye(M), step_cost=1e3, border=border)(beliefs_of(rng, 9), np.zeros(9)).any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda _: checked_loss(np.zeros((2, 4)), M), r"3 columns, one per object, got shape \(2, 4\)"),
        (lambda _: checked_loss(np.zeros((0, M)), M), "a row per decision"),
        (lambda _: checked_loss(-np.ones((M, M)), M), "finite and not negative"),
        (lambda _: checked_loss(np.full((M, M), np.nan), M), "finite and not negative"),
        (lambda o: expected_gain(o, np.ones((M, L)), [0], np.eye(M)), r"taps have 4 x 3 classes, .* shape \(3, 4\)"),
        (lambda o: expected_gain(o, np.ones((L, M)), [0], np.eye(M), "wall"), "border must be one of"),
        (
            lambda _: representative_outcomes(np.zeros((L, M))),
            r"axes .tap, where, what. and at least one tap, got shape \(4, 3\)",
        ),
        (lambda _: representative_outcomes(np.full((2, L, M), np.nan)), r"NaN or \+inf"),
        (lambda o: risk_mover(o, np.eye(M), step_cost=-1), "cost of a move must be at least 0, got -1"),
        (lambda o: gain_watch(o, np.eye(M), step_cost=np.nan), "cost of a move must be at least 0"),
    ],
)
def test_what_makes_no_sense_is_refused(pool, call, message):
    with pytest.raises(InputError, match=message):
        call(tap_outcomes(pool))
