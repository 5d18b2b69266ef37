"""Ctrl-C and SIGTERM where Python would lose them or print a traceback."""

import signal
import subprocess
import sys
import time
import weakref
from contextlib import suppress

import numpy as np
import pytest
from solidtouch.cli import main
from solidtouch.cli.shared.interrupt import ended_by_interrupt, repeated, terminable


class Thing:
    """Something to be deleted."""


def delete_with_signal(number):
    """Deletes a thing whose callback runs while the signal arrives; goes on for a while, as a command does."""
    thing = Thing()
    reference = weakref.ref(thing, lambda _: signal.raise_signal(number))
    del thing
    end = time.monotonic() + 5.0
    while time.monotonic() < end:
        assert reference() is None


@pytest.mark.parametrize(("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_in_a_callback_ends_the_program_all_the_same(number, error):
    before = sys.unraisablehook, signal.getsignal(signal.SIGALRM)

    with pytest.raises(error), terminable(), repeated():
        delete_with_signal(number)

    assert before == (sys.unraisablehook, signal.getsignal(signal.SIGALRM))
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


def swallow(number):
    with suppress(BaseException):
        signal.raise_signal(number)
    time.sleep(5.0)


@pytest.mark.parametrize(("number", "error"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_that_a_library_swallows_ends_the_program_all_the_same(number, error):
    with pytest.raises(error), terminable(), repeated():
        swallow(number)


def interrupt(done):
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        time.sleep(0.2)
        done.append("stopped")


def test_what_stops_after_an_interrupt_is_not_interrupted_again():
    done = []
    with pytest.raises(KeyboardInterrupt), repeated():
        interrupt(done)

    assert done == ["stopped"]


def test_a_block_that_an_interrupt_ends_is_followed_by_the_rest():
    with repeated():
        with ended_by_interrupt():
            signal.raise_signal(signal.SIGINT)
        time.sleep(0.2)

    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


def test_other_errors_in_a_callback_are_reported_as_ever(monkeypatch):
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", lambda unraisable: reported.append(unraisable.exc_type))
    thing = Thing()
    reference = weakref.ref(thing, lambda _: 1 / 0)

    with repeated():
        del thing

    assert reference() is None
    assert reported == [ZeroDivisionError]


EARLY = """
import os, signal, sys
class Finder:
    def find_spec(self, name, *more):
        if name == "{module}":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
sys.argv = ["solidtouch", "simulate", "--out", "data"]
from solidtouch.cli.main import run
run()
"""


@pytest.mark.parametrize("module", ["typer", "solidtouch.hardware.errors", "rich.progress"])
def test_a_command_interrupted_before_it_begins_says_so(module, tmp_path):
    words = [sys.executable, "-c", EARLY.format(module=module)]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)

    assert done.returncode == 130
    assert done.stderr == "solidtouch: interrupted; no file is left incomplete.\n"
    assert not (tmp_path / "data").exists()


def test_an_interrupt_before_a_command_is_found_says_so(monkeypatch, capsys):
    def interrupted(**_):
        raise KeyboardInterrupt

    monkeypatch.setattr(main, "_command", lambda: interrupted)
    with pytest.raises(SystemExit) as stopped:
        main.run()

    assert stopped.value.code == 130
    assert capsys.readouterr().err == "solidtouch: interrupted; no file is left incomplete.\n"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_while_a_file_is_written_leaves_nothing(number, code, command, tmp_path, monkeypatch):
    """Of any command; SIGTERM alone would end the program at once."""
    taps = tmp_path / "taps.npz"
    np.savez(taps, taps=np.zeros((4, 5, 2)), what=np.arange(4) % 2, what_names=np.array(["a", "b"]))
    monkeypatch.setattr("solidtouch.models.storage.Path.chmod", lambda *_: signal.raise_signal(number))

    done = command("convert", taps, tmp_path / "out.nc")

    assert (done.code, [path.name for path in tmp_path.iterdir()]) == (code, ["taps.npz"])
