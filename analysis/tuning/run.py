"""Choice of fixation point and threshold from training taps, with a summary in sentences.

The fixation point comes first, at the threshold that a setting has; then the threshold, for trials that aim for the
chosen point. What is wanted of the threshold is either the least cost or a P(wrong) that is kept in a new session, see
`stats.target_error`. All estimates are of models that have not seen the taps; those at the chosen values are the least
of many and so a little too good.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...inference.trials.resampling import USED_UP
from ...inference.tuning.fixation import FixationChoice, choose_fixation
from ...inference.tuning.held_out import Estimate, Parts
from ...inference.tuning.threshold import ThresholdChoice, check_cost, choose_threshold
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.setting_file import Setting
from ..page.numbers import spanned
from ..stats.target_error import FEWEST, choose, prediction_interval, threshold_grid


class Price(NamedTuple):
    """What is wanted.

    Attributes:
        cost_error: Taps that a unit of error is worth.
        wrong: Whether errors are P(wrong) even where objects have sizes.
        target: A P(wrong) that is wanted instead of the least cost, or `None`.
    """

    cost_error: float = 50.0
    wrong: bool = False
    target: float | None = None


class Tuning(NamedTuple):
    """What was found.

    Attributes:
        grid: The classes.
        fixation: The curve over positions.
        threshold: The curve over thresholds at the chosen position.
        chosen: Index of the threshold that is taken.
        reachable: Whether a wanted P(wrong) is kept in a new session; `None` where none is wanted.
        setting: With both.
        price: What was wanted.
    """

    grid: ClassGrid
    fixation: FixationChoice
    threshold: ThresholdChoice
    chosen: int
    reachable: bool | None
    setting: Setting
    price: Price

    @property
    def sentences(self) -> list[str]:
        """What was chosen, with intervals."""
        used_up = float(self.threshold.used_up[self.chosen])
        few = (
            f"Too few taps: at this threshold {used_up:.0%} of the decisions were forced because all taps of a class "
            "were used up; intervals cover any outcome of further taps."
        )
        return [_about_fixation(self), _about_threshold(self), *[few] * (used_up > USED_UP)]


def check_price(price: Price, sessions: int) -> None:
    """Refuses what cannot be wanted.

    Raises:
        InputError: The price is negative, or a wanted error is none or cannot be promised with so few sessions.
    """
    check_cost(price.cost_error)
    if price.target is None:
        return
    if not 0 < price.target < 1:
        raise InputError(f"The target error must lie between 0 and 1, got {price.target}.")
    if sessions < FEWEST:
        raise InputError(
            f"A threshold for a target error requires at least {FEWEST} training sessions, got {sessions}."
        )


def tune_parts(
    parts: Parts,
    setting: Setting,
    price: Price,
    *,
    thresholds: tuple[float, ...] | None = None,
    passive: bool = False,
    trials: int = 1000,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> Tuning:
    """Both choices.

    Args:
        parts: Training taps and models that have not seen them.
        setting: All else; its threshold is that of the trials from which the fixation point is chosen.
        price: What is wanted.
        thresholds: Those to choose from; `None` for `target_error.threshold_grid`.
        passive: Whether positions are judged by trials that stand there.
        trials: In each part, at each position and for the threshold.
        seed: Of the trials.
        progress: Called with the number of further trials ended, of `tuning_trials` in all.

    Raises:
        InputError: There is one object only, or a setting is out of range.
    """
    check_objects(parts.grid)
    check_price(price, len(parts.parts) if parts.by_session else 1)
    common = {
        "wrong": price.wrong,
        "trials": trials,
        "seed": seed,
        "progress": progress,
    }
    fixation = choose_fixation(parts, setting.play.changed(passive=passive), **common)
    theta = threshold_grid(parts.grid.M) if thresholds is None else np.array(thresholds)
    aimed = setting.play.changed(fixation=fixation.chosen, passive=False)
    threshold = choose_threshold(parts, theta, price.cost_error, play=aimed, **common)
    chosen, reachable, missed = threshold.chosen, None, ""
    if price.target is not None:
        chosen, reachable = choose(threshold.wrong, price.target)
        missed = "" if reachable else f" A P(wrong) of {price.target:g} is not reached in a new session."
    tuned = setting.changed(
        fixation=fixation.chosen,
        threshold=float(threshold.theta[chosen]),
        passive=False,
        note=f"Fixation point and threshold tuned on training taps. {parts.sentence}{missed}",
    )
    return Tuning(parts.grid, fixation, threshold, chosen, reachable, tuned, price)


def tuning_trials(parts: Parts, trials: int) -> int:
    """At most how many trials `tune_parts` plays."""
    return parts.played * (parts.grid.L + 1) * trials


def check_objects(grid: ClassGrid) -> None:
    """Refuses data that leave nothing to decide.

    Raises:
        InputError: There is one object only.
    """
    if grid.M < 2:
        raise InputError("There is only one object, so fixation point and threshold have no effect on decisions.")


def _about_fixation(found: Tuning) -> str:
    choice, grid = found.fixation, found.grid
    if grid.L == 1:
        return "There is only one position, so there is no fixation point to choose."
    unit = unit_of(found)
    alike = int(choice.alike.sum())
    told = (
        f"Fixation point {grid.where_label(choice.chosen)} (class {choice.chosen}): error "
        f"{_interval(choice.error, choice.chosen)} {unit}"
    )
    if choice.chosen == choice.best:
        others = {1: "no other is", 2: "one other is"}.get(alike, f"{alike - 1} others are")
        return f"{told}, the lowest of all; {others} within one standard error of it."
    near = (
        f"at {grid.where_label(choice.best)}; of the {alike} positions within one standard error of the lowest it is "
    )
    worse = choice.excess.mean[choice.chosen] > 0
    more = f"{_interval(choice.excess, choice.chosen)} more than the lowest error, " if worse else "as low as "
    return f"{told}, {more}{near}the nearest to the middle."


def _about_threshold(found: Tuning) -> str:
    choice, h = found.threshold, found.chosen
    told = (
        f"Threshold {shown_threshold(choice.theta[h])}: error {_interval(choice.error, h)} {unit_of(found)} after "
        f"{_interval(choice.taps, h)} taps"
    )
    if found.reachable is None:
        return (
            f"{told}, cost {_interval(choice.cost, h)} taps at {found.price.cost_error:g} taps for an error of 1"
            f"{_alike(choice)}."
        )
    low, high = (ends[h] for ends in prediction_interval(choice.wrong))
    verdict = "is reached" if found.reachable else "is not reached; this threshold has the lowest"
    return (
        f"{told}; P(wrong) of a new session {spanned(choice.wrong[:, h].mean(), low, high)}, with 90% prediction "
        f"interval, so the target P(wrong) of {found.price.target:g} {verdict}."
    )


def _alike(choice: ThresholdChoice) -> str:
    """Which thresholds the data cannot tell from the chosen one, to follow its cost."""
    h, number, tried = choice.chosen, int(choice.alike.sum()), len(choice.theta)
    if number == 1:
        return "; all other thresholds cost significantly more" * (tried > 1)
    apart = np.flatnonzero(~choice.alike)
    first, last = int(apart[apart < h].max(initial=-1)) + 1, int(apart[apart > h].min(initial=tried)) - 1
    around = f"thresholds between {shown_threshold(choice.theta[first])} and {shown_threshold(choice.theta[last])}"
    if last - first + 1 == number:
        return f"; {around} do not differ significantly in cost"
    among = f", among them all {around}" * (last > first)
    return f"; {number} of the {tried} thresholds do not differ significantly in cost{among}"


def shown_threshold(theta: float) -> str:
    """A threshold in so many digits, at least four, that its distance from 1 is known to a twentieth."""
    return next(
        text for digits in range(4, 18) if abs(float(text := f"{theta:.{digits}g}") - theta) <= (1 - theta) / 20
    )


def unit_of(found: Tuning) -> str:
    """Of errors."""
    return "P(wrong)" if found.price.wrong else found.grid.what_error_unit


def _interval(estimate: Estimate, index: int) -> str:
    return spanned(estimate.mean[index], estimate.low[index], estimate.high[index])
