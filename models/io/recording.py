"""Content of a file before it becomes a `TapSet`: samples, with labels for each row.

Every reader (`io.arrays`, `io.csv`, `io.layouts.assemble`) returns a `Recording`. Its rows are taps where the file
holds cut taps, and frames where it holds continuous streams; the labels have the same meaning in both.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .. import storage
from ..blocks import over_blocks
from ..errors import InputError
from ..preprocessing import Preprocessing
from ..settings import Missing
from ..tap_checks import not_finite
from ..taps import TapSet


@dataclass(frozen=True, eq=False)
class Labels:
    """Labels of `n` rows and the tables they refer to; names as in `TapSet.from_arrays`.

    Attributes:
        what: Object of each row as an index into `what_name`, shape (n,).
        where: Position of each row, shape (n,).
        session: Recording session of each row, shape (n,).
        trial: Number of each row as recorded, shape (n,), or `None` for the order of the rows.
        what_name: Names of the objects.
        extra: Further arrays of shape (n,) or (n, K).
        tables: Other arguments of `TapSet.from_arrays`, without a row axis: `where_value`, `where_edges`,
            `where_unit`, `what_value`, `what_unit`, `taxel_position`, `units`, `sensor`, `source`, `licence`.
    """

    what: NDArray[np.int64]
    where: NDArray[np.float64]
    session: NDArray[np.int64]
    trial: NDArray[np.int64] | None
    what_name: tuple[str, ...]
    extra: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)

    def take(self, rows: ArrayLike) -> Self:
        """Labels of these rows, with the same tables."""
        rows = np.asarray(rows, dtype=np.intp)
        return replace(
            self,
            what=self.what[rows],
            where=self.where[rows],
            session=self.session[rows],
            trial=None if self.trial is None else self.trial[rows],
            extra={name: values[rows] for name, values in self.extra.items()},
        )

    def tapset(self, taps: NDArray[np.floating], preprocessing: Preprocessing, missing: Missing = "refuse") -> TapSet:
        """Tap set of labelled taps, `taps` of shape (n, J, K)."""
        return TapSet.from_arrays(
            taps,
            self.what,
            self.what_name,
            preprocessing=preprocessing,
            where=self.where,
            session=self.session,
            trial=self.trial,
            extra=self.extra,
            missing=missing,
            **self.tables,
        )


@dataclass(frozen=True, eq=False)
class Recording:
    """The content of a file.

    Attributes:
        samples: Cut taps, shape (N, J, K), or frames of continuous streams, shape (S, K).
        labels: Labels of the `N` taps or `S` frames.
        rate_hz: Sampling rate in hertz, `None` if not given.
        file: For streams, the number of the file that each frame comes from, shape (S,).
        left_out: Arrays that could not be kept, one sentence each.
        time: For streams, the time of each frame in seconds, shape (S,), if known.
        row: For streams, the number of each frame in its file, shape (S,), if frames between them may be gone.
    """

    samples: NDArray[np.floating]
    labels: Labels
    rate_hz: float | None = None
    file: NDArray[np.int64] | None = None
    left_out: tuple[str, ...] = ()
    time: NDArray[np.float64] | None = None
    row: NDArray[np.intp] | None = None

    @property
    def is_stream(self) -> bool:
        """Whether the rows are frames still to be cut into taps."""
        return self.samples.ndim == 2

    def tapset(self, missing: Missing = "refuse") -> TapSet:
        """Tap set of the cut taps.

        Raises:
            InputError: The rows are frames of streams, or as `TapSet`.
        """
        if self.is_stream:
            raise InputError("contains continuous streams; cut them into taps with solidtouch convert --trigger.")
        record = Preprocessing(samples=self.samples.shape[1], rate_hz=self.rate_hz)
        return self.labels.tapset(self.samples, record, missing)


@contextmanager
def naming(path: str | Path) -> Iterator[None]:
    """Puts the path in front of the message of any `InputError` raised inside the block."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def check_real(name: str, values: Any) -> None:
    """Checks the type of an array, or of what a file declares of it.

    Raises:
        InputError: It does not hold real numbers.
    """
    if values.dtype.kind not in "fiub":
        got = "text" if values.dtype.kind in "US" else values.dtype
        raise InputError(f"array {name} must hold real numbers, got {got}.")


def as_samples(
    name: str,
    values: NDArray[Any],
    missing: Missing | None = "refuse",
    place: Callable[[tuple[int, ...]], str] | None = None,
) -> NDArray[np.floating]:
    """Samples as float32 or float64, as stored; integers become float64.

    Args:
        name: Of the array, for messages.
        values: The samples.
        missing: What to do with those that are NaN, see `load_taps`; `None` for labels, which cannot be missing.
        place: Where the sample at an index stands, for messages; default the index itself.

    Raises:
        InputError: They are not real numbers, or one is infinite or, unless `missing` is `drop`, NaN.
    """
    check_real(name, values)
    if values.dtype not in (np.float32, np.float64):
        kind = np.dtype(np.float32 if values.dtype == np.float16 else np.float64)
        values = changed(values, lambda block: block.astype(kind), kind)
    rows = np.atleast_1d(values)
    for which, bad in over_blocks(rows, lambda block, which: (which, _refused(block, missing))):
        if len(bad):
            index = tuple((bad[0] + which.start * (np.arange(rows.ndim) == 0)).tolist())
            where = f"{name}[{', '.join(map(str, index))}]" if place is None else place(index)
            raise InputError(f"{where} is {rows[index]}; {not_finite(rows[index], sample=missing is not None)}")
    return values


def changed(
    values: NDArray[Any], work: Callable[[NDArray[Any]], NDArray[Any]], kind: np.dtype[Any]
) -> NDArray[np.floating]:
    """Samples after some work on each, as floats; those of a mapped file in a temporary one."""
    found = None
    if isinstance(values, np.memmap):
        parts = over_blocks(values, lambda block, _: np.ascontiguousarray(work(block), kind).data)
        found = storage.spooled(parts, values.shape, kind)
    return work(values).astype(kind, copy=False) if found is None else found


def _refused(values: NDArray[np.floating], missing: Missing | None) -> NDArray[np.intp]:
    """Indices of values that cannot be samples, shape (n, axes)."""
    return np.argwhere(np.isinf(values) if missing == "drop" else ~np.isfinite(values))


def concatenated(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Taps or frames of several files one after the other, in a temporary file if they are many."""
    if len(parts) == 1:
        return parts[0]
    kind = np.result_type(*parts)
    if sum(part.nbytes for part in parts) > storage.ON_DISK:
        shape = (sum(map(len, parts)), *parts[0].shape[1:])
        blocks = (block for part in parts for block in over_blocks(part, lambda block, _: block))
        joined = storage.spooled((np.ascontiguousarray(block, kind).data for block in blocks), shape, kind)
        if joined is not None:
            return joined
    return np.concatenate(parts)


def runs(*keys: NDArray[Any]) -> NDArray[np.intp]:
    """First row of each maximal run in which none of the keys changes."""
    changes = np.zeros(len(keys[0]), dtype=bool)
    changes[:1] = True
    for key in keys:
        changes[1:] |= key[1:] != key[:-1]
    return np.flatnonzero(changes)
