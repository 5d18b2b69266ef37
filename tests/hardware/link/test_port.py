"""A port on a pseudo-terminal: bytes both ways, finite waits, and nothing but `RigError` whatever happens."""

import fcntl
import os
import tty
from pathlib import Path

import pytest
from solidtouch.hardware.errors import PortBusy, PortError, PortLost, RigError, WriteTimeout
from solidtouch.hardware.link.port import Port


class Peer:
    """The other end of a pseudo-terminal."""

    def __init__(self):
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        os.close(slave)

    def write(self, data):
        os.write(self.master, data)

    def read(self):
        return os.read(self.master, 4096)

    def unplug(self):
        if self.master is not None:
            os.close(self.master)
            self.master = None


@pytest.fixture
def peer():
    peer = Peer()
    yield peer
    peer.unplug()


@pytest.fixture
def port(peer):
    port = Port(peer.name)
    port.open()
    yield port
    port.close()


def test_bytes_come_and_go(port, peer):
    port.write(b"?\x18\xff")
    peer.write(b"ok\r\n\x07\x80")

    assert peer.read() == b"?\x18\xff"
    assert port.read() == b"ok\r\n\x07\x80"
    assert (port.sent, port.received) == (3, 6)


def test_reading_nothing_returns_at_once(port):
    assert port.read() == b""
    assert port.waiting() == 0


def test_waiting_tells_what_can_be_read(port, peer):
    peer.write(b"abc")
    os.read(port.fileno(), 1)

    assert port.waiting() == 2


def test_what_came_before_the_port_was_opened_is_gone(peer):
    peer.write(b"old")
    port = Port(peer.name)
    port.open()
    peer.write(b"new")

    assert port.read() == b"new"

    port.close()


def test_opening_twice_keeps_the_counts_and_opening_anew_starts_them(port, peer):
    port.write(b"abc")
    port.open()

    assert port.sent == 3

    port.close()
    port.open()

    assert (port.sent, port.received) == (0, 0)


def test_a_closed_port_cannot_be_used(port):
    port.close()
    port.close()

    assert not port.is_open
    assert port.fileno() is None
    assert port.waiting() == 1  # so that whoever waits reads it and learns why
    with pytest.raises(PortLost, match=r"/dev/pts/.*: the port is closed"):
        port.read()
    with pytest.raises(PortLost, match="the port is closed"):
        port.write(b"a")


def test_a_port_that_vanishes_is_lost_on_reading(port, peer):
    peer.unplug()

    assert port.waiting() == 1
    with pytest.raises(PortLost, match=r"/dev/pts/.*: lost the port while reading; it was unplugged"):
        port.read()
    assert not port.is_open


def test_a_port_that_vanishes_is_lost_on_writing(port, peer):
    peer.unplug()

    with pytest.raises(PortLost, match="lost the port while writing"):
        port.write(b"a")
    assert port.sent == 0


def test_a_lost_port_can_be_opened_again(port, peer):
    peer.unplug()
    with pytest.raises(PortLost):
        port.read()
    again = Peer()
    port.address = again.name
    port.open()
    again.write(b"back")

    assert port.read() == b"back"

    again.unplug()


def test_a_device_that_takes_nothing_ends_the_write(peer, monkeypatch):
    monkeypatch.setattr("solidtouch.hardware.link.port.WRITE_TIMEOUT_S", 0.05)
    port = Port(peer.name)
    port.open()

    with pytest.raises(WriteTimeout, match=r"took no bytes for 0.05 s; part of them may have arrived"):
        port.write(bytes(1_000_000))

    assert port.is_open
    port.close()


def test_a_second_program_finds_the_port_busy(port, peer):
    with pytest.raises(PortBusy, match="another program has the port open"):
        Port(peer.name).open()


def test_a_port_locked_by_another_program_is_busy(peer):
    with Path(peer.name).open("rb", buffering=0) as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(PortBusy, match="another program has the port open"):
            Port(peer.name).open()


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("/dev/no-such-port", "/dev/no-such-port: cannot open the port: no such port."),
        ("/dev/null", "/dev/null: cannot open the port: "),
        ("nonsense://x", "nonsense://x: cannot open the port: "),
        ("socket://127.0.0.1:1", "socket://127.0.0.1:1: cannot open the port: "),
        ("", ": cannot open the port: "),
    ],
)
def test_what_cannot_be_opened_is_named_in_one_sentence(address, sentence):
    port = Port(address)
    with pytest.raises(PortError) as caught:
        port.open()

    assert str(caught.value).startswith(sentence)
    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)
    assert not port.is_open


def test_an_impossible_baud_rate_is_an_error_of_the_port(peer):
    with pytest.raises(PortError, match="cannot open the port"):
        Port(peer.name, baud=-1).open()


def test_a_port_without_a_file_works_too():
    port = Port("loop://")
    port.open()
    port.write(b"abc")

    assert port.fileno() is None
    assert port.waiting() == 3
    assert port.read() == b"abc"

    port.close()
    with pytest.raises(PortLost, match="loop://: the port is closed"):
        port.read()


def test_every_error_of_a_port_is_a_rig_error():
    assert all(issubclass(error, RigError) for error in (PortBusy, PortError, PortLost, WriteTimeout))
