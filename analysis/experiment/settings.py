"""What changes the numbers of the experiment."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...inference.episode import DEADLINE
from ...inference.moves.control import check_fixation
from ...inference.reference import Border
from ...inference.trials.run import THRESHOLDS
from ...inference.tuning.tempering import fit_tempered
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.catalogue import FitSettings, split_name
from ...models.measurement.model import TapModel
from ...models.power import check_saturation
from ...models.taps import TapSet

SHOWN_THETA = 0.95  # threshold of the confusion matrices and trajectories


@dataclass(frozen=True)
class Settings:
    """Everything that changes the numbers of the experiment.

    Attributes:
        trials: Trials per position, at which passive ones stay and active ones start, and about as many in all per
            fixation point other than the default; all thresholds share them.
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

    @property
    def fresh_thresholds(self) -> tuple[float, ...]:
        """The threshold that is shown and those below, at which fresh taps are played."""
        return tuple(theta for theta in self.thresholds if theta <= self.thresholds[self.shown])

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
