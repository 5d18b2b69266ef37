"""Figures 4 and 6: beliefs and positions within single episodes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models.grid import ClassGrid
from .figure_curves import read_off
from .figure_sizes import TWO_COLUMNS, new_figure
from .figure_style import (
    ACTIVE,
    DECIDED,
    FIXATION,
    OTHERS,
    PASSIVE,
    TRUE,
    axis_label,
    label_panel,
    line_bundle,
    short,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SPREAD = 0.25  # of the distance between neighbouring classes, to either side; the note in the figure says so


class BeliefCase(NamedTuple):
    """The beliefs of one episode and what was true in it.

    Attributes:
        beliefs: Belief of each class after each tap, shape (T, L, M); the first is after the first tap.
        prior: Belief of each class before the first tap, shape (L, M).
        where: Index of the true where class.
        what: Index of the true what class.
    """

    beliefs: NDArray[np.floating]
    prior: NDArray[np.floating]
    where: int
    what: int


@styled
def beliefs(clear: BeliefCase, ambiguous: BeliefCase, grid: ClassGrid) -> Figure:
    """Beliefs of all classes against the number of taps, a clear (A) and an ambiguous case (B); Fig. 4."""
    figure, axes = new_figure(TWO_COLUMNS, 2.7, 1, 2, sharey=True, panel=2.6)
    for panel, letter, case in zip(axes[0], "AB", (clear, ambiguous), strict=True):
        plot_beliefs(panel, case, grid)
        label_panel(panel, letter)
    axes[0, 0].set_ylabel("belief")
    return figure


def plot_beliefs(axes: Axes, case: BeliefCase, grid: ClassGrid) -> Axes:
    """Draws all beliefs of one episode thin and names the true class and the one believed most in the end."""
    curves = np.concatenate([case.prior[np.newaxis], case.beliefs]).reshape(len(case.beliefs) + 1, -1)
    taps = np.arange(len(curves))
    true = int(np.ravel_multi_index((case.where, case.what), grid.shape))
    decided = int(curves[-1].argmax())
    line_bundle(axes, taps, np.delete(curves, [true, decided], axis=1).T, color=OTHERS, linewidth=0.5)
    role = "true and decided" if true == decided else "true"
    axes.plot(taps, curves[:, true], color=TRUE, linewidth=1.6, label=f"{role}: {class_label(grid, true)}")
    if decided != true:
        label = f"decided: {class_label(grid, decided)}"
        axes.plot(taps, curves[:, decided], color=DECIDED, linewidth=1.6, linestyle=(0, (4, 1.5)), label=label)
    axes.set(xlabel="taps", ylim=(-0.02, 1.02))
    axes.locator_params(axis="x", integer=True)
    axes.legend(
        loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0, borderpad=0.3, labelspacing=0.2, handlelength=2.4
    )
    return axes


def class_label(grid: ClassGrid, index: int) -> str:
    """A joint class in words, such as `"8 mm rod at 7.5 mm"`; `index` counts over (L, M) flattened."""
    l, m = np.unravel_index(index, grid.shape)
    if grid.L == 1:
        return short(grid.what_name[m], grid.what_name)
    return f"{short(grid.what_name[m], grid.what_name)} at {short(grid.where_label(int(l)))}"


@styled
def trajectories(passive: ArrayLike, active: ArrayLike, grid: ClassGrid, fixation: int) -> Figure:
    """Where the sensor stood in many episodes, passive (A) and active (B); Fig. 6.

    Args:
        passive: Where class at each tap, shape (n, T); -1 or NaN after the decision.
        active: The same under active perception.
        grid: What the classes stand for.
        fixation: Index of the where class that active perception moves to.
    """
    figure, axes = new_figure(TWO_COLUMNS, 2.7, 1, 2, sharey=True, panel=2.6)
    shown = (("passive", passive, PASSIVE), ("active", active, ACTIVE))
    for panel, letter, (name, index, colour) in zip(axes[0], "AB", shown, strict=True):
        plot_trajectories(panel, index, grid, colour)
        label_panel(panel, letter, name)
    mark_fixation(axes[0, 1], grid, fixation)
    axes[0, 0].set_ylabel(axis_label("position", grid.axis_unit))
    note = "Lines at the same position are offset by up to a quarter of a class; dots mark decisions."
    figure.supxlabel(note, fontsize="small")
    return figure


def plot_trajectories(axes: Axes, index: ArrayLike, grid: ClassGrid, colour: str) -> Axes:
    """Draws one thin line per episode, slightly displaced so that lines on the same positions show."""
    index = np.asarray(index, dtype=np.float64)
    stands = np.isfinite(index) & (index >= 0)
    value = grid.where_value[np.where(stands, index, 0).astype(np.intp)]
    position = np.where(stands, value + _displacement(len(index), grid)[:, np.newaxis], np.nan)
    taps = 1 + np.arange(index.shape[1])
    line_bundle(axes, taps, position, color=colour, linewidth=0.5, alpha=0.45)
    last = np.maximum(stands.sum(axis=1), 1)
    trials = np.argsort(last, kind="stable")
    ends = trials, last[trials] - 1
    (dots,) = axes.plot(last[trials], position[ends], ".", color=colour, markersize=2.2, label="decision")
    starts = [f"start {grid.where_label(l)}" for l in np.where(stands, index, 0)[trials, 0].astype(int)]
    read_off(dots, starts, [str(tap) for tap in last[trials]], y=[f"{place:g}" for place in value[ends]])
    axes.set(xlabel="tap", xlim=(0, 1.02 * last.max() + 0.5))
    axes.locator_params(axis="x", integer=True)
    axes.locator_params(axis="y", steps=[1, 2, 5, 10])
    axes.set_yticks(grid.where_value, minor=True)
    return axes


def mark_fixation(axes: Axes, grid: ClassGrid, fixation: int) -> Axes:
    """Marks the fixation point on the position axis."""
    value = float(grid.where_value[fixation])
    axes.axhline(value, color=FIXATION, linewidth=0.8, linestyle=(0, (4, 2)), zorder=0)
    axes.annotate(
        "fixation\npoint",
        (1, value),
        xycoords=("axes fraction", "data"),
        xytext=(3, 0),
        textcoords="offset points",
        va="center",
        color=FIXATION,
    )
    return axes


def _displacement(n: int, grid: ClassGrid) -> NDArray[Any]:
    """One offset per line, evenly spread and in no visible order (multiples of the golden ratio)."""
    spacing = float(np.diff(grid.where_value).min()) if grid.L > 1 else 1.0
    return _SPREAD * spacing * (2 * (np.arange(n) * 0.6180339887 % 1) - 1)
