"""Guesses what arrays, columns and names of files mean, each with the reason."""

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...cutting.sessions import GAP_STEPS
from .formats.contents import Contents, Variable
from .mapping import LABELS
from .patterns import natural, number_in

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
_NAMES = r"name|label|categor|class|object|material"
_FEW = 200
"""Distinct values of a column that can be labels."""
_BETWEEN = re.compile(r"((?:[/_\s-]|(?<!\d)\.|\.(?!\d))+)")
"""Between words of names of files: no point within a number."""
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

    @property
    def of_names(self) -> bool:
        """Whether it is a field of the names of files, which needs no line of its own."""
        return self.value == f"{{{self.key}}}"


def name_pattern(names: Sequence[str]) -> tuple[str, list[Guess]]:
    """Pattern of the names of files, and what its fields may be; empty where all names are one.

    Names are divided into words and numbers. Where all have equally many and the same letters between them, words that
    differ become fields: sessions by their name or as dates, numbers with a unit positions, other numbers trials, other
    words objects.
    """
    if len(names) < 2:
        return "", []
    parts = [_BETWEEN.split(name) for name in names]
    if len({len(each) for each in parts}) > 1 or any(
        len({each[i] for each in parts}) > 1 for i in range(1, len(parts[0]), 2)
    ):
        return "", []
    words = [tuple(each[i] for each in parts) for i in range(len(parts[0]))]
    varying = [i for i in range(len(words)) if len(set(words[i])) > 1]
    found: dict[tuple[str, ...], Guess] = {}
    for strict in (True, False):
        for n, i in enumerate(varying):
            if words[i] in found:
                continue
            before = words[i - 2][0] if i > 1 and i - 2 not in varying else ""
            taken = {guess.key for guess in found.values()}
            key, reason = _field(words[i], before, taken, last=n == len(varying) - 1, strict=strict)
            if key:
                found[words[i]] = Guess(key, f"{{{key}}}", reason)
    same = {i: re.sub(r"[{}*?]", "?", words[i][0]) for i in range(len(words)) if i not in varying}
    pieces = [found[of].value if of in found else same.get(i, "*") for i, of in enumerate(words)]
    return "".join(pieces), sorted(found.values(), key=lambda guess: pieces.index(guess.value))


def _field(values: Sequence[str], before: str, taken: set[str], *, last: bool, strict: bool) -> tuple[str, str]:
    """Which field words of names may be, and why; empty if none is left.

    What letters, units and dates tell comes first (`strict`); other numbers are the trial if they are the last ones,
    else the position or the session.
    """
    distinct = sorted(set(values), key=natural)
    shown = _shown(distinct)
    hint = before + " " + re.sub(r"\d+", " ", " ".join(distinct[:20]))
    numbers = [number_in(value) for value in distinct]
    units = {each[1] for each in numbers if each is not None}
    letters = {re.sub(r"[\d.,+-]", " ", value).split(" ")[0].lower() for value in distinct}
    wanted: list[tuple[str, str]] = []
    if all(each is not None for each in numbers):
        if letters in ({"s"}, {"d"}):
            wanted.append(("session", shown))
        if letters <= {"t", "r", "n"} and "" not in letters:
            wanted.append(("trial", shown))
        decimals = any("." in value or "," in value for value in distinct)
        if units & {"mm", "cm", "deg", "um", "µm", "m"} or letters == {"p"} or decimals or _like("where", before):
            wanted.append(("where", f"numbers such as {shown}"))
        if _like("session", hint) or all(_DATE.search(value) for value in distinct):
            wanted.insert(0, ("session", shown))
        if not strict:
            others = ["trial", "where", "session"] if last else ["where", "session", "trial"]
            wanted += [(key, f"numbers {shown}") for key in others]
    elif _like("session", hint):
        wanted.append(("session", shown))
    else:
        wanted.append(("what", shown))
    if not strict:
        wanted.append(("what", shown))
    return next(((key, reason) for key, reason in wanted if key not in taken), ("", ""))


def _like(key: str, text: str) -> bool:
    return re.search(_WORDS[key], text, re.IGNORECASE) is not None


def _shown(values: Sequence[str]) -> str:
    return ", ".join(values[:3]) + (f", ... ({len(values)})" if len(values) > 3 else "")


def column_guesses(contents: Contents, values: Mapping[str, NDArray[Any]]) -> list[Guess]:
    """What the columns of a table may mean.

    Args:
        contents: The table.
        values: Its columns that could be read.
    """
    columns = {name: each for name, each in values.items() if each.ndim == 1}
    numeric = {name for name, each in columns.items() if _numbers(each) is not None}
    alike = numeric | {name for name in columns.keys() - numeric if _all_hold_a_number(columns[name])}
    guesses = _labels_by_name(columns, alike)
    if (second := _other_axis(guesses.get("where"), columns)) is not None:
        guesses = {key: guess for key, guess in guesses.items() if guess.value != second}
        guesses["where"] = Guess("where", [guesses["where"].value, second], "the names of two axes of a plane")
    texts = [name for name, each in columns.items() if name not in alike and 1 < len(np.unique(each)) <= _FEW]
    if "what" not in guesses and texts:
        guesses["what"] = Guess("what", texts[0], f"texts, {len(np.unique(columns[texts[0]]))} different ones")
    lists = [name for name, each in contents.variables.items() if len(each.shape) > 1 and _is_number(each)]
    if lists:
        guesses.pop("tap", None)
        return [*guesses.values(), *_of_lists(lists, values)]
    if "tap" not in guesses and "trial" in guesses and _repeats(columns[guesses["trial"].value]):
        guesses["tap"] = Guess("tap", guesses["trial"].value, "its values stay the same for many rows")
    used = {name for guess in guesses.values() for name in _listed(guess.value)}
    taxels = _taxels([name for name in columns if name in numeric and name not in used], contents)
    return [*guesses.values(), *([] if taxels is None else [taxels])]


def _labels_by_name(columns: Mapping[str, NDArray[Any]], numbers: Set[str]) -> dict[str, Guess]:
    """Time, tap and labels among columns, by their names and the number of their values.

    Args:
        columns: Their values.
        numbers: Columns of numbers, also in texts.
    """
    guesses: dict[str, Guess] = {}
    for key, name in ((key, name) for key in _WORDS for name in columns):
        each = columns[name]
        if key in guesses or not _like(key, _plain(name)):
            continue
        distinct, few = len(np.unique(each)), min(_FEW, max(2, len(each) // 2))
        most = {"what": few, "session": few, "where": _FEW}.get(key, len(each))
        fits = _increases(each) if key == "time" else name in numbers or key in ("what", "session")
        if fits and distinct <= most:
            reason = _steps(each) if key == "time" else f"its name, and {distinct} different values"
            guesses[key] = Guess(key, name, reason)
    return guesses


def _of_lists(lists: Sequence[str], values: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Which column of lists holds the samples, and what to do where they differ in length."""
    name = next((name for name in lists if re.search(_SIGNAL, _plain(name), re.IGNORECASE)), lists[0])
    yield Guess("taps", name, "lists of numbers")
    if name not in values:
        yield Guess("length", "longest", "its lists differ in length")


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _steps(values: NDArray[Any]) -> str:
    """How a time increases."""
    steps = np.diff(_numbers(values))  # pyright: ignore - it is one of numbers
    usual = float(np.median(steps))
    gaps = int(np.count_nonzero((steps <= 0) | (steps > GAP_STEPS * usual)))
    return f"it increases by {usual:g}" + (f", with {gaps} gap{'s' * (gaps != 1)}" if gaps else "")


def _other_axis(where: Guess | None, values: Mapping[str, NDArray[Any]]) -> str | None:
    """The column y beside a column x of positions."""
    if where is None or not re.match(r"x\b", _plain(where.value), re.IGNORECASE):
        return None
    wanted = f"y{where.value[1:]}".lower()
    return next((name for name, of in values.items() if name.lower() == wanted and len(np.unique(of)) <= _FEW), None)


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
    name = max(variables, key=lambda each: (_is_number(variables[each]), size_of(variables[each])))
    signal = variables[name]
    axis = _axis_of_vectors(signal, variables)
    length, rank = signal.shape[axis] if signal.shape else None, len(signal.shape)
    vectors = [each for each, of in variables.items() if each != name and length and _length(of) == length]
    times = [each for each in vectors if _like("time", _plain(each))]
    found = [Guess("taps", name, "the largest array of numbers")]
    if rank == 2 and axis == 0 and times and _increases(values.get(times[0], np.zeros(1))):
        found.append(Guess("time", times[0], f"its name, and one rising value for each of {length} rows"))
        found.append(Guess("axes", "sample,taxel", "as each row has a time"))
    elif rank != 3 or axis:
        found.append(Guess("axes", _axes(rank, axis), f"shape {shape_of(signal)}; check which axis is which"))
    if None in signal.shape[1:]:
        found.append(Guess("length", "longest", "its elements differ in length"))
    for key in LABELS:
        fitting = [each for each in vectors if _like(key, _plain(each)) and each not in times]
        if fitting:
            found.append(Guess(key, fitting[0], f"its name, and one value for each of {length} taps"))
    keys = {guess.key for guess in found}
    if "what" not in keys and len(vectors) == 1:
        found.append(Guess("what", vectors[0], f"the only array with one value for each of {length} taps"))
    return _in_groups([*found, *_tables(found, contents, values)], contents)


def _tables(found: Sequence[Guess], contents: Contents, values: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """Names of objects that indices refer to, and positions where indices count from 1."""
    variables, called = contents.variables, {guess.key: guess.value for guess in found}
    index = {key: values[called[key]] for key in ("what", "where") if called.get(key) in values}
    index = {key: of for key, of in index.items() if of.dtype.kind in "iuf" and of.size and np.isfinite(of).all()}
    if "what" not in index:
        return
    low, top = int(index["what"].min()), int(index["what"].max())
    texts = {name: of.shape[0] for name, of in variables.items() if of.dtype.kind == "U" and of.shape}
    names = [name for name, n in texts.items() if n in (top, top + 1) and re.search(_NAMES, name, re.IGNORECASE)]
    if not names:
        return
    yield Guess("what_names", names[0], "as many texts as objects")
    if low != 1 or texts[names[0]] != top:
        return
    yield Guess("one_based", True, f"{called['what']} runs from 1 to {top}")
    if "where" in index and index["where"].min() == 1:
        others = [name for name, of in variables.items() if name != called["where"] and _is_number(of)]
        fitting = [name for name in others if size_of(variables[name]) == index["where"].max()]
        places = [name for name in fitting if _like("where", _plain(name))]
        yield from (Guess("where_values", name, "as many numbers as positions") for name in places[:1])


def _axis_of_vectors(signal: Variable, variables: Mapping[str, Variable]) -> int:
    """The axis that is as long as most of the arrays with one axis: that of taps."""
    lengths = [length for of in variables.values() if of.shape and (length := _length(of)) is not None]
    counts = [lengths.count(n) if n and n > 1 else 0 for n in signal.shape]
    return int(np.argmax(counts)) if counts else 0


def _length(variable: Variable) -> int | None:
    """Number of values of an array with one axis, or with others of length 1; `None` of another one."""
    size = size_of(variable)
    return size if size == max((n or 1 for n in variable.shape), default=1) else None


def _axes(rank: int, axis: int) -> str:
    """Axes of so many, where this is that of taps."""
    if rank > 4:
        return ",".join([*("what", "where", "trial", "session")[: rank - 2], "sample", "taxel"])
    if rank == 1:
        return "sample"
    rest = {2: ["sample"], 3: ["sample", "taxel"], 4: ["what", "sample", "taxel"]}.get(rank, [])
    at = axis or int(len(rest) == 3)
    return ",".join([*rest[:at], "tap", *rest[at:]])


def _in_groups(found: list[Guess], contents: Contents) -> list[Guess]:
    """The same for all groups whose names differ in one number, which becomes a field."""
    taps = found[0].value
    for number in re.finditer(r"\d+", taps):
        before, after = taps[: number.start()], taps[number.end() :]
        called = re.compile(re.escape(before) + r"\d+" + re.escape(after))
        rank = len(contents.variables[taps].shape)
        alike = [each for each, of in contents.variables.items() if called.fullmatch(each) and len(of.shape) == rank]
        if len(alike) < 2:
            continue
        word = re.split(r"[/_.\s-]", before.rstrip("/_.- "))[-1]
        key = next((key for key in ("trial", "where", "session") if _like(key, word)), "session")
        here = taps[: number.end()]
        changed = [
            guess._replace(value=f"{before}{{{key}}}{guess.value[len(here) :]}")
            if isinstance(guess.value, str) and guess.value.startswith(here)
            else guess
            for guess in found
            if guess.key != key
        ]
        changed[0] = changed[0]._replace(reason=f"{len(alike)} large arrays of numbers, called alike")
        return changed
    return found


def shape_of(variable: Variable) -> str:
    """Shape in print, such as `40 x ?`; empty for one number."""
    return " x ".join("?" if n is None else str(n) for n in variable.shape)


def _is_number(variable: Variable) -> bool:
    return variable.dtype.kind in "fiu"


def size_of(variable: Variable) -> int:
    """Number of values, as far as the lengths of the axes are known."""
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


def _all_hold_a_number(texts: NDArray[Any]) -> bool:
    """Whether few different texts have one number each, and all with one unit."""
    distinct = np.unique(texts).tolist()[: _FEW + 1]
    found = {None if (each := number_in(text)) is None else each[1] for text in distinct}
    return len(distinct) <= _FEW and len(found) == 1 and None not in found


def _increases(values: NDArray[Any]) -> bool:
    numbers = _numbers(values)
    return numbers is not None and len(numbers) > 1 and bool((np.diff(numbers) > 0).mean() > 0.9)


def _repeats(values: NDArray[Any]) -> bool:
    return bool(len(values) > 2 * (1 + np.count_nonzero(values[1:] != values[:-1])))
