"""Whatever ends the opening of a rig, or what follows it, leaves no port open and no finger on an object."""

import threading

import msgspec
import pytest
from slow_cases import slow_but
from solidtouch.hardware.emulator.shared_clock import SharedClock, SocketConnection
from solidtouch.hardware.errors import NotAtRest, PortBusy, PortError, RigError, StageFault
from solidtouch.hardware.journal import NoJournal
from solidtouch.hardware.link.loop import HostClock
from solidtouch.hardware.rig import open_rig as opening
from solidtouch.hardware.rig.open_rig import connected, open_rig, unconnected
from solidtouch.hardware.rig.rest import resting_place


class Refusing:
    """A rig whose parts fail as told, and that counts how often it was closed."""

    def __init__(self, connecting=None, closing=None):
        self.connecting, self.closing, self.closed, self.rest = connecting, closing, 0, resting_place()

    def connect(self, _):
        if self.connecting is not None:
            raise self.connecting

    def close(self):
        self.closed += 1
        if self.closing is not None:
            raise self.closing


def nth(n):
    """A condition that holds the n-th time that it is asked, counted from 0."""
    left = [n]

    def holds(_):
        left[0] -= 1
        return left[0] < 0

    return holds


def interrupt():
    raise KeyboardInterrupt


@pytest.mark.parametrize("kind", ["command", "event", "status", "frame"])
@pytest.mark.parametrize("n", slow_but((0, 5, 21), (0, 1, 2, 3, 5, 8, 13, 21)))
def test_ctrl_c_at_any_moment_leaves_nothing_open(rig_bench, kind, n):
    """In homing, connecting, moving or tapping; a moment that never comes changes nothing."""
    threads = threading.active_count()
    rig_bench.diary.when(kind, interrupt, nth(n))
    try:
        with rig_bench.rig(home=True) as rig:
            rig.tap()
    except KeyboardInterrupt:
        came = True
    else:
        came = False

    assert came == (kind not in rig_bench.diary.acts)
    assert came or kind == "event"
    assert rig_bench.open_ports == []
    assert rig_bench.is_clear
    assert threads == threading.active_count()


FAULTS = {
    "no such stage": ("stage", None),
    "no such sensor": ("sensor", None),
    "noise from the stage": (None, ("garbage", {"port": "stage"})),
    "noise from the sensor": (None, ("garbage", {"port": "sensor"})),
    "a silent sensor": (None, ("silent_sensor", {})),
    "a stage that restarts": (None, ("brown_out", {"rate": 0.1})),
    "a stage that cannot move": (None, ("refuse_move", {})),
    "a sensor that is unplugged": (None, ("unplug", {"port": "sensor", "rate": 0.05, "seconds": 60.0})),
}


@pytest.mark.parametrize(("missing", "fault"), FAULTS.values(), ids=FAULTS)
def test_a_rig_that_cannot_be_opened_leaves_nothing_open(rig_bench, missing, fault):
    settings = rig_bench.settings
    if missing is not None:
        part = msgspec.structs.replace(getattr(settings, missing), port="/dev/there-is-none")
        settings = msgspec.structs.replace(settings, **{missing: part})
    else:
        rig_bench.on(fault[0], **fault[1])
    with pytest.raises(RigError, match=r"(?m)(none|stage|finger): .*\.$"), rig_bench.rig(settings=settings):
        pass

    assert rig_bench.open_ports == []
    assert rig_bench.is_clear


@pytest.mark.parametrize(
    ("fault", "how", "note"),
    [
        ("silent_sensor", {}, "Finger off the object at y = 0.0 mm."),
        ("overload", {"mask": 5}, "Finger at y = 0.0 mm, where its readings are those of a touch."),
        ("unplug", {"port": "stage"}, "Finger position unknown: switch the power off before touching it."),
    ],
)
def test_a_note_says_where_the_finger_is(rig_bench, fault, how, note):
    def tap():
        with rig_bench.rig() as rig:
            rig_bench.once_deep(lambda: rig_bench.on(fault, **how))
            rig.tap()

    with pytest.raises(RigError) as caught:
        tap()
    assert caught.value.__notes__ == [note]


def test_a_finger_that_another_program_drives_is_left_to_it():
    """Nobody is asked to switch the power off in the middle of its work."""
    busy = PortBusy("/dev/stage: another program has the port open.")
    with pytest.raises(PortBusy) as raised, connected(Refusing(connecting=busy)):
        pass
    assert raised.value.__notes__ == ["Finger position unknown: another program drives it."]


def test_what_fails_is_told_and_closing_follows():
    for trouble in (StageFault("It stopped."), KeyboardInterrupt(), ZeroDivisionError("division by zero")):
        for rig in (Refusing(connecting=trouble), Refusing()):
            with pytest.raises(type(trouble)) as raised, connected(rig):
                raise trouble
            assert raised.value is trouble
            assert rig.closed == 1


def test_a_finger_that_stays_on_is_told_after_whatever_failed():
    rig = Refusing(closing=StageFault("It does not stop."))
    sentence = r"^division by zero\. The finger may still be pressing; .* It does not stop\.\nFinger position unknown"
    with pytest.raises(NotAtRest, match=sentence), connected(rig):
        raise ZeroDivisionError("division by zero")


def test_it_is_told_once():
    trouble = NotAtRest("The finger may still press.")
    with pytest.raises(NotAtRest) as raised, connected(Refusing(closing=StageFault("It does not stop."))):
        raise trouble

    assert raised.value is trouble


def test_a_rig_that_fails_only_in_closing_is_told_as_it_is():
    with (
        pytest.raises(StageFault, match="It does not stop"),
        connected(Refusing(closing=StageFault("It does not stop."))),
    ):
        pass


def test_an_emulator_that_is_not_there_is_named(rig_bench):
    with (
        pytest.raises(PortError, match=r"control: no emulator answers; start one with `solidtouch emulate`"),
        open_rig(rig_bench.settings, NoJournal()),
    ):
        pass


@pytest.mark.parametrize("shared", [True, False])
def test_an_emulated_rig_has_the_time_that_its_file_says(rig_bench, monkeypatch, shared):
    emulator = msgspec.structs.replace(rig_bench.settings.emulator, shared_clock=shared)
    settings = msgspec.structs.replace(rig_bench.settings, emulator=emulator)
    connection = rig_bench.emulation
    monkeypatch.setattr(SocketConnection, "__init__", lambda *_: None)
    monkeypatch.setattr(SocketConnection, "control", lambda _, order: connection.control(order))
    monkeypatch.setattr(SocketConnection, "close", lambda _: None)
    with unconnected(settings, NoJournal()) as rig:
        assert isinstance(rig.loop.clock, SharedClock if shared else HostClock)
        assert isinstance(rig.emulator, SocketConnection)


def test_a_real_rig_has_the_time_of_the_host(rig_bench):
    with unconnected(msgspec.structs.replace(rig_bench.settings, emulator=None), NoJournal()) as rig:
        assert isinstance(rig.loop.clock, HostClock)
        assert rig.emulator is None


def test_a_stage_homes_only_when_asked_to(rig_bench, monkeypatch):
    """Homing drives it to its switches."""
    asked = []
    rig = Refusing()
    monkeypatch.setattr(rig, "connect", asked.append)
    monkeypatch.setattr(opening, "build_rig", lambda *_: rig)
    settings = msgspec.structs.replace(rig_bench.settings, emulator=None)
    for more in ((), (True,)):
        with open_rig(settings, NoJournal(), *more):
            pass
    assert asked == [False, True]
