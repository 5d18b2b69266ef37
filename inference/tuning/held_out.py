"""Training taps with models that did not train on them, for choices without test taps.

Each session is left out in turn and met by the model of the others. A single session is divided within each class,
in turn by recorded order, and either part is met by the model of the other; that shows less than a new session would.

What is averaged over parts has a standard error by what would be drawn anew, not by how many trials are played: these
draw the same few taps again and again. Where parts are sessions, these would be: each is left out as one that tests and
as one that trains the models of the others (jackknife, see `with_repeats`). Means of parts alone would differ too
little: a session whose taps are easy to tell apart is so in a test, and makes the models of all other parts surer.
The halves of one session are no such units: there the same trials are played on resamples of their taps within each
class, and the models stay; what sessions would add is not in them. Intervals are those of Student's t.

No trial draws a tap twice: halves have few taps, and drawing them again and again makes right beliefs too sure.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations, islice
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
GROUPS = 10
"""Sessions are left out of a repeat in at most so many groups, which bounds the number of models."""
_PAIR = 2


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
        repeats: For each session that a repeat leaves out, the numbers of the other parts and the models that meet
            them, see `with_repeats`; empty where parts are halves.
    """

    grid: ClassGrid
    parts: tuple[HeldOut, ...]
    by_session: bool
    sentence: str
    repeats: tuple[tuple[tuple[int, TapModel], ...], ...]

    @property
    def played(self) -> int:
        """How many tables trials are played on, for values and their intervals."""
        return len(self.parts) * (1 + (0 if self.by_session else RESAMPLES)) + sum(map(len, self.repeats))

    def tables(self) -> Iterator[Iterator[tuple[int, TapTable]]]:
        """Tables of each repeat, with the numbers of their parts."""
        for repeat in self.repeats:
            parts = ((f, model, self.parts[f]) for f, model in repeat)
            yield ((f, one.table if model is one.model else tap_table(model, one.taps)) for f, model, one in parts)


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
    F = range(len(parts) if by_session else 0)
    repeats = tuple(tuple((f, parts[f].model) for f in F if f != g) for g in F)
    return Parts(grid, tuple(parts), by_session, f"{told} {too_few(int(np.median(count)))}".rstrip(), repeats)


def with_repeats(
    parts: Parts,
    taps: TapSet,
    fit: Callable[[TapSet, ClassGrid], TapModel],
    progress: Callable[[int], None] | None = None,
) -> Parts:
    """The same parts with repeats that leave sessions out of models, too.

    The sessions are left out in turn, in `GROUPS` groups if there are more (delete-a-group jackknife, Kott 2001), and
    the parts that stay are met by models without that group and their own. Models stay if one of them cannot be fitted
    or has no taps of a class of its part, which the sentence then says.

    Args:
        parts: Parts of all taps; those of one or two sessions are returned as they are.
        taps: The training taps.
        fit: Gives the model of taps.
        progress: Called with the number of models fitted since the last call, of `repeated_models` in all.
    """
    F = len(parts.parts)
    if not repeated_models(parts):
        return parts
    group = np.arange(F) % min(F, GROUPS)
    session = np.array([part.taps.session[0] for part in parts.parts])
    models = {}
    for pair in combinations(range(group.max() + 1), _PAIR):
        kept = ~np.isin(taps.session, session[np.isin(group, pair)])
        try:
            models[frozenset(pair)] = model = fit(taps.select(kept), parts.grid)
            known = all(model.known(parts.parts[f].taps).all() for f in np.flatnonzero(np.isin(group, pair)))
        except InputError:
            known = False
        if not known:
            return parts._replace(sentence=f"{parts.sentence} {_MODELS_STAY}")
        if progress is not None:
            progress(1)
    repeats = [
        [(f, models[frozenset((g, int(group[f])))]) for f in range(F) if group[f] != g] for g in range(group.max() + 1)
    ]
    return parts._replace(repeats=tuple(map(tuple, repeats)))


def repeated_models(parts: Parts) -> int:
    """How many models `with_repeats` fits at most."""
    G = min(len(parts.parts), GROUPS)
    return G * (G - 1) // 2 if parts.by_session and G > _PAIR else 0


def over_parts(values: ArrayLike, drawn: Floats, least: float = -np.inf, endings: Sequence[ArrayLike] = ()) -> Estimate:
    """Mean over trials and parts.

    Args:
        values: Values of n trials in each of F parts, shape (F, ..., n).
        drawn: The same mean in each of R repeats, see `repeated_means`, shape (R, ...).
        least: What no value can be below, nor the interval.
        endings: What else the values might be, see `cut_short`: the interval holds those of all.
    """
    error = drawn.std(axis=0, ddof=1)
    half = error * stdtrit(len(drawn) - 1, 0.5 + CONFIDENCE / 2)
    mean, *others = (np.asarray(one, dtype=np.float64).mean(axis=(0, -1)) for one in (values, *endings))
    low, high = np.minimum.reduce([mean, *others]) - half, np.maximum.reduce([mean, *others]) + half
    return Estimate(mean, error, np.maximum(low, least), high)


def excess_over_parts(values: Floats, chosen: int, drawn: Floats, endings: Sequence[Floats] = ()) -> Estimate:
    """Mean excess over the chosen option, arguments as in `over_parts`, shape (F, options, n)."""
    apart = [one - other[:, [chosen]] for one, other in zip(endings, endings[::-1], strict=True)]
    for one in apart:
        one[:, chosen] = 0.0
    return over_parts(values - values[:, [chosen]], drawn - drawn[:, [chosen]], endings=apart)


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


def repeated_means(
    parts: Parts, play: Callable[[TapTable, int], Sequence[Floats]], trials: int, seed: int
) -> list[Floats]:
    """Means over trials and parts in repeats of the study, for `over_parts`.

    Args:
        parts: The parts.
        play: Plays trials on a table, from a random stream on, and gives values of the trials, each of shape (..., n).
        trials: Random streams that it takes.
        seed: Random seed of resamples of taps.

    Returns:
        For each of what `play` gives its mean in R repeats, their deviations enlarged so that they vary as the mean of
        a repeated study would, shape (R, ...).
    """

    def mean(table: TapTable, stream: int) -> list[Floats]:
        return [np.asarray(values).mean(axis=-1) for values in play(table, stream * trials)]

    if parts.by_session:
        played = [[mean(table, f) for f, table in tables] for tables in parts.tables()]
        G = len(played)
        means = [[np.mean(values, axis=0) for values in zip(*repeat, strict=True)] for repeat in played]
        return [_enlarged(np.array(values), (G - 1) / np.sqrt(G)) for values in zip(*means, strict=True)]
    of_parts = []
    for f, part in enumerate(parts.parts):
        pools = islice(resampled_pools(part.table, RESAMPLES, seed), 1, None)
        tables = (part.table._replace(pool=pool) for pool in pools)
        kept = zip(*(mean(table, r * len(parts.parts) + f) for r, table in enumerate(tables, 1)), strict=True)
        of_parts.append([_enlarged(np.array(means), spread(part.table).factor) for means in kept])
    return [np.mean(means, axis=0) for means in zip(*of_parts, strict=True)]


_MODELS_STAY = (
    "Without two of the sessions some classes have no taps or no model can be fitted, so intervals take the models as "
    "they are and may be too narrow."
)


def _enlarged(values: Floats, factor: float) -> Floats:
    mean = values.mean(axis=0)
    return mean + factor * (values - mean)


def decision_error(grid: ClassGrid, decided: ArrayLike, true: ArrayLike, wrong: bool = False) -> Floats:
    """Errors of decided objects: in the unit of their sizes, or 0 and 1 with `wrong` or without sizes."""
    if wrong:
        return (np.asarray(decided) != np.asarray(true)).astype(np.float64)
    return grid.what_error(decided, true)
