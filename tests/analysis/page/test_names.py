"""Names that mean something to a figure, a page or a terminal are shown as they are, or escaped."""

import re
import shutil
import subprocess
from base64 import b64decode

import numpy as np
import pytest
from hostile_names import NAMES, UNIT
from matplotlib.text import Text
from slow_cases import slow_but
from solidtouch.analysis.page.figure_confusion import confusion
from solidtouch.analysis.page.figure_sizes import new_figure
from solidtouch.analysis.page.figure_style import save, short, styled
from solidtouch.analysis.page.html import draw_pictures, write_page
from solidtouch.analysis.page.page import Brief, Cautions, Listing, Page, Picture, Section, Table
from solidtouch.analysis.page.terminal import as_text
from solidtouch.cli.main import run
from solidtouch.models.grid import ClassGrid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

L, M, J, K = 4, len(NAMES), 20, 4
CHROMIUM = shutil.which("chromium")


def session(seed):
    """Taps of every object at every position, which can be told apart."""
    rng = np.random.default_rng(seed)
    where, what = (each.ravel() for each in np.indices((L, M * 8)))
    what = what // 8
    time = np.linspace(0, 1, J)[:, np.newaxis]
    waves = where[:, np.newaxis, np.newaxis] * np.sin(3 * time) + (1 + what[:, np.newaxis, np.newaxis]) * np.cos(time)
    return TapSet.from_arrays(
        waves * np.arange(1, K + 1) + rng.normal(size=(len(where), J, K)),
        what,
        NAMES,
        where=where.astype(float),
        where_value=np.arange(L, dtype=float),
        where_unit=UNIT,
        what_value=np.arange(M, dtype=float),
        what_unit=UNIT,
        preprocessing=Preprocessing(samples=J),
    )


@pytest.fixture(scope="module")
def taps():
    return session(0)


def test_names_are_printable_alike_in_taps_and_grids(taps):
    """And still tell objects apart."""
    grid = ClassGrid([0.0], UNIT, None, NAMES)

    assert list(grid.what_name) == taps.what_name == list(taps.grid().what_name)
    assert grid.where_unit == taps.where_unit == "mm $x_{$ <b>\\x1b[31m"
    assert grid.what_name[:3] == tuple(NAMES[:3])
    assert grid.what_name[5] == r"esc\x1b[31m\r\n\ttab [bold]{0}%s"
    assert all(name.isprintable() and len(name) <= 80 for name in grid.what_name)
    assert len({*ClassGrid([0.0], "", None, ["a" * 100 + str(i) for i in range(50)]).what_name}) == 50


def test_texts_of_figures_are_no_formulas(tmp_path, recwarn):
    """But the numbers at axes with powers are."""

    @styled
    def draw():
        figure, axes = new_figure(3.0, 2.0)
        axes[0, 0].plot([1, 10, 100], label=short(NAMES[2]))
        axes[0, 0].set(xlabel=NAMES[0], yscale="log", title=NAMES[0])
        axes[0, 0].legend()
        return figure

    figure = draw()
    save(figure, tmp_path, "figure")
    save(confusion(np.eye(M), np.eye(M), NAMES, 0.9), tmp_path, "confusion")
    texts = {text.get_text(): text for text in figure.findobj(Text) if text.get_text()}

    assert not recwarn.list
    assert texts["$\\mathdefault{10^{1}}$"].get_parse_math()
    assert not texts[NAMES[0]].get_parse_math()
    assert short(NAMES[2]) in texts
    assert all(len(short(name)) <= 29 for name in NAMES)


def pictures():
    yield Picture("fig1", NAMES[1], NAMES[4][:200], lambda: confusion(np.eye(M), np.eye(M), NAMES, 0.9))

    @styled
    def curves():
        figure, axes = new_figure(3.0, 2.0)
        for i, name in enumerate(NAMES):
            axes[0, 0].plot([0, 1], [i, i + 1], label=name)
        axes[0, 0].set(xlabel=NAMES[0], ylabel=NAMES[1], title=NAMES[2])
        return figure

    yield Picture("fig2", NAMES[2], NAMES[3][:200], curves, curves=True)


@pytest.fixture(scope="module")
def page(tmp_path_factory, taps):
    """A page with the names everywhere."""
    folder, names = tmp_path_factory.mktemp("page"), taps.what_name
    table = Table(["object", *names], [[name, *["0.50 [0.45, 0.55]"] * M] for name in names], names[1])
    blocks = [*names, Listing(names, names[1]), Cautions(names), Brief(table), *pictures()]
    page = Page(names[1], blocks, [Section(names[2], names)])
    write_page(folder, page, {"names": names}, "summary.json", draw_pictures(folder, [*pictures()], lambda _: None))
    assert "\x1b" not in as_text(page, 80)
    return folder / "report.html"


def shown(page, width):
    """Title, widths of window and content, and errors of a page in a browser."""
    probe = page.with_name(f"probe-{width}.html")
    text = page.read_text(encoding="utf-8")
    scripts = "document.querySelectorAll('script:not(.st-episode script)').length"
    told = f"`${{document.title}}|${{innerWidth}}|${{document.documentElement.scrollWidth}}|${{{scripts}}}`"
    probe.write_text(
        text + f"<script>document.body.id = btoa(unescape(encodeURIComponent({told})))</script>", encoding="utf-8"
    )
    words = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", f"--window-size={width},900", "--dump-dom"]
    done = subprocess.run([*words, probe.as_uri()], capture_output=True, text=True, timeout=60, check=True)
    return b64decode(re.search(r'<body id="([^"]+)"', done.stdout)[1]).decode().split("|")


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize("width", slow_but([500], [500, 1600]))
def test_a_browser_runs_no_script_of_a_name(page, width):
    """And the page is no wider than the window; wide tables scroll on their own."""
    title, window, content, scripts = shown(page, width)

    assert title == NAMES[1]
    assert int(content) <= int(window)
    assert scripts == "2"  # the page's own and the probe


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize(
    "words",
    [
        ["reproduce", "--data", "0.nc", "1.nc", "--quick"],
        ["compare", "0.nc", "1.nc", "--models", "histogram,gaussian", "--quick"],
        ["audit", "0.nc", "1.nc", "2.nc", "--quick"],
    ],
    ids=lambda words: words[0],
)
def test_pages_of_commands_in_a_browser(tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    for i in range(3):
        session(i).save(f"{i}.nc")
    monkeypatch.setattr("sys.argv", ["solidtouch", *words, "--out", "out"])
    with pytest.raises(SystemExit) as stop:
        run()

    assert not stop.value.code
    for width in (500, 1600):
        title, window, content, scripts = shown(tmp_path / "out" / "report.html", width)
        assert title != "taken"
        assert int(content) <= int(window)
        assert scripts == "2"
    assert "could not be drawn" not in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
