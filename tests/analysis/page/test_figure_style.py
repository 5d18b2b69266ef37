"""Names and units in figures are short and stay different; tables hold them whole."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as some
from matplotlib.colors import to_hex
from solidtouch.analysis.page.figure_confusion import plot_confusion
from solidtouch.analysis.page.figure_sizes import new_figure
from solidtouch.analysis.page.figure_style import ACTIVE, PASSIVE, axis_label, band, short, short_unit, unit_name

ROD = "smooth aluminium rod of the second workshop series no. {} with a matt finish"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("8 mm rod", "8 mm rod"),
        ("a" * 28, "a" * 28),
        ("encoder counts of the third joint of the hand", "encoder counts of t…the hand"),
    ],
)
def test_a_long_name_loses_its_middle(name, expected):
    assert short(name) == expected


def test_the_middle_is_kept_where_names_differ_there():
    rods = [ROD.format(number) for number in range(5)]

    assert [short(rod, rods) for rod in rods] == [f"smooth a…no. {i} with a…finish" for i in range(5)]
    assert short("8 mm rod", rods) == "8 mm rod"


@given(
    some.lists(
        some.builds("{}{}{}".format, *(some.text("ab", min_size=1, max_size=40) for _ in range(3))),
        min_size=1,
        max_size=12,
        unique=True,
    )
)
def test_different_names_stay_different(names):
    shorter = [short(name, names) for name in names]

    assert len(set(shorter)) == len(names)
    assert max(map(len, shorter)) <= 28


def test_names_that_differ_in_several_places_are_numbered():
    names = [f"{'x' * 40}{i}{'y' * 40}{j}{'z' * 30}" for i in range(3) for j in range(4)]

    assert [short(name, names)[-5:].lstrip("z") for name in names][:2] == [" (1)", " (2)"]
    assert len({short(name, names) for name in names}) == len(names)


def test_units_are_whole_in_tables_and_short_in_figures():
    unit = "encoder counts of the third joint of the hand, undocumented"

    assert unit_name(unit) == "encoder counts of the third joint of the hand"
    assert short_unit(unit) == "encoder counts of t…the hand"
    assert axis_label("position", unit) == "position (encoder counts of t…the hand)"


def test_objects_of_a_confusion_table_stay_different():
    figure, axes = new_figure(3, 3)
    rods = [ROD.format(number) for number in range(4)]
    plot_confusion(axes[0, 0], np.eye(4), rods)
    figure.canvas.draw()

    assert [text.get_text() for text in axes[0, 0].get_yticklabels()] == [short(rod, rods) for rod in rods]


def test_bands_that_overlap_are_told_apart():
    """By outlines in their colours; black is so pale that red with it stays red."""
    _, axes = new_figure(3, 2)
    data = xr.Dataset({"e": ("x", [1.0, 2.0]), "e_low": ("x", [0.5, 1.0]), "e_high": ("x", [1.5, 3.0])})
    for colour in (PASSIVE, ACTIVE):
        band(axes[0, 0], [0, 1], data, "e", colour)
    red, black = axes[0, 0].collections
    (shade,), (over,) = (np.asarray(one.get_facecolor()) for one in (red, black))
    under = 1 - shade[3] * (1 - shade[:3])
    mixed = over[3] * over[:3] + (1 - over[3]) * under

    assert [to_hex(one.get_edgecolor()[0]) for one in (red, black)] == [PASSIVE, ACTIVE]
    assert min(one.get_linewidth()[0] for one in (red, black)) > 0
    assert np.isclose(mixed.max() - mixed.min(), under.max() - under.min(), atol=0.02)
    assert mixed.min() > 0.75
