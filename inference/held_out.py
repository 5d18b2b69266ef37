"""Training taps behind models that have not seen them, for choices that are made before any test tap.

Each session is left out in turn and met by the model of the others. A single session is divided within each class,
in turn by recorded order, and either part is met by the model of the other; that shows less than a new session would.

What is averaged over parts has a standard error by how parts differ, not by how many trials are played: these draw the
same few taps again and again. Where parts are sessions, it is that of their mean, for errors of all trials of a session
go up and down together. The halves of one session differ by their taps alone, and each object has its own, so there the
differences of all objects count; what sessions would add is not in them. Intervals are those of Student's t.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t

from ..models.classes import ClassGrid
from ..models.errors import InputError
from ..models.model import TapModel
from ..models.splits import Fold, split
from ..models.taps import TapSet
from .trial_plan import TapTable, tap_table

type Floats = NDArray[np.float64]
CONFIDENCE = 0.95


class HeldOut(NamedTuple):
    """Taps and the model that they did not train.

    Attributes:
        name: What the part is called.
        model: Of all other taps.
        taps: Those of classes that it knows.
        table: Their log-likelihoods.
    """

    name: str
    model: TapModel
    taps: TapSet
    table: TapTable


class Parts(NamedTuple):
    """All training taps, each of them held out once.

    Attributes:
        grid: The classes.
        parts: F of them.
        by_session: Whether they are sessions rather than the halves of one.
        sentence: What was left out, in words.
    """

    grid: ClassGrid
    parts: tuple[HeldOut, ...]
    by_session: bool
    sentence: str


class Estimate(NamedTuple):
    """A mean over parts.

    Attributes:
        mean: Shape (...).
        error: Its standard error, shape (...).
        low: Lower end of the 95 % interval.
        high: Its upper end.
    """

    mean: Floats
    error: Floats
    low: Floats
    high: Floats


def held_out(
    taps: TapSet,
    grid: ClassGrid,
    fit: Callable[[TapSet, ClassGrid], TapModel],
    progress: Callable[[int], None] | None = None,
) -> Parts:
    """Divides training taps and fits a model to all but each part.

    Args:
        taps: The training taps.
        grid: The classes.
        fit: Gives the model of taps.
        progress: Told how many more models are fitted.

    Raises:
        InputError: A single session has no class with two taps, no tap of a part is of a class of the others, or most
            of its taps are among them.
    """
    by_session = len(np.unique(taps.session)) > 1
    folds = split(taps, grid, "leave-one-session-out" if by_session else "parity").folds
    if not by_session:
        odd = folds[0]
        folds = (Fold(odd.train, odd.test, "test even taps"), Fold(odd.test, odd.train, "test odd taps"))
    parts = []
    for fold in folds:
        model = fit(fold.train, grid)
        known = model.trained_with(fold.test)
        if 2 * known > len(fold.test):
            raise InputError(
                f"Of the {len(fold.test)} taps left out to {fold.name}, {known} stand among the others, so nothing is "
                "held out."
            )
        usable = model.usable(fold.test)
        parts.append(HeldOut(fold.name, model, usable, tap_table(model, usable)))
        if progress is not None:
            progress(1)
    told = (
        f"Each of {len(parts)} training sessions is left out in turn."
        if by_session
        else "There is one training session: its taps are halved within each class, and either half is left out in "
        "turn. A new session would differ more, so expect larger errors there and wider intervals than these."
    )
    return Parts(grid, tuple(parts), by_session, told)


def over_parts(values: ArrayLike, what: ArrayLike, by_session: bool, least: float = -np.inf) -> Estimate:
    """Mean over trials and parts; the standard error is at least that of the trials' own chance.

    Args:
        values: Of n trials in each of F parts, shape (F, ..., n).
        what: Object of each trial, of a shape that broadcasts to that.
        by_session: Whether parts are sessions.
        least: What no value can be below, nor the interval.
    """
    values = np.asarray(values, dtype=np.float64)
    F, n = len(values), values.shape[-1]
    means = values.mean(axis=-1)
    chance = values.var(axis=-1).sum(axis=0) / (n * F**2)
    between, freedom = (means.var(axis=0, ddof=1), F - 1) if by_session else _between_objects(values, what)
    error = np.sqrt(np.maximum(chance, between / F))
    half = error * t.ppf(0.5 + CONFIDENCE / 2, freedom)
    mean = means.mean(axis=0)
    return Estimate(mean, error, np.maximum(mean - half, least), mean + half)


def _between_objects(values: Floats, what: ArrayLike) -> tuple[Floats, int]:
    """Variance of a part's mean by the taps that it happens to hold, and its degrees of freedom.

    Each object's taps differ from part to part for themselves, so the variances of their shares add up.
    """
    what = np.broadcast_to(np.asarray(what), values.shape)
    total, freedom = np.zeros(values.shape[1:-1]), 0
    for m in np.unique(what):
        count = (what == m).sum(axis=-1)
        if not count.all():
            continue
        mean = (values * (what == m)).sum(axis=-1) / count
        total = total + (count / values.shape[-1]).mean(axis=0) ** 2 * mean.var(axis=0, ddof=1)
        freedom += len(values) - 1
    return total, max(1, freedom)


def decision_error(grid: ClassGrid, decided: ArrayLike, true: ArrayLike, wrong: bool = False) -> Floats:
    """Errors of decisions about objects: in the unit of their sizes, or 1 and 0 where `wrong` or they have none."""
    if wrong:
        return (np.asarray(decided) != np.asarray(true)).astype(np.float64)
    return grid.what_error(decided, true)
