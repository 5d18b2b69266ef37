"""Writers of every file kind that can be imported, as another laboratory's software would write them."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from solidtouch.models.measurement.registry import measurement_model
from solidtouch.models.measurement.story import ParametricModel
from solidtouch.models.taps import TapSet


def as_arrays(taps: TapSet) -> dict[str, Any]:
    """The documented array layout of a tap set."""
    data = taps.dataset
    arrays = {
        "taps": taps.taps,
        "what": taps.what.astype(np.int32),
        "what_names": np.array(taps.what_name),
        "where": np.searchsorted(data["where_value"].values, taps.where).astype(np.int32),
        "where_values": data["where_value"].values,
        "where_unit": np.array(taps.where_unit),
        "session": taps.session.astype(np.int32),
        "trial": taps.trial.astype(np.int32),
        "meta": np.array(json.dumps({"sensor": data.attrs["sensor"], "rate_hz": taps.preprocessing.rate_hz})),
    }
    arrays |= {str(name): values.values for name, values in data.data_vars.items() if name != "taps"}
    if "what_value" in data.coords:
        arrays |= {"what_values": data["what_value"].values, "what_unit": np.array(data["what_value"].attrs["units"])}
    return arrays


def write_npz(taps: TapSet, path: Path) -> None:
    np.savez(path, **as_arrays(taps))


def write_mat5(taps: TapSet, path: Path) -> None:
    arrays = as_arrays(taps)
    arrays["what_names"] = np.array(taps.what_name, dtype=object)
    texts = {name: str(arrays[name]) for name in ("where_unit", "meta", "what_unit") if name in arrays}
    savemat(path, arrays | texts, oned_as="column")


def write_mat73(taps: TapSet, path: Path) -> None:
    """HDF5 as MATLAB writes it: reversed axes, nothing below two axes, text as UTF-16 codes, cells by reference."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in as_arrays(taps).items():
            if name == "what_names":
                cells = [_put(file, f"#refs#/{i}", str(text)) for i, text in enumerate(values)]
                node = file.create_dataset(name, data=np.array([[cell.ref for cell in cells]], dtype=h5py.ref_dtype))
                node.attrs["MATLAB_class"] = np.bytes_("cell")
            else:
                _put(file, name, str(values) if values.dtype.kind == "U" else values)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512, b" "))


def _put(file: h5py.File, name: str, value: Any) -> h5py.Dataset:
    if isinstance(value, str):
        node = file.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), dtype="<u2").reshape(-1, 1))
        node.attrs["MATLAB_class"] = np.bytes_("char")
        return node
    value = np.asarray(value)
    value = value.reshape(-1, 1) if value.ndim == 1 else value
    node = file.create_dataset(name, data=value.T)
    node.attrs["MATLAB_class"] = np.bytes_("double")
    return node


def csv_table(taps: TapSet) -> list[dict[str, Any]]:
    """One dictionary per sample."""
    rate = taps.preprocessing.rate_hz
    extra = {str(n): v.values for n, v in taps.dataset.data_vars.items() if n != "taps" and v.ndim == 1}
    size = taps.dataset["what_value"].values if "what_value" in taps.dataset.coords else None
    return [
        {
            "tap": n,
            "what": taps.what_name[taps.what[n]],
            "where": repr(float(taps.where[n])),
            "session": taps.session[n],
            "trial": taps.trial[n],
            **({} if rate is None else {"time_s": j / rate}),
            **({} if size is None else {"what_value": size[taps.what[n]]}),
            **{name: values[n] for name, values in extra.items()},
            **{f"taxel_{k}": repr(float(value)) for k, value in enumerate(frame)},
        }
        for n, tap in enumerate(taps.taps)
        for j, frame in enumerate(tap)
    ]


def write_table(rows: list[dict[str, Any]], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


@pytest.fixture(scope="session")
def arrays_of() -> Callable[[TapSet], dict[str, Any]]:
    return as_arrays


@pytest.fixture(scope="session")
def table_of() -> Callable[[TapSet], list[dict[str, Any]]]:
    return csv_table


@pytest.fixture(scope="session")
def put_table() -> Callable[[list[dict[str, Any]], Path], None]:
    return write_table


@pytest.fixture(scope="session")
def writers() -> dict[str, tuple[str, Callable[[TapSet, Path], None]]]:
    """Name of the kind: suffix and writer."""
    return {
        "nc": (".nc", lambda taps, path: taps.save(path)),
        "zarr": (".zarr", lambda taps, path: taps.dataset.to_zarr(path, consolidated=False)),
        "npz": (".npz", write_npz),
        "mat5": (".mat", write_mat5),
        "mat73": (".mat", write_mat73),
        "csv": (".csv", lambda taps, path: write_table(csv_table(taps), path)),
    }


@pytest.fixture(scope="session")
def as_student() -> Callable[[ParametricModel], ParametricModel]:
    """A function that makes a `student` of a `gaussian` without a fit, which takes long."""

    def make(gaussian: ParametricModel) -> ParametricModel:
        level, variance = gaussian.parameters["level"], gaussian.parameters["variance"]
        freedom = np.geomspace(2.5, 30.0, gaussian.K)
        parameters = {"level": level, "scale": variance**0.5, "freedom": freedom}
        return replace(gaussian, story=measurement_model("student"), parameters=parameters)

    return make
