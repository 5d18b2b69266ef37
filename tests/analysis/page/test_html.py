"""A page as HTML."""

import doctest
import json
import re
from html.parser import HTMLParser
from urllib.parse import unquote
from xml.etree import ElementTree as ET

import pytest
from matplotlib.figure import Figure
from solidtouch.analysis.page import html
from solidtouch.analysis.page import page as pages
from solidtouch.analysis.page.figure_curves import CurvePanel, CurveSeries
from solidtouch.analysis.page.figure_sizes import new_figure
from solidtouch.analysis.page.figure_style import Drawing, label_panel, styled
from solidtouch.analysis.page.html import (
    Image,
    draw_pictures,
    embedded,
    in_words,
    write_page,
)
from solidtouch.analysis.page.page import (
    Brief,
    Cautions,
    Embedded,
    Listing,
    Note,
    Page,
    Picture,
    Section,
    Table,
    Terms,
    Verbatim,
)

TABLE = Table(
    ["model", "error (mm)", "how", "taps"],
    [["a<b", "**1.0**", "by `fit`", "3"], ["c", "too few taps"]],
    "Errors & taps",
    words={2},
    dense=True,
)
PAGE = Page(
    "Rods <of> steel & brass",
    ["Intro, see [the rules](#rules).", Verbatim("solidtouch `fit` **x**"), Brief(Cautions(["Few <taps>."]))],
    [
        Section(
            "Errors",
            [
                Brief(TABLE),
                Picture("fig1", "Title", 'Caption "1" & more', Figure),
                Picture("fig2", "Nothing", "to draw", lambda: None),
                Note(["**Simulated.**"]),
                Section("Inner", [Listing(["one", "two"], "Found"), Listing([], "Lost")]),
                Embedded('<div class="player">played <i>here</i></div>', "What this is"),
            ],
            "errors",
        ),
        Section(
            "Rules",
            [Terms({"risk": "mean `cost`", "loss": "x"}), Table((), [("seed", "1")])],
            "rules",
            folded=True,
        ),
    ],
)


def test_a_number_is_broken_before_its_interval_only():
    """In a narrow window; prose is broken anywhere."""
    cells = ["a b (c d)", "1.0 [0.5, 1.5]", "a b (c d)"]
    page = html.render_page(Page("", [Table(["x", "y", "z"], [cells], words={2})], []))

    assert '<td class="n">1.0 [0.5,\N{NO-BREAK SPACE}1.5]</td>' in page
    assert "<td>a b (c d)</td>" in page


class Parsed(HTMLParser):
    """Elements with their attributes, and the text but for script; fails where elements are not closed in order."""

    VOID = ("meta", "img", "source")

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.words = [], [], []
        self.feed(text)
        self.close()
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert tag == self.open.pop()

    def handle_data(self, data):
        if self.open[-1:] not in (["script"], ["style"]):
            self.words.append(data)

    def of(self, tag):
        """The attributes of all elements of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def parsed():
    return Parsed(html.render_page(PAGE, {"fig1": Image("data:image/png;base64,AAAA", 672)}))


def test_everything_is_on_the_page_and_escaped(parsed):
    assert parsed.open == []
    for expected in (
        "Rods <of> steel & brass",
        "Intro, see the rules .",
        "solidtouch `fit` **x**",
        "Read with care Few <taps>.",
        "Errors & taps model error (mm) how taps a<b 1.0 by fit 3 c too few taps",
        'Title (fig1). Caption "1" & more',
        "Inner Found: one two Lost: none.",
        "played here What this is",
        "Rules risk mean cost loss x seed 1",
    ):
        assert expected in parsed.text


def test_marks_become_elements(parsed):
    tags = [tag for tag, _ in parsed.elements]
    assert tags.count("code") == 2
    assert tags.count("strong") == 3
    assert [link["href"] for link in parsed.of("a")] == ["#errors", "#rules", "#rules"]


def test_the_navigation_leads_to_every_section(parsed):
    assert [heading.get("id") for heading in parsed.of("h2")] == ["errors", None]
    assert parsed.of("details") == [{"class": "fold", "id": "rules"}]
    assert parsed.of("h3") == [{}]
    assert parsed.of("nav") == [{"aria-label": "Sections"}]


def test_tables_can_be_read_aloud_and_scrolled(parsed):
    """Headings have a scope; prose may be broken into lines, numbers not; a short row is filled by its last cell."""
    assert [heading["scope"] for heading in parsed.of("th")] == ["col"] * 4 + ["row"] * 3
    assert parsed.of("td") == [{"class": "n"}, {}, {"class": "n"}, {"colspan": "3"}, {"class": "n"}]
    assert parsed.of("table") == [{"class": "dense"}, {}]
    assert [part["tabindex"] for part in parsed.of("div") if "scroll" in part["class"]] == ["0"] * 3
    assert [part["role"] for part in parsed.of("div") if "note" in part["class"]] == ["note"] * 2


def test_figures_have_a_text_and_a_size(parsed):
    assert parsed.of("img") == [
        {"src": "data:image/png;base64,AAAA", "width": "672", "alt": 'Title. Caption "1" & more'}
    ]
    assert "img" not in dict(Parsed(html.render_page(PAGE)).elements)


def test_what_is_empty_is_left_out():
    page = Parsed(html.render_page(Page("T", [Cautions([]), Table(["head"], []), Listing([])], [])))
    assert page.text == "T T"  # of the window and of the page
    assert {"div", "table", "ul"}.isdisjoint(dict(page.elements))


def test_a_page_is_written_with_its_figures_and_numbers(tmp_path):
    """It needs nothing from outside."""
    images = draw_pictures(tmp_path, PAGE.pictures, lambda _: None)
    write_page(tmp_path, PAGE, {"a": 1.5, "b": "ü"}, "summary.json", images)

    assert {path.name for path in tmp_path.iterdir()} == {"fig1.svg", "report.html", "summary.json"}
    assert json.loads((tmp_path / "summary.json").read_text(encoding="utf-8")) == {"a": 1.5, "b": "ü"}
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert unquote(Parsed(text).of("img")[0]["src"]).startswith("data:image/svg+xml,<?xml ")
    text = re.sub(r'"data:[^"]*"', "", text)
    assert not re.search(r"<script [^>]|<link|@import|url\(|\bfetch\(|\bimport\b|http", text)


def test_drawn_figures_are_counted_and_need_not_be_drawn_again(tmp_path):
    counted = []
    images = draw_pictures(tmp_path, PAGE.pictures, counted.append)

    assert set(images) == {"fig1"}
    assert counted == [1, 1]
    (tmp_path / "again").mkdir()
    write_page(tmp_path / "again", PAGE, {}, "summary.json", images)
    assert {path.name for path in (tmp_path / "again").iterdir()} == {"report.html", "summary.json"}


def test_a_figure_that_cannot_be_drawn_costs_no_other(tmp_path):
    """The page tells why it is missing."""

    def fail():
        raise ZeroDivisionError("no <taps>")

    pictures = [Picture("fig0", "Title", "Caption", fail), *PAGE.pictures]
    with pytest.warns(UserWarning, match="fig0 could not be drawn: ZeroDivisionError, no <taps>"):
        images = draw_pictures(tmp_path, pictures, lambda _: None)
    page = Parsed(html.render_page(Page("T", pictures, []), images))

    assert [image["alt"] for image in page.of("img")] == ['Title. Caption "1" & more']
    assert "The figure fig0 could not be drawn: ZeroDivisionError, no <taps>" in page.text


def test_large_drawings_are_embedded_as_pixels(tmp_path):
    """But where their pixels would be larger still."""
    svg, png = tmp_path / "a.svg", tmp_path / "a.png"
    png.write_bytes(b"\0" * 1000)
    svg.write_text("<svg>" + " " * 2000 + "</svg>")

    assert embedded([svg], 672).data.startswith("data:image/svg+xml,<svg>")
    assert embedded([svg, png], 672).data.startswith("data:image/png;base64,")
    svg.write_text("<svg></svg>")
    assert embedded([svg, png], 672).data.startswith("data:image/svg+xml")
    assert embedded([svg, png], 672).width == 672


@pytest.mark.parametrize("narrow", [False, True], ids=["wide", "narrow"])
def test_a_page_holds_the_drawing_whatever_is_in_it(narrow):
    """As browsers read it, which leave out line breaks; an address among others has no spaces."""
    svg = """<svg a="it's 100 % &lt; &quot;#1&quot; &amp; ü"\nb="%23">\n<g href="#c">d\n&gt; 'e'</g></svg>"""
    address = html._narrow(Drawing(svg.encode(), 7.0, bytes)) if narrow else html._svg_uri(svg.encode())
    image = Image(address, 672, narrow=address)
    page = Parsed(html.render_page(PAGE, {"fig1": image}))
    read = page.of("source")[0]["srcset"] if narrow else page.of("img")[0]["src"]
    start, data = read.split(",", 1)

    assert start == "data:image/svg+xml"
    assert not re.search(r"[\n#]", data)
    assert not (narrow and " " in data)
    found, drawn = (ET.canonicalize(one, strip_text=True) for one in (unquote(data), svg))
    assert found == drawn.replace("\n", " ")


def test_curves_keep_what_they_are_called():
    """In an attribute with quotation marks of its own."""
    names = ["it's", 'a "b" & <c>', "&#39;", "100 %"]
    curves = [CurvePanel(name, "", "", (0, 0, 1, 1), [CurveSeries(name, "#000", [], [])]) for name in names]
    image = Image("data:image/png;base64,AAAA", 672, curves=html._as_json(curves))
    page = html.render_page(PAGE, {"fig1": image})
    (figure,) = Parsed(page).of("figure")

    assert 'data-curves=\'[{"title":"it&#39;s",' in page
    assert [panel["title"] for panel in json.loads(figure["data-curves"])] == names


def test_pixels_are_written_where_drawings_are_too_large(tmp_path, monkeypatch):
    monkeypatch.setattr(html, "_IMAGE_BYTES", 100)
    images = draw_pictures(tmp_path, PAGE.pictures, lambda _: None)

    assert {path.name for path in tmp_path.iterdir()} == {"fig1.svg", "fig1.png"}
    assert (tmp_path / "fig1.png").read_bytes().startswith(b"\x89PNG")
    assert images["fig1"].data.startswith("data:image/")


def test_a_text_says_what_a_figure_shows(tmp_path):
    """Axes with their units, and where curves begin and end; the words stand in the page."""

    @styled
    def draw():
        figure, axes = new_figure(3, 2)
        axes[0, 0].plot([1, 4], [2.5, 0.5], label="active")
        axes[0, 0].set(xlabel="taps", ylabel="object error (mm)")
        label_panel(axes[0, 0], "A")
        return figure

    picture = Picture("fig", "Errors", "Against taps.", draw)
    images = draw_pictures(tmp_path, [picture], lambda _: None)
    words = "Panel A: object error (mm) against taps; active from 2.5 at 1 to 0.5 at 4."
    page = html.render_page(Page("t", [picture], []), images)

    assert images["fig"].words == words
    assert f'alt="Errors. Against taps. {words}"' in page


def test_the_examples_of_the_docstrings_hold():
    assert doctest.testmod(pages).failed == 0


@pytest.mark.parametrize(
    ("names", "words"),
    [(("A", "taps", "error"), "Panel A: error against taps; "), (("", "", "error"), "error; "), (("", "", ""), "")],
)
def test_a_panel_is_told_by_what_it_has(names, words):
    """Its letter, its axes, and where its curves begin and end."""
    series = CurveSeries("active", "black", [], [(0.1, 0.2, "1", "5", ""), (0.3, 0.4, "2", "4", "")])
    panel = CurvePanel(*names, (0, 0, 1, 1), [series])

    assert in_words([panel]) == f"{words}active from 5 at 1 to 4 at 2."
    assert in_words([panel] * 7).endswith("2. 1 more panel.")
