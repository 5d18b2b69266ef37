"""Dependence of counted trials on the test taps: the same trials on resamples of these, and on fresh taps.

Counts of ten million trials on the same few taps have no Monte Carlo error worth naming, and still vary with the taps.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...inference.trials.records import Farthest, TapTable, TrialPlan, Trials, endings
from ...inference.trials.resampling import (
    CONFIDENCE,
    RESAMPLES,
    ResampledTrials,
    Spread,
    no_endings,
    planned_trials,
    play_resamples,
    resamples_in_words,
    spread,
    too_few_in,
    trial_noise,
    widened,
)
from ...inference.trials.selections import sessions_drawn, sessions_in_words
from ...inference.trials.tally import tally
from ...models.grid import ClassGrid
from ...models.settings import PlaySettings
from ..stats.metrics import SHARE, Range, ranges
from ..stats.tallied import tally_means

type Floats = NDArray[np.float64]

SPREAD = ("what_error", "where_error", "taps", "what_wrong", "belief", "stopped_fraction", "no_class_left_fraction")
"""What has intervals."""
FRESH_TRIALS = 20_000
SELECTED_TRIALS = 5000
"""On each resample: where decisions take a tap or two, the chance of fewer trials would hide that of the taps."""
_RANGES = dict.fromkeys(SPREAD[3:], SHARE)
_SELDOM = ("what_error", "where_error", "taps", "what_wrong", "stopped_fraction", "no_class_left_fraction")


class TapSpread(NamedTuple):
    """What resampled test taps give, at H thresholds.

    Attributes:
        stored: Means of trials that draw with replacement, on the taps as they are and on resamples, shape
            (H, 1 + 3 R), by name, see `resampling.play_resamples`.
        fresh: Likewise of trials that draw no tap twice.
        endings: What else their estimates might have been, shape (H,) each, see `inference.trials.records`.
        used_up: Share of the latter that ended because all taps of a class were drawn, shape (H,).
        spread: How resamples of trials with replacement turn into intervals.
        fresh_spread: Likewise without.
        few: Why intervals may be off, in a sentence; empty where they hold.
        sentence: What intervals hold.
        ranges: Between which values means lie, by name.
    """

    stored: dict[str, Floats]
    fresh: dict[str, Floats]
    endings: tuple[Mapping[str, Floats], ...]
    used_up: Floats
    spread: Spread
    fresh_spread: Spread
    few: str
    sentence: str
    ranges: dict[str, Range]

    def intervals(self, means: Mapping[str, Floats]) -> dict[str, tuple[Floats, Floats]]:
        """Ends of the 95% intervals of means of trials with replacement, each of shape (H,), by name."""
        return {
            name: self._interval(self.spread, name, np.column_stack([means[name], samples[:, 1:]]), means["taps"])
            for name, samples in self.stored.items()
        }

    def fresh_intervals(self) -> dict[str, tuple[Floats, Floats]]:
        """Those of the means of trials on fresh taps."""
        taps = self.fresh["taps"][:, 0]
        return {
            name: self._interval(self.fresh_spread, name, samples, taps, [one[name] for one in self.endings])
            for name, samples in self.fresh.items()
        }

    def _interval(
        self, how: Spread, name: str, samples: Floats, taps: Floats, ends: Sequence[Floats] = ()
    ) -> tuple[Floats, Floats]:
        least, most, step = self.ranges[name]
        low, high = how.interval(samples, least, most, ends)
        if name not in _SELDOM:
            return low, high
        return widened(low, high, samples[:, 0], how.center(samples), how.taps / taps, step, most, least=least)


def tap_spread(
    table: TapTable,
    grid: ClassGrid,
    thresholds: ArrayLike,
    trials: int,
    *,
    play: PlaySettings = PlaySettings(),
    progress: Callable[[int], None] | None = None,
    **rule: Any,
) -> TapSpread:
    """Plays trials on resampled test taps, on the processor.

    Args:
        table: Test taps.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        trials: Whose means are to have intervals; on each resample as many, `SELECTED_TRIALS` at most.
        play: How trials are played.
        progress: Called with the number of further trials played, of `spread_trials` in all.
        rule: As for `resampling.play_resamples`: `fixation`, `where`, `seed`, `workers`.

    Raises:
        InputError: An argument is out of range.
    """
    thresholds = np.atleast_1d(np.asarray(thresholds, dtype=np.float64))

    def reduce(played: Trials, plan: TrialPlan) -> dict[str, Floats]:
        means = tally_means(tally(played, plan, grid.shape), grid)
        return {name: len(played.what) * means[name] for name in SPREAD} | {
            "used_up": played.used_up.sum(axis=0, dtype=float)
        }

    ends = partial(endings, deadline=play.deadline, farthest=Farthest.on(grid))
    rule |= {"play": play, "progress": progress}

    def samples(fresh: bool, number: int) -> ResampledTrials:
        might_be = ends if fresh else no_endings
        return play_resamples(
            table,
            thresholds,
            reduce,
            trials=number,
            fresh=fresh,
            endings=might_be,
            resample_trials=SELECTED_TRIALS,
            **rule,
        ).per_trial()

    fresh_trials = min(trials, FRESH_TRIALS)
    stored, fresh = samples(False, min(trials, SELECTED_TRIALS)), samples(True, fresh_trials)
    used_up = fresh.samples["used_up"]
    fresh_spread = spread(table, noise=trial_noise(fresh_trials, SELECTED_TRIALS), thinned=True)
    return TapSpread(
        {name: stored.samples[name] for name in SPREAD},
        {name: fresh.samples[name] for name in SPREAD},
        fresh.endings,
        used_up[:, 0],
        spread(table, noise=trial_noise(trials, SELECTED_TRIALS)),
        fresh_spread,
        _few(table, thresholds, fresh_spread, used_up),
        _sentence(table),
        _RANGES | ranges(grid, play.deadline),
    )


def spread_trials(trials: int) -> int:
    """How many trials `tap_spread` plays."""
    own = (min(trials, most) for most in (SELECTED_TRIALS, FRESH_TRIALS))
    return sum(planned_trials(number, resample_trials=SELECTED_TRIALS) for number in own)


def _few(table: TapTable, thresholds: Floats, how: Spread, used_up: Floats) -> str:
    """The gravest sentence of `resampling.too_few`, and at which thresholds it does not hold."""
    few = [too_few_in(table.pool, how, samples) for samples in used_up]
    told = few[int((used_up[:, 0] + how.center(used_up)).argmax())]
    at = [f"{theta:g}" for theta, words in zip(thresholds, few, strict=True) if words]
    return told if len(at) in (0, len(few)) else f"{told} This applies to theta {', '.join(at)}."


def _sentence(table: TapTable) -> str:
    """What intervals hold, from what is drawn anew, and whether a trial mixes sessions."""
    drawn, trials = sessions_drawn(table), sessions_in_words(table)
    held = (
        f"the test taps {resamples_in_words(drawn)}; they cover other test sessions"
        if drawn > 1
        else f"{RESAMPLES} resamples of the test taps {resamples_in_words(1, thinned=False)} (for fresh taps, "
        f"{resamples_in_words(1)}); they cover other test data"
    )
    missing = "" if drawn > 1 else ", but not other sessions"
    return (
        f"Brackets are {CONFIDENCE:.0%} intervals from {held} of these classes{missing}, for the same model. {trials}"
    ).rstrip()
