"""Training taps, test taps and class grid of an experiment on recorded taps."""

from collections.abc import Sequence

import numpy as np

from .errors import InputError
from .grid import ClassGrid
from .io.load import TapSource, names_of, taps_of
from .settings import Division
from .splits import Split, split, two_files, untrained


def load_experiment(data: Sequence[TapSource], division: Division | None = None) -> tuple[Split, ClassGrid]:
    """Split and class grid of an experiment on recorded taps.

    Args:
        data: One tap set to split, or two, TRAIN and TEST; each a tap set or its file.
        division: Grouping and division of the taps.

    Returns:
        The split, and the grid of the (first) tap set, including classes without a training tap.

    Raises:
        InputError: No tap set or more than two, an option that is for one only, or as `load_taps`,
            `TapSet.grid`, `split`, `two_files` and `untrained`.
    """
    if not 1 <= len(data) <= 2:
        raise InputError(f"Give one data file, or two (TRAIN and TEST), got {len(data)}.")
    division = division or Division()
    first = taps_of(data[0])
    grid = first.grid(division.where_cell, division.what_cell)
    if len(data) == 1:
        sessions = parse_sessions(division.train, "--train"), parse_sessions(division.test, "--test")
        parts = split(first, grid, division.split, *sessions)
    else:
        division.refuse_split("with two files the first trains and the second tests")
        parts = two_files(first, taps_of(data[1]), names_of(data))
    for fold in parts.folds:
        for verb, side in (("train with", fold.train), ("test", fold.test)):
            if not np.any(np.minimum(*side.indices(grid)) >= 0):
                names = names_of(data)
                raise InputError(f"No tap left to {verb}: none of {names[-1]} belongs to a class of {names[0]}.")
    return untrained(parts, division.training_taps), grid


def parse_sessions(text: str | None, option: str) -> list[int] | None:
    """Session numbers separated by commas.

    Raises:
        InputError: The text has another form.
    """
    if text is None:
        return None
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"{option} must be session numbers such as 0,1, got {text!r}.") from None
