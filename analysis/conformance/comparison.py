"""First difference between a program's answers and the exact ones."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .answers import OPTIONAL, QUANTITIES, Answer
from .case import Case
from .program import printable
from .tolerance import Tolerance, allowed_decisions, allowed_moves

_LABELS = {
    "log_likelihood": "lm",
    "posterior": "lm",
    "log_posterior": "lm",
    "where": "l",
    "what": "m",
    "counts": "lmkb",
    "information": "l",
}


class Difference(NamedTuple):
    """The first difference of a case.

    Attributes:
        tap: Where, counted from 1; 0 is the fit.
        quantity: Of what; empty where whole answers are missing or too many.
        sentence: What differs and by how much.
    """

    tap: int
    quantity: str
    sentence: str


def first_difference(
    case: Case,
    expected: Sequence[Answer],
    actual: Sequence[Answer],
    tolerances: dict[str, Tolerance],
    without: Sequence[str] = (),
) -> Difference | None:
    """The first difference, or `None` where all is right.

    Args:
        case: The case.
        expected: Right answers, of the taps that have one.
        actual: The program's, one for each tap.
        tolerances: See `tolerance.tolerances`.
        without: Quantities that a program need not answer.
    """
    by_tap = {answer.tap: answer for answer in actual}
    for right in expected:
        given = by_tap.get(right.tap)
        if given is None:
            return Difference(right.tap, "", "there is no answer")
        found = _compare(case, right, given, tolerances, without)
        if found is not None:
            return Difference(right.tap, *found)
    return None


def is_later(other: Difference | None, found: Difference) -> bool:
    """Whether a difference, if there is one, comes after another."""
    return other is None or (other.tap, _order(other.quantity)) > (found.tap, _order(found.quantity))


def _order(quantity: str) -> int:
    return QUANTITIES.index(quantity) if quantity in QUANTITIES else -1


def _compare(
    case: Case, right: Answer, given: Answer, tolerances: dict[str, Tolerance], without: Sequence[str]
) -> tuple[str, str] | None:
    if right.error != given.error:
        said, due = printable((given.error or "an answer")[:60]), right.error or "an answer"
        return "error", f"it says {said} where {due} is due"
    for name in QUANTITIES:
        if name not in right.values or (name not in given.values and name in (*OPTIONAL, *without)):
            continue
        if name not in given.values:
            return name, f"{name} is missing"
        sentence = _differs(case, name, right, given.values[name], tolerances)
        if sentence:
            return name, sentence
    return None


def _differs(case: Case, name: str, right: Answer, value: Any, tolerances: dict[str, Tolerance]) -> str:
    """What is wrong with one quantity; empty if it passes."""
    if name == "decisions":
        allowed = allowed_decisions(case, right, tolerances["what"])
        for theta, passes, index in zip(case.thresholds, allowed, value.tolist(), strict=True):
            if index not in passes:
                return f"at threshold {theta:g} it decides {_choice(index)} instead of {_choices(passes)}"
        return ""
    if name == "move":
        moves = allowed_moves(case, right, tolerances["where"])
        return "" if value in moves else f"its move is {value:+d} instead of {_choices(moves, sign=True)}"
    return _array_differs(name, np.asarray(right.values[name]), np.asarray(value), tolerances[name])


def _array_differs(name: str, right: Any, value: Any, tolerance: Tolerance) -> str:
    if right.shape != value.shape:
        return f"{name} has shape {list(value.shape)} instead of {list(right.shape)}"
    same = right == value  # also minus infinity
    with np.errstate(invalid="ignore"):
        excess = np.abs(value - right) - tolerance.absolute - tolerance.relative * np.abs(right)
    wrong = ~same & ~(excess <= 0)
    if not wrong.any():
        return ""
    if right.shape == ():
        return f"{name} is {value:.17g} instead of {right:.17g}{_gap(value, right)}"
    size = np.where(wrong, np.where(np.isfinite(excess), excess, np.inf), -np.inf)
    place = np.unravel_index(int(size.argmax()), right.shape)
    where = ", ".join(f"{letter}={i}" for letter, i in zip(_LABELS.get(name, "b"), place, strict=False))
    return f"{name} at {where} is {value[place]:.17g} instead of {right[place]:.17g}{_gap(value[place], right[place])}"


def _gap(value: float, right: float) -> str:
    gap = abs(value - right)
    return f" (off by {gap:.2g})" if np.isfinite(gap) else ""


def _choice(index: int) -> str:
    return "nothing" if index < 0 else str(index)


def _choices(allowed: set[int], sign: bool = False) -> str:
    return " or ".join(f"{index:+d}" if sign else _choice(index) for index in sorted(allowed))
