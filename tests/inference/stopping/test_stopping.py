"""Rules stop hand-made records where they should, and keep their promises where the model is right."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.analysis.experiment.sources import right_model
from solidtouch.hardware.simulator.model_rig import bin_tables, draw_session
from solidtouch.inference.moves.control import fixation, passive
from solidtouch.inference.moves.expected_gain import gain_watch, representative_outcomes
from solidtouch.inference.stopping.recorded import stops
from solidtouch.inference.stopping.stopping import (
    DECIDE,
    GIVE_UP,
    GO_ON,
    Moment,
    after,
    both_above,
    divergences,
    each_error,
    lookahead,
    mean_error,
    msprt,
    or_give_up,
    what_above,
    where_above,
)
from solidtouch.inference.trials.lockstep import Record, play
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.states import States

WHAT = [
    [[0.5, 0.3, 0.2], [0.7, 0.2, 0.1], [0.6, 0.3, 0.1], [0.95, 0.04, 0.01], [0.97, 0.02, 0.01]],
    [[0.3, 0.4, 0.3], [0.3, 0.4, 0.3], [0.2, 0.3, 0.5], [0.2, 0.3, 0.5], [0.2, 0.2, 0.6]],
    [[0.2, 0.1, 0.7], [0.1, 0.1, 0.8], [0.1, 0.1, 0.8], [0.1, 0.1, 0.8], [0.1, 0.1, 0.8]],
]
WHERE = [[0.3, 0.5, 0.9, 0.6, 0.9], [0.8, 0.9, 0.9, 0.9, 0.9], [0.4, 0.4, 0.4, 0.4, 0.4]]
GAIN = [[0.5, 0.3, 0.2, 0.05, 0.0], [0.1, 0.2, 0.3, 0.4, 0.5], [0.2, 0.0, 0.0, 0.0, 0.0]]
LENGTH = [5, 5, 2]
"""Three trials of five taps at most and three objects; the third ended after two."""

RULES = {
    "what": (what_above(0.69), [2, 5, 1], [DECIDE, GO_ON, DECIDE]),
    "what, strictly": (what_above(0.8), [4, 5, 2], [DECIDE, GO_ON, GO_ON]),
    "what, never": (what_above(1.0), [5, 5, 2], [GO_ON, GO_ON, GO_ON]),
    "where": (where_above(0.55), [3, 1, 2], [DECIDE, DECIDE, GO_ON]),
    "where, never": (where_above(1.0), [5, 5, 2], [GO_ON, GO_ON, GO_ON]),
    "both": (both_above(0.55, 0.7), [3, 5, 2], [DECIDE, DECIDE, GO_ON]),
    "one tap": (after(1), [1, 1, 1], [DECIDE, DECIDE, DECIDE]),
    "three taps": (after(3), [3, 3, 2], [DECIDE, DECIDE, GO_ON]),
    "lookahead": (lookahead(0.1), [4, 1, 2], [DECIDE, DECIDE, DECIDE]),
    "msprt": (msprt([0.1, 1.0, 0.3], 0.1), [2, 5, 2], [DECIDE, GO_ON, DECIDE]),
    "mean error": (mean_error(0.04), [5, 5, 2], [DECIDE, GO_ON, GO_ON]),
    "each error": (each_error(0.5, 3), [4, 5, 2], [DECIDE, GO_ON, GO_ON]),
    "deadline": (or_give_up(what_above(0.9), 3), [3, 3, 2], [DECIDE, DECIDE, GO_ON]),
    "gives up below": (or_give_up(what_above(0.9), 3, 0.55), [3, 3, 2], [DECIDE, GIVE_UP, GO_ON]),
    "gives up always": (or_give_up(what_above(0.75), 2, 1.0), [2, 2, 2], [GIVE_UP, GIVE_UP, DECIDE]),
    "decides in time": (or_give_up(what_above(0.9), 4, 1.0), [4, 4, 2], [DECIDE, GIVE_UP, GO_ON]),
}


def record_of(what, where, length, **watched):
    what = np.array(what)
    nothing = np.zeros(what.shape[:2], np.int64)
    where = np.array(where)
    return Record(
        what,
        nothing,
        where,
        *([nothing] * 5),
        np.array(length),
        nothing[:, 0],
        {k: np.array(v) for k, v in watched.items()},
        np.zeros(len(length), bool),
    )


@pytest.fixture
def record():
    return record_of(WHAT, WHERE, LENGTH, gain=GAIN)


@pytest.mark.parametrize("name", RULES)
def test_rules_stop_hand_made_records_where_they_should(record, name):
    rule, taps, answer = RULES[name]
    found = stops(rule, record)

    assert found.taps.tolist() == taps
    assert found.answer.tolist() == answer


@pytest.mark.parametrize("name", RULES)
def test_a_rule_says_of_one_moment_what_it_says_of_it_in_a_record(record, name):
    """So trials that are stopped as they go stop where the record says."""
    rule = RULES[name][0]
    for i in range(3):
        said, taps = GO_ON, 0
        while said == GO_ON and taps < record.length[i]:
            moment = Moment(
                record.what_marginal[i, taps],
                record.where_belief[i, taps],
                np.int64(taps + 1),
                np.float64(GAIN[i][taps]),
            )
            said, taps = int(rule(moment)), taps + 1
        found = stops(rule, record)
        assert (found.taps[i], found.answer[i]) == (taps, said)


def test_what_follows_the_last_tap_is_not_looked_at(record):
    """Here beliefs behind the end would stop."""
    late = record_of([[[0.5, 0.5], [0.6, 0.4], [0.99, 0.01]]], [[0.1, 0.1, 0.1]], [2])

    assert stops(what_above(0.9), late).answer.tolist() == [GO_ON]
    assert stops(what_above(0.9), late).taps.tolist() == [2]


def test_a_higher_threshold_never_stops_sooner(rng):
    record = record_of(rng.dirichlet(np.ones(3), size=(50, 20)), rng.random((50, 20)), np.full(50, 20))
    for rule in (what_above, where_above, lambda theta: mean_error(1 - theta), lambda theta: both_above(theta, 0.5)):
        taps = [stops(rule(theta), record).taps for theta in (0.4, 0.6, 0.8, 0.95)]
        assert (np.diff(taps, axis=0) >= 0).all()
    dear = [stops(msprt([0.1, 0.2, 0.4], cost), record).taps for cost in (1e-4, 1e-2, 1e-1, 1.0)]
    assert (np.diff(dear, axis=0) <= 0).all()


def test_the_thresholds_of_msprt_go_to_one_as_taps_get_cheap():
    """By cost over divergence, and a stop becomes rarer."""
    for cost in (1e-2, 1e-4, 1e-8):
        for m, divergence in enumerate((0.5, 1.0, 2.0)):
            threshold = 1 / (1 + cost / divergence)
            assert 1 - threshold == pytest.approx(cost / divergence, rel=0.05)
            for belief, expected in ((threshold - 1e-12, GO_ON), (threshold + 1e-12, DECIDE)):
                what = np.full(3, (1 - belief) / 2)
                what[m] = belief
                rule = msprt([0.5, 1.0, 2.0], cost)
                assert rule(Moment(what, np.float64(1), np.int64(1), np.float64(0))) == expected


# Divergences ------------------------------------------------------------------------------------------------------


def test_divergences_are_the_mean_of_log_likelihood_ratios(make_model, rng):
    """Of taps drawn from each object's own histograms, to the nearest rival, within five standard errors."""
    model = make_model(3, 4, 2, 5, 7, power=0.3, pseudocount=0.5, taps=10)
    tables = bin_tables(model.probabilities, model.edges, model.grid.shape)
    found = divergences(model, 1)
    for m in range(4):
        taps = tables.values(1, m, rng.random((20000, 5, 2)))
        log_likelihood = model.log_likelihood(taps)[:, 1]
        ratio = np.delete(log_likelihood[:, [m]] - log_likelihood, m, axis=1)
        nearest = ratio[:, ratio.mean(axis=0).argmin()]
        assert abs(nearest.mean() - found[m]) < 5 * nearest.std() / np.sqrt(20000)


def test_divergences_are_proportional_to_the_exponent_and_to_the_samples(make_model):
    model = make_model(power="none")
    for power, samples, factor in (("J", 5, 1 / 5), (0.25, 5, 0.25), ("none", 10, 2)):
        other = replace(model, power=power, preprocessing=replace(model.preprocessing, samples=samples))
        np.testing.assert_allclose(divergences(other, 2), factor * divergences(model, 2), rtol=1e-12)


def test_bins_that_only_a_rival_leaves_empty_diverge_without_end(make_model):
    """What an object itself cannot give counts for nothing."""
    model = make_model(1, 2, 1, 1, 2, pseudocount=0.0, power="none")
    counts = np.array([[2, 2], [4, 0]])[np.newaxis, :, np.newaxis]
    model = replace(model, counts=counts)

    assert divergences(model, 0).tolist() == [np.inf, pytest.approx(np.log(2))]
    with pytest.raises(InputError, match="a finite cost and divergences above 0"):
        msprt(divergences(model, 0), 0.1)


def test_divergences_of_what_has_none_are_refused(make_model):
    states = States(np.array([0.8, 1.3]), np.array([0.1, -0.2]), np.log([0.4, 0.6]))
    with pytest.raises(InputError, match="a histogram model without states, not a session model"):
        divergences(replace(make_model(), states=states), 0)
    with pytest.raises(InputError, match="a position from 0 to 2, got 4 and position 3"):
        divergences(make_model(), 3)
    with pytest.raises(InputError, match="two objects and a position from 0 to 2, got 1 and position 0"):
        divergences(make_model(3, 1), 0)
    with pytest.raises(InputError, match="Not every object was trained at position 1"):
        divergences(make_model(untrained=[(1, 2)]), 1)


# Promises ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def played():
    """Trials on taps drawn from the model that perceives them, of few samples so that errors occur."""
    model = right_model(seed=5, samples=2)
    table = tap_table(model, draw_session(model, 150, 1))
    plan = plan_trials(table.pool, 4000, 3)
    loss = 1 - np.eye(model.grid.M)
    outcomes = representative_outcomes(tap_table(model, draw_session(model, 10, 7)).log_likelihood)
    watch = gain_watch(outcomes, loss, negligible=0.004, border="clamp")

    def play_with(policy):
        return play(table, plan, policy, border="clamp", deadline=60, enough=0.9995, seed=2, watch=watch)

    return {"passive": play_with(passive()), "active": play_with(fixation(7))}, model


def wrong_of(rule, record):
    found = stops(rule, record)
    decided = found.answer == DECIDE
    what = record.what[np.arange(len(found.taps)), found.taps - 1]
    return decided, decided & (what != record.held)


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["passive", "active"])
@pytest.mark.parametrize("error", [0.3, 0.1, 0.03])
def test_errors_stay_below_what_is_promised(played, policy, error):
    """On the mean of all objects, and of each object apart, within three standard errors of a share."""
    record, M = played[0][policy], played[1].grid.M
    decided, wrong = wrong_of(mean_error(error), record)
    assert wrong.sum() / decided.sum() <= error + 3 * np.sqrt(error / decided.sum())
    assert decided.mean() > 0.5
    _, wrong = wrong_of(each_error(error, M), record)
    for m in range(M):
        of_object = wrong[record.held == m]
        assert of_object.mean() <= error + 3 * np.sqrt(error / len(of_object))


@pytest.mark.slow
def test_a_promise_of_each_object_is_dearer_than_one_of_their_mean(played):
    """And both are kept with taps to spare, not by never deciding."""
    record, M = played[0]["active"], played[1].grid.M
    mean, each = stops(mean_error(0.1), record), stops(each_error(0.1, M), record)

    assert (each.taps >= mean.taps).all()
    assert each.taps.mean() > mean.taps.mean()


@pytest.mark.slow
def test_looking_ahead_stops_the_sooner_the_dearer_taps_are(played):
    """And taps and errors together cost less than after any fixed number of taps."""
    record, costs = played[0]["active"], (0.005, 0.02, 0.08)
    taps = [stops(lookahead(cost), record).taps for cost in costs]
    assert (np.diff(taps, axis=0) <= 0).all()

    def risk(rule, cost):
        found = stops(rule, record)
        what = record.what[np.arange(len(found.taps)), found.taps - 1]
        return (what != record.held).mean() + cost * found.taps.mean()

    for cost in costs:
        assert risk(lookahead(cost), cost) < min(risk(after(n), cost) for n in range(1, 60))


@pytest.mark.slow
def test_msprt_with_the_divergences_of_a_place_decides(played):
    """With cheaper taps later, and less often wrong."""
    records, model = played
    rules = [msprt(divergences(model, 7), cost) for cost in (0.3, 0.03, 0.003)]
    taps = [stops(rule, records["active"]).taps.mean() for rule in rules]
    wrong = [wrong_of(rule, records["active"])[1].mean() for rule in rules]

    assert (np.diff(taps) > 0).all()
    assert (np.diff(wrong) < 0).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: after(0), "must be an integer of at least 1, got 0"),
        (lambda: after(1.5), "must be an integer of at least 1, got 1.5"),
        (lambda: after(float("nan")), "got nan"),
        (lambda: or_give_up(after(1), 0), "Giving up needs at least 1 tap .* got 0"),
        (lambda: or_give_up(after(1), 2, float("nan")), "a belief from 0 to 1, got 2 and nan"),
        (lambda: what_above(float("nan")), "threshold on a belief must be a number from 0 to 1, got nan"),
        (lambda: where_above(float("nan")), "threshold on a belief must be a number from 0 to 1, got nan"),
        (lambda: lookahead(float("inf")), "The cost of a tap must be above 0"),
        (lambda: each_error(0.1, 0), "number of objects must be at least 1, got 0"),
        (lambda: msprt([1.0, 0.0], 0.1), "divergences above 0"),
        (lambda: msprt([1.0, 1.0], 0.0), "a finite cost"),
        (lambda: mean_error(0.0), "error must be between 0 and 1, got 0.0"),
        (lambda: each_error(1.0, 3), "error must be between 0 and 1, got 1.0"),
        (lambda: lookahead(0.0), "The cost of a tap must be above 0, got 0.0"),
        (lambda: stops(lookahead(0.1), record_of(WHAT, WHERE, LENGTH)), "needs the expected gain of the next tap"),
    ],
)
def test_what_makes_no_sense_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()
