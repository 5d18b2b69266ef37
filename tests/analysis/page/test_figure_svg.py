"""Drawings are shorter than matplotlib writes them, and look the same."""

import re
from base64 import b64encode
from io import BytesIO
from itertools import zip_longest
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_svg import FigureCanvasSVG
from solidtouch.analysis.page.figure_canvas import Canvas
from solidtouch.analysis.page.figure_sizes import new_figure
from solidtouch.analysis.page.figure_style import drawing_of, styled
from solidtouch.analysis.page.figure_svg import shortened
from solidtouch.analysis.page.html import embedded

SVG, LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"


@styled
def figure(points=50):
    """Whatever figures are made of."""
    made, axes = new_figure(7.0, 4.0, 2, 3)
    x = np.linspace(1, 30, points)
    axes[0, 0].plot(x, np.sin(x), "o--", color="#0072b2", label="active")
    axes[0, 0].plot(x, x // 9, "s", markeredgewidth=0, drawstyle="steps")
    axes[0, 0].legend(title="100 %: \"a\" & 'b' < ü")
    axes[0, 1].errorbar(x, np.cos(x), 0.3, fmt="^", capsize=2, alpha=0.4)
    axes[0, 1].set(xscale="log", ylabel="log axis")
    axes[0, 2].fill_between(x, x, 2 * x, alpha=0.3, hatch="//", edgecolor="red")
    axes[1, 0].scatter(x, -x, c=x, s=x, edgecolors="black")
    axes[1, 1].vlines(x, 0, x, alpha=0.5, linewidth=2.5)
    axes[1, 1].bar([1, 2, 3], [3, 2, 1], color="none", edgecolor="black")
    axes[1, 2].imshow(np.outer(x, x), alpha=0.5)
    return made


def written(made):
    """What matplotlib writes, and the same shortened."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("solidtouch.analysis.page.figure_style.shortened", lambda svg, _: svg)
        before = drawing_of(made).svg
    return before, shortened(before, ())


def declared(text):
    return dict(re.findall(r"([\w-]+):\s*([^;]*)", text or ""))


def shapes(svg):
    """What is painted in turn: kind, numbers of place and form, and the style that it has in the end."""
    root = ET.fromstring(svg)  # noqa: S314 - our own
    named = {one.get("id"): one for one in root.iter() if one.get("id")}
    everyone, rules = re.fullmatch(r"(\*|svg)\{(.*)\}", root.find(f".//{SVG}style").text).groups()

    def clip(one):
        name = re.search(r"#(.*)\)", one.get("clip-path", ""))
        return [float(value) for _, value in sorted(named[name[1]][0].items())] if name else []

    def painted(one, style, place, clips):
        kind = one.tag.removeprefix(SVG)
        if kind in ("defs", "metadata", "style"):
            return
        if everyone in ("*", kind):
            style = {**style, **declared(rules)}
        style = {**style, **declared(one.get("style"))}
        at = [float(n) for n in re.findall(r"-?\d+\.?\d*", one.get("transform", ""))] or [
            float(one.get("x", 0)),
            float(one.get("y", 0)),
        ]
        place, clips = [*place, *(at if any(at) else [])], clips + clip(one)
        if kind == "use":
            yield from painted(named[one.get(LINK)[1:]], style, place, clips)
        elif kind in ("path", "image", "rect"):
            yield kind, [*place, *corners(one.get("d", "")), *clips], style
        for part in one:
            yield from painted(part, style, place, clips)

    return [*painted(root, {}, [], [])]


def corners(path):
    """All numbers of a path, both for each corner."""
    at = [0.0, 0.0]
    for command, numbers in re.findall(r"([A-Za-z])([^A-Za-z]*)", path):
        found = [float(number) for number in numbers.split()]
        found = {"H": [*found, at[1]], "V": [at[0], *found]}.get(command, found)
        at = found[-2:] or at
        yield from found


def test_every_shape_keeps_its_place_and_style():
    before, after = map(shapes, written(figure()))

    assert len(before) > 300
    for (kind, numbers, style), shape in zip_longest(before, after):
        assert shape == (kind, pytest.approx(numbers, abs=0.0051), style)


def test_remembered_texts_look_as_matplotlib_draws_them():
    """In another size of type, too, and in formulas."""
    drawing_of(figure())  # whose texts are remembered
    ours, theirs = BytesIO(), BytesIO()
    with mpl.rc_context({"font.size": 13, "svg.hashsalt": "solidtouch"}):
        made = figure()
        made.suptitle("again: $x^2$, ff fi, ü\nand **Wörter**", fontsize=13, parse_math=True)
        made.draw_without_rendering()
        made.set_layout_engine(None)
        made.dpi = 72
        FigureCanvasSVG(made).print_svg(theirs, metadata={"Date": None})
        Canvas(made, 72, {"Date": None}).print_svg(ours)
    assert ours.getvalue() == theirs.getvalue()


def test_ids_stay_that_are_asked_for_or_referred_to():
    svg = written(figure())[0]
    short = shortened(svg, ["curve-0-0"]).decode()

    assert b'id="axes_1"' in svg
    assert {*re.findall(r' id="([^"]*)"', short)} == {*re.findall(r'(?:href="|url\()#([^")]+)', short), "curve-0-0"}


@pytest.mark.parametrize("points", [10, 100])
def test_a_page_holds_curves_in_less_than_half_the_bytes_of_base64(points, tmp_path):
    made, axes = new_figure(7.0, 2.0, 1, 3)
    x = np.linspace(0, 1, points)
    for panel in axes[0]:
        panel.plot(x, np.sin(x), "o-", label="active")
        panel.set(xlabel="belief threshold", ylabel="object error (mm)")
    before, after = written(made)
    (tmp_path / "a.svg").write_bytes(after)

    assert len(embedded([tmp_path / "a.svg"], 672).data) < 0.4 * len(b64encode(before))
