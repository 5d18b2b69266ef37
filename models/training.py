"""Test taps that trained the model, which would make errors too small: found by their digests and left out."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .digest import tap_digests
from .errors import InputError
from .taps import TapSet

_MOST = 2 / 3
"""A session of which a larger share trained the model is left out as a whole; one split by parity or halves is not."""
_FEW = 0.01


def training_taps(taps: TapSet, training: NDArray[np.uint64]) -> NDArray[np.bool_]:
    """Which taps belong to the training data, shape (N,).

    A digest identifies a tap if it occurs once in the training data: coarse or binned samples give equal taps by
    chance, and of these at most 1 / e equal exactly one training tap. Sessions of which more than two thirds are
    identified belong to the training data with all their taps. Single taps do where at most one training tap in a
    hundred equals another one.

    Args:
        taps: The taps, N of them.
        training: Digests of the training taps, see `tap_digests`.
    """
    digest, count = np.unique(training, return_counts=True)
    known = np.isin(tap_digests(taps.taps), digest[count == 1])
    chance = count[count > 1].sum() > _FEW * len(training)
    result = known & (not chance)
    for session in np.unique(taps.session):
        own = taps.session == session
        result[own] |= known[own].mean() > _MOST
    return result


def without_training(
    taps: TapSet, training: NDArray[np.uint64], keep: bool = False, names: Sequence[str] | None = None
) -> tuple[TapSet, str]:
    """The taps that did not train a model, and one sentence about those that did.

    Args:
        taps: Test taps.
        training: Digests of the training taps.
        keep: Whether to return all taps all the same.
        names: What sessions are called, by their numbers; `None` for the numbers.

    Returns:
        The taps and the sentence, which is empty where no tap trained the model.

    Raises:
        InputError: No tap is left.
    """
    known = training_taps(taps, training)
    if not known.any():
        return taps, ""
    named = f"{_counted(taps, known, names)} trained the model"
    if keep:
        return taps, f"{named} and are played all the same, so expect larger errors on new taps."
    if known.all():
        raise InputError(
            f"No tap is left to test: {named}. Name other sessions or files, or play them all the same with "
            "--training-taps (training_taps = true in a study)."
        )
    return taps.select(~known), f"{named} and are left out; --training-taps plays them all the same."


def _counted(taps: TapSet, known: NDArray[np.bool_], names: Sequence[str] | None) -> str:
    """How many taps of which sessions."""
    sessions = np.unique(taps.session[known])
    parts = []
    for session in sessions:
        own = taps.session == session
        n, N = int((own & known).sum()), int(own.sum())
        called = f"session {session}" if names is None else names[session]
        parts.append(f"{f'all {n}' if n == N else f'{n} of {N}'} taps of {called}")
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last
