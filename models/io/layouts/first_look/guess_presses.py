"""Guesses where taps are in the rows of a table: numbers, phases, counts and signals of presses."""

import re
from collections.abc import Iterator, Mapping, Set
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .guess import Guess, as_floats, counts, plain, repeats

_NUMBERING = r"\b(id|nr|no|number|num|nummer|index|idx|n)\b"
"""What columns that number taps are called."""
_PRESSED = r"contact|trig|switch|sync|press(?!ure)|touched|kontakt"
"""What a column is called that says when a finger presses."""
_LEVELS, _RARELY = 4, 0.9
"""Values are rarely within a quarter of the range around its middle, if there are two levels."""
_ROWS = 8
"""Rows of a tap, at least."""


def phases(columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """A column of phases of which one is called a press or contact."""
    for name, of in columns.items():
        if re.search(r"phase|state|status", plain(name), re.IGNORECASE) and of.dtype.kind == "U" and repeats(of):
            pressed = [each for each in np.unique(of).tolist() if re.search(_PRESSED, each, re.IGNORECASE)]
            if len(pressed) == 1:
                yield Guess("tap", name, "its name, and phases")
                yield Guess("keep", f"{name}={pressed[0]}", "the phase of a press, by its name")
                return


def restarting(columns: Mapping[str, NDArray[Any]], names: Set[str]) -> Guess | None:
    """A column that counts the samples of each tap anew."""
    for name in [name for name in columns if name in names]:
        floats = as_floats(columns[name])
        steps = np.zeros(0) if floats is None else np.diff(floats)
        if floats is not None and (steps < 0).sum() > 1 and set(steps[steps >= 0]) == {1.0}:
            begins = set(floats[1:][steps < 0])
            if begins == {floats[0]} and floats[0] in (0, 1) and len(floats) > _ROWS * (steps < 0).sum():
                return Guess("tap", f"restart:{name}", f"it counts anew {(steps < 0).sum()} times")
    return None


def signal(columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """A column of two levels that changes at each press, and if it is one of contact the samples of the shortest."""
    for name in [name for name in columns if re.search(_PRESSED, plain(name), re.IGNORECASE)]:
        floats = np.zeros(0) if (found := as_floats(columns[name])) is None else found
        low, high = (floats.min(), floats.max()) if len(floats) else (0.0, 0.0)
        middle, away = (low + high) / 2, np.abs(floats - (low + high) / 2)
        falls = bool(np.mean(floats > middle) > 1 / 2) and not _tells_contact(name)
        down = floats < middle if falls else floats > middle
        starts, ends = (np.flatnonzero(np.diff(down.astype(int)) == step) + 1 for step in (1, -1))
        if high > low and (away > (high - low) / _LEVELS).mean() > _RARELY and min(len(starts), len(ends)) > 1:
            yield Guess("trigger", "signal", f"{name} {'falls' if falls else 'rises'} {len(starts)} times")
            yield Guess("signal", f"{name}<{middle:g}" if falls else name, "its name, and two levels")
            if _tells_contact(name):
                lengths = ends[ends > starts[0]] - starts[: np.count_nonzero(ends > starts[0])]
                yield Guess("window", int(lengths.min()), "samples of the shortest press; check")
            return


def _tells_contact(name: str) -> bool:
    """Whether a column is called so that it tells a contact throughout, rather than its begin."""
    return re.search(r"contact|press(?!ure)|touched|kontakt", plain(name), re.IGNORECASE) is not None


def between_taps(tap: Guess | None, columns: Mapping[str, NDArray[Any]]) -> Iterator[Guess]:
    """What leaves out rows between taps, which have a number below 0 or none."""
    if (
        tap is None
        or (floats := as_floats(columns[tap.value])) is None
        or (floats >= 0).all()
        or not (floats >= 0).any()
    ):
        return
    yield Guess(
        "keep",
        f"{tap.value}>=0",
        f"rows between taps have {'no number' if np.isnan(floats).any() else 'negative ones'}",
    )


def counted_taps(
    columns: Mapping[str, NDArray[Any]], numeric: Set[str], guesses: Mapping[str, Guess]
) -> Iterator[Guess]:
    """The column that numbers taps one after the other, by what numbers are called."""
    used = {guess.value for guess in guesses.values() if isinstance(guess.value, str)}
    for name in [name for name in columns if name in numeric - used and re.search(_NUMBERING, plain(name), re.I)]:
        if (floats := as_floats(columns[name])) is not None and counts(floats):
            yield Guess("tap", name, "it counts, and stays the same for many rows; check whether these are taps")
            return
