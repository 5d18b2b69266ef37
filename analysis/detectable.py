"""What data would be enough: the smallest miscalibration factor that a design can detect.

The factor of a data set is the number of wrong decisions over the number that beliefs expect. A right model gives it a
distribution on each design (sessions, taps per class), by simulation from the fitted model; "overconfident" is said
above that distribution's 1 - level quantile. If the true factor is f, wrong decisions come f times as often, clustered
as before: a mean f times as large and, as of an overdispersed Poisson count, a variance f times as large. With a gamma
distribution of these moments (the "quasi-Poisson" of McCullagh and Nelder, "Generalized Linear Models", 1989, ch. 6.2)
the power at f is the chance to exceed the quantile, and the smallest f with the wanted power is what can be detected.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import root_scalar
from scipy.stats import gamma

from ..models.errors import InputError

LEVEL, POWER = 0.05, 0.8
_MOST = 1e3  # a factor beyond which nothing is detected


class Design(NamedTuple):
    """What is measured on.

    Attributes:
        sessions: How many.
        taps: Of each class and session.
    """

    sessions: int
    taps: int


class Detectable(NamedTuple):
    """What a design can detect.

    Attributes:
        design: The design.
        right: The largest factor that does not reject a right model.
        factor: The smallest true factor that is detected with the wanted power; infinite where none is.
    """

    design: Design
    right: float
    factor: float


def detectable_factor(
    factors: ArrayLike, level: float = LEVEL, power: float = POWER, critical: float | None = None
) -> float:
    """The smallest true factor that is called overconfident with the wanted power.

    Args:
        factors: Of data sets of the design drawn from a right model, shape (R,).
        level: Of the one-sided test.
        power: Wanted, above the level.
        critical: The factor above which the test rejects; by default the 1 - level quantile of the factors.

    Returns:
        At least 1; infinite where the factors never vary, as without a wrong decision, or no factor is large enough.

    Raises:
        InputError: There are fewer than two factors, or one is negative or not finite.
    """
    factors = np.asarray(factors, dtype=np.float64)
    if factors.ndim != 1 or len(factors) < 2 or not (np.isfinite(factors) & (factors >= 0)).all():
        raise InputError("A detectable factor needs two factors or more of a right model, none negative.")
    mean, variance = float(factors.mean()), float(factors.var(ddof=1))
    if not mean > 0 or not variance > 0:
        return np.inf
    limit = float(np.quantile(factors, 1 - level)) if critical is None else critical
    scale = variance / mean

    def lacking(f: float) -> float:
        return power - float(gamma.sf(limit, f * mean / scale, scale=scale))

    if lacking(1.0) <= 0:
        return 1.0
    return float(root_scalar(lacking, bracket=(1.0, _MOST)).root) if lacking(_MOST) < 0 else np.inf


def detectable(
    factors: Callable[[Design], NDArray[np.float64]],
    designs: Iterable[Design],
    level: float = LEVEL,
    power: float = POWER,
) -> list[Detectable]:
    """What each design can detect.

    Args:
        factors: Gives factors of data sets of a design drawn from a right model, shape (R,).
        designs: The designs.
        level: Of the test.
        power: Wanted.
    """
    found = []
    for design in designs:
        values = factors(design)
        found.append(Detectable(design, float(np.quantile(values, 1 - level)), detectable_factor(values, level, power)))
    return found
