"""The same arrays are read from whichever format they are kept in, in any order and in parts."""

from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as of_numpy
from scipy.io import netcdf_file, savemat
from slow_cases import slow_but
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io import untrusted
from solidtouch.models.io.layouts.formats import named_arrays, numpy_files
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.hdf5 import open_hdf5, open_netcdf
from solidtouch.models.io.layouts.formats.matlab import open_mat
from solidtouch.models.io.layouts.formats.numpy_files import open_npy, open_npz
from solidtouch.models.io.layouts.formats.zarr_store import open_zarr
from workspaces import NAMES, TEXTS, same, write_v5, write_v73


def write_hdf5(path, arrays):
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            if values.dtype.kind == "U":
                file.create_dataset(name, data=values.astype(object), dtype=h5py.string_dtype())
            else:
                file[name] = values


def write_zarr(version):
    def write(path, arrays):
        group = zarr.open_group(path, mode="w", zarr_format=version)
        for name, values in arrays.items():
            group.create_array(name, data=values, chunks=tuple(-(-n // 2) or 1 for n in values.shape))

    return write


def texts_as_cells(write):
    """As MATLAB has no arrays of texts."""

    def written(path, arrays):
        kinds = {name: getattr(values, "dtype", np.dtype("O")).kind for name, values in arrays.items()}
        write(path, {name: values.tolist() if kinds[name] == "U" else values for name, values in arrays.items()})

    return written


FORMATS = {
    "npz": ("a.npz", lambda path, arrays: np.savez(path, **arrays), open_npz),
    "npz packed": ("a.npz", lambda path, arrays: np.savez_compressed(path, **arrays), open_npz),
    "hdf5": ("a.h5", write_hdf5, open_hdf5),
    "zarr 2": ("a.zarr", write_zarr(2), open_zarr),
    "zarr 3": ("a.zarr", write_zarr(3), open_zarr),
    "mat 5": ("a.mat", texts_as_cells(write_v5), open_mat),
    "mat 7.3": ("a.mat", texts_as_cells(write_v73), open_mat),
}
KINDS = st.sampled_from(["f8", "f4", "i1", "u2", "i4", ">i8", "?"])
SHAPES = of_numpy.array_shapes(min_dims=1, max_dims=3, min_side=2, max_side=4)
ARRAYS = st.dictionaries(
    NAMES,
    of_numpy.arrays(KINDS, SHAPES) | st.lists(TEXTS, min_size=2, max_size=4).map(np.array),
    min_size=1,
    max_size=5,
)


ONCE = ["npz", "hdf5", "zarr 3", "mat 5"]


@pytest.mark.parametrize(
    ("name", "write", "open_file"), slow_but([FORMATS[kind] for kind in ONCE], FORMATS.values()), ids=FORMATS
)
@given(arrays=ARRAYS, data=st.data())
@settings(max_examples=15)
def test_arrays_come_through(name, write, open_file, arrays, data):
    order = data.draw(st.lists(st.sampled_from(sorted(arrays)), unique=True))
    with TemporaryDirectory() as folder:
        write(Path(folder, name), arrays)
        contents = open_file(Path(folder, name), TextTable())
        whole, part = (contents.read(names)[0] for names in (list(arrays), order))

    assert contents.variables.keys() == arrays.keys()
    assert not contents.unreadable
    assert list(part) == order
    for key, values in arrays.items():
        wanted = np.asarray(values)
        assert same(whole[key], wanted)
        assert key not in part or same(part[key], wanted)
        assert contents.variables[key].shape == wanted.shape
        assert contents.variables[key].dtype.kind == whole[key].dtype.kind == wanted.dtype.kind


@pytest.fixture(params=FORMATS.values(), ids=FORMATS)
def saved(request, tmp_path):
    """From arrays to their file, opened."""
    name, write, open_file = request.param

    def made(**arrays):
        write(tmp_path / name, arrays)
        return open_file(tmp_path / name, TextTable())

    return made


@pytest.mark.parametrize("limit", [storage.ON_DISK, 1000], ids=["in memory", "on disk"])
def test_columns_stand_side_by_side(limit, saved, monkeypatch):
    time, force = np.arange(500.0) / 100, np.arange(500, dtype=np.int16)
    contents = saved(time=time, force=force, other=np.ones((3, 2)))
    monkeypatch.setattr(storage, "ON_DISK", limit)
    monkeypatch.setattr(named_arrays, "BLOCK", 1600)
    values, columns = contents.read(["time"], ["force", "time", "force"])

    assert list(values) == ["time"]
    assert columns.dtype == np.float64
    assert isinstance(columns, np.memmap) == (limit == 1000)
    np.testing.assert_array_equal(columns, np.stack([force, time, force], axis=1))
    assert contents.read(["time"])[1] is None


def test_what_is_no_column_is_refused(saved):
    texts = np.array(["a", "b", "c"])
    contents = saved(x=np.arange(3.0), y=np.arange(4.0), table=np.ones((3, 2)), names=texts)
    with pytest.raises(InputError, match="columns differ in length: x has 3 rows, y 4"):
        contents.read([], ["x", "y"])
    with pytest.raises(InputError, match=r"array table has shape \(3, 2\); a column has one axis"):
        contents.read([], ["table"])
    with pytest.raises(InputError, match="array names holds texts, not numbers"):
        contents.read([], ["names"])
    with pytest.raises(InputError, match="no array z; the file holds: "):
        contents.read(["z"])


def test_large_arrays_stay_on_disk(saved, monkeypatch):
    wanted = np.arange(6000.0).reshape(20, 30, 10)
    contents = saved(taps=wanted)
    monkeypatch.setattr(storage, "ON_DISK", 1000)
    for module in (named_arrays, numpy_files):
        monkeypatch.setattr(module, "BLOCK", 3000)
    found = contents.read(["taps"])[0]["taps"]

    assert isinstance(found, np.memmap)
    np.testing.assert_array_equal(found, wanted)


PACKED = {
    "npz": ("a.npz", lambda path, x: np.savez_compressed(path, x=x), open_npz),
    "hdf5": ("a.h5", lambda path, x: h5py.File(path, "w").create_dataset("x", data=x, compression="gzip"), open_hdf5),
    "zarr": ("a.zarr", lambda path, x: zarr.open_group(path, mode="w").create_array("x", data=x), open_zarr),
}


@pytest.mark.parametrize(("name", "write", "open_file"), PACKED.values(), ids=PACKED)
def test_what_unpacks_to_too_much_is_refused(name, write, open_file, tmp_path, monkeypatch):
    monkeypatch.setattr(untrusted, "_SMALL", 100_000)
    write(tmp_path / name, np.zeros((1000, 1000)))
    contents = open_file(tmp_path / name, TextTable())
    with pytest.raises(InputError, match=r"declares 8 MB of content in [\d.]+ kB; more than 250 times its size"):
        contents.read(["x"])


def write_netcdf3(path, arrays):
    with netcdf_file(path, "w", mmap=False) as file:
        for name, values in arrays.items():
            letters = values.astype("S") if values.dtype.kind == "U" else None
            stored = letters.view("S1").reshape(*letters.shape, -1) if letters is not None else values
            dims = [f"{name}{i}" for i in range(stored.ndim)]
            for dim, n in zip(dims, stored.shape, strict=True):
                file.createDimension(dim, n)
            file.createVariable(name, stored.dtype, dims)[:] = stored


DAMAGED = {
    **FORMATS,
    "npy": ("a.npy", lambda path, arrays: np.save(path, arrays["x"]), open_npy),
    "netcdf": ("a.nc", write_netcdf3, open_netcdf),
    "mat 5 packed": ("a.mat", lambda path, arrays: savemat(path, arrays, do_compression=True), open_mat),
}
SOME = {"x": np.arange(24.0).reshape(2, 3, 4), "n": np.arange(5, dtype="i4"), "t": np.array(["one", "two"])}


@pytest.mark.parametrize("kind", slow_but([*ONCE, "netcdf"], DAMAGED))
@given(data=st.data())
@settings(max_examples=25)
def test_damaged_bytes_end_in_a_sentence(kind, data):
    """Or in values, where nothing tells that they were others."""
    name, write, open_file = DAMAGED[kind]
    with TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path, SOME | {"s": {"a": SOME["n"]}} if "mat" in kind else SOME)
        files = sorted(each for each in path.rglob("*") if each.is_file()) if path.is_dir() else [path]
        damage(data.draw(st.sampled_from(files)), data.draw)
        with suppress(InputError):
            contents = open_file(path, TextTable())
            for each in contents.variables:
                contents.read([each])


def damage(path, draw):
    content = bytearray(path.read_bytes())
    for _ in range(draw(st.integers(1, 3))):
        content[draw(st.integers(0, len(content) - 1))] = draw(st.integers(0, 255))
    path.write_bytes(content[: draw(st.sampled_from([len(content), draw(st.integers(0, len(content)))]))])
