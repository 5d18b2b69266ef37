"""Rows as labelled data sets."""

import numpy as np
import pytest
from solidtouch.analysis.page.labelled import interval_columns, labelled, rows, source_units, with_units


def test_rows_fill_a_grid_and_missing_ones_are_empty():
    """Numbers by NaN, words by nothing, truths by False; nested values are left out."""
    rows = [
        {"a": "x", "b": 2, "n": 1, "word": "long", "true": True, "nested": [1]},
        {"a": "x", "b": 1, "n": None, "word": "s", "true": False, "nested": []},
        {"a": "y", "b": 2, "n": np.float64(3), "word": None, "true": None, "nested": {}},
    ]
    found = labelled(rows, ("a", "b"))

    assert found["b"].values.tolist() == [2, 1]
    np.testing.assert_array_equal(found["n"], [[1, np.nan], [3, np.nan]])
    assert found["word"].values.tolist() == [["long", "s"], ["", ""]]
    assert found["true"].values.tolist() == [[True, False], [False, False]]
    assert "nested" not in found


def test_whole_numbers_stay_whole_unless_some_are_missing():
    rows = [{"a": 1, "b": 1, "n": 2}, {"a": 2, "b": 2, "n": 3}]

    assert labelled(rows, ["a"])["n"].dtype == int
    np.testing.assert_array_equal(labelled(rows, ["a", "b"])["n"], [[2, np.nan], [np.nan, 3]])


def test_two_rows_of_one_name_are_refused():
    with pytest.raises(ValueError, match="Two rows have the same a"):
        labelled([{"a": 1, "n": 2}, {"a": 1, "n": 3}], ["a"])


def test_no_rows_are_an_empty_data_set():
    assert labelled([], ["a"]).sizes == {"a": 0}


def test_rows_of_a_grid_are_plain_and_without_other_coordinates():
    """Numbers, words and truths as JSON takes them, in the order of the dimensions that are named."""
    data = labelled([{"a": a, "b": b, "n": b, "true": a == "x"} for a in "xy" for b in (1, 2)], ["a", "b"])
    found = rows(data.assign_coords(c=("a", [5, 6]), d=7.0), "b", "a")

    assert found[1] == {"b": 1, "a": "y", "n": 1, "true": False}
    assert [(row["b"], row["a"]) for row in found] == [(1, "x"), (1, "y"), (2, "x"), (2, "y")]
    assert {type(value) for row in found for value in row.values()} == {int, str, bool}


def test_units_go_to_bounds_and_differences_of_a_quantity_and_leave_the_original_alone():
    found = labelled([{"a": 1, "taps": 2.0, "taps_low": 1.0, "tapsy": 0.0, "equal_taps": 3.0}], ["a"])
    named = with_units(found, {"taps": "taps", "a": "mm"})

    assert {name: named[name].attrs.get("units") for name in named.variables} == {
        "a": "mm",
        "taps": "taps",
        "taps_low": "taps",
        "tapsy": None,
        "equal_taps": None,
    }
    assert not found["taps"].attrs


def test_sources_with_different_units_share_none():
    one, other = {"what_unit": "mm", "where_unit": "mm"}, {"what_unit": "", "where_unit": "mm"}
    assert source_units([one, one]) == {"taps": "taps", "what_error": "mm", "where_error": "mm", "way": "mm"}
    assert source_units([one, other]) == {"taps": "taps", "where_error": "mm", "way": "mm"}


def test_a_value_without_an_interval_has_empty_columns():
    assert interval_columns("n", [1, 0, 2]) == {"n": 1, "n_low": 0, "n_high": 2}
    assert interval_columns("n", None) == {"n": None, "n_low": None, "n_high": None}
