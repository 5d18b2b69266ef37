"""Cross-check of all ways of computing the posterior: the function `solidtouch.crosscheck` and its report."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import xarray as xr

from ...inference.reference import ZeroEvidenceError
from ...models.errors import InputError, check_counts
from ...models.io.load import TapSource
from ...models.measurement.histogram import trim
from ...models.measurement.registry import PAPER, AnyModel, model_names
from ...models.progress import Progress, no_progress
from ...models.settings import Division, FitSettings, PlaySettings
from ...models.splits import Split, load_experiment
from ..experiment.crosscheck import CrossCheck, crosscheck_model
from ..experiment.settings import ExperimentSettings
from ..page.labelled import labelled
from ..page.page import Page
from ..page.report import Report
from .page import crosscheck_page


@dataclass(frozen=True, eq=False, repr=False)
class CrossCheckReport(Report):
    """Largest differences between independent ways of computing the posterior.

    Attributes:
        found: All results, by model.
        refused: Why other models could not be checked, by model.
        split: Training and test taps.
    """

    found: Mapping[str, CrossCheck]
    refused: Mapping[str, str]
    split: Split

    def _page(self) -> Page:
        return crosscheck_page(self.found, self.refused, self.split)

    @property
    def passed(self) -> bool:
        """Whether all routes agree for every model that was checked."""
        return all(check.passed for check in self.found.values())

    @property
    def differences(self) -> xr.Dataset:
        """Largest and allowed differences, dims model, routes and quantity; `allowed` is NaN where none is compared."""
        rows = ({"model": name, **row._asdict()} for name, check in self.found.items() for row in check.rows)
        return labelled(rows, ("model", "routes", "quantity"))


def crosscheck(
    *data: TapSource,
    models: AnyModel | Sequence[AnyModel] = (PAPER,),
    division: Division = Division(),
    fit: FitSettings = FitSettings(),
    play: PlaySettings = PlaySettings(),
    episodes: int = 10,
    length: int = 40,
    sequence_taps: int = 20,
    seed: int = 0,
    progress: Progress = no_progress,
) -> CrossCheckReport:
    """Compares all engines on episodes with moves over test taps.

    >>> import solidtouch as st
    >>> train, test = st.simulate("ideal", sessions=2, seed=1)
    >>> report = st.crosscheck(train, test, episodes=1, length=3, sequence_taps=0)
    >>> report.passed
    True
    >>> bool(report.differences["largest"].sel(model="histogram", routes="numpy, filter", quantity="posterior") < 1e-10)
    True

    Args:
        data: One tap set or file that is divided, or two, of which the first trains and the second tests.
        models: Names of measurement models, see docs/reference/models.md. Of several, those that cannot be fitted to
            the taps are listed in `refused`.
        division: How taps are grouped into classes, and how one tap set is divided; of several folds the first counts.
        fit: How models are fitted; their seed is `seed`.
        play: Its border is the reading of Eq. 9.
        episodes: Episodes to compare.
        length: Taps of each.
        sequence_taps: Taps of each that are enumerated at once, at most 20.
        seed: Random seed.
        progress: Called with the name and size of every stage; returns the function that advances it.

    Raises:
        InputError: The taps or a setting cannot be used, or no model can be checked.
    """
    check_counts(episodes=episodes, length=length)
    check_counts(0, sequence_taps=sequence_taps, seed=seed)
    names = model_names(models)
    settings = ExperimentSettings(fit=fit.changed(seed=seed), play=play, seed=seed)
    split, grid = load_experiment(data, division)
    grid, _ = trim(grid, [fold.train for fold in split.folds])
    fold = split.folds[0]

    def check(name: str) -> CrossCheck:
        chosen = settings.changed(model=name)
        fitted = chosen.fitted(fold.train, grid, progress)
        advance = progress("Cross-checking engines" if len(names) == 1 else f"Cross-checking {name}", episodes)
        return crosscheck_model(
            fitted,
            fitted.usable(fold.test),
            train=fold.train,
            settings=settings,
            border=play.border,
            episodes=episodes,
            length=length,
            sequence_taps=sequence_taps,
            seed=seed,
            progress=lambda: advance(1),
        )

    if len(names) == 1:
        return CrossCheckReport({names[0]: check(names[0])}, {}, split)
    found: dict[str, CrossCheck] = {}
    refused: dict[str, str] = {}
    for name in names:
        try:
            found[name] = check(name)
        except (InputError, ZeroEvidenceError) as error:
            refused[name] = str(error)
    if not found:
        reasons = " ".join(f"{name}: {reason}" for name, reason in refused.items())
        raise InputError(f"No model could be checked. {reasons}".strip())
    return CrossCheckReport(found, refused, split)
