"""TOML files of settings: read, checked for what no settings file needs, and converted to a record."""

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import msgspec.inspect
from msgspec import Struct

from ..errors import InputError

_MOST_BYTES = 1 << 16
_MOST_PARTS = 32  # `tomllib` takes time and memory with the square of their number
_MOST_SHOWN = 200
_KEYS = re.compile(r"[^.\[\]]+")
_LONG_KEY = re.compile(
    rf"""(?:(?:(?<![\w-])[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{_MOST_PARTS}}}"""
)


def read_settings(path: str | Path) -> str:
    """Text of a settings file.

    Raises:
        InputError: The file is missing, larger than 64 KiB or not UTF-8 text.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise InputError(f"{path}: larger than {_MOST_BYTES >> 10} KiB, the most that a settings file may be.")
        return content.decode("utf-8").replace("\r\n", "\n")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot read: {getattr(error, 'strerror', None) or 'not UTF-8'}.") from error


def parse_settings[T: Struct](text: str, kind: type[T]) -> T:
    """Settings read from TOML text, with all keys and types checked.

    Raises:
        InputError: The text is not TOML, a key is unknown, missing, of the wrong type or has more than 32 parts, an
            integer is beyond 64 bits, or arrays are nested hundreds of levels deep.
    """
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise InputError(f"line {line}: a dotted key has more than {_MOST_PARTS} parts.")
    values: Any = None
    try:
        values = tomllib.loads(text)
        msgspec.msgpack.encode(values)  # refuses integers beyond 64 bits, as TOML has none
        return msgspec.convert(values, kind)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {_short(str(error))}.") from error
    except msgspec.ValidationError as error:
        raise InputError(_in_words(str(error), values, kind)) from error
    except RecursionError as error:
        raise InputError("arrays or tables are nested too deeply.") from error
    except (OverflowError, ValueError) as error:  # `int` raises the second beyond some 4,000 digits
        raise InputError("an integer is beyond 64 bits.") from error


def _in_words(message: str, values: Any, kind: type[Struct]) -> str:
    """Message `Expected `float` - at `$.tap.depth_mm`` as a sentence that starts with the key."""
    what, _, where = message.partition(" - at ")
    path = where.strip("`").removeprefix("$").removeprefix(".")
    allowed = _range(msgspec.inspect.type_info(kind), _KEYS.findall(path), values)
    if allowed and re.match(r"Expected `(int|float)` [<>]", what):
        return f"{_short(path)}: {allowed}."
    what = what.replace("Object contains unknown field", "unknown key").replace(
        "Object missing required field", "missing key"
    )
    what = _short(what[0].lower() + what[1:])
    return f"{_short(path)}: {what}." if path else f"{what}."


def _range(kind: Any, path: Sequence[str], value: Any) -> str:
    """What numbers a place in a record may hold and what it holds; empty where there is no such place."""
    if isinstance(kind, msgspec.inspect.UnionType):
        return next(filter(None, (_range(each, path, value) for each in kind.types)), "")
    if not path:
        words = {"ge": "from", "gt": "above", "le": "to"}
        bounds = [(word, getattr(kind, name, None)) for name, word in words.items()]
        allowed = " ".join(f"{word} {bound:,}" for word, bound in bounds if bound is not None)
        return allowed and f"must be {allowed}, got {value}"
    key, *others = path
    if isinstance(kind, msgspec.inspect.ListType) and isinstance(value, list):
        return _range(kind.item_type, others, value[int(key)])
    fields = {field.encode_name: field.type for field in getattr(kind, "fields", ())}
    return _range(fields[key], others, value[key]) if key in fields and key in value else ""


def _short(text: str) -> str:
    return text if len(text) <= _MOST_SHOWN else f"{text[:_MOST_SHOWN]}..."
