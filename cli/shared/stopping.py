"""Stopping rule of an episode, from command-line options."""

from typing import NamedTuple

from ...inference.information import TapOutcomes
from ...inference.stopping.rules import gain_of, make_rule, parse_patience, parse_stopping
from ...inference.stopping.stopping import StopRule, Watch
from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.measurement.model import TapModel
from ...models.settings import PlaySettings


class Ends(NamedTuple):
    """When to stop.

    Attributes:
        rule: The stopping rule.
        theta: Belief in an object that it requires, for pictures; 1 if none.
        watch: Expected gain of the next tap, for a rule that looks ahead.
        name: Name of the rule; empty for the paper's threshold.
    """

    rule: StopRule
    theta: float
    watch: Watch | None
    name: str


def choose_ends(
    name: str | None,
    play: PlaySettings,
    patience: str | None,
    model: TapModel,
    fixation: int | None,
    outcomes: TapOutcomes | None,
) -> Ends:
    """Stopping rule of `--stop` and `--give-up`.

    Args:
        name: Name of the rule, see `names.STOPS`; `None` for `--theta`.
        play: Threshold, deadline and border.
        patience: Value of `--give-up`.
        model: The fitted model.
        fixation: Fixation point as a position index, if any.
        outcomes: Training taps, for a rule that looks ahead.

    Raises:
        InputError: The rule is unknown, an option that it requires is missing, or it gives up after the deadline.
    """
    with naming("--give-up"):
        limit = None if patience is None else parse_patience(patience)
    with naming("--stop"):
        stopping = parse_stopping(name or f"what:{play.threshold!r}")
        rule = make_rule(stopping, model, fixation, limit)
    if limit is not None and limit[0] > play.deadline:
        raise InputError(f"--give-up {patience} exceeds the deadline of {play.deadline} taps.")
    watch = None
    if stopping.needs_outcomes:
        if outcomes is None:
            raise InputError(f"--stop {name} requires --training with the taps that trained the model.")
        watch = gain_of(outcomes, model.grid, play.border)
    return Ends(rule, stopping.threshold, watch, name or "")
