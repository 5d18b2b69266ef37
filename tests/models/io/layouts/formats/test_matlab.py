"""What MATLAB has of plain values comes through alike from both versions of its files."""

import struct
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np
import pytest
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats import matlab, matlab_hdf5, named_arrays
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.matlab import open_mat
from workspaces import WORKSPACES, Cells, expected, same, write_v5, write_v73

WRITERS = {"v5": write_v5, "v7.3": write_v73}


def opened(path):
    return open_mat(path, TextTable())


def all_of(contents):
    return contents.read(list(contents.variables))[0]


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
@given(workspace=WORKSPACES, data=st.data())
@settings(max_examples=25)
def test_a_workspace_comes_through(write, workspace, data):
    """Whole and in any parts; its variables are declared as they are read."""
    wanted = expected(workspace)
    with TemporaryDirectory() as folder:
        path = Path(folder, "taps.mat")
        write(path, workspace)
        contents = opened(path)
        found = all_of(contents)
        part = data.draw(st.lists(st.sampled_from(sorted(wanted)), unique=True)) if wanted else []
        again, _ = contents.read(part)

    assert not contents.unreadable
    assert found.keys() == wanted.keys()
    assert {name for name in wanted if not same(found[name], wanted[name])} == set()
    assert list(again) == part
    assert all(same(again[name], wanted[name]) for name in part)
    assert all(declared(contents.variables[name], values) for name, values in found.items())


def declared(variable, values):
    """Whether a variable is what was declared."""
    if isinstance(values, list):
        axes = variable.shape[-values[0].ndim :]
        fits = all(n in (None, m) for each in values for n, m in zip(axes, each.shape, strict=True))
        return fits and None in axes and {each.dtype for each in values} == {variable.dtype}
    return variable.shape == values.shape and (
        variable.dtype == values.dtype or variable.dtype.kind == values.dtype.kind == "U"
    )


@pytest.fixture(params=WRITERS.values(), ids=WRITERS)
def saved(request, tmp_path):
    """From a workspace to its file, opened."""

    def made(**workspace):
        request.param(tmp_path / "taps.mat", workspace)
        return opened(tmp_path / "taps.mat")

    return made


def test_blanks_among_numbers_are_missing(saved):
    found = all_of(saved(cell=Cells([np.array(2.0), np.empty((0, 0)), np.array(5.0)])))["cell"]
    np.testing.assert_array_equal(found, [2, np.nan, 5])


def test_taps_of_different_lengths_are_a_list(saved):
    """Also the one with a single sample, which is no vector of taxels."""
    taps = [np.arange(3.0 * n).reshape(n, 3) for n in (4, 1, 2)]
    contents = saved(trial=[{"data": tap, "rod": name} for tap, name in zip(taps, ("a", "b", "c"), strict=True)])

    assert contents.variables["trial.data"].shape == (3, None, 3)
    assert [same(found, tap) for found, tap in zip(all_of(contents)["trial.data"], taps, strict=True)] == [True] * 3
    assert all_of(contents)["trial.rod"].tolist() == ["a", "b", "c"]


def test_structs_inside_struct_arrays(saved):
    trials = [{"rig": {"taps": [{"x": np.arange(3.0) + i}, {"x": np.arange(3.0) - i}], "name": "r"}} for i in range(4)]
    found = all_of(saved(trials=trials))

    np.testing.assert_array_equal(found["trials.rig.taps.x"], [[np.arange(3) + i, np.arange(3) - i] for i in range(4)])
    assert found["trials.rig.name"].tolist() == ["r"] * 4


UNEVEN = [{"taps": [{"x": np.array(0.0)}] * n} for n in (2, 3)]
MIXED = {
    "numbers and texts": (Cells([np.array(1.0), "a"]), "it mixes numbers and texts"),
    "cells and numbers": (Cells([np.array(1.0), Cells(["a", "b"])]), "it mixes structs, cells and plain arrays"),
}


@pytest.mark.parametrize(("value", "sentence"), MIXED.values(), ids=MIXED)
def test_what_mixes_is_refused(value, sentence, saved):
    contents = saved(x=value, y=np.array(1.0))

    assert list(contents.variables) == ["y"]
    with pytest.raises(InputError, match=f"array x cannot be read: {sentence}; save them as arrays of their own"):
        contents.read(["x"])


def test_rows_of_elements_that_differ_in_number_end_in_blanks(saved):
    found = all_of(saved(trials=UNEVEN))
    np.testing.assert_array_equal(found["trials.taps.x"], [[0, 0, np.nan], [0, 0, 0]])


def test_matrices_of_elements_that_differ_in_size_are_refused(tmp_path):
    cells = np.empty(2, object)
    cells[:] = [np.full((2, columns), 1.0).astype(object) for columns in (2, 3)]
    savemat(tmp_path / "a.mat", {"x": cells, "y": 1.0})
    contents = opened(tmp_path / "a.mat")
    with pytest.raises(InputError, match=r"array x cannot be read: .* differ in size; save rows of cells"):
        contents.read(["x"])


def test_complex_numbers_are_refused_wherever_they_are(tmp_path):
    """SciPy would drop their imaginary part without a word in what it returns."""
    path = tmp_path / "taps.mat"
    cell = np.empty((1, 2), object)
    cell[0] = [np.array([[1j]]), np.array([[2.0]])]
    savemat(path, {"z": 1j, "s": {"y": 2j, "real": 1.0}, "cell": cell})
    contents = opened(path)

    assert list(contents.variables) == ["s.real"]
    for name in ("z", "s.y", "cell"):
        with pytest.raises(InputError, match=f"array {name} cannot be read: .*complex numbers; save the real and the"):
            contents.read([name])


def test_sparse_matrices_and_functions_are_refused(tmp_path):
    path = tmp_path / "taps.mat"
    savemat(path, {"s": scipy.sparse.eye_array(3), "x": 1.0})
    contents = opened(path)

    assert list(contents.variables) == ["x"]
    with pytest.raises(InputError, match=r"array s cannot be read: it is a sparse matrix; save full\(x\)"):
        contents.read(["s"])


OBJECTS = {
    "string": r"it is a string; save cellstr\(x\)",
    "table": r"it is a table; save table2struct\(x, 'ToScalar', true\)",
    "datetime": r"it is a datetime; save posixtime\(x\)",
    "categorical": r"it is categorical; save cellstr\(x\)",
    "own.Rig": r"it is an object \(own\.Rig\); save its properties",
}


@pytest.mark.parametrize(("kind", "sentence"), OBJECTS.items())
def test_objects_of_newer_files_are_refused(kind, sentence, tmp_path):
    path = tmp_path / "taps.mat"
    write_v73(path, {"y": np.array(1.0)})
    with h5py.File(path, "r+") as file:
        file["x"] = np.zeros((1, 6), "u4")
        file["x"].attrs.update({"MATLAB_class": np.bytes_(kind), "MATLAB_object_decode": np.int32(3)})
    contents = opened(path)

    assert list(contents.variables) == ["y"]
    with pytest.raises(InputError, match=f"array x cannot be read: {sentence}"):
        contents.read(["x"])


def object_of_v7(name, kind):
    """A variable as a file of version 5 to 7 holds an object of a class: its name, its class, and a number."""

    def element(number, content):
        return struct.pack("<II", number, len(content)) + content + bytes(-len(content) % 8)

    flags, number = element(6, struct.pack("<II", 17, 0)), element(6, struct.pack("<II", 13, 0))
    number += element(5, struct.pack("<ii", 1, 1)) + element(1, b"") + element(6, struct.pack("<I", 1))
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", kind))
    return element(14, flags + texts + element(14, number))


def test_objects_of_older_files_are_refused(tmp_path):
    path = tmp_path / "taps.mat"
    savemat(path, {"y": 1.0})
    with path.open("ab") as file:
        for kind in OBJECTS:
            file.write(object_of_v7(f"a_{kind[:3]}", kind))
    contents = opened(path)

    assert list(contents.variables) == ["y"]
    for kind, sentence in OBJECTS.items():
        with pytest.raises(InputError, match=f"array a_{kind[:3]} cannot be read: {sentence}"):
            contents.read([f"a_{kind[:3]}"])


def sparse(file):
    group = file.create_group("x")
    group.attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_sparse": np.uint64(3)})
    group["ir"], group["jc"], group["data"] = np.arange(3), np.arange(4), np.ones(3)


def complex_numbers(file):
    file["x"] = np.zeros((2, 1), [("real", "f8"), ("imag", "f8")])
    file["x"].attrs["MATLAB_class"] = np.bytes_("double")


def function(file):
    file.create_group("x").attrs["MATLAB_class"] = np.bytes_("function_handle")


def elsewhere(file):
    file["x"] = h5py.ExternalLink("other.h5", "/x")


def endless(file):
    node = file.create_dataset("x", (1, 2), h5py.ref_dtype)
    node.attrs["MATLAB_class"] = np.bytes_("cell")
    node[0] = [node.ref, node.ref]


def nowhere(file):
    node = file.create_dataset("x", (1, 2), h5py.ref_dtype)
    node.attrs["MATLAB_class"] = np.bytes_("cell")


NEWER = {
    "sparse": (sparse, r"it is a sparse matrix; save full\(x\)"),
    "complex": (complex_numbers, "it holds complex numbers; save the real"),
    "function": (function, r"it is a function handle; save func2str\(x\)"),
    "elsewhere": (elsewhere, "it is not in this file, but in another one or nowhere"),
    "nowhere": (nowhere, "of one of its elements, the file says where it is, but nothing is there"),
}


@pytest.mark.parametrize(("add", "sentence"), NEWER.values(), ids=NEWER)
def test_what_newer_files_hold_is_refused(add, sentence, tmp_path):
    path = tmp_path / "taps.mat"
    write_v73(path, {"y": np.array(1.0)})
    with h5py.File(path, "r+") as file:
        add(file)
    contents = opened(path)

    assert list(contents.variables) == ["y"]
    with pytest.raises(InputError, match=f"array x cannot be read: {sentence}"):
        contents.read(["x"])


def test_a_cell_inside_itself_ends(tmp_path, monkeypatch):
    monkeypatch.setattr(matlab_hdf5, "MOST_NODES", 1000)
    path = tmp_path / "taps.mat"
    write_v73(path, {"y": np.array(1.0)})
    with h5py.File(path, "r+") as file:
        endless(file)
    with pytest.raises(InputError, match="holds more elements of cells and structs than a file of its size can"):
        opened(path)


def test_cells_of_several_rows_keep_their_axes(tmp_path):
    """Both those of the numbers and those of the texts."""
    cell = np.empty((2, 3), object)
    names = np.empty((2, 3), object)
    for i, j in np.ndindex(2, 3):
        cell[i, j], names[i, j] = np.full((4, 5), 10.0 * i + j), f"{i}{j}"
    savemat(tmp_path / "taps.mat", {"cell": cell, "names": names})
    found = all_of(opened(tmp_path / "taps.mat"))

    assert found["cell"].shape == (2, 3, 4, 5)
    np.testing.assert_array_equal(found["cell"][:, :, 0, 0], [[0, 1, 2], [10, 11, 12]])
    assert found["names"].tolist() == [["00", "01", "02"], ["10", "11", "12"]]


def test_newer_cells_of_several_rows_keep_their_axes(tmp_path):
    path = tmp_path / "taps.mat"
    write_v73(path, {"n": Cells([np.array(float(i)) for i in (0, 1, 2, 10, 11, 12)])})
    with h5py.File(path, "r+") as file:
        rows, told = file["n"][:, 0].reshape(2, 3), dict(file["n"].attrs)
        del file["n"]
        file.create_dataset("n", data=rows.T, dtype=h5py.ref_dtype).attrs.update(told)
    assert all_of(opened(path))["n"].tolist() == [[0, 1, 2], [10, 11, 12]]


@pytest.mark.parametrize("name", ["numbers", "cells"])
def test_large_arrays_stay_on_disk(name, saved, monkeypatch):
    wanted = {"numbers": np.arange(6000.0).reshape(20, 30, 10), "cells": Cells([np.eye(30)] * 4)}
    contents = saved(**wanted)
    monkeypatch.setattr(storage, "ON_DISK", 1000)
    for module in (named_arrays, matlab_hdf5):
        monkeypatch.setattr(module, "BLOCK", 3000, raising=False)
    found = contents.read([name])[0][name]

    assert isinstance(found, np.memmap)
    np.testing.assert_array_equal(found, wanted[name])


def test_what_is_unpacked_goes_with_the_contents(saved, tmp_path, monkeypatch):
    monkeypatch.setattr(matlab.tempfile, "tempdir", str(tmp_path / "unpacked"))
    (tmp_path / "unpacked").mkdir()
    contents = saved(x=np.arange(3.0))
    all_of(contents)
    del contents

    assert list((tmp_path / "unpacked").iterdir()) == []


def test_another_file_is_refused(tmp_path):
    (tmp_path / "taps.mat").write_text("time,force\n0,1\n" * 40)
    with pytest.raises(InputError, match=r"not a MATLAB file of version 5 to 7\.3, or damaged or truncated"):
        opened(tmp_path / "taps.mat")
