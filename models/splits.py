"""Training taps, test taps and classes of an experiment; every result records its split."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .grid import ClassGrid
from .io.load import TapSource, check_there, names_of, taps_of
from .settings import Division
from .taps import TapSet, check_compatible
from .training import without_training

Method = Literal["sessions", "leave-one-session-out", "halves", "parity"]
METHODS: tuple[str, ...] = get_args(Method)

_SAME_SESSION = (
    "Training and test taps come from the same session, so the model has seen its slow drift: "
    "expect larger errors on a new session."
)


@dataclass(frozen=True, eq=False)
class Fold:
    """One training and one test set; see `untrained` for taps in both.

    Attributes:
        train: Training taps.
        test: Test taps.
        name: Printable name of the fold.
    """

    train: TapSet
    test: TapSet
    name: str


@dataclass(frozen=True, eq=False)
class Split:
    """The folds of an experiment.

    Attributes:
        folds: One or more; results of several are pooled.
        method: `"sessions"`, `"leave-one-session-out"`, `"halves"`, `"parity"` or `"files"`.
        description: Sentence that describes the test taps.
        warning: Sentence on the limits of the split, or empty.
    """

    folds: tuple[Fold, ...]
    method: str
    description: str
    warning: str = ""


def split(
    taps: TapSet,
    grid: ClassGrid,
    method: str | None = None,
    train_sessions: Sequence[int] | None = None,
    test_sessions: Sequence[int] | None = None,
) -> Split:
    """Splits one tap set.

    Args:
        taps: The taps; recorded order is (session, trial, position in the file).
        grid: Classes within which `halves` and `parity` split.
        method: `sessions` (default where there are two or more) tests the last session, or those named, with
            the model of the others; `leave-one-session-out` does so with each session in turn; `halves` trains
            with the first half of each class in recorded order, the longer half where the number is odd; `parity`
            (default where there is one session) trains with its first, third, fifth, ... tap.
        train_sessions: Sessions to train with; default: all not in the test.
        test_sessions: Sessions to test; default: the last, or all not in the training.

    Raises:
        InputError: The method is unknown, a session does not exist or is on both sides, or no tap is left to train
            or to test.
    """
    named = train_sessions is not None or test_sessions is not None
    sessions = np.unique(taps.session).tolist()
    if method is None:
        method = "sessions" if named or len(sessions) > 1 else "parity"
    if method not in METHODS:
        raise InputError(f"--split must be one of {', '.join(METHODS)}, got {method!r}.")
    if named and method != "sessions":
        raise InputError(f"--train and --test cannot be combined with --split {method}.")
    if method == "sessions":
        return _by_sessions(taps, sessions, train_sessions, test_sessions)
    if method == "leave-one-session-out":
        return _leave_one_out(taps, sessions)
    return _within_classes(taps, grid, method)


def untrained(parts: Split, keep: bool = False) -> Split:
    """Split without test taps that are training taps of their fold; its warning lists them.

    Args:
        parts: The split.
        keep: Whether to keep these taps, with a warning.

    Raises:
        InputError: No tap is left to test.
    """
    folds, told = [], [parts.warning] if parts.warning else []
    for fold in parts.folds:
        taps, sentence = without_training(fold.test, fold.train.digests, keep)
        folds.append(replace(fold, test=taps))
        if sentence:
            told.append(sentence if len(parts.folds) == 1 else f"{fold.name.capitalize()}: {sentence}")
    return replace(parts, folds=tuple(folds), warning=" ".join(told))


def two_files(train: TapSet, test: TapSet, names: Sequence[str] = ("TRAIN", "TEST")) -> Split:
    """One fold from two tap sets, with their names for messages.

    Raises:
        InputError: They differ in taxels, unit of position or preprocessing.
    """
    check_compatible(train, test, *names)
    return Split((Fold(train, test, "test file"),), "files", "The first file trains, the second tests.")


def select_sessions(taps: TapSet, chosen: Sequence[int] | None, option: str) -> TapSet:
    """Taps of these sessions, by default all.

    Args:
        taps: The taps.
        chosen: Session numbers.
        option: Name of the option, for messages.

    Raises:
        InputError: A session does not exist.
    """
    if chosen is None:
        return taps
    _check_sessions(np.unique(taps.session).tolist(), chosen, option)
    return _of(taps, chosen)


def _check_sessions(sessions: list[int], chosen: Sequence[int] | None, option: str) -> None:
    missing = sorted(set(chosen or ()) - set(sessions))
    if missing:
        raise InputError(f"{option}: no session {missing[0]}; the data have {_listed(sessions)}.")


def _by_sessions(taps: TapSet, sessions: list[int], train: Sequence[int] | None, test: Sequence[int] | None) -> Split:
    _check_sessions(sessions, train, "--train")
    _check_sessions(sessions, test, "--test")
    if test is None:
        test = sessions[-1:] if train is None else [s for s in sessions if s not in train]
    if train is None:
        train = [s for s in sessions if s not in test]
    both = sorted(set(train) & set(test))
    if both:
        raise InputError(f"Session {both[0]} cannot be in both --train and --test.")
    for verb, side in (("train with", train), ("test", test)):
        if not side:
            raise InputError(f"No tap left to {verb}: the data have {_listed(sessions)}.")
    fold = Fold(_of(taps, train), _of(taps, test), f"test {_listed(test)}")
    description = f"{_listed(train).capitalize()} train{_s(train)}, {_listed(test)} test{_s(test)}."
    return Split((fold,), "sessions", description)


def _leave_one_out(taps: TapSet, sessions: list[int]) -> Split:
    if len(sessions) < 2:
        raise InputError(f"No tap left to train with: the data have {_listed(sessions)} only.")
    folds = tuple(
        Fold(_of(taps, [s for s in sessions if s != left_out]), _of(taps, [left_out]), f"test session {left_out}")
        for left_out in sessions
    )
    description = f"Each of {len(sessions)} sessions is tested with the model of the others."
    return Split(folds, "leave-one-session-out", description)


def _within_classes(taps: TapSet, grid: ClassGrid, method: str) -> Split:
    position, size = rank_in_class(taps, grid)
    if method == "halves":
        trains = position < (size + 1) // 2
        description = "Within each class, the first half of the taps in recorded order trains, the second tests."
    else:
        trains = position % 2 == 0
        description = "Within each class, taps in recorded order train and test in turn."
    if trains.all():
        raise InputError("No tap left to test: no class has more than one tap.")
    fold = Fold(taps.select(trains), taps.select(~trains), method)
    return Split((fold,), method, description, _SAME_SESSION)


def rank_in_class(taps: TapSet, grid: ClassGrid) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rank of each tap among those of its class in recorded order, and their number; shapes (N,)."""
    where, what = taps.indices(grid)
    key = where * (grid.M + 1) + what
    rank, size = np.zeros(len(taps), dtype=np.intp), np.zeros(len(taps), dtype=np.intp)
    order = np.lexsort((taps.trial, taps.session))
    for value in np.unique(key):
        members = order[key[order] == value]
        rank[members] = np.arange(len(members))
        size[members] = len(members)
    return rank, size


def _of(taps: TapSet, sessions: Sequence[int]) -> TapSet:
    return taps.select(np.isin(taps.session, sessions))


def _listed(sessions: Sequence[int]) -> str:
    return f"session{'s' if len(sessions) > 1 else ''} {', '.join(str(s) for s in sessions)}"


def _s(sessions: Sequence[int]) -> str:
    return "" if len(sessions) > 1 else "s"


def load_experiment(data: Sequence[TapSource], division: Division | None = None) -> tuple[Split, ClassGrid]:
    """Split and class grid of an experiment on recorded taps.

    Args:
        data: One tap set to split, or two, TRAIN and TEST; each a tap set or its file.
        division: Grouping and division of the taps.

    Returns:
        The split, and the grid of the (first) tap set, including classes without a training tap.

    Raises:
        InputError: No tap set or more than two, an option that is for one only, or as `load_taps`,
            `TapSet.grid`, `split`, `two_files` and `untrained`.
    """
    if not 1 <= len(data) <= 2:
        raise InputError(f"Give one data file, or two (TRAIN and TEST), got {len(data)}.")
    division = division or Division()
    if len(data) > 1:
        division.refuse_split("with two files the first trains and the second tests")
    sessions = parse_sessions(division.train, "--train"), parse_sessions(division.test, "--test")
    check_there(data)
    first = taps_of(data[0], division.missing)
    grid = first.grid(division.where_cell, division.what_cell)
    if len(data) == 1:
        parts = split(first, grid, division.split, *sessions)
    else:
        parts = two_files(first, taps_of(data[1], division.missing), names_of(data))
    for fold in parts.folds:
        for verb, side in (("train with", fold.train), ("test", fold.test)):
            if not np.any(np.minimum(*side.indices(grid)) >= 0):
                names = names_of(data)
                raise InputError(f"No tap left to {verb}: none of {names[-1]} belongs to a class of {names[0]}.")
    parts = untrained(parts, division.training_taps)
    train, test = ([getattr(fold, side) for fold in parts.folds] for side in ("train", "test"))
    told = parts.warning, missing_sentence(train, "training taps"), missing_sentence(test, "test taps")
    return replace(parts, warning=" ".join(filter(None, told))), grid


def missing_sentence(taps: Sequence[TapSet], name: str) -> str:
    """How many samples are missing, and which taxels have none; empty if none is missing."""
    missing, J = np.concatenate([part.lacking for part in taps]), taps[0].samples.shape[1]
    if not missing.any():
        return ""
    dead = ", ".join(map(str, np.flatnonzero((missing == J).all(axis=0))))
    none = f"; taxels without any: {dead}" if dead else ""
    return f"{missing.mean() / J:.1%} of the samples of the {name} are missing and left out{none}."


def parse_sessions(text: str | None, option: str) -> list[int] | None:
    """Session numbers separated by commas.

    Raises:
        InputError: The text has another form.
    """
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must be session numbers such as 0,1, got {text!r}.") from None
