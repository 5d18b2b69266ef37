"""Figures of reliability, promises and wanted errors are drawn from small data, plain and awkward."""

from functools import cache

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.audit import figures_reliability as figure_reliability
from solidtouch.analysis.audit.guarantees import guarantees
from solidtouch.analysis.page.figure_curves import curves_of
from solidtouch.analysis.page.figure_style import save
from solidtouch.analysis.stats.reliability import EVERYTHING, reliability
from solidtouch.analysis.stats.target_error import Curves, TargetError, choose, leave_out, predicted
from solidtouch.inference.trials.records import TapTable
from solidtouch.models.grid import ClassGrid, tap_pool


def make(L=5, M=3, skill=1.0, scale=1.0):
    """A grid and a table."""
    rng = np.random.default_rng(0)
    where, what, _ = (index.ravel() for index in np.indices((L, M, 4)))
    log_likelihood = rng.normal(size=(len(where), L, M))
    log_likelihood[np.arange(len(where)), where, what] += skill
    names = tuple((f"rod {m}",) for m in range(M))
    table = TapTable(scale * log_likelihood, tap_pool(where, what, (L, M)), np.full((L, M), -np.log(L * M)))
    return ClassGrid(np.arange(float(L)), "mm", None, names), table


CASES = {
    "plain": make(),
    "never wrong": make(skill=9.0),
    "no doubt": make(skill=9.0, scale=300.0),
    "wrong without a doubt": make(scale=1e6),
    "one place": make(L=1),
    "one object": make(M=1),
    "many objects": make(M=14),
}


def wanted(error, target):
    error = np.asarray(error, dtype=np.float64)
    theta = 1 - np.geomspace(0.5, 1e-6, error.shape[1])
    curves = Curves(theta, error, error[..., np.newaxis], 1 + 20 * np.arange(error.size).reshape(error.shape), error)
    h, reachable = choose(error, target)
    at = predicted(curves, h)
    return TargetError(
        target, reachable, at, predicted(curves, 2), leave_out(curves, target), curves, ("one",), "active"
    )


@pytest.mark.parametrize("case", slow_but(("plain", "one place"), CASES))
def test_figures_are_drawn(case):
    """With a panel for each policy, without a warning."""
    grid, table = CASES[case]
    data = reliability(table, grid, (0.5, 0.9, 0.99), 0, trials=120, contacts=(1, 3, 7), resamples=20)
    promises = guarantees(table, table, grid, (0.5, 0.9), 0, trials=120, resamples=20)
    panels = 1 if "one" in case else 2

    figures = (
        (figure_reliability.reliability_after_taps(data), 3),
        (figure_reliability.reliability_at_stopping(data), panels),
        (figure_reliability.guarantee_factors(promises), panels),
    )
    for figure, count in figures:
        assert len(figure.axes) == count
        if case not in ("plain", "many objects"):  # the others have no more text, and laying it out takes longest
            figure.set_layout_engine("none")
        figure.draw_without_rendering()


def test_an_infinite_factor_is_a_mark_at_the_top():
    """After each number of taps at which decisions are wrong that leave no doubt."""
    grid, table = CASES["wrong without a doubt"]
    data = reliability(table, grid, (0.9,), 0, trials=120, contacts=(1, 3), resamples=20)
    axes = figure_reliability.reliability_after_taps(data).axes[2]
    (mark,) = (line for line in axes.get_lines() if line.get_marker() == "^")

    assert np.isinf(data["factor"].sel(what=EVERYTHING, counted="all")[-2:]).all()
    assert mark.get_xdata().tolist() == [1, 3]
    assert (mark.get_ydata() == axes.get_ylim()[1]).all()


@cache
def plain_reliability():
    """After 1, 2 and 3 taps; tests put factors of their own into it."""
    grid, table = CASES["plain"]
    return reliability(table, grid, (0.9,), 0, trials=120, contacts=(1, 2, 3), resamples=5)


def factor_panel(factor, low, high):
    """The figure after taps, and its panel of factors, for these factors after 1, 2 and 3 taps."""
    data = plain_reliability()
    ends = {"": factor, "_low": low, "_high": high}
    values = {f"factor{end}": data["factor"].copy() for end in ends}
    for end, value in ends.items():
        values[f"factor{end}"][(data["contacts"] > 0).values] = np.reshape(value, (3, 1, 1))
    figure = figure_reliability.reliability_after_taps(data.assign(values))
    figure.draw_without_rendering()
    return figure, figure.axes[2]


def key(figure):
    """What stands below a figure."""
    return [text.get_text() for text in figure.legends[0].get_texts()]


def marks(axes, marker):
    """Taps and factors that this marker stands at."""
    return [point for line in axes.get_lines() if line.get_marker() == marker for point in line.get_xydata().tolist()]


@pytest.mark.parametrize(("factor", "zeros"), [([0, 0, 0], [1, 2, 3]), ([2, 0, np.nan], [2]), ([0.03, 1, 2], [])])
def test_a_factor_of_0_is_an_open_mark_at_the_lower_end(factor, zeros):
    """On an axis that says so, with its interval, and the key tells why; others that are small lie on the axis."""
    figure, axes = factor_panel(factor, [0, 0, 0], [3, 0.5, np.inf])
    low, high = axes.get_ylim()
    ticks = [label.get_text() for label in axes.get_yticklabels() if low <= label.get_position()[1] <= high]
    bars = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])

    assert marks(axes, "v") == [[taps, 0.01] for taps in zeros]
    assert ("C: 0: no wrong decision" in key(figure)) == bool(zeros)
    assert ("0.01 or less" in ticks) == bool(zeros)
    assert "1" in ticks
    assert low < np.nanmin(np.maximum(factor, 0.01))
    assert 3 < high < 5
    assert bars[:, 1].min() == pytest.approx(0.01)


def test_a_factor_without_an_interval_has_no_bar():
    """Its ends are unknown, not beyond the axis."""
    _, axes = factor_panel([2.0, 1.0, 0.5], [np.nan] * 3, [np.nan] * 3)
    bars = np.concatenate([path.vertices for path in axes.collections[0].get_paths()])

    np.testing.assert_allclose(np.unique(bars[:, 1]), [0.5, 1.0, 2.0])


@pytest.mark.parametrize("large", [1e7, np.inf])
def test_an_axis_of_factors_ends_where_their_size_says_nothing(large):
    """What is beyond is a mark at the top with its interval, and numbers stand on the axis."""
    figure, axes = factor_panel([2, 4, large], [1, 3, 3], [3, 9, 1e14])
    low, high = axes.get_ylim()

    assert high < 20
    assert marks(axes, "^") == [[3, high]]
    assert key(figure)[-1] == "C: over 1000"
    assert axes.collections[-1].get_paths()[0].vertices.tolist() == [[3, 3], [3, high]]
    assert sum(low <= tick <= high for tick in axes.get_yticks()) > 3


def test_a_wide_axis_of_factors_has_a_few_numbers():
    """Which stay apart over five orders of magnitude."""
    _, axes = factor_panel([0, 1, 900], [0, 0.9, 10], [1, 2, 950])
    low, high = axes.get_ylim()

    assert 3 <= sum(low <= tick <= high for tick in axes.get_yticks()) <= 7


def test_where_no_factor_is_known_the_panel_says_why():
    """Without marks."""
    _, axes = factor_panel(*np.full((3, 3), np.nan))

    assert [text.get_text() for text in axes.texts] == ["no errors and no doubt"]
    assert not marks(axes, "v")


def test_the_wrong_fraction_of_each_object_has_a_line():
    """With its values, those of none at the lower end."""
    grid, table = make()
    data = reliability(table, grid, (0.5, 0.9, 0.99), 0, trials=120, contacts=(), resamples=5)
    axes = figure_reliability.reliability_at_stopping(data).axes[0]
    lines = {line.get_label(): line for line in axes.get_lines()}

    assert {"rod 0", "rod 1", "rod 2", EVERYTHING, "1 − belief", "1 − threshold"} <= set(lines)
    stopping = data.isel(setting=slice(0, 3)).sel(counted="stopped", what=EVERYTHING)
    np.testing.assert_allclose(lines[EVERYTHING].get_ydata(), np.maximum(stopping.wrong, 1e-4))
    np.testing.assert_allclose(lines["1 − belief"].get_ydata(), stopping.doubt)
    assert axes.get_yticklabels()[0].get_text() == "0.0001 or less"


def test_curves_against_the_threshold_are_told_by_the_threshold():
    """Not by the distance from 1 along which they are drawn."""
    grid, table = make()
    data = reliability(table, grid, (0.5, 0.9, 0.99), 0, trials=120, contacts=(), resamples=5)
    figures = (
        figure_reliability.reliability_at_stopping(data),
        figure_reliability.wanted_error(wanted(np.zeros((5, 7)), 0.2)),
    )
    stopping, tuning = (
        {one.label: [point[2] for point in one.points] for panel in curves_of(figure)[:1] for one in panel.series}
        for figure in figures
    )

    assert stopping["1 − threshold"] == stopping[EVERYTHING] == ["0.5", "0.9", "0.99"]
    assert all(float(text) >= 0.5 for texts in tuning.values() for text in texts)
    promises = guarantees(table, table, grid, (0.5, 0.9), 0, trials=120, resamples=20)
    (panel, *_) = curves_of(figure_reliability.guarantee_factors(promises))
    assert {point[2] for one in panel.series for point in one.points} == {"0.5", "0.9"}


@pytest.mark.parametrize(
    ("error", "target", "label"),
    [
        (np.zeros((5, 7)), 0.2, "chosen"),
        (np.full((6, 7), 0.5) + 0.1 * np.arange(6)[:, None], 0.2, "lowest; the target is not reachable"),
    ],
)
def test_the_chosen_threshold_is_marked(error, target, label, tmp_path):
    """And called what it is."""
    result = wanted(np.clip(error, 0, 1), target)
    figure = figure_reliability.wanted_error(result)
    marks = {line.get_label(): line for line in figure.axes[0].get_lines()}

    assert marks[label].get_xdata()[0] == pytest.approx(1 - result.chosen.theta)
    assert marks[label].get_ydata()[0] == result.chosen.error
    assert len(marks["left out, tuned on the others"].get_xdata()) == len(error)
    for path in save(figure, tmp_path, "wanted"):
        assert path.stat().st_size > 5000


def test_factors_of_promises_lie_on_the_axis_where_there_is_no_interval():
    """None at the lower end, a large one below the upper."""
    grid, table = make()
    promises = guarantees(table, table, grid, (0.5, 0.9), 0, trials=120, resamples=20)
    unknown = promises.assign({f"factor_{end}": promises["factor"] * np.nan for end in ("low", "high")})
    for value in (0.0, 7.0):
        axes = figure_reliability.guarantee_factors(unknown.assign(factor=0 * promises["factor"] + value)).axes[0]
        low, high = axes.get_ylim()
        drawn = np.concatenate([line.get_ydata() for line in axes.get_lines() if line.get_marker() in ("o", "s", "D")])
        assert len(drawn) > 4
        assert ((low < drawn) & (drawn < high)).all()
