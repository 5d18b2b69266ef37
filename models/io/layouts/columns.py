"""Which columns or taxels a map chooses."""

from collections.abc import Collection
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..recording import naming
from .formats.contents import Contents
from .mapping import TapMap, option
from .patterns import compiled_pattern, fields_of, is_pattern, natural, number_in
from .signal import Signal

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
            pattern = _literal_brackets(text.replace("{taxel}", "*"))
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


class ColumnGrid(NamedTuple):
    """Columns that are no taxels but samples or taps, or one of those of each taxel.

    Attributes:
        names: Of the columns: of each sample or tap those of all taxels.
        along: `"sample"` where rows are taps and columns samples, else `"tap"`.
        texts: What the names have for each sample or tap, in natural order.
        taxels: Likewise of each taxel.
        trial: Whether the names number the taps.
    """

    names: list[str]
    along: str
    texts: list[str]
    taxels: list[str]
    trial: bool

    def taps(self, frames: NDArray[np.float64]) -> Signal:
        """Taps of the columns, shape (rows, columns)."""
        K = len(self.taxels)
        if self.along == "sample":
            return Signal(frames.reshape(len(frames), -1, K))
        numbers = [number_in(text) for text in self.texts] if self.trial else []
        index = {"trial": np.array([int(found[0]) for found in numbers if found], np.intp)} if self.trial else {}
        return Signal(frames.reshape(len(frames), -1, K).swapaxes(0, 1), index)


def column_grid(how: TapMap, contents: Contents, others: Collection[str]) -> ColumnGrid | None:
    """Columns by a pattern such as `s{sample}_t{taxel}`, `v{sample}` or `trial {trial}`; `None` without such fields.

    Raises:
        InputError: Fields do not go together, no column but the others matches, or one that is due is not there.
    """
    text, key = _alone(how), option("taxels")
    fields = set() if text in contents.variables else set(fields_of(text))
    if not fields - {"taxel"}:
        return None
    pattern = compiled_pattern(text, key, ("sample", "taxel", "tap", "trial"))
    if len(whose := fields - {"taxel"}) > 1:
        raise InputError(f"{key} {text!r} has {' and '.join(map('{{{}}}'.format, sorted(whose)))}; columns are either.")
    name = whose.pop()
    matches = [(each, match.groupdict()) for each in contents.variables if (match := pattern.fullmatch(each))]
    named = {(match[name], match.get("taxel", "")): each for each, match in matches if each not in others}
    named = {of: each for of, each in named.items() if name == "tap" or any(map(str.isdecimal, of[0]))}
    if not named:
        raise InputError(f"no column matches {key} {text!r}; columns: {_listed(list(contents.variables))}.")
    texts, taxels = (_in_order({of[i] for of in named}) for i in (0, 1))
    due = [(each, taxel) for each in texts for taxel in taxels]
    if missing := [of for of in due if of not in named]:
        each, taxel = missing[0]
        raise InputError(f"{key} {text!r}: no column has {name} {each} of taxel {taxel}.")
    names = [named[of] for of in due]
    return ColumnGrid(names, "sample" if name == "sample" else "tap", texts, taxels, name == "trial" and not how.trial)


def _in_order(texts: Collection[str]) -> list[str]:
    """Texts by their numbers if all are such, else in natural order."""
    try:
        return sorted(texts, key=lambda text: (float(text), natural(text)))
    except ValueError:
        return sorted(texts, key=natural)


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


def _alone(how: TapMap) -> str:
    """The one pattern or slice of the columns, empty if there are several or none."""
    chosen = _chosen(how)
    return chosen[0] if len(chosen) == 1 else ""


def taxel_slice(how: TapMap) -> slice:
    """Which taxels of an array are used.

    Raises:
        InputError: The map says it in another way.
    """
    chosen = _as_slice(_alone(how))
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
