"""Parser and checks of a program's answers to taps."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .case import Case

ZERO_EVIDENCE = "zero_evidence"
FIT = ("edges", "counts")
LOGS = ("log_likelihood", "log_posterior")
"""Arrays that may hold minus infinity."""
ARRAYS = ("log_likelihood", "posterior", "log_posterior", "where", "what")
QUANTITIES = (
    *FIT,
    "log_likelihood",
    "log_evidence",
    "posterior",
    "log_posterior",
    "where",
    "what",
    "decisions",
    "information",
    "move",
)
"""In the order in which one follows from those before."""
OPTIONAL = ("log_posterior",)
_MOST = 1e15  # whole numbers below it are doubles


class BadAnswerError(ValueError):
    """A line is no answer; the message says why."""


class _NoNumberError(ValueError):
    """A line holds NaN or an infinity."""


class Allowed(NamedTuple):
    """Choices that pass beside the right ones, as a file lists them.

    Attributes:
        decisions: Of each threshold; -1 is none.
        moves: Own moves.
    """

    decisions: list[set[int]]
    moves: set[int]


@dataclass(frozen=True)
class Answer:
    """One line of answers.

    Attributes:
        tap: Which tap; 0 for the fitted tables.
        values: Arrays, numbers and choices by quantity; a decision of -1 is none.
        error: `"zero_evidence"` in place of values.
        allowed: What passes beside it; `None` where that is computed.
    """

    tap: int
    values: Mapping[str, Any] = field(default_factory=dict)
    error: str | None = None
    allowed: Allowed | None = None

    def line(self, case: str) -> dict[str, Any]:
        """As a program writes it; minus infinity and no decision are `None`."""
        start: dict[str, Any] = {"case": case, "tap": self.tap}
        if self.error is not None:
            return start | {"error": self.error}
        return start | {name: _plain(name, self.values[name]) for name in QUANTITIES if name in self.values}

    def without(self, names: Sequence[str]) -> "Answer":
        """The same less some quantities."""
        return replace(self, values={name: value for name, value in self.values.items() if name not in names})


def _plain(name: str, value: Any) -> Any:
    if name == "decisions":
        return [None if m < 0 else int(m) for m in value]
    if isinstance(value, np.ndarray):
        return _without_infinity(value.tolist())
    return int(value) if name == "move" else float(value)


def _without_infinity(values: Any) -> Any:
    if isinstance(values, list):
        return [_without_infinity(value) for value in values]
    return None if values == -np.inf else values


def parse_answer(line: str, case: Case) -> Answer:
    """The answer in a line.

    Raises:
        BadAnswerError: It is none.
    """
    try:
        fields = json.loads(line, parse_constant=_refuse)
    except _NoNumberError as error:
        raise BadAnswerError(f"is not JSON, which has no {error}; minus infinity is null: {_shown(line)}") from None
    except json.JSONDecodeError as error:
        if 3 * line.count("\0") > len(line) and ('"\0' in line or '\0"' in line):  # every other byte of plain letters
            raise BadAnswerError("is UTF-16, not UTF-8") from None
        if not line[error.pos :].strip():
            raise BadAnswerError(f"ends within an object, which must be on one line: {_shown(line)}") from None
        place = f" from character {error.pos + 1} on" if error.pos else ""
        raise BadAnswerError(f"is not JSON{place}: {_shown(line[error.pos :])}") from None
    except (ValueError, RecursionError):  # also a number of thousands of digits, and lists within lists
        raise BadAnswerError(f"is not JSON: {_shown(line)}") from None
    if not isinstance(fields, dict):
        raise BadAnswerError(f"is not a JSON object: {_shown(line)}")
    return _answer(fields, case, line)


def given_answer(fields: object, case: Case, tap: int) -> Answer:
    """The answer that a Python function gives to a tap, with NumPy arrays or lists.

    Raises:
        BadAnswerError: It is none.
    """
    if not isinstance(fields, Mapping):
        raise BadAnswerError(f"is not a mapping: {_shown(fields)}")
    names = ("case", "tap", "error", *QUANTITIES)
    given = {name: _python(name, fields[name]) for name in names if name in fields}
    return _answer({"case": case.name, "tap": tap, **given}, case, fields)


def _python(name: str, value: Any) -> Any:
    """A value as JSON would have it, but with infinities."""
    if isinstance(value, list | tuple):
        return [_python(name, part) for part in value]
    if value is None or isinstance(value, str | int):
        return value
    array = np.asarray(value)
    if array.dtype.kind == "f" and np.isnan(array).any():
        raise BadAnswerError(f"has NaN in {name}")
    return array.tolist()


def _answer(fields: Mapping[str, Any], case: Case, shown: object) -> Answer:
    """The answer in these fields, which a message shows as they were given."""
    if fields.get("case") != case.name:
        about = f"is about case {_shown(fields['case'])} instead of" if "case" in fields else "does not name its case,"
        raise BadAnswerError(f"{about} {case.name!r}")
    if "tap" not in fields:
        raise BadAnswerError(f"has no tap number: {_shown(shown)}")
    tap = _whole("tap", fields["tap"])
    if fields.get("error") is not None:
        return Answer(tap, error=str(fields["error"]))
    values = {name: _value(name, fields[name], case) for name in QUANTITIES if name in fields}
    return Answer(tap, values)


def _value(name: str, value: Any, case: Case) -> Any:
    if name == "move":
        return _whole(name, value)
    if name == "decisions":
        value = value if isinstance(value, list) else [value]
        if len(value) != len(case.thresholds):
            raise BadAnswerError(
                f"has decisions {_shown(value)}, one for each of {len(case.thresholds)} thresholds is due"
            )
        return np.array([-1 if m is None else _whole(name, m) for m in value], dtype=np.int64)
    if name == "log_evidence":
        return float(_numbers(name, value, (), empty=True))
    return _numbers(name, value, _shape(name, case), empty=name in LOGS)


def _refuse(constant: str) -> Any:
    raise _NoNumberError(constant)


def _whole(name: str, value: Any) -> int:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not abs(value) < _MOST or value != int(value):
        said = "text, not" if isinstance(value, str) else "not"
        raise BadAnswerError(f"has {name} {_shown(value)}, which is {said} a whole number")
    return int(value)


def _numbers(name: str, value: Any, shape: tuple[int, ...], empty: bool) -> NDArray[np.float64]:
    """An array in which null stands for minus infinity, if it may."""
    try:
        array = np.array(value, dtype=np.float64)  # null becomes NaN
    except (TypeError, ValueError, OverflowError):
        raise BadAnswerError(f"has {name} {_shown(value)}, numbers of shape {list(shape)} are due") from None
    if array.shape != shape and np.squeeze(array).shape == tuple(n for n in shape if n > 1):
        array = array.reshape(shape)  # some languages write a list of one as a number, and a column as lists in a list
    if array.shape != shape and not (name == "edges" and array.ndim == 2):  # one range per taxel is a usual mistake
        raise BadAnswerError(f"has {name} of shape {list(array.shape)}, {list(shape)} is due")
    if empty:
        return np.where(np.isnan(array), -np.inf, array)
    if np.isnan(array).any():
        raise BadAnswerError(f"has null or NaN in {name}")
    return array


def _shape(name: str, case: Case) -> tuple[int, ...]:
    L, M, K, _, B = case.sizes.values()
    shapes = {"where": (L,), "what": (M,), "information": (L,), "edges": (B + 1,), "counts": (L, M, K, B)}
    return shapes.get(name, (L, M))


def _shown(value: Any) -> str:
    text = str(value).strip()
    return repr(text if len(text) <= 60 else f"{text[:57]}...")
