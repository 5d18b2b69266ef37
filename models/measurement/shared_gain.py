"""`session`: any other model with an unknown gain and offset that all taps of an episode share.

Nobody knows at test time what the gain of the sensor is that day. It is one of S states on a grid, enumerated beside
where and what: the belief is carried over (where, what, state), and decisions take the sum over states (see `states`).
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from ..errors import InputError
from ..grid import ClassGrid
from ..settings import FitSettings
from ..taps import TapSet
from .fits.priors import Taps
from .fits.session_lines import SessionLine, live_taxels, session_line
from .likelihood.bins import bin_edges
from .model import Fitted, Row
from .scaling import Moments
from .states import States

ROW = Row("independence of taps", "any other with a gain and offset shared by all taps of an episode")
GAINS, OFFSETS = 7, 3
"""Number of grid points for gains and for offsets."""
_REACH = 2.0  # standard deviations to which the grid reaches
_GAIN_SD, _OFFSET_BINS = 0.05, 0.5  # where a single training session says nothing
_LEAST_GAIN = 1e-3
_UNSURE = 0.2  # sampling error of a gain from which on it says nothing
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
        own: Log gain and offset at `level` of the training sessions, relative to their mean, by their numbers; as
            expected given their lines, the sampling errors of these and this spread.
    """

    gain_sd: float
    offset_sd: float
    correlation: float = 0.0
    level: float = 0.0
    contrast: float = 1.0
    sessions: int = 0
    own: Mapping[int, NDArray[np.float64]] = {}

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of log gain and offset, shape (2, 2)."""
        sd = np.array([self.gain_sd, self.offset_sd])
        return np.outer(sd, sd) * [[1, self.correlation], [self.correlation, 1]]

    @property
    def unit(self) -> NDArray[np.float64]:
        """How far a log gain of 1 and an offset of 1 move samples, shape (2,)."""
        return np.array([self.contrast, 1.0])

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

    def layout(self) -> "Layout":
        """Where states lie, along the principal axes of gain and offset, of which the first moves samples most.

        As many states as the grid of `state_grid` has, all on the first axis where the other one is much shorter. The
        normal grid is mapped to quantiles of Student's t distribution, that of a session beside those known. The
        stand-in for unknown differences has independent gains and offsets.
        """
        if not self.sessions:
            return Layout.independent(self.gain_sd, self.offset_sd)
        unit = self.unit
        variance, axes = np.linalg.eigh(self.covariance * np.outer(unit, unit))
        sd, axes = np.sqrt(np.maximum(variance[::-1], 0)), axes[:, ::-1] / unit[:, None]
        z = _spread_over(sd, _SHORT)
        return Layout(np.where(axes[0] < 0, -1, 1) * axes * sd, self.widened(z), _log_prior(z))

    def widened(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Quantiles of Student's t distribution of a session beside the known ones, for those of a normal one."""
        n = self.sessions
        return np.sqrt(1 + 1 / n) * stdtrit(max(n - 1, 1), ndtr(z)) if n else z

    def states(self, layout: "Layout") -> States:
        """States of a layout."""
        log_gain, offset = layout.axes @ layout.z
        log_gain = np.clip(log_gain, np.log(_LEAST_GAIN), -np.log(_LEAST_GAIN))
        covariance = self.covariance
        slope = covariance[0, 1] / covariance[0, 0] if covariance[0, 0] else 0.0
        gain = np.exp(log_gain)
        # A pure gain about another level moves this one by slope (gain - 1), to first order slope log(gain).
        offset += slope * (gain - 1 - log_gain) + self.level * (1 - gain)
        return States(gain, offset, layout.log_prior)

    def at_rest(self, taps: TapSet, layout: "Layout") -> TapSet:
        """Training taps without those differences between their sessions that states hold.

        Args:
            taps: The taps; those of sessions without a line stay as they are.
            layout: Where the states lie. Differences within their spacing stay in the samples, so the model behind
                holds them.
        """
        part = layout.held(self)
        numbers, index = np.unique(taps.session, return_inverse=True)
        log_gain, offset = np.array([part @ self.own.get(int(number), np.zeros(2)) for number in numbers]).T
        gain = np.exp(log_gain)
        shift = offset + self.level * (1 - gain)  # a tap z was gain z + shift
        return taps.moved(1 / gain[index], -(shift / gain)[index])


class Layout(NamedTuple):
    """Points of a grid along two directions of gains and offsets.

    Attributes:
        axes: Log gain and offset at the mean level for a standard deviation along each direction, shape (2, 2).
        z: Points in standard deviations, shape (2, S).
        log_prior: Logs of their probabilities, shape (S,).
    """

    axes: NDArray[np.float64]
    z: NDArray[np.float64]
    log_prior: NDArray[np.float64]

    @classmethod
    def independent(
        cls, gain_sd: float, offset_sd: float, level: float = 0.0, gains: int = GAINS, offsets: int = OFFSETS
    ) -> "Layout":
        """That of gains about a point `level` below the mean level and of independent offsets."""
        z = _spread_over(np.array([gain_sd, offset_sd]), 0.0, gains, offsets)
        return cls(np.array([[gain_sd, 0.0], [level * gain_sd, offset_sd]]), z, _log_prior(z))

    def held(self, spread: SessionSpread) -> NDArray[np.float64]:
        """Matrix from log gain and offset at the mean level to that part of them which states hold, shape (2, 2).

        That is the projection on the directions with several points, least squares of what samples move, each shortened
        such that the rest has the variance of a uniform draw from the distance of neighbouring points.
        """
        unit, part = spread.unit, np.zeros((2, 2))
        points = [np.unique(z) for z in self.z]
        axes = self.axes * [len(each) > 1 for each in points]
        coefficients = np.linalg.pinv(axes * unit[:, None]) * unit
        sd = np.sqrt(np.maximum(np.diag(coefficients @ spread.covariance @ coefficients.T), 0))
        for axis, each, row, known in zip(axes.T, points, coefficients, sd, strict=True):
            if len(each) > 1 and known > 0:
                part += np.outer(axis, row) * max(0.0, 1 - np.diff(each).min() / np.sqrt(12) / known)
        return part


class SharedGain(NamedTuple):
    """Gains and offsets of training taps that a model is to have states for.

    Attributes:
        states: The states.
        taps: Training taps for the model behind.
        edges: Edges of its bins, those of the taps as they were recorded unless they are given.
        training: Digests of the taps as they were recorded.
        level: Level at which offsets are told.
        known: Whether training sessions show how sessions differ, or somebody said it.
        dead: Taxels that are constant in every training session.
    """

    states: States
    taps: TapSet
    edges: NDArray[np.float64]
    training: NDArray[np.uint64]
    level: float
    known: bool
    dead: list[int]

    @classmethod
    def of(cls, taps: TapSet, grid: ClassGrid, settings: FitSettings, at_rest: bool = True) -> "SharedGain":
        """States for training taps.

        Args:
            taps: Training taps.
            grid: The classes.
            settings: Standard deviations of log gain and offset between sessions, where they are given; gain and offset
                are independent then and those of the samples as they are.
            at_rest: Whether the model behind is fitted to taps without the differences that states hold.

        Raises:
            InputError: No tap belongs to a class, or samples are too large.
        """
        where, what = taps.indices(grid)
        used = taps.select((where >= 0) & (what >= 0))
        edges = settings.edges
        edges = bin_edges(used.extremes, settings.bins, settings.value_range) if edges is None else edges
        spread, given = session_spread(taps, grid, edges), (settings.gain_sd, settings.offset_sd)
        if given == (None, None):
            layout, level = spread.layout(), spread.level
            states = spread.states(layout)
        else:
            (gain_sd, offset_sd), level = spread.about_zero(*given), 0.0
            states, layout = state_grid(gain_sd, offset_sd), Layout.independent(gain_sd, offset_sd, spread.level)
            for axis, sd in enumerate(given):
                if sd is None:
                    layout.z[axis] = spread.widened(layout.z[axis])
            states = states._replace(gain=np.exp(gain_sd * layout.z[0]), offset=offset_sd * layout.z[1])
        known, live = spread.sessions > 0 or given != (None, None), live_taxels(used.extremes, used.session)
        rest = spread.at_rest(used, layout) if at_rest else used
        return cls(states, rest, edges, used.digests, level, known, np.flatnonzero(~live).tolist())

    def behind(self, fitted: Fitted) -> Fitted:
        """The model with these states, from the one behind."""
        model: Any = fitted.model  # every kind is a dataclass
        gain, offset, _ = self.states
        moved = offset + self.level * (gain - 1)
        found, unknown = fitted.convergence, "" if self.known else " (a guess, as no sessions can be compared)"
        told = (
            f"{found.sentence} States: {len(gain)}, gains {gain.min():.3g} to {gain.max():.3g} and offsets "
            f"{moved.min():.2g} to {moved.max():.2g} at level {self.level:.3g}{unknown}."
        )
        convergence = found._replace(sentence=told, warning=f"{found.warning} {self._warning()}".strip())
        return fitted._replace(
            model=replace(model, states=self.states, training=self.training), convergence=convergence
        )

    def _warning(self) -> str:
        if not self.dead:
            return ""
        taxels, are, them = ("Taxel", "is", "it") if len(self.dead) == 1 else ("Taxels", "are", "them")
        named = f"{taxels} {', '.join(map(str, self.dead))}"
        return f"{named} {are} constant in every training session, but states move {them}: leave {them} out."


def state_grid(gain_sd: float, offset_sd: float, gains: int = GAINS, offsets: int = OFFSETS) -> States:
    """Grid of gains around 1 and offsets around 0 with normal weights.

    Args:
        gain_sd: Standard deviation of the logarithm of the gain between sessions; 0 keeps it at 1.
        offset_sd: Standard deviation of the offset, in the unit of the samples; 0 keeps it at 0.
        gains: Points over the gain, reaching to two standard deviations; if one of the two does not vary, the other
            has the points of both, to 2.5.
        offsets: Points over the offset, likewise.

    Raises:
        InputError: A standard deviation is negative or not finite, or there are no points.
    """
    if not (np.isfinite([gain_sd, offset_sd]).all() and min(gain_sd, offset_sd) >= 0 and min(gains, offsets) >= 1):
        raise InputError(
            f"gain_sd and offset_sd must not be negative, got {gain_sd} and {offset_sd}; gains and offsets must be at "
            f"least 1, got {gains} and {offsets}."
        )
    axes, z, log_prior = Layout.independent(gain_sd, offset_sd, gains=gains, offsets=offsets)
    log_gain, offset = axes @ z
    return States(np.exp(log_gain), offset, log_prior)


def _spread_over(
    sd: NDArray[np.float64], least: float, gains: int = GAINS, offsets: int = OFFSETS
) -> NDArray[np.float64]:
    """Normal grid along two axes; all points on one if the other, relative to it, has no more than `least`."""
    if min(sd) > least * max(sd):
        return _grid(_points(gains, _REACH), _points(offsets, _REACH))
    all_, none = _points(gains * offsets if max(sd) > 0 else 1, _FAR), np.zeros(1)
    return _grid(all_, none) if sd[0] >= sd[1] else _grid(none, all_)


def _points(number: int, reach: float) -> NDArray[np.float64]:
    return np.linspace(-reach, reach, number) if number > 1 else np.zeros(1)


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

    Raises:
        InputError: Samples are so large that sums of their squares are no numbers.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    numbers, members = np.unique(taps.session[inside], return_counts=True)

    def known(which: NDArray[np.bool_]) -> Taps:
        part = np.flatnonzero(inside & which)
        return Taps(taps.select(part).doubles, where[part], what[part], grid.shape)

    every, live = Moments.of(known(inside)), live_taxels(taps.extremes[inside], taps.session[inside])
    lines: dict[int, SessionLine] = {}
    for number in numbers.tolist() if len(numbers) > 1 else ():
        line = session_line(known(taps.session == number), every, live)
        if line is not None:
            lines[number] = line
    if not lines:
        mean = every.mean[np.broadcast_to(every.samples > 0, every.mean.shape)]
        stand_in = _GAIN_SD, _OFFSET_BINS * float(np.diff(edges, axis=-1).mean())
        return SessionSpread(*stand_in, level=float(mean.mean()), contrast=float(mean.std()) or 1.0)
    level = float(np.mean([line.level for line in lines.values()]))
    scatter = np.sum([line.scatter for line in lines.values()], axis=0)
    scatter /= max(sum(line.freedom for line in lines.values()), 1)
    difference, error = {}, {}
    for number, line in lines.items():
        if line.weights[0, 0] * np.sqrt(scatter[0, 0]) > _UNSURE:
            line = line._replace(gain=1.0, weights=line.weights * [[0], [1]])  # noqa: PLW2901
        offset = line.offset + (line.gain - 1) * (level - line.level)
        moved = np.array([[1.0, 0.0], [level - line.level, 1.0]]) @ line.weights
        difference[number] = np.array([np.log(max(line.gain, _LEAST_GAIN)), offset])
        error[number] = moved @ scatter @ moved.T
        if not np.isfinite(error[number]).all():
            raise InputError(
                "The samples are too large to compare sessions; use a larger unit, or a model without session."
            )
    # A session differs from the mean of n - 1 others by more than from the truth.
    found, mean_error = (
        (1 - 1 / len(numbers)) * np.mean(each, axis=0)
        for each in ([np.outer(one, one) for one in difference.values()], list(error.values()))
    )
    covariance, count = found - mean_error, len(lines)
    # No sessions show that there is no difference at all.
    sd = np.sqrt(np.maximum(np.diag(covariance), np.diag(mean_error) / count))
    correlation = float(np.clip(covariance[0, 1] / (sd.prod() or np.inf), -1, 1))
    # As adjusted for degrees of freedom: two sessions always lie on a line.
    shrunk = _root(1 - (1 - correlation**2) * (count - 1) / (count - 2)) if count > 2 else 0.0
    correlation = float(np.copysign(shrunk, correlation))
    contrast = float(np.sqrt(np.mean([line.signal for line in lines.values()]))) or 1.0
    spread = SessionSpread(float(sd[0]), float(sd[1]), correlation, level, contrast, count)
    own, unit = {}, spread.unit
    for number, share in zip(numbers.tolist(), 1 - members / members.sum(), strict=True):
        if number in lines:  # the mean of all is nearer than that of the others
            noisy = unit * (spread.covariance + share * error[number]) * unit[:, None]
            own[number] = spread.covariance @ (unit * (np.linalg.pinv(noisy) @ (unit * share * difference[number])))
    return spread._replace(own=own)
