"""Measurement models compared on recorded taps: the function `solidtouch.compare` and its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from ...inference.moves.control import check_fixation
from ...inference.trials.resampling import RESAMPLES
from ...inference.trials.run import checked_thresholds
from ...models.errors import InputError, check_counts
from ...models.grid import ClassGrid
from ...models.io.load import TapSource, names_of
from ...models.measurement.histogram import trim
from ...models.measurement.model import TapModel
from ...models.measurement.registry import NAMES, AnyModel, model_names
from ...models.progress import Progress, no_progress
from ...models.settings import Division, FitSettings, PlaySettings
from ...models.splits import Split, load_experiment
from ...models.storage import write_netcdf
from ..experiment.data_warnings import fold_warnings
from ..page.page import Page, Row
from ..page.report import StudyReport
from ..stats.checks import REPLICATES
from ..tasks.crew import PATIENCE_S, crew_of
from .page import comparison_page, comparison_tree
from .run import CompareSettings, Comparison, compare_models
from .summary import summarise


@dataclass(frozen=True, eq=False, repr=False)
class ComparisonReport(StudyReport):
    """Measurement models compared by prediction, classification and decision error.

    Attributes:
        found: All results.
        summary: What the page says, as `summary.json` holds it.
    """

    found: Comparison
    summary: Row

    def _page(self) -> Page:
        return comparison_page(self.found, self.summary)

    @property
    def models(self) -> dict[str, TapModel]:
        """The fitted models by name."""
        return {name: fitted.model for name, fitted in self.found.fits.items()}

    @property
    def taps(self) -> xr.Dataset | None:
        """Mean log probability of taps of groups left out, dim model; `None` without a second group."""
        return self.found.left_out_groups

    @property
    def classes(self) -> xr.Dataset:
        """Scores of the belief in classes, dims model and contacts."""
        return self.found.classes

    @property
    def decisions(self) -> xr.Dataset:
        """Errors and reaction times, dims model, policy and theta."""
        return self.found.curves

    @property
    def elpd(self) -> dict[str, Any]:
        """Log probabilities of the taps of groups left out, by model, as input of `az.compare`.

        Each tap's are relative to the best model of that tap: only differences count, and their exponentials are taken.
        """
        return self.found.elpd

    @property
    def tree(self) -> xr.DataTree:
        """All labelled numbers, as `compare.nc` holds them."""
        return comparison_tree(self.found, self.summary)

    def _write_more(self, folder: Path) -> None:
        write_netcdf(self.tree, folder / "compare.nc")


def compare(
    *data: TapSource,
    models: AnyModel | Sequence[AnyModel] = NAMES,
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    draws: int = 400,
    trials: int = 4000,
    thresholds: Sequence[float] | None = None,
    play: PlaySettings = PlaySettings(),
    leave_out: str = "session",
    folds: int = 6,
    resamples: int = RESAMPLES,
    replicates: int = REPLICATES,
    scheduler: str | None = None,
    patience: float = PATIENCE_S,
    seed: int = 0,
    progress: Progress = no_progress,
    command: str = "",
) -> ComparisonReport:
    """Fits measurement models to training taps and compares their prediction, classification and decision errors.

    Args:
        data: One tap set or file that is divided, or two, of which the first trains and the second tests.
        models: Names, the reference first, or one name, see docs/reference/models.md; also NumPyro functions, see
            docs/how-to/your-own-model.md.
        division: How taps are grouped into classes, and how one tap set is divided.
        fit: How models are fitted; their seed is `seed`.
        draws: Draws from each posterior, to leave out single taps, at least 100; 0 skips that and the predictive
            checks.
        trials: Trials of each model, passive and active.
        thresholds: Belief thresholds, theta_W; `None` for those of the paper's range.
        play: How trials are played.
        leave_out: What models predict from the rest: each `session`, or each `position` or `object` of the test taps,
            on whose taps the models were not trained.
        folds: The most folds; more sessions, positions or objects are left out in groups. With one, sessions of the
            test taps alone are predicted, and no model is fitted again.
        resamples: Of the test taps, for intervals of beliefs and decisions.
        replicates: Of the training taps from each model, for predictive checks.
        scheduler: Address of a Dask scheduler, to fit and judge models on its cluster.
        patience: Seconds to wait for a lost scheduler or lost workers.
        seed: Random seed.
        progress: Called with the name and size of every stage; returns the function that advances it.
        command: The command line, for the page.

    Raises:
        InputError: The taps or a setting cannot be used.
    """
    check_counts(trials=trials)
    crew = None if scheduler is None else crew_of(scheduler, None, patience)
    check_counts(0, draws=draws, seed=seed)
    names = model_names(models)
    parts, grid = load_experiment(data, division)
    if len(parts.folds) != 1:
        raise InputError(
            f"--split {parts.method} makes {len(parts.folds)} training sets; compare requires one and leaves out each "
            "session by itself."
        )
    fold = parts.folds[0]
    grid, dropped = trim(grid, [fold.train])
    check_fixation(play.fixation, grid.L)
    settings = CompareSettings(
        models=tuple(names),
        fit=fit.changed(seed=seed),
        draws=draws,
        trials=trials,
        thresholds=checked_thresholds(thresholds),
        play=play,
        seed=seed,
        one_recording=len(data) == 1,
        leave_out=leave_out,
        folds=folds,
        resamples=resamples,
        replicates=replicates,
    )
    found = compare_models(fold.train, fold.test, grid, settings, progress, crew)
    described = _described(data, parts, grid, dropped, found.test_taps, command)
    return ComparisonReport(found, summarise(found, settings, described))


def _described(
    data: Sequence[TapSource], parts: Split, grid: ClassGrid, dropped: Sequence[str], test_taps: int, command: str
) -> Row:
    """The data in words."""
    fold = parts.folds[0]
    warnings = [parts.warning] if parts.warning else []
    if dropped:
        warnings.append(f"Left out, because they have no training tap: {', '.join(dropped)}.")
    if test_taps < len(fold.test):
        warnings.append(
            f"{len(fold.test) - test_taps} test taps were left out because some models do not know their classes."
        )
    simulated = fold.train.simulated and fold.test.simulated
    if not simulated:
        warnings += fold_warnings(fold, grid, one_file=len(data) == 1)
    return {
        "title": f"Measurement models compared: {', '.join(Path(name).name for name in names_of(data))}",
        "command": command,
        "what_was_run": [
            f"Every model was fitted to {len(fold.train)} training taps and judged on {test_taps} test taps. "
            + parts.description
        ],
        "simulated": simulated,
        "warnings": warnings,
    }
