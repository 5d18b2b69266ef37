"""Groups, arrays and attributes of HDF5 files: which are in the file itself, and what their types mean."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from .contents import Several

OTHER_FILE = "it is not in this file, but in another one or nowhere; convert that one, or copy it into this one"
_MACHINERY = {
    *("CLASS", "NAME", "VERSION", "TITLE", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"),
    *("_Netcdf4Dimid", "_Netcdf4Coordinates", "_nc3_strict", "_NCProperties", "_FillValue", "missing_value"),
    *("scale_factor", "add_offset", "units", "unit", "Units", "Unit", "_Unsigned", "_ARRAY_DIMENSIONS", "_Encoding"),
}
_MOST_LISTED = 100


def inside(group: Any, name: str) -> Any:
    """What a link leads to, `None` if that is not in the same file."""
    import h5py  # noqa: PLC0415

    if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
        return None
    try:
        return group[name]
    except KeyError:
        return None


def is_elsewhere(array: Any) -> bool:
    """Whether the numbers of an array are in another file."""
    if array.external:
        return True
    return array.is_virtual and any(each.file_name != "." for each in array.virtual_sources())


def arrays_in(file: Any) -> Iterator[tuple[str, Any]]:
    """Arrays of a file, and groups, each once, by their path; `None` for what is in another file."""
    import h5py  # noqa: PLC0415

    seen = {file["/"]}

    def walk(group: Any, prefix: str) -> Iterator[tuple[str, Any]]:
        for name in group:
            path = f"{prefix}{name}"
            node = inside(group, name)
            if node is not None and isinstance(node, h5py.Group):
                if node in seen:
                    continue
                seen.add(node)
                yield path, node
                yield from walk(node, f"{path}/")
            elif node is None or isinstance(node, h5py.Dataset):
                yield path, node

    yield from walk(file, "")


def simple(value: Any) -> str | float | None:
    """An attribute as a text or a number; several joined by commas, `None` for what is neither."""
    if isinstance(value, bytes | str):
        return (value.decode("utf-8", "replace") if isinstance(value, bytes) else value).rstrip("\0")
    values = np.asarray(value)
    if values.dtype.kind not in "fiubSUOT" or values.size > _MOST_LISTED:
        return None
    parts = [part for each in values.reshape(-1).tolist() if isinstance(part := _plain(each), str | float)]
    if len(parts) != values.size:
        return None
    return parts[0] if len(parts) == 1 else Several(parts)


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | str):
        return simple(value)
    return float(value) if isinstance(value, int | float) else value


def attributes_of(attributes: Mapping[str, Any], prefix: str = "") -> dict[str, str | float]:
    """Texts and numbers among attributes, but for those that say how arrays are stored and for units."""
    found = {}
    for name in attributes:
        if name not in _MACHINERY and not name.startswith("MATLAB_"):
            try:
                value = simple(attributes[name])
            except Exception:  # noqa: S112 - of a type that h5py does not know
                continue
            if value is not None:
                found[f"{prefix}{name}"] = value
    return found


def unit_of(attributes: Mapping[str, Any]) -> str:
    """Unit that the attributes of an array state, or empty."""
    for name in ("units", "unit", "Units", "Unit"):
        if name in attributes and isinstance(value := simple(attributes[name]), str):
            return value
    return ""
