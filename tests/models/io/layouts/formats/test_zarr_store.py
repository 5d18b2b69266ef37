"""Zarr stores: groups, single arrays, what xarray writes, and what is refused."""

import numpy as np
import pytest
import xarray as xr
import zarr
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.zarr_store import open_zarr

pytestmark = pytest.mark.filterwarnings("ignore:.*does not have a Zarr V3 specification")


@pytest.fixture(params=[2, 3])
def version(request):
    return request.param


def one(contents, name):
    return contents.read([name])[0][name]


def test_groups_are_joined(version, tmp_path):
    root = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=version)
    array = root.create_array("s1/day 2/taps", data=np.ones((2, 3)))
    root.attrs["licence"] = "CC0"
    root["s1"].attrs["subject"] = "A"
    array.attrs.update({"rate": 100, "units": "N"})
    contents = open_zarr(tmp_path / "a.zarr", TextTable())

    assert contents.variables.keys() == {"s1/day 2/taps"}
    assert contents.variables["s1/day 2/taps"].unit == "N"
    assert contents.attributes == {"licence": "CC0", "s1@subject": "A", "s1/day 2/taps@rate": 100.0}
    np.testing.assert_array_equal(one(contents, "s1/day 2/taps"), np.ones((2, 3)))


def test_a_store_may_be_one_array(version, tmp_path):
    zarr.create_array(tmp_path / "a.zarr", data=np.arange(3), zarr_format=version)
    assert one(open_zarr(tmp_path / "a.zarr", TextTable()), "data").tolist() == [0, 1, 2]


def test_packed_numbers_of_xarray_are_unpacked(version, tmp_path):
    force = np.array([1.5, np.nan, 3.0])
    dataset = xr.Dataset({"force": (("tap",), force), "what": (("tap",), np.array(["rod", "a", "b"]))})
    encoding = {"force": {"dtype": "int16", "scale_factor": 0.5, "_FillValue": -1}}
    dataset.to_zarr(tmp_path / "a.zarr", zarr_format=version, encoding=encoding, consolidated=False)
    contents = open_zarr(tmp_path / "a.zarr", TextTable())

    np.testing.assert_array_equal(one(contents, "force"), force)
    assert one(contents, "what").tolist() == ["rod", "a", "b"]


def test_what_was_never_written_elsewhere_is_no_gap(version, tmp_path):
    """Zero is how other programs fill an array, not what they call missing."""
    root = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=version)
    root.create_array("x", data=np.array([0, 1, 0]), fill_value=0)
    assert one(open_zarr(tmp_path / "a.zarr", TextTable()), "x").tolist() == [0, 1, 0]


def test_texts_of_any_length_and_fields(version, tmp_path):
    root = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=version)
    root.create_array("names", shape=(2,), dtype="str")[:] = np.array(["rod", "a long ball"], dtype=object)
    root.create_array("log", data=np.array([(1, 2.5)], [("n", "i4"), ("force", "f4")]))
    root.create_array("one", data=np.array(3.0))
    contents = open_zarr(tmp_path / "a.zarr", TextTable())

    assert one(contents, "names").tolist() == ["rod", "a long ball"]
    assert one(contents, "log.force").tolist() == [2.5]
    assert one(contents, "one") == 3.0


def test_complex_numbers_are_refused(version, tmp_path):
    zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=version).create_array("x", data=np.array([1j]))
    with pytest.raises(InputError, match="array x cannot be read: it holds complex numbers; save the real and the"):
        open_zarr(tmp_path / "a.zarr", TextTable()).read(["x"])


def test_an_array_of_an_unknown_type_leaves_the_others(tmp_path):
    root = zarr.open_group(tmp_path / "a.zarr", mode="w", zarr_format=2)
    for name in ("x", "y"):
        root.create_array(name, data=np.arange(3))
    told = tmp_path / "a.zarr" / "x" / ".zarray"
    told.write_text(told.read_text().replace("<i8", "<q9"))
    contents = open_zarr(tmp_path / "a.zarr", TextTable())

    assert one(contents, "y").tolist() == [0, 1, 2]
    with pytest.raises(InputError, match="array x cannot be read: it is damaged or of an unknown type"):
        contents.read(["x"])


def test_another_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match="not a Zarr store, or damaged"):
        open_zarr(tmp_path, TextTable())
    (tmp_path / "a.zarr").touch()
    with pytest.raises(InputError, match="is a file, expected a Zarr store, which is a folder"):
        open_zarr(tmp_path / "a.zarr", TextTable())
    zarr.open_group(tmp_path / "b.zarr", mode="w")
    with pytest.raises(InputError, match="a Zarr store without arrays"):
        open_zarr(tmp_path / "b.zarr", TextTable())
