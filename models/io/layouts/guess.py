"""Guesses what arrays, columns and names of files mean, each with the reason."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .formats.contents import Contents, Variable
from .patterns import natural, number_in

_WORDS = {
    "time": r"^(t|time|times|timestamp|stamp|time ?s|time ?ms|seconds|elapsed.*)$|timestamp|log_time",
    "trial": r"trial|repeat|repetition|\brep\b|attempt",
    "tap": r"^tap|press|contact ?(id|no|number)|episode|touch ?(id|no|number)|segment|grasp ?(id|no|number)",
    "session": r"session|\bday|date|\brun\b|subject|participant|user",
    "what": r"what|object|material|texture|class|label|shape|letter|surface|stimulus|category|diameter|item",
    "where": r"where|position|\bpos\b|location|angle|place|offset|\bx\b|x ?mm",
}
_SIGNAL = r"taxel|signal|sensor|tactile|force|pressure|electrode|pac|pdc|channel|\bch ?\d|fsr|skin|cap|touch|elec|adc"
_NAMES = r"name|label|categor"
_FEW = 200
"""Distinct values of a column that can be labels."""
_DATE = re.compile(r"(19|20)\d\d[-_.]?\d\d[-_.]?\d\d")


class Guess(NamedTuple):
    """One line of a map.

    Attributes:
        key: Of the map.
        value: Text, list of texts or truth value.
        reason: Why.
    """

    key: str
    value: Any
    reason: str


def name_pattern(names: Sequence[str]) -> tuple[str, list[Guess]]:
    """Pattern of the names of files, and what its fields may be; empty where all names are one.

    Names are divided into words and numbers. Where all have equally many and the same letters between them, words that
    differ become fields: sessions by their name or as dates, numbers with a unit positions, other numbers trials, other
    words objects.
    """
    if len(names) < 2:
        return "", []
    parts = [re.split(r"([/_\s.-]+)", name) for name in names]
    if len({len(each) for each in parts}) > 1 or any(
        len({each[i] for each in parts}) > 1 for i in range(1, len(parts[0]), 2)
    ):
        return "", []
    taken: set[str] = set()
    pieces, guesses = [], []
    for i, first in enumerate(parts[0]):
        values = [each[i] for each in parts]
        before = parts[0][i - 2] if i > 1 and len({each[i - 2] for each in parts}) == 1 else ""
        if len(set(values)) == 1:
            pieces.append(first)
            continue
        key, reason = _field(values, before, taken, len(names))
        pieces.append(f"{{{key}}}" if key else "*")
        if key:
            taken.add(key)
            guesses.append(Guess(key, f"{{{key}}}", reason))
    return "".join(pieces), guesses


def _field(values: Sequence[str], before: str, taken: set[str], files: int) -> tuple[str, str]:
    """Which field words of names may be, and why; empty if none is left."""
    distinct = sorted(set(values), key=natural)
    shown = _shown(distinct)
    hint = before + " " + re.sub(r"\d+", " ", " ".join(distinct[:20]))
    numbers = [number_in(value) for value in distinct]
    units = {each[1] for each in numbers if each is not None}
    wanted: list[tuple[str, str]] = []
    if re.search(_WORDS["session"], hint, re.IGNORECASE) or all(_DATE.search(value) for value in distinct):
        wanted.append(("session", shown))
    if all(each is not None for each in numbers):
        if units & {"mm", "cm", "deg", "um", "µm", "m"} or re.search(_WORDS["where"], before, re.IGNORECASE):
            wanted.append(("where", f"numbers such as {shown}"))
        wanted.append(("trial", f"numbers {shown}"))
        if len(distinct) < files:
            wanted.insert(len(wanted) - 1, ("where", f"few numbers, {shown}"))
    wanted.append(("what", shown))
    return next(((key, reason) for key, reason in wanted if key not in taken), ("", ""))


def _shown(values: Sequence[str]) -> str:
    return ", ".join(values[:3]) + (f", ... ({len(values)})" if len(values) > 3 else "")


def column_guesses(contents: Contents, values: Mapping[str, NDArray[Any]]) -> list[Guess]:
    """What the columns of a table may mean.

    Args:
        contents: The table.
        values: Its columns that could be read.
    """
    guesses: dict[str, Guess] = {}
    numeric = {name for name, each in values.items() if _numbers(each) is not None}
    for key, words in _WORDS.items():
        for name, each in values.items():
            if key in guesses or not re.search(words, _plain(name), re.IGNORECASE):
                continue
            distinct = len(np.unique(each))
            if key == "time" and not _increases(each):
                continue
            if key in ("what", "session") and distinct > min(_FEW, max(2, len(each) // 2)):
                continue
            if key in ("where", "trial", "tap") and name not in numeric:
                continue
            if key == "where" and distinct > _FEW:
                continue
            guesses[key] = Guess(key, name, f"its name, and {distinct} different values")
    used = {guess.value for guess in guesses.values()}
    if "what" not in guesses:
        texts = [name for name, each in values.items() if name not in numeric and 1 < len(np.unique(each)) <= _FEW]
        if texts:
            guesses["what"] = Guess("what", texts[0], f"texts, {len(np.unique(values[texts[0]]))} different ones")
            used.add(texts[0])
    if "tap" not in guesses and "trial" in guesses and _repeats(values[guesses["trial"].value]):
        guesses["tap"] = Guess("tap", guesses["trial"].value, "its values stay the same for many rows")
    taxels = _taxels([name for name in values if name in numeric and name not in used], contents)
    if taxels is not None:
        guesses["taxels"] = taxels
    return list(guesses.values())


def _taxels(names: Sequence[str], contents: Contents) -> Guess | None:
    """The largest group of columns of numbers that differ only in their numbers, or are called like signals."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    called = [name for name in names if re.search(_SIGNAL, _plain(name), re.IGNORECASE)]
    stem, members = max(groups.items(), key=lambda each: len(each[1]), default=("", []))
    if len(members) >= max(2, len(called)):
        pattern = stem.replace("#", "*")
        exact = [name for name in contents.variables if re.fullmatch(re.escape(pattern).replace(r"\*", ".*"), name)]
        return Guess("taxels", pattern if exact == members else members, f"{len(members)} columns numbered alike")
    if called:
        return Guess("taxels", called, "names of signals")
    return Guess("taxels", list(names), "all other columns of numbers") if names else None


def array_guesses(contents: Contents, values: Mapping[str, NDArray[Any]]) -> list[Guess]:
    """What the arrays of a file may mean.

    Args:
        contents: The file.
        values: Its arrays that could be read and are small.
    """
    variables = contents.variables
    if not variables:
        return []
    name = max(variables, key=lambda each: (_is_number(variables[each]), _size(variables[each])))
    signal = variables[name]
    found = [Guess("taps", name, "the largest array of numbers")]
    length = signal.shape[0] if signal.shape else None
    rank = len(signal.shape)
    axes = {1: "sample", 2: "tap,sample", 3: "tap,sample,taxel", 4: "what,tap,sample,taxel"}.get(rank, "")
    if rank >= 5:
        axes = ",".join([*("what", "where", "trial", "session")[: rank - 2], "sample", "taxel"])
    vectors = [
        each
        for each, of in variables.items()
        if each != name and of.shape and np.prod([n or 1 for n in of.shape]) == (length or -1)
    ]
    if rank != 3:
        found.append(Guess("axes", axes, f"shape {_shape(signal)}; check which axis is which"))
    for key in ("what", "where", "session", "trial"):
        fitting = [each for each in vectors if re.search(_WORDS[key], _plain(each), re.IGNORECASE)]
        if fitting:
            found.append(Guess(key, fitting[0], f"its name, and one value for each of {length} taps"))
    what = next((guess.value for guess in found if guess.key == "what"), None)
    if what is None and len(vectors) == 1:
        found.append(Guess("what", vectors[0], f"the only array with one value for each of {length} taps"))
        what = vectors[0]
    if what is not None and what in values and values[what].dtype.kind in "iuf" and values[what].size:
        top, low = int(values[what].max()), int(values[what].min())
        listed = [
            each
            for each, of in variables.items()
            if of.dtype.kind == "U" and of.shape and of.shape[0] in (top, top + 1) and re.search(_NAMES, each, re.I)
        ]
        if listed:
            found.append(Guess("what_names", listed[0], "as many texts as objects"))
            if low == 1 and variables[listed[0]].shape[0] == top:
                found.append(Guess("one_based", True, f"{what} runs from 1 to {top}"))
    return found


def _shape(variable: Variable) -> str:
    return " x ".join("?" if n is None else str(n) for n in variable.shape)


def _is_number(variable: Variable) -> bool:
    return variable.dtype.kind in "fiu"


def _size(variable: Variable) -> int:
    return int(np.prod([n or 1 for n in variable.shape], dtype=np.int64))


def _plain(name: str) -> str:
    """A name without its unit, its words apart."""
    name = re.sub(r"[\[(].*?[\])]", "", name.rpartition("/")[2]).strip()
    return re.sub(r"(?<=[a-z])(?=[A-Z])|[_.-]", " ", name).strip()


def _numbers(values: NDArray[Any]) -> NDArray[np.float64] | None:
    if values.dtype.kind in "fiu":
        return values.astype(np.float64)
    try:
        return values.astype(np.float64) if values.ndim == 1 else None
    except ValueError:
        return None


def _increases(values: NDArray[Any]) -> bool:
    numbers = _numbers(values)
    return numbers is not None and len(numbers) > 1 and bool((np.diff(numbers) > 0).mean() > 0.9)


def _repeats(values: NDArray[Any]) -> bool:
    return bool(len(values) > 2 * (1 + np.count_nonzero(values[1:] != values[:-1])))
