"""Labelled tables of a sensitivity study, from its summary."""

from collections.abc import Iterator
from typing import Any

import xarray as xr

from ..page.labelled import distinct, labelled, source_units
from ..page.page import Row

_ENDS = "", "_low", "_high", "_least", "_most"
_CHANGES = {
    "what_error": "what_error_difference",
    "where_error": "where_error_difference",
    "taps": "taps_difference",
    "factor": "factor_ratio",
}


def defaults_table(summary: Row) -> xr.Dataset:
    """Errors, reaction times and miscalibration of the defaults, and what active perception gains on passive."""
    sources = _sources(summary)
    rows = ({"source": name, **row} for name, source in sources.items() for row in source["default"])
    gains = ({"source": name, **_advantages(source)} for name, source in sources.items())
    units = source_units(sources.values())
    return labelled(rows, ("source", "policy"), units).merge(labelled(gains, ["source"], units))


def effects_table(summary: Row) -> xr.Dataset:
    """What each option changes."""
    units = source_units(summary["sources"])
    by_policy = (row for name, source in _sources(summary).items() for row in _policy_rows(name, source))
    by_option = (row for name, source in _sources(summary).items() for row in _option_rows(name, source))
    dims = "source", "choice", "option"
    return labelled(by_policy, (*dims, "policy"), units).merge(labelled(by_option, dims, units))


def pairs_table(summary: Row) -> xr.Dataset:
    """What two options change in the object error together, and beyond the sum of both."""
    rows = (
        {**row, "source": name, "first": _named(row["first"]), "second": _named(row["second"])}
        for name, source in _sources(summary).items()
        for row in source["pairs"]
    )
    unit = source_units(summary["sources"]).get("what_error", "")
    return labelled(rows, ("source", "first", "second"), {"beyond": unit, "together": unit})


def _sources(summary: Row) -> dict[str, Row]:
    """What came out for each source of data, by a name of its own."""
    names = distinct(source["name"] for source in summary["sources"])
    return dict(zip(names, summary["sources"], strict=True))


def _advantages(source: Row) -> dict[str, Any]:
    """What active perception gains on passive under the defaults."""
    gains = {name: dict(of) for name, of in source["advantage"].items()}
    return {f"{name}_advantage{end}": of[f"value{end}"] for name, of in gains.items() for end in _ENDS}


def _options(name: str, source: Row) -> Iterator[tuple[dict[str, str], dict[str, Any]]]:
    """Labels and numbers of every option."""
    for choice in source["choices"]:
        for option in choice["options"]:
            yield {"source": name, "choice": choice["name"], "option": option["name"]}, dict(option)


def _policy_rows(name: str, source: Row) -> Iterator[dict[str, Any]]:
    for labels, option in _options(name, source):
        for policy in source["policies"]:
            values = {
                f"{change}{end}": option[f"{policy}_{quantity}{end}"]
                for quantity, change in _CHANGES.items()
                for end in _ENDS
            }
            yield {**labels, "policy": policy, **values}


def _option_rows(name: str, source: Row) -> Iterator[dict[str, Any]]:
    for labels, option in _options(name, source):
        equal = {f"what_error_at_equal_taps_difference{end}": option[f"equal_taps{end}"] for end in _ENDS}
        gains = {f"{of}_advantage{end}": option[f"advantage_{of}{end}"] for of in source["advantage"] for end in _ENDS}
        shares = {share: option[share] for share in ("impossible_taps", "impossible_trials", "stopped")}
        yield {**labels, "verdict": option["verdict"], **equal, **gains, **shares}


def _named(option: Row) -> str:
    return f"{option['choice']}: {option['option']}"
