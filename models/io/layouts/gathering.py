"""Pieces that belong together: files side by side as taxels, and labels that a table lists for all of them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cutting.sessions import median_step
from ...errors import InputError, counted
from ..recording import naming
from .label_values import as_texts
from .labels import ByOrder
from .mapping import LABELS, PLANE, option
from .patterns import natural
from .pieces import Piece
from .signal import side_by_side


def with_all_taxels(found: Sequence[Piece]) -> list[Piece]:
    """The pieces, those as one whose names differ in the field `{taxel}` alone; the labels are those of the first.

    Raises:
        InputError: A group lacks what others have, or has it twice, or its samples or labels differ; the message names
            a file.
    """
    groups: dict[tuple[Any, ...], dict[str, Piece]] = {}
    for piece in found:
        fields = {key: of for key, of in piece.file.fields.items() if key != "taxel"}
        taxel = piece.file.fields.get("taxel")
        group = groups.setdefault((piece.file.source, *fields.items()) if taxel is not None else (id(piece),), {})
        if group.setdefault(taxel or "", piece) is not piece:
            raise InputError(
                f"{piece.file.path} and {group[taxel or ''].file.path} are both taxel {taxel} of the same taps; what "
                "tells them apart in their names must be a field."
            )
    return list(_each_beside(list(groups.values())))


def _each_beside(groups: Sequence[Mapping[str, Piece]]) -> Iterator[Piece]:
    for group in groups:
        taxels = sorted(group, key=natural)
        if set(taxels) != groups[0].keys():
            other = next(iter(set(taxels) ^ groups[0].keys()))
            raise InputError(
                f"{group[taxels[0]].file.path}: taxel {other} is either beside this file or beside "
                f"{next(iter(groups[0].values())).file.path}, but not beside both."
            )
        parts = [group[taxel] for taxel in taxels]
        for part in parts[1:]:
            _check_alike(parts[0], part)
        yield replace(parts[0], signal=side_by_side([of.signal for of in parts], [str(of.file.path) for of in parts]))


def _check_alike(first: Piece, other: Piece) -> None:
    for key in (*LABELS, *PLANE):
        if key in first.labels and not np.array_equal(_array(first.labels[key]), _array(other.labels[key])):
            raise InputError(f"{other.file.path}: {option(key)} differs from that of {first.file.path} beside it.")
    for one, two in zip(first.numbers, other.numbers, strict=True):
        if as_texts(one) != as_texts(two):
            raise InputError(f"{other.file.path}: {option('tap')} differs from that of {first.file.path} beside it.")
    if first.time_s is not None and other.time_s is not None and first.time_s.shape == other.time_s.shape:
        step = median_step(first.time_s.reshape(-1)) if first.time_s.size > 1 else 0.0
        if (abs(first.time_s - other.time_s) > abs(step) / 2).any():
            raise InputError(f"{other.file.path}: {option('time')} differs from that of {first.file.path} beside it.")


def _array(label: Any) -> NDArray[Any]:
    return np.asarray(label.values if isinstance(label, ByOrder) else label)


def with_ordered_labels(found: Sequence[Piece], of_taps: bool = False) -> list[Piece]:
    """The pieces with those labels that tables list in the order of all their taps or rows.

    Args:
        found: The pieces.
        of_taps: Whether a table may have a row for each tap that is still to be cut; its labels stay as they are then.

    Raises:
        InputError: A table has another number of rows.
    """
    labels, sharing = (
        [dict(piece.labels) for piece in found],
        dict[tuple[str, tuple[str, str], tuple[int, ...]], list[int]](),
    )
    for number, piece in enumerate(found):
        for key, of in piece.labels.items():
            if isinstance(of, ByOrder):
                sharing.setdefault((key, of.place, of.rows), []).append(number)
    for (key, *_), numbers in sharing.items():
        with naming(option(key)):
            parts = _parts(labels[numbers[0]][key], [found[number] for number in numbers], of_taps)
        for number, part in zip(numbers, parts, strict=True):
            labels[number][key] = part
    return [replace(piece, labels=of) for piece, of in zip(found, labels, strict=True)]


def _parts(label: Any, sharing: Sequence[Piece], of_taps: bool) -> list[NDArray[Any] | ByOrder]:
    """Values of a table for each piece that shares it: one for each tap, else for each row, else those of each file."""
    values, taps, rows = label.values, [piece.rows for piece in sharing], [piece.whole for piece in sharing]
    each = len({piece.file.path for piece in sharing}) == sum(taps)
    if label.doubt == "rows" or (label.doubt and len(values) == sum(taps) and each):
        raise InputError(f"{label.table}: {label.hint}.")
    if len(values) == sum(taps):
        return np.split(values, np.cumsum(taps)[:-1])
    if len(values) == sum(every := [piece.every for piece in sharing]):
        parts = np.split(values, np.cumsum(every)[:-1])
        return [part[piece.among] for part, piece in zip(parts, sharing, strict=True)]
    if len(values) == sum(rows):
        return [part[piece.row] for part, piece in zip(np.split(values, np.cumsum(rows)[:-1]), sharing, strict=True)]
    if all(number == len(values) for number in taps):
        return [values] * len(sharing)
    if of_taps:
        return [label] * len(sharing)
    whose = "taps" if sharing[0].signal.cut else "frames"
    header = "its first line counts as a header" if len(values) == sum(taps) - 1 and not label.doubt else ""
    hints = "".join(f"; {hint}" for hint in (header, label.hint) if hint)
    raise InputError(f"{label.table}: {counted(len(values), 'row')} for {sum(taps)} {whose}{hints}.")
