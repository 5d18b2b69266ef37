"""Labels in a table beside the recordings: whatever its order, each tap gets its own."""

import json

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.label_values import distinct
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


def written(folder, names, samples=2):
    """A table for each name, with taps that count the files."""
    for number, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("a,b\n" + f"{number},0\n" * samples)


def found(folder, table, **how):
    """Object by the number in the samples."""
    (folder / "labels.csv").write_text(table)
    how = {"taxels": "*", "tap": "file", "what": "labels.csv:thing", "files": "**/*.txt"} | how
    taps = load_mapped(folder, TapMap(**how)).taps
    return dict(zip(taps.taps[:, 0, 0].astype(int).tolist(), [taps.what_name[m] for m in taps.what], strict=True))


def test_rows_in_any_order_and_for_files_that_are_not_there(tmp_path):
    written(tmp_path, ["a.txt", "b.txt", "c.txt"])
    table = "file,thing\nc.txt,cup\ngone.txt,pot\na.txt,ball\nb.txt,rod\n"
    assert found(tmp_path, table) == {0: "ball", 1: "rod", 2: "cup"}


def test_a_number_that_is_also_the_name_of_a_file_does_not_name_it(tmp_path):
    """`weight` is 2 and 1 where the files are 1 and 2."""
    written(tmp_path, ["1.txt", "2.txt", "3.txt"])
    table = "weight,id,thing\n2,1,cup\n1,2,ball\n7,3,rod\n"
    assert found(tmp_path, table) == {0: "cup", 1: "ball", 2: "rod"}
    table = "weight,thing\n2,cup\n1,ball\n1,rod\n"
    assert found(tmp_path, table) == {0: "cup", 1: "ball", 2: "rod"}  # in their order


def test_a_file_without_a_row_is_refused(tmp_path):
    written(tmp_path, ["a.txt", "b.txt"])
    with pytest.raises(InputError, match=r"b\.txt: what \(--what\): labels\.csv has no row for this file"):
        found(tmp_path, "file,thing\na,cup\nc,rod\n")


def test_files_of_one_name_in_two_folders_are_told_apart_or_refused(tmp_path):
    written(tmp_path, ["x/1.txt", "y/1.txt"])
    assert found(tmp_path, "file,thing\ny/1.txt,cup\nx/1.txt,rod\n") == {0: "rod", 1: "cup"}
    with pytest.raises(InputError, match=r"1\.txt, which x/1\.txt and y/1\.txt may be"):
        found(tmp_path, "file,thing\n1.txt,cup\n1.txt,rod\n")


def test_as_many_taps_as_a_tap_has_samples(tmp_path):
    """Three files of three samples, and a table of three rows: one for each tap."""
    written(tmp_path, ["a.txt", "b.txt", "c.txt"], samples=3)
    assert found(tmp_path, "thing\ncup\nrod\nball\n") == {0: "cup", 1: "rod", 2: "ball"}


def test_a_table_in_each_folder(tmp_path):
    written(tmp_path, ["x/1.txt", "x/2.txt", "y/1.txt"])
    (tmp_path / "x" / "labels.csv").write_text("thing\ncup\nrod\n")
    (tmp_path / "y" / "labels.csv").write_text("thing\nball\n")
    assert found(tmp_path, "thing\nwrong\n") == {0: "cup", 1: "rod", 2: "ball"}


@pytest.mark.parametrize("cut", [False, True])
def test_tables_of_one_name_in_several_folders_are_those_of_their_files(tmp_path, cut):
    """Though they have as many rows; also of the presses of streams."""
    for folder, things in (("x", "cup rod"), ("y", "pot can")):
        (tmp_path / folder).mkdir()
        rows = "".join(f"{n // 4},{n % 4},{n}\n" for n in range(8))
        (tmp_path / folder / "a.csv").write_text(f"tap,f,n\n{rows}")
        (tmp_path / folder / "labels.csv").write_text(f"at,thing\n0,{things.split()[0]}\n4,{things.split()[1]}\n")
    how = TapMap(files="*/a.csv", taxels="n", tap="tap", what="labels.csv:thing")
    if cut:
        how = how.changed(tap=None, trigger="events", events="labels.csv:at", window=4)
    taps = load_mapped(tmp_path, how).taps
    assert [taps.what_name[m] for m in taps.what] == ["cup", "rod", "pot", "can"]


def test_taps_that_are_not_kept_have_their_rows_in_the_table(tmp_path):
    for number in (0, 1):
        np.savez(tmp_path / f"{number}.npz", x=np.arange(3.0).reshape(3, 1, 1) + 3 * number, ok=[1, number, 1])
    table = "thing\n" + "\n".join("abcdef")
    assert found(tmp_path, table, files="*.npz", taps="x", taxels=None, tap=None, keep="ok") == dict(
        zip((0, 2, 3, 4, 5), "acdef", strict=True)
    )
    with pytest.raises(InputError, match=r"labels\.csv: 4 rows for 6 taps"):
        found(tmp_path, "thing\na\nb\nc\nd\n", files="*.npz", taps="x", taxels=None, tap=None)


@given(st.lists(st.sampled_from(["a", "b", "10", "9", ""]), min_size=1, max_size=12))
def test_labels_are_counted_in_the_order_in_which_they_appear(labels):
    texts, first, which = distinct(np.array(labels))

    assert texts == list(dict.fromkeys(labels))
    assert [labels[row] for row in first] == texts
    assert [texts[number] for number in which] == labels
    assert first.tolist() == [labels.index(text) for text in texts]


@pytest.mark.parametrize(
    ("days", "sessions"),
    [(["2", "10", "2"], [2, 10, 2]), (["1", "01", "1"], [0, 1, 0]), (["d10", "d9", "d10"], [1, 0, 1])],
)
def test_sessions_are_as_they_stand_if_they_are_whole_numbers(days, sessions, tmp_path):
    """Others are numbered in natural order; 1 and 01 are two names."""
    rows = "".join(f"{day},{n}\n" for n, day in enumerate(days))
    (tmp_path / "a.csv").write_text(f"day,p\n{rows}", encoding="utf-8")
    taps = load_mapped(tmp_path / "a.csv", TapMap(taxels="p", tap="row", session="day")).taps

    assert taps.session.tolist() == sessions


@pytest.mark.parametrize("ids", [["3", "1", "2", "1"], ["3.0", "1", "2", "01"]])
def test_a_column_of_both_tells_which_row_is_whose(ids, tmp_path):
    """Numbers by their value, in any order."""
    rows = "".join(f"{number},{n}\n" for n, number in enumerate(ids))
    (tmp_path / "a.csv").write_text(f"id,p\n{rows}", encoding="utf-8")
    (tmp_path / "names.csv").write_text("thing,id\none,1\ntwo,2\nthree,3\nfour,4\n", encoding="utf-8")
    how = TapMap(taxels="p", tap="row", what="names.csv:thing")
    taps = load_mapped(tmp_path / "a.csv", how).taps

    assert [taps.what_name[m] for m in taps.what] == ["three", "one", "two", "one"]
    for table, message in (("id,thing\n1,a\n3,b\n", "no row with id 2"), ("id,thing\n1,a\n1,b\n", "id 1 in two rows")):
        (tmp_path / "names.csv").write_text(table, encoding="utf-8")
        with pytest.raises(InputError, match=rf"what \(--what\): the table has {message}"):
            load_mapped(tmp_path / "a.csv", how)


def test_a_table_may_name_files_in_capitals(tmp_path):
    written(tmp_path, ["Rec_a.txt", "rec_b.txt"])

    assert found(tmp_path, "file,thing\nREC_B,cup\nrec_A,ball\n") == {0: "ball", 1: "cup"}


@pytest.mark.parametrize("header", ["", "objects\n"])
def test_names_may_be_lines_of_a_file(header, tmp_path):
    """With or without a header."""
    (tmp_path / "names.txt").write_text(f"{header}apple\npear\nplum\n", encoding="utf-8")
    np.savez(tmp_path / "a.npz", x=np.zeros((3, 2, 2)), label=np.array([2, 0, 1]))
    taps = load_mapped(tmp_path / "a.npz", TapMap(taps="x", what="label", what_names="names.txt")).taps

    assert [taps.what_name[m] for m in taps.what] == ["plum", "apple", "pear"]


def test_a_table_may_name_files_by_their_number(tmp_path):
    """Though a column that names them as they are called goes before."""
    written(tmp_path, ["rec_7.txt", "rec_8.txt", "rec_10.txt"])
    by_number = "run,thing\n10,cup\n7,ball\n8,rod\n"
    assert found(tmp_path, by_number) == {0: "ball", 1: "rod", 2: "cup"}
    by_name = "at,file,thing\n7,rec_10,cup\n8,rec_7,ball\n10,rec_8,rod\n"
    assert found(tmp_path, by_name) == {0: "ball", 1: "rod", 2: "cup"}


def told(folder, files, how):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    taps, sentences = load_mapped([folder / name for name in files if name.startswith("day")], how)
    return [taps.what_name[m] for m in taps.what], sentences


DAYS = {"day0.csv": "n,p\n1,0\n0,1\n", "day1.csv": "n,p\n3,2\n2,3\n"}
HOW = TapMap(taxels="p", tap="row", what="labels.csv:thing")


@pytest.mark.parametrize(
    ("table", "things", "way"),
    [
        ("n,thing\n0,a\n1,b\n2,c\n3,d\n", "badc", "read by its column n, which the recording has as well."),
        ("id,thing\n0,a\n1,b\n", "aabb", "read by numbers of files in its column id."),
        ("kg,thing\n7,a\n1,b\n5,c\n3,d\n", "abcd", "read in the order of the taps, as it names no files and shares no"),
        ("file,thing\nday1,a\nDAY0.CSV,b\n", "bbaa", "read by names of files in its column file."),
    ],
)
def test_a_column_that_both_have_goes_before_numbers_of_files_and_the_order(table, things, way, tmp_path):
    """What was done is told."""
    found, sentences = told(tmp_path, DAYS | {"labels.csv": table}, HOW)

    assert "".join(found) == things
    assert sentences[0].startswith(f"labels.csv is {way}")


def test_two_columns_that_may_number_the_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="columns id and kg of the table of labels may both number"):
        told(tmp_path, DAYS | {"labels.csv": "id,kg,thing\n0,1,a\n1,0,b\n"}, HOW)


def test_blanks_around_names_and_the_precision_of_numbers_do_not_count(tmp_path):
    for session, kind in enumerate((np.float32, np.float64)):
        label, at = np.array(["rod ", " cup"]), np.array([0.1, 0.2], kind)
        np.savez(tmp_path / f"{session}.npz", x=np.full((2, 1, 1), session), label=label, at=at)
    taps = load_mapped(tmp_path, TapMap(taps="x", what="label", where="at")).taps

    assert (taps.what_name, taps.where.tolist()) == (["rod", "cup"], [0.1, 0.2] * 2)


@pytest.mark.parametrize(
    ("ats", "places"),
    [
        ("x-2 x-5", [2, 5]),
        ("x_-2 x_2", [-2, 2]),
        ("-2 2", [-2, 2]),
        ("1e-3 2e3", [0.001, 2000]),
        ("x-2 x2", None),
        ("x-2mm x2mm", None),
    ],
)
def test_a_hyphen_that_may_be_a_minus_is_refused(ats, places, tmp_path):
    rows = "".join(f"{at},{n}\n" for n, at in enumerate(ats.split()))
    (tmp_path / "a.csv").write_text(f"at,p\n{rows}", encoding="utf-8")
    how = TapMap(taxels="p", tap="row", where="at")
    if places is None:
        with pytest.raises(InputError, match=r"where \(--where\): the sign in 'x-2.*' may be a minus or a hyphen"):
            load_mapped(tmp_path, how)
    else:
        assert load_mapped(tmp_path, how).taps.where.tolist() == places


def test_positions_are_rounded_in_their_unit(tmp_path):
    """So that those of a stage in micrometres are whole millimetres."""
    (tmp_path / "a.csv").write_text("at,n,p\n-201,0,1\n1003,1,2\n1998,1,3\n", encoding="utf-8")
    how = TapMap(taxels="p", tap="row", where="at", where_scale=0.001, where_round=1, where_unit="mm")
    where = load_mapped(tmp_path, how).taps.where

    assert where.tolist() == [0, 1, 2]
    assert not np.signbit(where).any()
    with pytest.raises(InputError, match=r"where \(--where\) changes within a tap from 1003 to 1998"):
        load_mapped(tmp_path, how.changed(tap="n"))


@pytest.mark.parametrize(
    ("table", "things", "way"),
    [
        ("day,n,thing\n1,2,d\n1,3,c\n0,0,b\n0,1,a\n", "abcd", "read by its columns day, n, which"),
        (
            "file,n,thing\nday1,2,d\nday1,3,c\nday0,0,b\nday0,1,a\n",
            "abcd",
            "read by names of files in its column file and its column n,",
        ),
        ("day,thing\n0,a\n0,b\n1,c\n1,c\n1,c\n1,c\n", None, "6 rows for 4 taps"),
        ("day,n,thing\n1,2,d\n1,2,c\n0,0,b\n0,1,a\n", None, "the table has day, n 1, 2 in two rows"),
    ],
)
def test_several_columns_may_tell_rows_apart(table, things, way, tmp_path):
    """Where a number counts the taps of each day or file."""
    days = {f"day{day}.csv": f"day,n,p\n{day},{n},{n}\n{day},{m},{m}\n" for day, n, m in ((0, 1, 0), (1, 3, 2))}
    if things is None:
        with pytest.raises(InputError, match=way):
            told(tmp_path, days | {"labels.csv": table}, HOW)
    else:
        found, sentences = told(tmp_path, days | {"labels.csv": table}, HOW)
        assert "".join(found) == things
        assert way in sentences[0]


@pytest.mark.parametrize(
    ("recording", "how"),
    [
        ("1;0\n", {"header": False, "taxels": "0:2"}),
        ("1;0\n", {"header": False, "delimiter": ";", "taxels": "0:2"}),
        ("a;b\n1;0\n", {"delimiter": ";", "decimal": ","}),
        ("by a rig\na b\n1 0\n", {"skip_rows": 1, "delimiter": "blank"}),
    ],
)
@pytest.mark.parametrize("table", ["name,thing,turn [deg]\n1,rod,2.5\n", "thing;turn [deg]\nrod;2.5\n"])
def test_a_table_may_be_written_in_another_way_than_the_recording(tmp_path, recording, how, table):
    """With its unit."""
    (tmp_path / "1.txt").write_text(recording)
    (tmp_path / "labels.csv").write_text(table)
    labels = {"what": "labels.csv:thing", "where": "labels.csv:turn"}

    taps = load_mapped(tmp_path / "1.txt", TapMap(**({"taxels": "*", "tap": "file"} | labels | how))).taps

    assert (taps.taps.tolist(), taps.what_name, taps.where.tolist(), taps.where_unit) == (
        [[[1, 0]]],
        ["rod"],
        [2.5],
        "deg",
    )


def test_a_list_of_names_of_several_words_is_one_column(tmp_path):
    written(tmp_path, ["1.txt", "2.txt", "3.txt"])
    assert found(tmp_path, "thing\nred ball\ncup\nold red rod\n") == {0: "red ball", 1: "cup", 2: "old red rod"}


@pytest.mark.parametrize("how", [{"delimiter": ";"}, {"decimal": ","}, {"delimiter": "tab", "decimal": ","}])
def test_columns_of_a_table_are_told_apart_whatever_parts_those_of_the_recording(tmp_path, how):
    sign = "\t" if how.get("delimiter") == "tab" else ";"
    for number in (1, 2):
        (tmp_path / f"{number}.txt").write_text(f"a{sign}b\n{number}{sign}0\n")
    (tmp_path / "labels.csv").write_text("file,what\n2.txt,rod\n1.txt,cup\n")

    taps = load_mapped(
        tmp_path, TapMap(**({"files": "*.txt", "taxels": "*", "tap": "file", "what": "labels.csv"} | how))
    )

    assert [taps.taps.what_name[m] for m in taps.taps.what] == ["cup", "rod"]


def test_names_with_commas_need_the_name_of_their_column(tmp_path):
    written(tmp_path, ["1.txt", "2.txt"])
    table = 'thing\n"ball, red"\n"cup, blue"\n'
    with pytest.raises(InputError, match=r"labels.csv: 'thing' may be several columns; say which with labels.csv:COLU"):
        found(tmp_path, table, what="labels.csv")
    assert found(tmp_path, table) == {0: "ball, red", 1: "cup, blue"}


def test_fields_of_names_are_compared_with_columns_of_their_name(tmp_path):
    """Numbers by their value, texts in any capitals; the table is in another order than the files."""
    names = [f"s{session}/trial_{trial:02}.txt" for session in "AB" for trial in (1, 2, 10)]
    written(tmp_path, names)
    table = "trial,session,thing\n10,a,cup\n2,b,rod\n1,a,ball\n1,b,pot\n10,b,jug\n2,a,can\n3,a,none\n"
    how = {"files": "s{session}/trial_{trial}.txt"}
    assert found(tmp_path, table, **how) == dict(enumerate(["ball", "can", "cup", "pot", "rod", "jug"]))
    with pytest.raises(InputError, match=r"sB/trial_10\.txt: what \(--what\): labels\.csv has no row for this file"):
        found(tmp_path, table.replace("10,b,jug\n", ""), **how)


def test_a_column_of_folders_tells_files_of_one_name_apart(tmp_path):
    written(tmp_path, ["Day1/p.txt", "Day1/q.txt", "Day2/p.txt"])
    table = "day,file,thing\nday2,p.txt,rod\nday1,q.txt,cup\nday1,p.txt,ball\n"
    assert found(tmp_path, table) == {0: "ball", 1: "cup", 2: "rod"}


def test_rows_of_a_folder_are_those_of_its_files_in_their_order(tmp_path):
    """One for all of them, or one for each tap."""
    written(tmp_path, ["x/1.txt", "x/2.txt", "y/1.txt"])
    assert found(tmp_path, "person,thing\ny,rod\nx,cup\n") == {0: "cup", 1: "cup", 2: "rod"}
    assert found(tmp_path, "person,thing\ny,rod\nx,cup\nx,ball\n") == {0: "cup", 1: "ball", 2: "rod"}


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        (
            "1,cup\n2,rod\n",
            r"labels\.csv: 2 rows for 3 taps; its column run has numbers in the names of files, but not",
        ),
        (
            "1,cup\n2,rod\n4,pot\n",
            r"labels\.csv: its column run has numbers .* but not the same ones; labels\.csv:thing:COL",
        ),
    ],
)
def test_a_table_that_nearly_numbers_the_files_is_refused_with_the_way_out(tmp_path, rows, sentence):
    written(tmp_path, ["rec_1.txt", "rec_2.txt", "rec_3.txt"])
    with pytest.raises(InputError, match=sentence):
        found(tmp_path, f"run,thing\n{rows}")
    by_run = {"what": "labels.csv:thing:run"}
    if "3," in rows:
        assert found(tmp_path, f"run,thing\n{rows}", **by_run) == {0: "rod", 1: "pot", 2: "cup"}
    else:
        with pytest.raises(InputError, match=r"rec_3\.txt: what \(--what\): labels\.csv has no row for this file"):
            found(tmp_path, f"run,thing\n{rows}", **by_run)
    if rows.count("\n") == 3:
        assert found(tmp_path, f"run,thing\n{rows}", what="labels.csv:thing:order") == {0: "cup", 1: "rod", 2: "pot"}


def test_a_column_that_names_of_files_are_called_after_numbers_them_in_any_order(tmp_path):
    written(tmp_path, ["run_1.txt", "run_2.txt", "run_3.txt"])
    assert found(tmp_path, "Run,thing\n3,cup\n1,rod\n2,pot\n") == {0: "rod", 1: "pot", 2: "cup"}


def test_what_tells_rows_can_be_said(tmp_path):
    """A column of another name in the recording, a field, or the number of the file among others."""
    written(tmp_path, ["s1_rec_7.txt", "s1_rec_3.txt"])
    table = "id,nr,thing\n1,3,cup\n2,7,rod\n"
    assert found(tmp_path, table, files="*_rec_{trial}.txt", what="labels.csv:thing:nr=trial") == {0: "rod", 1: "cup"}
    (tmp_path / "a.txt").write_text("m,p\n2,0\n1,1\n2,2\n")
    how = {"files": "a.txt", "tap": "row", "taxels": "p", "what": "labels.csv:thing:id=m"}
    assert found(tmp_path, table, **how) == {0: "rod", 1: "cup", 2: "rod"}
    for what, sentence in (
        ("labels.csv:thing:no", "no column no; columns: id, nr, thing"),
        ("labels.csv:thing:id=no", "no column no; there is"),
        ("labels.csv:thing:id", "no column id; there is"),
    ):
        with pytest.raises(InputError, match=sentence):
            found(tmp_path, table, **how | {"what": what})


def test_a_table_of_one_file_does_not_number_it(tmp_path):
    """Its column counts presses, though 1 and 2 are the numbers of the files."""
    for number in (1, 2):
        (tmp_path / f"rec_{number}.txt").write_text(
            "".join(f"{row},{n}\n" for n, row in enumerate("ab", 2 * number - 2))
        )
        (tmp_path / f"labels_{number}.csv").write_text("press,thing\n" + f"1,{'cup' * number}\n2,rod\n")
    how = {"files": "rec_{session}.txt", "header": False, "taxels": "1:2", "tap": "row"}
    (tmp_path / "labels.csv").write_text("")
    taps = load_mapped(tmp_path, TapMap(what="labels_{session}.csv:thing", **how)).taps
    assert [taps.what_name[m] for m in taps.what] == ["cup", "rod", "cupcup", "rod"]


def test_the_column_that_numbers_files_may_be_the_label(tmp_path):
    written(tmp_path, ["rec_7.txt", "rec_3.txt", "rec_12.txt"])
    assert found(tmp_path, "run\n3\n12\n7\n", what="labels.csv:run") == {0: "7", 1: "3", 2: "12"}


@pytest.mark.parametrize(
    "text", ["data/raw/{}.txt", "C:\\data\\raw\\{}.txt", "./{}.txt", "{}.bag", "/home/me/lab/{}", "DATA/{}.TXT"]
)
def test_names_of_files_may_have_folders_and_endings_of_the_author(tmp_path, text):
    written(tmp_path, ["rec_a.txt", "rec_b.txt"])
    assert found(tmp_path, f"file,thing\n{text.format('rec_b')},cup\n{text.format('rec_a')},rod\n") == {
        0: "rod",
        1: "cup",
    }


def test_folders_of_the_author_tell_files_of_one_name_apart(tmp_path):
    written(tmp_path, ["x/1.txt", "y/1.txt"])
    assert found(tmp_path, "file,thing\nlab/y/1.txt,cup\nlab/x/1.txt,rod\n") == {0: "rod", 1: "cup"}


def test_labels_of_taps_that_are_empty_are_not_needed(tmp_path):
    cells, at = np.empty(3, dtype=object), np.empty(3, dtype=object)
    cells[:] = [np.full((2, 2), 1.0), np.empty((0, 0)), np.full((2, 2), 3.0)]
    at[:] = [3.0, np.empty((0, 0)), 5.0]
    scipy.io.savemat(tmp_path / "a.mat", {"x": cells, "at": at})

    taps = load_mapped(tmp_path / "a.mat", TapMap(taps="x", axes="tap,sample,taxel", where="at", length=2)).taps

    assert (taps.taps[:, 0, 0].tolist(), taps.where.tolist()) == ([1, 3], [3, 5])


def test_an_array_has_a_label_for_each_of_the_arrays_of_a_file(tmp_path):
    """In the natural order of their names."""
    arrays = {f"tap_{n}": np.full((4, 2), n) for n in (1, 2, 10)}
    np.savez(tmp_path / "a.npz", **arrays, thing=np.array(["cup", "rod", "pot"]))
    how = TapMap(taps="tap_*", axes="sample,taxel", tap="file", what="thing")
    taps = load_mapped(tmp_path / "a.npz", how).taps
    assert [taps.what_name[m] for m in taps.what] == ["cup", "rod", "pot"]
    assert taps.taps[:, 0, 0].tolist() == [1, 2, 10]


@pytest.mark.parametrize("column", ["tap_id", "random order"])
def test_a_table_with_its_rows_counted_in_another_order_is_refused_with_the_ways_out(tmp_path, column):
    """As it may be shuffled, or a column of it may count something else."""
    (tmp_path / "a.txt").write_text("tap,p\n0,0\n1,1\n2,2\n")
    how = {"tap": "row", "taxels": "p", "files": "a.txt"}
    table = f"{column},thing\n2,cup\n0,rod\n1,pot\n"
    with pytest.raises(
        InputError, match=rf"by its column {column} its rows are in another order than the taps; labels.csv:th"
    ):
        found(tmp_path, table, **how)
    assert found(tmp_path, table, **how, what="labels.csv:thing:order") == {0: "cup", 1: "rod", 2: "pot"}
    by_tap = f"labels.csv:thing:{column}=tap"
    assert found(tmp_path, table, **how, what=by_tap) == {0: "rod", 1: "pot", 2: "cup"}
    assert found(tmp_path, f"{column},thing\n0,cup\n1,rod\n2,pot\n", **how) == {0: "cup", 1: "rod", 2: "pot"}
    (tmp_path / "labels.csv").write_text(table)
    taps = load_mapped(tmp_path, TapMap(what="labels.csv:thing", where=f"labels.csv:{column}", **how)).taps
    assert taps.where.tolist() == [2, 0, 1]  # it is a label itself


def test_columns_of_both_may_differ_in_capitals(tmp_path):
    (tmp_path / "a.txt").write_text("tap,p\n0,0\n1,1\n2,2\n")
    table = "Tap,thing\n2,cup\n0,rod\n1,pot\n"
    assert found(tmp_path, table, tap="row", taxels="p", files="a.txt") == {0: "rod", 1: "pot", 2: "cup"}


def test_a_column_of_both_outweighs_the_numbers_of_files(tmp_path):
    for number, sort in ((1, 2), (2, 1)):
        (tmp_path / f"rec_{number}.txt").write_text(f"id,p\n{sort},{number}\n{sort},{number}\n")
    assert found(tmp_path, "id,thing\n1,cup\n2,rod\n", taxels="p") == {1: "rod", 2: "cup"}


@pytest.mark.parametrize(("names", "alike"), [(["Rod", "rod"], "Rod and rod"), (["a-1", "a 1", "b"], "a-1 and a 1")])
def test_objects_that_differ_in_signs_alone_are_told(names, alike, tmp_path):
    rows = "".join(f"{name},{n}\n" for n, name in enumerate(names))
    (tmp_path / "a.csv").write_text(f"thing,p\n{rows}")
    told = load_mapped(tmp_path / "a.csv", TapMap(taxels="p", tap="row", what="thing")).told
    assert told == (f"what (--what): {alike} are two objects that differ in signs alone.",)


@pytest.mark.parametrize(
    ("rows", "column"),
    [
        ("10 11 12 00 01 02", "day"),
        ("00 10 01 11 02 12", "day"),
        ("02 00 01 10 11 12", "nr"),
        ("00 01 02 10 11 12", None),
    ],
)
def test_a_table_that_contradicts_the_order_of_the_taps_is_refused(rows, column, tmp_path):
    """By the days that both have, or by what it counts in each day."""
    taps = [f"{day},{tap}" for day in (0, 1) for tap in (0, 1, 2)]
    (tmp_path / "a.txt").write_text("day,tap,p\n" + "".join(f"{tap},{n}\n" for n, tap in enumerate(taps)))
    how = {"tap": "row", "taxels": "p", "files": "a.txt"}
    table = "day,nr,thing\n" + "".join(f"{day},{nr},{n}\n" for n, (day, nr) in zip("abcdef", rows.split(), strict=True))
    if column is None:
        assert found(tmp_path, table, **how) == dict(enumerate("abcdef"))
        return
    with pytest.raises(InputError, match=rf"by its column {column} its rows are in another order than the taps"):
        found(tmp_path, table, **how)
    by_both = found(tmp_path, table, **how, what="labels.csv:thing:nr=tap")
    assert "".join(by_both.values()) == "".join(np.array(list("abcdef"))[np.argsort(rows.split())])
    with pytest.raises(InputError, match=r"the table has nr \d in two rows"):
        found(tmp_path, table.replace("day", "date"), **how, what="labels.csv:thing:nr=tap")


@pytest.mark.parametrize("kind", ["jsonl", "parquet"])
def test_tables_may_be_of_other_formats(tmp_path, kind):
    """As those of a LeRobot data set: days by the number of the episode, names by the number of the task."""
    (tmp_path / "meta").mkdir()
    frames = {"episode_index": np.repeat([0, 1, 2], 2), "task_index": np.repeat([4, 3, 4], 2), "p": np.arange(6.0)}
    pq.write_table(pa.table(frames), tmp_path / "a.parquet")
    tasks, days = {"task_index": [3, 4], "task": ["cup", "rod"]}, {"episode_index": [2, 0, 1], "day": ["b", "a", "b"]}
    for name, table in (("tasks", tasks), ("days", days)):
        rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
        path = tmp_path / f"meta/{name}.{kind}"
        if kind == "jsonl":
            path.write_text("\n".join(map(json.dumps, rows)))
        else:
            pq.write_table(pa.table(table), path)
    how = TapMap(taxels="p", tap="episode_index", what="task_index", what_names=f"meta/tasks.{kind}:task")

    taps = load_mapped(tmp_path / "a.parquet", how.changed(session=f"meta/days.{kind}:day")).taps

    assert [taps.what_name[m] for m in taps.what] == ["rod", "cup", "rod"]
    assert taps.session.tolist() == [0, 1, 1]


def test_attributes_of_arrays_are_kept_and_keep_taps(tmp_path):
    """Under the last part of their names."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for n, success in enumerate((1, 0, 1)):
            file[f"s/trial_{n}/x"] = np.full((2, 2), n)
            file[f"s/trial_{n}"].attrs.update(success=success, kind=f"k{n}")
    how = TapMap(taps="s/trial_{trial}/x", axes="sample,taxel", tap="file", what="s/trial_{trial}@kind")
    how = how.changed(extra=("s/trial_{trial}@success", "s/trial_{trial}@kind"))

    taps = load_mapped(tmp_path / "a.h5", how).taps
    assert (taps.dataset["success"].values.tolist(), taps.dataset["kind"].values.tolist()) == (
        [1, 0, 1],
        ["k0", "k1", "k2"],
    )
    taps = load_mapped(tmp_path / "a.h5", how.changed(keep="s/trial_{trial}@success=1")).taps
    assert taps.taps[:, 0, 0].tolist() == [0, 2]


def test_a_table_that_names_the_columns_of_taps_is_not_read_in_their_order(tmp_path):
    (tmp_path / "a.txt").write_text("u,v,w\n1,2,3\n1,2,3\n")
    how = {"files": "a.txt", "taxels": "{tap}", "tap": None}
    assert found(tmp_path, "tap,thing\nu,cup\nv,rod\nw,pot\n", **how) == {1: "cup", 2: "rod", 3: "pot"}
    with pytest.raises(InputError, match="by its column tap its rows are in another order than the taps"):
        found(tmp_path, "tap,thing\nw,pot\nu,cup\nv,rod\n", **how)


@pytest.mark.parametrize("keep", ["ok=1", "ok=0"])
def test_a_table_may_list_taps_that_are_not_kept(tmp_path, keep):
    """Rows of one are dropped, of another all."""
    (tmp_path / "a.txt").write_text("n,ok,p\n0,1,0\n0,0,0\n1,0,1\n1,0,1\n2,1,2\n2,1,2\n3,1,3\n")
    how = {"files": "a.txt", "taxels": "p", "tap": "n", "keep": keep, "length": "shortest"}
    kept = {0: "cup", 2: "pot", 3: "can"} if keep == "ok=1" else {0: "cup", 1: "rod"}
    assert found(tmp_path, "thing\ncup\nrod\npot\ncan\n", **how) == kept


def test_numbers_of_all_files_in_another_order_than_the_rows_may_count_something_else(tmp_path):
    """As an order of presentation does; names of files that are called after the column tell."""
    written(tmp_path, ["rec_1.txt", "rec_2.txt", "rec_3.txt"])
    table = "run,thing\n3,cup\n1,rod\n2,pot\n"
    with pytest.raises(InputError, match="by its column run its rows are in another order than the taps"):
        found(tmp_path, table)
    assert found(tmp_path, table, what="labels.csv:thing:run") == {0: "rod", 1: "pot", 2: "cup"}
    assert found(tmp_path, table, what="labels.csv:thing:order") == {0: "cup", 1: "rod", 2: "pot"}
    for number in (1, 2, 3):
        (tmp_path / f"rec_{number}.txt").rename(tmp_path / f"run_{number}.txt")
    assert found(tmp_path, table) == {0: "rod", 1: "pot", 2: "cup"}
