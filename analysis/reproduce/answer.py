"""Active against passive perception at one threshold, in sentences."""

from collections.abc import Iterator, Mapping, Sequence

from ..page.numbers import interval, listed, number
from ..page.page import Row

_NAMES = {"what_error": "object error", "where_error": "position error", "taps": "reaction time"}
_LOST = {
    0: ("is not significant", "are not significant"),
    -1: ("is significant in the opposite direction", "are significant in the opposite direction"),
    None: ("cannot be tested", "cannot be tested"),
}
"""What becomes of differences on fresh taps, of one and of several."""


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
        *_on_fresh({row["policy"]: row for row in fresh}, {name: sign for name, sign in clear.items() if sign}),
    ]


def _on_fresh(rows: Mapping[str, Row], clear: Mapping[str, int]) -> Iterator[str]:
    """Whether differences that stored taps show, with these directions, hold where no tap repeats."""
    difference = rows.get("passive - active")
    if difference is None or not clear:
        return
    now = [(name, sign, _direction(difference, name)) for name, sign in clear.items()]
    phrases = []
    for kind, (of_one, of_several) in _LOST.items():
        lost = [_NAMES[name] for name, sign, fresh in now if (None if fresh is None else sign * fresh) == kind]
        if lost:
            several = len(lost) > 1
            phrases.append(f"the difference{'s' * several} in {listed(lost)} {of_several if several else of_one}")
    remains = "these differences remain significant" if len(clear) > 1 else "this difference remains significant"
    yield f"On fresh taps, of which none repeats within a trial, {listed(phrases) or remains}."


def _direction(difference: Row, name: str) -> int | None:
    """1 where active perception is significantly lower, -1 where it is higher, else 0; `None` without an interval."""
    low, high = (difference.get(f"{name}_{end}") for end in ("low", "high"))
    if low is None or high is None:
        return None
    return int(low > 0) - int(high < 0)


def _phrase(name: str, direction: int | None) -> str:
    if direction is None:
        return f"{_an(_NAMES[name])} whose difference cannot be tested"
    if not direction:
        return f"{_an(_NAMES[name])} that does not differ significantly"
    lower, higher = ("shorter", "longer") if name == "taps" else ("lower", "higher")
    return f"a {lower if direction > 0 else higher} {_NAMES[name]}"


def _an(name: str) -> str:
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"
