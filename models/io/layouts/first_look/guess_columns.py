"""Guesses what the columns of a table mean."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from itertools import takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....cutting.sessions import GAP_STEPS
from ....errors import counted
from ..formats.contents import Contents, name_and_unit
from ..patterns import number_in
from ..times import UNITS, time_unit, told_of_rate, unit_since_1970
from .guess import (
    CHECK,
    CLOCK,
    FEW,
    SIGNAL,
    TAP_AXES,
    WORDS,
    Guess,
    as_floats,
    as_list,
    counts,
    few,
    increases,
    is_class,
    is_number,
    like,
    only_counts,
    plain,
    repeats,
    seconds_of,
)
from .guess_presses import between_taps, counted_taps, phases, restarting, signal

_TAXEL = re.compile(r"(taxel|channel|kanal|sensor|electrode|ch|fsr)s?( ?(id|no|nr|number|index|name))?", re.IGNORECASE)
"""What a column of the numbers or names of taxels is called."""
_VALUE = re.compile(rf"value|wert|reading|{SIGNAL}", re.IGNORECASE)
_DIGITS = re.compile(r"-?\d[\d.,]*")
"""A cell that looks like a number, which the map may still have to be told how to read."""
_ALIKE, _ROW = 3, 8
"""Columns that are called alike, and columns of numbers of a row that is a tap, at least."""
_SMOOTH = 0.6
"""Neighbours along samples differ by less than this share of the spread."""


def column_guesses(
    contents: Contents, values: Mapping[str, NDArray[Any]], named: Set[str] = frozenset()
) -> list[Guess]:
    """What the columns of a table may mean.

    Args:
        contents: The table.
        values: Its columns that could be read.
        named: Keys of the map that the names of files tell.
    """
    columns = {name: each for name, each in values.items() if each.ndim == 1}
    taxel = next((name for name, each in columns.items() if _tells_taxel(name, each)), None)
    if taxel is not None:
        rows = columns[taxel] == columns[taxel][0]
        columns = {name: each[rows] for name, each in columns.items() if name != taxel}
    clocks = {name for name, each in columns.items() if each.dtype.kind == "U" and seconds_of(each) is not None}
    numeric = {name for name, each in columns.items() if name not in clocks and as_floats(each) is not None}
    alike = numeric | {name for name in columns.keys() - numeric if _all_hold_a_number(columns[name])}
    numbered = _numbered(columns, numeric)
    written = {name for name, each in columns.items() if each.size and _DIGITS.fullmatch(str(each[0]))}
    labels = {name: of for name, of in columns.items() if name not in numbered}
    guesses = _labels(labels, alike, clocks, written)
    lists = [name for name, each in contents.variables.items() if len(each.shape) > 1 and is_number(each)]
    if lists:
        return _of_lists(lists, guesses, contents, values)
    if wide := list(_wide(columns, numeric, numbered, guesses)):
        return [*guesses.values(), *wide]
    if "tap" not in guesses and "trial" in guesses and repeats(columns[guesses["trial"].value]):
        guesses["tap"] = Guess("tap", guesses["trial"].value, "its values stay the same for many rows")
    if "tap" not in guesses:
        guesses |= {guess.key: guess for guess in counted_taps(columns, numeric, guesses)}
    guesses |= {guess.key: guess for guess in between_taps(guesses.get("tap"), columns)}
    if all(map(str.isdecimal, columns)):
        guesses |= {guess.key: guess for guess in _whole_numbers(columns) if guess.key not in named}
    used = {name for name in columns if like("time", plain(name))}
    used |= {name for guess in guesses.values() for name in as_list(guess.value)}
    stems = Counter(re.sub(r"\d+", "#", name) for name in numeric)
    alone = [name for name in numeric if name.isdecimal() or stems[re.sub(r"\d+", "#", name)] == 1]
    used |= {name for name in alone if only_counts(columns[name])}
    if "tap" not in guesses and (pressing := list(phases(columns))):
        guesses |= {guess.key: guess for guess in pressing}
        used |= {pressing[0].value}
    elif "tap" not in guesses and (anew := restarting(columns, numeric - used)) is not None:
        guesses |= {anew.key: anew}
    elif "tap" not in guesses:
        guesses |= {guess.key: guess for guess in signal({name: columns[name] for name in numeric - used})}
        used |= {guess.value.partition("<")[0] for guess in guesses.values() if guess.key == "signal"}
    used |= {guess.value.removeprefix("restart:") for guess in guesses.values() if guess.key == "tap"}
    free = [name for name in columns if name in numeric | written and name not in used]
    if taxel is not None and free:
        return [*guesses.values(), *_of_long_table(taxel, free)]
    taxels = _taxels(free, contents)
    return [*guesses.values(), *([] if taxels is None else [taxels])]


def _labels(
    columns: Mapping[str, NDArray[Any]], alike: Set[str], clocks: Set[str], written: Set[str]
) -> dict[str, Guess]:
    """Time, tap and labels by names, by texts and by places.

    Args:
        columns: Those that may be labels.
        alike: Columns of numbers, also in texts.
        clocks: Columns of clock times.
        written: Columns that begin with what looks like a number.
    """
    guesses = _labels_by_name(columns, alike)
    if "time" not in guesses and (rising := [name for name in clocks if increases(columns[name])]):
        guesses["time"] = Guess("time", rising[0], _steps(rising[0], columns[rising[0]]))
    if (second := _other_axis(guesses.get("where"), columns)) is not None:
        guesses = {key: guess for key, guess in guesses.items() if guess.value != second}
        guesses["where"] = Guess("where", [guesses["where"].value, second], "the names of two axes of a plane")
    texts = {name: len(np.unique(each)) for name, each in columns.items() if name not in alike | written}
    texts = {name: n for name, n in texts.items() if 1 < n <= few(columns[name])}
    others = [name for name in texts if name not in clocks and not like("where", plain(name))]
    if "what" not in guesses and others:
        guesses["what"] = Guess("what", others[0], f"texts, {texts[others[0]]} different ones")
    if "where" not in guesses:
        guesses |= {guess.key: guess for guess in _named_places(texts, columns)}
    if "time" in guesses and "session" not in guesses:
        guesses |= {guess.key: guess for guess in _days(guesses["time"].value, columns)}
    return guesses


def _numbered(columns: Iterable[str], numeric: Set[str]) -> set[str]:
    """Columns of numbers that are called alike but for their numbers, at least three; those are no labels."""
    stems: dict[str, list[str]] = {}
    for name in columns:
        if name in numeric and re.search(r"\d", name):
            stems.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    return {name for members in stems.values() if len(members) >= _ALIKE for name in members}


def _wide(
    columns: Mapping[str, NDArray[Any]], numeric: Set[str], numbered: Set[str], guesses: Mapping[str, Guess]
) -> Iterator[Guess]:
    """Tables whose rows or columns are taps: columns numbered as taps, or rows with labels that change often."""
    stems = {re.sub(r"\d+", "#", name) for name in numbered}
    if len(stems) == 1 and any(like(key, plain(next(iter(stems)))) for key in ("tap", "trial")):
        yield Guess("taxels", stems.pop().replace("#", "{trial}"), f"{len(numbered)} columns numbered as taps")
        return
    whole = [name for name in numeric if is_class(columns[name])] if all(map(str.isdecimal, columns)) else []
    label = guesses["what"].value if "what" in guesses else min(whole, default=None, key=int)
    if {"time", "tap"} & guesses.keys() or label is None or repeats(columns[label]):
        return
    pairs = {name: re.findall(r"\d+", name) for name in numbered}
    if len(stems) == 1 and all(len(found) == 2 for found in pairs.values()):
        counts = [len({found[i] for found in pairs.values()}) for i in (0, 1)]
        fields = ("taxel", "sample") if _sample_last(next(iter(stems)), counts) else ("sample", "taxel")
        pattern = stems.pop().replace("#", "{%s}", 1).replace("#", "{%s}", 1) % fields
        yield Guess("tap", "row", f"{label} changes from row to row")
        yield Guess("taxels", pattern, f"{len(numbered)} columns of two numbers; {CHECK.replace('axis', 'number')}")
        return
    apart = {label, *(each for guess in guesses.values() for each in as_list(guess.value))}
    names = [name for name in columns if name in (numeric if whole else numbered or numeric) and name not in apart]
    if len(names) < _ROW:
        return
    if whole:
        yield Guess("what", label, "whole numbers that repeat; check whether they are objects")
    yield Guess("tap", "row", f"{label} changes from row to row")
    at = [list(columns).index(name) for name in names]
    joined = at == list(range(at[0], at[-1] + 1))
    yield Guess("taxels", f"{at[0]}:{at[-1] + 1}" if joined else names, f"{len(names)} columns of numbers")
    if _smooth(np.stack([as_floats(columns[name]) for name in names], axis=1)):  # pyright: ignore - all are numbers
        yield Guess("axes", "tap,sample", "neighbours are alike: samples of one taxel; without this line, taxels")


def _sample_last(stem: str, counts: Sequence[int]) -> bool:
    """Whether the second of two numbers in names of columns is that of a sample, by a t before it or their counts."""
    before = [part.rstrip("_.-[( ").lower() for part in stem.split("#")[:2]]
    timed = [part.endswith(("t", "time", "sample")) for part in before]
    return timed[1] if timed[0] != timed[1] else counts[1] > counts[0]


def _smooth(rows: NDArray[np.float64]) -> bool:
    """Whether neighbours in a row differ less than others do."""
    return bool(np.nanmean(np.abs(np.diff(rows, axis=1))) < _SMOOTH * np.nanmean(np.abs(rows - np.nanmean(rows))))


def _of_long_table(taxel: str, free: Sequence[str]) -> Iterator[Guess]:
    """The column that tells taxels, and that of values, which is among these."""
    called = [name for name in free if _VALUE.search(plain(name))]
    yield Guess("taxel", taxel, "its name, and rows that repeat its values: a row for each sample of each taxel")
    yield Guess("taxels", [(called or free)[-1]], "a column of values")


def _whole_numbers(columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Taps and objects of a table without a header: whole numbers that repeat, beside others that have decimals."""
    floats = {name: of for name, each in columns.items() if (of := as_floats(each)) is not None}
    rising = [name for name, of in floats.items() if len(of) > _ROW and (np.diff(of) > 0).all()]
    times = [name for name in rising if not only_counts(floats[name])]
    yield from (Guess("time", name, f"{_steps(name, floats[name])}; check whether it is a time") for name in times[:1])
    whole = [name for name, of in floats.items() if is_class(of) or counts(of)]
    if len(whole) == len(floats):
        return
    for key in ("tap", "what"):
        name = next((each for each in whole if key == "what" or counts(floats[each])), None)
        if name is not None:
            whole.remove(name)
            yield Guess(key, name, "whole numbers that repeat; check whether they mean this")


def _named_places(texts: Iterable[str], columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """A column of the names of positions, and these in their order of appearance."""
    for name in [name for name in texts if like("where", plain(name))][:1]:
        yield Guess("where", name, "its name, and texts")
        places = list(dict.fromkeys(columns[name].tolist()))
        yield Guess("where_values", places, "positions in order of appearance; put neighbours side by side")


def _tells_taxel(name: str, values: NDArray[Any]) -> bool:
    """Whether a column tells the taxel of each row of a long table: it repeats few names, or all numbers of a range."""
    if not _TAXEL.fullmatch(plain(name)) or not 1 < len(distinct := np.unique(values)) <= few(values):
        return False
    floats = as_floats(distinct)
    return floats is None or (floats.min() in (0, 1) and set(floats - floats.min()) == set(range(len(floats))))


def _days(time: str, columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """A session for each date of times."""
    if columns[time].dtype.kind == "U":
        days = {found[2] for text in columns[time].tolist() if (found := CLOCK.match(text))} - {None}
        if len(days) > 1:
            yield Guess("session", f"date:{time}", f"times of {len(days)} days")


def _labels_by_name(columns: Mapping[str, NDArray[Any]], numbers: Set[str]) -> dict[str, Guess]:
    """Time, tap and labels among columns, by their names and the number of their values.

    Args:
        columns: Their values.
        numbers: Columns of numbers, also in texts.
    """
    guesses: dict[str, Guess] = {}
    for key, name in ((key, name) for key in WORDS for name in columns):
        each = columns[name]
        if key in guesses or not like(key, plain(name)) or ("time" in guesses and guesses["time"].value == name):
            continue
        distinct, most_few = len(np.unique(each)), few(each)
        most = {"what": most_few, "session": most_few, "where": FEW}.get(key, len(each))
        fits = increases(each) if key == "time" else name in numbers or key in ("what", "session")
        if fits and distinct <= most:
            reason = _steps(name, each) if key == "time" else f"its name, and {distinct} different values"
            guesses[key] = Guess(key, name, reason)
    return guesses


def _of_lists(
    lists: Sequence[str], guesses: Mapping[str, Guess], contents: Contents, values: Mapping[str, NDArray[Any]]
) -> list[Guess]:
    """Which column of lists holds the samples, the axes of its lists, and labels in other lists."""
    shapes = {each: of.shape for each, of in contents.variables.items()}
    name = max(lists, key=lambda each: (len(shapes[each]), re.search(SIGNAL, plain(each), re.IGNORECASE) is not None))
    samples, rank = Guess("taps", name, "lists of numbers"), len(shapes[name])
    if rank == 2 and {"tap", "time"} <= guesses.keys():
        return [*guesses.values(), samples, Guess("axes", "sample,taxel", "a list of taxels for each time")]
    found = [guess for key, guess in guesses.items() if key != "tap"]
    outer = rank - len(TAP_AXES)
    for key in ("what", "where") if outer > 0 else ():
        fitting = [
            each for each, of in shapes.items() if len(of) == outer + 1 and like(key, plain(each.split(".")[-1]))
        ]
        if fitting:
            found = [guess for guess in found if guess.key != key]
            found.append(Guess(key, fitting[0], "its name, and lists as those of taps"))
    axes = [*[key for key in ("session", "what") if outer > 0][:outer], *TAP_AXES]
    if rank == len(axes):
        found.append(Guess("axes", ",".join(axes), f"lists of lists; {CHECK}"))
    return [*found, samples, *([] if name in values else [Guess("length", "longest", "its lists differ in length")])]


def _steps(name: str, values: NDArray[Any]) -> str:
    """How a time increases, and what is doubtful of it."""
    floats = np.zeros(0) if (found := as_floats(values)) is None else found
    steps, clock = np.diff(floats), values.dtype.kind == "U" and seconds_of(values) is not None
    usual = float(np.nanmedian(steps))
    gaps = int(np.count_nonzero((steps <= 0) | (steps > GAP_STEPS * usual)))
    stated = time_unit(name, name_and_unit(name)[1]) or (name if name in UNITS else "")
    unit = "s" if clock else stated or unit_since_1970(floats) or "s"
    doubt = told_of_rate(1 / (usual * UNITS[unit]), unit) if usual > 0 and unit in UNITS else ""
    return f"it increases by {usual:g}{f', with {counted(gaps, "gap")}' if gaps else ''}{f'; {doubt}' if doubt else ''}"


def _other_axis(where: Guess | None, values: Mapping[str, NDArray[Any]]) -> str | None:
    """The column y beside a column x of positions."""
    found = None if where is None else re.fullmatch(r"(.*[./])?x\b(.*)", re.sub("_", " ", where.value), re.IGNORECASE)
    if where is None or found is None:
        return None
    at = found.start(2) - 1
    wanted = f"{where.value[:at]}y{where.value[at + 1 :]}".lower()
    return next((name for name, of in values.items() if name.lower() == wanted and len(np.unique(of)) <= FEW), None)


def _taxels(names: Sequence[str], contents: Contents) -> Guess | None:
    """The largest group of columns of numbers that differ only in their numbers, or are called like signals."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(re.sub(r"\d+", "#", name), []).append(name)
    called = [name for name in names if re.search(SIGNAL, plain(name), re.IGNORECASE)]
    most = max(map(len, groups.values()), default=0)
    large = {stem: members for stem, members in groups.items() if len(members) == most}
    called = _of_one_unit(called, contents)
    if most > 1 and most * len(large) >= len(called):
        members = [name for name in names if re.sub(r"\d+", "#", name) in large]
        stem = next(iter(large)) if len(large) == 1 else _common(list(large))
        reason = f"{f'{len(large)} times ' * (len(large) > 1)}{most} columns numbered alike"
        return Guess("taxels", _pattern(stem, members, contents), reason)
    if called:
        return Guess("taxels", called, "names of signals")
    return Guess("taxels", list(names), "all other columns of numbers") if names else None


def _of_one_unit(names: list[str], contents: Contents) -> list[str]:
    """The columns in the unit of most of them."""
    units = Counter(contents.variables[name].unit for name in names).most_common(1)
    return [name for name in names if contents.variables[name].unit == units[0][0]]


def _common(stems: list[str]) -> str:
    """What stems begin and end with, and a sign for the rest between."""
    begin = "".join(each[0] for each in takewhile(lambda each: len(set(each)) == 1, zip(*stems, strict=False)))
    ends = [stem[len(begin) :][::-1] for stem in stems]
    end = "".join(each[0] for each in takewhile(lambda each: len(set(each)) == 1, zip(*ends, strict=False)))
    return f"{begin}*{end[::-1]}"


def _pattern(stem: str, members: list[str], contents: Contents) -> str | list[str]:
    """A pattern of columns that are called alike, or their names where it stands for others, too."""
    pattern = stem.replace("#", "*")
    exact = [name for name in contents.variables if re.fullmatch(re.escape(pattern).replace(r"\*", ".*"), name)]
    return pattern if exact == members else members


def _all_hold_a_number(texts: NDArray[Any]) -> bool:
    """Whether few different texts have one number each, and all with one unit."""
    distinct = np.unique(texts).tolist()[: FEW + 1]
    found = {None if (each := number_in(text)) is None else each[1] for text in distinct}
    return len(distinct) <= FEW and len(found) == 1 and None not in found
