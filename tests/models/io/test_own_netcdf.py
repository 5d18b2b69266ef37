"""Files of this software are read as xarray reads them."""

import numpy as np
import pytest
import xarray as xr
from netcdf_readings import same_by_both_ways
from solidtouch.models.storage import write_groups


def test_any_dataset_is_read_as_xarray_reads_it(tmp_path, rng):
    """Texts, truth values, missing values, coordinates of two axes, empty axes and single numbers, in groups."""
    root = xr.Dataset(
        {
            "samples": (("tap", "time"), rng.normal(size=(3, 2)), {"units": "N", "range": [-1.5, 2.0], "count": 3}),
            "missing": ("tap", [1.0, np.nan, -np.inf]),
            "dead": (("tap", "time"), rng.random((3, 2)) < 0.5),
            "names": ("tap", ["ä", "", "a longer one"]),
            "nothing": (("none", "tap"), np.zeros((0, 3), np.float32)),
            "bytes": ("wide", np.arange(4, dtype=np.uint8)),
            "number": 7,
            "text": "one",
        },
        coords={"time": ("time", [0.0, 0.5], {"units": "s"}), "place": (("tap", "time"), np.arange(6).reshape(3, 2))},
        attrs={"title": "a title", "empty": "", "format": 2, "values": [1, 2], "half": 0.5},
    )
    inner = xr.Dataset({"level": (("tap", "taxel"), rng.integers(9, size=(3, 5)))}, coords={"taxel": list("abcde")})
    write_groups({"/": root, "parameters": inner}, tmp_path / "file.nc")
    read = same_by_both_ways(tmp_path / "file.nc", ("/", "parameters", "absent"))

    xr.testing.assert_equal(read["/"], root)
    assert not read["absent"].variables


@pytest.mark.parametrize("where", [{"where_value": [0.0, 1.0, 4.0]}, {"where_unit": "deg"}])
def test_taps_are_read_as_xarray_reads_them(make_taps, tmp_path, where):
    """Of every axis and label."""
    make_taps(**where, taxel_position=np.zeros((5, 2))).save(tmp_path / "taps.nc")

    same_by_both_ways(tmp_path / "taps.nc", ("/",))
