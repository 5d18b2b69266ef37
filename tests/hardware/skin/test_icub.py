"""Skin messages from CAN frames and commands to CAN frames."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.hardware.skin import icub as skin
from solidtouch.hardware.skin.icub import Address, BoardVersion, Head, Pairing, Sensor, SkinReading, Tail, TaxelError
from solidtouch.hardware.skin.slcan import RemoteFrame, SlcanDecoder, SlcanFrame, transmit

INDEX = Sensor(14, 0)
HEAD = Head(INDEX, bytes([245, 244, 243, 242, 241, 240, 239]))
TAIL = Tail(INDEX, bytes([238, 237, 236, 235, 234]), 0, TaxelError(0))
RECEIVED = [
    (HEAD, 0x4E0, "40F5F4F3F2F1F0EF"),
    (TAIL, 0x4E0, "C0EEEDECEBEA0000"),
    (Tail(INDEX, TAIL.taxels, 1 << 11, TaxelError.NO_ACK), 0x4E0, "C0EEEDECEBEA8001"),
    (Tail(INDEX, TAIL.taxels, 1, TaxelError.NO_ACK | TaxelError.NOT_CONNECTED), 0x4E0, "C0EEEDECEBEA0013"),
    (Tail(Sensor(14, 4), TAIL.taxels, 0xABC, TaxelError.NOT_CONNECTED), 0x4E4, "C0EEEDECEBEAABC2"),
    (BoardVersion(14, 5, (2, 10, 9), (1, 2), True), 0x2E0, "1C05020A09010201"),
]
"""Units, identifiers and data; the same are built again from the units below."""

COMMANDS = [
    (skin.board_command(14), b"t20E44D0114F0\r"),
    (skin.board_command(14, skin_type=7, period_ms=209, no_load=245), b"t20E44D07D1F5\r"),
    (skin.triangles_command(14, 0, 15, enabled=False), b"t20E750000F00000022\r"),
    (skin.triangles_command(14, 0, 4, shift=2, offset=0x2001), b"t20E750000402010120\r"),
    (skin.start_command(14), b"t20E20700\r"),
    (skin.stop_command(14), b"t20E20701\r"),
    (skin.version_command(1, 2, 3), b"t20131C0203\r"),
]
HALVES = st.builds(
    lambda board, triangle, head: (
        Head(Sensor(board, triangle), bytes(7)) if head else Tail(Sensor(board, triangle), b"")
    ),
    st.integers(13, 14),
    st.integers(0, 1),
    st.booleans(),
)


def data_of(unit):
    """The data bytes of a unit, written out as the protocol's tables say."""
    if isinstance(unit, Head):
        return [0x40, *unit.taxels]
    if isinstance(unit, Tail):
        word = sum(1 << (4 + t) for t in range(12) if unit.out_of_range >> t & 1) + int(unit.error)
        return [0xC0, *unit.taxels, word // 256, word % 256]
    return [0x1C, unit.board_type, *unit.firmware, *unit.protocol, int(unit.compatible)]


@pytest.mark.parametrize(("unit", "identifier", "data"), RECEIVED)
def test_messages_are_read_and_written(unit, identifier, data):
    assert unit == skin.decode(SlcanFrame(identifier, bytes.fromhex(data)))
    assert bytes.fromhex(data) == bytes(data_of(unit))


@pytest.mark.parametrize(("frame", "wire"), COMMANDS)
def test_commands_are_these_bytes(frame, wire):
    assert wire == transmit(frame)
    assert [frame] == SlcanDecoder().push(wire)
    assert skin.decode(frame) is None


def test_old_boards_send_class_3():
    assert skin.decode(SlcanFrame(0x3E0, bytes.fromhex("40F5F4F3F2F1F0EF"))) == HEAD


@pytest.mark.parametrize("length", [6, 7])
def test_tails_of_old_firmware_lack_diagnostics(length):
    assert skin.decode(SlcanFrame(0x4E0, bytes.fromhex("C0EEEDECEBEA0000")[:length])) == Tail(INDEX, TAIL.taxels)


def test_identifiers_are_taken_apart_and_put_together():
    assert skin.address(0x4E3) == Address(4, 14, 3)
    assert all(skin.identifier(skin.address(number)) == number for number in range(0x800))


@pytest.mark.parametrize(
    "frame",
    [
        SlcanFrame(0x4E0, b""),
        SlcanFrame(0x4E0, bytes.fromhex("40F5F4F3F2F1F0")),
        SlcanFrame(0x4E0, bytes.fromhex("C0EEEDECEB")),
        SlcanFrame(0x4E0, bytes.fromhex("41F5F4F3F2F1F0EF")),
        SlcanFrame(0x5E0, bytes.fromhex("40F5F4F3F2F1F0EF")),
        SlcanFrame(0x4E0, bytes.fromhex("40F5F4F3F2F1F0EF"), extended=True),
        SlcanFrame(0x2E1, bytes.fromhex("1C05020A09010201")),
        SlcanFrame(0x2E0, bytes.fromhex("1C0502")),
        RemoteFrame(0x4E0, 8),
    ],
)
def test_other_frames_are_foreign(frame):
    """Wrong length, first byte, class, destination or kind."""
    assert skin.decode(frame) is None


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: skin.start_command(15), "board must be 1 to 14, got 15"),
        (lambda: skin.board_command(1, period_ms=210), "period in ms must be 1 to 209"),
        (lambda: skin.board_command(1, skin_type=256), "skin type"),
        (lambda: skin.board_command(1, no_load=-1), "no-load value"),
        (lambda: skin.triangles_command(1, 16, 16), "first triangle"),
        (lambda: skin.triangles_command(1, 3, 2), "last triangle must be 3 to 15"),
        (lambda: skin.triangles_command(1, 0, 0, shift=256), "shift"),
        (lambda: skin.triangles_command(1, 0, 0, offset=1 << 16), "offset"),
        (lambda: skin.version_command(1, major=256), "protocol major"),
        (lambda: skin.version_command(1, minor=256), "protocol minor"),
    ],
)
def test_arguments_out_of_range_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.parametrize("halves", [[(HEAD, 1.0), (TAIL, 1.001)], [(TAIL, 0.999), (HEAD, 1.0)]])
def test_halves_pair_in_either_order_at_the_time_of_the_head(halves):
    pairing = Pairing(0.01)
    readings = [pairing.push(*half) for half in halves]

    assert [None, SkinReading(INDEX, bytes(range(245, 233, -1)), 0, TaxelError(0), 1.0)] == readings
    assert (pairing.lost_heads, pairing.lost_tails, pairing.waiting) == (0, 0, 0)


def test_sensors_do_not_mix():
    pairing = Pairing(0.01)

    assert pairing.push(HEAD, 0.0) is None
    assert pairing.push(Tail(Sensor(14, 1), TAIL.taxels), 0.0) is None
    assert pairing.waiting == 2


@pytest.mark.parametrize(("missing", "lost"), [(2, (1, 0)), (3, (0, 1))])
def test_a_lost_half_costs_one_reading(missing, lost):
    """Of four ticks 20 ms apart, three are read, and the loss is counted."""
    halves = [(half, 0.02 * tick) for tick in range(4) for half in (HEAD, TAIL)]
    del halves[missing]
    pairing = Pairing(0.009)

    assert [reading.time_s for half in halves if (reading := pairing.push(*half))] == [0.0, 0.04, 0.06]
    assert lost == (pairing.lost_heads, pairing.lost_tails)


def test_halves_that_wait_at_the_end_are_lost():
    pairing = Pairing(0.01)
    pairing.push(TAIL, 0.0)
    pairing.clear()

    assert (pairing.lost_heads, pairing.lost_tails, pairing.waiting) == (1, 0, 0)


def test_a_reading_has_one_head_and_one_tail():
    with pytest.raises(ValueError, match="one head and one tail"):
        skin._joined(HEAD, 0.0, HEAD, 0.0)


@settings(deadline=None)
@given(st.lists(st.tuples(HALVES, st.floats(0, 0.1))))
def test_every_half_is_read_or_waits_or_is_counted(halves):
    pairing = Pairing(0.01)
    readings = sum(pairing.push(*half) is not None for half in halves)
    heads = sum(isinstance(half, Head) for half, _ in halves)

    assert pairing.waiting <= 4
    pairing.clear()
    assert (heads, len(halves) - heads) == (readings + pairing.lost_tails, readings + pairing.lost_heads)


@settings(deadline=None)
@given(st.integers(0, 0x7FF), st.binary(max_size=8), st.binary(max_size=60))
def test_no_frame_raises(identifier, data, noise):
    """Nor does what a decoder makes of noise."""
    skin.decode(SlcanFrame(identifier, data))
    for unit in SlcanDecoder().push(noise + b"\rt4E0840F5F4F3F2F1F0EF\r"):
        if isinstance(unit, (SlcanFrame, RemoteFrame)):
            skin.decode(unit)
