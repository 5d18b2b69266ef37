"""Files and folders that are whole or not there."""

import errno
import os
import re
import stat
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import check_there, load_taps
from solidtouch.models.measurement.generic import source
from solidtouch.models.storage import (
    check_folder,
    check_writable,
    complete_file,
    complete_folder,
    read_groups,
    write_groups,
    write_netcdf,
)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def write_half(opened, error):
    """Begins to write and comes to grief."""
    with opened as temporary:
        (temporary / "a" if temporary.is_dir() else temporary).write_text("half")
        raise error


def test_a_file_appears_when_it_is_complete(tmp_path):
    """Until then its folder holds a hidden name with the same ending."""
    target = tmp_path / "model.nc"
    with complete_file(target) as temporary:
        temporary.write_text("whole")
        assert not target.exists()
        assert (temporary.parent, temporary.suffix) == (tmp_path, ".nc")

    assert target.read_text() == "whole"
    assert names(tmp_path) == ["model.nc"]


def test_files_get_ordinary_permissions(tmp_path):
    """Not the private ones of temporary files."""
    plain = tmp_path / "plain"
    plain.touch()
    with complete_file(tmp_path / "ours") as temporary:
        temporary.write_text("x")

    assert stat.S_IMODE((tmp_path / "ours").stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interrupted_file_leaves_the_old_one(tmp_path, error):
    """And nothing beside it."""
    target = tmp_path / "model.nc"
    target.write_text("old")
    with pytest.raises(error):
        write_half(complete_file(target, force=True), error)

    assert target.read_text() == "old"
    assert names(tmp_path) == ["model.nc"]


def test_a_full_disk_is_an_input_error(tmp_path):
    """What the operating system says is in the message, and no half file is left."""
    with (
        pytest.raises(InputError, match=r"model\.nc: cannot write: No space left on device"),
        complete_file(tmp_path / "model.nc"),
    ):
        raise OSError(28, "No space left on device")
    assert names(tmp_path) == []


def test_what_hdf5_says_of_a_full_disk_is_said_in_a_word(tmp_path):
    said = "Can't write data (file write failed: time = now\n, errno = 28, error message = 'No space left on device')"
    with (
        pytest.raises(InputError, match=r"model\.nc: cannot write: No space left on device\.$"),
        complete_file(tmp_path / "model.nc"),
    ):
        raise OSError(said)


def test_a_dataset_that_does_not_fit_the_disk_is_refused_before_it_is_written(tmp_path, monkeypatch):
    """But one that is to be packed, whose size is not known."""
    data = xr.Dataset({"a": ("x", np.zeros(1000))})
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=5000))
    with pytest.raises(InputError, match=r"a\.nc: cannot write: needs 8 kB, but 5 kB are free on the disk\."):
        write_groups({"/": data}, tmp_path / "a.nc")
    assert names(tmp_path) == []

    data["a"].encoding["zlib"] = True
    write_groups({"/": data}, tmp_path / "a.nc")
    assert names(tmp_path) == ["a.nc"]


def test_existing_files_are_kept_without_force(tmp_path):
    """The message names the option that overwrites."""
    (tmp_path / "a").write_text("old")
    with (
        pytest.raises(InputError, match=r"a: already exists; use --force to overwrite it"),
        complete_file(tmp_path / "a"),
    ):
        pytest.fail("the block is entered")
    assert check_writable(tmp_path / "a", force=True) == tmp_path / "a"


def test_a_file_that_another_program_made_meanwhile_is_kept(tmp_path):
    """Without `force`, also one that was not there when it was checked."""
    target = tmp_path / "model.nc"

    def both_write():
        with complete_file(target) as temporary:
            temporary.write_text("ours")
            target.write_text("theirs")

    with pytest.raises(InputError, match="already exists"):
        both_write()
    assert (target.read_text(), names(tmp_path)) == ("theirs", ["model.nc"])


def test_files_appear_where_the_file_system_has_no_links(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    with complete_file(tmp_path / "model.nc") as temporary:
        temporary.write_text("whole")
    assert names(tmp_path) == ["model.nc"]


def test_places_that_cannot_be_written_are_refused(tmp_path, monkeypatch):
    """Directories, missing folders and folders without permission, each by name."""
    with pytest.raises(InputError, match="is a folder, expected a file name"):
        check_writable(tmp_path)
    with pytest.raises(InputError, match=r"no folder .*nowhere"):
        check_writable(tmp_path / "nowhere" / "a")
    (tmp_path / "mine.csv").touch()
    for below in ("x.nc", "deeper/x.nc"):
        with pytest.raises(InputError, match=r"x\.nc: cannot write: .*mine\.csv is a file, expected a folder\.$"):
            check_writable(tmp_path / "mine.csv" / below)
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(InputError, match=r"folder .* is not writable"):
        check_writable(tmp_path / "a")


LOOKS = {
    "write a file": check_writable,
    "write a folder": check_folder,
    "read groups": lambda path: read_groups(path, ("/",)),
    "read a store": storage.read_zarr,
    "read an object": lambda path: storage.read_object(path, "setting"),
    "read taps": load_taps,
    "read several": lambda path: check_there([path]),
    "read a function": lambda path: source.named(f"{path}.py:f"),
}


@pytest.mark.parametrize("look", LOOKS.values(), ids=LOOKS)
def test_a_path_that_the_system_cannot_look_at_is_named(look, tmp_path):
    with pytest.raises(InputError, match=r"9{300}.*: File name too long\."):
        look(tmp_path / ("9" * 300))


def test_a_temporary_name_that_cannot_be_made_is_refused(tmp_path):
    """For example where the name is too long."""
    with (
        pytest.raises(InputError, match="cannot write: File name too long"),
        complete_file(tmp_path / ("a" * 254)),
    ):
        pytest.fail("the block is entered")


def test_a_folder_appears_when_it_is_complete(tmp_path):
    """With the folders above it."""
    target = tmp_path / "runs" / "first"
    with complete_folder(target) as temporary:
        (temporary / "a").write_text("1")
        (temporary / "b").write_text("2")
        assert not target.exists()

    assert names(target) == ["a", "b"]
    assert names(tmp_path / "runs") == ["first"]


def test_all_files_of_a_folder_appear_at_once(tmp_path, monkeypatch):
    """A program that is killed while it moves them would leave half of them; permissions are ordinary ones."""
    monkeypatch.setattr(type(tmp_path), "replace", None)
    (tmp_path / "ordinary").mkdir()
    with complete_folder(tmp_path / "out") as temporary:
        for name in "ab":
            (temporary / name).touch()
    assert names(tmp_path / "out") == ["a", "b"]
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "ordinary").stat().st_mode


def test_a_folder_that_another_program_made_meanwhile_is_kept(tmp_path):
    def both_write():
        with complete_folder(tmp_path / "out") as temporary:
            (temporary / "ours").touch()
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "theirs").touch()

    with pytest.raises(InputError, match="already exists"):
        both_write()
    assert (names(tmp_path), names(tmp_path / "out")) == (["out"], ["theirs"])


def test_an_interrupted_folder_leaves_nothing(tmp_path):
    """Neither the folder nor its temporary files."""
    with pytest.raises(KeyboardInterrupt):
        write_half(complete_folder(tmp_path / "first"), KeyboardInterrupt)

    assert names(tmp_path) == []


def test_forced_folders_keep_what_is_not_replaced(tmp_path):
    """Files of the same name are replaced."""
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    with complete_folder(tmp_path, force=True) as temporary:
        (temporary / "a").write_text("new")

    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a": "new", "b": "old"}


@pytest.fixture
def old_results(tmp_path):
    """A folder with results."""
    folder = tmp_path / "out"
    folder.mkdir()
    for name in ("page", "image"):
        (folder / name).write_text("old")
    folder.chmod(0o750)
    return folder


def write_new(folder):
    with complete_folder(folder, force=True) as temporary:
        for name in ("page", "image", "table"):
            (temporary / name).write_text("new")


def contents(folder):
    return {path.name: path.read_text() for path in folder.iterdir() if path.is_file()}


OLD = {"page": "old", "image": "old"}
NEW = {"page": "new", "image": "new", "table": "new"}


def test_forced_folders_appear_at_once(old_results, tmp_path, monkeypatch):
    """Without one file moved by itself."""
    monkeypatch.setattr(type(tmp_path), "replace", None)
    write_new(old_results)

    assert contents(old_results) == NEW
    assert stat.S_IMODE(old_results.stat().st_mode) == 0o750
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("after", [False, True])
def test_an_interrupted_forced_folder_is_the_old_or_the_new_one(old_results, tmp_path, monkeypatch, after):
    swap = storage._swap

    def interrupted(*folders):
        if after:
            swap(*folders)
        raise KeyboardInterrupt

    monkeypatch.setattr(storage, "_swap", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_new(old_results)

    assert contents(old_results) == (NEW if after else OLD)
    assert names(tmp_path) == ["out"]


def test_what_another_program_puts_into_a_forced_folder_meanwhile_is_kept(old_results, tmp_path, monkeypatch):
    swap = storage._swap

    def late(new, old):
        (old / "theirs").write_text("theirs")
        swap(new, old)

    monkeypatch.setattr(storage, "_swap", late)
    write_new(old_results)

    assert contents(old_results) == NEW | {"theirs": "theirs"}
    assert names(tmp_path) == ["out"]


REWRITE = """
import itertools, sys
from pathlib import Path
from solidtouch.models.storage import complete_folder

for number in itertools.count(int(sys.argv[2])):
    with complete_folder(Path(sys.argv[1]), force=True) as temporary:
        for name in "abcdefgh":
            (temporary / name).write_text(str(number))
    print("written", flush=True)
"""


@pytest.mark.slow
def test_a_killed_forced_folder_is_the_old_or_the_new_one(tmp_path, rng):
    """Killed while it writes one generation of files after the other; not so if files are moved one by one."""
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
    try:
        storage._swap(tmp_path / "one", tmp_path / "other")
    except (OSError, AttributeError) as error:
        pytest.skip(f"Folders cannot be exchanged here: {error}.")
    folder = tmp_path / "out"
    folder.mkdir()
    for kill in range(20):
        with subprocess.Popen(
            [sys.executable, "-c", REWRITE, folder, str(1000 * kill)], stdout=subprocess.PIPE
        ) as process:
            process.stdout.readline()
            time.sleep(rng.uniform(0.0, 0.02))
            process.kill()
        found = contents(folder)
        assert sorted(found) == list("abcdefgh")
        assert len(set(found.values())) == 1


@pytest.mark.parametrize("case", ["no exchange", "no function for it", "another file", "a folder", "working directory"])
def test_forced_folders_are_written_where_they_are_not_exchanged(old_results, tmp_path, monkeypatch, case):
    def refuse(*_):
        raise AttributeError if "function" in case else PermissionError(errno.EPERM, "Operation not permitted")

    if case.startswith("no "):
        monkeypatch.setattr(storage, "_swap", refuse)
    elif case == "working directory":
        monkeypatch.chdir(old_results)
    else:
        (old_results / "mine").write_text("old") if case == "another file" else (old_results / "mine").mkdir()
    inode = old_results.stat().st_ino
    write_new(old_results)

    assert old_results.stat().st_ino == inode
    assert contents(old_results) == NEW | ({"mine": "old"} if case == "another file" else {})
    assert (old_results / "mine").exists() == (case in {"another file", "a folder"})
    assert names(tmp_path) == ["out"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no disk that is always full")
def test_a_disk_that_fills_is_no_matter_of_hdf5():
    """Which may crash Python later."""
    with pytest.raises(OSError, match="No space left on device") as error:
        write_netcdf(xr.Dataset({"x": ("t", np.arange(1000.0))}), Path("/dev/full"))
    assert error.value.errno == errno.ENOSPC


def test_large_netcdf_files_do_not_go_through_memory(tmp_path, monkeypatch):
    small = xr.Dataset({"x": ("t", np.arange(1000.0))})
    monkeypatch.setattr(type(tmp_path), "write_bytes", None)
    with pytest.raises(TypeError):
        write_netcdf(small, tmp_path / "small.nc")
    monkeypatch.setattr(storage, "ON_DISK", 100)
    write_netcdf(small, tmp_path / "large.nc")
    xr.testing.assert_identical(xr.load_dataset(tmp_path / "large.nc"), small)


def test_an_empty_folder_is_taken(tmp_path):
    """It holds nothing that could be lost."""
    assert check_folder(tmp_path) == tmp_path


def test_folders_that_hold_something_are_refused(tmp_path):
    """So are files."""
    (tmp_path / "a").touch()
    with pytest.raises(InputError, match=r"already exists; use --force to overwrite the files in it"):
        check_folder(tmp_path)
    with pytest.raises(InputError, match="a: is a file, expected a folder"):
        check_folder(tmp_path / "a", force=True)


def test_folders_that_cannot_be_made_are_refused(tmp_path):
    """A file stands where the folder above should be."""
    (tmp_path / "a").touch()
    with pytest.raises(InputError, match="cannot create the folder"), complete_folder(tmp_path / "a" / "b"):
        pytest.fail("the block is entered")


def test_a_folder_without_permission_is_not_one_that_cannot_be_made(tmp_path, monkeypatch):
    """One that is there cannot be written; one that is not cannot be created."""
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path))}: the folder is not writable"):
        check_folder(tmp_path)
    with pytest.raises(InputError, match=f"cannot create the folder: {re.escape(str(tmp_path))} is not writable"):
        check_folder(tmp_path / "new")


def test_devices_and_pipes_are_never_replaced(tmp_path):
    """Even with force."""
    os.mkfifo(tmp_path / "pipe.nc")
    with pytest.raises(InputError, match=r"pipe\.nc: not a regular file, so not overwritten"):
        check_writable(tmp_path / "pipe.nc", force=True)


def test_a_disk_that_fills_while_a_folder_is_written_is_an_input_error(tmp_path):
    """The folder is named and nothing of it stays."""
    with pytest.raises(InputError, match="run: cannot write: No space left on device"):
        write_half(complete_folder(tmp_path / "run"), OSError(errno.ENOSPC, "No space left on device"))

    assert names(tmp_path) == []


def test_groups_are_written_and_read_as_xarray_does_it(tmp_path):
    """Dimensions with and without values, text, booleans, missing values, packed numbers, attributes of all kinds."""
    inner = xr.Dataset(
        {
            "level": (
                ("object", "taxel"),
                np.array([[1.0, np.nan, 3.0], [4.0, 5.0, 6.0]]),
                {"unit": "mm", "at": [1, 2]},
            ),
            "packed": ("taxel", [0.5, 1.5, np.nan], {}, {"dtype": "i2", "scale_factor": 0.5, "_FillValue": -1}),
            "seen": ("object", [True, False]),
            "note": ("taxel", ["a", "", "ünicode"]),
            "alone": ((), 3),
            "none": (("object", "nothing"), np.zeros((2, 0))),
        },
        {"object": ["rod 4 mm", "rod 6 mm"], "place": ("taxel", [0.5, 1.5, 2.5]), "trial": [7, 8, 9]},
        {"format": 2, "name": "x", "share": 0.25, "empty": "", "names": ["a", "b"]},
    )
    path = tmp_path / "a.nc"
    write_groups({"/": xr.Dataset(attrs={"kind": "tree"}), "inner": inner}, path)

    found = read_groups(path, ("/", "inner", "missing"))
    assert found["/"].attrs == {"kind": "tree"}
    xr.testing.assert_identical(found["inner"], inner)
    assert found["missing"].identical(xr.Dataset())

    tree = xr.DataTree.from_dict({"/": inner[["object"]], "/a/b": inner, "/a/c": inner["level"].to_dataset()})
    write_netcdf(tree, path)
    tree.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    for name in ("a.nc", "b.nc"):
        with xr.open_datatree(tmp_path / name, engine="h5netcdf") as read:
            assert read.identical(tree)
            assert [[*node.variables] for node in read.subtree] == [[*node.variables] for node in tree.subtree]


def test_what_is_no_netcdf_file_is_refused(tmp_path):
    (tmp_path / "a.nc").write_bytes(b"text")

    for name, message in {"a.nc": "not a netCDF file", "b.nc": "no such file", ".": "is a folder"}.items():
        with pytest.raises(InputError, match=message):
            read_groups(tmp_path / name, "/")


def test_a_file_that_finds_no_memory_is_written_directly(tmp_path):
    """In a process that may hold too little for three copies; without them HDF5 would crash it later."""
    code = f"""
import resource
import numpy as np, xarray as xr
from solidtouch.models import storage
data = xr.Dataset({{"a": ("x", np.arange(2.0**24))}})
storage.BytesIO = None
limit = int(open("/proc/self/statm").read().split()[5]) * resource.getpagesize() + 2**28
resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
storage.write_netcdf(data, {str(tmp_path / "a.nc")!r})
"""
    subprocess.run([sys.executable, "-c", code], check=True)

    with xr.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as read:
        assert read["a"].size == 2**24
        assert read["a"][-1] == 2**24 - 1


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the peak of memory is read from /proc")
def test_asking_for_memory_takes_none():
    """Models of a hundred megabytes took three times their size while they were saved."""
    code = """
from pathlib import Path
from solidtouch.models.storage import _has_memory
assert _has_memory(1 << 29)
peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(int(peak.split()[1]) >> 10)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 256
