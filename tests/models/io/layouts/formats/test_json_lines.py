"""Rows as JSON, in lines and in documents."""

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats import json_lines
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.json_lines import JsonLines, closed, open_json


def opened(folder, content, name="t.jsonl"):
    path = folder / name
    path.write_text(content)
    return open_json(path, TextTable())


def test_keys_are_columns_and_lists_are_elements(tmp_path):
    """Nested objects are joined by dots, and so are objects in lists."""
    rows = [
        {
            "a": 1,
            "b": {"c": 2.5, "d": "x"},
            "v": [1, 2],
            "p": [{"x": 1}, {"x": 2}],
            "m": [[1, 2], [3, None]],
            "w": ["u"],
        },
        {
            "a": None,
            "b": {"c": 3, "d": "y"},
            "v": [3, 4],
            "p": [{"x": 3}],
            "m": [[5, 6], [7, 8]],
            "w": ["v"],
            "late": 5,
        },
    ]
    contents = opened(tmp_path, "\n\n".join(map(json.dumps, rows)))
    found, numbers = contents.read(["b.d", "v", "p.x", "m", "w"], ["b.c", "a", "late"])

    assert list(contents.variables) == ["a", "b.c", "b.d", "v", "p.x", "m", "w", "late"]
    assert [contents.variables[name].shape for name in ("a", "v", "p.x")] == [(None,), (None, 2), (None, None)]
    assert found["b.d"].tolist() == ["x", "y"]
    assert found["v"].tolist() == [[1, 2], [3, 4]]
    assert [each.tolist() for each in found["p.x"]] == [[1, 2], [3]]
    np.testing.assert_array_equal(found["m"], [[[1, 2], [3, np.nan]], [[5, 6], [7, 8]]])
    assert found["w"].tolist() == [["u"], ["v"]]
    np.testing.assert_array_equal(numbers, [[2.5, 1, np.nan], [3, np.nan, 5]])
    assert contents.place(1) == "line 3"


@pytest.mark.parametrize(
    "content",
    ['[{"a":1,"b":"x"},{"a":2,"b":"y"}]', '{"a":[1,2],"b":["x","y"],"rate":10}', '{"a":1,"b":"x"}\n{"a":2,"b":"y"}'],
)
def test_a_document_is_a_list_of_objects_an_object_of_lists_or_lines(tmp_path, content):
    contents = opened(tmp_path, content, "t.json")
    found, numbers = contents.read(["b"], ["a"])

    assert found["b"].tolist() == ["x", "y"]
    assert numbers.tolist() == [[1], [2]]
    assert contents.attributes == ({"rate": 10} if "rate" in content else {})


ROWS = st.lists(
    st.fixed_dictionaries(
        {
            "n": st.floats() | st.integers(-(2**50), 2**50),
            "t": st.text(max_size=5),
            "l": st.lists(st.floats(), max_size=3),
        }
    ),
    min_size=1,
    max_size=8,
)


@given(ROWS, st.integers(1, 100))
def test_rows_are_read_back_as_they_were_written(tmp_path_factory, rows, size):
    """In blocks of any size; also the NaN that Python writes."""
    path = tmp_path_factory.mktemp("t") / "t.jsonl"
    path.write_text("\n".join(map(json.dumps, rows)))
    for contents in (open_json(path, TextTable()), JsonLines(path, size)):
        found, numbers = contents.read(["t", "l"], ["n"])

        np.testing.assert_array_equal(numbers[:, 0], [row["n"] for row in rows])
        assert [text.rstrip("\0") for text in found["t"]] == [row["t"].rstrip("\0") for row in rows]
        for read, row in zip(found["l"], rows, strict=True):
            np.testing.assert_array_equal(read, row["l"])


@given(ROWS, st.booleans(), st.data())
def test_the_begin_of_a_document_holds_the_first_of_its_rows(rows, by_row, data):
    """Wherever it ends; of an object of lists the last one may be shorter than the others."""
    whole = rows if by_row else {"rate": 3, **{key: [row[key] for row in rows] for key in ("t", "n", "l")}}
    text = json.dumps(whole, indent=data.draw(st.sampled_from([None, 1]))).encode()
    begin = closed(text[: data.draw(st.integers(1, len(text)))])
    found = json.loads(begin) if begin else []

    if by_row:
        assert json.dumps(found) == json.dumps(rows[: len(found)])
    elif found:
        assert json.dumps(list(found.items())[:-1]) == json.dumps(list(whole.items())[: len(found) - 1])
        last = list(found)[-1]
        assert last == "rate" or json.dumps(found[last]) == json.dumps(whole[last][: len(found[last])])


@pytest.mark.parametrize("end", ["a, [b", 'a, \\"b', "a, \\", "a"])
def test_a_text_that_breaks_off_hides_its_signs(end):
    assert closed(f'{{"t": ["x", "{end}'.encode()) == b'{"t": ["x"]}'


@pytest.mark.parametrize("by_row", [True, False])
def test_only_the_begin_of_a_large_document_is_read_to_look_at_it(by_row, tmp_path, monkeypatch):
    monkeypatch.setattr(json_lines, "BLOCK", 1000)
    rows = [{"n": n, "t": "],{"} for n in range(200)]
    whole = rows if by_row else {"rate": 3, "n": list(range(200)), "t": ["x"] * 200}
    path = tmp_path / "t.json"
    path.write_text(json.dumps(whole))
    contents = open_json(path, TextTable(), 4)
    numbers = contents.read([], ["n"])[1][:, 0].tolist()

    assert numbers == list(range(len(numbers)))
    assert len(numbers) < 200
    assert contents.unreadable == {"the rest of the file": "its first 1 kB tell what there is"}
    assert len(open_json(path, TextTable()).read([], ["n"])[1]) == 200


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no objects with keys"),
        ('{"a":1}\n\n{"a":2\n', "line 3: not JSON: Expecting"),
        ('{"a":1}\n[3]\n', "line 2: not an object with keys"),
        ('{"a":"u"}\n{"b":1}\n', "line 2, a: missing"),
        ('{"a":[1]}\n{}\n', "line 2, a: missing"),
        ('{"a":[[1,2],[3]]}\n', "line 1, a: its inner lists differ in length"),
        ('{"a":[1]}\n{"a":1}\n', "line 2, a: 1 is not a list, as others are"),
        ('{"a":"u"}\n{"a":1}\n', "line 2, a: 1 is not a text, as others are"),
        ('{"a":["u",1]}\n', "line 1, a: 'u' is not a number"),
        ("[" * 100_000, "line 1: not JSON"),
    ],
)
def test_what_is_wrong_is_said_with_its_line(tmp_path, content, message):
    with pytest.raises(InputError, match=re.escape(message)):
        opened(tmp_path, content).read(["a"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"a":[1,2],"b":[1]}', "the list a has 2 items, but b has 1"),
        ("3", "neither a list of objects nor an object of lists"),
        ('[{"a":1},\n{"a":}]', "line 2: not JSON: Expecting value at character 6"),
    ],
)
def test_what_is_wrong_with_a_document_is_said(tmp_path, content, message):
    with pytest.raises(InputError, match=re.escape(message)):
        opened(tmp_path, content, "t.json")


@given(
    st.binary(max_size=50) | st.text('{}[]":,\n1ae.', max_size=50).map(str.encode),
    st.sampled_from(("t.json", "t.jsonl")),
)
def test_any_bytes_are_read_or_refused_in_a_sentence(tmp_path_factory, content, name):
    path = tmp_path_factory.mktemp("t") / name
    path.write_bytes(content)
    try:
        contents = open_json(path, TextTable())
        contents.read(list(contents.variables))
    except InputError as error:
        assert str(error).endswith(".")  # noqa: PT017
