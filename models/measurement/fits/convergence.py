"""Convergence of a fit."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError


class NotConvergedError(InputError):
    """A fit did not converge, and `unconverged` was not set."""


class Convergence(NamedTuple):
    """Convergence of a fit.

    Attributes:
        converged: Whether it may be used; always where the posterior is exact.
        sentence: How it was found, and what shows that it did or did not converge.
        stats: Numbers behind it, by name.
    """

    converged: bool
    sentence: str
    stats: dict[str, NDArray[np.float64]]


EXACT = Convergence(True, "The posterior is exact.", {})
EXACT_CELLS = Convergence(True, "The posterior is exact, given the prior of the variances that all classes share.", {})


def ascent(rounds: int, change: float, still: float) -> Convergence:
    """Convergence of coordinate ascent on a factorised posterior.

    Args:
        rounds: How many it took.
        change: Change by the last round.
        still: The change that counts as none.
    """
    sentence = (
        f"Factorised posterior by coordinate ascent, {rounds} rounds; the last changed it by {change:.2g} "
        f"(at most {still:g})."
    )
    return Convergence(change <= still, sentence, {"rounds": np.array(float(rounds)), "change": np.array(change)})
