"""What arrays, columns and names of files are often called, and what numbers are times."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple
from warnings import catch_warnings

import numpy as np
from numpy.typing import NDArray

from ....errors import InputError
from ..formats.contents import Contents, Variable
from ..times import in_seconds

WORDS = {
    "time": r"^(t|time|times|timestamp|stamp|seconds|elapsed.*|zeit|temps|x value)( ?([mun]?s|sec))?$"
    r"|^(ms|us|µs)$|timestamp|log.?time",
    "trial": r"trial|repeat|repetition|\brep\b|attempt|versuch|essai",
    "tap": r"^tap|press(?!ure)|contact ?(id|no|number)|episode|touch ?(id|no|number)|segment|grasp ?(id|no|number)",
    "session": r"session|\bday|date|\brun\b|\b(sub|ses|set)\b|subject|participant|user|sitzung|s[eé]ance"
    r"|^(tag|split|block|sess)$",
    "what": r"what|object|material|texture|class|label|shape|letter|surface|stimulus|category|diameter|item|obje[kc]?t"
    r"|specimen|gesture|^(probe|obj|y)$",
    "where": r"where|position|\bpos\b|location|angle|place|offset|depth|\bx\b|x ?mm|^p$",
}
SIGNAL = (
    r"taxel|signal|sensor|tactile|force|pressure|electrode|pac|pdc|channel|\bch ?\d|fsr|skin|cap|touch|elec|adc|kraft"
)
NAMES = r"name|label|categor|class|object|material"
"""What lists of the names of objects are called."""
_RISING = 0.8
"""Share of the steps of a time that rise; it may begin anew with each tap."""
_RATE = r"fs|f s|(sampl(e|ing) ?)?(rate|freq(uency)?)( ?hz)?|abtastrate"
CLOCK = re.compile(r"((\d{4}-\d\d-\d\d|\d{1,2}\.\d{1,2}\.\d{4})[T _])?\d\d?:\d\d(?=\D)")
TAP_AXES = ("tap", "sample", "taxel")
CHECK = "check which axis is which"
FEW = 200
"""Distinct values of a column that can be labels."""
_ROWS = 8


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
    return re.search(WORDS[key], text, re.IGNORECASE) is not None


def shown(values: Sequence[str]) -> str:
    """The first of some texts."""
    return ", ".join(values[:3]) + (f", ... ({len(values)})" if len(values) > 3 else "")


def as_list(value: Any) -> list[Any]:
    """One value, or several."""
    return list(value) if isinstance(value, list | tuple) else [value]


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


def rate_guess(contents: Contents, values: Mapping[str, NDArray[Any]]) -> Guess | None:
    """A rate that stands in the file: an attribute, or an array or column of one value, that is called so."""
    found = {name: of for name, of in contents.attributes.items() if isinstance(of, float | int)}
    for name, of in values.items():
        floats = as_floats(of.reshape(-1))
        if floats is not None and len(floats) and (floats == floats[0]).all():
            found[name] = float(floats[0])
    for name, value in found.items():
        own = re.split(r"[/.@]", name)[-1]
        if re.fullmatch(_RATE, plain(own), re.IGNORECASE) and np.isfinite(value) and value > 0:
            return Guess("rate", int(value) if value == int(value) else value, f"{name} in the file")
    return None


def as_floats(values: NDArray[Any]) -> NDArray[np.float64] | None:
    """Numbers, also in texts, and times in seconds; `None` of anything else."""
    if values.dtype.kind in "fiu":
        return values.astype(np.float64)
    try:
        return np.where(values == "", "nan", values).astype(np.float64) if values.ndim == 1 else None
    except ValueError:
        return seconds_of(values)


def seconds_of(values: NDArray[Any]) -> NDArray[np.float64] | None:
    """Seconds since the first of texts such as `2024-01-31 10:00:00.25`; `None` of others."""
    if values.ndim != 1 or not values.size or not all(map(CLOCK.match, map(str, values[:FEW].tolist()))):
        return None
    try:
        with catch_warnings(action="error"):  # that numpy does not keep time zones
            times = values.astype("datetime64[ns]")
        return (times - times[0]).astype(np.int64) / 1e9
    except (ValueError, UserWarning):
        pass
    try:
        seconds = in_seconds("time", "", values, "s")
    except InputError:
        return None
    return seconds - seconds[0]


def increases(values: NDArray[Any]) -> bool:
    """Whether numbers or times mostly rise."""
    floats = as_floats(values)
    return floats is not None and len(floats) > 1 and bool((np.diff(floats) > 0).mean() > _RISING)


def indices(called: Mapping[str, Any], values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Values of objects and positions that are finite numbers."""
    names = {key: called[key] for key in ("what", "where") if isinstance(called.get(key), str)}
    index = {key: values[name] for key, name in names.items() if name in values}
    return {key: of for key, of in index.items() if of.dtype.kind in "iuf" and of.size and np.isfinite(of).all()}


def is_class(values: NDArray[Any]) -> bool:
    """Whether these are few whole numbers from 0 or 1."""
    distinct = np.unique(as_floats(values))  # pyright: ignore - they are numbers
    return 1 < len(distinct) <= few(values) and distinct[0] in (0, 1) and bool((np.diff(distinct) == 1).all())


def counts(values: NDArray[np.float64]) -> bool:
    """Whether each of several rows has the same number, and the next ones that after it."""
    return repeats(values) and set(np.diff(values)) == {0.0, 1.0}


def only_counts(values: NDArray[Any]) -> bool:
    """Whether numbers rise by the same step throughout, as those of rows or samples do."""
    floats = as_floats(values)
    steps = np.zeros(0) if floats is None else np.unique(np.diff(floats))
    return len(values) > _ROWS and len(steps) == 1 and steps[0] >= 1


def few(values: NDArray[Any]) -> int:
    """How many different values of so many rows can be labels."""
    return min(FEW, max(2, len(values) // 2))


def repeats(values: NDArray[Any]) -> bool:
    """Whether each value stays the same for three rows or more, on average."""
    return bool(len(values) > 2 * (1 + np.count_nonzero(values[1:] != values[:-1])))
