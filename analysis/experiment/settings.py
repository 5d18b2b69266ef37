"""Settings that change the numbers of the experiment."""

import numpy as np

from ...inference.moves.control import check_fixation
from ...inference.trials.run import THRESHOLDS
from ...inference.tuning.tempering import fit_tempered
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ...models.measurement.registry import split_name, suited
from ...models.progress import Progress, no_progress
from ...models.settings import Checked, FitSettings, PlaySettings
from ...models.taps import TapSet

SHOWN_THETA = PlaySettings().threshold
"""Figures that show one threshold take the nearest to this."""


class ExperimentSettings(Checked, frozen=True, kw_only=True):
    """Settings that change the numbers of the experiment.

    Attributes:
        model: Measurement model of the catalogue.
        fit: How it is fitted.
        play: How episodes are played; figures that show one threshold take the nearest to `play.threshold`.
        trials: Trials per position, at which passive ones stay and active ones start, and about as many in all per
            fixation point other than the default; all thresholds share them.
        thresholds: theta_W.
        seed: Random seed of the trials.
    """

    model: str = "histogram"
    fit: FitSettings = FitSettings()
    play: PlaySettings = PlaySettings()
    trials: int = 1000
    thresholds: tuple[float, ...] = THRESHOLDS
    seed: int = 0

    @property
    def shown(self) -> int:
        """Index of the threshold nearest to `play.threshold`, for figures that show one."""
        return int(np.abs(np.asarray(self.thresholds) - self.play.threshold).argmin())

    @property
    def fresh_thresholds(self) -> tuple[float, ...]:
        """The threshold that is shown and those below, at which fresh taps are played."""
        return tuple(theta for theta in self.thresholds if theta <= self.thresholds[self.shown])

    def fitted(self, taps: TapSet, grid: ClassGrid, progress: Progress = no_progress) -> TapModel:
        """The measurement model of training taps under these settings.

        Raises:
            InputError: As `fit_tempered`.
        """
        fitted, _ = fit_tempered(self.model, taps, grid, suited(self.model, self.fit), progress=progress)
        return fitted.model


def check_settings(settings: ExperimentSettings, grid: ClassGrid) -> None:
    """Refuses settings that cannot be run, before any work is done.

    Raises:
        InputError: One is out of range.
    """
    check_fixation(settings.play.fixation, grid.L)
    if settings.trials < 1:
        raise InputError(f"--trials must be at least 1, got {settings.trials}.")
    if not settings.thresholds or not all(0 <= theta <= 1 for theta in settings.thresholds):
        raise InputError(f"--thresholds must be numbers from 0 to 1, got {settings.thresholds}.")
    _, in_states = split_name(settings.model)
    if in_states and settings.play.border == "prior":
        raise InputError("border 'prior' does not support models that carry a state; use 'uniform'.")
