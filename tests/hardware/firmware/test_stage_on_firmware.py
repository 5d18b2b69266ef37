"""The stage driver on GRBL's own firmware in real time; the board knows where the stage truly stands.

Distances and times of stops hold on a computer that has a core to spare.
"""

import math
import re
from itertools import islice

import pytest
from firmware_board import QUICK, on_firmware
from solidtouch.hardware.emulator.grbl.settings import DEFAULTS
from solidtouch.hardware.errors import CommandRefused, NoAnswer, PositionUnknown, StageAlarm, StageFault
from solidtouch.models import seeds
from stage_script import X, Y

from benchmarks.checks import damage
from benchmarks.checks.watched_stage import Bench

pytestmark = pytest.mark.slow

STEP_MM = 0.02
"""Repeatability of homing on a busy computer."""
BRAKE_MM = 0.05 * 20 + 20**2 / (2 * 500)
"""What is prepared and the braking from 20 mm/s."""
DAMAGED = 40
"""Damaged commands that are tried, a minute of them."""


def place(board):
    x, y, _ = board.place_mm
    return X.rig_mm(x), Y.rig_mm(y)


def near(x_mm, y_mm):
    return pytest.approx((x_mm, y_mm), abs=STEP_MM)


def stands_still(board, loop):
    before = board.place_mm
    with loop.unguarded():
        loop.sleep(0.3)
    return before == board.place_mm


class Once:
    """A guard that acts once, when the stage has passed x = 4 mm; it keeps where it stood then."""

    def __init__(self, board, act):
        self.board, self.act, self.place = board, act, None

    def __call__(self, _):
        if self.place is None and place(self.board)[0] > 4.0:
            self.place = place(self.board)
            self.act()


class Objection(StageFault):
    """Something else is wrong."""


def test_it_is_recognised_homed_and_moved(unhomed, board):
    unhomed.connect()
    assert (unhomed.report.firmware[:8], unhomed.report.state) == ("Grbl 1.1", "Alarm")
    assert unhomed.report.values == {**DEFAULTS, **QUICK}
    with pytest.raises(PositionUnknown, match="home the stage first"):
        unhomed.move(x_mm=0.0)

    unhomed.home()
    assert board.place_mm == pytest.approx((-1.0, -1.0, -1.0), abs=2 * STEP_MM)
    unhomed.move(x_mm=5.3, y_mm=-1.0)
    assert place(board) == near(5.3, -1.0)
    unhomed.path([(5.3, 2.5, 12.0), (5.3, 0.0, 12.0), (7.0, 1.0, 5.0)])
    assert place(board) == near(7.0, 1.0)
    assert unhomed.position_mm == near(7.0, 1.0)
    counts = unhomed.counts
    assert 0 == counts.extra_answers == counts.unknown == counts.unanswered == counts.refused == counts.dropped


def test_it_stays_homed_while_nobody_is_connected(stage, board):
    stage.move(x_mm=3.0)
    stage.close()
    stage.connect()

    assert stage.homed
    assert stage.position_mm == near(3.0, 0.0)


def test_a_tap_has_its_depth_and_duration(stage, board, loop):
    bench = Bench(damage.paper_rig(), board.line, board.clock, lambda: board.place_mm, sample_s=0.002)
    loop.clock = bench.watch
    bench.watch.paths = [[board.place_mm]]
    stage.path([(0.0, 2.5, 12.0), (0.0, 0.0, 12.0)])

    y_mm = [(now_s, Y.rig_mm(y)) for now_s, (_, y, _) in bench.watch.trace]
    away = [now_s for now_s, y in y_mm if y > 0.1]
    assert max(y for _, y in y_mm) == pytest.approx(2.5, abs=STEP_MM)
    assert away[-1] - away[0] == pytest.approx(2 * (2.5 / 12 + 12 / 500 - math.sqrt(2 * 0.1 / 500)), abs=0.02)
    assert place(board) == near(0.0, 0.0)
    assert stage.counts.false_idle == 0


def test_reports_in_motion_say_where_the_stage_is(stage, board, loop, journal):
    """Up to the time of a report on its way, 10 ms."""
    off_mm = []

    def compare(_):
        if len(journal.reports) > seen[0]:
            seen[0] = len(journal.reports)
            off_mm.append(math.dist(journal.reports[-1][1], place(board)))

    seen = [len(journal.reports)]
    with loop.guarded(compare):
        stage.move(x_mm=16.0)

    assert len(off_mm) > 20
    assert max(off_mm) < 0.03 * 20
    assert sorted(off_mm)[len(off_mm) // 2] < 0.012 * 20


def test_a_guard_that_objects_leaves_a_stage_that_can_be_stopped_and_moved(stage, board, loop):
    def act():
        raise Objection("stop")

    guard = Once(board, act)
    with loop.guarded(guard), pytest.raises(Objection):
        stage.move(x_mm=16.0)
    stage.stop()

    assert stands_still(board, loop)
    assert place(board)[0] - guard.place[0] < BRAKE_MM + 0.5
    assert stage.position_mm == near(*place(board))
    stage.move(x_mm=0.0)
    assert place(board) == near(0.0, 0.0)


def test_a_feed_hold_by_a_person_is_told(stage, board, loop):
    with loop.guarded(Once(board, lambda: board.line.write(b"!"))), pytest.raises(StageFault, match="x = 16 mm"):
        stage.move(x_mm=16.0)

    assert stands_still(board, loop)
    assert place(board)[0] < 8.0
    stage.stop()
    stage.move(x_mm=0.0)
    assert place(board) == near(0.0, 0.0)


def test_a_move_beyond_the_travel_is_an_alarm_and_a_jog_is_refused(stage, board, loop):
    board.line.write(b"$J=G53X-300F600\n")
    loop.sleep(0.2)
    assert stage.counts.extra_answers == 1
    board.line.write(b"G90G1X-300F600\n")
    loop.sleep(1.0)
    with pytest.raises(StageAlarm, match="ALARM:2, the move would leave the travel"):
        stage.move(x_mm=1.0)

    assert place(board) == near(0.0, 0.0)
    stage.home()
    stage.move(x_mm=0.0, y_mm=0.0)
    assert place(board) == near(0.0, 0.0)


def test_a_limit_switch_in_motion_stops_at_once_and_needs_homing(stage, board, loop):
    guard = Once(board, lambda: board.press("X"))
    with loop.guarded(guard), pytest.raises(StageAlarm, match="ALARM:1, a limit switch was hit, and lost its position"):
        stage.move(x_mm=16.0)

    assert place(board)[0] - guard.place[0] < 0.1
    assert stage.position_mm is None
    stage.close()
    with pytest.raises(NoAnswer, match="locked by an alarm until its reset button"):
        stage.connect()
    board.press("")
    stage.connect(will_home=True)
    stage.home()
    stage.move(x_mm=0.0, y_mm=0.0)
    assert place(board) == near(0.0, 0.0)


@pytest.mark.parametrize("cut", ["reset", "power"])
def test_a_restart_in_a_move_costs_the_position(stage, board, loop, cut):
    guard = Once(board, board.start if cut == "power" else lambda: board.line.write(b"\x18"))
    with loop.guarded(guard), pytest.raises(StageFault, match=r"restarted by itself|ALARM:3"):
        stage.move(x_mm=16.0)

    assert not stage.homed
    with pytest.raises(StageFault):
        stage.move(x_mm=0.0)
    loop.sleep(1.0)
    stage.home()
    stage.move(x_mm=0.0, y_mm=0.0)
    assert place(board) == near(0.0, 0.0)


@pytest.mark.parametrize(
    ("sent", "state", "advice"),
    [
        (b"G90G0X-50\n!", "Hold", "press its cycle start"),
        (b"\x84", "Door", "close its safety door"),
        (b"$C\n", "Check", r"send \$C"),
        (b"$SLP\n", "Sleep", "press its reset"),
    ],
)
def test_a_state_that_only_a_person_ends_is_named_and_homing_ends_it(stage, board, sent, state, advice):
    board.say(sent, 0.5)
    stage.close()
    with pytest.raises(StageFault, match=f"was in state {state} for .* s; .*{advice}"):
        stage.connect()

    stage.connect(will_home=True)
    stage.home()
    stage.move(x_mm=0.0, y_mm=0.0)
    assert place(board) == near(0.0, 0.0)


def test_a_refused_command_is_told(stage, board):
    board.line.keep(lambda _, data: data.replace(b"F", b"") if data.startswith(b"$J") else data)
    with pytest.raises(CommandRefused, match=r"error:(2|22), "):
        stage.move(x_mm=3.0)

    assert place(board) == near(0.0, 0.0)


@pytest.mark.parametrize(
    ("pattern", "becomes"),
    [(rb"X.*Z-?[0-9.]*", b""), (rb"X-4", b"X-"), (rb"X-44", b"X-04"), (rb"F900", b"F3000"), (rb"Y-4", b"Y-9")],
    ids=["no axes", "a digit lost", "a digit changed", "speed", "another axis"],
)
def test_a_damaged_jog_is_stopped_in_time(stage, board, loop, pattern, becomes):
    """At the speed of the example, 15 mm/s."""
    bench = Bench(damage.paper_rig(), board.line, board.clock, lambda: board.place_mm)
    loop.clock = bench.watch
    bench.watch.paths = [[board.place_mm, (X.machine_mm(16.0), Y.machine_mm(0.0), -1.0)]]
    board.line.keep(lambda _, data: re.sub(pattern, becomes, data) if data.startswith(b"$J") else data)
    with pytest.raises(StageFault, match="was stopped; it is at x ="):
        stage.move(x_mm=16.0, speed_mm_s=15.0)

    assert any(data.startswith(b"$J") for data in board.line.writes)
    assert bench.watch.strayed_mm < damage.CORRIDOR_MM
    assert bench.watch.strayed_s < damage.CORRIDOR_S
    assert stands_still(board, loop)


def test_damaged_commands_of_a_collection(board):
    """A sample of what `make faults` does on the emulated controller."""
    rig, tally, make = damage.paper_rig(), damage.Tally(), on_firmware(board)
    generator = seeds.generator(0, seeds.Purpose.STUDY)
    cases = []
    for action in damage.collection(rig, 2):
        if action.name == "home":  # the firmware homes z first
            continue
        writes, sound = damage.reference(rig, action, make)
        cases += [(action, one, sound, writes[one.write]) for one in damage.damages(writes, generator)]
    for action, one, sound, data in islice(cases, 0, None, len(cases) // DAMAGED):
        damage.check(rig, action, one, sound, data, tally, make)

    assert not tally.failed, tally.examples
    assert sum(tally.cases.values()) > sum(tally.done.values()) > 0
