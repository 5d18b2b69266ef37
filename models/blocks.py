"""Work on samples in blocks of taps, so that recordings need not fit into memory.

Large recordings stay in their file (see `storage.open_taps`), and a block of them is in memory at a time for each
thread. Samples are arrays or variables of xarray, shape (N, J, K); what is done to them is the same.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from xarray import Variable
from xarray.backends import BackendArray
from xarray.core import indexing

from .threads import cores, in_order

BLOCK = 1 << 24
"""Bytes of samples read at a time."""
_BYTES, _THREADS = 8, 4
_LONGER = 4  # a block may be so many times longer to hold whole chunks


def block_length(samples: Any) -> int:
    """Number of taps in a block, at least 1; those of whole chunks of a file, if these are not too long."""
    length = max(1, BLOCK // max(1, prod(samples.shape[1:]) * samples.dtype.itemsize))
    chunk = getattr(samples, "encoding", {}).get("preferred_chunks", {}).get("tap", 1)
    return -(-length // chunk) * chunk if chunk <= _LONGER * length else length


def over_blocks[T](samples: Any, work: Callable[[NDArray[Any], slice], T], workers: int | None = None) -> Iterator[T]:
    """Results of work on blocks of samples, in order; several blocks are worked on at the same time.

    Args:
        samples: Shape (N, J, K).
        work: Takes the samples of a block and which taps these are; from any thread.
        workers: Number of threads; default one per core, at most 4, as each holds blocks.
    """
    step = block_length(samples)
    parts = [slice(start, min(start + step, len(samples))) for start in range(0, len(samples), step)]

    def task(part: slice) -> Callable[[], T]:
        return lambda: work(np.asarray(samples[part]), part)

    yield from in_order(map(task, parts), min(len(parts), workers or min(cores(None), _THREADS)) or 1)


@dataclass(frozen=True, eq=False)
class ScaledSamples:
    """Samples of a large recording in double precision and in other units, made when they are asked for.

    Attributes:
        samples: Shape (N, J, K), in memory or on disk.
        centre: Origin of each taxel, shape (K,), or of all.
        unit: Unit of each taxel, likewise.
    """

    samples: Any
    centre: Any = 0.0
    unit: Any = 1.0
    dtype = np.dtype(np.float64)

    @property
    def shape(self) -> tuple[int, ...]:
        """(N, J, K)."""
        return self.samples.shape

    @property
    def encoding(self) -> dict[str, Any]:
        """How a file holds them."""
        return getattr(self.samples, "encoding", {})

    def __len__(self) -> int:
        return len(self.samples)

    def chosen(self, taps: NDArray[np.bool_]) -> "ScaledSamples":
        """Those of the taps in a mask."""
        return replace(self, samples=self.samples[np.flatnonzero(taps)])

    def __getitem__(self, taps: slice) -> NDArray[np.float64]:
        block = np.asarray(self.samples[taps]).astype(self.dtype)
        block -= self.centre
        block /= self.unit
        return block

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return self[:].astype(dtype or self.dtype, copy=False)


class _LazySamples(BackendArray):
    """Samples for a lazy variable of xarray, shape (N, J, K); a subclass reads those of some taps."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        """Any part of them."""
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._part)

    def _part(self, key: tuple[Any, ...]) -> NDArray[Any]:
        taps, *rest = key
        index = np.arange(self.shape[0])[taps]
        return self._read(index, rest) if np.ndim(index) else self._read(np.array([index]), rest)[0]

    def _read(self, index: NDArray[np.intp], rest: Sequence[Any]) -> NDArray[Any]:
        """Of the taps at these indices the samples and taxels that `rest` says."""
        raise NotImplementedError

    def variable(self, like: Variable) -> Variable:
        """They as a variable, with the dims and attributes of another one."""
        return Variable(like.dims, indexing.LazilyIndexedArray(self), like.attrs, like.encoding)


class JoinedSamples(_LazySamples):
    """Samples of recordings one after the other, for a lazy variable of xarray; each is read when it is asked for."""

    def __init__(self, parts: Sequence[Any]) -> None:
        self.parts, self.ends = parts, np.cumsum([len(part) for part in parts])
        self.shape = int(self.ends[-1]), *parts[0].shape[1:]
        self.dtype = np.result_type(*(part.dtype for part in parts))

    def _read(self, index: NDArray[np.intp], rest: Sequence[Any]) -> NDArray[Any]:
        part_of, found = np.searchsorted(self.ends, index, side="right"), []
        for number, part in enumerate(self.parts):
            rows = index[part_of == number] - (self.ends[number] - len(part))
            found.append(np.asarray(part[(_run(rows), *rest)]))
        order = np.argsort(part_of, kind="stable")
        return np.concatenate(found).astype(self.dtype, copy=False)[np.argsort(order, kind="stable")]


def _run(index: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """Indices as a slice if they are one, which files read faster."""
    whole = len(index) and (np.diff(index) == 1).all()
    return slice(int(index[0]), int(index[-1]) + 1) if whole else index


def joined_samples(parts: Sequence[Variable]) -> Variable:
    """Samples of several recordings one after the other, of which none is read."""
    return JoinedSamples(parts).variable(parts[0])


class TaredSamples(_LazySamples):
    """Samples less the mean of the first ones of their tap and taxel."""

    def __init__(self, samples: Variable, first: int, dtype: Any) -> None:
        self.samples, self.first, self.shape, self.dtype = samples, first, samples.shape, np.dtype(dtype)

    def _read(self, index: NDArray[np.intp], rest: Sequence[Any]) -> NDArray[Any]:
        return tared(np.asarray(self.samples[_run(index)]).astype(self.dtype, copy=False), self.first)[:, *rest]


class MovedSamples(_LazySamples):
    """Samples in double precision, those of each tap multiplied by its gain and then shifted by its offset."""

    dtype = np.dtype(np.float64)

    def __init__(self, samples: Variable, gain: NDArray[np.float64], offset: NDArray[np.float64]) -> None:
        self.samples, self.gain, self.offset, self.shape = samples, gain, offset, samples.shape

    def _read(self, index: NDArray[np.intp], rest: Sequence[Any]) -> NDArray[Any]:
        run = _run(index)
        block = np.asarray(self.samples[run]).astype(self.dtype)
        block *= self.gain[run, None, None]
        block += self.offset[run, None, None]
        return block[:, *rest]


def tared(samples: NDArray[Any], first: int) -> NDArray[Any]:
    """Samples (N, J, K) less the mean of the first ones of their tap and taxel."""
    return samples - samples[:, :first].mean(axis=1, keepdims=True)


def write_in_blocks(dataset: Any, name: str, path: Path) -> None:
    """Writes an xarray dataset as netCDF with a variable that is read block by block; Dask is not needed."""
    import h5netcdf  # noqa: PLC0415

    samples = dataset.variables[name]
    dataset.drop_vars(name).to_netcdf(path, engine="h5netcdf")
    with h5netcdf.File(path, "a") as file:
        for dim in samples.sizes.keys() - file.dimensions.keys():
            file.dimensions[dim] = samples.sizes[dim]
        written = file.create_variable(name, samples.dims, samples.dtype)
        written.attrs.update(samples.attrs)
        for which, block in over_blocks(samples, lambda block, which: (which, block)):
            written[which] = block


def extreme_samples(samples: Any, may_miss: bool = False, of_taxels: bool = True) -> NDArray[Any]:
    """Lowest and highest sample of each tap and taxel, shape (N, 2, K), or of each tap, shape (N, 2).

    Args:
        samples: Shape (N, J, K).
        may_miss: Whether samples that are NaN do not count; NaN where there is no other. Else they are the lowest and
            the highest.
        of_taxels: Whether those of each taxel are wanted, which takes several times as long.
    """
    extremes = (np.fmin, np.fmax) if may_miss else (np.minimum, np.maximum)

    def of(block: NDArray[Any], _: slice) -> NDArray[Any]:
        with np.errstate(invalid="ignore"):
            ends = [_folded(each, block) if of_taxels else each.reduce(block, axis=(1, 2)) for each in extremes]
        return np.stack(ends, axis=1)

    return np.concatenate(list(over_blocks(samples, of)))


def _folded(extreme: np.ufunc, block: NDArray[Any]) -> NDArray[Any]:
    """Minimum or maximum over the second of three axes, one by one, as NumPy is slow where the last one is short."""
    found = block[:, 0].copy()
    for j in range(1, block.shape[1]):
        extreme(found, block[:, j], out=found)
    return found


def tap_digests(taps: Any) -> NDArray[np.uint64]:
    """Digest of each tap (N, J, K), equal for equal values in single or double precision, shape (N,)."""

    def of(block: NDArray[Any], _: slice) -> bytes:
        return b"".join(
            hashlib.blake2b(np.ascontiguousarray(tap, np.float64), digest_size=_BYTES).digest() for tap in block
        )

    return np.frombuffer(b"".join(over_blocks(taps, of)), dtype="<u8").astype(np.uint64)
