"""Samples of a file as taps or as frames of a stream, whatever the order of their axes."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import check_real, naming
from .formats.columns import stacked
from .formats.contents import Values
from .mapping import option

_FRAMES = ("sample", "taxel")
_ROLES = ("tap", *_FRAMES)
_SHOWN = 40
_IN_JSON = {"nan": "NaN", "None": "null", "inf": "Infinity"}
_NOT_JSON = re.compile(r"\b(?:nan|None|inf)\b")


@dataclass(frozen=True, eq=False)
class Signal:
    """Samples of one file or array.

    Attributes:
        samples: Taps, shape (n, J, K) or a list of n of shape (J_i, K); or frames of a stream, shape (R, K).
        axis_index: Index of each tap along the axes that are labels, each of shape (n,).
        lengths: Of the axes of labels and taps in their order, or of those of elements that differ in shape.
        counts: Number of taps of each of these elements.
    """

    samples: Values
    axis_index: dict[str, NDArray[np.intp]] = field(default_factory=dict)
    lengths: tuple[int, ...] = ()
    counts: tuple[int, ...] = ()

    @property
    def cut(self) -> bool:
        """Whether these are taps."""
        return isinstance(self.samples, list) or self.samples.ndim == 3

    def select(self, mask: NDArray[np.bool_]) -> "Signal":
        """These taps or frames alone."""
        samples = self.samples
        index = {key: of[mask] for key, of in self.axis_index.items()}
        if isinstance(samples, list):
            return Signal([each for each, keep in zip(samples, mask, strict=True) if keep], index)
        return Signal(samples[mask], index)

    def with_taxels(self, chosen: slice) -> "Signal":
        """These taxels alone.

        Raises:
            InputError: There are none.
        """
        samples = self.samples
        if len(samples) and not range(samples[0].shape[-1])[chosen]:
            raise InputError(f"{option('taxels')} chooses none of {samples[0].shape[-1]} taxels.")
        some = [each[..., chosen] for each in samples] if isinstance(samples, list) else samples[..., chosen]
        return replace(self, samples=some)


def arranged(
    values: Values, axes: Sequence[str] | None, name: str, frames: bool, shape: Sequence[int | None] = ()
) -> Signal:
    """Samples with their axes in the order of a tap set.

    Args:
        values: The array, or a list of arrays where its elements differ in shape.
        axes: Its axes; `None` for tap, sample and taxel if there are three.
        name: Of the array, for messages.
        frames: Whether two axes are those of frames, sample and taxel, if nothing else is said.
        shape: Of a list the axes of its elements in the file and those inside them, as far as they are known.

    Raises:
        InputError: The axes do not fit the array, or it holds no real numbers.
    """
    lead = _lead(values, shape) if isinstance(values, list) else ()
    rank = len(lead) + max((each.ndim for each in values), default=0) if isinstance(values, list) else values.ndim
    axes = _default_axes(rank, name, frames) if axes is None else axes
    if len(axes) != rank:
        there = f"{len(values)} elements" if isinstance(values, list) else f"shape {values.shape}"
        raise InputError(f"{name} has {_axes(rank)} ({there}), but axes (--axes) has {len(axes)}: {', '.join(axes)}.")
    with naming(option("taps")):
        if isinstance(values, list):
            return _of_elements(values, axes, name, lead)
        check_real(name, values)
    return _of_array(values, axes)


def from_texts(values: Values, name: str, place: Callable[[int], str]) -> Values:
    """Lists of numbers in texts such as `[[0.1, 0.2], [0.3, nan]]`, as pandas writes them, as arrays.

    Args:
        values: Of each row; what holds no texts stays as it is.
        name: Their name.
        place: Where a row stands, for messages.

    Raises:
        InputError: A text is no such list.
    """
    if not isinstance(values, np.ndarray) or values.dtype.kind != "U":
        return values
    found = list[NDArray[np.float64]]()
    for row, text in enumerate(values.tolist()):
        try:
            listed = json.loads(_NOT_JSON.sub(lambda match: _IN_JSON[match[0]], text))
            found.append(np.array([*listed], np.float64))
        except (ValueError, TypeError, RecursionError):
            raise InputError(
                f"{place(row)}, {name}: {text[:_SHOWN]!r} is no list of numbers such as [[0.1, 0.2], [0.3, 0.4]], with "
                "inner lists of one length; save arrays as .npz instead."
            ) from None
    return stacked(found) if found else values


def _default_axes(rank: int, name: str, frames: bool) -> tuple[str, ...]:
    if rank == len(_ROLES):
        return _ROLES
    if rank == 2 and frames:
        return _FRAMES
    if rank == 2:
        raise InputError(
            f"{name} has two axes: say which with axes (--axes), tap,sample or tap,taxel; if they are sample,taxel, "
            "say what a tap is with tap (--tap), or cut taps with --trigger."
        )
    raise InputError(f"{name} has {_axes(rank)}: say which with axes (--axes), such as what,trial,sample,taxel.")


def _axes(number: int) -> str:
    return f"{number} {'axis' if number == 1 else 'axes'}"


def _lead(values: list[NDArray[Any]], shape: Sequence[int | None]) -> tuple[int, ...]:
    """Lengths of the axes of the elements of a list, given in the order of their rows."""
    lead = shape[: len(shape) - max((each.ndim for each in values), default=0)]
    known = tuple(length for length in lead if length is not None)
    return known if len(known) == len(lead) > 0 and prod(known) == len(values) else (len(values),)


def _of_elements(values: list[NDArray[Any]], axes: Sequence[str], name: str, lead: tuple[int, ...]) -> Signal:
    """Taps of elements that differ in shape, along axes of labels or of taps, which elements may have as well."""
    outer, inner = axes[: len(lead)], axes[len(lead) :]
    if set(outer) & set(_FRAMES):
        raise InputError(
            f"{name}: its elements differ in shape, so axes (--axes) must begin with tap or a label for each of "
            f"{_axes(len(lead))} of elements, got {', '.join(axes)}."
        )
    for number, each in enumerate(values):
        if each.ndim != len(inner):
            raise InputError(f"{name}: element {number} has {_axes(each.ndim)}, others {len(inner)}.")
        check_real(f"{name}[{number}]", each)
    parts = [_of_array(each, inner) for each in values]
    taps = [tap for part in parts for tap in (part.samples if part.cut else [np.asarray(part.samples)])]
    counts = tuple(len(part.samples) if part.cut else 1 for part in parts)
    index = {axis: np.repeat(along, counts) for axis, along in _label_index(outer, lead).items()}
    for axis in parts[0].axis_index:
        if axis in index:
            raise _twice(axis)
        index[axis] = np.concatenate([part.axis_index[axis] for part in parts])
    return Signal(taps, index, lead, counts)


def _of_array(values: NDArray[Any], axes: Sequence[str]) -> Signal:
    labels = [axis for axis in axes if axis not in _FRAMES]
    if not labels:
        return Signal(_in_order(values, axes, _FRAMES))
    merged = [axis if axis in _FRAMES else "tap" for axis in axes]
    lengths = tuple(values.shape[i] for i, axis in enumerate(axes) if axis not in _FRAMES)
    return Signal(_in_order(values, merged, _ROLES), _label_index(labels, lengths), lengths)


def _label_index(labels: Sequence[str], lengths: Sequence[int]) -> dict[str, NDArray[np.intp]]:
    """Index of each tap along the axes that are labels."""
    found: dict[str, NDArray[np.intp]] = {}
    for axis, along in zip(labels, np.indices(lengths).reshape(len(labels), -1), strict=True):
        if axis in found and axis != "tap":
            raise _twice(axis)
        found[axis] = along
    found.pop("tap", None)
    return found


def _twice(axis: str) -> InputError:
    return InputError(f"axes (--axes) has {axis} twice; only tap, sample and taxel may be repeated.")


def _in_order(values: NDArray[Any], axes: Sequence[str], wanted: Sequence[str]) -> NDArray[Any]:
    """The array with one axis for each wanted role; those of a role are flattened, a missing one has length 1."""
    order = [i for role in wanted for i, axis in enumerate(axes) if axis == role]
    moved = values.transpose(order)
    lengths = [[values.shape[i] for i, axis in enumerate(axes) if axis == role] for role in wanted]
    shape = tuple(int(np.prod(each, dtype=np.int64)) for each in lengths)
    return moved if moved.shape == shape else moved.reshape(shape)


def side_by_side(signals: Sequence[Signal], names: Sequence[str]) -> Signal:
    """One signal with the taxels of all.

    Raises:
        InputError: They differ in taps, samples or kind.
    """
    first = signals[0]
    for signal, name in zip(signals[1:], names[1:], strict=True):
        if _lengths(signal) != _lengths(first):
            raise InputError(f"{option('taps')}: {names[0]} and {name} differ in their numbers of taps or samples.")
    if len(signals) == 1:
        return first
    samples = [signal.samples for signal in signals]
    if isinstance(first.samples, list):
        return replace(first, samples=[np.concatenate(each, axis=-1) for each in zip(*samples, strict=True)])
    return replace(first, samples=np.concatenate(samples, axis=-1))


def _lengths(signal: Signal) -> list[tuple[int, ...]]:
    samples = signal.samples
    return [each.shape[:-1] for each in samples] if isinstance(samples, list) else [samples.shape[:-1]]


def split_frames(frames: NDArray[Any], starts: NDArray[np.intp]) -> Values:
    """Taps of consecutive frames, shape (n, J, K), or a list of them if they differ in length."""
    lengths = np.diff(starts, append=len(frames))
    if len(lengths) and (lengths == lengths[0]).all():
        return frames.reshape(len(lengths), lengths[0], frames.shape[1])
    return [frames[start : start + length] for start, length in zip(starts, lengths, strict=True)]
