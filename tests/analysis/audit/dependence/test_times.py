"""Tests of dependence in time: brute force, level, power, and effective numbers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.stats import binom
from solidtouch.analysis.audit.dependence.permutation import unit_residuals
from solidtouch.analysis.audit.dependence.taxels import taxel_dependence
from solidtouch.analysis.audit.dependence.times import (
    effective_samples,
    partial_autocorrelation,
    squared_correlations,
    time_dependence,
    unbiased_correlation,
)
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps


def processes(rng, strata, n, J, K, rho):
    """Gaussian AR(1) samples in strata of n taps whose courses differ, shape (strata n, J, K), and their strata."""
    factor = np.linalg.cholesky(toeplitz(rho ** np.arange(J)))
    taps = np.einsum("ij,njk->nik", factor, rng.normal(size=(strata * n, J, K)))
    stratum = np.repeat(np.arange(strata), n)
    return taps + 5 * rng.normal(size=(strata, J, K))[stratum], stratum


def corrected(r, n):
    estimates = unbiased_correlation(n)
    return np.sign(r) * np.interp(np.abs(r), np.linspace(0, 1, len(estimates)), estimates)


def test_autocorrelations_are_those_of_loops(rng):
    """Means of corrected correlations over samples, taxels and, weighted by taps, strata; constant columns left out."""
    sizes, J, K = (3, 6, 4, 5, 8), 4, 2
    stratum = rng.permutation(np.repeat(np.arange(5), sizes))
    taps = rng.normal(size=(len(stratum), J, K)).cumsum(axis=1)
    taps[stratum == 1, 2, 1] = 4.0
    found = time_dependence(taps, stratum, permutations=9)
    per_taxel = np.zeros((2, J, K))
    for s, n in enumerate(sizes):
        own = taps[stratum == s]
        for k in range(K):
            for i in range(J):
                for j in range(i, J):
                    if s != 1 or k != 1 or 2 not in (i, j):
                        r = np.corrcoef(own[:, i, k], own[:, j, k])[0, 1]
                        per_taxel[:, j - i, k] += n * corrected(r, n), n
    up, down = per_taxel.sum(axis=2)
    assert_allclose(found["autocorrelation"], up / down)
    assert_allclose(found["lag1"], per_taxel[0, 1] / per_taxel[1, 1])
    assert found["taps"] == len(taps)


@pytest.mark.parametrize("n", [3, 4, 7])
def test_corrected_correlations_of_few_taps_are_unbiased(rng, n):
    rho = 0.6
    x = rng.normal(size=(20000, n))
    y = rho * x + np.sqrt(1 - rho**2) * rng.normal(size=x.shape)
    x, y = (v - v.mean(axis=1, keepdims=True) for v in (x, y))
    r = (x * y).sum(axis=1) / np.sqrt((x**2).sum(axis=1) * (y**2).sum(axis=1))
    assert abs(corrected(r, n).mean() - rho) < 0.015
    assert abs(r.mean() - rho) > 0.02
    assert_allclose(corrected([-1.0, 0.0, 1.0], n), [-1, 0, 1])


@pytest.mark.parametrize(("n", "tolerance"), [(3, 0.25), (4, 0.02), (7, 0.02)])
def test_squared_correlations_of_few_taps_are_unbiased(rng, n, tolerance):
    """But those of three taps, which are too small."""
    rho, sums = 0.6, []
    for _ in range(8000):
        x = rng.normal(size=(n, 2)) @ np.linalg.cholesky([[1, rho], [rho, 1]]).T
        sums.append(squared_correlations(unit_residuals(np.column_stack([x, np.ones(n)]))))
    assert abs(np.mean(sums) / 2 - rho**2) < tolerance


def test_squared_correlations_of_many_taps_are_the_sum_of_all(rng):
    units = unit_residuals(rng.normal(size=(4000, 3)) + rng.normal(size=(4000, 1)))
    r = np.corrcoef(units.T)
    assert_allclose(squared_correlations(units), (r**2).sum() - 3, atol=0.003)


def test_partial_autocorrelations_solve_the_equations_of_yule_and_walker():
    rho = np.array([1.0, 0.6, 0.5, 0.1, 0.2])
    expected = [1.0] + [solve_toeplitz(rho[:h], rho[1 : h + 1])[-1] for h in range(1, 5)]
    assert_allclose(partial_autocorrelation(rho), expected)
    assert_allclose(partial_autocorrelation(0.7 ** np.arange(6.0)), [1, 0.7, 0, 0, 0, 0], atol=1e-12)
    assert_array_equal(np.isnan(partial_autocorrelation(np.array([1.0, 0.9, -0.9, 0.5]))), [False, False, True, True])


def test_effective_samples_are_the_inverse_variance_of_a_mean():
    rho = 0.8 ** np.arange(7.0)
    assert_allclose(effective_samples(rho), 1 / toeplitz(rho).mean())
    assert_allclose(effective_samples(np.array([[1.0, 0, 0], [1, 1, 1], [1, -1, 1]])), [3, 1, 6])
    assert np.isnan(effective_samples(np.full(4, np.nan)))


def test_effective_numbers_of_a_process_are_those_of_its_correlation(rng):
    J, K, rho = 9, 3, 0.7
    found = time_dependence(*processes(rng, 40, 30, J, K, rho), permutations=19)
    correlation = toeplitz(rho ** np.arange(J))
    truth = {"samples": 1 / correlation.mean(), "values": K * J**2 / (correlation**2).sum()}
    for name, value in truth.items():
        low, middle, high = (float(found[f"effective_{name}{end}"]) for end in ("_low", "", "_high"))
        assert abs(middle - value) < 0.8 * (high - low), name
        assert low < middle < high
        assert_allclose(middle, value, rtol=0.05)
    inside = (found["autocorrelation_low"] < rho ** np.arange(J)) & (
        rho ** np.arange(J) < found["autocorrelation_high"]
    )
    assert inside.values[1:].mean() > 0.7
    assert_allclose(found["partial"].values[:3], [1, rho, 0], atol=0.05)


def test_independent_values_are_worth_their_number(rng):
    taps, stratum = processes(rng, 50, 9, 6, 4, 0.0)
    found = time_dependence(taps, stratum, permutations=19)
    assert found["values"] == 24
    assert_allclose(found["effective_values"], 24, rtol=0.1)
    assert_allclose(found["effective_samples"], 6, rtol=0.15)


def test_taxels_that_say_the_same_are_one(rng):
    """Also where they say it with opposite signs."""
    taps, stratum = processes(rng, 40, 8, 5, 1, 0.0)
    one = time_dependence(taps, stratum, permutations=9)
    doubled = time_dependence(np.concatenate([taps, 3 - 2 * taps, taps], axis=2), stratum, permutations=9)
    assert_allclose(doubled["effective_values"], 5, rtol=0.1)
    assert_allclose(doubled["effective_samples"], one["effective_samples"])
    assert doubled["values"] == 15


def test_noise_that_remembers_is_found_in_time_and_not_across_taxels(rng):
    taps, stratum = processes(rng, 8, 10, 6, 3, 0.5)
    along, across = time_dependence(taps, stratum, permutations=199), taxel_dependence(taps, stratum, permutations=199)
    assert_array_equal(along["p"], 1 / 200)
    assert along["rejected"].all()
    assert (across["family_p"] > 0.01).all()


def test_dependence_of_late_samples_only_is_found_by_any_lag(rng):
    taps = rng.normal(size=(100, 5, 2))
    taps[:, 4] += taps[:, 0]
    found = time_dependence(taps, np.repeat(np.arange(5), 20), permutations=199)
    assert found["p"].values[0] > 0.05
    assert found["p"].values[1] == 1 / 200
    near = time_dependence(taps, np.repeat(np.arange(5), 20), permutations=199, lags=3)
    assert near["p"].values[1] > 0.05
    assert near.attrs["lags"] == 3


@pytest.mark.slow
def test_the_tests_hold_their_level():
    """On taps whose taxels depend on each other at each sample and samples do not on each other."""
    n, rejects = 100, np.zeros(2)
    for seed in range(n):
        rng = np.random.default_rng(seed)
        taps = rng.normal(size=(24, 4, 3)) + 2 * rng.normal(size=(24, 4, 1))
        rejects += time_dependence(taps.round(), np.repeat(np.arange(4), 6), permutations=19, seed=seed)["p"] <= 0.05
    assert (rejects >= binom.ppf(0.001, n, 0.05)).all()
    assert (rejects <= binom.isf(0.001, n, 0.05)).all()


def test_taxels_in_another_order_say_the_same(rng):
    taps, stratum = processes(rng, 6, 5, 4, 3, 0.3)
    here = time_dependence(taps, stratum, permutations=49)
    there = time_dependence(taps[:, :, [2, 0, 1]], stratum, permutations=49)
    assert_allclose(there["lag1"], here["lag1"].values[[2, 0, 1]])
    for name in ("autocorrelation_low", "effective_values_high", "p"):
        assert_allclose(there[name], here[name])


def test_dead_taxels_do_not_count(rng):
    taps, stratum = processes(rng, 6, 5, 4, 2, 0.3)
    dead = np.concatenate([np.tile(stratum[:, None, None], (1, 4, 1)), taps], axis=2)
    alone, found = (time_dependence(one, stratum, permutations=19) for one in (taps, dead))
    assert found["dead"].values.tolist() == [True, False, False]
    assert np.isnan(found["lag1"].values[0])
    for name in ("autocorrelation", "p", "values", "effective_values"):
        assert_allclose(found[name], alone[name])


@pytest.mark.parametrize(
    ("shape", "stratum", "reason"),
    [
        ((8, 1, 3), [0] * 8, "taps have 1 sample"),
        ((8, 0, 3), [0] * 8, "taps have 0 samples"),
        ((3, 4, 2), [0, 1, 2], "no stratum has two taps"),
        ((0, 4, 2), [], "no stratum has two taps"),
    ],
)
def test_what_says_nothing_has_a_reason(rng, shape, stratum, reason):
    found = time_dependence(rng.normal(size=shape), stratum, permutations=9)
    assert reason in str(found["reason"].values)
    assert np.isnan(found["p"]).all()
    assert np.isnan(found["effective_samples"])


def test_constant_taps_have_a_reason():
    found = time_dependence(np.ones((6, 4, 2)), np.zeros(6), permutations=9)
    assert "no taxel varies" in str(found["reason"].values)
    assert found["dead"].all()


def test_one_sample_still_has_effective_values(rng):
    taps = np.repeat(rng.normal(size=(60, 1, 1)), 3, axis=2)
    found = time_dependence(taps, np.repeat(np.arange(6), 10), permutations=9)
    assert_allclose(found["effective_values"], 1.0)


def test_strata_of_two_say_signs_only_and_no_effective_values(rng):
    found = time_dependence(rng.normal(size=(20, 4, 2)), np.repeat(np.arange(10), 2), permutations=19)
    assert np.isfinite(found["p"]).all()
    assert np.isnan(found["effective_values"])


def test_one_stratum_and_one_taxel_have_no_interval(rng):
    taps, stratum = processes(rng, 1, 30, 5, 1, 0.6)
    found = time_dependence(taps, stratum, permutations=99)
    assert found["p"].values[0] == 0.01
    assert np.isnan(found["effective_samples_low"])


@pytest.mark.parametrize("lags", [0, -1])
def test_a_lag_is_at_least_one(rng, lags):
    with pytest.raises(InputError, match=f"At least one lag is tested, got {lags}"):
        time_dependence(rng.normal(size=(6, 3, 2)), np.zeros(6), lags=lags)


def test_recorded_samples_of_a_fingertip_remember(shared_data):
    taps = load_taps(shared_data / "braille_icub.npz")
    found = time_dependence(taps.taps, 2 * taps.dataset["what"].values + taps.session, permutations=99)
    assert_array_equal(found["p"], 0.01)
    assert found["effective_samples"] < 0.5 * taps.taps.shape[1]
