"""The quick reading of files of this software beside that of xarray."""

from pathlib import Path

import xarray as xr
from solidtouch.models.io.untrusted import is_sealed
from solidtouch.models.storage import read_groups


def same_by_both_ways(path: Path, names: tuple[str, ...]) -> dict[str, xr.Dataset]:
    """Groups of a sealed file, after they were compared with what xarray reads from a copy whose seal is broken."""
    copy = path.with_name("unsealed.nc")
    copy.write_bytes(path.read_bytes()[:-1] + b"?")
    assert is_sealed(path)
    assert not is_sealed(copy)
    quick, slow = read_groups(path, names), read_groups(copy, names)
    for name in names:
        xr.testing.assert_identical(quick[name], slow[name])
        for each, variable in slow[name].variables.items():
            assert quick[name][each].dtype == variable.dtype
            assert {key: type(value) for key, value in quick[name][each].attrs.items()} == {
                key: type(value) for key, value in variable.attrs.items()
            }
    return quick
