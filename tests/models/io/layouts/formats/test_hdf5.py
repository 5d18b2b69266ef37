"""HDF5 and netCDF files: groups, compound types, elements of any length, references, units and packed numbers."""

import h5py
import numpy as np
import pytest
import xarray as xr
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats import named_arrays
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.hdf5 import open_hdf5, open_netcdf


@pytest.fixture
def opened(tmp_path):
    """From what fills a file to its contents."""

    def made(fill):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            fill(file)
        return open_hdf5(tmp_path / "a.h5", TextTable())

    return made


def one(contents, name):
    return contents.read([name])[0][name]


def test_groups_are_joined(opened):
    def fill(file):
        file["s1/day 2/taps"] = np.ones((2, 3))
        file["s1"].attrs["subject"] = "A"
        file["s1/day 2/taps"].attrs.update({"rate": 100, "units": b"N", "names": ["a", "b"]})
        file.attrs.update({"licence": "CC0", "version": np.float32(1.5), "size": [4, 6]})

    contents = opened(fill)
    assert contents.variables["s1/day 2/taps"].unit == "N"
    assert contents.attributes == {
        "licence": "CC0",
        "version": 1.5,
        "size": "4, 6",
        "s1@subject": "A",
        "s1/day 2/taps@rate": 100.0,
        "s1/day 2/taps@names": "a, b",
    }
    np.testing.assert_array_equal(one(contents, "s1/day 2/taps"), np.ones((2, 3)))


def test_fields_of_compound_types_are_columns(opened):
    kind = np.dtype([("t", "f8"), ("at", [("x", "i2"), ("label", h5py.string_dtype())]), ("fixed", "S4")])
    rows = np.array([(0.5, (1, "ö"), b"ab"), (1.5, (2, "b"), b"c")], dtype=kind)
    contents = opened(lambda file: file.create_dataset("log", data=rows, dtype=kind))
    found, columns = contents.read(["log.at.label", "log.fixed"], ["log.at.x", "log.t"])

    assert list(contents.variables) == ["log.t", "log.at.x", "log.at.label", "log.fixed"]
    assert found["log.at.label"].tolist() == ["ö", "b"]
    assert found["log.fixed"].tolist() == ["ab", "c"]
    assert columns.tolist() == [[1, 0.5], [2, 1.5]]


def test_elements_of_any_length_are_a_list(opened):
    def fill(file):
        for name, lengths in (("uneven", (2, 0, 3)), ("even", (2, 2, 2))):
            node = file.create_dataset(name, (3,), h5py.vlen_dtype("f4"))
            for i, length in enumerate(lengths):
                node[i] = np.arange(length)

    contents = opened(fill)
    assert contents.variables["uneven"].shape == (3, None)
    assert [each.tolist() for each in one(contents, "uneven")] == [[0, 1], [], [0, 1, 2]]
    assert one(contents, "even").tolist() == [[0, 1]] * 3


def test_references_lead_to_their_arrays(opened):
    def fill(file):
        taps = [file.create_dataset(f"kept/{n}", data=np.full((n, 3), n)) for n in (2, 4)]
        names = [file.create_dataset(f"kept/name {n}", data=f"rod {n}") for n in (2, 4)]
        for name, to in (("taps", taps), ("again", taps[:1] * 2), ("names", names), ("mixed", [taps[0], names[0]])):
            file.create_dataset(name, (2,), h5py.ref_dtype)[...] = [each.ref for each in to]
        file.create_dataset("empty", (2,), h5py.ref_dtype)

    contents = opened(fill)
    assert contents.variables["taps"].shape == (2, None, 3)
    assert [each.tolist() for each in one(contents, "taps")] == [[[2] * 3] * 2, [[4] * 3] * 4]
    assert one(contents, "again").tolist() == [[[2] * 3] * 2] * 2
    assert one(contents, "names").tolist() == ["rod 2", "rod 4"]
    for name, sentence in (("mixed", "it refers to arrays of different types"), ("empty", "it refers to what is not")):
        with pytest.raises(InputError, match=f"array {name} cannot be read: {sentence}"):
            contents.read([name])


def test_enumerations_and_flags_are_numbers(opened):
    def fill(file):
        file["what"] = np.array([2, 1], h5py.enum_dtype({"rod": 1, "ball": 2}, "u1"))
        file["touched"] = np.array([True, False])
        file["nothing"] = h5py.Empty("f4")
        file["text"] = "mm"

    contents = opened(fill)
    assert one(contents, "what").tolist() == [2, 1]
    assert contents.variables["what"].dtype == np.uint8
    assert one(contents, "touched").dtype == np.bool_
    assert one(contents, "nothing").shape == (0,)
    assert one(contents, "text") == "mm"


def test_links_within_the_file_are_followed_once(opened):
    def fill(file):
        file["g/x"] = np.arange(3)
        file["g/self"] = file["g"]
        file["soft"] = h5py.SoftLink("/g/x")

    contents = opened(fill)
    assert contents.variables.keys() == {"g/x", "soft"}
    assert one(contents, "soft").tolist() == [0, 1, 2]


def virtual(file):
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (3,))
    file.create_virtual_dataset("x", layout)


ELSEWHERE = {
    "link": lambda file: file.__setitem__("x", h5py.ExternalLink("other.h5", "/x")),
    "virtual": virtual,
    "raw": lambda file: file.create_dataset("x", (3,), "f8", external=[("/etc/hostname", 0, 24)]),
    "nowhere": lambda file: file.__setitem__("x", h5py.SoftLink("/lost")),
}


@pytest.mark.parametrize("add", ELSEWHERE.values(), ids=ELSEWHERE)
def test_other_files_are_not_opened(add, opened):
    contents = opened(add)
    assert not contents.variables
    with pytest.raises(InputError, match="array x cannot be read: it is not in this file, but in another one or no"):
        contents.read(["x"])


REFUSED = {
    "complex": (np.zeros(2, complex), "it holds complex numbers; save the real and the imaginary part"),
    "raw": (np.zeros(2, "V3"), "it holds raw bytes"),
}


@pytest.mark.parametrize(("values", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_is_neither_numbers_nor_texts_is_refused(values, sentence, opened):
    contents = opened(lambda file: file.create_dataset("x", data=values))
    with pytest.raises(InputError, match=f"array x cannot be read: {sentence}"):
        contents.read(["x"])


@pytest.mark.parametrize("limit", [storage.ON_DISK, 100], ids=["in memory", "on disk"])
@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_packed_numbers_of_netcdf_are_unpacked(engine, limit, tmp_path, monkeypatch):
    """As xarray reads them."""
    rng = np.random.default_rng(4)
    force = np.where(rng.random((40, 3)) < 0.2, np.nan, rng.integers(0, 90, (40, 3)) / 2 + 1)
    data = {
        "force": (("tap", "taxel"), force, {"units": "N"}),
        "count": (("tap",), np.where(np.arange(40) == 7, np.nan, np.arange(40.0))),
        "what": (("tap",), np.array(["rod", "ball"] * 20)),
        "plain": (("tap",), np.arange(40, dtype=np.int32)),
    }
    encoding = {
        "force": {"dtype": "int16", "scale_factor": 0.5, "add_offset": 1.0, "_FillValue": -5},
        "count": {"dtype": "int32", "_FillValue": -1},
    }
    path = tmp_path / "a.nc"
    dataset = xr.Dataset(data, attrs={"licence": "CC0"})
    dataset.to_netcdf(path, engine=engine, encoding=encoding)
    contents = open_netcdf(path, TextTable())
    monkeypatch.setattr(storage, "ON_DISK", limit)
    monkeypatch.setattr(named_arrays, "BLOCK", 100)
    found, _ = contents.read(list(data))

    assert contents.variables["force"].unit == "N"
    assert contents.attributes["licence"] == "CC0"
    for name in data:
        np.testing.assert_array_equal(found[name], dataset[name].values)
        assert contents.variables[name].shape == found[name].shape
    assert found["plain"].dtype.kind == contents.variables["plain"].dtype.kind == "i"


def test_letters_of_netcdf_are_texts(tmp_path):
    names = xr.Dataset({"what": (("tap",), np.array([b"rod", b"ball"]))})
    for engine in ("h5netcdf", "scipy"):
        names.to_netcdf(tmp_path / "a.nc", engine=engine, encoding={"what": {"dtype": "S1"}})
        contents = open_netcdf(tmp_path / "a.nc", TextTable())
        assert contents.variables["what"].shape == (2,)
        assert one(contents, "what").tolist() == ["rod", "ball"]


def test_numbers_that_are_unsigned_in_name_only(tmp_path):
    """As the classic format has no unsigned ones."""
    for name, fill in (("x", {}), ("y", {"_FillValue": np.int8(-1)})):
        data = xr.Dataset({name: (("tap",), np.array([-56, 3, -1], np.int8), {"_Unsigned": "true", **fill})})
        data.to_netcdf(tmp_path / f"{name}.nc", engine="scipy")
    assert one(open_netcdf(tmp_path / "x.nc", TextTable()), "x").tolist() == [200, 3, 255]
    np.testing.assert_array_equal(one(open_netcdf(tmp_path / "y.nc", TextTable()), "y"), [200, 3, np.nan])


def test_dimensions_without_values_are_no_arrays(tmp_path):
    xr.Dataset({"x": (("tap", "taxel"), np.ones((2, 3)))}).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")
    assert list(open_netcdf(tmp_path / "a.nc", TextTable()).variables) == ["x"]


def test_another_file_is_refused(tmp_path):
    (tmp_path / "a.h5").write_text("time,force\n0,1\n")
    for open_file in (open_hdf5, open_netcdf):
        with pytest.raises(InputError, match="not an HDF5 file, or damaged or truncated"):
            open_file(tmp_path / "a.h5", TextTable())
