"""Labels in the names of files and folders."""

import numpy as np
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
        ({"session": "date:{session}"}, r"session \(--session\): no pattern gives the name of this file a field"),
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


def test_places_by_fields_of_the_names_alone(grid):
    taps = load_mapped(grid, TapMap(taxels="a", tap="file", files="p_{x}_{y}.csv")).taps
    assert taps.grid().where_place[taps.where.astype(int)].tolist() == taps.taps[:, :, 0].tolist()
    with pytest.raises(InputError, match=r"the field {y} of a name needs {x} and {y}"):
        load_mapped(grid, TapMap(taxels="a", tap="file", files="p_*_{y}.csv"))
    (grid / "p_0mm_0mm.csv").rename(grid / "p_0mm_0cm.csv")
    for name in ("p_0mm_2mm", "p_1mm_0mm", "p_1mm_2mm"):
        (grid / f"{name}.csv").rename(grid / f"{name[:-2]}cm.csv")
    with pytest.raises(InputError, match=r"where \(--where\): x is in mm, y in cm; a plane has one unit"):
        load_mapped(grid, TapMap(taxels="a", tap="file", files="p_{x}_{y}.csv"))


@pytest.mark.parametrize("listed", [("left", "mid", "right"), "sides"])
def test_names_of_positions_are_numbered_in_their_order(listed, tmp_path):
    """Given as a list or as an array; objects likewise."""
    where, what = ["mid", "left", "right", "mid"], ["cup", "rod", "cup", "rod"]
    arrays = {"x": np.arange(4.0).reshape(4, 1, 1), "side": where, "thing": what, "things": ["rod", "cup"]}
    np.savez(tmp_path / "r.npz", **arrays, sides=["left", "mid", "right"])
    how = TapMap(taps="x", where="side", where_values=listed, what="thing", what_names="things")
    taps = load_mapped(tmp_path / "r.npz", how).taps

    assert taps.where.tolist() == [1, 0, 2, 1]
    assert [taps.what_name[m] for m in taps.what] == what
    assert list(taps.what_name) == ["rod", "cup"]


def test_numbers_with_a_unit_are_no_names(tmp_path):
    np.savez(tmp_path / "r.npz", x=np.arange(2.0).reshape(2, 1, 1), at=[1, 0])
    how = TapMap(taps="x", where="at", where_values=("0 mm", "2.5 mm"))
    taps = load_mapped(tmp_path / "r.npz", how).taps
    assert (taps.where.tolist(), taps.where_unit) == ([2.5, 0], "mm")


def test_objects_that_are_missing_are_refused(tmp_path):
    (tmp_path / "r.csv").write_text("s,what\n1,cup\n2,NaN\n")
    with pytest.raises(InputError, match=r"what \(--what\) is missing for tap 1 of"):
        load_mapped(tmp_path / "r.csv", TapMap(taxels="s", tap="row", what="what"))


def test_the_unit_of_times_may_end_their_name(tmp_path):
    (tmp_path / "r.csv").write_text("time_ms,s\n0,1\n10,2\n")
    taps = load_mapped(tmp_path / "r.csv", TapMap(taxels="s", tap="file", time="time_ms")).taps
    assert taps.preprocessing.rate_hz == 100


def test_files_that_do_not_match_are_told(grid):
    """Though not tables of labels and files of other kinds."""
    (grid / "labels.csv").write_text("file,thing\np_1mm_0mm,a\np_1mm_2mm,b\n")
    (grid / "notes.txt").write_text("b")
    taps, told = load_mapped(grid, TapMap(taxels="a", tap="file", files="p_1mm_*.csv", what="labels.csv:thing"))
    assert len(taps) == 2
    first = f"2 of 4 files below {grid} do not match files (--files), such as p_0mm_0mm.csv."
    assert told == (first, "labels.csv is read by names of files in its column file.")


def test_a_file_that_is_named_twice_is_refused(grid):
    path = grid / "p_0mm_0mm.csv"
    with pytest.raises(InputError, match=r"p_0mm_0mm\.csv: named twice, so that its taps would be"):
        load_mapped([grid, path], TapMap(taxels="a", tap="file"))


@pytest.mark.parametrize(
    "keys",
    [{"session": "date:file:{what}_{session}.csv"}, {"files": "{what}_{session}.csv", "session": "date:{session}"}],
)
def test_sessions_by_a_date_in_the_name_are_in_its_order(keys, tmp_path):
    for value, day in enumerate(("01.02.2024", "24.12.2023", "31.01.2024")):
        (tmp_path / f"rod_{day}.csv").write_text(f"a\n{value}\n")
    taps = load_mapped(tmp_path, TapMap(taxels="a", tap="file", **keys)).taps
    assert dict(zip(taps.taps[:, 0, 0].tolist(), taps.session.tolist(), strict=True)) == {0: 2, 1: 0, 2: 1}
    assert len(taps.what_name) == 1


@pytest.mark.parametrize(
    "keys",
    [
        {"files": "{what}_d{where}mm_r{trial}.csv"},
        {"what": "file:{what}_*.csv", "where": "file:*_d{where}mm_r{trial}.csv", "files": "**/*"},
        {"files": "{what}_d{x}mm_r{trial}.CSV"},
    ],
)
def test_a_field_that_is_no_number_is_told(keys, tmp_path):
    for name in ("rod_d1mm_r1.CSV", "rod_d0p5mm_r1.CSV"):
        (tmp_path / name).write_text("a\n1\n2\n")
    (tmp_path / "rod_d1mm_r1.CSV").unlink()
    with pytest.raises(InputError, match=r": {(where|x)} must be one number, .* but is '0p5' in rod_d0p5mm_r1.CSV"):
        load_mapped(tmp_path, TapMap(taxels="a", tap="file", **keys))


def test_files_of_an_unknown_ending_need_their_format(tmp_path):
    """And a pattern if there are several endings."""
    for number in range(3):
        (tmp_path / f"{number}.lvm").write_text("a\n1\n2\n")
    how = TapMap(taxels="a", tap="file", format="text")
    with pytest.raises(InputError, match=r"; if those called \*\.lvm are text, say format \(--format\) text\."):
        load_mapped(tmp_path, how.changed(format=None))
    assert len(load_mapped(tmp_path, how).taps) == 3
    (tmp_path / "notes.md").write_text("x")
    with pytest.raises(InputError, match=r"several kinds \(3 \.lvm, 1 \.md\); say which with files \(--files\)"):
        load_mapped(tmp_path, how)
    (tmp_path / "3.csv").write_text("a\n1\n2\n")
    assert len(load_mapped(tmp_path, how).taps) == 1
    (tmp_path / "own").mkdir()
    (tmp_path / "own/a.npy").write_text("x")
    with pytest.raises(InputError, match=r"no file of a known kind in this folder \([^;]*$"):
        load_mapped(tmp_path / "own", how)


@pytest.mark.parametrize(
    ("pattern", "name", "what", "where"),
    [
        ("{what}{where}.csv", "ball25.csv", "ball", 25),
        ("{what}{where}.csv", "ball-2mm.csv", "ball", -2),
        ("{what}{where}_*.csv", "rod10mm_3.csv", "rod", 10),
        ("*{where}_{what}.csv", "pos25_cup.csv", "cup", 25),
        ("*{where}_{what}.csv", "a1pos25_cup.csv", "cup", 25),
        ("{what}_{where}*.csv", "cup_25mm_r1.csv", "cup", 25),
    ],
)
def test_a_number_beside_a_text_or_any_signs_is_whole(pattern, name, what, where, tmp_path):
    (tmp_path / name).write_text("a\n1\n")
    taps = load_mapped(tmp_path, TapMap(taxels="a", tap="file", files=pattern)).taps
    assert (taps.what_name, taps.where.tolist()) == ([what], [where])


@pytest.mark.parametrize(
    "pattern",
    ["{what}*.csv", "*{what}.csv", "{what}{session}.csv", "{x}{y}.csv", "{where}{what}.csv"],
)
def test_fields_that_end_nowhere_are_refused(pattern, tmp_path):
    (tmp_path / "wool1.csv").write_text("a\n1\n")
    with pytest.raises(InputError, match=r"files \(--files\): nothing in .* tells where a field ends or begins"):
        load_mapped(tmp_path, TapMap(taxels="a", tap="file", files=pattern))
