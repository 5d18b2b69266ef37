"""The paper end to end: data sets through the experiment, then figures, tables and the report in one folder."""

import json
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from ..hardware.data_collection import simulate_session
from ..hardware.presets import preset
from ..inference.control import check_fixation
from ..inference.engine import make_engine
from ..models.classes import ClassGrid
from ..models.histogram import trim
from ..models.splits import Fold, Split
from ..models.storage import complete_folder
from . import figures, metrics
from .contacts import summarise
from .crosscheck import CrossCheck, crosscheck
from .examples import Trajectories, belief_cases, trajectories
from .figures import BeliefCase
from .paper import compare
from .report import write_report
from .study import Settings, Study, can_act, check_settings, planned, study

type Progress = Callable[[str, int], Callable[[int], None]]

_PACKAGES = ("solidtouch", "numpy", "jax", "numpyro", "funsor", "arviz", "xarray", "scipy", "matplotlib")


@dataclass(frozen=True)
class Request:
    """What to reproduce.

    Attributes:
        split: The data sets; every fold is one.
        grid: The classes.
        settings: What changes the numbers.
        simulated: Name of the preset, `None` for recorded data.
        command: How it was asked for.
        files: Names of the recorded files.
        episodes: Episodes of the cross-check.
        sequence_taps: Taps of each that are enumerated at once.
    """

    split: Split
    grid: ClassGrid
    settings: Settings
    simulated: str | None = None
    command: str = ""
    files: tuple[str, ...] = ()
    episodes: int = 10
    sequence_taps: int = 20


class Results(NamedTuple):
    """Everything that the files are made of.

    Attributes:
        grid: The classes that were told apart.
        left_out: Classes without a training tap, by name.
        studies: One per data set.
        passive: Outcomes by sensing position, all data sets.
        active: Outcomes by fixation point; `None` where nothing can be acted on.
        fixation: The fixation point of the curves.
        cases: A clear and an ambiguous sequence of beliefs.
        paths: Example trajectories; `None` where nothing can be acted on.
        check: The engines compared.
        elapsed_s: Seconds per stage.
    """

    grid: ClassGrid
    left_out: tuple[str, ...]
    studies: list[Study]
    passive: xr.Dataset
    active: xr.Dataset | None
    fixation: int
    cases: tuple[BeliefCase, BeliefCase]
    paths: Trajectories | None
    check: CrossCheck
    elapsed_s: dict[str, float]


@dataclass
class _Clock:
    """Stages with their progress bars and seconds."""

    progress: Progress
    elapsed_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Callable[[int], None]]:
        """Times one stage; gives the function that advances its bar."""
        began = time.perf_counter()
        yield self.progress(name, total)
        self.elapsed_s[name] = round(time.perf_counter() - began, 2)


def no_progress(stage: str, total: int) -> Callable[[int], None]:  # noqa: ARG001 - the signature of Progress
    """Shows nothing."""
    return lambda done: None  # noqa: ARG005


def simulated_split(name: str, data_sets: int, seed: int, progress: Progress = no_progress) -> Split:
    """Simulated data sets of two sessions each: the first trains, the second tests.

    Data set d is what `solidtouch simulate --seed (seed + d)` writes.

    Raises:
        InputError: There is no such preset.
    """
    settings = preset(name)
    advance = progress("Simulating taps", data_sets)
    folds = []
    for d in range(data_sets):
        train, test = (simulate_session(settings, seed + d, session) for session in (0, 1))
        folds.append(Fold(train, test, f"seed {seed + d}"))
        advance(1)
    return Split(tuple(folds), "sessions", "In every simulated data set session 0 trains and session 1 tests.")


def reproduce(request: Request, folder: Path, force: bool = False, progress: Progress = no_progress) -> dict[str, Any]:
    """Runs the experiment and writes its folder, whole or not at all.

    Args:
        request: What to reproduce.
        folder: Where the figures, `results.nc`, `summary.json` and `report.html` go.
        force: Whether files in an existing folder may be replaced.
        progress: Told the name and size of every stage; gives the function that counts what is done.

    Returns:
        What `summary.json` holds.

    Raises:
        InputError: The folder cannot be written, or the data or settings cannot be used.
        ZeroEvidenceError: A test tap is impossible under every class.
    """
    with complete_folder(folder, force) as temporary:
        clock = _Clock(progress)
        results = _run(request, clock)
        with clock.stage("Drawing figures", 8) as advance:
            pictures = _draw(request, results, temporary, advance)
        summary = _summary(request, results)
        _results_tree(results).to_netcdf(temporary / "results.nc", engine="h5netcdf")
        (temporary / "summary.json").write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        write_report(temporary, summary, pictures)
    return summary


def _run(request: Request, clock: _Clock) -> Results:
    settings, folds = request.settings, request.split.folds
    grid, left_out = trim(request.grid, [fold.train for fold in folds])
    check_settings(settings, grid)
    fixation = check_fixation(settings.fixation, grid.L)
    with clock.stage("Playing trials", planned(grid, settings) * len(folds)) as advance:
        studies = [study(fold, grid, settings, advance) for fold in folds]
    first = studies[0]
    with clock.stage("Cross-checking engines", request.episodes) as advance:
        check = crosscheck(
            first.model,
            first.test,
            border=settings.border,
            episodes=request.episodes,
            sequence_taps=request.sequence_taps,
            seed=settings.seed,
            progress=lambda: advance(1),
        )
    with clock.stage("Following single episodes", 1) as advance:
        engine = make_engine("filter", first.model, settings.border)
        cases = belief_cases(first, engine, settings)
        paths = trajectories(first, engine, settings, fixation) if can_act(grid) else None
        advance(1)
    names = [part.name for part in studies]
    active = [part.active for part in studies if part.active is not None]
    return Results(
        grid=grid,
        left_out=_left_out(left_out, studies),
        studies=studies,
        passive=metrics.join([part.passive for part in studies], names),
        active=metrics.join(active, names) if active else None,
        fixation=fixation,
        cases=cases,
        paths=paths,
        check=check,
        elapsed_s=clock.elapsed_s,
    )


def _left_out(trimmed: tuple[str, ...], studies: Sequence[Study]) -> tuple[str, ...]:
    if len(studies) == 1:
        return (*trimmed, *studies[0].model.left_out)
    return (*trimmed, *(f"{name} ({part.name})" for part in studies for name in part.model.left_out))


def _draw(request: Request, results: Results, folder: Path, advance: Callable[[int], None]) -> list[dict[str, Any]]:
    pictures = []

    def keep(name: str, title: str, caption: str, figure: Any) -> None:
        png, svg = figures.save(figure, folder, name)
        pictures.append({"name": name, "title": title, "caption": caption, "png": png, "svg": svg})
        advance(1)

    settings, grid, first = request.settings, results.grid, results.studies[0]
    theta = settings.thresholds[settings.shown]
    aim = grid.where_label(results.fixation)
    shown = int(first.test.what[0])
    train = request.split.folds[0].train
    session = train.select((train.session == train.session[0]) & (train.what == shown))
    keep(
        "fig3",
        "Taps of one object",
        f"The training taps on {train.what_name[shown]} of one session in order of position.",
        figures.pressure(session, shown),
    )
    keep(
        "fig4",
        "Beliefs during single sequences",
        "Belief in every class against the number of taps, a clear (A) and an ambiguous (B) passive sequence.",
        figures.beliefs(*results.cases, grid),
    )
    curves = _curves(results)
    if results.active is not None and results.paths is not None:
        keep(
            "fig5_passive",
            "Passive perception by sensing position",
            "Errors and reaction time against the position where the sensor stays, one curve per threshold.",
            figures.errors_by_position(metrics.by_place(results.passive)),
        )
        keep(
            "fig5_active",
            "Active perception by fixation point",
            "Errors and reaction time against the fixation point, averaged over starts, one curve per threshold.",
            figures.errors_by_fixation(metrics.by_place(results.active)),
        )
        keep(
            "fig6",
            "Trajectories",
            f"Position against taps in {len(results.paths.passive)} passive (A) and active (B) trials at threshold "
            f"{theta:g}; the fixation point is {aim}.",
            figures.trajectories(*results.paths, grid, results.fixation),
        )
    keep(
        "fig7",
        "Decision errors, passive and active" if "active" in curves else "Decision errors, passive",
        "Errors against the belief threshold (A, B) and against the mean reaction time (C, D)"
        + (f"; the fixation point is {aim}." if "active" in curves else "."),
        figures.acuity(curves["passive"], curves.get("active")),
    )
    keep(
        "confusion",
        "Which object is taken for which",
        f"Share of decisions at threshold {theta:g}, rows are the true objects.",
        figures.confusion(*_confusions(results), list(grid.what_name), theta),
    )
    keep(
        "contacts",
        "Accuracy after a fixed number of contacts",
        "Share of right answers after n taps of the same class, without moves or stopping.",
        figures.contacts(_accuracy(results), grid),
    )
    return pictures


def _curves(results: Results) -> dict[str, xr.Dataset]:
    """Each policy's error and reaction time against the threshold."""
    curves = {"passive": metrics.over_places(results.passive)}
    if results.active is not None:
        curves["active"] = metrics.at_place(results.active, results.fixation)
    return curves


def _confusions(results: Results) -> tuple[np.ndarray, np.ndarray | None]:
    passive = np.sum([part.passive_confusion for part in results.studies], axis=0)
    active = [part.active_confusion for part in results.studies if part.active_confusion is not None]
    return passive, np.sum(active, axis=0) if active else None


def _accuracy_rows(results: Results) -> list[dict[str, float | int]]:
    """Accuracy for the numbers of contacts that every data set can answer."""
    pooled = zip(*(part.accuracy for part in results.studies), strict=False)
    return [summarise(rows) for rows in pooled]


def _accuracy(results: Results) -> xr.Dataset:
    rows = _accuracy_rows(results)
    columns = {name: ("contacts", [row[name] for row in rows]) for name in rows[0] if name != "contacts"}
    return xr.Dataset(columns, {"contacts": [row["contacts"] for row in rows]})


def _results_tree(results: Results) -> xr.DataTree:
    """Every curve, labelled, with intervals; groups without an interval hold the single data sets."""
    grid = results.grid
    groups = {
        "passive/data_sets": results.passive,
        "passive/by_position": metrics.by_place(results.passive),
        "contacts": _accuracy(results),
    }
    if results.active is not None:
        groups["active/data_sets"] = results.active
        groups["active/by_fixation"] = metrics.by_place(results.active)
    groups |= {f"{policy}/curve": curve for policy, curve in _curves(results).items()}
    passive, active = _confusions(results)
    confusion = {"passive": (("what_true", "what_decided"), passive)}
    if active is not None:
        confusion["active"] = (("what_true", "what_decided"), active)
    names = np.asarray(grid.what_name, dtype=np.str_)
    groups["confusion"] = xr.Dataset(confusion, {"what_true": names, "what_decided": names})
    if results.paths is not None:
        for policy, paths in results.paths._asdict().items():
            groups[f"{policy}/trajectories"] = xr.Dataset({"where_index": (("trial", "tap"), paths)})
    return xr.DataTree.from_dict(groups)


def _summary(request: Request, results: Results) -> dict[str, Any]:
    settings, grid = request.settings, results.grid
    curves = _curves(results)
    kind = "simulated data sets" if request.simulated else "folds"
    sizes = results.studies[0].test.dataset.sizes
    return {
        "title": f"Active Bayesian perception: {_subject(request)}",
        "what_was_run": _what_was_run(request, results),
        "command": request.command,
        "simulated": request.simulated is not None,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
        "seed": settings.seed,
        "options": asdict(settings) | {"data_sets": len(results.studies)},
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
            "where": [grid.where_label(l) for l in range(grid.L)],
            "what": list(grid.what_name),
            "left_out": list(results.left_out),
        },
        "units": {"what": grid.what_error_unit, "where": grid.where_unit},
        "fixation": {"index": results.fixation, "value": grid.where_label(results.fixation)},
        "results": [row for policy, curve in curves.items() for row in _rows(policy, curve)],
        "interval": metrics.interval_sentence(len(results.studies), kind),
        "accuracy": _accuracy_rows(results),
        "paper": compare(curves, metrics.at_place(results.passive, results.fixation)) if request.simulated else None,
        "crosscheck": _check_summary(results.check),
        "warnings": _warnings(request, results),
        "skipped": _skipped(grid),
        "elapsed_s": results.elapsed_s,
    }


def _rows(policy: str, curve: xr.Dataset) -> list[dict[str, Any]]:
    names = [name for name in metrics.QUANTITIES for name in (name, f"{name}_low", f"{name}_high")]
    return [
        {"policy": policy, "theta": float(curve["theta"][h])}
        | {name: float(curve[name][h]) for name in (*names, *metrics.FRACTIONS)}
        for h in range(curve.sizes["theta"])
    ]


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


def _sources(request: Request) -> list[dict[str, Any]]:
    """What was read or simulated: one row per data set, or per side of a split."""
    rows = []
    for fold in request.split.folds:
        for side, taps in (("training", fold.train), ("test", fold.test)):
            attributes = taps.dataset.attrs
            name = request.files[-1 if side == "test" else 0] if request.files else f"preset {request.simulated}"
            rows.append(
                {
                    "name": f"{name}, {fold.name}, {side}",
                    "taps": len(taps),
                    "sessions": sorted(int(session) for session in np.unique(taps.session)),
                    "description": "; ".join(
                        attributes[key] for key in ("sensor", "source", "licence") if attributes.get(key)
                    ),
                }
            )
    return rows


def _what_was_run(request: Request, results: Results) -> list[str]:
    settings, grid = request.settings, results.grid
    sets = len(results.studies)
    lines = [
        f"A histogram model of {settings.bins} bins was fitted to training taps of {grid.L} x {grid.M} "
        f"(where, what) classes and tested on other taps, {sets} data set{'s' * (sets > 1)} in all. In every trial "
        "test taps of one class are drawn with replacement and Bayes' rule accumulates the joint belief until the "
        "belief in one object exceeds the threshold.",
        f"Passive: {settings.trials} trials at each sensing position. "
        + (
            f"Active: {settings.trials} trials with random starts at each fixation point; the curves take the point "
            f"{grid.where_label(results.fixation)}. "
            if can_act(grid)
            else ""
        )
        + f"All thresholds are read off the same trials. After {settings.deadline} taps the most probable classes "
        "are taken. Errors are distances between classes.",
    ]
    return lines


def _warnings(request: Request, results: Results) -> list[str]:
    sentences = [request.split.warning] if request.split.warning else []
    dropped = sum(part.dropped for part in results.studies)
    if dropped:
        sentences.append(f"{dropped} test taps belong to classes without a training tap and were left out.")
    substituted = [part for part in (results.passive, results.active) if part is not None]
    if any(float(part["substituted_fraction"].max()) > 0 for part in substituted):
        sentences.append(
            "Some moves led to a class without a test tap; the nearest class with one was used, as counted in the table."
        )
    if not results.check.passed:
        sentences.append("The engines disagree: see the cross-check below before using any number.")
    return [*sentences, *results.check.notes]


def _skipped(grid: ClassGrid) -> list[str]:
    if can_act(grid):
        return []
    reason = (
        "one where class, so there is nowhere to move" if grid.L == 1 else "one object, so nothing is to be told apart"
    )
    return [f"These data have {reason}: active perception and figures 5 and 6 are left out."]
