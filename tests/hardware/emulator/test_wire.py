"""Faults of a wire: each does what its meaning says, and bytes never overtake each other."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.wire import Wire

LINE = b"<Idle|MPos:0.000>\r\n"


@pytest.fixture
def switches():
    return Switches(seed=3)


@pytest.fixture
def wire(switches):
    return Wire("stage", switches)


def everything(wire):
    """All pieces with the times at which they arrive."""
    pieces = []
    while (time_s := wire.next_event_s()) < float("inf"):
        pieces.append((time_s, wire.arrived(time_s)))
    return pieces


def sent(wire, data=LINE, time_s=1.0):
    wire.send(data, time_s)
    return b"".join(data for _, data in everything(wire))


def test_without_faults_output_arrives_whole_and_at_once(wire):
    wire.send(LINE, 1.0)

    assert everything(wire) == [(1.0, LINE)]
    assert wire.arrived(2.0) == b""


def test_a_split_output_comes_in_pieces(wire, switches):
    switches.on("split", size=7, delay_s=0.5)
    wire.send(LINE, 1.0)

    assert [(1.0, LINE[:7]), (1.5, LINE[7:14]), (2.0, LINE[14:])] == everything(wire)


@pytest.mark.parametrize("count", [1, 4])
def test_bytes_are_missing(wire, switches, count):
    switches.on("drop_bytes", count=count)
    left = iter(LINE)
    got = sent(wire)

    assert len(LINE) - count == len(got)
    assert all(byte in left for byte in got)  # in the same order


def test_more_bytes_than_there_are_cannot_be_missing(wire, switches):
    switches.on("drop_bytes", count=99)

    assert sent(wire) == b""


@pytest.mark.parametrize(
    ("data", "merged"),
    [(b"ok\r\n", {b"ok"}), (b"a\rb\r", {b"ab\r", b"a\rb"}), (b"\x07t", {b"t"}), (b"1\n", {b"1"})],
)
def test_a_line_end_is_missing(wire, switches, data, merged):
    switches.on("merge")

    assert sent(wire, data) in merged


def test_without_a_line_end_nothing_merges(wire, switches):
    switches.on("merge", times=1)

    assert sent(wire, b"abc") == b"abc"
    assert switches.is_on("merge")


@pytest.mark.parametrize("count", [1, 3])
def test_bits_are_flipped(wire, switches, count):
    switches.on("flip_bits", count=count)
    got = sent(wire)
    flipped = sum((a ^ b).bit_count() for a, b in zip(LINE, got, strict=True))

    assert 1 <= flipped <= count
    assert flipped % 2 == count % 2


def test_garbage_has_the_length_of_the_output(wire, switches):
    switches.on("garbage")
    got = sent(wire)

    assert len(LINE) == len(got)
    assert got != LINE


def test_late_output_keeps_its_order(wire, switches):
    switches.on("late", delay_s=1.0)
    for i in range(50):
        wire.send(b"%c" % i, 0.01 * i)
    pieces = everything(wire)

    assert bytes(range(50)) == b"".join(data for _, data in pieces)
    assert all(0.01 * data[0] <= time_s <= 0.01 * data[-1] + 1.0 for time_s, data in pieces)
    assert pieces[0][0] > 0


def test_a_fault_of_the_other_port_does_not_strike(wire, switches):
    switches.on("drop_bytes", times=1, port="sensor")

    assert sent(wire) == LINE
    assert switches.is_on("drop_bytes")


@given(
    outputs=st.lists(st.binary(max_size=20), max_size=12),
    on=st.sets(st.sampled_from(["split", "drop_bytes", "merge", "flip_bits", "garbage", "late"])),
    seed=st.integers(0, 1000),
)
def test_time_never_runs_back_and_no_byte_is_invented(outputs, on, seed):
    switches = Switches(seed)
    for name in on:
        switches.on(name, rate=0.5)
    wire = Wire("sensor", switches)
    for i, data in enumerate(outputs):
        wire.send(data, 0.01 * i)
    pieces = everything(wire)
    times = [time_s for time_s, _ in pieces]

    assert times == sorted(times)
    assert sum(len(data) for _, data in pieces) <= sum(map(len, outputs))
