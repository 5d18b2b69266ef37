"""Control strategy of an episode, from command-line options."""

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
from ...inference.trials.records import trial_chances
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
        fixation: Fixation point as a position index; `None` for strategies without one.
    """

    policy: MovePolicy
    fixation: int | None


def load_outcomes(model: TapModel, training: Sequence[Path] | None, move: str, stop: str | None) -> TapOutcomes | None:
    """Taps of `--training`, for strategies and rules that look ahead; `None` without `--training`.

    Args:
        model: The fitted model.
        training: Files of `--training`.
        move: Name of the strategy.
        stop: Name of the stopping rule, if any.

    Raises:
        InputError: The strategy or rule is unknown, neither looks ahead, or a file cannot be used.
    """
    with naming("--move"):
        ahead = parse_strategy(move).needs_outcomes
    with naming("--stop"):
        ahead = ahead or (stop is not None and parse_stopping(stop).needs_outcomes)
    if not training:
        return None
    if not ahead:
        raise InputError("--training requires a --move that looks ahead, such as info-what, or --stop lookahead.")
    with naming(f"--training {', '.join(map(str, training))}"):
        taps = concatenate([load_taps(file) for file in training])
        outcomes = training_outcomes(model, taps)
    known = int(np.isin(model.training, taps.digests).sum())
    if known < len(model.training):
        print(
            f"Note: --training contains {known} of the {len(model.training)} taps that trained the model.",
            file=sys.stderr,
        )
    return outcomes


def choose_moves(
    name: str,
    model: TapModel,
    play: PlaySettings,
    outcomes: TapOutcomes | None,
    targets: Path | None,
) -> Moves:
    """Strategy of `--move`.

    Args:
        name: Name of the strategy, see `names.MOVES`.
        model: The fitted model.
        play: Border and fixation point; the latter is ignored for passive episodes.
        outcomes: Training taps, for a strategy that looks ahead.
        targets: File of `--targets`.

    Raises:
        InputError: The strategy is unknown, an option is missing or not supported by it, or a file cannot be used.
    """
    with naming("--move"):
        strategy = parse_strategy(name)
    if strategy.needs_outcomes and outcomes is None:
        raise InputError(f"--move {name} requires --training with the taps that trained the model.")
    if strategy.kind == "table" and targets is None:
        raise InputError("--move table requires --targets with a learned table.")
    if targets is not None and strategy.kind != "table":
        raise InputError("--targets requires --move table.")
    if play.fixation is not None and not (strategy.aims or play.passive):
        raise InputError(f"--fixation cannot be combined with --move {name}, which uses no fixation point.")
    point = check_fixation(play.fixation, model.grid.L) if strategy.aims else None
    table = None
    if targets is not None:
        table = load_table(targets)
        with naming(f"--targets {targets}"):
            table = table.checked(model.grid)
    policy = make_policy(name, model.grid, border=play.border, fixation_index=point, outcomes=outcomes, table=table)
    return Moves(policy, point)


def chances(seed: int, episode: int, deadline: int) -> Iterator[float]:
    """Random numbers for the strategy of an episode, determined by seed and episode number."""
    return iter(trial_chances(seed, episode, deadline).tolist())
