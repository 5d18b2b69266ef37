"""Figures of how models predict taps."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.compare import figures_taps as figures

NAMES = np.array(["histogram", "profile", "session:matrix-normal"])


def with_bounds(name: str) -> dict[str, tuple[str, np.ndarray]]:
    """A quantity of three models with intervals and differences."""
    values = np.array([-10.0, -8.0, -9.0])
    parts = {"": values, "_low": values - 1, "_high": values + 1}
    differences = {f"_difference{end}": part - part[0] for end, part in parts.items()}
    return {f"{name}{end}": ("model", part) for end, part in {**parts, **differences}.items()}


def test_every_model_is_a_row_of_groups_left_out():
    """Labels are the models' names, and the x axis says what is compared in which unit."""
    means = xr.Dataset(
        {**with_bounds("integrated"), **with_bounds("plug_in")}, {"model": NAMES}, {"reference": "histogram"}
    )
    (axes,) = figures.groups_left_out(means).axes
    assert [label.get_text() for label in axes.get_yticklabels()] == NAMES.tolist()
    assert axes.get_xlabel() == "log probability per tap − that of histogram (nat)"


def test_missing_estimates_leave_their_row_empty():
    """A model without a posterior has one dot, not none and not an error."""
    means = xr.Dataset(
        {**with_bounds("integrated"), **with_bounds("plug_in")}, {"model": NAMES}, {"reference": "histogram"}
    )
    means["integrated_difference"][1] = np.nan
    (axes,) = figures.groups_left_out(means).axes
    assert len([line for line in axes.lines if line.get_marker() == "o" and len(line.get_xdata())]) == 5


def test_pareto_k_says_how_many_taps_cannot_be_left_out():
    """The share above .7 of the taps looked at stands beside each row, or that no tap has a Pareto k."""
    k = np.stack(
        [np.linspace(0, 0.6, 20), np.append(np.linspace(0, 1.4, 10), np.full(10, np.nan)), np.full(20, np.nan)]
    )
    looked_at = np.stack([np.full(20, True), np.arange(20) < 10, np.full(20, True)])
    pair = ("model", "tap")
    left_out = xr.Dataset({"pareto_k": (pair, k), "looked_at": (pair, looked_at), "good_k": 0.7}, {"model": NAMES})
    (axes,) = figures.pareto(left_out).axes
    assert [text.get_text() for text in axes.texts] == ["0% of 20 above 0.7", "50% of 10 above 0.7", "no Pareto k"]


@pytest.mark.parametrize("statistics", [1, 4])
def test_checks_show_what_was_observed_within_the_axes(statistics):
    """The line of the observed value is visible however far the replicates are."""
    generator = np.random.default_rng(0)
    checks = xr.Dataset(
        {
            "observed": ("statistic", np.linspace(1, 50, statistics)),
            "replicated": (("model", "statistic", "replicate"), generator.normal(size=(3, statistics, 7))),
            "label": ("statistic", np.array([f"label {i}" for i in range(statistics)])),
        },
        {"model": NAMES, "statistic": np.array([f"s{i}" for i in range(statistics)])},
    )
    shown = [axes for axes in figures.predictive_checks(checks).axes if axes.get_visible()]
    assert len(shown) == statistics
    for axes, observed in zip(shown, checks["observed"].values, strict=True):
        low, high = axes.get_xlim()
        assert low < observed < high
