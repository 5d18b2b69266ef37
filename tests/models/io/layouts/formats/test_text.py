"""Tables of text are read back as they were written, whatever the delimiter, decimal mark and encoding."""

import csv
import io
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.text import TextContents, open_text
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

SIGNS = {",": ",", ";": ";", "tab": "\t", "|": "|", "blank": " "}
NUMBERS = st.floats() | st.integers(-(2**60), 2**60).map(float)
WORDS = st.text("ab é\"',;|#\t.", max_size=8).map(lambda text: f"w{text}".strip())


def opened(folder: Path, content: str | bytes, **how):
    path = folder / "t.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return open_text(path, TextTable(**how))


def refused(folder: Path, content: str | bytes, names=(), columns=(), **how) -> str:
    with pytest.raises(InputError) as error:
        opened(folder, content, **how).read(names, columns)
    return str(error.value)


@st.composite
def tables(draw):
    """Numbers, words, how they are written, and the bytes of that."""
    name = draw(st.sampled_from(list(SIGNS)))
    decimal = draw(st.sampled_from(".," if name != "," else "."))
    numbers = np.array(draw(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=9)))
    words = draw(st.lists(WORDS, min_size=len(numbers), max_size=len(numbers)))
    header, comment = draw(st.booleans()), draw(st.sampled_from(("", "#", "//")))
    spare = draw(st.booleans()) and name != "blank"
    end, skip = draw(st.sampled_from(("\n", "\r\n", "\r"))), draw(st.integers(0, 2))
    encoding = draw(st.sampled_from(("utf-8", "utf-8-sig", "utf-16", "cp1252")))
    text = io.StringIO()
    ambiguous = comment or (name == "blank" and any("\t" in word for word in words))  # a tab is a blank, too
    quoting = csv.QUOTE_ALL if ambiguous else draw(st.sampled_from((csv.QUOTE_MINIMAL, csv.QUOTE_ALL)))
    quoted = csv.writer(text, delimiter=SIGNS[name], quoting=quoting, lineterminator="\n")
    text.write("anything\n" * skip)
    if header:
        quoted.writerow(["force [N]", "what µ", "t (ms)", *[""] * spare])
    for (a, b), word in zip(numbers, words, strict=True):
        if draw(st.booleans()):
            text.write(draw(st.sampled_from(("\n", "  \n"))))
        if comment and draw(st.booleans()):
            text.write(f"{comment} a note, with; signs | 5\n")
        shown = [repr(float(a)).replace(".", decimal), repr(float(b)).replace(".", decimal)]
        marked = any(sign in word for sign in ('"', "\t", " ", "#"))
        quoted.writerow([shown[0], word.replace('"', "") if marked else word, shown[1], *[""] * spare])
    clean = [word.replace('"', "") if any(s in word for s in ('"', "\t", " ", "#")) else word for word in words]
    return (
        numbers,
        clean,
        text.getvalue().replace("\n", end).encode(encoding),
        TextTable(delimiter=name, decimal=decimal, skip_rows=skip, comment=comment, header=header),
    )


@given(tables(), st.integers(1, 200))
def test_a_table_is_read_back_as_it_was_written(tmp_path_factory, table, size):
    """By blocks of any size."""
    numbers, words, content, how = table
    path = tmp_path_factory.mktemp("t") / "t.csv"
    path.write_bytes(content)
    for contents in (open_text(path, how), TextContents(path, how, size)):
        force, what, time = list(contents.variables)
        if how.header:
            assert [force, what, time] == ["force [N]", "what µ", "t (ms)"]
        texts, read = contents.read([what], [time, force])

        np.testing.assert_array_equal(read, numbers[:, ::-1])
        assert [" ".join(word.split()) for word in texts[what]] == [" ".join(word.split()) for word in words]


@given(tables())
def test_the_delimiter_that_is_found_is_the_one_that_was_written(tmp_path_factory, table):
    """Or it is not clear, and the message names the option.

    Without a header, signs in words may divide every row alike, and then nothing tells what was meant.
    """
    _, words, content, how = table
    assume(how.header or not any(sign in word for word in words for sign in SIGNS.values()))
    path = tmp_path_factory.mktemp("t") / "t.csv"
    path.write_bytes(content)
    given_ = open_text(path, how)
    try:
        found = open_text(
            path, TextTable(**{key: getattr(how, key) for key in how.__struct_fields__ if key != "delimiter"})
        )
    except InputError as error:
        assert "--delimiter" in str(error)  # noqa: PT017
        return
    assert list(found.variables) == list(given_.variables)


@given(
    st.binary(max_size=60) | st.text('1,;\n\r\t "#.e-aµ>:sN\u00a0\u2019', max_size=60).map(str.encode),
    st.booleans(),
    st.integers(1, 20),
)
def test_any_bytes_are_read_or_refused_in_a_sentence(tmp_path_factory, content, header, size):
    """And in blocks of any size alike."""
    path, outcomes = tmp_path_factory.mktemp("t") / "t.csv", []
    path.write_bytes(content)
    for how_much in (size, 1 << 22):
        try:
            contents = TextContents(path, TextTable(header=header), how_much)
            names = [name for name, each in contents.variables.items() if each.dtype.kind == "f"]
            outcomes.append(str(contents.read([], names)))
        except InputError as error:
            outcomes.append(str(error))
    assert outcomes[0] == outcomes[1]


@pytest.mark.parametrize("content", ["force\n1\n2.5\n", "force\n1\n\n2.5", "# force\n1\n2.5\n", "force,\n1,\n2.5,\n"])
def test_one_column_needs_no_delimiter(tmp_path, content):
    assert opened(tmp_path, content).read([], ["force"])[1].tolist() == [[1], [2.5]]


def test_a_name_needs_no_unit_as_long_as_it_is_unique(tmp_path):
    contents = opened(tmp_path, "force [N],t/ms,x (mm),x (V),ch [1]\n1,2,3,4,5\n")

    assert [each.unit for each in contents.variables.values()] == ["N", "ms", "mm", "V", ""]
    assert contents.read([], ["force", "t", "x (V)"])[1].tolist() == [[1, 2, 4]]
    with pytest.raises(InputError, match=r"x may be x \(mm\) or x \(V\)"):
        contents.named("x")
    with pytest.raises(InputError, match=r"no column forse; there is force \[N\]\."):
        contents.named("forse")


def test_missing_cells_are_nan(tmp_path):
    read = opened(tmp_path, "a,b\n1,\nNA,2\n nan , 3 \n").read([], ["a", "b"])[1]
    np.testing.assert_array_equal(read, [[1, np.nan], [np.nan, 2], [np.nan, 3]])


def test_columns_without_a_name_have_their_number(tmp_path):
    assert list(opened(tmp_path, ",a\n0,5\n").variables) == ["0", "a"]
    assert list(opened(tmp_path, "0,5\n", header=False).variables) == ["0", "1"]


def test_columns_of_one_name_are_told_apart_by_numbers(tmp_path):
    """The name alone stands for none of them."""
    contents = opened(tmp_path, "a,a [N],b,a [N],a,a.1\n1,2,3,4,5,6\n")

    assert list(contents.variables) == ["a.0", "a.0 [N]", "b", "a.1 [N]", "a.2", "a.1"]
    assert contents.read([], ["b", "a.2", "a.1", "a.1 [N]"])[1].tolist() == [[3, 5, 6, 4]]
    for name in ("a", "a [N]"):
        with pytest.raises(InputError, match=rf"column {re.escape(name)} is repeated; say which: a\.0"):
            contents.read([], [name])


def test_columns_of_one_name_are_taken_by_patterns_and_by_numbers(tmp_path):
    """Whether or not all lines end in a delimiter."""
    for end in ("", ","):
        for n in range(2):
            (tmp_path / f"{n}.csv").write_text(f"Time,Force,Force,x{end}\n0,1,2,7{end}\n1,3,{n},7{end}\n")
        for taxels in ("Force*", "1:3", ("Force.0", "Force.1")):
            how = TapMap(taxels=taxels, tap="file", time="Time")
            assert load_mapped(tmp_path, how).taps.taps.tolist() == [[[1, 2], [3, 0]], [[1, 2], [3, 1]]]


def test_rows_have_places(tmp_path):
    contents = opened(tmp_path, 'x,b\n# hm\n\n1,2\n"3",4 # c\n\n5,6\n', comment="#")
    assert [contents.place(row) for row in range(3)] == ["line 4", "line 5", "line 7"]


@pytest.mark.parametrize("size", [1, 1 << 22])
def test_blank_lines_of_one_column_are_no_rows(tmp_path, size):
    path = tmp_path / "t.csv"
    path.write_text("1\n \n\n2\n3")
    contents = TextContents(path, TextTable(header=False), size)
    assert [contents.place(row) for row in range(3)] == ["line 1", "line 4", "line 5"]


@pytest.mark.parametrize(
    ("content", "how", "message"),
    [
        ("", {}, "no lines"),
        ("a,b\n", {}, "no rows below the header"),
        ("a,b\n1,2\n", {"skip_rows": 5}, "5 skipped"),
        ("a,b\n1,2\n3,x\n", {"delimiter": ","}, "line 3, column b: 'x' is not a number."),
        ("a,b\n1,2\n3\n", {"delimiter": ","}, "line 3: 1 cell, but there are 2 columns, split at commas"),
        ("a,b\n1,2\n3,4,5\n", {"delimiter": ","}, "line 3: 3 cells"),
        ("a,b\n1,2\n3\n", {}, "--delimiter, or --skip-rows or --comment for lines before it (line 3: 1 cell"),
        ("Device 5, made by us\n\na;b\n1;2\n", {}, "--skip-rows"),
        ("a;b\n1,5;2\n", {}, "line 2, column a: '1,5' is not a number with decimal mark '.'; --decimal changes it."),
        ("a;b\n1.5;2\n", {"decimal": ","}, "'1.5' is not a number with decimal mark ','; --decimal"),
        ("1,2;3\n4,5;6\n", {"header": False}, ", and ; may be the delimiter; say which by --delimiter"),
        ("1,2\n3,4\n", {}, "--no-header"),
        ('a,b\n"1,2\n3,4\n', {}, "line 2: a quoted cell does not end"),
        ('a,b\n"1"x,2\n', {"delimiter": ","}, "line 2: "),
        ("a,b\n1,2\n", {"delimiter": "ab"}, "--delimiter"),
        ("a,b\n1,2\n", {"decimal": "x"}, "--decimal"),
        ("a,b\n1,2\n", {"delimiter": ",", "decimal": ","}, "--decimal"),
        (b"a,b\n1\x00,2\n", {}, "zero bytes"),
        ("a,b\n1,True\n", {}, "line 2, column b: 'True' is not a number"),
    ],
)
def test_what_is_wrong_is_said_with_its_place_and_the_option_that_helps(tmp_path, content, how, message):
    assert message in refused(tmp_path, content, (), ["a", "b"] if "b" in str(content) else ["0"], **how)


def test_a_mistake_deep_in_a_file_is_found(tmp_path):
    """In a later block, with its line."""
    rows = ["1.25,2.5,3.75"] * 700_000
    rows[650_000] = "1,2,3..5"
    content = "a,b,c\n" + "\n".join(rows)

    assert refused(tmp_path, content, (), "abc") == "line 650002, column c: '3..5' is not a number."
    rows[650_000] = "1,2"
    assert refused(tmp_path, "a,b,c\n" + "\n".join(rows), (), "abc").startswith("line 650002: 2 cells")
    content = ("a,b,c\n" + "\n".join(rows[:650_000])).encode() + b"\n1,2,\xff\n"
    assert refused(tmp_path, content, (), "abc") == "line 650002: not UTF-8 text."


def test_a_large_table_stays_on_disk(tmp_path, monkeypatch):
    """And memory holds little of it; without room for it, it is read into memory."""
    monkeypatch.setattr(storage, "ON_DISK", 1 << 20)
    numbers = np.arange(900_000.0).reshape(-1, 3)
    rows = "\n".join(f"{a:.0f},{b:.0f},{c:.0f}" for a, b, c in numbers)
    contents = opened(tmp_path, "a,b,c\n" + rows)
    contents.read([], "a")
    small = TextContents(contents.path, TextTable(), 1 << 16)
    tracemalloc.start()
    read = small.read([], "abc")[1]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()

    assert isinstance(read, np.memmap)
    assert peak < numbers.nbytes / 2
    np.testing.assert_array_equal(read, numbers)
    monkeypatch.setattr(storage, "spooled", lambda parts, *_: (next(iter(parts)), None)[1])
    np.testing.assert_array_equal(contents.read([], "abc")[1], numbers)


def test_signs_of_windows_are_read(tmp_path):
    """And bytes that Windows has no sign for as in Latin-1."""
    (tmp_path / "a.csv").write_bytes("a,b\n1,5 – 6 €\n".encode("cp1252"))
    (tmp_path / "b.csv").write_bytes(b"a,b\n1,\x81\xe4\n")
    read = [open_text(tmp_path / name, TextTable()).read(["b"])[0]["b"].tolist() for name in ("a.csv", "b.csv")]

    assert read == [["5 – 6 €"], ["\x81ä"]]


def test_points_and_blanks_between_thousands_are_told(tmp_path):
    message = refused(tmp_path, "a;b\n1,5;2\n-1.072;3\n", columns=["a", "b"], decimal=",", delimiter=";")
    assert message == "line 3, column a: '-1.072' is not a number; write thousands without points."
    message = refused(tmp_path, "a;b\n1.5;2\n1 072 000.5;3\n", columns=["a", "b"])
    assert message == "line 3, column a: '1 072 000.5' is not a number; write thousands without blanks."


@pytest.mark.parametrize(
    ("content", "delimiter"),
    [
        ("a -> b,c\n1 -> 2,3\n", ("->", ",")),
        ("a->b->c\n1->2->3\n", "->"),
        ("a;b,c\n1;2,3\n", (",", ";")),
        ("a::b\tc\n1::2 3\n", ("::", "blank")),
        ("a, b, c\n1, 2, 3\n", ", "),
    ],
)
def test_cells_are_divided_by_several_signs(tmp_path, content, delimiter):
    assert opened(tmp_path, content, delimiter=delimiter).read([], "abc")[1].tolist() == [[1, 2, 3]]


def test_signs_in_quotes_divide_no_cells(tmp_path):
    content = 'a->b\n1->"x->y"\n2->z\n'
    assert opened(tmp_path, content, delimiter="->").read(["b"])[0]["b"].tolist() == ["x->y", "z"]
    assert "line 3: 1 cell, but there are 2 columns, split at '->'." in refused(
        tmp_path, "a->b\n1->2\n3\n", (), "ab", delimiter="->"
    )
    assert "--decimal" in refused(tmp_path, "a,b\n1,2\n", delimiter=(";", ","), decimal=",")


@pytest.mark.parametrize("between", [",", ", ", "\t", " ", ";"])
def test_logs_of_a_serial_monitor_are_divided_at_the_arrow_too(tmp_path, between):
    """Arduino's writes the time before each line; a header of the sketch stands behind one as well."""
    rows = [f"14:02:11.{10 + n} -> {between.join(map(str, (n, 2 * n, -3)))}" for n in range(3)]
    contents = opened(tmp_path, "\r\n".join(rows), header=False)
    texts, read = contents.read(["0"], ["1", "2", "3"])

    assert texts["0"].tolist() == ["14:02:11.10", "14:02:11.11", "14:02:11.12"]
    assert read.tolist() == [[0, 0, -3], [1, 2, -3], [2, 4, -3]]
    assert "--no-header" in refused(tmp_path, "\n".join(rows))
    header = f"14:02:11.09 -> {between.join('abc')}"
    assert list(opened(tmp_path, "\n".join([header, *rows])).variables) == ["time", "a", "b", "c"]


@pytest.mark.parametrize("time", ["2022-05-01 14:02:11.250", "14:02:11", "2022-05-01T14:02:11+01:00", "01/05/22 2:02"])
def test_a_row_of_numbers_and_a_time_is_no_header(tmp_path, time):
    assert "--no-header" in refused(tmp_path, f"{time},494,491\n{time},500,499\n")
    assert list(opened(tmp_path, f"{time},a,491\n{time},500,499\n").variables) == [time, "a", "491"]


def test_a_row_of_units_is_below_the_header(tmp_path):
    """Whatever the decimal mark, with formats of times and dashes; and rows keep their places."""
    content = "Zeit;Kraft;Rate;n;Thing\nhh:mm:ss;[mN];m/s²;-;\n10:00:00;0,5;1;3;rod\n10:00:01;0,7;2;4;rod\n"
    contents = opened(tmp_path, content, decimal=",")

    assert [each.unit for each in contents.variables.values()] == ["", "mN", "m/s²", "", ""]
    assert contents.read(["Zeit"], ["Kraft", "Rate"])[1].tolist() == [[0.5, 1], [0.7, 2]]
    assert contents.place(0) == "line 3"


@pytest.mark.parametrize(
    "content",
    [
        "t,f\ns,N\nms,mN\n1,2\n",  # rows of texts
        "thing,f\nrod,N\nrod,5\nrod,7\n",  # the first value of f is N
        "t,f\n0,N\n1,5\n2,7\n",
        "t,f\ns,hot\n1,5\n2,7\n",
        "id\nF\n1\n2\n",
    ],
)
def test_other_texts_in_the_first_row_are_no_units(tmp_path, content):
    contents = opened(tmp_path, content)
    names = list(contents.variables)

    assert contents.read(names)[0][names[-1]].tolist() == [row.split(",")[-1] for row in content.split()[1:]]


def test_a_first_row_of_texts_is_refused_with_the_way_to_leave_it_out(tmp_path):
    content = "t,f\nsecs,newtons\n0.1,5\n"
    message = refused(tmp_path, content, columns=["t", "f"])
    assert "column t: 'secs' is not a number; if this line is no row of data, --skip-rows 2 --no-header" in message
    assert opened(tmp_path, content, skip_rows=2, header=False).read([], "01")[1].tolist() == [[0.1, 5]]


@pytest.mark.parametrize("sign", ["\u00a0", "\u2009", "\u202f", "'", "\u2019"])
@pytest.mark.parametrize("decimal", ",.")
def test_thousands_may_be_apart_by_signs_that_are_no_decimal_marks(tmp_path, sign, decimal):
    """In numbers, read as numbers and as texts; not in other texts, nor in numbers that are not written so."""
    content = f"a;b;c\n-1{sign}030{decimal}5;{sign.join(('12', '345', '678'))};Tim{sign}s\n2{decimal}5;3;1{sign}000 V\n"
    contents = opened(tmp_path, content, decimal=decimal)
    texts, read = contents.read(["c"], ["a", "b"])

    assert read.tolist() == [[-1030.5, 12345678], [2.5, 3]]
    assert contents.read(["a"])[0]["a"].tolist() == ["-1030.5", "2.5"]
    assert texts["c"].tolist() == [f"Tim{sign}s", f"1{sign}000 V"]
    for wrong in (f"1{sign}00", f"1000{sign}000", f"1{sign}000{sign}5"):
        assert "is not a number" in refused(tmp_path, f"a;b\n{wrong};2\n", columns=["a"], decimal=decimal)
