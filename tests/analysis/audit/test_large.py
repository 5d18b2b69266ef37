"""Audits of recordings on disk: what counts samples reads them in blocks, with the results of taps in memory."""

import tracemalloc

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.audit.dependence.drift import contrasts, recorded_time
from solidtouch.analysis.audit.leakage.run import leakage
from solidtouch.analysis.audit.variance.causes import split_variance
from solidtouch.analysis.audit.variance.gains import tap_gains
from solidtouch.analysis.experiment.before_contact import leading_samples
from solidtouch.analysis.stats.evidence import evidence
from solidtouch.analysis.stats.right_exponent import right_sets
from solidtouch.models import blocks, storage
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.taps import TapSet

J, K = 6, 5


@pytest.fixture
def large(make_taps, tmp_path, monkeypatch):
    """Taps whose samples vary more from the third on, in memory, and the same read from their file by seven."""
    taps = make_taps(sessions=3)
    samples = taps.taps * np.array([0.0, 0.1, 1.0, 2.0, 3.0, 3.0])[:, None] + 0.1 * np.random.default_rng(1).normal(
        size=taps.taps.shape
    )
    taps = TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, samples)))
    taps.save(tmp_path / "taps.nc")
    monkeypatch.setattr(storage, "ON_DISK", 0)
    monkeypatch.setattr(blocks, "BLOCK", 7 * J * K * 8)
    return taps, TapSet.load(tmp_path / "taps.nc")


@pytest.fixture
def parts_only(large, monkeypatch):
    """Nobody may ask for all samples of a session or more."""
    asked = TapSet.taps.fget

    def some(taps):
        assert len(taps) < len(large[0]) / 3
        return asked(taps)

    monkeypatch.setattr(TapSet, "taps", property(some))


def own(taps):
    where, what = taps.indices(taps.grid())
    return where * taps.grid().M + what


def test_gains_are_the_same(large):
    """Means of cells are sums over blocks, and all else is of single taps."""
    found = [tap_gains(taps.doubles, own(taps), taps.session) for taps in large]
    for name in ("value", "error", "amplitude", "used"):
        np.testing.assert_allclose(getattr(found[1], name), getattr(found[0], name), rtol=1e-9, atol=1e-12)
    assert np.isfinite(found[0].value).any()
    assert isinstance(large[1].doubles, blocks.ScaledSamples)


def test_leading_samples_are_the_same(large):
    """From means and squares of classes."""
    expected, found = (leading_samples(taps.doubles, own(taps)) for taps in large)
    assert found[:2] == expected[:2]
    np.testing.assert_allclose(found.class_change, expected.class_change, rtol=1e-9)
    np.testing.assert_allclose(found.change, expected.change, rtol=1e-12)


def told(taps):
    return leakage(taps.select(taps.session < 2), taps.select(taps.session == 2), taps.grid(), pre=2).told


@pytest.mark.slow
def test_leakage_is_the_same(large, parts_only, monkeypatch):
    """Of samples before contact, whole taps, and taps less what comes before contact."""
    found = told(large[1])
    monkeypatch.undo()
    xr.testing.assert_allclose(found, told(large[0]))


def test_contrasts_read_their_taps_alone(large, parts_only):
    """At most two triples of a class and session."""
    key = [own(taps) * 3 + taps.session for taps in large]
    expected, found = (
        contrasts(taps.samples, of, recorded_time(taps), taps.session, 1) for taps, of in zip(large, key, strict=True)
    )
    np.testing.assert_array_equal(found.values, expected.values)


def test_evidence_reads_its_taps_alone(large, parts_only):
    """With the split of its variance by cause."""
    shares = []
    for taps in large:
        train, some = taps.select(taps.session == 0), np.arange(len(taps)) % 4 == 0
        model = fit(train, taps.grid(), bins=9)
        shares.append(split_variance(taps, evidence(train, taps, taps.grid(), model, some), resamples=9))
    xr.testing.assert_allclose(shares[1], shares[0])


def test_gains_hold_few_blocks_at_a_time(make_taps, tmp_path, monkeypatch):
    """Peak memory is a fraction of the recording."""
    taps = make_taps(repeats=20, J=50, K=20)
    taps.save(tmp_path / "taps.nc")
    size = taps.samples.nbytes
    monkeypatch.setattr(storage, "ON_DISK", 0)
    monkeypatch.setattr(blocks, "BLOCK", size // 50)
    large = TapSet.load(tmp_path / "taps.nc")
    tracemalloc.start()
    tap_gains(large.doubles, own(large), large.session)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < size


def test_data_of_a_right_model_are_held_once(make_taps, tmp_path, monkeypatch):
    """The samples of a class are read, shuffled between its taps and put down; those of the recording are not kept."""
    taps = make_taps(repeats=20, J=50, K=20)
    taps.save(tmp_path / "taps.nc")
    model, size = fit(taps, taps.grid(), bins=9), taps.samples.nbytes
    expected = right_sets(model, [taps.select(taps.session == s) for s in range(2)], np.random.default_rng(0))
    monkeypatch.setattr(storage, "ON_DISK", 0)
    large = TapSet.load(tmp_path / "taps.nc")
    sets = [large.select(large.session == s) for s in range(2)]
    tracemalloc.start()
    found = right_sets(model, sets, np.random.default_rng(0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.6 * size
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.samples.values, other.taps)
