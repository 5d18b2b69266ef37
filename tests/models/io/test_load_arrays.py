"""What `.npz` and `.mat` must hold, and what is said where they do not."""

import json

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from solidtouch.models.errors import InputError
from solidtouch.models.io.arrays import read_arrays, recording_from_arrays
from solidtouch.models.io.load import load_taps


@pytest.fixture
def arrays(make_taps, arrays_of):
    """The layout with N=24, J=6, K=5, L=3, M=4."""
    return arrays_of(make_taps(repeats=1))


def changed(values, place, value):
    values = np.array(values, dtype=np.result_type(values, type(value)) if np.isscalar(value) else values.dtype)
    values[place] = value
    return values


BAD = {
    "taps missing": (lambda a: {**a, "taps": None}, r"missing array taps; the file holds: meta, session"),
    "what missing": (lambda a: {**a, "what": None}, "missing array what;"),
    "names missing": (lambda a: {**a, "what_names": None}, "missing array what_names"),
    "where missing": (lambda a: {**a, "where": None}, "missing array where;"),
    "taps flat": (lambda a: {**a, "taps": a["taps"][:, 0]}, r"taps must have shape \(N, J, K\).*got \(24, 5\)"),
    "taps empty": (lambda a: {**a, "taps": a["taps"][:, :0]}, r"without empty axes, got \(24, 0, 5\)"),
    "taps text": (lambda a: {**a, "taps": a["taps"].astype("U9")}, "taps must hold real numbers"),
    "taps complex": (lambda a: {**a, "taps": a["taps"] * 1j}, "taps cannot be read: it holds complex numbers"),
    "taps nan": (lambda a: {**a, "taps": changed(a["taps"], (3, 2, 1), np.nan)}, r"taps\[3, 2, 1\] is nan"),
    "taps infinite": (lambda a: {**a, "taps": changed(a["taps"], (3, 2, 1), -np.inf)}, r"taps\[3, 2, 1\] is -inf"),
    "what short": (lambda a: {**a, "what": a["what"][:-1]}, r"what must have shape \(24,\), got shape \(23,\)"),
    "what above": (
        lambda a: {**a, "what": changed(a["what"], 7, 4)},
        r"what\[7\] is 4, outside the 4 entries of what_n",
    ),
    "what below": (lambda a: {**a, "what": changed(a["what"], 7, -1)}, r"what\[7\] is -1, outside the 4 entries"),
    "what from 1": (lambda a: {**a, "what": a["what"] + 1}, "indices count from 0"),
    "what broken": (
        lambda a: {**a, "what": changed(a["what"], 7, 0.5)},
        r"what\[7\] is 0.5, not an integer",
    ),
    "where above": (
        lambda a: {**a, "where": changed(a["where"], 2, 3)},
        r"where\[2\] is 3, outside the 3 entries of wher",
    ),
    "where nan": (lambda a: {**a, "where": changed(a["where"], 2, np.nan)}, r"where\[2\] is nan"),
    "names twice": (lambda a: {**a, "what_names": np.array(["a", "b", "c", "a"])}, "a repeated name"),
    "names numbers": (lambda a: {**a, "what_names": np.arange(4)}, "what_names must be a list of text"),
    "names none": (lambda a: {**a, "what_names": np.array([], dtype=str)}, "what_names is empty"),
    "values twice": (lambda a: {**a, "where_values": np.array([1.0, 0.0, 1.0])}, "where_values contains 1 twice"),
    "values nan": (lambda a: {**a, "where_values": np.array([1.0, np.nan, 2.0])}, r"where_values\[1\] is nan"),
    "values square": (lambda a: {**a, "where_values": np.eye(3)}, "where_values must have one axis"),
    "edges short": (lambda a: {**a, "where_edges": np.arange(3.0)}, r"where_edges must have shape \(4,\)"),
    "sizes short": (lambda a: {**a, "what_values": np.arange(3.0)}, r"what_values must have shape \(4,\)"),
    "unit number": (lambda a: {**a, "where_unit": np.array(3)}, "where_unit must be one text"),
    "unit list": (lambda a: {**a, "where_unit": np.array(["mm", "cm"])}, "where_unit must be one text"),
    "session broken": (lambda a: {**a, "session": a["session"] + 0.25}, "not an integer"),
    "trial short": (lambda a: {**a, "trial": a["trial"][1:]}, r"trial must have shape \(24,\)"),
    "meta broken": (lambda a: {**a, "meta": np.array("{")}, "array meta is not JSON"),
    "meta deep": (lambda a: {**a, "meta": np.array("[" * 100_000)}, "array meta is not JSON"),
    "meta digits": (lambda a: {**a, "meta": np.array(f'{{"rate_hz": {"9" * 5_000}}}')}, "array meta is not JSON"),
    "rate huge": (
        lambda a: {**a, "meta": np.array(f'{{"rate_hz": {"9" * 400}}}')},
        "array meta: rate_hz must be a pos",
    ),
    "meta list": (lambda a: {**a, "meta": np.array("[1]")}, "meta must be a JSON object"),
    "rate text": (lambda a: {**a, "meta": np.array('{"rate_hz": "fast"}')}, "array meta: rate_hz must be a pos"),
    "rate zero": (lambda a: {**a, "meta": np.array('{"rate_hz": 0}')}, "array meta: rate_hz must be a positive"),
    "extra nan": (lambda a: {**a, "depth": np.full(24, np.nan)}, r"depth\[0\] is nan"),
    "extra name": (lambda a: {**a, "time": np.zeros(24)}, "array time must be renamed"),
    "taxels few": (lambda a: {**a, "taxel_position": np.zeros((4, 2))}, "do not match|taxel"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_arrays_are_named_with_their_place(case, arrays, tmp_path):
    change, message = BAD[case]
    np.savez(tmp_path / "bad.npz", **{k: v for k, v in change(arrays).items() if v is not None})

    with pytest.raises(InputError, match=message) as caught:
        load_taps(tmp_path / "bad.npz")

    assert str(caught.value).startswith(str(tmp_path / "bad.npz"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("notes", "Array notes is left out: it holds pickled objects"),
        ("taps", "array taps cannot be read: it holds pick"),
    ],
)
def test_pickled_objects_are_never_read(name, told, arrays, tmp_path):
    """An object array could run code when it is unpickled."""
    np.savez(tmp_path / "a.npz", **arrays | {name: np.array([{}, None], dtype=object)}, allow_pickle=True)

    if name == "notes":
        assert read_arrays(tmp_path / "a.npz").left_out[0].startswith(told)
    else:
        with pytest.raises(InputError, match=told):
            load_taps(tmp_path / "a.npz")


def test_only_samples_and_objects_are_required(arrays):
    """Without the other arrays there is one position without unit, one session, and the order of the file."""
    labels = recording_from_arrays({name: arrays[name] for name in ("taps", "what", "what_names")}).tapset()

    assert labels.grid().shape == (1, 4)
    assert labels.where_unit == ""
    assert set(labels.session) == {0}
    assert labels.trial.tolist() == list(range(24))


def test_positions_may_be_given_without_a_table(arrays):
    del arrays["where_values"]
    taps = recording_from_arrays(arrays | {"where": arrays["where"] * 0.25}).tapset()

    assert taps.dataset["where_value"].values.tolist() == [0.0, 0.25, 0.5]


def test_an_unsorted_table_of_positions_is_sorted_with_its_taps(arrays):
    taps = recording_from_arrays(arrays | {"where_values": np.array([3.0, -1.0, 2.0])}).tapset()

    assert taps.dataset["where_value"].values.tolist() == [-1.0, 2.0, 3.0]
    assert taps.where.tolist() == np.array([3.0, -1.0, 2.0])[arrays["where"]].tolist()


def test_unit_none_means_no_position_only_where_there_is_one_value(arrays):
    one = arrays | {"where": arrays["where"] * 0, "where_values": np.zeros(1), "where_unit": np.array("none")}

    assert recording_from_arrays(one).tapset().where_unit == ""
    assert recording_from_arrays(arrays | {"where_unit": np.array("none")}).tapset().where_unit == "none"


def test_arrays_without_a_row_per_tap_are_left_out_by_name(arrays, tmp_path):
    further = {"camera": np.zeros((24, 3)), "depth": np.zeros(24), "flag": np.ones(24) > 0}
    np.savez(tmp_path / "a.npz", **arrays | further)
    recording = read_arrays(tmp_path / "a.npz")

    assert recording.left_out == ("Array camera is left out: not one row per tap, (24, 3).",)
    assert set(recording.labels.extra) == {"depth", "flag"}


def test_meta_feeds_the_attributes(arrays):
    meta = {"sensor": "s", "licence": "l", "repo": "r", "path": "p", "note": "n", "rate_hz": 25}
    taps = recording_from_arrays(arrays | {"meta": np.array(json.dumps(meta))}).tapset()

    assert (taps.dataset.attrs["sensor"], taps.dataset.attrs["licence"]) == ("s", "l")
    assert taps.dataset.attrs["source"] == "r p; n"
    assert taps.preprocessing.rate_hz == 25.0


def test_text_and_flags_as_further_arrays_survive_saving(arrays, tmp_path):
    arrays |= {"operator": np.array(["ann", "bo"] * 12), "flag": np.arange(24) % 3 == 0}
    recording_from_arrays(arrays).tapset().save(tmp_path / "a.nc")
    read = load_taps(tmp_path / "a.nc")

    assert [str(name) for name in read.dataset["operator"].values[:2]] == ["ann", "bo"]
    assert read.dataset["flag"].values.tolist() == arrays["flag"].tolist()


def test_character_matrices_are_lists_of_names(arrays, tmp_path):
    """MATLAB pads the rows of a character matrix with blanks."""
    savemat(
        tmp_path / "a.mat", arrays | {"what_names": np.array(["a", "bb", "cc c", "d"]), "where_unit": "mm", "meta": ""}
    )

    assert load_taps(tmp_path / "a.mat").what_name == ["a", "bb", "cc c", "d"]


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({"inner": 1.0}, r"the file holds: .* what_names\.inner"),
        (np.array(["a", 3.0, "c", "d"], dtype=object), "it mixes numbers and texts"),
    ],
)
def test_kinds_that_matlab_has_and_we_do_not_are_refused(value, message, arrays, tmp_path):
    arrays["where_unit"], arrays["meta"] = "mm", "{}"
    savemat(tmp_path / "a.mat", arrays | {"what_names": value})

    with pytest.raises(InputError, match=f"what_names.*{message}"):
        load_taps(tmp_path / "a.mat")


def test_strings_and_structs_of_v73_are_refused(make_taps, writers, tmp_path):
    for kind, message in (("string", r"it is a string; save cellstr\(x\)"), ("struct", "missing array what_names")):
        path = tmp_path / f"{kind}.mat"
        writers["mat73"][1](make_taps(repeats=1), path)
        with h5py.File(path, "r+") as file:
            del file["what_names"]
            node = (
                file.create_group("what_names") if kind == "struct" else file.create_dataset("what_names", data=[[1]])
            )
            node.attrs["MATLAB_class"] = np.bytes_(kind)

        with pytest.raises(InputError, match=message):
            load_taps(path)


def test_cells_of_numbers_and_empty_arrays_of_v73_are_refused(make_taps, writers, tmp_path):
    path = tmp_path / "a.mat"
    writers["mat73"][1](make_taps(repeats=1), path)
    with h5py.File(path, "r+") as file:
        file["#refs#/0"].attrs["MATLAB_class"] = np.bytes_("double")
        del file["session"]
        file["session"] = np.array([0, 0], np.uint64)  # the size of an empty array
        file["session"].attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_empty": 1})

    with pytest.raises(InputError, match="what_names cannot be read: it mixes numbers and texts"):
        load_taps(path)

    with h5py.File(path, "r+") as file:
        file["#refs#/0"].attrs["MATLAB_class"] = np.bytes_("char")
    with pytest.raises(InputError, match=r"session must have shape \(24,\), got shape \(0,\)"):
        load_taps(path)


def test_a_matlab_file_of_version_4_is_refused(tmp_path, make_taps):
    savemat(tmp_path / "a.mat", {"taps": np.zeros((3, 2))}, format="4")

    with pytest.raises(InputError, match="not a MATLAB file of version 5"):
        load_taps(tmp_path / "a.mat")
