"""Which columns or taxels a map chooses."""

from collections.abc import Collection
from fnmatch import fnmatchcase

from ...errors import InputError
from ..recording import naming
from .formats.contents import Contents
from .mapping import TapMap, option
from .patterns import compiled_pattern, fields_of, is_pattern, natural

_MOST_SHOWN = 12
type FirstColumns = dict[str, str]
"""Columns of taxels of the first file of a recording, each with its unit; empty before that."""


def taxel_columns(how: TapMap, contents: Contents, others: Collection[str]) -> list[str]:
    """Names of the columns of samples, in the order of the file; no pattern stands for one of the others, as of labels.

    Raises:
        InputError: The map names none, or one that is not there.
    """
    names = list(contents.variables)
    if not names and contents.unreadable:
        raise InputError(". ".join(f"{name} cannot be read: {why}" for name, why in contents.unreadable.items()) + ".")
    if how.taxels is None:
        raise InputError(
            "say which columns are taxels with taxels (--taxels), or which array holds samples with taps (--taps); "
            f"there are: {_listed(names)}."
        )
    found: list[str] = []
    for text in _chosen(how):
        part = _as_slice(text)
        if part is not None and text not in names:
            matched = list(contents.columns[part])
        elif is_pattern(text) and text not in names:
            pattern = _literal_brackets(text)
            matched = [name for name in names if fnmatchcase(name, pattern) and name not in others]
        else:
            parts = [part.strip() for part in text.split(",")]
            if len(parts) > 1 and set(parts) <= set(names):
                raise InputError(f"taxels (--taxels) {text!r}: give the option once for each of these columns.")
            with naming(option("taxels")):
                matched = [contents.named(text)]
        if not matched:
            raise InputError(f"no column matches taxels (--taxels) {text!r}; columns: {_listed(names)}.")
        found += [name for name in matched if name not in found]
    return found


def sample_columns(how: TapMap, contents: Contents) -> tuple[list[str], int] | None:
    """Columns of each sample of each taxel, such as `s{sample}_t{taxel}`, and the number of taxels; `None` for others.

    Columns are in the natural order of samples, and of taxels within each.

    Raises:
        InputError: No column matches, or one that is due is not there.
    """
    text = how.taxels
    if not isinstance(text, str) or not {"sample", "taxel"} <= set(fields_of(text)):
        return None
    pattern = compiled_pattern(text, option("taxels"), ("sample", "taxel"))
    matches = [(name, match) for name in contents.variables if (match := pattern.fullmatch(name))]
    named = {(match["sample"], match["taxel"]): name for name, match in matches}
    if not named:
        raise InputError(f"no column matches taxels (--taxels) {text!r}; columns: {_listed(list(contents.variables))}.")
    samples, taxels = (sorted({key[i] for key in named}, key=natural) for i in (0, 1))
    due = [(sample, taxel) for sample in samples for taxel in taxels]
    if missing := [key for key in due if key not in named]:
        sample, taxel = missing[0]
        raise InputError(f"taxels (--taxels) {text!r}: no column has sample {sample} of taxel {taxel}.")
    return [named[key] for key in due], len(taxels)


def _listed(names: list[str]) -> str:
    return f"{', '.join(names[:_MOST_SHOWN])}{', ...' if len(names) > _MOST_SHOWN else ''}"


def agreeing(columns: list[str], contents: Contents, how: TapMap, first: FirstColumns) -> list[str]:
    """The columns in the order of those of the first file, which this may be.

    Raises:
        InputError: Columns or their units differ from those of the first file; columns by number may have other names.
    """
    if not first:
        first |= {name: contents.variables[name].unit for name in columns}
        return columns
    names, shared = list(first), set(columns) & first.keys()
    if shared == first.keys() == set(columns):
        if columns != names and _by_number(how):
            raise InputError(
                "columns of taxels are in another order than in the first file; name them in taxels (--taxels)."
            )
        return names
    other = next((name for name in columns if name not in first), None) or next(n for n in names if n not in columns)
    if not _by_number(how):
        raise InputError(
            f"taxels (--taxels): this file and the first one differ in {other!r}; names of columns must be the same."
        )
    return columns


def _by_number(how: TapMap) -> bool:
    return any(_as_slice(text) is not None for text in _chosen(how))


def _chosen(how: TapMap) -> tuple[str, ...]:
    return (how.taxels,) if isinstance(how.taxels, str) else how.taxels or ()


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
