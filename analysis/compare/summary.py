"""Summary of a comparison: `summary.json`, from which the page and the printed table are made.

A number that is missing is `None`, an infinite one a word.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import xarray as xr

from ...models.measurement.model import BINS
from ...models.measurement.registry import row
from ..experiment.settings import SHOWN_THETA
from ..page.figure_style import unit_name
from ..page.labelled import rows
from ..page.numbers import factor, listed, versions
from ..page.page import Row
from ..stats.decisions import decision_interval_sentence, too_few_taps
from ..stats.no_class_left import no_class_left_sentence
from .classes import class_interval_sentence
from .ranking import best_rows, headline, levels, point_fits, rank_rows
from .run import CompareSettings, Comparison

_PACKAGES = ("solidtouch", "numpy", "scipy", "jax", "numpyro", "arviz", "arviz-stats", "xarray", "matplotlib")
_CLASS_SCORES = (
    "log_score_joint",
    "log_score_what",
    "brier_what",
    "calibration_what",
    "calibration_where",
    "accuracy_joint",
    "accuracy_where",
    "accuracy_what",
    "no_class_left",
)
_DECISIONS = (
    "what_error",
    "where_error",
    "taps",
    "stopped_fraction",
    "used_up",
    "no_class_left",
    "what_wrong",
    "miscalibration",
)


def summarise(comparison: Comparison, settings: CompareSettings, described: Row) -> Row:
    """Content of `summary.json`."""
    grid = comparison.grid
    names = list(comparison.fits)
    ranked = levels(comparison)
    return {
        **described,
        "versions": versions(_PACKAGES),
        "seed": settings.seed,
        "reference": names[0],
        "grid": {"L": grid.L, "M": grid.M, "unit": unit_name(grid.where_unit)},
        "units": {"what": grid.what_error_unit, "where": unit_name(grid.where_unit)},
        "test_taps": comparison.test_taps,
        "models": [_model(comparison, name, settings.fit.power) for name in names],
        "refused": [{"name": name, "reason": reason} for name, reason in comparison.refused.items()],
        "unit": settings.leave_out,
        "groups": comparison.groups,
        "warnings": [
            *described["warnings"],
            *([comparison.groups] if comparison.left_out_groups is None else []),
            *too_few_taps(comparison.curves, _shown(comparison.curves)),
            *_no_class_left(comparison),
            *_alone(names),
            *_measures(comparison),
            *_points(comparison.left_out_groups),
            *comparison.missing,
            *(warning for fit in comparison.fits.values() if (warning := fit.convergence.warning)),
        ],
        "taps": _taps(comparison),
        "contacts": [int(n) for n in comparison.classes["contacts"].values],
        "classes": _rows(comparison.classes, "contacts", names=_CLASS_SCORES),
        "class_interval": class_interval_sentence(),
        "decisions": _rows(comparison.curves, "policy", "theta", names=_DECISIONS),
        "shown_theta": _shown(comparison.curves),
        "equal_taps": _rows(comparison.equal, "policy", "taps", names=("what_error", "where_error", "what_wrong")),
        "decision_interval": decision_interval_sentence(comparison.curves),
        "checks": _checks(comparison.checks),
        "levels": [{"title": level.title, "unit": level.unit} for level in ranked],
        "ranks": rank_rows(ranked, names),
        "headline": headline(ranked, names[0]),
        "best": best_rows(ranked, names[0]),
        "overconfident": overconfident(comparison.curves),
        "trials": settings.trials,
        "draws": settings.draws,
        "elapsed_s": comparison.elapsed_s,
    }


def _no_class_left(comparison: Comparison) -> list[str]:
    """A sentence for each model of which test taps left no class."""
    left = comparison.curves["no_class_left"].max(("policy", "theta"))
    return [
        f"{name}: {no_class_left_sentence(share, comparison.fits[name].model)}"
        for name in comparison.fits
        if (share := float(left.sel(model=name))) > 0
    ]


def overconfident(curves: xr.Dataset) -> str:
    """A sentence on models whose decisions are wrong more often than their beliefs imply, if there are any.

    Named are those whose whole interval of the miscalibration factor at the shown threshold is above 1.
    """
    theta, said = _shown(curves), []
    keys = ("miscalibration", "miscalibration_low", "miscalibration_high")
    for policy in reversed(curves["policy"].values.tolist()):
        at = curves.sel(policy=policy, theta=theta)
        ends = {name: tuple(float(at[key].sel(model=name)) for key in keys) for name in at["model"].values}
        above = sorted((name for name in ends if ends[name][1] > 1), key=lambda name: -ends[name][0])
        models = [f"{name} ({factor(ends[name], ends[name][0] == np.inf)} times)" for name in above]
        if models:
            said.append(f"{policy} with {listed(models)}")
    if not said:
        return ""
    return (
        f"Overconfident: decisions at threshold {theta:g} are wrong more often than the beliefs imply: "
        f"{'; '.join(said)}. Intervals hold for each model alone."
    )


def _alone(names: Sequence[str]) -> list[str]:
    """A sentence if no second model could be fitted."""
    return [f"Only one model, {names[0]}, could be fitted, so nothing is compared."] if len(names) == 1 else []


def _model(comparison: Comparison, name: str, power: str | float) -> Row:
    relaxes, how = row(name)
    fitted = comparison.fits[name]
    return {
        "name": name,
        "relaxes": relaxes,
        "how": how,
        "fit": fitted.convergence.sentence,
        "converged": fitted.convergence.converged,
        "seconds": comparison.seconds[name],
        "power": comparison.learned.get(name, f"{power} ({fitted.model.exponent:.3g})"),
        "states": len(fitted.model.states.gain),
    }


def _taps(comparison: Comparison) -> list[Row]:
    means, single, stacking = comparison.left_out_groups, comparison.left_out_taps, comparison.stacking
    found: dict[str, dict[str, Any]] = {name: {"name": name} for name in comparison.fits}
    if means is not None:
        for row in _rows(means):
            found[row["name"]] |= row
        for name, row in () if stacking is None else stacking.iterrows():
            found[name] |= {"weight": float(row["weight"])}
    if single is not None:
        for name in map(str, single["model"].values):
            found[name] |= _single(single.sel(model=name))
    return list(found.values())


def _single(left_out: xr.Dataset) -> Row:
    """Leave-one-tap-out; importance sampling counts only where it works for every tap."""
    looked_at = left_out["looked_at"].values.astype(bool)
    k = left_out["pareto_k"].values[looked_at]
    bad = float((~(k <= float(left_out["good_k"]))).mean())  # a k that is NaN is not good
    found = {"psis": left_out["psis"].values.mean(), "bad_k": bad, "good_k": left_out["good_k"]}
    exact = (name for name in ("exact", "exact_plug_in") if name in left_out and np.isfinite(left_out[name]).all())
    found |= {name: left_out[name].mean() for name in exact}
    counted = {"psis_taps": int(looked_at.sum()), "psis_ranks": bool(looked_at.all()) and bad == 0.0}
    return {name: _number(value) for name, value in found.items()} | counted


def _measures(comparison: Comparison) -> list[str]:
    """A warning where models are not on one measure."""
    by = {name: fit.model.measure for name, fit in comparison.fits.items()}
    others = [name for name, measure in by.items() if measure != BINS]
    if not others:
        return []
    are = "gives densities" if len(others) == 1 else "give densities"
    told = f"{', '.join(others)} {are} of samples, taken times the widths of bins"
    if len(others) == len(by):
        return [f"{told}; scores are not probabilities of bins."]
    return [
        f"{told}; the other models give probabilities of bins. Scores of taps compare them only as far as densities "
        "are flat within a bin; classes and decisions are compared in any case."
    ]


def _points(means: xr.Dataset | None) -> list[str]:
    """A warning where some models have a posterior to integrate over and others none."""
    points = [] if means is None else point_fits(means)
    if means is None or len(points) in {0, means.sizes["model"]}:
        return []
    have = "has" if len(points) == 1 else "have"
    return [
        f"{', '.join(points)} {have} a single value for each parameter and no posterior, so all models are ranked by "
        "plug-in parameters; integrated scores favour models with a posterior."
    ]


def _checks(checks: xr.Dataset | None) -> list[Row]:
    if checks is None:
        return []
    return [
        {
            "statistic": str(check["label"].values),
            "assumption": str(check["assumption"].values),
            "observed": float(check["observed"]),
            "models": [
                {
                    "name": str(name),
                    "replicated": _number(check["replicated"].sel(model=name).mean()),
                    "p": _number(check["p"].sel(model=name)),
                }
                for name in check["model"].values
            ],
        }
        for check in (checks.sel(statistic=statistic) for statistic in checks["statistic"].values)
    ]


def _shown(curves: xr.Dataset) -> float:
    """The threshold nearest to .95."""
    thetas = curves["theta"].values
    return float(thetas[np.abs(thetas - SHOWN_THETA).argmin()])


def _rows(data: xr.Dataset, *dims: str, names: Iterable[str] | None = None) -> list[Row]:
    """A row per label of these dimensions and model, with bounds and differences of the named quantities or of all."""
    endings = ("", "_low", "_high", "_difference", "_difference_low", "_difference_high")
    wanted = data.data_vars if names is None else [n + e for n in names for e in endings if n + e in data]
    found = rows(data[[*wanted]].rename(model="name"), *dims, "name")
    return [{key: value if key in (*dims, "name") else _number(value) for key, value in row.items()} for row in found]


def _number(value: Any) -> float | str | None:
    """A finite number; infinities as words and NaN as nothing, as JSON has neither."""
    number = float(value)
    if np.isnan(number):
        return None
    return number if np.isfinite(number) else ("-inf" if number < 0 else "inf")
