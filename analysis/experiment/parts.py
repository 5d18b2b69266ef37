"""Training, tuning and measuring taps of an audit."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.io.joining import numbered
from ...models.io.load import TapSource, check_there, names_of, taps_of
from ...models.settings import Division
from ...models.splits import rank_in_class
from ...models.taps import TapSet, check_alike, concatenate
from ...models.training import without_training

_HALVED = (
    "Tuning and measuring taps are the odd and even taps of the same session, so tuned values fit that session better "
    "than a new one."
)


@dataclass(frozen=True, eq=False)
class AuditParts:
    """Taps by what they are for. Sessions are numbered anew, so that no two of different files share a number.

    Attributes:
        train: What models are fitted to.
        tune: Sessions by which exponents and thresholds are chosen.
        measure: What everything is measured on.
        session_names: What each session number is called.
        description: In words.
        warnings: What the division cannot show, one sentence each.
        halved: Whether tuning and measuring taps are of the same session.
    """

    train: TapSet
    tune: tuple[TapSet, ...]
    measure: TapSet
    session_names: tuple[str, ...]
    description: str
    warnings: tuple[str, ...]
    halved: bool

    @property
    def of_one_session(self) -> bool:
        """Whether the session that measures trains as well."""
        return bool(np.isin(self.measure.session, self.train.session).any())

    @cached_property
    def all_taps(self) -> TapSet:
        """All taps together, those that train first and those that measure last."""
        return concatenate([self.train, *self.tune, self.measure])


def load_parts(
    data: Sequence[TapSource], division: Division | None = None, *, whole: bool = False
) -> tuple[AuditParts, ClassGrid]:
    """The parts of an audit and the classes.

    Args:
        data: Tap sets or their files, divided as in `audit_parts`.
        division: The cells, and whether taps that train also tune and measure; it splits nothing.
        whole: Whether taps with missing samples are refused, also those of tap sets that remember to drop them.

    Raises:
        InputError: As `load_taps`, `TapSet.grid` and `audit_parts`.
    """
    division = division or Division()
    check_there(data)
    taps = [taps_of(source, None if whole else division.missing) for source in data]
    if not taps:
        raise InputError("Taps to train, tune and measure with are missing; pass one tap set or more.")
    grid = taps[0].grid(division.where_cell, division.what_cell)
    names = [Path(name).name for name in names_of(data)]
    return audit_parts(taps, names, grid, division.training_taps), grid


def audit_parts(
    taps: Sequence[TapSet], names: Sequence[str], grid: ClassGrid, training_taps: bool = False
) -> AuditParts:
    """Divides tap sets: the first trains, the last measures, those between tune.

    Of two the second is halved by trial, within each class. A single one is divided by its sessions as if each were a
    file, except that all but the last two train; a single session is divided within each class, half of it trains.
    Taps that train neither tune nor measure, see `without_training`; warnings say which are left out.

    Args:
        taps: Tap sets in the order of their files.
        names: What the files are called.
        grid: The classes.
        training_taps: Whether they tune and measure all the same.

    Raises:
        InputError: There is none, they do not fit together, or one of the parts would hold no tap of a class.
    """
    if not taps:
        raise InputError("An audit requires at least one file of taps.")
    warnings = []
    check_alike(taps, names)
    parts, session_names = numbered(taps, names)

    def fresh(train: TapSet, *others: TapSet) -> list[TapSet]:
        known, found = train.digests, []
        for other in others:
            rest, sentence = without_training(other, known, training_taps, session_names)
            found.append(rest)
            if sentence:
                warnings.append(f"{sentence[0].upper()}{sentence[1:]}")
        return found

    if len(taps) == 1:
        train, tune, measure, description, halved = _of_one(parts[0], session_names, grid)
        *tune, measure = fresh(train, *tune, measure)
        tune = tuple(tune)
    elif len(taps) == 2:
        train, halved = parts[0], True
        (rest,) = fresh(*parts)
        tune, measure = _halves(rest, grid)
        description = f"{names[0]} trains; {names[1]}, halved by trial, tunes and measures."
        tune = (tune,)
    else:
        train, halved = parts[0], False
        *tune, measure = fresh(*parts)
        tune = tuple(tune)
        description = f"{names[0]} trains, {_listed(names[1:-1])}, {names[-1]} measures."
    if halved:
        warnings.append(_HALVED)
    _check(grid, train, tune, measure)
    copies = np.isin(measure.digests, np.concatenate([other.digests for other in tune])).sum()
    if copies:
        warnings.append(f"{copies} of the {len(measure)} measuring taps are also tuning taps.")
    return AuditParts(train, tune, measure, session_names, description, tuple(warnings), halved)


def _of_one(
    taps: TapSet, names: tuple[str, ...], grid: ClassGrid
) -> tuple[TapSet, tuple[TapSet, ...], TapSet, str, bool]:
    """The parts of a single tap set."""
    sessions = np.unique(taps.session)
    if len(sessions) == 1:
        train, rest = _halves(taps, grid)
        tune, measure = _halves(rest, grid)
        return (
            train,
            (tune,),
            measure,
            f"There is one session, {names[0]}: within each class half of the taps are for training, a quarter for "
            "tuning and a quarter for measuring.",
            True,
        )
    if len(sessions) == 2:
        tune, measure = _halves(taps.select(taps.session == 1), grid)
        return (
            taps.select(taps.session == 0),
            (tune,),
            measure,
            f"{names[0]} trains; {names[1]}, halved by trial, tunes and measures.",
            True,
        )
    train = taps.select(taps.session < len(sessions) - 2)
    tune, measure = (taps.select(taps.session == len(sessions) - back) for back in (2, 1))
    verb = "train" if len(sessions) > 3 else "trains"
    description = f"{', '.join(names[:-2])} {verb}, {_listed(names[-2:-1])}, {names[-1]} measures."
    return train, (tune,), measure, description, False


def _halves(taps: TapSet, grid: ClassGrid) -> tuple[TapSet, TapSet]:
    """The first, third, fifth, ... tap of each class and the others.

    Raises:
        InputError: No class has two taps.
    """
    rank, _ = rank_in_class(taps, grid)
    odd: NDArray[np.bool_] = rank % 2 == 0
    if odd.all():
        raise InputError(
            "Tuning and measuring taps cannot be separated: no class has two taps in the session to be halved. Add a "
            "third file or session."
        )
    return taps.select(odd), taps.select(~odd)


def _check(grid: ClassGrid, train: TapSet, tune: Sequence[TapSet], measure: TapSet) -> None:
    trained = _own(train, grid)
    if not (trained >= 0).any():
        raise InputError("No tap to train with: none belongs to a class of the first file.")
    for verb, part in (("measure", measure), *(("tune with", part) for part in tune)):
        if not np.isin(_own(part, grid), trained[trained >= 0]).any():
            raise InputError(f"No tap to {verb}: none belongs to a class with a training tap.")


def _own(taps: TapSet, grid: ClassGrid) -> NDArray[np.intp]:
    """Class of each tap, where * M + what, -1 outside the grid, shape (N,)."""
    where, what = taps.indices(grid)
    return np.where(np.minimum(where, what) >= 0, where * grid.M + what, -1)


def _listed(names: Sequence[str]) -> str:
    """Names and what they do."""
    return f"{', '.join(names)} {'tunes' if len(names) == 1 else 'tune'}"
