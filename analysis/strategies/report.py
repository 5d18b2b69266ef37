"""Control strategies and stopping rules on the same trials: the function `solidtouch.strategies` and its report."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import xarray as xr

from ...models.errors import InputError, check_counts
from ...models.io.load import TapSource, check_there
from ...models.progress import Progress, no_progress
from ...models.settings import Division
from ..page.page import Page, Row
from ..page.report import StudyReport, TitleRecord
from ..tasks.crew import PATIENCE_S, crew_of
from .data import RIGHT, recorded_bench, simulated_bench
from .page import strategies_page
from .regret import TRIALS, RegretSettings, regret_study
from .regret_summary import summarise_regret
from .run import StrategySettings, StrategyStudy, strategy_study
from .summary import summarise
from .tables import at_threshold_table, curves_tree, equal_taps_table, regret_table, rules_table, trust_table

DATA = "ideal", "paper", "nodrift", "broken", RIGHT
"""Presets that strategies are compared on."""


@dataclass(frozen=True, eq=False, repr=False)
class StrategiesReport(StudyReport):
    """Control strategies and stopping rules compared with the paper's.

    Attributes:
        found: All results, one for each kind of data.
        summary: What the page says, as `strategies.json` holds it.
    """

    SUMMARY: ClassVar[str] = "strategies.json"

    found: tuple[StrategyStudy, ...]
    summary: Row

    def _page(self) -> Page:
        return strategies_page(self.summary)

    @property
    def curves(self) -> xr.DataTree:
        """Errors, reaction times and distances travelled, dims source, power, rule and strategy.

        Groups by what a stopping rule is set with, each with a dim of its own: `theta`, `taps` (dim number_of_taps) and
        `cost`.
        """
        return curves_tree(self.summary)

    @property
    def equal_taps(self) -> xr.Dataset:
        """Errors and distances at equal mean numbers of taps, dims source, power, rule, strategy and taps.

        `<name>_difference` is what they differ from the fixation point.
        """
        return equal_taps_table(self.summary)

    @property
    def at_threshold(self) -> xr.Dataset:
        """Reaction times and distances, and differences from the fixation point, at one threshold (attribute `theta`).

        Dims source, power and strategy.
        """
        return at_threshold_table(self.summary)

    @property
    def rules(self) -> xr.Dataset:
        """Stopping rules with the fixation point, dims source, power, rule and taps.

        `<name>_difference` is what they differ from the paper's rule.
        """
        return rules_table(self.summary)

    @property
    def trust(self) -> xr.Dataset:
        """Miscalibration and information about the object after five taps, dims source, power and strategy."""
        return trust_table(self.summary)

    @property
    def regret(self) -> xr.Dataset | None:
        """Cost beyond that of the exact rule or a bound, dims case, tap_cost, strategy and kind; `None` if left out."""
        return regret_table(self.summary)


def strategies(
    *data: TapSource,
    presets: Sequence[str] = DATA,
    data_sets: int = 10,
    division: Division = Division(),
    trials: int = 100,
    regret: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    patience: float = PATIENCE_S,
    seed: int = 0,
    progress: Progress = no_progress,
    command: str = "",
) -> StrategiesReport:
    """Compares control strategies and stopping rules on the same trials: error against taps and distance travelled.

    Args:
        data: Recorded taps or their files, each on its own, with a tap in every class.
        presets: Presets of the simulated rig; `"model"` draws taps from the model that perceives them.
        data_sets: Simulated data sets of each preset.
        division: Width of the cells, and whether test taps that are among the training taps are kept.
        trials: Trials of each data set and strategy.
        regret: Trials for the cost of strategies beyond that of the exact rule, or a bound, on taps of a correct model;
            0 skips that, `None` does it with the usual number if there is a preset.
        workers: Data sets at a time, or strategies for a single one; `None` for as many as there are cores.
        scheduler: Address of a Dask scheduler, to run on its cluster instead.
        patience: Seconds to wait for a lost scheduler or lost workers.
        seed: Random seed.
        progress: Called with the name and size of every stage; returns the function that advances it.
        command: The command line, for the page.

    Raises:
        InputError: The taps or a setting cannot be used.
    """
    check_counts(data_sets=data_sets, trials=trials, workers=workers)
    crew = crew_of(scheduler, workers, patience)
    check_counts(0, regret=regret, seed=seed)
    regret = TRIALS * bool(presets) if regret is None else regret
    if not presets and not data and not regret:
        raise InputError("--presets none requires a file of recorded taps, or --regret.")
    if len(set(presets)) < len(presets):
        raise InputError(f"--presets names one twice: {','.join(presets)}.")
    check_there(data)
    benches = [simulated_bench(name, data_sets, seed) for name in presets]
    benches += [recorded_bench(taps, division) for taps in data]
    settings = StrategySettings(trials=trials, seed=seed)
    found = tuple(strategy_study(bench, settings, progress, crew) for bench in benches)
    regrets = RegretSettings(regret, seed)
    lost = summarise_regret(regret_study(regrets, progress, crew), regrets) if regret else None
    described = TitleRecord(title="Control strategies and stopping rules", command=command)
    return StrategiesReport(found, summarise(found, settings, described, lost))
