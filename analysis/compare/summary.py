"""Summary of a comparison: `summary.json`, from which the page and the printed table are made."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from ...models.measurement.registry import row
from ..experiment.settings import SHOWN_THETA
from ..page.figure_style import short_unit
from ..page.numbers import versions
from ..stats.decisions import decision_interval_sentence, too_few_taps
from ..stats.no_class_left import no_class_left_sentence
from .classes import class_interval_sentence
from .ranking import findings, levels, rank_rows
from .record import (
    CheckRow,
    ClassRow,
    ComparedData,
    ComparedModel,
    ComparisonSummary,
    DecisionRow,
    EqualTapsRow,
    SingleTapRow,
    TapRow,
    Value,
)
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


def summarise(comparison: Comparison, settings: CompareSettings, described: ComparedData) -> ComparisonSummary:
    """Content of `summary.json`."""
    grid = comparison.grid
    names = list(comparison.fits)
    ranked = levels(comparison)
    return {
        **described,
        "versions": versions(_PACKAGES),
        "seed": settings.seed,
        "reference": names[0],
        "grid": {"L": grid.L, "M": grid.M, "unit": short_unit(grid.where_unit)},
        "units": {"what": grid.what_error_unit, "where": short_unit(grid.where_unit)},
        "test_taps": comparison.test_taps,
        "models": [_model(comparison, name, settings.fit.power) for name in names],
        "refused": [{"name": name, "reason": reason} for name, reason in comparison.refused.items()],
        "sessions": comparison.sessions,
        "warnings": [
            *described["warnings"],
            *([comparison.sessions] if comparison.left_out_sessions is None else []),
            *too_few_taps(comparison.curves, _shown(comparison.curves)),
            *_no_class_left(comparison),
            *_alone(names),
        ],
        "taps": _taps(comparison),
        "contacts": [int(n) for n in comparison.classes["contacts"].values],
        "classes": _classes(comparison.classes),
        "class_interval": class_interval_sentence(),
        "decisions": _decisions(comparison.curves),
        "shown_theta": _shown(comparison.curves),
        "equal_taps": _equal(comparison.equal),
        "decision_interval": decision_interval_sentence(),
        "checks": _checks(comparison.checks),
        "levels": [{"title": level.title, "unit": level.unit} for level in ranked],
        "ranks": rank_rows(ranked, names),
        "findings": findings(ranked, names[0]),
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


def _alone(names: Sequence[str]) -> list[str]:
    """A sentence if no second model could be fitted."""
    return [f"Only one model, {names[0]}, could be fitted, so nothing is compared."] if len(names) == 1 else []


def _model(comparison: Comparison, name: str, power: str | float) -> ComparedModel:
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


def _taps(comparison: Comparison) -> list[TapRow | SingleTapRow]:
    means, single, stacking = comparison.left_out_sessions, comparison.left_out_taps, comparison.stacking
    rows = []
    for name in comparison.fits:
        row = TapRow(name=name)
        if means is not None and name in means["model"].values:
            row = TapRow(name=name, **_values(means.sel(model=name)))
        if means is not None and stacking is not None and name in stacking.index:
            taps = means.attrs["taps"]
            row["weight"] = float(stacking.loc[name, "weight"])
            row["behind"] = float(stacking.loc[name, "elpd_diff"]) / taps
            row["behind_se"] = float(stacking.loc[name, "dse"]) / taps
        if single is not None and name in single["model"].values:
            row = _with_single(row, single.sel(model=name))
        rows.append(row)
    return rows


def _with_single(row: TapRow, left_out: xr.Dataset) -> SingleTapRow:
    """Leave-one-tap-out as well; importance sampling counts only where it answers for every tap."""
    good_k = float(left_out["good_k"])
    bad = float((left_out["pareto_k"] > good_k).mean())
    psis = _number(left_out["psis"].mean())
    found = SingleTapRow(**row, psis=psis, bad_k=bad, good_k=good_k, psis_ranks=bad == 0.0)
    for name in ("exact", "exact_plug_in"):
        if name in left_out and np.isfinite(left_out[name]).all():
            found[name] = float(left_out[name].mean())
    return found


def _classes(scores: xr.Dataset) -> list[ClassRow]:
    return [
        ClassRow(name=str(name), contacts=int(n), **_values(scores.sel(model=name, contacts=n), _CLASS_SCORES))
        for n in scores["contacts"].values
        for name in scores["model"].values
    ]


def _decisions(curves: xr.Dataset) -> list[DecisionRow]:
    return [
        DecisionRow(
            name=str(name),
            policy=str(policy),
            theta=float(theta),
            **_values(curves.sel(model=name, policy=policy, theta=theta), _DECISIONS),
        )
        for policy in curves["policy"].values
        for theta in curves["theta"].values
        for name in curves["model"].values
    ]


def _equal(equal: xr.Dataset) -> list[EqualTapsRow]:
    return [
        EqualTapsRow(
            name=str(name),
            policy=str(policy),
            taps=float(t),
            **_values(equal.sel(model=name, policy=policy, taps=t), ("what_error", "where_error", "what_wrong")),
        )
        for policy in equal["policy"].values
        for t in equal["taps"].values
        for name in equal["model"].values
    ]


def _checks(checks: xr.Dataset | None) -> list[CheckRow]:
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


def _values(row: xr.Dataset, names: Sequence[str] | None = None) -> dict[str, Any]:
    """Numbers of a row, with bounds and differences of the named quantities or of all."""
    endings = ("", "_low", "_high", "_difference", "_difference_low", "_difference_high")
    wanted = (
        [str(name) for name in row.data_vars]
        if names is None
        else [n + e for n in names for e in endings if n + e in row]
    )
    return {name: _number(row[name]) for name in wanted}


def _number(value: Any) -> Value:
    """A finite number; infinities as words and NaN as nothing, as JSON has neither."""
    number = float(value)
    if np.isnan(number):
        return None
    return number if np.isfinite(number) else ("-inf" if number < 0 else "inf")
