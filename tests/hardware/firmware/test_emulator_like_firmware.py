"""The emulated controller answers, moves and stops as GRBL's own firmware does."""

import re
from dataclasses import replace

import pytest
from firmware_board import QUICK, Board
from grbl_answers import ANSWERS
from grbl_line import HOMED, Line
from solidtouch.models import seeds

from benchmarks.checks.damage import damages

pytestmark = pytest.mark.slow

SPEED = 8.0
HOME_MM = (-1.0, -1.0, -1.0)
STEP_MM = 0.0041
WRITES = {"shortest pulse"}
"""Names of lines that change `$0`."""
NOT_EMULATED = {"arc"}

SEQUENCES = {
    "status": [b"?"],
    "startup lines": [b"$N\n"],
    "offsets": [b"$#\n"],
    "settings": [b"$$\n"],
    "move": [b"G90G21G1X-5F600\n", b"?", b"$G\n"],
    "jog": [b"$J=G91X-5Y-2F600\n", b"?", b"$G\n"],
    "hold at rest": [b"!", b"?", b"$J=X-3F600\n", b"~", b"?"],
    "hold of a move": [b"G1X-4F120\n", b"!", b"$G\n", b"~", b"?"],
    "hold and reset": [b"G1X-9F120\n", b"!", b"\x18", b"$X\n", b"$G\n"],
    "door": [b"\x84", b"?", b"$$\n", b"~", b"?"],
    "door of a jog": [b"$J=X-9F120\n", b"\x84", b"$G\n", b"~", b"$G\n"],
    "hold of a jog": [b"$J=X-9F120\n", b"!", b"$G\n"],
    "cancel": [b"$J=X-9F120\n", b"\x85", b"$G\n"],
    "cancel at rest": [b"\x85", b"?"],
    "check": [b"$C\n", b"?", b"G1X-5F100\n", b"G1X-500F100\n", b"$J=X-2F100\n", b"$H\n", b"!", b"?", b"$C\n", b"?"],
    "sleep": [b"$SLP\n", b"?", b"G0X-1\n", b"!", b"\x18", b"?", b"$X\n", b"?"],
    "soft limit": [b"G1X-500F100\n", b"?", b"\x85", b"\n", b"\x18", b"?", b"G0X-1\n", b"$X\n", b"?"],
    "soft limit of a jog": [b"$J=X-500F100\n", b"?"],
    "machine zero": [b"$J=G53G90G21F3000\n", b"?", b"\x18", b"?", b"$J=X-5F100\n"],
    "onto a switch and off": [b"$J=Z0F600\n", b"\x18", b"$X\n", b"?", b"$J=Z-1F600\n", b"\x18", b"?"],
    "reset at rest": [b"G0X-3\n", b"\x18", b"?"],
    "reset of a move": [b"G1X-9F120\n", b"\x18", b"$G\n", b"G0X-1\n", b"$J=X-2F100\n", b"$X\n", b"$G\n"],
    "unlock at rest": [b"$X\n", b"?"],
    "dwell": [b"G4P0.2\n", b"?"],
    "end of a program": [b"G91G1F100\nM30\n", b"$G\n"],
    "rest of a cut jog": [b"G80\n", b"$J=G53X-4\n", b"6.0F600\n", b"X-46F600\n", b"?"],
    "overrides": [b"\x90\x91\x95\x99", b"?"],
    "too long and a comment": [b"(" + b"X" * 100 + b")\n", b"G" * 90 + b"\n", b"?"],
    "two lines at once": [b"G0X-2\nG0X-3\n", b"?"],
    "overflow": [b"G4P0.1\n" + b"G0X-2Y-2\n" * 13],
}
LINES = (
    b"$J=G53X-46.5000Y-35.0000Z-1.0000F1500\n",
    b"$J=G91X0.0000Y-6.5000Z0.0000F600\n",
    b"G80G21\n",
    b"$$\n",
    b"$G\n",
)
"""What the driver sends."""
REAL_TIME = frozenset(b"?!~\x18") | frozenset(range(128, 256))
STRIDE = 211
"""Every such damaged line is tried, about a minute of them."""


@pytest.fixture(scope="module")
def fast(program, tmp_path_factory):
    made = Board(program, tmp_path_factory.mktemp("fast"), SPEED, QUICK)
    yield made
    made.remove()


class Pair:
    """The firmware and the emulated controller, both homed."""

    def __init__(self, board):
        self.board, self.emulated = board, Line(replace(HOMED, values=QUICK))
        board.home(HOME_MM)
        board.line.open()
        board.say(b"\x18", 1.0, re.compile(rb"help\]\r\n"))

    def say(self, data, seconds=1.5):
        """What each answers."""
        return [plain(answer) for answer in (self.board.say(data, seconds), self.emulated.say(data, seconds))]

    def places(self):
        """Where each truly stands."""
        return self.board.place_mm, self.emulated.place


def plain(answer):
    """An answer without the fields that come now and then."""
    return re.sub(rb"\|(WCO|Ov):[^|>]*", b"", answer)


@pytest.mark.parametrize("name", [name for name in ANSWERS if name not in NOT_EMULATED])
def test_a_line_is_answered_so(fast, name):
    pair = Pair(fast)
    command, answer = ANSWERS[name]

    assert pair.say(command, 0.5) == [answer, answer]
    if name in WRITES:
        pair.say(b"$0=10\n", 0.5)


@pytest.mark.parametrize("name", SEQUENCES)
def test_a_sequence_is_answered_so(fast, name):
    pair = Pair(fast)
    for data in SEQUENCES[name]:
        firmware, emulated = pair.say(data)
        assert firmware == emulated, data
    firmware, emulated = pair.places()
    assert firmware == pytest.approx(emulated, abs=0.5)  # of a move that something stopped


def test_damaged_lines_are_answered_so(fast):
    """Answer, modes and, of motions that end soon, the place."""
    generator = seeds.generator(0, seeds.Purpose.STUDY)
    lines = [damage.apply(line) for line in LINES for damage in damages([line], generator)]
    different = []
    for data in [line for line in lines if not REAL_TIME & set(line)][::STRIDE]:
        pair = Pair(fast)
        pair.say(b"G80G21\n", 0.3)
        answers = [pair.say(data, 4.0), pair.say(b"\n", 0.3), pair.say(b"$G\n", 0.3), pair.say(b"?", 0.3)]
        states = [answer.partition(b"|")[0] for answer in answers.pop()]
        same = all(firmware == emulated for firmware, emulated in (*answers, states))
        if same and states[0] == b"<Idle":
            firmware, emulated = pair.places()
            same = firmware == pytest.approx(emulated, abs=STEP_MM)
        if not same:
            different.append((data, answers, states, pair.places()))

    assert different == []
