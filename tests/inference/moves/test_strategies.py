"""Strategies by name."""

import numpy as np
import pytest
from solidtouch.inference.information import tap_outcomes
from solidtouch.inference.moves.control import fixation, passive, random_place, random_step
from solidtouch.inference.moves.information import informative
from solidtouch.inference.moves.strategies import make_policy, parse_strategy, time_costs, way_costs
from solidtouch.inference.moves.table import TargetTable, lookup
from solidtouch.inference.names import MOVES
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid

L, M, N = 6, 3, 20
GRID = ClassGrid(1.5 * np.arange(L), "mm", None, tuple((f"object {m}",) for m in range(M)))
RNG = np.random.default_rng(5)
OUTCOMES = tap_outcomes(RNG.normal(size=(N, L, M)))
TABLE = TargetTable(
    np.array([3, 3, 2, 5, 0, 1]),
    np.ones((L, L)),
    np.ones((L, L)),
    np.ones((L, L), int),
    GRID.where_value,
    "log",
    1,
)
BELIEFS, CHANCE = RNG.dirichlet(np.full(L * M, 0.3), size=300).reshape(-1, L, M), RNG.random(300)
NAMED = {
    "passive": passive(),
    "fixation": fixation(4),
    "fixation:0.45": fixation(4, 0.45),
    "fixation:1": fixation(4, 1.0),
    "random": random_place(),
    "step": random_step(1),
    "step:3": random_step(3),
    "info-what": informative(OUTCOMES, "what", "clamp"),
    "info-where": informative(OUTCOMES, "where", "clamp"),
    "info-joint": informative(OUTCOMES, "joint", "clamp"),
    "info-what-per-mm": informative(OUTCOMES, "what", "clamp", per=way_costs(GRID)),
    "info-joint-per-s": informative(OUTCOMES, "joint", "clamp", per=time_costs(GRID)),
    "table": lookup(TABLE),
}


def named(name, **change):
    known = {"border": "clamp", "fixation_index": 4, "outcomes": OUTCOMES, "table": TABLE}
    return make_policy(name, GRID, **known | change)


@pytest.mark.parametrize("name", NAMED)
def test_a_name_is_its_strategy(name):
    beliefs, chance = BELIEFS[:40], CHANCE[:40]

    assert named(name)(beliefs, chance).tolist() == NAMED[name](beliefs, chance).tolist()


def test_every_name_without_a_number_can_be_asked_at_once():
    """No two move alike."""
    names = [form for form in MOVES if ":" not in form]
    moves = [named(name)(BELIEFS, CHANCE) for name in names]

    assert all((row.shape, row.dtype) == ((300,), np.int64) for row in moves)
    assert len({tuple(row.tolist()) for row in moves}) == len(names) == 14


def test_the_default_fixation_point_is_the_middle():
    assert named("fixation", fixation_index=None)(BELIEFS, CHANCE).tolist() == fixation(2)(BELIEFS, CHANCE).tolist()


def test_compiled_trials_know_the_paper_and_nothing_else():
    """By the threshold for a move."""
    theta_x = {name: parse_strategy(name).theta_x for name in NAMED}

    assert {name: value for name, value in theta_x.items() if value is not None} == {
        "passive": 1.0,
        "fixation": 0.0,
        "fixation:0.45": 0.45,
        "fixation:1": 1.0,
    }
    assert [name for name in NAMED if parse_strategy(name).aims] == ["fixation", "fixation:0.45", "fixation:1"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lazy", "Unknown control strategy 'lazy'; choose from passive, fixation, .*table"),
        ("info-which", "Unknown control strategy 'info-which'"),
        ("info-what-per-kg", "Unknown control strategy"),
        ("random:2", "Unknown control strategy 'random:2'"),
        ("fixation:THETA_X", "theta_X of a strategy must be between 0 and 1, got 'fixation:THETA_X'"),
        ("fixation:1.5", "between 0 and 1, got 'fixation:1.5'"),
        ("fixation:nan", "between 0 and 1"),
        ("step:0", "integer from 1 to 1000, got 'step:0'"),
        ("step:1.5", "integer from 1 to 1000, got 'step:1.5'"),
        ("step:", "integer from 1 to 1000"),
        ("step:100000", "integer from 1 to 1000"),
        ("two-taps", "Unknown control strategy 'two-taps'; choose from passive, fixation, .*table"),
        ("two-taps:8", "Unknown control strategy 'two-taps:8'; choose from passive, fixation, .*table"),
        (f"step:{10**24}", "integer from 1 to 1000"),
    ],
)
def test_unknown_names_are_refused(name, message):
    with pytest.raises(InputError, match=message):
        parse_strategy(name)


OTHER = ClassGrid(2.0 * np.arange(L), "mm", None, GRID.what_members)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("info-what", {"outcomes": None}, "'info-what' needs training taps"),
        ("info-joint-per-mm", {"outcomes": None}, "'info-joint-per-mm' needs training taps"),
        ("table", {"table": None}, "needs a table of targets"),
        ("info-what", {"outcomes": tap_outcomes(np.zeros((N, L, 2)))}, r"have \(6, 2\) classes, the model \(6, 3\)"),
        ("table", {"table": TABLE._replace(where_value=OTHER.where_value)}, "6 positions from 0 to 10, the model 6"),
        ("fixation", {"fixation_index": 6}, "index from 0 to 5, got 6"),
    ],
)
def test_what_a_strategy_needs_must_be_there(name, change, message):
    with pytest.raises(InputError, match=message):
        named(name, **change)
