"""Analysis of a model that carries a state of the episode speaks of objects, not of hypotheses."""

from types import SimpleNamespace

import numpy as np
import pytest
from numbered_taps import NumberedTaps
from slow_cases import slow_but
from solidtouch.analysis.experiment.trial_check import DEVICES, compare_trials
from solidtouch.analysis.reproduce.examples import belief_cases
from solidtouch.analysis.stats.contacts import accuracy
from solidtouch.inference.engines.compiled import FilterEngine
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials.records import plan_trials, tap_table

L, M, S, N = 4, 3, 2, 30


@pytest.fixture
def model():
    rng = np.random.default_rng(0)
    prior = rng.dirichlet(np.ones(L * S * M)).reshape(L, S * M)
    return NumberedTaps(2 * rng.normal(size=(N, L, S * M)), np.log(prior), M)


@pytest.fixture
def taps(model):
    where, what = np.indices((L, M)).reshape(2, -1)
    return model.taps_of(np.resize(where, N), np.resize(what, N))


def test_contacts_are_judged_by_sums_over_states():
    """Class (0, 1) leads over states although no hypothesis of it does, in what and jointly."""
    belief = np.zeros((L, S, M))
    belief[0, :, 1] = 0.3
    belief[0, 1, 2] = 0.4
    with np.errstate(divide="ignore"):
        log_likelihood = np.log(belief).reshape(1, L, S * M)
    model = NumberedTaps(log_likelihood, np.full((L, S * M), -np.log(L * S * M)), M)
    (row,) = accuracy(tap_table(model, model.taps_of([0], [1])), seed=0, contacts=(1,))

    assert row.hits.tolist() == [[1.0, 1.0, 1.0]]


def test_contacts_share_the_state():
    """A tap for object 1 in state 0 and one for it in state 1 are no evidence for it where the state stays."""
    likelihood = np.full((2, L, S, M), 0.1)
    likelihood[0, 0, 0, 1] = likelihood[1, 0, 1, 1] = 1.0
    likelihood[:, 0, 0, 2] = 0.6
    model = NumberedTaps(np.log(likelihood).reshape(2, L, S * M), np.full((L, S * M), -np.log(L * S * M)), M)
    one, two = accuracy(tap_table(model, model.taps_of([0, 0], [1, 1])), seed=0, contacts=(1, 2))

    assert one.hits.tolist() == [[1.0, 1.0, 1.0]]
    assert two.hits.tolist() == [[0.0, 1.0, 0.0]]


def test_taps_that_no_state_can_give_count_as_wrong():
    model = NumberedTaps(np.full((1, L, S * M), -np.inf), np.full((L, S * M), -np.log(L * S * M)), M)

    (row,) = accuracy(tap_table(model, model.taps_of([3], [2])), seed=0, contacts=(1,))

    assert not row.hits.any()


@pytest.mark.parametrize("border", slow_but(["uniform"], [border for border in BORDERS if border != "prior"]))
def test_trials_with_states_are_episodes(model, taps, border):
    """On every device, under every border that knows states."""
    table = tap_table(model, taps)
    plan = plan_trials(table.pool, 12, 0, fixation=1)
    found = compare_trials(FilterEngine(model, border), table, taps, plan, border, 9, 1e-9)

    assert set(found) == set(DEVICES)
    for differences in found.values():
        assert (differences.decisions, differences.near_ties) == (0, 0)
        assert differences.belief.shape == (2, 12 * 13)
        np.testing.assert_allclose(*differences.belief, rtol=0, atol=1e-10)


def test_example_episodes_show_objects(model, taps):
    """Beliefs and prior of the figure have the shape of the classes and sum to one."""
    study = SimpleNamespace(model=model, test=taps, table=tap_table(model, taps))
    clear, ambiguous = belief_cases(study, FilterEngine(model), SimpleNamespace(seed=0))

    for case in (clear, ambiguous):
        assert case.beliefs.shape == (20, L, M)
        assert case.prior.shape == (L, M)
        np.testing.assert_allclose([*case.beliefs.sum(axis=(1, 2)), case.prior.sum()], 1.0)
