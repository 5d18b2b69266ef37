"""Reliability of beliefs and the promises of the stopping rule, on tables small enough to be played by hand."""

import json
from functools import cache

import numpy as np
import pytest
import xarray as xr
from even_taps import even_table
from slow_cases import slow_but
from solidtouch.analysis.audit.guarantees import (
    PROMISED,
    USED,
    broken,
    exceeded,
    guarantee_sentence,
    guarantees,
    of_largest,
)
from solidtouch.analysis.stats import reliability as reliability_module
from solidtouch.analysis.stats.decided import decided_about, independent_decisions
from solidtouch.analysis.stats.reliability import (
    BINS,
    COUNTED,
    EVERYTHING,
    after_contacts,
    at_stopping,
    bin_edges,
    headline,
    interval_sentence,
    reliability,
)
from solidtouch.analysis.stats.right_model import Reference
from solidtouch.inference.trials.records import TapTable, plan_trials
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid, tap_pool
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import PlaySettings

L, M = 6, 3
TRIALS, DEADLINE = 240, 7
THETAS = (0.9, 0.5, 0.7)


def grid_of(L=L, M=M):
    return ClassGrid(1.5 * np.arange(L), "mm", None, tuple((f"rod {m}",) for m in range(M)))


def table_of(L=L, M=M, repeats=4, **more):
    return even_table(L, M, repeats, **more)


@cache
def calibrated(L=L, M=M, repeats=1500, seed=5, symbols=7, evenness=1.5):
    """A table of taps drawn from the very distributions that their likelihoods are of."""
    rng = np.random.default_rng(seed)
    p = rng.dirichlet(np.full(symbols, evenness), size=(L, M))
    where, what, _ = (index.ravel() for index in np.indices((L, M, repeats)))
    drawn = (rng.random(len(where))[:, np.newaxis] > p[where, what].cumsum(axis=1)).sum(axis=1)
    prior = np.full((L, M), -np.log(L * M))
    return TapTable(np.moveaxis(np.log(p), 2, 0)[drawn], tap_pool(where, what, (L, M)), prior)


@pytest.fixture(scope="module")
def data():
    return reliability(
        table_of(),
        grid_of(),
        THETAS,
        3,
        trials=TRIALS,
        play=PlaySettings(deadline=DEADLINE, fixation=2),
        contacts=(1, 4),
    )


def by_hand(table, theta, theta_x, deadline=DEADLINE):
    plan = plan_trials(table.pool, TRIALS, 3, 2)
    trials = run_trials(
        table, plan, (theta,), play=PlaySettings(theta_x=theta_x, deadline=deadline), seed=3, fresh=True
    )
    return plan, trials


@pytest.mark.parametrize(("policy", "theta_x"), [("passive", 1.0), ("active", 0.0)])
def test_means_are_those_of_trials_counted_one_by_one(data, policy, theta_x):
    """Of the stopped and of all, for every object and all together."""
    for theta in THETAS:
        plan, trials = by_hand(table_of(), theta, theta_x)
        at = at_stopping(data, policy).sel(theta=theta)
        for counted in COUNTED:
            for name in (EVERYTHING, *grid_of().what_name):
                n = wrong = doubt = loss = brier = taps = own = 0.0
                for i in range(TRIALS):
                    if name not in (EVERYTHING, f"rod {plan.what[i]}"):
                        continue
                    own += 1
                    if counted == "stopped" and not trials.stopped[i, 0]:
                        continue
                    belief, right = trials.belief[i, 0], trials.what[i, 0] == plan.what[i]
                    n, wrong, doubt = n + 1, wrong + (not right), doubt + 1 - belief
                    loss -= np.log(belief if right else 1 - belief)
                    brier += (belief - right) ** 2
                    taps += trials.taps[i, 0]
                cell = at.sel(counted=counted, what=name)
                assert cell.trials == n
                if not n:
                    assert np.isnan(cell.wrong)
                    continue
                assert cell.fraction == pytest.approx(n / own)
                for key, total in {
                    "wrong": wrong,
                    "doubt": doubt,
                    "log_loss": loss,
                    "brier": brier,
                    "taps": taps,
                }.items():
                    assert cell[key].item() == pytest.approx(total / n), key
                assert cell.factor.item() == pytest.approx(wrong / doubt)
                assert cell.over_promise.item() == pytest.approx(wrong / n / (1 - theta))


def test_after_fixed_numbers_of_taps_every_trial_counts(data):
    """As decided by a deadline, with a threshold that is never reached."""
    _, trials = by_hand(table_of(), 1.0, 1.0, deadline=4)
    part = after_contacts(data)

    assert part.contacts.values.tolist() == [1, 4]
    assert (part.taps.sel(what=EVERYTHING).values == [1, 4]).all()
    cell = part.sel(contacts=4, what=EVERYTHING)
    assert cell.doubt.item() == pytest.approx(1 - trials.belief.mean())
    assert cell.trials.item() == TRIALS
    assert np.isnan(part.over_promise).all()


def test_objects_add_up(data):
    """Trials, wrong decisions and the confusion."""
    each = data.isel(what=slice(1, None))
    everything = data.sel(what=EVERYTHING)
    wrong = (each.wrong * each.trials).sum("what")
    off_diagonal = data.confusion.sum(["true", "decided"]) - sum(
        data.confusion.isel(true=m, decided=m, drop=True) for m in range(M)
    )

    assert (each.trials.sum("what") == everything.trials).all()
    np.testing.assert_allclose(wrong, everything.wrong * everything.trials)
    np.testing.assert_allclose(off_diagonal.transpose(*wrong.dims), wrong)
    np.testing.assert_array_equal(data.confusion.sum("decided").values, each.trials.values)


def test_the_curve_holds_every_trial_and_its_gaps_are_the_calibration_error(data):
    """Bins of about equally many trials, in increasing belief."""
    full = data.curve_trials.values > 0
    gap = np.abs(data.curve_right - data.curve_belief).where(full, 0.0)

    np.testing.assert_array_equal(data.curve_trials.sum("bin"), data.trials)
    np.testing.assert_allclose((gap * data.curve_trials).sum("bin") / data.trials, data.calibration_error, atol=1e-12)
    for belief in data.curve_belief.values.reshape(-1, BINS):
        assert (np.diff(belief[np.isfinite(belief)]) > 0).all()
    assert (data.curve_right_low <= data.curve_right).where(full, True).all()
    assert (data.curve_right_high >= data.curve_right).where(full, True).all()


def test_equal_beliefs_share_a_bin():
    """So the order of trials does not matter, nor does that of taps, which makes beliefs differ by rounding."""
    belief = np.array([0.5, 0.9, 0.5, 0.5 + 1e-15, 0.7, 0.9])
    for bins, ends, places in ((3, [0.5, 0.9], [0, 1, 0, 0, 0, 1]), (6, [0.5, 0.7, 0.9], [0, 2, 0, 0, 1, 2])):
        edges = bin_edges(belief, bins)
        assert edges.tolist() == pytest.approx(ends)
        assert (np.searchsorted(edges, belief, side="right") - 1).tolist() == places
    assert bin_edges(np.full(9, 0.3)).tolist() == pytest.approx([0.3])
    assert bin_edges(np.empty(0)).tolist() == []
    many = np.random.default_rng(0).random(403)
    edges = bin_edges(many)
    counts = np.bincount(np.searchsorted(edges, many, side="right") - 1)
    assert len(edges) == len(counts) == BINS
    assert set(counts.tolist()) <= {40, 41}


@pytest.fixture(scope="module")
def kept_promises():
    """Of both policies, by a right model."""
    table, play = calibrated(), PlaySettings(deadline=400)
    return guarantees(table, table, grid_of(), (0.6, 0.8, 0.9), 1, play=play, trials=4000, resamples=40)


@pytest.mark.slow
@pytest.mark.parametrize("policy", slow_but(["active"], ("passive", "active")))
def test_a_right_model_has_factor_one_and_keeps_the_promises(policy, kept_promises):
    """Within the interval, overall; promises hold for each object too, and some decisions are wrong."""
    table, promises = calibrated(), kept_promises
    more, play = {"trials": 4000, "resamples": 40}, PlaySettings(border="clamp", deadline=400)
    data = reliability(table, grid_of(), (0.6, 0.8, 0.9), 1, play=play, contacts=(4,), only=policy, **more)
    at = at_stopping(data, policy).sel(what=EVERYTHING, counted="stopped")
    kept = promises.sel(setup=PROMISED, policy=policy)

    assert (at.wrong > 0.02).all()
    assert (at.factor_low < 1).all()
    assert (at.factor_high > 1).all()
    assert (at.factor_high - at.factor_low < 0.6).all()
    assert (at.over_promise < 1).all()
    after = after_contacts(data).sel(what=EVERYTHING)
    assert after.sizes["contacts"] == (policy == "passive")
    assert (after.factor_low < 1).all()
    assert (after.factor_high > 1).all()
    assert (after.calibration_error < 0.03).all()
    assert (kept.factor < 1).all()
    assert kept.holds.all()


@pytest.mark.slow
def test_a_likelihood_counted_three_times_breaks_what_it_promises():
    """The factor is well above 1, and the promise at a high threshold is broken beyond its interval."""
    table = calibrated(evenness=0.4)
    bold = table._replace(log_likelihood=3 * table.log_likelihood)
    data = reliability(bold, grid_of(), (0.95,), 1, trials=1500, contacts=(5,), resamples=40, only="passive")
    promises = guarantees(bold, table, grid_of(), (0.95,), 1, trials=1500, resamples=40)
    at = at_stopping(data, "passive").sel(theta=0.95, what=EVERYTHING, counted="stopped")

    assert at.factor_low > 2
    assert not promises.holds.sel(setup=PROMISED, policy="passive", what=EVERYTHING).any()
    assert promises.holds.sel(setup=USED, policy="passive", what=EVERYTHING).all()
    assert broken(promises, "passive", 0.95)[PROMISED][EVERYTHING][1] > 1


def promising(p, n, seed, power=1.0):
    """A model of known distributions, n taps of each class drawn from it at power none, and promises made of it."""
    L, M = p.shape[:2]
    counts = np.round(1e6 * p)[:, :, None].astype(np.int64)
    model = HistogramModel(grid_of(L, M), np.arange(p.shape[2] + 1.0), power, Preprocessing(1), counts, 0.0)
    where, what, _ = (index.ravel() for index in np.indices((L, M, n)))
    taps = model.form.sample(where, what, model.edges, 1, np.random.default_rng(seed))
    flat = np.full((L, M), -np.log(L * M))
    table = TapTable(model.log_likelihood(taps), tap_pool(where, what, (L, M)), flat)
    options = {"trials": 600, "resamples": 60}
    return model, table, guarantees(table, table, grid_of(L, M), (0.8,), 0, **options)


def test_a_promise_is_exceeded_by_a_test_only():
    """A bold model's is, a right model's is not; where no interval lies above its limit nothing is simulated."""
    p = np.random.default_rng(5).dirichlet(np.ones(6), size=(4, 3))
    model, table, promises = promising(p, 40, 1, power=4.0)
    at = promises.sel(setup=PROMISED, policy="passive", theta=0.8)
    found = exceeded(promises, model, table, "passive", 0.8, trials=300, simulations=60)
    assert list(found) == [EVERYTHING, "rod 0", "rod 1", "rod 2"]
    assert not at.holds.sel(what=EVERYTHING)
    # Counted four times, one sample has no right model: that at power 4 is as bold, and nothing exceeds it.
    assert not any(one.exceeded for one in found.values())
    right, _, _ = promising(p, 40, 1)
    found = exceeded(promises, right, table, "passive", 0.8, trials=300, simulations=60)
    assert found[EVERYTHING].exceeded
    assert found[EVERYTHING].beside.high < 1.5 < found[EVERYTHING].beside.value
    assert found[EVERYTHING].beside.value == pytest.approx(at.factor.sel(what=EVERYTHING).item())
    for name, one in found.items():
        assert not one.exceeded or not at.holds.sel(what=name)
    model, table, promises = promising(p, 40, 1)
    kept = exceeded(promises, model, table, "passive", 0.8)
    assert promises.holds.sel(setup=PROMISED, policy="passive").all()
    assert all(one == (False, None) for one in kept.values())


def test_promises_of_many_objects_are_simulated_often_enough(monkeypatch):
    """Holm's first step asks for a p-value of the level over their number, which few simulations never give."""
    p = np.random.default_rng(5).dirichlet(np.ones(6), size=(4, 3))
    _, table, promises = promising(p, 40, 1, power=4.0)
    asked = []

    def simulated(*_, simulations, play, **more):
        asked.append((simulations, play))
        return Reference(np.zeros((simulations, 1, 4)), np.zeros((simulations, 1, 4)))

    monkeypatch.setattr("solidtouch.analysis.audit.guarantees.simulate", simulated)
    right, _, _ = promising(p, 40, 1)
    found = exceeded(promises, right, table, "passive", 0.8, simulations=9)
    exceeded(promises, right, table, "active", 0.8, simulations=99, play=PlaySettings(fixation=3, theta_x=0.2))

    active = PlaySettings(border="clamp", fixation=3, theta_x=0.2)
    assert asked == [(79, PlaySettings(border="clamp", passive=True)), (99, active)]
    preview = exceeded(promises, right, table, "passive", 0.8, simulations=39)
    assert asked[-1][0] == 39
    assert preview[EVERYTHING].exceeded
    assert preview[EVERYTHING].beside.above == 1 / 40
    assert found[EVERYTHING].beside.above == 1 / 80
    assert found[EVERYTHING].exceeded


def test_the_largest_excess_is_tested_first_and_the_others_beside_each_other():
    """With 19 data sets at 5% only what lies above all of them, in units of the spread of each value."""
    reference = np.linspace(-1, 1, 19)[:, np.newaxis] * [1.0, 100.0, 1.0]
    assert of_largest([9.0, 900.0, 0.0], reference, 0.05).tolist() == [True, True, False]
    assert of_largest([0.9, 900.0, 0.0], reference, 0.05).tolist() == [False, True, False]
    assert of_largest([9.0, 90.0, np.nan], reference, 0.05).tolist() == [True, False, False]
    assert not of_largest([9.0, 900.0, 9.0], reference[1:], 0.05).any()
    assert not of_largest([np.nan, 0.0, 0.0], np.full((19, 3), np.nan), 0.05).any()


def test_the_largest_excess_keeps_its_level():
    """Whatever values have to do with each other, and where one is above."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(1000):
        values = rng.normal(size=(40, 1)) + rng.exponential(size=(40, 6)) ** 2
        values[0, 5] += 100
        found.append(of_largest(values[0], values[1:], 0.05))
    above = np.array(found)[:, 5].mean()
    wrong = np.array(found)[:, :5].any(axis=1).mean()
    assert above > 0.97
    assert 0.02 < wrong < 0.07


def test_promises_are_counted_as_they_are_made():
    """Overall among the stopped trials, for an object among all of its trials; against limits by hand."""
    table = table_of()
    data = guarantees(
        table,
        table,
        grid_of(),
        (0.7, 0.9),
        3,
        trials=TRIALS,
        play=PlaySettings(deadline=DEADLINE, border="circular", fixation=2),
    )
    plan, trials = by_hand(table, 0.9, 1.0)
    stopped, missed = trials.stopped[:, 0], trials.what[:, 0] != plan.what
    at = data.sel(setup=PROMISED, policy="passive", theta=0.9)

    assert at.limit.values.tolist() == pytest.approx([0.1, *[2 * 0.1 / 0.9] * M])
    assert at.wrong.sel(what=EVERYTHING).item() == pytest.approx(missed[stopped].mean())
    for m in range(M):
        own = plan.what == m
        assert at.wrong.sel(what=f"rod {m}").item() == pytest.approx((missed & stopped)[own].mean())
        assert at.stopped.sel(what=f"rod {m}").item() == pytest.approx(stopped[own].mean())
    np.testing.assert_allclose(data.factor, data.wrong / data.limit)
    passive = data.wrong.sel(policy="passive")
    np.testing.assert_array_equal(passive.sel(setup=PROMISED), passive.sel(setup=USED))
    active = data.wrong.sel(policy="active")
    assert (active.sel(setup=PROMISED) != active.sel(setup=USED)).any()
    assert "each object at most" in guarantee_sentence(data)


def test_never_wrong_is_not_surely_right():
    """The factor is 0, and its interval reaches as far as the number of independent decisions says."""
    data = reliability(table_of(skill=9.0), grid_of(), (0.9,), 0, trials=500, contacts=(3,))
    at = at_stopping(data, "passive").sel(theta=0.9, counted="stopped", what=EVERYTHING)
    taps = L * M * 4

    assert at.wrong == at.wrong_low == at.factor == at.factor_low == 0
    expected = 1 - 0.025 ** (1 / min(500, taps / at.taps.item()))
    assert at.wrong_high.item() == pytest.approx(expected)
    assert at.factor_high.item() == pytest.approx(expected / at.doubt.item())
    assert at.over_promise_high.item() == pytest.approx(expected / 0.1)
    assert not np.isnan(at.log_loss)


def test_beliefs_without_a_doubt_divide_nothing_by_zero():
    """Right ones tell nothing, wrong ones are infinitely too sure; JSON gets neither number."""
    sure = table_of(skill=9.0)
    certain = sure._replace(log_likelihood=sure.log_likelihood * 400)
    misled = certain._replace(log_likelihood=np.roll(certain.log_likelihood, 1, axis=2))
    for table, wrong in ((certain, 0.0), (misled, 1.0)):
        data = reliability(table, grid_of(), (0.9,), 0, trials=100, contacts=(1,))
        at = at_stopping(data, "passive").sel(theta=0.9, counted="stopped", what=EVERYTHING)
        assert (at.wrong, at.doubt) == (wrong, 0)
        assert np.isinf(at.factor) if wrong else np.isnan(at.factor)
        assert at.log_loss == pytest.approx(36.04 if wrong else 0, abs=0.01)
        said = headline(data, "active", 0.9)
        assert "NaN" not in json.dumps(said, allow_nan=False)
        assert said["factor"][0] is None
        assert said["wrong"][0] == wrong


def test_taps_used_twice_make_no_more_decisions():
    """Their number over the taps of a decision, at most the trials played."""
    pool = table_of().pool
    assert independent_decisions(pool, None, 4000, 6.0) == L * M * 4 / 6
    assert independent_decisions(pool, 1, 4000, 6.0) == L * 4 / 6
    assert independent_decisions(pool, 1, 3, 1.0) == 3
    assert independent_decisions(pool, 1, 4000, 100.0) == 1


def test_intervals_hold_whatever_trials_that_were_cut_short_might_have_come_to():
    """What 400 taps of a class give, where 4 of them end most trials: scores of beliefs, too, in 20 data sets."""
    options = {"trials": 400, "contacts": (), "only": "passive", "play": PlaySettings(deadline=60)}
    names = ("wrong", "doubt", "log_loss", "brier", "taps", "factor")
    many = calibrated(2, 2, repeats=400, symbols=3)
    truth = reliability(many, grid_of(2, 2), [0.99], 1, resamples=2, **options | {"trials": 4000})
    rng = np.random.default_rng(0)
    for _ in range(20):
        own = np.concatenate([rng.choice(400, 4, replace=False) + 400 * c for c in range(4)])
        cell = np.repeat(np.arange(4), 4)
        pool = tap_pool(*np.divmod(cell, 2), (2, 2))
        few = many._replace(log_likelihood=many.log_likelihood[own], pool=pool)
        data = reliability(few, grid_of(2, 2), [0.99], 1, resamples=40, **options)
        assert data.used_up > 0.5
        at, true = (one.isel(setting=0).sel(counted="all", what=EVERYTHING) for one in (data, truth))
        for name in names:
            assert at[f"{name}_low"] <= true[name] <= at[f"{name}_high"], name
        assert at.taps_high <= 60


def test_few_taps_give_the_factor_of_fresh_ones():
    """Sixty data sets of 20 taps per class from the model's own distributions: 1 on average.

    Drawn with replacement, the same taps make the same beliefs too sure by half and more.
    """
    rng, L, M, n, symbols = np.random.default_rng(4), 4, 3, 20, 6
    where, what, _ = (index.ravel() for index in np.indices((L, M, n)))
    p = rng.dirichlet(np.ones(symbols), size=(L, M))
    found = {True: [], False: []}
    for seed in range(60):
        drawn = (rng.random(len(where))[:, None] > p[where, what].cumsum(axis=1)).sum(axis=1)
        table = TapTable(
            np.moveaxis(np.log(p), 2, 0)[np.minimum(drawn, symbols - 1)],
            tap_pool(where, what, (L, M)),
            np.full((L, M), -np.log(L * M)),
        )
        plan = plan_trials(table.pool, 500, seed)
        for fresh, counts in found.items():
            trials = run_trials(table, plan, (0.95,), play=PlaySettings(theta_x=1.0), seed=seed, fresh=fresh)
            counts.append([(trials.what[:, 0] != plan.what).sum(), (1 - trials.belief).sum()])
    wrong, doubt = np.moveaxis(np.array([found[True], found[False]]), -1, 0)

    assert wrong[0].sum() / doubt[0].sum() == pytest.approx(1, abs=0.12)
    assert wrong[1].sum() / doubt[1].sum() > 1.5


@pytest.mark.slow
def test_intervals_cover_the_truth_of_other_taps():
    """Of 20 data sets of taps, the interval of the wrong fraction holds that of very many taps in most."""
    truth = reliability(
        calibrated(evenness=0.4), grid_of(), (0.8,), 0, trials=20000, contacts=(), resamples=1, only="passive"
    )
    true = at_stopping(truth, "passive").wrong.sel(what=EVERYTHING, counted="all").item()
    table, rng, held = calibrated(evenness=0.4), np.random.default_rng(8), 0
    where, what, _ = (index.ravel() for index in np.indices((L, M, 60)))
    for seed in range(20):
        chosen = (where * M + what) * 1500 + rng.integers(1500, size=len(where))
        part = TapTable(table.log_likelihood[chosen], tap_pool(where, what, (L, M)), table.log_prior)
        data = reliability(part, grid_of(), (0.8,), seed, trials=1000, contacts=(), resamples=40, only="passive")
        at = at_stopping(data, "passive").sel(what=EVERYTHING, counted="all", theta=0.8)
        held += at.wrong_low.item() <= true <= at.wrong_high.item()
    assert held >= 17


@pytest.mark.slow
def test_more_trials_at_one_place_do_not_narrow_intervals():
    """They repeat each other, and intervals hold the truth of other taps."""
    table, grid = calibrated(L=1, symbols=9, evenness=1.0), grid_of(1)
    truth = reliability(table, grid, (0.8,), 0, trials=20000, contacts=(), resamples=1, only="passive")
    true = at_stopping(truth, "passive").wrong.sel(what=EVERYTHING, counted="all").item()
    rng, held, widths = np.random.default_rng(8), 0, []
    where, what, _ = (index.ravel() for index in np.indices((1, M, 80)))
    for seed in range(20):
        part = TapTable(
            table.log_likelihood[what * 1500 + rng.integers(1500, size=len(what))],
            tap_pool(where, what, (1, M)),
            table.log_prior,
        )
        for trials in (100, 2000) if seed < 6 else (2000,):
            data = reliability(part, grid, (0.8,), seed, trials=trials, contacts=(), resamples=40, only="passive")
            at = at_stopping(data, "passive").sel(what=EVERYTHING, counted="all", theta=0.8)
            widths.append(float(at.wrong_high - at.wrong_low))
        held += at.wrong_low.item() <= true <= at.wrong_high.item()
    assert held >= 17
    assert np.mean(widths[1:12:2]) > 0.6 * np.mean(widths[:12:2])


def test_one_object_is_decided_for_by_its_place():
    """Places stand for objects, without moves, and a state of the episode is summed out."""
    table, grid = table_of(L=7, M=1, states=2, skill=0.4), grid_of(7, 1)
    data = reliability(table, grid, (0.8,), 0, trials=60, contacts=(2,))
    subject = decided_about(table, grid)

    assert data.attrs["decides"] == subject.kind == "place"
    assert data.what.values.tolist() == ["all", *(grid.where_label(l) for l in range(7))]
    assert set(data.policy.values) == {"passive"}
    assert subject.table.log_likelihood.shape == (28, 1, 14)
    for s in range(2):
        turned = subject.table.log_likelihood[:, 0, 7 * s : 7 * s + 7]
        np.testing.assert_array_equal(turned, table.log_likelihood[:, :, s])
    own = [subject.table.pool.pick(0, l, 0.6) for l in range(7)]
    assert own == [table.pool.pick(l, 0, 0.6) for l in range(7)]
    assert 0 < at_stopping(data, "passive").wrong.sel(what=EVERYTHING, counted="all").item() < 0.7
    promises = guarantees(table, table, grid, (0.8,), 0, trials=60)
    assert promises.limit.sel(theta=0.8).values.tolist() == pytest.approx([0.2, *[1.5] * 7])


def test_one_place_has_no_active_trials():
    """And none of its promises."""
    data = reliability(table_of(L=1), grid_of(1), (0.6,), 0, trials=50, contacts=(1,))
    assert set(data.policy.values) == {"passive"}
    assert "another session may differ by more" in interval_sentence(data)
    sessions = table_of(L=1)._replace(session=np.arange(M * 4) % 2)
    several = reliability(sessions, grid_of(1), (0.6,), 0, trials=50, contacts=(1,), resamples=9)
    assert "without each of the 2 test sessions in turn" in interval_sentence(several)
    assert guarantees(table_of(L=1), table_of(L=1), grid_of(1), (0.6,), 0, trials=50).policy.values.tolist() == [
        "passive"
    ]


def test_an_object_without_a_tap_has_no_numbers():
    """And the others have theirs."""
    table = table_of()
    keep = np.flatnonzero(np.repeat(np.tile(np.arange(M), L), 4) != 1)
    where, what, _ = (index.ravel()[keep] for index in np.indices((L, M, 4)))
    part = TapTable(table.log_likelihood[keep], tap_pool(where, what, (L, M)), table.log_prior)
    data = reliability(part, grid_of(), (0.7,), 0, trials=80, contacts=())
    at = at_stopping(data, "active").sel(theta=0.7)

    assert np.isnan(at.wrong.sel(what="rod 1")).all()
    assert np.isfinite(at.wrong.sel(what="rod 2")).all()
    assert headline(data, "active", 0.7)["each"]["rod 1"]["factor"] == [None, None, None]
    promises = guarantees(part, part, grid_of(), (0.7,), 0, trials=80)
    assert broken(promises, "active", 0.7)[USED]["rod 1"] == [None, None, None]


def test_one_tap_of_a_class_gives_no_interval():
    """Neither of decisions, with all that is possible as ends, nor of promises and of the curve of beliefs."""
    lone = table_of(repeats=1)
    data = reliability(lone, grid_of(), (0.7,), 0, trials=80, contacts=(1,))
    at = at_stopping(data, "active").sel(theta=0.7, counted="all", what=EVERYTHING)
    assert 0 < at.wrong < 1
    for name in ("wrong", "factor", "over_promise"):
        assert np.isnan([at[f"{name}_low"], at[f"{name}_high"]]).all(), name
    assert np.isnan(data.curve_right_low).all()
    promises = guarantees(lone, lone, grid_of(), (0.7,), 0, trials=80)
    assert np.isfinite(promises.wrong).any()
    assert np.isnan(promises.wrong_low).all()


def test_thresholds_that_nobody_reaches_leave_no_stopped_trial():
    """All trials still have their numbers."""
    data = reliability(
        table_of(skill=0.1), grid_of(), (0.999,), 0, trials=40, play=PlaySettings(deadline=2), contacts=()
    )
    at = at_stopping(data, "passive").sel(theta=0.999, what=EVERYTHING)

    assert at.fraction.sel(counted="stopped") == 0
    assert np.isnan(at.factor.sel(counted="stopped"))
    assert at.factor.sel(counted="all") > 0
    assert headline(data, "passive", 0.999)["factor"] == [None, None, None]
    promises = guarantees(
        table_of(skill=0.1), table_of(skill=0.1), grid_of(), (0.999,), 0, trials=40, play=PlaySettings(deadline=2)
    )
    assert np.isnan(promises.wrong.sel(what=EVERYTHING)).all()
    assert (promises.wrong.sel(what="rod 0") == 0).all()


def test_the_headline_says_the_numbers_of_the_dataset(data):
    """At the threshold next to the one asked for."""
    said = headline(data, "active", 0.93)
    at = at_stopping(data, "active").sel(theta=0.9)
    cell = at.sel(counted="stopped", what=EVERYTHING)

    assert said["theta"] == 0.9
    assert said["factor"] == [cell.factor.item(), cell.factor_low.item(), cell.factor_high.item()]
    assert said["all trials"]["wrong"][0] == at.wrong.sel(counted="all", what=EVERYTHING).item()
    assert said["each"]["rod 2"]["wrong"][0] == at.wrong.sel(counted="all", what="rod 2").item()
    assert said["used_up"] == data.used_up.sel(setting=(data.policy == "active") & (data.theta == 0.9)).item() > 0
    assert "Too few test taps" in said["few"]
    assert np.array(said["confusion"]).sum() == TRIALS
    json.dumps(said, allow_nan=False)


def test_the_same_seed_gives_the_same_numbers(data):
    """Trials and resamples."""
    again = reliability(
        table_of(),
        grid_of(),
        THETAS,
        3,
        trials=TRIALS,
        play=PlaySettings(deadline=DEADLINE, fixation=2),
        contacts=(1, 4),
    )
    xr.testing.assert_identical(data, again)


def test_bad_arguments_are_refused():
    """Each in a sentence."""
    table, grid = table_of(), grid_of()
    with pytest.raises(InputError, match="classes of the table do not match the grid of 6 x 2"):
        reliability(table, grid_of(L, 2), (0.5,), 0)
    with pytest.raises(InputError, match="thresholds below 1, got"):
        reliability(table, grid, (0.5, 1.0), 0)
    with pytest.raises(InputError, match="one resample and one tap are required, got 5 and contacts \\[0\\]"):
        reliability(table, grid, (0.5,), 0, contacts=(0,), resamples=5)
    with pytest.raises(InputError, match="there is nothing to decide"):
        decided_about(table_of(1, 1), grid_of(1, 1))
    with pytest.raises(InputError, match="thresholds between 0 and 1, got"):
        guarantees(table, table, grid, (0.0,), 0)
    with pytest.raises(InputError, match="hold different taps"):
        guarantees(table, table_of(repeats=3), grid, (0.5,), 0)


def test_bins_hold_what_is_counted():
    """By belief, of all and of each object; an object without a bin, of which no trial stopped, has none."""
    values, true, belief = np.arange(18.0).reshape(3, 6), np.array([0, 1, 1]), np.array([0.1, 0.3, 0.9])
    ends = np.full((3, reliability_module.BINS), np.inf)
    ends[0, :2], ends[2, 0] = (0.2, 0.4), 0.2
    sums, curve = np.zeros((2, 6)), np.zeros((3, reliability_module.BINS, 3))
    reliability_module._add(values, true, np.array([True, True, False]), belief, ends, sums, curve)
    assert sums.tolist() == values[:2].tolist()
    assert curve[0, :2].tolist() == [(values[0] + values[1])[:3].tolist(), [0, 0, 0]]
    assert not curve[1].any()
    assert curve[2, 0].tolist() == values[1, :3].tolist()
