"""GRBL units from bytes and commands to bytes, on clean and on noisy wires."""

import pytest
from decoder_laws import (
    assert_any_split_gives_the_same_units,
    assert_garbage_touches_only_the_unit_behind_it,
    assert_no_bytes_fill_the_memory,
    wire_of,
)
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.stage import grbl
from solidtouch.hardware.stage.grbl import (
    Alarm,
    Banner,
    Error,
    Feedback,
    GrblDecoder,
    GrblSetting,
    Ok,
    StartupLine,
    State,
    StatusReport,
    Unknown,
)

RECEIVED = [
    (Ok(), b"ok\r\n"),
    (Error(15), b"error:15\r\n"),
    (Alarm(1), b"ALARM:1\r\n"),
    (Banner("Grbl", "1.1h"), b"Grbl 1.1h ['$' for help]\r\n"),
    (Banner("GrblHAL", "1.1f"), b"GrblHAL 1.1f ['$' or '$HELP' for help]\r\n"),
    (GrblSetting(110, 500.0), b"$110=500.000\r\n"),
    (Feedback("MSG", "'$H'|'$X' to unlock"), b"[MSG:'$H'|'$X' to unlock]\r\n"),
    (Feedback("GC", "G0 G54 G17 G21"), b"[GC:G0 G54 G17 G21]\r\n"),
    (Feedback("VER", "1.1h.20190830:"), b"[VER:1.1h.20190830:]\r\n"),
    (StartupLine("G54G20", "ok"), b">G54G20:ok\r\n"),
    (
        StatusReport(State.IDLE, None, (-1.0, -2.5, 0.0), other=(("FS", "0,0"),)),
        b"<Idle|MPos:-1.000,-2.500,0.000|FS:0,0>\r\n",
    ),
    (
        StatusReport(State.HOLD, 1, None, (1.0, 2.0, 3.0), (0.0, 0.0, -0.125), (("Bf", "15,128"), ("Pn", "XY"))),
        b"<Hold:1|WPos:1.000,2.000,3.000|WCO:0.000,0.000,-0.125|Bf:15,128|Pn:XY>\r\n",
    ),
    (
        StatusReport(State.JOG, None, (0.5, 0.0, 0.0), other=(("Ov", "100,100,100"), ("FW", "grblHAL"))),
        b"<Jog|MPos:0.500,0.000,0.000|Ov:100,100,100|FW:grblHAL>\r\n",
    ),
    (Unknown("Marlin?"), b"Marlin?\r\n"),
]
CASES = pytest.mark.parametrize(("unit", "wire"), RECEIVED, ids=[wire[:20].decode() for _, wire in RECEIVED])
STREAMS = st.lists(st.sampled_from(RECEIVED), max_size=8)

COMMANDS = [
    (grbl.jog(500, (-10.0, -0.00004, -1.0)), b"$J=G53X-10.0000Y0.0000Z-1.0000F500\n"),
    (grbl.jog(60.5, (0.0, 0.0, 0.1234), relative=True), b"$J=G91X0.0000Y0.0000Z0.1234F60.5\n"),
    (grbl.HOME, b"$H\n"),
    (grbl.SETTINGS, b"$$\n"),
    (grbl.NO_MOTION + grbl.PARSER_STATE, b"G80G21\n$G\n"),
    (grbl.STATUS + grbl.RESET + grbl.JOG_CANCEL, b"?\x18\x85"),
]
SIMPLE = {
    Ok: "ok",
    Error: "error:{0.code}",
    Alarm: "ALARM:{0.code}",
    GrblSetting: "${0.number}={0.value:.3f}",
    Feedback: "[{0.kind}:{0.text}]",
    StartupLine: ">{0.line}:{0.result}",
    Unknown: "{0.text}",
}
HELP = {"Grbl": "['$' for help]", "GrblHAL": "['$' or '$HELP' for help]"}


def write(unit):
    """The line of a unit as the controller prints it."""
    if isinstance(unit, StatusReport):
        state = unit.state if unit.substate is None else f"{unit.state}:{unit.substate}"
        positions = {"MPos": unit.machine, "WPos": unit.work, "WCO": unit.offset}
        fields = [f"{name}:" + ",".join(f"{mm:.3f}" for mm in at) for name, at in positions.items() if at]
        return f"<{'|'.join([state, *fields, *(':'.join(field) for field in unit.other)])}>\r\n".encode()
    if isinstance(unit, Banner):
        return f"{unit.firmware} {unit.version} {HELP[unit.firmware]}\r\n".encode()
    return SIMPLE[type(unit)].format(unit).encode() + b"\r\n"


@CASES
def test_a_unit_is_written_and_read_whole_byte_by_byte_and_with_bytes_behind_it(unit, wire):
    decoder = GrblDecoder()

    assert wire == write(unit)
    assert [unit] == decoder.push(wire)
    assert [unit] == [found for byte in wire for found in decoder.push(bytes([byte]))]
    assert [unit] == decoder.push(wire + b"<Id")
    assert (decoder.lines.pending, decoder.lines.dropped.malformed) == (3, 0)


@pytest.mark.parametrize(("command", "wire"), COMMANDS)
def test_commands_are_these_bytes(command, wire):
    assert wire == command


@pytest.mark.parametrize(("unit", "wire"), [case for case in RECEIVED if isinstance(case[0], StatusReport)])
def test_truncated_reports_are_unknown(unit, wire):
    """A report is one only if all of it is there."""
    line = wire[:-2]
    for text in [line[1:], *(line[:n] for n in range(1, len(line)))]:
        assert GrblDecoder().push(text + b"\n") == [Unknown(text.decode())]


@pytest.mark.parametrize(
    "line",
    [
        "okok",
        "$110=500.000ok",
        "$110=500.000$111=500.000",
        "error:9ok",
        "ALARM:1[MSG:Reset to continue]",
        "<Idle|MPos:-1.000,-2.5ok",
        "<Idle|MPos:-1.000,-2.500,0.000<Idle|MPos:-1.000,-2.500,0.000|FS:0,0>",
        "<Idle|MPos:-1.000,-2.500|FS:0,0>",
        "<Idle|MPos:-1.000,-2.500,0.00|FS:0,0>",
        "<Idle|MPos:1.000,2.000,3.000|MPos:1.000,2.000,3.000>",
        "<Idle|MPos:1.000,2.000,3.000|WPos:1.000,2.000,3.000>",
        "<Idle|MPos:1.000,2.000,3.000|>",
        "<Idle|FS:0,0>",
        "<Idle>",
        "<Idlf|MPos:1.000,2.000,3.000>",
        "[MSG:a[MSG:b]",
        "Grbl",
        "error:",
    ],
)
def test_merged_and_torn_lines_are_unknown(line):
    assert GrblDecoder().push(f"{line}\r\n".encode()) == [Unknown(line)]


@pytest.mark.parametrize("bit", range(8))
@CASES
def test_a_flipped_bit_reaches_no_further_than_its_line(unit, wire, bit):
    """Lines before and after are kept, and noise is counted; CRLF survives the loss of one of its two."""
    for place in range(len(wire) - 2):
        broken = bytearray(wire)
        broken[place] ^= 1 << bit
        decoder = GrblDecoder()
        units = decoder.push(b"ok\r\n" + broken + b"ok\r\n")
        assert units[0] == units[-1] == Ok()
        assert bit < 7 or (len(units), decoder.lines.dropped.malformed) == (2, 1)


def test_fields_come_in_any_order_and_are_asked_by_name():
    [report] = GrblDecoder().push(b"<Run|FS:500,0|MPos:1.000,2.000,3.000|A:S>\n")

    assert isinstance(report, StatusReport)
    assert (report.machine, report.field("FS"), report.field("Pn")) == ((1.0, 2.0, 3.0), "500,0", None)


def test_a_cut_banner_still_tells_of_the_reset():
    assert GrblDecoder().push(b"Grbl 1.1h ['$' for hok\n") == [Banner("Grbl", "1.1h")]


def test_every_alarm_that_loses_the_position_has_words():
    assert set(grbl.ALARMS) >= grbl.POSITION_LOST


def test_lines_of_any_length_cost_no_memory():
    decoder = GrblDecoder()
    for _ in range(50):
        decoder.push(b"x" * 200)
        assert decoder.lines.pending <= grbl.LONGEST_LINE

    assert decoder.push(b"\r\nok\r\n") == [Ok()]
    assert (decoder.lines.dropped.overlong, decoder.lines.dropped.malformed, decoder.lines.dropped.byte_count) == (
        1,
        0,
        10000,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((100, (float("nan"), 0.0, 0.0)), "finite targets"),
        ((0, (1.0, 0.0, 0.0)), "at least 0.001 mm/min, got 0"),
        ((float("inf"), (1.0, 0.0, 0.0)), "got inf"),
        ((100, (1e80, 0.0, 0.0)), "at most 79 characters"),
    ],
)
def test_impossible_jogs_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        grbl.jog(*arguments)


@given(STREAMS, st.binary(max_size=300), st.lists(st.integers(0, 700)))
def test_any_split_gives_the_same_units(stream, noise, cuts):
    assert_any_split_gives_the_same_units(GrblDecoder, wire_of(stream) + noise, cuts)


@given(STREAMS, st.binary(max_size=300), STREAMS)
def test_garbage_touches_only_the_unit_behind_it(before, garbage, after):
    assert_garbage_touches_only_the_unit_behind_it(GrblDecoder, before, garbage, after, b"\r\n")


@given(st.lists(st.one_of(st.binary(max_size=400), st.text("<>|:,.-0123MPosWCOIdlekrAL[]$=G\r\n").map(str.encode))))
def test_no_bytes_raise_or_fill_the_memory(chunks):
    assert_no_bytes_fill_the_memory(GrblDecoder(), chunks, grbl.LONGEST_LINE)
