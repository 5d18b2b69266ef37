"""The chosen fixation point: planted best positions, held-out taps, and the rule for ties."""

import numpy as np
import pytest
from scipy.stats import t
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.trials.records import plan_trials, tap_table
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.tuning.fixation import choice, choose_fixation
from solidtouch.inference.tuning.held_out import (
    RESAMPLES,
    decision_error,
    held_out,
    over_parts,
    repeated_means,
    repeated_models,
    with_repeats,
)
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet, concatenate

L, M, J, B = 6, 3, 2, 8
GRID = ClassGrid(1.5 * np.arange(L), "mm", None, tuple((f"object {m}",) for m in range(M)))


def planted(best, sessions=3, repeats=12, width=0.8):
    """Taps of which the first taxel tells places apart and the second objects, best at one place."""
    contrast = np.exp(-((np.arange(L) - best) ** 2) / (2 * width**2))
    table = np.zeros((L, M, 2, B))
    for l in range(L):
        for m in range(M):
            table[l, m, 0, l] = 1.0
            table[l, m, 1] = 1.0 / B
            table[l, m, 1, m] += 2 * contrast[l]
    table += 0.02
    edges = np.arange(B + 1.0)
    parts = [draw_taps(GRID, table, edges, Preprocessing(samples=J), repeats, 1, s) for s in range(sessions)]
    taps = concatenate(parts).dataset
    within = np.random.default_rng(sessions).uniform(-0.4, 0.4, taps["taps"].shape)  # so that no two are the same
    return TapSet(taps.assign(taps=taps["taps"] + within))


def fitted(taps, grid):
    return fit(taps, grid, bins=B, pseudocount=0.5, power="none")


@pytest.mark.parametrize(("best", "sessions", "passive"), [(1, 1, False), (1, 3, True), (4, 1, True), (4, 3, False)])
def test_a_planted_best_position_is_found(best, sessions, passive):
    """By trials that aim for it and by trials that stand there, from sessions and from halves of one."""
    parts = held_out(planted(best, sessions, repeats=40, width=0.5), GRID, fitted)
    found = choose_fixation(
        parts, PlaySettings(threshold=0.9, passive=passive, deadline=25, border="clamp"), trials=500
    )

    assert found.best == best
    assert found.chosen == best
    assert found.excess.mean[best] == 0
    assert found.errors.shape == (max(2, sessions), L)


def test_every_part_is_met_by_a_model_without_its_taps():
    """Each session by that of the others, each half by that of the other; together they are all taps."""
    taps = planted(2)
    parts = held_out(taps, GRID, fitted)
    assert parts.by_session
    assert sum(len(part.taps) for part in parts.parts) == len(taps)
    for s, part in enumerate(parts.parts):
        assert np.unique(part.taps.session).tolist() == [s]
        np.testing.assert_array_equal(part.model.counts, fitted(taps.select(taps.session != s), GRID).counts)
    single = taps.select(taps.session == 0)
    halves = held_out(single, GRID, fitted)
    assert not halves.by_session
    assert "halved" in halves.sentence
    assert [len(part.taps) for part in halves.parts] == [len(single) // 2] * 2
    counts = [part.model.counts.sum() for part in halves.parts]
    assert sum(counts) == len(single) * J * 2


def test_taps_that_stand_in_two_sessions_are_not_held_out():
    taps = planted(2, sessions=1)
    again = TapSet(taps.dataset.assign_coords(session=("tap", np.ones(len(taps), np.int64))))
    with pytest.raises(InputError, match="also occur in the training taps"):
        held_out(concatenate([taps, again]), GRID, fitted)


def test_errors_are_those_of_trials_on_the_part():
    """At each position, by trials that anyone can play again; the reaction times as well."""
    parts = held_out(planted(4), GRID, fitted)
    found = choose_fixation(parts, PlaySettings(threshold=0.8, deadline=20), trials=150, seed=5)
    for f, l in ((0, 0), (2, 4)):
        part = parts.parts[f]
        table = tap_table(part.model, part.taps)
        plan = plan_trials(table.pool, 150, 5, l, first_stream=150 * f)
        trials = run_trials(table, plan, (0.8,), play=PlaySettings(theta_x=0.0, deadline=20), seed=5, fresh=True)
        assert found.errors[f, l] == decision_error(GRID, trials.what[:, 0], plan.what).mean()
        assert found.taps[f, l] == trials.taps.mean()


def test_of_equal_positions_the_nearest_to_the_middle_is_chosen():
    """The lower one of two; also where the least error lies elsewhere by luck."""
    even = np.zeros((2, 6, 40))
    assert choice(even, even, np.arange(6), 6, np.zeros((3, 6))).chosen == 2
    assert choice(even[:, :5], even[:, :5], np.arange(5), 5, np.zeros((3, 5))).chosen == 2
    rng = np.random.default_rng(0)
    noisy = np.tile(rng.normal(size=(2, 1, 400)), (1, 6, 1)) + rng.normal(size=(2, 6, 400))
    noisy -= noisy.mean(axis=-1, keepdims=True)
    noisy[:, 0] -= 0.01
    found = choice(noisy, noisy, np.arange(6), 6, 0.05 * rng.normal(size=(9, 6)))
    assert (found.best, found.chosen) == (0, 2)
    assert found.alike.all()


def test_a_position_that_is_surely_better_is_chosen_whatever_the_middle():
    """Its advantage is the same in every session, though sessions differ by much more."""
    session = np.array([0.1, 0.9, 2.0])[:, np.newaxis, np.newaxis]
    errors = session + np.where(np.arange(6) == 5, 0.0, 0.05)[:, np.newaxis] + np.zeros((3, 6, 10))
    errors += np.random.default_rng(1).normal(size=(3, 1, 10)) * 0.01
    found = choice(errors, errors, np.arange(6), 6, errors.mean(axis=-1))
    assert found.chosen == 5
    assert found.error.error[5] > 0.4
    assert found.excess.error[0] < 1e-6


def test_standard_errors_are_those_of_repeats(rng):
    """The interval is that of Student's t, and goes no lower than values can."""
    values, drawn = (
        rng.normal(size=(2, 3, 50)) + np.array([6.0, -3.0])[:, np.newaxis, np.newaxis],
        rng.normal(size=(9, 3)),
    )
    found = over_parts(values, drawn, -1.0)
    np.testing.assert_allclose(found.mean, values.mean(axis=(0, 2)))
    np.testing.assert_allclose(found.error, drawn.std(axis=0, ddof=1))
    np.testing.assert_allclose((found.high - found.mean) / found.error, t.ppf(0.975, 8))
    np.testing.assert_allclose(found.low, np.maximum(found.mean - found.error * t.ppf(0.975, 8), -1.0))


@pytest.mark.parametrize("sessions", [2, 3, 5, 12])
def test_a_repeat_leaves_sessions_out_of_tests_and_of_models(sessions):
    """Of two sessions models stay; of more than ten some are left out together. The variance is the jackknife's."""
    taps = planted(2, sessions)
    parts = held_out(taps, GRID, fitted)
    repeated = with_repeats(parts, taps, fitted)
    G = min(sessions, 10)
    group = np.arange(sessions) % G

    def tapped(table, stream):
        return (np.full((1, 4), table.log_likelihood.sum() + stream),)

    kept = np.empty(G)
    for g in range(G):
        means = []
        for f in np.flatnonzero(group != g):
            without = np.isin(group, [f % G, g]) if sessions > 2 else np.arange(sessions) == f
            model = fitted(taps.select(~without[taps.session]), GRID)
            means.append(tap_table(model, taps.select(taps.session == f)).log_likelihood.sum() + 7 * f)
        kept[g] = np.mean(means)
    (drawn,) = repeated_means(repeated, tapped, 7, 0)

    if sessions > 2:
        assert repeated_models(parts) == len({id(model) for one in repeated.repeats for _, model in one})
    else:
        assert repeated is parts
    assert drawn.shape == (G, 1)
    np.testing.assert_allclose(drawn[:, 0] - drawn.mean(), (G - 1) / np.sqrt(G) * (kept - kept.mean()), atol=1e-9)
    np.testing.assert_allclose(drawn.var(ddof=1), (G - 1) / G * ((kept - kept.mean()) ** 2).sum())
    assert repeated.played == sessions + sum(len([f for f in group if f != g]) for g in range(G))


def test_models_stay_where_those_of_fewer_sessions_lack_a_class():
    """That is said; so it is where no model can be fitted."""
    taps = planted(2, sessions=3)
    lacking = taps.select((taps.indices(GRID)[0] != 0) | (taps.session != 1))
    parts = held_out(lacking, GRID, fitted)
    assert with_repeats(parts, lacking, fitted).repeats == parts.repeats
    assert "models as they are" in with_repeats(parts, lacking, fitted).sentence

    def refused(_taps, _grid):
        raise InputError("Not with so few.")

    whole = held_out(taps, GRID, fitted)
    assert "models as they are" in with_repeats(whole, taps, refused).sentence
    assert with_repeats(whole, taps, fitted).sentence == whole.sentence


def test_halves_have_no_repeats():
    """Their taps are resampled."""
    taps = planted(2, sessions=1)
    parts = held_out(taps, GRID, fitted)
    assert with_repeats(parts, taps, fitted) is parts
    assert (repeated_models(parts), parts.played) == (0, 2 * (1 + RESAMPLES))


def test_taps_of_halves_are_drawn_anew_and_not_trials():
    """A decision after one tap at one place: the standard error is that of the taps' means, whatever the trials."""
    taps = planted(2, sessions=1, repeats=24)
    parts = held_out(taps.select(taps.indices(GRID)[0] == 2), GRID, fitted)
    for part in parts.parts:
        assert (part.table.pool.count[:, 2] == 12).all()

    def play(table, stream, trials=4000):
        plan = plan_trials(table.pool, trials, 3, where=2, first_stream=stream)
        played = run_trials(table, plan, (0.0,), play=PlaySettings(theta_x=1.0), seed=3, fresh=True)
        return ((played.what != plan.what[:, np.newaxis]).T.astype(float),)

    (drawn,) = repeated_means(parts, play, 4000, 0)
    variance = 0.0
    for part in parts.parts:
        pool = part.table.pool
        for m in range(M):
            own = pool.taps(2, m)
            belief = np.exp(part.table.log_likelihood[own] + part.table.log_prior)
            wrong = belief.sum(axis=1).argmax(axis=1) != m
            variance += wrong.var(ddof=1) / 12 / (2 * M) ** 2
    assert drawn.shape == (RESAMPLES, 1)
    np.testing.assert_allclose(drawn.std(ddof=1), np.sqrt(variance), rtol=0.35)


def test_positions_without_passive_taps_are_not_tried():
    """They hold NaN, and are not chosen."""
    taps = planted(4)
    taps = taps.select((taps.indices(GRID)[0] != 0) | (taps.session != 1))
    found = choose_fixation(
        held_out(taps, GRID, fitted), PlaySettings(threshold=0.8, passive=True, deadline=10), trials=50
    )
    assert np.isnan(found.error.mean[0])
    assert np.isnan(found.errors[:, 0]).all()
    assert not found.alike[0]
    assert np.isfinite(found.error.mean[1:]).all()


@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (1, 1)])
def test_one_place_and_one_object_have_a_fixation_point(make_taps, shape):
    """The only one, or the middle where nothing can go wrong."""
    taps = make_taps(L=shape[0], M=shape[1], repeats=4)
    grid = taps.grid()
    found = choose_fixation(held_out(taps, grid, fitted), PlaySettings(threshold=0.9, deadline=10), trials=40)
    assert found.chosen == (shape[0] - 1) // 2
    if shape[1] == 1:
        assert found.error.mean.tolist() == [0] * shape[0]


def test_errors_have_the_unit_that_is_asked_for():
    """Sizes, or P(wrong) where there are none or it is asked for."""
    sized = ClassGrid(np.arange(2.0), "mm", None, (("a",), ("b",)), np.array([2.0, 6.0]), "mm")
    assert decision_error(sized, [0, 1, 1], [0, 0, 1]).tolist() == [0, 4, 0]
    assert decision_error(sized, [0, 1, 1], [0, 0, 1], wrong=True).tolist() == [0, 1, 0]
    assert decision_error(GRID, [0, 2], [0, 0]).tolist() == [0, 1]


def test_the_same_seed_gives_the_same_choice():
    parts = held_out(planted(4), GRID, fitted)
    first, second, other = (
        choose_fixation(parts, PlaySettings(threshold=0.8, deadline=9), trials=60, seed=s) for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.errors, second.errors)
    assert not np.array_equal(first.errors, other.errors)
