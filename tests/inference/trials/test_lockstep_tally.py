"""Counts of trials in step are those of compiled trials under the strategies that both know."""

import numpy as np
import pytest
from solidtouch.inference.moves.control import fixation, passive, random_place
from solidtouch.inference.trials import lockstep_tally
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.lockstep_tally import tally_policy, trials_of
from solidtouch.inference.trials.records import TapTable, plan_trials
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.trials.tally import tally_trials
from solidtouch.models.errors import InputError
from solidtouch.models.grid import tap_pool
from solidtouch.models.settings import PlaySettings

L, M, N, TRIALS = 5, 3, 90, 70
THETAS = (0.9, 0.35, 1.0, 0.6)
RULE = {"border": "clamp", "deadline": 15, "seed": 4, "first_stream": 9}


@pytest.fixture(scope="module")
def table():
    rng = np.random.default_rng(0)
    where, what = rng.integers(L, size=N), rng.integers(M, size=N)
    log_likelihood = rng.normal(scale=1.2, size=(N, L, M))
    log_likelihood[np.arange(N), where, what] += 0.8
    return TapTable(log_likelihood, tap_pool(where, what, (L, M)), np.full((L, M), -np.log(L * M)))


def assert_same(found, expected):
    for name, value in expected._asdict().items():
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize(("policy", "theta_x"), [(passive(), 1.0), (fixation(3), 0.0), (fixation(3, 0.5), 0.5)])
@pytest.mark.parametrize("where", [None, 2])
def test_counts_are_those_of_compiled_trials(table, monkeypatch, policy, theta_x, where):
    """However they are cut into pieces, from any start and stream; progress counts them all."""
    monkeypatch.setattr(lockstep_tally, "_AT_ONCE", 32)
    told = []
    found = tally_policy(table, THETAS, TRIALS, policy, where=where, progress=told.append, **RULE)

    assert_same(
        found,
        tally_trials(
            table,
            THETAS,
            TRIALS,
            play=PlaySettings(theta_x=theta_x, border=RULE["border"], deadline=RULE["deadline"]),
            fixation=3,
            where=where,
            workers=1,
            seed=RULE["seed"],
            first_stream=RULE["first_stream"],
        ),
    )
    assert [counts.trials for counts in told] == [32, 64, TRIALS]


def test_strategies_at_random_do_not_depend_on_the_pieces(table, monkeypatch):
    whole = tally_policy(table, THETAS, TRIALS, random_place(), **RULE)
    monkeypatch.setattr(lockstep_tally, "_AT_ONCE", 11)

    assert_same(tally_policy(table, THETAS, TRIALS, random_place(), **RULE), whole)


def test_a_record_is_decided_at_every_threshold(table):
    plan = plan_trials(table.pool, TRIALS, 1, 2)
    expected = run_trials(table, plan, THETAS, play=PlaySettings(theta_x=0.0, deadline=15), seed=1)
    found = trials_of(play(table, plan, fixation(2), deadline=15, seed=1), THETAS)
    for name, value in expected._asdict().items():
        np.testing.assert_allclose(getattr(found, name), value, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize(("trials", "thresholds"), [(0, [0.5]), (5, []), (5, [np.nan])])
def test_what_makes_no_sense_is_refused(table, trials, thresholds):
    with pytest.raises(InputError, match="trials must be at least 1 and thresholds not NaN"):
        tally_policy(table, thresholds, trials, passive())
