"""Labels in the names of files and folders."""

import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


@pytest.fixture
def grid(tmp_path):
    """A file for each of two by two places."""
    for x in (0, 1):
        for y in (0, 2):
            (tmp_path / f"p_{x}mm_{y}mm.csv").write_text(f"a\n{x}\n{y}\n")
    return tmp_path


@pytest.mark.parametrize(
    "where",
    [
        ("file:p_{x}_{y}.csv", "file:p_{x}_{y}.csv"),
        ("file:p_{x}_*.csv", "folder:p_*_{y}.csv"),
    ],
)
def test_places_in_a_plane(where, grid):
    taps = load_mapped(grid, TapMap(taxels="a", tap="file", where=where)).taps
    places = taps.grid().where_place[taps.where.astype(int)]
    assert places.tolist() == taps.taps[:, :, 0].tolist()
    assert taps.where_unit == "mm"


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"where": ["file:p_{x}_*.csv", "file:p_{x}_*.csv"]}, r"where \(--where\) y: the pattern .* has no field {y}"),
        ({"what": "file:{where}.csv"}, r"what \(--what\): the pattern '{where}.csv' has no field {what}"),
        ({"files": "p_{tap}_*.csv"}, r"files \(--files\): unknown field {tap}; fields are what, session, taxel, where"),
        ({"where": ["file:q_{x}.csv", "file:{y}.csv"]}, r"does not match where \(--where\) x 'file:q_{x}.csv'"),
    ],
)
def test_patterns_without_what_they_are_for_are_refused(keys, message, grid):
    with pytest.raises(InputError, match=message):
        load_mapped(grid, TapMap(**{"taxels": "a", "tap": "file"} | keys))


def test_a_table_of_a_further_array_is_no_recording(grid):
    (grid / "more.csv").write_text("file,depth\n" + "".join(f"p_{x}mm_{y}mm,{x + y}\n" for x in (0, 1) for y in (0, 2)))
    taps = load_mapped(grid, TapMap(taxels="a", tap="file", extra="more.csv:depth")).taps
    assert taps.dataset["more.csv:depth"].values.tolist() == taps.taps.sum(axis=(1, 2)).tolist()


def test_every_file_is_a_session_and_a_trial(grid):
    taps = load_mapped(grid, TapMap(taxels="a", tap="file", session="file", trial="file")).taps
    assert taps.session.tolist() == taps.trial.tolist() == [0, 1, 2, 3]
