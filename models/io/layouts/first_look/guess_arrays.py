"""Guesses what the arrays of a file mean: samples, their axes and labels."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.contents import Contents, Variable
from ..mapping import LABELS
from .guess import CHECK, TAP_AXES, Guess, increases, is_number, like, plain, shape_of, size_of
from .guess_names import name_pattern

_NAMES = r"name|label|categor|class|object|material"
_NO_OBJECT = re.compile(r"time|stamp|force|torque|joint|pose|accel|gyro|image|camera|position|velocity", re.IGNORECASE)
"""What groups of other quantities than those of an object are called."""
_LIST_BYTES = 1 << 16
type _Shape = tuple[int | None, ...]


def array_guesses(
    contents: Contents, values: Mapping[str, NDArray[Any]], others: Sequence[Contents] = (), of_names: bool = False
) -> list[Guess]:
    """What the arrays of a file may mean.

    Args:
        contents: The file.
        values: Its arrays that could be read and are small.
        others: Further files of the recording.
        of_names: Whether the names of these files tell objects, positions or trials.
    """
    variables = contents.variables
    if not variables:
        return []
    name = max(variables, key=lambda each: (is_number(variables[each]), size_of(variables[each])))
    alike, pattern, fields = _called_alike(name, variables)
    further = (other.variables[name].shape for other in others if name in other.variables)
    shapes = [variables[each].shape for each in alike] + list(further)
    keys = {guess.key for guess in fields}
    found = [Guess("taps", name, _which(alike, variables))]
    vectors = _vectors(name, variables)
    rank, axis = len(variables[name].shape), _axis_of_vectors(variables[name], vectors)
    labels = [each for each, n in vectors.items() if rank and n == variables[name].shape[axis]]
    times = [each for each in labels if like("time", plain(each))]
    labels = [each for each in labels if each not in times]
    one_each = len(alike) > 1 and {vectors[each] for each in labels} == {len(alike)}
    if rank == 2 and axis == 0 and times and increases(values.get(times[0], np.zeros(1))):
        found.append(Guess("time", times[0], f"its name, and one rising value for each of {shapes[0][0]} rows"))
        found.append(Guess("axes", "sample,taxel", "as each row has a time"))
        if keys & {"what", "trial"}:
            found.append(Guess("tap", "file", "each array is one tap, if it is"))
    elif _each_a_tap(rank, len(shapes), keys, of_names) and (one_each or not labels):
        found += _one_tap(shapes)
        labels = []
    else:
        found += _axes(variables[name], axis, vectors, values)
    of_objects = any(guess.key == "axes" and guess.value.startswith("what") for guess in found)
    found += _labels(labels, vectors, of_objects and axis == 0)
    found += [*_tables(found, contents, values)]
    found = [guess for guess in found if guess.key not in keys]
    return _in_groups(found, name, pattern, fields, contents)


def _which(alike: Sequence[str], variables: Mapping[str, Variable]) -> str:
    """Why these are the samples."""
    if len(alike) < 2:
        return "the largest array of numbers"
    lists = [each for each, of in variables.items() if each not in alike and _length(of) == len(alike)]
    lists = [each for each in lists if not like("time", plain(each)) and len(variables[alike[0]].shape) < len(TAP_AXES)]
    told = f"; {lists[0]} has one value for each: write those into a table, what = TABLE.csv" if lists else ""
    return f"{len(alike)} large arrays of numbers, called alike{told}"


def _each_a_tap(rank: int, several: int, keys: set[str], of_names: bool) -> bool:
    """Whether each of several arrays or files is one tap."""
    told = of_names or bool(keys & {"what", "where", "x", "trial"})
    return rank in (1, 2) and several > 1 and told and ("taxel" not in keys or rank == 1)


def _one_tap(shapes: Sequence[_Shape]) -> Iterator[Guess]:
    """Each array or file is a tap; the axis that differs between them is that of samples."""
    yield Guess("tap", "file", "each array is one tap, if it is")
    if len(shapes[0]) == 1:
        yield Guess("axes", "sample", "numbers one after the other")
        return
    differ = [len({shape[axis] for shape in shapes if len(shape) == len(shapes[0])}) > 1 for axis in (0, 1)]
    if differ == [False, True]:
        yield Guess("axes", "taxel,sample", "taps differ in the length of the second axis")
    elif differ == [True, False]:
        yield Guess("axes", "sample,taxel", "taps differ in the length of the first axis")
    else:
        shape = " x ".join("?" if n is None else str(n) for n in shapes[0])
        yield Guess("axes", "sample,taxel", f"shape {shape}; {CHECK}")
    if any(differ):
        yield Guess("length", "shortest", "taps differ in length")


def _axes(
    signal: Variable, axis: int, vectors: Mapping[str, int], values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """The axes of an array, where this is that of taps, and times along that of samples."""
    rank, rest = len(signal.shape), [i for i in range(len(signal.shape)) if i != axis]
    rising = {
        each: n for each, n in vectors.items() if like("time", plain(each)) and increases(values.get(each, np.zeros(1)))
    }
    timed = {each: [i for i in rest if signal.shape[i] == n] for each, n in rising.items()}
    timed = {each: found[0] for each, found in timed.items() if len(found) == 1}
    if timed and rank in (2, 3):
        name, at = next(iter(timed.items()))
        yield Guess("time", name, f"its name, and one rising value for each of {signal.shape[at]} samples")
    unknown = [i for i in rest if i and signal.shape[i] is None]
    told = [*timed.values(), *(unknown if len(unknown) == 1 else [])]
    if rank == len(TAP_AXES):
        at = told[0] if told else rest[0]
        names = ",".join("tap" if i == axis else "sample" if i == at else "taxel" for i in range(rank))
        reason = (
            f"shape {shape_of(signal)}; {CHECK}" if not told else "the axis of samples has times or differs in length"
        )
        if not told or names != ",".join(TAP_AXES):
            yield Guess("axes", names, reason)
    else:
        yield Guess("axes", _other_axes(rank, axis), f"shape {shape_of(signal)}; {CHECK}")
    if None in signal.shape[1:]:
        yield Guess("length", "longest", "its elements differ in length")


def _other_axes(rank: int, axis: int) -> str:
    """Axes of so many, where this is that of taps."""
    if rank > 4:
        return ",".join([*("what", "where", "trial", "session")[: rank - 2], "sample", "taxel"])
    if rank == 1:
        return "sample"
    rest = {2: ["sample"], 4: ["what", "sample", "taxel"]}.get(rank, [])
    at = axis or int(len(rest) == 3)
    return ",".join([*rest[:at], "tap", *rest[at:]])


def _labels(labels: Sequence[str], vectors: Mapping[str, int], of_objects: bool) -> list[Guess]:
    """Labels of taps, or of objects along an axis, among arrays with one value for each."""
    found = []
    if of_objects:
        names = [each for each in labels if re.search(_NAMES, each, re.IGNORECASE)]
        return [Guess("what_names", each, f"one for each of {vectors[each]} objects") for each in names[:1]]
    for key in LABELS:
        fitting = [each for each in labels if like(key, plain(each))]
        if fitting:
            found.append(Guess(key, fitting[0], f"its name, and one value for each of {vectors[fitting[0]]} taps"))
    if len(labels) == 1 and not any(guess.key == "what" for guess in found):
        found.append(Guess("what", labels[0], f"the only array with one value for each of {vectors[labels[0]]} taps"))
    return found


def _tables(found: Sequence[Guess], contents: Contents, values: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Names of objects that indices refer to, and positions where indices count from 1."""
    variables, called = contents.variables, {guess.key: guess.value for guess in found}
    index = _indices(called, values)
    if "what" not in index:
        return
    low, top = int(index["what"].min()), int(index["what"].max())
    texts = {name: of.shape[0] for name, of in variables.items() if of.dtype.kind == "U" and of.shape}
    names = [name for name, n in texts.items() if n in (top, top + 1) and re.search(_NAMES, name, re.IGNORECASE)]
    if not names:
        return
    yield Guess("what_names", names[0], "as many texts as objects")
    if low != 1 or texts[names[0]] != top:
        return
    yield Guess("one_based", True, f"{called['what']} runs from 1 to {top}")
    if "where" in index and index["where"].min() == 1:
        others = [name for name, of in variables.items() if name != called["where"] and is_number(of)]
        fitting = [name for name in others if size_of(variables[name]) == index["where"].max()]
        places = [name for name in fitting if like("where", plain(name))]
        yield from (Guess("where_values", name, "as many numbers as positions") for name in places[:1])


def _indices(called: Mapping[str, Any], values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Values of objects and positions that are finite numbers."""
    names = {key: called[key] for key in ("what", "where") if isinstance(called.get(key), str)}
    index = {key: values[name] for key, name in names.items() if name in values}
    return {key: of for key, of in index.items() if of.dtype.kind in "iuf" and of.size and np.isfinite(of).all()}


def names_beside(
    path: Path, found: Sequence[Guess], contents: Contents, values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """A list of the names of objects in a file of text beside the recording, where objects are numbers."""
    called = {guess.key: guess.value for guess in found}
    if "what_names" in called:
        return
    axes, lowest, count = str(called.get("axes", "")).split(","), 0, 0
    if (index := _indices(called, values).get("what")) is not None:
        lowest, count = int(index.min()), int(index.max()) + 1
    elif "what" in axes and called.get("taps") in contents.variables:
        count = contents.variables[called["taps"]].shape[axes.index("what")] or 0
    for file in sorted(path.parent.glob("*.txt")):
        if count < 2 or not re.search(_NAMES, file.stem, re.IGNORECASE) or file.stat().st_size > _LIST_BYTES:
            continue
        lines = [line for line in file.read_text("utf-8", errors="replace").splitlines() if line.strip()]
        if len(lines) == count - (lowest == 1):
            yield Guess("what_names", file.name, f"{len(lines)} lines, one for each object")
            if lowest == 1:
                yield Guess("one_based", True, f"{called['what']} runs from 1 to {len(lines)}")
            return


def _vectors(name: str, variables: Mapping[str, Variable]) -> dict[str, int]:
    """Arrays beside the samples with one axis, those in the same group first, and their lengths."""
    found = {each: n for each, of in variables.items() if each != name and of.shape and (n := _length(of)) is not None}
    group = name.rpartition("/")[0]
    return dict(sorted(found.items(), key=lambda each: each[0].rpartition("/")[0] != group))


def _axis_of_vectors(signal: Variable, vectors: Mapping[str, int]) -> int:
    """The axis that is as long as most of the arrays with one axis that hold no times: that of taps."""
    lengths = [n for each, n in vectors.items() if not like("time", plain(each))]
    counts = [lengths.count(n) if n and n > 1 else 0 for n in signal.shape]
    return int(np.argmax(counts)) if counts else 0


def _length(variable: Variable) -> int | None:
    """Number of values of an array with one axis, or with others of length 1; `None` of another one."""
    size = size_of(variable)
    return size if size == max((n or 1 for n in variable.shape), default=1) else None


def _called_alike(name: str, variables: Mapping[str, Variable]) -> tuple[list[str], str, list[Guess]]:
    """Arrays called like this one, in their order, with the pattern of their names and its fields.

    Their names differ in numbers, or in the texts of groups as well; shapes differ in one axis at most.
    """
    shape, depth = variables[name].shape, name.count("/")
    same = [each for each, of in variables.items() if is_number(of) and _fits(of.shape, shape)]
    same = [each for each in same if each.count("/") == depth]
    by_text = [each for each in same if _stem(each.rpartition("/")[2]) == _stem(name.rpartition("/")[2])]
    by_number = [each for each in by_text if _stem(each) == _stem(name)]
    if any(_NO_OBJECT.search(each.rpartition("/")[0]) for each in by_text):
        by_text = by_number
    for alike in (by_text, by_number):
        pattern, fields = name_pattern(alike, of_taps=len(shape) < len(TAP_AXES))
        if pattern:
            return alike, pattern, fields
    return [name], name, []


def _stem(name: str) -> str:
    return re.sub(r"\d+", "#", name)


def _fits(shape: _Shape, other: _Shape) -> bool:
    """Whether arrays have as many axes, of which at most one differs in length."""
    return len(shape) == len(other) and sum(a != b for a, b in zip(shape, other, strict=True)) <= 1


def _in_groups(found: list[Guess], name: str, pattern: str, fields: Sequence[Guess], contents: Contents) -> list[Guess]:
    """The same for all arrays called alike, whose names have fields."""
    if not fields:
        return found
    between = next(each for each in (r"([/.])", "(/)", "($)") if len(_apart(each, name)) == len(_apart(each, pattern)))
    groups, fielded = _apart(between, name)[:-1], _apart(between, pattern)[:-1]
    changed = [found[0]._replace(value=pattern)]
    for guess in found[1:]:
        parts = _apart(between, guess.value) if isinstance(guess.value, str) else []
        beside = groups and parts[: len(groups)] == groups
        changed.append(guess._replace(value="".join([*fielded, *parts[len(groups) :]])) if beside else guess)
    taken = {guess.key for guess in (*changed, *fields)}
    mine = [each.partition("@")[2] for each in contents.attributes if each.partition("@")[0] == name]
    for key in LABELS:
        fitting = [each for each in mine if like(key, plain(each))]
        if key not in taken and fitting:
            changed.append(Guess(key, f"{pattern}@{fitting[0]}", "an attribute of each array, by its name"))
    return [*changed, *fields]


def _apart(between: str, text: str) -> list[str]:
    """Parts of a text and what is between them."""
    return re.split(between, text)
