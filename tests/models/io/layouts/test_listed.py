"""Names that labels index, in a file of their own."""

import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


def named(folder, content, labels=(2, 0, 1), name="names.txt", **how):
    """Names of the taps with these labels, and what was told."""
    (folder / name.partition(":")[0]).write_text(content, encoding="utf-8")
    np.savez(folder / "a.npz", x=np.zeros((len(labels), 2, 2)), label=np.array(labels))
    found = load_mapped(folder / "a.npz", TapMap(**({"taps": "x", "what": "label", "what_names": name} | how)))
    return [found.taps.what_name[m] for m in found.taps.what], found.told


@pytest.mark.parametrize("heading", ["", "class\n", "Classes\n", "# what they are\n", '"name"\n', "materials\n\n"])
def test_lines_are_names_of_any_words(tmp_path, heading):
    assert named(tmp_path, f"{heading}red ball\ncan\n10 mm rod\n")[0] == ["10 mm rod", "red ball", "can"]


@pytest.mark.parametrize(
    "content",
    [
        "3 cup\n1 can\n2 red ball\n",
        "3: cup\n1: can\n2: red ball",
        "3\tcup\n1\tcan\n2\tred ball\n",
        "3. cup\n1. can\n2. red ball\n",
    ],
)
@pytest.mark.parametrize("one_based", [True, False])
def test_lines_may_begin_with_the_numbers_that_labels_have(tmp_path, content, one_based):
    assert named(tmp_path, content, (3, 1, 2, 1), one_based=one_based)[0] == ["cup", "can", "red ball", "can"]


def test_a_column_of_numbers_beside_the_names_is_that_of_the_labels(tmp_path):
    """Whatever their order; numbers that labels do not have are no such column."""
    table = "id,kg,name\n3,7,cup\n1,8,can\n2,9,ball\n"
    assert named(tmp_path, table, (3, 1, 2), "names.csv:name")[0] == ["cup", "can", "ball"]
    assert named(tmp_path, table, (0, 1, 2), "names.csv:name")[0] == ["cup", "can", "ball"]  # in their order
    with pytest.raises(InputError, match=r"what_names .* several columns of the table have these numbers"):
        named(tmp_path, "id,kg,name\n3,1,cup\n1,2,can\n2,3,ball\n", (3, 1, 2), "names.csv:name")


@pytest.mark.parametrize(
    "content", ['["can", "ball", "cup"]', '{"0": "can", "2": "cup", "1": "ball"}', '{"cup": 2, "can": 0, "ball": 1}']
)
def test_names_in_json(tmp_path, content):
    assert named(tmp_path, content, name="names.json")[0] == ["cup", "can", "ball"]


@pytest.mark.parametrize("content", ["{", '{"a": "b"}', "3", '[["a"]]'])
def test_other_json_is_refused(tmp_path, content):
    with pytest.raises(
        InputError, match=r"what_names \(--what-names\): .*names\.json: (no JSON|must be a list, or an)"
    ):
        named(tmp_path, content, name="names.json")


def test_one_line_may_hold_all_names(tmp_path):
    assert named(tmp_path, "can; ball; cup\n")[0] == ["cup", "can", "ball"]


def test_positions_may_be_lines_with_units_or_commas(tmp_path):
    for content, expected in (("10 mm\n20 mm\n30 mm\n", [30, 10, 20]), ("1,5\n2,6\n3,7\n", [3.7, 1.5, 2.6])):
        (tmp_path / "at.txt").write_text(content)
        np.savez(tmp_path / "a.npz", x=np.zeros((3, 2, 2)), label=np.array([2, 0, 1]))
        taps = load_mapped(tmp_path / "a.npz", TapMap(taps="x", where="label", where_values="at.txt")).taps
        assert taps.where.tolist() == expected


def test_names_without_taps_are_told(tmp_path):
    """As those of indices that count from 1, where the last one does not occur."""
    told = named(tmp_path, "can\nball\ncup\nrod\n", (1, 2, 3, 1))[1]
    assert told == (
        "1 of 4 what_names (--what-names) have no taps: can; if indices count from 1, say one_based (--one-based).",
    )
    assert named(tmp_path, "can\nball\ncup\nrod\n", (1, 2, 3), one_based=True)[1][0].endswith("have no taps: rod.")


def test_numbers_of_sessions_with_names_are_told(tmp_path):
    for name in ("train", "test"):
        (tmp_path / f"{name}.csv").write_text("p\n1\n")
    assert load_mapped(tmp_path, TapMap(files="{session}.csv", taxels="p", tap="row")).told == (
        "Sessions: 0 is test, 1 is train.",
    )


def test_lists_of_several_folders_must_be_alike(tmp_path):
    for folder in "xy":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "names.txt").write_text("can\nball\n")
        (tmp_path / folder / "a.csv").write_text("n,p\n0,1\n1,2\n")
    how = TapMap(files="*/a.csv", taxels="p", tap="row", what="n", what_names="names.txt")
    assert load_mapped(tmp_path, how).taps.what_name == ["can", "ball"]
    (tmp_path / "y/names.txt").write_text("ball\ncan\n")
    with pytest.raises(InputError, match=r"what_names \(--what-names\): .*y/names\.txt differs from .*x/names\.txt"):
        load_mapped(tmp_path, how)
