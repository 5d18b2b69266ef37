"""Figures of a sensitivity study."""

from itertools import pairwise

import numpy as np
import pytest
from solidtouch.analysis.page.figure_sizes import TWO_COLUMNS, new_figure
from solidtouch.analysis.page.figure_style import styled
from solidtouch.analysis.sensitivity.figures import plot_forest


@styled
def four_panels(name, reach):
    """A forest plot of one option, in the smallest panels of the study."""
    figure, axes = new_figure(TWO_COLUMNS, 1.5, 1, 4)
    ends = {f"{name}_low": 1 / reach, f"{name}_high": reach}
    row = {"verdict": "nothing", name: 1.0, f"{name}_least": None, f"{name}_most": None, **ends}
    for panel in axes[0]:
        plot_forest(panel, [("option", row)], name, 0.2)
    return figure


@pytest.mark.parametrize("name", ["active_taps", "active_factor"])
@pytest.mark.parametrize("reach", [1.5, 20.0, 1663.0, 1e12])
def test_labels_of_ticks_leave_room_for_each_other(name, reach):
    """However far intervals reach: no two labels of an axis touch, and no change has one."""
    figure = four_panels(name, reach)
    figure.canvas.draw()

    for axes in figure.axes:
        labels = [label for label in axes.get_xticklabels() if label.get_text()]
        boxes = sorted((label.get_window_extent() for label in labels), key=lambda box: box.x0)
        assert all(left.x1 < right.x0 for left, right in pairwise(boxes))
        assert (1.0 if name.endswith("factor") else 0.0) in np.asarray(axes.get_xticks())
