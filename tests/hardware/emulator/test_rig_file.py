"""The rig.toml of an emulated bench is valid, and taps as deep as the simulator's rig."""

from dataclasses import replace

import pytest
from solidtouch.hardware.emulator.rig_file import CLEARANCE_MM, TRAVEL_MM, emulated_rig, toml, write_rig
from solidtouch.hardware.rig.settings import load_rig, parse_rig
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.errors import InputError

PAPER = PRESETS["paper"]


@pytest.mark.parametrize("kind", ["icub", "lines"])
@pytest.mark.parametrize("name", list(PRESETS))
def test_it_reads_back_as_it_was_made(tmp_path, name, kind):
    rig = emulated_rig(tmp_path, PRESETS[name], kind, name="a \"b\" 'c' µ")
    write_rig(tmp_path / "rig.toml", rig, ["4 mm rod"])

    assert load_rig(tmp_path / "rig.toml") == rig
    assert "# Its objects: 4 mm rod.\n" in (tmp_path / "rig.toml").read_text(encoding="utf-8")


def test_taps_are_those_of_the_simulator(tmp_path):
    rig = emulated_rig(tmp_path, PAPER, "icub")

    assert (rig.preprocessing.samples, rig.preprocessing.rate_hz) == (50, 50.0)
    assert rig.tap.depth_mm == CLEARANCE_MM + PAPER.depth_mm
    assert rig.range.where_classes == PAPER.where_classes
    down_and_up_s = 2 * (rig.tap.depth_mm - rig.tap.clear_mm) / rig.stage.y.speed_mm_s
    assert 0.4 < down_and_up_s < 0.7


@pytest.mark.parametrize("start_mm", [-3.0, 0.0, 40.0])
def test_the_limits_lie_on_the_axes_and_home_is_clear(tmp_path, start_mm):
    rig = emulated_rig(tmp_path, replace(PAPER, start_mm=start_mm, end_mm=start_mm + 16.0), "icub")
    x, y = rig.stage.x, rig.stage.y
    machine = [axis.machine_mm(mm) for axis in (x, y) for mm in (axis.low_mm, axis.high_mm)]

    assert all(-TRAVEL_MM < mm < 0 for mm in machine)
    assert x.rig_mm(0.0) > x.high_mm
    assert y.rig_mm(0.0) < rig.tap.clear_mm
    assert y.high_mm > rig.tap.depth_mm


def test_other_sizes_fit_too(tmp_path):
    settings = replace(
        PAPER, taxels=PAPER.taxels[:7], rate_hz=25.0, start_mm=2.0, end_mm=8.0, cell_mm=1.5, spacing_mm=0.25
    )
    rig = parse_rig(toml(emulated_rig(tmp_path, settings, "icub")))

    assert (rig.sensor.taxels, rig.sensor.period_ms, rig.range.where_classes) == (7, 40, 4)
    assert rig.preprocessing.samples == 25


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"rate_hz": 60.0}, "The iCub skin board sends every 1 to 209 ms; 60 Hz is out of range"),
        ({"rate_hz": 2.0}, "; 2 Hz is out of range"),
        ({"rate_hz": 1000 / 210, "tap_period_s": 1.05}, "; 4.7619 Hz is out of range"),
        ({"taxels": PAPER.taxels * 2}, "The iCub's fingertip has 12 taxels, not 24"),
        ({"end_mm": 180.0}, "The range of 180 mm exceeds the travel"),
    ],
)
def test_what_the_bench_cannot_do_is_said(tmp_path, changes, sentence):
    with pytest.raises(InputError, match=sentence):
        emulated_rig(tmp_path, replace(PAPER, **changes), "icub")


@pytest.mark.parametrize("period_ms", [1, 209])
def test_the_slowest_and_the_fastest_board_fit(tmp_path, period_ms):
    settings = replace(PAPER, rate_hz=1000 / period_ms, tap_period_s=5 * period_ms / 1000)
    assert emulated_rig(tmp_path, settings, "icub").sensor.period_ms == period_ms


def test_lines_take_any_number_of_taxels_and_any_rate(tmp_path):
    rig = emulated_rig(tmp_path, replace(PAPER, taxels=PAPER.taxels * 2, rate_hz=60.0), "lines")

    assert (rig.sensor.taxels, rig.sensor.rate_hz) == (24, 60.0)


def test_its_own_file_is_replaced_and_a_file_of_others_is_not(tmp_path):
    path, rig = tmp_path / "rig.toml", emulated_rig(tmp_path, PAPER, "lines")
    write_rig(path, rig, ["a"])
    write_rig(path, rig, ["b"])

    assert "objects: b." in path.read_text()

    path.write_text('name = "mine"\n')
    with pytest.raises(InputError, match=r"rig.toml: not written by the emulator, so not overwritten"):
        write_rig(path, rig, ["a"])


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(InputError, match=r"rig.toml: cannot write: No such file"):
        write_rig(tmp_path / "none" / "rig.toml", emulated_rig(tmp_path, PAPER, "icub"), [])
