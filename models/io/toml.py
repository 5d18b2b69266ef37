"""TOML files of settings: read, checked for what no settings file needs, and converted to a record."""

import re
import tomllib
from pathlib import Path

import msgspec
from msgspec import Struct

from ..errors import InputError
from .mistakes import convert, shortened

_MOST_BYTES = 1 << 16
_MOST_PARTS = 32  # `tomllib` takes time and memory with the square of their number
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
    try:
        values = tomllib.loads(text)
        msgspec.msgpack.encode(values)  # refuses integers beyond 64 bits, as TOML has none
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not TOML: {shortened(str(error))}.") from error
    except RecursionError as error:
        raise InputError("arrays or tables are nested too deeply.") from error
    except (OverflowError, ValueError) as error:  # `int` raises the second beyond some 4,000 digits
        raise InputError("an integer is beyond 64 bits.") from error
    return convert(values, kind)
