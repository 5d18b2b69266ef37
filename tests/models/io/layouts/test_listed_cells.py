"""Columns of text tables whose cells are lists of numbers."""

import csv

import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


def table(folder, cells):
    with (folder / "t.csv").open("w") as file:
        csv.writer(file).writerows([["", "thing", "signal"], *([n, "ab"[n % 2], cell] for n, cell in enumerate(cells))])
    return folder / "t.csv"


@pytest.mark.parametrize("shape", [(5, 3), (300, 64)])
def test_a_list_in_a_cell_is_a_tap(tmp_path, shape):
    """As pandas writes it, also where it is long."""
    taps = np.random.default_rng(1).normal(size=(6, *shape))
    taps[2, 1, 1] = np.nan
    how = TapMap(taps="signal", axes="tap,sample,taxel", what="thing")
    found = load_mapped(table(tmp_path, map(str, taps.tolist())), how, missing="drop").taps

    np.testing.assert_array_equal(found.taps, taps)
    assert found.what.tolist() == [0, 1, 0, 1, 0, 1]


def test_lists_in_cells_may_differ_in_length(tmp_path):
    taps = [[[n, 2.5]] * (n + 2) for n in range(4)]
    how = TapMap(taps="signal", axes="tap,sample,taxel", length="shortest")
    assert load_mapped(table(tmp_path, taps), how).taps.taps.tolist() == [[[n, 2.5]] * 2 for n in range(4)]


def test_lists_in_cells_may_be_frames_of_a_tap(tmp_path):
    how = TapMap(taps="signal", tap="thing", keep="thing=a")
    with pytest.raises(InputError, match="thing"):
        load_mapped(table(tmp_path, ["[1, 2]"] * 4), how.changed(keep=None))
    assert load_mapped(table(tmp_path, ["[1, 2]"]), how).taps.taps.tolist() == [[[1, 2]]]


@pytest.mark.parametrize("cell", ["[[1 2]\n [3 4]]", "[[1, 2], [3]]", "rod", "5", '["a"]', "[1, 2", '{"a": 1}', "[{}]"])
def test_other_texts_are_refused_with_their_place(tmp_path, cell):
    with pytest.raises(InputError, match=r"line 4, signal: .* is no list of numbers .*\.npz"):
        load_mapped(table(tmp_path, ["[[1, 2]]"] * 2 + [cell]), TapMap(taps="signal", axes="tap,sample,taxel"))
