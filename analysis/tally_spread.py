"""How much counted trials depend on the test taps: the same trials on resamples of these, and trials on fresh taps.

Counts of ten million trials on the same few taps have no Monte Carlo error worth naming, and still vary with the taps.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..inference.montecarlo import Trials
from ..inference.resampling import (
    CONFIDENCE,
    RESAMPLE_TRIALS,
    RESAMPLES,
    Spread,
    planned_trials,
    play_resamples,
    spread,
    widened,
)
from ..inference.tally import tally
from ..inference.trial_plan import TapTable, TrialPlan
from ..models.classes import ClassGrid
from .tallied import tally_means

type Floats = NDArray[np.float64]

SPREAD = ("what_error", "where_error", "taps", "what_wrong", "belief", "stopped_fraction", "no_class_left_fraction")
"""What has intervals."""
FRESH_TRIALS = 20_000
_LEAST = {"taps": 1.0}
_SHARES = SPREAD[3:]


class TapSpread(NamedTuple):
    """What resampled test taps give, at H thresholds.

    Attributes:
        stored: Means of trials that draw with replacement, on each of R resamples, shape (H, R), by name.
        fresh: Means of trials that draw no tap twice, on the taps as they are and on each resample, shape (H, 1 + R).
        used_up: Share of the latter that ended because all taps of a class were drawn, shape (H,).
        spread: How resamples turn into intervals.
        few: Why intervals may be off, in a sentence; empty where they hold.
        sentence: What intervals hold.
        most: What the object error cannot exceed.
        smallest: The smallest errors, by name.
    """

    stored: dict[str, Floats]
    fresh: dict[str, Floats]
    used_up: Floats
    spread: Spread
    few: str
    sentence: str
    most: float
    smallest: dict[str, float]

    def intervals(self, means: Mapping[str, Floats]) -> dict[str, tuple[Floats, Floats]]:
        """Ends of the 95 % intervals of means of trials with replacement, each of shape (H,), by name."""
        return {
            name: self._interval(name, np.column_stack([means[name], resamples]), means["taps"])
            for name, resamples in self.stored.items()
        }

    def fresh_intervals(self) -> dict[str, tuple[Floats, Floats]]:
        """Those of the means of trials on fresh taps."""
        return {name: self._interval(name, samples, self.fresh["taps"][:, 0]) for name, samples in self.fresh.items()}

    def _interval(self, name: str, samples: Floats, taps: Floats) -> tuple[Floats, Floats]:
        most = self.most if name == "what_error" else 1.0 if name in _SHARES else np.inf
        low, high = self.spread.interval(samples, _LEAST.get(name, 0.0), most)
        if name not in self.smallest:
            return low, high
        return widened(low, high, self.spread.taps / taps, self.smallest[name], most)


def tap_spread(
    table: TapTable,
    grid: ClassGrid,
    thresholds: ArrayLike,
    trials: int,
    *,
    progress: Callable[[int], None] | None = None,
    **rule: Any,
) -> TapSpread:
    """Plays trials on resampled test taps, on the processor.

    Args:
        table: Test taps.
        grid: The classes.
        thresholds: theta_W, shape (H,).
        trials: Whose means are to have intervals; on each resample as many, `RESAMPLE_TRIALS` at most.
        progress: Told how many more trials were played; `spread_trials` says of how many.
        rule: As for `resampling.play_resamples`: `theta_x`, `fixation`, `where`, `border`, `deadline`, `seed`,
            `workers`.

    Raises:
        InputError: An argument is out of range.
    """
    thresholds = np.atleast_1d(np.asarray(thresholds, dtype=np.float64))

    def reduce(played: Trials, plan: TrialPlan) -> dict[str, Floats]:
        means = tally_means(tally(played, plan, grid.shape), grid)
        return {name: means[name] for name in SPREAD} | {"used_up": played.used_up.mean(axis=0)}

    def samples(fresh: bool, number: int) -> dict[str, Floats]:
        found = play_resamples(*(table, thresholds, reduce), trials=number, fresh=fresh, progress=progress, **rule)
        return {name: np.stack([one[name] for one in found], axis=-1) for name in found[0]}

    stored, fresh = samples(False, min(trials, RESAMPLE_TRIALS)), samples(True, min(trials, FRESH_TRIALS))
    used_up = fresh["used_up"][:, 0]
    return TapSpread(
        {name: stored[name][:, 1:] for name in SPREAD},
        {name: fresh[name] for name in SPREAD},
        used_up,
        spread(table),
        _few(table, thresholds, used_up),
        _sentence(table),
        1.0 if grid.what_error_unit == "P(wrong)" else np.inf,
        {
            "what_error": grid.smallest_what_error,
            "where_error": grid.smallest_where_error,
            **dict.fromkeys(("what_wrong", "stopped_fraction", "no_class_left_fraction"), 1.0),
        },
    )


def spread_trials(trials: int) -> int:
    """How many trials `tap_spread` plays."""
    return sum(planned_trials(min(trials, own)) for own in (RESAMPLE_TRIALS, FRESH_TRIALS))


def _few(table: TapTable, thresholds: Floats, used_up: Floats) -> str:
    """The gravest sentence of `resampling.spread`, and at which thresholds it does not hold."""
    few = [spread(table, float(share)).few for share in used_up]
    told = few[int(used_up.argmax())]
    at = [f"{theta:g}" for theta, words in zip(thresholds, few, strict=True) if words]
    return told if len(at) in (0, len(few)) else f"{told} This concerns theta {', '.join(at)}."


def _sentence(table: TapTable) -> str:
    """What intervals hold, from what is drawn anew, and whether a trial mixes sessions."""
    taps = table.pool.order
    sessions = 1 if table.session is None else len(np.unique(np.asarray(table.session)[taps]))
    drawn = f"{sessions} sessions, then taps of each class and session," if sessions > 1 else "taps of each class"
    missing = "" if sessions > 1 else ", but not how another session would differ"
    mixed = (
        f" Each trial draws taps of all {sessions} test sessions, so what lasts within a session averages out: errors "
        "within one session, as with --test N, may be larger."
    )
    return (
        f"Brackets are {CONFIDENCE:.0%} intervals from {RESAMPLES} resamples of the test data ({drawn} drawn with "
        f"replacement): they hold how other test data of these classes would differ{missing}; the model stays."
        f"{mixed if sessions > 1 else ''}"
    )
