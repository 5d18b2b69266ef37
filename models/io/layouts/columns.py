"""Which columns or taxels a map chooses."""

from fnmatch import fnmatchcase

from ...errors import InputError
from .formats.contents import Contents
from .mapping import TapMap
from .patterns import is_pattern

_MOST_SHOWN = 12


def taxel_columns(how: TapMap, contents: Contents) -> list[str]:
    """Names of the columns of samples, in the order of the file.

    Raises:
        InputError: The map names none, or one that is not there.
    """
    names = list(contents.variables)
    if how.taxels is None:
        raise InputError(
            "say which columns are taxels with taxels (--taxels), or which array holds samples with taps (--taps); "
            f"there are: {', '.join(names[:_MOST_SHOWN])}{', ...' if len(names) > _MOST_SHOWN else ''}."
        )
    wanted = (how.taxels,) if isinstance(how.taxels, str) else how.taxels
    found: list[str] = []
    for text in wanted:
        part = _as_slice(text)
        if part is not None and text not in names:
            matched = names[part]
        elif is_pattern(text) and text not in names:
            matched = [name for name in names if fnmatchcase(name, _literal_brackets(text))]
        else:
            matched = [contents.named(text)]
        if not matched:
            raise InputError(
                f"no column matches taxels (--taxels) {text!r}; columns: {', '.join(names[:_MOST_SHOWN])}."
            )
        found += [name for name in matched if name not in found]
    return found


def taxel_slice(how: TapMap) -> slice:
    """Which taxels of an array are used.

    Raises:
        InputError: The map says it in another way.
    """
    chosen = _as_slice(how.taxels) if isinstance(how.taxels, str) else None
    if chosen is None:
        raise InputError(f"taxels (--taxels) of an array must be a slice such as 0:12, got {how.taxels!r}.")
    return chosen


def _literal_brackets(text: str) -> str:
    """Units in headers stand in brackets, which `fnmatch` would read as a set of letters."""
    return text.replace("[", "[[]")


def _as_slice(text: str) -> slice | None:
    begin, colon, end = text.partition(":")
    if not colon or not all(not part or part.lstrip("-").isdecimal() for part in (begin, end)):
        return None
    return slice(int(begin) if begin else None, int(end) if end else None)
