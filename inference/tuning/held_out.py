"""Training taps with models that did not train on them, for choices without test taps.

Each session is left out in turn and met by the model of the others. A single session is divided within each class,
in turn by recorded order, and either part is met by the model of the other; that shows less than a new session would.

What is averaged over parts has a standard error by what would be drawn anew, not by how many trials are played: these
draw the same few taps again and again. Where parts are sessions, it is that of their mean, for errors of all trials of
a session go up and down together, and each has taps of its own. The halves of one session are no such units: there the
same trials are played on resamples of their taps within each class, and the models stay; what sessions would add is not
in them. Intervals are those of Student's t.

No trial draws a tap twice: halves have few taps, and drawing them again and again makes right beliefs too sure.
"""

from collections.abc import Callable, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ...models.splits import Fold, split
from ...models.taps import TapSet
from ..trials.records import TapTable, tap_table
from ..trials.resampling import spread, too_few, widened
from ..trials.selections import resampled_pools

type Floats = NDArray[np.float64]
CONFIDENCE = 0.95
RESAMPLES = 40
"""Number of resamples of the taps of halves."""


class HeldOut(NamedTuple):
    """Taps and a model that they did not train.

    Attributes:
        name: What the part is called.
        model: Model of all other taps.
        taps: Those of classes that it knows.
        table: Their log-likelihoods.
    """

    name: str
    model: TapModel
    taps: TapSet
    table: TapTable


class Parts(NamedTuple):
    """All training taps, each held out once.

    Attributes:
        grid: The classes.
        parts: F of them.
        by_session: Whether they are sessions rather than the halves of one.
        sentence: Description of what was left out.
    """

    grid: ClassGrid
    parts: tuple[HeldOut, ...]
    by_session: bool
    sentence: str


class Estimate(NamedTuple):
    """Mean over parts.

    Attributes:
        mean: Shape (...).
        error: Its standard error, shape (...).
        low: Lower end of the 95% interval.
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
    """Parts of training taps, each with a model fitted to all others.

    Args:
        taps: The training taps.
        grid: The classes.
        fit: Gives the model of taps.
        progress: Called with the number of models fitted since the last call.

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
                f"{known} of the {len(fold.test)} taps held out to {fold.name} also occur in the training taps; remove "
                "the duplicates."
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
    count = np.concatenate([part.table.pool.count[part.table.pool.count > 0] for part in parts])
    return Parts(grid, tuple(parts), by_session, f"{told} {too_few(int(np.median(count)))}".rstrip())


def over_parts(
    values: ArrayLike, resampled: Floats | None = None, least: float = -np.inf, endings: Sequence[ArrayLike] = ()
) -> Estimate:
    """Mean over trials and parts.

    Args:
        values: Values of n trials in each of F parts, shape (F, ..., n).
        resampled: Where parts are halves of a session: the same mean on each of R resamples of their taps, see
            `resampled_means`, shape (R, ...). Where they are sessions, `None`; the standard error then is that of
            their mean, and at least that of the trials' own chance.
        least: What no value can be below, nor the interval.
        endings: What else the values might be, see `cut_short`: the interval holds those of all.
    """
    values = np.asarray(values, dtype=np.float64)
    F, n = len(values), values.shape[-1]
    means = values.mean(axis=-1)
    if resampled is None:
        chance = values.var(axis=-1).sum(axis=0) / (n * F**2)
        error, freedom = np.sqrt(np.maximum(chance, means.var(axis=0, ddof=1) / F)), F - 1
    else:
        error, freedom = resampled.std(axis=0, ddof=1), len(resampled) - 1
    half = error * stdtrit(freedom, 0.5 + CONFIDENCE / 2)
    mean = means.mean(axis=0)
    all_ = [mean, *(np.asarray(ending).mean(axis=(0, -1)) for ending in endings)]
    low, high = np.minimum.reduce(all_) - half, np.maximum.reduce(all_) + half
    return Estimate(mean, error, np.maximum(low, least), high)


def excess_over_parts(
    values: Floats, chosen: int, resampled: Floats | None = None, endings: Sequence[Floats] = ()
) -> Estimate:
    """Mean excess over the chosen option, arguments as in `over_parts`, shape (F, options, n)."""
    apart = [one - other[:, [chosen]] for one, other in zip(endings, endings[::-1], strict=True)]
    for one in apart:
        one[:, chosen] = 0.0
    drawn = None if resampled is None else resampled - resampled[:, [chosen]]
    return over_parts(values - values[:, [chosen]], drawn, endings=apart)


def with_unseen(error: Estimate, taps: ArrayLike, parts: Parts, wrong: bool) -> Estimate:
    """Errors with intervals that allow for errors where none occurred, see `resampling.widened`.

    Args:
        error: Mean errors, each of shape (...).
        taps: Mean taps of a decision, likewise.
        parts: Training taps and models that have not seen them.
        wrong: Whether errors are P(wrong) even where objects have sizes.
    """
    decided, true = np.indices((parts.grid.M, parts.grid.M))
    sizes = decision_error(parts.grid, decided, true, wrong)
    least = sizes[sizes > 0].min(initial=sizes.max())
    decisions = sum(int(part.table.pool.count.sum()) for part in parts.parts) / np.asarray(taps)
    low, high = widened(error.low, error.high, error.mean, error.mean, decisions, least, np.inf)
    return error._replace(low=low, high=high)


def resampled_means(
    parts: Parts, play: Callable[[TapTable, int], Sequence[Floats]], trials: int, seed: int
) -> list[Floats] | None:
    """Resampled means for `over_parts` if parts are halves of one session; `None` if they are sessions.

    Args:
        parts: The parts.
        play: Plays trials on a table, from a random stream on, and gives values of the trials, each of shape (..., n).
        trials: Random streams that it takes.
        seed: Random seed of the resamples.

    Returns:
        Means over trials and parts for each of what `play` gives, shape (R, ...), their deviations enlarged as
        `resampling.Spread` says.
    """
    if parts.by_session:
        return None
    of_parts = []
    for part in parts.parts:
        pools = islice(resampled_pools(part.table, RESAMPLES, seed), 1, None)
        tables = (part.table._replace(pool=pool) for pool in pools)
        played = (play(table, r * trials) for r, table in enumerate(tables, 1))
        kept = zip(*([np.asarray(v).mean(axis=-1) for v in values] for values in played), strict=True)
        of_parts.append([_enlarged(np.array(means), spread(part.table).factor) for means in kept])
    return [np.mean(means, axis=0) for means in zip(*of_parts, strict=True)]


def _enlarged(values: Floats, factor: float) -> Floats:
    mean = values.mean(axis=0)
    return mean + factor * (values - mean)


def decision_error(grid: ClassGrid, decided: ArrayLike, true: ArrayLike, wrong: bool = False) -> Floats:
    """Errors of decided objects: in the unit of their sizes, or 0 and 1 with `wrong` or without sizes."""
    if wrong:
        return (np.asarray(decided) != np.asarray(true)).astype(np.float64)
    return grid.what_error(decided, true)
