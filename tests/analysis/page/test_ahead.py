"""Figures drawn ahead, on a thread and in a process of their own."""

import json
import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from threading import Event, get_ident

import numpy as np
import pytest
from matplotlib.figure import Figure
from solidtouch.analysis.page.ahead import draw_ahead, drawing_ahead, later
from solidtouch.analysis.page.html import Image, draw_pictures
from solidtouch.analysis.page.page import Picture

SCRIPT = """
import json, os, signal, sys, time, warnings
from functools import partial
from pathlib import Path

import numpy as np
from solidtouch.analysis.page import html
from solidtouch.analysis.page.ahead import draw_ahead, drawing_ahead
from solidtouch.analysis.page.figure_sizes import new_figure
from solidtouch.analysis.page.page import Picture

pids = Path("pids")

def curve(data):
    with pids.open("a") as file:
        print(os.getpid(), file=file)
    if not data.any():
        return None
    figure, axes = new_figure(3, 2)
    axes[0, 0].plot(data, label="$a$")
    axes[0, 0].legend()
    return figure

def doubtful(data):
    warnings.warn("doubtful", stacklevel=1)
    return curve(data)

def fails(data):
    raise ZeroDivisionError("nothing")

def drawn(draws, ahead=True, before=lambda: None, name="figures"):
    folder = Path(name)
    folder.mkdir()
    pictures = [Picture(f"fig{i}", "", "", draw) for i, draw in enumerate(draws)]
    if not ahead:
        return html.draw_pictures(folder, pictures, lambda _: None)
    with drawing_ahead():
        before()
        draw_ahead(draws)
        return html.draw_pictures(folder, pictures, lambda _: None)

def who():
    own = [int(line) == os.getpid() for line in pids.read_text().split()]
    pids.unlink()
    return own

def children():
    return Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()
"""
FORKS = pytest.mark.skipif(sys.platform != "linux", reason="other systems draw on a thread")


def script(folder, code):
    """What a program prints last, as JSON."""
    words = [sys.executable, "-c", SCRIPT + code]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr


def test_figures_are_drawn_ahead_once_and_on_another_thread(tmp_path):
    """Those with the same data: equal ones may be of another report."""
    threads = []

    def draw(data):
        threads.append(get_ident())
        return Figure() if data.any() else None

    data, equal, empty = np.ones(2), np.ones(2), np.zeros(2)
    pictures = [Picture(f"fig{i}", "", "", partial(draw, part)) for i, part in enumerate((data, equal, empty))]
    draw_ahead([partial(draw, data)])
    assert not threads
    with drawing_ahead():
        draw_ahead(partial(draw, part) for part in (data, empty, data))
        images = draw_pictures(tmp_path, pictures, lambda _: None)
    assert set(images) == {"fig0", "fig1"}
    assert [thread == get_ident() for thread in threads] == [False, False, True]
    assert (tmp_path / "fig0.svg").read_bytes() == (tmp_path / "fig1.svg").read_bytes()


def test_figures_with_other_options_are_other_figures(tmp_path):
    draws = [partial(Figure, figsize=(width, 1)) for width in (1, 2)]
    with drawing_ahead():
        draw_ahead(draws)
        images = draw_pictures(
            tmp_path, [Picture(f"fig{i}", "", "", draw) for i, draw in enumerate(draws)], lambda _: None
        )
    assert [image.width for image in images.values()] == [96, 192]


def test_a_figure_that_cannot_be_drawn_ahead_costs_no_other(tmp_path):
    fails, works = partial(int, "x"), partial(Figure)
    pictures = [Picture("fig0", "", "", fails), Picture("fig1", "", "", works)]
    with drawing_ahead():
        draw_ahead([fails, works])
        with pytest.warns(UserWarning, match="fig0 could not be drawn: ValueError"):
            images = draw_pictures(tmp_path, pictures, lambda _: None)
    assert isinstance(images["fig1"], Image)


def test_a_figure_that_waits_for_its_stage_holds_up_no_other(tmp_path):
    """And each is drawn once, though the page asks for all of them again."""
    ended, done, count = Event(), Event(), []

    def waiting():
        ended.wait(20)
        yield late

    def late():
        count.append("late")
        return Figure()

    def draw():
        count.append("draw")
        done.set()
        return Figure()

    with drawing_ahead():
        draw_ahead(waiting())
        draw_ahead([draw])
        assert done.wait(5)
        ended.set()
        draw_ahead([late, draw])
        images = draw_pictures(tmp_path, [Picture(one.__name__, "", "", one) for one in (late, draw)], lambda _: None)
    assert count == ["draw", "late"]
    assert set(images) == {"late", "draw"}


def test_a_module_is_loaded_when_its_function_is_called():
    (blocks,) = later("solidtouch.models", "blocks")
    (same,) = later("solidtouch.models", "blocks")

    assert blocks.over_blocks == same.over_blocks
    assert [*blocks.over_blocks(np.ones((2, 1, 1)), lambda block, _: block.sum())] == [2.0]


def test_a_process_with_threads_does_not_fork():
    script = "import threading, time\nfrom solidtouch.analysis.tasks.beside import can_fork\n"
    script += "print(can_fork())\nthreading.Thread(target=time.sleep, args=(1,)).start()\nprint(can_fork())\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(sys.platform == "linux"), "False"]


@FORKS
def test_another_process_draws_the_same(tmp_path):
    """Pixels as well, and what there is nothing to draw for is left out."""
    found, _ = script(
        tmp_path,
        """
html._IMAGE_BYTES = 100
draws = [partial(curve, part) for part in (np.arange(4.0), np.zeros(3))]
there = drawn(draws, name="there")
apart = who()
here = drawn(draws, ahead=False, name="here")
same = [path.read_bytes() == Path("here", path.name).read_bytes() for path in sorted(Path("there").iterdir())]
print(json.dumps([apart, who(), there == here, same, children()]))
""",
    )
    assert found == [[False, False], [True, True], True, [True, True], []]


@FORKS
def test_what_the_process_cannot_draw_is_drawn_here(tmp_path):
    """What cannot be sent, and all of it when the process is killed."""
    found, _ = script(
        tmp_path,
        """
class Local:
    def any(self):
        return False

def unsent():
    class Inner(Local): pass
    return partial(curve, Inner())

images = drawn([unsent(), partial(curve, np.ones(2))], name="unsent")
first = who()
kill = lambda: os.kill(int(children()[0]), signal.SIGKILL)
again = drawn([partial(curve, np.ones(2)), partial(curve, np.ones(3))], before=kill, name="killed")
print(json.dumps([[*images], first, [*again], who(), children()]))
""",
    )
    assert found == [["fig1"], [True, False], ["fig0", "fig1"], [True, True], []]


@FORKS
def test_warnings_and_failures_are_told(tmp_path):
    found, told = script(
        tmp_path,
        """
images = drawn([partial(doubtful, np.ones(2)), partial(doubtful, np.ones(3)), partial(fails, np.ones(2))])
print(json.dumps([who(), images["fig2"]]))
""",
    )
    assert found == [[False, False], "The figure fig2 could not be drawn: ZeroDivisionError, nothing"]
    assert told.count("UserWarning: doubtful") == 1
    assert told.count("UserWarning: The figure fig2 could not be drawn") == 1


@FORKS
def test_an_interrupted_study_leaves_no_process(tmp_path):
    """Not even one that draws; and nothing more is drawn."""
    found, _ = script(
        tmp_path,
        """
def slow(data):
    pids.write_text("begun")
    time.sleep(60)

began = time.monotonic()
try:
    with drawing_ahead():
        draw_ahead([partial(slow, np.ones(2)), partial(curve, np.ones(2))])
        while not (pids.exists() and pids.read_text()):
            time.sleep(0.01)
        raise KeyboardInterrupt
except KeyboardInterrupt:
    pass
print(json.dumps([time.monotonic() - began < 30, pids.read_text(), children()]))
""",
    )
    assert found == [True, "begun", []]


@FORKS
def test_a_process_ends_with_the_one_that_started_it(tmp_path):
    code = """
with drawing_ahead():
    print(children()[0], flush=True)
    time.sleep(60)
"""
    words = [sys.executable, "-c", SCRIPT + code]
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as child:
        process = int(child.stdout.readline())
        os.kill(process, 0)
        child.kill()
        end = time.monotonic() + 20
        while Path(f"/proc/{process}").exists() and time.monotonic() < end:
            time.sleep(0.05)
    assert not Path(f"/proc/{process}").exists() or "zombie" in Path(f"/proc/{process}/status").read_text()
