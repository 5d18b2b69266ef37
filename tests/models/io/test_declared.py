"""Files whose headers declare more than they may are refused before their data are read."""

import struct
import zipfile

import h5netcdf
import h5py
import numpy as np
import pytest
import zarr
from numpy.lib import format as npy
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io import untrusted
from solidtouch.models.io.load import load_taps

LARGE = (1_000_000, 1_000, 1_000)
TOO_MUCH = r"declares 8 TB of content in [\d.]+ kB; more than 250 times its size is not read\."


@pytest.fixture
def arrays(make_taps, arrays_of):
    return arrays_of(make_taps(repeats=1))


@pytest.fixture
def unread(monkeypatch):
    """No data of an archive are read."""
    monkeypatch.setattr(npy, "read_array", lambda *_, **__: pytest.fail("data were read"))
    monkeypatch.setattr(storage, "spooled", lambda *_, **__: pytest.fail("data were unpacked"))
    monkeypatch.setattr(untrusted, "_SMALL", 100_000)


BAD = {
    "bomb": ({"taps": np.zeros((24, 1000, 50))}, r"declares 9\.6\d* MB of content in [\d.]+ kB; more than 250 times"),
    "bomb without names": ({"taps": np.zeros((24, 1000, 50)), "what_names": None}, "missing array what_names; the fi"),
    "what missing": ({"what": None}, "missing array what; the file holds"),
    "taps of text": ({"taps": np.full((24, 6, 5), "x")}, "array taps must hold real numbers, got text"),
    "flat taps": ({"taps": np.zeros(24)}, r"array taps must have shape \(N, J, K\) without empty axes, got \(24,\)"),
    "names of numbers": ({"what_names": np.arange(4)}, "array what_names must be a list of text"),
    "objects": ({"what": np.array([{}])}, "array what cannot be read: it holds pickled objects, which are refused"),
}


@pytest.mark.parametrize(("changes", "sentence"), BAD.values(), ids=BAD)
@pytest.mark.usefixtures("unread")
def test_an_archive_is_refused_by_its_headers(changes, sentence, arrays, tmp_path):
    np.savez_compressed(tmp_path / "bad.npz", **{k: v for k, v in (arrays | changes).items() if v is not None})

    with pytest.raises(InputError, match=rf"bad\.npz: {sentence}"):
        load_taps(tmp_path / "bad.npz")


def test_an_array_without_use_is_not_read(arrays, tmp_path, monkeypatch):
    monkeypatch.setattr(untrusted, "_SMALL", 100_000)
    np.savez_compressed(tmp_path / "taps.npz", **arrays, photograph=np.zeros(10**7))

    assert len(load_taps(tmp_path / "taps.npz")) == 24


HEADERS = {
    "other size": (
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (10, 10)}",
        "says 800 bytes, not 64",
    ),
    "negative": (b"{'descr': '<f8', 'fortran_order': False, 'shape': (-2, -4)}", "is damaged"),
    "nested": (b"{'descr': '<f8', 'fortran_order': False, 'shape': " + b"(" * 3_000, "is damaged"),
    "no header": (b"", "is damaged"),
}


@pytest.mark.parametrize(("header", "sentence"), HEADERS.values(), ids=HEADERS)
def test_a_forged_header_is_told(header, sentence, arrays, tmp_path):
    np.savez(tmp_path / "bad.npz", **arrays)
    with zipfile.ZipFile(tmp_path / "bad.npz", "a") as archive:
        archive.writestr("x.npy", npy.MAGIC_PREFIX + b"\1\0" + struct.pack("<H", len(header)) + header + bytes(64))

    with pytest.raises(InputError, match=f"bad.npz: array x .*{sentence}"):
        load_taps(tmp_path / "bad.npz")


def test_a_long_header_is_not_read(arrays, tmp_path):
    """It declares 4 GB, of which the archive holds 10 MB in 10 kB."""
    np.savez(tmp_path / "bad.npz", **arrays)
    with zipfile.ZipFile(tmp_path / "bad.npz", "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", npy.MAGIC_PREFIX + b"\2\0" + struct.pack("<I", 2**32 - 1) + bytes(10**7))

    with pytest.raises(InputError, match=r"array x is damaged \(EOF: reading array header"):
        load_taps(tmp_path / "bad.npz")


def in_netcdf(path):
    with h5netcdf.File(path, "w") as file:
        file.dimensions = dict(zip("abc", LARGE, strict=True))
        file.create_variable("x", tuple("abc"), "f8", chunks=(100, 10, 10), fillvalue=0)


def in_zarr(path):
    x = zarr.open_group(path, mode="w", zarr_format=2).create_array("x", shape=LARGE, dtype="f8", chunks=(100, 10, 10))
    x.attrs["_ARRAY_DIMENSIONS"] = list("abc")


def in_matlab(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("taps", LARGE, "f8", chunks=(100, 10, 10))
        file["what"] = [1.0]
        file["what_names"] = np.array([[120]], np.uint16)
        file["what_names"].attrs["MATLAB_class"] = np.bytes_("char")


@pytest.mark.parametrize(("write", "name"), [(in_netcdf, "x.nc"), (in_zarr, "x.zarr"), (in_matlab, "x.mat")])
def test_terabytes_of_fill_values_are_refused(write, name, tmp_path):
    write(tmp_path / name)

    with pytest.raises(InputError, match=rf"{name}: {TOO_MUCH}"):
        load_taps(tmp_path / name)


@pytest.mark.parametrize("ending", [".nc", ".npz"])
def test_what_does_not_fit_into_memory_is_refused_with_both_numbers(ending, make_taps, arrays, tmp_path, monkeypatch):
    if ending == ".nc":
        make_taps().save(tmp_path / "taps.nc")
    else:
        np.savez(tmp_path / "taps.npz", **arrays)
    monkeypatch.setattr(untrusted, "available_memory", lambda: 1_500)

    with pytest.raises(InputError, match=rf"taps{ending}: needs [\d.]+ kB of memory, but 1\.5 kB are available\."):
        load_taps(tmp_path / f"taps{ending}")


@pytest.mark.parametrize(
    ("number", "text"), [(0, "0 bytes"), (999, "999 bytes"), (7_800_000, "7.8 MB"), (10**24, "1e+06 EB")]
)
def test_bytes_have_a_unit(number, text):
    assert untrusted.in_bytes(number) == text


def test_some_memory_is_available():
    assert 1 << 20 < untrusted.available_memory() < 1 << 50
