"""The gist of a page in a terminal."""

import io

import pytest
from matplotlib.figure import Figure
from rich.console import Console
from solidtouch.analysis.page.page import Brief, Cautions, Listing, Note, Page, Picture, Section, Table
from solidtouch.analysis.page.terminal import cut_to, show


def printed(page, width=80):
    text = io.StringIO()
    show(page, Console(file=text, width=width))
    return [line.strip() for line in text.getvalue().splitlines() if line.strip()]


def test_what_is_brief_is_printed_under_the_titles_of_its_sections():
    """Nothing else is; marks and markup of rich are plain text."""
    table = Table(["model", "error (mm)", "how"], [["[bold]a", "**1.0**", "x"], ["b", "2.0", "y"]], "Errors")
    page = Page(
        "Title",
        ["Intro.", Brief(Cautions(["Few taps.", "Old taps."]))],
        [
            Section("First", [Brief(table, columns=(0, 1)), Picture("f", "t", "c", Figure), table], "first"),
            Section("Second", ["Nothing brief."], "second"),
            Section("Third", [Section("Inner", [Brief(Note(["See `fit`.", Listing(["one"], "Found")]))])], "third"),
            Section("Fourth", [Brief(Table(["a"], [])), Brief(Cautions([]))], "fourth"),
        ],
    )
    lines = printed(page)

    assert lines[:4] == ["Warning: Few taps.", "Warning: Old taps.", "First", "Errors"]
    assert [" ".join(line.split()) for line in lines[4:]] == [
        "error",
        "model (mm)",
        lines[6],
        "[bold]a 1.0",
        "b 2.0",
        "Third",
        "See fit.",
        "Found:",
        "- one",
    ]
    assert set(lines[6]) == {"─"}


def test_a_list_of_names_and_values_has_no_head():
    lines = printed(Page("T", [Brief(Table((), [("seed", "1"), ("taps", "20")]))], []))
    assert [" ".join(line.split()) for line in lines] == ["seed 1", "taps 20"]


def test_numbers_stay_whole_where_the_console_is_narrow():
    """Words are broken into lines instead."""
    rows = [["a name of many words", "0.1234 [0.1000, 0.1500]", "0.5678 [0.5000, 0.6500]"]]
    for width in (70, 30):
        lines = printed(Page("T", [Brief(Table(["name", "error", "taps"], rows))], []), width)
        assert any("0.1234 [0.1000, 0.1500]  0.5678 [0.5000, 0.6500]" in line for line in lines)
        assert any(line.startswith("a name") for line in lines)


@pytest.mark.parametrize("width", [76, 80, 90])
def test_names_stay_whole_beside_long_headings(width):
    """A narrow console breaks headings into lines, not the names of models, and no line is too long."""
    head = ["model", "taps (nat per tap)", "class after 20 taps (nat)", "passive object error at 10 taps (mm)"]
    rows = [["matrix-normal", "1 (-695)", "3 (-1.25)", "6 (1.53)"]]
    lines = printed(Page("T", [Brief(Table([*head, *head[1:3]], [[*rows[0], *rows[0][1:3]]]))], []), width)
    assert any(line.startswith("matrix-normal ") for line in lines)
    assert all(len(line) <= width for line in lines)


@pytest.mark.parametrize(("width", "columns"), [(120, 4), (60, 3), (20, 1)])
def test_a_live_view_says_which_columns_have_no_room(width, columns):
    """And breaks its title, where rich would cut both off without a mark."""
    table = Table(["name", "a", "b", "c"], [["model", *["0.1234 [0.1000, 0.1500]"] * 3]], "A title " * 12)
    text = io.StringIO()
    console = Console(file=text, width=width)
    console.print(*cut_to(Page("T", [Brief(table)], []), console))
    said = " ".join(text.getvalue().split())

    assert said.count("0.1234 [0.1000, 0.1500]") == columns - 1
    assert said.count("title") == 12
    missing = {4: "", 3: "too narrow for 1 more column.", 1: "too narrow for 3 more columns."}[columns]
    assert said.endswith(missing)
    assert ("too narrow" in said) == bool(missing)
    assert max(map(len, text.getvalue().splitlines())) <= width
