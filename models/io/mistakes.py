"""What is wrong with a settings file or a JSON file of a known form, in words that start with the key."""

import re
from collections.abc import Iterable, Iterator, Sequence
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


def convert[T: Struct](values: Any, kind: type[T]) -> T:
    """A record from what a file holds.

    Raises:
        InputError: A key is unknown or missing, or a value is not what its key takes.
    """
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        own = error.__cause__  # what a record says of its values itself
        raise InputError(str(own) if isinstance(own, InputError) else _in_words(str(error), values, kind)) from error
    except UnicodeEncodeError as error:
        raise InputError("a text has half a surrogate pair, which is no character.") from error


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
        places = [*_places(msgspec.inspect.type_info(kind), _KEYS.findall(path), values)]
        if allowed := _joined(place for place, _ in places):
            what, path = f"must be {allowed}, got {shortened(_shown(places[0][1]))}", path.removesuffix("[...]")
    said = shortened(what[0].lower() + what[1:])
    return f"{shortened(path)}: {said}." if path else f"{said}."


def _places(kind: Any, path: Sequence[str], value: Any) -> Iterator[tuple[Any, Any]]:
    """The types that a place in a record may have, with what it holds; of a wrong entry of a dictionary that of all."""
    if not path or isinstance(kind, msgspec.inspect.DictType):
        yield kind, value
    elif isinstance(kind, msgspec.inspect.Metadata):
        yield from _places(kind.type, path, value)
    elif isinstance(kind, msgspec.inspect.UnionType):
        for each in kind.types:
            yield from _places(each, path, value)
    elif isinstance(kind, msgspec.inspect.StructType) and isinstance(value, dict) and path[0] in value:
        key, *others = path
        fields = {field.encode_name: field.type for field in kind.fields}
        if key == kind.tag_field:
            yield msgspec.inspect.LiteralType((kind.tag,)), value[key]
        elif key in fields and (kind.tag_field is None or value.get(kind.tag_field) == kind.tag):
            yield from _places(fields[key], others, value[key])
    elif isinstance(value, list) and path[0].isdigit():
        index = int(path[0])
        pair = isinstance(kind, msgspec.inspect.TupleType)
        yield from _places(kind.item_types[index] if pair else getattr(kind, "item_type", None), path[1:], value[index])


def _allowed(kind: Any) -> str:
    """What a type takes; empty where no words are known."""
    if isinstance(kind, msgspec.inspect.Metadata):
        return (kind.extra or {}).get("wanted") or _allowed(kind.type)
    if isinstance(kind, msgspec.inspect.UnionType):
        return _joined(kind.types)
    if isinstance(kind, msgspec.inspect.LiteralType):
        return ", ".join(map(str, kind.values[:-1])) + " or " * (len(kind.values) > 1) + str(kind.values[-1])
    if isinstance(kind, msgspec.inspect.TupleType):
        return f"a list of length {len(kind.item_types)}"
    if isinstance(kind, msgspec.inspect.DictType):
        return f"a table with {_allowed(kind.value_type)} for each key"
    name = next((name for known, name in _NAMES if isinstance(kind, known)), "")
    return " ".join(filter(None, [name, _bounds(kind), _lengths(kind)]))


def _joined(kinds: Iterable[Any]) -> str:
    return " or ".join(dict.fromkeys(filter(None, map(_allowed, kinds))))


def _bounds(kind: Any) -> str:
    """Limits of a number."""
    least, above, most, below = (getattr(kind, name, None) for name in ("ge", "gt", "le", "lt"))
    if least is not None and most is not None:
        return f"from {least:,} to {most:,}"
    at_most = "at most {:,}" if above is not None else "of at most {:,}"
    words = {"from {:,}": least, "above {:,}": above, at_most: most, "below {:,}": below}
    return " and ".join(word.format(limit) for word, limit in words.items() if limit is not None)


def _lengths(kind: Any) -> str:
    """Limits of the length of a text or list."""
    least, most = getattr(kind, "min_length", None), getattr(kind, "max_length", None)
    if least is None or most is None:
        return "" if least is most else f"of length {most} or less" if least is None else f"of length {least} or more"
    return f"of length {least} to {most}"


def _shown(value: Any) -> str:
    return str(value) if hasattr(value, "isoformat") else repr(value)


def shortened(text: str) -> str:
    """A text, or its beginning."""
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."
