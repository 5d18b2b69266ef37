"""What a file holds, whatever its format: named arrays or columns, read when they are asked for."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

type Values = NDArray[Any] | list[NDArray[Any]]
"""An array, or where its elements differ in shape one array for each."""


class TextTable(msgspec.Struct, frozen=True, kw_only=True):
    """How a table of text is written; see docs/reference/maps.md.

    Attributes:
        delimiter: Between cells, `"tab"`, or `"blank"` for any number of blanks; `None` to find it.
        decimal: Decimal mark.
        skip_rows: Lines before the header.
        comment: What begins a comment.
        header: Whether there is one.
    """

    delimiter: str | None = None
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


class Contents(ABC):
    """What a file holds.

    Attributes:
        path: The file or folder.
        variables: Its arrays or columns in their order; groups are joined by `/`, fields of structs by `.`.
        unreadable: Names of what cannot be read, each with the reason, for messages.
        attributes: Texts and numbers that belong to the file, such as a licence.
        table: Whether the variables are columns of one table, with as many rows each.
    """

    path: Path
    variables: Mapping[str, Variable]
    unreadable: Mapping[str, str]
    attributes: Mapping[str, str | float]
    table: bool = False

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

    def place(self, row: int) -> str:
        """Where a row of a table stands, for messages."""
        return f"row {row + 1}"
