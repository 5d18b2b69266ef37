"""The figures of a report."""

import re
import sys

import numpy as np
import pytest
import xarray as xr
from slow_cases import slow_but
from solidtouch.analysis.page.figure_confusion import confusion, row_normalised
from solidtouch.analysis.page.figure_curves import curves_of
from solidtouch.analysis.page.figure_episodes import BeliefCase, beliefs, trajectories
from solidtouch.analysis.page.figure_style import axis_label, save, short_unit
from solidtouch.analysis.reproduce import figures
from solidtouch.analysis.reproduce.figure_taps import pressure
from solidtouch.models.errors import InputError
from solidtouch.models.grid import ClassGrid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

LONG_UNIT = "encoder counts, 4th position column; ~1240 counts/step"
THETA = np.array([0.1, 0.5, 0.95])


def class_grid(L=4, M=3, where_unit="mm", sized=True):
    where = np.cumsum(1 + np.arange(L) % 3) - 0.5
    names = tuple((f"{4 + 2 * m} mm rod",) for m in range(M))
    value = 4.0 + 2 * np.arange(M) if sized else None
    return ClassGrid(where, where_unit, None, names, value, "mm" if sized else "")


def tap_set(N=30, J=5, K=7, L=4, *, edges=True, layout=True, where_unit="mm", seed=0):
    rng = np.random.default_rng(seed)
    where = rng.integers(0, L, N) + 0.5
    where[:L] = np.arange(L) + 0.5
    return TapSet.from_arrays(
        rng.normal(size=(N, J, K)),
        np.arange(N) % 2,
        ["4 mm rod", "6 mm rod", "never touched"],
        preprocessing=Preprocessing(J, 50.0),
        where=where,
        where_edges=np.arange(L + 1.0) if edges else None,
        where_unit=where_unit,
        taxel_position=rng.normal(size=(K, 3)) * (3, 1, 9) if layout else None,
        units="counts",
    )


def curves(theta=THETA, place=None, *, what_unit="mm", where_unit="mm", holes=False):
    coords = {"theta": np.asarray(theta)}
    if place is not None:
        coords = {"place": np.asarray(place, dtype=float), **coords}
    shape = tuple(len(values) for values in coords.values())
    middle = 1 + np.arange(np.prod(shape), dtype=float).reshape(shape)
    if holes:
        middle[..., 0] = np.nan
    data = xr.Dataset(coords=coords, attrs={"what_unit": what_unit, "where_unit": where_unit})
    for name in ("what_error", "where_error", "taps"):
        for suffix, change in (("", 0), ("_low", -0.3), ("_high", 0.4)):
            data[name + suffix] = (tuple(coords), middle + change)
    if place is not None:
        data["place"].attrs["units"] = where_unit
    return data


def case(T=6, L=4, M=3, where=1, what=2, winner=(1, 2)):
    belief = np.full((T, L, M), 0.1)
    belief[(slice(None), *winner)] = np.linspace(0.2, 3, T)
    return BeliefCase(belief / belief.sum(axis=(1, 2), keepdims=True), np.full((L, M), 1 / (L * M)), where, what)


def walks(n=9, T=5, L=4):
    index = np.arange(n)[:, np.newaxis] % L * np.ones((1, T + 1), dtype=int)
    index[np.arange(T + 1) > 1 + np.arange(n)[:, np.newaxis] % T] = -1
    return index


def contact_curves(n=(1, 2, 5)):
    accuracy = xr.Dataset(coords={"contacts": np.asarray(n)})
    for name in ("joint", "where", "what"):
        for suffix, change in (("", 0.5), ("_low", 0.4), ("_high", 0.6)):
            accuracy[name + suffix] = ("contacts", np.full(len(n), change))
    return accuracy


CASES = {
    "pressure": lambda: pressure(tap_set(), 0),
    "pressure without layout": lambda: pressure(tap_set(layout=False, edges=False), 1),
    "pressure of 66 taxels": lambda: pressure(tap_set(K=66, layout=False), 1),
    "pressure of 66 placed taxels": lambda: pressure(tap_set(K=66), 1),
    "pressure at one position": lambda: pressure(tap_set(L=1, edges=False, J=1), 0),
    "pressure of many taps": lambda: pressure(tap_set(N=9610, J=1, K=15, L=31, layout=False), 0),
    "beliefs": lambda: beliefs(case(), case(T=9, winner=(2, 0)), class_grid()),
    "beliefs of one class": lambda: beliefs(case(1, 1, 1, 0, 0, (0, 0)), case(2, 1, 1, 0, 0, (0, 0)), class_grid(1, 1)),
    "beliefs of 31 x 31": lambda: beliefs(
        case(20, 31, 31), case(20, 31, 31, winner=(2, 0)), class_grid(31, 31, LONG_UNIT)
    ),
    "by position": lambda: figures.errors_by_position(curves(place=[1, 2, 5, 6, 9])),
    "by position, one place": lambda: figures.errors_by_position(curves(place=[3.5])),
    "by position, 31 places, 20 thresholds": lambda: figures.errors_by_position(
        curves(np.linspace(0.1, 0.995, 20), np.arange(31))
    ),
    "by fixation, one threshold": lambda: figures.errors_by_fixation(curves([0.95], [1, 2, 4])),
    "by fixation, holes": lambda: figures.errors_by_fixation(
        curves(place=[1, 2, 5, 6], holes=True, what_unit="P(wrong)", where_unit=LONG_UNIT)
    ),
    "trajectories": lambda: trajectories(walks(), walks(7, 8), class_grid(), 1),
    "trajectories with NaN": lambda: trajectories(np.where(walks(L=1) < 0, np.nan, 0), walks(L=1), class_grid(1), 0),
    "acuity": lambda: figures.acuity(curves(), curves(np.append(THETA, 0.99))),
    "acuity, passive only": lambda: figures.acuity(curves(what_unit="P(wrong)", holes=True), None),
    "acuity, no where": lambda: figures.acuity(curves([0.95]).drop_vars("where_error"), None),
    "confusion": lambda: confusion(np.eye(3), np.diag([5, 0, 2]), class_grid().what_name, 0.95),
    "confusion, one object": lambda: confusion([[3]], None, ["rod"], 0.95),
    "confusion, 31 objects": lambda: confusion(np.eye(31), np.ones((31, 31)), class_grid(M=31).what_name, 0.95),
    "contacts": lambda: figures.contacts(contact_curves(), class_grid()),
    "one contact": lambda: figures.contacts(contact_curves([1]), class_grid(L=1)),
    "many contacts": lambda: figures.contacts(contact_curves([1, 2, 5, 10, 20, 50]), class_grid(M=1)),
}


def axis_labels(figure):
    return [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]


LARGE = [name for name in CASES if re.search(r"31|66 taxels|many", name)]
PLAIN = (
    "pressure without layout",
    "pressure at one position",
    "beliefs of one class",
    "by position, one place",
    "by fixation, holes",
    "trajectories",
    "acuity",
    "acuity, no where",
    "confusion",
    "one contact",
)
"""A case of each figure, and what is left out in it."""
LARGEST = "pressure of many taps", "beliefs of 31 x 31", "trajectories with NaN"


@pytest.mark.parametrize("name", slow_but(PLAIN, sorted({*CASES} - {*LARGE})))
def test_figures_are_drawn(name):
    """Without a warning, as far as they are laid out."""
    CASES[name]().draw_without_rendering()


@pytest.mark.parametrize("name", slow_but(LARGEST, [*LARGE, "trajectories with NaN", "acuity, passive only"]))
def test_figures_are_written(name, tmp_path):
    """Every figure draws without a warning and is small enough to be mailed."""
    (svg,) = save(CASES[name](), tmp_path, "figure")

    assert [tmp_path / "figure.svg"] == [svg] == list(tmp_path.iterdir())
    assert svg.read_text().startswith("<?xml")
    assert svg.stat().st_size < 1_500_000


@pytest.mark.parametrize("name", slow_but(["pressure"], ["pressure", "trajectories"]))
def test_the_same_data_give_the_same_bytes(name, tmp_path):
    """A figure drawn and written twice is the same file, and an older one is replaced."""
    first = [path.read_bytes() for path in save(CASES[name](), tmp_path, "figure", most=0)]
    second = [path.read_bytes() for path in save(CASES[name](), tmp_path, "figure", most=0)]

    assert first == second


def test_drawing_leaves_no_setting_behind(tmp_path, monkeypatch):
    """Settings of this package end with the function that needs them, and pyplot is never imported."""
    import matplotlib as mpl

    def settings():
        return {key: mpl.rcParams[key] for key in mpl.rcParams if key != "backend"}  # asking for it imports pyplot

    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    before = settings()
    save(CASES["contacts"](), tmp_path, "figure")

    assert settings() == before


def test_pressure_has_a_line_per_taxel_and_a_tick_per_class_edge():
    """Taps stand in order of position; the axis is labelled at the edges of the classes."""
    taps = tap_set()
    axes, layout = pressure(taps, 0).axes
    of_object = np.sort(taps.where[taps.what == 0])

    assert len(axes.lines) == 7
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("position (mm)", "sensor reading (counts)")
    assert [float(label.get_text()) for label in axes.get_xticklabels()] == [0, 1, 2, 3, 4]
    assert [(of_object < edge).sum() for edge in range(5)] == list(axes.get_xticks())
    assert [str(k) for k in range(7)] == [text.get_text() for text in layout.texts]


def test_the_taxel_layout_shows_the_widest_axes():
    """The longest of the three axes stands upright, the next one lies across."""
    taps = tap_set()
    spots = pressure(taps, 0).axes[1].collections[0].get_offsets()

    np.testing.assert_allclose(spots, taps.dataset["taxel_position"].values[:, [0, 2]])


def test_pressure_without_positions_counts_taps():
    """With one where class the axis is the number of the tap."""
    assert CASES["pressure at one position"]().axes[0].get_xlabel() == "tap"


def test_pressure_without_layout_names_the_taxels():
    """Up to twelve taxels have a legend, more a colour bar."""
    legend = CASES["pressure without layout"]().axes[1].get_legend()
    bar = CASES["pressure of 66 taxels"]().axes[1].child_axes[0]

    assert [str(k) for k in range(7)] == [text.get_text() for text in legend.get_texts()]
    assert bar.get_ylabel() == "taxel"


def test_thinned_pressure_keeps_the_extremes():
    """Where samples are too many to draw, the highest and the lowest of each taxel are still in its line."""
    taps = tap_set(N=400, J=20, K=3)
    drawn = sorted((line.get_ydata().min(), line.get_ydata().max()) for line in pressure(taps, 0).axes[0].lines)
    samples = taps.taps[taps.what == 0]

    np.testing.assert_allclose(sorted(zip(samples.min(axis=(0, 1)), samples.max(axis=(0, 1)), strict=True)), drawn)


def test_an_object_without_taps_is_refused():
    """There is nothing to draw, and the message names the object."""
    with pytest.raises(InputError, match="'never touched' has no tap"):
        pressure(tap_set(), 2)


def test_beliefs_start_at_the_prior_and_name_the_classes():
    """The true class and the one believed in the end are labelled in words; the others are thin."""
    clear, ambiguous = CASES["beliefs"]().axes
    labels = [[text.get_text() for text in axes.get_legend().get_texts()] for axes in (clear, ambiguous)]

    assert labels == [
        ["true and decided: 8 mm rod at 2.5 mm"],
        ["true: 8 mm rod at 2.5 mm", "decided: 4 mm rod at 5.5 mm"],
    ]
    assert [len(axes.collections[0].get_segments()) for axes in (clear, ambiguous)] == [11, 10]
    assert [line.get_ydata()[0] for axes in (clear, ambiguous) for line in axes.lines] == [1 / 12] * 3
    assert list(range(10)) == list(ambiguous.lines[0].get_xdata())


def test_errors_by_place_have_a_line_per_threshold_and_one_band():
    """The lowest threshold is light, the highest, which alone carries its interval, has the colour of its policy."""
    *panels, bar = CASES["by position"]().axes

    assert [len(axes.lines) for axes in panels] == [3, 3, 3]
    assert [len(axes.collections) for axes in panels] == [1, 1, 1]
    assert [line.get_color() for line in panels[0].lines] == ["#f4cfd5", "#de7082", "#c8102e"]
    assert [label.get_text() for label in bar.get_yticklabels()] == ["0.1", "0.5", "0.95"]
    assert [axes.get_title(loc="left") for axes in panels] == ["A", "B", "C"]
    assert [axes.get_ylabel() for axes in panels] == [
        "object error (mm)",
        "position error (mm)",
        "reaction time (taps)",
    ]


def test_thresholds_may_come_in_any_order():
    """Lines are sorted by threshold and place before they are drawn."""
    data = curves(place=[1, 2, 5])
    shuffled = data.isel(theta=[2, 0, 1], place=[1, 2, 0])
    drawn, again = (figures.errors_by_position(d).axes[0].lines for d in (data, shuffled))

    for line, other in zip(drawn, again, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), other.get_xydata())


def test_long_units_are_shortened_and_objects_without_size_are_named():
    """Axis labels stay short; an error without a unit is the probability of being wrong."""
    labels = axis_labels(CASES["by fixation, holes"]())

    assert labels[0] == ("fixation point (encoder counts)", "object: P(wrong)")
    assert labels[1] == ("fixation point (encoder counts)", "position error (encoder counts)")


@pytest.mark.parametrize(
    ("unit", "short"), [("mm", "mm"), ("", ""), (LONG_UNIT, "encoder counts"), ("mm; x", "mm"), ("mm (x axis)", "mm")]
)
def test_units_end_at_the_first_comma_semicolon_or_bracket(unit, short):
    """What follows is explanation, not unit."""
    assert short == short_unit(unit)


def test_a_quantity_without_unit_has_no_brackets():
    """Nothing is printed for a unit that is not known."""
    assert axis_label("position", "") == "position"


def test_trajectories_end_with_the_decision():
    """A line has as many points as there are taps before the padding, near the values of its classes."""
    index = walks()
    passive, active = trajectories(index, index, class_grid(), 1).axes
    lines = passive.collections[0].get_segments()
    value = class_grid().where_value

    assert (index >= 0).sum(axis=1).tolist() == [len(line) for line in lines]
    for line, row in zip(lines, index, strict=True):
        np.testing.assert_allclose(value[row[row >= 0]], line[:, 1], atol=0.25)
    assert [passive.get_title(), active.get_title()] == ["passive", "active"]
    assert value[1] == active.lines[-1].get_ydata()[0]
    assert passive.get_ylabel() == "position (mm)"


def test_a_decision_of_a_trajectory_tells_its_tap_its_place_and_its_start():
    """The place of the class and not that of the line, which is a little beside it; the quickest is first."""
    index, grid = walks(), class_grid()
    panels = curves_of(trajectories(index, index, grid, 1))
    (series,) = panels[0].series
    taps = (index >= 0).sum(axis=1)
    first = int(np.argsort(taps, kind="stable")[0])
    place, start = grid.where_value[index[first, taps[first] - 1]], grid.where_label(int(index[first, 0]))

    assert series.label == "decision"
    assert len(series.points) == len(index)
    assert series.points[0][2:] == (str(taps[first]), f"{place:g}", f"start {start}")


def test_acuity_has_four_panels_that_show_everything():
    """Passive is red and active black; no interval is cut off, though the second policy is drawn later."""
    passive, active = curves(), curves(np.append(THETA, 0.99))
    figure = figures.acuity(passive, active)

    assert [axes.get_title(loc="left") for axes in figure.axes] == ["A", "B", "C", "D"]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["passive", "active"]
    assert [line.get_color() for line in figure.axes[0].lines] == ["#c8102e", "#000000"]
    for axes in figure.axes:
        assert axes.get_ylim()[0] == 0
        assert axes.get_ylim()[1] >= float(active["what_error_high"].max())
    assert [axis_labels(figure)[i] for i in (0, 3)] == [
        ("belief threshold", "object error (mm)"),
        ("mean reaction time (taps)", "position error (mm)"),
    ]


def test_acuity_leaves_out_an_error_that_is_not_there():
    """Data with one where class have two panels."""
    assert len(CASES["acuity, no where"]().axes) == 2


@pytest.mark.parametrize(
    "draw",
    [lambda: figures.acuity(None, None), lambda: confusion(None, None, [], 0.5)],
    ids=["acuity", "confusion"],
)
def test_nothing_to_draw_is_an_error(draw):
    """One policy at least is needed."""
    with pytest.raises(ValueError, match="passive and active are both None"):
        draw()


def test_confusion_prints_row_shares():
    """Rows sum to one; a row without decisions stays empty."""
    share = row_normalised([[3, 1, 0], [0, 0, 0], [0, 0, 2]])
    figure = confusion([[3, 1, 0], [0, 0, 0], [0, 0, 2]], None, ["a", "b", "c"], 0.95)

    np.testing.assert_array_equal([[0.75, 0.25, 0], [np.nan] * 3, [0, 0, 1]], share)
    assert [text.get_text() for text in figure.axes[0].texts] == ["0.75", "0.25", "1.00"]
    assert axis_labels(figure) == [("decided object", "true object")]
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("name", "series"),
    [
        ("contacts", {"object and position": 1 / 12, "position": 1 / 4, "object": 1 / 3}),
        ("one contact", {"object": 1 / 3}),
        ("many contacts", {"position": 1 / 4}),
    ],
)
def test_contacts_show_accuracy_and_chance(name, series):
    """Each series has its interval and its chance level; parts with one class are left out."""
    axes = CASES[name]().axes[0]
    dotted = [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":" and len(line.get_ydata())]

    assert [*series, "chance"] == [text.get_text() for text in axes.get_legend().get_texts()]
    assert list(series.values()) == dotted
    assert len(series) == len(axes.collections)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("contacts", "fraction correct")
