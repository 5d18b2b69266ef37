"""The paper's experiment on simulated or recorded taps: what `solidtouch.reproduce` does and gives back."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from ...inference.trials.run import checked_thresholds
from ...models.errors import InputError
from ...models.experiment import load_experiment
from ...models.io.load import TapSource, names_of
from ...models.measurement.registry import PAPER
from ...models.settings import Division, FitSettings, PlaySettings
from ..experiment.settings import ExperimentSettings
from ..page.page import Page
from ..page.report import StudyReport
from ..page.stages import Progress, no_progress
from .page import pictures, report_page
from .record import ReproductionSummary
from .results import Request, Results
from .run import run_experiment, simulated_split
from .summary import results_tree, summarise
from .tables import decisions_table, places_table


@dataclass(frozen=True, eq=False, repr=False)
class ReproductionReport(StudyReport):
    """The paper's experiment: passive and active perception, error against reaction time.

    Attributes:
        request: What was asked for.
        found: All results.
        summary: What the page says, as `summary.json` holds it.
    """

    request: Request
    found: Results
    summary: ReproductionSummary

    def _page(self) -> Page:
        return report_page(self.summary, self.found.check, pictures(self.request, self.found))

    @property
    def passed(self) -> bool:
        """Whether all ways of computing the belief agree."""
        return self.found.check.passed

    @property
    def decisions(self) -> xr.Dataset:
        """Errors and reaction times, dims policy and theta; `<name>_difference` is passive less active.

        Variables that begin with `fresh_` hold on fresh taps, of which none is drawn twice in a trial.
        """
        return decisions_table(self.found, self.summary)

    @property
    def positions(self) -> xr.Dataset:
        """Errors and reaction times of passive perception at each position, dims where and theta."""
        return places_table(self.found.by_position, "where", self.summary)

    @property
    def fixations(self) -> xr.Dataset | None:
        """Errors and reaction times for each fixation point, dims fixation and theta; `None` where none can be used."""
        found = self.found.by_fixation
        return None if found is None else places_table(found, "fixation", self.summary)

    @property
    def tree(self) -> xr.DataTree:
        """Every curve, labelled, with intervals, as `results.nc` holds them."""
        return results_tree(self.request, self.found)

    def _write_more(self, folder: Path) -> None:
        self.tree.to_netcdf(folder / "results.nc", engine="h5netcdf")


def reproduce(
    *data: TapSource,
    preset: str | None = None,
    data_sets: int | None = None,
    trials: int = 1000,
    thresholds: Sequence[float] | None = None,
    play: PlaySettings = PlaySettings(),
    model: str = PAPER,
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    episodes: int = 10,
    sequence_taps: int = 20,
    seed: int = 0,
    progress: Progress = no_progress,
    command: str = "",
) -> ReproductionReport:
    """Runs the paper's experiment on simulated or recorded taps.

    Args:
        data: Recorded taps or their files instead of simulated ones: one that is divided, or two, of which the first
            trains and the second tests.
        preset: Preset of the simulated rig; `None` for `"paper"`.
        data_sets: Simulated data sets; `None` for 12.
        trials: Trials at each position and for each fixation point.
        thresholds: Belief thresholds, theta_W; `None` for those of the paper's range.
        play: How trials are played.
        model: The measurement model, see docs/reference/models.md.
        division: How taps are grouped into classes, and how one tap set is divided.
        fit: How the model is fitted; its seed is `seed`.
        episodes: Episodes on which all ways of computing the belief are compared.
        sequence_taps: Taps of each that are enumerated at once.
        seed: Random seed.
        progress: Told the name and size of every stage; gives the function that counts what is done.
        command: The command line, for the page.

    Raises:
        InputError: The taps or a setting cannot be used.
    """
    _check_kind(data, preset, data_sets, division)
    settings = ExperimentSettings(
        model=model,
        fit=fit.changed(seed=seed),
        play=play,
        trials=trials,
        thresholds=checked_thresholds(thresholds),
        seed=seed,
    )
    preset = None if data else preset or "paper"
    if preset is None:
        split, grid = load_experiment(data, division)
    else:
        split = simulated_split(preset, 12 if data_sets is None else data_sets, seed, progress)
        grid = split.folds[0].train.grid(division.where_cell, division.what_cell)
    files = tuple(Path(name).name for name in names_of(data))
    request = Request(split, grid, settings, preset, command, files, episodes, sequence_taps)
    found = run_experiment(request, progress)
    return ReproductionReport(request, found, summarise(request, found))


def _check_kind(data: Sequence[TapSource], preset: str | None, data_sets: int | None, division: Division) -> None:
    """Refuses settings of simulated taps where taps are recorded, and the other way round."""
    simulated_only = {"--preset": preset, "--data-sets": data_sets}
    recorded_only = {
        "--split": division.split,
        "--train": division.train,
        "--test": division.test,
        "--training-taps": division.training_taps or None,
    }
    for option, value in (simulated_only if data else recorded_only).items():
        if value is not None:
            raise InputError(f"{option} requires {'simulated' if data else 'recorded'} taps.")
