"""Tap sets without dead and saturated taxels."""

import numpy as np
import pytest
from solidtouch.models import storage
from solidtouch.models.cutting.tap_cutter import TapCutter
from solidtouch.models.cutting.taxels import usable_taxels, with_taxels
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet


def tap_set(samples, **record):
    n, J, K = samples.shape
    return TapSet.from_arrays(
        samples,
        np.arange(n) % 2,
        ["ball", "rod"],
        preprocessing=Preprocessing(samples=J, **record),
        taxel_position=np.arange(2.0 * K).reshape(K, 2),
        extra={"gain": np.arange(float(n * K)).reshape(n, K), "depth": np.arange(float(n))},
        missing="drop",
    )


@pytest.fixture
def samples(rng):
    """Taps of 5 taxels: the second is dead, the fourth is cut off at 8, the last has no values."""
    samples = rng.normal(size=(6, 40, 5)).cumsum(axis=1)
    samples[:, :, 1] = 3.0
    samples[:, :, 3] = np.minimum(np.linspace(0, 30, 40) + samples[:, :, 3] / 10, 8.0)
    samples[:, :, 4] = np.nan
    return samples


def test_dead_and_saturated_taxels_are_found_and_named(samples):
    found = usable_taxels(tap_set(samples))

    assert found == ((0, 2), (1, 4), (3,))
    assert found.sentence() == "3 of 5 taxels left out: 1, 4 (dead: one value throughout); 3 (saturated)."
    assert found.sentence(list("abcde")) == "3 of 5 taxels left out: b, e (dead: one value throughout); d (saturated)."


def test_only_what_is_asked_for_is_left_out(samples):
    taps = tap_set(samples)

    assert usable_taxels(taps, saturated=False) == ((0, 2, 3), (1, 4), ())
    assert usable_taxels(taps, dead=False) == ((0, 1, 2, 4), (), (3,))
    assert usable_taxels(taps, dead=False, saturated=False).sentence() == ""


def test_none_left_is_refused(samples):
    with pytest.raises(InputError, match="no taxel would be left: of 3, 2 are dead and 1 saturated"):
        usable_taxels(tap_set(samples[:, :, [1, 3, 4]]))


def test_left_out_taxels_are_gone_from_all_arrays_and_in_the_record(samples):
    taps = with_taxels(tap_set(samples, trigger="clock"), (2, 0))

    np.testing.assert_array_equal(taps.taps, samples[:, :, [0, 2]])
    assert taps.dataset["taxel_position"].values.tolist() == [[0, 1], [4, 5]]
    assert taps.dataset["gain"].values[1].tolist() == [5, 7]
    assert taps.dataset["depth"].values.tolist() == list(range(6))
    assert taps.preprocessing == Preprocessing(samples=40, trigger="clock", taxels=(0, 2))
    again = with_taxels(taps, [1])
    assert again.preprocessing.taxels == (2,)
    np.testing.assert_array_equal(again.taps, samples[:, :, [2]])


def test_all_taxels_leave_the_taps_as_they_are(samples):
    taps = tap_set(samples)

    assert with_taxels(taps, range(5)) is taps


def test_large_recordings_stay_on_disk(samples, tmp_path, monkeypatch):
    tap_set(samples).save(tmp_path / "a.nc")
    monkeypatch.setattr(storage, "ON_DISK", 100)
    large = TapSet.load(tmp_path / "a.nc", "drop")
    chosen = with_taxels(large, usable_taxels(large).used)

    assert chosen.scanned is not None
    np.testing.assert_array_equal(chosen.scanned, large.scanned[:, :, [0, 2]])
    np.testing.assert_array_equal(chosen.taps, samples[:, :, [0, 2]])


@pytest.mark.parametrize("used", [(), (5,), (-1,)])
def test_taxels_that_are_not_there_are_refused(samples, used):
    with pytest.raises(InputError, match="taxels must be at least one of 0 to 4"):
        with_taxels(tap_set(samples), used)


def test_taps_that_any_taxel_may_have_started_are_refused(samples):
    with pytest.raises(InputError, match="cut at contact cannot be left out; cut the streams without them"):
        with_taxels(tap_set(samples, trigger="contact", trigger_level=1.0), (0,))


def test_a_rig_that_looks_at_these_taxels_alone_cuts_the_same_taps(samples):
    """Whatever was done to the frames, other than waiting for contact."""
    record = Preprocessing(
        samples=8, rate_hz=20.0, sensor_hz=40.0, highpass_hz=0.5, tare="tap", tare_samples=2, trigger="clock"
    )
    stream = np.nan_to_num(samples).reshape(-1, 5)
    cut = np.stack([tap.samples for tap in TapCutter(record).push(stream)])
    taps = TapSet.from_arrays(cut, np.zeros(len(cut), int), ["ball"], preprocessing=record)
    found = usable_taxels(taps)
    chosen = with_taxels(taps, found.used)

    assert found.dead == (1, 4)
    at_rig = [tap.samples for tap in TapCutter(chosen.preprocessing).push(stream)]
    np.testing.assert_array_equal(chosen.taps, np.stack(at_rig))
