"""Effect of each choice that the paper leaves open: the function `solidtouch.sensitivity` and its report."""

from dataclasses import dataclass
from typing import ClassVar

import xarray as xr

from ...models.errors import InputError, check_counts
from ...models.io.load import TapSource, check_there
from ...models.progress import Progress, no_progress
from ...models.settings import Division
from ..experiment.sources import recorded_source, simulated_source
from ..page.page import Page, Row
from ..page.report import StudyReport, TitleRecord
from ..tasks.crew import PATIENCE_S, crew_of
from .page import sensitivity_page
from .run import Sensitivity, SensitivitySettings, sensitivity_study
from .summary import summarise
from .tables import defaults_table, effects_table, pairs_table


@dataclass(frozen=True, eq=False, repr=False)
class SensitivityReport(StudyReport):
    """Effect of each open choice: on the paper's conclusion, on its numbers, or none.

    Attributes:
        found: All results, one for each kind of data.
        summary: What the page says, as `sensitivity.json` holds it.
    """

    SUMMARY: ClassVar[str] = "sensitivity.json"

    found: tuple[Sensitivity, ...]
    summary: Row

    def _page(self) -> Page:
        return sensitivity_page(self.summary)

    @property
    def defaults(self) -> xr.Dataset:
        """Errors, reaction times and miscalibration of the defaults, dims source and policy.

        `<name>_advantage` is passive less active, dim source.
        """
        return defaults_table(self.summary)

    @property
    def effects(self) -> xr.Dataset:
        """Changes from the default by each option, dims source, choice, option and policy.

        `<name>_advantage` is passive less active under the option. NaN where an option is of another choice.
        """
        return effects_table(self.summary)

    @property
    def pairs(self) -> xr.Dataset:
        """Changes of the object error by pairs of options, and beyond their sum, dims source, first and second."""
        return pairs_table(self.summary)


def sensitivity(
    *data: TapSource,
    data_sets: int = 40,
    preset: str = "paper",
    division: Division = Division(),
    trials: int = 1000,
    strongest: int = 5,
    workers: int | None = None,
    scheduler: str | None = None,
    patience: float = PATIENCE_S,
    seed: int = 0,
    progress: Progress = no_progress,
    command: str = "",
) -> SensitivityReport:
    """Compares every option of the choices that the paper leaves open with the default, on the same trials.

    Args:
        data: Recorded taps or their files, each studied on its own; three sessions or more are left out in turn.
        data_sets: Simulated data sets; 0 for recorded taps only.
        preset: Preset of the simulated rig.
        division: Width of the cells, and whether test taps that are among the training taps are kept.
        trials: Trials of each data set, policy and option.
        strongest: Choices of which all pairs are tried.
        workers: Data sets at a time, or options for a single one; `None` for as many as there are cores.
        scheduler: Address of a Dask scheduler, to run on its cluster instead.
        patience: Seconds to wait for a lost scheduler or lost workers.
        seed: Random seed.
        progress: Called with the name and size of every stage; returns the function that advances it.
        command: The command line, for the page.

    Raises:
        InputError: The taps or a setting cannot be used.
    """
    check_counts(trials=trials, workers=workers)
    crew = crew_of(scheduler, workers, patience)
    check_counts(0, data_sets=data_sets, strongest=strongest, seed=seed)
    if not data_sets and not data:
        raise InputError("--data-sets 0 requires a file of recorded taps.")
    for option, width in (("--where-cell", division.where_cell), ("--what-cell", division.what_cell)):
        if width is not None and not data:
            raise InputError(f"{option} {width} requires recorded taps; simulated taps keep their classes.")
    check_there(data)
    sources = [simulated_source(preset, data_sets, seed)] if data_sets else []
    sources += [recorded_source(taps, division) for taps in data]
    settings = SensitivitySettings(trials=trials, seed=seed, strongest=strongest)
    found = tuple(sensitivity_study(source, settings, progress, crew) for source in sources)
    described = TitleRecord(title="Sensitivity to the choices that the paper leaves open", command=command)
    return SensitivityReport(found, summarise(found, settings, described))
