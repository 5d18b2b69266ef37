"""Round trips through every file kind, recorded data, and files that are something else."""

import shutil
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps, read_recording, taps_of
from solidtouch.models.taps import TapSet

KINDS = ("nc", "zarr", "npz", "mat5", "mat73", "csv")
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256))


def assert_same(expected, actual):
    """Everything but the source, which names the file kind in some layouts, is the same."""
    assert set(expected.dataset.variables) == set(actual.dataset.variables)
    for name, variable in expected.dataset.variables.items():
        other = actual.dataset[name]
        assert variable.dims == other.dims, name
        np.testing.assert_array_equal(variable.values, other.values, err_msg=str(name))
    assert expected.preprocessing == actual.preprocessing


@pytest.mark.parametrize("kind", KINDS)
@given(
    sizes=st.permutations([2, 3, 4, 5]),
    rate=st.sampled_from([None, 40.0, 50.0, 128.0, 312.5]),
    seed=st.integers(0, 99),
    sized=st.booleans(),
)
@settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_round_trip_gives_the_same_tap_set(kind, sizes, rate, seed, sized, make_taps, writers, tmp_path_factory):
    """A tap set written in any layout is read as it was."""
    from solidtouch.models.preprocessing import Preprocessing

    L, M, J, K = sizes
    size = {"what_value": 2.0 + 2 * np.arange(M)} if sized else {}
    taps = make_taps(L, M, J, K, 2, 1, seed, preprocessing=Preprocessing(J, rate), **size)
    depth = np.arange(len(taps)) / 8
    more = {"depth": depth} if kind == "csv" else {"depth": depth, "offset": np.ones((len(taps), K))}
    taps = make_taps(L, M, J, K, 2, 1, seed, preprocessing=Preprocessing(J, rate), extra=more, **size)
    suffix, write = writers[kind]
    path = tmp_path_factory.mktemp("trip") / f"taps{suffix}"
    write(taps, path)

    read = load_taps(path)

    assert_same(taps, read)
    if kind != "csv":
        assert read.where_unit == "mm"


@pytest.mark.parametrize("kind", KINDS)
def test_missing_samples_are_read_where_they_are_to_be_dropped(kind, make_taps, writers, tmp_path):
    """In samples and nowhere else; infinite ones are refused all the same, and so is a tap set that lacks some."""
    whole, (suffix, write) = make_taps(2, 2, 3, 2, 1, 2), writers[kind]

    def written(value, name="taps", place=(1, 2, 0)):
        values = whole.dataset[name].values.copy()
        values[place] = value
        path = tmp_path / f"{name}{value}{suffix}"
        marked = whole.dataset.assign_attrs(missing="drop")
        if name == "taps" and np.isnan(value):
            write(TapSet(marked.assign(taps=(whole.dataset["taps"].dims, values))), path)
        else:
            object.__setattr__(taps := TapSet(marked), "dataset", marked.assign({name: (marked[name].dims, values)}))
            write(taps, path)
        return path

    lacking = written(np.nan)
    read = load_taps(lacking, missing="drop")

    assert np.argwhere(np.isnan(read.taps)).tolist() == [[1, 2, 0]]
    assert read.missing == "drop"
    refused = [(lacking, "refuse"), (written(np.inf), "drop")]
    refused += [(written(np.nan, "where", 3), "drop")] if kind in ("nc", "zarr", "csv") else []  # others hold indices
    for path, missing in refused:
        with pytest.raises(InputError, match="NaN and infinite values are not accepted"):
            load_taps(path, missing)
    with pytest.raises(InputError, match="accept samples that are NaN with --missing drop"):
        load_taps(lacking)
    assert taps_of(read, "drop") is taps_of(read, "refuse") is read
    with pytest.raises(InputError, match="1 of 8 taps have missing samples"):
        taps_of(read)
    with pytest.raises(InputError, match="missing must be refuse or drop, got 'keep'"):
        load_taps(lacking, "keep")


@pytest.mark.parametrize("kind", ["npz", "mat5", "mat73"])
@pytest.mark.parametrize(("J", "K"), [(1, 3), (3, 1), (1, 1)])
def test_axes_of_length_one_survive(kind, J, K, make_taps, writers, tmp_path):
    """MATLAB drops trailing axes of length one; they come back."""
    suffix, write = writers[kind]
    taps = make_taps(2, 2, J, K, 1, 2)
    write(taps, tmp_path / f"taps{suffix}")

    assert_same(taps, load_taps(tmp_path / f"taps{suffix}"))


def test_samples_keep_their_precision(make_taps, arrays_of, tmp_path):
    """float32 and float64 are kept, whole numbers become float64."""
    arrays = arrays_of(make_taps(repeats=1))
    for stored, read in (("f4", "f4"), ("f8", "f8"), ("u1", "f8"), ("f2", "f4")):
        np.savez(tmp_path / "a.npz", **arrays | {"taps": np.abs(arrays["taps"]).astype(stored)})

        assert np.dtype(read) == load_taps(tmp_path / "a.npz").taps.dtype


@pytest.mark.parametrize("suffix", [".nc", ".npz", ".mat", ".csv"])
@pytest.mark.parametrize(
    "content", [b"", PNG, b"MATLAB 5.0 MAT-file".ljust(200), b"PK\x05\x06" + bytes(18), b"\x00" * 600]
)
def test_foreign_files_are_refused_by_name(suffix, content, tmp_path):
    """Whatever a file holds, the sentence begins with its name."""
    path = tmp_path / f"taps{suffix}"
    path.write_bytes(content)

    with pytest.raises(InputError, match=rf"taps\{suffix}: "):
        load_taps(path)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "zarr"])
def test_damaged_files_are_refused_or_read(kind, make_taps, writers, tmp_path, rng):
    """Cutting a file anywhere, or garbling one that this software parses itself, ends in `InputError` or nothing."""
    suffix, write = writers[kind]
    path = tmp_path / f"taps{suffix}"
    write(make_taps(2, 2, 3, 2, 1, 1), path)
    whole = path.read_bytes()
    damaged = [whole[: len(whole) * i // 12] for i in range(12)]
    for _ in range(50 if kind in ("npz", "csv") else 0):  # garbled HDF5 and MATLAB files can crash their libraries
        garbled = bytearray(whole)
        start = int(rng.integers(len(whole)))
        garbled[start : start + 8] = rng.bytes(8)
        damaged.append(bytes(garbled))
    sentences = [refusal(path, content) for content in damaged]

    assert any(sentences)
    assert all("\n" not in sentence and str(path) in sentence for sentence in sentences if sentence)


def refusal(path, content):
    """What is said to a file with this content, nothing if it is read."""
    path.write_bytes(content)
    try:
        load_taps(path)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("suffix", [".nc", ".npz", ".mat", ".csv"])
def test_directory_in_place_of_a_file_is_refused(suffix, tmp_path):
    (tmp_path / f"taps{suffix}").mkdir()

    with pytest.raises(InputError, match="is a folder, expected a"):
        load_taps(tmp_path / f"taps{suffix}")


def test_damaged_stores_are_refused(make_taps, writers, tmp_path):
    """Without a chunk of the samples, without samples, without metadata, and no folder at all."""
    _, write = writers["zarr"]
    path = tmp_path / "taps.zarr"
    write(make_taps(2, 2, 3, 2, 1, 1), path)
    with pytest.raises(InputError, match="a tap set holds taps that are already cut"):
        read_recording(path)
    next(part for part in (path / "taps" / "c").rglob("*") if part.is_file()).unlink()
    with pytest.raises(InputError, match=r"taps\.zarr: taps\[0, 0, 0\] is nan; NaN and infinite values"):
        load_taps(path)
    shutil.rmtree(path / "taps")
    with pytest.raises(InputError, match=r"taps\.zarr: not a tap set of format 1"):
        load_taps(path)
    (path / "zarr.json").unlink()
    with pytest.raises(InputError, match=r"taps\.zarr: not a Zarr store with arrays, or damaged"):
        load_taps(path)
    (tmp_path / "file.zarr").touch()
    with pytest.raises(InputError, match=r"file\.zarr: is a file, expected a Zarr store, which is a folder"):
        load_taps(tmp_path / "file.zarr")


def test_missing_file_and_unknown_kind_are_refused(tmp_path):
    (tmp_path / "taps.xlsx").write_bytes(b"x")
    (tmp_path / "empty").mkdir()
    for name, message in (
        ("none.npz", "no such file"),
        ("taps.xlsx", "unknown format"),
        ("empty", r"no \.csv files in this folder"),
    ):
        with pytest.raises(InputError, match=message):
            load_taps(tmp_path / name)


@pytest.mark.parametrize("name", ["taps.parquet", "taps.ARROW", "taps.feather", "taps.h5", "taps.tsv", "taps.jsonl"])
@pytest.mark.parametrize("installed", [True, False])
def test_a_file_that_needs_a_map_says_so(tmp_path, monkeypatch, name, installed):
    """And which package, where that is not installed."""
    if not installed:
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / name).touch()
    with pytest.raises(InputError, match="are read by solidtouch convert with --map or its options") as caught:
        load_taps(tmp_path / name)

    columnar = name.lower().endswith(("parquet", "arrow", "feather"))
    assert "convert --look writes a map" in str(caught.value)
    assert ("solidtouch[formats]" in str(caught.value)) == (columnar and not installed)


def test_a_tap_set_holds_no_streams(tmp_path, make_taps):
    make_taps(repeats=1).save(tmp_path / "a.nc")
    with pytest.raises(InputError, match="already cut"):
        read_recording(tmp_path / "a.nc")


def test_zip_of_something_else_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("letter.txt", "hello")

    with pytest.raises(InputError, match=r"letter.txt cannot be read: it is not an array"):
        load_taps(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("name", "sizes", "classes"),
    [
        ("barrett_ballcyl", (108, 120, 66), (6, 6)),
        ("barrett_boxes", (129, 120, 66), (14, 2)),
        ("eflesh_grid", (9610, 1, 15), (31, 31)),
        ("icub_grasp", (179, 16, 60), (1, 10)),
        ("braille_icub", (540, 51, 12), (1, 27)),
    ],
)
def test_recorded_data_are_read_whole(name, sizes, classes, shared_data: Path):
    """Every recorded set has its documented size, and every tap a class."""
    taps = load_taps(shared_data / f"{name}.npz")
    where, what = taps.indices(taps.grid())

    assert sizes == taps.taps.shape
    assert classes == taps.grid().shape
    assert where.min() >= 0
    assert what.min() >= 0
    assert taps.taps.dtype == np.float32


def test_recorded_attributes_and_further_arrays_are_kept(shared_data: Path):
    ballcyl = load_taps(shared_data / "barrett_ballcyl.npz")
    braille = load_taps(shared_data / "braille_icub.npz")

    assert ballcyl.dataset["offset"].dims == ("tap", "taxel")
    assert ballcyl.dataset["where_actual"].dims == ("tap",)
    assert ballcyl.dataset.attrs["licence"] == "MIT"
    assert braille.preprocessing.rate_hz == 40.0
    assert braille.where_unit == ""
