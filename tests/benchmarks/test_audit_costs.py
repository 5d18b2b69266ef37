"""The studies of promises and of wanted errors run, and tell what they should from what they are given."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.guarantees import PROMISED, USED
from solidtouch.analysis.stats.target_error import Curves, choose
from solidtouch.hardware.simulator.settings import preset

from benchmarks.studies.audit import guarantees, target


@pytest.fixture(scope="module")
def drawn(make_model):
    """Taps of two samples from a small model that is right about them."""
    study = guarantees
    model = make_model(L=5, M=3, K=3, J=9, B=6, taps=8, power="none", pseudocount=0.5)
    return study.drawn(model, 2, study.Sizes(pools=4, taps_per_class=400, trials=3000), 1)


def test_promises_hold_where_the_model_is_right(drawn):
    """At every threshold, passive and active, with errors enough that they might not."""
    promised = drawn.pools.sel(setup=PROMISED)
    assert drawn.samples == 2
    assert drawn.repeats.shape == (2, len(guarantees.THETAS))
    assert (drawn.repeats >= 0).all()
    assert (drawn.repeats < 0.05).all()
    assert (promised.wrong.sel(what="all", theta=0.8) > 0.02).all()
    for policy in ("passive", "active"):
        for theta in guarantees.THETAS:
            assert guarantees.holds(promised.sel(policy=policy, theta=theta))
        ratio, low, high = guarantees.calibration(promised.sel(policy=policy, theta=0.8))
        assert low <= ratio <= high
        assert 0.85 < ratio < 1.15


def test_taps_have_the_samples_asked_for(make_model):
    """And a likelihood without a root."""
    own = guarantees.of_samples(make_model(J=9, power="none"), 2)
    assert own.preprocessing.samples == 2
    assert own.exponent == 1


def pools_of(wrong, limit, doubt=0.05):
    """Guarantees of one setup, policy and threshold: wrong fractions (pool, what) beside limits (what)."""
    wrong = np.asarray(wrong, dtype=np.float64)
    names = ["all", *(f"rod {m}" for m in range(wrong.shape[1] - 1))]
    data = {
        "wrong": (("pool", "what"), wrong),
        "doubt": (("pool", "what"), np.full(wrong.shape, doubt)),
        "limit": ("what", np.asarray(limit, dtype=np.float64)),
    }
    return xr.Dataset(data, {"what": names})


def test_a_promise_broken_by_one_object_does_not_hold():
    """Beyond the error of the pools; within it, it does."""
    noise = 0.01 * np.array([[-1.0], [0.0], [1.0], [0.5], [-0.5]])
    assert guarantees.holds(pools_of(noise + np.array([0.05, 0.1, 0.1]), [0.05, 0.2, 0.2]))
    assert not guarantees.holds(pools_of(noise + np.array([0.05, 0.1, 0.3]), [0.05, 0.2, 0.2]))
    assert not guarantees.holds(pools_of(noise + np.array([0.09, 0.1, 0.1]), [0.05, 0.2, 0.2]))


def test_calibration_is_the_ratio_of_means_with_an_interval():
    """Its half width is that of the mean of wrong less ratio times doubt, over the mean doubt."""
    wrong = np.array([0.04, 0.05, 0.09])
    ratio, low, high = guarantees.calibration(pools_of(np.stack([wrong, wrong], axis=1), [0.1, 0.1]))
    half = 4.302653 * wrong.std(ddof=1) / np.sqrt(3) / 0.05
    assert (ratio, low, high) == pytest.approx((1.2, 1.2 - half, 1.2 + half), rel=1e-5)


def test_rigs_break_the_promises_and_the_page_says_how_much(drawn):
    """Of a session of the paper's rig, tested on another."""
    study = guarantees
    sizes = study.Sizes(pools=4, taps_per_class=400, trials=3000, data_sets=2, rig_trials=300)
    rig = study.on_rig("paper", sizes, 1)
    assert rig.sizes["pool"] == 2
    assert (rig.factor.sel(setup=PROMISED, theta=0.95, what="all") > 5).all()

    page = study.page([drawn], {"paper": rig}, sizes, 1)
    assert "the bounds hold in 6 of 6 rows" in page
    assert page.count("| 2 | clamp |") == 6
    assert page.count("| 2 | uniform | active |") == 3
    assert "| 2 | uniform | passive |" not in page
    assert page.count("| paper |") == 12
    assert list(study.BORDERS) == [PROMISED, USED]


def tuning_of(error):
    error = np.asarray(error, dtype=np.float64)
    theta = 1 - np.geomspace(0.5, 1e-3, error.shape[1])
    return Curves(theta, error, error[..., np.newaxis], 1.0 + np.arange(error.size).reshape(error.shape), error)


def test_outcomes_are_judged_by_fresh_sessions():
    """Those that exceed a target that is called reachable break it; one in the interval is covered."""
    study = target
    tuning = tuning_of(np.tile([0.5, 0.3, 0.01], (5, 1)))
    fresh = np.array([[0.5, 0.3, 0.01], [0.5, 0.9, 0.9], [0.5, 0.3, 0.06], [0.4, 0.2, 0.0]])
    found = {one.target: one for one in study.outcomes(tuning, fresh)}

    for wanted, one in found.items():
        h, reachable = choose(tuning.error, wanted)
        assert one.theta == tuning.theta[h]
        assert one.reachable == reachable
        assert one.fresh == tuple(fresh[:, h])
        assert one.expected == pytest.approx(tuning.error[0, h])
    assert found[0.1].broken == [False, True, False, False]
    assert found[0.05].covered[:2] == [True, False]


@pytest.mark.slow
def test_a_data_set_of_the_paper_is_played_with_both_policies():
    """Drift makes small errors unreachable for passive perception."""
    study = target
    found = study.data_set(preset("paper"), 3, 60)
    assert set(found) == {"active", "passive"}
    assert [one.target for one in found["passive"]] == list(study.TARGETS)
    assert not any(one.reachable for one in found["passive"][:3])
    assert all(len(one.fresh) == study.FRESH for one in found["active"])
    page = study.page({"paper": [found, found]}, 3, 60)
    assert page.startswith("2 data sets of each rig, seed 3")
    assert "| paper | passive | 0.05, 0.1, 0.2" in page
    assert "of 2 |" in page


def test_rigs_differ_in_their_drift_only():
    """By the factor that their names say."""
    rigs = target.rigs()
    assert rigs["half drift"].mounting_x_mm == preset("paper").mounting_x_mm / 2
    assert rigs["double drift"].session_gain_log_sd == 2 * preset("paper").session_gain_log_sd
    assert rigs["double drift"].white_counts == preset("paper").white_counts
    assert rigs["nodrift"] == preset("nodrift")
