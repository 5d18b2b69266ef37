"""Guesses what arrays, columns and names of files mean, each with the reason."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....cutting.sessions import GAP_STEPS
from ....errors import counted
from ..formats.contents import Contents, Variable
from ..patterns import number_in
from ..times import UNITS, time_unit, told_of_rate, unit_since_1970

_WORDS = {
    "time": r"^(t|time|times|timestamp|stamp|time ?s|time ?ms|seconds|elapsed.*|zeit)$|timestamp|log.?time",
    "trial": r"trial|repeat|repetition|\brep\b|attempt|versuch",
    "tap": r"^tap|press|contact ?(id|no|number)|episode|touch ?(id|no|number)|segment|grasp ?(id|no|number)",
    "session": r"session|\bday|date|\brun\b|subject|participant|user|^tag$",
    "what": r"what|object|material|texture|class|label|shape|letter|surface|stimulus|category|diameter|item|objekt|^y$",
    "where": r"where|position|\bpos\b|location|angle|place|offset|\bx\b|x ?mm|^p$",
}
_SIGNAL = (
    r"taxel|signal|sensor|tactile|force|pressure|electrode|pac|pdc|channel|\bch ?\d|fsr|skin|cap|touch|elec|adc|kraft"
)
_TAXEL = re.compile(r"(taxel|channel|kanal|sensor|electrode|ch|fsr)s?( ?(id|no|nr|number|index|name))?", re.IGNORECASE)
"""What a column of the numbers or names of taxels is called."""
_VALUE = re.compile(rf"value|wert|reading|{_SIGNAL}", re.IGNORECASE)
_RISING = 0.8
"""Share of the steps of a time that rise; it may begin anew with each tap."""
_DIGITS = re.compile(r"-?\d[\d.,]*")
"""A cell that looks like a number, which the map may still have to be told how to read."""
_CLOCK = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
TAP_AXES = ("tap", "sample", "taxel")
CHECK = "check which axis is which"
_FEW = 200
"""Distinct values of a column that can be labels."""


class Guess(NamedTuple):
    """One line of a map.

    Attributes:
        key: Of the map.
        value: Text, list of texts or truth value.
        reason: Why.
        of_names: Whether it is a field of the names of files or arrays, which needs no line of its own.
    """

    key: str
    value: Any
    reason: str
    of_names: bool = False


def like(key: str, text: str) -> bool:
    """Whether a name is one that a key of the map often has."""
    return re.search(_WORDS[key], text, re.IGNORECASE) is not None


def shown(values: Sequence[str]) -> str:
    """The first of some texts."""
    return ", ".join(values[:3]) + (f", ... ({len(values)})" if len(values) > 3 else "")


def column_guesses(contents: Contents, values: Mapping[str, NDArray[Any]]) -> list[Guess]:
    """What the columns of a table may mean.

    Args:
        contents: The table.
        values: Its columns that could be read.
    """
    columns = {name: each for name, each in values.items() if each.ndim == 1}
    taxel = next((name for name, each in columns.items() if _tells_taxel(name, each)), None)
    if taxel is not None:
        rows = columns[taxel] == columns[taxel][0]
        columns = {name: each[rows] for name, each in columns.items() if name != taxel}
    numeric = {name for name, each in columns.items() if as_floats(each) is not None}
    alike = numeric | {name for name in columns.keys() - numeric if _all_hold_a_number(columns[name])}
    guesses = _labels_by_name(columns, alike)
    if (second := _other_axis(guesses.get("where"), columns)) is not None:
        guesses = {key: guess for key, guess in guesses.items() if guess.value != second}
        guesses["where"] = Guess("where", [guesses["where"].value, second], "the names of two axes of a plane")
    written = {name for name, each in columns.items() if each.size and _DIGITS.fullmatch(str(each[0]))}
    texts = {name: len(np.unique(each)) for name, each in columns.items() if name not in alike | written}
    texts = {name: n for name, n in texts.items() if 1 < n <= _few(columns[name])}
    others = [name for name in texts if not like("where", plain(name))]
    if "what" not in guesses and others:
        name, n = others[0], texts[others[0]]
        guesses["what"] = Guess("what", name, f"texts, {n} different ones")
    if "where" not in guesses:
        guesses |= {guess.key: guess for guess in _named_places(texts, columns)}
    if "time" in guesses and "session" not in guesses:
        guesses |= {guess.key: guess for guess in _days(guesses["time"].value, columns)}
    lists = [name for name, each in contents.variables.items() if len(each.shape) > 1 and is_number(each)]
    if lists:
        guesses.pop("tap", None)
        return [*guesses.values(), *_of_lists(lists, contents, values)]
    if "tap" not in guesses and "trial" in guesses and _repeats(columns[guesses["trial"].value]):
        guesses["tap"] = Guess("tap", guesses["trial"].value, "its values stay the same for many rows")
    guesses |= {guess.key: guess for guess in _between_taps(guesses.get("tap"), columns)}
    if all(map(str.isdecimal, columns)):
        guesses |= {guess.key: guess for guess in _whole_numbers(columns)}
    used = {name for name in columns if like("time", plain(name))}
    used |= {name for guess in guesses.values() for name in _listed(guess.value)}
    free = [name for name in columns if name in numeric | written and name not in used]
    if taxel is not None and free:
        return [*guesses.values(), *_of_long_table(taxel, free)]
    taxels = _taxels(free, contents)
    return [*guesses.values(), *([] if taxels is None else [taxels])]


def _of_long_table(taxel: str, free: Sequence[str]) -> Iterator[Guess]:
    """The column that tells taxels, and that of values, which is among these."""
    called = [name for name in free if _VALUE.search(plain(name))]
    yield Guess("taxel", taxel, "its name, and rows that repeat its values: a row for each sample of each taxel")
    yield Guess("taxels", [(called or free)[-1]], "a column of values")


def _few(values: NDArray[Any]) -> int:
    """How many different values of so many rows can be labels."""
    return min(_FEW, max(2, len(values) // 2))


def _between_taps(tap: Guess | None, columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """What leaves out rows between taps, which have a number below 0 or none."""
    if (
        tap is None
        or (floats := as_floats(columns[tap.value])) is None
        or (floats >= 0).all()
        or not (floats >= 0).any()
    ):
        return
    yield Guess(
        "keep",
        f"{tap.value}>=0",
        f"rows between taps have {'no number' if np.isnan(floats).any() else 'negative ones'}",
    )


def _whole_numbers(columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Taps and objects of a table without a header: whole numbers that repeat, beside others that have decimals."""
    floats = {name: of for name, each in columns.items() if (of := as_floats(each)) is not None}
    whole = [name for name, of in floats.items() if (of == np.round(of)).all() and len(np.unique(of)) <= _few(of)]
    if len(whole) == len(floats):
        return
    for key in ("tap", "what"):
        name = next((each for each in whole if key == "what" or _counts(floats[each])), None)
        if name is not None:
            whole.remove(name)
            yield Guess(key, name, "whole numbers that repeat; check whether they mean this")


def _counts(values: NDArray[np.float64]) -> bool:
    """Whether each of several rows has the same number, and the next ones that after it."""
    return _repeats(values) and set(np.diff(values)) == {0.0, 1.0}


def _named_places(texts: Iterable[str], columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """A column of the names of positions, and these in their order of appearance."""
    for name in [name for name in texts if like("where", plain(name))][:1]:
        yield Guess("where", name, "its name, and texts")
        places = list(dict.fromkeys(columns[name].tolist()))
        yield Guess("where_values", places, "positions in order of appearance; put neighbours side by side")


def _tells_taxel(name: str, values: NDArray[Any]) -> bool:
    """Whether a column tells the taxel of each row of a long table: it repeats few names, or all numbers of a range."""
    if not _TAXEL.fullmatch(plain(name)) or not 1 < len(distinct := np.unique(values)) <= _few(values):
        return False
    floats = as_floats(distinct)
    return floats is None or (floats.min() in (0, 1) and set(floats - floats.min()) == set(range(len(floats))))


def _days(time: str, columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """A session for each date of times."""
    if columns[time].dtype.kind == "U" and _CLOCK.match(columns[time][0]):
        days = len({text[:10] for text in columns[time].tolist()})
        if days > 1:
            yield Guess("session", f"date:{time}", f"times of {days} days")


def _labels_by_name(columns: Mapping[str, NDArray[Any]], numbers: Set[str]) -> dict[str, Guess]:
    """Time, tap and labels among columns, by their names and the number of their values.

    Args:
        columns: Their values.
        numbers: Columns of numbers, also in texts.
    """
    guesses: dict[str, Guess] = {}
    for key, name in ((key, name) for key in _WORDS for name in columns):
        each = columns[name]
        if key in guesses or not like(key, plain(name)):
            continue
        distinct, few = len(np.unique(each)), _few(each)
        most = {"what": few, "session": few, "where": _FEW}.get(key, len(each))
        fits = increases(each) if key == "time" else name in numbers or key in ("what", "session")
        if fits and distinct <= most:
            reason = _steps(name, each) if key == "time" else f"its name, and {distinct} different values"
            guesses[key] = Guess(key, name, reason)
    return guesses


def _of_lists(lists: Sequence[str], contents: Contents, values: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Which column of lists holds the samples, and what to do where they differ in length."""
    name = next((name for name in lists if re.search(_SIGNAL, plain(name), re.IGNORECASE)), lists[0])
    yield Guess("taps", name, "lists of numbers")
    if name not in values:
        yield Guess("length", "longest", "its lists differ in length")
    if len(contents.variables[name].shape) == len(TAP_AXES):
        yield Guess("axes", ",".join(TAP_AXES), f"lists of lists; {CHECK}")


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _steps(name: str, values: NDArray[Any]) -> str:
    """How a time increases, and what is doubtful of it."""
    steps = np.diff(as_floats(values))  # pyright: ignore - it is one of numbers
    usual = float(np.nanmedian(steps))
    gaps = int(np.count_nonzero((steps <= 0) | (steps > GAP_STEPS * usual)))
    unit = "s" if values.dtype.kind == "U" else time_unit(name, "") or unit_since_1970(values) or "s"
    doubt = told_of_rate(1 / (usual * UNITS[unit]), unit) if usual > 0 else ""
    return f"it increases by {usual:g}{f', with {counted(gaps, "gap")}' if gaps else ''}{f'; {doubt}' if doubt else ''}"


def _other_axis(where: Guess | None, values: Mapping[str, NDArray[Any]]) -> str | None:
    """The column y beside a column x of positions."""
    if where is None or not re.match(r"x\b", plain(where.value), re.IGNORECASE):
        return None
    wanted = f"y{where.value[1:]}".lower()
    return next((name for name, of in values.items() if name.lower() == wanted and len(np.unique(of)) <= _FEW), None)


def _taxels(names: Sequence[str], contents: Contents) -> Guess | None:
    """The largest group of columns of numbers that differ only in their numbers, or are called like signals."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    called = [name for name in names if re.search(_SIGNAL, plain(name), re.IGNORECASE)]
    stem, members = max(groups.items(), key=lambda each: len(each[1]), default=("", []))
    if len(members) >= max(2, len(called)):
        pattern = stem.replace("#", "*")
        exact = [name for name in contents.variables if re.fullmatch(re.escape(pattern).replace(r"\*", ".*"), name)]
        return Guess("taxels", pattern if exact == members else members, f"{len(members)} columns numbered alike")
    if called:
        return Guess("taxels", called, "names of signals")
    return Guess("taxels", list(names), "all other columns of numbers") if names else None


def shape_of(variable: Variable) -> str:
    """Shape in print, such as `40 x ?`; empty for one number."""
    return " x ".join("?" if n is None else str(n) for n in variable.shape)


def is_number(variable: Variable) -> bool:
    """Whether a variable holds numbers."""
    return variable.dtype.kind in "fiu"


def size_of(variable: Variable) -> int:
    """Number of values, as far as the lengths of the axes are known."""
    return int(np.prod([n or 1 for n in variable.shape], dtype=np.int64))


def plain(name: str) -> str:
    """A name without its groups and its unit, its words apart."""
    name = re.sub(r"[\[(].*?[\])]", "", name.rpartition("/")[2]).strip()
    return re.sub(r"(?<=[a-z])(?=[A-Z])|[_.-]", " ", name).strip()


def as_floats(values: NDArray[Any]) -> NDArray[np.float64] | None:
    """Numbers, also in texts, and times in seconds; `None` of anything else."""
    if values.dtype.kind in "fiu":
        return values.astype(np.float64)
    try:
        return np.where(values == "", "nan", values).astype(np.float64) if values.ndim == 1 else None
    except ValueError:
        return _seconds(values)


def _seconds(values: NDArray[Any]) -> NDArray[np.float64] | None:
    """Seconds since the first of texts such as `2024-01-31 10:00:00.25`."""
    if values.ndim != 1 or not values.size or not all(map(_CLOCK.match, map(str, values[:_FEW].tolist()))):
        return None
    try:
        times = values.astype("datetime64[ns]")
        return (times - times[0]).astype(np.int64) / 1e9
    except ValueError:
        return None


def _all_hold_a_number(texts: NDArray[Any]) -> bool:
    """Whether few different texts have one number each, and all with one unit."""
    distinct = np.unique(texts).tolist()[: _FEW + 1]
    found = {None if (each := number_in(text)) is None else each[1] for text in distinct}
    return len(distinct) <= _FEW and len(found) == 1 and None not in found


def increases(values: NDArray[Any]) -> bool:
    """Whether numbers or times mostly rise."""
    floats = as_floats(values)
    return floats is not None and len(floats) > 1 and bool((np.diff(floats) > 0).mean() > _RISING)


def _repeats(values: NDArray[Any]) -> bool:
    return bool(len(values) > 2 * (1 + np.count_nonzero(values[1:] != values[:-1])))
