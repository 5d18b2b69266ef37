"""Sentences of a sensitivity study from the numbers of a summary: rules of the verdicts, findings, lists.

Words can be made anew from the numbers of an older study, see `worded`.
"""

import math
from collections import Counter
from collections.abc import Iterator

from ..page.numbers import STORED_ONLY, listed, number
from ..page.page import Row
from ..stats.jackknife import FEWEST_UNITS
from .effects import CLASS_FLOOR, FACTOR_LIMIT, RELEVANT, TAPS_FLOOR

WORDS = {
    "what_error": "object error",
    "where_error": "position error",
    "taps": "taps",
    "factor": "calibration",
}
VERDICTS = {
    "conclusion": "changes the conclusion",
    "numbers": "changes the numbers",
    "not decided": "undecided",
    "nothing": "changes nothing",
}
"""In words, the gravest first."""
_VERDICTS_OF_MANY = {
    "conclusion": "change the conclusion",
    "numbers": "change the numbers",
    "not decided": "are undecided",
    "nothing": "change nothing",
}


def worded(summary: Row) -> Row:
    """The numbers of an older study with present sentences."""
    return {**summary, "rules": rules(), "sources": [worded_source(source) for source in summary["sources"]]}


def worded_source(source: Row) -> Row:
    """The numbers of a source with their words."""
    return {**source, "findings": findings(source), "lists": [*lists_of(source)]}


def rules() -> list[str]:
    """Sentences about the rules of the verdicts."""
    return [
        "The conclusion is that, at the same threshold, active perception has lower object and position errors than "
        "passive perception and takes fewer taps. An option changes the conclusion if one of these advantages is "
        "significant under the defaults but not under the option, and is significantly smaller; “reversed” means that "
        "passive perception is then significantly better. An advantage that loses significance without being "
        "significantly smaller does not count as lost.",
        "An option changes the numbers if an error, a number of taps or the calibration changes significantly and by "
        f"more than the relevance limit: {100 * RELEVANT:g}% of the default's value, and {100 * CLASS_FLOOR:g}% of "
        f"the distance between neighbouring classes or {TAPS_FLOOR:g} taps; for calibration a factor of "
        f"{math.exp(FACTOR_LIMIT):.2f}. It changes nothing if all of them change significantly less than the limit. "
        "Otherwise it is undecided.",
        "Options with lower errors are listed if an error is lower by more than this limit, either significantly or "
        "by its own 95% interval only (some of the latter will be due to chance). Smaller gains are not listed, even "
        "if significant.",
        "Significant means at the 5% level for all intervals of a source together (Bonferroni); intervals in brackets "
        f"are individual 95% intervals. With fewer than {FEWEST_UNITS} units nothing is called significant.",
        "Calibration is P(wrong object) over the mean of 1 − belief (1 if calibrated); its changes are factors. "
        "Trials, positions, objects and random numbers are the same under all options.",
        STORED_ONLY,
        "A trial that meets a tap impossible under every class ends with the belief before that tap.",
        "A dash marks a missing number: no threshold of the option leads to as many taps as the default, or no "
        "decision is wrong and calibration is undefined. A number without brackets has no interval, because it is "
        "undefined when one of the units is left out.",
    ]


def findings(source: Row) -> list[str]:
    """Main findings, in sentences."""
    rows = options_of(source)
    counted = Counter(option["verdict"] for _, option in rows)
    counts = [f"{counted[key]} {words}" for key, words in _VERDICTS_OF_MANY.items()]
    said = [f"Of {len(rows)} options of {len(source['choices'])} choices {', '.join(counts)}."]
    units = source["number_of_units"]
    if units < FEWEST_UNITS:
        said.append(f"With {units} units no verdict is possible; at least {FEWEST_UNITS} are required.")
    elif "active" in source["policies"]:
        said.append(_conclusion(source))
    faultless = [row["policy"] for row in source["default"] if row["what_error"] == 0]
    if faultless:
        said.append(
            f"Under the defaults no {' and no '.join(faultless)} decision is wrong, so options can only increase "
            "errors, and intervals of zero width do not apply to other data."
        )
    said += _near_chance(source)
    for key in ("conclusion", "numbers"):
        names = [choice["name"] for choice in source["choices"] if choice["verdict"] == key]
        if names:
            said.append(f"Choices with an option that {VERDICTS[key]}: {'; '.join(names)}.")
    idle = [choice["name"] for choice in source["choices"] if choice["verdict"] == "nothing"]
    if idle:
        said.append(f"Choices that change nothing under any option: {'; '.join(idle)}.")
    return said


def lists_of(source: Row) -> Iterator[Row]:
    """Options that are too many for a sentence: `key`, `title` and `items` of each list."""
    rows = options_of(source)
    unsure = {f"{name}, {option['name']}": _no_longer_sure(source, option) for name, option in rows}
    if any(unsure.values()):
        yield {
            "key": "unsure",
            "title": "Options under which an advantage of active perception is no longer significant, without being "
            "significantly smaller",
            "items": [f"{name}: {listed(lost)}" for name, lost in unsure.items() if lost],
        }
    titles = {
        "surely": f"Options with {significantly(source)} lower errors than the default, beyond the relevance limit",
        "perhaps": "Options with errors lower beyond this limit by their own 95% interval only (some will be due to "
        "chance)",
    }
    for key, title in titles.items():
        items = [
            f"{name}, {option['name']}: {', '.join(option['better'][key])}"
            for name, option in rows
            if option["better"][key]
        ]
        yield {"key": key, "title": title, "items": items}


def options_of(source: Row) -> list[tuple[str, Row]]:
    """All options of a source with the names of their choices."""
    return [(choice["name"], option) for choice in source["choices"] for option in choice["options"]]


def significantly(source: Row) -> str:
    """The word "significantly", with its scope."""
    return f"significantly ({source['scope']})" if source["scope"] else "significantly"


def _conclusion(source: Row) -> str:
    sure = [WORDS[name] for name in _sure_advantages(source)]
    rest = [WORDS[name] for name in source["advantage"] if WORDS[name] not in sure]
    if not sure:
        return (
            f"Active perception has no {significantly(source)} lower error or number of taps under the defaults, so "
            "no option can change the conclusion."
        )
    start = f"Under the defaults active perception is {significantly(source)} better in {listed(sure)}"
    return start + (f", but not in {listed(rest)}." if rest else ".")


def _near_chance(source: Row) -> Iterator[str]:
    """A sentence for each option under which every policy is as bad as an answer that needs no tap."""
    blind, unit = source["blind_error"], source["what_unit"]
    for name, option in options_of(source):
        errors = {row["policy"]: row["what_error"] + option[f"{row['policy']}_what_error"] for row in source["default"]}
        if blind > 0 and min(errors.values()) >= blind:
            told = listed([f"{number(error)} {policy}" for policy, error in errors.items()])
            yield (
                f"Under {name}, {option['name']}, objects are perceived no better than without touch: the object "
                f"error ({unit}) is {told}, compared with {number(blind)} for always choosing the same object."
            )


def _sure_advantages(source: Row) -> list[str]:
    return [name for name, value in source["advantage"].items() if (value["value_least"] or 0.0) > 0]


def _no_longer_sure(source: Row, option: Row) -> list[str]:
    """The advantages that are sure under the defaults but not under an option that keeps the conclusion."""
    if option["verdict"] == "conclusion":
        return []
    return [WORDS[q] for q in _sure_advantages(source) if not (option[f"advantage_{q}_least"] or 0.0) > 0]
