"""What figures of strategies show of intervals, of what is not known and of what lies beyond their axes."""

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from slow_cases import slow_but
from solidtouch.analysis.strategies.figures import curves, equal_taps, grouped, stopping, trajectories
from solidtouch.analysis.strategies.figures_trust import trust
from solidtouch.analysis.strategies.findings import FIXED, PAPER, TAPS
from solidtouch.analysis.strategies.run import BASE, STRATEGIES

ENDS = ("", "_low", "_high", "_least", "_most")
NAMES = ("passive", BASE, "info-what", "table")
GIVING_UP = "what, at 10 taps give up"


def known(name, value, low=None, high=None, least=None, most=None):
    """A quantity with its intervals, as a summary has it."""
    return {f"{name}{end}": x for end, x in zip(ENDS, (value, low, high, least, most), strict=True)}


def point(taps, error, high, given_up=0.0):
    """One level of a rule."""
    numbers = [known("what_error", error, 0.0, high), known("where_error", error / 5, 0.0, high / 5)]
    numbers += [known("given_up", given_up), known("taps", taps), known("way", taps - 1.0)]
    return {"level": 0.9} | {key: value for one in numbers for key, value in one.items()}


def told(factor, base_factor, excess=1.0):
    """A row of trust."""
    numbers = [
        known("factor", factor, 0.5, 2.0),
        known("base_factor", base_factor, 0.5, 2.0),
        known("gain", 0.1, 0.0, 0.2),
    ]
    numbers += [known("excess", excess, -500.0, 500.0), known("base_excess", 1.0, 0.5, 1.5)]
    return {"strategy": "info-what"} | {key: value for one in numbers for key, value in one.items()}


def null_decisions(source):
    """Their panel."""
    return next(axes for axes in stopping(source).axes if axes.get_title() == "null decisions")


@pytest.fixture
def source():
    """A summary of one kind of data with wide intervals."""
    line = [point(1.0, 2.0, 2.5), point(3.0, 0.5, 4.0)]
    rows = [
        {"strategy": name, "taps": taps} | known("what_error_difference", 0.2, -0.1, 0.5, -9.0, 0.6)
        for name in NAMES
        for taps in TAPS
    ]
    power = {
        "power": "J",
        "strategies": list(NAMES),
        "curves": {rule: dict.fromkeys(NAMES, line) for rule in (PAPER, FIXED, GIVING_UP)},
        "equal": {PAPER: rows, FIXED: [dict(row) for row in rows]},
        "trust": [told(1.5, 1.2)],
    }
    return {
        "name": "made up",
        "what_unit": "mm",
        "where_unit": "mm",
        "strategies": list(NAMES),
        "powers": [power],
        "grid": {"where_value": [0.5, 1.5, 2.5], "where_unit": "mm"},
        "fixation": 1,
        "paths": {name: [[0, 1, 1], [2, -1, -1], [1, 1, -1]] for name in NAMES},
    }


def texts(axes):
    """What is written in a panel."""
    return [text.get_text() for text in axes.texts]


def test_every_strategy_is_in_one_group():
    """The fixation point is in none, and an unknown one in the last."""
    groups = grouped([*STRATEGIES, "fixation:0.3"])
    assert sorted(name for names in groups.values() for name in names) == sorted({*STRATEGIES, "fixation:0.3"} - {BASE})
    assert "fixation:0.3" in list(groups.values())[-1]
    assert grouped([BASE]) == {"": []}


@pytest.mark.parametrize("draw", [curves, stopping])
def test_panels_hold_the_intervals_of_last_points(source, draw):
    """Nothing of them is cut off."""
    for axes in draw(source).axes:
        top = axes.get_ylim()[1]
        assert all(np.max(line.get_ydata()) <= top for line in axes.get_lines())


def test_very_long_intervals_have_arrowheads(source):
    """They do not squeeze the curves."""
    curve = [point(1.0, 2.0, 2.5), point(3.0, 0.5, 100.0)]
    source["powers"][0]["curves"][PAPER]["table"] = curve
    *_, panel = curves(source).axes[: len(grouped(NAMES))]
    assert panel.get_ylim()[1] < 10
    assert [tuple(head.get_offsets()[0])[1] for head in panel.collections] == [panel.get_ylim()[1]]


def test_only_rules_that_give_up_have_null_decisions(source):
    """The panel of them says if there are none."""
    assert "no rule with null decisions" in texts(null_decisions(source))
    source["powers"][0]["curves"][GIVING_UP] = {BASE: [point(2.0, 0.5, 1.0, given_up=0.3)]}
    panel = null_decisions(source)
    assert "no rule with null decisions" not in texts(panel)
    assert [line.get_ydata()[-1] for line in panel.get_lines()] == [0.3]


def test_differences_without_an_interval_are_hollow(source):
    """Filled are those that have one; what is not reached is said to be so."""
    found = source["powers"][0]["equal"][PAPER]
    rows = [row for row in found if row["taps"] == TAPS[0] and row["strategy"] != BASE]
    rows[0] |= known("what_error_difference", 0.2)
    rows[1] |= known("what_error_difference", None)
    figure = equal_taps(source)
    marks = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert [to_rgba(mark.get_markerfacecolor()) == to_rgba("white") for mark in marks] == [True, False]
    assert texts(figure.axes[0]) == [" not reached "]
    (legend,) = figure.legends
    assert any("no interval" in text.get_text() for text in legend.get_texts())


def test_cut_intervals_have_arrowheads(source):
    """Those that hold all together may go on beyond the panel, at the left here."""
    axes = equal_taps(source).axes[0]
    heads = [collection.get_offsets()[0] for collection in axes.collections]
    assert [x for x, _ in heads] == [pytest.approx(axes.get_xlim()[0])] * (len(NAMES) - 1)


def test_all_may_decide_with_the_first_tap(source):
    """Strokes and a count are left."""
    source["paths"] = {name: [[0, -1, -1], [2, -1, -1]] for name in NAMES}
    for axes in trajectories(source).axes[: len(NAMES)]:
        assert texts(axes) == ["decided: 2 at tap 1, 2 by tap 5"]


@pytest.mark.parametrize("number", slow_but([4, 7], [1, 4, 5, 7, 11]))
def test_the_lowest_panel_of_each_column_names_taps(source, number):
    """Whether or not the last row is full."""
    source["paths"] = {f"{BASE}:{i}": [[0, 1, 2], [2, 1, -1]] for i in range(number)}
    figure = trajectories(source)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == number
    for i, axes in enumerate(shown):
        lowest = i + len(figure.axes) // -(-number // 4) >= number
        assert axes.xaxis.get_tick_params()["labelbottom"] == lowest


def test_trust_beyond_its_axes_is_hollow_at_their_ends(source):
    """A miscalibration that is not known is counted."""
    source["powers"] = [{"power": "J", "trust": [told(None, 2e8)]}, {"power": "none", "trust": [told(1.0, 1.0)]}]
    gain, factor, excess = trust([source]).axes
    beyond, inside = [line for line in gain.get_lines() if line.get_marker() in {"o", "s"}]
    assert beyond.get_xdata()[0] == pytest.approx(gain.get_xlim()[1])
    assert to_rgba(beyond.get_markerfacecolor()) == to_rgba("white")
    assert to_rgba(inside.get_markerfacecolor()) != to_rgba("white")
    assert texts(factor) == ["undefined: 1"]
    assert not texts(excess)
    assert len(excess.collections) == 2 * (2 + 2), "two lines and two arrowheads for each"
