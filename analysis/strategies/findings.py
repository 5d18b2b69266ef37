"""Findings of a comparison of strategies, in sentences.

Data are those of `summary.summarise`.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from ..experiment.settings import SHOWN_THETA
from ..page.numbers import interval, listed, number
from ..page.page import Row

TAPS = (2, 3, 5, 10)
"""Mean numbers of taps at which strategies are held against each other."""
LOOK = 5
"""Taps after which what was expected of them and miscalibration are looked at."""
PAPER, FIXED = "what", "number of taps"
"""The paper's stopping rule, and the one under which all make the same number of taps."""
INFORMED = ("info-what", "info-joint")
RULES = {PAPER: "At equal mean taps (by threshold)", FIXED: "After equal numbers of taps"}


def source_findings(source: Row) -> list[str]:
    """Findings on one kind of data, in sentences."""
    first = source["powers"][0]
    said = []
    for family, words in RULES.items():
        for quantity, word in (("what_error", "object"), ("where_error", "position")):
            found = (_sure(first["equal"][family], f"{quantity}_difference", sign) for sign in (-1, 1))
            said.append(f"{words}, {_told(f'the {word} error', *map(_named, found))}.")
    ways = {name: _at_theta(first, name)["way"] for name in first["strategies"]}
    far = listed([f"{name} {number(way)}" for name, way in ways.items() if way])
    return [*said, f"Mean travel per decision at threshold {SHOWN_THETA:g}, in {source['where_unit']}: {far}."]


def findings(sources: Sequence[Row]) -> list[str]:
    """Findings across all kinds of data, in sentences; none without data."""
    if not sources:
        return []
    said = [better_finding(sources), *random_findings(sources)]
    for name in INFORMED:
        gains = [
            f"{source['name']} at power {power['power']} {interval(row, 'gain')}"
            for source in sources
            for power in source["powers"]
            for row in power["trust"]
            if row["strategy"] == name
        ]
        said.append(
            f"Difference of P(wrong object) between the fixation point and {name} after {LOOK} taps: "
            f"{'; '.join(gains)}."
        )
    return said


def better_finding(sources: Sequence[Row]) -> str:
    """Whether any strategy has a significantly lower object error than the fixation point, on any data."""
    found = [
        f"{name} on {source['name']}"
        for source in sources
        for name in dict.fromkeys(
            name
            for family in RULES
            for name in _sure(source["powers"][0]["equal"][family], "what_error_difference", -1)
        )
    ]
    subject = f"{listed(found)}:" if found else "No strategy has"
    on = "" if found else " on any of these data"
    return f"{subject} significantly lower object error than the paper's fixation point at equal taps{on}."


def random_findings(sources: Sequence[Row]) -> list[str]:
    """Object error of random moves compared with the fixation point, for each kind of data and both rules."""
    return [
        _random(source["name"], family, source["powers"][0]["equal"][family]) for source in sources for family in RULES
    ]


def _random(name: str, family: str, rows: Sequence[Row]) -> str:
    key = "what_error_difference"
    known = [row for row in rows if row["strategy"] == "random" and row[f"{key}_low"] is not None]
    worse = _taps(row for row in known if (row[f"{key}_least"] or 0.0) > 0)
    perhaps = _taps(row for row in known if row[f"{key}_low"] > 0 >= (row[f"{key}_least"] or 0.0))
    better = _taps(row for row in known if (row[f"{key}_most"] or 0.0) < 0)
    hoped = _taps(row for row in known if row[f"{key}_high"] < 0 <= (row[f"{key}_most"] or 0.0))
    told = (
        (worse, "significantly higher object error at {} taps"),
        (perhaps, "higher object error at {} taps (by individual intervals only)"),
        (better, "significantly lower object error at {} taps"),
        (hoped, "lower object error at {} taps (by individual intervals only)"),
    )
    parts = [words.format(listed(taps)) for taps, words in told if taps]
    where = RULES[family][0].lower() + RULES[family][1:]
    found = ", ".join(parts) or "no significantly different object error"
    return f"{name}, {where}: random moves have {found} than the fixation point."


def _taps(rows: Iterable[Row]) -> list[str]:
    return [str(row["taps"]) for row in rows]


def _sure(rows: Sequence[Row], key: str, sign: int) -> dict[str, list[int]]:
    """Numbers of taps at which strategies surely differ in one direction, by strategy."""
    found: dict[str, list[int]] = {}
    for row in rows:
        end = row[f"{key}_least" if sign > 0 else f"{key}_most"]
        if end is not None and sign * end > 0:
            found.setdefault(row["strategy"], []).append(row["taps"])
    return found


def _named(found: Mapping[str, Sequence[int]]) -> str:
    return listed([f"{name} ({', '.join(map(str, taps))} taps)" for name, taps in found.items()])


def _told(error: str, better: str, worse: str) -> str:
    """Strategies whose error differs significantly from that of the fixation point."""
    if not better and not worse:
        return f"no strategy differs significantly from the fixation point in {error}"
    found = [f"{word} for {names}" for word, names in (("lower", better), ("higher", worse)) if names]
    return f"{error} is significantly {' and '.join(found)} than with the fixation point"


def _at_theta(power: Row, strategy: str) -> Row:
    """The point of the paper's rule at `SHOWN_THETA`."""
    return next(row for row in power["curves"][PAPER][strategy] if math.isclose(row["level"], SHOWN_THETA))
