"""Large recordings that are compressed, text, integers or of MATLAB are unpacked into temporary files."""

import errno
import os
from functools import partial
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats import named_arrays, numpy_files, text
from solidtouch.models.io.load import load_taps
from solidtouch.models.taps import TapSet

KINDS = {"single": np.float32, "integers": np.int16}


def npz(path, arrays, _):
    np.savez_compressed(path, **arrays)


def npz_by_column(path, arrays, _):
    np.savez_compressed(path, **arrays | {"taps": np.asfortranarray(arrays["taps"])})


def in_mat(chunks):
    def write(path, arrays, to_mat):
        to_mat(path)
        with h5py.File(path, "r+") as file:
            told = dict(file["taps"].attrs)
            del file["taps"]
            file.create_dataset("taps", data=arrays["taps"].T, chunks=chunks, compression="gzip" if chunks else None)
            file["taps"].attrs.update(told)

    return write


FILES = {
    "npz": ("taps.npz", npz),
    "npz by column": ("taps.npz", npz_by_column),
    "mat": ("taps.mat", in_mat(None)),
    "mat in chunks": ("taps.mat", in_mat((2, 3, 5))),
}


@pytest.fixture(params=FILES.values(), ids=FILES)
def packed(request, writers, monkeypatch, tmp_path):
    """From a tap set and a type to a file that is unpacked seven taps at a time, and its samples."""
    name, write = request.param

    def made(taps, arrays, kind):
        arrays["taps"] = np.round(20 * arrays["taps"]).astype(kind)
        write(tmp_path / name, arrays, partial(writers["mat73"][1], taps))
        monkeypatch.setattr(storage, "ON_DISK", 1000)
        for module in (numpy_files, named_arrays):
            monkeypatch.setattr(module, "BLOCK", 7 * arrays["taps"][0].nbytes)
        return tmp_path / name, arrays["taps"]

    return made


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_samples_stay_on_disk(packed, make_taps, arrays_of, kind, monkeypatch):
    """Until somebody asks for them."""
    taps = make_taps()
    path, samples = packed(taps, arrays_of(taps), kind)
    with monkeypatch.context() as patched:
        patched.setattr(TapSet, "taps", property(lambda _: pytest.fail("all samples were asked for")))
        large = load_taps(path)
    assert large.samples.dtype == (np.float64 if kind is np.int16 else np.float32)
    np.testing.assert_array_equal(large.samples.values, samples)


def test_without_room_they_come_into_memory(packed, make_taps, arrays_of, monkeypatch):
    """Where the folder for temporary files is full."""
    taps = make_taps()
    path, samples = packed(taps, arrays_of(taps), np.float32)
    monkeypatch.setattr(storage, "tempfile", SimpleNamespace(TemporaryFile=lambda: Full(errno.ENOSPC)))
    np.testing.assert_array_equal(load_taps(path).taps, samples)


def test_other_failures_are_told(packed, make_taps, arrays_of, monkeypatch):
    taps = make_taps()
    path, _ = packed(taps, arrays_of(taps), np.float32)
    monkeypatch.setattr(storage, "tempfile", SimpleNamespace(TemporaryFile=lambda: Full(errno.EIO)))
    with pytest.raises(InputError, match=r"taps\.(npz|mat): .*Input/output error"):
        load_taps(path)


def test_a_damaged_member_is_found_where_it_is_unpacked(make_taps, arrays_of, monkeypatch, tmp_path):
    """By its checksum, as in memory."""
    path = tmp_path / "taps.npz"
    npz(path, arrays_of(make_taps()), None)
    content = bytearray(path.read_bytes())
    at = content.index(b"taps.npy") + 3000
    content[at : at + 40] = bytes(40)
    path.write_bytes(content)
    for limit in (storage.ON_DISK, 1000):
        monkeypatch.setattr(storage, "ON_DISK", limit)
        with pytest.raises(InputError, match=r"taps\.npz: array taps is damaged"):
            load_taps(path)


@pytest.fixture
def tables(make_taps, writers, tmp_path, monkeypatch):
    """Two CSV files in a folder, of which seven rows are read at a time, and their taps."""
    parts = [make_taps(sessions=1, repeats=2, seed=seed, extra={"force": np.arange(24.0)}) for seed in (1, 2)]
    for number, part in enumerate(parts):
        dataset = part.dataset.assign_coords(session=("tap", np.full(len(part), number)))
        writers["csv"][1](TapSet(dataset), tmp_path / f"{number}.csv")
    monkeypatch.setattr(storage, "ON_DISK", 1000)
    monkeypatch.setattr(text.TextContents.__init__, "__defaults__", (7 * 70,))
    return tmp_path, parts


def same(large, expected):
    assert large.scanned is not None
    np.testing.assert_array_equal(large.samples.values, expected.taps)
    for name in ("what", "where", "session", "trial", "force"):
        np.testing.assert_array_equal(large.dataset[name].values, expected.dataset[name].values)


def test_rows_are_read_some_at_a_time(tables, monkeypatch):
    """Also those that need a closer look, and where a class first occurs late; without room as before."""
    folder, (expected, _) = tables
    path = folder / "0.csv"
    rows = path.read_text(encoding="utf-8").splitlines()
    cells = ["who", *["x"] * (len(rows) - 7), *['"True"'] * 6]
    rows = [f"{row},{cell}" for row, cell in zip(rows, cells, strict=True)]
    path.write_text("\n".join(rows), encoding="utf-8")
    with monkeypatch.context() as patched:
        patched.setattr(TapSet, "taps", property(lambda _: pytest.fail("all samples were asked for")))
        large = load_taps(path)
    same(large, expected)
    monkeypatch.setattr(storage, "tempfile", SimpleNamespace(TemporaryFile=lambda: Full(errno.ENOSPC)))
    same(load_taps(path), expected)


def test_folders_are_joined_on_disk(tables):
    """One file behind the other."""
    folder, parts = tables
    large = load_taps(folder)
    assert large.session.tolist() == [0] * 24 + [1] * 24
    np.testing.assert_array_equal(large.samples.values, np.concatenate([part.taps for part in parts]))


def test_a_bad_cell_is_found_in_its_part(tables):
    """With its line, as in memory; missing samples may be dropped."""
    folder, (expected, _) = tables
    path = folder / "0.csv"
    rows = path.read_text(encoding="utf-8").splitlines()
    rows[100] = ",".join([*rows[100].split(",")[:-1], "nan"])
    path.write_text("\n".join(rows), encoding="utf-8")
    with pytest.raises(InputError, match=r"0\.csv: line 101, column taxel_4 is nan"):
        load_taps(path)
    dropped = load_taps(path, "drop").samples.values
    assert np.isnan(dropped).sum() == np.isnan(dropped[99 // 6, 99 % 6, 4]) == 1
    np.testing.assert_array_equal(dropped[:16], expected.taps[:16])


class Full:
    """A temporary file that cannot be written."""

    def __init__(self, number):
        self.number = number

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def write(self, _):
        raise OSError(self.number, os.strerror(self.number))
