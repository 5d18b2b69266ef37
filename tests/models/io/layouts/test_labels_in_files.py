"""Labels that stand in the file of the samples: one-hot, in attributes of the file, and beside each of its arrays."""

import h5py
import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


@pytest.fixture
def recording(tmp_path):
    """Four taps of three objects: in one array with one-hot labels, and in an array each with attributes."""
    taps = np.arange(24.0).reshape(4, 3, 2)
    what, where = [2, 0, 1, 2], [1.5, 0.5, 1.5, 0.5]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["all/x"], file["all/y"] = taps, np.eye(3)[what]
        file["all/at"] = np.array([[0, 1], [1, 0], [0, 1], [1, 0]], bool)
        file.attrs["names"], file.attrs["listed"] = np.array([b"cup", b"rod", b"egg"]), "cup, rod,egg"
        file.attrs["places"] = [0.5, 1.5]
        for number, each in enumerate(taps):
            array = file.create_dataset(f"each/no {number}/x", data=each)
            array.attrs["object"], array.parent.attrs["at"] = what[number], where[number]
            file[f"each/no {number}/name"] = ["cup", "rod", "egg"][what[number]]
    return tmp_path / "a.h5", taps.tolist()


@pytest.mark.parametrize("names", ["names", "listed"])
@pytest.mark.parametrize(
    "keys",
    [
        {"taps": "all/x", "what": "all/y", "where": "all/at"},
        {"taps": "all/x", "what": "all/y", "where": "all/at", "one_based": True},
        {"taps": "each/*/x", "tap": "file", "what": "each/*/x@object", "where": "each/*@at", "where_values": None},
        {"taps": "each/no {trial}/x", "tap": "file", "what": "each/*/name", "where": "each/no {trial}@at"},
        {"taps": "each/*/x", "tap": "file", "what": "all/y", "where": "all/at"},
    ],
)
def test_labels_are_read_wherever_they_stand(recording, names, keys):
    path, samples = recording
    places = "places" if keys["where"] == "all/at" else None
    taps = load_mapped(path, TapMap(**({"what_names": names, "where_values": places} | keys))).taps

    assert taps.taps.tolist() == samples
    assert [taps.what_name[m] for m in taps.what] == ["egg", "cup", "rod", "egg"]
    assert taps.where.tolist() == [1.5, 0.5, 1.5, 0.5]


@pytest.mark.parametrize("wrong", [[[1, 1, 0]], [[0, 0, 0]], [[0, 2, 0]], [[0.5, 0.5, 0]], [[np.nan, 1, 0]]])
def test_other_rows_of_several_values_are_no_label(tmp_path, wrong):
    np.savez(tmp_path / "a.npz", x=np.zeros((2, 3, 2)), y=np.concatenate([[[0, 0, 1]], wrong]))
    with pytest.raises(InputError, match=r"what \(--what\): y has shape \(2, 3\), expected one value for each tap"):
        load_mapped(tmp_path / "a.npz", TapMap(taps="x", what="y"))


def test_an_attribute_of_several_values_has_one_for_each_tap(recording):
    path, _ = recording
    with h5py.File(path, "a") as file:
        file.attrs["day"] = [1, 2, 2, 1]
    how = TapMap(taps="all/x", session="day")
    assert load_mapped(path, how).taps.session.tolist() == [1, 2, 2, 1]
    assert load_mapped(path, how.changed(taps="each/*/x", tap="file")).taps.session.tolist() == [1, 2, 2, 1]
    with pytest.raises(InputError, match=r"what \(--what\) has 3 values for 4 taps"):
        load_mapped(path, how.changed(what="names"))


def test_a_pattern_that_is_beside_no_array_is_named(recording):
    path, _ = recording
    how = TapMap(taps="each/*/x", tap="file", what="all/*")
    with pytest.raises(InputError, match=r"what \(--what\): no array all/\*"):
        load_mapped(path, how)
