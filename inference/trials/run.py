"""Large numbers of perception episodes from a table of tap log-likelihoods.

Moves do not depend on the threshold theta_W, so one trajectory answers every threshold at once: it runs until the
slowest threshold is crossed, and each threshold takes the first tap at which its belief is exceeded.

Every random number comes from (seed, stream of the trial, tap), so the same seed gives the same trials however they
are cut into pieces and wherever these are played.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models import seeds
from ...models.errors import InputError, check_numbers
from ...models.grid import TapPool
from ...models.settings import PlaySettings, check_saturation
from ...models.threads import cores, in_order
from ..engines.compiled import border_number, classes, likelihoods, refuse_border, scaled_belief
from . import kernel
from .records import Rule, TapTable, TrialPlan, Trials, checked_plan

# The paper's range of belief thresholds; its spacing is not given.
THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.975, 0.99, 0.995)
_AT_ONCE = 8192  # trials of a piece at most
_NUMBERS_AT_ONCE = 1 << 26  # likewise, beliefs in classes, so that progress and Ctrl-C do not wait for long
_LONGER = 4  # how many times longer the pieces of several threads may be, as each costs a change of threads
_FEWEST = 1024  # trials that are worth a change of threads


def checked_thresholds(thresholds: float | Sequence[float] | None) -> tuple[float, ...]:
    """Increasing belief thresholds; `THRESHOLDS` by default.

    Raises:
        InputError: One is given twice or lies outside 0 to 1.
    """
    if thresholds is None:
        return THRESHOLDS
    numbers = check_numbers(thresholds, "--thresholds").astype(np.float64).ravel()
    checked = tuple(np.sort(numbers).tolist())
    if not checked or not all(0 <= theta <= 1 for theta in checked) or len(set(checked)) < len(checked):
        given = ",".join(f"{theta:g}" for theta in numbers)
        raise InputError(f"--thresholds must be distinct numbers from 0 to 1, got {given!r}.")
    return checked


class Player(Protocol):
    """Plays trials of one table under one rule."""

    at_once: int
    """Recommended number of trials per call."""

    def __call__(self, plan: TrialPlan, first: int, last: int, trials: Trials) -> None:
        """Plays rows `first` to `last` - 1 of a plan and fills in these rows of `trials`."""
        ...


def run_trials(
    table: TapTable,
    plan: TrialPlan,
    thresholds: ArrayLike,
    *,
    play: PlaySettings = PlaySettings(),
    seed: int = 0,
    fresh: bool = False,
    device: str = "cpu",
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Trials:
    """Decisions of the planned trials at every threshold.

    Agrees trial by trial with `episode.perceive` on a `ReplayRig` that is given `trial_uniforms`. Trials in which no
    class is left are counted in `Trials.no_class_left` and end nothing else.

    Args:
        table: Test taps.
        plan: The trials.
        thresholds: theta_W, shape (H,), any order; 1 or more never stops.
        play: How they are played; their thresholds are `thresholds` and their fixation points those of the plan.
        seed: Random seed of the draws of taps.
        fresh: Whether no tap is drawn twice in a trial, see `Rule.fresh`; on the processor only.
        device: `"cpu"` for compiled loops, `"gpu"` or `"xla-cpu"` for arrays on what JAX finds.
        workers: Threads on the processor; `None` for as many as it has cores. Changes the speed only.
        progress: Called with the number of trials finished since the last call.

    Raises:
        InputError: An argument is out of range, or there is no such device.
    """
    rule = make_rule(thresholds, play, seed)._replace(fresh=fresh)
    player = make_player(table, rule, device)
    plan = checked_plan(plan, table.pool)
    return play_plan(player, plan, len(rule.thresholds), cores(workers) if device == "cpu" else 1, progress)


def play_plan(
    player: Player, plan: TrialPlan, H: int, threads: int, progress: Callable[[int], None] | None = None
) -> Trials:
    """Decisions of the trials of a checked plan at H thresholds, played by some threads."""
    n = len(plan.where)
    trials = empty_trials(n, H)
    pieces = list(_pieces(n, threads, player.at_once * (_LONGER if threads > 1 else 1)))
    tasks = (partial(player, plan, first, last, trials) for first, last in pieces)
    for (first, last), _ in zip(pieces, in_order(tasks, threads), strict=True):
        if progress is not None:
            progress(last - first)
    return trials


def _pieces(n: int, threads: int, most: int) -> Iterator[tuple[int, int]]:
    """Ranges of trials, the end excluded, that get shorter, so that all threads end together."""
    fewest, first = -(-min(n, threads * _FEWEST) // threads), 0
    while first < n:
        last = min(first + min(max((n - first) // threads, fewest), most), n)
        yield first, last
        first = last


def make_rule(thresholds: ArrayLike, play: PlaySettings, seed: int) -> Rule:
    """Rule of trials from settings.

    Raises:
        InputError: An argument is out of range.
    """
    thresholds = np.atleast_1d(np.asarray(thresholds, dtype=np.float64))
    if not len(thresholds) or np.isnan(thresholds).any():
        raise InputError("thresholds must have at least one value, and no NaN.")
    never = np.where(thresholds >= 1, np.inf, thresholds)
    column = np.argsort(never, kind="stable")
    return Rule(never[column], column, play.move_threshold, border_number(play.border), play.deadline, *seeds.key(seed))


def make_player(table: TapTable, rule: Rule, device: str = "cpu") -> Player:
    """Player of trials on a device.

    Raises:
        InputError: The device is unknown, the table holds a value that is no log-likelihood or its parts do not fit
            each other, or the border is `prior` and the model carries a state.
    """
    check_device(device)
    if device == "cpu":
        return LoopPlayer(table, rule)
    check_table(table, rule)
    if rule.fresh:
        raise InputError(f"Trials on fresh taps require device cpu, got {device!r}.")
    from .gpu import ArrayPlayer  # noqa: PLC0415 - JAX takes half a second to import

    return ArrayPlayer(table, rule, "cpu" if device == "xla-cpu" else device)


def check_table(table: TapTable, rule: Rule) -> None:
    """Refuses tables that no trial can be played on; errors as for `make_player`."""
    if not ((table.log_likelihood < np.inf).all() and (table.log_prior < np.inf).all()):
        raise InputError("The table of log-likelihoods or the prior contains NaN or +inf.")
    (L, M), hypotheses = table.pool.shape, table.log_prior.shape[-1]
    if table.log_prior.shape != table.log_likelihood.shape[1:] or len(table.log_prior) != L or hypotheses % M:
        raise InputError(
            f"Shapes do not match: prior {table.log_prior.shape}, log-likelihoods of a tap "
            f"{table.log_likelihood.shape[1:]}, classes ({L}, {M})."
        )
    check_saturation(table.saturation)
    refuse_border(rule.border, hypotheses, M)


def check_device(device: str) -> None:
    """Refuses a device that is unknown or not there.

    Raises:
        InputError: It is.
    """
    if device not in ("cpu", "gpu", "xla-cpu"):
        raise InputError(f"device must be cpu, gpu or xla-cpu, got {device!r}.")
    if device == "gpu":
        from ...models.measurement.fits.device import jax_device  # noqa: PLC0415 - JAX takes half a second to import

        jax_device(device)


class LoopPlayer:
    """Plays trials one after the other in compiled loops.

    Attributes:
        at_once: How many trials it is best given at a time.
    """

    def __init__(self, table: TapTable, rule: Rule) -> None:
        check_table(table, rule)
        self._likelihoods = likelihoods(table.log_likelihood)
        self._pool, self._prior, self._rule = table.pool, scaled_belief(table.log_prior), rule
        self._classes, self._saturation = classes(table.trained), float(table.saturation)
        self.at_once = max(1, min(_AT_ONCE, _NUMBERS_AT_ONCE // (rule.deadline * table.log_prior.size)))

    def on(self, pool: TapPool) -> "LoopPlayer":
        """Player on another selection of the same taps, without preparing the likelihoods again."""
        other = copy(self)
        other._pool = pool
        return other

    def under(self, rule: Rule) -> "LoopPlayer":
        """Player under another rule of the same table, likewise."""
        other = copy(self)
        other._rule = rule
        return other

    def __call__(self, plan: TrialPlan, first: int, last: int, trials: Trials) -> None:
        """As `Player`."""
        known = self._likelihoods, self._pool, self._prior, self._classes, self._saturation
        kernel.play(*known, plan, self._rule, first, last, trials)


def empty_trials(n: int, H: int) -> Trials:
    """Empty record of n trials at H thresholds."""

    def integers() -> NDArray[np.int64]:
        return np.zeros((n, H), dtype=np.int64)

    return Trials(
        taps=integers(),
        what=integers(),
        where=integers(),
        true_where=integers(),
        stopped=np.zeros((n, H), dtype=np.bool_),
        clamped=integers(),
        substituted=integers(),
        belief=np.zeros((n, H)),
        used_up=np.zeros((n, H), dtype=np.bool_),
        no_class_left=np.zeros((n, H), dtype=np.bool_),
    )
