"""The paper's experiment on simulated or recorded taps: the function `solidtouch.reproduce` and its report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import batched, chain
from pathlib import Path

import xarray as xr

from ...hardware.simulator.session import simulate_session
from ...hardware.simulator.settings import preset as preset_settings
from ...inference.moves.control import check_fixation
from ...inference.trials.resampling import RESAMPLES
from ...inference.trials.run import checked_thresholds
from ...models.errors import InputError, check_counts
from ...models.grid import ClassGrid
from ...models.io.load import TapSource, names_of
from ...models.measurement.histogram import trim
from ...models.measurement.registry import PAPER, AnyModel, model_name
from ...models.progress import Progress, no_progress
from ...models.seeds import data_set_seed
from ...models.settings import Division, FitSettings, PlaySettings
from ...models.splits import Fold, Split, load_experiment
from ...models.storage import write_netcdf
from ...models.taps import TapSet
from ...models.threads import cores, in_order
from ..experiment.policies import combined
from ..experiment.settings import ExperimentSettings, check_settings
from ..experiment.study import Study, planned, study
from ..page.page import Page, Picture
from ..page.report import StudyReport
from ..page.stages import StageClock
from ..stats import metrics
from .check import check_ahead
from .figures import pictures
from .page import report_page
from .record import ReproductionSummary
from .results import Request, Results, comparison, decisions_table, places_table
from .summary import results_tree, summarise


@dataclass(frozen=True, eq=False, repr=False)
class ReproductionReport(StudyReport):
    """Results of the paper's experiment: passive and active perception, error against reaction time.

    What only the page needs, such as the cross-check of the engines, is computed when it is first asked for.

    Attributes:
        request: What was asked for.
        found: All results.
    """

    request: Request
    found: Results

    @cached_property
    def summary(self) -> ReproductionSummary:
        """What the page says, as `summary.json` holds it."""
        return summarise(self.request, self.found)

    @cached_property
    def pictures(self) -> list[Picture]:
        """The figures."""
        return list(pictures(self.request, self.found))

    def _page(self) -> Page:
        return report_page(self.summary, self.found.check, self.pictures, self.found.example)

    @property
    def passed(self) -> bool:
        """Whether all ways of computing the belief agree."""
        return self.found.check.passed

    @property
    def decisions(self) -> xr.Dataset:
        """Errors and reaction times, dims policy and theta; `<name>_difference` is passive minus active.

        Variables that begin with `fresh_` hold on fresh taps, of which none is drawn twice in a trial.
        """
        return decisions_table(self.found)

    @property
    def positions(self) -> xr.Dataset:
        """Errors and reaction times of passive perception at each position, dims where and theta."""
        return places_table(self.found.by_position, "where", self.found.grid)

    @property
    def fixations(self) -> xr.Dataset | None:
        """Errors and reaction times for each fixation point, dims fixation and theta; `None` where none can be used."""
        found = self.found.by_fixation
        return None if found is None else places_table(found, "fixation", self.found.grid)

    @property
    def tree(self) -> xr.DataTree:
        """Every curve, labelled, with intervals, as `results.nc` holds them."""
        return results_tree(self.request, self.found)

    def _write_more(self, folder: Path) -> None:
        write_netcdf(self.tree, folder / "results.nc")


def reproduce(
    *data: TapSource,
    preset: str | None = None,
    data_sets: int | None = None,
    trials: int = 1000,
    thresholds: Sequence[float] | None = None,
    play: PlaySettings = PlaySettings(),
    model: AnyModel = PAPER,
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
        progress: Called with the name and size of every stage, also of those only for the page; returns the function
            that advances it.
        command: The command line, for the page.

    Raises:
        InputError: The taps or a setting cannot be used.
    """
    _check_kind(data, preset, data_sets, division)
    check_counts(data_sets=data_sets, trials=trials, episodes=episodes)
    check_counts(0, sequence_taps=sequence_taps, seed=seed)
    settings = ExperimentSettings(
        model=model_name(model),
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

        def grid_of(taps: TapSet) -> ClassGrid:
            return taps.grid(division.where_cell, division.what_cell)

        number = 12 if data_sets is None else data_sets
        split = simulated_split(preset, number, seed, progress, lambda taps: check_settings(settings, grid_of(taps)))
        grid = grid_of(split.folds[0].train)
    files = tuple(Path(name).name for name in names_of(data))
    request = Request(split, grid, settings, preset, command, files, episodes, sequence_taps)
    return ReproductionReport(request, run_experiment(request, progress))


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


def simulated_split(
    name: str,
    data_sets: int,
    seed: int,
    progress: Progress = no_progress,
    check: Callable[[TapSet], object] = lambda taps: None,  # noqa: ARG005
) -> Split:
    """Simulated data sets of two sessions each: the first trains, the second tests.

    Data set d is what `solidtouch simulate --seed SEED --data-set d` writes.

    Args:
        name: Of the preset.
        data_sets: How many.
        seed: Of the first one.
        progress: Called with the name and size of the stage; returns the function that advances it.
        check: Called with the first session, for what is wrong to be found before the others are made.

    Raises:
        InputError: There is no such preset, or as by `check`.
    """
    settings = preset_settings(name)
    own = [(data_set_seed(seed, d), session) for d in range(data_sets) for session in (0, 1)]
    first = simulate_session(settings, *own[0])
    check(first)
    advance = progress("Simulating taps", data_sets)
    others = in_order((partial(simulate_session, settings, *one) for one in own[1:]), cores(None))
    folds = []
    for d, (train, test) in enumerate(batched(chain([first], others), 2)):
        folds.append(Fold(train, test, f"data set {d}"))
        advance(1)
    return Split(
        tuple(folds), "sessions", "In each simulated data set, session 0 is for training and session 1 for testing."
    )


def run_experiment(request: Request, progress: Progress) -> Results:
    """Runs the experiment on every data set.

    Args:
        request: What to reproduce.
        progress: Called with the name and size of every stage; returns the function that advances it.

    Raises:
        InputError: The data or settings cannot be used.
    """
    clock = StageClock(progress)
    settings, folds = request.settings, request.split.folds
    grid, left_out = trim(request.grid, [fold.train for fold in folds])
    check_settings(settings, grid)
    fixation = check_fixation(settings.play.fixation, grid.L)
    resamples = RESAMPLES if len(folds) == 1 else 0
    with clock.stage("Playing trials", planned(grid, settings, resamples) * len(folds)) as advance:
        # Data sets must not share random numbers, or their spread would miss the sampling of trials.
        studies, begun = [], None
        for d, fold in enumerate(folds):
            own = settings.changed(seed=data_set_seed(settings.seed, d))
            studies.append(study(fold, grid, own, advance, resamples, clock.progress))
            if d == 0:
                begun = check_ahead(comparison(request, studies[0]), request.episodes, clock)
    names = [part.name for part in studies]

    def joined(parts: list[xr.Dataset]) -> xr.Dataset:
        return metrics.join(parts, names)

    return Results(
        request=request,
        grid=grid,
        left_out=_left_out(left_out, studies),
        studies=studies,
        stored=combined([part.played.stored for part in studies], joined),
        fresh=combined([part.played.fresh for part in studies], joined),
        fixation=fixation,
        clock=clock,
        begun=begun,
    )


def _left_out(trimmed: tuple[str, ...], studies: Sequence[Study]) -> tuple[str, ...]:
    if len(studies) == 1:
        return (*trimmed, *studies[0].model.left_out)
    return (*trimmed, *(f"{name} ({part.name})" for part in studies for name in part.model.left_out))
