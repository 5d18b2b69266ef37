"""Figures of the model studies: recovered models, calibration of fits, gain of `session`."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, new_figure
from solidtouch.analysis.page.figure_style import OTHERS, TWELVE, label_panel, styled


@styled
def recovery_figure(wins: NDArray[np.intp], models: Sequence[str]) -> Figure:
    """How often each model forecast the session left out best, by the model that the taps are from.

    Args:
        wins: Numbers of data sets, shape (source, winner).
        models: Names of both.
    """
    side = 1.2 + 0.36 * len(models)
    figure, axes = new_figure(side + 0.4, side - 0.36 * int((wins.sum(axis=1) == 0).sum()))
    plot_wins(axes[0, 0], wins, models)
    return figure


def plot_wins(axes: Axes, wins: NDArray[np.intp], models: Sequence[str]) -> Axes:
    """A table of shaded numbers, a row per source that has a data set."""
    sources = [name for name, row in zip(models, wins, strict=True) if row.any()]
    wins = wins[wins.any(axis=1)]
    share = wins / wins.sum(axis=1, keepdims=True)
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1.3, aspect="equal")
    for i, j in np.argwhere(wins > 0):
        axes.text(j, i, str(wins[i, j]), ha="center", va="center", color="white" if share[i, j] > 0.6 else "black")
    axes.set_xticks(range(len(models)), models, rotation=45, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(len(sources)), sources)
    axes.set_xlabel("best forecast of the session left out")
    axes.set_ylabel("taps from")
    axes.spines[["top", "right"]].set_visible(True)
    return axes


class RankPanel(NamedTuple):
    """The ranks of one model.

    Attributes:
        title: Its name.
        z: Where the distribution functions are looked at, as fractions of the largest rank.
        low: Lower end of the simultaneous band, minus `z`.
        high: Upper end, likewise.
        curves: Distribution function of each quantity's ranks minus `z`.
    """

    title: str
    z: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    curves: Mapping[str, NDArray[np.float64]]


@styled
def rank_figure(panels: Sequence[RankPanel]) -> Figure:
    """Distribution functions of ranks less that of uniform ones, a panel per model, with simultaneous bands."""
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure, axes = new_figure(TWO_COLUMNS, 2.1 * rows, rows, columns, sharex=True)
    for i, (panel, shown) in enumerate(zip(axes.flat, panels, strict=False)):
        plot_ranks(panel, shown)
        label_panel(panel, chr(ord("A") + i), shown.title)
    for panel in list(axes.flat)[len(panels) :]:
        panel.set_visible(False)
    for panel in axes[-1]:
        panel.set_xlabel("rank of the truth, as a fraction")
    for panel in axes[:, 0]:
        panel.set_ylabel("share of ranks, less uniform")
    return figure


def plot_ranks(axes: Axes, panel: RankPanel) -> Axes:
    """One line per quantity over the band."""
    axes.fill_between(panel.z, panel.low, panel.high, color=OTHERS, alpha=0.3, linewidth=0)
    axes.axhline(0, color=OTHERS, linewidth=0.6)
    for colour, line, (name, curve) in zip(_SPREAD, cycle(_LINES), panel.curves.items(), strict=False):
        axes.plot(panel.z, curve, color=colour, linestyle=line, label=name)
    axes.set_xlim(0, 1)
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small", handlelength=2.4)
    return axes


_LINES = ("-", (0, (5, 1.5)), (0, (1.2, 1)), (0, (6, 1.2, 1.2, 1.2)))
_SPREAD = [TWELVE[i] for i in (4, 1, 3, 0, 5, 2, 8, 6, 9, 7, 10, 11)]  # neighbours far apart


class RulePanel(NamedTuple):
    """Ends of runs of variational fits.

    Attributes:
        title: Which data.
        limit: Change that the rule allows, in nats per tap.
        points: By the name of the model, change and gap of all fits after each run, shape (2, fits, runs).
    """

    title: str
    limit: float
    points: Mapping[str, NDArray[np.float64]]


@styled
def rule_figure(panels: Sequence[RulePanel]) -> Figure:
    """What the rule looks at, and what is left to gain, a panel for each kind of data."""
    figure, axes = new_figure(TWO_COLUMNS, 2.6, 1, len(panels), sharey=True)
    for i, (panel, shown) in enumerate(zip(axes[0], panels, strict=True)):
        plot_rule(panel, shown)
        label_panel(panel, chr(ord("A") + i), shown.title)
        panel.set_xlabel("change (nats per tap)")
    axes[0, 0].set_ylabel("gap to the long fit (nats per tap)")
    axes[0, -1].legend(loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def plot_rule(axes: Axes, panel: RulePanel) -> Axes:
    """A mark for the end of every run, on logarithmic axes; gaps below a ten-thousandth are drawn there."""
    least = 1e-4
    for colour, mark, (name, (change, gap)) in zip(_SPREAD, cycle("o^sx"), panel.points.items(), strict=False):
        values = np.maximum(change, least).ravel(), np.maximum(gap, least).ravel()
        axes.plot(*values, mark, color=colour, markersize=2.4, alpha=0.6, label=name)
    axes.axvline(panel.limit, color=OTHERS, linewidth=0.6)
    axes.set_xscale("log")
    axes.set_yscale("log")
    return axes


class Gain(NamedTuple):
    """Differences of one score between a model in states and the same without.

    Attributes:
        title: Which data and models.
        taps: Numbers of taps, shape (n,).
        values: By the name of the power, a row per data set, shape (data sets, n).
    """

    title: str
    taps: NDArray[np.intp]
    values: Mapping[str, NDArray[np.float64]]


@styled
def session_figure(gains: Sequence[Gain], quantity: str) -> Figure:
    """What states gain on each data set, a panel for each kind of data and pair of models."""
    columns = min(2, len(gains))
    rows = -(-len(gains) // columns)
    figure, axes = new_figure(TWO_COLUMNS, 2.3 * rows, rows, columns)
    for i, (panel, gain) in enumerate(zip(axes.flat, gains, strict=False)):
        plot_gain(panel, gain)
        label_panel(panel, chr(ord("A") + i), gain.title)
    for panel in list(axes.flat)[len(gains) :]:
        panel.set_visible(False)
    for panel in axes[-1]:
        panel.set_xlabel("taps")
    for panel in axes[:, 0]:
        panel.set_ylabel(quantity)
    axes[0, 0].legend(loc="best")
    return figure


def plot_gain(axes: Axes, gain: Gain) -> Axes:
    """A mark per data set with the mean as a bar; the powers stand side by side, the second in hollow marks."""
    axes.axhline(0, color=OTHERS, linewidth=0.6, zorder=0)
    place = np.arange(len(gain.taps), dtype=np.float64)
    looks = ({"color": "#d55e00"}, {"color": "#0072b2", "marker": "D", "markerfacecolor": "none"})
    for i, (look, (name, values)) in enumerate(zip(looks, gain.values.items(), strict=False)):
        x = place + (i - 0.5 * (len(gain.values) - 1)) * 0.35
        spread = np.linspace(-0.08, 0.08, len(values)) if len(values) > 1 else np.zeros(1)
        marks = {"marker": "o", "markersize": 2.5, "alpha": 0.7, "linestyle": "none", "label": name} | look
        axes.plot((x + spread[:, None]).ravel(), values.ravel(), **marks)
        axes.hlines(values.mean(axis=0), x - 0.13, x + 0.13, color=look["color"], linewidth=1.6)
    axes.set_xticks(place, [str(n) for n in gain.taps])
    return axes
