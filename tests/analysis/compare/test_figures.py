"""Figures that compare models, drawn from small made-up datasets."""

from functools import cache

import numpy as np
import pytest
import xarray as xr
from slow_cases import slow_but
from solidtouch.analysis.compare import figures as figure_compare
from solidtouch.analysis.compare import figures_decisions
from solidtouch.analysis.compare.classes import CALIBRATIONS
from solidtouch.analysis.compare.classes import MEANS as SCORES
from solidtouch.analysis.page.figure_sizes import new_figure
from solidtouch.analysis.page.figure_style import save
from solidtouch.models.grid import ClassGrid

NAMES = [f"model {i}" for i in range(10)]


def class_grid(L=4, M=3):
    names = tuple((f"{m} mm rod",) for m in range(M))
    return ClassGrid(np.arange(L) + 0.5, "mm", None, names, 4.0 + np.arange(M), "mm")


def filled(names, dims, coords, models, units):
    rng = np.random.default_rng(0)
    data = xr.Dataset(coords={"model": models, **coords}, attrs={"reference": models[0]})
    shape = tuple(data.sizes[dim] for dim in dims)
    for name in names:
        value = rng.uniform(0.2, 0.8, shape)
        if name.startswith("log_score"):
            value = -value
        for label, middle in ((name, value), (f"{name}_difference", value - value[:1])):
            for suffix, change in (("", 0.0), ("_low", -0.1), ("_high", 0.15)):
                data[label + suffix] = (dims, middle + change, {"units": units(name)})
    return data


def scores(models=NAMES[:3], contacts=(1, 2, 5, 10)):
    coords = {"contacts": list(contacts)}
    return filled(
        [*SCORES, *CALIBRATIONS],
        ("model", "contacts"),
        coords,
        models,
        lambda name: "nat" if name.startswith("log_score") else "",
    )


def decisions(models=NAMES[:3], dim="theta", values=(0.5, 0.9, 0.95, 0.99), policies=("passive", "active")):
    coords = {"policy": list(policies), dim: list(values)}
    names = ["what_error", "where_error", "what_wrong", "miscalibration"]
    data = filled(names, ("model", "policy", dim), coords, models, lambda name: "mm" if "error" in name else "")
    if dim == "theta":
        shape = len(models), len(policies), 1
        first = 1 + np.arange(np.prod(shape)).reshape(shape)
        data["taps"] = (("model", "policy", dim), first + np.array([0.0, 1.0, 4.0, 9.0])[: len(values)])
    return data


def equal(**changes):
    return decisions(dim="taps", values=changes.pop("values", (1.0, 2.0, 5.0)), **changes)


def endless():
    data = scores()
    data["log_score_joint"][1, 2] = -np.inf
    data["log_score_joint_low"][1, 2:] = -np.inf
    data["log_score_joint_difference"][1, 2] = -np.inf
    data["log_score_joint_difference"][2, 0] = np.inf
    return data


CASES = {
    "scores": lambda: figure_compare.class_scores(scores(), class_grid()),
    "scores, ten models": lambda: figure_compare.class_scores(scores(NAMES), class_grid()),
    "scores, one model": lambda: figure_compare.class_scores(scores(NAMES[:1], (1,)), class_grid()),
    "scores, one where": lambda: figure_compare.class_scores(scores(), class_grid(L=1)),
    "scores, one what": lambda: figure_compare.class_scores(scores(), class_grid(M=1)),
    "scores, endless": lambda: figure_compare.class_scores(endless(), class_grid()),
    "score differences": lambda: figure_compare.class_differences(scores(), class_grid()),
    "score differences, endless": lambda: figure_compare.class_differences(endless(), class_grid()),
    "score differences, one model": lambda: figure_compare.class_differences(scores(NAMES[:1]), class_grid()),
    "curves": lambda: figures_decisions.decision_curves(decisions(), class_grid()),
    "curves, ten models": lambda: figures_decisions.decision_curves(decisions(NAMES), class_grid()),
    "curves, one threshold": lambda: figures_decisions.decision_curves(decisions(values=(0.9,)), class_grid()),
    "curves, passive": lambda: figures_decisions.decision_curves(decisions(policies=("passive",)), class_grid(L=1)),
    "differences": lambda: figure_compare.decision_differences(equal(), class_grid()),
    "differences, no time": lambda: figure_compare.decision_differences(equal(values=()), class_grid()),
    "miscalibration": lambda: figures_decisions.miscalibration(decisions()),
}


@cache
def drawn(name):
    """The figure of a case, which tests only read."""
    return CASES[name]()


def panels(figure):
    return [axes for axes in figure.axes if axes.get_visible()]


EACH = "scores, endless", "score differences", "curves", "differences", "miscalibration"
"""A case of each figure, as dense as most."""


@pytest.mark.parametrize("name", slow_but(EACH, CASES))
def test_nothing_overlaps(name):
    """Panels with their labels and the key below them stand apart, within the figure, and draw without a warning."""
    figure = drawn(name)
    figure.draw_without_rendering()
    boxes = [part.get_tightbbox() for part in (*panels(figure), *figure.legends)]

    for i, box in enumerate(boxes):
        assert box.x0 >= -1
        assert box.x1 <= figure.bbox.x1 + 1
        assert not any(box.shrunk(0.98, 0.98).overlaps(other) for other in boxes[i + 1 :])


@pytest.mark.slow
def test_a_figure_of_ten_models_is_written(tmp_path):
    """Small enough to be mailed."""
    (svg,) = save(drawn("curves, ten models"), tmp_path, "figure")

    assert svg.stat().st_size < 1_500_000


def test_eleven_models_look_different():
    """In colour, and in marker and line together; the reference is grey wherever it stands."""
    styles = figure_compare.model_styles([*NAMES, "reference"], "reference")

    assert len({style["color"] for style in styles.values()}) == 11
    assert len({style["marker"] for style in styles.values()}) == 11
    assert styles["reference"]["color"] == "#949494"
    assert figure_compare.model_styles([f"m{i}" for i in range(40)], "m0").keys() == {f"m{i}" for i in range(40)}


def test_models_look_the_same_with_and_without_the_reference():
    """Differences leave it out, and colours stay."""
    scores, differences = panels(drawn("scores"))[0], panels(drawn("differences"))[0]
    colours = {bars.get_label(): bars.lines[0].get_color() for bars in scores.containers}

    assert list(colours) == NAMES[:3]
    assert {bars.get_label(): bars.lines[0].get_color() for bars in differences.containers} == {
        name: colours[name] for name in NAMES[1:3]
    }


def test_class_scores_have_a_panel_for_each_question():
    """With units, the level of guessing, and a line of every model through its values."""
    data = scores()
    figure = figure_compare.class_scores(data, class_grid())
    labels = [axes.get_ylabel() for axes in panels(figure)]

    assert labels == [
        "log score, class (nat)",
        "Brier score, class",
        "fraction correct, position",
        "log score, object (nat)",
        "calibration error, object",
        "fraction correct, object",
    ]
    assert {axes.get_xlabel() for axes in panels(figure)} == {"taps"}
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [*NAMES[:3], "chance"]
    last = panels(figure)[5]
    for i, bars in enumerate(last.containers):
        np.testing.assert_allclose(bars.lines[0].get_ydata(), data.accuracy_what[i])
        low, high = np.array([segment[:, 1] for segment in bars.lines[2][0].get_segments()]).T
        np.testing.assert_allclose(low, data.accuracy_what_low[i])
        np.testing.assert_allclose(high, data.accuracy_what_high[i])
    assert [line.get_ydata()[0] for line in last.lines if line.get_label() == "chance"] == [1 / 3]
    chance = [axes.lines for axes in panels(figure)[:2]]
    levels = [next(line.get_ydata()[0] for line in lines if line.get_label() == "chance") for lines in chance]
    np.testing.assert_allclose(levels, [-np.log(12), 1 - 1 / 12])


def test_models_stand_beside_each_other():
    """At one number of contacts no two share a place, and their middle is at the number."""
    axes = panels(drawn("scores"))[0]
    x = np.array([bars.lines[0].get_xdata() for bars in axes.containers])

    assert (np.diff(x, axis=0) > 0).all()
    np.testing.assert_allclose(x[1], [1, 2, 5, 10])
    assert x[2, 0] < x[0, 1]


@pytest.mark.parametrize(("shape", "expected"), [((1, 3), "object"), ((4, 1), "position")])
def test_one_where_or_what_class_leaves_the_other_question(shape, expected):
    """Four panels instead of six."""
    labels = [axes.get_ylabel() for axes in panels(figure_compare.class_scores(scores(), class_grid(*shape)))]

    assert len(labels) == 4
    assert sum(expected in label for label in labels) >= 2
    assert not any({"object": "position", "position": "object"}[expected] in label for label in labels)


def triangles(axes, edge):
    return [
        (line.get_color(), round(float(line.get_xdata()[0]), 1))
        for line in axes.lines
        if line.get_transform() == axes.get_xaxis_transform()
        and line.get_ydata()[0] == edge
        and line.get_marker() in "v^"
    ]


def test_endless_scores_are_triangles_at_the_edge():
    """In the model's colour and at its place; nothing else is drawn there."""
    figure = drawn("scores, endless")
    colour = figure_compare.model_styles(NAMES[:3], NAMES[0])[NAMES[1]]["color"]
    first = panels(figure)[0]

    assert triangles(first, 0) == [(colour, 5.0)]
    assert len(first.containers[1].lines[0].get_xdata()) == 3
    assert not triangles(panels(figure)[3], 0)
    assert [len(triangles(panels(drawn("score differences, endless"))[0], edge)) for edge in (0, 1)] == [1, 1]


def test_scores_far_below_guessing_do_not_flatten_the_others():
    """They leave the axes and are triangles at the edge."""
    data = scores()
    data["log_score_joint"][2] = -500.0
    first = panels(figure_compare.class_scores(data, class_grid()))[0]

    assert len(triangles(first, 0)) == 4
    assert first.get_ylim()[0] == pytest.approx(-1.5 * np.log(12))
    assert first.get_ylim()[1] <= 0


def test_scores_of_a_single_class_are_drawn():
    """They are zero, as guessing is; what matplotlib warns of would fail the test."""
    data = scores()
    for name in ("log_score_joint", *(f"log_score_joint_{end}" for end in ("low", "high"))):
        data[name][:] = 0.0
    first = panels(figure_compare.class_scores(data, class_grid(1, 1)))[0]
    assert first.get_ylim()[0] < 0 < first.get_ylim()[1]


def test_curves_pass_through_the_thresholds_and_are_linear_in_time():
    """Halfway between two thresholds in taps the line is halfway between their errors, and so is the band."""
    data = decisions()
    _, axes = new_figure(3, 3)
    panel = figures_decisions.plot_errors(axes[0, 0], data, "where_error", NAMES[1])
    part = data.sel(model=NAMES[1], policy="active")
    line = next(line for line in panel.lines if line.get_label() == "active")

    np.testing.assert_allclose(line.get_xdata()[line.get_markevery()], part.taps)
    np.testing.assert_allclose(line.get_ydata()[line.get_markevery()], part.where_error)
    between = np.interp(line.get_xdata(), part.taps, part.where_error)
    np.testing.assert_allclose(line.get_ydata(), between)
    assert len(line.get_xdata()) > 50
    assert len(panel.collections) == 2
    assert panel.get_ylim()[0] == 0.0


def test_the_reference_is_behind_every_other_model():
    """In grey without a band, both policies; where it is the only model, it has a panel of its own."""
    _, axes = new_figure(3, 3)
    panel = figures_decisions.plot_errors(axes[0, 0], decisions(), "what_error", NAMES[2])
    behind = {line.get_label(): line for line in panel.lines if line.get_color() == "#949494"}

    assert list(behind) == [f"{NAMES[0]}, passive", f"{NAMES[0]}, active"]
    assert len({line.get_linestyle() for line in behind.values()}) == 2
    alone = figures_decisions.decision_curves(decisions(NAMES[:1]), class_grid())
    assert [axes.get_title() for axes in panels(alone)] == [NAMES[0]] * 2


def test_wide_bands_of_errors_do_not_flatten_the_lines():
    """The axis of an error ends just above the largest of all models, however wide the bands are."""
    data = decisions()
    data["where_error_high"][:] = 50.0
    data["what_error"][:] = 0.0
    axes = panels(figures_decisions.decision_curves(data, class_grid()))

    assert [panel.get_ylim()[1] for panel in axes[2:]] == pytest.approx([1.15 * float(data["where_error"].max())] * 2)
    assert axes[0].get_ylim()[1] > 0


def test_decisions_have_a_panel_for_each_error_and_model():
    """Where nothing is elsewhere, one error; the label of an error stands left of its rows."""
    whole, passive = panels(drawn("curves")), panels(drawn("curves, passive"))

    assert [axes.get_title(loc="left") for axes in whole] == ["A", "B", "C", "D"]
    assert [axes.get_title() for axes in whole] == NAMES[1:3] * 2
    assert [axes.get_ylabel().split(" (")[0] for axes in whole] == ["object error", "", "position error", ""]
    assert drawn("curves").get_supxlabel() == "mean reaction time (taps)"
    assert [axes.get_ylabel() for axes in passive] == ["object error (mm)", ""]


def test_differences_are_dots_around_a_line_at_zero():
    """Of every model but the reference, which the axis names."""
    data = equal()
    panel = panels(figure_compare.decision_differences(data, class_grid()))[3]

    assert panel.get_ylabel() == "position error (mm)\n− that of model 0"
    assert len(panel.containers) == 2
    assert panel.containers[0].lines[0].get_linestyle() == "None"
    np.testing.assert_allclose(
        panel.containers[1].lines[0].get_ydata(), data.where_error_difference.sel(model=NAMES[2], policy="active")
    )
    assert any(set(line.get_ydata()) == {0} for line in panel.lines)


def test_missing_times_are_left_out_and_none_at_all_is_said():
    """NaN draws nothing; an empty comparison draws a sentence."""
    data = equal()
    data["what_error_difference"][1, 0, 2] = np.nan
    _, axes = new_figure(3, 3)
    panel = figure_compare.plot_differences(axes[0, 0], data, "what_error", "passive")

    assert [len(bars.lines[0].get_xdata()) for bars in panel.containers] == [2, 3]
    for empty in panels(drawn("differences, no time")):
        assert [text.get_text() for text in empty.texts] == ["no common reaction time"]


def test_miscalibration_has_a_line_where_beliefs_are_right():
    """On a logarithmic scale, at one."""
    left, right = panels(drawn("miscalibration"))

    assert left.get_yscale() == right.get_yscale() == "log"
    assert set(left.lines[0].get_ydata()) == {1}
    assert (drawn("miscalibration").get_supxlabel(), left.get_ylabel()) == (
        "belief threshold",
        "wrong / mean (1 − belief)",
    )


def test_tick_labels_have_room():
    """Of many numbers of contacts only some are labelled, the first among them."""
    many = figure_compare.class_scores(scores(contacts=range(1, 31)), class_grid())
    ticks = panels(many)[0].get_xticks()

    assert ticks[0] == 1
    assert 5 <= len(ticks) <= 16
    assert (np.diff(np.log(ticks)) > np.log(30) / 15).all()
