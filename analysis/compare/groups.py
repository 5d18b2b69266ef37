"""Groups of taps that models predict from the others: sessions, positions or objects.

A session left out shows how a model does when it is put to use. A position or object left out shows what it says about
one that it was never trained on: the model's own likelihood where its parameters carry over from other classes, else
the mean of those at the trained positions of the same object, or of the trained objects at the same position.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.draws import integrated, plug_in
from ...models.measurement.likelihood.true_class import Own
from ...models.measurement.model import Fitted
from ...models.seeds import Purpose, generator
from ...models.taps import TapSet, concatenate
from .taps import LOG_PROBABILITY, ScoreKind, TapScores

UNITS = ("session", "position", "object")
_AXIS = {"position": 0, "object": 1}
_ROOM = 1 << 23  # samples of repeated taps held at a time


class GroupFold(NamedTuple):
    """One group left out."""

    name: str
    train: TapSet
    test: TapSet


def folds_of(
    unit: str, train: TapSet, test: TapSet, grid: ClassGrid, most: int, *, one_recording: bool = False
) -> tuple[list[GroupFold], str]:
    """Every session, position or object left out in turn, in at most `most` groups of neighbours.

    Sessions are those of both sets. Positions and objects are left out of the training taps and predicted in the test
    taps, so that sessions stay apart as they were divided.

    Args:
        unit: One of `UNITS`.
        train: Training taps.
        test: Test taps.
        grid: The classes.
        most: The most folds.
        one_recording: Whether sessions of the same number in both are the same session.

    Returns:
        The folds, one that tests `test` on `train` itself last where there is such a one, and a sentence. No fold
        where there is one session, position or object only.
    """
    if unit == "session":
        return _session_folds(train, test, most, one_recording)
    axis = _AXIS[unit]
    trained, tested, others = train.indices(grid)[axis], test.indices(grid)[axis], test.indices(grid)[1 - axis]
    groups = _groups(np.intersect1d(trained[trained >= 0], tested[tested >= 0]), most)
    if len(np.unique(trained[trained >= 0])) < 2 or len(groups) < 2:
        return [], f"No {unit} can be left out, because TRAIN and TEST share fewer than two."
    names = grid.what_name if axis else [grid.where_label(l) for l in range(grid.L)]
    folds = [
        GroupFold(
            f"{unit} {', '.join(names[i] for i in group)}",
            train.select(~np.isin(trained, group)),
            test.select(np.isin(tested, group) & (others >= 0)),
        )
        for group in groups
    ]
    each = _each(unit, groups, len(np.concatenate(groups)))
    return folds, f"{each} of TEST was predicted by models trained without it."


def said(trained: NDArray[np.bool_], unit: str) -> NDArray[np.bool_]:
    """Mask of the classes that a model can say something about, shape (L, M).

    Args:
        trained: Classes with training taps, or with parameters from others, shape (L, M).
        unit: What is left out, one of `UNITS`.
    """
    return trained if unit == "session" else np.broadcast_to(trained.any(_AXIS[unit], keepdims=True), trained.shape)


def known_taps(taps: TapSet, grid: ClassGrid, covered: NDArray[np.bool_]) -> TapSet:
    """The taps of covered classes.

    Raises:
        InputError: There is none.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    inside[inside] = covered[where[inside], what[inside]]
    if not inside.any():
        raise InputError("No tap is left: none belongs to a class with a training tap.")
    return taps.select(inside)


type Scorer = Callable[[Fitted, TapSet, float], dict[str, TapScores]]


def scorer(unit: str, folds: Sequence[GroupFold], grid: ClassGrid, seed: int) -> Scorer:
    """What scores the left-out taps under a model, given the exponent of its decisions."""
    if unit == "session":
        alone = one_session(folds)
        return lambda fitted, taps, _: score_sessions(fitted, taps, seed, alone=alone)
    axis = _AXIS[unit]
    fold_of = np.full(grid.shape[axis], -1)
    for number, fold in enumerate(folds):
        fold_of[fold.test.indices(grid)[axis]] = number
    return lambda fitted, taps, exponent: score_places(fitted, taps, unit, fold_of, seed, exponent)


def one_session(folds: Sequence[GroupFold]) -> bool:
    """Whether one session alone is left out, so that nothing shows how sessions vary."""
    return len(folds) == 1 and len(np.unique(folds[0].test.session)) == 1


def score_kinds(unit: str, grid: ClassGrid, *, in_bins: bool) -> dict[str, ScoreKind]:
    """What the scores of taps left out are, by name; densities times widths of bins may exceed 1."""
    inferred, of = ("object", grid.what_error_unit) if unit == "position" else ("position", grid.where_unit)
    log_probability = LOG_PROBABILITY._replace(limits=(-np.inf, 0.0 if in_bins else np.inf))
    return {
        "integrated": log_probability,
        "plug_in": log_probability,
        "belief": ScoreKind(f"mean log belief in the true {inferred} after one tap", "nat", (-np.inf, 0.0)),
        "error": ScoreKind(f"mean {inferred} error after one tap", of, (0.0, np.inf)),
    }


def score_sessions(fitted: Fitted, taps: TapSet, seed: int, *, alone: bool = False) -> dict[str, TapScores]:
    """Log probability of taps of left-out sessions under their own classes, which the model knows, in nats.

    Clusters are sessions, or the classes of one that is left out `alone`.

    Returns:
        `integrated`, where there is a posterior, and `plug_in`.
    """
    own = taps.indices(fitted.model.grid)
    drawn = own[0] * fitted.model.grid.M + own[1] if alone else taps.session
    cluster = np.unique(drawn, return_inverse=True)[1].astype(np.intp)
    return {name: TapScores(way(taps.taps, own), cluster) for name, way in _ways(fitted, seed).items()}


def score_places(
    fitted: Fitted, taps: TapSet, unit: str, fold_of: NDArray[np.intp], seed: int, exponent: float
) -> dict[str, TapScores]:
    """Scores of taps of left-out positions or objects about which the model says something, see `said`.

    Args:
        fitted: Without the group that is left out.
        taps: Taps of that group.
        unit: `position` or `object`.
        fold_of: GroupFold of each position or object, -1 where it is never left out, shape (L,) or (M,).
        seed: Random seed.
        exponent: Of the likelihood in beliefs.

    Returns:
        `integrated` and `plug_in` as in `score_sessions`; `belief`, the log belief of the tap's object (or position)
        after this tap alone; and `error`, that of the most probable one, in the grid's units. Each as well with one
        more fold of positions (or objects) left out of what the model says; of those it was still trained on.
    """
    axis, (grid, trained) = _AXIS[unit], (fitted.model.grid, fitted.model.trained)
    own, ways = taps.indices(grid), _ways(fitted, seed)
    alike = np.indices(grid.shape)[1 - axis] == own[1 - axis][:, None, None]
    everywhere = _table(ways["plug_in"], taps.taps, np.broadcast_to(trained, alike.shape))
    beside = {name: _table(way, taps.taps, trained & alike) for name, way in ways.items()}

    def scored(known: NDArray[np.bool_]) -> dict[str, NDArray[np.float64]]:
        predicted = {name: _predicted(np.where(known, table, np.nan), own) for name, table in beside.items()}
        return predicted | _inferred(exponent * np.where(known, everywhere, np.nan), own, grid, axis)

    fold = np.expand_dims(fold_of, 1 - axis)
    less = [scored(trained & (fold != number)) for number in range(int(fold_of.max()) + 1)]
    cluster = np.zeros(len(taps), dtype=np.intp)
    return {
        name: TapScores(values, cluster, np.stack([one[name] for one in less], axis=1))
        for name, values in scored(trained).items()
    }


def _ways(fitted: Fitted, seed: int) -> dict[str, "_Way"]:
    ways: dict[str, _Way] = {"plug_in": partial(plug_in, fitted)}
    if fitted.posterior is not None:
        ways["integrated"] = lambda taps, own: integrated(fitted, taps, own, generator(seed, Purpose.SCORES))
    return ways


type _Way = Callable[[NDArray[np.floating], Own], NDArray[np.float64]]


def _table(way: _Way, taps: NDArray[np.floating], wanted: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Log probability of taps (N, J, K) under the wanted classes, shape (N, L, M), NaN elsewhere."""
    table, (tap, where, what) = np.full(wanted.shape, np.nan), wanted.nonzero()
    step = max(1, _ROOM // taps[0].size)
    for start in range(0, len(tap), step):
        part = slice(start, start + step)
        table[tap[part], where[part], what[part]] = way(taps[tap[part]], (where[part], what[part]))
    return table


def _predicted(table: NDArray[np.float64], own: Own) -> NDArray[np.float64]:
    """Log probability of taps under their own classes, or the mean of those in the table where these are not there."""
    itself = table[np.arange(len(table)), *own]
    return np.where(np.isnan(itself), _log_mean(table.reshape(len(table), -1), axis=1), itself)


def _inferred(table: NDArray[np.float64], own: Own, grid: ClassGrid, axis: int) -> dict[str, NDArray[np.float64]]:
    """`belief` and `error` of the object of taps at new positions (axis 0), or of the position at new objects."""
    log = _log_sum(table, axis=1 + axis)
    with np.errstate(invalid="ignore"):  # NaN where no class is possible
        belief = log - _log_sum(log, axis=1)[:, None]
    error = (grid.what_error, grid.where_error)[axis]
    true = own[1 - axis]
    return {"belief": belief[np.arange(len(true)), true], "error": error(belief.argmax(axis=1), true)}


def _log_sum(table: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    return np.asarray(logsumexp(np.where(np.isnan(table), -np.inf, table), axis=axis))


def _log_mean(table: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    """NaN where there is no number."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return _log_sum(table, axis) - np.log((~np.isnan(table)).sum(axis=axis))


def _session_folds(train: TapSet, test: TapSet, most: int, one_recording: bool) -> tuple[list[GroupFold], str]:
    test = test if one_recording else _renumbered(train, test)
    if most == 1 and not np.isin(test.session, train.session).any():
        return [GroupFold("TEST", train, test)], "Each session of TEST was predicted from TRAIN, and none of TRAIN."
    try:
        pooled = concatenate([train, test])
    except InputError as error:
        sentence = f"TRAIN and TEST cannot be pooled ({str(error).rstrip('.')}), so TEST alone is left out."
        return [GroupFold("TEST", train, test)], sentence
    sessions = np.unique(pooled.session)
    if len(sessions) < 2:
        return [], "No session can be left out, because there is only one."
    groups = _groups(sessions, max(most, 2))
    folds = []
    for group in groups:
        left_out = np.isin(pooled.session, group)
        folds.append(
            GroupFold(f"session {', '.join(map(str, group))}", pooled.select(~left_out), pooled.select(left_out))
        )
    same = [set(np.unique(fold.train.session)) == set(np.unique(train.session)) for fold in folds]
    is_main = [s and len(fold.train) == len(train) for s, fold in zip(same, folds, strict=True)]
    folds = [f for f, m in zip(folds, is_main, strict=True) if not m] + [
        f._replace(train=train) for f, m in zip(folds, is_main, strict=True) if m
    ]
    return folds, f"{_each('session', groups, len(sessions))} of TRAIN and TEST was predicted from the others."


def _groups(members: NDArray[np.intp], most: int) -> list[NDArray[np.intp]]:
    return np.array_split(members, min(len(members), most)) if len(members) else []


def _each(unit: str, groups: Sequence[NDArray[np.intp]], members: int) -> str:
    return f"Each {unit}" if len(groups) == members else f"Each of {len(groups)} groups of {unit}s"


def _renumbered(train: TapSet, test: TapSet) -> TapSet:
    """The test taps, in sessions of their own numbers where the training taps have the same ones."""
    if not np.isin(test.session, train.session).any():
        return test
    offset = int(train.session.max()) + 1 - int(test.session.min())
    return TapSet(test.dataset.assign_coords(session=("tap", test.session + offset)))
