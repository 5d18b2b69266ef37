"""The reference of verdicts on beliefs: simulated data of the same design, and a test whose level is that it says."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom
from solidtouch.analysis.audit.remedy_scores import decisions, judge
from solidtouch.analysis.stats.reliability import EVERYTHING, at_stopping, headline, reliability
from solidtouch.analysis.stats.right_model import (
    SIMULATIONS,
    compare,
    described,
    equivalent,
    exact,
    reference_factors,
    simulate,
)
from solidtouch.inference.trials.records import TapTable, plan_trials
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.grid import ClassGrid, tap_pool
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import FitSettings, PlaySettings

OPTIONS = {"play": PlaySettings(theta_x=1.0, fixation=0, border="clamp", deadline=40), "trials": 120, "seed": 0}


def model_of(L=3, M=2, K=1, J=1, B=5, power="none", seed=0, saturation=np.inf):
    rng = np.random.default_rng(seed)
    counts = np.round(1e6 * rng.dirichlet(np.ones(B), size=(L, M, K))).astype(np.int64) + 1
    grid = ClassGrid(np.arange(L) + 0.0, "mm", None, tuple((f"object {m}",) for m in range(M)))
    return HistogramModel(grid, np.arange(B + 1.0), power, Preprocessing(J), counts, 0.0, saturation=saturation)


def data_of(model, n, seed, repeat=1):
    """Taps of every class drawn from a model, each sample so many times; and their table."""
    L, M = model.grid.shape
    where, what, _ = (index.ravel() for index in np.indices((L, M, n)))
    J = model.preprocessing.samples // repeat
    taps = np.repeat(model.form.sample(where, what, model.edges, J, np.random.default_rng(seed)), repeat, axis=1)
    return TapTable(model.log_likelihood(taps), tap_pool(where, what, (L, M)), model.log_prior)


@pytest.mark.parametrize(
    ("power", "J", "samples", "left"),
    [("J", 5, 1, 1.0), ("none", 5, 5, 1.0), (0.4, 5, 2, 1.0), (0.5, 5, 2, 1.25), (0.05, 5, 1, 0.25), (2.0, 3, 3, 2.0)],
)
def test_fewer_samples_that_count_more_mean_the_same(power, J, samples, left):
    """The log-likelihood of a tap whose samples repeat is that of the equivalent tap, whatever the exponent."""
    model = model_of(J=J, K=3, power=power)
    fewer = equivalent(model)
    assert fewer.preprocessing.samples == samples
    assert fewer.exponent == pytest.approx(left)
    where, what = np.arange(3).repeat(2), np.tile([0, 1], 3)
    taps = fewer.form.sample(where, what, fewer.edges, samples, np.random.default_rng(1))
    times = J / samples
    mean = np.stack([model.log_likelihood(np.repeat(taps[:, [j]], J, axis=1)) for j in range(samples)]).mean(axis=0)
    np.testing.assert_allclose(fewer.log_likelihood(taps), mean, rtol=1e-12)
    if times == int(times):
        repeated = np.repeat(taps, int(times), axis=1)
        np.testing.assert_allclose(fewer.log_likelihood(taps), model.log_likelihood(repeated), rtol=1e-12)


def test_fewer_samples_may_be_of_taps_with_samples_before_the_press():
    model = model_of(J=5, K=3, power="J")
    record = Preprocessing(samples=5, trigger="press", pre_samples=2, tare="tap", tare_samples=3)
    assert equivalent(replace(model, preprocessing=record)).preprocessing.samples == 1


EXACT = {
    "J": (("J", 5), True),
    "none": (("none", 5), True),
    "two samples": ((0.4, 5), True),
    "rounded": ((0.1 * 3, 10), True),
    "two and a half": ((0.5, 5), False),
    "less than one": ((0.1, 5), False),
    "more than there are": ((2.0, 3), False),
}


@pytest.mark.parametrize(("given", "expected"), EXACT.values(), ids=EXACT)
def test_beliefs_are_right_where_whole_samples_are_worth_the_exponent(given, expected):
    power, J = given
    assert exact(model_of(power=power, J=J)) is expected
    assert not exact(model_of(power=power, J=J, saturation=5.0))


def test_models_of_times_keep_their_samples(make_taps):
    """So a root makes them cautious in the reference, and only without one beliefs are right."""
    taps = make_taps(2, 2, 4, 2)
    model = fit_model("profile", taps, taps.grid(), FitSettings(bins=9, power="J")).model
    kept = equivalent(model)
    assert kept.preprocessing.samples == 4
    assert kept.exponent == pytest.approx(0.25)
    np.testing.assert_allclose(kept.log_likelihood(taps.taps), model.log_likelihood(taps.taps))
    assert not exact(model)
    assert exact(replace(model, power="none"))
    count = np.full((2, 2), 3)
    where, what = np.repeat(np.argwhere(count), 3, axis=0).T
    table = TapTable(np.zeros((12, 2, 2)), tap_pool(where, what, (2, 2)), model.log_prior)
    found = simulate(model, table, [0.9], **OPTIONS, simulations=5)
    assert found.factor.shape == found.missed.shape == (5, 1, 3)


@pytest.mark.parametrize(("power", "J", "repeat"), [("none", 2, 1), ("J", 4, 4)])
def test_in_the_reference_beliefs_are_right(power, J, repeat):
    """Mistakes over doubt are 1 on average, and vary as they do in data of the model itself."""
    model = model_of(L=4, M=3, K=2, J=J, power=power)
    table = data_of(model, 12, 0, repeat)
    found = simulate(model, table, [0.9], **OPTIONS | {"trials": 400}, simulations=60)
    assert found.factor.shape == (60, 1, 4)
    assert found.factor[..., 0].mean() == pytest.approx(1, abs=0.12)
    factors = []
    for seed in range(60):
        own = data_of(model, 12, 1000 + seed, repeat)
        plan = plan_trials(own.pool, 400, seed)
        trials = run_trials(own, plan, [0.9], play=PlaySettings(theta_x=1.0, deadline=40), fresh=True, seed=seed)
        factors.append((trials.what != plan.what[:, None]).sum() / (1 - trials.belief).sum())
    ours = found.factor[:, 0, 0]
    assert np.mean(factors) == pytest.approx(ours.mean(), abs=3 * np.hypot(np.std(factors), ours.std()) / np.sqrt(60))
    assert np.std(factors) == pytest.approx(ours.std(), rel=0.5)


def test_fewer_taps_give_a_wider_reference():
    model = model_of(L=4, M=3)
    wide, narrow = (
        simulate(model, data_of(model, n, 0), [0.7], **OPTIONS | {"trials": 800}, simulations=40).factor[:, 0, 0]
        for n in (15, 120)
    )
    assert wide.std() > 1.5 * narrow.std()


def test_simulations_repeat_with_the_seed_and_count_their_progress():
    model = model_of()
    table = data_of(model, 6, 0)
    told = []
    one, again, other = (
        simulate(model, table, [0.5, 0.9], **OPTIONS | {"seed": seed}, simulations=4, progress=told.append)
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one.factor, again.factor)
    np.testing.assert_array_equal(one.missed, again.missed)
    assert not np.array_equal(one.factor, other.factor)
    assert told == [1] * 12


def test_one_object_has_a_reference_for_its_places():
    model = model_of(L=5, M=1)
    found = simulate(model, data_of(model, 8, 0), [0.8], **OPTIONS, simulations=30)
    assert found.factor.shape == (30, 1, 6)
    assert np.nanmean(found.factor[:, 0, 0]) == pytest.approx(1, abs=0.3)


def test_data_sets_are_described_as_the_audit_describes_taps():
    """Factors of all decisions are those of `reliability`; missed trials are counted as promises are made."""
    model = model_of(L=4, M=3)
    table = data_of(model, 9, 3)
    plan = plan_trials(table.pool, 300, 0)
    trials = run_trials(table, plan, (0.6, 0.8), play=PlaySettings(theta_x=1.0, deadline=4, border="clamp"), fresh=True)
    factor, missed = described(trials.what, plan.what, trials.belief, trials.stopped, 3)
    data = reliability(
        table,
        model.grid,
        (0.6, 0.8),
        0,
        trials=300,
        play=PlaySettings(deadline=4, border="clamp"),
        contacts=(),
        resamples=1,
        only="passive",
    )
    at = at_stopping(data, "passive").sel(counted="all")
    np.testing.assert_allclose(factor, at.factor.transpose("theta", "what"))
    for h in range(2):
        wrong = (trials.what[:, h] != plan.what) & trials.stopped[:, h]
        assert 0 < wrong.sum() < trials.stopped[:, h].sum() < 300
        assert missed[h, 0] == pytest.approx(wrong.sum() / trials.stopped[:, h].sum())
        for m in range(3):
            assert missed[h, 1 + m] == pytest.approx(wrong[plan.what == m].mean())


def test_ties_count_for_both_sides():
    """Of nine data sets two above, three equal and four below."""
    found = compare(1.0, np.array([2.0, 3, 1, 1, 1, 0, 0, 0.5, 0.5]))
    assert (found.value, found.median) == (1.0, 1.0)
    assert found.above == pytest.approx((1 + 5) / 10)
    assert found.below == pytest.approx((1 + 7) / 10)
    assert compare(9.0, np.arange(19.0)).above == pytest.approx(11 / 20)
    assert compare(99.0, np.arange(19.0))[4:] == pytest.approx((1 / 20, 1))
    assert compare(-1.0, np.arange(19.0))[4:] == pytest.approx((1, 1 / 20))


def test_data_sets_without_a_mistake_or_a_doubt_count_as_nothing():
    """Against a value of 0 too, and for none below; a value that is not known rejects nothing."""
    reference = np.array([np.nan, 0.0, 1.0, np.nan, 2.0])
    found = compare(3.0, reference)
    assert (found.median, found.above, found.below) == (1.0, pytest.approx(1 / 6), 1.0)
    assert (found.low, found.high) == pytest.approx((0.05, 1.95))
    assert compare(0.0, reference)[4:] == (1.0, pytest.approx(4 / 6))
    assert compare(np.nan, reference)[4:] == (1.0, 1.0)
    alone = compare(1.0, np.full(39, np.nan))
    assert alone[4:] == (1 / 40, 1.0)
    assert np.isnan([alone.median, alone.low, alone.high]).all()


def test_an_infinite_factor_is_above_all_others():
    """Decisions are wrong that leave no doubt: only data sets with such decisions count against it."""
    reference = np.append(np.arange(8.0), np.nan)
    assert compare(np.inf, reference) == (np.inf, 3.5, pytest.approx(0.175), pytest.approx(6.825), 0.1, 1.0)
    assert compare(np.inf, np.append(reference, np.inf))[4:] == pytest.approx((2 / 11, 1.0))
    assert compare(5.0, np.append(reference, np.inf))[1:] == (
        4.0,
        1.0,
        np.inf,
        pytest.approx(5 / 11),
        pytest.approx(8 / 11),
    )
    assert compare(np.inf, np.full(9, np.nan))[4:] == (0.1, 1.0)
    assert np.isnan(compare(np.inf, np.full(9, np.nan)).median)


def judged_passive(model, table, setting, trials, advance=lambda _: None):
    """A model on a table of taps, in passive trials."""
    options = {"trials": trials, "seed": 0}
    found = decisions(table, model.grid, setting, [setting.play.threshold], contacts=(), only="passive", **options)
    told = headline(found, "passive", setting.play.threshold)
    reference = reference_factors(model, table, setting, "passive", trials // 2, 0, progress=advance)
    return judge(told, model, table.pool, reference)


def test_mistakes_without_a_doubt_are_overconfident():
    """Likelihoods of a million nats leave no doubt; the factor of all decisions and of each object is infinite."""
    model = model_of(L=3, M=3)
    table = data_of(model, 12, 1)
    bold = replace(model, power=1e6)
    seen = table._replace(log_likelihood=1e6 * table.log_likelihood)
    setting = Setting.of(threshold=0.9, border="clamp", passive=True, deadline=40)
    found = judged_passive(bold, seen, setting, 300)
    assert 0 < found.wrong < 1
    assert found.factor == (np.inf, np.inf, np.inf)
    assert all(factor == (np.inf, np.inf, np.inf) for factor, _ in found.each.values())


def test_a_setting_is_played_as_it_says():
    """Moves, fixation, border, deadline and threshold of the setting; passive trials never move."""
    model = model_of(L=5, M=2, B=3)
    table = data_of(model, 6, 0)
    setting = Setting.of(threshold=0.8, theta_x=0.3, fixation=1, border="circular", deadline=6)
    options = {
        "trials": 90,
        "seed": 4,
        "simulations": 3,
    }
    for policy, theta_x in (("active", 0.3), ("passive", 1.0)):
        found = reference_factors(model, table, setting, policy, 90, 4, 3)
        np.testing.assert_array_equal(
            found,
            simulate(
                model,
                table,
                [0.8],
                play=PlaySettings(theta_x=theta_x, border="circular", deadline=6, fixation=1),
                **options,
            ).factor[:, 0],
        )
    one = reference_factors(model_of(L=5, M=1), data_of(model_of(L=5, M=1), 6, 0), setting, "passive", 90, 4, 3)
    assert one.shape == (3, 6)


@pytest.mark.slow
def test_the_test_has_its_level():
    """Sixty data sets of the model itself: p-values are uniform, so one in ten is at most a tenth, either side."""
    model = model_of(L=2, M=2, B=4, seed=3)
    p, n = [], 60
    for seed in range(n):
        table = data_of(model, 10, seed)
        options = OPTIONS | {
            "seed": seed,
            "trials": 60,
            "play": OPTIONS["play"].changed(deadline=10),
        }  # as here, with streams of its own
        plan = plan_trials(table.pool, 60, seed, first_stream=10**6)
        trials = run_trials(
            table, plan, [0.7], play=PlaySettings(theta_x=1.0, deadline=10, border="clamp"), fresh=True, seed=seed
        )
        value = described(trials.what, plan.what, trials.belief, trials.stopped, 2)[0][0, 0]
        reference = simulate(model, table, [0.7], **options, simulations=29).factor[:, 0, 0]
        p.append(compare(value, reference)[4:])
    for above in (0.1, 0.3, 0.5):
        found = (np.array(p) <= above).sum(axis=0)
        assert (found <= binom.ppf(0.999, n, above)).all()
        assert (found >= binom.ppf(0.001, n, above)).all()


def test_the_verdict_finds_the_side():
    """Samples counted several times are above a right model, half counted ones below; the right model is neither."""
    model = model_of(L=4, M=3, J=3)
    table = data_of(model, 40, 5)
    setting = Setting.of(threshold=0.9, border="clamp", passive=True, deadline=40)
    told = []

    def judged(power):
        bold = replace(model, power=power)
        seen = table._replace(log_likelihood=power * table.log_likelihood)
        return judged_passive(bold, seen, setting, 400, told.append)

    right = judged(1.0)
    assert min(right.beside.above, right.beside.below) > 0.025
    assert right.exact
    assert right.taps == 40
    assert right.beside.value == right.factor[0]
    assert list(right.each) == ["object 0", "object 1", "object 2"]
    for factor, beside in right.each.values():
        assert beside.value == factor[0]
    assert sum(told) == SIMULATIONS
    # One sample at power 1 is what three samples at a third are worth: right taps of three are known better.
    cautious = judged(1 / 3)
    assert cautious.exact
    assert cautious.beside.below < 0.025 < cautious.beside.above
    repeated = data_of(model, 40, 5, repeat=3)
    bold = judged_passive(model, repeated, setting, 400)
    assert bold.beside.above < 0.025 < bold.beside.below
    assert bold.beside.low < 1 < bold.beside.high < bold.beside.value


def test_few_decisions_leave_the_label_of_all_objects():
    """Of the columns of a reference the first is all objects together, in the order of `reliability`."""
    data = reliability(data_of(model_of(), 5, 0), model_of().grid, (0.9,), 0, trials=30, contacts=(), resamples=1)
    assert str(data["what"].values[0]) == EVERYTHING
