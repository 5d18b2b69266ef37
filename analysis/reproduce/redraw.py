"""Figures of a reproduction from `results.nc`, as the run drew them."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import xarray as xr

from ...models.grid import ClassGrid
from ..page.figure_confusion import confusion
from ..page.figure_episodes import BeliefCase, beliefs, trajectories
from .figures import acuity_of, contacts, errors_by_fixation, errors_by_position

CASES = "clear", "ambiguous"
NOT_STORED = {"fig3": "it shows single taps, which the file does not hold"}


def stored_figures(groups: Mapping[str, xr.Dataset]) -> dict[str, Callable[[], Any]]:
    """Functions that draw the figures, by name.

    Args:
        groups: Of the file, by path; that of the root is "/".
    """
    about = groups["/"].attrs
    grid = ClassGrid.from_dict(json.loads(about["grid"]))
    clear, ambiguous = (_case(groups[f"examples/{name}"]) for name in CASES)
    found: dict[str, Callable[[], Any]] = {"fig4": partial(beliefs, clear, ambiguous, grid)}
    if "active/by_fixation" in groups:
        found["fig5_passive"] = partial(errors_by_position, groups["passive/by_position"])
        found["fig5_active"] = partial(errors_by_fixation, groups["active/by_fixation"])
    if "active/trajectories" in groups:
        paths = (groups[f"{policy}/trajectories"]["where_index"].values for policy in ("passive", "active"))
        found["fig6"] = partial(trajectories, *paths, grid, int(about["fixation"]))
    curves = {policy: groups[f"{policy}/curve"] for policy in ("passive", "active") if f"{policy}/curve" in groups}
    found["fig7"] = partial(acuity_of, curves, grid)
    if grid.M > 1:
        table = groups["confusion"]
        counts = (table[policy].values if policy in table else None for policy in ("passive", "active"))
        found["confusion"] = partial(confusion, *counts, list(grid.what_name), float(about["theta"]))
    if max(grid.shape) > 1:
        found["contacts"] = partial(contacts, groups["contacts"], grid)
    return found


def _case(group: xr.Dataset) -> BeliefCase:
    true = int(group.attrs["where_true"]), int(group.attrs["what_true"])
    return BeliefCase(group["belief"].values, group["prior"].values, *true)


def case_group(case: BeliefCase) -> xr.Dataset:
    """Beliefs of an example, as the file holds them."""
    dims = ("where", "what")
    return xr.Dataset(
        {"belief": (("tap", *dims), case.beliefs), "prior": (dims, case.prior)},
        attrs={"where_true": int(case.where), "what_true": int(case.what)},
    )
