"""rig.toml: what it says comes back, and what is wrong in it is named by its key."""

import re
from pathlib import Path

import pytest
from solidtouch.hardware.rig.settings import EmulatorSettings, IcubSettings, LineSettings, load_rig, parse_rig
from solidtouch.models.errors import InputError

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "rig.toml"

RIG = """
name = "bench"
sensor = { kind = "icub", port = "/dev/finger" }
range = { start_mm = 0.0, end_mm = 6.0, cell_mm = 1.5 }
tap = { clear_mm = 0.0, depth_mm = 2.0, samples = 30, lead_samples = 7 }
[stage]
port = "/dev/stage"
x = { letter = "X", origin_mm = -60.0, low_mm = -1.0, high_mm = 7.0, speed_mm_s = 20.0 }
y = { letter = "Y", origin_mm = -40.0, low_mm = -2.0, high_mm = 3.0, speed_mm_s = 10.0, direction = -1 }
"""
SENSOR = 'sensor = { kind = "icub", port = "/dev/finger" }'
LINES = 'sensor = { kind = "lines", port = "p", taxels = 5, rate_hz = 100.0 }'


def edited(old, new):
    assert old in RIG
    return RIG.replace(old, new)


def test_the_example_in_the_docs_is_valid():
    rig = load_rig(EXAMPLE)

    assert rig.range.where_classes == 16
    assert rig.sensor.taxels == 12
    assert rig.preprocessing.rate_hz == 50.0


def test_defaults_fill_what_the_file_does_not_say():
    rig = parse_rig(RIG)

    assert isinstance(rig.sensor, IcubSettings)
    assert (14, 0, 20, list(range(12))) == (
        rig.sensor.board,
        rig.sensor.triangle,
        rig.sensor.period_ms,
        rig.sensor.order,
    )
    assert rig.emulator is None
    assert EmulatorSettings("socket").shared_clock
    with pytest.raises(AttributeError, match="immutable"):
        EmulatorSettings("socket").control = "another"


def test_the_preprocessing_record_follows_from_the_tap():
    record = parse_rig(RIG).preprocessing

    assert (
        record.trigger,
        record.samples,
        record.pre_samples,
        record.tare,
        record.tare_samples,
        record.rate_hz,
    ) == ("press", 30, 7, "tap", 7, 50.0)


def test_a_sensor_of_lines_has_its_own_keys():
    rig = parse_rig(edited('sensor = { kind = "icub", port = "/dev/finger" }', LINES))

    assert isinstance(rig.sensor, LineSettings)
    assert rig.preprocessing.rate_hz == 100.0


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("rig_mm", [-1.0, 0.0, 2.25])
def test_rig_and_machine_coordinates_are_inverse(axis, rig_mm):
    axis = getattr(parse_rig(RIG).stage, axis)

    assert rig_mm == axis.rig_mm(axis.machine_mm(rig_mm))


def test_a_direction_of_minus_one_turns_the_axis_round():
    y = parse_rig(RIG).stage.y

    assert y.machine_mm(2.0) == -42.0


WRONG = {
    "no toml": (RIG + "=", "not TOML"),
    "unknown key": (edited("clear_mm", "clearmm"), r"tap: unknown key `clearmm`"),
    "missing key": (edited("depth_mm = 2.0, ", ""), r"tap: missing key `depth_mm`"),
    "missing table": (RIG.split("[stage]", maxsplit=1)[0], r"missing key `stage`"),
    "wrong type": (
        edited("depth_mm = 2.0", 'depth_mm = "2"'),
        r"tap.depth_mm: must be a number from -10,000 to 10,000, got '2'",
    ),
    "out of range": (
        edited("samples = 30", "samples = 0"),
        r"tap.samples: must be an integer from 1 to 100,000, got 0\.",
    ),
    "unknown sensor": (edited('"icub"', '"eye"'), r"sensor\.kind: must be icub or lines, got 'eye'"),
    "limits": (edited("high_mm = 7.0", "high_mm = -2.0"), r"stage.x: low_mm=-1 must be below high_mm=-2"),
    "same letter": (edited('"Y"', '"X"'), r"stage.y.letter: both axes are called X"),
    "range outside": (edited("end_mm = 6.0", "end_mm = 9.0"), r"range.end_mm: 9 mm is outside the limits of stage.x"),
    "too deep": (edited("depth_mm = 2.0", "depth_mm = 3.5"), r"tap.depth_mm: 3.5 mm is outside the limits"),
    "not deeper": (edited("depth_mm = 2.0", "depth_mm = 0.0"), r"tap.depth_mm: must be above clear_mm"),
    "cells": (edited("cell_mm = 1.5", "cell_mm = 4.0"), r"range: must be a whole number of cells"),
    "turned range": (edited("start_mm = 0.0, end_mm = 6.0", "start_mm = 6.0, end_mm = 0.0"), r"range: must"),
    "lead": (edited("lead_samples = 7", "lead_samples = 30"), r"tap.lead_samples: must be below samples"),
    "period": (edited("samples = 30", "samples = 80"), r"tap.period_s: 80 samples take 1.6 s"),
    "one port": (edited("/dev/stage", "/dev/finger"), r"stage.port: must differ from sensor.port"),
    "slow tap": (edited("depth_mm = 2.0", "depth_mm = 2.0, speed_mm_s = 2.0"), r"tap.samples: .* at least 2.00 s"),
    "overload at rest": (edited('"/dev/finger"', '"p", overload = 225'), r"sensor.overload: must be below 225"),
    "overload of lines at rest": (
        edited(SENSOR, LINES.replace(" }", ", idle_high = 550.0, overload = 500.0 }")),
        r"sensor.overload: must be above 550, the highest reading at rest, got 500",
    ),
    "order twice": (
        edited('"/dev/finger"', '"p", order = [1, 1]'),
        r"sensor.order: must list distinct taxels out of 0 to 11",
    ),
    "order empty": (edited('"/dev/finger"', '"p", order = []'), r"sensor.order: a tap needs at least one taxel"),
    "positions": (
        edited('"/dev/finger"', '"p", positions_mm = [[1, 2]]'),
        r"sensor.positions_mm: must give two or three",
    ),
    "nan": (
        edited("depth_mm = 2.0", "depth_mm = nan"),
        r"tap.depth_mm: must be a number from -10,000 to 10,000, got nan\.",
    ),
    "far away": (
        edited("high_mm = 7.0", "high_mm = 1e308"),
        r"stage\.x\.high_mm: must be a number from .* got 1e\+308",
    ),
    "infinite limit": (
        edited("high_mm = 7.0", "high_mm = inf"),
        r"stage.x.high_mm: must be a number from .* got inf\.",
    ),
    "high-pass": (
        edited("samples = 30", "samples = 30, highpass_hz = 30.0"),
        r"tap: A high-pass filter at 30.0 Hz needs",
    ),
}


@pytest.mark.parametrize(("text", "sentence"), WRONG.values(), ids=WRONG.keys())
def test_the_message_names_the_key(text, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        parse_rig(text)

    assert str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_the_message_names_the_file(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(edited("depth_mm = 2.0", "depth_mm = true"))

    with pytest.raises(InputError, match=re.escape(f"{path}: tap.depth_mm")):
        load_rig(path)


@pytest.mark.parametrize("content", [None, b"\xff\xfe"], ids=["missing", "not text"])
def test_a_file_that_cannot_be_read_is_named(tmp_path, content):
    path = tmp_path / "rig.toml"
    if content is not None:
        path.write_bytes(content)

    with pytest.raises(InputError, match=re.escape(f"{path}: cannot read")):
        load_rig(path)
