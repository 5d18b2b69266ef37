"""A sensitivity study in numbers and sentences: `sensitivity.json`, from which page, table and document are made."""

import math
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from .figure_style import short_unit
from .open_choices import Choice, Option
from .open_effects import CLASS_FLOOR, FACTOR_LIMIT, RELEVANT, SUMS, TAPS_FLOOR, Effect, Interval, limits, verdict
from .sensitivity import Sensitivity, SensitivitySettings
from .study import SHOWN_THETA

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
_BETTER = {
    "surely": "Options that surely err less than the default",
    "perhaps": "Options that err less by their own 95 % interval only, of which some will be chance",
}
_ERRORS = ("what_error", "where_error")
_PACKAGES = ("solidtouch", "numpy", "scipy", "numba", "xarray", "matplotlib")


def summarise(
    studies: Sequence[Sensitivity], settings: SensitivitySettings, described: Mapping[str, Any]
) -> dict[str, Any]:
    """What `sensitivity.json` holds.

    Args:
        studies: One for each source of data.
        settings: What was asked for.
        described: `title` and `command`.
    """
    return {
        **described,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
        "seed": settings.seed,
        "trials": settings.trials,
        "theta": SHOWN_THETA,
        "rules": rules(),
        "sources": [summarise_source(one) for one in studies],
    }


def rules() -> list[str]:
    """How verdicts come about, in sentences."""
    return [
        "The conclusion is that active perception errs less than passive, in objects and in positions, and takes fewer "
        "taps, at the same threshold. An option changes it where one of these is sure under the defaults, is not sure "
        "under the option, and the advantage is surely smaller.",
        "An option changes the numbers where an error, a number of taps or the calibration surely changes, and by more "
        f"than {100 * RELEVANT:g} % of the default's value and {100 * CLASS_FLOOR:g} % of the distance of neighbouring "
        f"classes or {TAPS_FLOOR:g} taps; calibration by more than a factor of {math.exp(FACTOR_LIMIT):.2f}. "
        "It changes nothing where every one of them surely changes by less. All else is not decided.",
        "Sure is what holds for all intervals of a source together with 95 % (Bonferroni); intervals in brackets are "
        "95 % each. Calibration is P(wrong object) over the mean of 1 - belief, 1 where beliefs are right; its changes "
        "are factors. Trials, places, objects and random numbers are the same under all options.",
        "A trial that meets a tap that no class can have given ends there with what it believed before.",
    ]


def summarise_source(study: Sensitivity) -> dict[str, Any]:
    """What came out for one source of data."""
    limit = limits(study.default, study.source.grid)
    options = [_option(study, index, limit) for index in range(len(study.effects))]
    order = study.strongest_first()
    choices = [_choice(study, choice, index, options) for choice, index in order]
    grid = study.source.grid
    summary = {
        "name": study.source.name,
        "simulated": study.source.simulated,
        "units": study.source.units,
        "policies": list(study.scale.policies),
        "intervals": study.scale.intervals,
        "grid": {"L": grid.L, "M": grid.M},
        "what_unit": grid.what_error_unit,
        "where_unit": short_unit(grid.where_unit),
        "default": [_flat(study.default, policy) | {"policy": policy} for policy in study.scale.policies],
        "advantage": {name: _interval(value) for name, value in study.reference.advantage.items()},
        "limits": {f"{p}_{q}": limit[p, q] for p, q in limit},
        "choices": choices,
        "skipped": [dict(zip(("choice", "option", "reason"), row, strict=True)) for row in study.catalogue.skipped],
        "not_run": [
            {"choice": choice.name, "option": name, "reason": reason}
            for choice in study.catalogue.choices
            for name, reason in choice.not_run
        ],
        "pairs": [
            {
                "first": _named(*pair.first),
                "second": _named(*pair.second),
                **_interval(pair.beyond, "beyond"),
                **_interval(pair.together, "together"),
                "sure": pair.beyond.sure,
            }
            for pair in study.pairs
        ],
        "pair_options": [_named(choice, study.catalogue.options[index][1]) for choice, index in order],
    }
    return summary | {"findings": findings(summary)}


def findings(source: Mapping[str, Any]) -> list[str]:
    """What a reader should know first, in sentences."""
    rows = [(choice["name"], option) for choice in source["choices"] for option in choice["options"]]
    counted = Counter(option["verdict"] for _, option in rows)
    counts = [f"{counted[key]} {words}" for key, words in _VERDICTS_OF_MANY.items()]
    said = [f"Of {len(rows)} options of {len(source['choices'])} choices {', '.join(counts)}."]
    if "active" in source["policies"]:
        said.append(_conclusion(source))
    faultless = [row["policy"] for row in source["default"] if row["what_error"] == 0]
    if faultless:
        said.append(
            f"Under the defaults no {' and no '.join(faultless)} decision is wrong here: options can only do harm, and "
            "intervals of no width say nothing of other data."
        )
    unsure = [f"{name}, {option['name']}" for name, option in rows if _no_longer_sure(source, option)]
    if unsure:
        said.append(
            f"Under {len(unsure)} more an advantage of active perception is no longer sure, but not surely smaller: "
            f"{'; '.join(unsure)}."
        )
    for key in ("conclusion", "numbers"):
        names = [choice["name"] for choice in source["choices"] if choice["verdict"] == key]
        if names:
            said.append(f"Choices of which an option {VERDICTS[key]}: {'; '.join(names)}.")
    idle = [choice["name"] for choice in source["choices"] if choice["verdict"] == "nothing"]
    if idle:
        said.append(f"Choices that change nothing, whatever the option: {'; '.join(idle)}.")
    for key, start in _BETTER.items():
        better = [
            f"{name}, {option['name']} ({', '.join(option['better'][key])})"
            for name, option in rows
            if option["better"][key]
        ]
        said.append(f"{start}: {'; '.join(better) or 'none'}.")
    return said


def _conclusion(source: Mapping[str, Any]) -> str:
    sure = [WORDS[name] for name, value in source["advantage"].items() if (value["value_least"] or 0.0) > 0]
    rest = [WORDS[name] for name in source["advantage"] if WORDS[name] not in sure]
    if not sure:
        return "Active perception is not surely better in anything under the defaults, so no option can change that."
    start = f"Under the defaults active perception is surely better in {listed(sure)}"
    return start + (f", which is not sure of {listed(rest)}." if rest else ".")


def _no_longer_sure(source: Mapping[str, Any], option: Mapping[str, Any]) -> bool:
    """Whether an advantage that is sure under the defaults is not under an option that keeps the conclusion."""
    sure = [name for name, value in source["advantage"].items() if (value["value_least"] or 0.0) > 0]
    return option["verdict"] != "conclusion" and any(not (option[f"advantage_{q}_least"] or 0.0) > 0 for q in sure)


def listed(names: Sequence[str]) -> str:
    """Names with commas and an "and"."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _choice(study: Sensitivity, choice: Choice, strongest: int, options: Sequence[dict[str, Any]]) -> dict[str, Any]:
    own = [row for (other, _), row in zip(study.catalogue.options, options, strict=True) if other.name == choice.name]
    return {
        "name": choice.name,
        "paper": choice.paper,
        "record": choice.record,
        "default": choice.default,
        "strongest": study.catalogue.options[strongest][1].name,
        "verdict": next(key for key in VERDICTS if any(row["verdict"] == key for row in own)),
        "options": own,
    }


def _option(study: Sensitivity, index: int, limit: Mapping[tuple[str, str], float]) -> dict[str, Any]:
    _, option = study.catalogue.options[index]
    found, last = study.effects[index], study.scale.policies[-1]
    decided, of = verdict(found, study.reference.advantage, limit)
    shares = study.shares[1 + index][-1]
    return {
        "name": option.name,
        "verdict": decided,
        "of": [_quantity(name) for name in of],
        **{
            key: value
            for policy in study.scale.policies
            for key, value in _flat(found.change, policy, f"{policy}_").items()
        },
        **_interval(found.equal_taps[last], "equal_taps"),
        **{
            key: value
            for name, one in found.advantage.items()
            for key, value in _interval(one, f"advantage_{name}").items()
        },
        "better": _better(study, found, limit),
        "impossible_taps": study.impossible[index],
        "impossible_trials": float(shares[SUMS.index("impossible")]),
        "stopped": float(shares[SUMS.index("stopped")]),
    }


def _better(study: Sensitivity, found: Effect, limit: Mapping[tuple[str, str], float]) -> dict[str, list[str]]:
    """What an option does better than the default by more than does not matter, surely or by its own interval only."""
    last = study.scale.policies[-1]
    errors = {(p, q): change for (p, q), change in found.change.items() if q in _ERRORS}
    told = {f"{p} {WORDS[q]}": (change, limit[p, q]) for (p, q), change in errors.items()}
    told[f"{last} object error at equal taps"] = found.equal_taps[last], limit[last, "what_error"]
    large = {name: change for name, (change, bound) in told.items() if change.value < -bound}
    more = " with more taps" if found.change[last, "taps"].low > 0 else ""
    words = {name: name if name.endswith("equal taps") or last not in name else name + more for name in large}
    return {
        "surely": [words[name] for name, change in large.items() if change.most < 0],
        "perhaps": [words[name] for name, change in large.items() if change.most >= 0 > change.high],
    }


def _quantity(name: str) -> str:
    """`active what_error` or `what_error reversed` in words."""
    return " ".join(WORDS.get(word, word) for word in name.split(" "))


def _named(choice: Choice, option: Option) -> dict[str, str]:
    return {"choice": choice.name, "option": option.name}


def _flat(values: Mapping[tuple[str, str], Interval], policy: str, prefix: str = "") -> dict[str, float | None]:
    flat: dict[str, float | None] = {}
    for (p, quantity), value in values.items():
        if p == policy:
            shown = Interval(*map(_exp, value)) if quantity == "factor" else value
            flat |= _interval(shown, f"{prefix}{quantity}")
    return flat


def _exp(value: float) -> float:
    """Infinity where a float cannot hold it, as intervals of very few units have such ends."""
    with np.errstate(over="ignore"):
        return float(np.exp(value))


def _interval(value: Interval, name: str = "value") -> dict[str, float | None]:
    """The five numbers under names that pages know; `None` where there is none."""
    ends = ("", "_low", "_high", "_least", "_most")
    return {f"{name}{end}": x if math.isfinite(x) else None for end, x in zip(ends, value, strict=True)}
