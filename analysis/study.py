"""The paper's experiment on one data set: fit, then passive and active trials at every place and threshold."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..inference.control import check_fixation
from ..inference.episode import DEADLINE
from ..inference.montecarlo import THRESHOLDS, Trials, run_trials
from ..inference.reference import Border
from ..inference.tempering import fit_tempered
from ..inference.trial_plan import TapTable, TrialPlan, join_plans, plan_trials, tap_table
from ..models.catalogue import FitSettings, split_name
from ..models.classes import ClassGrid
from ..models.errors import InputError
from ..models.model import TapModel
from ..models.power import check_saturation
from ..models.splits import Fold
from ..models.taps import TapSet
from .contacts import Accuracy, accuracy
from .metrics import confusion, outcomes

SHOWN_THETA = 0.95  # threshold of the confusion matrices and trajectories


@dataclass(frozen=True)
class Settings:
    """Everything that changes the numbers of the experiment.

    Attributes:
        trials: Trials per sensing position (passive) and per fixation point (active); all thresholds share them.
        thresholds: theta_W.
        theta_x: Threshold on the where belief for a move of the active policy.
        fixation: Fixation point as where index; `None` for the middle.
        border: Reading of Eq. 9 at the ends of the range.
        deadline: Taps after which the most probable classes are taken.
        bins: Bins of the histogram, by which all models are judged.
        pseudocount: Counts added to every bin of the histogram.
        power: Root of the likelihood, or how it is learned, see `models.power`.
        value_range: Whether bins span all taxels together or each.
        saturation: How many taps' evidence an episode carries at most, see `inference.saturation`; `None` for no limit.
        seed: Of every random draw.
        model: Measurement model of the catalogue.
        unconverged: Whether a fit may be used that did not converge.
        shown_theta: Figures that show one threshold take the nearest to this.
    """

    trials: int = 1000
    thresholds: tuple[float, ...] = THRESHOLDS
    theta_x: float = 0.0
    fixation: int | None = None
    border: Border = "uniform"
    deadline: int = DEADLINE
    bins: int = 100
    pseudocount: float = 0.01
    power: str | float = "J"
    value_range: Literal["global", "taxel"] = "global"
    saturation: float | None = None
    seed: int = 0
    model: str = "histogram"
    unconverged: bool = False
    shown_theta: float = SHOWN_THETA

    @property
    def shown(self) -> int:
        """Index of the threshold nearest to `shown_theta`, for figures that show one."""
        return int(np.abs(np.asarray(self.thresholds) - self.shown_theta).argmin())

    def fit(self, taps: TapSet, grid: ClassGrid) -> TapModel:
        """The measurement model of training taps under these settings.

        Raises:
            InputError: As `fit_tempered`.
        """
        settings = FitSettings(
            bins=self.bins,
            pseudocount=self.pseudocount,
            power=self.power,
            saturation=np.inf if self.saturation is None else self.saturation,
            value_range=self.value_range,
            unconverged=self.unconverged,
            seed=self.seed,
        )
        fitted, _ = fit_tempered(self.model, taps, grid, settings)
        return fitted.model


class Study(NamedTuple):
    """One data set's results.

    Attributes:
        name: Of the data set.
        model: Fitted to the training taps.
        test: Test taps of trained classes.
        dropped: Number of test taps whose class has no training tap.
        table: Their log-likelihoods.
        passive: Outcomes by sensing position, see `metrics.outcomes`.
        active: Outcomes by fixation point; `None` with one where or one what class.
        passive_confusion: Shape (M, M) at the shown threshold.
        active_confusion: The same at the default fixation point.
        accuracy: After fixed numbers of contacts.
    """

    name: str
    model: TapModel
    test: TapSet
    dropped: int
    table: TapTable
    passive: xr.Dataset
    active: xr.Dataset | None
    passive_confusion: NDArray[np.int64]
    active_confusion: NDArray[np.int64] | None
    accuracy: list[Accuracy]


def study(fold: Fold, grid: ClassGrid, settings: Settings, progress: Callable[[int], None] | None = None) -> Study:
    """Runs the experiment on one training and test set.

    Args:
        fold: The data.
        grid: The classes.
        settings: What to do.
        progress: Called with the number of trials finished since the last call; `planned` tells the total.

    Raises:
        InputError: No test tap belongs to a trained class, or a setting is out of range.
    """
    model = settings.fit(fold.train, grid)
    test = model.usable(fold.test)
    table = tap_table(model, test)
    fixation = check_fixation(settings.fixation, grid.L)

    def play(plan: TrialPlan, theta_x: float) -> Trials:
        return run_trials(
            table,
            plan,
            settings.thresholds,
            theta_x=theta_x,
            border=settings.border,
            deadline=settings.deadline,
            seed=settings.seed,
            progress=progress,
        )

    plan = _passive_plan(table, settings)
    trials = play(plan, 1.0)
    passive = outcomes(trials, plan, plan.where, grid, settings.thresholds)
    passive_confusion = confusion(plan.what, trials.what[:, settings.shown], grid.M)
    active, active_confusion = None, None
    if can_act(grid):
        plan = _active_plan(table, settings, grid.L)
        trials = play(plan, settings.theta_x)
        active = outcomes(trials, plan, plan.fixation, grid, settings.thresholds)
        chosen = plan.fixation == fixation
        active_confusion = confusion(plan.what[chosen], trials.what[chosen, settings.shown], grid.M)
    rows = accuracy(table, settings.seed)
    dropped = len(fold.test) - len(test)
    return Study(fold.name, model, test, dropped, table, passive, active, passive_confusion, active_confusion, rows)


def can_act(grid: ClassGrid) -> bool:
    """Whether active perception means anything: there is somewhere to move and something to tell apart."""
    return grid.L > 1 and grid.M > 1


def planned(grid: ClassGrid, settings: Settings) -> int:
    """At most how many trials `study` plays, for progress bars."""
    return settings.trials * grid.L * (2 if can_act(grid) else 1)


def check_settings(settings: Settings, grid: ClassGrid) -> None:
    """Refuses settings that cannot be run, before any work is done.

    Raises:
        InputError: One is out of range.
    """
    check_fixation(settings.fixation, grid.L)
    if settings.saturation is not None:
        check_saturation(settings.saturation)
    if settings.trials < 1:
        raise InputError(f"--trials must be at least 1, got {settings.trials}.")
    if settings.deadline < 1:
        raise InputError(f"--deadline must be at least 1 tap, got {settings.deadline}.")
    if not settings.thresholds or not all(0 <= theta <= 1 for theta in settings.thresholds):
        raise InputError(f"--thresholds must be numbers from 0 to 1, got {settings.thresholds}.")
    if not 0 <= settings.theta_x <= 1:
        raise InputError(f"--theta-x must lie between 0 and 1, got {settings.theta_x}.")
    _, in_states = split_name(settings.model)
    if in_states and settings.border == "prior":
        raise InputError("--border prior does not go with a model that carries a state; uniform does.")


def _passive_plan(table: TapTable, settings: Settings) -> TrialPlan:
    positions = np.flatnonzero(table.pool.count.sum(axis=1))
    return join_plans(
        [
            plan_trials(table.pool, settings.trials, settings.seed, where=int(l), first_stream=int(l) * settings.trials)
            for l in positions
        ]
    )


def _active_plan(table: TapTable, settings: Settings, L: int) -> TrialPlan:
    """Every fixation point gets trials with the same starts and random streams, so that points compare in pairs."""
    plan = plan_trials(table.pool, settings.trials, settings.seed)
    return join_plans([plan._replace(fixation=np.full_like(plan.fixation, index)) for index in range(L)])
