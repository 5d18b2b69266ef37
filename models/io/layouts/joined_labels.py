"""Labels of all taps or frames from those of the pieces: objects and positions are numbered, units and names joined."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...cutting.sessions import number_by_date, number_by_gap
from ...errors import InputError, shortened
from ...grid import values_from_names
from ...tap_checks import RESERVED
from ...taps import in_plane
from ..recording import Labels, naming
from .label_tables import LabelTables
from .label_values import are_names, as_numbers, as_texts, by_name, distinct, is_missing
from .labels import LISTS, label_source
from .listed import Listed, listed
from .mapping import EXTRA, PLANE, TapMap, option
from .patterns import filled, natural
from .pieces import Piece
from .times import since_date

_MOST = 10**15 - 1  # as floats hold all integers to there


def joined_labels(found: Sequence[Piece], how: TapMap, beside: LabelTables) -> Labels:
    """Labels of all taps or rows, and the tables they refer to.

    Raises:
        InputError: Labels are missing, of the wrong kind, or contradict each other; the message names key and place.
    """
    named, places = (_listed(found, getattr(how, key), key, beside) for key in LISTS)
    what, names, sizes = _objects(found, how, named)
    where, tables = _positions(found, how, places)
    if alike := _alike(names):
        beside.told["what"] = f"{option('what')}: {' and '.join(alike)} are two objects that differ in signs alone."
    if named is not None and (unused := sorted(set(range(len(names))) - set(what.tolist()))):
        beside.told["what_names"] = _without_taps([names[m] for m in unused], names, how, 0 in unused)
    units = {piece.unit for piece in found}
    if how.units is None and len(units - {""}) > 1:
        raise InputError(f"samples are in {' and '.join(sorted(units - {''}))} in different files; --units says which.")
    tables |= {"units": how.units or (units.pop() if len(units) == 1 else "")}
    tables |= {key: getattr(how, key) or "" for key in ("sensor", "source", "licence")}
    if sizes is not None:
        tables |= sizes
    return Labels(
        what=what,
        where=where,
        session=_sessions(found, how, beside),
        trial=_trials(found),
        what_name=names,
        extra=dict(_extra(found, how)),
        tables=tables,
    )


def _without_taps(unused: Sequence[str], names: Sequence[str], how: TapMap, first: bool) -> str:
    """What is told where names have no taps, as those of a heading or of indices that count from 1."""
    hint = "; if indices count from 1, say one_based (--one-based)" if first and not how.one_based else ""
    return f"{len(unused)} of {len(names)} {option('what_names')} have no taps: {shortened(unused)}{hint}."


def _alike(names: Sequence[str]) -> list[str]:
    """The first names that have the same letters and numbers, whatever their capitals and the signs between."""
    seen: dict[str, list[str]] = {}
    for name in names:
        seen.setdefault(re.sub(r"[\s_-]+", "", name).casefold() or name, []).append(name)
    return next((same[:2] for same in seen.values() if len(same) > 1), [])


def _extra(found: Sequence[Piece], how: TapMap) -> Iterator[tuple[str, NDArray[Any]]]:
    """Further arrays by names that no array of a tap set has: the last part of their path if that is enough."""
    ends = [re.split(r"[/@]", name)[-1] for name in how.extra]
    for name, end in zip(how.extra, ends, strict=True):
        if (values := _values(found, EXTRA + name)) is not None:
            own = end if ends.count(end) == 1 else re.sub(r"[/@:{}*]+", "_", name).strip("_")
            yield f"recorded_{own}" if own in RESERVED else own, values


def _values(found: Sequence[Piece], key: str) -> NDArray[Any] | None:
    """A label of all taps or rows, shape (n,): numbers, or texts; `None` where it is nowhere."""
    with_axis = [key in piece.signal.axis_index for piece in found]
    if any(with_axis):
        return np.concatenate([piece.signal.axis_index[key] for piece in found])
    if key not in found[0].labels:
        return None
    parts = []
    for piece in found:
        value = piece.labels[key]
        with naming(piece.file.path):
            if isinstance(value, np.ndarray) and len(value) != piece.rows:
                raise InputError(f"{option(key)} has {len(value)} values for {piece.rows} taps.")
            parts.append(_exact(value) if isinstance(value, np.ndarray) else np.repeat(np.asarray(value), piece.rows))
    if len({part.dtype.kind in "US" for part in parts}) > 1:
        parts = [np.array(as_texts(part)) for part in parts]
    return np.concatenate(parts)


def _exact(values: NDArray[Any]) -> NDArray[Any]:
    """Numbers in double precision as they were written, so that 0.1 is the same in files of both precisions."""
    if values.dtype not in (np.float16, np.float32):
        return values
    distinct_values, which = np.unique(values, return_inverse=True)
    return distinct_values.astype(np.str_).astype(np.float64)[which]


def _measured(found: Sequence[Piece], key: str, raw: NDArray[Any]) -> tuple[NDArray[np.float64], str]:
    """A label as numbers with their unit, from the texts or from what the file states."""
    stated = {unit for piece in found if (unit := piece.label_units.get(key, ""))}
    if len(stated) > 1:
        raise InputError(f"{option(key)} is in {' and '.join(sorted(stated))} in different files.")
    numbers, unit = as_numbers(key, raw, lambda tap: _place(found, tap))
    return numbers, unit or next(iter(stated), "")


def _place(found: Sequence[Piece], tap: int) -> str:
    """Where a tap is, for messages."""
    for piece in found:
        if tap < piece.rows:
            return f"tap {tap} of {piece.file.path}"
        tap -= piece.rows
    return f"tap {tap}"


def _objects(
    found: Sequence[Piece], how: TapMap, named: Listed | None
) -> tuple[NDArray[np.int64], tuple[str, ...], dict[str, Any] | None]:
    """Index and names of the objects, and their sizes with the unit: by size, else in order of appearance."""
    raw = _values(found, "what")
    total = sum(piece.rows for piece in found)
    raw = np.repeat(np.array("object"), total) if raw is None else raw
    _check_there(found, "what", raw)
    if named is not None:
        by_axis = any("what" in piece.signal.axis_index for piece in found)
        index = _indices(found, "what", raw, named, how.one_based and not by_axis)
        names = np.array(as_texts(named.entries))
    else:
        texts, _, index = distinct(raw)
        names = np.array(texts)
    sizes = _sizes(found, how, index, tuple(names.tolist()))
    if sizes is not None and named is None:
        order = np.argsort(sizes["what_value"], kind="stable")
        index, names = np.argsort(order)[index], names[order]
        sizes["what_value"] = sizes["what_value"][order]
    return index.astype(np.int64), tuple(names.tolist()), sizes


def _check_there(found: Sequence[Piece], key: str, raw: NDArray[Any]) -> None:
    missing = np.flatnonzero(is_missing(raw))
    if len(missing):
        raise InputError(f"{option(key)} is missing for {_place(found, int(missing[0]))}.")


def _sizes(
    found: Sequence[Piece], how: TapMap, what: NDArray[np.int64], names: tuple[str, ...]
) -> dict[str, Any] | None:
    """Size of each object and its unit."""
    if how.what_value is None:
        return None
    if how.what_value == "names":
        known = values_from_names(names)
        if known is None:
            raise InputError(
                "what_value (--what-value): the names of the objects are not one number with a unit between the same "
                f"words: {', '.join(names[:5])}."
            )
        return {"what_value": known[0], "what_unit": how.what_unit or known[1]}
    raw = _values(found, "what_value")
    values, unit = _measured(found, "what_value", np.asarray(raw))
    sizes = np.full(len(names), np.nan)
    if len(values) != len(what):
        raise InputError(f"what_value (--what-value) has {len(values)} values for {len(what)} taps.")
    sizes[what] = values
    differing = np.flatnonzero(sizes[what] != values)
    if len(differing):
        tap = int(differing[0])
        raise InputError(f"what_value (--what-value): {names[what[tap]]} has {values[tap]:g} and {sizes[what[tap]]:g}.")
    return {"what_value": sizes, "what_unit": how.what_unit or unit}


def _listed(found: Sequence[Piece], told: Any, key: str, beside: LabelTables) -> Listed | None:
    """Names or positions that an index refers to, from the map, an array, an attribute or a table."""
    if told is None:
        return None
    if not isinstance(told, str):
        return Listed(np.asarray(told))
    source = label_source(key, told)
    if source.kind == "table":
        with naming(option(key)):
            files = {beside.place(filled(source.name, piece.file.fields), piece.file): piece.file for piece in found}
            lists = {path: listed(source, file, beside) for path, file in files.items()}
            one, *others = lists
            for other in others:
                if as_texts(lists[other].entries) != as_texts(lists[one].entries):
                    raise InputError(f"{other} differs from {one}; make tap sets of each alone.")
            return lists[one]
    first = found[0].tables[key].reshape(-1)
    for piece in found:
        if not np.array_equal(piece.tables[key].reshape(-1), first):
            raise InputError(f"{piece.file.path}: {told} differs from that of {found[0].file.path}.")
    return Listed(first)


def _indices(found: Sequence[Piece], key: str, raw: NDArray[Any], named: Listed, one_based: bool) -> NDArray[np.int64]:
    """Number of each label in a list, from 0: by its name, else as an index."""
    entries = named.entries
    by_text = by_name(key, raw, entries, lambda tap: _place(found, tap))
    if by_text is not None:
        return by_text.astype(np.int64)
    numbers, _ = as_numbers(key, raw, lambda tap: _place(found, tap))
    with naming(option("what_names" if key == "what" else "where_values")):
        if (told := named.indices(numbers)) is not None:
            return told
    index = numbers - one_based
    bad = np.flatnonzero((index != np.round(index)) | (index < 0) | (index >= len(entries)))
    if len(bad):
        there = f"the {len(entries)} entries of {option('what_names' if key == 'what' else 'where_values')}"
        hint = "; if indices count from 1, say one_based (--one-based)" if numbers.max() == len(entries) else ""
        place = _place(found, int(bad[0]))
        raise InputError(f"{option(key)} is {numbers[bad[0]]:g} for {place}, which is no index of {there}{hint}.")
    return index.astype(np.int64)


def _positions(found: Sequence[Piece], how: TapMap, named: Listed | None) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Position of each tap, and the tables that belong to it."""
    plane = [_values(found, key) for key in PLANE]
    if plane[0] is not None:
        return _in_plane(
            [_measured(found, key, raw) for key, raw in zip(PLANE, plane, strict=True) if raw is not None], how
        )
    raw = _values(found, "where")
    if raw is None:
        return np.zeros(sum(piece.rows for piece in found)), {"where_unit": how.where_unit or ""}
    if named is None:
        numbers, unit = _measured(found, "where", raw)
        return _rounded(numbers * how.where_scale, how), {"where_unit": how.where_unit or unit}
    by_axis = any("where" in piece.signal.axis_index for piece in found)
    values, unit = (
        (np.arange(len(named.entries), dtype=np.float64), "")
        if are_names(named.entries)
        else as_numbers("where_values", named.entries)
    )
    index = _indices(found, "where", raw, named, how.one_based and not by_axis)
    return values[index] * how.where_scale, {"where_unit": how.where_unit or unit}


def _in_plane(
    axes: Sequence[tuple[NDArray[np.float64], str]], how: TapMap
) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Places in a plane as numbered positions, see `taps.in_plane`."""
    places = np.stack([_rounded(values * how.where_scale, how) for values, _ in axes[:2]], axis=1)
    angles = [values[:, np.newaxis] for values, _ in axes[2:]]
    units = {unit for _, unit in axes[:2]} - {""}
    if len(units) > 1:
        raise InputError(f"{option('where')}: x is in {axes[0][1]}, y in {axes[1][1]}; a plane has one unit.")
    every, number = in_plane(np.concatenate([places, *angles], axis=1))
    tables = {
        "where_value": np.arange(len(every)),
        "where_place": every,
        "where_unit": how.where_unit or "".join(units),
    }
    return number.astype(np.float64), tables


def _rounded(values: NDArray[np.float64], how: TapMap) -> NDArray[np.float64]:
    """Positions without the noise of their measurement."""
    return values if how.where_round is None else np.round(values / how.where_round) * how.where_round + 0.0


def _sessions(found: Sequence[Piece], how: TapMap, beside: LabelTables) -> NDArray[np.int64]:
    """Session of each tap or row: whole numbers as they stand, others numbered; each source has its own."""
    raw, rows = _values(found, "session"), [piece.rows for piece in found]
    source = np.repeat([piece.file.source for piece in found], rows)
    told = None if how.session is None else label_source("session", how.session)
    with naming(option("session")):
        if told is not None and told.kind == "gap":
            return number_by_gap(_all_times(found), _seconds(told.name), source)
        if told is not None and told.dated:
            stated = {piece.label_units.get("session", "") for piece in found}
            numbers = np.asarray(raw)
            if len(stated) == 1 and numbers.dtype.kind in "iuf":
                since = since_date(numbers.astype(np.float64), stated.pop())
                numbers = numbers if since is None else (since * 1e9).astype("datetime64[ns]")
            return number_by_date(numbers)
    if raw is None:
        return source.astype(np.int64)
    _check_there(found, "session", raw)
    texts, _, which = distinct(raw)
    numbers = {int(text) for text in texts if text.isdecimal() and len(text) < 10}
    if source.max() == 0 and len(numbers) == len(texts):
        return np.array(list(map(int, texts)))[which]
    order = np.argsort(sorted(range(len(texts)), key=lambda n: natural(texts[n])))
    _, first, session = np.unique(source * len(texts) + order[which], return_index=True, return_inverse=True)
    called = [f"{number} is {texts[which[row]]}" for number, row in enumerate(first.tolist())]
    beside.told["session"] = f"Sessions: {shortened(called)}."
    return session


def _all_times(found: Sequence[Piece]) -> NDArray[np.float64]:
    """Time of each tap or row."""
    times = [piece.time_s for piece in found]
    known = [each for piece, each in zip(found, times, strict=True) if each is not None and each.shape == (piece.rows,)]
    if len(known) < len(found):
        raise InputError(f"gap: needs {option('time')}, one for each tap or row.")
    return np.concatenate(known)


def _seconds(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"gap:{text}: the pause must be a number of seconds.") from None


def _trials(found: Sequence[Piece]) -> NDArray[np.int64] | None:
    """Number of each tap as recorded."""
    raw = _values(found, "trial")
    if raw is None:
        return None
    numbers, _ = as_numbers("trial", raw, lambda tap: _place(found, tap))
    bad = np.flatnonzero((numbers != np.round(numbers)) | (abs(numbers) > _MOST))
    if len(bad):
        place = _place(found, int(bad[0]))
        raise InputError(f"{option('trial')} is {numbers[bad[0]]:g} for {place}, not an integer of up to 15 digits.")
    return numbers.astype(np.int64)
