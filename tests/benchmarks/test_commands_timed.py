"""Commands are timed as whole processes, their time is divided into stages, and the page keeps what is not measured."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.page import check_block, write_block
from benchmarks.speed.commands import run
from benchmarks.speed.commands.process import Spent, spent
from benchmarks.speed.commands.run import BLOCK, page, revision
from benchmarks.speed.commands.stages import EXIT, functions, shares, stacks, stage
from benchmarks.speed.commands.table import Timed, stored
from benchmarks.speed.commands.works import GIB, WORKS, Work, installed

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "performance.md"
HOLDING = """
import gc
import resource
import time

gc.disable()


def hold():
    held = b"x" * 10_000_000
    time.sleep(0.008)


for _ in range(100):
    hold()
if resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > 300_000:
    raise SystemExit("what was held is still there")
"""

BUSY = """
import sys, threading, time
def busy(seconds):
    began = time.process_time()
    while time.process_time() - began < seconds:
        pass
def wait():
    thread = threading.Thread(target=busy, args=[0.4])
    thread.start()
    thread.join()
busy(0.1)
wait()
time.sleep(0.2)
"""


def test_the_table_has_a_place_in_the_page():
    check_block(PAGE, BLOCK)


def test_a_process_is_measured_from_outside(tmp_path):
    """Its own memory, not that of the tests, and its own processor time, not its sleep."""
    took = spent([sys.executable, "-S", "-c", BUSY + "bytearray(10**8)"], tmp_path)

    assert took.seconds > 0.7
    assert 0.5 < took.processor_s < took.seconds - 0.15
    assert 1e8 < took.peak < 1.5e8


def test_a_program_may_tell_its_own_time(tmp_path):
    words = [sys.executable, "-S", "-c", 'print(\'...\\n{"seconds": 7, "processor_s": 3}\')']
    assert spent(words, tmp_path, inside=True)[:2] == (7, 3)


def test_a_command_that_fails_ends_the_measurement(tmp_path):
    with pytest.raises(RuntimeError, match=r"ended with exit code 3:\nwhy"):
        spent([sys.executable, "-S", "-c", "print('why'); raise SystemExit(3)"], tmp_path)


def test_an_older_state_that_fails_a_command_is_left_out_of_its_row(monkeypatch):
    """Also if it fails in a later round; this state may not fail."""
    runs = {"old": 0, "new": 0}

    def spend(words, *_, **__):
        runs[words[0]] += 1
        if words[0] == "old" and runs["old"] > 2:
            raise RuntimeError("no such option")
        return Spent(1.0, 1.0, 1, 0.0)

    monkeypatch.setattr(run, "spent", spend)
    monkeypatch.setattr(run, "stacks", lambda *_: {("a.py:f",): 1.0})
    work = Work("x", ("solidtouch", "x"), 1, 3)
    now, old = {"solidtouch": "new"}, {"solidtouch": "old"}
    timed, _ = run._timed(work, 3, {"now": now, "before": old}, {"now": Path(), "before": Path()})

    assert (len(timed.now), len(timed.before), runs) == (3, 0, {"old": 3, "new": 4})
    with pytest.raises(RuntimeError, match="no such option"):
        run._timed(work, 3, {"now": old}, {"now": Path()})


def test_an_older_state_that_takes_minutes_is_measured_once(monkeypatch):
    """Without a run before, which the present state has."""
    runs = []
    monkeypatch.setattr(run, "spent", lambda words, *_, **__: runs.append(words[0]) or Spent(1.0, 1.0, 1, 0.0))
    monkeypatch.setattr(run, "stacks", lambda *_: {("a.py:f",): 1.0})
    programs = {name: {"solidtouch": name} for name in ("now", "before")}
    timed, _ = run._timed(Work("x", ("solidtouch", "x"), 1, 1), 2, programs, dict.fromkeys(programs, Path()))

    assert (len(timed.now), len(timed.before)) == (2, 1)
    assert sorted(runs) == ["before", "now", "now", "now"]


@pytest.mark.skipif(sys.platform != "linux", reason="the processor times of threads are read from /proc")
def test_stacks_of_all_threads_are_counted_by_processor_time(tmp_path):
    """All of them, or those that run while the main thread is in a function.

    What a thread spends after its last sample is lost, which on a busy machine may be a tenth of a second.
    """
    (tmp_path / "program.py").write_text(BUSY, encoding="utf-8")
    everything, inside = (stacks([sys.executable, "program.py"], tmp_path, name) for name in ("", "program.py:wait"))

    def busy(counted):
        return functions(counted, r"program\.py:busy$").popitem()[1]

    assert 0.2 < busy(everything) < 0.55
    assert sum(everything.values()) >= busy(everything)
    assert 0 <= everything[EXIT,] < 0.1
    assert 0.1 < busy(inside) < 0.45
    assert busy(inside) <= sum(inside.values()) < busy(inside) + 0.1


@pytest.mark.skipif(sys.platform != "linux", reason="the processor times of threads are read from /proc")
def test_what_a_function_held_is_freed_when_it_has_been_looked_at(tmp_path):
    """Also where Python never searches for circular garbage: 100 calls hold 10 MB each."""
    (tmp_path / "program.py").write_text(HOLDING, encoding="utf-8")

    assert functions(stacks([sys.executable, "program.py"], tmp_path), r"program\.py:hold$")


@pytest.mark.parametrize(
    ("calls", "name"),
    [
        (["/x/cli/audit.py:audit", "<frozen importlib._bootstrap>:_find_and_load", "/y/a.py:f"], "imports"),
        (["/x/inference/trials/run.py:play", "/y/jax/_src/compiler.py:compile_or_get_cached"], "compiling"),
        (["/x/analysis/audit/figures_checks.py:draw", "/y/numpy/core.py:f"], "figures"),
        (
            ["/x/analysis/audit/report.py:audit", "/x/analysis/page/report.py:save", "/x/models/taps.py:f"],
            "models/taps",
        ),
        (["/x/analysis/audit/run.py:audit", "/x/inference/trials/tally.py:f", "/x/models/taps.py:f"], "trials/tally"),
        (["/y/site.py:main"], "other"),
        ([EXIT], "exit of Python"),
    ],
)
def test_a_stack_belongs_to_the_module_that_the_study_calls(calls, name):
    assert stage(calls) == name


def test_small_stages_are_other():
    counted = {(f"/x/models/{name}.py:f",): seconds for name, seconds in {"a": 6.0, "b": 3.7, "c": 0.3}.items()}
    assert shares(counted) == pytest.approx({"models/a": 0.6, "models/b": 0.37, "other": 0.03})


def took(*seconds):
    return [Spent(value, 2 * value, GIB, 0.1) for value in seconds]


def test_the_page_keeps_rows_and_seconds_before_that_are_not_measured(tmp_path):
    document = tmp_path / "page.md"
    document.write_text(f"<!-- begin {BLOCK} -->\n<!-- end {BLOCK} -->\n", encoding="utf-8")
    where = "- processor: one\n- vector instructions: two\n- system: three\n- packages: four"
    first, second = WORKS[0], WORKS[-1]

    def write(older, *timed):
        write_block(document, BLOCK, page(timed, where, older, stored(document, BLOCK)))
        return stored(document, BLOCK)

    write("abc123", *(Timed(work, took(2, 1, 4), took(8, 6, 8), {"imports": 1.0}) for work in (first, second)))
    kept = write("", Timed(first, took(1), [], {"compiling": 0.5, "other": 0.5}))

    assert kept.older == "abc123"
    assert kept.head.splitlines()[0] == "- processor: one"
    assert "packages" not in kept.head
    assert kept.rows == {
        first.name: [first.name, "1", "20 s", "2", "1.00 GiB", "compiling 50%, other 50%", "8 (6–8)", "4 (2–6)"],
        second.name: [second.name, "2 (1–4)", "0.3 s", "4 (2–8)", "1.00 GiB", "imports 100%", "8 (6–8)", "4 (2–6)"],
    }


def test_an_installation_without_the_command_is_refused(tmp_path):
    with pytest.raises(ValueError, match="solidtouch is missing"):
        installed(tmp_path)


@pytest.mark.slow
def test_commands_are_measured_into_the_page(tmp_path):
    """In quick sizes, with another installation, here the same one."""
    document = tmp_path / "performance.md"
    document.write_text(f"<!-- begin {BLOCK} -->\n<!-- end {BLOCK} -->\n", encoding="utf-8")
    before = tmp_path / "before"
    before.mkdir()
    (before / ".venv").symlink_to(sys.prefix)
    for words in (
        ("init", "-q"),
        ("-c", "user.name=n", "-c", "user.email=e", "commit", "-q", "--allow-empty", "-m", "m"),
    ):
        subprocess.run(["git", *words], cwd=before, check=True)  # noqa: S607
    words = ["--quick", "--only", "inspect", "--only", "`import", "--before", before, "--out", tmp_path / "out"]
    called = [sys.executable, "-m", "benchmarks.speed.commands.run", *words, "--document", document]
    subprocess.run(called, cwd=PAGE.parents[2], check=True)
    kept = stored(document, BLOCK)

    assert kept.older == revision(before)
    assert "imports" in kept.rows["`inspect` of it"][5]
    for name in ("`inspect` of it", "`import solidtouch`"):
        assert "%" in kept.rows[name][5]  # an import is so short that only its end may be seen
        assert 0 < float(kept.rows[name][7].partition(" ")[0]) < 100
    measured = json.loads((tmp_path / "out" / "commands.json").read_text(encoding="utf-8"))
    assert len(measured["works"]) == 2
