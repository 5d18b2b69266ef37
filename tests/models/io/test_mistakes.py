"""Mistakes in files are told by key, with what the key takes and what it has."""

from typing import Annotated, Literal

import msgspec
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.mistakes import convert, decode_json
from solidtouch.models.settings import wanted


class Part(msgspec.Struct, forbid_unknown_fields=True):
    length_mm: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0
    names: tuple[str, ...] = ()


class Whole(msgspec.Struct, forbid_unknown_fields=True):
    """Of every kind that files have."""

    number: Annotated[int, msgspec.Meta(ge=1)]
    order: Literal["up", "down", "none"] = "up"
    by: Annotated[str | list[str], wanted("a name or a list of names")] = ""
    kind: bool | None = None
    parts: Annotated[list[Part], msgspec.Meta(min_length=1)] | None = None


SENTENCES = {
    "missing key": ({}, "missing key `number`."),
    "unknown key": ({"number": 1, "more": 2}, "unknown key `more`."),
    "out of range": ({"number": 0}, "number: must be an integer from 1, got 0."),
    "wrong type": ({"number": "a"}, "number: must be an integer from 1, got 'a'."),
    "choice": ({"number": 1, "order": "left"}, "order: must be down, none or up, got 'left'."),
    "described": ({"number": 1, "by": 3}, "by: must be a name or a list of names, got 3."),
    "may be null": ({"number": 1, "kind": 3}, "kind: must be true or false, got 3."),
    "no table": ({"number": 1, "parts": [2]}, "parts[0]: must be a table of keys and values, got 2."),
    "short list": ({"number": 1, "parts": []}, "parts: must be a list of length 1 or more, got []."),
    "in a list": (
        {"number": 1, "parts": [{}, {"length_mm": 11}]},
        "parts[1].length_mm: must be a number above 0 to 10, got 11.",
    ),
    "below that": ({"number": 1, "parts": [{"names": ["a", 4]}]}, "parts[0].names[1]: must be a text, got 4."),
    "key of a part": ({"number": 1, "parts": [{"width": 1}]}, "parts[0]: unknown key `width`."),
    "not a table": ([1], "must be a table of keys and values, got [1]."),
}


@pytest.mark.parametrize(("values", "sentence"), SENTENCES.values(), ids=SENTENCES)
def test_mistakes_are_told_by_key(values, sentence):
    for read in (lambda: convert(values, Whole), lambda: decode_json(msgspec.json.encode(values), Whole)):
        with pytest.raises(InputError) as refused:
            read()
        assert str(refused.value) == sentence


@pytest.mark.parametrize("content", [b"", b'{"number": 1', b"number = 1", b"\xff\xfe", b"[" * 100_000])
def test_what_is_not_json_is_called_so(content):
    with pytest.raises(InputError, match=r"^not JSON, or cut short\.$"):
        decode_json(content, Whole)


def test_long_values_are_shortened():
    with pytest.raises(InputError) as refused:
        convert({"number": "a" * 100_000}, Whole)
    assert len(str(refused.value)) < 500


def test_a_right_file_is_a_record():
    assert decode_json(b'{"number": 2, "parts": [{"names": ["a"]}]}', Whole) == Whole(2, parts=[Part(names=("a",))])
