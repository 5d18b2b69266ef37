"""Amount of data needed for a verdict: the smallest miscalibration factor that a design can detect.

The factor of a data set is the number of wrong decisions over the number that beliefs expect. A right model gives it a
distribution on each design (sessions, taps per class), by simulation from the fitted model (`stats.right_model`);
"overconfident" is said above that distribution's 1 - level quantile. If wrong decisions come f times as often as a
right model's, clustered as before, the factor has a mean f times as large and, as an overdispersed Poisson count, a
variance f times as large. With a gamma distribution of these moments (the "quasi-Poisson" of McCullagh and Nelder,
"Generalized Linear Models", 1989, ch. 6.2) the power at f is the chance to exceed the quantile, and the smallest f with
the wanted power is what can be detected.

A right model has no sessions, so only the number of taps matters; sessions that do differ need more of them.
"""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincc

from ...inference.trials.records import TapTable
from ...models.errors import InputError
from ...models.grid import episode_sessions, tap_pool
from ...models.measurement.model import TapModel
from ...models.setting_file import Setting
from ..stats.detection import LEVEL, POWER
from ..stats.right_model import equivalent, quantiles, reference_factors

SESSIONS, TAPS = (1, 3, 10), (20, 60)
"""Designs that are looked at, beside the present number of taps."""
SIMULATIONS = 99
_WORK = 3e8  # samples drawn for a design, some seconds; larger ones are left out
_MOST = 1e3  # a factor beyond which nothing is detected


class Design(NamedTuple):
    """What is measured on."""

    sessions: int
    taps: int


class Detectable(NamedTuple):
    """The smallest factor that a design can detect.

    Attributes:
        design: The design.
        right: The largest factor that does not reject a right model.
        factor: The smallest true factor that is detected with the wanted power; infinite where none is.
    """

    design: Design
    right: float
    factor: float


def designs_from(taps: int) -> list[Design]:
    """The designs that are looked at."""
    return [Design(sessions, number) for sessions in SESSIONS for number in sorted({taps, *TAPS})]


def enough(
    model: TapModel,
    table: TapTable,
    setting: Setting,
    policy: str,
    trials: int,
    seed: int,
    simulations: int = SIMULATIONS,
) -> list[Detectable]:
    """What other designs could detect, with trials that move and stop as they do now.

    Args:
        model: In use.
        table: The measuring taps as it sees them; classes without a tap stay so.
        setting: How trials move and stop.
        policy: `"passive"` or `"active"`.
        trials: Of each data set.
        seed: Of all random numbers.
        simulations: Data sets of each design.
    """
    l, m = np.nonzero(table.pool.per_class)
    K, samples = model.edges.shape[0], equivalent(model).preprocessing.samples

    def factors(design: Design) -> NDArray[np.float64]:
        each = design.sessions * design.taps
        where, what = np.repeat(l, each), np.repeat(m, each)
        session = episode_sessions(where, what, np.tile(np.arange(each) // design.taps, len(l)))
        pool = tap_pool(where, what, table.pool.shape, session)
        return reference_factors(model, table._replace(pool=pool), setting, policy, trials, seed, simulations)[:, 0]

    most = _WORK / (len(l) * K * samples * simulations)
    wanted = designs_from(max(1, int(np.median(table.pool.count[table.pool.count > 0]))))
    return detectable(factors, [one for one in wanted if one.sessions * one.taps <= most], LEVEL / 2)


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
        raise InputError("A detectable factor requires two or more non-negative factors of a correct model.")
    mean, variance = float(factors.mean()), float(factors.var(ddof=1))
    if not mean > 0 or not variance > 0:
        return np.inf
    limit = float(np.quantile(factors, 1 - level)) if critical is None else critical
    scale = variance / mean

    def lacking(f: float) -> float:
        return power - float(gammaincc(f * mean / scale, limit / scale))

    if lacking(1.0) <= 0:
        return 1.0
    from scipy.optimize import root_scalar  # noqa: PLC0415 - most audits have no use for it

    return float(root_scalar(lacking, bracket=(1.0, _MOST)).root) if lacking(_MOST) < 0 else np.inf


def detectable(
    factors: Callable[[Design], NDArray[np.float64]],
    designs: Iterable[Design],
    level: float = LEVEL,
    power: float = POWER,
) -> list[Detectable]:
    """What each design can detect.

    Args:
        factors: Gives factors of data sets of a design drawn from a right model, shape (R,); those that are NaN, as
            where no trial stops, are left out, and of infinite ones only the rank counts. Designs of as many taps are
            asked for once.
        designs: The designs.
        level: Of the test.
        power: Wanted.
    """
    found, known = [], {}
    for design in designs:
        taps = design.sessions * design.taps
        if taps not in known:
            values = factors(design)
            values = values[~np.isnan(values)]
            right, finite = float(quantiles(values, 1 - level)), values[np.isfinite(values)]
            known[taps] = right, np.inf
            if np.isfinite(right) and len(finite) > 1:
                known[taps] = right, detectable_factor(finite, level, power, right)
        found.append(Detectable(design, *known[taps]))
    return found
