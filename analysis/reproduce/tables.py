"""Labelled tables of a reproduction."""

import xarray as xr

from ..page.labelled import labelled, with_units
from ..stats.metrics import QUANTITIES
from .headline import curve_rows, difference_rows
from .record import ReproductionSummary
from .results import Results

_CHANGES = {f"{name}{end}": f"{name}_difference{end}" for name in QUANTITIES for end in ("", "_low", "_high")}


def decisions_table(found: Results, summary: ReproductionSummary) -> xr.Dataset:
    """Errors and reaction times of passive and active perception, and passive less active, against the threshold."""
    stored, fresh = (_decisions(curves, summary) for curves in (found.curves, found.fresh_curves))
    fresh = fresh.rename({name: f"fresh_{name}" for name in fresh.data_vars})
    return stored.merge(fresh, join="outer")


def places_table(found: xr.Dataset, dim: str, summary: ReproductionSummary) -> xr.Dataset:
    """Errors and reaction times by place, with the places along another dim."""
    return with_units(found.rename(place=dim).drop_attrs(deep=False), _units(summary))


def _decisions(curves: dict[str, xr.Dataset], summary: ReproductionSummary) -> xr.Dataset:
    units = _units(summary)
    rows = (row for name, curve in curves.items() if name != "difference" for row in curve_rows(name, curve))
    table = labelled(rows, ("policy", "theta"), units)
    if "difference" not in curves:
        return table
    change = labelled(difference_rows(curves["difference"]), ["theta"], units).drop_vars("policy")
    return table.merge(change.rename({name: _CHANGES[str(name)] for name in change.data_vars}))


def _units(summary: ReproductionSummary) -> dict[str, str]:
    return {"what_error": summary["units"]["what"], "where_error": summary["units"]["where"], "taps": "taps"}
