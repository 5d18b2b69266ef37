"""`session`: any other model with an unknown gain and offset that all taps of an episode share.

Nobody knows at test time what the gain of the sensor is that day. It is one of S states on a grid, enumerated beside
where and what: the belief is carried over (where, what, state), and decisions take the sum over states (see `states`).
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..grid import ClassGrid
from ..taps import TapSet
from .fits.priors import Taps
from .model import Fitted, Row
from .scaling import Moments
from .states import States

ROW = Row("independence of taps", "any other with a gain and offset shared by all taps of an episode")
GAINS, OFFSETS = 7, 3
"""Number of grid points for gains and for offsets."""
_REACH = 2.0  # standard deviations to which the grid reaches
_GAIN_SD, _OFFSET_BINS = 0.05, 0.5  # where a single training session says nothing
_LEAST_GAIN = 1e-3
_FLAT = 0.1  # signal over noise below which taps say nothing of a gain


def with_shared_gain(
    fitted: Fitted, taps: TapSet, grid: ClassGrid, gain_sd: float | None, offset_sd: float | None
) -> Fitted:
    """Fitted model with gains and offsets that all taps of an episode share.

    Args:
        fitted: Any fit.
        taps: Its training taps.
        grid: The classes.
        gain_sd: Standard deviation of the log gain between sessions; `None` to take it from the training taps.
        offset_sd: Standard deviation of the offset between sessions, likewise.

    Raises:
        InputError: A standard deviation is negative or not finite.
    """
    model: Any = fitted.model  # every kind is a dataclass
    found = session_spread(taps, grid, model.edges)
    states = state_grid(found[0] if gain_sd is None else gain_sd, found[1] if offset_sd is None else offset_sd)
    spread = f"States: {len(states.gain)}, gains {states.gain.min():.3g} to {states.gain.max():.3g}"
    spread += f" and offsets {states.offset.min():.2g} to {states.offset.max():.2g}."
    convergence = fitted.convergence._replace(sentence=f"{fitted.convergence.sentence} {spread}")
    return fitted._replace(model=replace(model, states=states), convergence=convergence)


def state_grid(gain_sd: float, offset_sd: float, gains: int = GAINS, offsets: int = OFFSETS) -> States:
    """Grid of gains around 1 and offsets around 0 with normal weights.

    Args:
        gain_sd: Standard deviation of the logarithm of the gain between sessions; 0 keeps it at 1.
        offset_sd: Standard deviation of the offset, in the unit of the samples; 0 keeps it at 0.
        gains: Points over the gain, reaching to two standard deviations.
        offsets: Points over the offset, likewise.

    Raises:
        InputError: A standard deviation is negative or not finite, or there are no points.
    """
    if not (np.isfinite([gain_sd, offset_sd]).all() and min(gain_sd, offset_sd) >= 0 and min(gains, offsets) >= 1):
        raise InputError(
            f"gain_sd and offset_sd must not be negative, got {gain_sd} and {offset_sd}; gains and offsets must be at "
            f"least 1, got {gains} and {offsets}."
        )
    z_gain, z_offset = _points(gains, gain_sd), _points(offsets, offset_sd)
    gain, offset = (axis.ravel() for axis in np.meshgrid(z_gain, z_offset, indexing="ij"))
    log_prior = -0.5 * (gain**2 + offset**2)
    return States(np.exp(gain * gain_sd), offset * offset_sd, log_prior - np.logaddexp.reduce(log_prior))


def _points(number: int, sd: float) -> NDArray[np.float64]:
    return np.linspace(-_REACH, _REACH, number) if number > 1 and sd > 0 else np.zeros(1)


def session_spread(taps: TapSet, grid: ClassGrid, edges: NDArray[np.float64]) -> tuple[float, float]:
    """Standard deviations of log gain and offset between sessions of training taps.

    The mean taps of the classes in each session are regressed on those in all others. Where that says nothing, as with
    a single session, 5% and half a bin stand in.

    Args:
        taps: Training taps.
        grid: The classes.
        edges: Bin edges, which set the unit of the stand-in.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    numbers = np.unique(taps.session[inside])
    if len(numbers) < 2:
        return _GAIN_SD, _OFFSET_BINS * float(np.diff(edges, axis=-1).mean())
    log_gain, offset = [], []
    for number in numbers:
        parts = (np.flatnonzero(inside & (this == (taps.session == number))) for this in (True, False))
        pair = _shared_means(*(_moments(taps.select(part), where[part], what[part], grid) for part in parts))
        if pair is not None:
            slope, intercept = _line(*pair)
            log_gain.append(np.log(max(slope, _LEAST_GAIN)))
            offset.append(intercept)
    if not log_gain:
        return _GAIN_SD, _OFFSET_BINS * float(np.diff(edges, axis=-1).mean())
    # A session differs from the mean of n - 1 others by more than from the truth.
    shrink = np.sqrt(1 - 1 / len(numbers))
    return float(shrink * _root_mean_square(log_gain)), float(shrink * _root_mean_square(offset))


def _moments(taps: TapSet, where: NDArray[np.intp], what: NDArray[np.intp], grid: ClassGrid) -> Moments:
    return Moments.of(Taps(taps.doubles, where, what, grid.shape))


def _shared_means(this: Moments, others: Moments) -> tuple[NDArray[np.float64], NDArray[np.float64], float] | None:
    """Flattened mean taps of the classes shared by a session and the others, and the noise variance of the latter.

    `None` where there are no such classes, or no class with two taps in the others to tell noise by.
    """
    n, count = this.samples, others.samples
    used, freedom = (n > 0) & (count > 0), np.maximum(count - 1, 0).sum(axis=(0, 1)).mean()
    if not used.any() or not freedom:
        return None
    square = others.square.sum(axis=(0, 1)).mean()
    noise = float(square / freedom * np.broadcast_to(1 / np.maximum(count, 1), used.shape).mean(where=used))
    used = np.broadcast_to(used, this.mean.shape)
    return this.mean[used], others.mean[used], noise


def _line(mean: NDArray[np.float64], rest: NDArray[np.float64], noise: float) -> tuple[float, float]:
    """Slope and intercept of means against others with this noise variance, which would bias the slope otherwise."""
    signal = float(rest.var()) - noise
    slope = float(((mean - mean.mean()) * (rest - rest.mean())).mean()) / signal if signal > _FLAT * noise else 1.0
    return slope, float(mean.mean() - slope * rest.mean())


def _root_mean_square(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
