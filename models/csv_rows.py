"""Comma-separated text to columns, with the line of every row kept for error messages.

=============  ==========================================================================================
column         meaning
=============  ==========================================================================================
``what``       name of the object, required
``taxel...``   one column per taxel, in the order of the header; at least one
``tap``        number of the tap, the same in all its rows; without this column the rows are a stream
``where``      position
``session``    number of the recording session
``trial``      number of the tap as recorded; default its ``tap``
``time_s``     seconds, increasing within a tap or stream; gives the sampling rate
``what_value`` size of the object, the same wherever its name stands
other          one number or text per tap, kept under its own name
=============  ==========================================================================================
"""

import csv
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError

NUMBERS = ("tap", "where", "session", "trial", "time_s", "what_value")
WHOLE = ("tap", "session", "trial")


@dataclass(frozen=True, eq=False)
class CsvRows:
    """The rows of one file.

    Attributes:
        taxels: Samples, shape (R, K).
        taxel_names: Header of the taxel columns, `K` names.
        columns: The other columns, each of shape (R,): numbers, or text for `what` and for what is no number.
        lines: Line of each row in the file, counted from 1, shape (R,).
    """

    taxels: NDArray[np.float64]
    taxel_names: tuple[str, ...]
    columns: dict[str, NDArray[Any]]
    lines: NDArray[np.int64]


def read_rows(path: Path) -> CsvRows:
    """The rows of a file.

    Raises:
        InputError: The file is empty or no UTF-8 text, the header lacks a column or names one twice, or a row has a
            missing cell or a cell that is no finite number; the sentence names line and column.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            header = [name.strip() for name in next(reader, [])]
            _check_header(header)
            return _parse(header, ((reader.line_num, row) for row in reader if row))
    except UnicodeDecodeError as error:
        raise InputError("this is no CSV file: it holds bytes that are no UTF-8 text.") from error
    except csv.Error as error:
        raise InputError(f"this is no CSV file: {error}.") from error
    except OSError as error:
        raise InputError(f"the file cannot be read: {error.strerror}.") from error


def _check_header(header: Sequence[str]) -> None:
    if not header:
        raise InputError("the file is empty or begins with an empty line, a header line is needed.")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise InputError(f"line 1 names the column {twice[0]!r} twice.")
    if "what" not in header:
        raise InputError(f"line 1 has no column what; separated by commas it reads: {', '.join(header)[:200]}.")
    if not any(name.startswith("taxel") for name in header):
        raise InputError("line 1 has no column whose name begins with taxel.")


def _parse(header: Sequence[str], rows: Iterable[tuple[int, Sequence[str]]]) -> CsvRows:
    numeric = [i for i, name in enumerate(header) if name in NUMBERS or name.startswith("taxel")]
    textual = [i for i in range(len(header)) if i not in numeric]
    numbers, lines, texts = array("d"), array("q"), [[] for _ in textual]
    for line, row in rows:
        if len(row) != len(header):
            raise InputError(f"line {line} has {len(row)} cells, the header has {len(header)}.")
        try:
            numbers.extend([float(row[i]) for i in numeric])
        except ValueError:
            raise _no_number(line, row, [(i, header[i]) for i in numeric]) from None
        lines.append(line)
        for column, i in zip(texts, textual, strict=True):
            column.append(row[i].strip())
    if not lines:
        raise InputError("the file has a header but no rows.")
    table = np.asarray(numbers).reshape(-1, len(numeric))
    _check_finite(table, lines, [header[i] for i in numeric])
    columns = {header[i]: table[:, j] for j, i in enumerate(numeric) if header[i] in NUMBERS}
    columns |= {header[i]: _column(header[i], column, lines) for i, column in zip(textual, texts, strict=True)}
    taxels = [j for j, i in enumerate(numeric) if header[i] not in NUMBERS]
    names = tuple(header[numeric[j]] for j in taxels)
    return CsvRows(table[:, taxels], names, _whole(columns, lines), np.asarray(lines))


def _no_number(line: int, row: Sequence[str], numeric: Sequence[tuple[int, str]]) -> InputError:
    for i, name in numeric:
        try:
            float(row[i])
        except ValueError:
            return InputError(f"line {line}, column {name} holds {row[i]!r}, which is not a number.")
    return InputError(f"line {line} holds something that is not a number.")


def _check_finite(table: NDArray[np.float64], lines: Sequence[int], names: Sequence[str]) -> None:
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise InputError(
            f"line {lines[row]}, column {names[column]} holds {table[row, column]}; "
            "NaN and infinite values are not accepted."
        )


def _column(name: str, cells: Sequence[str], lines: Sequence[int]) -> NDArray[Any]:
    """A text column; one that is no label becomes numbers if all its cells are."""
    if name == "what":
        if "" in cells:
            raise InputError(f"line {lines[cells.index('')]}, column what is empty.")
        return np.array(cells, dtype=np.str_)
    try:
        return np.array([float(cell) for cell in cells])
    except ValueError:
        return np.array(cells, dtype=np.str_)


def _whole(columns: dict[str, NDArray[Any]], lines: Sequence[int]) -> dict[str, NDArray[Any]]:
    """The columns, with those that count things as whole numbers."""
    whole = {}
    for name in set(WHOLE) & set(columns):
        values = columns[name]
        bad = np.flatnonzero(values != np.round(values))
        if len(bad):
            raise InputError(f"line {lines[bad[0]]}, column {name} holds {values[bad[0]]:g}, which is no whole number.")
        whole[name] = values.astype(np.int64)
    return columns | whole
