"""Guesses what the arrays of a file mean: samples, their axes and labels."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..formats.contents import Contents, Variable
from ..mapping import LABELS
from ..patterns import compiled_pattern
from .guess import CHECK, NAMES, TAP_AXES, Guess, increases, indices, is_number, like, plain, shape_of, size_of
from .guess_names import name_pattern
from .guess_presses import signal

_NO_OBJECT = re.compile(r"time|stamp|force|torque|joint|pose|accel|gyro|image|camera|position|velocity", re.IGNORECASE)
"""What groups of other quantities than those of an object are called."""
_LOOKED, _SMOOTH = 64, 0.6
"""Taps whose neighbouring samples are compared; samples differ by less than this share of what taxels do."""
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
    if not any(map(is_number, variables.values())):
        return []
    name = max(variables, key=lambda of: (is_number(variables[of]), not like("time", _own(of)), size_of(variables[of])))
    alike, pattern, fields = _called_alike(
        name, {**variables, **{each: of for other in others for each, of in other.variables.items()}}
    )
    alike = [each for each in alike if each in variables]
    further = (other.variables[name].shape for other in others if name in other.variables)
    shapes = [variables[each].shape for each in alike] + list(further)
    keys = {guess.key for guess in fields}
    found = [Guess("taps", name, _which(alike, variables))]
    vectors = _vectors(name, variables)
    rank, axis = len(variables[name].shape), _axis_of_vectors(variables[name], vectors)
    labels = [each for each, n in vectors.items() if rank and n == variables[name].shape[axis]]
    times = [each for each in labels if like("time", _own(each))]
    labels = [each for each in labels if each not in times]
    if "trial" in keys and len(alike) > 1:  # what is beside each tap has a value for each sample
        groups = {each.rpartition("/")[0] for each in alike} - {""}
        labels = [each for each in labels if each.rpartition("/")[0] not in groups]
    if len(labels) > 1 and not any(like(key, _own(each)) for key in LABELS for each in labels):
        labels = []
    one_each = len(alike) > 1 and {vectors[each] for each in labels} == {len(alike)}
    if rank == 2 and axis == 0 and times and increases(values.get(times[0], np.zeros(1))):
        found.append(Guess("time", times[0], f"its name, and one rising value for each of {shapes[0][0]} rows"))
        found.append(Guess("axes", "sample,taxel", "as each row has a time"))
        if keys & {"what", "trial"}:
            found.append(Guess("tap", "file", "each array is one tap, if it is"))
        elif pressing := list(signal({each: values[each] for each in labels if each in values})):
            found += pressing
            labels = [each for each in labels if each != pressing[1].value.partition("<")[0]]
    elif _each_a_tap(rank, len(shapes), keys, of_names) and (one_each or not labels):
        found += _one_tap(shapes)
        labels = []
    else:
        found += _axes(name, variables[name], axis, vectors, values)
    found += _over_axes(found, variables, name)
    of_objects = any(guess.key == "axes" and guess.value.startswith("what") for guess in found)
    found += _labels(labels, vectors, of_objects and axis == 0)
    if not any(guess.key == "what" for guess in found):
        found += _on_other_topics(name, contents, values)
    found += [*_tables(found, contents, values), *_valid(labels, values)]
    found = [guess for guess in found if guess.key not in keys]
    return _in_groups(found, name, pattern, fields, contents)


def _on_other_topics(name: str, contents: Contents, values: Mapping[str, NDArray[Any]]) -> list[Guess]:
    """The object, where messages of another topic than the samples name it."""
    others = [each for each in values if contents.clock(each) != contents.clock(name) and like("what", each)]
    texts = [each for each in others if values[each].dtype.kind == "U" and len(np.unique(values[each])) > 1]
    return [Guess("what", each, "texts of another topic; the last one before each row counts") for each in texts[:1]]


def _which(alike: Sequence[str], variables: Mapping[str, Variable]) -> str:
    """Why these are the samples."""
    if len(alike) < 2:
        return "the largest array of numbers"
    lists = [each for each, of in variables.items() if each not in alike and _length(of) == len(alike)]
    lists = [each for each in lists if not like("time", _own(each)) and len(variables[alike[0]].shape) < len(TAP_AXES)]
    told = f"; {lists[0]} has one value for each, and may be a label of them" if lists else ""
    return f"{len(alike)} large arrays of numbers, called alike{told}"


def _each_a_tap(rank: int, several: int, keys: set[str], of_names: bool) -> bool:
    """Whether each of several arrays or files is one tap."""
    told = of_names or bool(keys & {"what", "where", "x", "trial"})
    if rank == len(TAP_AXES):
        return several > 1 and "trial" in keys
    return rank in (1, 2) and several > 1 and told and ("taxel" not in keys or rank == 1)


def _one_tap(shapes: Sequence[_Shape]) -> Iterator[Guess]:
    """Each array or file is a tap; the axis that differs between them is that of samples."""
    yield Guess("tap", "file", "each array is one tap, if it is")
    rank = len(shapes[0])
    if rank == 1:
        yield Guess("axes", "sample", "numbers one after the other")
        return
    differ = [axis for axis in range(rank) if len({shape[axis] for shape in shapes if len(shape) == rank}) > 1]
    at = differ[0] if len(differ) == 1 else 0
    shape = " x ".join("?" if n is None else str(n) for n in shapes[0])
    ordinal = ("first", "second", "third")[at]
    reason = f"taps differ in the length of the {ordinal} axis" if len(differ) == 1 else f"shape {shape}; {CHECK}"
    yield Guess("axes", ",".join("sample" if axis == at else "taxel" for axis in range(rank)), reason)
    if differ:
        yield Guess("length", "shortest", "taps differ in length")


def _axes(
    name: str, signal: Variable, axis: int, vectors: Mapping[str, int], values: Mapping[str, NDArray[Any]]
) -> Iterator[Guess]:
    """The axes of an array, where this is that of taps, and times along that of samples."""
    rank, rest = len(signal.shape), [i for i in range(len(signal.shape)) if i != axis]
    rising = {
        each: n for each, n in vectors.items() if like("time", _own(each)) and increases(values.get(each, np.zeros(1)))
    }
    timed = {each: [i for i in rest if signal.shape[i] == n] for each, n in rising.items()}
    timed = {each: found[0] for each, found in timed.items() if len(found) == 1}
    if timed and rank in (2, 3):
        time, at = next(iter(timed.items()))
        yield Guess("time", time, f"its name, and one rising value for each of {signal.shape[at]} samples")
    beside = [values[each] for each, n in vectors.items() if n == signal.shape[axis] and each in values]
    repeated = any(len(np.unique(of)) < of.size for of in beside)
    unknown = [i for i in rest if i and signal.shape[i] is None]
    told = [*timed.values(), *(unknown if len(unknown) == 1 else [])]
    if rank == len(TAP_AXES):
        smooth = None if told or axis else _smooth_axis(values.get(name), rest)
        at = told[0] if told else rest[0] if smooth is None else smooth
        names = ",".join("tap" if i == axis else "sample" if i == at else "taxel" for i in range(rank))
        reason = (
            f"shape {shape_of(signal)}; {CHECK}" if not told else "the axis of samples has times or differs in length"
        )
        if smooth is not None:
            reason = f"shape {shape_of(signal)}; neighbours are more alike along the axis of samples; check"
        if not told or names != ",".join(TAP_AXES):
            yield Guess("axes", names, reason)
    else:
        yield Guess("axes", _other_axes(rank, axis, signal.shape, repeated), f"shape {shape_of(signal)}; {CHECK}")
    if None in signal.shape[1:]:
        yield Guess("length", "longest", "its elements differ in length")


def _smooth_axis(samples: NDArray[Any] | None, axes: Sequence[int]) -> int | None:
    """The one of two axes along which neighbours differ clearly less; `None` if neither does."""
    if samples is None or min(samples.shape) < 2:
        return None
    rough = [float(np.nanmean(np.abs(np.diff(samples[:_LOOKED], axis=axis)))) for axis in axes]
    return axes[int(np.argmin(rough))] if min(rough) < _SMOOTH * max(rough) else None


def _other_axes(rank: int, axis: int, shape: _Shape, of_taps: bool) -> str:
    """Axes of so many, where this is that of taps; beside a grid of taxels the longest one is of samples."""
    if rank == len(TAP_AXES) + 1 and of_taps and not axis:
        longest = max(range(1, rank), key=lambda at: shape[at] or 0)
        return ",".join("tap" if at == 0 else "sample" if at == longest else "taxel" for at in range(rank))
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
        names = [each for each in labels if re.search(NAMES, each, re.IGNORECASE)]
        return [Guess("what_names", each, f"one for each of {vectors[each]} objects") for each in names[:1]]
    for key in LABELS:
        fitting = [each for each in labels if like(key, _own(each))]
        if fitting:
            found.append(Guess(key, fitting[0], f"its name, and one value for each of {vectors[fitting[0]]} taps"))
    rest = [each for each in labels if not re.search("time|stamp", _own(each), re.IGNORECASE)]
    if len(labels) == len(rest) == 1 and not any(guess.key == "what" for guess in found):
        found.append(Guess("what", labels[0], f"the only array with one value for each of {vectors[labels[0]]} taps"))
    return found


def _tables(found: Sequence[Guess], contents: Contents, values: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Names of objects that indices refer to, and positions where indices count from 1."""
    variables, called = contents.variables, {guess.key: guess.value for guess in found}
    axes = str(called.get("axes", "")).split(",")
    if "where" in axes and (n := variables[called["taps"]].shape[axes.index("where")]):
        fitting = [
            each for each, of in variables.items() if is_number(of) and size_of(of) == n and like("where", _own(each))
        ]
        yield from (Guess("where_values", each, "as many numbers as positions") for each in fitting[:1])
    index = indices(called, values)
    if "what" not in index:
        return
    low, top = int(index["what"].min()), int(index["what"].max())
    texts = {name: of.shape[0] for name, of in variables.items() if of.dtype.kind == "U" and of.shape}
    names = [name for name, n in texts.items() if n in (top, top + 1) and re.search(NAMES, name, re.IGNORECASE)]
    if not names:
        return
    yield Guess("what_names", names[0], "as many texts as objects")
    if low != 1 or texts[names[0]] != top:
        return
    yield Guess("one_based", True, f"{called['what']} runs from 1 to {top}")
    if "where" in index and index["where"].min() == 1:
        others = [name for name, of in variables.items() if name != called["where"] and is_number(of)]
        fitting = [name for name in others if size_of(variables[name]) == index["where"].max()]
        places = [name for name in fitting if like("where", _own(name))]
        yield from (Guess("where_values", name, "as many numbers as positions") for name in places[:1])


def _over_axes(found: Sequence[Guess], variables: Mapping[str, Variable], name: str) -> Iterator[Guess]:
    """Positions with one value for each element of the axes before samples and taxels."""
    axes = next((guess.value.split(",") for guess in found if guess.key == "axes"), [])
    shape = variables[name].shape[: axes.index("sample")] if "sample" in axes else ()
    if len(shape) > 1 and "where" not in axes:
        fitting = [each for each, of in variables.items() if of.shape == shape and like("where", _own(each))]
        yield from (Guess("where", each, "its name, and its axes") for each in fitting[:1])


def _valid(labels: Sequence[str], values: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """What says which taps are valid."""
    truths = [each for each in labels if re.search(r"\bis ?valid|\bvalid", _own(each), re.IGNORECASE)]
    truths = [each for each in truths if each in values and set(np.unique(values[each]).tolist()) == {0, 1}]
    for each in truths[:1]:
        yield Guess("keep", each, f"its name; it keeps {np.count_nonzero(values[each])} of {values[each].size} taps")


def _vectors(name: str, variables: Mapping[str, Variable]) -> dict[str, int]:
    """Arrays beside the samples with one axis, those in the same group first, and their lengths."""
    found = {each: n for each, of in variables.items() if each != name and of.shape and (n := _length(of)) is not None}
    group = name.rpartition("/")[0]
    return dict(sorted(found.items(), key=lambda each: each[0].rpartition("/")[0] != group))


def _axis_of_vectors(signal: Variable, vectors: Mapping[str, int]) -> int:
    """The axis that is as long as most of the arrays with one axis that hold no times: that of taps."""
    lengths = [n for each, n in vectors.items() if not like("time", _own(each))]
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
    shape, depth = variables[name].shape, len(re.findall("[/.]", name))
    same = [each for each, of in variables.items() if is_number(of) and _fits(of.shape, shape)]
    same = [each for each in same if len(re.findall("[/.]", each)) == depth]
    by_text = [each for each in same if _stem(re.split("[/.]", each)[-1]) == _stem(re.split("[/.]", name)[-1])]
    by_number = [each for each in by_text if _stem(each) == _stem(name)]
    groups = {part for each in by_text for part in re.split("[/.]", each)[:-1]}
    if any(map(_NO_OBJECT.search, (part for part in groups if not re.search(r"\d", part)))):
        by_text = by_number
    if any(map(_NO_OBJECT.search, same)) or not re.search(r"\d", name):
        same = by_text
    for alike in (same, by_text, by_number):
        pattern, fields = name_pattern(alike, of_taps=len(shape) < len(TAP_AXES))
        if any(each not in alike and is_number(variables[each]) for each in _matched(pattern, variables)):
            continue
        if pattern and (alike is by_text or alike is by_number or {"what", "trial"} <= {guess.key for guess in fields}):
            return alike, pattern, fields
    return [name], name, []


def _matched(pattern: str, names: Iterable[str]) -> list[str]:
    """The names that a pattern matches; none without one."""
    return list(filter(compiled_pattern(pattern, "taps").fullmatch, names)) if pattern else []


def _own(name: str) -> str:
    """The name of an array without those of its groups and structs, its words apart."""
    return plain(re.split(r"[/.]", name)[-1])


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
    owners = {"/".join(name.split("/")[:n]): "/".join(pattern.split("/")[:n]) for n in range(1, name.count("/") + 2)}
    mine = [(owners[of], each) for of, _, each in (text.partition("@") for text in contents.attributes) if of in owners]
    for key in LABELS:
        fitting = [f"{of}@{each}" for of, each in mine if like(key, plain(each))]
        if key not in taken and fitting:
            changed.append(Guess(key, fitting[-1], "an attribute of each array or group, by its name"))
    return [*changed, *fields]


def _apart(between: str, text: str) -> list[str]:
    """Parts of a text and what is between them."""
    return re.split(between, text)
