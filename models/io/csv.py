"""CSV files, and folders of them, to a `Recording`; `csv_rows` documents the columns."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .csv_rows import NUMBERS, CsvRows, read_rows
from .recording import Labels, Recording, naming

_TAKEN = ("taps", "sample", "axis", "time", "what_name", "what_class", "where_value", "where_class", "where_edges")


def read_csv(path: Path) -> Recording:
    """Recording from one file.

    Raises:
        InputError: As `read_rows`, or the rows of a tap are inconsistent.
    """
    with naming(path):
        return _recording([path], [read_rows(path)])


def read_csv_folder(folder: Path) -> Recording:
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
            parts.append(read_rows(path))
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
    frames = np.concatenate([part.taxels for part in parts])
    file = np.repeat(np.arange(len(parts)), [len(part.lines) for part in parts])
    lines = np.concatenate([part.lines for part in parts])
    places = _Places(paths, file, lines)
    columns.setdefault("session", file)
    labels = _labels(columns, places)
    if "tap" not in columns:
        starts = _starts(file, columns["session"], labels.what)
        return Recording(frames, labels, _rate(columns, starts, places), file)
    starts = _starts(file, columns["session"], columns["tap"])
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


def _starts(*keys: NDArray[Any]) -> NDArray[np.intp]:
    """First row of each maximal run in which none of the keys changes."""
    changes = np.zeros(len(keys[0]), dtype=bool)
    changes[0] = True
    for key in keys:
        changes[1:] |= key[1:] != key[:-1]
    return np.flatnonzero(changes)


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
