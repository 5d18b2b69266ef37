"""Digests of taps, and exclusion of test taps that trained the model, which would bias errors downwards."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .taps import TapSet

_MOST = 2 / 3
"""A session with a larger fraction of training taps is left out entirely; one split by parity or halves is not."""
_FEW = 0.01


def training_taps(taps: TapSet, training: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Mask of the taps that belong to the training data, shape (N,).

    A digest identifies a tap if it occurs once in the training data: coarse or binned samples give equal taps by
    chance, and of these at most 1 / e equal exactly one training tap. If more than two thirds of a session are
    identified, all its taps belong to the training data. Single taps do if at most one training tap in a hundred
    equals another one.

    Args:
        taps: The taps, N of them.
        training: Digests of the training taps, see `blocks.tap_digests`.
    """
    digest, count = np.unique(training, return_counts=True)
    empty = (taps.lacking == taps.samples.shape[1]).all(axis=1)
    known = np.isin(taps.digests, digest[count == 1]) & ~empty
    chance = count[count > 1].sum() > _FEW * len(training)
    result = known & (not chance)
    for session in np.unique(taps.session):
        own = taps.session == session
        result[own] |= known[own].mean() > _MOST
    return result


def without_training(
    taps: TapSet, training: NDArray[np.uint64], keep: bool = False, names: Sequence[str] | None = None
) -> tuple[TapSet, str]:
    """Taps that did not train a model, and a sentence about those that did.

    Args:
        taps: Test taps.
        training: Digests of the training taps.
        keep: Whether to return all taps nevertheless.
        names: Names of the sessions by number; `None` to use the numbers.

    Returns:
        Taps and sentence, which is empty if no tap trained the model.

    Raises:
        InputError: No tap is left.
    """
    known = training_taps(taps, training)
    if not known.any():
        return taps, ""
    named = f"{_counted(taps, known, names)} trained the model"
    if keep:
        return taps, f"{named} and are kept, so expect larger errors on new taps."
    if known.all():
        raise InputError(
            f"No tap left to test: {named}. Choose other sessions or files, or keep them with "
            "--training-taps (training_taps = true in a study)."
        )
    return taps.select(~known), f"{named} and are left out; --training-taps keeps them."


def untrained_taps(taps: TapSet, training: NDArray[np.uint64], keep: bool = False) -> tuple[TapSet, str]:
    """As `without_training`, for models that may not list their training taps; with the kind of message."""
    if not len(training):
        return taps, "Note: the model does not name the taps that trained it, so none are left out."
    rest, sentence = without_training(taps, training, keep)
    return rest, f"{'Warning' if keep else 'Note'}: {sentence}" if sentence else ""


def _counted(taps: TapSet, known: NDArray[np.bool_], names: Sequence[str] | None) -> str:
    """Numbers of taps by session, as a phrase."""
    sessions = np.unique(taps.session[known])
    parts = []
    for session in sessions:
        own = taps.session == session
        n, N = int((own & known).sum()), int(own.sum())
        called = f"session {session}" if names is None else names[session]
        parts.append(f"{f'all {n}' if n == N else f'{n} of {N}'} taps of {called}")
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last
