"""The emulated SLCAN adapter."""

import re
from dataclasses import replace
from itertools import pairwise
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.emulator.adapter import Adapter
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.finger import Finger
from solidtouch.hardware.emulator.skin_board import SkinBoard
from solidtouch.hardware.simulator.settings import PRESETS

QUIET = replace(PRESETS["ideal"], white_counts=0.0)
OPEN = b"S8\rO\r"
STREAM = b"t20E44D0114F0\rt20E750000000010022\rt20E20700\r"
HEAD, TAIL = b"t4E0840F0F0F0F0F0F0F0\r", b"t4E08C0F0F0F0F0F00000\r"


@pytest.fixture
def switches():
    return Switches()


@pytest.fixture
def adapter(switches):
    return make(switches)


def make(switches):
    adapter = Adapter(switches, SkinBoard(switches, Finger(QUIET, lambda _: (8.0, 0.0), 0, 0)))
    adapter.opened(0.0)
    return adapter


def ask(adapter, data, time_s=0.0):
    adapter.receive(data, time_s)
    return adapter.step(time_s)


def listen(adapter, ticks):
    return [adapter.step(adapter.next_event_s()) for _ in range(ticks)]


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"\r", b"\r"),
        (b"\r\r\r", b"\r\r\r"),
        (b"C\r", b"\a"),
        (b"S8\rS0\rS9\rS\rS08\r", b"\r\r\a\a\a"),
        (b"O\rO\rL\rC\rC\r", b"\r\a\a\r\a"),
        (b"L\rt20E0\rr20E0\rF\rC\r", b"\r\a\aF00\r\r"),
        (b"O\rS8\rZ1\rM00000000\rm00000000\r", b"\r\a\a\a\a"),
        (b"Z0\rZ1\rZ2\rM0000000F\rmffffffff\rM0\r", b"\r\r\a\r\r\a"),
        (b"V\rN\rV1\rF\r", b"V1013\rNA123\r\a\a"),
        (b"O\rF\rV\r", b"\rF00\rV1013\r"),
        (b"t20E0\r", b"\a"),
        (b"O\rt20E0\rt20E101\rt20E8FFffFFffFFffFFff\r", b"\rz\rz\rz\r"),
        (b"O\rt20E\rt20E1\rt20E10\rt20E0FF\rt80E0\rt20E9\rt2GE0\rt20E1G0\r", b"\r" + 8 * b"\a"),
        (b"O\rT0000020E0\rT1FFFFFFF101\rT200000000\rT00000000\r", b"\rZ\rZ\r\a\a"),
        (b"O\rr20E8\rR0000020E0\rr20E9\rr20E101\r", b"\rz\rZ\r\a\a"),
        (b"o\rX\r\a\r\nC\rAT\r", b"\a\a\a\a\a"),
        (b"C\rS8\r\rO\rO\r", b"\a\r\r\r\a"),
    ],
)
def test_commands_are_answered(adapter, sent, answered):
    """A carriage return where a command is obeyed, a bell where it is not; the last are python-can's."""
    assert ask(adapter, sent) == answered


@given(st.lists(st.integers(0, 60), max_size=5))
def test_commands_may_come_in_pieces(cuts):
    """However the bytes are cut, the answers are the same."""
    sent = OPEN + b"V\r" + STREAM
    adapter, answered = make(Switches()), b""
    at = sorted({0, len(sent), *(min(cut, len(sent)) for cut in cuts)})
    for start, end in pairwise(at):
        answered += ask(adapter, sent[start:end])

    assert answered == b"\r\rV1013\rz\rz\rz\r"


def test_readings_come_in_pairs(adapter):
    """Head and tail of every tick, as text with capital digits."""
    ask(adapter, OPEN + STREAM, 5.0)

    assert adapter.next_event_s() == pytest.approx(5.02)
    assert adapter.step(5.01) == b""
    assert adapter.step(5.03) == HEAD + TAIL
    assert adapter.step(5.09) == 3 * (HEAD + TAIL)


def test_the_board_answers_over_the_bus(adapter):
    """The answer comes behind that of the adapter."""
    assert ask(adapter, OPEN + b"t20E31C0100\r") == b"\r\rz\rt2E081C0B010500010001\r"


@pytest.mark.parametrize("start", [b"O\r", b"S6\rO\r"])
def test_only_a_bus_at_1_mbit_is_heard(adapter, start):
    """At another bit rate commands are sent and nobody hears them."""
    assert ask(adapter, start + STREAM).endswith(b"z\rz\rz\r")
    assert adapter.next_event_s() == inf


def test_a_closed_channel_passes_nothing_on(adapter):
    """The board streams on, and is heard again when the channel opens."""
    ask(adapter, OPEN + STREAM)
    ask(adapter, b"C\r", 0.01)
    assert listen(adapter, 3) == [b"", b"", b""]
    ask(adapter, b"L\r", 0.07)
    assert listen(adapter, 1) == [HEAD + TAIL]


def test_time_stamps_wrap_after_a_minute(adapter):
    """With `Z1` frames end in milliseconds as four digits."""
    ask(adapter, b"Z1\r" + OPEN + STREAM, 59.985)

    stamps = [line[-4:] for data in listen(adapter, 2) for line in data.split(b"\r")[:-1]]
    assert [int(stamp, 16) for stamp in stamps] == pytest.approx([5, 5, 25, 25], abs=1)


def test_output_waits_and_is_lost_when_the_port_closes(adapter):
    """Until it is stepped it says since when something waits."""
    adapter.receive(b"V\r", 2.0)
    assert adapter.next_event_s() == 2.0
    adapter.closed(2.0)

    assert adapter.step(2.0) == b""
    assert adapter.next_event_s() == inf


def test_without_acks_only_the_version_is_answered(adapter, switches):
    """Commands are obeyed, and the version does not start with its letter."""
    switches.on("no_acks")
    assert ask(adapter, b"C\r" + OPEN + b"O\rF\rN\rZ1\r" + STREAM) == b""
    assert re.fullmatch(rb"(?!V)[ -~]+\r", ask(adapter, b"V\r"))
    assert listen(adapter, 1) == [HEAD + TAIL]


def test_a_bell_refuses_a_command(adapter, switches):
    """What is refused is not done; closing and empty commands are spared."""
    switches.on("bell", times=2)

    assert ask(adapter, b"\rC\rS8\rO\rF\r") == b"\r\a\a\a\a"
    assert ask(adapter, OPEN) == b"\r\r"


def test_left_open_it_streams_at_once(switches):
    """Opening is refused until it is closed."""
    switches.on("left_open", times=1)
    adapter = make(switches)

    assert listen(adapter, 2) == [HEAD + TAIL, HEAD + TAIL]
    assert ask(adapter, b"S8\rO\rC\rO\r", 0.05) == b"\a\a\r\r"


def test_lost_and_swapped_halves(adapter, switches):
    """A tick without its readings, with one half, and with the halves the wrong way round."""
    ask(adapter, OPEN + STREAM)
    switches.on("lost_frames", times=1, count=2)
    switches.on("lost_half", times=1)
    switches.on("swapped_halves", times=1)
    data = listen(adapter, 4)

    assert data[:2] == [b"", b""]
    assert data[2] in {HEAD, TAIL}
    assert data[3] == HEAD + TAIL
    switches.on("swapped_halves", times=1)
    assert listen(adapter, 1) == [TAIL + HEAD]


@given(st.lists(st.binary(max_size=60) | st.sampled_from([b"\r", OPEN, STREAM, b"t20E"]), max_size=30))
def test_random_bytes_never_raise(pieces):
    """Whatever comes, what goes out consists of answers and frames."""
    adapter = make(Switches())
    for t, piece in enumerate(pieces):
        answer = ask(adapter, piece, t / 10)
        assert re.fullmatch(rb"(?:\r|\a|z\r|Z\r|F00\r|V1013\r|NA123\r|t[0-9A-F]{4,20}\r)*", answer)


def test_memory_is_bounded(adapter):
    """Endless commands and unread output are cut off, and the next command is understood."""
    for _ in range(50):
        adapter.receive(b"S" * 10_000, 0.0)
    assert ask(adapter, b"\rV\r") == b"\aV1013\r"
    adapter.receive(b"V\r" * 50_000, 0.0)

    assert len(adapter.step(0.0)) <= 65536
