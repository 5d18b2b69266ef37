"""Sizes, ranges and data-quality warnings of a tap set, before any fit."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...models.cutting.taxels import constant_taxels, saturated_taxels, taxel_ranges
from ...models.grid import ClassGrid
from ...models.preprocessing import Preprocessing
from ...models.splits import missing_sentence
from ...models.taps import TapSet
from ..experiment.data_warnings import data_warnings
from .questions import QuestionAnswer, answers


@dataclass(frozen=True, eq=False)
class Inspection:
    """The facts that `solidtouch inspect` prints; `S` sessions, `L` x `M` classes, `K` taxels.

    Attributes:
        size: Taps, samples per tap, taxels: (N, J, K).
        sessions: The session numbers, `S` of them.
        where_label: Value of each where class in print, without its unit, `L` of them.
        what_label: Print name of each what class, `M` of them.
        where_unit: Unit of the positions.
        counts: Taps per session and class, shape (S, L, M).
        low: Lowest value of each taxel, shape (K,).
        high: Highest value of each taxel, shape (K,).
        units: Unit of the samples.
        constant: Taxels with one value throughout.
        saturated: Taxels that stay long at an extreme, as `saturated_taxels` defines it.
        preprocessing: What was done to the samples: the fields of the record that are not their default.
        attributes: Sensor, source, licence and the further arrays.
        warnings: What may mislead, one sentence each.
        answers: Which questions the recording can answer.
    """

    size: tuple[int, int, int]
    sessions: tuple[int, ...]
    where_label: tuple[str, ...]
    what_label: tuple[str, ...]
    where_unit: str
    counts: NDArray[np.int64]
    low: NDArray[np.floating]
    high: NDArray[np.floating]
    units: str
    constant: tuple[int, ...]
    saturated: tuple[int, ...]
    preprocessing: dict[str, Any]
    attributes: dict[str, str]
    warnings: tuple[str, ...]
    answers: tuple[QuestionAnswer, ...]


def inspect_taps(taps: TapSet, grid: ClassGrid) -> Inspection:
    """The facts about a tap set, its taps counted in the classes of `grid`."""
    sessions = np.unique(taps.session)
    low, high = taxel_ranges(taps.extremes)
    counts = count_taps(taps, grid)
    extra = [str(name) for name in taps.dataset.data_vars if name != "taps"]
    attributes = {name: str(taps.dataset.attrs.get(name, "")) for name in ("sensor", "source", "licence")}
    return Inspection(
        size=(len(taps), *taps.tap_shape),
        sessions=tuple(sessions.tolist()),
        where_label=_places(grid),
        what_label=grid.what_name,
        where_unit=grid.where_unit,
        counts=counts,
        low=low,
        high=high,
        units=taps.dataset["taps"].attrs.get("units", ""),
        constant=constant_taxels(taps.extremes),
        saturated=saturated_taxels(taps.samples, taps.extremes),
        preprocessing=_chosen(taps.preprocessing),
        attributes={**attributes, "further arrays": ", ".join(extra)},
        warnings=tuple(filter(None, (missing_sentence([taps], "taps"), *data_warnings(taps, grid)))),
        answers=answers(taps, grid, counts),
    )


def _places(grid: ClassGrid) -> tuple[str, ...]:
    """Positions in print, without their unit."""
    if grid.where_place is None:
        return tuple(f"{value:g}" for value in grid.where_value)
    return tuple(f"({', '.join(f'{value:g}' for value in place)})" for place in grid.where_place)


def _chosen(record: Preprocessing) -> dict[str, Any]:
    default = asdict(Preprocessing(samples=record.samples))
    return {name: value for name, value in asdict(record).items() if name != "samples" and value != default[name]}


def count_taps(taps: TapSet, grid: ClassGrid) -> NDArray[np.int64]:
    """Taps per session (in increasing order) and class, shape (S, L, M); those outside the grid are not counted."""
    where, what = taps.indices(grid)
    sessions, session = np.unique(taps.session, return_inverse=True)
    counts = np.zeros((len(sessions), *grid.shape), dtype=np.int64)
    inside = (where >= 0) & (what >= 0)
    np.add.at(counts, (session[inside], where[inside], what[inside]), 1)
    return counts
