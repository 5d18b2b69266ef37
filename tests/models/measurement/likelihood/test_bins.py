"""Bins and counts of samples, from loops that guess where equal widths would put them."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from solidtouch.inference import reference
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.likelihood.bins import count_taps, find_bins, tap_counts

FINITE = st.floats(-1e12, 1e12)


@st.composite
def edges_and_samples(draw):
    """Increasing edges, equally wide or not, and samples on, beside, between and outside them."""
    if draw(st.booleans()):
        low, width = draw(st.floats(-1e6, 1e6)), draw(st.floats(1e-3, 1e6))
        edges = np.linspace(low, low + width, draw(st.integers(2, 12)))
    else:
        edges = np.unique(draw(hnp.arrays(np.float64, st.integers(2, 12), elements=FINITE, unique=True)))
    near = np.concatenate([edges, np.nextafter(edges, -np.inf), np.nextafter(edges, np.inf)])
    anything = st.floats(allow_nan=False) | st.sampled_from(near.tolist())
    return edges, draw(hnp.arrays(np.float64, st.integers(1, 30), elements=anything))


@settings(max_examples=200, deadline=None)
@given(edges_and_samples())
def test_bins_are_those_of_the_reference_for_every_number(case):
    """Edges, their neighbours, infinite and huge values, in double and in single precision."""
    edges, samples = case
    with np.errstate(over="ignore"):
        single = samples.astype(np.float32)
    for values in (samples, single):
        np.testing.assert_array_equal(find_bins(values[:, np.newaxis], edges)[:, 0], reference.bin_index(values, edges))


@pytest.mark.parametrize("edges", [[-1.7e308, 0.0, 1.7e308], [0.0, 5e-324, 1e-323], [1.0, np.nextafter(1.0, 2), 1e300]])
def test_extreme_edges_are_no_exception(edges):
    """Widths that overflow or hardly exist give no guess, but the right bin."""
    edges = np.array(edges)
    samples = np.array([-np.inf, -1.0, 0.0, 5e-324, 1.0, 1.5, 1e301, np.inf])

    np.testing.assert_array_equal(find_bins(samples[:, np.newaxis], edges)[:, 0], reference.bin_index(samples, edges))


@pytest.mark.parametrize("dtype", [np.uint8, np.int64, np.float16, ">f4", ">f8", bool])
def test_samples_of_any_kind_are_counted(rng, dtype):
    """They need not be contiguous, nor open for writing."""
    samples = (3 * rng.random((4, 5, 3))).astype(dtype)[:, ::2]
    samples.flags.writeable = False
    edges = np.linspace(-0.5, 3.5, 6)
    bins = np.stack([reference.bin_index(samples[..., k], edges) for k in range(3)], axis=-1)

    np.testing.assert_array_equal(find_bins(samples, edges), bins)
    np.testing.assert_array_equal(dense(samples, edges), np.concatenate([*tap_counts(bins, 5)]))


def test_a_nan_is_in_no_bin(rng):
    """Among other samples its bin is -1, and it is not counted; an infinite one is refused."""
    samples = rng.random((3, 4, 2))
    samples[1, 2, 1] = np.nan
    bins = find_bins(samples, np.linspace(0, 1, 5))

    assert np.argwhere(bins < 0).tolist() == [[1, 2, 1]]
    assert np.concatenate(list(tap_counts(bins, 4))).sum(axis=1).tolist() == [8, 7, 8]
    np.testing.assert_array_equal(dense(samples, np.linspace(0, 1, 5)), np.concatenate(list(tap_counts(bins, 4))))
    samples[1, 2, 1] = np.inf
    with pytest.raises(InputError, match="Samples must not be NaN or infinite"):
        list(count_taps(samples, np.linspace(0, 1, 5)))


@pytest.mark.parametrize("shape", [(1, 1, 1), (7, 1, 3), (2, 9, 1), (40, 6, 5), (0, 6, 5)])
@pytest.mark.parametrize("B", [1, 2, 11])
@pytest.mark.parametrize("at_a_time", [1, 70, 10**9])
def test_counts_are_those_of_a_loop(rng, monkeypatch, shape, B, at_a_time):
    """For any sizes and chunks; every cell is listed once, with a count above zero."""
    monkeypatch.setattr("solidtouch.models.measurement.likelihood.bins._SAMPLES", at_a_time)
    N, J, K = shape
    samples, edges = rng.normal(size=shape), np.sort(rng.normal(size=(K, B + 1)), axis=1)
    expected = np.zeros((N, K * B))
    for n in range(N):
        for k in range(K):
            for b in reference.bin_index(samples[n, :, k], edges[k]):
                expected[n, k * B + b] += 1

    np.testing.assert_array_equal(dense(samples, edges), expected.reshape(N, K * B))
    assert expected.sum() == N * J * K


def dense(samples, edges):
    """The counts of taps with their zeros."""
    counts = np.zeros((len(samples), samples.shape[2] * (edges.shape[-1] - 1)))
    for which, part in count_taps(samples, edges):
        for n, (first, end) in enumerate(pairwise(part.first), start=which.start):
            assert len(set(part.cell[first:end])) == end - first
            assert (part.times[first:end] > 0).all()
            counts[n, part.cell[first:end]] = part.times[first:end]
    return counts


def test_memory_is_bounded_by_a_chunk(make_model, tmp_path):
    """Taps and log-likelihoods of 50 and 100 MB, both on disk, pass through a few MB."""
    model = make_model(L=20, M=31, K=6, J=100)
    taps = np.lib.format.open_memmap(tmp_path / "taps.npy", "w+", np.float32, (20000, 100, 6))
    taps[::13] = 0.7
    out = np.lib.format.open_memmap(tmp_path / "out.npy", "w+", np.float64, (20000, 20, 31))
    expected = model.log_likelihood(taps[:40])
    tracemalloc.start()
    written = model.log_likelihood(taps, out)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()

    assert written is out
    assert peak < 8e6
    np.testing.assert_array_equal(out[:40], expected)
    np.testing.assert_array_equal(out[13 * 1500 : 13 * 1500 + 40], expected)


def test_log_likelihoods_can_be_written_to_a_store(make_model, draw_samples):
    """Anything that takes slices will do, if it has the right shape."""
    model = make_model(pseudocount=0.0)
    samples = draw_samples(model, 6)
    store = zarr.create_array({}, shape=(6, 3, 4), chunks=(4, 3, 4), dtype="f8")

    assert model.log_likelihood(samples, store) is store
    np.testing.assert_array_equal(store[:], model.log_likelihood(samples))
    with pytest.raises(InputError, match=r"out must have shape \(6, 3, 4\), got \(5, 3, 4\)"):
        model.log_likelihood(samples, np.empty((5, 3, 4)))


def test_log_likelihoods_of_bins_are_those_of_their_samples(make_model, draw_samples):
    model = make_model(3, 2, 2, 6, 5, pseudocount=0.5, taps=9)
    taps = draw_samples(model, 40)
    bins = model.bins(taps)

    np.testing.assert_array_equal(model.prepared.of_bins(bins, model.exponent), model.log_likelihood(taps))

    bins[7, 3, 1] = -1
    taps[7, 3, 1] = np.nan
    expected = model.with_missing("drop").log_likelihood(taps)
    np.testing.assert_allclose(model.prepared.of_bins(bins, model.exponent), expected, rtol=1e-12)
