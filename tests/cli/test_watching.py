"""`perceive --view`, `perceive --save-episode` and `view`: episodes on a page and in a file."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from types import SimpleNamespace

import pytest
from event_viewer import SOON_S, ask, viewer
from solidtouch.analysis.live.saved import load_episodes
from solidtouch.analysis.live.server import PageServer
from solidtouch.cli.shared import watching
from solidtouch.cli.shared.episode_run import TapPace, default_pace
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset
from solidtouch.models.measurement.histogram import fit

BASE = ("--engine", "numpy", "--seed", 4)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The file of a model."""
    path = tmp_path_factory.mktemp("watching") / "model.nc"
    taps = simulate_session(preset("paper"), 4, 0)
    fit(taps, taps.grid()).save(path)
    return path


@pytest.fixture(autouse=True)
def _nobody_waits(monkeypatch):
    monkeypatch.setattr(watching, "_PROGRAM_S", 0.05)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def printed(out):
    return [json.loads(line) for line in out.splitlines()]


def test_a_file_of_episodes_equals_the_json_line_by_line(command, model, tmp_path):
    """Every field of it, for taps and decisions; the header says what was done."""
    file = tmp_path / "e.json"
    done = command("perceive", model, *BASE, "--episodes", 2, "--json", "--save-episode", file)
    lines, saved = printed(done.out), json.loads(file.read_text())

    assert done.code == 0
    assert f"Episodes: {file}" in done.err
    for kind, rows in (("taps", [row for row in lines if "tap" in row]), ("ends", [r for r in lines if "taps" in r])):
        assert [{key: own[key] for key in row} for own, row in zip(saved[kind], rows, strict=True)] == rows
    header = load_episodes(file).header
    assert header.heading == "simulated rig, preset paper, engine numpy"
    assert (header.theta, header.rule, header.fixation, header.deadline, header.seed) == (0.95, "", 7, 100, 4)
    assert (header.samples, header.taxels, header.rate_hz, len(header.taxel_mm)) == (50, 12, 50.0, 12)
    assert header.reading_unit == "counts"
    again = command("perceive", model, *BASE, "--save-episode", file)
    assert (again.code, "already exists" in again.err) == (2, True)


@pytest.mark.parametrize(
    ("options", "theta", "rule"), [(["--stop", "where:0.5"], None, "where:0.5"), (["--theta", 1], None, "")]
)
def test_rules_without_a_threshold_have_none(command, model, tmp_path, options, theta, rule):
    file = tmp_path / "e.json"
    assert command("perceive", model, *BASE, *options, "--deadline", 2, "--save-episode", file).code == 0
    assert (load_episodes(file).header.theta, load_episodes(file).header.rule) == (theta, rule)


def test_a_recording_is_replayed_with_the_places_and_the_unit_of_its_taxels(command, model, tmp_path):
    simulate_session(preset("paper"), 4, 1).save(tmp_path / "taps.nc")
    base = ("perceive", model, *BASE, "--rig", f"replay:{tmp_path / 'taps.nc'}", "--save-episode")

    assert command(*base, tmp_path / "e.json").code == 0
    header = load_episodes(tmp_path / "e.json").header
    assert (len(header.taxel_mm), header.reading_unit) == (12, "counts")


def test_a_page_that_nobody_opens_ends_with_the_command(command, model):
    """It prints its address, and waits a moment."""
    done = command("perceive", model, *BASE, "--view", "--deadline", 2, "--pace", 0)

    assert done.code == 0
    assert re.search(r"^Page: http://127\.0\.0\.1:\d+/[\w-]{24}/$", done.out, flags=re.MULTILINE)


def test_a_page_is_opened_where_there_is_a_display(command, model, monkeypatch):
    """Unless it must not be."""
    opened = []
    monkeypatch.setenv("DISPLAY", ":0")
    browser = SimpleNamespace(open=opened.append, get=lambda: None, Error=OSError)
    monkeypatch.setattr("solidtouch.analysis.live.feed.webbrowser", browser)
    monkeypatch.setattr(watching, "_BROWSER_S", 0.05)
    base = ("perceive", model, *BASE, "--deadline", 1, "--view")
    done, silent = command(*base), command(*base, "--no-browser")

    assert done.code == silent.code == 0
    assert opened == re.findall(r"http\S+", done.out)


@pytest.fixture
def running(model):
    """A function that starts `perceive --view` as a program and returns it with the address of its page."""
    programs = []

    def start(*options):
        words = [sys.executable, "-m", "solidtouch.cli", "perceive", str(model), *map(str, BASE), "--view", *options]
        program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        programs.append(program)
        for line in program.stderr:
            if line.startswith("Page: "):
                return program, line.split()[1]
        raise AssertionError("no address")

    yield start
    for program in programs:
        program.kill()
        program.communicate()


def test_the_page_of_a_running_program_says_what_it_prints_and_stops_it(running):
    """By the way of Ctrl-C: with its exit code, after the page was told."""
    program, url = running("--json", "--theta", "1", "--deadline", "10000", "--pace", "0.02", "--no-browser")
    with viewer(url) as read:
        (_, kind, start), *taps = read(4)
        assert ask(url, "stop", "POST", Origin="http://evil.example")[0] == 403
        assert ask(url, "stop", "POST", Origin=url.rsplit("/", 2)[0])[0] == 202
        *rest, (_, last, text) = read_all(read)
    out, err = program.communicate(timeout=SOON_S)

    assert (kind, start["stoppable"], start["saved"]) == ("start", True, False)
    assert (last, text["text"]) == ("finished", "the program was stopped")
    rows = printed(out)
    shown = [data for _, _, data in (*taps, *rest)]
    assert len(rows) in {len(shown), len(shown) - 1}  # the last one may have been on its way to the printer
    assert [{key: own[key] for key in row} for own, row in zip(shown, rows, strict=False)] == rows
    assert program.returncode == 130
    assert "interrupted; no file is left incomplete" in err


def read_all(read):
    """Events up to the last."""
    events = []
    while not events or events[-1][1] != "finished":
        events += read(1)
    return events


@pytest.mark.slow
def test_a_program_waits_until_its_page_has_everything(running):
    program, url = running("--json", "--deadline", "3", "--theta", "1")
    time.sleep(1.0)
    with viewer(url) as read:
        kinds = [kind for _, kind, _ in read_all(read)]
    program.communicate(timeout=SOON_S)

    assert kinds == ["start", "tap", "tap", "tap", "end", "finished"]
    assert program.returncode == 0


@pytest.fixture
def file(command, model, tmp_path):
    """A file of an episode."""
    path = tmp_path / "e.json"
    assert command("perceive", model, *BASE, "--deadline", 2, "--save-episode", path).code == 0
    return path


def test_saved_episodes_become_a_page_in_a_file(command, file, tmp_path):
    done = command("view", file, "--out", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()

    assert (done.code, done.out) == (0, f"Page: {tmp_path / 'page.html'}\n")
    assert load_episodes(file).taps[1].sentence.replace(",", ",") in text
    assert not re.findall(r'(?:src|href)="(?!data:)', text)
    assert "already exists" in command("view", file, "--out", tmp_path / "page.html").err


def test_saved_episodes_are_served_until_there_is_no_viewer(command, file):
    done = command("view", file)

    assert done.code == 0
    assert done.out.startswith("Page: http://127.0.0.1:")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["none.json"], "none.json: cannot read: No such file or directory"),
        (["FILE", "--out", "page.txt"], "--out must name an .html file, got page.txt"),
        (["FILE", "--out", "none/page.html"], "cannot write: no folder none"),
        (["FILE", "--out", "page.html", "--port", "8000"], "--out cannot be combined with --port or --no-browser"),
        (["FILE", "--out", "page.html", "--no-browser"], "--out cannot be combined with --port or --no-browser"),
    ],
)
def test_bad_options_of_view_are_one_sentence(command, file, options, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = command("view", *[str(file) if word == "FILE" else word for word in options])

    assert done.code == 2
    assert said in done.err
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def test_in_a_terminal_it_is_served_until_ctrl_c(command, file, monkeypatch):
    def wait(server):
        assert ask(server.url)[0] == 200
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(PageServer, "wait", wait)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    done = command("view", file)

    assert done.code == 0
    assert "Ctrl-C ends" in done.out


def test_a_finished_program_in_a_terminal_waits_for_a_viewer_or_ctrl_c(monkeypatch):
    server = PageServer()
    server.publish_last(b"0")
    said = []

    def waited(first_s):
        assert first_s == float("inf")
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(SOON_S)

    monkeypatch.setattr(server, "wait_until_served", waited)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    try:
        watching.served_out(server, SimpleNamespace(note=said.append), opened=False)
    finally:
        server.close()

    assert said == ["Waiting for a browser to open the page; Ctrl-C ends."]


@pytest.mark.parametrize(
    ("rig", "as_json", "view", "terminal", "pace"),
    [
        ("simulated", False, False, True, 0.5),
        ("simulated:ideal", False, True, False, 0.5),
        ("replay:taps.nc", False, True, True, 0.5),
        ("rig.toml", False, True, True, 0.0),
        ("simulated", True, True, True, 0.0),
        ("simulated", False, False, False, 0.0),
    ],
)
def test_what_is_watched_has_a_pace(monkeypatch, rig, as_json, view, terminal, pace):
    """But programs and devices have none."""
    monkeypatch.setattr("sys.stdout.isatty", lambda: terminal, raising=False)
    assert default_pace(rig, as_json, view) == pace


def test_a_pace_keeps_taps_apart_and_waits_for_none_after_the_last():
    """Also from one episode to the next."""
    pace, began = TapPace(0.05), []
    made = [[SimpleNamespace(move=0), SimpleNamespace(move=None)]] * 2

    def steps(own):
        for step in own:
            began.append(time.monotonic())
            yield step

    for own in made:
        for _ in pace.taps(steps(own)):
            pass
    end = time.monotonic()

    assert all(later - sooner >= 0.05 for sooner, later in pairwise(began))
    assert end - began[-1] < 0.05
