"""Every move is watched: nothing moves before readings arrive, and a silence or a touch on the way stops the finger."""

import re

import msgspec
import pytest
from slow_cases import slow_but
from solidtouch.hardware.errors import (
    BaselineRefused,
    NoAnswer,
    NotAtRest,
    OutOfLimits,
    SensorOverload,
    StaleSensor,
    WrongDevice,
)
from solidtouch.hardware.rig.check import check_rig
from solidtouch.hardware.rig.open_rig import connected

NOT_HOMED = "Finger position unknown: switch the power off before touching it."


def is_move(data):
    return data.startswith((b"$J=", b"$H"))


@pytest.mark.parametrize("home", [False, True])
def test_nothing_moves_before_readings_arrive(make_bench, home):
    with make_bench(homed=not home, place_mm=None) as bench:
        bench.on("silent_sensor")
        with pytest.raises(NoAnswer, match="no readings") as caught, connected(bench.build(), home):
            pass

        assert not any(map(is_move, bench.diary.sent(bench.stage_port)))
        assert caught.value.__notes__ == [NOT_HOMED if home else "Finger off the object at y = -29.0 mm."]


def test_a_finger_on_the_object_stays_where_it_is_without_readings(rig_bench):
    with rig_bench.rig() as rig:
        rig.close = lambda: (rig.skin.stop(), rig.stage.close())  # as if the program were killed
        rig.stage.move(y_mm=rig_bench.settings.tap.depth_mm)
    rig_bench.diary.log.clear()
    rig_bench.on("silent_sensor")
    with pytest.raises(NoAnswer, match="no readings") as caught, connected(rig_bench.build()):
        pass

    assert not any(map(is_move, rig_bench.diary.sent(rig_bench.stage_port)))
    note = "Finger at y = 2.5 mm, beyond tap.clear_mm: it may press on the object."
    assert caught.value.__notes__ == [note]


def test_a_failure_far_from_the_object_does_not_move_the_finger_towards_it(make_bench):
    with make_bench(place_mm=None) as bench:
        bench.on("drift", counts_per_s=60.0)
        with pytest.raises(BaselineRefused) as caught, connected(bench.build()):
            pass

        assert not any(map(is_move, bench.diary.sent(bench.stage_port)))
        assert caught.value.__notes__ == ["Finger off the object at y = -29.0 mm."]


def test_a_silence_on_the_way_stops_the_finger(rig_bench):
    with rig_bench.rig() as rig:
        start = rig_bench.place_mm[0]
        rig_bench.diary.when("command", lambda: rig_bench.on("silent_sensor"), lambda sent: is_move(sent[1]))
        with pytest.raises(StaleSensor, match="no reading for"):
            rig.move(7)

        assert abs(rig_bench.place_mm[0] - start) < 6.0
        assert rig_bench.is_clear


def test_a_touch_on_the_way_stops_the_finger(rig_bench):
    """The finger passes so low that it meets an object which is put in its way."""
    tap = rig_bench.settings.tap
    low = msgspec.structs.replace(tap, clear_mm=tap.depth_mm - 1)
    rig = rig_bench.build(settings=msgspec.structs.replace(rig_bench.settings, tap=low))
    rig_bench.emulation.control({"object": None})
    with connected(rig):
        rig_bench.emulation.control({"object": len(rig_bench.emulation.objects) - 1})
        with pytest.raises(SensorOverload, match="the finger touched something on its way"):
            rig.move(10)


def test_an_overload_while_homing_resets_the_controller(make_bench):
    with make_bench(homed=False) as bench:
        rig = bench.build()

        def overload():
            rig.skin.monitor.overloaded = lambda _: True

        bench.diary.when("command", overload, lambda sent: sent[1].startswith(b"$H"))
        with pytest.raises(SensorOverload, match="a taxel saturated while homing"), connected(rig, home=True):
            pass

        assert b"\x18" in bench.diary.sent(bench.stage_port)


def test_a_silence_while_homing_resets_the_controller(make_bench):
    """The controller is silent, too, so that nothing arrives."""
    with make_bench(homed=False) as bench:
        bench.diary.when("command", lambda: bench.on("silent_sensor"), lambda sent: sent[1].startswith(b"$H"))
        with pytest.raises(StaleSensor, match=r"no reading for \d{3} ms"), connected(bench.build(), home=True):
            pass

        assert b"\x18" in bench.diary.sent(bench.stage_port)


def test_a_finger_behind_the_object_is_not_moved_through_it(rig_bench):
    """As after homing by another program to a switch on the wrong side."""
    stage = rig_bench.settings.stage
    y = msgspec.structs.replace(stage.y, origin_mm=-100.0, direction=1)
    settings = msgspec.structs.replace(rig_bench.settings, stage=msgspec.structs.replace(stage, y=y))
    sentence = r"at y = 71.0 mm, beyond stage.y.high_mm = 3 on the side of the object"
    with pytest.raises(OutOfLimits, match=sentence), connected(rig_bench.build(settings=settings)):
        pass

    assert not any(map(is_move, rig_bench.diary.sent(rig_bench.stage_port)))


@pytest.mark.parametrize("home", [False, True])
def test_a_tap_faster_than_the_controller_is_refused_before_anything_moves(make_bench, home):
    with make_bench(homed=not home) as bench:
        fast = msgspec.structs.replace(bench.settings.tap, speed_mm_s=90.0)
        settings = msgspec.structs.replace(bench.settings, tap=fast)
        sentence = (
            r"tap.speed_mm_s=90 exceeds the maximum of Y, 50 mm/s \(\$111=3000 mm/min\); lower it or send \$111=5400"
        )
        with pytest.raises(WrongDevice, match=sentence), connected(bench.build(settings=settings), home):
            pass

        assert any(re.search(sentence, wrong) for wrong in check_rig(bench.build(settings=settings), 0.5, home).wrong)
        assert not any(map(is_move, bench.diary.sent(bench.stage_port)))


STATES = {
    "Door": (b"\x84", "close its safety door and press cycle start"),
    "Hold": (b"!", "press its cycle start"),
    "Check": (b"$C\n", r"send \$C"),
    "Sleep": (b"$SLP\n", "press its reset"),
}


@pytest.mark.parametrize("state", slow_but(("Door", "Check"), STATES))
def test_a_person_who_stopped_the_controller_reads_how_to_go_on(rig_bench, state):
    """In the words of a connection."""
    pressed, remedy = STATES[state]
    with rig_bench.rig() as rig:
        rig_bench.emulation.bench.links[0].device.receive(pressed, rig_bench.clock.now())
        rig.loop.sleep(0.3)
        sentence = rf"the stage did not stop \(state {state}\); it is .*{remedy}.*home it \(--home\)"
        with pytest.raises(NotAtRest, match=sentence):
            rig.tap()
        rig.stage.connect(will_home=True)
        rig.stage.home()
