"""Fixation point and threshold from training taps: the function `solidtouch.tune` and its report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from ...inference.trials.run import checked_thresholds
from ...models.errors import check_counts
from ...models.io.load import TapSource
from ...models.measurement.registry import PAPER, AnyModel, model_name
from ...models.progress import Progress, no_progress
from ...models.setting_file import Setting
from ...models.settings import Division, FitSettings, PlaySettings
from ..page.page import Brief, Page
from .page import position_table, threshold_table
from .run import Price, Tuning, check_objects, check_price, tune_parts, tuning_trials
from .training import TunedReport, training_data


@dataclass(frozen=True, eq=False, repr=False)
class TuningReport(TunedReport):
    """The fixation point and the threshold that were chosen, with the curves they were chosen from.

    Attributes:
        training: The taps and models of them.
        found: All results.
    """

    found: Tuning

    def _page(self) -> Page:
        tables = Brief(position_table(self.found)), Brief(threshold_table(self.found))
        sentences = *self.found.sentences, self.training.repeated.sentence
        return Page("Tuning", [*(Brief(sentence) for sentence in sentences), *tables], [])

    @property
    def setting(self) -> Setting:
        """The setting with both, to perceive with."""
        return self.found.setting


def tune(
    *data: TapSource,
    cost_error: float = 50.0,
    wrong: bool = False,
    target_error: float | None = None,
    by: Literal["active", "passive"] = "active",
    thresholds: Sequence[float] | None = None,
    model: AnyModel = PAPER,
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    play: PlaySettings = PlaySettings(),
    trials: int = 1000,
    seed: int = 0,
    progress: Progress = no_progress,
    note: Callable[[str], object] = lambda sentence: None,  # noqa: ARG005
) -> TuningReport:
    """Chooses the fixation point and the belief threshold from training taps.

    Args:
        data: Taps or their files, of which the training taps are used: all but the last of three
            or more, and of one or two those of a fit.
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
        progress: Called with the name and size of every stage; returns the function that advances it.
        note: Called with a sentence about the training taps.

    Raises:
        InputError: The taps or a setting cannot be used.

    >>> import solidtouch as st
    >>> train, test = st.simulate("ideal", sessions=2, seed=1)
    >>> report = st.tune(train, test, trials=50, thresholds=[0.5, 0.9])
    >>> report.setting.play.threshold in (0.5, 0.9)
    True
    """
    check_counts(trials=trials)
    check_counts(0, seed=seed)
    price = Price(cost_error, wrong, target_error)
    name, cells = model_name(model), (division.where_cell, division.what_cell)
    setting = Setting(model=name, fit=fit, where_cell=cells[0], what_cell=cells[1], play=play)
    chosen = None if thresholds is None else checked_thresholds(thresholds)
    training = training_data(data, division, name, fit.changed(seed=seed), progress)
    check_objects(training.grid)
    check_price(price, training.sessions)
    note(training.described)
    parts = training.repeated
    found = tune_parts(
        parts,
        setting,
        price,
        thresholds=chosen,
        passive=by == "passive",
        trials=trials,
        seed=seed,
        progress=progress("Playing trials", tuning_trials(parts, trials)),
    )
    return TuningReport(training, found)
