"""What `rig check` finds: numbers of a sensor at rest, and sentences about what is wrong."""

import re
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solidtouch.hardware.rig.check import check_rig, sensor_report
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.hardware.skin.skin import SkinFrame

K = 3
EVERY = np.ones(K, bool)


def frames_of(time_s, raw):
    return [SkinFrame(t, r, 255 - r, EVERY) for t, r in zip(time_s, raw, strict=True)]


@given(
    st.integers(16, 400),
    st.floats(1.0, 200.0),
    st.lists(st.floats(-100, 100), min_size=K, max_size=K),
    st.floats(-1e6, 1e6),
)
@settings(max_examples=50)
def test_a_straight_line_has_its_rate_its_slope_and_no_noise(n, rate_hz, per_min, start_s):
    time_s = start_s + np.arange(n) / rate_hz
    middle_s = time_s.mean()
    raw = np.array([[200.0 + slope / 60 * (t - middle_s) for slope in per_min] for t in time_s])
    report = sensor_report(frames_of(time_s, raw), lost=0)

    assert (report.readings, report.loss) == (n, 0.0)
    assert report.rate_hz == pytest.approx(rate_hz, rel=1e-6)
    np.testing.assert_allclose(report.idle, 200.0, atol=1e-6)
    np.testing.assert_allclose(report.noise, 0.0, atol=1e-4)
    np.testing.assert_allclose(report.drift_per_min, per_min, atol=1e-3)
    np.testing.assert_allclose(report.drift_error, 0.0, atol=1e-2)


def test_the_interval_of_the_drift_holds_in_19_of_20_cases(rng):
    """Even where successive readings share half of their noise."""
    held = []
    time_s = np.arange(500) / 50.0
    for _ in range(300):
        white = rng.normal(size=(503, K))
        noise = (white[:-3] + white[1:-2] + white[2:-1] + white[3:]) / 2
        report = sensor_report(frames_of(time_s, 240 + 0.1 * time_s[:, np.newaxis] + noise), lost=0)
        held.extend(np.abs(report.drift_per_min - 6.0) < report.drift_error)

    assert 0.92 < np.mean(held) < 0.98
    assert report.noise == pytest.approx([1.0] * K, abs=0.15)


def test_loss_is_the_share_of_readings_that_did_not_come():
    report = sensor_report(frames_of(np.arange(75) / 50.0, np.zeros((75, K))), lost=25)

    assert report.loss == 0.25


@pytest.mark.parametrize("seconds", [0.5, 2.0, 10.0])
@pytest.mark.parametrize("kind", ["icub", "lines"])
def test_a_bench_in_order_has_nothing_wrong(make_bench, kind, seconds):
    with make_bench(kind=kind) as bench:
        place_mm = bench.place_mm
        report = check_rig(bench.build(), seconds)

        assert report.wrong == []
        assert report.sensor.rate_hz == pytest.approx(50.0, rel=0.02)
        assert report.sensor.idle.shape == (12,)
        assert dict(report.lines)["  controller"].startswith("Grbl 1.1")
        assert place_mm == bench.place_mm
        assert bench.open_ports == []


def test_a_stage_that_is_lost_is_told_and_homing_finds_it(make_bench):
    with make_bench(homed=False) as bench:
        (sentence,) = check_rig(bench.build(), 2.0).wrong
        assert sentence.endswith("position unknown; home the stage first (--home).")
        assert not any(data.startswith(b"$H") for data in bench.diary.sent(bench.stage_port))

        report = check_rig(bench.build(), 2.0, home=True)
        assert report.wrong == []
        assert dict(report.lines)["  position"].startswith("x = ")


WRONG = {
    "lost_frames": ({"rate": 0.02}, "readings were lost; taps with losses are repeated"),
    "drift": ({"counts_per_s": 0.8}, "taxel 0 drifts by -"),
    "foreign": ({}, r"\d+ foreign since the port was opened"),
    "stuck": ({}, "readings are identical; the sensor is stuck"),
    "silent_sensor": ({}, "no readings from board 14"),
    "unplug": ({"port": "sensor", "rate": 0.01}, "finger: lost the port while reading"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_what_is_wrong_with_the_sensor_is_a_sentence(rig_bench, fault):
    parameters, sentence = WRONG[fault]
    rig_bench.on(fault, **parameters)
    report = check_rig(rig_bench.build())

    assert any(re.search(sentence, wrong) for wrong in report.wrong)
    assert "stage" in dict(report.lines)
    assert rig_bench.open_ports == []


def test_taxels_that_never_change_are_named(make_bench):
    """That alone is nothing wrong: a quiet taxel of a sensor with few digits does the same."""
    without_noise = {"white_counts": 0.0, "taxel_noise_counts": 0.0, "common_noise_counts": 0.0}
    settings = replace(PRESETS["paper"], taxels=PRESETS["paper"].taxels[:2], **without_noise)
    with make_bench(settings, kind="lines") as bench:
        report = check_rig(bench.build(), 2.0)

    assert report.wrong == []
    assert dict(report.lines)["  at rest"] == "taxels 0, 1 constant; touch to test"


def test_without_a_stage_the_sensor_is_still_looked_at(rig_bench):
    stage = msgspec.structs.replace(rig_bench.settings.stage, port="/dev/there-is-none")
    report = check_rig(rig_bench.build(settings=msgspec.structs.replace(rig_bench.settings, stage=stage)), 2.0)

    assert [wrong for wrong in report.wrong if ": no such port" in wrong] == report.wrong
    assert report.sensor.readings > 90


def test_too_few_readings_are_told(rig_bench):
    (sentence,) = check_rig(rig_bench.build(), 0.1).wrong

    assert sentence.endswith("readings in 0.1 s are too few to assess; read for longer.")
