"""What the tests of dependence share: strata, ranks, permutations, p-values and intervals."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import false_discovery_control, rankdata, spearmanr
from solidtouch.analysis.audit.dependence import permutation as dependence
from solidtouch.analysis.audit.dependence.permutation import (
    bootstrap_weights,
    checked,
    checked_level,
    false_discovery,
    mean_ranks,
    percentiles,
    permutation_test,
    permuted,
    product_sums,
    ratio,
    spread_samples,
    unit_residuals,
)
from solidtouch.models.errors import InputError


def test_strata_are_the_taps_of_a_label_and_single_taps_drop_out(rng):
    _, strata = checked(rng.normal(size=(7, 2, 3)), [5, -1, 5, 9, -1, 5, 4], 1)
    assert [own.tolist() for own in strata] == [[1, 4], [0, 2, 5]]


def test_no_tap_has_no_stratum():
    assert checked(np.zeros((0, 2, 3)), [], 1)[1] == []


def test_values_that_differ_by_rounding_are_equal(rng):
    taps = rng.normal(size=(6, 4, 2))
    taps[1] = taps[0] + 1e-14
    values, _ = checked(taps, np.zeros(6), 1)
    assert_array_equal(values[0], values[1])
    assert len(np.unique(values[1:, 0, 0])) == 5


@pytest.mark.parametrize(
    ("taps", "stratum", "permutations", "message"),
    [
        (np.zeros((4, 3)), np.zeros(4), 1, "need a stratum each, got shapes"),
        (np.zeros((4, 3, 2)), np.zeros(3), 1, "need a stratum each, got shapes"),
        (np.full((4, 3, 2), np.nan), np.zeros(4), 1, "NaN or infinite"),
        (np.zeros((4, 3, 2)), np.zeros(4), 0, "at least one permutation, got 0"),
    ],
)
def test_what_cannot_be_tested_is_refused(taps, stratum, permutations, message):
    with pytest.raises(InputError, match=message):
        checked(taps, stratum, permutations)


@pytest.mark.parametrize("alpha", [0.0, 1.0, np.nan])
def test_a_level_is_a_probability(alpha):
    with pytest.raises(InputError, match="between 0 and 1"):
        checked_level(alpha)


def test_products_of_unit_ranks_sum_to_spearmans_rho(rng):
    """With ties too; a constant column is 0."""
    values = rng.integers(4, size=(9, 3)).astype(float)
    values[:, 2] = 7.1
    units = unit_residuals(mean_ranks(values))
    assert_allclose((units[:, 0] * units[:, 1]).sum(), spearmanr(values[:, 0], values[:, 1]).statistic)
    assert_array_equal(units[:, 2], 0.0)


def test_unit_residuals_are_centred_and_of_unit_length(rng):
    units = unit_residuals(rng.normal(size=(5, 3, 2)))
    assert_allclose(units.sum(axis=0), 0.0, atol=1e-14)
    assert_allclose((units**2).sum(axis=0), 1.0)


def test_samples_are_spread_over_a_tap():
    assert spread_samples(50, 10).tolist() == [2, 7, 12, 17, 22, 27, 32, 37, 42, 47]
    assert spread_samples(3, 10).tolist() == [0, 1, 2]


@pytest.mark.parametrize("n", [4, 60])
def test_product_sums_are_sums_of_products_of_permuted_columns(rng, n):
    """With a table of products for small strata and without one for large."""
    columns, P, F = 3, 6, 5
    units = rng.normal(size=(columns, n, F))
    permutation = rng.permuted(np.tile(np.arange(n, dtype=np.int32), (columns, P, 1)), axis=2)
    first, second, group = np.array([0, 0, 1]), np.array([1, 2, 2]), np.array([0, 1, 0])
    expected = np.zeros((2, P))
    for i, j, g in zip(first, second, group, strict=True):
        for p in range(P):
            expected[g, p] += (units[i][permutation[i, p]] * units[j][permutation[j, p]]).sum()
    assert_allclose(product_sums(units, first, second, group)(permutation), expected)


def test_all_permutations_are_equally_frequent():
    counts = dict.fromkeys(itertools.permutations(range(3)), 0)

    def prepare(_, own):
        def count(permutation):
            for one in permutation[1, int(permutation[1, 0].tolist() == [0, 1, 2]) :]:
                counts[tuple(one.tolist())] += 1
            return np.zeros((1, permutation.shape[1]))

        return [count]

    permuted([np.arange(3)], 2, prepare, [1], [6000], 1)
    assert all(850 < count < 1150 for count in counts.values())


@pytest.mark.parametrize("threads", [1, 4])
def test_observed_taps_come_first_and_blocks_join(rng, monkeypatch, threads):
    """In blocks of any size: sums over strata have the observed value first, strata their means over permutations."""
    monkeypatch.setattr(dependence, "cores", lambda _: threads)
    values = rng.normal(size=(9, 2, 1))
    strata = [np.array([0, 2, 3, 7]), np.array([1, 4, 5, 6, 8])]

    def run(block):
        monkeypatch.setattr(dependence, "_BLOCK", block)
        seen = [], []

        def prepare(s, own):
            one = product_sums(values[own].transpose(1, 0, 2), *(np.array([i]) for i in (0, 1, 0)))

            def keep(permutation):
                seen[s].append(one(permutation))
                return seen[s][-1]

            return [keep, None]

        found, nothing = permuted(strata, 2, prepare, [1, 3], [20, 7], 3)
        return found, nothing, seen

    found, nothing, seen = run(16)
    assert min(map(len, seen)) > 5
    own = [np.concatenate(blocks, axis=1)[0] for blocks in seen]
    assert_allclose(found.total[0], own[0] + own[1])
    assert_allclose(found.observed[:, 0], [(values[own, 0] * values[own, 1]).sum() for own in strata])
    assert_allclose(found.expected[:, 0], [one[1:].mean() for one in own])
    assert_array_equal(nothing.total, np.zeros((3, 8)))
    assert run(1 << 20)[0].total.shape == (1, 21)


def test_a_p_value_counts_permutations_at_least_as_large():
    total = np.array([[3.0, 1.0, 2.0, 3.0, 4.0], [-9.0, 0.0, 1.0, 2.0, 1.0]])
    upper = permutation_test(total, two_sided=False)
    assert_allclose(upper.p, [3 / 5, 1.0])
    z = (total - total.mean(axis=1, keepdims=True)) / total.std(axis=1, keepdims=True)
    assert_allclose(upper.z, z[:, 0])
    both = permutation_test(total, two_sided=True)
    assert_allclose(both.p, [1.0, 1 / 5])
    assert_allclose(both.family_z, -z[1, 0])
    assert both.family_p == 1 / 5


def test_a_statistic_without_spread_rejects_nothing():
    test = permutation_test(np.full((2, 7), 0.3), two_sided=True)
    assert_array_equal(test.p, 1.0)
    assert test.family_p == 1.0


def test_q_values_are_those_of_benjamini_and_hochberg():
    p = np.array([0.01, np.nan, 0.04, 0.03, 0.5])
    assert_allclose(false_discovery(p), [0.04, np.nan, 0.16 / 3, 0.16 / 3, 0.5])
    assert np.isnan(false_discovery(np.full(3, np.nan))).all()


def test_ratios_weigh_strata_and_resamples():
    value, weight = np.array([[1.0, 0.0], [4.0, 0.0], [9.0, 0.0]]), np.array([[1.0, 0.0], [2.0, 0.0], [2.0, 0.0]])
    assert_allclose(ratio(value, weight), [14 / 5, np.nan])
    assert_allclose(ratio(value, weight, np.array([[2.0, 0.0, 1.0], [0.0, 3.0, 0.0]]))[:, 0], [11 / 4, 2.0])
    assert_array_equal(bootstrap_weights(6, 0).sum(axis=1), 6.0)


def test_few_strata_have_no_interval(rng):
    values = rng.normal(size=(1000, 2))
    assert np.isnan(percentiles(values, 4)).all()
    assert_allclose(percentiles(values, 5), np.quantile(values, [0.025, 0.975], axis=0))


def test_an_interval_needs_most_resamples(rng):
    values = rng.normal(size=(100, 2))
    values[:4, 0] = values[:6, 1] = np.nan
    low, _ = percentiles(values, 9)
    assert_allclose(low, [np.quantile(values[4:, 0], 0.025), np.nan])


@pytest.mark.parametrize("shape", [(1,), (7,), (20, 3, 4)])
def test_ranks_and_false_discovery_are_those_of_scipy(rng, shape):
    values = rng.integers(5, size=shape).astype(float)
    p = rng.random(30) ** 3

    np.testing.assert_array_equal(mean_ranks(values), rankdata(values, axis=0))
    np.testing.assert_allclose(false_discovery(p), false_discovery_control(p), rtol=1e-14)
