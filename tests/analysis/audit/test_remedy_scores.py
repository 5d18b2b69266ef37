"""What goes into the scores of remedies: sequences of taps, gains with their ends, and errors of two settings."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm
from solidtouch.analysis.audit import remedy_scores
from solidtouch.analysis.audit.remedy_scores import _against, _gains, _log_belief, _log_beliefs, _sequences
from solidtouch.inference.trials.judged_sequences import without_replacement
from solidtouch.inference.trials.records import TapTable
from solidtouch.inference.trials.resampling import Spread, spread
from solidtouch.inference.trials.selections import thinned_pools
from solidtouch.models import seeds
from solidtouch.models.grid import tap_pool

GENERATOR = np.random.default_rng(0)


def pool_with(*count):
    """A pool of one object with so many taps at each position."""
    where = np.repeat(np.arange(len(count)), count)
    return tap_pool(where, 0 * where, (len(count), 1)), where


def test_sequences_hold_no_tap_twice_where_there_are_enough():
    """As many as a class has are each of them once; with fewer, taps repeat; classes without a tap have none."""
    pool, where = pool_with(6, 0, 5, 2)
    drawn, weight = _sequences(pool, 5, 40, GENERATOR)
    assert drawn.shape == (120, 5)
    assert weight == pytest.approx(np.full(120, 1 / 120))
    assert (where[drawn] == np.repeat([0, 2, 3], 40)[:, None]).all()
    for row in drawn[:80]:
        assert len(set(row)) == 5
    assert {tuple(sorted(row)) for row in drawn[40:80]} == {(6, 7, 8, 9, 10)}
    assert len({tuple(row) for row in drawn[40:80]}) > 20
    assert set(drawn[80:].ravel()) == {11, 12}


def test_sequences_of_classes_hold_no_tap_twice():
    """Likewise those by which models are compared; every tap is in as many."""
    group = np.arange(10, 17)
    drawn = without_replacement(group, 5, 4000, np.random.default_rng(1))
    assert (np.sort(drawn, axis=1)[:, 1:] > np.sort(drawn, axis=1)[:, :-1]).all()
    assert set(drawn.ravel()) == set(group)
    assert np.bincount(drawn.ravel() - 10) / 4000 == pytest.approx(np.full(7, 5 / 7), abs=0.05)


def test_sequences_of_a_shuffle_share_no_tap():
    """Every second is of every second shuffle, and classes with more sequences weigh no more."""
    drawn = without_replacement(np.arange(11), 3, 8, np.random.default_rng(2))
    assert drawn.shape == (12, 3)
    for first in range(4):
        assert len(np.unique(drawn[first::4])) == 9
    assert without_replacement(np.arange(400), 10, 6, GENERATOR).shape == (6, 10)  # as many as are wanted, not 80
    pool, where = pool_with(11, 3)
    drawn, weight = _sequences(pool, 3, 8, GENERATOR)
    assert [np.sum(where[drawn[:, 0]] == l) for l in (0, 1)] == [12, 8]
    assert [weight[where[drawn[:, 0]] == l].sum() for l in (0, 1)] == pytest.approx([0.5, 0.5])


def two_positions(*count):
    """One object: taps at position 0 believe in it by .8, those at position 2 by .3, so many of each; none at 1."""
    _, where = pool_with(*count)
    belief = np.full((len(where), 3, 1), 0.1)
    belief[np.arange(len(where)), where, 0] = np.where(where == 0, 0.8, 0.3)
    belief[np.arange(len(where)), 1, 0] = np.where(where == 0, 0.1, 0.6)
    table = TapTable(np.log(belief), tap_pool(where, 0 * where, (3, 1)), np.log(np.full((3, 1), 1 / 3)))
    grid = SimpleNamespace(M=1, L=3, where_value=np.arange(3.0), where_index=lambda value: value.astype(int))
    remedy = SimpleNamespace(grid=grid, model=SimpleNamespace(saturation=np.inf))
    return table, remedy, grid, SimpleNamespace(indices=lambda _: (where, 0 * where))


def test_log_beliefs_are_means_over_classes_with_taps():
    """Each counts alike, however many taps it has, and one without any does not; resamples follow."""
    table, remedy, grid, taps = two_positions(9, 0, 4)
    (means,) = _log_beliefs([(table, remedy)], table, grid=grid, taps=taps, n=1, seed=0)
    assert means.shape == (1 + 3 * remedy_scores.RESAMPLES,)
    assert means == pytest.approx(np.full(len(means), (np.log(0.8) + np.log(0.3)) / 2))
    two = [p[0] ** 2 / np.sum(np.square(p)) for p in ([0.8, 0.1, 0.1], [0.3, 0.1, 0.6])]
    (means,) = _log_beliefs([(table, remedy)], table, grid=grid, taps=taps, n=2, seed=0)
    assert means[0] == pytest.approx(np.log(two).mean())


def test_log_beliefs_are_those_of_the_resampled_taps():
    """The first of the taps as they are, then of each resample, by sequences of its own taps."""
    table, remedy, grid, taps = two_positions(5, 3, 4)
    values = table.log_likelihood + np.random.default_rng(2).normal(size=table.log_likelihood.shape)
    table = table._replace(log_likelihood=values)
    (means,) = _log_beliefs([(table, remedy)], table, grid=grid, taps=taps, n=1, seed=3)
    exact = []
    for pool in thinned_pools(table, remedy_scores.RESAMPLES, 3):
        own = _log_belief(table, remedy, grid, taps.indices(grid), pool.order[:, None])
        exact.append(np.mean([own[np.asarray(taps.indices(0)[0])[pool.order] == l].mean() for l in range(3)]))
    assert np.corrcoef(means[1 : 1 + remedy_scores.RESAMPLES], exact[1:])[0, 1] > 0.5
    assert means[0] == pytest.approx(exact[0], abs=0.25)


def test_log_beliefs_of_several_remedies_are_those_of_each_alone():
    """All see the same sequences, so gains are differences on the same taps."""
    table, remedy, grid, taps = two_positions(8, 6, 7)
    noisy = table.log_likelihood + np.random.default_rng(2).normal(size=table.log_likelihood.shape)
    seen = [(table, remedy), (table._replace(log_likelihood=noisy), remedy)]
    both = _log_beliefs(seen, table, grid=grid, taps=taps, n=3, seed=1)
    alone = [_log_beliefs([one], table, grid=grid, taps=taps, n=3, seed=1)[0] for one in seen]
    np.testing.assert_array_equal(both, alone)


def test_estimate_and_halves_are_of_so_many_disjoint_sequences():
    """The estimate takes all sequences of more draws, resamples those of fewer, halves every second of them."""
    table, remedy, grid, taps = two_positions(40, 30, 35)
    values = table.log_likelihood + np.random.default_rng(2).normal(size=table.log_likelihood.shape)
    table = table._replace(log_likelihood=values)
    generator = seeds.generator(3, seeds.Purpose.REMEDY_SCORES)
    halves = []
    for i, pool in enumerate(thinned_pools(table, remedy_scores.RESAMPLES, 3)):
        each = remedy_scores._RESAMPLE_SEQUENCES if i else remedy_scores._SEQUENCES
        drawn, weight = _sequences(pool, 2, each, generator)
        belief = weight * _log_belief(table, remedy, grid, taps.indices(grid), drawn)
        halves.append([2 * belief[::2].sum(), 2 * belief[1::2].sum()])
    first, second = np.transpose(halves)

    (found,) = _log_beliefs([(table, remedy)], table, grid=grid, taps=taps, n=2, seed=3)

    np.testing.assert_allclose(found, np.concatenate([(first + second) / 2, first[1:], second[1:]]))


def drawn_gain(seed, taps):
    """Gain after 5 taps of half the power of log-likelihoods with noise, on taps drawn from 6 histograms."""
    log_prob = np.log(np.random.default_rng(5).dirichlet(np.ones(8), size=6))
    generator = np.random.default_rng([seed, taps])
    own = np.repeat(np.arange(6), taps)
    symbol = (generator.random((len(own), 1)) > np.exp(log_prob).cumsum(axis=-1)[own]).sum(axis=-1).clip(0, 7)
    noisy = (log_prob[:, symbol].T + generator.normal(size=(len(own), 6))).reshape(-1, 3, 2)
    where, what = np.divmod(own, 2)
    pool, grid = tap_pool(where, what, (3, 2)), SimpleNamespace(M=2, L=3)
    as_it_is, halved = (TapTable(values, pool, np.full((3, 2), -np.log(6))) for values in (noisy, noisy / 2))
    remedy = SimpleNamespace(grid=grid, model=SimpleNamespace(saturation=np.inf))
    common = {"grid": grid, "taps": SimpleNamespace(indices=lambda _: (where, what)), "n": 5, "seed": seed}
    base, beliefs = _log_beliefs([(as_it_is, remedy), (halved, remedy)], as_it_is, **common)
    how = spread(as_it_is, noise=remedy_scores._RESAMPLE_SEQUENCES / remedy_scores._SEQUENCES, thinned=True)
    return _gains(beliefs, base, 0.0, how, 1, is_base=False)


@pytest.mark.slow
@pytest.mark.parametrize("taps", [10, 30])
def test_intervals_of_gains_hold_what_many_taps_give(taps):
    """In 92% of the data sets or more: too wide rather than too narrow, as few sequences tell how much they vary."""
    truth = np.mean([drawn_gain(seed, 2000)[1][0] for seed in range(10**6, 10**6 + 5)])
    _, gains, sure = zip(*(drawn_gain(seed, taps) for seed in range(300)), strict=True)
    _, low, high = np.transpose(gains)
    assert np.mean((low <= truth) & (truth <= high)) > 0.92
    assert np.mean(np.array(sure) > truth) < 0.045  # 2.5% and chance


@pytest.mark.parametrize("remedies", [1, 3, 12])
def test_the_sure_end_holds_for_all_remedies_together(remedies):
    """By Bonferroni's inequality: the more remedies, the lower; deviations are enlarged."""
    rng = np.random.default_rng(0)
    base, beliefs = rng.normal(-1, 0.1, 4001), rng.normal(-0.5, 0.2, 4001)
    (score, low, high), (gain, gain_low, gain_high), sure = _gains(
        beliefs, base, 0.0, Spread(1.2), remedies, is_base=False
    )
    spread = 1.2 * (beliefs - base)[1:].std()
    assert (score, gain) == (beliefs[0], beliefs[0] - base[0])
    assert sure == pytest.approx(gain - norm.ppf(1 - 0.025 / remedies) * spread, rel=0.02)
    assert sure <= gain_low < gain < gain_high
    assert [low, high] == pytest.approx([float(end) for end in Spread(1.2).interval(beliefs)])
    assert _gains(base, base, 0.0, Spread(1.2), remedies, is_base=True)[1:] == (None, None)


def test_the_sure_end_lies_below_the_interval():
    """Also where resamples are skewed, so that no remedy surely helps whose gain may be none."""
    gains = np.append(0.5, -(np.random.default_rng(0).exponential(size=2000) ** 2))
    _, (_, low, _), sure = _gains(gains, 0 * gains, 0.0, Spread(1.0), 1, is_base=False)
    assert low < 0.5 - 1.96 * gains[1:].std()
    assert sure == low


def test_gains_by_rounding_are_none():
    """Nothing surely helps whose beliefs are the same but for the last digits."""
    base = np.random.default_rng(0).normal(-1, 0.1, 101)
    for excess, helps in ((1e-12, False), (3e-12, True)):
        _, gain, sure = _gains(base + excess, base, 2e-12, Spread(1.0), 3, is_base=False)
        assert (sure > 0) == helps
        assert (gain == (0, 0, 0)) != helps


def rough(taps, used_up):
    """Two selections of trials at four thresholds; (theta, resample) of one model."""
    values = {"taps": taps, "used_up": used_up}
    samples = {name: np.column_stack([value, np.zeros((4, 4))]) for name, value in values.items()}
    attributes = {
        "factor": 1.0,
        "freedom": np.inf,
        "sessions": 1,
        "test_taps": 9,
        "trials": 100,
        "resample_trials": 100,
    }
    return xr.Dataset(
        {name: (("model", "theta", "resample"), one[np.newaxis]) for name, one in samples.items()},
        {"model": ["own"], "theta": [0.5, 0.7, 0.9, 0.99]},
        attributes,
    )


def test_errors_are_compared_where_test_taps_suffice():
    """Also on selections, up to the threshold in use; at that one where they do at none."""
    fine, few, none = [[0.0, 0.002, 0.006]] * 1, [[0.0, 0.1, 0.1]], [[0.2, 0.2, 0.2]]
    cases = [(fine * 2 + few * 2, 0.7), (fine * 4, 0.9), (none * 4, 0.9), (fine + few + fine + few, 0.9)]
    for used_up, theta in cases:
        assert remedy_scores._comparable(rough(np.ones((4, 3)), used_up), "own", 0.9) == theta


@pytest.mark.parametrize(("time", "theta"), [(1.0, 0.7), (1.5, 0.9), (1.8, 0.99), (2.5, 0.99), (9.0, 0.99)])
def test_remedies_are_played_until_all_selections_take_so_long(time, theta):
    """And one threshold more, as others may be faster."""
    taps = [[1.2, 1.1, 1.0], [2.0, 1.9, 1.6], [4.0, 2.6, 3.0], [6.0, 5.0, 5.5]]
    assert remedy_scores._needed(rough(taps, np.zeros((4, 3))), time) == {"own": theta}


def at(what, where):
    """Errors at a reaction time, each with its ends."""
    data = {}
    for name, values in (("what_error", what), ("where_error", where)):
        data |= {f"{name}{end}": value for end, value in zip(("", "_low", "_high"), values, strict=True)}
    return xr.Dataset(data)


def test_independent_errors_pair_their_sides_crosswise(monkeypatch):
    """A change is smallest where the one error is low and the other high."""
    own = at((0.30, 0.27, 0.35), (1.0, 0.9, 1.3)).expand_dims(model=["finer"], policy=["passive"], taps=[4.0])
    asked = []

    def equal(played, times):
        asked.append((played, times))
        return own

    monkeypatch.setattr(remedy_scores, "at_equal_taps", equal)
    found = _against(at((0.50, 0.46, 0.62), (2.0, 1.6, 2.3)), "played", "passive", 4.0)
    assert asked == [("played", [4.0])]
    for name, change, low, high in (
        ("what_error", -0.2, np.hypot(0.03, 0.12), np.hypot(0.05, 0.04)),
        ("where_error", -1.0, np.hypot(0.1, 0.3), np.hypot(0.3, 0.4)),
    ):
        assert float(found[f"{name}_difference"]) == pytest.approx(change)
        assert float(found[f"{name}_difference_low"]) == pytest.approx(change - low)
        assert float(found[f"{name}_difference_high"]) == pytest.approx(change + high)
        for end in ("", "_low", "_high"):
            assert float(found[name + end]) == float(own[name + end].squeeze())
