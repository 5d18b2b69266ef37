"""Intervals of a sweep: data sets are the units, seeds are not."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t, ttest_1samp
from solidtouch.analysis.sweep.result import over_data
from solidtouch.models.errors import InputError


@pytest.fixture
def result(rng):
    """Five data sets that differ, three seeds that differ little, two policies."""
    of_data = rng.normal(size=(5, 1, 1))
    values = of_data + np.array([0.0, 1.0]) + 0.01 * rng.normal(size=(5, 3, 2))
    return xr.Dataset({"what_error": (("data", "seed", "policy"), values)})


def test_intervals_are_over_data_sets(result):
    """Those of Student's t of five means of seeds."""
    found = over_data(result, ["what_error"])
    means = result["what_error"].mean("seed").values
    for p in range(2):
        expected = ttest_1samp(means[:, p], 0).confidence_interval(0.95)
        np.testing.assert_allclose(found["what_error_low"][p], expected.low)
        np.testing.assert_allclose(found["what_error_high"][p], expected.high)
    assert found["units"].values.tolist() == [5, 5]


def test_differences_pair(result):
    gain = (result["what_error"].isel(policy=1) - result["what_error"].isel(policy=0)).to_dataset(name="gain")
    found = over_data(gain, ["gain"])
    assert 0.95 < found["gain_low"] < 1 < found["gain_high"] < 1.05


def test_sessions_of_one_recording_share_their_training(result):
    """So intervals over them are wider; a session each of several recordings are data sets of their own."""
    of = ["a", "a", "a", "", "b"]
    shared, apart = (result.assign_coords(recording=("data", names)) for names in (of, ["a", "b", "c", "", ""]))
    for taken, factor in (
        (shared, 1.5),
        (apart, 1.0),
        (shared.isel(data=[2, 3, 4]), 1.0),
        (shared[{"data": [0, 1]}], 3**0.5),
    ):
        plain = over_data(taken.drop_vars("recording"), ["what_error"])
        found = over_data(taken, ["what_error"])
        xr.testing.assert_allclose(found["what_error"], plain["what_error"])
        width, least = (one["what_error_high"] - one["what_error_low"] for one in (found, plain))
        np.testing.assert_allclose(width, factor * least)


def test_a_data_set_with_a_cell_to_come_is_left_out(result):
    result["what_error"][0, 1, 0] = np.nan
    found = over_data(result, ["what_error"])
    rest = over_data(result.isel(data=slice(1, None)), ["what_error"])
    assert found["units"].values.tolist() == [4, 5]
    np.testing.assert_allclose(found["what_error_low"][0], rest["what_error_low"][0])


@pytest.mark.parametrize(("sessions", "factor", "units"), [(1, 1.5, 8), (4, 3**0.5, 4)])
def test_the_units_of_one_data_set_are_its_resamples(rng, sessions, factor, units):
    """Around the value of the taps as they are; of 4 sessions that are left out in turn, twice each, by jackknife."""
    values = rng.normal(size=(1, 2, 9))
    result = xr.Dataset(
        {"taps": (("data", "seed", "resample"), values)},
        {"resample": np.arange(9), "resample_factor": factor, "resample_sessions": sessions},
    )
    found = over_data(result, ["taps"])
    first, *drawn = values.mean(axis=(0, 1))
    drawn = np.reshape(drawn, (-1, units)).mean(axis=0)
    error = factor * drawn.std(ddof=1) * (1 if sessions == 1 else 3**0.5 / 2)
    assert found["taps"] == pytest.approx(first)
    assert found["units"] == units
    half = t.ppf(0.975, units - 1) * error
    assert (found["taps_low"], found["taps_high"]) == (pytest.approx(first - half), pytest.approx(first + half))


def resampled(values, sessions=1, factor=1.5):
    result = xr.Dataset({"taps": ("resample", values)}, {"resample": np.arange(len(values))})
    return result.assign_coords(resample_factor=factor, resample_sessions=sessions)


def test_a_resample_to_come_is_left_out(rng):
    """As if there were one less; the estimate needs none."""
    values = rng.normal(size=9)
    values[4] = np.nan
    found, fewer = over_data(resampled(values), ["taps"]), over_data(resampled(np.delete(values, 4)), ["taps"])
    assert found["units"] == fewer["units"] == 7
    for name in ("taps", "taps_low", "taps_high"):
        assert found[name] == pytest.approx(float(fewer[name]))
    assert over_data(resampled([2.5, np.nan, np.nan]), ["taps"])["taps"] == 2.5
    assert np.isnan(over_data(resampled([2.5, 1.0, np.nan]), ["taps"])["taps_low"])


def test_the_taps_as_they_are_must_be_there(rng):
    with pytest.raises(InputError, match="resample 0, must be in the selection"):
        over_data(resampled(rng.normal(size=9)).isel(resample=slice(1, None)), ["taps"])


def test_one_data_set_has_no_interval(result):
    with pytest.raises(InputError, match="trials on its taps say nothing of other taps"):
        over_data(result.isel(data=[0]), ["what_error"])


def test_units_that_do_not_vary_give_no_interval(result):
    """Errors that no data set has are not known to be none."""
    found = over_data(0 * result[["what_error"]], ["what_error"])

    assert (found["what_error"] == 0).all()
    assert np.isnan(found["what_error_low"]).all()
