"""Labelled taps, the input of every command and the output of every rig.

A `TapSet` wraps one xarray dataset, so that recordings stay readable without this software:

==================  ==================  ===================================================================
name                dims                meaning
==================  ==================  ===================================================================
``taps``            tap, sample, taxel  preprocessed samples, attribute ``units`` if known
``what``            tap                 index into the table of objects
``where``           tap                 position of the tap, attribute ``units``
``session``         tap                 number of the recording session
``trial``           tap                 number of the tap within its session or class, as recorded
``time``            sample              seconds from the first sample of a tap (sample number without a rate)
``taxel_position``  taxel, axis         optional, millimetres
``what_name``       what_class          table of objects
``what_value``      what_class          optional size of each object, attribute ``units``
``where_value``     where_class         table of nominal positions
``where_edges``     where_edge          optional: class ``l`` covers ``[edge l, edge l + 1)``
``where_place``     where_class, plane  optional: x, y and perhaps an angle of positions that are numbered
==================  ==================  ===================================================================

Attributes: ``sensor``, ``source``, ``licence``, ``preprocessing`` (JSON), ``format``, and ``missing`` with the value
``drop`` where samples may be NaN, which models then leave out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from . import storage
from .blocks import (
    MovedSamples,
    ScaledSamples,
    extreme_samples,
    joined_samples,
    over_blocks,
    tap_digests,
    write_in_blocks,
)
from .errors import InputError, check_format, check_numbers, printable, printable_name
from .grid import ClassGrid, group, parse_length, values_from_names
from .io.untrusted import seal
from .preprocessing import Preprocessing
from .settings import Missing, check_missing
from .storage import check_netcdf_name, check_writable, complete_file, read_groups, read_zarr, room_for, write_netcdf
from .tap_checks import RESERVED, check_shapes, check_values

FORMAT = 1
RIG_UNIT = "counts"
"""Unit of the samples of rigs, simulated ones included."""
_ROUNDING = 1e-6  # in cells
_MOST_CELLS = 1e6


@dataclass(frozen=True, eq=False)
class TapSet:
    """Labelled taps on xarray; variables are listed at the head of this file.

    >>> samples = np.arange(24.0).reshape(4, 3, 2)  # 4 taps of 3 samples from 2 taxels
    >>> taps = TapSet.from_arrays(samples, [0, 0, 1, 1], ["ball", "rod"], preprocessing=Preprocessing(samples=3))
    >>> len(taps), taps.grid().shape, len(taps.select(taps.what == 1))
    (4, (1, 2), 2)

    Attributes:
        dataset: The labelled arrays; `taps` of a large file stay there until `taps` is asked for, see `blocks`.
        scanned: The `extremes` of a large recording, which is not read again for them.

    Raises:
        InputError: An array is missing, has the wrong shape, holds NaN or infinite values, or labels point
            outside their table. NaN samples are accepted where the attribute `missing` is `drop`.
    """

    dataset: xr.Dataset
    scanned: NDArray[Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        """Checks the dataset."""
        if not isinstance(self.dataset, xr.Dataset):
            raise InputError(f"A TapSet holds an xarray dataset, got {type(self.dataset).__name__}; see from_arrays.")
        check_shapes(self.dataset)
        if self.samples.nbytes > storage.ON_DISK:
            object.__setattr__(self, "scanned", self.extremes)
        ends = self.scanned
        if ends is None:
            ends = extreme_samples(self.samples, self.missing == "drop", of_taxels=False)
        check_values(self.dataset, ends)

    @classmethod
    def from_arrays(
        cls,
        taps: ArrayLike,
        what: ArrayLike,
        what_name: Sequence[str],
        *,
        preprocessing: Preprocessing,
        where: ArrayLike | None = None,
        where_value: ArrayLike | None = None,
        where_edges: ArrayLike | None = None,
        where_place: ArrayLike | None = None,
        where_unit: str = "",
        what_value: ArrayLike | None = None,
        what_unit: str = "",
        session: ArrayLike | None = None,
        trial: ArrayLike | None = None,
        taxel_position: ArrayLike | None = None,
        units: str = "",
        sensor: str = "",
        source: str = "",
        licence: str = "",
        extra: Mapping[str, ArrayLike] | None = None,
        missing: Missing = "refuse",
    ) -> Self:
        """Tap set from plain arrays.

        Args:
            taps: Preprocessed samples, shape (N, J, K); those of a mapped file (`numpy.memmap`) stay there.
            what: Object of each tap as an index into `what_name`, shape (N,).
            what_name: Names of the objects.
            preprocessing: Preprocessing of the samples.
            where: Position of each tap in `where_unit`, shape (N,); default: 0 for all.
            where_value: Nominal positions, increasing; default: the distinct values of `where`.
            where_edges: Edges of the position classes, one more than `where_value`.
            where_place: Places in a plane that `where_value` numbers, x and y in `where_unit` and perhaps an angle,
                shape (len(where_value), 2) or (len(where_value), 3).
            where_unit: Unit of the positions.
            what_value: Size of each object, shape (len(what_name),).
            what_unit: Unit of the sizes.
            session: Recording session of each tap, shape (N,); default: 0 for all.
            trial: Number of each tap in its session, shape (N,); default: the order given.
            taxel_position: Position of each taxel in mm, shape (K, 2) or (K, 3).
            units: Unit of the samples.
            sensor: Name of the sensor.
            source: Origin of the data.
            licence: Licence of the data.
            extra: Further arrays whose first axis is the tap and whose second, if any, the taxel.
            missing: What to do with samples that are NaN: `"refuse"` them, or `"drop"` to accept them and leave them
                out of the fit and the likelihood.

        Raises:
            InputError: As the class.
        """
        mapped = isinstance(taps, np.memmap)
        taps = check_numbers(taps, "taps")
        if taps.ndim != 3:
            raise InputError(f"taps must have three axes (tap, sample, taxel), got shape {taps.shape}.")
        n = len(taps)
        if not isinstance(preprocessing, Preprocessing):
            raise InputError(f"preprocessing must be a Preprocessing record, got {type(preprocessing).__name__}.")
        where = np.zeros(n) if where is None else check_numbers(where, "where").astype(np.float64)
        where_value = np.unique(where) if where_value is None else check_numbers(where_value, "where_value")
        rate = preprocessing.rate_hz
        coords: dict[str, Any] = {
            "what": ("tap", np.asarray(what)),
            "where": ("tap", where, {"units": where_unit}),
            "session": ("tap", np.zeros(n, dtype=np.int64) if session is None else np.asarray(session)),
            "trial": ("tap", np.arange(n) if trial is None else np.asarray(trial)),
            "time": (
                "sample",
                np.arange(taps.shape[1]) / (rate or 1.0),
                {"units": "sample" if rate is None else "s"},
            ),
            "what_name": ("what_class", np.asarray(what_name, dtype=np.str_)),
            "where_value": ("where_class", where_value.astype(np.float64), {"units": where_unit}),
        }
        if what_value is not None:
            coords["what_value"] = (
                "what_class",
                check_numbers(what_value, "what_value").astype(np.float64),
                {"units": what_unit},
            )
        if where_edges is not None:
            coords["where_edges"] = (
                "where_edge",
                check_numbers(where_edges, "where_edges").astype(np.float64),
                {"units": where_unit},
            )
        if where_place is not None:
            place = check_numbers(where_place, "where_place").astype(np.float64)
            coords["where_place"] = (("where_class", "plane"), place, {"units": where_unit})
        if taxel_position is not None:
            coords["taxel_position"] = (
                ("taxel", "axis"),
                np.asarray(taxel_position, dtype=np.float64),
                {"units": "mm"},
            )
        variables: dict[str, Any] = {"taps": (("tap", "sample", "taxel"), taps, {"units": units})}
        for name, values in (extra or {}).items():
            if name in RESERVED:
                raise InputError(f"array {name} must be renamed: the name is reserved in a tap set.")
            variables[name] = (("tap", "taxel")[: np.ndim(values)], np.asarray(values))
        attributes = {
            "sensor": sensor,
            "source": source,
            "licence": licence,
            "preprocessing": preprocessing.to_json(),
            "format": FORMAT,
            **_marked(missing),
        }
        for name, (dims, values, *_) in {**coords, **variables}.items():
            axes = 1 if isinstance(dims, str) else len(dims)
            if np.ndim(values) != axes:
                raise InputError(f"{name} must have {axes} axes, got shape {np.shape(values)}.")
        try:
            dataset = xr.Dataset(variables, coords, attributes)
            return cls(dataset.assign(taps=joined_samples([dataset.variables["taps"]])) if mapped else dataset)
        except ValueError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"The arrays of this tap set do not match: {error}.") from error

    @property
    def samples(self) -> xr.Variable:
        """Samples in memory or on disk, shape (N, J, K), to be worked on by `blocks.over_blocks`."""
        return self.dataset.variables["taps"]

    @property
    def taps(self) -> NDArray[np.floating]:
        """Samples in memory, shape (N, J, K); those on disk are read and stay in memory."""
        return self.samples.load().values

    @property
    def doubles(self) -> Any:
        """Samples in double precision, shape (N, J, K); made block by block if the recording is large."""
        return self.taps.astype(np.float64) if self.scanned is None else ScaledSamples(self.samples)

    @property
    def lacking(self) -> NDArray[np.intp]:
        """Number of missing samples of each tap and taxel, shape (N, K)."""
        if self.missing == "refuse":
            return np.zeros((len(self), self.samples.shape[2]), np.intp)
        return np.concatenate(list(over_blocks(self.samples, lambda block, _: np.isnan(block).sum(axis=1))))

    @property
    def extremes(self) -> NDArray[Any]:
        """Lowest and highest sample of each tap and taxel, shape (N, 2, K), NaN where all are missing."""
        return extreme_samples(self.samples, self.missing == "drop") if self.scanned is None else self.scanned

    @cached_property
    def digests(self) -> NDArray[np.uint64]:
        """Digest of each tap, see `blocks.tap_digests`, shape (N,)."""
        return tap_digests(self.samples)

    @property
    def what(self) -> NDArray[np.int64]:
        """Index of each tap's object in `what_name`, shape (N,)."""
        return self.dataset["what"].values

    @property
    def where(self) -> NDArray[np.float64]:
        """Position of each tap in `where_unit`, shape (N,)."""
        return self.dataset["where"].values

    @property
    def session(self) -> NDArray[np.int64]:
        """Recording session of each tap, shape (N,)."""
        return self.dataset["session"].values

    @property
    def trial(self) -> NDArray[np.int64]:
        """Number of each tap as recorded, shape (N,)."""
        return self.dataset["trial"].values

    @property
    def units(self) -> str:
        """Unit of the samples; empty if it is not known."""
        return printable(str(self.dataset["taps"].attrs.get("units", "")))

    @property
    def taxel_mm(self) -> NDArray[np.float64] | None:
        """Places of the taxels in mm, shape (K, 2) or (K, 3), or `None` if they are not known."""
        places = self.dataset.get("taxel_position")
        return None if places is None else places.values

    @property
    def what_name(self) -> list[str]:
        """Names of the objects."""
        return [printable_name(name) for name in self.dataset["what_name"].values]

    @property
    def where_unit(self) -> str:
        """Unit of the positions."""
        return printable(str(self.dataset["where"].attrs.get("units", "")))

    @cached_property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the samples."""
        return Preprocessing.from_json(self.dataset.attrs["preprocessing"])

    @property
    def missing(self) -> Missing:
        """Whether samples that are NaN are to be dropped; else there are none."""
        return "drop" if self.dataset.attrs.get("missing") == "drop" else "refuse"

    @property
    def tap_shape(self) -> tuple[int, int]:
        """Numbers of samples and taxels of a tap, (J, K)."""
        return self.dataset.sizes["sample"], self.dataset.sizes["taxel"]

    @property
    def simulated(self) -> bool:
        """Whether the taps come from a simulated rig."""
        return self.source.startswith("simulated")

    @property
    def source(self) -> str:
        """Origin of the data; of several sessions that of the first."""
        return str(self.dataset.attrs.get("source", ""))

    def __len__(self) -> int:
        return self.dataset.sizes["tap"]

    def select(self, index: ArrayLike | slice) -> Self:
        """Taps at these indices, in this slice or where this mask is True, with the same tables.

        Raises:
            InputError: No tap is selected, or there is none at an index.
        """
        index = np.arange(len(self))[index] if isinstance(index, slice) else np.asarray(index)
        if index.dtype == bool and index.shape != (len(self),):
            raise InputError(f"A mask of {len(self)} taps must have shape ({len(self)},), got {index.shape}.")
        if index.dtype == bool or not index.size:
            index = np.flatnonzero(index)
        if index.dtype.kind not in "iu" or not ((-len(self) <= index) & (index < len(self))).all():
            raise InputError(f"Taps are selected by a mask or by indices from 0 to {len(self) - 1}.")
        return type(self)(self.dataset.isel(tap=index), None if self.scanned is None else self.scanned[index])

    def moved(self, gain: NDArray[np.float64], offset: NDArray[np.float64]) -> Self:
        """The same taps, each multiplied by a gain and then shifted by an offset, both of shape (N,)."""
        samples = MovedSamples(self.samples, gain, offset)
        if self.scanned is None:
            return type(self)(self.dataset.assign(taps=samples.variable(self.samples).load()))
        return type(self)(
            self.dataset.assign(taps=samples.variable(self.samples)),
            self.scanned * gain[:, None, None] + offset[:, None, None],
        )

    def grid(self, where_cell: str | None = None, what_cell: str | None = None) -> ClassGrid:
        """Class grid of the tables, optionally grouped into cells, or with finer positions.

        Args:
            where_cell: Width of the position classes with unit, such as `"3mm"`; `None` for those of the table. Cells
                narrower than the classes of a table with edges divide its whole range equally.
            what_cell: Width of the object classes; needs object sizes, or names that contain them (`"rod 4 mm"`).

        Raises:
            InputError: A width cannot be parsed or converted, finer cells do not divide the range or have no taps, or
                objects have no sizes.
        """
        where_value = self.dataset["where_value"].values
        edges = self.dataset["where_edges"].values if "where_edges" in self.dataset.coords else None
        if where_cell is not None and "where_place" in self.dataset.coords:
            raise InputError("where_cell (--where-cell) divides positions on a line; these are places in a plane.")
        if where_cell is not None:
            width = parse_length(where_cell, self.where_unit, "where_cell (--where-cell)")
            if edges is not None and width < (1 - _ROUNDING) * np.diff(edges).min():
                edges = self._finer(edges, width, where_cell)
                where_value = (edges[:-1] + edges[1:]) / 2
            else:
                edges, where_value = _coarser(where_value, edges, width, where_cell)
        names = self.what_name
        what_value, what_unit = self._what_values()
        members = tuple((name,) for name in names)
        if what_cell is not None:
            spelled = values_from_names(names) if what_value is None else (what_value, what_unit)
            if spelled is None:
                raise InputError("what_cell (--what-cell) needs objects with sizes, but these have none.")
            sizes, what_unit = spelled
            cells = group(sizes, parse_length(what_cell, what_unit, "what_cell (--what-cell)"))
            kept = [np.flatnonzero(cells == cell) for cell in np.unique(cells)]
            members = tuple(tuple(names[i] for i in cell[np.argsort(sizes[cell])]) for cell in kept)
            what_value = np.array([sizes[cell].mean() for cell in kept])
        return ClassGrid(
            where_value,
            self.where_unit,
            edges,
            members,
            what_value,
            what_unit if what_value is not None else "",
            self.dataset["where_place"].values if "where_place" in self.dataset.coords else None,
        )

    def _finer(self, edges: NDArray[np.float64], width: float, where_cell: str) -> NDArray[np.float64]:
        """Edges of equal cells across the range; each inside tapped classes must have a tap."""
        length = float(edges[-1] - edges[0])
        if not length / width < _MOST_CELLS:
            raise InputError(
                f"where_cell (--where-cell) {where_cell} is too narrow for a range of {length:g} {self.where_unit}."
            )
        cells = round(length / width)
        if abs(length / width - cells) > _ROUNDING * cells:
            raise InputError(
                f"where_cell (--where-cell) {where_cell} does not divide the range of {length:g} {self.where_unit} "
                "into equal cells."
            )
        finer = np.linspace(edges[0], edges[-1], cells + 1)
        place = self.where + _ROUNDING * width
        held = np.unique(np.searchsorted(edges, place, side="right") - 1)
        filled = np.searchsorted(finer, place, side="right") - 1
        centre = np.searchsorted(edges, (finer[:-1] + finer[1:]) / 2, side="right") - 1
        wanting = np.setdiff1d(np.flatnonzero(np.isin(centre, held)), filled)
        if len(wanting):
            raise InputError(
                f"where_cell (--where-cell) {where_cell} leaves {len(wanting)} of {cells} cells without a tap: the "
                f"taps have {len(np.unique(self.where))} positions."
            )
        return finer

    def _what_values(self) -> tuple[NDArray[np.float64] | None, str]:
        if "what_value" not in self.dataset.coords:
            return None, ""
        values = self.dataset["what_value"]
        return values.values, printable(str(values.attrs.get("units", "")))

    def indices(self, grid: ClassGrid) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Position and object index of each tap in `grid`, -1 if outside; two arrays of shape (N,)."""
        return grid.where_index(self.where), grid.what_index(self.what_name)[self.what]

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes the tap set as netCDF, atomically; the name must end in `.nc`.

        Raises:
            InputError: The file has another ending, cannot be written, or exists and `force` is not set.
        """
        check_netcdf_name(check_writable(path, force))
        with complete_file(path, force, room_for(self.dataset)) as temporary:
            if self.samples.nbytes > storage.ON_DISK:
                write_in_blocks(self.dataset, "taps", temporary)
            else:
                write_netcdf(self.dataset, temporary)
                seal(temporary)

    @classmethod
    def load(cls, path: str | Path, missing: Missing = "refuse") -> Self:
        """Tap set from a netCDF file, or from a Zarr store of its `dataset`, whose name ends in `.zarr`.

        Args:
            path: The file or store.
            missing: As in `from_arrays`.

        Raises:
            InputError: The file is missing, damaged or not a tap set.
        """
        zarr = Path(path).suffix.lower() == ".zarr"
        dataset = read_zarr(path, "taps") if zarr else read_groups(path, "/", on_disk="taps")["/"]
        if "taps" in dataset and "kind" not in dataset.attrs:
            check_format(dataset.attrs.get("format"), f"{path}: a tap set", FORMAT)
        if dataset.attrs.get("format") != FORMAT or "taps" not in dataset:
            other = ", but a fitted model" if "kind" in dataset.attrs else ""
            raise InputError(f"{path}: not a tap set of format {FORMAT}{other}.")
        try:
            dataset.attrs.pop("missing", None)  # whoever reads the file decides
            return cls(dataset.assign_attrs(_marked(missing)))
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def concatenate(parts: Sequence[TapSet], names: Sequence[str] | None = None) -> TapSet:
    """One tap set from several with the same objects and preprocessing, with all their positions.

    Samples may be missing in it if they may in one of them.

    Args:
        parts: The tap sets; other tables than that of positions are those of the first.
        names: Their names for messages.

    Raises:
        InputError: There is none, or they are incompatible.
    """
    if not parts:
        raise InputError("There are no taps.")
    check_alike(parts, [f"part {i}" for i in range(1, len(parts) + 1)] if names is None else names)
    parts = with_all_places(parts)
    large = any(part.scanned is not None for part in parts)
    datasets = [part.dataset.drop_vars("taps") if large else part.dataset for part in parts]
    dataset = xr.concat(datasets, dim="tap", data_vars="minimal", coords="minimal", compat="override")
    dataset = dataset.assign_attrs(_marked("drop" if any(part.missing == "drop" for part in parts) else "refuse"))
    if not large:
        return TapSet(dataset)
    dataset = dataset.assign(taps=joined_samples([part.samples for part in parts]))
    return TapSet(dataset, np.concatenate([part.extremes for part in parts]))


def check_compatible(train: TapSet, test: TapSet, train_name: str = "TRAIN", test_name: str = "TEST") -> None:
    """Checks that a model of one tap set can be tested on another.

    Raises:
        InputError: They differ in taxels, unit of position or preprocessing.
    """
    taxels = train.dataset.sizes["taxel"], test.dataset.sizes["taxel"]
    if taxels[0] != taxels[1]:
        raise InputError(f"{train_name} has {taxels[0]} taxels and {test_name} has {taxels[1]}.")
    if train.where_unit != test.where_unit:
        raise InputError(f"{train_name} has positions in {train.where_unit!r}, {test_name} in {test.where_unit!r}.")
    differences = train.preprocessing.differences(test.preprocessing)
    if differences:
        raise InputError(
            f"{train_name} and {test_name} differ in preprocessing: {'; '.join(differences)}."
            f"{train.preprocessing.advice(test.preprocessing)}"
        )


def check_alike(taps: Sequence[TapSet], names: Sequence[str]) -> None:
    """Checks that tap sets can be sessions of one recording.

    Raises:
        InputError: They differ in objects, taxels, unit of position or preprocessing; the message names both.
    """
    for other, name in zip(taps[1:], names[1:], strict=True):
        check_compatible(taps[0], other, names[0], name)
        if other.what_name != taps[0].what_name:
            raise InputError(f"{name}: objects differ from those of {names[0]}.")


def with_all_places(taps: Sequence[TapSet]) -> Sequence[TapSet]:
    """The tap sets; if their tables of positions differ, with the union of the positions and without edges."""
    tables = [part.dataset["where_value"] for part in taps]
    places = [part.dataset.get("where_place") for part in taps]
    if any(place is not None for place in places):
        return _with_all_in_plane(taps, places)
    if all(table.equals(tables[0]) for table in tables):
        return taps
    every = np.unique(np.concatenate([table.values for table in tables]))
    column = ("where_class", every, tables[0].attrs)
    places = ("where_value", "where_edges")
    plain = (part.dataset.drop_vars(places, errors="ignore").assign_coords(where_value=column) for part in taps)
    return [TapSet(dataset, part.scanned) for dataset, part in zip(plain, taps, strict=True)]


def in_plane(places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Different places in the order of their numbers, shape (L, D), and the number of each place given, shape (n,).

    They are numbered to and fro, by x, then by y and then by angle, so that neighbours in number are neighbours in a
    full grid: y rises along the first x, falls along the next one, and so on, and the angle likewise.

    >>> in_plane(np.array([[0.0, 0.0], [0.0, 1.0], [2.0, 0.0], [2.0, 1.0]]))[1].tolist()
    [0, 1, 3, 2]

    Args:
        places: x, y and perhaps an angle, shape (n, D).
    """
    different, of = np.unique(places, axis=0, return_inverse=True)
    number = np.zeros(len(different), dtype=np.intp)
    for column in different.T:
        values, rank = np.unique(column, return_inverse=True)
        number = number * len(values) + np.where(number % 2, len(values) - 1 - rank, rank)
    order = np.argsort(number)
    return different[order], np.argsort(order)[of.reshape(-1)]


def _with_all_in_plane(taps: Sequence[TapSet], places: Sequence[xr.DataArray | None]) -> Sequence[TapSet]:
    """The tap sets with the union of their places in a plane, numbered anew."""
    if any(place is None or place.shape[1] != places[0].shape[1] for place in places):  # pyright: ignore
        raise InputError("Some positions are places in a plane and others are not, or only some have an angle.")
    known: list[xr.DataArray] = [place for place in places if place is not None]
    if all(place.equals(known[0]) for place in known):
        return taps
    every, number = in_plane(np.concatenate([place.values for place in known]))
    numbers = np.split(number, np.cumsum([len(place) for place in known])[:-1])
    coords = {
        "where_value": ("where_class", np.arange(len(every), dtype=np.float64), taps[0].dataset["where_value"].attrs),
        "where_place": (("where_class", "plane"), every, known[0].attrs),
    }
    found = []
    for part, of in zip(taps, numbers, strict=True):
        where = of[np.searchsorted(part.dataset["where_value"].values, part.where)].astype(np.float64)
        dataset = part.dataset.drop_vars(("where_value", "where_place"))
        column = ("tap", where, part.dataset["where"].attrs)
        found.append(TapSet(dataset.assign_coords(where=column, **coords), part.scanned))
    return found


def _coarser(
    where_value: NDArray[np.float64], edges: NDArray[np.float64] | None, width: float, where_cell: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Edges and values of the cells that group the positions of a table."""
    start = float(where_value.min()) if edges is None else float(edges[0])
    cells = group(where_value, width, start)
    if cells.max() >= len(where_value):
        raise InputError(f"where_cell (--where-cell) {where_cell} leaves a cell without a position.")
    groups = [where_value[cells == cell] for cell in range(cells.max() + 1)]
    if not all(len(members) for members in groups):
        raise InputError(f"where_cell (--where-cell) {where_cell} leaves a cell without a position.")
    values = np.array([members.mean() for members in groups])
    return start + width * np.arange(len(groups) + 1, dtype=np.float64), values


def _marked(missing: Missing) -> dict[str, str]:
    """Attribute of a dataset whose samples may be missing."""
    check_missing(missing)
    return {"missing": missing} if missing == "drop" else {}
