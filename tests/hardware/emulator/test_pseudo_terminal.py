"""A pseudo-terminal as the device's end of a line: opens and closes are seen, nothing echoes, full buffers drop."""

import fcntl
import os
from pathlib import Path

import pytest
from solidtouch.hardware.emulator.pseudo_terminal import PseudoTerminal
from solidtouch.models.errors import InputError


@pytest.fixture
def terminal(tmp_path):
    terminal = PseudoTerminal(tmp_path / "port")
    yield terminal
    terminal.unplug()


@pytest.fixture
def program(terminal):
    file = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    yield file
    os.close(file)


EVERY_BYTE = bytes(range(256))


def test_nobody_has_a_new_one_open(terminal):
    assert terminal.is_plugged
    assert not terminal.is_open
    assert terminal.read() == b""


def test_an_open_and_a_close_are_seen(terminal):
    file = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY)

    assert terminal.is_open

    os.close(file)

    assert not terminal.is_open


def test_every_byte_comes_through_unchanged_both_ways(terminal, program):
    os.write(program, EVERY_BYTE)

    assert terminal.read(promised=256) == EVERY_BYTE

    assert terminal.write(EVERY_BYTE) == 256
    assert os.read(program, 1000) == EVERY_BYTE


def test_what_the_device_sends_does_not_come_back(terminal, program):
    terminal.write(b"hello\r\n")

    assert terminal.read() == b""
    assert not terminal.has_input


def test_a_promise_that_is_not_kept_ends_the_wait(terminal, program):
    os.write(program, b"ab")

    assert terminal.read(promised=5) == b"ab"


def test_a_full_buffer_drops_and_counts(terminal, program):
    sent = written = 0
    while terminal.overrun == 0:
        written += terminal.write(bytes(1000))
        sent += 1000

    assert terminal.overrun == sent - written
    assert written >= 4095


def test_bytes_written_before_a_close_are_still_read(terminal):
    file = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY)
    os.write(file, b"bye")
    os.close(file)

    assert terminal.read() == b"bye"


def test_what_was_left_unread_is_discarded(terminal):
    terminal.write(b"old")
    terminal.discard()
    file = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    with pytest.raises(BlockingIOError):
        os.read(file, 100)

    os.close(file)


def test_an_unplugged_one_has_no_link_and_takes_nothing(terminal, program):
    terminal.unplug()
    terminal.unplug()

    assert not terminal.link.is_symlink()
    assert (terminal.is_plugged, terminal.is_open, terminal.write(b"x"), terminal.read(9)) == (False, False, 0, b"")
    assert os.read(program, 10) == b""  # the end of the file


def test_plugged_in_again_it_has_the_same_link(terminal):
    terminal.unplug()
    terminal.plug()
    terminal.plug()
    file = os.open(terminal.link, os.O_RDWR | os.O_NOCTTY)

    assert terminal.is_open

    os.close(file)


def test_a_renumbered_one_comes_back_as_another_device(terminal):
    before = terminal.link.readlink()
    terminal.unplug(renumber=True)
    terminal.plug()

    assert before != terminal.link.readlink()


def test_a_second_reader_takes_bytes(terminal, program):
    terminal.write(b"abcdef")

    assert terminal.steal(2) == 2
    assert os.read(program, 10) == b"cdef"
    assert terminal.steal(2) == 0


def test_a_held_one_is_locked_until_it_is_released(terminal, program):
    terminal.hold()
    terminal.hold()

    with pytest.raises(BlockingIOError):
        fcntl.flock(program, fcntl.LOCK_EX | fcntl.LOCK_NB)

    terminal.release()
    fcntl.flock(program, fcntl.LOCK_EX | fcntl.LOCK_NB)


def test_closing_leaves_nothing_behind(tmp_path):
    files = len(list(Path("/proc/self/fd").iterdir()))
    terminal = PseudoTerminal(tmp_path / "port")
    terminal.unplug(renumber=True)
    terminal.plug()
    terminal.unplug()
    again = PseudoTerminal(tmp_path / "port")
    again.hold()
    again.unplug()

    assert list(tmp_path.iterdir()) == []
    assert files == len(list(Path("/proc/self/fd").iterdir()))


def test_a_link_left_behind_is_replaced(tmp_path):
    (tmp_path / "port").symlink_to("/nowhere")
    terminal = PseudoTerminal(tmp_path / "port")

    assert (tmp_path / "port").exists()

    terminal.unplug()


def test_a_link_that_someone_else_has_replaced_is_left_alone(terminal):
    terminal.link.unlink()
    terminal.link.symlink_to("/nowhere")
    terminal.unplug()

    assert terminal.link.is_symlink()


def test_a_file_of_that_name_is_not_replaced(tmp_path):
    (tmp_path / "port").write_text("mine")

    with pytest.raises(InputError, match="port: exists and is not a link to a terminal"):
        PseudoTerminal(tmp_path / "port")

    assert (tmp_path / "port").read_text() == "mine"


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match=r"missing/port: cannot create the port: No such file"):
        PseudoTerminal(tmp_path / "missing" / "port")
