"""Summary of a sensitivity study: `sensitivity.json`, from which page, table and document are made."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...models.grid import ClassGrid
from ..experiment.settings import SHOWN_THETA
from ..page.figure_style import unit_name
from ..page.numbers import listed, versions
from ..page.page import Row
from ..page.report import TitleRecord
from ..stats.jackknife import Interval, as_factor, as_numbers
from .choices import Choice, Option
from .effects import SUMS, Effect, limits, verdict
from .findings import VERDICTS, WORDS, rules, worded_source
from .run import Sensitivity, SensitivitySettings

_ERRORS = ("what_error", "where_error")
_PACKAGES = ("solidtouch", "numpy", "scipy", "numba", "xarray", "matplotlib")


def summarise(studies: Sequence[Sensitivity], settings: SensitivitySettings, described: TitleRecord) -> Row:
    """Content of `sensitivity.json`."""
    return {
        **described,
        "versions": versions(_PACKAGES),
        "seed": settings.seed,
        "trials": settings.trials,
        "theta": SHOWN_THETA,
        "sources": [worded_source(_source(one)) for one in studies],
        "rules": rules(),
    }


def _source(study: Sensitivity) -> Row:
    """What came out for one source of data, in numbers."""
    limit = limits(study.default, study.source.grid)
    options = [_option(study, index, limit) for index in range(len(study.effects))]
    order = study.strongest_first()
    choices = [_choice(study, choice, index, options) for choice, index in order]
    grid = study.source.grid
    return {
        "name": study.source.name,
        "simulated": study.source.simulated,
        "units": study.source.units,
        "number_of_units": study.source.number_of_units,
        "scope": study.source.scope,
        "policies": list(study.scale.policies),
        "intervals": study.scale.intervals,
        "grid": {"L": grid.L, "M": grid.M},
        "what_unit": grid.what_error_unit,
        "where_unit": unit_name(grid.where_unit),
        "blind_error": blind_error(grid),
        "default": [{**_flat(study.default, policy), "policy": policy} for policy in study.scale.policies],
        "advantage": {name: as_numbers(value) for name, value in study.reference.advantage.items()},
        "limits": {f"{p}_{q}": limit[p, q] for p, q in limit},
        "choices": choices,
        "skipped": [
            {"choice": choice, "option": option, "reason": reason} for choice, option, reason in study.catalogue.skipped
        ],
        "not_run": [
            {"choice": choice.name, "option": name, "reason": reason}
            for choice in study.catalogue.choices
            for name, reason in choice.not_run
        ],
        "pairs": [
            {
                "first": _named(*pair.first),
                "second": _named(*pair.second),
                **as_numbers(pair.beyond, "beyond"),
                **as_numbers(pair.together, "together"),
                "sure": pair.beyond.sure,
            }
            for pair in study.pairs
        ],
        "pair_options": [_named(choice, study.catalogue.options[index][1]) for choice, index in order],
    }


def blind_error(grid: ClassGrid) -> float:
    """Smallest mean object error of a constant answer, for equally frequent objects."""
    what = np.arange(grid.M)
    return float(grid.what_error(what[:, np.newaxis], what).mean(axis=1).min())


def _choice(study: Sensitivity, choice: Choice, strongest: int, options: Sequence[Row]) -> Row:
    """A choice with its options; `verdict_of` names those of the gravest verdict, the strongest first, or all."""
    own = [i for i, (other, _) in enumerate(study.catalogue.options) if other.name == choice.name]
    gravest = next(key for key in VERDICTS if any(options[i]["verdict"] == key for i in own))
    of = [i for i in sorted(own, key=lambda i: -study.strength(i)) if options[i]["verdict"] == gravest]
    return {
        "name": choice.name,
        "paper": choice.paper,
        "record": choice.record,
        "default": choice.default,
        "note": choice.note,
        "strongest": study.catalogue.options[strongest][1].name,
        "verdict": gravest,
        "verdict_of": "all" if 1 < len(of) == len(own) else listed([options[i]["name"] for i in of]),
        "options": [options[i] for i in own],
    }


def _option(study: Sensitivity, index: int, limit: Mapping[tuple[str, str], float]) -> Row:
    _, option = study.catalogue.options[index]
    found, last = study.effects[index], study.scale.policies[-1]
    decided, of = verdict(found, study.reference.advantage, limit)
    shares = study.shares[1 + index][-1]
    changes: dict[str, Any] = {}
    for policy in study.scale.policies:
        changes |= _flat(found.change, policy, f"{policy}_")
    changes |= as_numbers(found.equal_taps[last], "equal_taps")
    for name, one in found.advantage.items():
        changes |= as_numbers(one, f"advantage_{name}")
    return {
        "name": option.name,
        "verdict": decided,
        "of": [" ".join(WORDS.get(word, word) for word in name.split(" ")) for name in of],
        **changes,
        "better": _better(study, found, limit),
        "impossible_taps": study.impossible[index],
        "impossible_trials": float(shares[SUMS.index("impossible")]),
        "stopped": float(shares[SUMS.index("stopped")]),
    }


def _better(study: Sensitivity, found: Effect, limit: Mapping[tuple[str, str], float]) -> Row:
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


def _named(choice: Choice, option: Option) -> Row:
    return {"choice": choice.name, "option": option.name}


def _flat(values: Mapping[tuple[str, str], Interval], policy: str, prefix: str = "") -> dict[str, Any]:
    """Numbers of a policy under made names."""
    flat = {}
    for (p, quantity), value in values.items():
        if p == policy:
            shown = as_factor(value) if quantity == "factor" else value
            flat |= as_numbers(shown, f"{prefix}{quantity}")
    return flat
