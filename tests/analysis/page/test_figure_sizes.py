"""Styles: a figure has the size and type of its use, and shows the same."""

import numpy as np
import pytest
from matplotlib.text import Text
from slow_cases import slow_but
from solidtouch.analysis.page.figure_sizes import NARROW, STYLES, drawn_as, key, new_figure
from solidtouch.analysis.page.figure_style import label_panel, save_as, styled
from solidtouch.models.errors import InputError

WIDTHS = {"page": 10.8, "paper": 88 / 25.4, "talk": 40 / 3}


@styled
def three(**options):
    """Three panels with one label for their common axis and a key below."""
    figure, axes = new_figure(7.0, 2.3, 1, 3, sharey=True, **options)
    for letter, panel in zip("ABC", axes[0], strict=True):
        panel.plot([0, 1], [0, 1], linewidth=1.0, label=f"a line of panel {letter}")
        panel.set_xlabel("a quantity that has a very long name (mm)")
        label_panel(panel, letter, "a title")
    axes[0, 0].set_ylabel("error (mm)")
    key(figure, [*axes[0, 0].lines] * 4, ["one", "two", "three", "a much longer name than all of the others"])
    return figure


@pytest.mark.parametrize("n", range(1, 13))
def test_a_key_of_any_number_of_names_fits_its_figure(n):
    """Also where its columns are uneven, as those of nine models are."""
    names = ["histogram", "gaussian", "student", "profile", "profile-ar", "profile-mvn", "matrix-normal", "smooth"]
    figure, axes = styled(new_figure)(7.0, 2.3, 1, 1)
    (line,) = axes[0, 0].plot([0, 1])
    box = styled(key)(figure, [line] * n, [names[i % 8] for i in range(n)], handlelength=2.6)
    figure.draw_without_rendering()

    assert box.get_tightbbox().x0 >= 0
    assert box.get_tightbbox().x1 <= figure.bbox.x1


@pytest.mark.parametrize("style", STYLES)
def test_a_style_has_its_width_and_type(style):
    """No text is smaller than a sixth below the type of the style, and none reaches beyond the figure."""
    with drawn_as(style):
        figure = three()
        figure.draw_without_rendering()
    texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]

    assert figure.get_figwidth() == pytest.approx(WIDTHS[style])
    assert min(text.get_fontsize() for text in texts) >= 0.83 * STYLES[style].points
    for part in (*figure.axes, *figure.legends):
        box = part.get_tightbbox()
        assert box.x0 >= -1
        assert box.x1 <= figure.bbox.x1 + 1
    if style == "talk":
        assert figure.get_figwidth() / figure.get_figheight() == pytest.approx(16 / 9)


def test_panels_go_on_below_in_a_column():
    """And what stands left of a row carries the label of the axis that all share."""
    with drawn_as("paper"):
        figure, whole = three(), three(whole=True)
    columns = [[axes.get_subplotspec().colspan.start for axes in one.axes] for one in (figure, whole)]

    assert columns == [[0, 1, 0], [0, 1, 2]]
    assert [axes.get_ylabel() for axes in figure.axes] == ["error (mm)", "", "error (mm)"]
    assert whole.get_figwidth() == pytest.approx(180 / 25.4)


def test_strokes_grow_with_type():
    """Also the ticks, which do not depend on settings at the time of drawing."""
    widths = {}
    for style in STYLES:
        with drawn_as(style):
            axes = three().axes[0]
        axes.figure.canvas.draw()
        widths[style] = axes.lines[0].get_linewidth(), axes.xaxis.get_ticklines()[0].get_markersize()

    for style, (line, tick) in widths.items():
        assert line == pytest.approx(STYLES[style].points / 8)
        assert tick == pytest.approx(3 * STYLES[style].points / 8)


def test_a_figure_of_ones_own_keeps_its_size():
    """Its type is that of the design, whatever the style is."""
    with drawn_as("page"):
        own = three()
    with drawn_as("talk", own):
        assert new_figure(7.0, 2.0)[0] is own
    assert own.get_figwidth() == pytest.approx(10.8)


def test_an_unknown_style_is_refused():
    with (
        pytest.raises(InputError, match="There is no style 'poster'; styles are page, paper, talk"),
        drawn_as("poster"),  # pyright: ignore[reportArgumentType]
    ):
        pass


@pytest.mark.parametrize("kind", slow_but(["pdf"], ["svg", "pdf", "png"]))
def test_the_same_figure_gives_the_same_file(kind, tmp_path):
    """In every format, and the file is of that kind."""
    for name in ("a", "b"):
        save_as(three(), tmp_path / name, kind)
    first, second = ((tmp_path / name).read_bytes() for name in ("a", "b"))

    assert first == second
    assert {"svg": b"<?xml", "pdf": b"%PDF", "png": b"\x89PNG"}[kind] == first[: 5 if kind == "svg" else 4]


def grey(colour):
    """Luminance of a colour."""
    from matplotlib.colors import to_rgb

    return float(np.dot(to_rgb(colour), (0.2126, 0.7152, 0.0722)))


def test_series_are_told_apart_in_grey():
    """By luminance, mark or line: none of two looks that stand in one panel are alike without their colour."""
    from solidtouch.analysis.audit import figures as audit
    from solidtouch.analysis.compare import figures, figures_decisions
    from solidtouch.analysis.reproduce.figures import _POLICIES, _SERIES
    from solidtouch.analysis.strategies.figures import _GROUPS, _LOOKS

    from benchmarks.speed.figures import COLOURS, MARKS
    from benchmarks.studies.audit.figures import KNOBS

    looks = {
        "models": figures.model_styles([f"m{i}" for i in range(10)], "m0"),
        "decisions": figures_decisions._LOOKS,
        "policies": _POLICIES,
        "answers": _SERIES,
        **{title: {name: _LOOKS[name] for name in ("fixation", *names)} for title, names in _GROUPS.items()},
        "methods": {name: {"color": colour, "marker": MARKS[name]} for name, colour in COLOURS.items()},
        "knobs": {name: {"color": one[0], "marker": one[1], "linestyle": one[2]} for name, one in KNOBS.items()},
        "remedies": {c: {"color": c, "marker": audit._MARKS.get(c, "o")} for c in (audit.TRUE, audit.DECIDED)},
    }
    for title, group in looks.items():
        seen = [(str(look.get("marker")), str(look.get("linestyle")), grey(look["color"])) for look in group.values()]
        for i, (marker, line, light) in enumerate(seen):
            alike = [other for other in seen[i + 1 :] if other[:2] == (marker, line) and abs(other[2] - light) < 0.15]
            assert not alike, title


def test_a_notebook_shows_a_figure_though_nobody_has_loaded_pyplot():
    formatters = pytest.importorskip("IPython.core.formatters", reason="IPython is not installed")
    figure, _ = new_figure(3.0, 2.0)

    assert formatters.PNGFormatter()(figure)[:4] == b"\x89PNG"


def test_a_label_beside_long_names_of_rows_fits_a_narrow_window():
    """What is below a panel has less room where names stand left of it."""
    with drawn_as(NARROW):
        figure, axes = styled(new_figure)(7.0, 2.3, of_text=True)
        axes[0, 0].set_yticks([0, 1], ["differences between sessions", "a"])
        axes[0, 0].set_xlabel("share of the variance of the evidence of 10 taps (%)")
        styled(lambda: figure)()
        figure.draw_without_rendering()

    assert axes[0, 0].xaxis.label.get_window_extent().x1 <= figure.bbox.x1
