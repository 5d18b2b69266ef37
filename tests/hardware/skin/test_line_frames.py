"""Lines of a simple sensor, whole, in pieces and damaged."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.skin.line_sensor import Comment, LineDecoder, LineReading

STREAM = b"7,1\n# three taxels\r\n20,1,2.5,-3\n40,+1,.5,1e2\r\n\n60,0,0,0\n"
UNITS = [
    Comment("three taxels"),
    LineReading(20, (1.0, 2.5, -3.0)),
    LineReading(40, (1.0, 0.5, 100.0)),
    LineReading(60, (0.0, 0.0, 0.0)),
]


def decoded(*pieces):
    decoder = LineDecoder(3)
    return [unit for piece in pieces for unit in decoder.push(piece)]


def test_whole_and_byte_by_byte_a_stream_says_the_same():
    assert decoded(STREAM) == UNITS
    assert decoded(*(bytes([byte]) for byte in STREAM)) == UNITS


@pytest.mark.parametrize("length", range(len(STREAM)))
def test_a_stream_cut_short_gives_what_was_complete(length):
    units = decoded(STREAM[:length])

    assert units == UNITS[: len(units)]


@pytest.mark.parametrize(
    "line",
    [
        b"20,1,2",
        b"20,1,2,3,4",
        b"20,1,2,",
        b"20,1,,3",
        b"20,1,2,3 ",
        b"20, 1,2,3",
        b"-20,1,2,3",
        b"20.5,1,2,3",
        b"4294967296,1,2,3",
        b"20,1,2,nan",
        b"20,1,2,inf",
        b"20,1,2,1e999",
        b"20,1,2,0x10",
        b"20,1,2,1_0",
        b"20,1,\xff2,3",
        b"20,1,2,3\r\r",
        b"20,1,2,320,1,2,3",
        "20,1,2,\u0663".encode(),
        b"20,1,2," + b"3" * 300,
    ],
    ids=repr,
)
def test_what_is_no_reading_is_dropped_and_counted(line):
    decoder = LineDecoder(3)

    assert decoder.push(b"\n" + line + b"\n9,1,2,3\n") == [LineReading(9, (1.0, 2.0, 3.0))]
    assert decoder.lines.dropped.malformed + decoder.lines.dropped.overlong == 1


def test_the_first_line_may_be_half_a_line_and_is_not_believed():
    assert decoded(b"20,1,2,3\n40,1,2,3\n") == [LineReading(40, (1.0, 2.0, 3.0))]
    assert decoded(b"# whole\n") == [Comment("whole")]


def test_a_line_of_another_size_is_remembered():
    decoder = LineDecoder(3)
    decoder.push(b"\n20,1,2\n")

    assert decoder.other_size == 2


@given(st.lists(st.binary(max_size=400), max_size=20))
def test_no_bytes_raise_and_few_are_kept(pieces):
    decoder = LineDecoder(3)
    for piece in pieces:
        decoder.push(piece)

        assert decoder.lines.pending <= 200


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.floats(allow_nan=False, allow_infinity=False, width=32), min_size=3, max_size=3),
)
def test_numbers_come_back_as_they_were_sent(t_ms, values):
    line = ",".join(map(str, [t_ms, *values])).encode()

    assert decoded(b"\n" + line + b"\n") == [LineReading(t_ms, tuple(values))]
