"""Active against passive perception at one threshold, in sentences."""

from collections.abc import Iterator, Mapping, Sequence

from ..page.numbers import interval, listed, number
from ..page.page import Row

_NAMES = {"what_error": "object error", "where_error": "position error", "taps": "reaction time"}


def answer(theta: float, stored: Sequence[Row], fresh: Sequence[Row], units: Mapping[str, str]) -> list[str]:
    """The comparison on stored taps and, where there are differences, whether they hold on fresh ones.

    >>> ends = {"what_error_low": 0.4, "what_error_high": 0.6}
    >>> rows = [{"policy": "passive", "what_error": 1.5}, {"policy": "active", "what_error": 1.0},
    ...         {"policy": "passive - active", "what_error": 0.5, **ends}]
    >>> answer(0.9, rows, rows, {"what_error": "mm"})[0]
    'At threshold 0.9, compared with passive perception, active perception has a lower object error (1 against 1.5 mm).'

    Args:
        theta: The threshold.
        stored: Rows of passive, active and their difference on stored taps; without active only that of passive.
        fresh: The same on fresh taps.
        units: Of the quantities that can differ, by name.
    """
    rows = {row["policy"]: row for row in stored}
    if "active" not in rows:
        found = (f"{_an(_NAMES[name])} of {interval(rows['passive'], name)} {unit}" for name, unit in units.items())
        return [f"At threshold {number(theta, 10)}, passive perception has {listed([*map(str.strip, found)])}."]
    clear = {name: _direction(rows["passive - active"], name) for name in units}
    phrases = []
    for name, unit in units.items():
        active, passive = (interval(rows[policy], name) for policy in ("active", "passive"))
        phrases.append(f"{_phrase(name, clear[name])} ({' '.join([active, 'against', passive, unit]).strip()})")
    compared = f"compared with passive perception, active perception has {listed(phrases)}."
    return [
        f"At threshold {number(theta, 10)}, {compared}",
        *_on_fresh({row["policy"]: row for row in fresh}, [name for name in units if clear[name]]),
    ]


def _on_fresh(rows: Mapping[str, Row], names: Sequence[str]) -> Iterator[str]:
    """Whether differences that stored taps show hold where no tap repeats."""
    difference = rows.get("passive - active")
    if difference is None or not names:
        return
    lost = [_NAMES[name] for name in names if not _direction(difference, name)]
    where = "On fresh taps, of which none repeats within a trial,"
    if lost:
        several = len(lost) > 1
        yield f"{where} the difference{'s' * several} in {listed(lost)} {'are' if several else 'is'} not significant."
    else:
        yield f"{where} {'these differences remain' if len(names) > 1 else 'this difference remains'} significant."


def _direction(difference: Row, name: str) -> int:
    """1 where active perception is significantly lower, -1 where it is higher, else 0."""
    low, high = (difference.get(f"{name}_{end}") for end in ("low", "high"))
    if low is None or high is None:
        return 0
    return int(low > 0) - int(high < 0)


def _phrase(name: str, direction: int) -> str:
    if not direction:
        return f"{_an(_NAMES[name])} that does not differ significantly"
    lower, higher = ("shorter", "longer") if name == "taps" else ("lower", "higher")
    return f"a {lower if direction > 0 else higher} {_NAMES[name]}"


def _an(name: str) -> str:
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
