"""Data-quality warnings of tap sets: each function checks one problem and yields a sentence if it occurs."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.blocks import tap_digests
from ...models.cutting.taxels import constant_taxels, saturated_taxels
from ...models.grid import ClassGrid
from ...models.splits import Fold
from ...models.taps import TapSet, concatenate

FEW = 5  # distinct taps per class, below which a histogram is mostly empty
_NAMED = 6  # how many cells, classes or taxels a sentence names before it only counts


def data_warnings(taps: TapSet, grid: ClassGrid, *, alone: bool = True) -> Iterator[str]:
    """Data-quality warnings, one sentence each, the most serious first.

    Args:
        taps: What to look at.
        grid: The classes.
        alone: Whether there are no other taps, of other sessions.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    if not inside.all():
        yield f"{np.count_nonzero(~inside)} of {len(taps)} taps lie outside all classes and are not used."
    cells = np.ravel_multi_index((where[inside], what[inside]), grid.shape)
    yield from one_object(grid, what[inside])
    yield from _empty(cells, grid)
    yield from _sessions(taps, cells, inside, grid, alone)
    yield from _few(taps, cells, inside, grid)
    yield from _blocks(taps, where, what, grid)
    yield from _uneven(grid)
    yield from _taxels(taps)


def one_object(grid: ClassGrid, what: ArrayLike) -> Iterator[str]:
    """A sentence if all taps, with these object indices, are of the same object."""
    if len(touched := np.unique(what)) == 1:
        yield (
            f"All taps are of one object, {grid.what_name[touched[0]]}: it cannot be confused with another, so object "
            "errors are zero and every decision is made at the first tap."
        )


def fold_warnings(fold: Fold, grid: ClassGrid, *, one_file: bool) -> list[str]:
    """Data-quality warnings of training and test taps, checked together if they come from one file."""
    files = [concatenate([fold.train, fold.test])] if one_file else [fold.train, fold.test]
    sentences = [sentence for taps in files for sentence in data_warnings(taps, grid, alone=one_file)]
    return list(dict.fromkeys(sentences))


def _uneven(grid: ClassGrid) -> Iterator[str]:
    steps = np.diff(grid.where_value) if grid.where_place is None else np.empty(0)
    if len(steps) and steps.max() > 1.5 * steps.min():
        yield (
            f"Positions are unevenly spaced, by {steps.min():g} to {steps.max():g} {grid.where_unit}".rstrip()
            + ": moves are counted in classes, so equal moves differ in length."
        )


def _empty(cells: NDArray[np.intp], grid: ClassGrid) -> Iterator[str]:
    filled = np.zeros(grid.shape, dtype=bool)
    filled.flat[cells] = True
    objects, positions = filled.any(axis=0), filled.any(axis=1)
    if not objects.all():
        yield f"Objects without any tap: {_named([f'“{grid.what_name[m]}”' for m in np.flatnonzero(~objects)])}."
    if not positions.all():
        yield f"Positions without any tap: {_named([grid.where_label(int(l)) for l in np.flatnonzero(~positions)])}."
    holes = np.argwhere(~filled & objects & positions[:, np.newaxis])
    if len(holes):
        names = _named([_cell_name(grid, l, m) for l, m in holes])
        yield f"{len(holes)} of {filled.size} (position, object) classes have no tap: {names}."


def _sessions(
    taps: TapSet, cells: NDArray[np.intp], inside: NDArray[np.bool_], grid: ClassGrid, alone: bool
) -> Iterator[str]:
    session = taps.session[inside]
    sessions = np.unique(taps.session)
    if len(sessions) == 1:
        if alone:
            yield (
                "There is only one session: generalisation to another day cannot be assessed, and training and test "
                "taps share slow drift."
            )
        return
    missing = [
        f"{_cell_name(grid, *np.unravel_index(cell, grid.shape))} in session {number}"
        for cell in np.unique(cells)
        for number in sorted(set(sessions.tolist()) - set(session[cells == cell].tolist()))
    ]
    if missing:
        yield f"Some classes have no tap in some sessions: {_named(missing)}."


def _few(taps: TapSet, cells: NDArray[np.intp], inside: NDArray[np.bool_], grid: ClassGrid) -> Iterator[str]:
    """Distinct taps: exact copies count once."""
    content, session = _contents(taps)[inside], taps.session[inside]
    distinct = np.unique(np.stack([cells, session, content]), axis=1)
    if distinct.shape[1] < len(cells):
        yield f"{len(cells) - distinct.shape[1]} taps are exact copies of another tap of the same class and session."
    per_session = np.unique(distinct[:2], axis=1, return_counts=True)[1]
    if len(per_session) and per_session.max() == 1:
        yield ("Each class has one tap per session, so evidence cannot accumulate over distinct contacts of a session.")
    filled, counts = np.unique(distinct[0], return_counts=True)
    few = filled[counts < FEW]
    if len(few):
        names = [
            f"{_cell_name(grid, *np.unravel_index(cell, grid.shape))}: {counts[filled == cell][0]}" for cell in few
        ]
        yield f"{len(few)} of {len(filled)} classes with taps have fewer than {FEW} distinct taps ({_named(names)})."


def _contents(taps: TapSet) -> NDArray[np.int64]:
    """A number for each tap, shape (N,), equal for exact copies; samples are read only where extremes are equal."""
    content = tap_digests(taps.extremes)
    _, which, count = np.unique(content, return_inverse=True, return_counts=True)
    alike = np.flatnonzero(count[which] > 1)
    if alike.size:
        content[alike] = taps.select(alike).digests
    return content.view(np.int64)


def _blocks(taps: TapSet, where: NDArray[np.intp], what: NDArray[np.intp], grid: ClassGrid) -> Iterator[str]:
    for name, sessions in blocks_of(taps, where, what, grid).items():
        yield (
            f"Recorded in blocks: in session{'s' * (len(sessions) > 1)} {', '.join(map(str, sessions))} the taps of "
            f"each {name} are consecutive, so slow sensor drift alone can reveal the {name}."
        )


def blocks_of(taps: TapSet, where: NDArray[np.intp], what: NDArray[np.intp], grid: ClassGrid) -> dict[str, list[int]]:
    """Sessions in which the taps of a class follow one another, for objects, positions and, only alone, their pairs."""
    pair = np.where((where >= 0) & (what >= 0), where * grid.M + what, -1)
    found: dict[str, list[int]] = {}
    for name, classes in (("object", what), ("position", where), ("(position, object) class", pair)):
        for session in np.unique(taps.session).tolist():
            chosen = taps.session == session
            order = recorded_order(taps.trial[chosen])
            if in_blocks(classes[chosen][order]):
                found.setdefault(name, []).append(session)
    if len(found) > 1:
        found.pop("(position, object) class", None)  # follows from the others in most recordings
    return found


def recorded_order(trial: NDArray[np.int64]) -> NDArray[np.intp]:
    """The order in which the taps of one session were recorded, as far as the file tells.

    Trial numbers that are all different number the taps of the session. Where they repeat they count within each
    class (as in most published sets) and say nothing about the order of the classes; then the order in the file
    stands for it.
    """
    if len(np.unique(trial)) == len(trial):
        return np.argsort(trial)
    return np.arange(len(trial))


def in_blocks(classes: ArrayLike) -> bool:
    """Whether nine in ten of the classes with two or more taps occur in one uninterrupted run.

    Args:
        classes: Class of each tap of a session in recorded order, -1 for none.
    """
    classes = np.asarray(classes)
    first_of_run = np.flatnonzero(np.diff(classes, prepend=-2) != 0)
    runs = np.bincount(classes[first_of_run] + 1)[1:]
    taps = np.bincount(classes + 1)[1:]
    repeated = taps >= 2
    return bool(np.count_nonzero(repeated) >= 2 and (runs[repeated] == 1).mean() >= 0.9)


def _taxels(taps: TapSet) -> Iterator[str]:
    constant, saturated = constant_taxels(taps.extremes), saturated_taxels(taps.samples, taps.extremes)
    K = taps.samples.shape[2]
    if constant:
        yield f"{len(constant)} of {K} taxels are constant: {_named(constant)}."
    if saturated:
        yield (
            f"{len(saturated)} of {K} taxels may be saturated (they stay at an extreme that is not "
            f"their idle level): {_named(saturated)}."
        )


def _cell_name(grid: ClassGrid, l: int | np.intp, m: int | np.intp) -> str:
    if grid.L == 1:
        return grid.what_name[int(m)]
    return f"({grid.where_label(int(l))}, {grid.what_name[int(m)]})"


def _named(things: Sequence[object]) -> str:
    """The first things by name and how many follow."""
    names = ", ".join(str(thing) for thing in things[:_NAMED])
    return names if len(things) <= _NAMED else f"{names} and {len(things) - _NAMED} more"
