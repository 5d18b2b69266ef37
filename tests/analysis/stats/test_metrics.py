"""Errors, reaction times and intervals on trials whose outcome is written down here."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t
from solidtouch.analysis.stats.metrics import (
    QUANTITIES,
    Range,
    by_place,
    confusion,
    interval_sentence,
    join,
    outcomes_dataset,
    over_places,
    ranges,
    sum_outcomes,
    with_noise,
)
from solidtouch.inference.trials.records import ENDINGS, TrialPlan, Trials
from solidtouch.inference.trials.resampling import Spread, share_beyond
from solidtouch.models.grid import ClassGrid

THETAS = (0.5, 0.9)
WHAT = np.array([0, 1, 2, 0, 1])
PLACE = np.array([0, 0, 0, 2, 2])
"""Five trials; at place 1 there is none."""
DEADLINE = 200


@pytest.fixture
def grid():
    """3 positions, unequally spaced, and 4 objects of known size."""
    where = np.array([0.0, 1.0, 4.0])
    return ClassGrid(where, "mm", None, tuple((f"rod {m}",) for m in range(4)), np.array([4.0, 6, 8, 12]), "mm")


@pytest.fixture
def plan():
    return TrialPlan(PLACE, WHAT, PLACE, np.arange(5), np.zeros(5, int))


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


def dataset_of(trials, plan, grid):
    return outcomes_dataset(sum_outcomes(trials, plan, PLACE, grid).means(grid.L), (), grid, THETAS, DEADLINE)


@pytest.fixture
def dataset(trials, plan, grid):
    return dataset_of(trials, plan, grid)


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


def test_noise_is_the_variance_of_a_mean_over_trials(dataset):
    """Variance of single trials over their number; none where there is no trial."""
    np.testing.assert_allclose(dataset["taps_noise"], [[1 / 3, 13 / 3], [0, 0], [1.0, 1600.0]], rtol=1e-14)


def test_starts_in_equal_numbers_are_no_noise(trials, grid):
    """At one fixation point only what varies between trials of one start counts."""
    plan = TrialPlan(np.array([0, 0, 1, 1, 2]), WHAT, np.zeros(5, int), np.arange(5), np.zeros(5, int))
    noise = sum_outcomes(trials, plan, plan.fixation, grid).means(grid.L).noise["taps"]

    np.testing.assert_allclose(noise[0], [(2 * 0.5 + 2 * 0.5) / 25, (2 * 2.0 + 2 * 40.5) / 25], rtol=1e-14)


def test_differences_pair_trial_by_trial(trials, plan, grid):
    """Trials that all take two taps more differ by 2 without noise, the same trials by nothing at all."""
    more = sum_outcomes(trials._replace(taps=trials.taps + 2), plan, PLACE, grid, minus=trials).means(grid.L)
    same = sum_outcomes(trials, plan, PLACE, grid, minus=trials).means(grid.L)

    np.testing.assert_array_equal(more.mean["taps"][[0, 2]], 2.0)
    np.testing.assert_array_equal(more.noise["taps"], 0.0)
    assert all((mean[[0, 2]] == 0).all() for mean in same.mean.values())


def test_objects_without_sizes_give_the_share_of_wrong_answers(trials, plan, grid):
    """The unit says so."""
    named = ClassGrid(grid.where_value, "mm", None, grid.what_members)
    dataset = dataset_of(trials, plan, named)

    xr.testing.assert_equal(dataset["what_error"], dataset["what_wrong"])
    assert dataset.attrs["what_unit"] == "P(wrong)"


@pytest.fixture
def resampled(trials, plan, grid):
    """A data set whose 5 resamples take -2, -1, 0, 1 and 2 taps more at place 0, without noise."""
    means = sum_outcomes(trials, plan, PLACE, grid).means(grid.L)
    quiet = means._replace(noise={name: 0 * noise for name, noise in means.noise.items()})
    steps = [np.array([[step], [np.nan], [0.0]]) for step in (-2, -1, 0, 1, 2)]
    drawn = [quiet._replace(mean=quiet.mean | {"taps": quiet.mean["taps"] + step}) for step in steps]
    return join([outcomes_dataset(quiet, drawn, grid, THETAS, DEADLINE)], ["only"])


def test_one_data_set_has_intervals_of_resamples(resampled):
    """Those of the resamples, enlarged, from one tap on; no interval where resamples lack trials."""
    result = by_place(resampled, Spread(1.5)).isel(place=0)
    samples = np.add.outer([2.0, 7.0], [0, -2, -1, 0, 1, 2])
    low, high = Spread(1.5).interval(samples, 1.0, DEADLINE)

    np.testing.assert_allclose(result["taps"], [2.0, 7.0])
    np.testing.assert_allclose(result["taps_high"], high)
    np.testing.assert_allclose(result["taps_low"], low)
    assert (low >= 1).all()
    assert np.isnan(by_place(resampled).isel(place=1)["taps_high"]).all()


def test_places_count_alike(resampled):
    """The mean over places ignores how many trials each had, in every resample too."""
    half = np.std([-1, -0.5, 0, 0.5, 1], ddof=1) * t.isf(0.025, 4)
    result = over_places(resampled, difference=True)

    np.testing.assert_allclose(result["taps"], [3.5, 33.5])
    np.testing.assert_allclose(result["stopped_fraction"], [1.0, 0.75])
    np.testing.assert_allclose(result["taps_high"], result["taps"] + half)


def test_differences_can_be_negative(resampled):
    """An outcome cannot be below its least, a difference can."""
    low = [by_place(resampled).isel(place=0)["taps_low"], by_place(resampled, difference=True)["taps_low"][0]]

    assert 1.0 < float(low[0][0]) < 2.0
    assert float(low[1][0]) == pytest.approx(2.0 - np.std([-2, -1, 0, 1, 2], ddof=1) * t.isf(0.025, 4))


def test_one_data_set_without_resamples_has_no_interval(dataset):
    result = by_place(join([dataset], ["only"]))

    assert np.isnan(result["taps_low"]).all()
    np.testing.assert_allclose(result["taps"][0], [2.0, 7.0])


def test_resamples_of_few_trials_get_the_noise_of_many():
    """A variance of 4 of which 3 is noise becomes 1 and the noise that is wanted; the mean stays."""
    drawn = 5 + 2 * np.random.default_rng(0).standard_normal((3, 100_000))
    own, present = np.array([0.25, 1e-9, 8.0]), np.array([3.0, 9.0, 3.0])
    changed, enlarged = (with_noise(drawn, own, present, 0.5, factor) for factor in (1.0, 2.0))

    np.testing.assert_allclose(changed.var(axis=1), [1.25, 0.0, 9.0], atol=0.1)
    np.testing.assert_allclose(enlarged.var(axis=1), [1.0625, 0.0, 3.0], atol=0.1)
    np.testing.assert_allclose(changed.mean(axis=1), drawn.mean(axis=1))
    assert (with_noise(np.ones((1, 4)), np.ones(1), np.ones(1), 0.5, 1.0) == 1).all()


def test_trials_with_one_outcome_have_the_noise_that_resamples_show():
    """Of as many trials: a tenth of it with ten times the trials; no estimate is certain by luck."""
    drawn = np.random.default_rng(0).standard_normal((1, 100_000))

    assert with_noise(drawn, np.zeros(1), np.ones(1), 0.1, 1.0).var() == pytest.approx(0.1, rel=0.05)


def scaled(dataset, factor):
    return dataset.assign({name: factor * dataset[name] for name in QUANTITIES})


def test_several_data_sets_have_t_intervals_between_them(dataset):
    """With 3 data sets, t of 2 degrees of freedom times the standard error of their mean."""
    three = join([scaled(dataset, factor) for factor in (1.0, 1.2, 1.4)], ["a", "b", "c"])
    half = t.ppf(0.975, 2) * 2.0 * np.std([1.0, 1.2, 1.4], ddof=1) / np.sqrt(3)
    result = by_place(three).isel(place=0)

    np.testing.assert_allclose(
        [result[name][0] for name in ("taps", "taps_low", "taps_high")], 2.4 + half * np.array([0, -1, 1])
    )
    assert float(over_places(three)["taps"][0]) == pytest.approx(4.2)
    wider = by_place(three, Spread(1.5)).isel(place=0)
    np.testing.assert_allclose(wider["taps_high"][0] - wider["taps"][0], 1.5 * half)


def with_endings(data, best, worst):
    """The same data, whose reaction times might have been shorter or longer by so much."""
    return data.assign({f"taps{end}": data["taps"] + by for end, by in zip(ENDINGS, (best, worst), strict=True)})


def test_intervals_hold_what_trials_cut_short_might_have_come_to(dataset, resampled):
    """Of one data set by its resamples, of several between them; each end about the ending on its side."""
    several = xr.concat([scaled(dataset, factor) for factor in (4, 5, 6)], "data_set")
    for data, spread in ((resampled, Spread(1.0)), (several, Spread(1.0))):
        plain, wide = (by_place(one, spread, difference=True) for one in (data, with_endings(data, 0.0, 7.0)))
        xr.testing.assert_allclose(wide.taps_low, plain.taps_low)
        xr.testing.assert_allclose(wide.taps_high, plain.taps_high + 7)
        early = by_place(with_endings(data, -0.5, 0.0), spread, difference=True)
        xr.testing.assert_allclose(early.taps_high, plain.taps_high)
        xr.testing.assert_equal(wide.what_error_low, plain.what_error_low)


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
    result = by_place(three).isel(place=2)
    alone = by_place(join([dataset, without], ["a", "b"])).isel(place=2)

    assert float(result["taps"][0]) == pytest.approx(10.0)
    assert float(result["taps_high"][0]) == pytest.approx(10.0 + half)
    assert float(alone["taps"][0]) == 5.0
    assert np.isnan(alone["taps_high"]).all()


def test_intervals_cover_the_truth_as_often_as_they_say(grid):
    """Of 400 normal samples of 5 data sets, 95% of the intervals hold the true mean."""
    rng = np.random.default_rng(0)
    values = 50 + rng.normal(size=(5, 400))
    data_sets = xr.Dataset(
        {
            **dict.fromkeys(EXPECTED, (("data_set", "place", "theta"), values[:, :, None])),
            "trials": (("data_set", "place"), np.ones((5, 400))),
        },
        attrs={f"range_{name}": one for name, one in ranges(grid, DEADLINE).items()},
    )
    data_sets.attrs |= dict.fromkeys(("range_what_error", "range_where_error"), Range())
    result = by_place(data_sets)
    covered = (result["taps_low"] < 50) & (result["taps_high"] > 50)

    assert abs(float(covered.mean()) - 0.95) < 4 * np.sqrt(0.05 * 0.95 / 400)


def test_confusion_counts_rows_by_truth(trials):
    """Each trial once, decided objects in the columns."""
    table = confusion(WHAT, trials.what[:, 0], 4)

    assert table.tolist() == [[0, 1, 1, 0], [0, 1, 0, 1], [0, 0, 1, 0], [0, 0, 0, 0]]


def test_sentences_say_what_the_intervals_hold():
    """Spread between data sets, or resampled taps, with sessions where several test."""
    assert "t-intervals of the mean over 12 simulated data sets" in interval_sentence(12, "simulated data sets")
    assert "share training sessions" in interval_sentence(3, "folds")
    assert "on test taps of each class, drawn with replacement" in interval_sentence(1, "folds")
    assert "without each of the 2 test sessions in turn" in interval_sentence(
        1, "folds", Spread(1.0, freedom=1.0, sessions=2)
    )
    assert interval_sentence(1, "folds", Spread(np.nan, "One tap.")) == "One tap."


OBJECTS = (("a",), ("b",), ("c",))


@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        (np.array([4.0, 9.0, 6.0]), Range(0.0, 5.0, 2.0)),
        (np.array([4.0, 4.0, 6.0]), Range(0.0, 2.0, 2.0)),
        (np.array([4.0, 4.0, 4.0]), Range(0.0, np.inf, 0.0)),
        (None, Range(0.0, 1.0, 1.0)),
    ],
)
def test_errors_lie_between_none_and_the_farthest_classes(sizes, expected):
    """The step is the smallest error; where all objects are alike there is none, and no greatest."""
    found = ranges(ClassGrid(np.array([0.0, 1.0, 4.0]), "mm", None, OBJECTS, sizes, "" if sizes is None else "mm"), 50)
    assert found["what_error"] == expected
    assert found["where_error"] == Range(0.0, 4.0, 1.0)


def test_reaction_times_lie_between_a_tap_and_the_deadline():
    one_place = ClassGrid(np.zeros(1), "mm", None, OBJECTS)
    assert ranges(one_place, 50) == {"taps": Range(1, 50), "where_error": Range(step=0), "what_error": Range(0, 1)}
    assert ranges(one_place, 1)["taps"] == Range(1, np.inf)


def never_wrong(grid, dataset, sets=1):
    """Data sets in which no decision errs; resamples of the only one err a little, less than their noise."""
    quiet = dataset.assign({name: 0 * dataset[name] for name in ("what_error", "where_error")})
    if sets > 1:
        return join([quiet] * sets, [str(i) for i in range(sets)])
    few = np.linspace(0, 0.01, 20)[:, np.newaxis, np.newaxis] + np.zeros((20, *dataset["taps"].shape))
    added = {f"{name}_resampled": (("resample", "place", "theta"), few) for name in ("what_error", "where_error")}
    noise = {f"{name}_resampled_noise": dataset["taps_noise"] * 0 + 1.0 for name in ("what_error", "where_error")}
    still = {"taps_resampled": dataset["taps"].expand_dims(resample=20), "taps_resampled_noise": dataset["taps_noise"]}
    quiet = quiet.assign(added | noise | still)
    quiet = quiet.assign({f"{name}_noise": 0 * quiet["taps_noise"] for name in QUANTITIES})
    return join([quiet.assign(resampled_trials=0.5 * quiet["trials"])], ["only"])


@pytest.mark.parametrize("sets", [1, 4])
def test_no_interval_of_errors_that_were_not_seen_has_no_width(grid, dataset, sets):
    """It reaches as far as the fewer of test taps and trials allow, and less far with more data sets."""
    spread = Spread(1.0, taps=600)
    result, pooled = (of(never_wrong(grid, dataset, sets), spread) for of in (by_place, over_places))
    own = np.minimum(600 / 3 / result["taps"], dataset["trials"])
    step = ranges(grid, DEADLINE)["where_error"].step

    for one, independent in ((result, own), (pooled, np.minimum(600 / pooled["taps"], dataset["trials"].sum()))):
        least = step * share_beyond(sets * independent.transpose(*one["where_error"].dims))
        seen = one["where_error"].notnull().values
        assert (one["where_error_low"].values[seen] == 0).all()
        assert (one["where_error_high"].values[seen] >= least[seen] - 1e-12).all()


def test_a_difference_of_errors_that_were_not_seen_is_not_known_exactly(grid, dataset):
    spread = Spread(1.0, taps=600)
    slow = over_places(never_wrong(grid, dataset, 4), spread)["taps"] + 1
    result = over_places(never_wrong(grid, dataset, 4), spread, difference=True, slowest=slow)
    beyond = ranges(grid, DEADLINE)["what_error"].step * share_beyond(4 * np.minimum(600 / slow, dataset.trials.sum()))

    np.testing.assert_allclose(result["what_error_high"], beyond)
    np.testing.assert_allclose(result["what_error_low"], -beyond)


def test_the_mean_over_places_has_as_many_trials_as_all_of_them(grid, dataset):
    """Resamples with half the trials, and trials of one outcome: half the noise of resamples stays in the variance."""
    data = never_wrong(grid, dataset)
    steps = np.linspace(-1, 1, 20)
    values = np.broadcast_to(steps[:, np.newaxis, np.newaxis], (20, 3, 2))
    drawn = data["what_error_resampled"].copy(data=values[np.newaxis])
    noise = data["what_error_resampled_noise"].copy(data=np.full((1, 3, 2), 0.1))
    data = data.assign(what_error_resampled=drawn, what_error_resampled_noise=noise)
    result = over_places(data, Spread(1.0), difference=True)
    seen = int((dataset["trials"] > 0).sum())
    present = 0.1 * 3 / seen**2
    variance = steps.var(ddof=1) - present + 0.5 * present

    np.testing.assert_allclose(result["what_error_high"], np.sqrt(variance) * t.isf(0.025, 19))
