"""Whatever comes over the line, in pieces of any size and with faults, the emulated controller goes on."""

import math

import pytest
from grbl_line import Line
from hypothesis import given, settings
from hypothesis import strategies as st

COMMANDS = st.sampled_from(
    [
        *(b"$J=G91X-1F3000\n", b"$J=X-9Y-9F900\n", b"G1X-3F600\n", b"G0Y-3\n", b"G1X-900\n", b"G4P0.1\n", b"G0X1"),
        *(b"$$\n", b"$H\n", b"$X\n", b"$110=60\n", b"$22=0\n", b"$130=0\n", b"G91\n", b"G20\n", b"\r\n"),
        *(b"?", b"!", b"~", b"\x85", b"\x18"),
    ]
)
FAULTS = [
    "torn_status",
    "brown_out",
    "lost_ok",
    "extra_ok",
    "refuse_move",
    "limit_alarm",
    "silent_status",
    "false_idle",
]


@settings(max_examples=150, deadline=None)
@given(
    parts=st.lists(st.tuples(st.one_of(COMMANDS, st.binary(max_size=30)), st.floats(0.0, 1.0)), max_size=25),
    faults=st.sets(st.sampled_from(FAULTS)),
)
def test_nothing_makes_it_raise_hang_or_grow(parts, faults):
    line = Line()
    for name in faults:
        line.switches.on(name, rate=0.2)
    for data, seconds in parts:
        before = line.now
        for _ in range(3):
            assert len(line.say(data, seconds)) < 20000
        assert line.now == pytest.approx(before + 3 * seconds)
        assert all(map(math.isfinite, line.controller.position_mm(line.now)))
    line.switches.clear()
    line.say(b"~\x85\n", 60.0)
    line.say(b"\x18", 3.0)
    line.say(b"\x18", 3.0)
    assert line.say(b"\n\n", 1.0) == b"ok\r\nok\r\n"
    assert line.state() in {"Idle", "Alarm"}


@settings(max_examples=50, deadline=None)
@given(parts=st.lists(COMMANDS.filter(lambda data: data != b"\x18"), max_size=6))
def test_byte_by_byte_equals_whole(parts):
    whole, bytewise = Line(), Line()
    data = b"".join(parts)[:120]
    for byte in data:
        bytewise.controller.receive(bytes([byte]), bytewise.now)
        assert bytewise.controller.step(bytewise.now) == b""

    assert whole.say(data, 30.0) == bytewise.say(b"", 30.0)
    assert whole.controller.position_mm(whole.now) == bytewise.controller.position_mm(bytewise.now)
