"""Stopping rules by name, for command lines.

A rule that looks ahead needs to be told what the next tap is expected to save; `gain_of` says it from training taps.
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

FORMS = (
    "what:THETA",
    "where:THETA",
    "both:THETA_W,THETA_X",
    "taps:N",
    "error:P",
    "each-error:P",
    "msprt:COST",
    "lookahead:COST",
)
"""All names; capitals stand for numbers."""
_KINDS = {form.partition(":")[0]: form.count(",") + 1 for form in FORMS}
_SHARES, _INSIDE = ("what", "where", "both"), ("error", "each-error")
_PATIENCE = re.compile(r"(\d+)(?::(.+))?")


class Stopping(NamedTuple):
    """A name taken apart.

    Attributes:
        kind: What stands before the colon.
        numbers: What stands behind it.
    """

    kind: str
    numbers: tuple[float, ...]

    @property
    def needs_outcomes(self) -> bool:
        """Whether it needs outcomes of training taps."""
        return self.kind == "lookahead"

    @property
    def threshold(self) -> float:
        """The belief in an object that it asks for as the paper does; 1 if it asks for something else."""
        return self.numbers[0] if self.kind in ("what", "both") else 1.0


def parse_stopping(name: str) -> Stopping:
    """The stopping rule of a name.

    Raises:
        InputError: There is none, or a number is out of range.
    """
    kind, _, text = name.partition(":")
    parts = text.split(",")
    if kind not in _KINDS or len(parts) != _KINDS[kind]:
        raise InputError(f"There is no stopping rule {name!r}; there are {', '.join(FORMS)}.")
    numbers = tuple(_number(part) for part in parts)
    if kind in _SHARES and not all(0 <= number <= 1 for number in numbers):
        raise InputError(f"A belief to stop at must lie between 0 and 1, got {name!r}.")
    if kind in _INSIDE and not 0 < numbers[0] < 1:
        raise InputError(f"A share of wrong decisions must lie between 0 and 1, got {name!r}.")
    if kind == "taps" and not (numbers[0] >= 1 and numbers[0].is_integer()):
        raise InputError(f"The number of taps must be a whole one from 1 on, got {name!r}.")
    if kind in ("msprt", "lookahead") and not 0 < numbers[0] < np.inf:
        raise InputError(f"What a tap costs must be a number above 0, got {name!r}.")
    return Stopping(kind, numbers)


def parse_patience(text: str) -> tuple[int, float]:
    """Taps after which one gives up unless the belief in an object exceeds a share, 1 where `TAPS:BELIEF` has none.

    Raises:
        InputError: The words make no sense.
    """
    found = _PATIENCE.fullmatch(text)
    taps, belief = (int(found[1]), 1.0 if found[2] is None else _number(found[2])) if found else (0, 1.0)
    if taps < 1 or not 0 <= belief <= 1:
        raise InputError(f"Giving up is after so many taps, such as 10, or 10:0.5 for belief up to 0.5, got {text!r}.")
    return taps, belief


def make_rule(
    stopping: Stopping, model: TapModel, where: int | None = None, patience: tuple[int, float] | None = None
) -> StopRule:
    """The stopping rule, ready to be asked.

    Args:
        stopping: See `parse_stopping`.
        model: What perceives.
        where: Where class by whose taps `msprt` judges how far apart objects are; `None` for where they are farthest.
        patience: See `parse_patience`; `None` never gives up.

    Raises:
        InputError: As `divergences`, or objects cannot be told apart.
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
    """Error of each decision (row) for each object (column), shape (M, M), in the unit of what errors."""
    return np.array([grid.what_error(np.full(grid.M, m), np.arange(grid.M)) for m in range(grid.M)])


def gain_of(outcomes: TapOutcomes, grid: ClassGrid, border: Border) -> Watch:
    """By how much the next tap is expected to lower the error of the decision, for `lookahead`."""
    return gain_watch(outcomes, error_loss(grid), border=border)


def _apart(model: TapModel, where: int | None) -> NDArray[np.float64]:
    """How far apart objects are, at a place or where the two that are most alike are farthest apart."""
    if where is not None:
        return divergences(model, where)
    trained = np.flatnonzero(model.trained.all(axis=1))
    if not len(trained):
        raise InputError("The rule msprt needs a place where every object was trained.")
    return max((divergences(model, int(l)) for l in trained), key=lambda values: float(values.min()))


def _number(text: str) -> float:
    """A number, NaN where it is none, which is out of every range."""
    try:
        return float(text)
    except ValueError:
        return float("nan")
