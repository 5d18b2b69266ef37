"""CSV files, and folders of them, to a `Recording`; `csv_rows` documents the columns."""

import csv
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import storage
from ..blocks import BLOCK
from ..errors import InputError
from ..settings import Missing
from ..tap_checks import not_finite
from .recording import Labels, Recording, concatenated, naming, runs

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


def read_rows(path: Path, missing: Missing = "refuse") -> CsvRows:
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
        table, taxels, cells = _cells(path, header, numeric, lines, missing)
    except UnicodeDecodeError as error:
        raise InputError("not a CSV file: not UTF-8 text.") from error
    except csv.Error as error:
        raise InputError(f"not a CSV file: {error}.") from error
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}.") from error
    columns = {header[i]: table[:, j] for j, i in enumerate(i for i in numeric if header[i] in NUMBERS)}
    columns |= {name: _column(name, cells[i], lines) for i, name in enumerate(header) if i not in numeric}
    names = tuple(header[i] for i in numeric if header[i] not in NUMBERS)
    return CsvRows(taxels, names, columns | _whole(columns, lines), lines)


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of the first row and of all non-empty rows."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, strict=True)
        yield from ((reader.line_num, row) for row in reader if row or reader.line_num == 1)


def _check_header(header: Sequence[str]) -> None:
    if not header:
        raise InputError("the file is empty or starts with an empty line; a header line is needed.")
    twice = [name for name, number in Counter(header).items() if number > 1]
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


def _cells(
    path: Path, header: Sequence[str], numeric: Sequence[int], lines: NDArray[np.int64], missing: Missing
) -> tuple[NDArray[np.float64], NDArray[np.float64], Any]:
    """Numbers, shape (R, columns), those of taxels, shape (R, K), and a frame with the text of the other columns.

    Those of taxels are in a temporary file if they are many.
    """
    import pandas as pd  # noqa: PLC0415

    names = [header[i] for i in numeric]
    taxel = np.array([name not in NUMBERS for name in names])
    shape = len(lines), int(taxel.sum())
    large = 8 * shape[0] * shape[1] > storage.ON_DISK
    at_once = max(1, BLOCK // (8 * len(numeric))) if large else len(lines)

    def gathered(on_disk: bool, parts: Callable[..., Iterator[tuple[NDArray[np.float64], Any]]]) -> Any:
        numbers, texts = [], []

        def samples() -> Iterator[NDArray[np.float64]]:
            start = 0
            for table, text in parts(path, header, numeric, at_once):
                unknown = np.isnan(table) & (taxel & (missing == "drop"))
                _check_finite(np.where(unknown, 0.0, table), lines[start:], names)
                numbers.append(table[:, ~taxel])
                texts.append(text)
                start += len(table)
                yield table[:, taxel]

        if on_disk:
            taxels = storage.spooled((np.ascontiguousarray(part).data for part in samples()), shape, np.float64)
            if taxels is None:
                return gathered(False, parts)
        else:
            taxels = np.concatenate(list(samples()))
        return np.concatenate(numbers), taxels, pd.concat(texts, ignore_index=True)

    try:
        return gathered(large, _quickly)
    except InputError:
        raise
    except ValueError:  # pandas does not give the place, and `float` accepts more, such as 1_000
        return gathered(large, _as_python)


def _frames(path: Path, width: int, numeric: Sequence[int], at_once: int, **more: Any) -> Iterator[Any]:
    """Frames of so many rows, with numbers in some columns and text in the others."""
    import pandas as pd  # noqa: PLC0415

    kinds: Any = {i: "float64" if i in numeric else "object" for i in range(width)}
    how: Any = {"header": 0, "names": list(kinds), "dtype": kinds, "na_filter": False, "low_memory": False}
    with path.open(encoding="utf-8-sig", newline="") as file:
        yield from pd.read_csv(file, chunksize=at_once, **how, **more)


def _quickly(
    path: Path, header: Sequence[str], numeric: Sequence[int], at_once: int
) -> Iterator[tuple[NDArray[np.float64], Any]]:
    """Numbers and texts of so many rows at a time, as pandas reads them."""
    numeric = list(numeric)
    for frame in _frames(path, len(header), numeric, at_once):
        yield frame[numeric].to_numpy(), frame.drop(columns=numeric)


def _as_python(
    path: Path, header: Sequence[str], numeric: Sequence[int], at_once: int
) -> Iterator[tuple[NDArray[np.float64], Any]]:
    """Likewise, but numbers as Python reads them."""
    rows = islice(_rows(path), 1, None)
    texts = [i for i in range(len(header)) if i not in numeric]
    for frame in _frames(path, len(header), numeric, at_once, usecols=texts):
        own = islice(rows, len(frame))
        table = array("d", chain.from_iterable(_floats(line, row, header, numeric) for line, row in own))
        yield np.asarray(table).reshape(-1, len(numeric)), frame


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
            f"{not_finite(table[row, column], sample=names[column] not in NUMBERS)}"
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


_TAKEN = ("taps", "sample", "axis", "time", "what_name", "what_class", "where_value", "where_class", "where_edges")


def read_csv(path: Path, missing: Missing = "refuse") -> Recording:
    """Recording from one file.

    Raises:
        InputError: As `read_rows`, or the rows of a tap are inconsistent.
    """
    with naming(path):
        return _recording([path], [read_rows(path, missing)])


def read_csv_folder(folder: Path, missing: Missing = "refuse") -> Recording:
    """Recording from all `.csv` files of a folder, in natural order of their names.

    Each file is one session, numbered from 0, unless all have a column `session`.

    Raises:
        InputError: As `read_csv`; or there is no such file, or they have different columns.
    """
    paths = sorted((p for p in folder.iterdir() if p.suffix.lower() == ".csv"), key=_natural)
    if not paths:
        raise InputError(f"{folder}: no .csv files in this folder.")
    parts = []
    for path in paths:
        with naming(path):
            parts.append(read_rows(path, missing))
            _check_same_columns(parts[0], parts[-1], paths[0])
    return _recording(paths, parts)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorts `session-2` before `session-10`."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", path.name)]


def _check_same_columns(first: CsvRows, other: CsvRows, first_path: Path) -> None:
    if first.taxel_names != other.taxel_names:
        raise InputError(f"line 1: taxel columns differ from those of {first_path}.")
    differing = sorted(set(first.columns) ^ set(other.columns))
    if differing:
        raise InputError(f"line 1: column {differing[0]} is either here or in {first_path}, but not in both.")


def _recording(paths: Sequence[Path], parts: Sequence[CsvRows]) -> Recording:
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    frames = concatenated([part.taxels for part in parts])
    file = np.repeat(np.arange(len(parts)), [len(part.lines) for part in parts])
    lines = np.concatenate([part.lines for part in parts])
    places = _Places(paths, file, lines)
    columns.setdefault("session", file)
    labels = _labels(columns, places)
    if "tap" not in columns:
        starts = runs(file, columns["session"], labels.what)
        return Recording(frames, labels, _rate(columns, starts, places), file, time=columns.get("time_s"))
    starts = runs(file, columns["session"], columns["tap"])
    _check_taps(columns, starts, file, places)
    samples = np.diff(starts, append=len(frames))
    taps = frames.reshape(len(starts), samples[0], -1)
    return Recording(taps, labels.take(starts), _rate(columns, starts, places))


class _Places:
    """File and line of a row, for messages."""

    def __init__(self, paths: Sequence[Path], file: NDArray[np.int64], lines: NDArray[np.int64]) -> None:
        self._paths, self._file, self._lines = paths, file, lines

    def __getitem__(self, row: int) -> str:
        path = f"{self._paths[self._file[row]]}, " if len(self._paths) > 1 else ""
        return f"{path}line {self._lines[row]}"


def _check_taps(
    columns: dict[str, NDArray[Any]], starts: NDArray[np.intp], file: NDArray[np.int64], places: _Places
) -> None:
    """Checks that taps are in consecutive rows, of equal length, with constant labels."""
    tap, session = columns["tap"], columns["session"]
    seen: dict[tuple[int, int, int], int] = {}
    samples = np.diff(starts, append=len(tap))
    for start, length in zip(starts, samples, strict=True):
        key = int(file[start]), int(session[start]), int(tap[start])
        if key in seen:
            raise InputError(
                f"{places[start]}: tap {key[2]} of session {key[1]} starts again after another tap; "
                "rows of a tap must be consecutive, and tap numbers unique."
            )
        seen[key] = length
        if length != samples[0]:
            raise InputError(
                f"{places[start]}: tap {key[2]} has {length} rows, the first tap {samples[0]}; they must be equal."
            )
    first = np.repeat(starts, samples)
    for name in set(columns) - {"time_s"}:
        bad = np.flatnonzero(columns[name] != columns[name][first])
        if len(bad):
            raise InputError(
                f"{places[bad[0]]}: column {name} changes within tap {tap[bad[0]]} "
                f"from {columns[name][first[bad[0]]]} to {columns[name][bad[0]]}."
            )


def _labels(columns: dict[str, NDArray[Any]], places: _Places) -> Labels:
    """Labels of every row; objects are numbered by size if they have one, else in order of appearance."""
    names, first, what = np.unique(columns["what"], return_index=True, return_inverse=True)
    values = columns.get("what_value")
    order = np.argsort(first if values is None else values[first], kind="stable")
    tables: dict[str, Any] = {}
    if values is not None:
        bad = np.flatnonzero(values != values[first][what])
        if len(bad):
            raise InputError(f"{places[bad[0]]}: what_value of {columns['what'][bad[0]]} differs from its first one.")
        tables["what_value"] = values[first][order]
    extra = {name: column for name, column in columns.items() if name not in ("what", *NUMBERS)}
    for name in extra:
        if name in _TAKEN:
            raise InputError(f"column {name} must be renamed: the name is reserved in a tap set.")
    return Labels(
        what=np.argsort(order)[what],
        where=columns.get("where", np.zeros(len(what))),
        session=columns["session"],
        trial=columns.get("trial", columns.get("tap")),
        what_name=tuple(str(name) for name in names[order]),
        extra=extra,
        tables=tables,
    )


def _rate(columns: dict[str, NDArray[Any]], starts: NDArray[np.intp], places: _Places) -> float | None:
    """Samples per second from the median step of `time_s`, rounded to six digits."""
    if "time_s" not in columns or len(columns["time_s"]) < 2:
        return None
    steps = np.diff(columns["time_s"])
    inside = np.ones(len(steps), dtype=bool)
    inside[starts[1:] - 1] = False
    bad = np.flatnonzero(inside & (steps <= 0))
    if len(bad):
        raise InputError(f"{places[bad[0] + 1]}: time_s does not increase.")
    return float(f"{1 / np.median(steps[inside]):.6g}") if inside.any() else None
