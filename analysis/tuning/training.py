"""Training taps of a tuning, models fitted to them, and the files that every tuning writes."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ...inference.moves.table import learn_table, save_table
from ...inference.tuning.held_out import Parts, held_out, repeated_models, with_repeats
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.io.load import TapSource, names_of
from ...models.measurement.histogram import trim
from ...models.measurement.model import TapModel
from ...models.progress import Progress
from ...models.setting_file import Setting
from ...models.settings import Division, FitSettings
from ...models.splits import load_experiment
from ...models.taps import TapSet, concatenate
from ..experiment.parts import load_parts
from ..experiment.settings import ExperimentSettings
from ..page.report import Report

_TWO = 2  # tap sets that are divided as for a fit


@dataclass(frozen=True, eq=False)
class TrainingData:
    """Training taps and models of them, which are fitted when they are first needed.

    Attributes:
        taps: The taps.
        grid: Their classes.
        described: Which taps they are.
        settings: Model and fit.
        progress: Called with the name and size of every stage.
    """

    taps: TapSet
    grid: ClassGrid
    described: str
    settings: ExperimentSettings
    progress: Progress

    @property
    def sessions(self) -> int:
        """How many train."""
        return len(set(self.taps.session.tolist()))

    @cached_property
    def parts(self) -> Parts:
        """All taps, each held out once from its model."""
        stage = self.progress("Fitting models", max(_TWO, self.sessions))
        return held_out(self.taps, self.grid, self.settings.fitted, stage)

    @cached_property
    def repeated(self) -> Parts:
        """The same with models of fewer sessions, which intervals of their means need."""
        if not (models := repeated_models(self.parts)):
            return self.parts
        stage = self.progress("Fitting models of fewer sessions", models)
        return with_repeats(self.parts, self.taps, self.settings.fitted, stage)

    @cached_property
    def model(self) -> TapModel:
        """The model of all taps."""
        return self.settings.fitted(self.taps, self.grid)


@dataclass(frozen=True, eq=False, repr=False)
class TunedReport(Report):
    """Report of a tuning on training taps.

    Attributes:
        training: The taps and models of them.
    """

    training: TrainingData

    @property
    @abstractmethod
    def setting(self) -> Setting:
        """The setting with fixation point and threshold, to perceive with."""

    @property
    def parts(self) -> Parts:
        """The training taps, each held out once from its model."""
        return self.training.parts

    @property
    def model(self) -> TapModel:
        """The model of all training taps."""
        return self.training.model.with_scores(self.training.taps)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes the setting to a JSON file.

        Raises:
            InputError: The file cannot be written.
        """
        self.setting.save(path, force)

    def save_targets(self, path: str | Path, trials: int = 1000, seed: int = 0, force: bool = False) -> None:
        """Learns the best move from each estimated position on held-out taps, and writes it for `--move table`.

        Raises:
            InputError: The file cannot be written.
        """
        tables = [part.table for part in self.parts.parts]
        border = self.setting.play.border
        save_table(learn_table(tables, self.training.grid, border=border, trials=trials, seed=seed), path, force)


def training_data(
    data: Sequence[TapSource], division: Division, model: str, fit: FitSettings, progress: Progress
) -> TrainingData:
    """The training taps.

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
        told += f" Left out, because they have no training tap: {', '.join(dropped)}."
    described = f"{told} Only training taps are used."
    return TrainingData(taps, grid, described, ExperimentSettings(model=model, fit=fit), progress)
