"""CSV files and folders of them."""

from pathlib import Path

import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.load import load_taps, read_recording

HEADER = "tap,what,where,taxel_1,taxel_2\n"


def write(folder: Path, text: str, name: str = "a.csv") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def test_the_least_that_is_needed_is_an_object_and_a_taxel(tmp_path):
    """Without the other columns there is one position and one session, and taps count as trials."""
    taps = load_taps(write(tmp_path, "tap,what,taxel\n4,ball,1\n4,ball,2\n2,box,3\n2,box,4.5\n"))

    assert taps.taps.tolist() == [[[1.0], [2.0]], [[3.0], [4.5]]]
    assert taps.what_name == ["ball", "box"]
    assert taps.trial.tolist() == [4, 2]
    assert taps.session.tolist() == [0, 0]
    assert taps.preprocessing.rate_hz is None


def test_bytes_that_spreadsheets_add_do_no_harm(tmp_path):
    """A byte order mark, Windows line ends, blank lines, quotes, blanks around names and a last comma are fine."""
    text = '\ufeff\r\n   \r\ntap, what ,"taxel 1"\r\n0,"ball, red",1e3\r\n\r\n1,box, -2 ,\r\n\r\n'

    taps = load_taps(write(tmp_path, text))

    assert taps.what_name == ["ball, red", "box"]
    assert taps.taps.ravel().tolist() == [1000.0, -2.0]


def test_numbers_are_read_as_python_reads_them(tmp_path):
    """Exactly."""
    cells = ("0.1", "-0", "9007199254740993", "2.2250738585072011e-308", " 7\t", "123456789012345678901")
    taps = load_taps(write(tmp_path, "tap,what,taxel\n" + "".join(f"{i},a,{cell}\n" for i, cell in enumerate(cells))))

    assert taps.taps.tobytes() == np.array([float(cell) for cell in cells]).tobytes()


def test_names_that_look_like_numbers_stay_as_they_are_written(tmp_path):
    """Objects are text; so is another column, unless all of its cells are numbers."""
    taps = load_taps(write(tmp_path, "tap,what,taxel,who,flag\n0,1.50,1,NA,True\n1,1.5,1,7,False\n"))

    assert taps.what_name == ["1.50", "1.5"]
    assert taps.dataset["who"].values.tolist() == ["NA", "7"]
    assert taps.dataset["flag"].values.tolist() == ["True", "False"]


def test_objects_are_in_the_order_of_their_size_or_of_their_appearance(tmp_path):
    by_size = load_taps(write(tmp_path, "tap,what,what_value,taxel\n0,big,9,1\n1,small,2,1\n2,big,9,1\n"))
    by_appearance = load_taps(write(tmp_path, "tap,what,taxel\n0,z,1\n1,a,1\n2,z,1\n"))

    assert (by_size.what_name, by_size.what.tolist()) == (["small", "big"], [1, 0, 1])
    assert by_size.dataset["what_value"].values.tolist() == [2.0, 9.0]
    assert (by_appearance.what_name, by_appearance.what.tolist()) == (["z", "a"], [0, 1, 0])


def test_other_columns_are_kept_as_numbers_or_text(tmp_path):
    taps = load_taps(write(tmp_path, "tap,what,taxel,depth,who\n0,a,1,0.5,ann\n1,a,1,2,bo\n"))

    assert taps.dataset["depth"].values.tolist() == [0.5, 2.0]
    assert taps.dataset["who"].values.tolist() == ["ann", "bo"]


BAD = {
    "empty": ("", "the file is empty"),
    "header only": (HEADER, "no rows below the header"),
    "no object": ("tap,taxel_1\n0,1\n", r"line 1: missing column what; columns, split at commas: tap, taxel_1;"),
    "semicolons": (
        "tap;what;taxel\n0;a;1\n",
        "line 1: missing column what; columns, split at commas: tap;what;taxel",
    ),
    "no taxel": ("tap,what,force\n0,a,1\n", "no column name starts with taxel"),
    "column twice": ("tap,what,taxel,taxel\n0,a,1,2\n", "line 1: column 'taxel' is repeated"),
    "not a number": (HEADER + "0,a,1,1,2\n0,a,1,x7,2\n", r"line 3, column taxel_1: 'x7' is not a number"),
    "after blank lines": (
        HEADER + "0,a,1,1,2\n\n\n0,a,1,,2\n",
        r"line 5, column taxel_1 is nan; NaN and infinite",
    ),
    "after quoted line end": ('tap,what,taxel\n0,"a\nb",1\n1,c,x\n', r"line 4, column taxel: 'x'"),
    "decimal comma": (HEADER + '0,a,1,"1,5",2\n', r"line 2, column taxel_1: '1,5'"),
    "nan": (HEADER + "0,a,1,1,nan\n", r"line 2, column taxel_2 is nan; NaN and infinite"),
    "infinite": (HEADER + "0,a,1,1,2\n0,a,1,-inf,2\n", r"line 3, column taxel_1 is -inf"),
    "truth values": ("tap,what,taxel\n0,a,True\n1,a,False\n", r"line 2, column taxel: 'True' is not a"),
    "zero bytes": (HEADER + "0,a,1,1,2\n0,a,1,1,2\0\0\n", "not a text table: it holds zero bytes"),
    "separators": (HEADER + "0,a,1,1_000,2\n", "line 2, column taxel_1: '1_000' is not a number"),
    "text cell missing": (
        "tap,what,taxel,who\n0,a,1,ann\n1,a,1\n",
        r"line 3: 3 cells, but there are 4 columns, split at commas\.",
    ),
    "after a quote": ('tap,what,taxel\n0,"a"b,1\n', "line 2: ',' expected after '\"'"),
    "cell missing": (HEADER + "0,a,1,1\n", "line 2: 4 cells, but there are 5 columns"),
    "cell too many": (HEADER + "0,a,1,1,2,9\n", "line 2: 6 cells, but there are 5 columns"),
    "object empty": (HEADER + "0,a,1,1,2\n1, ,1,1,2\n", "line 3, column what: empty"),
    "tap broken": (HEADER + "0,a,1,1,2\n0.5,a,1,1,2\n", "line 3, column tap: 0.5 is not an integer"),
    "lengths": (HEADER + "0,a,1,1,2\n0,a,1,1,2\n7,a,1,1,2\n", "line 4: tap 7 has 1 rows, the first tap 2"),
    "again": (HEADER + "3,a,1,1,2\n4,a,1,1,2\n3,a,1,1,2\n", "line 4: tap 3 of session 0 starts again"),
    "object changes": (HEADER + "3,a,1,1,2\n3,b,1,1,2\n", "line 3: column what changes within tap 3 from a to b"),
    "place changes": (
        HEADER + "3,a,1,1,2\n3,a,2,1,2\n",
        r"line 3: column where changes within tap 3 from 1\.0 to 2\.0",
    ),
    "size changes": (
        "tap,what,what_value,taxel\n0,a,1,1\n1,b,2,1\n2,a,3,1\n",
        "line 4: what_value of a differs from its first one",
    ),
    "time stands": (
        "tap,time_s,what,taxel\n0,0,a,1\n0,0.1,a,1\n1,0,a,1\n1,0,a,1\n",
        "line 5: time_s does not increase",
    ),
    "name taken": ("tap,what,taxel,sample\n0,a,1,2\n", "sample must be renamed"),
    "quote open": ('tap,what,taxel\n0,"a,1\n', "line 2: a quoted cell does not end"),
    "stream": ("what,taxel\na,1\na,2\n", "contains continuous streams; .* solidtouch convert --trigger"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_rows_are_named_with_line_and_column(case, tmp_path):
    text, message = BAD[case]
    path = write(tmp_path, text)

    with pytest.raises(InputError, match=message) as caught:
        load_taps(path)

    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1", "utf-16"])
def test_text_may_be_in_the_encodings_of_spreadsheets(encoding, tmp_path):
    (tmp_path / "a.csv").write_bytes("tap,what,taxel\n0,Würfel,1\n".encode(encoding))

    assert load_taps(tmp_path / "a.csv").what_name == ["Würfel"]


def test_each_file_of_a_folder_is_a_session_in_natural_order(tmp_path):
    """`run-2` comes before `run-10`, tap numbers may begin again in each file, other files are ignored."""
    for name, value in (("run-10.csv", 10), ("run-2.csv", 2), ("Run-1.CSV", 1)):
        write(tmp_path, f"tap,what,taxel\n0,a,{value}\n1,b,{value}\n", name)
    write(tmp_path, "notes", "read.me")

    taps = load_taps(tmp_path)

    assert taps.taps.ravel().tolist() == [1.0, 1.0, 2.0, 2.0, 10.0, 10.0]
    assert taps.session.tolist() == [0, 0, 1, 1, 2, 2]


def test_a_column_session_goes_before_the_number_of_the_file(tmp_path):
    for name, session in (("a.csv", 7), ("b.csv", 7), ("c.csv", 3)):
        write(tmp_path, f"tap,what,session,taxel\n0,a,{session},1\n", name)

    assert load_taps(tmp_path).session.tolist() == [7, 7, 3]


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (
            "tap,what,taxel_2,taxel_1\n0,a,1,2\n",
            r"b\.csv: line 1: taxel columns differ from those of .*a\.csv",
        ),
        ("tap,what,taxel_1\n0,a,1\n", r"b\.csv: line 1: taxel columns differ"),
        ("tap,what,where,taxel_1,taxel_2\n0,a,0,1,2\n", r"b\.csv: line 1: column where is either here or in"),
        ("tap,what,taxel_1,taxel_2\n0,a,1,x\n", r"b\.csv: line 2, column taxel_2"),
        ("tap,what,taxel_1,taxel_2\n0,a,1,2\n0,a,1,2\n", r"b\.csv, line 2: tap 0 has 2 rows"),
    ],
)
def test_files_of_a_folder_that_do_not_fit_are_named(second, message, tmp_path):
    write(tmp_path, "tap,what,taxel_1,taxel_2\n0,a,1,2\n")
    write(tmp_path, second, "b.csv")

    with pytest.raises(InputError, match=message):
        load_taps(tmp_path)


def test_the_rate_is_that_of_the_time_inside_taps(tmp_path, make_taps, table_of, put_table):
    """Pauses between taps and rounded times do not matter."""
    rows = table_of(make_taps(repeats=1))
    for row in rows:
        row["time_s"] = f"{row['time_s'] + 100 * row['tap']:.3f}"
    put_table(rows, tmp_path / "a.csv")

    assert load_taps(tmp_path / "a.csv").preprocessing.rate_hz == 50.0


def test_a_stream_has_the_rate_of_its_median_step(tmp_path):
    times = np.cumsum([0.01] * 9 + [0.5])
    lines = "".join(f"{time},a,1\n" for time in times)

    recording = read_recording(write(tmp_path, "time_s,what,taxel\n" + lines))

    assert recording.is_stream
    assert recording.rate_hz == 100.0


def test_many_columns_are_checked_soon(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"taxel_{k}" for k in range(50_000)) + f"\n{'0,' * 49_999}0\n")

    with pytest.raises(InputError, match="line 1: missing column what"):
        load_taps(path)
