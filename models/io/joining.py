"""Tap sets of several files as sessions that are told apart."""

from collections.abc import Sequence

import numpy as np

from ..digest import tap_digests
from ..errors import InputError
from ..taps import TapSet, check_compatible, concatenate

_PLACES = ("where_value", "where_edges")
_TABLES = ("where_value", "where_edges", "what_value", "taxel_position", "time")


def joined(taps: Sequence[TapSet], names: Sequence[str]) -> TapSet:
    """One tap set of several, whose sessions are numbered anew in their order; a single one as it is.

    Args:
        taps: Tap sets in the order of their files.
        names: What the files are called.

    Raises:
        InputError: They do not fit together, or two hold the same taps, which would be known when they are tested.
    """
    if len(taps) == 1:
        return taps[0]
    check_alike(taps, names)
    _check_apart(taps, names)
    taps = _with_all_places(taps)
    return concatenate(numbered(taps, names)[0])


def _with_all_places(taps: Sequence[TapSet]) -> Sequence[TapSet]:
    """The tap sets, with the positions of all where their tables differ, and then without edges between them."""
    tables = [part.dataset["where_value"] for part in taps]
    if all(table.equals(tables[0]) for table in tables):
        return taps
    every = np.unique(np.concatenate([table.values for table in tables]))
    column = ("where_class", every, tables[0].attrs)
    return [TapSet(part.dataset.drop_vars(_PLACES, errors="ignore").assign_coords(where_value=column)) for part in taps]


def _check_apart(taps: Sequence[TapSet], names: Sequence[str]) -> None:
    known: dict[int, str] = {}
    for part, name in zip(taps, names, strict=True):
        digests = tap_digests(part.taps).tolist()
        shared = [known[digest] for digest in digests if digest in known]
        if shared:
            raise InputError(f"{len(shared)} taps of {name} stand in {shared[0]} too.")
        known |= dict.fromkeys(digests, name)


def check_alike(taps: Sequence[TapSet], names: Sequence[str]) -> None:
    """Refuses tap sets that are no sessions of one recording.

    Raises:
        InputError: They differ in objects, taxels, unit of position or preprocessing; the message names both files.
    """
    for other, name in zip(taps[1:], names[1:], strict=True):
        check_compatible(taps[0], other, names[0], name)
        if other.what_name != taps[0].what_name:
            raise InputError(f"{name} has other objects than {names[0]}.")


def numbered(taps: Sequence[TapSet], names: Sequence[str]) -> tuple[list[TapSet], tuple[str, ...]]:
    """The tap sets with session numbers that are theirs alone, and what these are called."""
    parts, called = [], []
    for part, name in zip(_with_one_table(taps), names, strict=True):
        sessions, index = np.unique(part.session, return_inverse=True)
        parts.append(TapSet(part.dataset.assign_coords(session=("tap", index + len(called)))))
        called += [name] if len(sessions) == 1 and len(taps) > 1 else [f"{name} session {s}" for s in sessions]
    return parts, tuple(called)


def _with_one_table(taps: Sequence[TapSet]) -> list[TapSet]:
    """The tap sets with the tables of the first, which give the classes, and without arrays that not all have."""
    first = taps[0].dataset
    tables = {name: first[name].variable for name in _TABLES if name in first.variables}
    shared = set.intersection(*(set(part.dataset.data_vars) for part in taps))
    return [
        TapSet(
            part.dataset.drop_vars([*_TABLES, *(set(part.dataset.data_vars) - shared)], errors="ignore").assign_coords(
                tables
            )
        )
        for part in taps
    ]
