"""The emulated board of the iCub's skin."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.finger import Finger
from solidtouch.hardware.emulator.skin_board import CanFrame, SkinBoard
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.errors import InputError

QUIET = replace(PRESETS["ideal"], white_counts=0.0)
SET_BOARD = "4D 01 14 F0"
FINGER_ON = "50 00 00 00 01 00 22"
START, STOP = "07 00", "07 01"


class Bench:
    """A board, its switches, and a finger whose height is set by hand."""

    def __init__(self, *commands, settings=QUIET, **options):
        self.switches = Switches()
        self.y_mm = 0.0
        self.finger = Finger(settings, lambda _: (8.0, self.y_mm), 0, 0, 2)
        self.board = SkinBoard(self.switches, self.finger, **options)
        self.tell(*commands)

    def tell(self, *commands, time_s=0.0, identifier=0x20E):
        return [answer for text in commands for answer in self.board.hear(frame(text, identifier), time_s)]

    def taxels(self):
        """The 12 bytes of the next reading."""
        (head, tail), *_ = self.board.tick()
        return list(head.data[1:] + tail.data[1:6])


def frame(text, identifier=0x20E):
    return CanFrame(identifier, bytes.fromhex(text))


def test_the_order_of_the_start_matters():
    """Board, triangles, start streams the finger; in another order nothing comes, or all triangles do."""
    assert Bench(SET_BOARD, FINGER_ON, START).board.next_event_s() == pytest.approx(0.02)
    assert Bench(SET_BOARD, START, FINGER_ON).board.next_event_s() == inf
    assert Bench(FINGER_ON, SET_BOARD, START).board.next_event_s() == inf
    assert Bench().board.next_event_s() == inf
    untold = Bench(START)
    assert untold.board.next_event_s() == pytest.approx(0.05)
    assert len(untold.board.tick()) == 16


def test_readings_come_at_the_period_without_drifting():
    """The n-th reading is due n periods after the start."""
    bench = Bench(SET_BOARD, FINGER_ON)
    bench.tell(START, time_s=3.0)
    due = []
    for _ in range(1000):
        due.append(bench.board.next_event_s())
        bench.board.tick()

    assert due == pytest.approx([3.0 + 0.02 * n for n in range(1, 1001)], abs=1e-9)


def test_a_board_left_streaming_streams_the_finger():
    """Every 20 ms from then on, its own triangle alone."""
    bench = Bench()
    bench.board.leave_streaming(3.0)

    assert bench.board.next_event_s() == pytest.approx(3.02)
    assert bench.taxels() == [0xF0] * 12


def test_commands_while_streaming():
    """`0x4D` goes on at the new period without triangles, `0x50` stops, `0x07 01` stops."""
    bench = Bench(SET_BOARD, FINGER_ON, START)
    bench.tell("4D 01 0A F0", time_s=1.0)
    assert bench.board.next_event_s() == inf
    bench = Bench(SET_BOARD, FINGER_ON, START, FINGER_ON)
    assert bench.board.next_event_s() == inf
    bench.tell(START)
    assert bench.board.next_event_s() < inf
    bench.tell(STOP)
    assert bench.board.next_event_s() == inf


def test_frames_have_the_documented_form():
    """Head and tail of triangle 3 of board 5: identifier, first byte, 8 bytes, no diagnostics."""
    bench = Bench(board=5, triangle=3)
    bench.tell(SET_BOARD, "50 03 03 00 01 00 22", START, identifier=0x205)
    (head, tail), *rest = bench.board.tick()

    assert not rest
    assert head == frame("40" + 7 * "F0", 0x453)
    assert tail == frame("C0" + 5 * "F0" + "00 00", 0x453)


@pytest.mark.parametrize("identifier", [0x20D, 0x10E, 0x30E, 0x40E, 0x200])
def test_only_commands_for_this_board_are_obeyed(identifier):
    """Other boards and classes are not meant."""
    bench = Bench(SET_BOARD, FINGER_ON)
    assert not bench.tell(START, "1C 00 00", identifier=identifier)
    assert bench.board.next_event_s() == inf


@pytest.mark.parametrize(("identifier", "answer"), [(0x20E, 0x2E0), (0x21E, 0x2E1), (0x20F, 0x2E0)])
def test_the_version_is_answered(identifier, answer):
    """The answer goes to whoever asks, also to a broadcast, and says mtb4."""
    assert Bench().tell("1C 01 00", identifier=identifier) == [frame("1C 0B 01 05 00 01 00 01", answer)]
    assert Bench().tell("1C 02 00")[0].data[-1] == 0


@pytest.mark.parametrize("command", ["", "4D", "4D 01 00 F0", "50 00", "50 03 01 00 01 00 22", "50 00 10 00 01 00 22"])
def test_commands_cut_short_or_out_of_range_are_ignored(command):
    """They do not stop the stream either."""
    bench = Bench(SET_BOARD, FINGER_ON, START, command)

    assert bench.board.next_event_s() == pytest.approx(0.02)


def test_taxels_at_twice_their_range_are_marked():
    """Under load from twice 0xF0 steps of 4 counts on, and without load from twice the 15 steps above it on."""
    bench = Bench(SET_BOARD, "50 00 00 02 01 00 22", START)
    inside, beyond = [0, 1919, -119], [1920, -120, 5000]
    values = bench.finger.read(0.0) + np.array([*inside, *beyond, *[0] * 6])
    bench.finger.read = lambda _: values
    (_, tail), *_ = bench.board.tick()

    assert int.from_bytes(tail.data[6:], "big") >> 4 == 0b111000


def test_touch_lowers_what_is_sent():
    """A press reads below the value without load, never below 0."""
    bench = Bench(SET_BOARD, FINGER_ON, START)
    assert set(bench.taxels()) == {0xF0}
    bench.y_mm = 2.0
    some = [bench.taxels() for _ in range(20)][-1]
    bench.y_mm = 30.0
    many = [bench.taxels() for _ in range(20)][-1]

    assert min(some) < 200
    assert all(b <= a <= 0xF0 for a, b in zip(some, many, strict=True))
    assert min(many) == 0


def test_calibrating_under_load_reads_above_no_load_afterwards():
    """The board takes whatever presses for no load."""
    bench = Bench(SET_BOARD)
    bench.y_mm = 2.0
    bench.tell(FINGER_ON, time_s=10.0)
    bench.tell(START, time_s=10.0)
    pressed = bench.taxels()
    bench.y_mm = 0.0
    released = [bench.taxels() for _ in range(30)][-1]

    assert max(abs(byte - 0xF0) for byte in pressed) < 15
    assert max(released) == 255


def test_the_shift_scales_readings_down():
    """A shift of 2 leaves a quarter of the load."""
    fine, coarse = (Bench(SET_BOARD, f"50 00 00 0{shift} 01 00 22", START) for shift in (0, 2))
    for bench in (fine, coarse):
        bench.y_mm = 2.0
    load = [[0xF0 - byte for byte in [bench.taxels() for _ in range(20)][-1]] for bench in (fine, coarse)]

    assert [value >> 2 for value in load[0]] == load[1]


def test_broken_taxels_are_reported():
    """Taxels 1 and 11 read 0, are out of range, and the error says not connected."""
    bench = Bench(SET_BOARD, FINGER_ON, START)
    bench.switches.on("taxel_error", times=1, mask=1 << 1 | 1 << 11)
    (head, tail), *_ = bench.board.tick()

    assert (head.data[2], tail.data[5]) == (0, 0)
    assert tail.data[6:] == bytes.fromhex("80 22")
    assert set(bench.taxels()) == {0xF0}


def test_overloaded_taxels_read_0_and_are_not_out_of_range():
    """The end of the range is not yet twice the range."""
    bench = Bench(SET_BOARD, FINGER_ON, START)
    bench.switches.on("overload", mask=0b100)
    (head, tail), *_ = bench.board.tick()

    assert head.data == bytes.fromhex("40 F0 F0 00 F0 F0 F0 F0")
    assert tail.data[6:] == b"\0\0"


def test_the_board_recalibrates_by_itself():
    """Whatever presses is no load then."""
    bench = Bench(SET_BOARD, FINGER_ON, START)
    bench.y_mm = 2.0
    before = [bench.taxels() for _ in range(30)][-1]
    bench.switches.on("recalibrate", times=1)

    assert min(before) < 200
    assert set(bench.taxels()) == {0xF0}


def test_faults_of_the_stream():
    """A silent board sends nothing, an old one class 3, and a foreign one is there too."""
    bench = Bench(SET_BOARD, FINGER_ON, START)
    bench.switches.on("silent_sensor", times=1)
    assert bench.board.tick() == []
    bench.switches.on("old_class", times=1)
    assert [head.identifier for head, _ in bench.board.tick()] == [0x3E0]
    bench.switches.on("foreign", times=1)
    assert [head.identifier for head, _ in bench.board.tick()] == [0x410, 0x4E0, 0x4E1]


def test_stuck_values_repeat():
    """Noise stops too."""
    bench = Bench(SET_BOARD, FINGER_ON, START, settings=PRESETS["paper"])
    bench.taxels()
    bench.switches.on("stuck")

    assert len({tuple(bench.taxels()) for _ in range(20)}) == 1


def test_a_triangle_has_12_taxels():
    """A smaller finger leaves the rest without load, a larger one does not fit."""
    small = Bench(SET_BOARD, FINGER_ON, START, settings=replace(QUIET, taxels=QUIET.taxels[5:8]))
    small.y_mm = 2.5
    assert [small.taxels() for _ in range(9)][-1][3:] == 9 * [0xF0]

    with pytest.raises(InputError, match=r"finger has 24 taxels; .* has 12"):
        Bench(settings=replace(QUIET, taxels=2 * QUIET.taxels))


@given(st.lists(st.tuples(st.sampled_from([0x20E, 0x20F, 0x4E0]), st.binary(max_size=8)), max_size=20))
def test_no_command_raises(commands):
    """Whatever is on the bus, readings keep their form."""
    bench = Bench()
    for identifier, data in commands:
        bench.board.hear(CanFrame(identifier, data), 1.0)
        bench.board.hear(frame(START), 1.0)
        if bench.board.next_event_s() < inf:
            for head, tail in bench.board.tick():
                assert (head.data[0], len(head.data), tail.data[0], len(tail.data)) == (0x40, 8, 0xC0, 8)
