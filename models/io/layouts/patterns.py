"""Patterns of names with fields, such as `{session}/{what}_{where}mm_*.csv`."""

import re
from functools import cache
from re import Pattern

from ...errors import InputError

_PIECE = re.compile(r"\{(\w*)\}|(\*\*/|\*\*)|(\*)|(\?)|([^*?{}]+)|(.)")
_DIGITS = r"[-+\u2212]?\d+(?:[.,]\d+)?[^\W\d_]*"
_NUMBER = rf"[^\W\d_]*{_DIGITS}"
"""A number with letters around it, as of a unit."""
_UNCLEAR_BETWEEN = {("text", "text"), ("text", "*"), ("*", "text"), ("number", "number"), ("number", "text")}
NUMBERS = ("where", "trial", "x", "y", "angle")
"""Fields that are numbers."""
FIELDS = ("what", "session", "taxel", *NUMBERS)
_IN_TEXT = re.compile(r"((?:(?<![^\W_])[-+])?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?) ?(°|[^\W\d_]*)")
_SIGNS = str.maketrans("\u2212\u03bc", "-\u00b5")  # a minus, and the Greek letter that is written for micro
_IN_THOUSANDS = re.compile(r"(?<![\d.,])[1-9]\d{0,2}(?:(?:,\d{3}){2,}(?![\d,])|,\d{3}(?=\.\d))")
_UNCLEAR = re.compile(r"(?<![\d.,])[1-9]\d{0,2},\d{3}(?!\d|[.,]\d)")
_TEMPLATE = re.compile(r"\{(\w+)\}")


@cache
def compiled_pattern(pattern: str, key: str, fields: tuple[str, ...] = FIELDS) -> Pattern[str]:
    """Regular expression of a pattern.

    `*` and `?` stand for any characters and for one, but no `/`; `**` for any folders; a field for at least one
    character without `/`, as few as possible, and where it is a number for one, with letters before and after it, or
    after it alone if a text is before it. A field that occurs again stands for the same text.

    Args:
        pattern: The pattern.
        key: Key of the map, for messages.
        fields: Those that it may have.

    Raises:
        InputError: A field is unknown, a bracket is not closed, or nothing tells where a field ends.
    """
    parts, seen, before = [], set(), ""
    for name, folders, any_, one, plain, other in _PIECE.findall(pattern):
        own = ""
        if plain:
            parts.append(re.escape(plain))
        elif folders:
            parts.append("(?:.*/)?" if folders.endswith("/") else ".*")
        elif any_ or one:
            own = any_
            parts.append("[^/]*?" if any_ else "[^/]")
        elif name in seen:
            parts.append(f"(?P={name})")
        elif name in fields:
            seen.add(name)
            own = "number" if name in NUMBERS else "text"
            number = _DIGITS if before == "text" else _NUMBER
            parts.append(f"(?P<{name}>{number if name in NUMBERS else '[^/]+?'})")
        elif other or name == "":
            raise InputError(f"{key}: {pattern!r} has a bracket that is not part of a field such as {{what}}.")
        else:
            raise InputError(f"{key}: unknown field {{{name}}}; fields are {', '.join(fields)}.")
        if (before, own) in _UNCLEAR_BETWEEN:
            raise InputError(
                f"{key}: nothing in {pattern!r} tells where a field ends or begins beside another or *; put what "
                "stands between them there, such as _, or use ? for each sign."
            )
        before = own
    return re.compile("".join(parts))


def fields_of(pattern: str) -> tuple[str, ...]:
    """Names of the fields of a pattern."""
    return tuple(dict.fromkeys(_TEMPLATE.findall(pattern)))


def is_pattern(text: str) -> bool:
    """Whether a text stands for several names."""
    return any(letter in text for letter in "*?{")


def filled(template: str, fields: dict[str, str]) -> str:
    """A name with the fields that are known put in."""
    return _TEMPLATE.sub(lambda found: fields.get(found[1], found[0]), template)


def natural(text: str) -> list[tuple[int, int, str]]:
    """Sorts `session-2` before `session-10`."""
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in re.split(r"([0-9]+)", text)]


def number_in(text: str) -> tuple[float, str] | None:
    """The only number in a text and the letters after it; `None` otherwise, or where a comma may mean two things.

    A comma between digits is a decimal mark, or separates thousands where there are two or a point follows.

    >>> number_in("pos_-1.5mm"), number_in("1,5"), number_in("1,000.5"), number_in("trial-03"), number_in("2 of 3")
    ((-1.5, 'mm'), (1.5, ''), (1000.5, ''), (3.0, ''), None)
    """
    if unclear_comma(text):
        return None
    whole = _IN_THOUSANDS.sub(lambda found: found[0].replace(",", ""), text.translate(_SIGNS))
    found = _IN_TEXT.findall(re.sub(r"(?<=\d),(?=\d)", ".", whole))
    return (float(found[0][0]), found[0][1]) if len(found) == 1 else None


def unclear_comma(text: str) -> bool:
    """Whether a text holds a number such as `1,250`, which is 1.25 with a decimal comma and else 1250."""
    return _UNCLEAR.search(text) is not None
