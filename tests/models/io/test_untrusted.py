"""Files that crash or hang a library end in a sentence, and files of this software are read at once."""

import sys
import time

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from solidtouch.models.errors import InputError
from solidtouch.models.io import untrusted
from solidtouch.models.io.load import load_taps
from solidtouch.models.io.mat_v5 import read_v5


@pytest.fixture
def saved(make_taps, tmp_path):
    path = tmp_path / "taps.nc"
    make_taps(repeats=1).save(path)
    return path


@pytest.fixture
def children(monkeypatch):
    """The files that child processes read."""
    read, first = [], untrusted.subprocess.run

    def run(command, **how):
        read.append(command[command.index("-m") + 4])
        return first(command, **how)

    monkeypatch.setattr(untrusted.subprocess, "run", run)
    return read


def test_a_file_of_this_software_needs_no_child(saved, children):
    assert untrusted.is_sealed(saved)
    load_taps(saved)
    assert children == []


def flipped(path):
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def shortened(path):
    path.write_bytes(path.read_bytes()[:-1])


def extended(path):
    with h5py.File(path, "r+") as file:
        file.attrs["further"] = "text"


@pytest.mark.parametrize("change", [flipped, shortened, extended])
def test_a_file_changed_since_is_read_by_a_child_first(change, saved, children):
    change(saved)

    assert not untrusted.is_sealed(saved)
    load_taps(saved)
    assert children == [str(saved)]


def test_a_large_file_has_no_seal(saved, monkeypatch):
    before = saved.read_bytes()
    monkeypatch.setattr(untrusted, "_MOST_SEALED", len(before) - 1)
    untrusted.seal(saved)

    assert saved.read_bytes() == before


def test_a_file_that_crashes_its_library_is_refused(tmp_path):
    """An unknown type of text makes SciPy 1.16 crash."""
    path = tmp_path / "taps.mat"
    savemat(path, {"where_unit": "mm"})
    content = path.read_bytes()
    assert content.count(b"\x10\x00\x02\x00mm") == 1
    path.write_bytes(content.replace(b"\x10\x00\x02\x00mm", b"\x10\x01\x02\x00mm"))

    with pytest.raises(InputError, match=r"taps\.mat: .*(crashes the library of its format|damaged)"):
        load_taps(path)


def test_all_of_a_matlab_file_comes_through(tmp_path):
    path = tmp_path / "taps.mat"
    values = {"file": np.eye(3), "z": np.array([[1j]]), "s": {"a": 1}, "names": np.array(["a", "bb"], dtype=object)}
    savemat(path, values)

    arrays = read_v5(path)

    np.testing.assert_array_equal(arrays["file"], np.eye(3))
    np.testing.assert_array_equal(arrays["z"], [[1j]])
    assert list(arrays["names"]) == ["a", "bb"]
    assert arrays["s"] == "struct, sparse matrix, function, string or object"


ENDS = {
    "hang": ("exec sleep 60", r"reading it takes longer than 1 s; the file may be damaged\."),
    "crash": ("kill -11 $$", "reading it crashes the library of its format; the file may be damaged"),
    "memory": ("exit 3", r"reading it takes more than [\d.]+ [GM]B of memory; the file may be damaged"),
}


@pytest.mark.skipif(sys.platform == "win32", reason="the child is a shell script")
@pytest.mark.parametrize(("script", "sentence"), ENDS.values(), ids=ENDS)
def test_how_a_child_ends_is_told(script, sentence, saved, tmp_path, monkeypatch):
    child = tmp_path / "child"
    child.write_text(f"#!/bin/sh\n{script}\n")
    child.chmod(0o755)
    flipped(saved)
    monkeypatch.setattr(untrusted.sys, "executable", str(child))
    monkeypatch.setattr(untrusted, "_SECONDS", 1)
    monkeypatch.setattr(untrusted, "_BUSY", 1)

    start = time.perf_counter()
    with pytest.raises(InputError, match=rf"taps\.nc: {sentence}"):
        load_taps(saved)
    assert time.perf_counter() - start < 10


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other limits")
def test_a_child_has_a_limit_of_memory(saved, monkeypatch):
    """An array of fill values takes no room in the file."""
    monkeypatch.setattr(untrusted, "_MEMORY", 300 << 20)
    with h5py.File(saved, "r+") as file:
        file.create_dataset("further", (30, 1 << 20), "f8", chunks=(1, 1 << 20))
    with pytest.raises(InputError, match=r"taps\.nc: reading it takes more than 3\d\d MB of memory"):
        load_taps(saved)
