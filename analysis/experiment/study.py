"""The paper's experiment on one data set: fit, then passive and active trials at every position and threshold."""

from collections.abc import Callable
from typing import NamedTuple

from ...inference.moves.control import check_fixation
from ...inference.trials.records import TapTable, tap_table
from ...models.grid import ClassGrid, can_act
from ...models.measurement.model import TapModel
from ...models.progress import Progress, no_progress
from ...models.splits import Fold
from ...models.taps import TapSet
from ..stats.contacts import Accuracy, accuracy
from .policies import PlayedPolicies, most_trials, play_policies, resamples_of
from .settings import ExperimentSettings


class Study(NamedTuple):
    """Results of one data set.

    Attributes:
        name: Of the data set.
        model: Fitted to the training taps.
        test: Test taps of trained classes.
        dropped: Number of test taps whose class has no training tap.
        table: Their log-likelihoods.
        played: What came of passive and active trials.
        accuracy: After fixed numbers of contacts.
    """

    name: str
    model: TapModel
    test: TapSet
    dropped: int
    table: TapTable
    played: PlayedPolicies
    accuracy: list[Accuracy]


def study(
    fold: Fold,
    grid: ClassGrid,
    settings: ExperimentSettings,
    progress: Callable[[int], None] | None = None,
    resamples: int = 0,
    fitting: Progress = no_progress,
) -> Study:
    """Runs the experiment on one training and test set.

    Args:
        fold: The data.
        grid: The classes.
        settings: What to do.
        progress: Called with the number of trials finished since the last call; `planned` tells the total.
        resamples: Of the test taps, for intervals where there is one data set only.
        fitting: Called with the name of a stage of the fit and its size; returns the function that advances it.

    Raises:
        InputError: No test tap belongs to a trained class, or a setting is out of range.
    """
    model = settings.fitted(fold.train, grid, fitting)
    test = model.usable(fold.test)
    table = tap_table(model, test)
    fixation = check_fixation(settings.play.fixation, grid.L)
    pools = resamples_of(table, resamples, settings.seed)
    played = play_policies(table, grid, settings, fixation, acts=can_act(grid), pools=pools, progress=progress)
    dropped = len(fold.test) - len(test)
    return Study(fold.name, model, test, dropped, table, played, accuracy(table, settings.seed, pools=pools.fresh))


def planned(grid: ClassGrid, settings: ExperimentSettings, resamples: int = 0) -> int:
    """How many trials `study` plays, or about as many, for progress bars."""
    return most_trials(grid, settings, can_act(grid), resamples)
