"""Stopping rules by name, for commands.

A rule that looks ahead needs the expected gain of the next tap; `gain_of` computes it from training taps.
"""

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ..information import TapOutcomes
from ..moves.expected_gain import gain_watch
from ..names import STOPS
from ..reference import Border
from .stopping import (
    StopRule,
    Watch,
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

_KINDS = {form.partition(":")[0]: form.count(",") + 1 for form in STOPS}
_SHARES, _INSIDE = ("what", "where", "both"), ("error", "each-error")
_PATIENCE = re.compile(r"(\d+)(?::(.+))?")


class Stopping(NamedTuple):
    """Parsed name of a stopping rule.

    Attributes:
        kind: Text before the colon.
        numbers: Numbers after it.
    """

    kind: str
    numbers: tuple[float, ...]

    @property
    def needs_outcomes(self) -> bool:
        """Whether it needs training taps."""
        return self.kind == "lookahead"

    @property
    def threshold(self) -> float:
        """Belief in an object that it requires, as in the paper; 1 for other rules."""
        return self.numbers[0] if self.kind in ("what", "both") else 1.0


def parse_stopping(name: str) -> Stopping:
    """Parses the name of a stopping rule.

    Raises:
        InputError: The rule is unknown, or a number out of range.
    """
    kind, _, text = name.partition(":")
    parts = text.split(",")
    if kind not in _KINDS or len(parts) != _KINDS[kind]:
        raise InputError(f"Unknown stopping rule {name!r}; choose from {', '.join(STOPS)}.")
    numbers = tuple(_number(part) for part in parts)
    if kind in _SHARES and not all(0 <= number <= 1 for number in numbers):
        raise InputError(f"The belief of a stopping rule must be between 0 and 1, got {name!r}.")
    if kind in _INSIDE and not 0 < numbers[0] < 1:
        raise InputError(f"The error of a stopping rule must be between 0 and 1, got {name!r}.")
    if kind == "taps" and not (numbers[0] >= 1 and numbers[0].is_integer()):
        raise InputError(f"The number of taps must be an integer of at least 1, got {name!r}.")
    if kind in ("msprt", "lookahead") and not 0 < numbers[0] < np.inf:
        raise InputError(f"The cost of a tap must be above 0, got {name!r}.")
    return Stopping(kind, numbers)


def parse_patience(text: str) -> tuple[int, float]:
    """Number of taps after which to give up, and the belief above which to decide instead; 1 if `TAPS:BELIEF` has none.

    Raises:
        InputError: The text cannot be parsed.
    """
    found = _PATIENCE.fullmatch(text)
    taps, belief = (int(found[1]), 1.0 if found[2] is None else _number(found[2])) if found else (0, 1.0)
    if taps < 1 or not 0 <= belief <= 1:
        raise InputError(f"Giving up needs a number of taps such as 10, or 10:0.5 for belief up to 0.5, got {text!r}.")
    return taps, belief


def make_rule(
    stopping: Stopping, model: TapModel, where: int | None = None, patience: tuple[int, float] | None = None
) -> StopRule:
    """Stopping rule by its parsed name.

    Args:
        stopping: See `parse_stopping`.
        model: Fitted model.
        where: Position for the divergences of `msprt`; `None` for the one with the largest.
        patience: See `parse_patience`; `None` to never give up.

    Raises:
        InputError: As `divergences`, or objects cannot be distinguished.
    """
    M = model.grid.M
    rules = {
        "what": what_above,
        "where": where_above,
        "both": both_above,
        "taps": lambda number: after(int(number)),
        "error": mean_error,
        "each-error": lambda error: each_error(error, M),
        "msprt": lambda cost: msprt(_apart(model, where), cost),
        "lookahead": lookahead,
    }
    rule = rules[stopping.kind](*stopping.numbers)
    return rule if patience is None else or_give_up(rule, *patience)


def error_loss(grid: ClassGrid) -> NDArray[np.float64]:
    """Error of each decision (row) for each object (column), shape (M, M), in the unit of object errors."""
    return np.array([grid.what_error(np.full(grid.M, m), np.arange(grid.M)) for m in range(grid.M)])


def gain_of(outcomes: TapOutcomes, grid: ClassGrid, border: Border) -> Watch:
    """Watch of the expected reduction of the decision's error by the next tap, for `lookahead`."""
    return gain_watch(outcomes, error_loss(grid), border=border)


def _apart(model: TapModel, where: int | None) -> NDArray[np.float64]:
    """Divergences of objects at a position, by default where the closest two are farthest apart; shape (M,)."""
    if where is not None:
        return divergences(model, where)
    trained = np.flatnonzero(model.trained.all(axis=1))
    if not len(trained):
        raise InputError("Stopping rule 'msprt' needs a position where every object was trained.")
    return max((divergences(model, int(l)) for l in trained), key=lambda values: float(values.min()))


def _number(text: str) -> float:
    """The number in a text, or NaN, which is out of every range."""
    try:
        return float(text)
    except ValueError:
        return float("nan")
