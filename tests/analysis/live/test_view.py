"""The belief as picture, sentence and record, for grids of any size."""

import json
from io import StringIO
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console
from solidtouch.analysis.live.ending import ending_of, said
from solidtouch.analysis.live.picture import live_picture
from solidtouch.analysis.live.view import Seen, fitting_width, picture, record, sentence
from solidtouch.hardware.named_rigs import Truth
from solidtouch.inference.episode import Step
from solidtouch.models.grid import ClassGrid


def seen(belief, p=0.4, unit="mm", **more):
    """The third tap with this belief of shape (L, M)."""
    belief = np.asarray(belief, dtype=float)
    belief = belief / belief.sum()
    with np.errstate(divide="ignore"):
        log_belief = np.log(belief)
    L, M = belief.shape
    step = Step(
        3,
        np.zeros((2, 2)),
        more.pop("arrived", 0),
        log_belief,
        log_belief,
        -1.25,
        more.pop("decision", None),
        more.pop("move", 2),
    )
    grid = ClassGrid(
        0.5 + np.arange(L), unit, None, tuple((more.get("names", "{} mm rod").format(m),) for m in range(M))
    )
    more.pop("names", None)
    return Seen(step, grid, more.pop("theta", 0.9), more.pop("fixation", None), p, **more)


def printed(shown, width=100, rows=20, **console):
    file = StringIO()
    Console(file=file, width=width, **console).print(picture(shown, width, rows))
    return file.getvalue()


PEAK = [[0.0, 0.0, 0.0], [0.01, 0.7, 0.0], [0.09, 0.2, 0.0]]


def test_cells_hold_percentages():
    """Objects are rows, places columns; what is below half a percent is a dot; marginals stand beside and below."""
    lines = printed(seen(PEAK, fixation=1), color_system=None).splitlines()

    assert lines[0].split() == ["0.5", "1.5", "2.5", "what"]
    assert lines[1].split()[:7] == ["0", "mm", "rod", "·", "1", "9", "0.100"]
    assert lines[2].split()[:7] == ["1", "mm", "rod", "·", "70", "20", "0.900"]
    assert lines[3].split()[:7] == ["2", "mm", "rod", "·", "·", "·", "0.000"]
    assert lines[5].split() == ["where", "·", "71", "29"]
    assert lines[6].index("▲") == lines[5].index("71") + 1
    assert "Tap 3: 1 mm rod 0.900 (threshold 0.9), at 1.5 mm 0.710." in lines
    assert "Usual tap, p 0.4." in lines
    assert "Move +2." in lines


def test_the_bar_marks_the_threshold():
    """A mark where the belief must come to, unless the bar has passed it."""
    line = printed(seen([[1, 1]], theta=0.75), color_system=None).splitlines()[1]

    assert line.endswith("0.500 ██████   ┊  ")


def test_colours_go_from_dark_to_bright_with_legible_digits():
    """Certain is yellow with black digits, impossible violet with white ones."""
    out = printed(seen([[1.0, 0.0]]), color_system="truecolor", force_terminal=True)

    assert "\x1b[38;2;0;0;0;48;2;253;231;37m100" in out
    assert "\x1b[38;2;255;255;255;48;2;68;1;84m" in out


@given(st.integers(1, 400), st.integers(1, 40), st.integers(30, 200), st.integers(2, 25))
def test_any_grid_fits_any_width(L, M, width, rows):
    """No line is longer than the terminal, no more rows than asked for, and the columns hold all belief."""
    belief = np.random.default_rng(L + M).random((L, M))
    shown = seen(belief, fixation=L // 2, names="object of some length {}")
    lines = printed(shown, width, rows, color_system=None).splitlines()
    where = next(i for i, line in enumerate(lines) if line.startswith("where "))

    assert max(map(len, lines)) <= width
    assert where - 2 <= min(M, rows)
    assert all(len(line.rstrip()) > 0 for line in lines[:1])


def test_objects_without_a_row_of_their_own_share_one():
    """The most probable ones keep theirs, in the order of the grid."""
    belief = [[0.05, 0.3, 0.05, 0.4, 0.2]]
    lines = printed(seen(belief), rows=3, color_system=None).splitlines()

    assert [line.split()[0] for line in lines[1:4]] == ["1", "3", "3"]
    assert lines[3].split()[:4] == ["3", "others", "30", "0.300"]


def test_places_without_a_column_of_their_own_share_one():
    """The legend says so."""
    out = printed(seen(np.ones((40, 2))), width=60, color_system=None)

    assert "classes each, the first named" in out
    assert printed(seen(np.ones((16, 2))), fitting_width(seen(np.ones((16, 2))).grid)).count("each") == 0


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"p": 0.4, "move": 0}, "tap 3: 1 mm rod 0.900, 1.5 mm 0.710, usual tap, p 0.4, stay"),
        ({"p": 0.002, "move": -2}, "tap 3: 1 mm rod 0.900, 1.5 mm 0.710, unusual tap, p 0.002, move -2"),
        ({"p": None, "move": None}, "no p-value, deadline: 1 mm rod is the most probable"),
        ({"decision": 1, "move": None}, "decided: 1 mm rod"),
        ({"unknown": True}, "unknown: unlike every object of the model"),
    ],
)
def test_a_sentence_says_what_is_believed_and_what_follows(more, said):
    assert said in sentence(seen(PEAK, **more))


def test_a_decision_is_said_in_the_picture():
    out = printed(seen(PEAK, decision=1, move=None, theta=0.8, heading="A rig, engine numpy"), color_system=None)

    assert "(above the threshold 0.8)" in out
    assert "Decided: 1 mm rod." in out
    assert out.startswith("A rig, engine numpy")


def test_square_brackets_in_names_are_no_markup():
    assert "[red]" in printed(seen([[1.0]], names="[red]{}"), color_system=None)


def test_a_record_is_json():
    """Numbers that engines agree in are rounded alike."""
    content = json.loads(json.dumps(record(seen(PEAK, p=0.0049999999999, arrived=-1))))

    assert content == {
        "tap": 3,
        "what": "1 mm rod",
        "what_belief": 0.9,
        "where": 1.5,
        "where_index": 1,
        "where_belief": 0.71,
        "log_evidence": -1.25,
        "p": 0.005,
        "unusual": True,
        "arrived": -1,
        "move": 2,
        "what_marginal": [0.1, 0.9, 0.0],
        "where_marginal": [0.0, 0.71, 0.29],
    }


def test_the_picture_needs_nothing_from_elsewhere():
    """The SVG holds the text and names no address but that of its own format."""
    svg = live_picture(seen(PEAK, fixation=1))

    assert "1&#160;mm&#160;rod" in svg
    assert svg.count("http") == 1
    ET.fromstring(svg)  # noqa: S314 - our own


def test_a_decision_that_is_put_off_is_explained():
    """The belief is above the threshold, and there is a move instead of a decision."""
    assert sentence(seen(PEAK, theta=0.8, decision=None)).endswith("possibly unlike every object of the model, move +2")


@pytest.mark.parametrize("place", [None, [[0, 0, 30], [1, 0, 30], [0, 2, 60]]], ids=["line", "plane"])
def test_the_truth_is_said_with_its_unit(place):
    """In a plane it is a place, not its number."""
    shown = seen(PEAK, decision=1, move=None)
    grid = ClassGrid([0, 1, 2], "mm, from the end", None, ["ball", "rod", "disc"], where_place=place)
    told = said(2, ending_of(shown._replace(grid=grid), Truth("ball", 2.0)))

    at = ("1 mm", "2 mm") if place is None else ("(1, 0) mm at 30", "(0, 2) mm at 60")
    assert told == f"Episode 2: rod at {at[0]} after 3 taps (threshold). Truth: ball at {at[1]}."


def test_wide_letters_keep_the_columns_in_line():
    """A letter of Chinese takes two columns of the terminal."""
    lines = printed(seen(PEAK, names="直径四ミリの棒のとても長い名前{}"), color_system=None).splitlines()

    assert lines[1].startswith("直径四ミリの棒の … ")
    assert len({cell_len(line[: line.index("0.")]) for line in lines[1:4]}) == 1


def test_a_position_without_room_has_no_label():
    """Without its sign it would be another one."""
    shown = seen([[1.0], [1.0]], names="a")
    grid = ClassGrid([-123456.0, 5.0], "mm (from the end)", None, ["a"])
    out = printed(shown._replace(grid=grid), color_system=None)

    assert out.splitlines()[0].split() == ["what"]
    assert "columns: position (mm)." in out
