"""Faults of both ports and how the whole rig handles them; numbers are rows of docs/reference/faults.md."""

from itertools import pairwise

import msgspec
import pytest
from slow_cases import slow_but
from solidtouch.hardware.errors import NotAtRest, PortBusy, PortError, PortLost, RigError, WrongDevice
from solidtouch.hardware.link.port import Port

PORTS = ("stage", "sensor")
EITHER = pytest.mark.parametrize("port", PORTS)


def address(bench, port):
    return bench.settings.stage.port if port == "stage" else bench.settings.sensor.port


def with_port(settings, port, address):
    return msgspec.structs.replace(settings, **{port: msgspec.structs.replace(getattr(settings, port), port=address)})


def noticed(rig):
    """Everything that the drivers counted as wrong."""
    return sum(vars(rig.skin.counts).values()) - rig.skin.counts.frames + sum(vars(rig.stage.counts).values())


def assert_only_true_taps(bench, rig, n=4):
    """Taps, whatever they cost, are those that the finger felt; what fails leaves the finger off."""
    for _ in range(n):
        try:
            samples = rig.tap()
        except RigError:
            assert bench.is_clear
        else:
            assert bench.deviation(samples) < 3 * bench.settings.sensor.noise_limit


SPLITS = [(size, port) for size in (1, 7) for port in PORTS]


@pytest.mark.parametrize(("size", "port"), slow_but([(1, "stage"), (7, "sensor")], SPLITS))
def test_fault_01_split(rig_bench, port, size):
    """Nothing is lost, and nothing is taken for a fault."""
    rig_bench.on("split", port=port, size=size, delay_s=0.0002)
    with rig_bench.rig() as rig:
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig_bench.struck("split") > 20
        assert rig.tally.rejected == 0
        assert noticed(rig) == 0


DAMAGED = [(fault, port) for fault in ("drop_bytes", "merge", "flip_bits") for port in PORTS]


@pytest.mark.parametrize(
    ("fault", "port"), slow_but([("drop_bytes", "stage"), ("merge", "sensor"), ("flip_bits", "sensor")], DAMAGED)
)
def test_fault_02_03_04_damaged_bytes(rig_bench, port, fault):
    with rig_bench.rig() as rig:
        rig_bench.on(fault, port=port, rate=0.02 if port == "sensor" else 0.2)
        assert_only_true_taps(rig_bench, rig)
        rig_bench.off()
        assert rig_bench.struck(fault) > 0
        assert noticed(rig) + rig.tally.rejected > 0
        assert rig_bench.place_mm[0] == pytest.approx(rig.place_mm, abs=0.01)


def test_fault_02_dropped_bytes_spoil_their_tap(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("drop_bytes", times=1, port="sensor"))
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig_bench.diary.all("tap") == [(False, "1 reading lost"), (True, "")]
        assert rig.skin.counts.lost == 1


def test_fault_03_merged_lines_are_no_line(rig_bench):
    """One reading is lost with the end between its halves, two with the one between readings."""
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("merge", times=1, port="sensor"))
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig_bench.diary.all("tap") in (
            [(False, "1 reading lost"), (True, "")],
            [(False, "2 readings lost"), (True, "")],
        )
        assert rig.skin.counts.dropped == 1


@EITHER
def test_fault_04_wrong_baud_rate(rig_bench, port):
    rig_bench.on("garbage", port=port)
    with pytest.raises(WrongDevice, match=f"{address(rig_bench, port)}: .*baud"), rig_bench.rig():
        pass

    assert rig_bench.open_ports == []


def test_fault_06_unplugged_sensor(rig_bench):
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("unplug", times=1, port="sensor"))
        with pytest.raises(PortLost, match="finger: lost the port while reading; it was unplugged"):
            rig.tap()
        assert rig_bench.is_clear
        assert rig.stage.position_mm is not None


def test_fault_06_unplugged_stage(rig_bench):
    """What was sent ends by itself; plugged in again, the stage is where it says, and nothing moves unasked."""
    with rig_bench.rig() as rig:
        rig_bench.once_deep(lambda: rig_bench.on("unplug", times=1, port="stage"))
        with pytest.raises(NotAtRest, match=r"stage: lost the port .* lift it by hand"):
            rig.tap()
        assert rig.stage.position_mm is None
    rig_bench.clock.wait([], rig_bench.clock.now() + 2.0)
    place_mm = rig_bench.place_mm

    again = rig_bench.build()
    again.stage.connect()
    assert place_mm == rig_bench.place_mm
    again.stage.close()

    with rig_bench.rig() as rig:
        assert rig_bench.deviation(rig.tap()) < 1e-9


@EITHER
def test_fault_07_renumbered(rig_bench, port):
    """The name of the port stays, whatever the system calls the device, and who answers there is made sure of."""
    with rig_bench.rig() as rig:
        rig_bench.on("renumber", times=1, port=port, seconds=0.5)
        with pytest.raises(PortLost if port == "sensor" else NotAtRest, match="was unplugged"):
            rig.tap()
    rig_bench.clock.wait([], rig_bench.clock.now() + 2.0)
    with rig_bench.rig() as rig:
        assert rig_bench.deviation(rig.tap()) < 1e-9


def test_fault_07_another_device_at_the_port(rig_bench):
    stage, sensor = rig_bench.settings.stage.port, rig_bench.settings.sensor.port
    rig_bench.on("left_open")
    for settings, found in (
        (with_port(rig_bench.settings, "stage", sensor), "no GRBL controller answers"),
        (with_port(rig_bench.settings, "stage", f"{stage}-gone"), ": no such port"),
    ):
        with (
            pytest.raises(WrongDevice if settings.stage.port == sensor else PortError, match=found),
            rig_bench.rig(settings=settings),
        ):
            pass
        assert rig_bench.open_ports == []


@EITHER
def test_fault_08_stale_input(rig_bench, port):
    with rig_bench.rig() as rig:
        rig.tap()
    rig_bench.on("stale_input", port=port)
    with rig_bench.rig() as rig:
        assert rig_bench.struck("stale_input") == 1
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig.tally.rejected == 0


@EITHER
def test_fault_11_two_programs(rig_bench, port):
    other = Port(address(rig_bench, port))
    other.open()
    with pytest.raises(PortBusy, match=f"{other.address}: another program has the port open"), rig_bench.rig():
        pass
    other.close()
    assert rig_bench.open_ports == []

    with rig_bench.rig() as rig:
        rig_bench.on("second_reader", port=port, rate=0.05)
        assert_only_true_taps(rig_bench, rig)
        rig_bench.off()
        assert rig_bench.struck("second_reader") > 0
        assert noticed(rig) > 0


@EITHER
def test_fault_12_modem_manager(rig_bench, port):
    """It keeps a new port for ten seconds and talks to the device; the rig waits, and ignores what came of it."""
    rig_bench.on("busy_port", times=1, port=port, seconds=10.0)
    rig_bench.emulation.control({})
    busy = []
    rig_bench.diary.when("event", lambda: busy.append(True), lambda event: event[0] == "busy")
    with rig_bench.rig() as rig:
        assert busy
        assert rig_bench.clock.now() > 10.0
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig.tally.rejected == 0


@EITHER
def test_fault_32_late(rig_bench, port):
    """Readings carry the time of their arrival, in order; those that are late are no loss."""
    with rig_bench.rig() as rig:
        rig_bench.on("late", port=port, rate=0.5, delay_s=0.015)
        rig_bench.diary.frames.clear()
        assert rig_bench.deviation(rig.tap()) < 1e-9
        assert rig_bench.struck("late") >= 3
        assert rig.skin.counts.lost == 0
    times_s = [frame.time_s for frame in rig_bench.diary.frames]
    gaps_ms = {round(1000 * (b - a)) for a, b in pairwise(times_s)}

    assert times_s == sorted(times_s)
    assert (len(gaps_ms) > 3) == (port == "sensor")
