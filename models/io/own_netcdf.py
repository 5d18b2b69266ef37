"""Quick writing of netCDF files, and reading of those that this software has written.

xarray and h5netcdf ask HDF5 anew for each size and name, hundreds of times for a small model, so that either takes ten
times as long. Files whose bytes are known to be as they were written need none of their checks.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import h5py
    import xarray as xr

_BARE_DIMENSION = b"This is a netCDF dimension but not a netCDF variable."
_STRUCTURE = {"CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_NCProperties"}


def write_own(file: "h5py.File", tree: "xr.DataTree") -> None:
    """Writes the groups of a tree into a file that keeps the order of names, as xarray does; packs nothing."""
    import h5py  # noqa: PLC0415
    from xarray import conventions  # noqa: PLC0415

    file.attrs["_NCProperties"] = np.bytes_(f"version=2,hdf5={h5py.version.hdf5_version},h5py={h5py.__version__}")
    scales: dict[str, dict[Any, Any]] = {}
    n = 0
    for node in tree.subtree:
        group: Any = file.require_group(node.path) if node is tree else file.create_group(node.path, track_order=True)
        held = conventions.encode_dataset_coordinates(node.to_dataset(inherit=node is tree))
        variables, attributes = conventions.cf_encoder(*held)
        sizes = dict(size for variable in variables.values() for size in variable.sizes.items())
        _write_attributes(group, attributes)
        known = scales[node.path] = {} if node is tree else dict(scales[node.path.rpartition("/")[0] or "/"])
        items = {name: _written(group, name, variable) for name, variable in variables.items()}
        for dimension, size in sizes.items():
            if dimension not in items and dimension in known and known[dimension].size == size:
                continue
            scale = items.get(dimension)
            if scale is None:
                scale = group.create_dataset(dimension, (size,), ">f4", maxshape=(size or None,))
                scale.make_scale(_BARE_DIMENSION + b"%10d" % size)
            else:
                scale.make_scale(dimension)
            scale.attrs["_Netcdf4Dimid"] = np.int32(n)
            known[dimension] = scale
            n += 1
        for name, variable in variables.items():
            if name not in sizes:
                for axis, dimension in enumerate(variable.dims):
                    items[name].dims[axis].attach_scale(known[dimension])


def _written(group: Any, name: str, variable: "xr.Variable") -> Any:
    """A variable without its dimensions."""
    import h5py  # noqa: PLC0415

    values, attributes = variable.values, dict(variable.attrs)
    kind: Any = h5py.string_dtype() if values.dtype.kind in "OU" else values.dtype
    unlimited = {"maxshape": tuple(size or None for size in values.shape)} if not values.size else {}
    item = group.create_dataset(
        name,
        data=values.astype(object) if values.dtype.kind == "U" else values,
        dtype=kind,
        fillvalue=attributes.get("_FillValue"),
        track_order=True,
        **unlimited,
    )
    _write_attributes(item, attributes)
    return item


def _write_attributes(of: Any, attributes: Mapping[str, Any]) -> None:
    for name, value in attributes.items():
        of.attrs[name] = [value] if np.isscalar(value) and not isinstance(value, str) else value


def size_of(file: "h5py.File") -> int:
    """Bytes of all arrays in a file, unpacked."""
    sizes: list[int] = []
    file.visititems(lambda _, item: sizes.append(getattr(item, "nbytes", 0)))
    return sum(sizes)


def read_own(file: "h5py.File", name: str) -> "xr.Dataset":
    """Variables and attributes of a group as xarray reads them, in memory; times stay numbers."""
    import h5py  # noqa: PLC0415
    import xarray as xr  # noqa: PLC0415

    group: Any = file[name]
    variables = {
        name: xr.Variable(_dimensions(name, item, file), _values(item), _attributes(item))
        for name, item in group.items()
        if isinstance(item, h5py.Dataset) and not item.attrs.get("NAME", b"").startswith(_BARE_DIMENSION)
    }
    return xr.decode_cf(xr.Dataset(variables, attrs=_attributes(group)), decode_times=False)


def _dimensions(name: str, item: Any, file: Any) -> tuple[str, ...]:
    if "DIMENSION_LIST" in item.attrs:
        return tuple(file[scale].name.rpartition("/")[2] for (scale,) in item.attrs["DIMENSION_LIST"])
    return (name,) * item.ndim


def _values(item: Any) -> Any:
    import h5py  # noqa: PLC0415

    return np.asarray(item.asstr()[()], str) if h5py.check_string_dtype(item.dtype) else item[()]


def _attributes(of: Any) -> dict[str, Any]:
    """Attributes for users, single numbers as scalars."""
    names = (name for name in of.attrs if name not in _STRUCTURE and not name.startswith("_Netcdf4"))
    read = {name: of.attrs[name] for name in names}
    return {name: value[0] if np.shape(value) == (1,) else value for name, value in read.items()}
