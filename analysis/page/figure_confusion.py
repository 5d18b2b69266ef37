"""Figure of the confusion of objects."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .figure_sizes import ONE_COLUMN, TWO_COLUMNS, new_figure
from .figure_style import every, label_panel, short, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

_NUMBERS_UP_TO = 12


@styled
def confusion(passive: ArrayLike | None, active: ArrayLike | None, labels: Sequence[str], theta: float) -> Figure:
    """Confusion of objects, passive and active side by side.

    Args:
        passive: Decisions or their frequencies, rows true and columns decided, shape (M, M); `None` leaves
            the panel out.
        active: The same for active perception.
        labels: Name of each what class.
        theta: The belief threshold of the decisions.

    Raises:
        ValueError: Both are `None`.
    """
    tables = {name: table for name, table in (("passive", passive), ("active", active)) if table is not None}
    if not tables:
        raise ValueError("passive and active are both None: there is no confusion table to draw.")
    width = TWO_COLUMNS if len(tables) > 1 else ONE_COLUMN + 0.4
    figure, axes = new_figure(width, 3.5, 1, len(tables), sharey=True, panel=2.6)
    image = None
    for panel, letter, (name, table) in zip(axes[0], "AB"[: len(tables)], tables.items(), strict=True):
        image = plot_confusion(panel, table, labels)
        label_panel(panel, letter if len(tables) > 1 else "", f"{name}, threshold {theta:g}")
    axes[0, 0].set_ylabel("true object")
    if len(labels) > _NUMBERS_UP_TO and image is not None:
        figure.colorbar(image, ax=list(axes[0]), shrink=0.7, label="fraction of decisions")
    return figure


def plot_confusion(axes: Axes, table: ArrayLike, labels: Sequence[str]) -> AxesImage:
    """Draws one row-normalised table as an image, with numbers where they are legible; returns the image."""
    share = row_normalised(table)
    M = len(labels)
    image = axes.imshow(share, cmap="Blues", vmin=0, vmax=1)
    shown = range(0, M, 1 if M <= _NUMBERS_UP_TO else -(-M // 16))
    names = [short(labels[m], labels) for m in shown]
    slant = {"rotation": 45, "ha": "right", "rotation_mode": "anchor"} if every(names, 30) > 1 else {}
    axes.set_xticks(shown, names, **slant)
    axes.set_yticks(shown, names)
    axes.tick_params(length=0)
    axes.spines[:].set(visible=True, color="0.7")
    axes.set_xlabel("decided object")
    if M <= _NUMBERS_UP_TO:
        _write_numbers(axes, share)
    return image


def row_normalised(table: ArrayLike) -> NDArray[np.float64]:
    """Each row divided by its sum, shape (M, M); a row without decisions is NaN."""
    table = np.asarray(table, dtype=np.float64)
    total = table.sum(axis=1, keepdims=True)
    return np.divide(table, total, out=np.full_like(table, np.nan), where=total > 0)


def _write_numbers(axes: Axes, share: NDArray[np.float64]) -> None:
    roomy = len(share) <= 6
    size = "medium" if roomy else "small"
    for (row, column), value in np.ndenumerate(share):
        if np.isfinite(value) and value >= 0.005:
            colour = "white" if value > 0.55 else "black"
            number = f"{value:.2f}" if roomy else f"{value:.2f}".removeprefix("0")
            axes.text(column, row, number, ha="center", va="center", fontsize=size, color=colour)
