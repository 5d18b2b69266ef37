"""CSV files with the columns of this software, and folders of them, to a `Recording`.

=====================  ===============================================================================================
column                 meaning
=====================  ===============================================================================================
``taxel...``           samples, one column for each taxel
``what``               name of the object
``what_value``         its size
``where``              position
``tap``                number of the tap, the same in its consecutive rows; without it rows are frames of streams
``session``            number of the recording session; without it that of the file in its folder
``trial``              number of the tap as recorded
``time_s``             time in seconds
=====================  ===============================================================================================

The first and ``what`` are required. Every further column is kept, as numbers if all of its cells are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cutting.sampling_rate import common_rate, pace
from ..errors import InputError
from ..settings import Missing
from .layouts.formats.contents import Contents, TextTable
from .layouts.formats.registry import open_contents
from .layouts.label_values import as_known
from .layouts.patterns import natural
from .recording import Labels, Recording, as_samples, concatenated, naming, runs

NUMBERS = ("tap", "where", "session", "trial", "time_s", "what_value")
WHOLE = ("tap", "session", "trial")


@dataclass(frozen=True, eq=False)
class CsvRows:
    """The rows of one file.

    Attributes:
        contents: The file.
        taxels: Samples, shape (R, K).
        taxel_names: Header of the taxel columns, `K` names.
        columns: Other columns, each of shape (R,): numbers, or text for `what` and non-numeric columns.
    """

    contents: Contents
    taxels: NDArray[np.floating]
    taxel_names: tuple[str, ...]
    columns: dict[str, NDArray[Any]]


def _read_rows(path: Path, missing: Missing) -> CsvRows:
    """Rows of a file.

    Raises:
        InputError: The file is no table, the header lacks or repeats a column, or a cell holds no number where one is
            needed; the message names file, line and column.
    """
    contents = open_contents(path, TextTable(delimiter=","), "text")
    with naming(path):
        header = contents.columns
        _check_header(header, contents.repeated)
        taxels = tuple(name for name in header if name.startswith("taxel"))
        known = [name for name in NUMBERS if name in header]
        values, table = contents.read([name for name in header if name not in (*taxels, *known)], [*taxels, *known])
        numbers = np.asanyarray(table)

        def place(index: tuple[int, ...]) -> str:
            return f"{contents.place(index[0])}, column {[*taxels, *known][index[1]]}"

        samples = as_samples("taxel", numbers[:, : len(taxels)], missing, place)
        as_samples("label", numbers[:, len(taxels) :], None, lambda index: place((index[0], index[1] + len(taxels))))
        columns = {name: numbers[:, i] for i, name in enumerate(known, len(taxels))}
        columns |= {name: as_known(np.asarray(of)) if name != "what" else np.asarray(of) for name, of in values.items()}
        empty = np.flatnonzero(columns["what"] == "")
        if len(empty):
            raise InputError(f"{contents.place(int(empty[0]))}, column what: empty.")
        return CsvRows(contents, samples, taxels, columns | _whole(contents, columns))


def _check_header(header: Sequence[str], repeated: Sequence[str]) -> None:
    if repeated:
        raise InputError(f"line 1: column {repeated[0]!r} is repeated.")
    if "what" not in header:
        raise InputError(
            f"line 1: missing column what; columns, split at commas: {', '.join(header)[:200]}; for "
            "another layout solidtouch convert --look shows what is there."
        )
    if not any(name.startswith("taxel") for name in header):
        raise InputError("line 1: no column name starts with taxel; solidtouch convert --look shows what is there.")


def _whole(contents: Contents, columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[np.int64]]:
    """Columns of counts, as integers."""
    whole = {}
    for name in set(WHOLE) & set(columns):
        values = columns[name]
        bad = np.flatnonzero(values != np.round(values))
        if len(bad):
            raise InputError(f"{contents.place(int(bad[0]))}, column {name}: {values[bad[0]]:g} is not an integer.")
        whole[name] = values.astype(np.int64)
    return whole


def read_csv(path: Path, missing: Missing = "refuse") -> Recording:
    """Recording from one file.

    Raises:
        InputError: The file is not such a table, or the rows of a tap are inconsistent; the message names file, line
            and column.
    """
    rows = _read_rows(path, missing)
    with naming(path):
        return _recording([rows])


def read_csv_folder(folder: Path, missing: Missing = "refuse") -> Recording:
    """Recording from all `.csv` files of a folder, in natural order of their names.

    Each file is one session, numbered from 0, unless all have a column `session`.

    Raises:
        InputError: As `read_csv`; or there is no such file, or they have different columns.
    """
    paths = sorted((p for p in folder.iterdir() if p.suffix.lower() == ".csv"), key=lambda path: natural(path.name))
    if not paths:
        raise InputError(f"{folder}: no .csv files in this folder.")
    parts: list[CsvRows] = []
    for path in paths:
        parts.append(_read_rows(path, missing))
        with naming(path):
            _check_same_columns(parts[0], parts[-1])
    return _recording(parts)


def _check_same_columns(first: CsvRows, other: CsvRows) -> None:
    if first.taxel_names != other.taxel_names:
        raise InputError(f"line 1: taxel columns differ from those of {first.contents.path}.")
    differing = sorted(set(first.columns) ^ set(other.columns))
    if differing:
        raise InputError(f"line 1: column {differing[0]} is either here or in {first.contents.path}, but not in both.")


def _recording(parts: Sequence[CsvRows]) -> Recording:
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    frames = concatenated([part.taxels for part in parts])
    file = np.repeat(np.arange(len(parts)), [len(part.taxels) for part in parts])
    places = _Places(parts)
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

    def __init__(self, parts: Sequence[CsvRows]) -> None:
        self._parts = parts

    def __getitem__(self, row: int) -> str:
        number = 0
        while row >= len(self._parts[number].taxels):
            row -= len(self._parts[number].taxels)
            number += 1
        contents = self._parts[number].contents
        return f"{contents.path}, {contents.place(row)}" if len(self._parts) > 1 else contents.place(row)


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
    """Samples per second by `time_s`, see `cutting.sampling_rate`."""
    if "time_s" not in columns or len(columns["time_s"]) < 2:
        return None
    steps = np.diff(columns["time_s"])
    inside = np.ones(len(steps), dtype=bool)
    inside[starts[1:] - 1] = False
    bad = np.flatnonzero(inside & (steps <= 0))
    if len(bad):
        raise InputError(f"{places[bad[0] + 1]}: time_s does not increase.")
    begins = np.append(True, ~inside)
    found = pace(columns["time_s"], begins)
    return None if found is None else common_rate([found])[0]
