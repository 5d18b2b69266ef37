"""What a page does in a browser: curves, folded parts, dark mode, and room for all widths."""

from functools import partial

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.page.figure_style import band, new_figure, styled
from solidtouch.analysis.page.html import draw_pictures, write_page
from solidtouch.analysis.page.page import Cautions, Embedded, Note, Page, Picture, Section, SideBySide, Table

from benchmarks.browser import PRESENT, chromium, errors, resize

pytest.importorskip("selenium", reason="selenium is not installed")
pytestmark = pytest.mark.skipif(not PRESENT, reason="chromium or chromedriver is not installed")

SOON_S = 10.0
X = np.linspace(0.1, 0.9, 9)


@styled
def curves():
    """Two curves with bands in two panels."""
    figure, axes = new_figure(7.0, 2.4, 1, 2)
    for panel, letter in zip(axes[0], "AB", strict=True):
        for name, colour, value in (("passive", "#c8102e", 2.0), ("active", "#000000", 1.0)):
            data = xr.Dataset(
                {f"e{end}": ("x", value - X + more) for end, more in (("", 0), ("_low", -0.1), ("_high", 0.1))}
            )
            panel.plot(X, data["e"], "o-", label=name, color=colour)
            band(panel, X, data, "e", colour)
        panel.set(xlabel="belief threshold", ylabel="object error (mm)", title=letter)
    return figure


@styled
def scale():
    """Three curves, one for each threshold."""
    figure, axes = new_figure(7.0, 2.4)
    for threshold in (0.2, 0.5, 0.95):
        axes[0, 0].plot(X, threshold * X, label=f"threshold {threshold:g}")
    return figure


def pictures():
    """One whose curves are read off, one that stays a picture, one with curves on a scale, one drawn twice."""
    yield Picture("fig1", "Errors", "Errors against the threshold.", curves, curves=True)
    yield Picture("fig2", "Again", "The same.", curves)
    yield Picture("fig3", "Scale", "One curve for each threshold.", scale, curves=True)
    yield Picture("fig4", "Rows", "Drawn for narrow windows, too.", scale, narrow=True)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A page with every kind of block that the browser has to do with."""
    folder = tmp_path_factory.mktemp("page")
    wide = Table(
        ["model", *(f"error of the object at {i} taps" for i in range(20))], [["a", *["0.50 [0.45, 0.55]"] * 20]]
    )
    first, second, third, fourth = pictures()
    sections = [
        Section("Figures", [first, wide, third, fourth], "figures"),
        Section("More", [Section("Inner", [second], "inner", folded=True)], "more", folded=True),
        Section("Episode", [Embedded("<p id='played'>played</p>", "An episode.")], "episode"),
    ]
    cautions = Cautions([f"Warning {i}." for i in range(5)])
    page = Page("A page", [SideBySide([Note(["Answer."]), wide]), cautions, "See [there](#inner)."], sections)
    write_page(folder, page, {}, "summary.json", draw_pictures(folder, page.pictures, lambda _: None))
    return (folder / "report.html").as_uri()


@pytest.fixture(scope="module")
def driver():
    with chromium() as made:
        yield made


@pytest.fixture
def browser(driver, report):
    """The page, in a window of its own size; nothing may be wrong with it at the end."""
    resize(driver, 1200, 900)
    driver.get("about:blank")
    driver.get(report)
    yield driver
    assert errors(driver) == []


def point_at(browser, x, y):
    """Moves the mouse to a place in the first figure, in fractions of its size."""
    left, top, width, height = browser.execute_script(
        "const plot = document.querySelector('.plot'); plot.scrollIntoView({block: 'center'});"
        "const area = plot.getBoundingClientRect(); return [area.left, area.top, area.width, area.height]"
    )
    place = {"x": left + x * width, "y": top + y * height}
    browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", **place})
    return browser.execute_script(
        "const told = document.querySelector('.told'); return told.hidden ? '' : told.textContent"
    )


def test_a_curve_tells_the_value_that_the_mouse_is_at(browser):
    """Of every point; elsewhere nothing is told, nor in a figure that stays a picture."""
    panels = browser.execute_script("return JSON.parse(document.querySelector('figure').dataset.curves)")
    for panel in panels:
        for series in panel["series"]:
            for x, y, threshold, error, _ in series["points"][::4]:
                lines = point_at(browser, x, y).split("\n")
                assert lines == [
                    f"{panel['title']} – {series['label']}", f"object error (mm): {error}",
                    f"belief threshold: {threshold}",
                ]  # fmt: skip
    assert panels[0]["series"][0]["points"][0][3] == "1.90 [1.80, 2.00]"
    assert point_at(browser, 0.001, 0.001) == ""
    assert browser.find_elements("css selector", "#figure-fig2 .told") == []


def test_curves_are_switched_off_in_the_key(browser):
    """With their bands; they tell nothing then, and the picture for printing keeps them."""
    passive, active = browser.find_elements("css selector", "#figure-fig1 .legend button")
    assert [button.text for button in (passive, active)] == ["passive", "active"]
    shown = partial(
        browser.execute_script,
        "const root = document.querySelector('.drawing').shadowRoot;"
        "return [...root.querySelectorAll('[id^=curve-]')].map((part) => getComputedStyle(part).display !== 'none')",
    )
    assert shown() == [True] * 8
    passive.click()
    assert passive.get_attribute("aria-pressed") == "false"
    assert sum(shown()) == 4
    series = browser.execute_script("return JSON.parse(document.querySelector('figure').dataset.curves)[0].series[0]")
    assert "passive" not in point_at(browser, *series["points"][0][:2])
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert browser.execute_script("return getComputedStyle(document.querySelector('.drawing')).display") == "none"
    assert browser.find_element("css selector", "img").is_displayed()
    resize(browser, 1200, 900)
    passive.click()
    assert shown() == [True] * 8


def test_curves_on_a_scale_are_chosen_by_one_slider(browser):
    """All at first; then one, beside which the others are pale and tell nothing."""
    from selenium.webdriver.common.keys import Keys

    figure = browser.find_element("id", "figure-fig3")
    (slider,), (output,) = (figure.find_elements("css selector", f".legend {part}") for part in ("input", "output"))
    pale = partial(
        browser.execute_script,
        "return [...arguments[0].querySelector('.drawing').shadowRoot.querySelectorAll('[id^=curve-]')]"
        ".map((part) => getComputedStyle(part).opacity < 0.5)",
        figure,
    )
    assert figure.find_elements("css selector", ".legend button") == []
    assert (output.text, pale()) == ("all thresholds", [False] * 3)
    slider.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    assert (output.text, pale()) == ("threshold 0.5", [True, False, True])
    figure.find_element("css selector", ".card > .scroll").send_keys(Keys.ARROW_RIGHT, Keys.ARROW_DOWN)
    assert figure.find_element("css selector", ".told").text.startswith("threshold 0.5\n")
    slider.send_keys(Keys.HOME)
    assert (output.text, pale()) == ("all thresholds", [False] * 3)


def test_the_keyboard_reaches_every_value(browser):
    """Along a curve, to the next, back, and away."""
    from selenium.webdriver.common.keys import Keys

    plot = browser.find_element("css selector", ".card > .scroll")
    told = browser.find_element("css selector", ".told")

    def after(*keys):
        plot.send_keys(*keys)
        return told.text.split("\n")

    assert after(Keys.RIGHT)[:2] == ["A – passive", "object error (mm): 1.90 [1.80, 2.00]"]
    assert after(Keys.RIGHT)[1] == "object error (mm): 1.80 [1.70, 1.90]"
    assert after(Keys.DOWN)[:2] == ["A – active", "object error (mm): 0.80 [0.70, 0.90]"]
    assert after(Keys.DOWN, Keys.END)[:2] == ["B – passive", "object error (mm): 1.10 [1.00, 1.20]"]
    assert after(Keys.UP, Keys.HOME)[0] == "A – active"
    assert told.get_attribute("role") == "status"
    assert after(Keys.ESCAPE) == [""]


def test_links_and_printing_open_folded_parts(browser):
    """Also those inside of others, and those that were closed again; a browser tells of a new hash when it has time."""
    from selenium.webdriver.support.ui import WebDriverWait

    inner, link = browser.find_element("id", "inner"), browser.find_element("link text", "there")
    for _ in range(2):
        assert inner.get_attribute("open") is None
        link.click()
        WebDriverWait(browser, SOON_S, 0.01).until(lambda _: inner.get_attribute("open") is not None)
        assert browser.find_element("id", "figure-fig2").is_displayed()
        browser.execute_script("for (const part of document.querySelectorAll('details')) part.open = false")
    browser.execute_script("dispatchEvent(new Event('beforeprint'))")
    assert browser.find_element("id", "figure-fig2").is_displayed()
    browser.execute_script("dispatchEvent(new Event('afterprint'))")
    assert not browser.find_element("id", "figure-fig2").is_displayed()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [420, 900, 1600])
def test_a_page_has_room_in_every_window(browser, width, scheme):
    """It never scrolls sideways, its tables do and fade where they are cut off; figures are on a light card,
    which does not fade."""
    resize(browser, width, 900, scheme)
    told = browser.execute_async_script(
        "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => {"
        "const colour = (name, part) => getComputedStyle(document.querySelector(part))[name];"
        "done([document.documentElement.scrollWidth <= innerWidth,"
        "  [...document.querySelectorAll('.scroll')].every((part) => !part.checkVisibility() ||"
        "    (part.scrollWidth - part.clientWidth > 1) === part.classList.contains('more')) &&"
        "    !document.querySelector('.card.more'),"
        "  colour('backgroundColor', 'html') + colour('backgroundColor', 'body'), colour('backgroundColor', '.card'),"
        "  colour('color', 'body')])}))"
    )
    fits, fades, page, card, text = told
    assert fits
    assert fades
    assert card == "rgb(255, 255, 255)"
    assert ("rgb(255, 255, 255)" in page) == (scheme == "light")
    assert (text == "rgb(26, 26, 26)") == (scheme == "light")


@pytest.mark.parametrize("width", [420, 1600])
def test_a_narrow_window_has_its_own_picture_and_arrows_where_there_is_more(browser, width):
    """The picture is whole in it; wide tables have an arrow until they are scrolled to their end."""
    resize(browser, width, 900)
    whole, drawn_for_it, arrows, at_the_end = browser.execute_async_script(
        "const done = arguments[0], figure = document.querySelector('#figure-fig4');"
        "const image = figure.querySelector('img'), scroll = figure.querySelector('.scroll');"
        "const table = document.querySelector('table').closest('.frame');"
        "const arrow = () => getComputedStyle(table, '::after').content !== 'none';"
        "const drawn = () => requestAnimationFrame(() => requestAnimationFrame(() => {"
        "  const arrows = arrow();"
        "  table.firstElementChild.scrollLeft = 1e5;"
        "  requestAnimationFrame(() => requestAnimationFrame(() => done([scroll.scrollWidth <= scroll.clientWidth,"
        "    image.currentSrc !== image.src, arrows, arrow()])));"
        "}));"
        "image.decode().then(drawn);"
    )
    assert whole
    assert drawn_for_it == (width == 420)
    assert arrows
    assert not at_the_end


def test_without_script_everything_is_there(driver, report):
    """Pictures in place of curves, and folded parts that open."""
    driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        driver.get(report)
        assert driver.find_elements("css selector", ".drawing, .legend") == []
        assert driver.find_element("css selector", "img").is_displayed()
        driver.find_element("css selector", "#more > summary").click()
        assert driver.find_element("css selector", "#inner > summary").is_displayed()
    finally:
        driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
