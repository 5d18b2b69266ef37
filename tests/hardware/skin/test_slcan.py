"""SLCAN units from bytes and commands to bytes, on clean and on noisy wires."""

import pytest
from decoder_laws import (
    assert_any_split_gives_the_same_units,
    assert_garbage_touches_only_the_unit_behind_it,
    assert_no_bytes_fill_the_memory,
    wire_of,
)
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.link.port import LineSplitter
from solidtouch.hardware.skin import slcan
from solidtouch.hardware.skin.slcan import (
    Bell,
    Done,
    Flags,
    Remark,
    RemoteFrame,
    Reply,
    SlcanDecoder,
    SlcanFrame,
    StatusFlags,
)

SENT = [
    (SlcanFrame(0x4E0, bytes.fromhex("40F5F4F3F2F1F0EF")), b"t4E0840F5F4F3F2F1F0EF\r"),
    (SlcanFrame(0x20E, b"\x07\x00"), b"t20E20700\r"),
    (SlcanFrame(0x7FF, b""), b"t7FF0\r"),
    (SlcanFrame(0, b""), b"t0000\r"),
    (SlcanFrame(0x1FFFFFFF, b"\xab", extended=True), b"T1FFFFFFF1AB\r"),
    (RemoteFrame(0x123, 8), b"r1238\r"),
    (RemoteFrame(0x00ABCDEF, 0, extended=True), b"R00ABCDEF0\r"),
]
"""Frames as they are both sent and received."""

RECEIVED = [
    *SENT,
    (SlcanFrame(0x4E0, b"\x40\x01", stamp_ms=0x1A2B), b"t4E0240011A2B\r"),
    (RemoteFrame(0x123, 8, stamp_ms=60000), b"r1238EA60\r"),
    (Done(), b"\r"),
    (Done("z"), b"z\r"),
    (Done("Z"), b"Z\r"),
    (Bell(), b"\a"),
    (Reply("V", "1013"), b"V1013\r"),
    (Reply("N", "A123"), b"NA123\r"),
    (StatusFlags(Flags.RECEIVE_OVERFLOW | Flags.FRAME_LOST), b"F0A\r"),
    (Remark("b158aa7 github.com/x/canable-fw.git"), b"b158aa7 github.com/x/canable-fw.git\r"),
]
CASES = pytest.mark.parametrize(("unit", "wire"), RECEIVED, ids=[repr(wire) for _, wire in RECEIVED])
STREAMS = st.lists(st.sampled_from(RECEIVED), max_size=8)


def tally(decoder):
    return decoder.lines.dropped.overlong, decoder.lines.dropped.malformed, decoder.lines.dropped.byte_count


@pytest.mark.parametrize(("unit", "wire"), SENT, ids=[repr(wire) for _, wire in SENT])
def test_frames_are_written_as_they_are_read(unit, wire):
    assert wire == slcan.transmit(unit)


def test_time_stamps_are_not_transmitted():
    assert slcan.transmit(SlcanFrame(1, b"", stamp_ms=7)) == b"t0010\r"


@CASES
def test_a_unit_is_read_whole_byte_by_byte_and_with_bytes_behind_it(unit, wire):
    decoder = SlcanDecoder()

    assert [unit] == decoder.push(wire)
    assert [unit] == [found for byte in wire for found in decoder.push(bytes([byte]))]
    assert [unit] == decoder.push(wire + b"t4E0")
    assert (decoder.lines.pending, tally(decoder)) == (4, (0, 0, 0))


@pytest.mark.parametrize(("unit", "wire"), SENT)
def test_truncated_frames_are_dropped(unit, wire):
    """A frame that lost its end, its start or one digit is no frame; it is counted."""
    for text in [wire[1:-1], *(wire[:n] for n in range(1, len(wire) - 1)), wire[:2] + wire[3:-1]]:
        decoder = SlcanDecoder("never")
        assert decoder.push(text + b"\r") == []
        assert (0, 1, len(text)) == tally(decoder)


@pytest.mark.parametrize(("first", "first_wire"), SENT)
@pytest.mark.parametrize(("second", "second_wire"), SENT)
def test_merged_frames_are_both_lost(first, first_wire, second, second_wire):
    """A lost carriage return costs the two frames beside it, and not the third."""
    decoder = SlcanDecoder()

    assert [SlcanFrame(1, b"")] == decoder.push(first_wire[:-1] + second_wire + b"t0010\r")
    assert decoder.lines.dropped.malformed == 1


@pytest.mark.parametrize("bit", range(8))
@CASES
def test_a_flipped_bit_reaches_no_further_than_the_next_unit(unit, wire, bit):
    """Wherever the bit is, units before are kept, and units after the next terminator too."""
    mark = SlcanFrame(0x111, b"\x11")
    for place in range(len(wire)):
        broken = bytearray(wire)
        broken[place] ^= 1 << bit
        units = SlcanDecoder("never").push(b"t111111\r" + broken + b"t111111\r" * 2)
        assert mark == units[0]
        assert mark == units[-1]


@pytest.mark.parametrize(
    "line",
    [b"t4E084", b"t4E08C0ZZ", b"t4E", b"t4E0940F5F4F3F2F1F0EF11", b"tFFF0", b"T200000000", b"t0010EA61", b"t\xff\x00"],
)
def test_what_fools_other_parsers_is_dropped(line):
    """Too little data, no hex digit, no length, length 9, identifier or stamp out of range, noise."""
    decoder = SlcanDecoder()

    assert decoder.push(line + b"\r") == []
    assert (0, 1, len(line)) == tally(decoder)


def test_lower_case_digits_and_crlf_are_accepted():
    assert SlcanDecoder().push(b"t4e01ab\r\nt4e01ab\r\n\r") == [SlcanFrame(0x4E0, b"\xab")] * 2 + [Done()]


def test_a_bell_drops_what_stands_before_it():
    decoder = SlcanDecoder()

    assert decoder.push(b"t001\a\n\a") == [Bell(), Bell()]
    assert tally(decoder) == (0, 1, 4)


def test_the_stamp_setting_is_strict():
    """A frame without its stamp, or with one where none was ordered, is dropped."""
    bare, stamped = b"t0010\r", b"t00100007\r"

    assert SlcanDecoder("never").push(bare + stamped) == [SlcanFrame(1, b"")]
    assert SlcanDecoder("always").push(bare + stamped) == [SlcanFrame(1, b"", stamp_ms=7)]


def test_lines_of_any_length_cost_no_memory():
    """A line longer than the longest is dropped whole; the next unit is read."""
    decoder = SlcanDecoder()
    for _ in range(50):
        decoder.push(b"t" * 70)
        assert decoder.lines.pending <= slcan.LONGEST_LINE

    assert decoder.push(b"\r" + b"t0010\r" + b"x" * 97 + b"\a") == [SlcanFrame(1, b""), Bell()]
    assert tally(decoder) == (2, 0, 3597)


def test_a_line_as_long_as_the_longest_is_kept():
    lines = LineSplitter(b"\r", 3)

    assert lines.push(b"abc\rabcd\r\r") == [(b"abc", b"\r"), (None, b"\r"), (b"", b"\r")]


def test_the_bit_rate_of_the_icub_is_s8():
    assert slcan.bit_rate(1000) == b"S8\r"


@pytest.mark.parametrize("kbit", [750, 800, 0])
def test_ambiguous_bit_rates_are_refused(kbit):
    with pytest.raises(ValueError, match=rf"got {kbit}"):
        slcan.bit_rate(kbit)


@pytest.mark.parametrize("frame", [SlcanFrame(0x800, b""), SlcanFrame(-1, b""), RemoteFrame(1 << 29, 0, extended=True)])
def test_identifiers_that_do_not_fit_are_refused(frame):
    with pytest.raises(ValueError, match="does not fit"):
        slcan.transmit(frame)


@pytest.mark.parametrize("frame", [SlcanFrame(1, bytes(9)), RemoteFrame(1, 9), RemoteFrame(1, -1)])
def test_lengths_beyond_eight_are_refused(frame):
    with pytest.raises(ValueError, match="0 to 8 bytes"):
        slcan.transmit(frame)


@given(STREAMS, st.binary(max_size=120), st.lists(st.integers(0, 400)))
def test_any_split_gives_the_same_units(stream, noise, cuts):
    assert_any_split_gives_the_same_units(SlcanDecoder, wire_of(stream) + noise, cuts)


@given(STREAMS, st.binary(max_size=150), STREAMS)
def test_garbage_touches_only_the_unit_behind_it(before, garbage, after):
    assert_garbage_touches_only_the_unit_behind_it(SlcanDecoder, before, garbage, after, b"\r\a")


@given(st.lists(st.one_of(st.binary(max_size=200), st.text("tTrRzZVNF0189aAfF\r\a\n").map(str.encode))))
def test_no_bytes_raise_or_fill_the_memory(chunks):
    assert_no_bytes_fill_the_memory(SlcanDecoder(), chunks, slcan.LONGEST_LINE)
