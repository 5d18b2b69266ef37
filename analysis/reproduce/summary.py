"""Summary of a reproduction: `summary.json` and `results.nc`."""

import json
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from ...inference.trials.selections import sessions_in_words
from ...models.grid import ClassGrid, can_act
from ...models.measurement.registry import PAPER, row, split_name
from ...models.settings import learned_taps
from ...models.taps import TapSet
from ..experiment.crosscheck import CrossCheck
from ..experiment.data_warnings import FEW, fold_warnings
from ..experiment.settings import ExperimentSettings
from ..page.figure_style import unit_name
from ..page.labelled import NUMBERS_FORMAT
from ..page.numbers import versions
from ..stats import metrics
from ..stats.no_class_left import no_class_left_sentence
from .headline import compare, headline
from .record import AccuracyRow, FixationRecord, ReproductionSummary, TapsRecord
from .redraw import CASES, case_group
from .results import Request, Results, curve_rows, difference_rows, finite

_PACKAGES = ("solidtouch", "numpy", "jax", "numpyro", "funsor", "arviz", "xarray", "scipy", "matplotlib")


def summarise(request: Request, results: Results) -> ReproductionSummary:
    """Content of `summary.json`, from which the report is written."""
    settings, grid = request.settings, results.grid
    curves = results.curves
    kind = "simulated data sets" if request.simulated else "folds"
    test = results.studies[0].test
    sizes = test.dataset.sizes
    sessions = dict.fromkeys(sessions_in_words(part.table) for part in results.studies)
    return {
        "title": f"Active Bayesian perception: {_subject(request)}",
        "what_was_run": _what_was_run(request, results),
        "command": request.command,
        "simulated": request.simulated is not None,
        "versions": versions(_PACKAGES),
        "model": settings.model,
        "seed": settings.seed,
        "data_sets": [part.name for part in results.studies],
        "options": _options(settings) | {"fixation": results.fixation, "data_sets": len(results.studies)},
        "data": _sources(request),
        "split": {
            "method": request.split.method,
            "description": request.split.description,
            "warning": request.split.warning,
        },
        "grid": {
            "L": grid.L,
            "M": grid.M,
            "K": sizes["taxel"],
            "J": sizes["sample"],
            "where": _span([grid.where_label(l) for l in range(grid.L)]) if grid.L > 1 else "",
            "what": _span(grid.what_name),
            "where_value": grid.where_value.tolist(),
            "what_name": list(grid.what_name),
            "left_out": list(results.left_out),
        },
        "units": {"what": grid.what_error_unit, "where": unit_name(grid.where_unit)},
        "fixation": _fixation(results),
        "headline": headline(results, settings.shown),
        "results": [row for name in ("passive", "active") if name in curves for row in curve_rows(name, curves[name])],
        "differences": difference_rows(curves.get("difference")),
        "shown_theta": settings.thresholds[settings.shown],
        "interval": " ".join(
            [metrics.interval_sentence(len(results.studies), kind, results.spread), *sessions]
        ).rstrip(),
        "accuracy": [_accuracy(row) for row in results.accuracy],
        "paper": compare(curves, results.by_position.isel(place=results.fixation)) if request.simulated else None,
        "crosscheck": _check_summary(results.check),
        "warnings": _warnings(request, results),
        "skipped": _skipped(grid),
        "elapsed_s": results.elapsed_s,
    }


def _options(settings: ExperimentSettings) -> dict[str, Any]:
    """What was asked for, by the names of the command line."""
    fit = ("bins", "pseudocount", "power", "value_range", "saturation")
    return {
        "trials": settings.trials,
        "thresholds": settings.thresholds,
        **{name: getattr(settings.play, name) for name in ("theta_x", "fixation", "border", "deadline")},
        **{name: getattr(settings.fit, name) for name in fit},
        "seed": settings.seed,
        "model": settings.model,
        "unconverged": settings.fit.unconverged,
        "shown_theta": settings.play.threshold,
    }


def _check_summary(check: CrossCheck) -> dict[str, Any]:
    return check._asdict() | {
        "passed": check.passed,
        "rows": [row._asdict() | {"passed": row.passed} for row in check.rows],
        "notes": list(check.notes),
    }


def _subject(request: Request) -> str:
    if request.simulated:
        return f"simulated rig, preset {request.simulated}"
    return ", ".join(request.files)


def _sources(request: Request) -> list[TapsRecord]:
    """What was simulated or read, one row per preset or file."""
    folds = request.split.folds
    if request.simulated:
        taps = sum(len(fold.train) + len(fold.test) for fold in folds)
        row = _source(f"preset {request.simulated}", taps, folds[0].train, folds[0].test)
        sets = f"{len(folds)} data set{'s' * (len(folds) > 1)} of seed {request.settings.seed}"
        return [{**row, "description": f"{folds[0].train.dataset.attrs['sensor']}; {sets}"}]
    first = folds[0]
    if len(request.files) == 1:
        return [_source(request.files[0], len(first.train) + len(first.test), first.train, first.test)]
    sides = zip(request.files, (first.train, first.test), strict=True)
    return [_source(name, len(taps), taps) for name, taps in sides]


def _source(name: str, taps: int, *parts: TapSet) -> TapsRecord:
    attributes = parts[0].dataset.attrs
    about = (("", "sensor"), ("", "source"), ("licence: ", "licence"))
    sessions = sorted({int(session) for part in parts for session in part.session})
    return {
        "name": name,
        "taps": taps,
        "sessions": ", ".join(str(session) for session in sessions),
        "description": "; ".join(label + attributes[key] for label, key in about if attributes.get(key)),
    }


def _accuracy(row: Mapping[str, float | int]) -> AccuracyRow:
    numbers: dict[str, Any] = {name: finite(value) for name, value in row.items()}
    return AccuracyRow(**numbers)


def _fixation(results: Results) -> FixationRecord | None:
    if results.by_fixation is None:
        return None
    return {"index": results.fixation, "value": float(results.grid.where_value[results.fixation])}


def _span(names: Sequence[str]) -> str:
    """Names in print, many of them by the first and the last."""
    return ", ".join(names) if len(names) <= 8 else f"{names[0]} to {names[-1]}"


def _what_was_run(request: Request, results: Results) -> list[str]:
    settings, grid = request.settings, results.grid
    sets = len(results.studies)
    return [
        f"{_model(settings)} was fitted to training taps of {grid.L} x {grid.M} (position, object) classes and tested "
        f"on other taps, in {sets} data set{'s' * (sets > 1)}. A trial draws test taps of one object at the current "
        "position, with replacement as in the paper (stored taps) or without (fresh taps). Bayes' rule updates the "
        "joint belief until the belief in one object exceeds the threshold.",
        f"Passive: {settings.trials} trials at each sensing position. "
        + (
            "Active: the same trials, with the same objects and random numbers, start at each position and move to "
            f"the fixation point {grid.where_label(results.fixation)}; about {settings.trials} trials move to each "
            "other fixation point. "
            if can_act(grid)
            else ""
        )
        + f"All thresholds are evaluated on the same trials. After {settings.play.deadline} taps the most probable "
        "classes are chosen. "
        + (
            "Object errors are fractions of wrong decisions, position errors are distances between classes."
            if grid.what_value is None
            else "Errors are distances between classes."
        ),
        *_learned(request, results),
    ]


def _model(settings: ExperimentSettings) -> str:
    """The measurement model, in words."""
    kind, in_states = split_name(settings.model)
    words = f"A histogram model with {settings.fit.bins} bins"
    if kind != PAPER:
        words = f"The model {kind} ({row(kind).how}; likelihoods over {settings.fit.bins} bins)"
    return words + " with a gain and offset shared by all taps of an episode" * in_states


def _learned(request: Request, results: Results) -> list[str]:
    """What power was learned, where one was."""
    taps = learned_taps(request.settings.fit.power)
    if taps is None:
        return []
    powers = ", ".join(f"{part.model.exponent:.3g}" for part in results.studies)
    return [
        "The exponent of the likelihood was learned by leaving out one training session at a time, for beliefs after "
        f"{taps} tap{'s' * (taps > 1)}: {powers}."
    ]


def _warnings(request: Request, results: Results) -> list[str]:
    sentences = [request.split.warning] if request.split.warning else []
    sentences += _repeated_taps(results)
    if not request.simulated:
        sentences += _data_warnings(request, results.grid)
    dropped = sum(part.dropped for part in results.studies)
    if dropped:
        sentences.append(f"{dropped} test taps were left out because their classes have no training tap.")
    substituted = [part for part in (results.stored.passive, results.stored.fixations) if part is not None]
    if any(float(part["substituted_fraction"].max()) > 0 for part in substituted):
        sentences.append(
            "Some moves led to a class without a test tap; the nearest class with one was used (see “trials "
            "substituted” in the tables)."
        )
    none_left = max(float(part["no_class_left_fraction"].max()) for part in substituted)
    if none_left > 0:
        sentences.append(no_class_left_sentence(none_left, results.studies[0].model))
    if not results.check.passed:
        sentences.append("The engines disagree, so the results are unreliable; see the cross-check.")
    return [*sentences, *results.check.notes]


def _repeated_taps(results: Results) -> list[str]:
    """Whether trials see the same few taps again and again."""
    distinct = np.concatenate([part.table.pool.count[part.table.pool.count > 0] for part in results.studies])
    if distinct.min() >= FEW:
        return []
    few = "only one test tap" if distinct.max() == 1 else f"fewer than {FEW} test taps"
    share = np.mean(distinct < FEW)
    return [
        f"{'All' if share == 1 else f'{share:.0%} of the'} test classes have {few}, which a trial draws repeatedly; "
        "results after several taps reflect repetition, not new contacts."
    ]


def _data_warnings(request: Request, grid: ClassGrid) -> list[str]:
    """What `inspect` says about the files."""
    return fold_warnings(request.split.folds[0], grid, one_file=len(request.files) == 1)


def _skipped(grid: ClassGrid) -> list[str]:
    if can_act(grid):
        return []
    reason = "a single position" if grid.L == 1 else "a single object"
    return [f"Active perception and Figures 5 and 6 are left out, because the data have {reason}."]


def results_tree(request: Request, results: Results) -> xr.DataTree:
    """Every curve, labelled, with intervals; groups without an interval hold the single data sets."""
    grid = results.grid
    groups = {
        "passive/data_sets": _without_resamples(results.stored.passive),
        "passive/by_position": results.by_position,
        "contacts": results.accuracy_dataset,
    }
    if results.stored.fixations is not None and results.by_fixation is not None:
        groups["active/data_sets"] = _without_resamples(results.stored.fixations)
        groups["active/by_fixation"] = results.by_fixation
    if results.stored.active is not None:
        groups["active/by_start"] = metrics.by_place(results.stored.active, results.spread)
    groups |= {f"{policy}/curve": curve for policy, curve in results.curves.items()}
    groups |= {f"{policy}/fresh": curve for policy, curve in results.fresh_curves.items()}
    passive, active = results.confusions
    confusion = {"passive": (("what_true", "what_decided"), passive)}
    if active is not None:
        confusion["active"] = (("what_true", "what_decided"), active)
    names = np.asarray(grid.what_name, dtype=np.str_)
    groups["confusion"] = xr.Dataset(confusion, {"what_true": names, "what_decided": names})
    if results.paths is not None:
        for policy, paths in results.paths._asdict().items():
            groups[f"{policy}/trajectories"] = xr.Dataset({"where_index": (("trial", "tap"), paths)})
    groups |= {f"examples/{name}": case_group(case) for name, case in zip(CASES, results.cases, strict=True)}
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "format": NUMBERS_FORMAT,
        "command": request.command,
        "model": request.settings.model,
        "split": f"{request.split.method}: {request.split.description}",
        "seed": request.settings.seed,
        "theta": request.settings.thresholds[request.settings.shown],
        "fixation": results.fixation,
        "grid": json.dumps(grid.to_dict()),
        "solidtouch": version("solidtouch"),
    }
    return tree


def _without_resamples(data_sets: xr.Dataset) -> xr.Dataset:
    return data_sets.drop_vars([name for name in data_sets.data_vars if "_resampled" in str(name)])
