"""A conformance case: a model, taps and moves as plain numbers, and the lines that a program reads.

The format is documented in docs/reference/conformance/README.md. Numbers are doubles, indices count from 0.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.reference import Border, Power

FORMAT = 1
LEVELS = {
    "core": "each of the equations 1 to 10 by itself, with border uniform",
    "episodes": "whole episodes: all equations together, tap after tap, with border uniform",
    "borders": "the other readings of Eq. 9, and untrained classes",
    "limits": "the limits of floating point: up to 10 000 taps, beliefs below 1e-308, moves with any border",
    "continuous": "normal distributions in place of histograms",
    "strategies": "the next move by expected information about object, position or both",
}
"""Names and what they are about, from simple to demanding; a case belongs to one of them."""
BASIC = ("core", "episodes", "borders", "limits")
"""Levels that a check asks of a program by default; their headers have the keys of the first kit alone."""


class Training(NamedTuple):
    """Taps from which a program finds edges and counts itself.

    Attributes:
        taps: Shape (N, J, K).
        where: Where class of each, shape (N,).
        what: What class of each, shape (N,).
    """

    taps: NDArray[np.float64]
    where: NDArray[np.intp]
    what: NDArray[np.intp]


class Pinned(NamedTuple):
    """Right answers as a file has them, in place of those that would be computed.

    Attributes:
        answers: Of the taps that have one, each an `answers.Answer`.
        tolerances: Absolute and relative, by quantity.
        left_out: Why the file is not there, as the precision of its kit cannot do it; empty where it is.
    """

    answers: tuple[Any, ...]
    tolerances: Mapping[str, tuple[float, float]]
    left_out: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Case:
    """What an implementation is given.

    Exactly one of `counts`, `probabilities`, `training` and `mean` is there; `edges` go with all but `training`.

    Attributes:
        name: Of the case.
        about: What it tests, in a sentence.
        equations: Of the paper, that it is mainly about.
        prior: Belief before the first tap, shape (L, M).
        taps: Samples, shape (T, J, K).
        moves: Where classes moved before each tap, the first 0, shape (T,).
        bins: B.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        counts: Histograms, shape (L, M, K, B).
        probabilities: Tables to be used as they are, likewise.
        training: Taps to fit.
        pseudocount: Added to every bin.
        power: Root of Eq. 1.
        border: Reading of Eq. 9.
        thresholds: theta_W, H of them.
        theta_x: Threshold for a move.
        fixation: Where class to move to.
        where_value: Of the where classes, default their numbers.
        answered: Taps with an expected answer, counted from 1; none for all.
        strict_ties: Whether equal beliefs are equal in any arithmetic, so that the lowest index is the one answer.
        level: What a program that passes it can claim, one of `LEVELS`.
        mean: Of normal distributions, shape (L, M, K), with `sd`.
        sd: Their standard deviations, likewise.
        strategy: Of the own move, one of `information.STRATEGIES`; empty for Eq. 8 and 10.
        pool: Taps that may come next, for a strategy, shape (N, J, K).
        pinned: Answers of a file.
    """

    name: str
    about: str
    equations: tuple[int, ...]
    prior: NDArray[np.float64]
    taps: NDArray[np.float64]
    moves: NDArray[np.intp]
    bins: int
    edges: NDArray[np.float64] | None = None
    counts: NDArray[np.int64] | None = None
    probabilities: NDArray[np.float64] | None = None
    training: Training | None = None
    pseudocount: float = 0.01
    power: Power = "J"
    border: Border = "uniform"
    thresholds: tuple[float, ...] = (0.5, 0.95)
    theta_x: float = 0.0
    fixation: int = 0
    where_value: tuple[float, ...] = ()
    answered: tuple[int, ...] = ()
    strict_ties: bool = False
    level: str = "core"
    mean: NDArray[np.float64] | None = None
    sd: NDArray[np.float64] | None = None
    strategy: str = ""
    pool: NDArray[np.float64] | None = None
    pinned: Pinned | None = None

    def __repr__(self) -> str:
        return f"<Case {self.name}: {len(self.taps)} tap{'s' * (len(self.taps) != 1)}. {self.about}>"

    @property
    def absent(self) -> bool:
        """Whether a folder has its name alone, as the precision of its kit cannot do it."""
        return self.pinned is not None and bool(self.pinned.left_out)

    @property
    def sizes(self) -> dict[str, int]:
        """L, M, K, J and B."""
        L, M = self.prior.shape
        _, J, K = self.taps.shape
        return {"L": L, "M": M, "K": K, "J": J, "B": self.bins}

    @property
    def places(self) -> tuple[float, ...]:
        """Value of each where class."""
        return self.where_value or tuple(float(l) for l in range(len(self.prior)))

    @property
    def objects(self) -> tuple[str, ...]:
        """Name of each what class."""
        return tuple(f"object {m}" for m in range(self.prior.shape[1]))

    def header(self) -> dict[str, Any]:
        """The first line that a program reads."""
        tables: dict[str, Any] = {}
        if self.edges is not None:
            tables["edges"] = self.edges.tolist()
        if self.counts is not None:
            tables |= {"counts": self.counts.tolist(), "pseudocount": self.pseudocount}
        if self.probabilities is not None:
            tables["probabilities"] = self.probabilities.tolist()
        if self.mean is not None and self.sd is not None:
            tables |= {"mean": self.mean.tolist(), "sd": self.sd.tolist()}
        if self.training is not None:
            training = {name: part.tolist() for name, part in self.training._asdict().items()}
            tables |= {"training": training, "pseudocount": self.pseudocount}
        strategy = {} if self.pool is None else {"strategy": self.strategy, "pool": self.pool.tolist()}
        return {
            "format": FORMAT,
            "case": self.name,
            **self.sizes,
            "where_value": list(self.places),
            "where_unit": "mm",
            "what_name": list(self.objects),
            **tables,
            "prior": self.prior.tolist(),
            "power": self.power,
            "border": self.border,
            "thresholds": list(self.thresholds),
            "theta_x": self.theta_x,
            "fixation": self.fixation,
            **strategy,
        }

    def tap_lines(self) -> Iterator[dict[str, Any]]:
        """The lines behind the first."""
        for t, (tap, move) in enumerate(zip(self.taps, self.moves, strict=True)):
            yield {"tap": t + 1, "move": int(move), "samples": tap.tolist()}

    def lines(self) -> Iterator[str]:
        """All that a program reads, line by line."""
        for line in (self.header(), *self.tap_lines()):
            yield to_line(line)

    def expects(self, tap: int) -> bool:
        """Whether the answer to a tap is compared; tap 0 is the fit."""
        return not self.answered or tap in self.answered or tap == 0


def to_line(fields: dict[str, Any]) -> str:
    """One object as a line; Python writes a double with the fewest digits, at most 17, that give it back."""
    return json.dumps(fields, allow_nan=False, separators=(",", ":"), ensure_ascii=False)
