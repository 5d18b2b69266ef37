"""The emulated array that prints lines."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.emulator.faults import Switches
from solidtouch.hardware.emulator.finger import Finger
from solidtouch.hardware.emulator.line_array import LineArray
from solidtouch.hardware.simulator.settings import PRESETS

PAPER = PRESETS["paper"]


def array(taxels=5, rate_hz=40.0, y_mm=0.0, what=None):
    switches = Switches()
    settings = replace(PAPER, taxels=PAPER.taxels[:taxels], rate_hz=rate_hz)
    return LineArray(switches, Finger(settings, lambda _: (8.0, y_mm), 0, 0, what), rate_hz), switches


def lines(device, until_s):
    data = b""
    while device.next_event_s() <= until_s:
        data += device.step(device.next_event_s())
    return data.decode("ascii").splitlines()


def values(text):
    return np.array([[int(value) for value in line.split(",")] for line in text if not line.startswith("#")])


def test_it_starts_anew_when_the_port_is_opened():
    """A second after opening a header comes, then lines at the rate with its own time; closed it is silent."""
    device, _ = array()
    assert device.next_event_s() == np.inf
    device.opened(100.0)
    assert device.step(100.9) == b""
    first, *rest = lines(device, 102.0)

    assert first == "# solidtouch-lines K=5 rate_hz=40"
    assert values(rest)[:, 0].tolist() == list(range(1000, 2001, 25))
    assert values(rest).shape[1] == 6

    device.closed(102.0)
    assert device.next_event_s() == np.inf
    device.opened(103.0)
    assert lines(device, 104.0)[0].startswith("#")


def test_lines_late_come_together():
    """One step sends all that is due."""
    device, _ = array()
    device.opened(0.0)

    assert device.step(1.1).count(b"\n") == 1 + 5


def test_it_ignores_what_it_is_told():
    """Bytes from the program change nothing."""
    device, _ = array()
    device.opened(0.0)
    device.receive(bytes(range(256)), 0.5)

    assert device.next_event_s() == 1.0


def test_values_rise_under_load():
    """A pressed finger prints more than a free one."""
    free, _ = array(taxels=12)
    pressed, _ = array(taxels=12, y_mm=2.5, what=2)
    for device in (free, pressed):
        device.opened(0.0)

    assert values(lines(pressed, 2.0))[-1, 1:].sum() > values(lines(free, 2.0))[-1, 1:].sum() + 200


@pytest.mark.parametrize(
    ("fault", "options", "expected"), [("silent_sensor", {}, 0), ("lost_frames", {"times": 2, "count": 3}, 41 - 6)]
)
def test_faults_take_lines_away(fault, options, expected):
    """A silent sensor prints its header only; lost readings are missing."""
    device, switches = array()
    switches.on(fault, **options)
    device.opened(0.0)

    assert len(values(lines(device, 2.0))) == expected


def test_stuck_values_repeat_while_time_goes_on():
    """A sensor that hangs still counts milliseconds."""
    device, switches = array()
    switches.on("stuck")
    device.opened(0.0)
    printed = values(lines(device, 2.0))

    assert (printed[:, 1:] == printed[0, 1:]).all()
    assert len(set(printed[:, 0])) == 41


def test_drift_and_overload_end_at_full_scale():
    """Drift adds up with time, and what it has added stays; overload hits the taxels of its mask."""
    device, switches = array(taxels=3)
    device.opened(0.0)
    switches.on("drift", counts_per_s=20.0)
    drifted = values(lines(device, 4.0))[:, 1:]
    switches.off("drift")
    switches.on("overload", times=1, mask=0b101)
    overloaded, after = values(lines(device, 4.05))[:, 1:]

    assert drifted[-1].mean() - drifted[0].mean() == pytest.approx(60, abs=5)
    assert overloaded[[0, 2]].tolist() == [255, 255]
    assert after == pytest.approx(drifted[-1], abs=15)
    assert overloaded[1] < 100
