"""Belief threshold for a wanted error, tuned on sessions that did not train the model.

Beliefs are no error rates where the model is wrong, but a threshold can be tuned until decisions err as rarely as
wanted. Errors persist in a session: the mounting of today takes one object for another in nearly every trial, that of
tomorrow does not. So sessions are the sample, not trials, and what a threshold will do in a new one is as uncertain as
sessions differ; with such a drift the error has a floor, however high the threshold.

**Prediction for a new session.** Errors of sessions lie between 0 and 1, often at 0, and move in steps of about one
over the number of objects. On the scale arcsin sqrt(error), on which proportions spread alike everywhere, sessions are
taken as normal with unknown mean and spread, and the spread has a prior that weighs as much as one session more which
deviates by 0.15: that is 0.02 of error where it is 0, and 0.15 where it is a half. Without it, five sessions without an
error would promise that there never is one. The interval is that of Student's t with as many degrees of freedom as
there are sessions. `benchmarks/studies/audit/target.py` counts how often it holds.

A threshold is **reachable** where the upper end of that interval is at most the wanted error.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from ...inference.moves.control import check_fixation
from ...inference.trials.records import plan_trials, tap_table
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.model import TapModel
from ...models.settings import PlaySettings
from ...models.taps import TapSet
from .decided import decided_about, decided_trials

FEWEST = 5
"""Sessions that a threshold can be tuned on."""
COVERAGE = 0.9
"""Of prediction intervals."""
DEFAULT_THETA = 0.95
"""The threshold of a live episode where nothing else is said."""
TRIALS = 1000
_POINTS = 61
_LEAST = 1e-6  # 1 - threshold at the end of the grid
_SPREAD = 0.15  # prior, see the head of this file
_SESSIONS = 1.0  # that the prior weighs
_ALIKE = 0.005  # errors that differ by less count as equal: of equal ones the fastest threshold is best


class Prediction(NamedTuple):
    """Predicted results of a threshold.

    Attributes:
        theta: The threshold.
        error: Mean P(wrong) over the sessions, which is what to expect of a new one.
        low: Lower end of the 90% prediction interval of the error of a new session.
        high: Its upper end.
        taps: Mean reaction time over the sessions.
        stopped: Mean fraction of trials that crossed the threshold before the deadline.
    """

    theta: float
    error: float
    low: float
    high: float
    taps: float
    stopped: float


class SessionsLeftOut(NamedTuple):
    """What tuning itself costs: each session's threshold is tuned on the others; all of shape (n,).

    Attributes:
        theta: The threshold.
        reachable: Whether the others call the target reachable.
        error: P(wrong) of the session left out, at that threshold.
        expected: Mean of the others there.
        covered: Whether the error lies in the prediction interval from the others.
        taps: Mean reaction time of the session left out.
    """

    theta: NDArray[np.float64]
    reachable: NDArray[np.bool_]
    error: NDArray[np.float64]
    expected: NDArray[np.float64]
    covered: NDArray[np.bool_]
    taps: NDArray[np.float64]


class Curves(NamedTuple):
    """Sessions at every threshold.

    Attributes:
        theta: Increasing thresholds, shape (H,).
        error: P(wrong) over all decisions, those at the deadline among them, shape (n, H).
        each: The same of each object, NaN where a session has none of its taps, shape (n, H, M).
        taps: Mean reaction time, shape (n, H).
        stopped: Fraction of trials that crossed the threshold before the deadline, shape (n, H).
    """

    theta: NDArray[np.float64]
    error: NDArray[np.float64]
    each: NDArray[np.float64]
    taps: NDArray[np.float64]
    stopped: NDArray[np.float64]


class TargetError(NamedTuple):
    """The threshold for a wanted error.

    Attributes:
        target: The wanted P(wrong).
        reachable: Whether the chosen threshold keeps it in a new session, by the prediction interval.
        chosen: The smallest threshold that does, or, where none does, the one with the lowest error.
        default: The default threshold.
        left_out: What tuning costs.
        curves: Sessions at every threshold.
        names: Of what is decided for.
        policy: `"passive"` or `"active"`.
    """

    target: float
    reachable: bool
    chosen: Prediction
    default: Prediction
    left_out: SessionsLeftOut
    curves: Curves
    names: tuple[str, ...]
    policy: str

    @property
    def sentence(self) -> str:
        """Recommendation, in a sentence."""
        at, usual = self.chosen, self.default
        told = (
            f"threshold {_theta(at.theta)}, where {at.error:.1%} of the decisions are wrong (a new session: "
            f"{at.low:.1%} to {at.high:.1%}, {COVERAGE:.0%} prediction interval) after {at.taps:.1f} taps; the default "
            f"{usual.theta:g} has {usual.error:.1%} ({usual.low:.1%} to {usual.high:.1%}) after {usual.taps:.1f} taps"
        )
        if self.reachable:
            return f"The target error of {self.target:g} is reached at {told}."
        return f"The target error of {self.target:g} is not reached; the lowest error is at {told}."

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers for JSON."""
        left = self.left_out
        return {
            "target": self.target,
            "reachable": self.reachable,
            "policy": self.policy,
            "chosen": self.chosen._asdict(),
            "default": self.default._asdict(),
            "left_out": {name: values.tolist() for name, values in left._asdict().items()},
            "sentence": self.sentence,
        }


def target_error(
    model: TapModel,
    sessions: Sequence[TapSet],
    target: float,
    grid: ClassGrid,
    *,
    seed: int = 0,
    trials: int = TRIALS,
    play: PlaySettings = PlaySettings(),
) -> TargetError:
    """The smallest threshold whose error rate in a new session stays below the target.

    With one object decisions are about the place, see `reliability`; where the finger cannot move, trials are passive.

    Args:
        model: The fitted measurement model.
        sessions: Taps that did not train it, one set per session, at least five.
        target: Wanted P(wrong), between 0 and 1.
        grid: The classes of the model.
        seed: Of the trials.
        trials: In each session.
        play: How trials are played; decisions at the deadline count. The chosen threshold is compared with its own.

    Raises:
        InputError: There are too few sessions, one of them trained the model, or a setting is out of range.
    """
    if len(sessions) < FEWEST:
        raise InputError(
            f"A threshold for a target error requires at least {FEWEST} sessions that did not train the model, got "
            f"{len(sessions)}."
        )
    if not 0 < target < 1:
        raise InputError(f"The target error must lie between 0 and 1, got {target}.")
    if not 0 < play.threshold < 1:
        raise InputError(f"The default threshold must lie between 0 and 1, got {play.threshold}.")
    for number, taps in enumerate(sessions):
        known = model.trained_with(taps)
        if 2 * known > len(taps):
            raise InputError(
                f"Tuning session {number} trained the model: {known} of its {len(taps)} taps are the same."
            )
    curves, names, moving = session_curves(
        model,
        sessions,
        grid,
        seed=seed,
        trials=trials,
        play=play,
    )
    h, reachable = choose(curves.error, target)
    usual = int(np.searchsorted(curves.theta, play.threshold))
    return TargetError(
        float(target),
        reachable,
        predicted(curves, h),
        predicted(curves, usual),
        leave_out(curves, target),
        curves,
        names,
        "active" if moving else "passive",
    )


def session_curves(
    model: TapModel,
    sessions: Sequence[TapSet],
    grid: ClassGrid,
    *,
    seed: int = 0,
    trials: int = TRIALS,
    play: PlaySettings = PlaySettings(),
    fresh: bool = False,
) -> tuple[Curves, tuple[str, ...], bool]:
    """Errors and reaction times of each session at every threshold, what is decided for, and whether the finger moves.

    Trials of all sessions have the same random numbers.

    Args:
        model: The fitted measurement model.
        sessions: Taps of each.
        grid: The classes of the model.
        seed: Of the trials.
        trials: In each session.
        play: How trials are played; its threshold is added to those of `threshold_grid`.
        fresh: Whether no tap is drawn twice in a trial.

    Raises:
        InputError: There is nothing to decide, or a setting is out of range.
    """
    aim = check_fixation(play.fixation, grid.L) if grid.M > 1 else 0
    theta = np.union1d(threshold_grid(grid.M if grid.M > 1 else grid.L), [play.threshold])
    rows, names, moving = [], (), False
    for taps in sessions:
        subject = decided_about(tap_table(model, model.usable(taps)), grid)
        names, moving = subject.names, "active" in subject.policies and play.move_threshold < 1
        plan = plan_trials(subject.table.pool, trials, seed, aim)
        played = decided_trials(subject.table, plan, theta, play.changed(passive=not moving), seed, fresh=fresh)
        wrong = np.array([one.decided != one.true for one in played], dtype=np.float64)
        count = np.bincount(plan.what, minlength=len(names))
        with np.errstate(invalid="ignore"):
            each = np.array([np.bincount(plan.what, row, len(names)) / count for row in wrong])
        taken = np.array([one.taps.mean() for one in played])
        rows.append((wrong.mean(axis=1), each, taken, np.array([one.stopped.mean() for one in played])))
    return Curves(theta, *(np.array(column) for column in zip(*rows, strict=True))), names, moving


def threshold_grid(M: int) -> NDArray[np.float64]:
    """Thresholds from 1 / M, where one tap decides, up to 1 - 10^-6, in equal steps of the logarithm of 1 - theta."""
    return 1 - np.geomspace(1 - 1 / M, _LEAST, _POINTS)


def prediction_interval(error: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends of the 90% prediction interval of a new session's error, see the head of this file.

    Args:
        error: Of n sessions, shape (n, ...).

    Returns:
        Each of shape (...).
    """
    n = len(error)
    angle = np.arcsin(np.sqrt(np.clip(error, 0.0, 1.0)))
    squares = ((angle - angle.mean(axis=0)) ** 2).sum(axis=0) + _SESSIONS * _SPREAD**2
    freedom = n - 1 + _SESSIONS
    half = stdtrit(freedom, 0.5 + COVERAGE / 2) * np.sqrt(squares / freedom * (1 + 1 / n))
    low, high = (np.clip(angle.mean(axis=0) + sign * half, 0.0, np.pi / 2) for sign in (-1, 1))
    return np.sin(low) ** 2, np.sin(high) ** 2


def choose(error: NDArray[np.float64], target: float) -> tuple[int, bool]:
    """Which threshold to take for a wanted error, and whether it is reachable.

    Args:
        error: Of n sessions at increasing thresholds, shape (n, H).
        target: The wanted error.

    Returns:
        Index of the smallest threshold of which the prediction interval ends at or below the target; where there is
        none, of the smallest whose mean error is the lowest, or so near that nobody would wait for the difference.
    """
    _, high = prediction_interval(error)
    reaching = np.flatnonzero(high <= target)
    if len(reaching):
        return int(reaching[0]), True
    mean = error.mean(axis=0)
    return int(np.flatnonzero(mean <= mean.min() + _ALIKE)[0]), False


def predicted(curves: Curves, h: int) -> Prediction:
    """What the threshold with index h does."""
    low, high = prediction_interval(curves.error[:, h])
    means = (values[:, h].mean() for values in (curves.taps, curves.stopped))
    return Prediction(*map(float, (curves.theta[h], curves.error[:, h].mean(), low, high, *means)))


def leave_out(curves: Curves, target: float) -> SessionsLeftOut:
    """Each session under the threshold that the others choose."""
    rows = []
    for i, error in enumerate(curves.error):
        others = np.delete(curves.error, i, axis=0)
        h, reachable = choose(others, target)
        low, high = prediction_interval(others[:, h])
        covered = low <= error[h] <= high
        rows.append((curves.theta[h], reachable, error[h], others[:, h].mean(), covered, curves.taps[i, h]))
    return SessionsLeftOut(*(np.array(column) for column in zip(*rows, strict=True)))


def _theta(theta: float) -> str:
    """A threshold with as many digits as tell it from 1."""
    return f"{theta:.{max(2, int(np.ceil(1 - np.log10(1 - theta))))}f}"
