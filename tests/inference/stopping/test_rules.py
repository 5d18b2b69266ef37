"""Stopping rules by name, and episodes that end by them as recorded trials do."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import perceive, steps
from solidtouch.inference.information import tap_outcomes
from solidtouch.inference.moves.control import fixation, passive
from solidtouch.inference.moves.expected_gain import expected_gain
from solidtouch.inference.names import STOPS
from solidtouch.inference.stopping import stopping
from solidtouch.inference.stopping.recorded import stops
from solidtouch.inference.stopping.rules import error_loss, gain_of, make_rule, parse_patience, parse_stopping
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.records import plan_trials, tap_table, trial_uniforms
from solidtouch.models.errors import InputError

DEADLINE, TRIALS, SEED = 9, 60, 4
NAMES = (
    "what:0.9",
    "where:0.6",
    "both:0.8,0.5",
    "taps:4",
    "error:0.2",
    "each-error:0.3",
    "msprt:0.05",
    "lookahead:0.1",
)


@pytest.fixture(scope="module")
def model(make_model):
    """Little is told by a tap."""
    return replace(make_model(L=5, M=3, seed=8), power=0.15)


def same(rule, other, M=3):
    """Whether two rules say the same of many moments."""
    rng = np.random.default_rng(3)
    what = rng.dirichlet(np.full(M, 0.3), size=400)
    moment = stopping.Moment(what, rng.uniform(size=400), rng.integers(1, 12, size=400), rng.uniform(0, 0.3, size=400))
    return rule(moment).tolist() == other(moment).tolist()


def test_a_name_is_its_rule(model):
    expected = (
        stopping.what_above(0.9),
        stopping.where_above(0.6),
        stopping.both_above(0.8, 0.5),
        stopping.after(4),
        stopping.mean_error(0.2),
        stopping.each_error(0.3, 3),
        stopping.msprt(stopping.divergences(model, 2), 0.05),
        stopping.lookahead(0.1),
    )
    for name, rule in zip(NAMES, expected, strict=True):
        assert same(make_rule(parse_stopping(name), model, 2), rule), name
    given_up = make_rule(parse_stopping("what:0.9"), model, patience=(6, 0.5))
    assert same(given_up, stopping.or_give_up(stopping.what_above(0.9), 6, 0.5))
    assert not same(given_up, stopping.what_above(0.9))


def test_every_form_has_a_name_here():
    assert [form.partition(":")[0] for form in STOPS] == [name.partition(":")[0] for name in NAMES]


def test_without_a_place_msprt_takes_that_where_objects_are_farthest_apart(model):
    least = [stopping.divergences(model, l).min() for l in range(5)]
    found = make_rule(parse_stopping("msprt:0.05"), model)

    assert same(found, stopping.msprt(stopping.divergences(model, int(np.argmax(least))), 0.05))


@pytest.fixture(scope="module")
def recorded(model):
    """Taps drawn from the model, their trials with the fixation point, and what the next tap would save."""
    taps = draw_session(model, 6, 3, 0)
    table = tap_table(model, model.usable(taps))
    plan, watch = (
        plan_trials(table.pool, TRIALS, SEED),
        gain_of(tap_outcomes(table.log_likelihood), model.grid, "clamp"),
    )
    return taps, plan, play(table, plan, fixation(2), border="clamp", deadline=DEADLINE, seed=SEED, watch=watch), watch


PATIENT = list(product(NAMES, [None, (5, 1.0), (3, 0.7)]))


@pytest.mark.parametrize(("name", "patience"), slow_but(PATIENT[::2], PATIENT), ids=str)
def test_episodes_end_where_recorded_trials_do(model, recorded, name, patience):
    """The same taps one by one: same number, same answer, same object."""
    taps, plan, record, watch = recorded
    rule, engine = make_rule(parse_stopping(name), model, 2, patience), make_engine("filter", model, "clamp")
    found = stops(rule, record)
    assert patience is not None or name == "taps:4" or len(set(found.taps.tolist())) > 2
    for i, (where, what, _, stream, _) in enumerate(zip(*plan, strict=True)):
        rig = ReplayRig(taps, model.grid, where, what, iter(trial_uniforms(SEED, stream, DEADLINE)))
        episode = perceive(rig, engine, rule, fixation(2), DEADLINE, watch=watch)
        answer = stopping.DECIDE if episode.stopped else stopping.GIVE_UP if episode.gave_up else stopping.GO_ON

        assert (episode.taps, answer) == (found.taps[i], found.answer[i])
        assert episode.what == record.what[i, episode.taps - 1]


def test_null_decisions_occur(model, recorded):
    """So that the test above means something."""
    rule = make_rule(parse_stopping("what:0.999"), model, patience=(2, 0.9))
    answers = stops(rule, recorded[2]).answer.tolist()
    assert min(answers.count(stopping.DECIDE), answers.count(stopping.GIVE_UP)) > 3


def test_doubt_holds_back_decisions_and_not_giving_up(model, recorded):
    taps, plan, *_ = recorded
    for rule, ended in (
        (stopping.what_above(0.4), (DEADLINE, False)),
        (stopping.or_give_up(stopping.what_above(1.0), 3, 1.0), (3, True)),
    ):
        rig = ReplayRig(taps, model.grid, int(plan.where[0]), int(plan.what[0]), np.random.default_rng(0))
        made = list(steps(rig, make_engine("filter", model), rule, passive(), DEADLINE, lambda *_: True))

        assert (len(made), made[-1].gave_up) == ended
        assert made[-1].decision is None


def test_a_rule_that_looks_ahead_needs_somebody_who_does(model, recorded):
    taps, plan, *_ = recorded
    rig = ReplayRig(taps, model.grid, int(plan.where[0]), int(plan.what[0]), np.random.default_rng(0))
    with pytest.raises(InputError, match="needs the expected gain of the next tap"):
        perceive(rig, make_engine("filter", model), stopping.lookahead(0.1), passive())


def test_the_gain_is_that_of_the_error_under_the_border(model, recorded):
    """And borders differ in what a move to the end leaves."""
    taps, *_ = recorded
    outcomes, moves = tap_outcomes(tap_table(model, model.usable(taps)).log_likelihood), np.full(20, 3)
    beliefs = np.random.default_rng(2).dirichlet(np.full(15, 0.5), size=20).reshape(-1, 5, 3)
    found = {border: gain_of(outcomes, model.grid, border)(beliefs, moves)["gain"] for border in ("clamp", "uniform")}

    assert not np.allclose(found["clamp"], found["uniform"])
    for border, gain in found.items():
        expected = expected_gain(outcomes, beliefs, moves[:, np.newaxis], error_loss(model.grid), border)[:, 0]
        np.testing.assert_allclose(gain, expected, atol=1e-12)


def test_loss_is_the_error_of_the_classes(model):
    size = model.grid.what_value
    expected = np.abs(np.subtract.outer(size, size)) if size is not None else 1 - np.eye(model.grid.M)
    assert error_loss(model.grid).tolist() == expected.tolist()


@pytest.mark.parametrize("name", ["", "both:0.5", "what:0.5,0.5", "others:1"])
def test_unknown_rules_are_refused(name):
    with pytest.raises(InputError, match=f"Unknown stopping rule '{name}'; choose from what:THETA, "):
        parse_stopping(name)


@pytest.mark.parametrize(
    "name",
    ["what", "what:", "what:x", "what:nan", "what:1.1", "both:0.5,2", "taps:0", "taps:1.5", "taps:inf", "error:0",
     "error:1", "each-error:-1", "msprt:0", "msprt:inf", "lookahead:nan"],
)  # fmt: skip
def test_numbers_that_make_no_sense_are_refused(name):
    with pytest.raises(InputError, match=f"must be .*, got '{name}'"):
        parse_stopping(name)


@pytest.mark.parametrize("text", ["", "0", "-1", "x", "3:", "3:2", "3:nan", "1.5", "3:0.5:1"])
def test_patience_that_makes_no_sense_is_refused(text):
    with pytest.raises(InputError, match=f"got '{text}'"):
        parse_patience(text)


def test_patience():
    assert (parse_patience("10"), parse_patience("7:0.25")) == ((10, 1.0), (7, 0.25))


def test_msprt_needs_a_place_with_every_object(model):
    poor = replace(model, counts=model.counts * np.eye(5, 3, dtype=np.int64)[..., np.newaxis, np.newaxis])
    with pytest.raises(InputError, match="every object"):
        make_rule(parse_stopping("msprt:0.1"), poor)
