"""When an episode ends, from what the command line says."""

from typing import NamedTuple

from ...inference.information import TapOutcomes
from ...inference.stopping.rules import gain_of, make_rule, parse_patience, parse_stopping
from ...inference.stopping.stopping import StopRule, Watch
from ...models.errors import InputError
from ...models.io.recording import naming
from ...models.measurement.model import TapModel
from ...models.settings import PlaySettings


class Ends(NamedTuple):
    """When to end.

    Attributes:
        rule: The stopping rule.
        theta: The belief in an object that it asks for, 1 where it asks for none, for pictures.
        watch: Says what the next tap is expected to save, for a rule that looks ahead.
        name: Of a rule that is not the paper's threshold, empty for that.
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
    """The rule of `--stop` and `--give-up`.

    Args:
        name: Of the rule, see `stopping.rules.FORMS`; `None` for `--theta`.
        play: Threshold, deadline and reading of Eq. 9.
        patience: `--give-up`.
        model: The fitted model.
        fixation: The where class that moves aim for, if they do.
        outcomes: Training taps, for a rule that looks ahead.

    Raises:
        InputError: There is no such rule, what it needs is not there, or it would give up after the deadline.
    """
    with naming("--give-up"):
        limit = None if patience is None else parse_patience(patience)
    with naming("--stop"):
        stopping = parse_stopping(name or f"what:{play.threshold!r}")
        rule = make_rule(stopping, model, fixation, limit)
    if limit is not None and limit[0] > play.deadline:
        raise InputError(f"--give-up {patience} comes after the deadline of {play.deadline} taps.")
    watch = None
    if stopping.needs_outcomes:
        if outcomes is None:
            raise InputError(f"--stop {name} needs --training with the taps that trained the model.")
        watch = gain_of(outcomes, model.grid, play.border)
    return Ends(rule, stopping.threshold, watch, name or "")
