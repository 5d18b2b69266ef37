"""What a sensitivity study says in words: the rules of its verdicts, findings and lists, from the numbers of a summary.

Words can be made anew from the numbers of an older study, see `worded`.
"""

import math
from collections import Counter
from collections.abc import Iterator

from ..page.numbers import number
from ..page.words import STORED_ONLY, listed
from ..stats.jackknife import FEWEST_UNITS
from .effects import CLASS_FLOOR, FACTOR_LIMIT, RELEVANT, TAPS_FLOOR
from .record import OptionList, OptionRow, SensitivitySource, SensitivitySummary, SourceNumbers

WORDS = {
    "what_error": "object error",
    "where_error": "position error",
    "taps": "taps",
    "factor": "calibration",
}
VERDICTS = {
    "conclusion": "changes the conclusion",
    "numbers": "changes the numbers",
    "not decided": "not decided",
    "nothing": "changes nothing",
}
"""In words, the gravest first."""
_VERDICTS_OF_MANY = {
    "conclusion": "change the conclusion",
    "numbers": "change the numbers",
    "not decided": "are not decided",
    "nothing": "change nothing",
}


def worded(summary: SensitivitySummary) -> SensitivitySummary:
    """The same numbers, as of an older study, with the words of today."""
    return {**summary, "rules": rules(), "sources": [worded_source(source) for source in summary["sources"]]}


def worded_source(source: SourceNumbers) -> SensitivitySource:
    """The numbers of a source with their words."""
    return {**source, "findings": findings(source), "lists": [*lists_of(source)]}


def rules() -> list[str]:
    """How verdicts come about, in sentences."""
    return [
        "The conclusion is that active perception errs less than passive, in objects and in positions, and takes fewer "
        "taps, at the same threshold. An option changes it where one of these is sure under the defaults, is not sure "
        "under the option, and the advantage is surely smaller; reversed means that passive is surely better then. "
        "Where the advantage is not sure any more but not surely smaller either, it is not shown to be gone.",
        "An option changes the numbers where an error, a number of taps or the calibration surely changes, and by more "
        f"than {100 * RELEVANT:g} % of the default's value and {100 * CLASS_FLOOR:g} % of the distance of neighbouring "
        f"classes or {TAPS_FLOOR:g} taps; calibration by more than a factor of {math.exp(FACTOR_LIMIT):.2f}. "
        "It changes nothing where every one of them surely changes by less. All else is not decided.",
        "Options that err less are listed where an error is lower by more than the same limit: surely, or by the 95 % "
        "interval of this error alone, of which some will be chance. Smaller gains are not listed, however sure.",
        "Sure is what holds for all intervals of a source together with 95 % (Bonferroni); intervals in brackets are "
        f"95 % each. Below {FEWEST_UNITS} units nothing is called sure.",
        "Calibration is P(wrong object) over the mean of 1 - belief, 1 where beliefs are right; its changes are "
        "factors. Trials, places, objects and random numbers are the same under all options.",
        STORED_ONLY,
        "A trial that meets a tap that no class can have given ends there with what it believed before.",
        "A dash stands where there is no number: an option whose thresholds never lead to as many taps as the default "
        "takes, or no wrong decision and so no calibration. A number without brackets has no interval, as it cannot be "
        "told any more when one of the units is left out.",
    ]


def findings(source: SourceNumbers) -> list[str]:
    """What a reader should know first, in sentences."""
    rows = options_of(source)
    counted = Counter(option["verdict"] for _, option in rows)
    counts = [f"{counted[key]} {words}" for key, words in _VERDICTS_OF_MANY.items()]
    said = [f"Of {len(rows)} options of {len(source['choices'])} choices {', '.join(counts)}."]
    units = source["number_of_units"]
    if units < FEWEST_UNITS:
        said.append(
            f"{units} units decide nothing: nothing is called sure here below {FEWEST_UNITS}, however narrow intervals "
            "look."
        )
    elif "active" in source["policies"]:
        said.append(_conclusion(source))
    faultless = [row["policy"] for row in source["default"] if row["what_error"] == 0]
    if faultless:
        said.append(
            f"Under the defaults no {' and no '.join(faultless)} decision is wrong here: options can only do harm, and "
            "intervals of no width say nothing of other data."
        )
    said += _near_chance(source)
    for key in ("conclusion", "numbers"):
        names = [choice["name"] for choice in source["choices"] if choice["verdict"] == key]
        if names:
            said.append(f"Choices of which an option {VERDICTS[key]}: {'; '.join(names)}.")
    idle = [choice["name"] for choice in source["choices"] if choice["verdict"] == "nothing"]
    if idle:
        said.append(f"Choices that change nothing, whatever the option: {'; '.join(idle)}.")
    return said


def lists_of(source: SourceNumbers) -> Iterator[OptionList]:
    """Options that are too many for a sentence: `key`, `title` and `items` of each list."""
    rows = options_of(source)
    unsure = {f"{name}, {option['name']}": _no_longer_sure(source, option) for name, option in rows}
    if any(unsure.values()):
        yield {
            "key": "unsure",
            "title": "Options under which an advantage of active perception is not sure any more, but not surely "
            "smaller either",
            "items": [f"{name}: {listed(lost)}" for name, lost in unsure.items() if lost],
        }
    titles = {
        "surely": f"Options that {surely(source)} err less than the default, by more than the limit of what matters",
        "perhaps": "Options that err less by more than that limit, but by their own 95 % interval only; some will be "
        "chance",
    }
    for key, title in titles.items():
        items = [
            f"{name}, {option['name']}: {', '.join(option['better'][key])}"
            for name, option in rows
            if option["better"][key]
        ]
        yield {"key": key, "title": title, "items": items}


def options_of(source: SourceNumbers) -> list[tuple[str, OptionRow]]:
    """All options of a source with the names of their choices."""
    return [(choice["name"], option) for choice in source["choices"] for option in choice["options"]]


def surely(source: SourceNumbers) -> str:
    """The word, with what it is limited to."""
    return f"surely ({source['scope']})" if source["scope"] else "surely"


def _conclusion(source: SourceNumbers) -> str:
    sure = [WORDS[name] for name in _sure_advantages(source)]
    rest = [WORDS[name] for name in source["advantage"] if WORDS[name] not in sure]
    if not sure:
        return (
            f"Active perception is not {surely(source)} better in anything under the defaults, so no option can change "
            "that."
        )
    start = f"Under the defaults active perception is {surely(source)} better in {listed(sure)}"
    return start + (f", which is not sure of {listed(rest)}." if rest else ".")


def _near_chance(source: SourceNumbers) -> Iterator[str]:
    """A sentence for each option under which every policy is as bad as an answer that needs no tap."""
    blind, unit = source["blind_error"], source["what_unit"]
    for name, option in options_of(source):
        errors = {row["policy"]: row["what_error"] + option[f"{row['policy']}_what_error"] for row in source["default"]}
        if blind > 0 and min(errors.values()) >= blind:
            told = listed([f"{number(error)} {policy}" for policy, error in errors.items()])
            yield (
                f"Objects are told no better than without touching under {name}, {option['name']}: the object error "
                f"({unit}) is {told}, that of always naming the same one {number(blind)}."
            )


def _sure_advantages(source: SourceNumbers) -> list[str]:
    return [name for name, value in source["advantage"].items() if (value["value_least"] or 0.0) > 0]


def _no_longer_sure(source: SourceNumbers, option: OptionRow) -> list[str]:
    """The advantages that are sure under the defaults but not under an option that keeps the conclusion."""
    if option["verdict"] == "conclusion":
        return []
    return [WORDS[q] for q in _sure_advantages(source) if not (option[f"advantage_{q}_least"] or 0.0) > 0]
