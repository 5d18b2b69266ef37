"""Published examples of other packages: parameters, what was observed, what they expect, and where that stands."""

import re
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from fractions import Fraction
from math import lcm
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FILE = Path(__file__).with_name("examples.toml")


@dataclass(frozen=True, kw_only=True)
class Example:
    """A hidden Markov model and a sequence that was observed.

    Attributes:
        name: Its name in the tables.
        package: Package and version.
        source: File and test or notebook in the repository of the package.
        start: Probability of each state at first, shape (S,).
        transition: Probabilities from state to state, shape (S, S), or (T - 1, S, S) if they differ in time.
        taps: What was observed, as training taps have it: symbols, shape (T, J, K).
        trained: Number of training samples of each state, taxel and symbol, shape (S, K, B), in the ratio of the
            published probabilities; `None` where `likelihood` is given instead.
        likelihood: Likelihood of every observation in every state, shape (T, S), or `None`.
        power: Root of the likelihood of a tap, `"J"` or `"none"`.
        expected: What the package expects, by quantity.
        within: Largest differences from it, by quantity.
    """

    name: str
    package: str
    source: str
    start: NDArray[np.float64]
    transition: NDArray[np.float64]
    taps: NDArray[np.float64]
    trained: NDArray[np.int64] | None = None
    likelihood: NDArray[np.float64] | None = None
    power: str = "none"
    expected: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    within: dict[str, float] = field(default_factory=dict)

    @property
    def transitions(self) -> NDArray[np.float64]:
        """Probabilities from state to state before each observation but the first, shape (T - 1, S, S)."""
        S = len(self.start)
        return np.broadcast_to(self.transition, (len(self.taps) - 1, S, S))

    @property
    def log_likelihood(self) -> NDArray[np.float64]:
        """Log-likelihood of every observation in every state, shape (T, S), sample by sample."""
        if self.likelihood is not None:
            return np.log(self.likelihood)
        assert self.trained is not None  # noqa: S101 - one of the two is given
        with np.errstate(divide="ignore"):
            log_prob = np.log(self.trained / self.trained.sum(axis=-1, keepdims=True))
        _, J, K = self.taps.shape
        symbols = self.taps.astype(int)
        total = sum(log_prob[:, k, symbols[:, j, k]].T for j in range(J) for k in range(K))
        return np.asarray(total) / (J if self.power == "J" else 1)


@dataclass(frozen=True, kw_only=True)
class Active:
    """An example whose place is moved by actions, while the object stays.

    Attributes:
        start: Place before the first observation.
        taps: As in `Example`.
        trained: As in `Example`, shape (L, M, K, B).
        visited: Place of each observation.
    """

    name: str
    package: str
    source: str
    places: Sequence[str]
    objects: Sequence[str]
    start: int
    taps: NDArray[np.float64]
    trained: NDArray[np.int64]
    visited: Sequence[int]
    expected: dict[str, NDArray[np.float64]] = field(default_factory=dict)


def examples() -> dict[str, Example]:
    """All examples without actions, by name."""
    return {given["name"]: _example(dict(given)) for given in _file()["example"]}


def active_examples() -> dict[str, Active]:
    """All examples with actions, by name."""
    found = {}
    for given in _file()["active"]:
        expected = {name: _numbers(value) for name, value in given.pop("expected", {}).items()}
        taps, trained = _numbers(given.pop("seen")), _counts(given.pop("emission"))
        found[given["name"]] = Active(**given, taps=taps, trained=trained, expected=expected)
    return found


def _file() -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"), parse_float=Decimal)


def _example(given: dict[str, Any]) -> Example:
    expected, allowed = given.pop("expected", {}), given.pop("within", {})
    within = {name: float(allowed.get(name, _half_unit(value))) for name, value in expected.items()}
    for name in ("start", "transition"):
        given[name] = _numbers(given[name])
    bags = given.pop("bags", None)
    seen = [np.repeat(np.arange(len(bag)), bag)[:, None].tolist() for bag in bags] if bags else given.pop("seen")
    trained = _counts(given.pop("emission"))
    return Example(
        **given,
        taps=_numbers(seen),
        trained=trained,
        expected={name: _numbers(value) for name, value in expected.items()},
        within=within,
    )


def _numbers(value: Any) -> NDArray[np.float64]:
    """Floats from nested lists of numbers and texts such as "1/6"."""
    return np.array(_each(value, lambda one: float(Fraction(str(one)))), dtype=np.float64)


def _each(value: Any, function: Any) -> Any:
    return [_each(part, function) for part in value] if isinstance(value, list) else function(value)


def _flat(value: Any) -> list[Any]:
    return [one for part in value for one in _flat(part)] if isinstance(value, list) else [value]


def _counts(emission: Any) -> NDArray[np.int64]:
    """Whole numbers in the ratio of probabilities (..., K, B), the same in sum for all; zeros fill up rows."""
    exact = _each(emission, lambda one: Fraction(str(one)))
    times = lcm(*(one.denominator for one in _flat(exact)))
    B = max(len(row) for row in _rows(exact))
    return np.array(_filled(_each(exact, lambda one: int(one * times)), B), dtype=np.int64)


def _rows(value: Any) -> list[list[Any]]:
    return [row for part in value for row in _rows(part)] if isinstance(value[0], list) else [value]


def _filled(value: Any, B: int) -> Any:
    return [_filled(part, B) for part in value] if isinstance(value[0], list) else value + [0] * (B - len(value))


def _half_unit(value: Any) -> Decimal:
    """Half a unit of the last digit of the numbers, a little more for rounding; 0 for whole numbers."""
    digits = max(
        (len(re.sub(r"^-?\d*\.?", "", str(one))) for one in _flat(value) if isinstance(one, Decimal)), default=0
    )
    return Decimal("0.5000001") * Decimal(10) ** -digits if digits else Decimal(0)
