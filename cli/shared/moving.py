"""How an episode moves, from what the command line says."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...inference.information import TapOutcomes
from ...inference.moves.control import MovePolicy, check_fixation
from ...inference.moves.information import training_outcomes
from ...inference.moves.strategies import make_policy, parse_strategy
from ...inference.moves.table import load_table
from ...inference.stopping.rules import parse_stopping
from ...inference.trials.plan import trial_chances
from ...models.digest import tap_digests
from ...models.errors import InputError
from ...models.io.load import load_taps
from ...models.io.recording import naming
from ...models.measurement.model import TapModel
from ...models.settings import PlaySettings
from ...models.taps import concatenate


class Moves(NamedTuple):
    """How to move.

    Attributes:
        policy: The strategy.
        fixation: Where class that it aims for; `None` where it aims for none.
    """

    policy: MovePolicy
    fixation: int | None


def load_outcomes(model: TapModel, training: Sequence[Path] | None, move: str, stop: str | None) -> TapOutcomes | None:
    """The taps of `--training` for strategies and rules that look ahead; `None` without them.

    Args:
        model: The fitted model.
        training: `--training`.
        move: Name of the strategy.
        stop: Name of the stopping rule, if it has one.

    Raises:
        InputError: There is no such strategy or rule, none of them looks ahead, or a file cannot be used.
    """
    with naming("--move"):
        ahead = parse_strategy(move).needs_outcomes
    with naming("--stop"):
        ahead = ahead or (stop is not None and parse_stopping(stop).needs_outcomes)
    if not training:
        return None
    if not ahead:
        raise InputError("--training goes with a --move that looks ahead, info-what and its like, or --stop lookahead.")
    with naming(f"--training {', '.join(map(str, training))}"):
        taps = concatenate([load_taps(file) for file in training])
        outcomes = training_outcomes(model, taps)
    known = int(np.isin(model.training, tap_digests(taps.taps)).sum())
    if known < len(model.training):
        print(
            f"Note: --training holds {known} of the {len(model.training)} taps that trained the model.", file=sys.stderr
        )
    return outcomes


def choose_moves(
    name: str,
    model: TapModel,
    play: PlaySettings,
    outcomes: TapOutcomes | None,
    targets: Path | None,
) -> Moves:
    """The strategy of `--move`, with what it learns from.

    Args:
        name: Of the strategy, see `strategies.FORMS`.
        model: The fitted model.
        play: Reading of Eq. 9 and fixation point; that of passive episodes is not looked at.
        outcomes: Training taps, for a strategy that looks ahead.
        targets: `--targets`.

    Raises:
        InputError: There is no such strategy, an option that it needs is not there or one that it does not, or a file
            cannot be used.
    """
    with naming("--move"):
        strategy = parse_strategy(name)
    if strategy.needs_outcomes and outcomes is None:
        raise InputError(f"--move {name} needs --training with the taps that trained the model.")
    if strategy.kind == "table" and targets is None:
        raise InputError("--move table needs --targets with a learned table.")
    if targets is not None and strategy.kind != "table":
        raise InputError("--targets goes with --move table only.")
    if play.fixation is not None and not (strategy.aims or play.passive):
        raise InputError(f"--fixation does not go with --move {name}, which aims for no fixation point.")
    point = check_fixation(play.fixation, model.grid.L) if strategy.aims else None
    table = None
    if targets is not None:
        with naming(f"--targets {targets}"):
            table = load_table(targets).checked(model.grid)
    policy = make_policy(name, model.grid, border=play.border, fixation_index=point, outcomes=outcomes, table=table)
    return Moves(policy, point)


def chances(seed: int, episode: int, deadline: int) -> Iterator[float]:
    """The random numbers that the strategy of an episode gets: the same for the same seed and number of the episode."""
    return iter(trial_chances(seed, episode, deadline).tolist())
