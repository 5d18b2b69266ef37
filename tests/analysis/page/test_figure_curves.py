"""Curves of a figure, read back from what is drawn."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.page.figure_curves import curves_of, read_off
from solidtouch.analysis.page.figure_style import band, drawing_of, new_figure

X = np.array([0.1, 0.5, 0.9])
DATA = xr.Dataset(
    {"e": ("x", [3.0, 2.0, np.nan]), "e_low": ("x", [2.5, 1.5, np.nan]), "e_high": ("x", [3.5, 2.5, 3.0])}
)


def told(figure):
    """Texts of the points of every curve, by panel and label."""
    return {
        (panel.title, one.label): [point[2:] for point in one.points]
        for panel in curves_of(figure)
        for one in panel.series
    }


@pytest.fixture
def axes():
    return new_figure(4.0, 2.0, 1, 2)[1][0]


def test_values_are_told_with_the_interval_of_their_band(axes):
    """To the digits of a table; what is missing is no point."""
    axes[0].plot(X, DATA["e"], label="active", color="black")
    band(axes[0], X, DATA, "e", "black")
    axes[0].set(title="A", xlabel="threshold", ylabel="error (mm)")
    (panel,) = curves_of(axes[0].figure)

    assert (panel.title, panel.x, panel.y) == ("A", "threshold", "error (mm)")
    assert [point[2:] for point in panel.series[0].points] == [
        ("0.1", "3.0 [2.5, 3.5]", ""), ("0.5", "2.0 [1.5, 2.5]", "")
    ]  # fmt: skip
    assert panel.series[0].parts == ["curve-0-0", "curve-0-0-0"]


def test_bars_are_intervals_of_both_coordinates(axes):
    """Those of other colours are of other curves."""
    axes[0].errorbar([1, 2], [3, 4], yerr=0.5, xerr=0.25, color="red", label="a")
    axes[0].errorbar([1, 2], [3, 4], yerr=2.5, color="blue", label="b")
    assert told(axes[0].figure) == {
        ("", "a"): [("1.00 [0.75, 1.25]", "3.0 [2.5, 3.5]", ""), ("2.00 [1.75, 2.25]", "4.0 [3.5, 4.5]", "")],
        ("", "b"): [("1", "3.0 [0.5, 5.5]", ""), ("2", "4.0 [1.5, 6.5]", "")],
    }


def test_panels_share_the_labels_of_their_key_and_axes(axes):
    """A line without a label has that of one that looks alike; others are no curves."""
    for panel in axes:
        panel.plot(X, X, "o--", color="red", label="a" if panel is axes[0] else None)
        panel.plot(X, X**2, color="red")
        panel.axhline(0.5, color="red", label="level")
        panel.set(xlim=(0, 1), ylim=(0, 1))
    axes[0].set(xlabel="x", ylabel="y")
    first, second = curves_of(axes[0].figure)
    assert [(one.x, one.y, [series.label for series in one.series]) for one in (first, second)] == [
        ("x", "y", ["a"])
    ] * 2


def test_a_figure_can_say_what_it_does_not_show(axes):
    (line,) = axes[0].plot(np.linspace(0, 1, 200), np.linspace(0, 1, 200), label="a")
    read_off(line, ["threshold 0.1", "threshold 0.9"], ["one", "two"], [0.0, 0.5], [0.1, 1.5], at=[0, 199])
    (beside,) = axes[0].plot([0.3], [0.42], label="beside")
    read_off(beside, y=["0.4"])
    assert told(axes[0].figure)["", "beside"] == [("0.3", "0.4", "")]
    assert told(axes[0].figure)["", "a"] == [
        ("one", "0.00 [0.00, 0.10]", "threshold 0.1"), ("two", "1.0 [0.5, 1.5]", "threshold 0.9")
    ]  # fmt: skip
    axes[1].plot(np.arange(1000), np.zeros(1000), label="long")
    assert len(told(axes[0].figure)["", "long"]) <= 100


def test_points_are_where_they_are_drawn():
    """Fractions from the upper left; numbers at an axis stand for their words."""
    figure, axes = new_figure(4.0, 2.0)
    axes[0, 0].set_position([0.25, 0.5, 0.5, 0.25])
    figure.set_layout_engine(None)
    axes[0, 0].plot([0, 1], [0, 10], label="a")
    axes[0, 0].set(xlim=(0, 1), ylim=(0, 10), yscale="linear", xticks=[0, 1], xticklabels=["rod", "ball"])
    (panel,) = curves_of(figure)
    assert panel.box == (0.25, 0.25, 0.75, 0.5)
    assert panel.series[0].points == [(0.25, 0.5, "rod", "0", ""), (0.75, 0.25, "ball", "10", "")]


def test_elements_of_a_curve_are_found_in_the_drawing(axes):
    for name, colour in (("active", "black"), ("passive", "red")):
        axes[0].plot(X, DATA["e"], label=name, color=colour)
        band(axes[0], X, DATA, "e", colour)
    drawing = drawing_of(axes[0].figure)
    parts = [part for panel in drawing.curves for series in panel.series for part in series.parts]
    assert len(parts) == len({*parts}) == 4
    assert all(f'id="{part}"'.encode() in drawing.svg for part in parts)


def test_a_band_is_no_interval_along_the_axis(axes):
    """Errors of 0 at several thresholds lie on one edge of it."""
    axes[0].plot(X, np.zeros(3), label="a", color="black")
    axes[0].fill_between(X, np.zeros(3), X, color="black", alpha=0.2)
    assert [point[0] for point in told(axes[0].figure)["", "a"]] == ["0.1", "0.5", "0.9"]


def test_points_that_a_panel_cuts_off_are_left_out(axes):
    """They would lie in its neighbour."""
    axes[0].plot([1, 2, 5], [0, 1, 0], label="a")
    axes[0].set(xlim=(0, 2), ylim=(0, 1))
    assert [point[0] for point in told(axes[0].figure)["", "a"]] == ["1", "2"]


def test_an_axis_that_shows_another_number_than_it_is_drawn_by_tells_that_one(axes):
    """As matplotlib does under the pointer."""
    axes[0].plot(1 - X, X, label="a")
    axes[0].fmt_xdata = lambda x: f"{1 - x:.3g}"

    assert [point[0] for point in told(axes[0].figure)["", "a"]] == ["0.1", "0.5", "0.9"]
