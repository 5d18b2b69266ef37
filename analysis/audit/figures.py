"""Figures of an audit: where the naive-Bayes assumption fails, and the effect of each remedy.

Data are those of `causes.split_variance`, `dependence.taxels.taxel_dependence`, `dependence.times.time_dependence`,
`remedy_scores.measure` and `leakage.run.leakage`. A figure that there is nothing to draw for is `None`.
"""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator, StrMethodFormatter
from numpy.typing import NDArray

from ..page.figure_sizes import TWO_COLUMNS, key, new_figure
from ..page.figure_style import ACTIVE, DECIDED, MOST_FACTOR, OTHERS, TRUE, axis_label, label_panel, short, styled
from .leakage.run import Leakage
from .remedy_scores import Scored
from .variance.causes import first_cause, is_cause, part_words, seen, sure_causes

type Interval = tuple[float | None, float | None, float | None]
"""An estimate with the ends of its interval; `None`, NaN or infinite where there is none."""

_ROW = 0.24  # inches
_QUANTITIES = {"what": "object", "where": "position", "joint": "object and position"}
_TOUCHES = ("whole taps", "tared taps")
_TAXEL_TICKS = 9
_SIGNS = 24  # taxels, up to which negative effects have a minus
_LEAST_REACH = {"rank": 0.1, "distance": 0.1, "table": 0.02}  # of colours, so that chance looks pale
_SPARED = "0.9"
_BAR_COLOURS = {"first": DECIDED, "there": TRUE, "perhaps": "#b3d4e8", "other": OTHERS}
_HATCH = {"first": "///"}  # the main cause is told from the others in grey as well
_WRAP = 24  # characters
_UNDECIDED = "#707070"
_MARKS = {DECIDED: "s"}
_BARS = 60  # lags, beyond which bars give way to a line
_SPAN = 300.0  # from the least to the largest factor that the axis holds


@styled
def causes(split: xr.Dataset, named: str | None = None, without: Sequence[str] = ()) -> Figure | None:
    """Shares of the variance of evidence by cause, the largest on top, the main cause in orange.

    Args:
        split: From `causes.split_variance`.
        named: The cause that is marked, by default that of `causes.first_cause`; an empty name marks none.
        without: Causes that other tests do not support.
    """
    if not np.isfinite(split["share"].values).any():
        return None
    figure, axes = new_figure(TWO_COLUMNS, 0.95 + 1.35 * _ROW * split.sizes["part"], of_text=True)
    known = split.fillna(0.0)
    plot_causes(axes[0, 0], split, first_cause(known, without) if named is None else named, sure_causes(known, without))
    _cause_key(figure, axes[0, 0])
    return figure


def seen_causes(split: xr.Dataset, named: str, without: Sequence[str]) -> Figure | None:
    """`causes` without the numbers of parts that these taps cannot show."""
    return causes(seen(split), named, without)


def plot_causes(axes: Axes, split: xr.Dataset, named: str | None, sure: Sequence[str]) -> Axes:
    """Draws a bar with its interval for each part; pale for causes that are not sure, last if not estimable."""
    order = np.argsort(-np.nan_to_num(split["share"].values, nan=-np.inf), kind="stable")
    split = split.isel(part=order)
    parts = [str(part) for part in split["part"].values]
    share, low, high = (100 * split[f"share{end}"].values for end in ("", "_low", "_high"))
    axes.axvline(0, color="black", linewidth=0.6)
    for i, part in enumerate(parts):
        if not np.isfinite(share[i]):
            axes.annotate("not estimable", (0, i), xytext=(4, 0), textcoords="offset points", va="center")
            continue
        there = "there" if part in sure else "perhaps"
        kind = "other" if not is_cause(part) else "first" if part == named else there
        axes.barh(
            i, share[i], height=0.7, color=_BAR_COLOURS[kind], hatch=_HATCH.get(kind), edgecolor="white", linewidth=0
        )
        if np.isfinite([low[i], high[i]]).all():
            axes.plot([low[i], high[i]], [i, i], color="black", linewidth=0.8)
        at = np.nanmax([share[i], high[i], 0.0])
        axes.annotate(f"{share[i]:.0f}%", (at, i), xytext=(4, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(parts)), [fill(part_words(part), _WRAP) for part in parts])
    axes.set_ylim(len(parts) - 0.4, -0.6)
    axes.set_xlim(*_padded(np.concatenate([low, high, share, [0.0]])))
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel(f"share of the variance of the evidence of {split.attrs.get('taps', 'some')} taps (%)")
    return axes


def _padded(values: NDArray[np.float64]) -> tuple[float, float]:
    """Ends of an axis that leave room for a number behind the longest bar."""
    values = values[np.isfinite(values)]
    span = float(np.ptp(values)) or 1.0
    return float(values.min()) - (0.02 * span if values.min() < 0 else 0.0), float(values.max()) + 0.12 * span


@styled
def taxel_map(dependence: xr.Dataset) -> Figure | None:
    """A map of the effect of every pair of taxels for each test.

    Effects stand below the diagonal and are mirrored above it by which pairs survive the false discovery rate.

    Args:
        dependence: From `dependence.taxels.taxel_dependence`.
    """
    if not np.isfinite(dependence["effect"].values).any():
        return None
    tests = [str(test) for test in dependence["test"].values]
    figure, axes = new_figure(TWO_COLUMNS, 3.9, 1, len(tests), sharey=True, panel=2.2)
    for i, (panel, test) in enumerate(zip(axes[0], tests, strict=True)):
        plot_taxel_map(panel, dependence.sel(test=test))
        label_panel(panel, chr(ord("A") + i), panel.get_title())
    axes[0, 0].set_ylabel("taxel")
    _map_key(figure, dependence)
    return figure


def plot_taxel_map(axes: Axes, one: xr.Dataset) -> Axes:
    """Draws one test: effects below the diagonal in colour, survivors above it in black, dead taxels hatched."""
    effect, rejected = one["effect"].values, one["rejected"].values
    K = len(effect)
    known = np.isfinite(effect)
    below, above = np.tril(known, -1), np.triu(known, 1)
    axes.set_facecolor("white")
    axes.add_patch(_hatched((-0.5, -0.5), K))
    test = str(one["test"].values)
    signed = test == "rank"
    reach = float(np.abs(effect[known]).max(initial=_LEAST_REACH.get(test, 0.01)))
    colours = ScalarMappable(Normalize(-reach if signed else 0.0, reach), "RdBu_r" if signed else "YlGnBu")
    shown = np.zeros((K, K, 4))
    shown[np.eye(K, dtype=bool)] = to_rgba("white")
    shown[below] = colours.to_rgba(effect[below])
    shown[above] = np.where(rejected[above, np.newaxis], to_rgba("black"), to_rgba(_SPARED))
    axes.imshow(shown, origin="upper", interpolation="nearest", zorder=2)
    if signed and K <= _SIGNS:
        rows, columns = np.nonzero(below & (effect < 0))
        axes.plot(columns, rows, "_", color="black", markersize=3.5, markeredgewidth=0.6, zorder=3)
    bar = axes.figure.colorbar(colours, ax=axes, orientation="horizontal", pad=0.02, shrink=0.9, aspect=25)
    bar.set_label(str(one["effect_unit"].values))
    bar.locator = MaxNLocator(nbins=5, steps=[1, 2, 5, 10])
    bar.update_ticks()
    pairs = int(below.sum())
    axes.set_title(f"{int((rejected & below).sum())} of {pairs} pair{'s' * (pairs != 1)}")
    if not known.any():
        axes.set_title("")
        said = {"ha": "center", "va": "center", "transform": axes.transAxes, "zorder": 3}
        text = axes.text(0.5, 0.5, fill(str(one["reason"].values), 24), bbox={"color": "white"}, **said)
        text.set_in_layout(False)
    ticks = range(0, K, next((step for step in (1, 2, 5, 10, 20, 50) if step * _TAXEL_TICKS >= K), 100))
    axes.set_xticks(ticks)
    axes.set_yticks(ticks)
    axes.set_xlabel("taxel")
    axes.spines[["top", "right"]].set_visible(True)
    return axes


@styled
def times(dependence: xr.Dataset, rate_hz: float | None = None) -> Figure | None:
    """Autocorrelation and partial autocorrelation of residuals against the lag.

    Args:
        dependence: From `dependence.times.time_dependence`.
        rate_hz: Samples per second; without it lags are in samples.
    """
    if dependence.sizes["lag"] < 2 or not np.isfinite(dependence["autocorrelation"].values[1:]).any():
        return None
    figure, axes = new_figure(TWO_COLUMNS, 2.3, 1, 2, sharey=True)
    for panel, letter, name in zip(axes[0], "AB", ("autocorrelation", "partial"), strict=True):
        plot_lags(panel, dependence, name, rate_hz)
        label_panel(panel, letter, panel.get_title())
    return figure


def plot_lags(axes: Axes, dependence: xr.Dataset, name: str, rate_hz: float | None = None) -> Axes:
    """Draws a correlation at every lag from 1 on, with its interval where it has one; many lags as a line."""
    x = dependence["lag"].values[1:] / (rate_hz or 1.0)
    value = dependence[name].values[1:]
    axes.axhline(0, color="black", linewidth=0.6)
    if len(x) > _BARS:
        axes.plot(x, value, color=TRUE)
    else:
        axes.vlines(x, 0, value, color=TRUE, linewidth=1.2)
        axes.plot(x, value, "o", color=TRUE, markersize=2.5)
    if f"{name}_low" in dependence:
        low, high = (dependence[f"{name}{end}"].values[1:] for end in ("_low", "_high"))
        axes.fill_between(x, low, high, color=TRUE, alpha=0.25, linewidth=0)
        if len(x) == 1:
            axes.vlines(x, low, high, color="black", linewidth=0.8)
    whole = name == "autocorrelation"
    axes.set_title(_effective(dependence) if whole else "given the samples between")
    axes.set_ylabel(name if whole else f"{name} autocorrelation")
    axes.set_xlabel("lag (s)" if rate_hz else "lag (samples)")
    axes.set_xlim(0, float(x[-1]) * 1.03)
    if not rate_hz:
        axes.locator_params(axis="x", integer=True)
    return axes


@styled
def remedies(scores: Sequence[Scored], n: int, taps: float, played: xr.Dataset) -> Figure | None:
    """Effect of each remedy, a row each with the current setting on top, and a panel per quantity.

    Args:
        scores: Of each remedy, the current setting first.
        n: Taps of the sequences by which beliefs are scored.
        taps: Reaction time at which errors are compared.
        played: Trials of the remedies, whose errors have units.

    Returns:
        Gain in log score, change of the error where decisions can err, and miscalibration; blue is better than the
        setting as it is, orange worse, grey not told apart.
    """
    if not scores:
        return None
    names = [score.name for score in scores]
    panels: list[tuple[list[Interval], str, bool]] = [
        (
            [_per_tap(score.gain, n) for score in scores],
            f"gain in log score\nafter {_taps(n)} (nats per tap)",
            True,
        )
    ]
    errors, label = _error_changes(scores, taps, played)
    if any(_known(error) for error in errors[1:]):
        panels.append((errors, label, False))
    height = 1.2 + _ROW * len(names)
    figure, axes = new_figure(TWO_COLUMNS, height, 1, len(panels) + 1, sharey=True, of_text=True, panel=2.6)
    for panel, (values, title, more) in zip(axes[0], panels, strict=False):
        plot_changes(panel, values, more_is_better=more)
        panel.set_xlabel(title)
    plot_factors(axes[0, -1], [score.factor for score in scores])
    axes[0, 0].set_yticks(range(len(names)), [short(name, names) for name in names])
    axes[0, 0].set_ylim(len(names) - 0.4, -0.6)
    for i, panel in enumerate(axes[0]):
        panel.tick_params(axis="y", length=0)
        panel.spines["left"].set_visible(False)
        label_panel(panel, chr(ord("A") + i))
    _change_key(figure)
    return figure


def plot_changes(axes: Axes, values: Sequence[Interval], *, more_is_better: bool) -> Axes:
    """Draws changes from the first row, which has none, as dots with intervals."""
    axes.axvline(0, color="grey", linewidth=0.8, linestyle=":")
    axes.plot(0, 0, "o", color=ACTIVE, markersize=4)
    for i, change in enumerate(values[1:], start=1):
        if not _known(change):
            axes.annotate("not known", (0, i), xytext=(4, 0), textcoords="offset points", va="center", color="grey")
            continue
        value, low, high = _numbers(change)
        better, worse = (low > 0, high < 0) if more_is_better else (high < 0, low > 0)
        _dot(axes, i, value, low, high, TRUE if better else DECIDED if worse else _UNDECIDED)
    axes.set_xmargin(0.08)
    axes.locator_params(axis="x", nbins=5)
    return axes


def plot_factors(axes: Axes, values: Sequence[Interval]) -> Axes:
    """Draws miscalibration factors on a log axis, with a line at 1 (calibrated)."""
    axes.set_xscale("log")
    axes.axvline(1, color="grey", linewidth=0.8, linestyle=":")
    numbers = np.array([_numbers(value) for value in values])
    least, most = _reach(numbers)
    most = min(most, MOST_FACTOR)
    for i, (value, low, high) in enumerate(numbers):
        if np.isinf(value):
            axes.plot(most, i, ">", color=ACTIVE, clip_on=False)
            axes.annotate("infinite", (most, i), xytext=(-6, 0), textcoords="offset points", ha="right", va="center")
        elif np.isnan(value):
            axes.annotate("no decision", (1, i), xytext=(4, 0), textcoords="offset points", va="center", color="grey")
        elif value < least:
            axes.plot(least, i, "<", color=ACTIVE, clip_on=False)
            axes.plot([least, np.clip(high, least, most)], [i, i], color=ACTIVE, linewidth=1.0)
        elif value > most:
            axes.plot(most, i, ">", color=ACTIVE, clip_on=False)
            axes.plot([np.clip(low, least, most), most], [i, i], color=ACTIVE, linewidth=1.0)
        else:
            _dot(axes, i, value, max(low, least), min(high, most), ACTIVE)
    axes.set_xlim(least, most)
    marks = np.outer(10.0 ** np.arange(-4, 7), (1, 2, 5)).ravel()
    marks = marks[(marks >= least) & (marks <= most)]
    axes.xaxis.set_major_locator(FixedLocator(_spread_marks(marks)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("miscalibration factor\nwrong / mean (1 − belief)")
    return axes


@styled
def leakage(result: Leakage) -> Figure | None:
    """Accuracy without touch and of whole taps, a panel for each of object, position and both.

    Args:
        result: From `leakage.run.leakage`.
    """
    told = result.told
    told = told.isel(source=np.isfinite(told["accuracy"].values).any(axis=1))
    if not told.sizes["source"]:
        return None
    quantities = [str(name) for name in told["quantity"].values]
    width = TWO_COLUMNS * {1: 0.62, 2: 0.84}.get(len(quantities), 1.0)
    rows = [*map(str, told["source"].values), "chance"]
    figure, axes = new_figure(width, 0.95 + _ROW * len(rows), 1, len(quantities), sharey=True, of_text=True, panel=2.6)
    for i, (panel, name) in enumerate(zip(axes[0], quantities, strict=True)):
        plot_told(panel, told.sel(quantity=name))
        if set(rows) - {*_TOUCHES, "chance"}:
            panel.set_xlabel(f"{panel.get_xlabel()}\ninferred without touch: {result.explains[name]}")
        label_panel(panel, chr(ord("A") + i) if len(quantities) > 1 else "", _QUANTITIES[name])
    axes[0, 0].set_yticks(range(len(rows)), rows)
    axes[0, 0].set_ylim(len(rows) - 0.4, -0.6)
    return figure


def plot_told(axes: Axes, told: xr.Dataset) -> Axes:
    """Draws the fraction right from each source with its interval; orange without touch, and chance as a line."""
    axes.axvline(float(told["chance"]), color="grey", linewidth=0.8, linestyle=":")
    for i, source in enumerate(told["source"].values):
        value, low, high = (float(told[name].sel(source=source)) for name in ("accuracy", "low", "high"))
        if np.isfinite(value):
            _dot(axes, i, value, low, high, ACTIVE if source in _TOUCHES else DECIDED)
    axes.plot(float(told["chance"]), told.sizes["source"], "|", color="grey", markersize=8)
    axes.set_xlim(0, 1.02)
    axes.set_xlabel("fraction correct after one tap")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    return axes


def _dot(axes: Axes, row: int, value: float, low: float, high: float, colour: str) -> None:
    """An estimate with its interval in a row; ends that are not finite are left out."""
    if np.isfinite([low, high]).all():
        axes.plot([low, high], [row, row], color=colour, linewidth=1.0)
    face = "white" if colour == _UNDECIDED else colour
    axes.plot(value, row, _MARKS.get(colour, "o"), color=colour, markerfacecolor=face, markersize=4)


def _known(change: Interval | None) -> bool:
    return change is not None and bool(np.isfinite(_numbers(change)).all())


def _changed(changes: Sequence[Interval]) -> bool:
    return any(_known(change) and any(change) for change in changes)


def _numbers(interval: Interval) -> tuple[float, float, float]:
    """The same with NaN for what is not there."""
    value, low, high = (np.nan if number is None else float(number) for number in interval)
    return value, low, high


def _per_tap(gain: Interval | None, n: int) -> Interval:
    if gain is None:
        return None, None, None
    value, low, high = _numbers(gain)
    return value / n, low / n, high / n


def _taps(n: int) -> str:
    return f"{n} tap{'s' * (n != 1)}"


def _error_changes(scores: Sequence[Scored], taps: float, played: xr.Dataset) -> tuple[list[Interval], str]:
    """Changes of the error in the object, or in the position where no change of that is seen, and what they are."""
    nothing: Interval = (None, None, None)
    changes: list[Interval] = [score.error_change or nothing for score in scores]
    places: list[Interval] = [score.where_error_change or nothing for score in scores]
    name = "what_error"
    if not _changed(changes) and _changed(places):
        name, changes = "where_error", places
    unit = played[name].attrs.get("units", "")
    quantity = "change of object error" if name == "what_error" else "change of position error"
    label = f"change of {unit}" if unit == "P(wrong)" else axis_label(quantity, unit)
    number = f"{taps:.3g}"
    return changes, f"{label}\nat {number} tap{'s' * (number != '1')} on average"


def _reach(numbers: NDArray[np.float64]) -> tuple[float, float]:
    """Ends of an axis of factors: all that is there about 1, but a few hundred times at most."""
    seen = numbers[np.isfinite(numbers) & (numbers > 0)]
    most = max(2.0, 1.25 * seen.max(initial=1.0))
    least = min(0.5, 0.8 * seen.min(initial=1.0))
    return min(0.5, max(least, most / _SPAN)), most


def _spread_marks(marks: NDArray[np.float64]) -> list[float]:
    """At most about six of the round numbers, 1 among them if it is there."""
    step = max(1, -(-len(marks) // 6))
    start = int(np.flatnonzero(marks == 1)[0]) % step if (marks == 1).any() else 0
    return marks[start::step].tolist()


def _effective(dependence: xr.Dataset) -> str:
    value, low, high = (float(dependence[f"effective_samples{end}"]) for end in ("", "_low", "_high"))
    J = dependence.sizes["lag"]
    return f"{J} samples are worth {value:.3g} ({low:.3g} to {high:.3g})" if np.isfinite(value) else ""


def _hatched(corner: tuple[float, float], side: float) -> Any:
    return Rectangle(corner, side, side, facecolor="white", edgecolor="0.7", hatch="/////", linewidth=0, zorder=1)


def _map_key(figure: Figure, dependence: xr.Dataset) -> None:
    alpha = float(dependence.attrs.get("alpha", np.nan))
    keys = {
        f"dependent, false discovery rate {alpha:.0%}": Patch(facecolor="black"),
        "not significant": Patch(facecolor=_SPARED),
    }
    off = ~np.eye(dependence.sizes["taxel"], dtype=bool)
    if np.isnan(dependence["effect"].values[:, off]).any():
        keys["constant taxel or not tested"] = _hatched((0, 0), 1)
    key(figure, list(keys.values()), list(keys))


def _cause_key(figure: Figure, axes: Axes) -> None:
    """Names the colours of bars that are there."""
    words = {"first": "main cause", "there": "cause", "perhaps": "not significant or below 5%", "other": "not a cause"}
    seen = {patch.get_facecolor() for patch in axes.patches}
    keys = [
        Patch(facecolor=_BAR_COLOURS[kind], hatch=_HATCH.get(kind), edgecolor="white", linewidth=0, label=word)
        for kind, word in words.items()
        if to_rgba(_BAR_COLOURS[kind]) in seen
    ]
    key(figure, keys, above=True)


def _change_key(figure: Figure) -> None:
    words = {
        "better than the current setting (95% interval)": TRUE,
        "worse": DECIDED,
        "undecided": _UNDECIDED,
    }
    keys = [
        Line2D([], [], color=c, marker=_MARKS.get(c, "o"), markersize=4, label=word, markerfacecolor=face)
        for word, c in words.items()
        for face in ["white" if c == _UNDECIDED else c]
    ]
    key(figure, keys)
