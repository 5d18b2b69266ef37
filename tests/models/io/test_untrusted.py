"""Files that crash or hang a library end in a sentence, and files of this software are read at once."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import pytest
from scipy.io import savemat
from solidtouch.models.errors import InputError
from solidtouch.models.io import untrusted
from solidtouch.models.io.load import load_taps


@pytest.fixture
def saved(make_taps, tmp_path):
    path = tmp_path / "taps.nc"
    make_taps(repeats=1).save(path)
    return path


@pytest.fixture
def children(monkeypatch):
    """The files that other processes read."""
    read, ask = [], untrusted._ask

    def asked(request, seconds):
        read.append(json.loads(request)[4])
        return ask(request, seconds)

    monkeypatch.setattr(untrusted, "_ask", asked)
    return read


@pytest.fixture
def starts(monkeypatch):
    """The processes that are started from now on."""
    untrusted._end_all()
    started, start = [], subprocess.Popen

    def popen(*arguments, **how):
        started.append(start(*arguments, **how))
        return started[-1]

    monkeypatch.setattr(untrusted.subprocess, "Popen", popen)
    yield started
    untrusted._end_all()


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


@pytest.mark.slow
def test_a_store_that_hangs_its_library_is_refused(make_taps, tmp_path, monkeypatch):
    """Zarr 3.1 makes as many texts as a chunk says that it holds."""
    monkeypatch.setattr(untrusted, "_MEMORY", 300 << 20)
    path = tmp_path / "taps.zarr"
    dataset = make_taps(repeats=1).dataset
    dataset = dataset.assign_coords(what_name=dataset["what_name"].astype(object))
    dataset.to_zarr(path, encoding={"what_name": {"compressors": None}}, consolidated=False)
    (chunk,) = (path / "what_name" / "c").iterdir()
    chunk.write_bytes(b"\xff\xff\xff\x7f" + chunk.read_bytes()[4:])

    with pytest.raises(InputError, match=r"taps\.zarr: reading it takes (more than 3\d\d MB of memory|longer)"):
        load_taps(path)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other limits")
def test_a_text_that_says_that_it_is_long_is_not_made(saved):
    """HDF5 makes room for it before it looks whether the file has it."""
    with h5py.File(saved) as file:
        place = file["what_name"].id.get_offset()
    content = bytearray(saved.read_bytes())
    content[place : place + 4] = b"\xff\xff\xff\x7f"
    saved.write_bytes(content)

    with pytest.raises(InputError, match=r"taps\.nc: reading it takes more than 1\.\d+ GB of memory"):
        load_taps(saved)


ENDS = {
    "hang": ("exec sleep 60", r"reading it takes longer than 1 s; the file may be damaged\."),
    "crash": ("kill -11 $$", "reading it crashes the library of its format; the file may be damaged"),
    "memory": ("exit 3", r"reading it takes more than [\d.]+ [GM]B of memory; the file may be damaged"),
}


@pytest.mark.skipif(sys.platform == "win32", reason="the child is a shell script")
@pytest.mark.parametrize(("script", "sentence"), ENDS.values(), ids=ENDS)
def test_how_a_child_ends_is_told(script, sentence, saved, tmp_path, starts, monkeypatch):
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


needs_forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no forks")
DEEDS = {
    "crash": ("os.kill(os.getpid(), 11)", "crashes the library of its format"),
    "loop": ("while True: pass", "takes longer than 1 s"),
    "wait": ("time.sleep(60)", "takes longer than 1 s"),
    "memory": ("bytes(1 << 40)", r"takes more than [\d.]+ GB of memory"),
}


@pytest.fixture
def try_file(tmp_path, starts, monkeypatch):
    """What reads a file that is a program, by running it in another process."""
    (tmp_path / "readers/isolated").mkdir(parents=True)
    reader = "import os, time\nfrom pathlib import Path\ndef read(path): exec(Path(path).read_text())\n"
    (tmp_path / "readers/isolated/programs.py").write_text(reader)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(untrusted, "__package__", "readers")
    monkeypatch.setattr(untrusted, "_SECONDS", 1)

    def run(text):
        path = tmp_path / f"{abs(hash(text))}.py"
        path.write_text(text)
        return untrusted.read_first("programs", path)

    return run


def runs(pid):
    """Whether a process runs; nobody may collect an orphan."""
    stat = Path(f"/proc/{pid}/stat")
    try:
        return stat.read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@needs_forks
def test_files_are_read_by_forks_of_one_child(try_file, starts):
    assert [try_file(text) for text in ("", "raise ValueError", "print('7')", "raise SystemExit(0)")] == [
        True,
        False,
        True,
        False,
    ]
    assert len(starts) == 1


@needs_forks
@pytest.mark.parametrize("deed", DEEDS)
def test_what_a_file_does_to_its_fork_is_told(deed, try_file, starts, monkeypatch):
    text, sentence = DEEDS[deed]
    if deed == "wait":
        monkeypatch.setattr(untrusted, "_BUSY", 0.3)
    with pytest.raises(InputError, match=f"reading it {sentence}.*; the file may be damaged"):
        try_file(text)

    assert try_file("")
    assert len(starts) == (2 if deed == "wait" else 1)
    assert starts[-1].poll() is None


@needs_forks
def test_a_child_that_ended_meanwhile_is_replaced(try_file, starts):
    assert try_file("")
    starts[0].kill()
    starts[0].wait()
    assert try_file("")
    assert len(starts) == 2


@needs_forks
def test_two_threads_read_at_a_time(try_file, starts, tmp_path):
    """Each file waits for the other."""
    text = "Path({!r}).touch()\nwhile not Path({!r}).exists(): time.sleep(0.01)\n"
    one, other = str(tmp_path / "one"), str(tmp_path / "other")
    with ThreadPoolExecutor(2) as threads:
        texts = [text.format(one, other), text.format(other, one) + "raise ValueError"]
        assert list(threads.map(try_file, texts)) == [True, False]
    assert len(starts) == 2


@needs_forks
def test_an_interrupted_reading_leaves_no_child(try_file, starts, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(untrusted, "_ready", interrupted)
    with pytest.raises(KeyboardInterrupt):
        try_file("time.sleep(60)")
    assert starts[0].poll() == -signal.SIGKILL


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("text", ["", "time.sleep(60)"], ids=["idle", "reading"])
def test_no_process_outlives_one_that_is_killed(text, try_file, tmp_path):
    """Neither a child that waits nor its fork."""
    told = tmp_path / "told"
    path = tmp_path / "program.py"
    path.write_text(f"Path({str(told)!r}).write_text(f'{{os.getpid()}} {{os.getppid()}} ')\n{text}")
    script = (
        "import time; from pathlib import Path; from solidtouch.models.io import untrusted; "
        f"untrusted.__package__ = 'readers'; untrusted.read_first('programs', Path({str(path)!r})); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", script]) as process:
        until(lambda: told.exists() and told.read_text().endswith(" "))
        fork, child = map(int, told.read_text().split())
        until(lambda: runs(fork) == bool(text))
        assert runs(child)
        process.kill()
    until(lambda: not runs(fork) and not runs(child))


def until(condition):
    end = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_without_forks_a_child_reads_each_file(try_file, starts, monkeypatch):
    monkeypatch.setattr(untrusted, "_FORKS", False)

    assert [try_file(text) for text in ("", "raise ValueError")] == [True, False]
    with pytest.raises(InputError, match="crashes the library"):
        try_file("os.abort()")
    assert [child.poll() for child in starts] == [0, 1, -signal.SIGABRT]
