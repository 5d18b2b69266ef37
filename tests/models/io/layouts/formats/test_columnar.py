"""Parquet, Arrow and Feather files hold what text and JSON hold."""

import datetime as dt
import decimal
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyarrow import feather
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats import columnar
from solidtouch.models.io.layouts.formats.columnar import open_columnar
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.json_lines import open_json
from solidtouch.models.io.layouts.formats.text import open_text

DAY = dt.datetime(2026, 1, 1)  # noqa: DTZ001 - as files without a time zone hold it
TABLE = pa.table(
    {
        "i": pa.array([1, 2, None]),
        "k": pa.array([1, 2, 3], "int32"),
        "what": ["a", "b", "c"],
        "d": pa.array(["x", "y", "x"]).dictionary_encode(),
        "l": [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]],
        "r": [[1.0, 2.0], [3.0], []],
        "n": [[[1, 2], [3, 4]], [[5, 6]], []],
        "fixed": pa.array([[1, 2], [3, 4], [5, 6]], pa.list_(pa.float32(), 2)),
        "st": [{"x": 1.0, "y": "u"}, {"x": 2.0, "y": "v"}, {"x": None, "y": "w"}],
        "ls": [[{"x": 1}, {"x": 2}], [{"x": 3}, {"x": 4}], [{"x": 5}, {"x": 6}]],
        "t": pa.array([DAY, None, DAY + dt.timedelta(milliseconds=1500)], pa.timestamp("ms")),
        "day": [DAY.date()] * 3,
        "dec": pa.array([decimal.Decimal("1.5")] * 3),
        "b": pa.array([True, False, None]),
        "none": pa.nulls(3),
        "bytes": [b"x"] * 3,
        "force [N]": [1.0, 2.0, 3.0],
    }
)


def stream(table, path):
    with pa.ipc.new_stream(path, table.schema) as writer:
        writer.write_table(table)


WRITERS = {"t.parquet": pq.write_table, "t.feather": feather.write_feather, "t.arrows": stream}


def saved(folder, name, table=TABLE, **how):
    path = folder / name
    WRITERS[name](table, str(path), **how)
    return path


@pytest.mark.parametrize("name", WRITERS)
def test_columns_of_any_type_are_numbers_texts_or_elements(tmp_path, name):
    contents = open_columnar(saved(tmp_path, name), TextTable())
    found, numbers = contents.read(["k", "what", "d", "l", "r", "n", "fixed", "st.y", "ls.x", "day"], ["force", "i"])

    assert contents.unreadable == {"bytes": "values of type binary"}
    assert [contents.variables[each].unit for each in ("t", "force [N]", "k")] == ["s", "N", ""]
    assert [contents.variables[each].shape[1:] for each in ("i", "n", "fixed")] == [(), (None, None), (2,)]
    assert {each: found[each].tolist() for each in ("k", "what", "d", "l", "st.y", "day")} == {
        "k": [1, 2, 3],
        "what": ["a", "b", "c"],
        "d": ["x", "y", "x"],
        "l": [[1, 2], [3, 4], [5, 6]],
        "st.y": ["u", "v", "w"],
        "day": ["2026-01-01"] * 3,
    }
    assert found["k"].dtype == np.int32
    assert found["fixed"].tolist() == found["l"].tolist()
    assert found["ls.x"].tolist() == [[1, 2], [3, 4], [5, 6]]
    assert [each.tolist() for each in found["r"]] == [[1, 2], [3], []]
    assert [each.tolist() for each in found["n"]] == [[[1, 2], [3, 4]], [[5, 6]], []]
    np.testing.assert_array_equal(numbers, [[1, 1], [2, 2], [3, np.nan]])
    begin = DAY.replace(tzinfo=dt.UTC).timestamp()
    np.testing.assert_array_equal(
        contents.read([], ["st.x", "t", "dec", "b", "none"])[1],
        [[1, begin, 1.5, 1, np.nan], [2, np.nan, 1.5, 0, np.nan], [np.nan, begin + 1.5, 1.5, np.nan, np.nan]],
    )


def test_a_table_is_the_same_in_every_format(tmp_path):
    rng = np.random.default_rng(1)
    rows = [
        {
            "force [N]": float(rng.normal(0, 1e3) if i % 3 else rng.integers(9)),
            "what": "abc"[rng.integers(3)],
            "t": float(i),
        }
        for i in range(500)
    ]
    text, lines = tmp_path / "t.csv", tmp_path / "t.jsonl"
    text.write_text("force [N],what,t\n" + "".join(f"{','.join(map(str, row.values()))}\n" for row in rows))
    lines.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    every = [open_text(text, TextTable()), open_json(lines, TextTable())]
    every += [open_columnar(saved(tmp_path, name, pa.Table.from_pylist(rows)), TextTable()) for name in WRITERS]

    for contents in every:
        found, numbers = contents.read(["what"], ["t", "force [N]"])

        assert list(contents.variables) == ["force [N]", "what", "t"]
        assert contents.table
        assert found["what"].tolist() == [row["what"] for row in rows]
        assert numbers.tolist() == [[row["t"], row["force [N]"]] for row in rows]


@pytest.mark.parametrize("name", WRITERS)
def test_the_size_of_blocks_does_not_matter(tmp_path, monkeypatch, name):
    whole = open_columnar(saved(tmp_path, name), TextTable()).read(["r", "n", "what"], ["k"])
    monkeypatch.setattr(columnar, "BLOCK", 1)
    parts = open_columnar(tmp_path / name, TextTable()).read(["r", "n", "what"], ["k"])

    assert str(parts) == str(whole)


@pytest.mark.parametrize("name", WRITERS)
def test_damaged_files_end_in_a_sentence(tmp_path, name):
    content, rng = saved(tmp_path, name, TABLE.drop_columns(["bytes"])).read_bytes(), np.random.default_rng(2)
    path = tmp_path / "damaged"
    for _ in range(20):
        damaged = bytearray(content)
        for place in rng.integers(len(damaged), size=rng.integers(1, 5)):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged[: len(damaged) if rng.integers(2) else rng.integers(len(damaged))])
        try:
            contents = open_columnar(path, TextTable())
            contents.read(list(contents.variables))
        except InputError as error:
            assert str(error).endswith(".")  # noqa: PT017


def test_missing_texts_and_lists_and_uneven_inner_lists_have_a_place(tmp_path):
    table = pa.table(
        {"what": ["a", None], "l": [[1], None], "n": [[[1], [2]], [[1], [2, 3]]], "m": [["a"], ["b", None]]}
    )
    contents = open_columnar(saved(tmp_path, "t.parquet", table), TextTable())
    for name, why in (
        ("what", "missing"),
        ("l", "missing"),
        ("n", "its inner lists differ in length"),
        ("m", "missing"),
    ):
        with pytest.raises(InputError, match=f"row 2, column {name}: {why}"):
            contents.read([name])
    with pytest.raises(InputError, match="column l does not hold one number in each row"):
        contents.read([], ["l"])


def test_what_is_missing_is_said(tmp_path, monkeypatch):
    path = saved(tmp_path, "t.parquet")
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'solidtouch\[formats\]'"):
        open_columnar(path, TextTable())
