"""Recordings that stay on disk: the same results as from memory, whatever the size of the blocks."""

import re
import tracemalloc

import numpy as np
import pytest
import xarray as xr
from slow_cases import slow_but
from solidtouch.analysis.inspect import quick_fit
from solidtouch.analysis.inspect.page import inspection_page
from solidtouch.analysis.inspect.run import inspect_taps
from solidtouch.inference.trials.records import tap_table
from solidtouch.models import blocks, storage
from solidtouch.models.blocks import block_length, over_blocks
from solidtouch.models.errors import InputError
from solidtouch.models.io.joining import joined
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.numpy_files import open_npz
from solidtouch.models.io.load import load_taps
from solidtouch.models.measurement import gaussian, matrix_normal, profile, profile_ar, profile_mvn, smooth, student
from solidtouch.models.measurement.fits.priors import CellPrior
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings
from solidtouch.models.splits import missing_sentence
from solidtouch.models.taps import TapSet
from solidtouch.models.training import training_taps

J, K = 6, 5
SIZES = {"1 tap": (1, ".nc"), "5 taps of a Zarr store": (5, ".zarr"), "more than all taps": (1000, ".nc")}


@pytest.fixture(params=SIZES.values(), ids=SIZES)
def on_disk(request, monkeypatch, tmp_path):
    """From a tap set to the same one read from its file block by block; nobody may ask for all of its samples."""
    step, ending = request.param

    def opened(taps, missing="refuse"):
        path = tmp_path / f"taps{ending}"
        if ending == ".nc":
            taps.save(path, force=True)
        else:
            write_zarr(taps, path)
        monkeypatch.setattr(storage, "ON_DISK", 0)
        monkeypatch.setattr(blocks, "BLOCK", step * J * K * taps.samples.dtype.itemsize)
        monkeypatch.setattr(TapSet, "taps", property(lambda _: pytest.fail("all samples were asked for")))
        return TapSet.load(path, missing)

    return opened


def each_in_blocks(fast, *others):
    """Models in blocks of every size; by default those that are fast, each in blocks of one size or some."""
    return pytest.mark.parametrize(
        ("name", "on_disk"),
        [
            pytest.param(
                name, size, id=f"{name}-{label}", marks=[pytest.mark.slow] * (size[0] not in fast.get(name, ()))
            )
            for name in (*fast, *others)
            for label, size in SIZES.items()
        ],
        indirect=["on_disk"],
    )


some_in_blocks = pytest.mark.parametrize(
    "on_disk",
    [pytest.param(size, id=label, marks=[pytest.mark.slow] * (size[0] != 5)) for label, size in SIZES.items()],
    indirect=True,
)
"""By default in blocks of some taps, which are not all of the same length."""


def write_zarr(taps, path):
    """A store with chunks of seven taps and two taxels."""
    taps.dataset.to_zarr(path, mode="w", consolidated=False, encoding={"taps": {"chunks": (7, J, 2)}})


def with_gaps(taps):
    """Taps without a seventh of their samples, one taxel that is dead, and one tap without any sample."""
    gaps = np.random.default_rng(0).random(taps.taps.shape) < 1 / 7
    gaps[..., 2] = gaps[11] = True
    return TapSet(taps.dataset.assign(taps=taps.dataset["taps"].where(~gaps)).assign_attrs(missing="drop"))


def fitted(taps, name="histogram", **more):
    model = fit_model(name, taps, taps.grid(), FitSettings(bins=9, **more)).model
    return model.with_scores(taps)


def same_arrays(model, other, rtol=0.0):
    for group, values in model.groups().items():
        for name, array in values.variables.items():
            compared = np.testing.assert_array_equal
            if array.dtype.kind == "f" and rtol:
                compared = lambda a, b, **told: np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol, **told)  # noqa: E731
            compared(array.values, other.groups()[group][name].values, err_msg=f"{group} {name}")


@pytest.mark.parametrize("value_range", slow_but(["taxel"], ["global", "taxel"]))
def test_histograms_are_the_same(on_disk, make_taps, value_range):
    """With edges, digests and novelty scores, where some taps are outside the grid and classes in no order."""
    taps = make_taps(repeats=2)
    taps = taps.select(np.random.default_rng(3).permutation(len(taps)))
    grid = taps.grid().select(range(2), [0, 2, 3])
    settings = FitSettings(bins=9, value_range=value_range)
    expected = fit_model("histogram", taps, grid, settings).model.with_scores(taps)
    large = on_disk(taps)

    same_arrays(fit_model("histogram", large, grid, settings).model.with_scores(large), expected)


@pytest.fixture
def given_prior(monkeypatch):
    """Variances have a fixed prior: the search for the most probable one turns rounding into differences of 1e-4."""
    for module in (gaussian, profile, profile_ar, profile_mvn, smooth):
        monkeypatch.setattr(module, "estimated_prior", lambda *_: CellPrior(0.0, 0.0, np.full(K, 2.0), np.full(K, 2.0)))


@each_in_blocks({"profile-mvn": [1], "profile-ar": [5], "smooth": [5], "session:profile": [5]}, "gaussian", "profile")
def test_sums_of_blocks_make_the_same_model(on_disk, given_prior, make_taps, name):
    """Where sufficient statistics are sums, up to the rounding of sums in parts."""
    taps = make_taps(M=2, repeats=2)
    taps = taps.select(np.random.default_rng(3).permutation(len(taps)))
    expected = fitted(taps, name)

    same_arrays(fitted(on_disk(taps), name), expected, 1e-12)


@some_in_blocks
def test_both_covariances_are_found_in_blocks(on_disk, make_taps):
    """Every round of the ascent goes through all taps, twice; sums differ by rounding."""
    taps = make_taps(L=2, M=2, repeats=2)
    taps = taps.select(np.random.default_rng(3).permutation(len(taps)))
    expected = fitted(taps, "matrix-normal")

    same_arrays(fitted(on_disk(taps), "matrix-normal"), expected, 1e-9)


@pytest.mark.parametrize(
    ("name", "repeats", "K", "part"),
    [("matrix-normal", 100, 20, 0.5), pytest.param("student", 200, 5, 0.9, marks=pytest.mark.slow)],
)
def test_a_fit_holds_few_blocks_at_a_time(make_taps, tmp_path, monkeypatch, name, repeats, K, part):
    """Peak memory is a fraction of the recording, and the model that of the same recording in memory.

    JAX takes some megabytes to trace the fit of `student` where it has not done so before.
    """
    taps = make_taps(repeats=repeats, J=50, K=K)
    taps.save(tmp_path / "taps.nc")
    size = taps.samples.nbytes
    monkeypatch.setattr(storage, "ON_DISK", 0)
    monkeypatch.setattr(blocks, "BLOCK", size // 50)
    monkeypatch.setattr(matrix_normal, "_ROUNDS", 2)
    monkeypatch.setattr(student, "_STEPS", 100)
    monkeypatch.setattr(student, "_RUNS", 1)
    large = TapSet.load(tmp_path / "taps.nc")
    expected = fitted(TapSet(taps.dataset), name, unconverged=True)

    tracemalloc.start()
    found = fitted(large, name, unconverged=True)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < part * size
    same_arrays(found, expected, 1e-9)


def test_a_large_recording_has_nearly_the_same_prior(on_disk, make_taps):
    """As far as the search for it is sure: variances are equal here, so the evidence hardly depends on it."""
    taps = make_taps(M=2, repeats=2)
    expected = fitted(taps, "profile")

    same_arrays(fitted(on_disk(taps), "profile"), expected, 1e-2)


@each_in_blocks({"gaussian": [1], "profile": [5]})
def test_sums_leave_missing_samples_out(on_disk, given_prior, make_taps, name):
    """A class without any sample of a taxel is refused by the sentence that says so in memory."""
    taps = with_gaps(make_taps(M=2, repeats=2))
    empty = taps.dataset.copy(deep=True)
    empty["taps"][(taps.what == 1) & (taps.where == 3.0), :, 4] = np.nan
    empty, expected = TapSet(empty), fitted(taps, name)
    with pytest.raises(InputError, match=r"samples of taxel 4.* are missing for position 2 and object 1") as refused:
        fitted(empty, name)

    same_arrays(fitted(on_disk(taps, "drop"), name), expected, 1e-12)
    with pytest.raises(InputError) as again:
        fitted(on_disk(empty, "drop"), name)
    assert str(again.value) == str(refused.value)


def test_missing_samples_are_left_out_alike(on_disk, make_taps):
    """A dead taxel, an empty tap and gaps everywhere."""
    taps = with_gaps(make_taps(M=2, repeats=3))
    expected, told = fitted(taps), missing_sentence([taps], "taps")
    known = training_taps(taps.select(slice(0, 25)), expected.training)
    large = on_disk(taps, "drop")

    same_arrays(fitted(large), expected)
    assert missing_sentence([large], "taps") == told
    np.testing.assert_array_equal(training_taps(large.select(slice(0, 25)), expected.training), known)


@each_in_blocks({"profile": [1, 5, 1000], "histogram": [5], "gaussian": [5]})
def test_tables_of_trials_are_the_same(on_disk, make_taps, name):
    """Likelihoods of test taps are computed from blocks, in the order of the taps, also with missing samples."""
    taps = with_gaps(make_taps(M=2, repeats=4))
    model = fitted(taps.select(taps.session == 0), name)
    expected = tap_table(model, taps)
    found = tap_table(model, on_disk(taps, "drop"))

    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-12)
    np.testing.assert_array_equal(found.pool.order, expected.pool.order)


def pressed(taps):
    """Taps of a coarse sensor, two taxels of which are cut off at one end and one of which is constant."""
    samples = np.round(4 * taps.taps) / 4
    samples[..., 1] = np.minimum(samples[..., 1], 6.0)
    samples[..., 3] = -np.minimum(samples[..., 3], 6.0)
    samples[..., 4] = 2.0
    samples[:, 0, [1, 3]] = 0.0
    samples[[5, 20]] = samples[[4, 19]]
    return TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, samples)))


def printed(taps):
    return repr(inspection_page(inspect_taps(taps, taps.grid())))


def test_an_inspection_is_the_same(on_disk, make_taps, monkeypatch):
    """Constant and saturated taxels, ranges, copies of taps, and all else that is printed of a large recording."""
    monkeypatch.setattr(quick_fit, "MOST_SAMPLES", 0)  # what stays on disk is too large for a quick fit
    taps = pressed(make_taps(repeats=2))
    expected = printed(taps)
    assert "2 of 5 taxels may be saturated" in expected
    assert "1 of 5 taxels are constant: 4." in expected

    assert printed(on_disk(taps)) == expected


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_bad_sample_is_found_in_its_block(on_disk, make_taps, value):
    """By the same sentence as in memory."""
    taps = make_taps(repeats=2)
    bad = taps.dataset.copy(deep=True)
    bad["taps"][40, 3, 2] = value
    with pytest.raises(InputError, match=r"^taps\[40, 3, 2\] is (nan|inf); ") as expected:
        TapSet(bad)
    object.__setattr__(taps, "dataset", bad)

    with pytest.raises(InputError) as found:
        on_disk(taps)
    assert re.search(r"taps\.(nc|zarr): ", str(found.value))
    assert str(found.value).endswith(str(expected.value))


def test_a_selection_is_written_on_disk(on_disk, make_taps, tmp_path):
    """With what is written from memory, in its order."""
    taps = make_taps(repeats=2, extra={"force": np.arange(48.0)})
    taps.select([20, 3, 40]).save(tmp_path / "expected.nc")
    on_disk(taps).select([20, 3, 40]).save(tmp_path / "written.nc")

    expected, written = (xr.load_dataset(tmp_path / name, engine="h5netcdf") for name in ("expected.nc", "written.nc"))
    xr.testing.assert_identical(written, expected)
    assert "force" in written.data_vars


@some_in_blocks
def test_recordings_are_joined_on_disk(on_disk, make_taps, tmp_path):
    """A large one behind a small one in single precision: written, selected and fitted as those in memory are."""
    small, taps = make_taps(sessions=1, repeats=2, seed=3), make_taps(sessions=1, repeats=2)
    small = TapSet(small.dataset.assign(taps=small.dataset["taps"].astype(np.float32)))
    expected = joined([small, taps], ["a", "b"])
    expected.save(tmp_path / "expected.nc")
    model, index = fitted(expected, "session:histogram"), np.random.default_rng(0).permutation(len(expected))[:30]
    chosen = expected.taps[index]

    large = joined([small, on_disk(taps)], ["a", "b"])
    large.save(tmp_path / "written.nc")

    written, whole = (xr.load_dataset(tmp_path / name, engine="h5netcdf") for name in ("written.nc", "expected.nc"))
    xr.testing.assert_identical(written, whole)
    same_arrays(fitted(large, "session:histogram"), model, 1e-12)
    np.testing.assert_array_equal(large.select(index).samples.values, chosen)
    np.testing.assert_array_equal(large.samples[-1, 2:, [4, 0]].values, expected.samples[-1, 2:, [4, 0]].values)
    np.testing.assert_array_equal(large.extremes, expected.extremes)


def test_a_large_archive_is_mapped(make_taps, arrays_of, tmp_path, monkeypatch):
    """If it is not compressed; a bad sample is found by the same sentence, and so is an end that is missing."""
    taps = make_taps()
    arrays = arrays_of(taps)
    np.savez(tmp_path / "taps.npz", **arrays)
    np.savez_compressed(tmp_path / "small.npz", **arrays)
    bad = arrays["taps"].copy()
    bad[100, 3, 2] = np.nan
    np.savez(tmp_path / "bad.npz", **arrays | {"taps": np.asfortranarray(bad)})
    with pytest.raises(InputError) as refused:
        load_taps(tmp_path / "bad.npz")
    monkeypatch.setattr(storage, "ON_DISK", 1000)
    monkeypatch.setattr(blocks, "BLOCK", 7 * J * K * 8)

    mapped, read = (
        open_npz(tmp_path / name, TextTable()).read(["taps"])[0]["taps"] for name in ("taps.npz", "small.npz")
    )
    assert isinstance(mapped, np.memmap)
    assert isinstance(read, np.memmap)
    np.testing.assert_array_equal(mapped, read)
    large, expected = load_taps(tmp_path / "taps.npz"), fitted(taps, "session:profile")
    with monkeypatch.context() as patched:
        patched.setattr(TapSet, "taps", property(lambda _: pytest.fail("all samples were asked for")))
        same_arrays(fitted(large.select(slice(None)), "session:profile"), expected, 1e-2)
    np.testing.assert_array_equal(large.select([5, 3]).samples.values, taps.taps[[5, 3]])
    with pytest.raises(InputError, match=r"bad\.npz: taps\[100, 3, 2\] is nan") as found:
        load_taps(tmp_path / "bad.npz")
    assert str(found.value) == str(refused.value)


def test_samples_that_are_asked_for_come_into_memory(make_taps, tmp_path, monkeypatch):
    """Once; the file is not needed after that."""
    taps = make_taps()
    taps.save(tmp_path / "taps.nc")
    monkeypatch.setattr(storage, "ON_DISK", 0)
    large = TapSet.load(tmp_path / "taps.nc")
    (tmp_path / "taps.nc").unlink()

    np.testing.assert_array_equal(large.taps, taps.taps)
    assert large.taps is large.taps
    np.testing.assert_array_equal(large.select([3, 1]).taps, taps.taps[[3, 1]])


def test_blocks_come_in_order_with_what_failed(monkeypatch):
    """Even where threads work on several at a time."""
    samples = np.arange(60.0).reshape(20, 3, 1)
    monkeypatch.setattr(blocks, "BLOCK", 7 * 24)
    assert block_length(samples) == 7
    chunks = [
        xr.Variable(("tap", "sample", "taxel"), samples, encoding={"preferred_chunks": {"tap": n}})
        for n in (3, 7, 10, 28, 29)
    ]
    assert [block_length(one) for one in chunks] == [9, 7, 10, 28, 7]  # whole chunks, unless a chunk is very long

    found = list(over_blocks(samples, lambda block, which: (which, block.sum()), workers=3))
    assert [which for which, _ in found] == [slice(0, 7), slice(7, 14), slice(14, 20)]
    assert [total for _, total in found] == [samples[which].sum() for which, _ in found]
    with pytest.raises(ZeroDivisionError):
        list(over_blocks(samples, lambda *_: 1 / 0, workers=3))
