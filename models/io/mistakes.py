"""What is wrong with a settings file or a JSON file of a known form, in words that start with the key."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import msgspec.inspect
from msgspec import Struct

from ..errors import InputError

_MOST_SHOWN = 200
_KEYS = re.compile(r"\[\.\.\.\]|[^.\[\]]+")
_NAMES = (
    (msgspec.inspect.BoolType, "true or false"),
    (msgspec.inspect.IntType, "an integer"),
    (msgspec.inspect.FloatType, "a number"),
    (msgspec.inspect.StrType, "a text"),
    (msgspec.inspect.ListType | msgspec.inspect.VarTupleType, "a list"),
    (msgspec.inspect.StructType, "a table of keys and values"),
)
_BOUNDS = {
    "ge": "from {:,}",
    "gt": "above {:,}",
    "le": "to {:,}",
    "lt": "below {:,}",
    "min_length": "of length {:,} or more",
    "max_length": "of length {:,} or less",
}


def convert[T: Struct](values: Any, kind: type[T]) -> T:
    """A record from what a file holds.

    Raises:
        InputError: A key is unknown or missing, or a value is not what its key takes.
    """
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise InputError(_in_words(str(error), values, kind)) from error


def decode_json[T: Struct](content: bytes, kind: type[T]) -> T:
    """A record from JSON.

    Raises:
        InputError: It is not JSON, or as by `convert`.
    """
    try:
        try:
            return msgspec.json.decode(content, type=kind)
        except msgspec.ValidationError:
            return convert(msgspec.json.decode(content), kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError("not JSON, or cut short.") from error


def _in_words(message: str, values: Any, kind: type[Struct]) -> str:
    """Message `Expected `float` - at `$.tap.depth_mm`` as a sentence that starts with the key."""
    what, _, where = message.partition(" - at ")
    path = where.strip("`").removeprefix("$").removeprefix(".")
    what = what.replace("Object contains unknown field", "unknown key")
    what = what.replace("Object missing required field", "missing key")
    if not what.startswith(("unknown", "missing")):
        for place, value in _places(msgspec.inspect.type_info(kind), _KEYS.findall(path), values):
            if allowed := _allowed(place):
                what = f"must be {allowed}, got {shortened(repr(value))}"
                break
    said = shortened(what[0].lower() + what[1:])
    return f"{shortened(path)}: {said}." if path else f"{said}."


def _places(kind: Any, path: Sequence[str], value: Any) -> Iterator[tuple[Any, Any]]:
    """The types that a place in a record may have, with what it holds."""
    if isinstance(kind, msgspec.inspect.Metadata) and path:
        yield from _places(kind.type, path, value)
    elif isinstance(kind, msgspec.inspect.UnionType) and path:
        for each in kind.types:
            yield from _places(each, path, value)
    elif not path:
        yield kind, value
    elif hasattr(kind, "item_type") and isinstance(value, list):
        yield from _places(kind.item_type, path[1:], value[int(path[0])])
    elif isinstance(value, dict):
        fields = {field.encode_name: field.type for field in getattr(kind, "fields", ())}
        if path[0] in fields and path[0] in value:
            yield from _places(fields[path[0]], path[1:], value[path[0]])


def _allowed(kind: Any) -> str:
    """What a type takes; empty where no words are known."""
    if isinstance(kind, msgspec.inspect.Metadata):
        return (kind.extra or {}).get("wanted") or _allowed(kind.type)
    if isinstance(kind, msgspec.inspect.UnionType):
        return " or ".join(dict.fromkeys(filter(None, map(_allowed, kind.types))))
    if isinstance(kind, msgspec.inspect.LiteralType):
        return ", ".join(map(str, kind.values[:-1])) + " or " * (len(kind.values) > 1) + str(kind.values[-1])
    name = next((name for known, name in _NAMES if isinstance(kind, known)), "")
    bounds = [word.format(getattr(kind, of)) for of, word in _BOUNDS.items() if getattr(kind, of, None) is not None]
    return " ".join([name, *bounds])


def shortened(text: str) -> str:
    """A text, or its beginning."""
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."
