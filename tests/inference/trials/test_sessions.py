"""Trials that stay in one of several test sessions."""

import numpy as np
import pytest
from array_device import ARRAYS
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import perceive
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.lockstep_tally import trials_of
from solidtouch.inference.trials.records import TapTable, plan_trials, tap_table, trial_uniforms
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.selections import resampled_pools, sessions_in_words, thinned_pools
from solidtouch.models.errors import InputError
from solidtouch.models.grid import FEW_TAPS, tap_pool
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.settings import PlaySettings

L, M, S = 4, 3, 3
THETAS = (0.5, 0.9, 1.0)


def table_of(mixed=False, misled=()):
    """Sessions of unequal size, some without some class; taps of those in `misled` all speak for the next object."""
    rng = np.random.default_rng(1)
    count = rng.integers(0, 5, size=(S, L, M)) * np.array([1, 2, 1])[:, None, None]
    session, where, what = np.repeat(np.argwhere(count >= 0), count.ravel(), axis=0).T
    values = rng.normal(size=(len(where), L, M))
    said = np.where(np.isin(session, misled), (what + 1) % M, what)
    values[np.arange(len(where)), :, said] += 8.0 if misled else 0.7
    pool = tap_pool(where, what, (L, M), 0 if mixed else session)
    prior = 0.1 * rng.normal(size=(L, M))  # so that no two classes tie
    return TapTable(values, pool, prior - np.logaddexp.reduce(prior.ravel()), session=session + 5)


@pytest.mark.parametrize(
    "border", [*(pytest.param(b, marks=pytest.mark.slow) for b in ("uniform", "clamp")), "circular"]
)
def test_every_route_plays_the_same_trials(border):
    """Loops, arrays and lockstep."""
    table = table_of()
    plan = plan_trials(table.pool, 60, 3, 1)
    assert set(plan.session.tolist()) == {0, 1, 2}
    settings = PlaySettings(theta_x=0.3, border=border, deadline=12)
    loops, arrays = (run_trials(table, plan, THETAS, play=settings, seed=8, device=at) for at in ("cpu", ARRAYS))
    steps = trials_of(play(table, plan, fixation(1, 0.3), border=border, deadline=12, seed=8), THETAS)
    for name in loops._fields:
        for other in (arrays, steps):
            np.testing.assert_allclose(getattr(other, name), getattr(loops, name), atol=1e-12, err_msg=name)


def test_trials_in_a_session_are_those_of_its_taps_alone():
    """Whatever the other sessions hold: the same streams and starts on a table of one session."""
    table = table_of()
    plan = plan_trials(table.pool, 200, 2, 1)
    played = run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.3, deadline=9), seed=4)
    for s in range(S):
        rows, own = np.flatnonzero(plan.session == s), np.flatnonzero(table.session == s + 5)
        alone = tap_pool(*np.argwhere(np.ones((L, M)))[cell_of(table, own)].T, (L, M))
        one = TapTable(table.log_likelihood[own], alone, table.log_prior)
        part = type(plan)(*(column[rows] for column in plan))._replace(session=0 * rows)
        expected = run_trials(one, part, THETAS, play=PlaySettings(theta_x=0.3, deadline=9), seed=4)
        for name in played._fields:
            np.testing.assert_array_equal(getattr(played, name)[rows], getattr(expected, name), err_msg=name)


def cell_of(table, taps):
    """Class l M + m of some taps."""
    cell = np.empty(len(table.log_likelihood), int)
    for l, m in np.ndindex(L, M):
        cell[table.pool.taps(l, m)] = l * M + m
    return cell[taps]


def test_a_session_that_misleads_has_its_own_errors():
    """All its trials are wrong and no others; with the sessions mixed most trials would be right."""
    options = {"play": PlaySettings(theta_x=1.0, deadline=30)}
    apart, mixed = table_of(misled=(2,)), table_of(mixed=True, misled=(2,))
    plan = plan_trials(apart.pool, 500, 0)
    wrong = run_trials(apart, plan, (1.0,), **options).what[:, 0] != plan.what
    np.testing.assert_array_equal(wrong, plan.session == 2)
    assert 0.2 < wrong.mean() < 0.5
    plan = plan_trials(mixed.pool, 500, 0)
    assert (run_trials(mixed, plan, (1.0,), **options).what[:, 0] != plan.what).mean() < 0.1


@pytest.mark.parametrize("pools", [resampled_pools, thinned_pools])
def test_a_session_left_out_starts_no_trial(pools):
    """The others are as they were."""
    table = table_of()
    whole, *others = pools(table, S, 0)
    for left_out, pool in enumerate(others):
        assert not pool.count[left_out].any()
        kept = np.arange(S) != left_out
        np.testing.assert_array_equal(pool.count[kept], whole.count[kept])
        assert left_out not in plan_trials(pool, 200, 0).session


def test_a_plan_with_another_session_is_refused():
    table = table_of()
    plan = plan_trials(table.pool, 3, 0)
    with pytest.raises(InputError, match="Trial 1 stays in session 3 of 3"):
        run_trials(table, plan._replace(session=np.array([0, 3, 1])), THETAS)


def test_trials_are_episodes_on_a_rig_in_their_session(make_taps):
    """Taps of a recording: `perceive` on a replay of the recorded session."""
    taps = make_taps(sessions=3, repeats=FEW_TAPS)
    train, test = taps.select(taps.session == 0), taps.select(taps.session > 0)
    model = fit(train, train.grid())
    table = tap_table(model, test)
    plan = plan_trials(table.pool, 12, 1, 1)
    assert {table.recorded_session(s) for s in plan.session.tolist()} == {1, 2}
    settings = PlaySettings(theta_x=0.2, deadline=6)
    played = run_trials(table, plan, (0.9,), play=settings, seed=1)
    for i, (where, what, point, stream, session) in enumerate(zip(*plan, strict=True)):
        chance = iter(trial_uniforms(1, int(stream), 6).tolist())
        rig = ReplayRig(test, model.grid, int(where), int(what), chance, session=table.recorded_session(session))
        episode = perceive(rig, make_engine("numpy", model), 0.9, fixation(int(point), 0.2), 6)
        decided = played.taps[i, 0], played.what[i, 0], played.where[i, 0], played.true_where[i, 0]
        assert decided == (episode.taps, episode.what, episode.where, rig.where_index)


def test_what_is_said_of_sessions(make_taps):
    """One session, several with enough taps, several with too few, and sessions that hold other classes."""

    def said(session=lambda i: i // 12 % 2, repeats=2 * FEW_TAPS):
        taps = make_taps(sessions=1, repeats=repeats)
        dataset = taps.dataset.copy(deep=True)
        dataset["session"] = dataset["session"].copy(data=session(np.arange(len(taps))))
        model = fit(taps, taps.grid())
        return sessions_in_words(tap_table(model, type(taps)(dataset)))

    assert not said(lambda i: 0 * i)
    assert said() == "Each trial stays in one of the 2 test sessions."
    assert "of all 2 test sessions, as a class has fewer than 10 taps in one, so" in said(repeats=FEW_TAPS)
    assert "of all 2 test sessions, as they hold other classes, so" in said(lambda i: i % 12 // 6)
