"""Fixation point and threshold from training taps: what `solidtouch.tune` does and gives back."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...inference.trials.run import checked_thresholds
from ...inference.tuning.held_out import Parts, held_out
from ...models.errors import InputError
from ...models.experiment import load_experiment
from ...models.grid import ClassGrid
from ...models.io.load import TapSource, names_of
from ...models.measurement.histogram import trim
from ...models.measurement.registry import PAPER
from ...models.setting_file import Setting
from ...models.settings import Division, FitSettings, PlaySettings
from ...models.taps import TapSet, concatenate
from ..experiment.parts import load_parts
from ..experiment.settings import ExperimentSettings
from ..page.page import Brief, Page
from ..page.report import Report
from ..page.stages import Progress, no_progress
from .page import position_table, threshold_table
from .run import Price, Tuning, check_objects, check_price, tune_parts, tuning_trials

_TWO = 2  # tap sets that are divided as for a fit


@dataclass(frozen=True, eq=False, repr=False)
class TuningReport(Report):
    """The fixation point and the threshold that were chosen, with the curves they were chosen from.

    Attributes:
        found: All results.
        parts: The training taps, each held out once from its model.
    """

    found: Tuning
    parts: Parts

    def _page(self) -> Page:
        tables = Brief(position_table(self.found)), Brief(threshold_table(self.found))
        sentences = self.parts.sentence, *self.found.sentences
        return Page("Tuning", [*tables, *(Brief(sentence) for sentence in sentences)], [])

    @property
    def setting(self) -> Setting:
        """The setting with both, to perceive with."""
        return self.found.setting

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes the setting to a JSON file.

        Raises:
            InputError: The file cannot be written.
        """
        self.setting.save(path, force)


def tune(
    *data: TapSource,
    cost_error: float = 50.0,
    wrong: bool = False,
    target_error: float | None = None,
    by: Literal["active", "passive"] = "active",
    thresholds: Sequence[float] | None = None,
    model: str = PAPER,
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    play: PlaySettings = PlaySettings(),
    trials: int = 1000,
    seed: int = 0,
    progress: Progress = no_progress,
) -> TuningReport:
    """Chooses the fixation point and the belief threshold from training taps.

    Args:
        data: Taps or their files, of which the training taps are used; see `tuning_taps`.
        cost_error: Taps that an error of 1 is worth, in the unit of errors.
        wrong: Whether errors are P(wrong) even where objects have sizes to be wrong by.
        target_error: The least threshold with this P(wrong) in a new session is chosen instead.
        by: Whether positions are judged by trials that aim for them, or by trials that stay there.
        thresholds: Belief thresholds to choose from; `None` for many.
        model: The measurement model, see docs/reference/models.md.
        division: How taps are grouped into classes, and how one tap set is divided.
        fit: How the model is fitted; its seed is `seed`.
        play: How trials are played; its threshold is that at which positions are compared.
        trials: Trials in each part, at each position and for the threshold.
        seed: Random seed.
        progress: Told the name and size of every stage; gives the function that counts what is done.

    Raises:
        InputError: The taps or a setting cannot be used.

    >>> import solidtouch as st
    >>> train, test = st.simulate("ideal", sessions=2, seed=1)
    >>> report = st.tune(train, test, trials=50, thresholds=[0.5, 0.9])
    >>> report.setting.play.threshold in (0.5, 0.9)
    True
    """
    price = Price(cost_error, wrong, target_error)
    setting = Setting(model=model, fit=fit, where_cell=division.where_cell, what_cell=division.what_cell, play=play)
    taps, grid, _ = tuning_taps(data, division)
    sessions = len(set(taps.session.tolist()))
    check_objects(grid)
    check_price(price, sessions)
    fitted = ExperimentSettings(model=model, fit=fit.changed(seed=seed)).fitted
    parts = held_out(taps, grid, fitted, progress("Fitting models", max(_TWO, sessions)))
    found = tune_parts(
        parts,
        setting,
        price,
        thresholds=None if thresholds is None else checked_thresholds(thresholds),
        passive=by == "passive",
        trials=trials,
        seed=seed,
        progress=progress("Playing trials", tuning_trials(parts, trials)),
    )
    return TuningReport(found, parts)


def tuning_taps(data: Sequence[TapSource], division: Division) -> tuple[TapSet, ClassGrid, str]:
    """The training taps, their classes, and which they are in words.

    Of three tap sets or more all but the last train; one or two are divided as for a fit.

    Raises:
        InputError: The taps cannot be used, or have no one training part.
    """
    if len(data) > _TWO:
        division.refuse_split("of several all but the last train")
        divided, grid = load_parts(data, division.changed(training_taps=True))
        taps = concatenate([divided.train, *divided.tune])
        told = f"{len(data) - 1} files train; {Path(names_of(data)[-1]).name} is kept for tests."
    else:
        parts, grid = load_experiment(data, division.changed(training_taps=True))
        if len(parts.folds) != 1:
            raise InputError(f"--split {parts.method} has no one training part; choose another.")
        taps, told = parts.folds[0].train, parts.description
    grid, dropped = trim(grid, [taps])
    if dropped:
        told += f" Left out for want of a training tap: {', '.join(dropped)}."
    return taps, grid, f"{told} Only training taps are used."
