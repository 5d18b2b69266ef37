"""Sampling variation of trials: the same trials on other selections of the test taps.

Drawn anew would be the sessions where several test, else the taps of the one. Models, policies and thresholds that are
given the same taps get the same selections and the same random numbers, so their differences pair. The model, and so
the training taps, stays as it is.

Trials on fresh taps draw no tap twice (`montecarlo.Rule.fresh`), so every decision is one on new taps; what those might
have come to that had all taps of a class, `cut_short` says. Their selections (`thinned_pools`) leave out a quarter of
the taps of each class, so no tap is in them twice. They vary a third as much as data sets do, from which is known how
much an estimate varies (delete-d jackknife: Shao and Wu 1989). Trials that draw stored taps with replacement have
selections of the same kind (`resampled_pools`): taps of each class drawn with replacement (bootstrap).

Several sessions are left out in turn, with all of their taps (jackknife). What varies within a session varies between
sessions too, so taps are not drawn besides; of S sessions the variance is known with S - 1 degrees of freedom, or fewer
where some have fewer taps than others.

Selections say how much an estimate varies, not where it lies: only their variance counts, see `Spread.interval`. What
they vary by the sampling of their few trials is known from the two halves of these trials, and taken out; how well the
variance is known widens the interval.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from ...models.grid import FEW_TAPS, TapPool
from ...models.settings import PlaySettings
from ...models.threads import cores, in_order
from .records import TapTable, TrialPlan, Trials, plan_trials
from .run import LoopPlayer, empty_trials, make_rule
from .selections import LEFT_OUT, resampled_pools, session_sizes, thinned_pools, uncaught
from .skewness import skewed_quantile, skewness_of_mean

type Floats = NDArray[np.float64]

RESAMPLES = 100
CONFIDENCE = 0.95
_FEW_SESSIONS, _FEW_FREEDOM = 4, 10.0
RESAMPLE_TRIALS = 2000
USED_UP = 0.05
"""Fraction of trials ended by a lack of stored taps, above which there are too few taps."""
USED_UP_SELECTED = 0.005
"""As `USED_UP`, in selections of three quarters of the taps, above which intervals are too wide; same page."""
_LEAST_FREEDOM = 4.0  # where the chance of trials hides that of taps, how well either is known is not known itself
_AT_ONCE = 1 << 15  # trials whose decisions are held
_DEFINED = 0.95  # of the resamples: an interval from fewer would be that of the lucky ones


class Spread(NamedTuple):
    """Converts resamples to intervals.

    Attributes:
        factor: By which deviations of resamples, or of several data sets, are enlarged. NaN where there is one tap of a
            class and one session, which gives no interval.
        few: Why intervals may be off, in a sentence; empty where they hold.
        taps: How many test taps there are.
        noise: Variance by the sampling of the estimate's trials, relative to that of a resample's fewer ones; `None`
            where samples hold no halves of trials, see `interval`.
        freedom: Degrees of freedom of the variance where sessions are left out in turn, or lone taps make it; infinite
            where taps are drawn else.
        sessions: How many are left out in turn; 1 where taps are drawn.
        sizes: Taps of each cluster that is left out of a mean in turn, shape (R,), if the interval is to be corrected
            for the skewness of clusters.
    """

    factor: float
    few: str = ""
    taps: int = 0
    noise: float | None = None
    freedom: float = np.inf
    sessions: int = 1
    sizes: NDArray[np.intp] | None = None

    @property
    def tells(self) -> bool:
        """Whether intervals exist."""
        return bool(np.isfinite(self.factor))

    def whole(self, samples: Floats) -> Floats:
        """Resamples among samples, without the estimate and halves."""
        last = samples.shape[-1]
        return samples[..., 1 : last if self.noise is None else 1 + (last - 1) // 3]

    def center(self, samples: Floats) -> Floats:
        """Mean of the finite resamples; 0 if there is none."""
        return _moments(self.whole(samples))[0]

    def interval(
        self,
        samples: Floats,
        least: ArrayLike = -np.inf,
        most: ArrayLike = np.inf,
        endings: Sequence[Floats] = (),
        event: ArrayLike = 0.0,
    ) -> tuple[Floats, Floats]:
        """Ends of the 95% interval.

        Of a quantity without a least value it is that of Student's t, with Hall's correction for skewness where
        `sizes` are known. With one it is that of a score: its ends are the values from which the estimate lies just so
        many standard deviations away if the variance grows with the value as that of a proportion or a count does
        (Wilson 1927). So few errors leave more room above than below.

        Args:
            samples: The estimate and, behind that, R resamples, shape (..., 1 + R); where `noise` is known also the
                first halves of their trials, then the second ones, shape (..., 1 + 3 R). NaN resamples are left out;
                where they are more than one in twenty, the interval is NaN. Infinite ones may be its ends.
            least: What the quantity cannot be below.
            most: Nor above.
            endings: What else the estimate might have been, shape (...): the interval holds those of all, see
                `cut_short`.
            event: How much an event that may not have been seen would change the quantity; its square is added to the
                variance. Broadcast to (...).

        Returns:
            Each of shape (...).
        """
        estimate, drawn = samples[..., 0], self.whole(samples)
        defined = ~np.isnan(drawn)
        enough = self.tells & ~np.isnan(estimate) & (defined.sum(axis=-1) >= max(1.0, _DEFINED * drawn.shape[-1]))
        tail = (1 - CONFIDENCE) / 2
        variance, freedom = self._variance(samples)
        variance, quantile = variance + np.square(event), stdtrit(freedom, 1 - tail)
        ordered = np.sort(drawn, axis=-1)  # NaN last
        last = np.maximum(defined.sum(axis=-1) - 1, 0)
        places = np.floor(tail * last).astype(np.intp), np.ceil((1 - tail) * last).astype(np.intp)
        center = self.center(samples)

        def around(value: Floats) -> tuple[Floats, Floats]:
            if np.isfinite(least).all():
                return _score(value, variance, quantile, center, least, most)
            error, quantiles = np.sqrt(variance), (quantile, -quantile)
            if self.sizes is not None:
                skewness = skewness_of_mean(drawn, self.sizes, self.freedom + 1)
                quantiles = [skewed_quantile(one, skewness) for one in quantiles]
            return value - quantiles[0] * error, value - quantiles[1] * error

        with np.errstate(invalid="ignore", over="ignore"):
            moved = [around(value) for value in (estimate, *endings)]
        ends = []
        for place, outermost, of in zip(places, (np.minimum, np.maximum), zip(*moved, strict=True), strict=True):
            # Where that many resamples are infinite, so is the end, unless it is on the other side of the estimate.
            end = np.take_along_axis(ordered, place[..., np.newaxis], axis=-1)[..., 0]
            finite = np.isfinite(estimate) & np.isfinite(end)
            end = np.where(finite, outermost.reduce(of), outermost(end, estimate))
            ends.append(np.where(enough, np.clip(end, least, most), np.nan))
        return ends[0], ends[1]

    def per_error(self, samples: Floats, least: float, most: float) -> Floats:
        """Change of a mean by one more error, as far as resamples show; 0 if they have no errors.

        Args:
            samples: As of `interval`.
            least: What the mean cannot be below.
            most: Nor above.
        """
        return _per_value(self._variance(samples)[0], self.center(samples), least, most)

    def margin(self, samples: Floats, tail: float) -> Floats:
        """Distance from the estimate that one side exceeds in a fraction `tail` of studies only.

        Args:
            samples: As of `interval`.
            tail: The share.
        """
        variance, freedom = self._variance(samples)
        return np.sqrt(variance) * stdtrit(freedom, 1 - tail)

    def _variance(self, samples: Floats) -> tuple[Floats, Floats]:
        """Variance of an estimate, from the taps and their trials, and its degrees of freedom, each of shape (...).

        Where the resamples' own trials are known, it is a difference of two variances from R resamples each, of
        halves' sums and differences, which are independent (Satterthwaite 1946).
        """
        whole = self.whole(samples)
        variance = _moments(whole)[1]
        freedom = np.maximum(np.isfinite(whole).sum(axis=-1) - 1.0, 1.0)
        if self.noise is None:
            return self.factor**2 * variance, np.minimum(freedom, self.freedom)
        first, second = np.split(samples[..., 1 + whole.shape[-1] :], 2, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            half = (first - second) / 2
            sampling = _moments(np.where(np.isfinite(half), half, np.nan) ** 2)[0]
            by_taps, taps_factor = np.maximum(variance - sampling, 0.0), self.factor**2
            total = taps_factor * by_taps + self.noise * sampling
            parts = (taps_factor * variance) ** 2 + ((taps_factor - self.noise) * sampling) ** 2
            known = np.maximum(freedom * total**2 / parts, _LEAST_FREEDOM)
        return total, np.minimum(np.where((variance > 0) & (self.sessions == 1), known, freedom), self.freedom)


def _score(
    value: Floats, variance: Floats, quantile: Floats, center: Floats, least: ArrayLike, most: ArrayLike
) -> tuple[Floats, Floats]:
    """Ends of the score interval of a quantity between a least and a greatest value, which may be infinite.

    Args:
        value: The estimate.
        variance: Variance of the quantity at `center`, which determines how it grows.
        quantile: Quantile of Student's t.
        center: Mean of the resamples.
        least: Least possible value.
        most: Greatest possible value.
    """
    span, above = np.subtract(most, least), np.subtract(value, least)
    q = quantile**2 * _per_value(variance, center, least, most)
    root = np.sqrt(np.maximum(q * (q + 4 * above * (1 - above / span)), 0.0))
    ends = (np.add(least, (2 * above + q + sign * root) / (2 * (1 + q / span))) for sign in (-1, 1))
    low, high = (np.where(np.isinf(value), value, end) for end in ends)
    return np.minimum(low, value), np.maximum(high, value)  # which rounding may put outside


def _per_value(variance: Floats, at: Floats, least: ArrayLike, most: ArrayLike) -> Floats:
    """Growth of the variance of a proportion or count with its value; 0 at either end of its range."""
    above = np.subtract(at, least)
    value = above * (1 - above / np.subtract(most, least))
    return np.divide(variance, value, out=np.zeros(np.shape(value)), where=value > 0)


def _moments(drawn: Floats) -> tuple[Floats, Floats]:
    """Mean and variance of the finite values over the last axis."""
    finite = np.isfinite(drawn)
    count = np.maximum(finite.sum(axis=-1), 1)
    mean = np.where(finite, drawn, 0.0).sum(axis=-1) / count
    with np.errstate(invalid="ignore"):
        deviation = np.where(finite, drawn - mean[..., np.newaxis], 0.0)
    return mean, (deviation**2).sum(axis=-1) / np.maximum(count - 1, 1)


def share_beyond(independent: ArrayLike) -> Floats:
    """Upper end of the interval of a proportion without a case in a number of independent trials.

    Three over their number is the familiar rule for an upper end alone; this is that of a two-sided interval.
    """
    return 1 - ((1 - CONFIDENCE) / 2) ** (1 / np.maximum(1.0, np.asarray(independent, dtype=np.float64)))


def widened(
    low: Floats,
    high: Floats,
    value: Floats,
    center: Floats,
    independent: ArrayLike,
    unit: ArrayLike = 1.0,
    most: ArrayLike = 1.0,
    *,
    least: float = 0.0,
    opened: bool = False,
) -> tuple[Floats, Floats]:
    """Interval of a mean error, widened if the estimate or its resamples have no errors or errors only.

    Likewise of a mean number of taps, where every decision takes one.

    Args:
        low: Lower end.
        high: Upper end.
        value: The estimate.
        center: Mean of the resamples.
        independent: How many decisions are independent of each other.
        unit: The smallest error; 1 in a proportion, 0 where there is none.
        most: The greatest mean error, which may be infinite.
        least: The least.
        opened: Whether ends that are NaN become the least and the greatest mean.
    """
    beyond = np.asarray(unit) * share_beyond(independent)
    if opened:
        low, high = np.where(np.isnan(low), least, low), np.where(np.isnan(high), most, high)
    some = np.greater(np.minimum(value, center), least)
    not_only = np.less(np.maximum(value, center), most)
    low = np.where(some, low, np.minimum(low, least))
    high = np.where(not_only, high, np.maximum(high, most))
    low = np.where(not_only, low, np.minimum(low, np.subtract(most, beyond)))
    return low, np.where(some, high, np.minimum(np.maximum(high, least + beyond), most))


def spread(table: TapTable, *, noise: float | None = None, thinned: bool = False) -> Spread:
    """Spread of the resamples of a table.

    Args:
        table: Test taps.
        noise: See `Spread`.
        thinned: Whether resamples are `thinned_pools`, or `resampled_pools`.
    """
    taps, sizes, total = taps_per_class(table.pool), session_sizes(table), int(table.pool.count.sum())
    sessions = len(sizes)
    if sessions > 1:
        freedom = freedom_of(sizes)
        few = too_few(taps, sessions=sessions, freedom=freedom)
        return Spread((sessions - 1.0) ** 0.5, few, total, noise, freedom, sessions)
    # n of n draws with replacement vary less than the quantity itself, by n - 1 over n.
    factor = np.nan if taps == 1 else (1 / LEFT_OUT if thinned else taps / (taps - 1)) ** 0.5
    times, freedom = uncaught(table, factor)
    return Spread(float(factor * times**0.5), too_few(taps, freedom=freedom), total, noise, freedom)


def freedom_of(sizes: NDArray[np.intp]) -> float:
    """Degrees of freedom of a variance between groups of these numbers of taps, shape (G,)."""
    alike = float(sizes.sum() ** 2 / (sizes**2).sum())  # so many groups of one size are worth as much (Kish 1965)
    return max(1.0, alike - 1)


def resamples_in_words(sessions: int, thinned: bool = True) -> str:
    """What intervals are from, to follow "the test taps"; of one session, "resamples" or "selections" of these.

    Args:
        sessions: That are drawn, see `selections.session_sizes`.
        thinned: Whether taps are drawn as in `thinned_pools`, or as in `resampled_pools`.
    """
    if sessions > 1:
        return f"without each of the {sessions} test sessions in turn"
    return "without a quarter of each class" if thinned else "of each class, drawn with replacement"


def taps_per_class(pool: TapPool) -> int:
    """Median number of taps per class that a trial can draw, over classes with taps."""
    return max(1, int(np.median(pool.count[pool.count > 0])))


def too_few(
    taps: int,
    used_up: float = 0.0,
    selected: float = 0.0,
    sessions: int = 1,
    freedom: float | None = None,
    decisions: str = "decisions",
) -> str:
    """Reason why intervals may be inaccurate, as a sentence; empty if they are reliable.

    Args:
        taps: Number of taps per class.
        used_up: Share of the trials that ended because all taps of a class were drawn.
        selected: That share in `thinned_pools`.
        sessions: Number that would be drawn anew, see `selections.session_sizes`.
        freedom: See `Spread`; that of sessions of one size unless said.
        decisions: Name of the decisions, for the sentence.
    """
    unequal = " of unequal sizes" if sessions >= _FEW_SESSIONS else ""
    few_sessions = (sessions - 1 if freedom is None else freedom) < _FEW_SESSIONS - 1
    reasons = (
        (taps == 1 and sessions == 1, "Most classes have a single test tap, too few for an interval."),
        (
            used_up > USED_UP,
            f"Too few test taps: {used_up:.0%} of the {decisions} were forced because the taps of a class, about "
            f"{taps}, were used up before the belief was high enough; intervals cover any outcome of further taps, so "
            "they are wide.",
        ),
        (
            sessions > 1 and few_sessions,
            f"Too few test sessions, {sessions}{unequal}, to estimate the variation between sessions, so intervals are "
            "unreliable: usually wide, but too narrow at times where few sessions have most of the errors.",
        ),
        (sessions > 1, ""),
        (taps < FEW_TAPS, f"Too few test taps, about {taps} per class: intervals are rough."),
        (
            freedom is not None and freedom < _FEW_FREEDOM,
            "Some classes have a single test tap, too few to estimate their variation, so intervals are wide.",
        ),
        (
            selected > USED_UP_SELECTED,
            f"Too few test taps for these intervals: without a quarter of them, {selected:.1%} of the {decisions} are "
            "forced because the taps of a class are used up, so intervals may be too wide.",
        ),
    )
    return next((sentence for holds, sentence in reasons if holds), "")


def too_few_in(pool: TapPool, how: Spread, used_up: Floats) -> str:
    """`too_few` for trials with the fraction ended by stored taps, samples as in `Spread.interval`."""
    return too_few(taps_per_class(pool), float(used_up[0]), float(how.center(used_up)), how.sessions, how.freedom)


class ResampledTrials(NamedTuple):
    """Sums over trials on the test taps and on each resample, by name.

    Attributes:
        samples: With one more axis: of the taps as they are first, then of each resample the mean of both halves of its
            trials, then of each the first half, then of each the second, 1 + 3 R; see `Spread.interval`.
        endings: What else the former might have been, without that axis.
        trials: How many trials the former are of.
        half: How many those of a resample, and each of its halves.
    """

    samples: dict[str, Floats]
    endings: tuple[Mapping[str, Floats], ...]
    trials: int
    half: int

    def per_trial(self) -> "ResampledTrials":
        """Means over the trials, of sums over them."""
        n = self.trials
        samples = {
            name: np.concatenate([sums[..., :1] / n, sums[..., 1:] / self.half], axis=-1)
            for name, sums in self.samples.items()
        }
        ends = tuple({name: sums / n for name, sums in one.items()} for one in self.endings)
        return self._replace(samples=samples, endings=ends)


def no_endings(_: Trials, __: TrialPlan) -> Sequence[Trials]:
    """Counts trials as they were decided."""
    return ()


def play_resamples(
    table: TapTable,
    thresholds: ArrayLike,
    reduce: Callable[[Trials, TrialPlan], Mapping[str, Floats]],
    *,
    trials: int,
    play: PlaySettings = PlaySettings(),
    fixation: int = 0,
    where: int | None = None,
    seed: int = 0,
    fresh: bool = True,
    resamples: int = RESAMPLES,
    resample_trials: int = RESAMPLE_TRIALS,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    endings: Callable[[Trials, TrialPlan], Sequence[Trials]] = no_endings,
) -> ResampledTrials:
    """Results of trials on the test taps, and on each resample.

    Args:
        table: Test taps.
        thresholds: theta_W, shape (H,).
        reduce: What is kept of decided trials, sums over them by name; asked for some trials at a time.
        trials: On the taps as they are; their streams and starts are those of `plan_trials`.
        play: As in `run_trials`.
        fixation: Class that the sensor aims for.
        where: Start in this where class only, or the nearest with a tap in the resample; `None` for any.
        seed: Random seed of starts, draws and resamples.
        fresh: Whether no tap is drawn twice in a trial; resamples are `thinned_pools` then, else `resampled_pools`.
        resamples: How many.
        resample_trials: On each of them, at most `trials`; an even number, at least 2, is played.
        workers: Threads; `None` for as many as there are cores. Changes the speed only.
        progress: Called with the number of trials since the last call, of `planned_trials` in all.
        endings: What else the trials on the test taps might have come to, see `cut_short.endings`.

    Returns:
        What `reduce` gave, added up.

    Raises:
        InputError: An argument is out of range.
    """
    rule = make_rule(thresholds, play, seed)._replace(fresh=fresh)
    player = LoopPlayer(table, rule)
    half = _half(trials, resample_trials)

    def played_on(pool: TapPool, n: int, stream: int) -> tuple[Trials, TrialPlan]:
        plan = plan_trials(pool, n, seed, fixation, _start(pool, where), stream)
        played = empty_trials(n, len(rule.thresholds))
        player.on(pool)(plan, 0, n, played)
        return played, plan

    def both(pool: TapPool, stream: int) -> tuple[Mapping[str, Floats], ...]:
        played, plan = played_on(pool, 2 * half, stream)
        halves = slice(half), slice(half, None)
        return tuple(reduce(_part(played, rows), _part(plan, rows)) for rows in halves)

    def some(pool: TapPool, stream: int, n: int) -> tuple[Mapping[str, Floats], ...]:
        played, plan = played_on(pool, n, stream)
        return tuple(reduce(one, plan) for one in (played, *endings(played, plan)))

    first, *pools = (thinned_pools if fresh else resampled_pools)(table, resamples, seed)
    sizes = [min(_AT_ONCE, trials - begin) for begin in range(0, trials, _AT_ONCE)]
    blocks = (partial(some, first, _AT_ONCE * i, n) for i, n in enumerate(sizes))
    others = (partial(both, pool, trials + 2 * half * number) for number, pool in enumerate(pools))
    estimate: list[Mapping[str, Floats]] = []
    halves: list[tuple[Mapping[str, Floats], ...]] = []
    for number, found in enumerate(in_order(chain(blocks, others), cores(workers))):
        own = number < len(sizes)
        if own:
            estimate = [_added(*parts) for parts in zip(estimate, found, strict=True)] if estimate else list(found)
        else:
            halves.append(found)
        if progress is not None:
            progress(sizes[number] if own else 2 * half)
    whole, *ends = estimate
    samples = {name: _layered(whole[name], [[h[name] for h in pair] for pair in halves]) for name in whole}
    return ResampledTrials(samples, tuple(ends), trials, half)


def _added(one: Mapping[str, Floats], other: Mapping[str, Floats]) -> Mapping[str, Floats]:
    return {name: sums + other[name] for name, sums in one.items()}


def _part(records: Any, rows: slice) -> Any:
    """Some rows of `Trials` or of a `TrialPlan`."""
    return type(records)(*(column[rows] for column in records))


def _half(trials: int, resample_trials: int) -> int:
    return max(1, min(trials, resample_trials) // 2)


def _layered(estimate: Floats, halves: list[list[Floats]]) -> Floats:
    """Estimate, resamples and their halves along a last axis."""
    if not halves:
        return np.asarray(estimate)[..., np.newaxis]
    parts = np.stack([np.stack(pair, axis=-1) for pair in halves], axis=-2)  # (..., R, 2)
    return np.concatenate([estimate[..., np.newaxis], parts.mean(axis=-1), parts[..., 0], parts[..., 1]], axis=-1)


def trial_noise(trials: int, resample_trials: int = RESAMPLE_TRIALS) -> float:
    """Variance from the sampling of `trials` trials, relative to that on a resample, see `Spread`."""
    return 2 * _half(trials, resample_trials) / trials


def planned_trials(trials: int, resamples: int = RESAMPLES, resample_trials: int = RESAMPLE_TRIALS) -> int:
    """Number of trials that `play_resamples` plays."""
    return trials + resamples * 2 * _half(trials, resample_trials)


def _start(pool: TapPool, where: int | None) -> int | None:
    """Initial position, or `None` if a resample of sessions lacks it."""
    if where is None or not 0 <= where < pool.shape[0]:
        return where
    held = np.flatnonzero(pool.count.any(axis=(0, 2)))
    return int(held[np.abs(held - where).argmin()])
