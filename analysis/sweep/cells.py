"""Cells of a sweep: every combination of the axes, by number or by value.

A cell's number counts them row by row, the last axis fastest. The axes are in such an order that neighbours share the
data set, then the fitted likelihoods.
"""

from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...inference.moves.strategies import parse_strategy
from .models import FitAxes
from .study import StudyFile

AXES = (
    "data",
    "model",
    "bins",
    "value_range",
    "pseudocount",
    "power",
    "border",
    "policy",
    "fixation",
    "seed",
    "resample",
)
_BORDER, _POLICY, _FIXATION = (AXES.index(name) for name in ("border", "policy", "fixation"))
_ACTIVE = "active"


class Effort(NamedTuple):
    """What is the same in every cell.

    Attributes:
        trials: Trials of a cell.
        thresholds: theta_W, H of them.
        deadline: Taps after which the most probable classes are taken.
    """

    trials: int
    thresholds: tuple[float, ...]
    deadline: int


class Cell(NamedTuple):
    """One combination; the fields after the number are the `AXES`.

    Attributes:
        number: Its place in the grid.
        data: Name of the data set.
        model: Likelihood model.
        bins: Histogram bins.
        value_range: Whether bins span all taxels together or each.
        pseudocount: Counts added to every bin.
        power: Root of the likelihood.
        border: Reading of Eq. 9.
        policy: `"passive"`, `"active"`, theta_X or the name of another strategy.
        fixation: Fixation point as where class, `None` for the middle.
        seed: Of the trials.
        resample: Of the test taps, 0 for the taps as they are.
    """

    number: int
    data: str
    model: str
    bins: int
    value_range: str
    pseudocount: float
    power: str | float
    border: Any
    policy: str | float
    fixation: int | None
    seed: int
    resample: int

    @property
    def fit_settings(self) -> FitAxes:
        """What decides the likelihoods of its data set."""
        return FitAxes(self.model, self.bins, self.value_range, self.pseudocount, self.power)

    @property
    def strategy(self) -> str:
        """Its policy by the name that `inference.moves.strategies` has for it."""
        if isinstance(self.policy, str):
            return "fixation" if self.policy == _ACTIVE else self.policy
        return f"fixation:{self.policy!r}"

    @property
    def theta_x(self) -> float | None:
        """Threshold on the where belief for a move: 0 always moves, 1 never does; `None` of other strategies."""
        return parse_strategy(self.strategy).theta_x


@dataclass(frozen=True)
class CellGrid:
    """All cells of a study.

    Attributes:
        axes: The values along each of `AXES`.
    """

    axes: tuple[tuple[Any, ...], ...]

    @classmethod
    def of(cls, study: StudyFile, data_sets: tuple[str, ...]) -> "CellGrid":
        """The grid of a study whose data sets have these names."""
        fixation = (None,) if study.grid.fixation == "middle" else tuple(study.grid.fixation)
        others = {name: tuple(getattr(study.grid, name)) for name in AXES if hasattr(study.grid, name)}
        resample = tuple(range(study.resamples + 1))
        values = {**others, "data": data_sets, "fixation": fixation, "resample": resample}
        return cls(tuple(values[name] for name in AXES))

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""
        return tuple(len(values) for values in self.axes)

    def __len__(self) -> int:
        return prod(self.shape)

    def cell(self, number: int) -> Cell:
        """The cell of this number."""
        values = (values[i] for values, i in zip(self.axes, self.index(number), strict=True))
        return Cell(int(number), *values)

    def index(self, number: int) -> tuple[int, ...]:
        """Its place along each axis."""
        return tuple(int(i) for i in np.unravel_index(number, self.shape))

    @cached_property
    def distinct(self) -> NDArray[np.intp]:
        """Numbers of the cells that are computed.

        Passive ones at the first border and fixation point only, those that do not aim for it at the first one only.
        """
        return np.flatnonzero(self._first_of_its_kind())

    def places(self, number: int) -> list[int]:
        """Numbers of all cells that a distinct one stands for, itself the last."""
        index = self.index(number)
        free = _free_axes(self.axes[_POLICY][index[_POLICY]])
        spread = [range(n) if axis in free else [i] for axis, (n, i) in enumerate(zip(self.shape, index, strict=True))]
        numbers = np.ravel_multi_index(np.meshgrid(*spread, indexing="ij"), self.shape).ravel()
        return [int(other) for other in numbers if other != number] + [number]

    def _first_of_its_kind(self) -> NDArray[np.bool_]:
        kept = np.ones(self.shape, dtype=bool)
        for policy, part in zip(self.axes[_POLICY], np.moveaxis(kept, _POLICY, 0), strict=True):
            for axis in _free_axes(policy):
                np.moveaxis(part, axis - (axis > _POLICY), 0)[1:] = False
        return kept


def _free_axes(policy: str | float) -> tuple[int, ...]:
    """Numbers of the axes along which trials of a policy are the same."""
    if not isinstance(policy, str) or policy == _ACTIVE:
        return ()
    return (_BORDER, _FIXATION) if policy == "passive" else (_FIXATION,)
