"""The process of a command: where compiled programs are kept, and an end that loses nothing."""

import gc
import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
from slow_cases import slow_but
from solidtouch.cli.shared import process


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """Folder of kept programs, in an environment that names none."""
    monkeypatch.setattr(os, "environ", os.environ | {"XDG_CACHE_HOME": str(tmp_path)})
    monkeypatch.delitem(os.environ, "JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setattr(warnings, "showwarning", lambda message, *_: sys.stdout.write(str(message)))
    process.keep_programs()
    folder = process.cache_folder()
    folder.mkdir(parents=True)
    (folder / "program").write_bytes(bytes(100))
    return folder


def test_programs_are_kept_in_the_cache_folder_of_the_user(kept, tmp_path):
    assert kept.is_relative_to(tmp_path)
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(kept)


def test_a_folder_that_the_environment_names_is_left_as_it_is(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "environ", {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)})

    process.keep_programs()

    assert os.environ == {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}


@pytest.mark.filterwarnings("always")
def test_programs_that_cannot_be_read_are_removed_without_a_word(kept, capsys):
    warnings.warn("Error reading persistent compilation cache entry for 'f': zlib.error: damaged", stacklevel=1)

    assert not list(kept.iterdir())
    warnings.warn("something else", stacklevel=1)
    assert capsys.readouterr().out == "something else"


def test_circular_garbage_is_collected_seldom_but_is():
    before = gc.get_threshold()
    try:
        process.collect_seldom()
        times = gc.get_stats()[0]["collections"]
        for _ in range(500_000):
            one = []
            one.append(one)
        times = gc.get_stats()[0]["collections"] - times
    finally:
        gc.set_threshold(*before)

    assert 1 <= times <= 4


LOADED = """
import gc
from solidtouch.cli.shared import interrupt, process
if {seldom}:
    process.collect_seldom()
searches = []
gc.callbacks.append(lambda phase, info: searches.append(phase))
with interrupt.loading():
    with interrupt.loading():
        pass
    kept = [[number] for number in range(500_000)]
print(len(searches), gc.get_freeze_count() > 500_000, gc.isenabled())
gc.disable()
with interrupt.loading():
    pass
assert not gc.isenabled()
"""
OF_TWO_GENERATIONS = "import gc\nof_three = gc.get_threshold\ngc.get_threshold = lambda: (*of_three()[:2], 0)\n"


@pytest.mark.parametrize(
    ("seldom", "before"),
    [(True, ""), (False, ""), (True, OF_TWO_GENERATIONS)],
    ids=["seldom", "as usual", "two generations"],
)
def test_what_a_command_loads_is_never_searched_for_garbage(seldom, before):
    """Where Python collects as usual, as in programs of others, or not at all, loading changes nothing."""
    done = subprocess.run(
        [sys.executable, "-c", before + LOADED.format(seldom=seldom)], capture_output=True, text=True, check=True
    )
    searches, kept, on = done.stdout.split()

    assert (int(searches) == 0, kept, on) == (seldom, str(seldom), "True")


END = """
import atexit, sys, threading, time
from solidtouch.cli.shared import process
from solidtouch.cli.shared.process import leave

class Never:
    def __del__(self):
        print("freed")

never = Never()
atexit.register(print, "at exit")
threading.Thread(target=lambda: (time.sleep(0.2), print("thread"))).start()
print("begun")
{more}
leave({code})
"""


def ended(more="", code=3, **options):
    return subprocess.run(
        [sys.executable, "-c", END.format(more=more, code=code)],
        text=True,
        check=False,
        stderr=subprocess.PIPE,
        **options,
    )


@pytest.mark.parametrize("code", [0, 3])
def test_threads_and_functions_at_exit_have_run_and_nothing_is_freed(code):
    done = ended(code=code, stdout=subprocess.PIPE)

    assert (done.returncode, done.stdout, done.stderr) == (code, "begun\nthread\nat exit\n", "")


def test_output_that_cannot_be_written_is_told_as_python_does():
    """`/dev/full` takes nothing."""
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = ended(stdout=full)

    assert done.returncode not in (0, 3)
    assert "No space left on device" in done.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no disk that is always full")
def test_a_full_disk_for_the_output_is_one_sentence():
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        words = [sys.executable, "-P", "-m", "solidtouch.cli", "--version"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)

    assert (done.returncode, done.stderr) == (
        2, "solidtouch: the output cannot be written: No space left on device.\n",
    )  # fmt: skip


def test_programs_are_removed_when_they_have_become_many(kept):
    more = "process._MOST_BYTES = {}; sys.modules['jax'] = None"
    env = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(kept)}

    ended(more.format(100), env=env, stdout=subprocess.DEVNULL)
    assert kept.exists()
    ended(more.format(99), env=env, stdout=subprocess.DEVNULL)
    assert not kept.exists()


LONG = """
import os, signal, sys, threading, time
from solidtouch.cli.main import app, program
from solidtouch.models.threads import in_order, other_threads

@app.command()
def long():
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    {work}

sys.argv = ["solidtouch", "long"]
program()
"""


WAITING = [
    "list(in_order([lambda: time.sleep(60)] * 4, 2))",
    "with other_threads(2) as threads: threads.submit(time.sleep, 60).result()",
    "with other_threads(1) as threads: list(in_order([lambda: threads.submit(time.sleep, 60).result()] * 4, 2))",
]


@pytest.mark.parametrize("work", slow_but(WAITING[2:], WAITING))
def test_nobody_waits_for_threads_after_an_interrupt(work):
    """Though they are in compiled code that hears of nothing."""
    start = time.monotonic()
    done = subprocess.run([sys.executable, "-c", LONG.format(work=work)], capture_output=True, text=True, check=False)

    assert done.returncode == 130
    assert done.stderr == "solidtouch: interrupted; no file is left incomplete.\n"
    assert time.monotonic() - start < 30


def test_a_module_is_empty_inside_alone():
    with process.empty("wsgiref.headers", "nobody"):
        from wsgiref import headers

        assert not hasattr(headers, "Headers")
    from wsgiref import headers

    assert headers.Headers
