"""Moves by expected information against choices made from loops over taps and classes."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.inference import reference
from solidtouch.inference.information import ABOUT, information_of_moves, tap_outcomes
from solidtouch.inference.moves import information as control_information
from solidtouch.inference.moves.information import informative, state_mean, training_outcomes
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import concatenate

L, M, N = 5, 3, 12
BELIEFS = 25


def entropy(p):
    return -sum(value * np.log(value) for value in np.ravel(p) if value > 0)


def brute_force(pool, belief, about="joint"):
    """Entropy now less the mean entropy of the posteriors after each tap of the pool."""
    marginal = {"joint": lambda b: b, "where": reference.where_marginal, "what": reference.what_marginal}[about]
    given = np.exp(pool) / np.exp(pool).sum(axis=0)
    value = entropy(marginal(belief))
    for likelihood in given:
        joint = belief * likelihood
        value -= joint.sum() * entropy(marginal(joint / joint.sum()))
    return value


def best(values, deltas):
    """The largest, then the shortest move, then the lowest class."""
    ranked = [(abs(d), i) for i, d in enumerate(deltas) if values[i] > max(values) - 1e-11]
    return deltas[min(ranked)[1]]


@pytest.fixture
def pool(rng):
    return rng.normal(-3, 1.5, size=(N, L, M))


@pytest.fixture
def beliefs(rng):
    return rng.dirichlet(np.full(L * M, 0.4), size=BELIEFS).reshape(-1, L, M)


def asked(policy, beliefs):
    return policy(beliefs, np.full(beliefs.shape[:-2], 0.5))


@pytest.mark.parametrize("about", ABOUT)
@pytest.mark.parametrize("border", reference.BORDERS)
def test_it_goes_where_a_loop_over_taps_expects_most(pool, beliefs, border, about):
    """Counted from the belief after the shift, for places that may be aimed for; the values themselves agree too."""
    targets, outcomes = [0, 1, 3, 4], tap_outcomes(pool)
    expected = []
    for belief in beliefs:
        deltas = [target - reference.where_decision(belief, 0) for target in targets]
        values = [brute_force(pool, reference.shift(belief, d, border), about) for d in deltas]
        expected.append(best(values, deltas))
        found = information_of_moves(outcomes, belief, deltas, border, about)
        np.testing.assert_allclose(found, values, rtol=0, atol=1e-10)
        assert (found >= 0).all()

    assert asked(informative(outcomes, about, border, targets), beliefs).tolist() == expected
    assert len(set(expected)) > 3


def test_the_border_and_what_it_is_about_change_where_it_goes(pool, beliefs):
    """So the cases above differ."""
    moves = [
        asked(informative(tap_outcomes(pool), about, border), beliefs).tolist()
        for about in ABOUT
        for border in ("uniform", "clamp", "circular")
    ]

    assert len({tuple(row) for row in moves}) == len(moves)


@pytest.mark.parametrize("about", ABOUT)
def test_who_is_certain_stays(pool, about):
    """Nothing is to be learned anywhere, and rounding does not move the finger."""
    certain = np.zeros((L, 1, L, M))
    certain[np.arange(L), 0, np.arange(L), 1] = 1.0
    outcomes = tap_outcomes(pool)

    assert not asked(informative(outcomes, about, "clamp"), certain).any()
    assert asked(informative(outcomes, about, "clamp", [0, 4]), certain)[:, 0].tolist() == [0, -1, -2, 1, 0]


def test_of_equal_places_it_takes_the_one_where_it_is_then_the_nearest_then_the_first():
    """Taps that are the same at every place tell the same everywhere."""
    pool = np.broadcast_to(np.random.default_rng(0).normal(size=(N, 1, M)), (N, L, M))
    belief = np.outer([0.1, 0.2, 0.4, 0.2, 0.1], [0.5, 0.3, 0.2])

    assert asked(informative(tap_outcomes(pool), "what", "clamp"), belief) == 0
    assert asked(informative(tap_outcomes(pool), "what", "clamp", [0, 1, 3]), belief) == -1
    assert asked(informative(tap_outcomes(pool), "what", "clamp", [0, 4]), belief) == -2


@pytest.mark.parametrize("about", ABOUT)
def test_a_batch_moves_as_its_beliefs_one_by_one(pool, beliefs, rng, monkeypatch, about):
    """Also a batch that is worked on in parts."""
    monkeypatch.setattr(control_information, "_AT_ONCE", 4)
    policy, chance = informative(tap_outcomes(pool), about, "uniform"), rng.random(20)
    single = [int(policy(belief, u)) for belief, u in zip(beliefs[:20], chance, strict=True)]
    moves = policy(beliefs[:20].reshape(4, 5, L, M), chance.reshape(4, 5))

    assert (moves.shape, moves.dtype) == ((4, 5), np.int64)
    assert moves.ravel().tolist() == single
    assert policy(beliefs[:0], chance[:0]).shape == (0,)


@pytest.mark.parametrize("about", ABOUT)
def test_numbers_of_objects_taps_and_places_do_not_matter(pool, beliefs, rng, about):
    """Permuted objects and taps move the same, a mirrored range the other way, a turned circle by the same angle."""
    beliefs = beliefs[:10]
    moves = asked(informative(tap_outcomes(pool), about, "uniform"), beliefs)
    what = rng.permutation(M)
    permuted = informative(tap_outcomes(rng.permutation(pool)[:, :, what]), about, "uniform")
    mirrored = informative(tap_outcomes(pool[:, ::-1]), about, "uniform")
    circle = asked(informative(tap_outcomes(pool), about, "circular"), beliefs)
    turned = asked(informative(tap_outcomes(np.roll(pool, 2, axis=1)), about, "circular"), np.roll(beliefs, 2, axis=1))

    assert asked(permuted, beliefs[:, :, what]).tolist() == moves.tolist()
    assert asked(mirrored, beliefs[:, ::-1]).tolist() == (-moves).tolist()
    assert not ((turned - circle) % L).any()


def test_information_may_be_had_per_cost(pool, beliefs, rng):
    """Of the move and the tap together, each way with its own."""
    outcomes, costs = tap_outcomes(pool), rng.uniform(0.5, 3, size=(L, L))
    expected = []
    for belief in beliefs:
        here = reference.where_decision(belief, 0)
        values = [
            brute_force(pool, reference.shift(belief, to - here, "clamp"), "what") / costs[here, to] for to in range(L)
        ]
        expected.append(best(values, [to - here for to in range(L)]))
    free = asked(informative(outcomes, "what", "clamp"), beliefs).tolist()

    assert asked(informative(outcomes, "what", "clamp", per=costs), beliefs).tolist() == expected
    assert expected != free
    assert asked(informative(outcomes, "what", "clamp", per=np.full((L, L), 7.0)), beliefs).tolist() == free
    dear = np.where(np.eye(L) > 0, 1.0, 1e9)
    assert not asked(informative(outcomes, "what", "clamp", per=dear), beliefs).any()


@pytest.fixture(scope="module")
def sessions(make_taps):
    taps = make_taps(sessions=3, repeats=4, L=3, M=4)
    return taps.select(taps.session < 2), taps.select(taps.session == 2)


def test_outcomes_are_the_training_taps_and_no_others(sessions):
    """Other taps among them are left out; a policy that had seen the test taps would go elsewhere."""
    train, test = sessions
    model = fit(train, train.grid(), bins=9)
    outcomes = training_outcomes(model, concatenate([test, train]))
    expected = tap_outcomes(model.log_likelihood(train.taps))
    beliefs = np.random.default_rng(2).dirichlet(np.full(12, 0.3), size=200).reshape(-1, 3, 4)
    cheating = informative(tap_outcomes(model.log_likelihood(test.taps)), "what")

    np.testing.assert_array_equal(outcomes.given, expected.given)
    assert (asked(informative(outcomes, "what"), beliefs) != asked(cheating, beliefs)).any()


def test_taps_that_did_not_train_are_refused(sessions):
    train, test = sessions
    model = fit(train, train.grid(), bins=9)

    with pytest.raises(InputError, match=f"none of these {len(test)} taps trained it"):
        training_outcomes(model, test)
    with pytest.raises(InputError, match="none of these"):
        training_outcomes(replace(model, training=np.empty(0, np.uint64)), train)


def test_models_with_states_predict_in_the_mean_over_them(sessions):
    """By their prior probabilities, each hypothesis once."""
    train, _ = sessions
    model = fit_model("session", train, train.grid(), FitSettings(bins=9)).model
    log_likelihood = model.log_likelihood(train.taps)
    S, M_ = len(model.states.gain), model.grid.M
    expected = np.zeros((len(train), *model.grid.shape))
    for s in range(S):
        expected += np.exp(model.states.log_prior[s] + log_likelihood[:, :, s * M_ : (s + 1) * M_])

    assert S > 1
    np.testing.assert_allclose(state_mean(model, log_likelihood), np.log(expected), rtol=1e-12)
    found = training_outcomes(model, train).given
    np.testing.assert_allclose(found, tap_outcomes(np.log(expected)).given, rtol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda o: informative(o, "which"), "about must be one of joint, where, what, got 'which'"),
        (lambda o: informative(o, border="wall"), "border must be one of uniform, .*, got 'wall'"),
        (lambda o: informative(o, candidates=[]), r"positions from 0 to 4, got \[\]"),
        (lambda o: informative(o, candidates=[0, 5]), r"positions from 0 to 4, got \[0, 5\]"),
        (lambda o: informative(o, per=np.ones((L, M))), r"must be above 0, .* got shape \(5, 3\)"),
        (lambda o: informative(o, per=np.zeros((L, L))), "must be above 0"),
    ],
)
def test_what_makes_no_sense_is_refused(pool, make, message):
    with pytest.raises(InputError, match=message):
        make(tap_outcomes(pool))
