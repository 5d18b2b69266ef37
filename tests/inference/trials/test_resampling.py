"""Trials on selections of the test taps, and how these turn into intervals."""

import numpy as np
import pytest
from scattered_taps import COUNT, table_of
from scipy.stats import binomtest, norm, t
from solidtouch.inference.trials import resampling
from solidtouch.inference.trials.records import plan_trials
from solidtouch.inference.trials.resampling import (
    RESAMPLES,
    Spread,
    planned_trials,
    play_resamples,
    share_beyond,
    spread,
    taps_per_class,
    too_few,
    trial_noise,
    widened,
)
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.selections import resampled_pools, thinned_pools
from solidtouch.models.settings import PlaySettings

SAMPLES = np.arange(101.0)
"""Resamples 0 to 100, of mean 50."""


def with_estimate(value, samples=SAMPLES):
    return np.concatenate([[value], samples])


def test_an_interval_lies_about_the_estimate():
    """As far as Student's t says by the standard deviation of the resamples, enlarged."""
    for factor in (1.0, 1.5):
        low, high = Spread(factor).interval(with_estimate(80.0))
        margin = factor * SAMPLES.std(ddof=1) * t.isf(0.025, 100)
        assert (low, high) == pytest.approx((80 - margin, 80 + margin))
        assert margin == pytest.approx(Spread(factor).margin(with_estimate(80.0), 0.025))


def test_an_interval_ends_where_the_quantity_does():
    """Each end is a value from which the estimate is as far as Student's t says, by the spread of that value."""
    value, least, most = np.array([20.0, 90.0]), 0.0, np.array([60.0, 100.0])
    samples = np.stack([with_estimate(one) for one in value])
    samples[0, 1:] = samples[0, 1:] / 2
    ends = Spread(1.0).interval(samples, least, most)
    center, variance = samples[:, 1:].mean(axis=1), samples[:, 1:].var(axis=1, ddof=1)
    for end in ends:
        grown = variance * end * (most - end) / (center * (most - center))
        assert (value - end) ** 2 / grown == pytest.approx([t.isf(0.025, 100) ** 2] * 2)
    assert (ends[0] < value).all()
    assert (value < ends[1]).all()
    assert (ends[1] < most).all()


def test_a_proportion_has_the_interval_of_wilson():
    """Resamples that vary as independent cases do; a count among very many is a proportion of nearly none."""
    n, k = 40, 6
    spread_out = np.array([-1.0, 1.0]) * np.sqrt(k / n * (1 - k / n) / n / 2)
    samples = np.concatenate([[k / n], k / n + np.tile(spread_out, 50_000)])
    assert samples[1:].var(ddof=1) == pytest.approx(k / n * (1 - k / n) / n / 2, rel=1e-4)
    low, high = Spread(2**0.5).interval(samples, 0.0, 1.0)
    wilson = binomtest(k, n).proportion_ci(method="wilson")
    assert (low, high) == pytest.approx((wilson.low, wilson.high), rel=1e-4)
    np.testing.assert_allclose(Spread(1.0).interval(samples, 0.0), Spread(1.0).interval(samples, 0.0, 1e9))


def test_one_error_more_is_known_from_how_the_seen_ones_vary():
    """Of 3 in 50 it is a fiftieth; where there is none nothing is known. What was not seen adds its square."""
    p = 3 / 50
    samples = np.append(p, p + np.tile([-1, 1], 50) * np.sqrt(p * (1 - p) / 50 * 99 / 100))
    assert Spread(1.0).per_error(samples, 0.0, 1.0) == pytest.approx(1 / 50)
    assert Spread(1.0).per_error(np.zeros(20), 0.0, 1.0) == 0
    low, high = Spread(1.0).interval(np.zeros((2, 101)), event=[0.0, 0.5])
    assert high == pytest.approx([0.0, 0.5 * t.isf(0.025, 99)])
    assert low == pytest.approx(-high)


@pytest.mark.parametrize(
    ("classes", "taps", "p"), [(18, 20, 0.02), (18, 60, 0.005), (2, 12, 0.15), (2, 12, 0.4), (18, 5, 0.05)]
)
def test_rare_errors_are_in_their_intervals(classes, taps, p):
    """Without a quarter of the taps errors are a third more at most: the middle 95% of selections hold too little."""
    rng = np.random.default_rng(0)
    kept, held = taps - taps // 4, []
    for _ in range(300):
        wrong = (rng.random((classes, taps)) < p).astype(float)
        chosen = rng.random((60, classes, taps)).argsort(axis=2)[..., :kept]
        drawn = np.take_along_axis(np.broadcast_to(wrong, (60, classes, taps)), chosen, 2).mean(axis=(1, 2))
        middle = wrong.mean() + 3**0.5 * (np.quantile(drawn, [0.025, 0.975]) - drawn.mean())
        ends = Spread(3**0.5).interval(np.append(wrong.mean(), drawn), 0.0, 1.0), middle
        means = wrong.mean(), drawn.mean()
        held.append([low <= p <= high for low, high in (widened(*one, *means, classes * taps) for one in ends)])
    new, old = np.mean(held, axis=0)
    assert 0.91 < new < 0.985
    assert old < 0.9


def test_an_interval_holds_whatever_else_the_estimate_might_have_been():
    """Each end is where it would be about that value; what is not known leaves no interval."""
    samples = with_estimate(60.0)
    low, high = Spread(1.0).interval(samples)
    assert Spread(1.0).interval(samples, endings=[np.array(50.0), np.array(61.0)]) == (low - 10, high + 1)
    assert Spread(1.0).interval(samples, endings=[np.array(62.0), np.array(np.inf)]) == (low, np.inf)
    assert np.isnan(Spread(1.0).interval(samples, endings=[np.array(np.nan)])).all()
    bounded = Spread(1.0).interval(samples, 0.0, endings=[np.array(0.0), np.array(np.inf)])
    assert bounded == (0.0, np.inf)
    assert Spread(1.0).interval(samples, 0.0, 70.0, [np.array(70.0)])[1] == 70.0


def test_few_undefined_resamples_are_left_out_and_many_leave_no_interval():
    """Up to one in twenty; without an estimate there is none either."""
    few, many = SAMPLES[1:].copy(), SAMPLES[1:].copy()
    few[::20], many[:6] = np.nan, np.nan
    assert np.isnan(few).sum() == 5
    low, high = Spread(1.0).interval(np.stack([with_estimate(x, y) for x, y in ((0, few), (0, many), (np.nan, few))]))
    defined = few[~np.isnan(few)]
    assert high[0] == -low[0] == pytest.approx(defined.std(ddof=1) * t.isf(0.025, 94))
    assert np.isnan(low[1:]).all()
    assert np.isnan(high[1:]).all()


def test_infinite_resamples_may_be_ends():
    """The others are about the mean of the finite ones; an infinite estimate has the ends of its resamples."""
    some = SAMPLES.copy()
    some[:5] = -np.inf
    low, high = Spread(1.0).interval(with_estimate(60.0, some))
    assert low == -np.inf
    assert high == pytest.approx(60 + some[5:].std(ddof=1) * t.isf(0.025, 95))
    low, high = Spread(2.0).interval(with_estimate(-np.inf, some))
    assert (low, high) == (-np.inf, 98)


def test_deviations_are_enlarged_by_the_number_of_draws():
    """Taps of a class, the median over those that have some; sessions where several test."""
    table = table_of()
    assert taps_per_class(table.pool) == 4
    assert spread(table).taps == table.pool.count.sum()
    assert spread(table_of(count=np.where(COUNT == 1, 4, COUNT))).factor == pytest.approx(np.sqrt(4 / 3))
    lone, others = 1, 1 / 4 + 1 / 7 + 1 / 5 + 1 / 2
    ratio = (others + lone) * (4.5 / 5) ** 2
    assert spread(table).factor ** 2 == pytest.approx(4 / 3 * ratio / (others + lone / 3))
    assert spread(table, thinned=True).factor ** 2 == pytest.approx(3 * ratio / (others + lone * 3 / 4))
    assert spread(table).freedom == pytest.approx((others + lone) ** 2 / (lone + others**2 / (3 + 6 + 4 + 1)))
    assert np.isinf(spread(table_of(count=np.full((3, 2), 6))).freedom)
    sessions = table_of(count=np.full((3, 2), 6), session=lambda i: i % 3)
    assert spread(sessions).factor == spread(sessions, thinned=True).factor == pytest.approx(np.sqrt(2))
    assert spread(sessions).sessions == 3
    assert spread(table).sessions == 1
    assert spread(table_of(session=lambda i: 0 * i + 5)).factor == spread(table).factor
    outside = table_of(session=lambda i: np.where(i < 19, 0, i))
    assert spread(outside).factor == spread(table).factor
    assert np.isnan(spread(table_of(count=np.eye(2, dtype=int)), thinned=True).factor)
    single = spread(table_of(count=np.eye(2, dtype=int)))
    assert np.isnan(single.factor)
    assert "too few for an interval" in single.few
    assert np.isnan(single.interval(with_estimate(20.0))).all()
    assert np.isnan(single.interval(np.zeros(5), 0.0, 1.0)).all()  # nor where no error was seen


def test_too_few_taps_are_said():
    """Below ten of a class, where more than one trial in twenty used them up, or one in two hundred of a selection."""
    assert spread(table_of()).few == too_few(4) == "Too few test taps, about 4 per class: intervals are rough."
    assert too_few(9).startswith("Too few test taps, about 9")
    assert too_few(10) == too_few(10, 0.05) == ""
    assert too_few(10, 0.06).startswith(
        "Too few test taps: 6% of the decisions were forced because the taps of a class, about 10"
    )
    assert too_few(10, 0.06) == too_few(10, 0.06, 0.5)
    assert too_few(9, 0.0, 0.5) == too_few(9)
    assert too_few(1, sessions=3).startswith("Too few test sessions, 3, to estimate")
    assert too_few(1, 0.0, 0.5, sessions=4) == ""
    assert too_few(2, 0.06, sessions=2) == too_few(2, 0.06)
    assert too_few(1, 0.06) == too_few(1) == "Most classes have a single test tap, too few for an interval."
    assert "sessions, 7 of unequal sizes, to estimate" in too_few(1, sessions=7, freedom=1.1)
    assert too_few(1, sessions=7, freedom=3.0) == ""
    assert too_few(12, freedom=9.0).startswith("Some classes have a single test tap")
    assert too_few(12, freedom=10.0) == too_few(12, freedom=np.inf) == ""
    lone = table_of(count=np.array([[20, 20, 20], [20, 1, 1]]))
    assert spread(lone).few == too_few(20, freedom=spread(lone).freedom) != ""
    assert too_few(10, 0.05, 0.005) == ""
    assert "without a quarter of them, 0.6% of the decisions are forced" in too_few(10, 0.05, 0.006)
    assert "0.6% of the passive decisions are" in too_few(10, 0.05, 0.006, decisions="passive decisions")
    assert "6% of the passive decisions were" in too_few(10, 0.06, decisions="passive decisions")


def sums(trials, plan):
    return {"taps": trials.taps.sum(axis=0), "right": (trials.what == plan.what[:, None]).sum(axis=0)}


OPTIONS = {
    "trials": 60,
    "play": PlaySettings(theta_x=0.0, deadline=9),
    "fixation": 1,
    "seed": 4,
    "resamples": 6,
    "resample_trials": 25,
}


@pytest.mark.parametrize(("fresh", "pools"), [(True, thinned_pools), (False, resampled_pools)])
def test_resamples_are_trials_on_selections_of_the_taps(fresh, pools):
    """Those of the taps first; each selection has streams of its own, in two halves of which the mean counts."""
    table = table_of()
    kept = play_resamples(table, (0.5, 0.9), sums, **OPTIONS, fresh=fresh)

    def alone(pool, n, stream):
        plan = plan_trials(pool, n, 4, 1, first_stream=stream)
        return sums(
            run_trials(
                table._replace(pool=pool),
                plan,
                (0.5, 0.9),
                play=PlaySettings(theta_x=0.0, deadline=9),
                seed=4,
                fresh=fresh,
            ),
            plan,
        )

    first, *others = pools(table, 6, 4)
    for name, values in kept.samples.items():
        assert values.shape == (2, 1 + 3 * 6)
        np.testing.assert_array_equal(values[:, 0], alone(first, 60, 0)[name])
        for r, pool in enumerate(others):
            halves = [alone(pool, 12, 60 + 24 * r + start)[name] for start in (0, 12)]
            np.testing.assert_array_equal(values[:, 7 + r], halves[0])
            np.testing.assert_array_equal(values[:, 13 + r], halves[1])
            np.testing.assert_allclose(values[:, 1 + r], np.mean(halves, axis=0), rtol=1e-15)
    per_trial, taps = kept.per_trial(), kept.samples["taps"]
    np.testing.assert_allclose(per_trial.samples["taps"], taps / np.r_[60, np.full(18, 12)], rtol=1e-15)


def test_many_trials_are_played_some_at_a_time(monkeypatch):
    """With the same sums, and what else they might have been."""

    def earlier(trials, _):
        return (trials._replace(taps=trials.taps - 1),)

    told = []
    whole, parts = [], []
    for size, kept in ((1 << 15, whole), (25, parts)):
        monkeypatch.setattr(resampling, "_AT_ONCE", size)
        told.clear()
        kept.append(play_resamples(table_of(), (0.5, 0.9), sums, **OPTIONS, endings=earlier, progress=told.append))
    assert told == [25, 25, 10, *[24] * 6]
    (one,), (other,) = whole, parts
    for name, values in one.samples.items():
        np.testing.assert_array_equal(values, other.samples[name])
        np.testing.assert_array_equal(one.endings[0][name], other.endings[0][name])


def test_resamples_do_not_depend_on_workers_and_count_their_progress():
    told = []
    one = play_resamples(table_of(), (0.5,), sums, **OPTIONS, workers=1, progress=told.append)
    several = play_resamples(table_of(), (0.5,), sums, **OPTIONS, workers=3)
    for name, values in one.samples.items():
        np.testing.assert_array_equal(values, several.samples[name])
    assert told == [60, *[24] * 6]
    assert sum(told) == planned_trials(60, 6, 25)
    assert planned_trials(10) == 10 * (1 + RESAMPLES)
    assert planned_trials(5000) == 5000 + RESAMPLES * resampling.RESAMPLE_TRIALS


def test_models_differ_by_nothing_from_themselves():
    """In every resample; better ones do better in most of them."""
    weak, same, good = (
        play_resamples(table_of(skill=skill), (0.5,), sums, **OPTIONS).samples["right"][0] for skill in (0.5, 0.5, 3.0)
    )
    np.testing.assert_array_equal(weak, same)
    assert (good > weak).mean() > 0.7


def test_trials_may_have_come_to_something_else():
    """What the trials of the test taps would give then, and those of no selection."""

    def earlier(trials, plan):
        return trials._replace(taps=trials.taps - 1), trials._replace(what=plan.what[:, None] + 0 * trials.what)

    kept = play_resamples(table_of(), (0.5, 0.9), sums, **OPTIONS, endings=earlier)
    np.testing.assert_array_equal(kept.endings[0]["taps"], kept.samples["taps"][:, 0] - 60)
    np.testing.assert_array_equal(kept.endings[1]["right"], [60, 60])
    assert play_resamples(table_of(), (0.5,), sums, **OPTIONS).endings == ()


def test_taps_may_be_drawn_again():
    """With `fresh` off no trial uses a class up."""
    fresh, again = (
        play_resamples(table_of(), (1.0,), lambda t, _: {"used up": t.used_up.sum(axis=0)}, **OPTIONS, fresh=value)
        for value in (True, False)
    )
    assert fresh.per_trial().samples["used up"].min() > 0.5
    assert not again.samples["used up"].any()


def layered(estimate, taps, noise, rng):
    """Samples of a quantity with so much variance by taps, and by the trials of a resample."""
    R = len(taps)
    halves = taps + rng.normal(0, np.sqrt(2 * noise), (2, R))
    return np.concatenate([[estimate], halves.mean(axis=0), *halves])


@pytest.mark.parametrize("noise", [0.0, 0.5, 4.0])
def test_the_sampling_of_trials_is_taken_out(noise):
    """What is left is enlarged; what the trials of the estimate scatter by is added."""
    rng = np.random.default_rng(1)
    samples = [layered(0.0, rng.normal(0, 1, 200), noise, rng) for _ in range(200)]
    errors = Spread(3.0, noise=0.25).margin(np.array(samples), norm.sf(1))
    assert np.mean(errors) == pytest.approx(np.sqrt(9 + 0.25 * noise), rel=0.08)


@pytest.mark.parametrize("R", [40, 200])
@pytest.mark.parametrize("noise", [0.0, 0.5, 2.0, 4.0, 20.0])
def test_intervals_hold_the_truth_however_noisy_selections_are(noise, R):
    """Also where the chance of trials hides that of taps; without degrees of freedom 0.90 to 0.94 would at 2 and 4."""
    rng = np.random.default_rng(3)
    estimates = rng.normal(0, np.sqrt(3 + 0.25 * noise), 2000)
    samples = np.array([layered(one, rng.normal(0, 1, R), noise, rng) for one in estimates])
    low, high = Spread(3**0.5, noise=0.25).interval(samples)
    held = np.mean((low <= 0) & (high >= 0))
    assert held > 0.941
    assert held < 0.97 or noise > 2


def test_trials_that_vary_by_chance_alone_leave_the_chance_of_the_estimate():
    rng = np.random.default_rng(2)
    samples = layered(0.0, np.zeros(4000), 1.0, rng)
    low, high = Spread(3.0, noise=0.25).interval(samples)
    assert 0.5 < (high - low) / 2 / 1.96 < 1.2
    constant = np.full(1 + 3 * 10, 2.0)
    assert Spread(3.0, noise=0.25).interval(constant) == (2.0, 2.0)
    assert Spread(3.0, noise=0.25).whole(np.arange(7.0)).tolist() == [1, 2]
    assert Spread(3.0).whole(np.arange(7.0)).tolist() == [1, 2, 3, 4, 5, 6]
    deviation = 3 * np.arange(1, 7).std(ddof=1)
    assert Spread(3.0).margin(np.arange(7.0), 0.01) == pytest.approx(deviation * t.isf(0.01, 5))
    assert Spread(3.0, freedom=3).margin(np.arange(7.0), 0.01) == pytest.approx(deviation * t.isf(0.01, 3))
    assert Spread(3.0, freedom=3).interval(np.arange(7.0)) == pytest.approx(
        deviation * t.isf(0.025, 3) * np.array([-1, 1])
    )


def test_the_noise_of_an_estimate_falls_with_its_trials():
    assert trial_noise(4000) == 0.5
    assert trial_noise(100) == trial_noise(2000) == 1
    assert trial_noise(101) == pytest.approx(100 / 101)


def test_an_interval_reaches_as_far_as_what_was_never_seen_could():
    """The exact two-sided bound of a proportion without a case."""
    assert share_beyond(100) == pytest.approx(0.03622, abs=1e-5)
    assert 1 - (1 - share_beyond(37)) ** 37 == pytest.approx(0.975)
    value, center = np.array([0.0, 0.4, 1.0, 0.001]), np.array([0.0, 0.4, 1.0, 0.001])
    low, high = widened(np.array([0.0, 0.4, 1.0, 0.0]), np.array([0.0, 0.5, 1.0, 0.002]), value, center, 100)
    assert low.tolist() == pytest.approx([0, 0.4, 1 - share_beyond(100), 0])
    assert high.tolist() == pytest.approx([share_beyond(100), 0.5, 1, 0.002])


def test_where_nothing_was_seen_an_interval_begins_at_the_least():
    """Whatever the estimate, and reaches beyond it: of errors, and of taps where all decisions take one."""
    for value in (0.0, 0.001):
        low, high = widened(*Spread(1.0).interval(np.append(value, np.zeros(50)), 0.0, 1.0), value, np.array(0.0), 100)
        assert (low, high) == (0.0, pytest.approx(share_beyond(100)))
    low, high = widened(*Spread(1.0).interval(np.ones(51), 1.0, 40.0), 1.0, np.array(1.0), 100, 1.0, 40.0, least=1.0)
    assert (low, high) == (1.0, pytest.approx(1 + share_beyond(100)))
    low, high = widened(*Spread(1.0).interval(np.append(0.999, np.ones(50)), 0.0, 1.0), 0.999, np.array(1.0), 100)
    assert (low, high) == (pytest.approx(1 - share_beyond(100)), 1.0)


def test_an_estimate_without_errors_is_not_sure_of_it_because_resamples_have_some():
    """However little they vary; the end is that of so many decisions without an error."""
    for value, ends in ((0.0, (0.0, share_beyond(100))), (1.0, (1 - share_beyond(100), 1.0))):
        assert widened(value, value, value, np.array(0.5), 100) == pytest.approx(ends)
    assert widened(0.0, 0.2, 0.0, np.array(0.05), 100) == (0.0, 0.2)


def test_an_interval_holds_its_estimate_where_resamples_are_infinite():
    """Or where the estimate is."""
    some = 5.0
    assert Spread(1.0).interval(np.append(some, np.full(50, np.inf)), 0.0) == (some, np.inf)
    assert Spread(1.0).interval(np.append(some, np.full(50, -np.inf))) == (-np.inf, some)
    low, high = Spread(1.0).interval(np.append(np.inf, np.arange(50.0)), 0.0)
    assert low < 2
    assert high == np.inf


def test_an_interval_of_which_resamples_know_nothing_is_wide_open():
    """From 0 to 1."""
    value = np.array([np.nan, 0.5])
    low, high = widened(value, np.array([np.nan, 0.6]), value, np.array([0, 0.5]), [50, 50], opened=True)
    assert low.tolist() == [0, 0.5]
    assert high.tolist() == [1, 0.6]


def test_mean_errors_in_millimetres_are_widened_by_one_class_and_never_from_above():
    """There is no greatest mean; an undefined interval stays so."""
    value = np.array([0.0, 9.0, np.nan])
    low, high = widened(value, np.array([0.0, 9.5, np.nan]), value, np.array([0, 9, 0]), 100, 2.0, np.inf)
    assert high[:2].tolist() == pytest.approx([2 * share_beyond(100), 9.5])
    assert low[:2].tolist() == [0, 9]
    assert np.isnan([low[2], high[2]]).all()
