"""The stage driver against an emulated controller: every fault of it, and what the driver makes of it."""

import contextlib

import pytest
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.grbl.controller import Controller
from solidtouch.hardware.emulator.grbl.settings import ControllerSettings
from solidtouch.hardware.errors import (
    CommandRefused,
    NoAnswer,
    OutOfLimits,
    PortLost,
    PositionUnknown,
    RigError,
    StageAlarm,
    StageFault,
    WriteTimeout,
)
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.rig.settings import StageSettings
from solidtouch.hardware.stage.stage import Stage
from stage_script import X, Y

SETTINGS = StageSettings(port="wired", x=X, y=Y, homing_s=20.0)
TAP = [(0.0, 2.5, 12.0), (0.0, 0.0, 12.0)]


class Bench:
    """A stage, the controller behind it, and where the finger truly is."""

    def __init__(self, loop, wired, controller, settings, **options):
        self.loop = loop
        self.switches = Switches(seed=3)
        self.controller = Controller(self.switches, controller)
        self.port = wired(self.controller, **options)
        self.stage = Stage(settings, loop, NoJournal(), self.port)

    @property
    def place_mm(self):
        x, y, _ = self.controller.position_mm(self.loop.now)
        return pytest.approx((X.rig_mm(x), Y.rig_mm(y)), abs=0.0021)

    def jogs_sent(self):
        return self.port.log.count(b"$J=")

    def stands_still(self):
        before = self.controller.position_mm(self.loop.now)
        with self.loop.unguarded(), contextlib.suppress(PortLost):
            self.loop.sleep(0.3)
        return before == self.controller.position_mm(self.loop.now)


@pytest.fixture
def bench(loop, wired):
    """A function that makes a bench with a homed stage at the origin of the rig frame."""

    def make(connect=True, homed=True, settings=SETTINGS, values=None, port=None, **controller):
        made = Bench(loop, wired, ControllerSettings(values or {}, homed=homed, **controller), settings, **(port or {}))
        if connect:
            made.stage.connect()
            made.stage.move(x_mm=0.0, y_mm=0.0)
        return made

    return make


# Without a fault


@pytest.mark.parametrize("firmware", ["Grbl", "GrblHAL"])
@pytest.mark.parametrize("values", [{}, {10: 0}, {10: 3}, {23: 3}])
def test_it_homes_and_moves_where_it_is_told(bench, firmware, values):
    rig = bench(connect=False, homed=False, firmware=firmware, values=values, work_offset_mm=(-10.0, -20.0, -5.0))
    rig.stage.connect()
    assert rig.stage.position_mm is None
    rig.stage.home()
    rig.stage.move(x_mm=5.3, y_mm=-1.0)
    rig.stage.path([(5.3, 2.5, 12.0), (5.3, 0.0, 12.0), (7.0, 1.0, 5.0)])

    assert rig.place_mm == (7.0, 1.0)
    assert rig.place_mm == rig.stage.position_mm
    assert 0 == rig.stage.counts.extra_answers == rig.stage.counts.unknown == rig.stage.counts.unanswered


def test_a_tap_takes_little_longer_than_the_motion(bench, loop):
    rig = bench()
    before = loop.now
    rig.stage.path(TAP)

    assert loop.now - before < 2 * (2.5 / 12 + 12 / 500) + 0.25
    assert rig.stage.counts.false_idle == 0


def test_a_jog_that_another_program_left_running_is_waited_for(bench, loop):
    rig = bench()
    rig.port.write(b"$J=G53G21X-50F600\n")
    rig.stage.connect()

    assert rig.place_mm == (10.0, 0.0)
    assert rig.stage.homed


@pytest.mark.parametrize("left", [b"$J=G53G21X-50F60", b"$", b"$1=25", b"(", b"$J=G53G21X-5", b"G1X-5F1", b"$X"])
def test_half_a_command_left_by_another_program_is_not_completed(bench, left):
    rig = bench()
    rig.port.write(left)
    rig.stage.connect()

    assert rig.place_mm == (0.0, 0.0)
    assert rig.stage.report.values[1] == 255
    assert rig.stands_still()
    rig.stage.path(TAP)


def test_half_a_homing_left_by_another_program_is_not_completed(bench):
    """The firmware refuses it, but stays in its homing state."""
    rig = bench()
    rig.port.write(b"$H")
    with pytest.raises(StageFault, match="was in state Home for 5 s"):
        rig.stage.connect()

    assert rig.place_mm == (0.0, 0.0)


def test_stopping_in_the_middle_of_a_tap_comes_to_rest_at_once(bench, loop):
    rig = bench()

    class Pressed(RigError):
        """The guard of this test."""

    def guard(now_s):
        if rig.stage.position_mm is not None and rig.stage.position_mm[1] > 0.5:
            raise Pressed("deep enough.")

    with pytest.raises(Pressed, match="deep"), loop.guarded(guard):
        rig.stage.path(TAP)
    before = loop.now
    rig.stage.stop()

    assert loop.now - before < 0.4
    assert rig.stands_still()
    rig.stage.move(y_mm=0.0)
    assert rig.place_mm == (0.0, 0.0)


@pytest.mark.parametrize("after", range(12))
def test_stopping_at_any_byte_leaves_a_stage_at_rest(bench, loop, after):
    """Whatever was in transit: a jog not yet read, its ok, or a report."""
    rig = bench()
    stop_s = loop.now + 0.0017 * after

    def guard(now_s):
        if rig.port.sent and now_s >= stop_s and rig.jogs_sent() > 1:
            raise KeyboardInterrupt

    with contextlib.suppress(KeyboardInterrupt), loop.guarded(guard):
        rig.stage.path(TAP)
    rig.stage.stop()

    assert rig.stands_still()
    rig.stage.move(y_mm=0.0)
    assert rig.place_mm == (0.0, 0.0)


# 1 to 5: damage on the way


def test_bytes_one_by_one_change_nothing(bench):
    rig = bench()
    pieces = []
    rig.port.wire = lambda data: pieces.append(data) or b""
    step = rig.port.step

    def trickle():
        step()
        if pieces:
            whole = b"".join(pieces)
            pieces.clear()
            rig.port.incoming += whole[:1]
            if whole[1:]:
                pieces.append(whole[1:])

    rig.port.step = trickle
    rig.port.next_event_s = lambda: rig.loop.now + 0.0001 if pieces else rig.controller.next_event_s()
    rig.stage.path(TAP)

    assert rig.place_mm == (0.0, 0.0)


@pytest.mark.parametrize("damage", ["drop", "merge", "flip"])
def test_damaged_answers_never_leave_the_stage_elsewhere_unsaid(bench, rng, damage):
    """Rows 2, 3 and 4: a fifth of all outputs are damaged."""

    def wire(data):
        if rng.random() > 0.2:
            return data
        at = int(rng.integers(len(data)))
        if damage == "merge":
            return data.replace(b"\r\n", b"", 1)
        return data[:at] + (b"" if damage == "drop" else bytes([data[at] ^ 1 << int(rng.integers(8))])) + data[at + 1 :]

    rig = bench()
    rig.port.wire = wire
    good = 0
    for i in range(30):
        jogs = rig.jogs_sent()
        try:
            rig.stage.move(x_mm=float(i % 16), y_mm=0.5 * (i % 3))
        except RigError:
            rig.port.wire = bytes
            rig.stage.home()
            rig.stage.stop()
            rig.port.wire = wire
            continue
        good += 1
        assert rig.jogs_sent() == jogs + 1
        assert rig.place_mm == (i % 16, 0.5 * (i % 3))

    assert good > 20


@pytest.mark.parametrize("damage", ["drop", "change", "double"])
def test_damaged_commands_never_leave_the_stage_elsewhere_unsaid(bench, rng, damage):
    """What the controller makes of a damaged jog may be another jog; its end then is not where it should be."""
    rig = bench()
    write = rig.port.write

    def damaging(data):
        at = int(rng.integers(len(data)))
        byte = {"drop": b"", "change": bytes([rng.integers(32, 127)]), "double": 2 * data[at : at + 1]}[damage]
        write(data if rng.random() > 0.2 else data[:at] + byte + data[at + 1 :])

    good = 0
    for i in range(30):
        rig.port.write = damaging
        target = float(i % 16), 0.5 * (i % 3)
        try:
            rig.stage.move(*target)
        except RigError:
            rig.port.write = write
            with contextlib.suppress(CommandRefused):  # it extends what is left of a damaged line
                rig.stage.home()
            rig.stage.home()
            continue
        good += 1
        assert rig.place_mm == target

    assert good > 10


def test_garbage_is_no_answer(bench):
    rig = bench()
    rig.port.wire = lambda data: bytes(byte | 0x80 for byte in data)
    with pytest.raises(NoAnswer, match="no answer from the controller to 20 status requests"):
        rig.stage.move(x_mm=5.0)

    assert rig.stage.counts.dropped > 0


def test_a_torn_report_is_ignored(bench):
    rig = bench()
    rig.switches.on("torn_status", rate=0.5)
    rig.stage.move(x_mm=10.0)

    assert rig.place_mm == (10.0, 0.0)
    assert rig.stage.counts.unknown > 0


# 6 to 10: ports and restarts


def test_an_unplugged_stage_is_told_and_connects_again(bench, loop):
    rig = bench()

    def pull(now_s):
        if rig.jogs_sent() > 1:
            rig.port.failure = PortLost("wired: the port was lost.")

    with loop.guarded(pull), pytest.raises(PortLost, match="was lost"):
        rig.stage.move(x_mm=10.0)
    assert rig.stage.position_mm is None

    rig.port.failure = None
    jogs = rig.jogs_sent()
    rig.stage.connect()
    assert jogs == rig.jogs_sent()
    rig.stage.move(x_mm=0.0)


def test_a_reset_at_opening_asks_for_homing(bench):
    rig = bench(connect=False)
    rig.switches.on("reset_on_open", times=1)
    rig.stage.connect()

    assert rig.stage.report.state == "Alarm"
    with pytest.raises(PositionUnknown, match="position unknown; home the stage first"):
        rig.stage.path(TAP)
    rig.stage.home()
    rig.stage.move(x_mm=3.0, y_mm=0.0)
    assert rig.place_mm == (3.0, 0.0)


def test_a_restart_in_a_move_stops_everything_until_it_is_homed(bench, loop):
    rig = bench()
    rig.switches.on("brown_out", times=1, rate=0.3)
    with pytest.raises(StageFault, match="restarted by itself"):
        rig.stage.path([(x, 0.0, 20.0) for x in range(16)])

    jogs = rig.jogs_sent()
    assert rig.stage.position_mm is None
    with pytest.raises(StageFault, match="restarted"):
        rig.stage.move(x_mm=0.0)
    assert jogs == rig.jogs_sent()
    rig.stage.home()
    rig.stage.move(x_mm=0.0, y_mm=0.0)
    assert rig.place_mm == (0.0, 0.0)


# 13 to 21: the controller


def test_a_lost_ok_is_made_up_for_by_the_position(bench):
    rig = bench()
    rig.switches.on("lost_ok", times=1)
    jogs = rig.jogs_sent()
    rig.stage.path(TAP)

    assert rig.place_mm == (0.0, 0.0)
    assert rig.jogs_sent() - jogs == 2
    assert rig.stage.counts.unanswered == 1


def test_a_homing_whose_ok_is_lost_counts(bench):
    rig = bench(connect=False, homed=False)
    rig.stage.connect()
    rig.switches.on("lost_ok", times=1)
    rig.stage.home()

    assert rig.stage.homed


def test_extra_oks_are_counted(bench):
    rig = bench()
    rig.switches.on("extra_ok")
    rig.stage.path(TAP)
    rig.stage.path(TAP)

    assert rig.place_mm == (0.0, 0.0)
    assert rig.stage.counts.extra_answers == 4


@pytest.mark.parametrize("code", [2, 15, 99])
def test_a_refused_move_is_not_repeated(bench, code):
    rig = bench()
    rig.switches.on("refuse_move", times=1, code=code)
    jogs = rig.jogs_sent()
    with pytest.raises(CommandRefused, match=f"error:{code}") as caught:
        rig.stage.path(TAP)

    assert code == caught.value.code
    assert jogs + 1 == rig.jogs_sent()
    rig.stage.stop()
    rig.stage.path(TAP)


def test_an_alarm_needs_somebody_who_asks_for_homing(bench, loop):
    rig = bench()
    rig.switches.on("limit_alarm", times=1)
    with pytest.raises(StageAlarm, match="ALARM:1"):
        rig.stage.move(x_mm=10.0)

    sent = rig.port.log
    for use in (lambda: rig.stage.move(x_mm=0.0), lambda: rig.stage.path(TAP), lambda: rig.stage.check(loop.now)):
        with pytest.raises(StageAlarm, match="ALARM:1"):
            use()
    assert sent == rig.port.log
    assert b"$X" not in sent
    assert b"\x18" not in sent
    rig.stage.home()
    rig.stage.move(x_mm=0.0, y_mm=0.0)
    assert rig.place_mm == (0.0, 0.0)


def test_a_controller_left_in_an_alarm_says_nothing(bench):
    rig = bench()
    rig.switches.on("limit_alarm", times=1)
    with pytest.raises(StageAlarm, match="ALARM:1"):
        rig.stage.move(x_mm=10.0)
    rig.stage.close()
    with pytest.raises(NoAnswer, match="locked by an alarm until its reset button"):
        rig.stage.connect()
    assert b"\x18" not in rig.port.log

    rig.stage.connect(will_home=True)
    rig.stage.home()
    rig.stage.move(x_mm=0.0, y_mm=0.0)
    assert rig.place_mm == (0.0, 0.0)


def test_silent_status_is_given_up(bench, loop):
    rig = bench()
    rig.switches.on("silent_status")
    before = loop.now
    with pytest.raises(NoAnswer, match="no answer from the controller to 20 status requests"):
        rig.stage.path(TAP)
    assert loop.now - before < 2.5

    rig.switches.clear()
    rig.stage.stop()
    assert rig.place_mm == (0.0, 0.0)


def test_a_few_silent_polls_are_forgiven(bench):
    rig = bench()
    rig.switches.on("silent_status", times=4)
    rig.stage.path(TAP)

    assert rig.stage.counts.silent_polls == 4


@pytest.mark.parametrize("seconds", [0.05, 0.15, 0.35])
def test_false_idle_does_not_end_a_tap(bench, seconds):
    rig = bench()
    rig.switches.on("false_idle", seconds=seconds)
    rig.stage.path(TAP)
    assert rig.stands_still()

    rig.stage.move(x_mm=4.0)
    assert rig.stands_still()
    assert rig.place_mm == (4.0, 0.0)


def test_the_buffer_of_the_controller_never_overflows(bench):
    """Row 19: a path of many points goes through 128 bytes."""
    rig = bench()
    points = [(0.5 * (i % 20), 0.1 * (i % 7), 12.0) for i in range(40)]
    rig.stage.path(points)

    assert rig.place_mm == points[-1][:2]
    assert rig.jogs_sent() - 1 == 40


def test_no_setting_is_ever_written(bench):
    """Row 20: writing one would lose bytes."""
    rig = bench()
    rig.stage.path(TAP)
    rig.stage.home()

    lines = [line for line in rig.port.log.replace(b"?", b"").split(b"\n") if line.startswith(b"$")]
    assert {line[:3] for line in lines} <= {b"$J=", b"$$", b"$G", b"$H"}


@pytest.mark.parametrize("delivered", [0, 10, 43])
def test_a_move_whose_writing_timed_out_is_not_sent_again(bench, delivered):
    rig = bench()
    write = rig.port.write

    def deaf(data):
        if data.startswith(b"$J"):
            write(data[:delivered])
            raise WriteTimeout("wired: the device took no bytes for 1 s.")
        write(data)

    rig.port.write = deaf
    with pytest.raises(WriteTimeout, match="took no bytes"):
        rig.stage.move(x_mm=10.0)
    assert rig.stage.position_mm is None

    rig.port.write = write
    rig.stage.stop()
    assert rig.stands_still()
    assert rig.stage.position_mm == rig.place_mm
    rig.stage.move(x_mm=1.0)
    assert rig.place_mm == (1.0, 0.0)


def test_a_slow_controller_is_waited_for(bench):
    rig = bench(line_s=0.2, status_s=0.05)
    rig.stage.path(TAP)

    assert rig.place_mm == (0.0, 0.0)


def test_a_move_that_an_operator_holds_is_told(bench, loop):
    rig = bench()

    def hold(now_s):
        if rig.jogs_sent() > 1 and not held:
            held.append(now_s)
            rig.controller.receive(b"!", now_s)

    held = []
    with loop.guarded(hold), pytest.raises(StageFault, match="on its way to x = 16 mm and was stopped"):
        rig.stage.move(x_mm=16.0)

    rig.stage.stop()
    rig.stage.move(x_mm=0.0)


def test_beyond_the_travel_nothing_is_sent(bench):
    rig = bench()
    sent = rig.port.log
    with pytest.raises(OutOfLimits, match="y = 9 mm"):
        rig.stage.path([(0.0, 1.0, 12.0), (0.0, 9.0, 12.0)])

    assert sent == rig.port.log


@pytest.mark.parametrize(
    ("sent", "state", "advice"),
    [
        (b"G0X-60\n!", "Hold", "press its cycle start"),
        (b"\x84", "Door", "close its safety door"),
        (b"$C\n", "Check", r"send \$C"),
        (b"$SLP\n", "Sleep", "press its reset"),
    ],
)
def test_a_state_that_only_a_person_ends_is_named_and_homing_ends_it(bench, sent, state, advice):
    made = bench(connect=False)
    made.controller.receive(sent, made.loop.now)
    made.loop.sleep(1.0)
    with pytest.raises(StageFault, match=f"was in state {state} for .* s; .*{advice}"):
        made.stage.connect()

    made.stage.connect(will_home=True)
    made.stage.home()
    assert made.stage.homed
