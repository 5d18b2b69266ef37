"""A rig whose taps have another rate than its sensor, and not all of its taxels."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from solidtouch.hardware.errors import SensorFault
from solidtouch.hardware.named_rigs import LabelledRig
from solidtouch.hardware.recording.recording import Recorder
from solidtouch.hardware.recording.settings import about_rig
from solidtouch.hardware.rig.settings import parse_rig
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.errors import InputError
from solidtouch.models.io.rig import taps_from_recording
from solidtouch.models.preprocessing import Preprocessing

FAST = replace(PRESETS["paper"], rate_hz=100.0)
CHANGED = {
    "rate_hz": 50.0,
    "highpass_hz": 0.1,
    "taxels": [0, 3, 4, 9],
    "samples": 45,
    "lead_samples": 10,
    "period_s": 1.2,
}


@pytest.fixture
def bench(make_bench):
    with make_bench(settings=FAST) as bench:
        settings = bench.settings
        bench.settings = msgspec.structs.replace(settings, tap=msgspec.structs.replace(settings.tap, **CHANGED))
        yield bench


def test_the_record_says_what_is_done_to_readings(bench):
    assert bench.settings.preprocessing == Preprocessing(
        samples=45,
        rate_hz=50.0,
        tare="tap",
        tare_samples=10,
        highpass_hz=0.1,
        trigger="press",
        pre_samples=10,
        sensor_hz=100.0,
        taxels=(0, 3, 4, 9),
    )


def test_a_recording_gives_the_taps_that_were_made_live_at_another_rate(bench, tmp_path):
    """To the last bit, also where one was repeated, with a high-pass filter on."""
    about = msgspec.structs.replace(about_rig(bench.settings), objects=list(bench.emulation.objects))
    path = tmp_path / "taps.mcap"
    with Recorder.create(path, about) as recorder, bench.rig(journal=recorder) as rig:
        labelled, live = LabelledRig(rig), []
        labelled.what = 1
        bench.once_deep(lambda: bench.on("lost_frames", times=1))
        for delta in (0, 1, -2):
            labelled.move(delta)
            live.append(labelled.tap())
    taps = taps_from_recording(path)

    assert rig.tally.rejected == 1
    np.testing.assert_array_equal(np.array(live), taps.taps)
    positions = np.array(bench.settings.sensor.positions_mm)[[0, 3, 4, 9]]
    np.testing.assert_array_equal(taps.dataset["taxel_position"].values, positions)
    assert live[-1].shape == (45, 4)
    assert live[-1].max() > 10
    assert np.abs(live[-1][:10]).max() < 2 * bench.settings.sensor.noise_limit


def test_a_reading_that_jumps_is_seen_before_it_is_smeared(bench, monkeypatch):
    """It would be within the limit once resampled."""
    seen = []

    def looked_at(samples, lead, limit):
        seen.append((samples.shape, lead))
        return "a jump"

    monkeypatch.setattr("solidtouch.hardware.rig.rig.implausible", looked_at)
    with bench.rig() as rig, pytest.raises(SensorFault, match="a jump"):
        rig.tap()

    frames = 2 * 44 + 1 + 2 * 20
    assert seen == [((frames, 12), lead) for _, lead in seen]
    assert all(lead in (39, 40, 41) for _, lead in seen)


TEXT = """
name = "bench"
sensor = { kind = "lines", port = "/dev/finger", taxels = 3, rate_hz = 100.0 }
tap = { depth_mm = 2.5, lead_samples = 10, period_s = 1.0, %s }
[stage]
port = "/dev/stage"
x = { letter = "X", origin_mm = -60.0, low_mm = 0.0, high_mm = 17.0, speed_mm_s = 20.0 }
y = { letter = "Y", origin_mm = -40.0, low_mm = -2.0, high_mm = 3.0, speed_mm_s = 12.0 }
"""


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("samples = 40, rate_hz = 33.33", "tap: Cannot resample from 100 Hz to 33.33 Hz"),
        ("samples = 40, rate_hz = 50, taxels = []", "tap: taxels must be at least one"),
        ("samples = 40, taxels = [2, 0]", "tap: taxels must be at least one, in increasing order"),
        ("samples = 40, taxels = [0, 3]", "tap.taxels: the sensor has 3 taxels, counted from 0, got 3"),
        ("rate_hz = 50, samples = 45", r"tap.period_s: 45 samples take 1.1 s, with 0.2 s for resampling, longer"),
    ],
)
def test_rates_and_taxels_that_a_rig_cannot_have_are_refused(keys, message):
    with pytest.raises(InputError, match=message):
        parse_rig(TEXT % keys)
