"""What trials on fresh taps might have come to that ran out of them."""

import numpy as np
import pytest
from scattered_taps import table_of
from solidtouch.inference.trials.records import Farthest, endings, plan_trials
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.grid import ClassGrid
from solidtouch.models.settings import PlaySettings

DEADLINE = 60
SIZES = np.array([4.0, 9.0, 2.0, 2.0])


def grid_of(L=5, sizes=SIZES):
    members = tuple((f"object {m}",) for m in range(len(sizes)))
    known = None if np.isnan(sizes).any() else sizes
    return ClassGrid(np.arange(L) + 0.5, "mm", np.arange(L + 1.0), members, known, "" if known is None else "mm")


def test_the_worst_decision_is_the_one_that_errs_most():
    """In place and size; another object where sizes do not tell."""
    far = Farthest.on(grid_of())
    assert far.where.tolist() == [4, 4, 0, 0, 0]
    assert far.what.tolist() == [1, 2, 1, 1]
    assert Farthest.on(grid_of(sizes=np.array([3.0, 3.0]))).what.tolist() == [1, 0]
    assert Farthest.on(grid_of(sizes=np.full(3, np.nan))).what.tolist() == [1, 0, 0]
    assert Farthest.on(grid_of(L=1, sizes=SIZES[:1])) == (0, 0)
    assert Farthest.among(1, 3).where.tolist() == [0]
    assert Farthest.among(1, 3).what.tolist() == [1, 2, 0]


@pytest.mark.parametrize("theta_x", [0.0, 1.0])
def test_only_trials_that_were_cut_short_might_end_otherwise(theta_x):
    """At best they are right, as late and as sure as they are; at worst wrong, sure and late. Means lie between."""
    table = table_of()
    plan = plan_trials(table.pool, 300, 1, 1)
    trials = run_trials(
        table, plan, (0.5, 0.8, 0.99), play=PlaySettings(theta_x=theta_x, deadline=DEADLINE), seed=1, fresh=True
    )
    best, worst = endings(trials, plan, DEADLINE, Farthest.among(3, 2))

    cut = trials.used_up
    assert cut.any()
    assert not cut.all()
    for end in (best, worst):
        for before, after in zip(trials, end, strict=True):
            np.testing.assert_array_equal(before[~cut], after[~cut])
        assert end.stopped[cut].all()
    true = np.broadcast_to(plan.what[:, None], cut.shape)
    np.testing.assert_array_equal(best.what[cut], true[cut])
    np.testing.assert_array_equal(worst.what[cut], 1 - true[cut])
    np.testing.assert_array_equal(best.where[cut], trials.true_where[cut])
    assert (worst.where[cut] != trials.true_where[cut]).all()
    np.testing.assert_array_equal(best.taps, trials.taps)
    np.testing.assert_array_equal(best.belief, trials.belief)
    assert (worst.taps[cut] == DEADLINE).all()
    assert (worst.belief[cut] == 1).all()


def test_trials_on_more_taps_lie_between_the_endings():
    """Forty taps of a class, of which trials that are cut short know the first four: means lie within."""
    many = table_of(count=np.full((3, 2), 40))
    few = many._replace(pool=many.pool._replace(count=np.full((1, 3, 2), 4)))
    plan = plan_trials(few.pool, 2000, 1, 1)
    options = {"play": PlaySettings(theta_x=1.0, deadline=DEADLINE), "seed": 1, "fresh": True}
    trials, further = (run_trials(table, plan, (0.9,), **options) for table in (few, many))
    assert trials.used_up.mean() > 0.2
    assert not further.used_up.any()
    best, worst = endings(trials, plan, DEADLINE, Farthest.among(3, 2))
    wrong = [(one.what[:, 0] != plan.what).mean() for one in (best, further, worst)]
    taps = [one.taps.mean() for one in (best, further, worst)]
    assert wrong == sorted(wrong)
    assert taps == sorted(taps)
