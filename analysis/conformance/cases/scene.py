"""Small random models and taps for cases; every number depends on the name of the case alone.

A sample is a bell over where and what plus noise, so that classes differ and neighbours resemble each other.
"""

import math
from dataclasses import dataclass
from functools import cache
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....inference import reference
from ....inference.reference import Border, Power
from ..case import Case, Training

_NOISE = 0.7
_TOP = 8.0  # bins span 0 to this


def numbers(name: str) -> Random:
    """Random numbers that depend on a name, in every version of Python the same."""
    return Random(name)  # noqa: S311 - not for secrets


@dataclass(frozen=True)
class Scene:
    """Sizes of a world; `make` gives cases in it.

    Attributes:
        L: Where classes.
        M: What classes.
        K: Taxels.
        J: Samples of a tap.
        B: Bins.
        training: Training taps of each class.
    """

    L: int = 5
    M: int = 3
    K: int = 4
    J: int = 2
    B: int = 8
    training: int = 6

    @property
    def edges(self) -> NDArray[np.float64]:
        """Equal bins over the range of the samples."""
        return np.array([_TOP * b / self.B for b in range(self.B + 1)])

    def tap(self, where: int, what: int, random: Random) -> NDArray[np.float64]:
        """Samples (J, K) in class (where, what), rounded so that they are far from edges in their last digits."""
        levels = _levels(self.L, self.M, self.K)[where][what]
        return np.array([[round(level + _NOISE * random.uniform(-1, 1), 6) for level in levels] for _ in range(self.J)])

    def counts(self, random: Random) -> NDArray[np.int64]:
        """Histograms of training taps, shape (L, M, K, B)."""
        counts = np.zeros((self.L, self.M, self.K, self.B), dtype=np.int64)
        for l, m in np.ndindex(self.L, self.M):
            for _ in range(self.training):
                bins = reference.bin_index(self.tap(l, m, random), self.edges)
                np.add.at(counts[l, m], (np.arange(self.K), bins), 1)
        return counts

    def fit_taps(self, random: Random) -> Training:
        """Taps of all classes, to be fitted."""
        classes = [(l, m) for l in range(self.L) for m in range(self.M) for _ in range(self.training)]
        taps = np.array([self.tap(l, m, random) for l, m in classes])
        where, what = np.array(classes).T
        return Training(taps, where, what)


@cache
def _levels(L: int, M: int, K: int) -> list[list[list[float]]]:
    """Levels of all taxels in all classes, [L][M][K]."""

    def level(where: int, what: int, k: int) -> float:
        place = (where + 0.5) / L
        taxel = (k + 0.5) / K
        width = 0.2 + 0.15 * (what + 1) / M
        return 0.8 + 6.0 * math.exp(-(((place - taxel) / width) ** 2)) * (1 - 0.2 * what / M)

    return [[[level(l, m, k) for k in range(K)] for m in range(M)] for l in range(L)]


def make(name: str, about: str, equations: tuple[int, ...], scene: Scene | None = None, **changes: Any) -> Case:
    """A case in a scene, with taps of one object and the moves that the reference makes.

    Args:
        name: Of the case, from which its random numbers come.
        about: What it tests.
        equations: That it is about.
        scene: The world; default one of pairwise different sizes.
        **changes: `taps` (their number), `start` (place and object), `own_moves` (or given `moves`, or neither for
            none), `holes` (untrained classes, which make the counts probabilities), and any field of `Case`.
    """
    scene = scene or Scene()
    random = numbers(name)
    if not {"counts", "probabilities", "training", "mean"} & set(changes):
        changes["counts"] = scene.counts(random)
    holes = changes.pop("holes", ())
    if holes:
        tables = reference.histogram_probabilities(changes.pop("counts"))
        for l, m in holes:
            tables[l, m] = 0.0
        known = tables.any(axis=(2, 3))
        changes |= {"probabilities": tables, "prior": known / known.sum()}
    if "training" not in changes:
        changes.setdefault("edges", scene.edges)
    L, M = scene.L, scene.M
    fields: dict[str, Any] = {"prior": np.full((L, M), 1.0 / (L * M)), "bins": scene.B, "fixation": (L - 1) // 2}
    fields |= {key: value for key, value in changes.items() if key not in ("start", "own_moves")}
    taps = fields.pop("taps", 4)
    moves = fields.pop("moves", None)
    start = changes.get("start", (L // 3, M - 1))
    if isinstance(taps, int) and changes.get("own_moves"):
        drawn, made = _active(scene, fields, start, taps, random)
    elif isinstance(taps, int):
        made = np.zeros(taps, dtype=np.intp) if moves is None else np.array(moves)
        places = np.clip(start[0] + np.cumsum(made), 0, L - 1)
        drawn = np.array([scene.tap(int(place), start[1], random) for place in places])
    else:
        drawn = np.array(taps, dtype=np.float64)
        made = np.zeros(len(drawn), dtype=np.intp) if moves is None else np.array(moves)
    return Case(name, about, equations, taps=drawn, moves=made, **fields)


def _active(
    scene: Scene, fields: dict[str, Any], start: tuple[int, int], taps: int, random: Random
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Taps of a finger that moves as the reference does, at first in class `start`; its range ends at the ends."""
    power: Power = fields.get("power", "J")
    border: Border = fields.get("border", "uniform")
    tables = fields.get("probabilities")
    if tables is None:
        tables = reference.histogram_probabilities(fields["counts"], fields.get("pseudocount", 0.01))
    trained = tables.any(axis=(2, 3))
    with np.errstate(divide="ignore"):
        log_prob, log_belief, place = np.log(tables), np.log(fields["prior"]), start[0]
    drawn, moves = [], [0]
    for _ in range(taps):
        drawn.append(scene.tap(place, start[1], random))
        bins = reference.bin_index(drawn[-1], fields["edges"])
        log_belief, _ = reference.update_log(log_belief, reference.tap_log_likelihood(bins, log_prob, power))
        where = reference.where_decision(np.exp(log_belief), fields.get("theta_x", 0.0))
        move = 0 if where is None else reference.fixation_move(where, fields["fixation"])
        log_belief = reference.shift_log(log_belief, move, border, trained)
        place = min(max(place + move, 0), scene.L - 1)
        moves.append(move)
    return np.array(drawn), np.array(moves[:-1], dtype=np.intp)
