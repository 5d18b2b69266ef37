"""Mistakes in files are told by key, with what the key takes and what it has."""

import datetime as dt
from typing import Annotated, Literal

import msgspec
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.mistakes import convert, decode_json
from solidtouch.models.settings import Checked, SettingError, wanted


class Part(msgspec.Struct, forbid_unknown_fields=True):
    length_mm: Annotated[float, msgspec.Meta(gt=0, le=10)] = 1.0
    names: tuple[str, ...] = ()


class Near(msgspec.Struct, tag_field="kind", tag="near"):
    reach: Annotated[int, msgspec.Meta(le=9)] = 0


class Far(msgspec.Struct, tag_field="kind", tag="far"):
    reach: Annotated[float, msgspec.Meta(ge=100, lt=1000)] = 100


class Own(Checked, frozen=True, kw_only=True):
    """Refuses a value itself."""

    factor: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.factor:
            raise SettingError("factor", "must not be 0.")


class Whole(msgspec.Struct, forbid_unknown_fields=True):
    """Of every kind that files have."""

    number: Annotated[int, msgspec.Meta(ge=1)]
    order: Literal["up", "down", "none"] = "up"
    by: Annotated[str | list[str], wanted("a name or a list of names")] = ""
    kind: bool | None = None
    parts: Annotated[list[Part], msgspec.Meta(min_length=1)] | None = None
    finger: Near | Far | None = None
    places: list[tuple[float, float]] = []
    words: dict[str, str] = {}
    few: Annotated[list[int], msgspec.Meta(min_length=1, max_length=2)] | None = None
    own: Own | None = None


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
        "parts[1].length_mm: must be a number above 0 and at most 10, got 11.",
    ),
    "below that": ({"number": 1, "parts": [{"names": ["a", 4]}]}, "parts[0].names[1]: must be a text, got 4."),
    "key of a part": ({"number": 1, "parts": [{"width": 1}]}, "parts[0]: unknown key `width`."),
    "other of two tables": (
        {"number": 1, "finger": {"kind": "far", "reach": 5}},
        "finger.reach: must be a number from 100 and below 1,000, got 5.",
    ),
    "one of two tables": (
        {"number": 1, "finger": {"kind": "near", "reach": "a"}},
        "finger.reach: must be an integer of at most 9, got 'a'.",
    ),
    "no such table": ({"number": 1, "finger": {"kind": "up"}}, "finger.kind: must be near or far, got 'up'."),
    "no name of a table": ({"number": 1, "finger": {"kind": 3}}, "finger.kind: must be near or far, got 3."),
    "no pair": ({"number": 1, "places": [[1]]}, "places[0]: must be a list of length 2, got [1]."),
    "in a pair": ({"number": 1, "places": [[1, "a"]]}, "places[0][1]: must be a number, got 'a'."),
    "in a dictionary": (
        {"number": 1, "words": {"a": 1}},
        "words: must be a table with a text for each key, got {'a': 1}.",
    ),
    "no dictionary": ({"number": 1, "words": 1}, "words: must be a table with a text for each key, got 1."),
    "long list": ({"number": 1, "few": [1, 2, 3]}, "few: must be a list of length 1 to 2, got [1, 2, 3]."),
    "what a record refuses": ({"number": 1, "own": {"factor": 0}}, "factor must not be 0."),
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


def test_half_a_character_is_refused():
    with pytest.raises(InputError, match="half a surrogate pair"):
        convert({"number": 1, "order": "\ud800"}, Whole)


def test_days_are_told_as_in_the_file():
    with pytest.raises(InputError, match=r"^by: must be a name or a list of names, got 1979-05-27\.$"):
        convert({"number": 1, "by": dt.date(1979, 5, 27)}, Whole)


def test_a_right_file_is_a_record():
    assert decode_json(b'{"number": 2, "parts": [{"names": ["a"]}]}', Whole) == Whole(2, parts=[Part(names=("a",))])
