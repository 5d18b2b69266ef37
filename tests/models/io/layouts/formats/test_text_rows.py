"""Rows of text tables that are shorter than the header: cut at the end of a file, or without what is empty."""

from itertools import product

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.text import TextContents
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

ROWS = [f"{n}.5,{n}.25,word {n}" for n in range(40)]


def opened(folder, content, size=1 << 22, **how):
    path = folder / "t.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    contents = TextContents(path, TextTable(**how), size)
    contents.without_cut = True
    return contents


CUT = list(product(["\n", "\r\n", "\r"], [7, 1 << 22], ["7.5", "7.5,0.1", '7.5,"0.', '"7'], [2, 29, 30, 31, 40]))
"""Every third has every pair of them."""


@pytest.mark.parametrize(("end", "size", "last", "rows"), slow_but(CUT[::3], CUT))
def test_a_last_line_that_is_cut_is_left_out_and_told(tmp_path, rows, last, size, end):
    contents = opened(tmp_path, end.join(["a,b,c", *ROWS[:rows], last]), size)

    assert contents.read([], ["a", "b"])[1].tolist() == [[n + 0.5, n + 0.25] for n in range(rows)]
    assert contents.damage == f"line {rows + 2} left out: the file ends within it."


@pytest.mark.parametrize("how", [{}, {"delimiter": ","}])
@pytest.mark.parametrize(
    "content", ["a,b\n1,2\n3,4", "a,b,\n1,2\n3,4", "a,b\n1,2\n3,", "a,b\n1,2\n3,4\n ", "a,b\n1,2\n3,4,"]
)
def test_a_last_line_that_is_whole_needs_no_end(tmp_path, content, how):
    contents = opened(tmp_path, content, **how)

    np.testing.assert_array_equal(contents.read([], "ab")[1], [[1, 2], [3, np.nan if content.endswith("3,") else 4]])
    assert not contents.damage


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("a,b\n1,2\n3\n4,5", "line 3: 1 cell"),
        ("a,b\n1,2\n3\n", "line 3: 1 cell"),
        ("a,b\n1,2\n3\n4", "line 3: 1 cell"),
        ('a,b\n1,2\n3,"4\n5,6', "line 3: a quoted cell does not end"),
    ],
)
@pytest.mark.parametrize("how", [{}, {"delimiter": ","}])
def test_other_short_rows_are_refused(tmp_path, content, message, how):
    with pytest.raises(InputError) as error:
        opened(tmp_path, content, **how).read([], "ab")
    assert message in str(error.value)


def test_a_row_of_units_and_an_arrow_do_not_matter_to_a_line_that_is_cut(tmp_path):
    for how in ({}, {"delimiter": ","}):
        contents = opened(tmp_path, "t,f\ns,N\n1,2\n2,3\n3", **how)
        assert contents.read([], "tf")[1].tolist() == [[1, 2], [2, 3]]
    logged = opened(tmp_path, "10:00:00 -> 1,2\n10:00:01 -> 3,4\n10:00:02 -> 5", header=False)
    assert logged.read([], "12")[1].tolist() == [[1, 2], [3, 4]]


def test_recordings_are_read_without_a_line_that_is_cut_but_not_tables_of_labels(tmp_path):
    for n in range(3):
        (tmp_path / f"{n}.csv").write_text("a,b\n1,2\n3,4\n5")
    (tmp_path / "labels.csv").write_text("file,object\n0.csv,rod\n1.csv,cube\n2.csv")
    how = TapMap(files="?.csv", taxels=("a", "b"), tap="file")
    found = load_mapped(tmp_path, how)

    assert found.taps.taps.shape == (3, 2, 2)
    assert f"{tmp_path / '1.csv'}: line 4 left out: the file ends within it." in found.told
    with pytest.raises(InputError, match=r"line 4: 1 cell, but there are 2 columns"):
        load_mapped(tmp_path, how.changed(what="labels.csv:object"))


LVM = "X_Value\tVoltage\tVoltage 1\tComment\n"


@pytest.mark.parametrize("how", [{}, {"delimiter": "tab"}])
@pytest.mark.parametrize("comments", [{}, {0: "\tstart"}, {0: "\t"}, {5: "\tit's", 70: '\t"a\nb"'}])
def test_rows_may_omit_empty_cells_at_their_end(tmp_path, how, comments):
    """As LabVIEW does below a header with a column of comments."""
    rows = [f"0.{n:03}\t{n}.5\t{n}.25{comments.get(n, '')}" for n in range(99)]
    contents = opened(tmp_path, LVM + "\n".join(rows) + "\n", **how)
    texts, read = contents.read(["Comment"], ["X_Value", "Voltage 1"])

    assert read.tolist() == [[n / 1000, n + 0.25] for n in range(99)]
    wanted = [comments.get(n, "").strip().strip('"') for n in range(99)]
    assert texts["Comment"].tolist() == wanted
    assert contents.told == ("Rows end before column Comment, which is read as missing.",)
    assert np.isnan(opened(tmp_path, LVM + "1\t2\t3\n2\t3\t4\n").read([], ["Comment"])[1]).all()
    if 0 in comments:
        bare = opened(tmp_path, "\n".join(rows), header=False, **how)
        assert bare.read([], "02")[1].tolist() == read.tolist()


@pytest.mark.parametrize(
    "content",
    [
        LVM + "1\t2\t3\n" * 40 + "4\t5\n",  # fewer cells than the other rows
        LVM + "1\t2\t3\n4\t5\n" + "1\t2\t3\n" * 3,
        LVM + "1\t2\t3\tx\n" * 3 + "4\t5\t6\n",  # most rows have all
        "force (N) time (s)\n1 2\n3 4\n",  # blanks within names
        "made\tby\tus\nt\tf\n1\t2\n3\t4\n",  # a line before the header
    ],
)
def test_rows_that_may_be_cut_are_refused(tmp_path, content):
    def read():
        contents = opened(tmp_path, content)
        contents.read([], list(contents.variables)[:2])

    with pytest.raises(InputError, match=r"line \d+: \d cells, but there are"):
        read()


def test_a_line_that_is_cut_has_fewer_cells_than_other_rows(tmp_path):
    contents = opened(tmp_path, LVM + "1\t2\t3\n" * 40 + "4\t5")
    assert contents.read([], ["X_Value"])[1].tolist() == [[1]] * 40
    assert contents.damage.startswith("line 42 ")
