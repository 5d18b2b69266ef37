"""Tests of dependence across taxels: brute force, level, power, and what is left out."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import binom, spearmanr
from scipy.stats.contingency import crosstab
from solidtouch.analysis.audit.dependence import taxels as dependence_taxels
from solidtouch.analysis.audit.dependence.permutation import mean_ranks
from solidtouch.analysis.audit.dependence.taxels import TESTS, quantile_bins, taxel_dependence, unit_distances
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import Rod, preset
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps

SIZES = (5, 9, 6, 11, 8)


def naive_distance_correlation(x, y):
    """Bias-corrected, with loops as Szekely and Rizzo (2013) write it."""
    n = len(x)

    def centred(v):
        d = np.array([[abs(a - b) for b in v] for a in v])
        u = np.zeros((n, n))
        for i in range(n):
            for j in range(n):
                if i != j:
                    u[i, j] = d[i, j] - d[i].sum() / (n - 2) - d[:, j].sum() / (n - 2) + d.sum() / ((n - 1) * (n - 2))
        return u

    a, b = centred(x), centred(y)
    return (a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum())


def naive_information(x, y, bins):
    """Mutual information of binned values in nats."""
    count = crosstab(*(quantile_bins(mean_ranks(values), bins) for values in (x, y))).count / len(x)
    expected = count.sum(axis=1, keepdims=True) * count.sum(axis=0)
    positive = count > 0
    return (count[positive] * np.log(count[positive] / expected[positive])).sum()


@pytest.fixture
def coupled(rng):
    """Taps of 5 strata, 4 samples and 3 taxels, the first two of which share something, and the strata."""
    stratum = rng.permutation(np.repeat(np.arange(5), SIZES))
    taps = rng.normal(size=(len(stratum), 4, 3)) + 10 * stratum[:, None, None]
    taps[:, :, 1] += 0.8 * taps[:, :, 0]
    return taps.round(1), stratum


def brute(taps, stratum, statistic, samples):
    """Mean over strata, weighted by taps, and samples."""
    values = [
        (len(own), np.mean([statistic(own[:, j, 0], own[:, j, 1]) for j in samples]))
        for own in (taps[stratum == s] for s in np.unique(stratum))
    ]
    weight, value = np.transpose(values)
    return weight @ value / weight.sum()


def test_effects_are_those_of_loops(coupled):
    """Spearman's rho at all samples, distance correlation and mutual information at some."""
    taps, stratum = coupled
    found = taxel_dependence(taps, stratum, permutations=39, samples=2)
    rank, distance, table = found["effect"].values[:, 0, 1]
    assert_allclose(rank, brute(taps, stratum, lambda x, y: spearmanr(x, y).statistic, range(4)))
    assert_allclose(distance, brute(taps, stratum, naive_distance_correlation, [1, 3]), rtol=1e-5)
    raw = brute(taps, stratum, lambda x, y: naive_information(x, y, min(4, len(x) // 2)), [1, 3])
    assert 0 < table < raw
    null = [
        brute(np.stack([taps[:, :, 0], shuffled(taps, stratum, seed)], axis=2), stratum, information, [1, 3])
        for seed in range(60)
    ]
    assert_allclose(table, raw - np.mean(null), atol=0.03)
    assert found["samples"].values.tolist() == [4, 2, 2]


def information(x, y):
    return naive_information(x, y, min(4, len(x) // 2))


def shuffled(taps, stratum, seed):
    """The second taxel, whole taps permuted within strata."""
    generator, moved = np.random.default_rng(seed), taps[:, :, 1].copy()
    for s in np.unique(stratum):
        own = np.flatnonzero(stratum == s)
        moved[own] = moved[generator.permutation(own)]
    return moved


@pytest.mark.parametrize("prepare", ["_ranks", "_distances", "_tables"])
def test_statistics_of_permutations_are_those_of_permuted_taps(coupled, rng, prepare):
    taps, stratum = coupled
    own = mean_ranks(taps[stratum == 3])
    n = len(own)
    permutation = rng.permuted(np.tile(np.arange(n, dtype=np.int32), (3, 4, 1)), axis=2)
    identity = np.tile(np.arange(n, dtype=np.int32), (3, 1, 1))
    statistic = getattr(dependence_taxels, prepare)(own).statistic(permutation)
    for p in range(4):
        moved = np.stack([own[permutation[k, p], :, k] for k in range(3)], axis=2)
        expected = getattr(dependence_taxels, prepare)(moved).statistic(identity)
        assert_allclose(statistic[:, p], expected[:, 0], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("sums", [1, 1 << 12, 1 << 21])
@pytest.mark.parametrize("n", [4, 6, 31, 32, 33, 63, 64, 65, 130])
def test_counts_of_masks_are_those_of_tables(rng, monkeypatch, n, sums):
    """Of taps that fill words or not, permutations that fill blocks or not, ties, and samples dead in a taxel.

    In some samples both taxels are the same, so that a count is as large as a bin. Terms are looked up one by one, in
    pairs, or by rows of a table.
    """
    monkeypatch.setattr(dependence_taxels, "_SUMS", sums)
    values = rng.normal(size=(n, 5, 2))
    values[:, 1] = values[:, 1].round()
    values[: n // 3, 2] = 0.0
    values[:, 1:3, 1] = values[:, 1:3, 0]
    values[:, 3, 0], values[:, 4, 1] = 2.0, 3.0
    permutation = rng.permuted(np.tile(np.arange(n, dtype=np.int32), (2, 67, 1)), axis=2)
    permutation[:, 0] = np.arange(n)
    first, second = values[permutation[0], :, 0], values[permutation[1], :, 1]
    expected = [[n * information(x[:, j], y[:, j]) for j in range(5)] for x, y in zip(first, second, strict=True)]
    found = dependence_taxels._tables(mean_ranks(values)).statistic(permutation)
    assert_allclose(found, [np.sum(expected, axis=1)], rtol=1e-10, atol=1e-10)


def test_distances_of_a_large_stratum_are_those_of_some_taps(rng, monkeypatch):
    monkeypatch.setattr(dependence_taxels, "_MOST_TAPS", 8)
    taps = rng.normal(size=(40, 1, 2))
    taps[:, :, 1] += taps[:, :, 0]
    found = taxel_dependence(taps, np.zeros(40), permutations=99)
    kept = taps[[2, 7, 12, 17, 22, 27, 32, 37], 0]
    assert_allclose(found["effect"].values[1, 0, 1], naive_distance_correlation(*kept.T), rtol=1e-5)
    assert found["p"].values[1, 0, 1] > found["p"].values[0, 0, 1]


def test_u_centred_distances_are_orthogonal_to_constants(rng):
    matrices = unit_distances(rng.normal(size=(3, 7)))
    assert_allclose(matrices.sum(axis=-1), 0.0, atol=1e-12)
    assert_allclose((np.tril(matrices) ** 2).sum(axis=(1, 2)), 1.0)
    assert_array_equal(unit_distances(np.array([[0.0, 0.0, 0.0, 1.0]])), 0.0)


def test_bins_hold_quarters_and_equal_values_share_one(rng):
    assert np.bincount(quantile_bins(mean_ranks(rng.normal(size=20)), 4)).tolist() == [5, 5, 5, 5]
    assert quantile_bins(mean_ranks(np.array([0.0, 0, 0, 0, 0, 0, 3, 1])), 4).tolist() == [1, 1, 1, 1, 1, 1, 3, 3]
    assert_array_equal(quantile_bins(mean_ranks(np.zeros(5)), 4), 2)


def test_taxels_in_another_order_have_the_same_effects(coupled):
    taps, stratum = coupled
    order = np.array([2, 0, 1])
    here = taxel_dependence(taps, stratum, permutations=199)
    there = taxel_dependence(taps[:, :, order], stratum, permutations=199)
    for name in ("effect", "effect_low"):
        rank, distance, _ = here[name].values[:, order][:, :, order]
        assert_allclose(there[name].values[:2], [rank, distance], rtol=1e-5)
    assert_allclose(there["p"].values, here["p"].values[:, order][:, :, order], atol=0.12)
    assert_array_equal(there["rejected"], here["rejected"].values[:, order][:, :, order])


def test_labels_of_strata_do_not_matter(coupled):
    taps, stratum = coupled
    assert taxel_dependence(taps, 7 * stratum - 3, permutations=9).identical(
        taxel_dependence(taps, stratum, permutations=9)
    )


def test_a_shared_taxel_is_found_and_the_others_are_not(coupled):
    """The pair that shares something is in every map; means are those of all pairs."""
    taps, stratum = coupled
    found = taxel_dependence(taps, stratum, permutations=199)
    assert found["effect_low"].values[0, 0, 1] > 0
    for test in TESTS:
        one = found.sel(test=test)
        assert one["rejected"].values.tolist() == [[False, True, False], [True, False, False], [False] * 3]
        assert one["family_p"] <= 0.05
        assert one["effect_low"].values[0, 1] < one["effect"].values[0, 1] < one["effect_high"].values[0, 1]
        assert one["pairs"] == 3
        assert_allclose(one["rejected_fraction"], 1 / 3)
        assert one["mean_absolute_null"] < one["mean_absolute"] < one["mean_absolute_high"]
        absolute = np.abs(one["effect"].values)
        assert_allclose(one["taxel_effect"], np.nansum(absolute, axis=1) / 2)
        assert_allclose(one["mean_absolute"], np.nansum(absolute) / 6)
        assert np.isnan(np.diagonal(one["effect"])).all()


def test_a_common_spread_is_seen_by_distances_and_not_by_ranks(rng):
    taps = rng.normal(size=(200, 2, 2)) * np.exp(rng.normal(size=(200, 1, 1)))
    found = taxel_dependence(taps, np.repeat(np.arange(10), 20), permutations=199)
    rank, distance, _ = found["p"].values[:, 0, 1]
    assert distance == 1 / 200
    assert rank > 0.05


def test_taxels_that_move_against_each_other_are_found(rng):
    """Ranks see dependence of either sign; two taxels that share noise with opposite signs are as dependent."""
    taps = rng.normal(size=(60, 2, 2))
    taps[:, :, 1] -= 2 * taps[:, :, 0]
    found = taxel_dependence(taps, np.repeat(np.arange(5), 12), permutations=99)
    assert float(found["effect"].values[0, 0, 1]) < -0.5
    assert_array_equal(found["p"].values[:, 0, 1], 0.01)
    assert_array_equal(found["family_p"], 0.01)


@pytest.mark.slow
def test_the_tests_hold_their_level():
    """On independent taxels with ties and dependence in time, each rejects in about one data set of twenty."""
    n, rejects, pairs = 100, np.zeros(3), []
    for seed in range(n):
        rng = np.random.default_rng(seed)
        taps = (rng.normal(size=(30, 4, 3)) + 2 * rng.normal(size=(30, 1, 3))).round()
        found = taxel_dependence(taps, np.repeat(np.arange(5), 6), permutations=19, seed=seed)
        rejects += found["family_p"].values <= 0.05
        pairs.append((found["p"].values <= 0.05).sum(axis=(1, 2)) / 6)
    assert (rejects >= binom.ppf(0.001, n, 0.05)).all()
    assert (rejects <= binom.isf(0.001, n, 0.05)).all()
    assert_allclose(np.mean(pairs, axis=0), 0.05, atol=0.04)


def test_a_common_mode_of_the_rig_is_found_and_the_noise_of_taxels_is_not():
    still = replace(
        preset("ideal"),
        rods=(Rod("6 mm rod", 6.0),),
        start_mm=6.0,
        end_mm=10.0,
        position_spread_mm=0.0,
        highpass_hz=0.0,
    )
    p = {}
    for name in ("common_noise_counts", "taxel_noise_counts"):
        taps = simulate_session(replace(still, **{name: 2.0}), seed=3, session=0)
        where, _ = taps.indices(taps.grid())
        p[name] = taxel_dependence(taps.taps[:, ::10], where, permutations=99)["family_p"].values
    assert_array_equal(p["common_noise_counts"], 0.01)
    assert (p["taxel_noise_counts"] > 0.05).all()


def test_dead_taxels_are_listed_and_left_out(coupled):
    """One that is constant, and one that only differs between strata."""
    taps, stratum = coupled
    dead = np.stack([np.full(taps.shape[:2], 3.0), np.tile(0.1 * stratum[:, None], (1, 4))], axis=2)
    alone = taxel_dependence(taps, stratum, permutations=19)
    found = taxel_dependence(np.concatenate([dead, taps], axis=2), stratum, permutations=19)
    assert found["dead"].values.tolist() == [True, True, False, False, False]
    assert_allclose(found["p"].values[:, 2:, 2:], alone["p"])
    assert np.isnan(found["p"].values[:, :2]).all()
    assert not found["rejected"].values[:, :2].any()
    assert_array_equal(found["pairs"], 3)


def test_taxels_that_never_vary_together_are_no_pair(coupled):
    taps, stratum = coupled
    taps[stratum < 2, :, 0], taps[stratum >= 2, :, 1] = 0.0, 0.0
    found = taxel_dependence(taps, stratum, permutations=19)
    assert not found["dead"].any()
    assert np.isnan(found["p"].values[:, 0, 1]).all()
    assert_array_equal(found["pairs"], 2)
    assert np.isfinite(found["mean_absolute_null"]).all()


def test_columns_that_are_constant_in_a_stratum_do_not_count(coupled):
    taps, stratum = coupled
    taps[stratum == 4, 2, 0] = 1.0
    found = taxel_dependence(taps, stratum, permutations=9)
    sums, weights = 0.0, 0.0
    for s, n in enumerate(SIZES):
        for j in range(4):
            if (s, j) != (4, 2):
                own = taps[stratum == s, j]
                sums, weights = sums + n * spearmanr(own[:, 0], own[:, 1]).statistic, weights + n
    assert_allclose(found["effect"].values[0, 0, 1], sums / weights)


def test_strata_of_three_are_for_ranks_only(rng):
    found = taxel_dependence(rng.normal(size=(18, 4, 3)), np.repeat(np.arange(6), 3), permutations=19)
    assert found["strata"].values.tolist() == [6, 0, 0]
    assert found["reason"].values[0] == ""
    assert all("no stratum has 4 taps" in reason for reason in found["reason"].values[1:])
    assert np.isfinite(found["family_p"].values).tolist() == [True, False, False]


def test_single_taps_drop_out_and_few_large_strata_do_not_crash(rng):
    """Five of six strata are too small for distances, so that most resamples would hold none."""
    taps = rng.normal(size=(17, 2, 3))
    found = taxel_dependence(taps, [0] * 6 + [1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6], permutations=19)
    assert found["strata"].values.tolist() == [6, 1, 1]
    assert found["taps"].values.tolist() == [16, 6, 6]
    assert np.isnan(found["effect_low"].values[1]).all()
    assert np.isfinite(found["effect_low"].values[0, 0, 1])


@pytest.mark.parametrize(
    ("shape", "stratum", "reason"),
    [
        ((6, 3, 1), [0] * 6, "one taxel only"),
        ((4, 3, 2), [0, 1, 2, 3], "no stratum has two taps"),
        ((4, 0, 2), [0] * 4, "no samples"),
        ((0, 3, 2), [], "no stratum"),
    ],
)
def test_what_says_nothing_has_a_reason(rng, shape, stratum, reason):
    found = taxel_dependence(rng.normal(size=shape), stratum, permutations=9)
    assert all(reason in one for one in found["reason"].values)
    assert np.isnan(found["family_p"]).all()


def test_one_sample_and_one_stratum_are_tested_without_interval(rng):
    taps = rng.normal(size=(45, 1, 2))
    taps[:, :, 1] += 2 * taps[:, :, 0]
    found = taxel_dependence(taps, np.zeros(45), permutations=99)
    assert_array_equal(found["p"].values[:, 0, 1], 0.01)
    assert np.isnan(found["effect_low"]).all()


def test_many_distances_are_permuted_less_often(rng, monkeypatch):
    monkeypatch.setattr(dependence_taxels, "_DISTANCE_WORK", 1.0)
    found = taxel_dependence(rng.normal(size=(20, 2, 3)), np.repeat([0, 1], 10), permutations=299)
    assert found["permutations"].values.tolist() == [299, 199, 299]


def test_progress_is_told_of_strata(coupled):
    done = []
    taxel_dependence(*coupled, permutations=9, progress=done.append)
    assert done == [1] * 5


@pytest.mark.parametrize("samples", [0, -2])
def test_at_least_one_sample_is_looked_at(coupled, samples):
    with pytest.raises(InputError, match="at least one sample"):
        taxel_dependence(*coupled, samples=samples)


def test_recorded_taps_of_a_fingertip_depend(shared_data):
    """Letters slid over: all taxels of the fingertip share the contact."""
    taps = load_taps(shared_data / "braille_icub.npz")
    what = taps.dataset["what"].values
    found = taxel_dependence(taps.taps, 2 * what + taps.session, permutations=199)
    assert (found["family_p"] == 1 / 200).all()
    assert found["strata"].values.tolist() == [54] * 3
