"""What the fingertip's driver sends, byte by byte, and how it takes what comes."""

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from skin_start import start
from solidtouch.hardware.errors import NoAnswer, WrongDevice
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.link.loop import HostClock, Loop
from solidtouch.hardware.rig.settings import IcubSettings
from solidtouch.hardware.skin.fingertip import Fingertip, make_skin

SETTINGS = IcubSettings(port="skin", triangle=2)
HEAD, TAIL = b"t4E2840F0F1F2F3F4F5F6\r", b"t4E28C0F7F8F9FAFB0000\r"
OPENING = [(b"\rC\r", b"\a"), (b"V\r", b"V1013\r"), (b"Z0\r", b"\r"), (b"S8\r", b"\r"), (b"O\r", b"\r")]
VERSION = (b"t20E31C0000\r", b"z\rt2E081C0B010500010001\r")
SET_UP = [
    (b"t20E20701\r", b"z\r"),
    (b"t20E44D0114F0\r", b"z\r"),
    (b"t20E750020200010022\r", b"z\r"),
    (b"t20E20700\r", b"z\r"),
]
LAST = [(b"t20E20701\rC\r", b"")]


@pytest.fixture
def make(loop, scripted):
    def tip(*exchanges, **changes):
        values = {field: getattr(SETTINGS, field) for field in SETTINGS.__struct_fields__} | changes
        return Fingertip(IcubSettings(**values), loop, NoJournal(), scripted(*exchanges, address="skin"))

    return tip


def stream(n, seed=0):
    """Exchanges that bring `n` readings, one every 20 ms."""
    noise = np.random.default_rng(seed).integers(-1, 2, (n, 12))
    for row in (240 + noise).astype(np.uint8):
        head, tail = row[:7].tobytes().hex().upper(), row[7:].tobytes().hex().upper()
        yield b"", f"t4E2840{head}\rt4E28C0{tail}0000\r".encode(), 0.02


def test_the_start_is_that_of_the_stock_driver(make):
    """Board, triangle, start; 20 ms is 0x14, and only the triangle wanted is enabled."""
    skin = make(*OPENING, VERSION, *SET_UP, *stream(52), *LAST)
    start(skin)
    skin.stop()

    assert skin.version is not None
    assert skin.version.firmware == (1, 5, 0)
    assert skin.monitor.baseline == pytest.approx([15.0] * 12, abs=0.5)
    assert skin.counts.frames == 51


def test_an_adapter_that_never_answers_is_told_the_same(make):
    """Stock CANable firmware tells its version without the letter; nobody waits for it after that."""
    quiet = [(sent, b"") for sent, _ in [*OPENING[2:], (VERSION[0], b""), *SET_UP]]
    exchanges = [(b"\rC\r", b""), (b"V\r", b"b158aa7 canable-fw.git\r"), *quiet]
    skin = make(*exchanges, *stream(52), *LAST)
    start(skin)
    skin.stop()

    assert skin.version is None


def test_without_acks_nothing_is_asked(make):
    exchanges = [(sent, b"") for sent, _ in [OPENING[0], *OPENING[2:], VERSION, *SET_UP]]
    skin = make(*exchanges, *stream(52), *LAST, acks="none")
    start(skin)

    assert skin.counts.frames >= 50
    assert skin.counts.refused == 0

    skin.stop()


@pytest.mark.parametrize("refused", range(1, 8))
def test_a_refused_command_is_named_in_strict_mode(make, refused):
    commands = [OPENING[0], *OPENING[2:], VERSION, *SET_UP]
    names = ["", "(Z0)", "(S8)", "(O)", "(1C)", "(07 01)", "(4D)", "(50)", "(07 00)"]
    exchanges = [*commands[:refused], (commands[refused][0], b"\a")]
    skin = make(*exchanges, *LAST, acks="strict")

    with pytest.raises(WrongDevice, match=f"skin: the adapter refused the command .*{re.escape(names[refused])}"):
        start(skin)


def test_an_adapter_without_z_will_do_unless_strict(make):
    opening = [*OPENING[:2], (b"Z0\r", b"\a"), *OPENING[3:]]
    skin = make(*opening, VERSION, *SET_UP, *stream(52), *LAST)
    start(skin)
    skin.stop()

    assert skin.counts.refused == 1


def test_an_answer_that_is_lost_ends_the_waiting_for_answers_unless_strict(make):
    opening = [*OPENING[:3], (b"S8\r", b""), *OPENING[4:]]
    skin = make(*opening, VERSION, *SET_UP, *stream(52), *LAST)
    start(skin)
    skin.stop()

    strict = make(OPENING[0], OPENING[2], (b"S8\r", b""), *LAST, acks="strict")
    with pytest.raises(NoAnswer, match=r"skin: the adapter did not answer .*S8"):
        start(strict)


def test_halves_only_are_no_reading(make):
    heads = [(b"", HEAD, 0.02) for _ in range(90)]
    skin = make(*OPENING, VERSION, *SET_UP, *heads, *LAST)

    with pytest.raises(Exception, match="skin: only half readings arrive from board 14, triangle 2"):
        start(skin)


def listening(make, **changes):
    """A driver as after its start, with what it heard."""
    skin, frames = make(**changes), []
    skin.on_frame = frames.append
    skin._streaming = True
    return skin, frames


def test_a_reading_has_the_time_of_its_head_and_the_sign_of_load(make):
    skin, frames = listening(make)
    for data, time_s in ((HEAD[:9], 1.0), (HEAD[9:], 1.001), (TAIL, 1.004)):
        skin._adapter.receive(data, time_s)

    assert len(frames) == 1
    assert frames[0].time_s == 1.001
    assert frames[0].raw.tolist() == [240.0 + i for i in range(12)]
    assert frames[0].values.tolist() == [15.0 - i for i in range(12)]
    assert frames[0].valid.all()
    assert frames[0].device_ms is None


@pytest.mark.parametrize(
    ("diagnostics", "order", "valid"),
    [
        (b"0000", range(12), [True] * 12),
        (b"8010", range(12), [False] + [True] * 10 + [False]),
        (b"8010", [11, 3, 0], [False, True, False]),
        (b"0001", range(12), [False] * 12),
        (b"0002", range(12), [False] * 12),
        (b"0003", range(12), [False] * 12),
    ],
)
def test_diagnostics_make_taxels_invalid(make, diagnostics, order, valid):
    skin, frames = listening(make, order=list(order))
    skin._adapter.receive(HEAD + TAIL.replace(b"0000\r", diagnostics + b"\r"), 1.0)

    assert frames[0].valid.tolist() == valid


def test_a_tail_without_diagnostics_is_believed(make):
    skin, frames = listening(make)
    skin._adapter.receive(HEAD + b"t4E26C0F7F8F9FAFB\r", 1.0)

    assert frames[0].valid.all()


@pytest.mark.parametrize("byte", [b"00", b"FF"])
def test_a_chip_at_either_end_of_its_range_is_invalid(make, byte):
    skin, frames = listening(make)
    skin._adapter.receive(b"t4E2840" + 7 * byte + b"\rt4E28C0" + 5 * byte + b"0000\r", 1.0)

    assert not frames[0].valid.any()


def test_other_boards_triangles_and_classes_are_foreign_and_commands_are_not(make):
    skin, frames = listening(make)
    for text in (b"t4E1840F0F0F0F0F0F0F0\r", b"t4D2840F0F0F0F0F0F0F0\r", b"t5E280000000000000000\r", b"t20E20700\r"):
        skin._adapter.receive(text, 1.0)
    skin._adapter.receive(HEAD.replace(b"t4", b"t3") + TAIL.replace(b"t4", b"t3"), 1.0)

    assert (skin.counts.foreign, len(frames)) == (3, 1)


def test_halves_without_the_other_are_counted(make):
    skin, frames = listening(make)
    for time_s, data in ((1.0, HEAD), (1.02, TAIL), (1.04, HEAD + TAIL), (1.06, TAIL), (1.08, HEAD + TAIL)):
        skin._adapter.receive(data, time_s)

    assert [frame.time_s for frame in frames] == [1.04, 1.08]
    assert skin.counts.unpaired == 3


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.one_of(st.binary(max_size=60), st.sampled_from([HEAD, TAIL, b"\a", b"z\r", HEAD[3:]])), max_size=30))
def test_no_bytes_raise(make, pieces):
    skin, _ = listening(make)
    for i, data in enumerate(pieces):
        skin._adapter.receive(data, 0.02 * i)
    skin.monitor.check(0.02 * len(pieces))


def test_settings_choose_the_driver():
    skin = make_skin(IcubSettings(port="/dev/finger", order=[1, 2]), Loop(HostClock()), NoJournal())

    assert isinstance(skin, Fingertip)
    assert (skin.port.address, skin.taxels, skin.rate_hz) == ("/dev/finger", 2, 50.0)
    assert np.isnan(skin.monitor.baseline).all()
    skin.monitor.check(0.0)
    skin.stop()
