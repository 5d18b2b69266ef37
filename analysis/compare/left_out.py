"""Groups of taps left out: models fitted without each, and their scores for its taps."""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...inference.trials.resampling import too_few
from ...models.errors import InputError
from ...models.grid import FEW_TAPS, ClassGrid
from ...models.measurement.draws import by_numpyro
from ...models.measurement.fits.portable import PortableFit
from ...models.measurement.generic.source import take_over
from ...models.measurement.model import BINS, Fitted
from ...models.measurement.registry import fit_model, suited
from ...models.settings import FitSettings
from ...models.taps import TapSet
from ..page.stages import StageClock
from ..tasks.crew import Crew, on_threads
from ..tasks.kept import Kept
from .groups import GroupFold, folds_of, known_taps, one_session, said, score_kinds, scorer
from .taps import TapScores, join_scores, mean_scores, relative_elpd


class LeftGroups(NamedTuple):
    """How groups are left out; the folds are made once in every process.

    Attributes:
        unit: One of `groups.UNITS`.
        train: Training taps.
        test: Test taps.
        grid: The classes.
        fit: How models are fitted.
        most: The most folds.
        one_recording: See `folds_of`.
        seed: Of the scores.
        functions: Of users, to be registered in another process.
        made: Keeps the folds.
    """

    unit: str
    train: TapSet
    test: TapSet
    grid: ClassGrid
    fit: FitSettings
    most: int
    one_recording: bool
    seed: int
    functions: dict[str, Any]
    made: Kept[tuple[list[GroupFold], str]]

    def folds(self) -> tuple[list[GroupFold], str]:
        """See `folds_of`."""
        given = self.unit, self.train, self.test, self.grid, self.most
        return self.made(None, lambda: folds_of(*given, one_recording=self.one_recording))


class _Refitted(NamedTuple):
    """A model without a fold, the classes that are judged, and the exponent of its decisions."""

    fold: int
    name: str
    made: PortableFit
    judged: NDArray[np.bool_]
    exponent: float


def leave_out_groups(
    fits: dict[str, Fitted], groups: LeftGroups, clock: StageClock, crew: Crew | None
) -> tuple[xr.Dataset | None, dict[str, Any], str, list[str]]:
    """Models fitted without each group and judged on its taps, on a cluster or here, several at a time.

    Here models of NumPyro run one after the other, as it runs them in one thread at a time.

    Returns:
        Means over (model), see `taps.mean_scores`, and log probabilities of the taps by model, see
        `taps.relative_elpd`, `None` and nothing without a second group; how groups were left out, and why models have
        no value, a sentence each.
    """
    crew = on_threads(alone=partial(_of_numpyro, fits)) if crew is None else crew
    unit, grid = groups.unit, groups.grid
    folds, sentence = groups.folds()
    if not folds:
        return None, {}, sentence, []
    scores: dict[str, dict[str, list[TapScores]]] = {}
    failed: dict[str, str] = {}
    with clock.stage(f"Leaving out {unit}s", len(folds) * len(fits)) as advance:
        for name, parts in crew(_score, _refits(fits, groups, failed, crew), groups, advance):
            for kind, part in parts.items():
                scores.setdefault(kind, {}).setdefault(name, []).append(part)
    whole = {
        kind: {name: join_scores(parts) for name, parts in named.items() if len(parts) == len(folds)}
        for kind, named in scores.items()
    }
    kinds = score_kinds(unit, grid, in_bins=all(fitted.model.measure == BINS for fitted in fits.values()))
    means = [mean_scores(named, next(iter(named)), kind, kinds[kind]) for kind, named in whole.items() if named]
    drawn = "class" if unit == "session" and one_session(folds) else unit
    merged = xr.merge(means, join="outer", combine_attrs="drop_conflicts") if means else None
    merged = None if merged is None else merged.assign_attrs(unit=unit, drawn=drawn)
    elpd = relative_elpd(predicted, len(folds)) if (predicted := whole.get("integrated")) else {}
    missing = [f"{name} has no value for left-out {unit}s: {reason}" for name, reason in failed.items()]
    return merged, elpd, sentence, [*missing, *_cautions(merged)]


def _cautions(means: xr.Dataset | None) -> list[str]:
    """What intervals of left-out sessions do not cover, or why they are wide, in a sentence."""
    if means is None or means.attrs["unit"] != "session":
        return []
    if means.attrs["drawn"] == "class":
        return ["One session is left out, so intervals of log probabilities of taps do not cover another session."]
    few = too_few(FEW_TAPS, sessions=means.attrs["clusters"], freedom=means.attrs["freedom"])
    return [f"Log probabilities of taps: {few}"] if few else []


def _refits(fits: dict[str, Fitted], groups: LeftGroups, failed: dict[str, str], crew: Crew) -> Iterator[_Refitted]:
    """The models fitted to the training taps of each fold; their power does not matter for taps."""
    folds, _ = groups.folds()
    wanted = [(number, name) for number, fold in enumerate(folds) if fold.train is not groups.train for name in fits]
    results = iter(crew(_refit, wanted, groups))
    for number, fold in enumerate(folds):
        refitted = {name: PortableFit(fitted) for name, fitted in fits.items()}
        for name in fits if fold.train is not groups.train else ():
            made = next(results)
            if isinstance(made, PortableFit):
                refitted[name] = made
            else:
                del refitted[name]
                failed.setdefault(name, f"without {fold.name}, {made}")
        if not refitted:
            raise InputError(f"No model can be fitted without {fold.name}.")
        judged = np.all([said(made.fitted.model.trained, groups.unit) for made in refitted.values()], axis=0)
        for name, made in refitted.items():
            yield _Refitted(number, name, made, judged, fits[name].model.exponent)


def _of_numpyro(fits: dict[str, Fitted], item: Any) -> bool:
    """Whether the model of a task runs NumPyro; tasks hold their fold and its name first."""
    fitted = fits[item[1]]
    return by_numpyro(fitted.model) or hasattr(fitted.posterior, "sizes")


def _refit(item: tuple[int, str], groups: LeftGroups) -> PortableFit | str:
    """A model without a fold, or why there is none."""
    (number, name), (folds, _) = item, groups.folds()
    take_over(groups.functions)
    try:
        fit = suited(name, groups.fit.changed(power="none"))
        return PortableFit(fit_model(name, folds[number].train, groups.grid, fit))
    except InputError as error:
        return str(error)


def _score(item: _Refitted, groups: LeftGroups) -> tuple[str, dict[str, TapScores]]:
    """Scores of a model for the taps of the fold that it is without."""
    folds, _ = groups.folds()
    taps = known_taps(folds[item.fold].test, groups.grid, item.judged)
    score = scorer(groups.unit, folds, groups.grid, groups.seed)
    return item.name, score(item.made.fitted, taps, item.exponent)
