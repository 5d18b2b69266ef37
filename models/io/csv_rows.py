"""CSV text to columns, with the line number of every row for messages.

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
``what_value`` size of the object, the same in all its rows
other          one number or text per tap, kept under its own name
=============  ==========================================================================================
"""

import csv
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

NUMBERS = ("tap", "where", "session", "trial", "time_s", "what_value")
WHOLE = ("tap", "session", "trial")


@dataclass(frozen=True, eq=False)
class CsvRows:
    """The rows of one file.

    Attributes:
        taxels: Samples, shape (R, K).
        taxel_names: Header of the taxel columns, `K` names.
        columns: Other columns, each of shape (R,): numbers, or text for `what` and non-numeric columns.
        lines: Line of each row in the file, counted from 1, shape (R,).
    """

    taxels: NDArray[np.float64]
    taxel_names: tuple[str, ...]
    columns: dict[str, NDArray[Any]]
    lines: NDArray[np.int64]


def read_rows(path: Path) -> CsvRows:
    """Rows of a file.

    Raises:
        InputError: The file is empty or not UTF-8 text, the header lacks or repeats a column, or a row has a missing
            cell or one that is not a finite number; the message names line and column.
    """
    try:
        rows = _rows(path)
        header = [name.strip() for name in next(rows, (1, []))[1]]
        _check_header(header)
        numeric = [i for i, name in enumerate(header) if name in NUMBERS or name.startswith("taxel")]
        lines = _check_rows(rows, header, numeric)
        table, cells = _cells(path, header, numeric)
    except UnicodeDecodeError as error:
        raise InputError("not a CSV file: not UTF-8 text.") from error
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}.") from error
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}.") from error
    _check_finite(table, lines, [header[i] for i in numeric])
    columns = {header[i]: table[:, j] for j, i in enumerate(numeric) if header[i] in NUMBERS}
    columns |= {name: _column(name, cells[i], lines) for i, name in enumerate(header) if i not in numeric}
    taxels = [j for j, i in enumerate(numeric) if header[i] not in NUMBERS]
    names = tuple(header[numeric[j]] for j in taxels)
    return CsvRows(table[:, taxels], names, columns | _whole(columns, lines), lines)


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of the first row and of all non-empty rows."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        yield from ((reader.line_num, row) for row in reader if row or reader.line_num == 1)


def _check_header(header: Sequence[str]) -> None:
    if not header:
        raise InputError("the file is empty or starts with an empty line; a header line is needed.")
    twice = [name for name in header if header.count(name) > 1]
    if twice:
        raise InputError(f"line 1: column {twice[0]!r} is repeated.")
    if "what" not in header:
        raise InputError(f"line 1: missing column what; columns, split at commas: {', '.join(header)[:200]}.")
    if not any(name.startswith("taxel") for name in header):
        raise InputError("line 1: no column name starts with taxel.")


def _check_rows(
    rows: Iterable[tuple[int, list[str]]], header: Sequence[str], numeric: Sequence[int]
) -> NDArray[np.int64]:
    """Line number of each row; pandas gives none, fills short rows and joins text around quotes."""
    lines = array("q")
    for line, row in rows:
        if len(row) != len(header):
            raise InputError(f"line {line}: {len(row)} cells, but the header has {len(header)}.")
        if not lines:
            _floats(line, row, header, numeric)  # pandas takes a column of only True and False for numbers
        lines.append(line)
    if not lines:
        raise InputError("the file has a header but no data rows.")
    return np.asarray(lines)


def _cells(path: Path, header: Sequence[str], numeric: Sequence[int]) -> tuple[NDArray[np.float64], Any]:
    """Numbers, shape (R, len(numeric)), and a frame with the text of the other columns."""
    import pandas as pd  # noqa: PLC0415

    kinds = {i: "float64" if i in numeric else "object" for i in range(len(header))}
    how: Any = {"header": 0, "names": list(kinds), "dtype": kinds, "na_filter": False, "low_memory": False}
    with path.open(encoding="utf-8-sig", newline="") as file:
        try:
            frame = pd.read_csv(file, **how)
            return frame[numeric].to_numpy(), frame
        except ValueError:  # pandas does not give the place, and `float` accepts more, such as 1_000
            rows = islice(_rows(path), 1, None)
            table = array("d", chain.from_iterable(_floats(line, row, header, numeric) for line, row in rows))
            file.seek(0)
            frame = pd.read_csv(file, usecols=[i for i in kinds if i not in numeric], **how)
            return np.asarray(table).reshape(-1, len(numeric)), frame


def _floats(line: int, row: Sequence[str], header: Sequence[str], numeric: Sequence[int]) -> list[float]:
    """The numbers of a row as Python reads them."""
    try:
        return [float(row[i]) for i in numeric]
    except ValueError as error:
        i = next(i for i in numeric if not _is_number(row[i]))
        raise InputError(f"line {line}, column {header[i]}: {row[i]!r} is not a number.") from error


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _check_finite(table: NDArray[np.float64], lines: NDArray[np.int64], names: Sequence[str]) -> None:
    bad = np.argwhere(~np.isfinite(table))
    if len(bad):
        row, column = bad[0]
        raise InputError(
            f"line {lines[row]}, column {names[column]}: {table[row, column]}; "
            "NaN and infinite values are not accepted."
        )


def _column(name: str, cells: Any, lines: NDArray[np.int64]) -> NDArray[Any]:
    """A text column; converted to numbers if all cells are numeric and it is not a label."""
    codes, found = cells.factorize()
    texts: Any = [text.strip() for text in found]
    if name == "what":
        empty = np.flatnonzero(np.array([not text for text in texts])[codes])
        if len(empty):
            raise InputError(f"line {lines[empty[0]]}, column what: empty.")
    else:
        with suppress(ValueError):
            texts = [float(text) for text in texts]
    return np.array(texts)[codes]


def _whole(columns: dict[str, NDArray[Any]], lines: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """Columns of counts, as integers."""
    whole = {}
    for name in set(WHOLE) & set(columns):
        values = columns[name]
        bad = np.flatnonzero(values != np.round(values))
        if len(bad):
            raise InputError(f"line {lines[bad[0]]}, column {name}: {values[bad[0]]:g} is not an integer.")
        whole[name] = values.astype(np.int64)
    return whole
