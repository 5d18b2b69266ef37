"""Tuned exponents beside those of a right model: a test with its level, which finds planted dependence."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom
from slow_cases import slow_but
from solidtouch.analysis.audit.remedies import EXPONENT, FALLING, beside_right, make_remedies, no_change
from solidtouch.analysis.stats.right_exponent import (
    MOST_TAPS,
    SIMULATIONS,
    Tuned,
    check_simulations,
    compare_below,
    learned_beside,
    outside,
    right_sets,
    simulate_tuned,
)
from solidtouch.analysis.stats.right_model import Beside, drawn_set, drawn_taps
from solidtouch.analysis.tasks.crew import on_runner
from solidtouch.hardware.simulator.model_rig import draw_session
from solidtouch.inference.tuning.tempering import best_power, fit_tempered
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet, concatenate
from task_runners import through_pickle

B, J, N = 6, 4, 6
SETTINGS = FitSettings(bins=B)
CONTACTS = 5


def model_of(L=2, M=2, K=1, seed=0):
    """Histograms of a known truth."""
    counts = np.round(1e6 * np.random.default_rng(seed).dirichlet(np.ones(B), size=(L, M, K))).astype(np.int64) + 1
    grid = ClassGrid(np.arange(L) + 0.0, "mm", None, tuple((f"object {m}",) for m in range(M)))
    return HistogramModel(grid, np.arange(B + 1.0), "none", Preprocessing(J), counts, 0.0)


RIGHT = model_of()


def repeated(taps):
    """One sample of each tap, J times."""
    first = taps.dataset["taps"].isel(sample=[0] * J)
    return TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, first.values)))


def same(taps):
    """The first tap of each class again and again, as if a session knew no other."""
    own = taps.what * (1 + int(taps.where.max())) + taps.where.astype(int)
    _, first, number = np.unique(own, return_index=True, return_inverse=True)
    return TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, taps.taps[first[number]])))


def parts(seed, plant=lambda taps: taps, n=N, right=RIGHT):
    """A session that trains and one that tunes."""
    return tuple(plant(draw_session(right, n, 50 + seed, session)) for session in range(2))


def exponent(seed, plant=lambda taps: taps, n=N, right=RIGHT):
    """An exponent tuned on one session of another's model, beside those of a right model."""
    train, tune = parts(seed, plant, n, right)

    def tuned(sets):
        model = fit_model("histogram", sets[0], train.grid(), SETTINGS).model
        return [best_power(model, sets[1:], CONTACTS, seed).power]

    model = fit_model("histogram", train, train.grid(), SETTINGS).model
    found = simulate_tuned(model, [train, tune], tuned, 1, seed)
    return compare_below(tuned([train, tune])[0], found[:, 0])


@pytest.mark.slow
@pytest.mark.parametrize("data_sets", [5, pytest.param(120, marks=pytest.mark.slow)])
def test_the_test_has_its_level(data_sets):
    """Independent samples, models of their own: small p-values are as rare as uniform ones, but for ties."""
    p = np.array([exponent(seed, right=model_of(3, 2, seed=seed)).below for seed in range(data_sets)])
    for alpha in (0.05, 0.1, 0.2):
        assert binom.ppf(0.001, data_sets, alpha) <= (p <= alpha).sum() <= binom.ppf(0.999, data_sets, alpha)


def test_samples_that_are_copies_are_found():
    """One sample J times deserves a J-th of the exponent of J samples."""
    for seed in range(2):
        found = exponent(seed, repeated, 20, model_of(5, 3))
        assert outside(found)
        assert found.value < found.low <= found.median


@pytest.mark.slow
def test_taps_that_are_copies_are_found():
    """However often the same tap is counted, it is worth one: the saturation of a right model is larger."""
    train, tune = parts(1, n=20, right=model_of(5, 3))
    setting = Setting.of(bins=B, power="none")
    for planted, expected in ((tune, False), (same(tune), True)):
        made, _ = make_remedies(no_change(setting, train, train.grid()), train, [planted], CONTACTS, 0, lambda _: None)
        told = []
        found = beside_right(made, train, [planted], CONTACTS, 0, told.append)
        tuned = {one.name: one.beside for one in found if one.beside is not None}
        assert list(tuned) == [EXPONENT, FALLING]
        assert tuned[EXPONENT].saturation is None
        assert outside(tuned[FALLING].saturation) is expected
        assert tuned[FALLING].taps == 20
        assert sum(told) == SIMULATIONS
        assert [one._replace(beside=None) for one in found] == made
    # what is shown is what was tuned
    assert tuned[EXPONENT].power.value == made[1].setting.fit.power
    assert tuned[FALLING].saturation.value == made[2].setting.fit.saturation


@pytest.mark.slow
def test_remedies_are_tuned_anew_on_every_data_set():
    """Fitted to its training taps, tuned on its tuning taps, as `make_remedies` does."""
    train, tune = parts(2)
    setting = Setting.of(bins=B, power="none")
    made, _ = make_remedies(no_change(setting, train, train.grid()), train, [tune], CONTACTS, 3, lambda _: None)
    _, one, falling, *_ = beside_right(made, train, [tune], CONTACTS, 3, lambda _: None)

    def tuned(sets):
        again, _ = make_remedies(
            no_change(setting, sets[0], train.grid()), sets[0], sets[1:], CONTACTS, 3, lambda _: None
        )
        limit = again[2].setting.fit.saturation
        return again[1].setting.fit.power, again[2].setting.fit.power, MOST_TAPS if limit is None else limit

    expected = simulate_tuned(made[0].model, [train, tune], tuned, 3, 3).T
    limit = made[2].setting.fit.saturation
    values = made[1].setting.fit.power, made[2].setting.fit.power, MOST_TAPS if limit is None else limit
    found = one.beside.power, falling.beside.power, falling.beside.saturation
    for beside, value, column in zip(found, values, expected, strict=True):
        assert beside == compare_below(value, column)


def test_without_tuned_exponents_nothing_is_simulated():
    train, tune = parts(0)
    made, _ = make_remedies(
        no_change(Setting.of(bins=B), train, train.grid()), train, [tune], CONTACTS, 0, lambda _: None
    )
    told = []
    assert beside_right(made[:1], train, [tune], CONTACTS, 0, told.append) == made[:1]
    assert sum(told) == SIMULATIONS


def test_simulations_repeat_with_the_seed():
    """Data sets have as many taps of each class and session; other classes are left out."""
    train, tune = parts(0)
    model = fit_model("histogram", train, train.grid(), SETTINGS).model
    far = TapSet(tune.dataset.assign_coords(where=("tap", tune.where + 100, tune.dataset["where"].attrs)))

    def fingerprints(sets):
        assert len(sets) == 2
        for one, like in zip(sets, (train, tune), strict=True):
            np.testing.assert_array_equal(one.session, like.session)
            np.testing.assert_array_equal(one.what, like.what)
            np.testing.assert_array_equal(one.where, like.where)
        return [one.taps.ravel() @ np.sqrt(np.arange(one.taps.size)) for one in sets]

    told = []
    one, again, other = (
        simulate_tuned(model, [train, far, tune], fingerprints, 2, seed, 5, told.append) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, again)
    assert not np.isin(one, other).any()
    assert len(np.unique(one)) == 10
    assert told == [1] * 15


def test_where_tuning_fails_nothing_is_significant():
    """Without a pseudocount other taps are impossible in some data sets; these count for either side."""

    def never(sets):
        raise InputError("impossible")

    train, tune = parts(0)
    model = fit_model("histogram", train, train.grid(), SETTINGS).model
    found = simulate_tuned(model, [train, tune], never, 2, 0, 3)
    assert np.isnan(found).all()
    assert found.shape == (3, 2)
    none = compare_below(0.01, found[:, 0])
    assert not outside(none)
    assert Tuned(none, None, 6, 3).sentence == "Exponent 0.01; a correct model could not be simulated."
    few = compare_below(0.01, np.array([np.nan, *np.full(18, 0.5)]))
    assert few.below == pytest.approx(2 / 20)
    assert not outside(few)


@pytest.mark.parametrize("S", [19, 39, 50, 99])
def test_what_is_outside_is_below_the_interval(S):
    """Just where the test at 5% rejects, also among ties; the share of right models there is at most 5%."""
    simulated = np.random.default_rng(S).permutation(np.repeat(np.arange(1.0, S + 1), 2)[:S])
    rejected = 0
    for value in np.append(simulated, [0.5, 1.5, 2.5, S + 1]):
        found = compare_below(value, simulated)
        assert outside(found) == (value < found.low)
        assert found.high == simulated.max()
        assert found.below == (1 + (simulated <= value).sum()) / (S + 1)
        rejected += outside(found)
    assert rejected >= 1
    assert (simulated < found.low).sum() <= 0.05 * (S + 1)


def test_words_say_whether_the_test_rejects():
    low, inside = Beside(0.42, 0.93, 0.81, 1.0, 1.0, 0.05), Beside(MOST_TAPS, MOST_TAPS, 12.3, MOST_TAPS, 1.0, 1.0)
    assert Tuned(low, inside, 20, 19).sentence == (
        "Exponent 0.42; a correct model on 20 training taps per class gives 0.93 (0.81 to 1): the exponent is "
        "lower, by a Monte Carlo test at 5% (p = 0.05). Saturation no limit; a correct model on 20 training taps "
        "per class gives no limit (12 to no limit): it does not differ significantly from a correct model."
    )
    assert "on 1 training tap per class" in Tuned(low, None, 1, 19).sentence


@pytest.mark.parametrize("in_states", [False, True])
def test_samples_are_shuffled_between_taps_of_a_class(in_states):
    """Of each taxel and time alone; in a model with states within a session. Nothing else is touched."""
    sets = [draw_session(model_of(3, 2, K=2), N, 0, session) for session in range(2)]
    model = fit_model("session" if in_states else "histogram", concatenate(sets), sets[0].grid(), SETTINGS).model
    shuffled = right_sets(model, sets, np.random.default_rng(0))
    together = shuffled if in_states else [concatenate(shuffled)]
    for before, after in zip(sets if in_states else [concatenate(sets)], together, strict=True):
        cell = before.where * 10 + before.what
        for c in np.unique(cell):
            one, other = before.taps[cell == c], after.taps[cell == c]
            np.testing.assert_array_equal(np.sort(one, axis=0), np.sort(other, axis=0))
            assert not np.array_equal(one, other)
            assert not (one[:, None] == other[None]).all(axis=(2, 3)).all()
    for before, after in zip(sets, shuffled, strict=True):
        assert before.dataset.drop_vars("taps").identical(after.dataset.drop_vars("taps"))
    if not in_states:
        assert not np.array_equal(np.sort(shuffled[0].taps, axis=0), np.sort(sets[0].taps, axis=0))


def test_other_models_draw_taps_of_their_own():
    sets = [draw_session(model_of(3, 2), N, 0)]
    profile = fit_model("profile", sets[0], sets[0].grid(), SETTINGS).model
    (drawn,) = right_sets(profile, sets, np.random.default_rng(0))
    assert not np.isin(drawn.taps, sets[0].taps).any()


def test_taps_of_a_session_are_in_one_state():
    """Of a model with states: all of a session, and not all sessions in the same."""
    base = model_of(3, 2, seed=1)
    states = fit_model("session", draw_session(base, 5, 0), base.grid, FitSettings(bins=B, offset_sd=3.0)).model.states
    model = replace(base, counts=np.where(np.arange(B) == 2, 10**9, 0) + 0 * base.counts, states=states)
    assert len(states.gain) > 1
    sessions = concatenate([draw_session(base, 5, 0, session) for session in range(8)])
    drawn = drawn_set(model, sessions, np.random.default_rng(0))
    means = [drawn.taps[drawn.session == session] for session in range(8)]
    assert np.std([one.mean() for one in means]) > 3 * np.mean([one.std() for one in means]) / np.sqrt(5 * J)
    where, what = sessions.indices(model.grid)
    alike = drawn_taps(model, where, what, np.zeros(len(where), dtype=np.intp), np.random.default_rng(0))
    assert alike.shape == sessions.taps.shape


@pytest.mark.parametrize("name", slow_but(["histogram"], ("histogram", "gaussian")))
def test_learned_powers_stand_beside_those_of_a_right_model(name):
    """Sessions left out in turn, as `fit --power learned` does; copies of a sample are found."""
    both = concatenate(parts(3, n=20))
    settings = SETTINGS.changed(power=f"learned:{CONTACTS}")
    more = {} if name == "histogram" else {"simulations": 19}
    simulations, found = more.get("simulations", SIMULATIONS), []
    for taps in (both, repeated(both)):
        fitted, learned = fit_tempered(name, taps, taps.grid(), settings)
        told = []
        found.append(learned_beside(name, fitted.model, taps, settings, learned.taps, progress=told.append, **more))
        assert found[-1].power.value == learned.power
        assert (found[-1].taps, found[-1].simulations, sum(told)) == (40, simulations, simulations)
    if name == "histogram":
        assert [outside(one.power) for one in found] == [False, True]
    elsewhere = learned_beside(name, fitted.model, taps, settings, learned.taps, crew=on_runner(through_pickle), **more)
    assert elsewhere == found[-1]
    assert re.search("a correct model on 40 training taps per class gives", found[0].sentence)


def test_too_few_simulations_are_refused():
    check_simulations(SIMULATIONS)
    with pytest.raises(InputError, match="--simulations must be 0 or at least 19, got 18"):
        check_simulations(SIMULATIONS - 1)
