"""Tests of taxels that may drift: contrasts, level where taxels drift by themselves, and power."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import binom
from solidtouch.analysis.audit.dependence.drift import (
    against_drift,
    contrasts,
    recorded_time,
    triple_weights,
    triples,
)
from solidtouch.analysis.audit.dependence.taxels import TESTS, taxel_dependence
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

C, N, J, K = 5, 18, 2, 3
"""Classes in turns, taps of each, samples, taxels."""


def drifting(seed, drift, *, common=0.0):
    """Taps of one session with the drift (C N, K) of each taxel, their classes and times."""
    rng = np.random.default_rng([seed, 4])
    T = C * N
    taps = rng.normal(size=(T, J, K)) + common * rng.normal(size=(T, 1, 1)) + drift(rng, T)[:, None, :]
    return taps, np.tile(np.arange(C), N), np.arange(T)


def still(rng, T):
    return np.zeros((T, K))


def line(rng, T):
    return np.linspace(-5, 5, T)[:, None] * np.array([1.0, -0.5, 2.0])


def walk(rng, T):
    return 8 * rng.normal(size=(T, K)).cumsum(axis=0)


def probed(taps, stratum, time, permutations=99, seed=0):
    whole = taxel_dependence(taps, stratum, permutations=permutations, seed=seed)
    local = contrasts(taps, stratum, time, np.zeros(len(time), dtype=int))
    return against_drift(whole, local, permutations=permutations, seed=seed)


def test_contrasts_leave_nothing_of_a_line(rng):
    """At any times, with the variance of independent noise unchanged."""
    time = np.sort(rng.random((40, 3)), axis=1) * 50
    weight = triple_weights(time)
    assert_allclose((weight * (3 - 0.7 * time)).sum(axis=1), 0.0, atol=1e-12)
    assert_allclose((weight**2).sum(axis=1), 1.0)


def test_triples_are_neighbours_and_do_not_overlap():
    stratum = np.array([7, 2, 7, 7, 2, 7, 7, 7, 2, 7])
    time = np.array([9, 8, 7, 6, 5, 4, 3, 2, 1, 0])
    assert triples(stratum, time).tolist() == [[8, 4, 1], [9, 7, 6], [5, 3, 2]]
    assert triples([0, 0, 1], [0, 1, 2]).shape == (0, 3)


def test_contrasts_are_weighted_sums_of_their_taps(rng):
    taps, stratum, time = drifting(1, still)
    found = contrasts(taps, stratum, time, np.full(len(time), 4), most=3)
    three = triples(stratum, time)
    assert_array_equal(np.bincount(found.stratum), [3] * C)
    assert_array_equal(found.session, 4)
    assert_allclose(found.values[0], np.tensordot(triple_weights(time[three[:1]])[0], taps[three[0]], 1))


def test_time_is_the_recorded_order():
    """By trial numbers where they number the session, else by the order in the file."""
    taps = TapSet.from_arrays(
        np.zeros((7, 1, 1)),
        np.zeros(7, dtype=int),
        ["a"],
        session=[0, 1, 0, 1, 0, 1, 1],
        trial=[5, 0, 2, 1, 9, 0, 1],
        preprocessing=Preprocessing(samples=1),
    )
    assert recorded_time(taps).tolist() == [1, 0, 0, 1, 2, 2, 3]


@pytest.mark.slow
def test_taxels_that_drift_by_themselves_are_found_by_whole_taps_only():
    """A line in each taxel: contrasts give what they give without it."""
    found, without = probed(*drifting(3, line)), probed(*drifting(3, still))
    assert_array_equal(found["family_p"], 0.01)
    assert_allclose(found["drift_p"], without["drift_p"])
    assert (found["drift_p"] > 0.05).all()
    assert_array_equal(found["rejected"], without["rejected"])
    assert_array_equal(found["contrasts"], C * N // 3)
    assert_array_equal(found["drift_reason"], "")


@pytest.mark.slow
def test_noise_common_to_taxels_is_found_by_contrasts():
    found = probed(*drifting(1, line, common=2.0))
    assert_array_equal(found["drift_p"].sel(test=["rank", "distance"]), 0.01)
    assert found["rejected"].sel(test="rank").values.sum() == K * (K - 1)


@pytest.mark.slow
def test_random_walks_of_taxels_keep_the_level():
    """Classes in turns share the walk, so they are permuted alike; each by itself ranks reject in one of three."""
    n, rejects = 60, np.zeros(len(TESTS))
    for seed in range(n):
        rejects += probed(*drifting(seed, walk), permutations=19, seed=seed)["drift_p"].values <= 0.05
    assert (rejects <= binom.isf(0.001, n, 0.05)).all()


def test_too_few_taps_have_a_reason():
    """Five taps of a class give one contrast, ten give three: enough for ranks only."""
    for taps_per_class, tests in ((5, 0), (10, 1), (12, 3)):
        taps, stratum, time = (part[: C * taps_per_class] for part in drifting(1, still))
        found = probed(taps, stratum, time)
        reasons = found["drift_reason"].values
        assert np.count_nonzero(reasons == "") == tests
        assert np.isfinite(found["drift_p"].values).tolist() == (reasons == "").tolist()
        assert np.isfinite(found["family_p"]).all()
        if tests < 3:
            assert "it takes 12 taps of a class and session" in reasons[-1]


def test_without_order_in_time_only_whole_taps_are_tested():
    taps, stratum, _ = drifting(1, still)
    whole = taxel_dependence(taps, stratum, permutations=19)
    found = against_drift(whole, None)
    assert (found["drift_reason"] == "sessions have one tap of a class each").all()
    assert np.isnan(found["drift_p"]).all()
    assert_array_equal(found["p"], whole["p"])
    one = taxel_dependence(taps[:, :, :1], stratum, permutations=19)
    assert all("one taxel" in reason for reason in against_drift(one, None)["drift_reason"].values)


@pytest.mark.parametrize("sizes", [(6, 6), (6, 7)])
def test_strata_of_one_label_and_size_are_permuted_alike(rng, sizes):
    """Then copies of a stratum have the statistic of one alone, twice; strata of other sizes have not."""
    one = rng.normal(size=(sizes[0], 2, 2))
    more = np.concatenate([one, rng.normal(size=(sizes[1] - sizes[0], 2, 2))])
    alone = taxel_dependence(one, np.zeros(len(one)), permutations=39, together=np.zeros(len(one)))
    stratum = np.repeat([0, 1], sizes)
    both = taxel_dependence(
        np.concatenate([one, more]), stratum, permutations=39, together=np.zeros(len(stratum), dtype=int)
    )
    assert (float(both["family_z"][0]) == pytest.approx(float(alone["family_z"][0]))) is (sizes == (6, 6))
