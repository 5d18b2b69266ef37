"""The host's clock waits for bytes, for lost ports and for the end of the wait, and no longer."""

import os
import tty

import pytest
from solidtouch.hardware.link.loop import HostClock
from solidtouch.hardware.link.port import Port


@pytest.fixture
def clock():
    return HostClock()


@pytest.fixture
def line():
    """A port and the other end of it."""
    master, slave = os.openpty()
    tty.setraw(slave)
    port = Port(os.ttyname(slave))
    os.close(slave)
    port.open()
    yield port, master
    port.close()
    os.close(master)


def waited(clock, ports, seconds):
    start = clock.now()
    clock.wait(ports, start + seconds)
    return clock.now() - start


def test_time_does_not_go_back(clock):
    times = [clock.now() for _ in range(100)]

    assert times == sorted(times)


@pytest.mark.parametrize("ports", [[], ["silent"]])
def test_silence_lasts_as_long_as_said(clock, line, ports):
    assert 0.02 <= waited(clock, [line[0]] if ports else [], 0.02) < 0.5


def test_bytes_end_the_wait(clock, line):
    port, master = line
    os.write(master, b"a")

    assert waited(clock, [port], 5.0) < 1.0
    assert port.read() == b"a"


def test_a_moment_that_is_over_is_not_waited_for(clock, line):
    assert waited(clock, [line[0]], -1.0) < 0.1


def test_a_closed_port_ends_the_wait(clock, line):
    line[0].close()

    assert waited(clock, [line[0]], 5.0) < 1.0


def test_a_vanished_port_ends_the_wait(clock):
    master, slave = os.openpty()
    port = Port(os.ttyname(slave))
    os.close(slave)
    port.open()
    os.close(master)

    assert waited(clock, [port], 5.0) < 1.0

    port.close()


def test_a_port_without_a_file_is_asked(clock):
    port = Port("loop://")
    port.open()

    assert 0.01 <= waited(clock, [port], 0.01) < 0.5

    port.write(b"a")

    assert waited(clock, [port], 5.0) < 1.0

    port.close()
