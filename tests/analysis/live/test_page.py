"""The page in a real browser: what it shows, and that it keeps up, comes back and stays."""

import json
import math
import time
from contextlib import contextmanager

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.analysis.live.feed import finish_data, serve_saved, start_data
from solidtouch.analysis.live.fragment import fragment, whole_page
from solidtouch.analysis.live.saved import encoded, encoded_episodes, recorded
from solidtouch.analysis.live.server import PageServer
from solidtouch.analysis.live.view import _COLOURS

from benchmarks.browser import ARTEFACTS, PRESENT, chromium, errors, picture, resize

pytest.importorskip("selenium", reason="selenium is not installed")
if not PRESENT:
    pytest.skip("chromium and chromedriver are not installed", allow_module_level=True)

SOON_S, AT_ONCE_S = 10.0, 0.1


@pytest.fixture(scope="module")
def driver():
    with chromium() as made:
        yield made


@pytest.fixture
def page(driver):
    """The browser, the console of which must have said nothing at the end."""
    errors(driver)
    resize(driver, 1600, 1000)
    yield driver
    said = errors(driver)
    driver.get("about:blank")
    assert said == []


@pytest.fixture
def server():
    made = PageServer(stop=lambda: None)
    yield made
    made.close()


def ask(driver, code, *given):
    """Value of an expression in which `player` is the player."""
    return driver.execute_script(f"const player = document.querySelector('.st-player').player; return {code}", *given)


def until(driver, code, seconds=SOON_S):
    """Waits until an expression is true."""
    end = time.monotonic() + seconds
    while not ask(driver, code):
        assert time.monotonic() < end, f"{code} stays false; the status is {ask(driver, 'player.at')}"
        time.sleep(0.01)


def start(server, episodes):
    server.publish("start", start_data(encoded(episodes.header), stoppable=True))


def publish(server, episodes, tap):
    server.publish("tap", encoded(episodes.taps[tap]))
    if tap + 1 == len(episodes.taps) or episodes.taps[tap + 1].episode != episodes.taps[tap].episode:
        server.publish("end", encoded(episodes.ends[episodes.taps[tap].episode - 1]))


NUMBERS = """(() => {
  const rows = [...document.querySelectorAll('.st-numbers tbody tr')];
  return Object.fromEntries(rows.map((row) => [row.dataset.name, row.querySelector('td').textContent]));
})()"""


def numbers(driver):
    """The record that the page shows in its table, with values as JSON has them."""
    shown = driver.execute_script(f"return {NUMBERS}")
    plain = {name: value for name, value in shown.items() if "." not in name}
    read = {
        name: None if value == "–" else value if name == "what" else json.loads(value) for name, value in plain.items()
    }
    for name in ("what_marginal", "where_marginal"):
        read[name] = [json.loads(value) for key, value in shown.items() if key.startswith(f"{name}.")]
    return read


def colour(belief):
    """Colour of a belief by the terminal's table."""
    at = math.sqrt(belief) * (len(_COLOURS) - 1)
    low = min(int(at), len(_COLOURS) - 2)
    return _COLOURS[low] + (at - low) * (_COLOURS[low + 1] - _COLOURS[low])


CELLS = """((L, M) => {
  const canvas = document.querySelector('.st-belief canvas'), ratio = canvas.width / canvas.clientWidth;
  const { left, top, width, height } = canvas.heatMap;
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  const at = (l, m) => [left + (l + 0.2) * width / L, top + (m + 0.85) * height / M].map((v) => Math.round(v * ratio));
  const pixel = ([x, y]) => [...data.slice(4 * (y * canvas.width + x), 4 * (y * canvas.width + x) + 3)];
  return Array.from({ length: L }, (_, l) => Array.from({ length: M }, (_, m) => pixel(at(l, m))));
})(...arguments)"""


def test_each_tap_is_shown_at_once_and_as_the_program_prints_it(page, server, episodes):
    """Within a tenth of a second, if the machine does not halt; numbers equal the JSON, and words the terminal's."""
    page.get(server.url)
    page.execute_script("document.querySelector('.st-numbers').open = true")
    start(server, episodes)
    late = []
    for tap, record in enumerate(episodes.taps):
        began = time.time()
        publish(server, episodes, tap)
        until(page, f"player.shownAt[{tap}] !== undefined")
        late.append(ask(page, f"player.shownAt[{tap}]") / 1000 - began)
        until(page, f"document.querySelector('[data-name=tap] td').textContent === '{record.tap}'")
        content = json.loads(encoded(record))
        assert numbers(page) == {name: content[name] for name in numbers(page)}
        assert page.execute_script("return document.querySelector('.st-sentence').textContent") == record.sentence
    server.publish_last(finish_data("the program has ended"))
    until(page, "document.querySelector('.st-player').dataset.status === 'ended'")

    assert np.median(late) < AT_ONCE_S
    assert len(numbers(page)) == 13
    assert ask(page, "document.querySelector('.st-end').textContent").startswith(episodes.ends[1].sentence)
    assert ask(page, "document.querySelector('.st-stop').hidden")


def test_the_heat_map_has_the_colours_of_the_beliefs(page, server, episodes):
    """Read back from the picture."""
    page.get(server.url)
    start(server, episodes)
    publish(server, episodes, 2)
    until(page, "player.shownAt[0] !== undefined")
    L, M = len(episodes.header.where_value), len(episodes.header.what_name)
    got = page.execute_script(f"return {CELLS}", L, M)
    wanted = [[colour(belief) for belief in row] for row in episodes.taps[2].belief]

    np.testing.assert_allclose(got, wanted, atol=2)


def test_a_reload_and_a_second_tab_show_all_taps_once(page, server, episodes):
    page.get(server.url)
    start(server, episodes)
    for tap in range(3):
        publish(server, episodes, tap)
    until(page, "player.taps.length === 3")
    page.refresh()
    until(page, "player.taps.length === 3")
    first = page.current_window_handle
    page.switch_to.new_window("tab")
    page.get(server.url)
    until(page, "player.taps.length === 3")
    publish(server, episodes, 3)
    for handle in (page.current_window_handle, first):
        page.switch_to.window(handle)
        until(page, "player.taps.length === 4")
        assert ask(page, "player.taps.map((tap) => tap.tap)") == [1, 2, 3, 4]
    page.switch_to.window(next(one for one in page.window_handles if one != first))
    page.close()
    page.switch_to.window(first)


def test_a_server_that_goes_away_leaves_the_page_as_it_is(driver, episodes):
    """A lost connection is mended by the page itself, without a tap too few or too many."""
    server = PageServer()
    try:
        driver.get(server.url)
        start(server, episodes)
        publish(server, episodes, 0)
        until(driver, "player.taps.length === 1")
        server._loop.call_soon_threadsafe(lambda: [viewer.drop() for viewer in server._positions])
        until(driver, "document.querySelector('.st-player').dataset.status === 'lost'")
        publish(server, episodes, 1)
        until(driver, "player.taps.length === 2")
        until(driver, "document.querySelector('.st-player').dataset.status === 'live'")
    finally:
        server.close()
    until(driver, "document.querySelector('.st-player').dataset.status === 'lost'")
    driver.find_element("css selector", "[title='One tap back']").click()
    until(driver, "document.querySelector('.st-sentence').textContent.startsWith('tap 1:')")

    assert ask(driver, "player.taps.map((tap) => tap.tap)") == [1, 2]
    assert all("net::ERR_" in said for said in errors(driver))
    driver.get("about:blank")


@contextmanager
def saved(driver, episodes):
    """The page with recorded episodes, held at the first tap."""
    server = serve_saved(episodes)
    try:
        driver.get(server.url)
        until(driver, f"player.taps.length === {len(episodes.taps)} && player.playing")
        press(driver, " ", "Home")
        yield server
    finally:
        server.close()


def press(driver, *keys):
    for key in keys:
        driver.execute_script("document.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0]}))", key)


def test_keys_move_through_taps_and_episodes(page, episodes):
    """Ends are ends; the scrubber and the menus say the same."""
    with saved(page, episodes):
        steps = [
            ("Home", 0), ("ArrowLeft", 0), ("ArrowRight", 1), ("ArrowRight", 2), ("PageDown", 5), ("PageDown", 5),
            ("ArrowRight", 6), ("Home", 5), ("PageUp", 0), ("End", 9), ("ArrowRight", 9),
        ]  # fmt: skip
        for key, at in steps:
            press(page, key)
            assert ask(page, "player.at") == at, key
        until(page, "document.querySelector('.st-place').textContent === 'tap 5 of 5'")
        assert ask(page, "document.querySelector('[aria-label=Episode]').value") == "2"
        assert ask(page, "document.querySelector('[aria-label=Tap]').value") == "4"
        for key, pace in (("+", 0.25), ("+", 0.1), ("-", 0.25), ("-", 0.5), ("-", 1), ("-", 2), ("-", 2)):
            press(page, key)
            assert ask(page, "player.pace") == pace


def test_play_goes_through_all_episodes_at_its_pace_and_stops_at_the_end(page, episodes):
    with saved(page, episodes):
        press(page, *"++++")
        began = time.monotonic()
        press(page, " ")
        until(page, "!player.playing")

        assert 0.5 < time.monotonic() - began < 4
        assert ask(page, "player.at") == 9
        press(page, " ")
        until(page, "player.at === 1")


def test_a_pause_lets_taps_come_and_play_catches_up(page, server, episodes):
    """The rig does not wait; behind the newest tap the page says how far."""
    page.get(server.url)
    start(server, episodes)
    publish(server, episodes, 0)
    until(page, "player.at === 0")
    press(page, " ")
    for tap in range(1, 5):
        publish(server, episodes, tap)
    until(page, "player.taps.length === 5")
    assert (ask(page, "player.at"), ask(page, "player.playing")) == (0, False)
    until(page, "document.querySelector('.st-place').textContent.includes('4 behind')")
    press(page, *"++++", " ")
    until(page, "player.at === 4 && player.following")
    publish(server, episodes, 5)
    until(page, "player.at === 5")


END_COLOURS = """((right) => {
  player.end({ ...player.episodes.get(2).end, right });
  player.draw();
  const colour = (name) => {
    const probe = document.createElement('p');
    probe.style.color = `var(--st-${name})`;
    document.querySelector('.st-player').append(probe);
    return [getComputedStyle(probe).color, probe.remove()][0];
  };
  const edge = getComputedStyle(document.querySelector('.st-words')).borderLeftColor;
  return ['true', 'wrong', 'mark', 'ink', 'bar'].filter((name) => colour(name) === edge);
})(...arguments)"""


def test_right_and_wrong_ends_have_colours_of_their_own(page, episodes):
    """Neither is that of the threshold; an end that nobody can judge has the colour of text."""
    with saved(page, episodes):
        press(page, "PageDown", "End")
        ends = {right: ask(page, END_COLOURS, right) for right in (True, False, None)}

    assert ends == {True: ["true"], False: ["wrong"], None: ["ink"]}


def test_panels_of_a_row_end_at_one_height(page, episodes):
    """Belief and finger; fingertip, readings and evidence."""
    with saved(page, episodes):
        until(page, "player.shownAt[0] !== undefined")
        bottoms = page.execute_script(
            "return [...document.querySelectorAll('.st-panel')].map((one) => one.getBoundingClientRect().bottom)"
        )

    assert bottoms == [bottoms[0]] * 2 + [bottoms[2]] * 3


CONTRASTS = """(async (done) => {
  const { lineRgb, themeOf } = await import(new URL('colours.js', location));
  const theme = themeOf(document.querySelector('.st-player'));
  const light = (rgb) => rgb.map((v) => (v / 255 <= 0.04045 ? v / 3294.6 : ((v / 255 + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0.05);
  const card = light(theme.card.match(/[0-9.]+/g).map(Number));
  const ratio = (value) => { const line = light(lineRgb(value, theme)); return Math.max(line / card, card / line); };
  done(Math.min(...Array.from({ length: 101 }, (_, i) => ratio(i / 100))));
})(...arguments)"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_curve_stands_out_from_its_ground(page, episodes, scheme):
    resize(page, 1600, 1000, scheme)
    with saved(page, episodes):
        assert page.execute_async_script(CONTRASTS) > 2.3


def test_names_are_text(page, episodes):
    """Markup in the name of an object is shown, not run; in an embedded page it ends no script."""
    with saved(page, episodes):
        assert page.execute_script("return document.querySelectorAll('img').length") == 0
        page.execute_script("document.querySelector('.st-numbers').open = true")
        until(page, f"document.body.textContent.includes({json.dumps(episodes.header.what_name[1])})")


def test_the_stop_button_stops_the_program(page, episodes):
    stopped = []
    server = PageServer(stop=lambda: stopped.append(1))
    try:
        page.get(server.url)
        start(server, episodes)
        until(page, "!document.querySelector('.st-stop').hidden")
        page.find_element("css selector", ".st-stop").click()
        end = time.monotonic() + SOON_S
        while not stopped and time.monotonic() < end:
            time.sleep(0.01)
    finally:
        server.close()
    errors(page)  # the server has gone

    assert stopped == [1]


SIZES = {
    "one": {"L": 1, "M": 1, "J": 1, "K": 1, "episodes": 1},
    "many": {"L": 200, "M": 100, "J": 3, "K": 7, "episodes": 1, "deadline": 2},
    "taxels": {"L": 3, "M": 2, "J": 20, "K": 4000, "episodes": 1, "deadline": 2},
    "long": {"L": 5, "M": 3, "J": 4, "K": 3, "episodes": 1, "deadline": 100},
}


WINDOWS = [(width, scheme, name) for name in SIZES for width, scheme in ((420, "dark"), (1600, "light"))]
EACH_SIZE = [(420, "dark", "one"), (1600, "light", "many"), (420, "dark", "taxels"), (1600, "light", "long")]


@pytest.mark.parametrize(("width", "scheme", "name"), slow_but(EACH_SIZE, WINDOWS))
def test_any_size_fits_any_width(page, seen_episodes, name, width, scheme):
    """Nothing is wider than the page, all pictures are drawn, and that takes no longer than a tap."""
    episodes = recorded(*seen_episodes(**SIZES[name]))
    resize(page, width, 900, scheme)
    with saved(page, episodes):
        press(page, "End")
        until(page, f"player.shownAt[{len(episodes.taps) - 1}] !== undefined")
        assert page.execute_script("return document.documentElement.scrollWidth") <= width
        drawn = page.execute_script("return [...document.querySelectorAll('canvas')].map((c) => c.toDataURL().length)")
        assert min(drawn) > 2000 - 1000 * (name == "one")
        dark = page.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert dark == ("rgb(22, 24, 27)" if scheme == "dark" else "rgb(255, 255, 255)")
        picture(page, ARTEFACTS / f"size-{name}-{width}-{scheme}.png")
        drawing = "(() => { const t = performance.now(); player.draw(); return performance.now() - t })()"
        assert min(ask(page, drawing) for _ in range(3)) < 1000 * AT_ONCE_S


def test_a_page_of_its_own_plays_without_a_server(page, episodes, tmp_path):
    """And holds all words where scripts do not run."""
    path = tmp_path / "page.html"
    path.write_text(whole_page(episodes), encoding="utf-8")
    page.get(path.as_uri())
    until(page, "player.shownAt[9] !== undefined")
    shown = page.execute_script("return getComputedStyle(document.querySelector('.st-static')).display")

    assert shown == "none"
    assert page.execute_script("return performance.getEntriesByType('resource').length") == 0
    assert ask(page, "player.taps.length") == 10
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert page.execute_script("return getComputedStyle(document.querySelector('.st-static')).display") == "block"
    assert page.execute_script("return document.querySelectorAll('.st-static li').length") == 12
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_two_fragments_on_a_page_have_a_player_each(page, episodes, tmp_path):
    """Also of two programs, which know nothing of each other."""
    (tmp_path / "page.html").write_text(fragment(episodes) * 2, encoding="utf-8")
    page.get((tmp_path / "page.html").as_uri())
    counts = "return [...document.querySelectorAll('.st-player')].map((one) => one.player.taps.length)"

    assert page.execute_script(counts) == [10, 10]


def test_the_widget_is_the_same_player(page, episodes, tmp_path):
    """Its module, run as notebooks run it."""
    pytest.importorskip("anywidget", reason="anywidget is not installed")
    from solidtouch.analysis.live.widget import EpisodeWidget

    (tmp_path / "cell.html").write_text(f"<style>{EpisodeWidget._css}</style><div id='cell'></div>", encoding="utf-8")
    page.get((tmp_path / "cell.html").as_uri())
    page.execute_async_script(
        """const [code, episodes, done] = arguments;
        import(URL.createObjectURL(new Blob([code], { type: 'text/javascript' }))).then((module) => {
          const model = { get: () => episodes }, el = document.getElementById('cell');
          window.remove = module.default.render({ model, el });
          done();
        });""",
        EpisodeWidget._esm,
        encoded_episodes(episodes).decode(),
    )
    until(page, "player.playing && player.at === 1")
    page.execute_script("window.remove()")

    assert page.execute_script("return document.querySelectorAll('canvas').length") == 0


@pytest.mark.slow
def test_the_page_of_a_long_run_leaves_out_its_oldest_episodes(page, server, episodes):
    """And stays at the tap that it shows."""
    page.get(server.url)
    shown = page.execute_async_script(
        """const [content, done] = arguments, { header, taps, ends } = JSON.parse(content);
        import(`${location.href}player.js`).then(({ createPlayer }) => {
          const root = document.body.appendChild(document.createElement("div"));
          const player = createPlayer(root, { memory: 6 * 42 });
          player.begin(header);
          for (let round = 0; round < 3; round += 1) {
            for (const tap of taps) player.tap({ ...tap, episode: tap.episode + 2 * round });
            for (const end of ends) player.end({ ...end, episode: end.episode + 2 * round });
          }
          const first = [...player.episodes.values()].map((own) => own.first);
          done([player.taps.map((tap) => tap.episode), first, player.at]);
        });""",
        encoded_episodes(episodes).decode(),
    )
    assert shown == [[6] * 5, [0], 0]
