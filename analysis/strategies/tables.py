"""Labelled tables of a comparison of strategies, from its summary."""

from collections.abc import Iterator, Mapping
from typing import Any

import xarray as xr

from ..page.labelled import distinct, labelled, source_units
from ..page.page import Row

_LEVELS = {"theta": "theta", "taps": "number_of_taps", "cost": "cost"}
_TRUST = {"expected": "nats", "told": "nats", "excess": "nats", "base_excess": "nats"}
_REGRET = {"tap_cost": "mm", "cost": "mm", "regret": "mm", "more": "mm"}


def curves_tree(summary: Row) -> xr.DataTree:
    """Errors, reaction times and distances of every strategy at every level of the stopping rules."""
    units = source_units(summary["sources"])
    groups = {}
    for parameter, level in _LEVELS.items():
        rows = [
            {**labels, "rule": family["name"], "strategy": name, **dict(point), level: point["level"]}
            for labels, power in _powers(summary)
            for family in power["families"]
            if family["parameter"] == parameter
            for name, points in power["curves"][family["name"]].items()
            for point in points
        ]
        if rows:
            table = labelled(rows, ("source", "power", "rule", "strategy", level), units)
            groups[parameter] = table.drop_vars("level")
    return xr.DataTree.from_dict(groups)


def equal_taps_table(summary: Row) -> xr.Dataset:
    """Strategies at equal mean numbers of taps, and their differences from the fixation point."""
    rows = (
        {**labels, "rule": rule, **row}
        for labels, power in _powers(summary)
        for rule, of in power["equal"].items()
        for row in of
    )
    return labelled(rows, ("source", "power", "rule", "strategy", "taps"), source_units(summary["sources"]))


def at_threshold_table(summary: Row) -> xr.Dataset:
    """Reaction times and distances at the shown threshold, and their differences from the fixation point."""
    rows = ({**labels, **row} for labels, power in _powers(summary) for row in power["shown"])
    table = labelled(rows, ("source", "power", "strategy"), source_units(summary["sources"]))
    return table.assign_attrs(theta=summary["theta"])


def rules_table(summary: Row) -> xr.Dataset:
    """Stopping rules with the fixation point at equal mean numbers of taps, and their differences from the paper's."""
    rows = ({**labels, **row} for labels, power in _powers(summary) for row in power["rules"])
    return labelled(rows, ("source", "power", "rule", "taps"), source_units(summary["sources"]))


def trust_table(summary: Row) -> xr.Dataset:
    """Miscalibration and information after some taps."""
    rows = ({**labels, **row} for labels, power in _powers(summary) for row in power["trust"])
    return labelled(rows, ("source", "power", "strategy"), _TRUST)


def regret_table(summary: Row) -> xr.Dataset | None:
    """Cost of strategies and rules, and its excess over that of the exact rule or a bound."""
    if summary["regret"] is None:
        return None
    rows = (
        {"case": f"{case['name']}, {'exact' if case['exact'] else 'bound'}", "tap_cost": case["tap_cost"], **row}
        for case in summary["regret"]["cases"]
        for row in case["prices"]
    )
    return labelled(rows, ("case", "tap_cost", "strategy", "kind"), _REGRET).drop_vars("shown")


def _powers(summary: Row) -> Iterator[tuple[Mapping[str, Any], Row]]:
    """Labels and results of every root of the likelihood on all data."""
    names = distinct(source["name"] for source in summary["sources"])
    for name, source in zip(names, summary["sources"], strict=True):
        for power in source["powers"]:
            yield {"source": name, "power": power["power"]}, power
