"""Passive and active trials of one plan: what they share, what their difference is, and when nothing can differ."""

import tracemalloc

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.experiment import policies
from solidtouch.analysis.experiment.policies import make_plans, most_trials, play_policies, resamples_of
from solidtouch.analysis.experiment.settings import ExperimentSettings
from solidtouch.analysis.stats import metrics
from solidtouch.inference.trials import records
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.grid import ClassGrid, tap_pool
from solidtouch.models.settings import PlaySettings

L, M, SYMBOLS = 5, 3, 6
FIXATION = 2
HOLES = [(0, 1), (3, 0), (3, 2), (4, 1)]
"""Classes without a test tap."""


@pytest.fixture
def grid():
    return ClassGrid(1.0 * np.arange(L), "mm", None, tuple((f"object {m}",) for m in range(M)))


def table_of(seed=0, taps=9, holes=(), sharpness=0.5):
    """Taps of one symbol each, drawn from the table that the likelihoods are those of."""
    rng = np.random.default_rng(seed)
    chances = rng.dirichlet(np.full(SYMBOLS, sharpness), size=(L, M)) * 0.97 + 0.03 / SYMBOLS
    cells = [(l, m) for l in range(L) for m in range(M) if (l, m) not in holes]
    where, what = np.repeat(cells, taps, axis=0).T
    symbols = np.array([rng.choice(SYMBOLS, p=chances[l, m]) for l, m in zip(where, what, strict=True)])
    log_likelihood = np.log(chances)[:, :, symbols].transpose(2, 0, 1).copy()
    return TapTable(log_likelihood, tap_pool(where, what, (L, M)), np.full((L, M), -np.log(L * M)))


def settings_of(**options):
    play = PlaySettings(border="clamp", threshold=options.pop("threshold", 0.2), deadline=options.pop("deadline", 100))
    return ExperimentSettings(**{"trials": 30, "thresholds": (0.2, 0.9), "play": play} | options)


@pytest.mark.parametrize("holes", [(), HOLES], ids=["whole grid", "holes"])
def test_active_trials_are_the_passive_ones(holes):
    """All of them at the default fixation point, the first of each position at the others, in equal numbers."""
    pool = table_of(holes=holes).pool
    starts, others, compared = make_plans(pool, 7, 0, FIXATION, acts=True)
    by_stream = {stream: (l, m) for l, m, _, stream, _ in zip(*starts, strict=True)}

    assert np.bincount(starts.where).tolist() == [7] * L
    assert set(starts.fixation) == {FIXATION}
    assert len(by_stream) == 7 * L
    assert sorted(set(others.fixation)) == [l for l in range(L) if l != FIXATION]
    for fixation in set(others.fixation):
        chosen = others.fixation == fixation
        np.testing.assert_array_equal(others.stream[chosen], starts.stream[compared])
        assert np.bincount(others.where[chosen]).tolist() == [2] * L
    for l, m, _, stream, _ in zip(*others, strict=True):
        assert by_stream[stream] == (l, m)
    assert all(pool.per_class[l, m] for l, m in by_stream.values())


@pytest.mark.parametrize("holes", [(), HOLES], ids=["whole grid", "holes"])
def test_decisions_after_one_tap_are_identical(holes):
    """Trial by trial, whatever is decided."""
    table = table_of(holes=holes, sharpness=0.1)
    starts, _, _ = make_plans(table.pool, 40, 3, FIXATION, acts=True)
    passive, active = (
        run_trials(table, starts, (0.2, 0.6), play=PlaySettings(theta_x=theta), seed=3) for theta in (1.0, 0.0)
    )
    once = passive.taps == 1

    assert 0.1 < once[:, 1].mean() < 0.9
    assert once[:, 0].all()
    np.testing.assert_array_equal(active.taps == 1, once)
    for one, other in zip(passive, active, strict=True):
        np.testing.assert_array_equal(one[once], other[once])
    assert (passive.what != active.what).any()


@pytest.mark.parametrize("holes", [(), HOLES], ids=["whole grid", "holes"])
def test_means_are_identical_where_every_decision_takes_one_tap(grid, holes):
    """Below one over the number of objects, on several data sets, in all digits; above, they are not."""
    sets = [
        play_policies(table_of(seed, holes=holes), grid, settings_of(seed=seed), FIXATION, acts=True)
        for seed in range(3)
    ]
    names = ["a", "b", "c"]
    passive, active, difference = (
        metrics.over_places(metrics.join([getattr(played.stored, name) for played in sets], names), difference=d)
        for name, d in (("passive", False), ("active", False), ("difference", True))
    )

    xr.testing.assert_identical(passive.isel(theta=0), active.isel(theta=0))
    assert float(passive["taps"][0]) == 1.0
    for name in metrics.QUANTITIES:
        assert [float(difference[f"{name}{end}"][0]) for end in ("", "_low", "_high")] == [0.0, 0.0, 0.0]
        np.testing.assert_allclose(difference[name], passive[name] - active[name], atol=1e-12)
        assert float(passive[name][1]) != float(active[name][1])


@pytest.mark.parametrize("holes", [(), HOLES], ids=["whole grid", "holes"])
def test_trials_in_blocks_are_the_same_trials(grid, monkeypatch, holes):
    """Blocks of three trials per position, the last one shorter, and fixation points in blocks of their own."""

    def played():
        return play_policies(table_of(holes=holes), grid, settings_of(trials=20), FIXATION, acts=True)

    whole = played()
    monkeypatch.setattr(policies, "_AT_ONCE", 3 * L)
    blocks = played()

    for draws in ("stored", "fresh"):
        for one, other in zip(getattr(whole, draws), getattr(blocks, draws), strict=True):
            if one is not None:
                xr.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)
    for name in ("passive_confusion", "active_confusion", "used_up"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(blocks, name))


@pytest.mark.slow
def test_memory_does_not_grow_with_trials(grid, monkeypatch):
    monkeypatch.setattr(policies, "_AT_ONCE", 50 * L)
    monkeypatch.setattr(records, "_KEPT", 0)  # starts are kept up to a number of trials that the test stays below
    table = table_of()

    def peak(trials):
        tracemalloc.start()
        play_policies(table, grid, settings_of(trials=trials), FIXATION, acts=True)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(50)  # compiles
    assert peak(1000) < 1.6 * peak(200)


def test_fixation_points_are_averages_over_starts(grid):
    """The same ones everywhere, so at a threshold of one tap every point is exactly as good as any other."""
    played = play_policies(table_of(), grid, settings_of(trials=40), FIXATION, acts=True)
    fixations = played.stored.fixations

    assert fixations["trials"].values.tolist() == [40] * L
    for name in metrics.QUANTITIES:
        assert np.ptp(fixations[name].values[:, 0]) == 0
    assert np.ptp(fixations["taps"].values[:, 1]) > 0


def test_fresh_trials_draw_no_tap_twice(grid):
    """With one tap per class nobody gets a second one of it, so passive trials are all used up after the first."""
    table = table_of(taps=1)
    settings = settings_of(threshold=0.9)
    played = play_policies(table, grid, settings, FIXATION, acts=True)

    assert played.fresh.passive["theta"].values.tolist() == [theta for theta in settings.thresholds if theta <= 0.9]
    assert float(played.fresh.passive["taps"].max()) == 1.0
    assert float(played.stored.passive["taps"].max()) > 1.0
    assert played.used_up.shape == played.selected.shape == (2, played.fresh.passive.sizes["theta"])
    assert 0.1 < played.used_up[0, -1] <= 1.0
    assert (np.diff(played.used_up) >= 0).all()
    assert (played.selected == 0).all()  # no selections
    assert np.isnan(played.spread.factor)
    assert "a single test tap" in played.spread.few


def test_what_selections_use_up_is_that_of_their_trials(grid):
    table, settings = table_of(taps=4), settings_of(threshold=0.9)
    pools = resamples_of(table, 3, 0)
    played = play_policies(table, grid, settings, FIXATION, acts=True, pools=pools)
    own = [play_policies(table._replace(pool=pool), grid, settings, FIXATION, acts=True) for pool in pools.fresh]

    assert (played.selected[:, -1] > played.used_up[:, -1]).all()
    assert played.selected == pytest.approx(np.mean([one.used_up for one in own], axis=0), abs=0.05)


def test_resamples_give_paired_intervals(grid):
    """The difference varies less than passive and active apart, and is exactly nothing after one tap."""
    table = table_of(taps=20)
    pools = resamples_of(table, 60, 1)
    counted = []
    settings = settings_of(seed=1)
    played = play_policies(table, grid, settings, FIXATION, acts=True, pools=pools, progress=counted.append)
    ends = {}
    for name in ("passive", "active", "difference"):
        joined = metrics.join([getattr(played.stored, name)], ["only"])
        ends[name] = metrics.over_places(joined, played.spread, difference=True)  # widths go with variances then
    width = {name: data["what_error_high"] - data["what_error_low"] for name, data in ends.items()}

    assert (width["passive"] > 0.02).all()
    assert float(width["difference"][1]) ** 2 < float(width["passive"][1]) ** 2 + float(width["active"][1]) ** 2
    assert [float(ends["difference"][f"what_error{end}"][0]) for end in ("", "_low", "_high")] == [0.0, 0.0, 0.0]
    assert sum(counted) == most_trials(grid, settings, True, 60)


def test_resamples_depend_on_the_seed_alone(grid):
    """The same intervals again, others with another seed."""
    table = table_of()

    def ends(seed):
        pools = resamples_of(table, 20, seed)
        played = play_policies(table, grid, settings_of(seed=seed), FIXATION, acts=True, pools=pools)
        return played.stored.active["taps_resampled"].values

    np.testing.assert_array_equal(ends(0), ends(0))
    assert (ends(0) != ends(1)).any()
