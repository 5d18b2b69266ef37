"""`session`: any other model with an unknown gain and offset that all taps of an episode share.

Nobody knows at test time what the gain of the sensor is that day. It is one of S states on a grid, enumerated beside
where and what: the belief is carried over (where, what, state), and decisions take the sum over states (see `states`).
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

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
_SHORT, _FAR = 0.2, 2.5  # an axis this short, relative to the other, gets one point; the other then reaches this far


class SessionSpread(NamedTuple):
    """Differences between sessions: a tap z becomes level + gain (z - level) + offset.

    Attributes:
        gain_sd: Standard deviation of the log gain.
        offset_sd: Standard deviation of the offset at `level`, in the unit of the samples.
        correlation: Of log gain and offset; that of a pure gain about 0 is 1 or -1 if levels are far from 0.
        level: Mean level of the training taps.
        contrast: Standard deviation of the mean taps of the classes around `level`; what a gain acts on.
        sessions: Number of sessions from which this was estimated; 0 for the stand-in, which has no correlation.
    """

    gain_sd: float
    offset_sd: float
    correlation: float = 0.0
    level: float = 0.0
    contrast: float = 1.0
    sessions: int = 0

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of log gain and offset, shape (2, 2)."""
        sd = np.array([self.gain_sd, self.offset_sd])
        return np.outer(sd, sd) * [[1, self.correlation], [self.correlation, 1]]

    def about_zero(self, gain_sd: float | None, offset_sd: float | None) -> tuple[float, float]:
        """Standard deviations of independent gains and offsets of the samples as they are.

        Args:
            gain_sd: Of the log gain, `None` for the one that agrees with these differences and `offset_sd`.
            offset_sd: Of the offset, likewise.
        """
        if gain_sd is None and offset_sd is not None:
            weights = np.array([self.contrast**2, self.level]) / (self.contrast**2 + self.level**2)  # line through 0
            gain_sd = _root(weights @ self.covariance @ weights - (weights[1] * offset_sd) ** 2)
        if offset_sd is None and gain_sd is not None:
            offset_sd = _root(self.offset_sd**2 - (self.level * gain_sd) ** 2)
        return (self.gain_sd if gain_sd is None else gain_sd), (self.offset_sd if offset_sd is None else offset_sd)

    def states(self) -> States:
        """Grid along the principal axes of gain and offset, the first of which moves samples most.

        As many states as the grid of `state_grid` has, all on the first axis where the other one is much shorter. The
        normal grid is mapped to quantiles of Student's t distribution, as few sessions may show too small a spread. The
        stand-in for unknown differences is `state_grid` about `level`.
        """
        if not self.sessions:
            plain = state_grid(self.gain_sd, self.offset_sd)
            return plain._replace(offset=plain.offset + self.level * (1 - plain.gain))
        unit, covariance = np.array([self.contrast, 1.0]), self.covariance
        variance, axes = np.linalg.eigh(covariance * np.outer(unit, unit))
        sd, axes = np.sqrt(np.maximum(variance[::-1], 0)), axes[:, ::-1] / unit[:, None]
        if sd[1] < _SHORT * sd[0]:
            z = _grid(_points(GAINS * OFFSETS, sd[0], _FAR), np.zeros(1))
        else:
            z = _grid(_points(GAINS, sd[0]), _points(OFFSETS, sd[1]))
        log_prior, z = _log_prior(z), stdtrit(self.sessions, ndtr(z))
        log_gain, offset = np.where(axes[0] < 0, -1, 1) * axes * sd @ z
        log_gain = np.clip(log_gain, np.log(_LEAST_GAIN), -np.log(_LEAST_GAIN))
        slope = covariance[0, 1] / covariance[0, 0] if covariance[0, 0] else 0.0
        gain = np.exp(log_gain)
        # A pure gain about another level moves this one by slope (gain - 1), to first order slope log(gain).
        offset += slope * (gain - 1 - log_gain) + self.level * (1 - gain)
        return States(gain, offset, log_prior)


def with_shared_gain(
    fitted: Fitted, taps: TapSet, grid: ClassGrid, gain_sd: float | None, offset_sd: float | None
) -> Fitted:
    """Fitted model with gains and offsets that all taps of an episode share.

    Args:
        fitted: Any fit.
        taps: Its training taps.
        grid: The classes.
        gain_sd: Standard deviation of the log gain between sessions; `None` to take it from the training taps. If this
            or `offset_sd` is given, gain and offset are independent and those of the samples as they are.
        offset_sd: Standard deviation of the offset between sessions, likewise.

    Raises:
        InputError: A standard deviation is negative or not finite.
    """
    model: Any = fitted.model  # every kind is a dataclass
    spread = session_spread(taps, grid, model.edges)
    if gain_sd is None and offset_sd is None:
        states, level = spread.states(), spread.level
    else:
        states, level = state_grid(*spread.about_zero(gain_sd, offset_sd)), 0.0
    moved = states.offset + level * (states.gain - 1)
    sentence = f"{fitted.convergence.sentence} States: {len(states.gain)}, gains {states.gain.min():.3g} to "
    sentence += f"{states.gain.max():.3g} and offsets {moved.min():.2g} to {moved.max():.2g} at level {level:.3g}."
    convergence = fitted.convergence._replace(sentence=sentence)
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
    z = _grid(_points(gains, gain_sd), _points(offsets, offset_sd))
    return States(np.exp(z[0] * gain_sd), z[1] * offset_sd, _log_prior(z))


def _points(number: int, sd: float, reach: float = _REACH) -> NDArray[np.float64]:
    return np.linspace(-reach, reach, number) if number > 1 and sd > 0 else np.zeros(1)


def _grid(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([axis.ravel() for axis in np.meshgrid(first, second, indexing="ij")])


def _log_prior(z: NDArray[np.float64]) -> NDArray[np.float64]:
    log_prior = -0.5 * (z**2).sum(axis=0)
    return log_prior - np.logaddexp.reduce(log_prior)


def _root(variance: float) -> float:
    return float(np.sqrt(max(variance, 0.0)))


def session_spread(taps: TapSet, grid: ClassGrid, edges: NDArray[np.float64]) -> SessionSpread:
    """Gains and offsets between sessions of training taps.

    The mean taps of the classes in each session are regressed on those in all others. The covariance of the results
    less that of their sampling errors is that of sessions. Where that says nothing, as with a single session, 5% and
    half a bin stand in.

    Args:
        taps: Training taps.
        grid: The classes.
        edges: Bin edges, which set the unit of the stand-in.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    numbers = np.unique(taps.session[inside])
    lines: list[_Line] = []
    for number in numbers if len(numbers) > 1 else ():
        this, rest = (
            Taps(taps.select(part).doubles, where[part], what[part], grid.shape)
            for part in (np.flatnonzero(inside & (same == (taps.session == number))) for same in (True, False))
        )
        line = _line(this, Moments.of(rest))
        if line is not None:
            lines.append(line)
    if not lines:
        part = np.flatnonzero(inside)
        every = Moments.of(Taps(taps.select(part).doubles, where[part], what[part], grid.shape))
        mean = every.mean[np.broadcast_to(every.samples > 0, every.mean.shape)]
        stand_in = _GAIN_SD, _OFFSET_BINS * float(np.diff(edges, axis=-1).mean())
        return SessionSpread(*stand_in, level=float(mean.mean()), contrast=float(mean.std()) or 1.0)
    level = float(np.mean([line.level for line in lines]))
    scatter = sum(line.scatter for line in lines) / max(sum(line.freedom for line in lines), 1)
    found, error = np.zeros((2, 2)), np.zeros((2, 2))
    for line in lines:
        gain, offset = line.gain, line.offset + (line.gain - 1) * (level - line.level)
        moved = np.array([[1.0, 0.0], [level - line.level, 1.0]]) @ line.weights
        difference = np.array([np.log(max(gain, _LEAST_GAIN)), offset])
        found += np.outer(difference, difference) / len(lines)
        error += moved @ scatter @ moved.T / len(lines)
    # A session differs from the mean of n - 1 others by more than from the truth.
    found, error = ((1 - 1 / len(numbers)) * each for each in (found, error))
    covariance, count = found - error, len(lines)
    # No sessions show that there is no difference at all.
    sd = np.sqrt(np.maximum(np.diag(covariance), np.diag(error) / count))
    correlation = float(np.clip(covariance[0, 1] / (sd.prod() or np.inf), -1, 1))
    # As adjusted for degrees of freedom: two sessions always lie on a line.
    shrunk = _root(1 - (1 - correlation**2) * (count - 1) / (count - 2)) if count > 2 else 0.0
    correlation = float(np.copysign(shrunk, correlation))
    contrast = float(np.sqrt(np.mean([line.signal for line in lines]))) or 1.0
    return SessionSpread(float(sd[0]), float(sd[1]), correlation, level, contrast, count)


class _Line(NamedTuple):
    """A session's mean taps against those of the others.

    Attributes:
        gain: Slope.
        offset: Difference of the means over all classes, times and taxels.
        level: Their mean in the others.
        signal: Variance of the others' mean taps without their noise.
        weights: Times the sums in `scatter` gives the sampling errors of slope and offset, shape (2, 2).
        scatter: Sum over taps of the products of two weighted sums of their deviations, shape (2, 2).
        freedom: Degrees of freedom of `scatter`.
    """

    gain: float
    offset: float
    level: float
    signal: float
    weights: NDArray[np.float64]
    scatter: NDArray[np.float64]
    freedom: float


def _line(taps: Taps, others: Moments) -> _Line | None:
    """Line of a session; `None` without a class in both, or with two taps in the others to tell noise by."""
    this = Moments.of(taps)
    n, count = this.samples, others.samples
    used, freedom = (n > 0) & (count > 0), np.maximum(count - 1, 0).sum(axis=(0, 1)).mean()
    if not used.any() or not freedom:
        return None
    square = others.square.sum(axis=(0, 1)).mean()
    noise = float(square / freedom * np.broadcast_to(1 / np.maximum(count, 1), used.shape).mean(where=used))
    used = np.broadcast_to(used, this.mean.shape)
    mean, rest = this.mean[used], others.mean[used]
    level, signal = float(rest.mean()), float(rest.var()) - noise
    flat = signal <= _FLAT * noise
    gain = 1.0 if flat else float(((mean - mean.mean()) * (rest - level)).mean()) / signal
    # Each tap adds to the sums by which slope and offset are found; its samples need not be independent.
    classes, number, rest_number = used.any(axis=(2, 3)), n.mean(axis=(2, 3)), count.mean(axis=(2, 3))
    whole = np.where(used, number[..., None, None] / np.maximum(n, 1), 0.0)
    sums = np.stack([whole * (others.mean - level), whole])

    def products(block: NDArray[np.float64], which: slice) -> NDArray[np.float64]:
        deviation = np.nan_to_num(this.residual(taps, block, which))
        own = taps.where[which], taps.what[which]
        each = np.stack([np.einsum("njk,njk->n", deviation, weight[own]) for weight in sums])
        return each @ each.T

    taken = (1 / number[classes] + 1 / rest_number[classes]).sum()
    scale = np.array([0.0 if flat else 1 / signal, 1.0]) * np.sqrt(taken) / used.sum()
    scatter = np.asarray(sum(taps.over_blocks(products)))
    freedom = float(np.maximum(number[classes] - 1, 0).sum())
    return _Line(gain, float(mean.mean()) - level, level, max(signal, 0.0), np.diag(scale), scatter, freedom)
