"""Samples that are missing, which are NaN: which models leave them out of a fit and a likelihood."""

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .scaling import Moments

_CAN = "histogram, gaussian, student, profile and functions with independent samples can."


def dependent(name: str) -> str:
    """Says that a likelihood cannot leave out samples."""
    return f"Samples are missing, and {name} cannot leave them out, because its samples depend on each other; {_CAN}"


def refuse_missing(name: str, samples: NDArray[np.floating]) -> None:
    """Checks that all samples of training taps are there.

    Raises:
        InputError: One is missing.
    """
    if np.isnan(samples).any():
        raise InputError(f"Samples are missing, and {name} cannot be fitted without them; {_CAN}")


def refuse_empty(name: str, moments: Moments, by_time: bool) -> None:
    """Checks that every class with taps has samples of each taxel that has any.

    A flat level of one that has none would be anywhere.

    Args:
        name: Name of the model.
        moments: Those of the training taps.
        by_time: Whether the model has a level for each time.

    Raises:
        InputError: A class has none; the message names it.
    """
    present = moments.samples > 0 if by_time else moments.samples.any(axis=2, keepdims=True)
    alive = present.any(axis=(0, 1))
    for l, m in np.argwhere(moments.taps):
        empty = alive & ~present[l, m]
        if empty.any():
            j, k = np.argwhere(empty)[0]
            at = f" at sample {j}" if by_time else ""
            raise InputError(
                f"{name} cannot be fitted: all samples of taxel {k}{at} are missing for position {l} and object {m}."
            )
