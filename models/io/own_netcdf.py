"""Quick reading of netCDF files that this software has written.

xarray and h5netcdf ask HDF5 anew for each size and name, hundreds of times for a small model, so that opening one takes
ten times as long. Files whose bytes are known to be as they were written need none of their checks.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import h5py
    import xarray as xr

_BARE_DIMENSION = b"This is a netCDF dimension but not a netCDF variable."
_STRUCTURE = {"CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_NCProperties"}


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
