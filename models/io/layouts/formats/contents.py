"""What a file holds, whatever its format: named arrays or columns, read when they are asked for."""

import re
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from ....errors import InputError, counted

_LISTED = 8
_AT_END = re.compile(r"[^\W_]+[_. -]([^\W\d_]+|°)$")
_UNITS = (
    re.compile(r"(?P<name>.*\S)\s*\[(?P<unit>[^\]]*[^\W\d][^\]]*|[°%])\]"),
    re.compile(r"(?P<name>.*\S)\s*\((?P<unit>[^)]*[^\W\d][^)]*|[°%])\)"),
    re.compile(r"(?P<name>.*\w)\s*/\s*(?P<unit>[kmuµμnhM]?(?:s|N|V|A|Pa|Hz|g|m|Nm|rad|bar)|cm|deg|°C?|K|%|min|h)"),
)

type Values = NDArray[Any] | list[NDArray[Any]]
"""An array, or where its elements differ in shape one array for each."""


class TextTable(msgspec.Struct, frozen=True, kw_only=True):
    """How a table of text is written; see docs/reference/maps.md.

    Attributes:
        delimiter: Between cells, `"tab"`, or `"blank"` for any number of blanks, or several of them; `None` to find it.
        decimal: Decimal mark.
        skip_rows: Lines before the header.
        comment: What begins a comment.
        header: Whether there is one.
    """

    delimiter: str | tuple[str, ...] | None = None
    decimal: str = "."
    skip_rows: int = 0
    comment: str = ""
    header: bool = True


@dataclass(frozen=True)
class Variable:
    """An array or column of a file.

    Attributes:
        shape: Its axes; `None` for one whose length is unknown before reading or differs between elements.
        dtype: Of its numbers; kind `U` for texts.
        unit: As the file states it, or empty.
    """

    shape: tuple[int | None, ...]
    dtype: np.dtype[Any]
    unit: str = ""


class Several(str):
    """Values of an attribute, as a text joined by commas."""

    values: tuple[str | float, ...]

    def __new__(cls, values: Sequence[str | float]) -> "Several":
        """The text of texts and numbers."""
        text = super().__new__(cls, ", ".join(each if isinstance(each, str) else f"{each:g}" for each in values))
        text.values = tuple(values)
        return text


class Contents(ABC):
    """What a file holds.

    Attributes:
        path: The file or folder.
        variables: Its arrays or columns in their order; groups are joined by `/`, fields of structs by `.`.
        unreadable: Names of what cannot be read, each with the reason, for messages.
        damage: What of it is left out as it is damaged, in a sentence, empty if nothing is.
        told: What to know of how it is read, one sentence each.
        attributes: Texts and numbers that belong to the file, such as a licence, or several of them.
        table: Whether the variables are columns of one table, with as many rows each.
        most: How many blocks of rows of a table `read` reads, each of some MiB; `None` for all.
        without_cut: Whether a last row of a table that is cut is left out, as `damage` tells, or else refused.
    """

    path: Path
    variables: Mapping[str, Variable]
    unreadable: Mapping[str, str]
    damage: str = ""
    told: Sequence[str] = ()
    attributes: Mapping[str, str | float]
    table: bool = False
    most: int | None = None
    without_cut: bool = False

    @property
    def columns(self) -> Sequence[str]:
        """Names of the columns by number."""
        return list(self.variables)

    @property
    def repeated(self) -> Sequence[str]:
        """Names that several columns have, which are told apart by numbers."""
        return ()

    @abstractmethod
    def read(self, names: Sequence[str], columns: Sequence[str] = ()) -> tuple[dict[str, Values], NDArray[Any] | None]:
        """Reads variables, in one pass through the file where that is how it is read.

        Args:
            names: Variables to be read as they are; texts as `U`, columns of a text table as texts.
            columns: Further variables of one axis and one length R, of numbers.

        Returns:
            The variables by name, and the columns side by side as floats, shape (R, len(columns)), in a temporary file
            if they are many (`storage.ON_DISK`); `None` without columns. Missing numbers are NaN.

        Raises:
            InputError: The file is damaged, or a column holds what is not a number; the message names variable and
                place, but not the file.
        """

    def clock(self, name: str) -> str | None:  # noqa: ARG002 - as that of messages
        """Variable with the time of each row of another one, in seconds; `None` where rows have no clock."""
        return None

    def place(self, row: int) -> str:
        """Where a row of a table stands, for messages."""
        return f"row {row + 1}"

    def named(self, name: str) -> str:
        """Full name of a variable; its name without the unit will do where no other has it.

        Raises:
            InputError: There is no such variable, or several; the message lists those, or close ones.
        """
        if name in self.variables:
            return name
        found = [full for full, each in self.variables.items() if each.unit and name_and_unit(full)[0] == name]
        if len(found) == 1:
            return found[0]
        if name in self.unreadable:
            raise InputError(f"{name} cannot be read: {self.unreadable[name]}.")
        if found:
            raise InputError(f"{name} may be {' or '.join(found)}.")
        close = get_close_matches(name, self.variables, cutoff=0.5) or list(self.variables)[:_LISTED]
        raise InputError(f"no {'column' if self.table else 'array'} {name}; there is {', '.join(close) or 'none'}.")


class InStep(NamedTuple):
    """Variables with a value for each row of the samples.

    Attributes:
        values: The variables.
        known: Which rows have a value of all of them, shape (rows,); `None` if all do.
        told: How they were found, one sentence each.
    """

    values: Mapping[str, Values]
    known: NDArray[np.bool_] | None = None
    told: tuple[str, ...] = ()


def with_clocks(names: Sequence[str], samples: Sequence[str], contents: Contents) -> list[str]:
    """Names of variables, and of the clocks of those that have another one than the samples.

    Args:
        names: Full names.
        samples: Name of the samples, if there are any.
        contents: The file.
    """
    clocks = {name: contents.clock(name) for name in (*samples, *names)}
    return [*dict.fromkeys([*names, *(filter(None, clocks.values()) if len({*clocks.values()}) > 1 else ())])]


def in_step(values: Mapping[str, Values], names: Sequence[str], sample: str, contents: Contents, rows: int) -> InStep:
    """Variables of another clock as the last value at or before each row; those with as many rows stay as they are.

    Args:
        values: All variables that were read, and the clocks of `with_clocks`.
        names: Those that have a value for each row.
        sample: Name of the samples.
        contents: The file.
        rows: Number of rows of the samples.

    Raises:
        InputError: One has no value before the last row.
    """
    own = contents.clock(sample)
    others = [name for name in names if contents.clock(name) != own and len(values[name]) != rows]
    if own is None or not others or len(time := np.asarray(values[own])) != rows:
        return InStep(values)
    known, found, told = np.ones(rows, dtype=bool), dict(values), list[str]()
    for name in others:
        at = _last(np.asarray(values[contents.clock(name) or name]), time)
        if (at < 0).all():
            raise InputError(f"{name}: its first message is later than all of {own.rpartition('/')[0]}.")
        known &= at >= 0
        of, first = values[name], np.maximum(at, 0)
        found[name] = of[first] if isinstance(of, np.ndarray) else [of[row] for row in first.tolist()]
    told.append(f"{', '.join(others)}: the last message at or before each of {own.rpartition('/')[0]} counts.")
    if not known.all():
        told.append(f"{contents.path}: {counted(int((~known).sum()), 'row')} left out: before the first of these.")
    return InStep(found, None if known.all() else known, tuple(told))


def _last(clock: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.intp]:
    """Row of the latest message at or before each time, the last one of several; -1 if there is none."""
    order = np.argsort(clock, kind="stable")
    at = np.searchsorted(clock[order], time, "right") - 1
    return np.where(at < 0, -1, order[at])


def unit_at_end(name: str, known: Collection[str]) -> str:
    """Unit at the end of a name such as `time_ms`, if it is one of those known; empty otherwise."""
    found = _AT_END.search(name)
    return found[1] if found is not None and found[1] in known else ""


def name_and_unit(header: str) -> tuple[str, str]:
    """Name and unit of a header such as `force [N]`, `t (ms)` or `t/ms`; the unit is empty if there is none."""
    found = next(filter(None, (pattern.fullmatch(header) for pattern in _UNITS)), None)
    return (found["name"], found["unit"].strip()) if found else (header, "")
