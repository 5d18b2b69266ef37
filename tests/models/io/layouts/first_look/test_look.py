"""What `--look` prints of odd files: always a map that is read, never a trace."""

import json

import h5py
import numpy as np
import pytest
from solidtouch.models.io.layouts.first_look.look import look
from solidtouch.models.io.layouts.mapping import TapMap, load_map

ARRAYS = {
    "one tap and a scalar": {"x": np.zeros((1, 5, 3)), "rate": 3.0, "y": [2]},
    "labels that are missing": {"x": np.zeros((4, 5, 3)), "what": [0, np.nan, 1, 1], "names": [b"a", b"b"]},
    "endless labels": {"x": np.zeros((4, 5, 3)), "what": [0, np.inf, 1, 1], "names": [b"a", b"b"]},
    "indices from 1": {
        "x": np.zeros((4, 5, 3)),
        "what": [1, 2, 1, 2],
        "names": [b"a", b"b"],
        "where": [1, 1, 2, 2],
        "positions": [0.5, 1.5],
    },
    "frames": {"x": np.zeros((9, 2)), "time": np.arange(9.0)},
    "scalars alone": {"a": 1.0, "b": 2},
    "texts alone": {"a": [b"x", b"y"]},
    "complex": {"a": np.zeros(3, complex)},
    "empty": {"a": np.zeros((0, 3, 2)), "b": np.zeros(0)},
    "many axes": {"a": np.zeros((2, 1, 2, 1, 2, 1))},
    "nothing known": {"a": np.full((4, 2), np.nan), "time": np.full(4, np.nan)},
}
TABLES = {
    "one column": "a\n1\n2\n",
    "missing cells": "t,a,what\n0,,x\n1,,\n",
    "texts alone": "a,b\nx,y\nz,w\n",
    "a plane": "x [mm],y [mm],s1,s2\n0,0,1,2\n0,1,1,3\n1,0,2,4\n1,1,2,5\n",
    "names like numbers": "what,s\n01,1\n1,2\n001,3\n",
}


def looked(folder, sources):
    """The text, and the map that it is."""
    text = look(sources, TapMap())
    (folder / "map.toml").write_text(text)
    return text, load_map(folder / "map.toml")


@pytest.mark.parametrize("kind", ARRAYS)
def test_of_arrays(kind, tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for name, values in ARRAYS[kind].items():
            file[name] = values
    text, how = looked(tmp_path, [tmp_path / "r.h5"])

    assert "\n# With this map: " in text
    if kind == "frames":
        assert "9 frames of streams: cut them with trigger, 2 taxels" in text
    if kind == "indices from 1":
        assert (how.what_names, how.where_values, how.one_based) == ("names", "positions", True)
        assert "4 taps, 5 samples x 3 taxels, 2 objects, 2 positions" in text


@pytest.mark.parametrize("kind", TABLES)
def test_of_tables(kind, tmp_path):
    (tmp_path / "r.csv").write_text(TABLES[kind])
    text, how = looked(tmp_path, [tmp_path / "r.csv"])

    assert "\n# With this map: " in text
    if kind == "a plane":
        assert (how.where, how.taxels) == (("x [mm]", "y [mm]"), "s*")


def test_of_names_with_signs_that_patterns_have(tmp_path):
    folder = tmp_path / "{set}"
    folder.mkdir()
    for name in ("[a]{b}_cup_1.csv", "[a]{b}_rod_2.csv"):
        (folder / name).write_text("s1,s2\n1,2\n3,4\n")
    text, how = looked(tmp_path, [folder])

    assert how.files == "[a]?b?_{what}_{trial}.csv"
    assert "2 taps, 2 samples x 2 taxels, 2 objects" in text


def test_a_map_is_not_tried_on_a_document_of_which_only_the_begin_was_read(tmp_path):
    (tmp_path / "r.json").write_text(json.dumps([{"s1": n, "s2": 0.5, "tap": n // 100} for n in range(150_000)]))
    text, how = looked(tmp_path, [tmp_path / "r.json"])

    assert "the rest of the file is not read: its first 4.19 MB tell what there is" in text
    assert "# This map was not tried on" in text
    assert (how.taxels, how.tap) == ("s*", "tap")
