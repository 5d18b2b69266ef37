"""Decisions of models in the same trials, on tables whose trials can be counted or played anew."""

import numpy as np
import pytest
import xarray as xr
from even_taps import even_table
from scipy.stats import t
from solidtouch.analysis.stats.decisions import (
    ERRORS,
    MEANS,
    at_equal_taps,
    decision_curves,
    decision_interval_sentence,
    planned,
    play_models,
    spread_of,
    too_few_taps,
)
from solidtouch.inference.trials.records import ENDINGS, plan_trials
from solidtouch.inference.trials.resampling import share_beyond
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.selections import thinned_pools
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid, policies
from solidtouch.models.settings import PlaySettings

L, M, H = 4, 3, 5
THRESHOLDS = (0.9, 0.4, 0.7, 0.97, 0.999)
TRIALS, RESAMPLES, DEADLINE = 250, 60, 25


def grid_of(L, M, sized=True):
    value = 2.0 + 3 * np.arange(M) if sized else None
    names = tuple((f"rod {m}",) for m in range(M))
    return ClassGrid(1.5 * np.arange(L), "mm", None, names, value, "cm" if sized else "")


def table_of(L=L, M=M, repeats=6, **more):
    return even_table(L, M, repeats, **more)


@pytest.fixture(scope="module")
def tables():
    return {"weak": table_of(), "good": table_of(seed=1, skill=1.5)}


@pytest.fixture(scope="module")
def played(tables):
    return play_models(
        tables,
        grid_of(L, M),
        THRESHOLDS,
        TRIALS,
        7,
        play=PlaySettings(deadline=DEADLINE, fixation=2),
        resamples=RESAMPLES,
    )


def by_hand(table, theta_x, grid, thresholds=THRESHOLDS, trials=TRIALS, first_stream=0):
    """Every mean of the trials as one would play them without this module, one trial at a time."""
    thresholds, plan = np.sort(thresholds), plan_trials(table.pool, trials, 7, 2, first_stream=first_stream)
    outcome = run_trials(
        table, plan, thresholds, play=PlaySettings(theta_x=theta_x, deadline=DEADLINE), seed=7, fresh=True
    )
    rows = {name: np.zeros((trials, len(thresholds))) for name in MEANS}
    for i in range(trials):
        for h in range(len(thresholds)):
            rows["what_error"][i, h] = abs(grid.what_value[outcome.what[i, h]] - grid.what_value[plan.what[i]])
            true_where = outcome.true_where[i, h]
            rows["where_error"][i, h] = abs(grid.where_value[outcome.where[i, h]] - grid.where_value[true_where])
            rows["taps"][i, h] = outcome.taps[i, h]
            rows["stopped_fraction"][i, h] = outcome.stopped[i, h]
            rows["doubt"][i, h] = 1 - outcome.belief[i, h]
            rows["what_wrong"][i, h] = outcome.what[i, h] != plan.what[i]
            rows["used_up"][i, h] = outcome.used_up[i, h]
            rows["no_class_left"][i, h] = outcome.no_class_left[i, h]
    return rows


@pytest.mark.parametrize(("policy", "theta_x"), [("passive", 1.0), ("active", 0.0)])
def test_means_are_those_of_the_trials_played_alone(played, tables, policy, theta_x):
    """At every threshold in increasing order, whatever the order they were given in."""
    rows = by_hand(tables["good"], theta_x, grid_of(L, M))

    assert played["taps"].dims == ("model", "policy", "theta", "resample")
    assert played.theta.values.tolist() == sorted(THRESHOLDS)
    for name in MEANS:
        means = played[name].sel(model="good", policy=policy).isel(resample=0)
        np.testing.assert_allclose(means, rows[name].mean(axis=0), rtol=1e-12, err_msg=name)


def test_resamples_are_the_same_taps_and_trials_for_all_models_and_policies(tables):
    """Each as one would play it on the resampled pool.

    A model beside itself differs by nothing but what trials that were cut short might have come to.
    """
    few = 40
    played = play_models(
        {**tables, "again": tables["weak"]},
        grid_of(L, M),
        THRESHOLDS,
        few,
        7,
        play=PlaySettings(deadline=DEADLINE, fixation=2),
        resamples=3,
    )
    for number, pool in enumerate(thinned_pools(tables["weak"], 3, 7)):
        for name, table in tables.items():
            for policy, theta_x in (("passive", 1.0), ("active", 0.0)):
                streams = [few * number] if number == 0 else [few * number, few * number + few // 2]
                parts = [
                    by_hand(
                        table._replace(pool=pool), theta_x, grid_of(L, M), trials=few // len(streams), first_stream=s
                    )
                    for s in streams
                ]
                for key in MEANS:
                    resampled = played[key].sel(model=name, policy=policy).isel(resample=number)
                    expected = np.mean([rows[key].mean(axis=0) for rows in parts], axis=0)
                    np.testing.assert_allclose(resampled, expected, atol=1e-12, err_msg=key)
    curves = decision_curves(played.sel(model=["weak", "again"]))
    whole = (curves.used_up == 0).sel(model="weak")
    assert whole.any()
    again, how = curves.sel(model="again"), spread_of(played)
    for key in MEANS:
        weak, (low, most, step) = played[key].sel(model="weak").values, played.attrs[f"range_{key}"]
        seen = how.per_error(weak, low, most)
        one = np.where(seen > 0, seen, step * again.taps / played.attrs["test_taps"])
        rare = np.minimum(how.center(weak) - low, most - how.center(weak)) < 5 * seen
        few = ((seen == 0) | rare) & (key != "doubt")
        least = np.where(few, t.ppf(0.975, 2) * np.sqrt(2) * one, 0.0)
        for sign, end in ((-1, "low"), (1, "high")):
            found = sign * again[f"{key}_difference_{end}"].values
            np.testing.assert_allclose(np.where(whole, found, least), least, atol=1e-12)
            assert (curves[f"{key}_difference_{end}"].sel(model="weak") == 0).all()
    assert (again.what_wrong_difference_high >= again.used_up - 1e-12).all()
    assert (again.what_wrong_difference_low <= -again.used_up + 1e-12).all()


def test_intervals_are_as_wide_as_the_taps_leave_a_mean():
    """At one place with one tap per decision: the error is a mean over taps, 1.96 standard errors on each side.

    The trials of the estimate add what they scatter by themselves.
    """
    repeats = 40
    table = table_of(1, 2, skill=0.5, repeats=repeats)
    played = play_models({"one": table}, grid_of(1, 2), (0.5,), 4000, 0, play=PlaySettings(deadline=1), resamples=1000)
    curves = decision_curves(played).isel(model=0, policy=0, theta=0)
    right = table.log_likelihood[:, 0].argmax(axis=1) == np.repeat([0, 1], repeats)
    variance = np.mean([own.var(ddof=1) for own in np.split(right.astype(float), 2)]) / (2 * repeats)
    half = 1.96 * np.sqrt(variance + right.mean() * (1 - right.mean()) / 4000)

    assert curves.what_wrong.item() == pytest.approx(1 - right.mean(), abs=0.03)
    assert (curves.what_wrong_high - curves.what_wrong_low).item() == pytest.approx(2 * half, rel=0.1)


def test_too_few_taps_are_named(played):
    """In one sentence, by the trials that use them up at the threshold shown or by their number alone; else none."""
    curves = decision_curves(played)
    shares = curves.used_up.sel(theta=0.999).max("model").to_series()
    first, second = shares.sort_values(ascending=False).index

    assert shares[second] > 0.05
    (said,) = too_few_taps(curves, 0.999)
    assert said.startswith(f"At threshold 0.999: Too few test taps: {shares[first]:.0%} of the {first} decisions of ")
    assert f" and {shares[second]:.0%} of the {second} decisions of " in said
    assert "the most of all models, were forced because the taps of a class, about 6, were used up" in said
    (rough,) = too_few_taps(curves, 0.4)
    assert "about 6 per class: intervals are rough" in rough
    more = curves.assign_attrs(taps_per_class=30)
    assert too_few_taps(more, 0.4) == []
    more["used_up_selected"].loc[{"policy": "active", "theta": 0.4, "model": more.model[-1]}] = 0.02
    (said,) = too_few_taps(more, 0.4)
    assert said.startswith("At threshold 0.4: Too few test taps for these intervals: ")
    assert f"2.0% of the active decisions of {more.model[-1].item()}, the most of all models," in said


def test_selections_use_up_more_taps_than_there_are_in_all(played):
    curves = decision_curves(played)

    assert np.all(curves.used_up_selected >= curves.used_up - 0.02)
    assert curves.used_up_selected.sel(theta=0.97).max() > curves.used_up.sel(theta=0.97).max()


def test_the_miscalibration_is_the_wrong_fraction_over_the_doubt(played):
    """In the estimate and in each resample, over all decided trials."""
    curves = decision_curves(played, reference="good")
    cell = {"model": "weak", "policy": "active", "theta": 0.7}
    ratio = (played.what_wrong / played.doubt).sel(cell).values

    assert curves.miscalibration.sel(cell).item() == ratio[0]
    ends = [(played[f"what_wrong{e}"] / played[f"doubt{e}"]).sel(cell).item() for e in ENDINGS]
    assert ends[0] < ratio[0] < ends[1]
    held = spread_of(played).interval(ratio, 0.0, endings=np.array(ends))
    for end, expected in zip(("low", "high"), held, strict=True):
        assert curves[f"miscalibration_{end}"].sel(cell).item() == expected
    assert curves.attrs["reference"] == "good"
    own = curves.miscalibration_difference.sel(model="good")
    assert (own.where(np.isfinite(curves.miscalibration.sel(model="good")), 0) == 0).all()
    assert np.isfinite(own).any()


def test_errors_that_never_occurred_are_not_excluded():
    """The interval of a model that is never wrong reaches up, by as many decisions as its taps make."""
    curves = decision_curves(play_models({"sure": table_of(skill=12.0)}, grid_of(L, M), (0.9,), 200, 0, resamples=20))
    at = curves.isel(model=0, theta=0).sel(policy="passive")
    beyond = share_beyond(curves.attrs["test_taps"] / float(at.taps))

    assert at.what_wrong.item() == at.what_wrong_low.item() == 0
    assert at.what_wrong_high.item() == pytest.approx(beyond)
    assert at.what_error_high.item() == pytest.approx(beyond * 3.0)  # the objects are 3 mm apart
    assert at.stopped_fraction_low.item() == pytest.approx(1 - beyond)
    assert at.no_class_left_high.item() == pytest.approx(beyond)


def test_a_miscalibration_without_wrong_decisions_is_undefined():
    """And with wrong ones of belief 1 infinite, without a warning."""
    sure = table_of(skill=12.0)
    misled = sure._replace(log_likelihood=np.roll(sure.log_likelihood, 1, axis=2) * 50)
    played = play_models({"sure": sure, "misled": misled}, grid_of(L, M), (0.5, 0.9), 40, 0, resamples=10)
    curves = decision_curves(played)

    assert (curves.what_wrong.sel(model="sure") == 0).all()
    assert (curves.doubt.sel(model="sure") > 0).all()
    for suffix in ("", "_low", "_high", "_difference"):
        assert np.isnan(curves[f"miscalibration{suffix}"].sel(model="sure")).all()
    assert (curves.what_wrong.sel(model="misled") == 1).all()
    assert (curves.miscalibration.sel(model="misled") == np.inf).all()


def test_states_are_summed_out_of_decisions(tables):
    """A model whose states are all alike decides as the model without."""
    table = tables["good"]
    stateful = table._replace(
        log_likelihood=np.tile(table.log_likelihood, (1, 1, 2)),
        log_prior=np.concatenate([table.log_prior + np.log(0.3), table.log_prior + np.log(0.7)], axis=1),
    )
    played = play_models({"plain": table, "states": stateful}, grid_of(L, M), THRESHOLDS, 60, 3, resamples=5)

    for name in MEANS:
        np.testing.assert_allclose(*played[name].values, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("shape", "expected"), [((1, 3), ("passive",)), ((4, 1), ("passive",)), ((2, 2), ("passive", "active"))]
)
def test_active_perception_needs_somewhere_to_move_and_something_to_tell(shape, expected):
    """Without, there are passive trials only, with means and intervals."""
    grid = grid_of(*shape)
    played = play_models({"one": table_of(*shape)}, grid, (0.5, 0.99), 30, 0, resamples=8)
    curves = decision_curves(played)

    assert policies(grid) == expected == tuple(curves.policy.values)
    assert np.isfinite(curves.what_error_high).all()
    if shape[1] == 1:
        assert (curves.what_error == 0).all()
        assert np.isnan(curves.miscalibration).all()
    assert at_equal_taps(played).what_error.dims == ("model", "policy", "taps")


def test_a_single_threshold_has_curves_but_no_equal_times(tables):
    """Two points at different times have none in common, unless it is asked for, and then the answer is NaN."""
    played = play_models(tables, grid_of(L, M), 0.9, 50, 0, resamples=10)

    assert decision_curves(played).taps.shape == (2, 2, 1)
    assert at_equal_taps(played).sizes["taps"] == 0
    assert np.isnan(at_equal_taps(played, taps=[2.5]).what_error).all()


def fake(taps, error):
    """Means without spread over resamples: times (model, theta) and what errors likewise, one policy."""
    taps, error = np.asarray(taps, dtype=float), np.asarray(error, dtype=float)
    dims = ("model", "policy", "theta", "resample")

    def spread(values):
        return np.repeat(values[:, np.newaxis, :, np.newaxis], 13, axis=-1)

    data = {name: (dims, spread(error), {"units": "mm"}) for name in MEANS} | {"taps": (dims, spread(taps))}
    data |= {name + end: (dims[:-1], data[name][1][..., 0]) for name in MEANS for end in ENDINGS}
    names = np.array([f"model {i}" for i in range(len(taps))])
    coords = {"model": names, "policy": ["passive"], "theta": np.linspace(0.1, 0.9, taps.shape[1])}
    attributes = {"factor": 1.0, "freedom": np.inf, "sessions": 1, "test_taps": 1e9}
    return xr.Dataset(data, coords, attributes | {"trials": 1000, "resample_trials": 1000})


def test_errors_at_equal_times_lie_on_the_line_between_thresholds():
    """A third of the way in time is a third of the way in error, and the difference follows."""
    equal = at_equal_taps(fake([[1, 4, 8], [2, 5, 6]], [[9, 3, 1], [8, 5, 5]]), taps=[2, 3, 6, 5])

    assert equal.taps.values.tolist() == [2, 3, 5, 6]
    np.testing.assert_allclose(equal.what_error[:, 0], [[7, 5, 2.5, 2], [8, 7, 5, 5]])
    np.testing.assert_allclose(equal.what_error_difference[1, 0], [1, 2, 2.5, 3])
    np.testing.assert_allclose(equal.what_error_difference_high[1, 0], [1, 2, 2.5, 3])


def test_nothing_is_extrapolated():
    """Beyond its fastest and slowest threshold a model has no error, and no difference to it exists."""
    equal = at_equal_taps(fake([[2, 4], [3, 9]], [[1, 0], [1, 0]]), taps=[1.9, 2, 3, 4.1, 9])

    assert np.isnan(equal.what_error.values[:, 0]).tolist() == [
        [True, False, False, True, True],
        [True, True, False, False, False],
    ]
    assert np.isnan(equal.what_error_difference.values[1, 0]).tolist() == [True, True, False, True, True]
    assert equal.common.values.tolist() == [[False, False, True, False, False]]


def test_default_times_are_round_and_shared_with_the_reference():
    """The second model ends at 8 taps, the third is apart from both; a time is common where all three are."""
    played = fake([[1, 30], [2.5, 8], [11, 12]], [[1, 0]] * 3)

    assert at_equal_taps(played).taps.values.tolist() == [3, 5, 7]
    assert at_equal_taps(played, reference="model 1").taps.values.tolist() == [3, 5, 7]
    assert not at_equal_taps(played).common.any()
    assert at_equal_taps(played.isel(model=[0, 1])).common.all()
    assert at_equal_taps(played.isel(model=[0])).taps.values.tolist() == [1, 1.5, 2, 3, 5, 7, 10, 15, 20, 30]
    assert at_equal_taps(played.isel(model=[1, 2])).sizes["taps"] == 0
    assert at_equal_taps(fake([[3.2, 4.8], [3.6, 9]], [[1, 0]] * 2)).taps.values.tolist() == [4.2]


def test_times_that_resamples_often_leave_have_no_interval(played):
    """At a model's slowest mean time half of the resamples are faster; well within its range all reach."""
    slowest = played.taps.sel(model="weak", policy="passive").isel(resample=0).max().item()
    equal = at_equal_taps(played, taps=[3.0, slowest]).sel(model="weak", policy="passive")

    for name in ERRORS:
        assert np.isfinite(equal[name]).all()
        assert np.isnan(equal[f"{name}_low"]).values.tolist() == [False, True]


def test_default_times_have_intervals_where_they_are_common(played):
    """So nothing common is shown without its uncertainty."""
    equal = at_equal_taps(played)
    shown = equal.where(equal.common, drop=True)

    assert shown.sizes["taps"] > 2
    assert np.isfinite(shown.what_error_difference_low.where(equal.common, 0.0)).all()
    assert (shown.what_error_low <= shown.what_error).where(equal.common, True).all()


def test_progress_counts_every_trial(tables):
    """Of each model and policy."""
    seen = []
    play_models(tables, grid_of(L, M), (0.5,), 33, 0, resamples=3, progress=seen.append)

    assert sum(seen) == (33 + 3 * 32) * len(tables) * len(policies(grid_of(L, M)))
    assert sum(seen) == planned(len(tables), grid_of(L, M), 33, 3)


def test_units_and_settings_are_with_the_numbers(played):
    """For axes and tables."""
    curves = decision_curves(played)

    assert (curves.what_error.attrs["units"], curves.where_error.attrs["units"]) == ("cm", "mm")
    assert (curves.attrs["trials"], curves.attrs["seed"], curves.attrs["resamples"]) == (TRIALS, 7, RESAMPLES)
    assert curves.attrs["taps_per_class"] == 6
    assert "a quarter of the test taps of each class, or one test session at a time" in decision_interval_sentence(
        curves
    )
    assert "do not cover variation between training sets" in decision_interval_sentence(curves)


def test_bad_arguments_are_refused(tables, played):
    """Each in a sentence."""
    with pytest.raises(InputError, match="classes of the tables do not match the grid of 4 x 2"):
        play_models(tables, grid_of(L, 2), (0.5,), 10, 0)
    with pytest.raises(InputError, match="at least one resample, got 0"):
        play_models(tables, grid_of(L, M), (0.5,), 10, 0, resamples=0)
    with pytest.raises(InputError, match="'best' is not one of the models weak, good"):
        decision_curves(played, reference="best")
    with pytest.raises(InputError, match="'best' is not one of the models weak, good"):
        at_equal_taps(played, reference="best")


def test_a_model_under_which_taps_are_impossible_is_played_too(tables):
    """Its trials end undecided with their first tap."""
    nothing = tables["good"]._replace(log_likelihood=np.full_like(tables["good"].log_likelihood, -np.inf))

    played = play_models({"weak": tables["weak"], "nothing": nothing}, grid_of(L, M), (0.5,), 10, 0)

    assert (played["taps"].sel(model="nothing") == 1).all()
    assert (played["stopped_fraction"].sel(model="nothing") == 0).all()
