"""Labels of taps that are cut from streams: those of the frame of each, or one for each tap or press in their order."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from msgspec import structs
from numpy.typing import ArrayLike, NDArray

from ...cutting.presses import Presses
from ...errors import InputError, counted
from ..recording import Labels, naming
from .joined_labels import joined_labels
from .label_tables import LabelTables
from .label_values import is_missing
from .labels import ByOrder, Label
from .mapping import EXTRA, PLANE, TapMap, option
from .pieces import Piece

_TOGETHER = {
    "what": ("what", "what_names", "what_value"),
    "what_value": ("what", "what_names", "what_value"),
    **dict.fromkeys(("where", *PLANE), ("where", "where_values")),
}
"""Keys of a map that say nothing of frames where a label is one of taps."""


@dataclass(frozen=True, eq=False)
class StreamLabels:
    """Labels of streams, and of the taps that are cut from them.

    Attributes:
        frames: Labels of all frames, without those that are of taps.
        pieces: The streams.
        how: The map.
        tables: Tables beside the files.
        of_taps: Labels that have one value for each tap or press, or are missing in frames.
        rate_hz: Frames per second, if known.
    """

    frames: Labels
    pieces: Sequence[Piece]
    how: TapMap
    tables: LabelTables
    of_taps: frozenset[str]
    rate_hz: float | None

    @classmethod
    def of(cls, pieces: Sequence[Piece], how: TapMap, tables: LabelTables, rate_hz: float | None) -> "StreamLabels":
        """Labels of streams.

        Raises:
            InputError: As of `joined_labels`.
        """
        of_taps = frozenset(key for piece in pieces for key, of in piece.labels.items() if _is_of_taps(of, piece.rows))
        without = {name: None for key in of_taps for name in _TOGETHER.get(key, (key,)) if not key.startswith(EXTRA)}
        extra = tuple(name for name in how.extra if EXTRA + name not in of_taps)
        among_frames = structs.replace(how, **without, extra=extra)
        gone = {*of_taps, *(PLANE if of_taps & {*PLANE} else ()), *without}
        alone = [replace(each, labels={k: of for k, of in each.labels.items() if k not in gone}) for each in pieces]
        return cls(joined_labels(alone, among_frames, tables), pieces, how, tables, of_taps, rate_hz)

    def at(self, rows: ArrayLike, presses: Presses | None) -> Labels:
        """Labels of taps.

        Args:
            rows: Frame of each tap's contact or press, a row of all streams, shape (n,).
            presses: All presses, if a signal or events told where these are.

        Raises:
            InputError: There are more or fewer labels than taps or presses.
        """
        rows = np.asarray(rows, dtype=np.intp)
        if not self.of_taps:
            return self.frames.take(rows)
        bounds = np.cumsum([0, *(piece.rows for piece in self.pieces)])
        stream = np.searchsorted(bounds, rows, "right") - 1
        counted_in = _Count.of(rows, stream, presses, bounds)
        parts = []
        for number in np.unique(stream).tolist():
            piece, taps = self.pieces[number], stream == number
            labels = {key: self._of_piece(key, number, counted_in, taps, rows - bounds[number]) for key in piece.labels}
            parts.append(piece.labels_at(rows[taps] - bounds[number], **labels))
        found = joined_labels(parts, self.how, self.tables)
        return found if "session" in self.of_taps else replace(found, session=self.frames.session[rows])

    def labelled(self, presses: Presses) -> Presses:
        """Those presses of a table or array that have an object, a position and a session there."""
        bounds = np.cumsum([0, *(piece.rows for piece in self.pieces)])
        stream = np.searchsorted(bounds, presses.row, "right") - 1
        count, known = _Count.of(presses.row, stream, presses, bounds), np.ones(len(presses.row), dtype=bool)
        for number in np.unique(stream).tolist():
            piece, own = self.pieces[number], stream == number
            for key in self.of_taps & {"what", "where", "session", *PLANE} & piece.labels.keys():
                label = piece.labels[key]
                if isinstance(label, ByOrder) or (isinstance(label, np.ndarray) and len(label) != piece.rows):
                    values = np.asarray(self._of_piece(key, number, count, own, presses.row))
                    known[own] &= ~is_missing(values)
        return presses._replace(row=presses.row[known], event=presses.event[known])

    def _of_piece(
        self, key: str, number: int, count: "_Count", taps: NDArray[np.bool_], frames: NDArray[np.intp]
    ) -> Label:
        """A label of the taps of a stream."""
        label, path = self.pieces[number].labels[key], self.pieces[number].file.path
        if isinstance(label, ByOrder):
            values, of = label.values, (label.place, label.rows)
            sharing = [n for n, each in enumerate(self.pieces) if _rows_of(each.labels.get(key)) == of]
            name, hint = label.table, f"; {label.hint}" if label.hint else ""
        elif not isinstance(label, np.ndarray):
            return label
        elif len(label) == self.pieces[number].rows:
            with naming(path), naming(option(key)):
                return _around(label, frames[taps], self.how, self.rate_hz)
        else:
            values, sharing, name, hint = label, [number], str(path), ""
        index, total = count.within(sharing, len(self.pieces))
        with naming(option(key)):
            if len(values) != total:
                header = "; its first line counts as a header" if len(values) == total - 1 else ""
                found = f"{counted(len(values), 'label')} for {counted(total, count.name)} in the streams"
                raise InputError(f"{name}: {found}{header}{hint}.")
        return values[index[taps]]


def _rows_of(label: Any) -> Any:
    return (label.place, label.rows) if isinstance(label, ByOrder) else None


def _is_of_taps(label: Label, frames: int) -> bool:
    """Whether a label has one value for each tap or press, or is missing in frames."""
    if isinstance(label, np.ndarray):
        return len(label) != frames or bool(is_missing(label).any())
    return isinstance(label, ByOrder)


def _around(label: NDArray[Any], frames: NDArray[np.intp], how: TapMap, rate_hz: float | None) -> NDArray[Any]:
    """Labels of the frames of taps, where they are missing there the only one that their taps have."""
    found, missing = label[frames], is_missing(label)
    scale = rate_hz / how.resample if rate_hz and how.resample else 1.0
    pre, window = round(scale * (how.pre or 0)), round(scale * (how.window or 1))
    for tap in np.flatnonzero(missing[frames]).tolist():
        first = max(0, int(frames[tap]) - pre)
        inside = slice(first, first + window)
        values = np.unique(label[inside][~missing[inside]])
        if len(values) > 1:
            raise InputError(f"has {values[0]} and {values[1]} in the tap at row {frames[tap]}, counted from 0.")
        if not len(values):
            raise InputError(f"is missing in the tap at row {frames[tap]}, counted from 0.")
        found[tap] = values[0]
    return found


@dataclass(frozen=True, eq=False)
class _Count:
    """Numbers of taps among all presses, or else among all taps.

    Attributes:
        name: What is counted, taps or presses.
        event: Number of each tap, shape (n,).
        stream: Number of the stream of each press or tap, -1 if it is in none, shape (E,).
    """

    name: str
    event: NDArray[np.intp]
    stream: NDArray[np.intp]

    @classmethod
    def of(
        cls, rows: NDArray[np.intp], stream: NDArray[np.intp], presses: Presses | None, bounds: NDArray[np.intp]
    ) -> "_Count":
        if presses is None:
            return cls("tap", np.arange(len(rows)), stream)
        if (twice := np.flatnonzero(np.diff(presses.row) == 0)).size:
            one, other = sorted(presses.event[twice[0] : twice[0] + 2].tolist())
            raise InputError(f"presses {one} and {other}, counted from 0, are at the same frame.")
        of = presses.file
        if of is None:
            of = np.full(presses.events, -1)
            of[presses.event] = np.searchsorted(bounds, presses.row, "right") - 1
        return cls("press", presses.event[np.searchsorted(presses.row, rows)], of)

    def within(self, streams: Sequence[int], every: int) -> tuple[NDArray[np.intp], int]:
        """Number of each tap among the presses or taps of some of all streams, and how many these have."""
        if len(streams) == every:
            return self.event, len(self.stream)
        own = np.flatnonzero(np.isin(self.stream, streams))
        return np.searchsorted(own, self.event), len(own)
