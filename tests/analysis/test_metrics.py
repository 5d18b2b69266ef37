"""Errors, reaction times and intervals on trials whose outcome is written down here."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm, t
from solidtouch.analysis.metrics import (
    QUANTITIES,
    at_place,
    by_place,
    confusion,
    interval_sentence,
    join,
    outcomes,
    over_places,
)
from solidtouch.inference.montecarlo import Trials
from solidtouch.inference.trial_plan import TrialPlan
from solidtouch.models.classes import ClassGrid

THETAS = (0.5, 0.9)
WHAT = np.array([0, 1, 2, 0, 1])
PLACE = np.array([0, 0, 0, 2, 2])
"""Five trials; at place 1 there is none."""


@pytest.fixture
def grid():
    """3 positions, unequally spaced, and 4 objects of known size."""
    where = np.array([0.0, 1.0, 4.0])
    return ClassGrid(where, "mm", None, tuple((f"rod {m}",) for m in range(4)), np.array([4.0, 6, 8, 12]), "mm")


@pytest.fixture
def plan():
    return TrialPlan(PLACE, WHAT, PLACE, np.arange(5))


@pytest.fixture
def trials():
    """At the second threshold all is right but the first trial's what, which was 0 and is decided as 3."""
    what = np.array([[1, 3], [1, 1], [2, 2], [2, 0], [3, 1]])
    where = np.array([[0, 0], [1, 0], [2, 2], [0, 2], [1, 1]])
    true_where = np.array([[0, 0], [0, 0], [0, 2], [2, 2], [2, 1]])
    taps = np.array([[1, 4], [2, 6], [3, 11], [4, 20], [6, 100]])
    return Trials(
        taps=taps,
        what=what,
        where=where,
        true_where=true_where,
        stopped=taps < 100,
        clamped=np.array([[0, 2], [0, 0], [0, 1], [0, 0], [0, 0]]),
        substituted=np.array([[0, 0], [1, 3], [0, 0], [0, 0], [0, 0]]),
        belief=np.ones((5, 2)),
        used_up=np.zeros((5, 2), dtype=bool),
        no_class_left=taps == 20,
    )


@pytest.fixture
def dataset(trials, plan, grid):
    return outcomes(trials, plan, PLACE, grid, THETAS)


EXPECTED = {
    "what_error": [[2 / 3, 8 / 3], [4.0 / 2 + 6.0 / 2, 0.0]],
    "where_error": [[(0 + 1 + 4) / 3, 0.0], [(4 + 3) / 2, 0.0]],
    "taps": [[2.0, 7.0], [5.0, 60.0]],
    "stopped_fraction": [[1.0, 1.0], [1.0, 0.5]],
    "clamped_fraction": [[0.0, 2 / 3], [0.0, 0.0]],
    "substituted_fraction": [[1 / 3, 1 / 3], [0.0, 0.0]],
    "what_wrong": [[1 / 3, 1 / 3], [1.0, 0.0]],
    "no_class_left_fraction": [[0.0, 0.0], [0.0, 0.5]],
}


@pytest.mark.parametrize("name", EXPECTED)
def test_outcomes_by_hand(dataset, name):
    """Means at each place and threshold, in the units of the grid; NaN where there was no trial."""
    expected = np.array([EXPECTED[name][0], [np.nan, np.nan], EXPECTED[name][1]])

    np.testing.assert_allclose(dataset[name], expected, rtol=1e-14)
    assert dataset[name].dims == ("place", "theta")


def test_outcomes_carry_labels_and_counts(dataset):
    """Places by their values, thresholds, units, and how many trials there were."""
    assert dataset["place"].values.tolist() == [0.0, 1.0, 4.0]
    assert dataset["place"].attrs == {"units": "mm"}
    assert dataset["theta"].values.tolist() == list(THETAS)
    assert dataset["trials"].values.tolist() == [3, 0, 2]
    assert (dataset.attrs["what_unit"], dataset.attrs["where_unit"]) == ("mm", "mm")


def test_variances_are_those_of_single_trials(dataset):
    """Mean squared distance from the mean of the place."""
    np.testing.assert_allclose(dataset["taps_variance"][0], [2 / 3, 26 / 3], rtol=1e-14)
    np.testing.assert_allclose(dataset["taps_variance"][2], [1.0, 1600.0], rtol=1e-14)


def test_objects_without_sizes_give_the_share_of_wrong_answers(trials, plan, grid):
    """The unit says so."""
    named = ClassGrid(grid.where_value, "mm", None, grid.what_members)
    dataset = outcomes(trials, plan, PLACE, named, THETAS)

    xr.testing.assert_equal(dataset["what_error"], dataset["what_wrong"])
    assert dataset.attrs["what_unit"] == "P(wrong)"


def test_one_data_set_has_normal_intervals_over_trials(dataset):
    """1.96 standard errors to both sides, not below zero."""
    one = join([dataset], ["only"])
    z = norm.ppf(0.975)
    half = z * np.sqrt([2 / 3 / 3, 26 / 3 / 3])
    result = at_place(one, 0)

    np.testing.assert_allclose(result["taps"], [2.0, 7.0])
    np.testing.assert_allclose(result["taps_high"], result["taps"] + half)
    np.testing.assert_allclose(result["taps_low"], result["taps"] - half)
    assert np.isnan(at_place(one, 1)["taps_high"]).all()


def test_places_count_alike(dataset):
    """The mean over places ignores how many trials each had; their sampling variances add up."""
    one = join([dataset], ["only"])
    half = norm.ppf(0.975) * np.sqrt((2 / 3 / 3 + 1.0 / 2) / 4)
    result = over_places(one)

    np.testing.assert_allclose(result["taps"], [3.5, 33.5])
    np.testing.assert_allclose(result["stopped_fraction"], [1.0, 0.75])
    assert float(result["taps_high"][0]) == pytest.approx(3.5 + half)


def scaled(dataset, factor):
    return dataset.assign({name: factor * dataset[name] for name in QUANTITIES})


def test_several_data_sets_have_t_intervals_between_them(dataset):
    """With 3 data sets, t of 2 degrees of freedom times the standard error of their mean."""
    three = join([scaled(dataset, factor) for factor in (1.0, 1.2, 1.4)], ["a", "b", "c"])
    half = t.ppf(0.975, 2) * 2.0 * np.std([1.0, 1.2, 1.4], ddof=1) / np.sqrt(3)
    result = at_place(three, 0)

    np.testing.assert_allclose(
        [result[name][0] for name in ("taps", "taps_low", "taps_high")], 2.4 + half * np.array([0, -1, 1])
    )
    assert float(over_places(three)["taps"][0]) == pytest.approx(4.2)


def test_intervals_keep_to_what_is_possible(dataset):
    """There is no trial without a tap and no negative error."""
    result = by_place(join([scaled(dataset, factor) for factor in (0.0, 0.0, 3.0)], ["a", "b", "c"]))

    assert float(result["taps_low"][0, 0]) == 1.0
    assert float(result["where_error_low"].min()) == 0.0
    assert float(result["taps_high"][0, 0]) > 4.0


def test_places_missing_in_some_data_sets_count_the_others(dataset):
    """The interval at such a place rests on the data sets that have it; on one alone there is none."""
    without = dataset.where(dataset["place"] != 4.0)
    without["trials"] = without["trials"].fillna(0.0)
    three = join([scaled(dataset, 1.0), scaled(dataset, 3.0), without], ["a", "b", "c"])
    half = t.ppf(0.975, 1) * 5.0 * np.std([1.0, 3.0], ddof=1) / np.sqrt(2)
    result = at_place(three, 2)
    alone = at_place(join([dataset, without], ["a", "b"]), 2)

    assert float(result["taps"][0]) == pytest.approx(10.0)
    assert float(result["taps_high"][0]) == pytest.approx(10.0 + half)
    assert float(alone["taps"][0]) == 5.0
    assert np.isnan(alone["taps_high"]).all()


def test_intervals_cover_the_truth_as_often_as_they_say(grid):
    """Of 400 normal samples of 5 data sets, 95 % of the intervals hold the true mean."""
    rng = np.random.default_rng(0)
    values = 50 + rng.normal(size=(5, 400))
    data_sets = xr.Dataset(
        {
            **dict.fromkeys(EXPECTED, (("data_set", "place", "theta"), values[:, :, None])),
            **{f"{name}_variance": (("data_set", "place", "theta"), 0 * values[:, :, None]) for name in QUANTITIES},
            "trials": (("data_set", "place"), np.ones((5, 400))),
        }
    )
    result = by_place(data_sets)
    covered = (result["taps_low"] < 50) & (result["taps_high"] > 50)

    assert abs(float(covered.mean()) - 0.95) < 4 * np.sqrt(0.05 * 0.95 / 400)


def test_confusion_counts_rows_by_truth(trials):
    """Each trial once, decided objects in the columns."""
    table = confusion(WHAT, trials.what[:, 0], 4)

    assert table.tolist() == [[0, 1, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 0]]


def test_sentences_say_what_the_intervals_hold():
    """Spread between data sets, or sampling of trials only."""
    assert "t-intervals of the mean over 12 simulated data sets" in interval_sentence(12, "simulated data sets")
    assert "95% normal intervals over the Monte Carlo trials of this one data set" in interval_sentence(1, "sessions")
