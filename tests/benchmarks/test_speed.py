"""The benchmarks run, and the ways of playing trials that they compare agree; times are not tested."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.models.taps import TapSet

from benchmarks.page import check_block
from benchmarks.speed import likelihood_peers, memory
from benchmarks.speed.growth import METHODS, slope
from benchmarks.speed.report import ratio, work_table
from benchmarks.speed.rows import LIMIT, Row, interleaved
from benchmarks.speed.scaling import exponent
from benchmarks.speed.trials.agreement import by_reference, differing
from benchmarks.speed.trials.decisions import limits
from benchmarks.speed.trials.job import Decisions, decisions, make_job, ours, prepared, random_table
from benchmarks.speed.trials.loops import loop, tuned_loop
from benchmarks.speed.trials.vectorised import vectorised

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "performance.md"


def run(name, *words):
    """What a benchmark prints; it must end with exit code 0."""
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{name}", *words],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_all_benchmarks_run_and_fill_their_page(tmp_path):
    """Nobody decides otherwise than the reference; the page keeps its text and shows the picture."""
    page = tmp_path / "performance.md"
    shutil.copyfile(PAGE, page)

    printed = run("speed.run", "--quick", "--out", tmp_path / "out", "--document", page)

    measured = json.loads((tmp_path / "out" / "benchmarks.json").read_text(encoding="utf-8"))
    notes = [row["note"] for row in measured["rows"] if "decided differently" in row["note"]]
    assert len(notes) >= 8
    assert all(note.partition("; ")[2].startswith("0 of ") for note in notes)
    assert all(row["seconds"] or row["note"] for row in measured["rows"])
    assert {curve["axis"] for curve in measured["curves"]} >= {"classes", "T", "trials", "trials in a call"}
    assert set(measured["machine"]["packages"]) >= {"numpy", "jax", "dynamax"}
    assert "| solidtouch |" in printed
    assert page.read_text(encoding="utf-8").startswith(PAGE.read_text(encoding="utf-8").partition("<!--")[0])
    assert "| solidtouch |" in page.read_text(encoding="utf-8")
    assert (tmp_path / "images" / "performance.svg").is_file()


@pytest.mark.slow
def test_one_work_can_be_measured_into_another_page(tmp_path):
    """With the machine; the rest of the page stays."""
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- begin information -->\nold\n<!-- end information -->\nafter\n", encoding="utf-8")
    run("speed.run", "--quick", "--only", "information", "--document", page)
    text = page.read_text(encoding="utf-8")

    assert text.startswith("before\n<!-- begin information -->\n- processor: ")
    assert text.endswith("<!-- end information -->\nafter\n")
    assert "old" not in text
    assert "| solidtouch, online, about what |" in text


@pytest.mark.slow
def test_a_gpu_or_its_code_is_measured():
    """On one core, on all and as arrays, all trials decide alike."""
    assert run("speed.run", "--quick", "--only", "gpu").count("; 0 of 1000 otherwise") == 6


SHAPES = [(1, 1), (1, 4), (5, 1), (3, 7), (16, 5), (16, 8), (16, 9)]
PLAYED = [(shape, policy) for shape in SHAPES for policy in ("passive", "active")]
ONCE_EACH = [(shape, ("active", "passive")[i % 2]) for i, shape in enumerate(SHAPES)]
PLAYED_AS = [f"{L}x{M}-{policy}" for (L, M), policy in PLAYED]


@pytest.mark.parametrize(("shape", "policy"), slow_but(ONCE_EACH, PLAYED), ids=PLAYED_AS)
def test_all_ways_of_playing_trials_decide_as_the_reference_does(shape, policy):
    """At several thresholds, some never reached, for sizes with and without vector instructions."""
    job = make_job(random_table(*shape), 25, policy, (0.3, 0.6, 0.9), deadline=12)
    ways = [loop(job), tuned_loop(job), vectorised(job, 7)]
    ways += [ours(job), decisions(prepared(job)())]
    ways += [yardstick.play(threads) for _, yardstick in limits(job) if yardstick for threads in (1, 2)]

    expected, near = by_reference(job)

    for way in ways:
        assert not (differing(way, expected) & ~near).any()


@pytest.mark.parametrize("way", ["multinomial", "categorical", "in_registers"])
def test_peers_give_our_log_likelihoods_up_to_a_constant_of_each_tap(make_model, draw_samples, way):
    model = make_model(L=3, M=7, K=4, J=6, B=9, seed=1)
    taps = draw_samples(model, T=5)
    if way != "in_registers":
        pytest.importorskip("sklearn")
    score = getattr(likelihood_peers, way)(model, taps)
    if score is None:
        pytest.skip("there is no C compiler")

    difference = score() / (1 if way == "in_registers" else 6) - model.log_likelihood(taps).reshape(5, -1)

    assert np.ptp(difference, axis=1).max() < (1e-5 if way == "in_registers" else 1e-12)


def test_differences_are_counted_by_trial():
    found = Decisions(*(np.zeros((3, 2), dtype=int) for _ in range(3)))
    other = Decisions(found.taps.copy(), found.what, found.where)
    other.taps[1] = 5

    assert differing(found, other).tolist() == [False, True, False]


def test_without_a_c_compiler_the_limit_says_so(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    job = make_job(random_table(2, 11), 3, "passive")

    ((method, yardstick),) = limits(job)

    assert method.startswith(LIMIT)
    assert yardstick is None


def test_every_round_runs_all_methods_beginning_with_another_one():
    ran = []

    seconds = interleaved({name: lambda name=name: ran.append(name) for name in "abc"}, 3)

    assert "".join(ran) == "abcbcacab"
    assert all(len(times) == 3 for times in seconds.values())


def test_the_exponent_of_a_power_law_is_found():
    slope, error = exponent([1, 10, 100, 1000], [2.0, 24.0, 160.0, 2200.0])
    exact, none = exponent([1, 10, 100, 1000], [3.0, 30.0, 300.0, 3000.0])

    assert (exact, none) == pytest.approx((1, 0), abs=1e-12)
    assert abs(slope - 1) < 2 * error
    assert error > 0.01


def test_the_slope_of_growth_is_that_of_the_larger_sizes():
    """With the t-interval of a straight line; none where a cost was not seen, or of three sizes."""
    size = [1, 10, 100, 1000, 10_000, 100_000, 1_000_000]
    constant_first = slope(size, [5.0, 5.0, 5.0, *(2.0 * n for n in size[3:])])
    bent = slope(size[:4], [1.0, 9.0, 110.0, 900.0])

    assert constant_first == pytest.approx((1, 1, 1))
    assert bent.low < 1 < bent.high
    assert bent.high - bent.value == pytest.approx(bent.value - bent.low)
    assert bent.high - bent.low == pytest.approx(2 * 4.303 * exponent(size[:4], [1.0, 9.0, 110.0, 900.0])[1], rel=1e-3)
    assert slope(size, [0.0] * 7) is None
    assert slope(size[:3], [1.0, 2.0, 3.0]) is None


@pytest.mark.slow
def test_growth_is_measured_and_drawn(tmp_path):
    """Every method over every size that it is measured over, with memory."""
    page = tmp_path / "performance.md"
    page.write_text("<!-- begin growth -->\n<!-- end growth -->\n", encoding="utf-8")
    run("speed.growth", "--quick", "--document", page)

    rows = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| ")][2:]
    assert len(rows) == sum(len(axes) for methods in METHODS.values() for axes in methods.values())
    assert all("s to " in row and "MiB" in row for row in rows)
    assert (tmp_path / "images" / "growth.svg").is_file()


def test_ratios_are_taken_within_rounds():
    """A machine that is slow in one round is slow for all of it."""
    assert ratio([1.0, 10.0, 3.0], [0.5, 5.0, 1.0]) == "2 (2–3)"
    assert ratio([1.0, 2.0, 6.0], [2.0]) == "1"
    assert ratio([], [1.0]) == ""


def test_a_method_that_could_not_run_says_why():
    rows = [
        Row("work", "plain", [2.0, 2.0], "tap"),
        Row("work", "peer", [], "tap", "not installed"),
    ]

    assert work_table(rows).splitlines()[-1] == "| peer | – |  | not installed |"


def test_a_page_without_a_place_is_refused(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("<!-- begin one -->\nold\n<!-- end one -->\n", encoding="utf-8")

    with pytest.raises(ValueError, match="has no lines <!-- begin two -->"):
        check_block(page, "one", "two")


def test_random_bytes_raise_nothing():
    assert run("checks.fuzz", "--inputs", "8000").count("no exception") == 4


@pytest.mark.slow
def test_random_faults_give_no_wrong_tap():
    """600 taps on three seeds; it fails where a tap is wrong, a move leaves the limits or a loss is not reported."""
    assert "taps accepted" in run("checks.faults")


@pytest.mark.slow
def test_a_killed_collection_loses_nothing_but_the_tap_in_progress():
    """Nor does one that is told to stop, and the finger is off the object then."""
    printed = run("checks.kills", "--moments", "3", "--spacing", "4")

    assert "kills and stops: 9" in printed
    assert "other taps lost: 0" in printed


@pytest.mark.slow
def test_a_disturbed_collection_loses_nothing():
    printed = run("checks.collecting", "--moments", "1")

    assert "two with one rig" in printed
    assert "!" not in printed


@pytest.mark.slow
def test_the_study_of_unknown_prints_its_tables():
    assert "no bounds" in run("studies.beliefs.unknown", "--data-sets", "2", "--sessions", "1")


@pytest.mark.slow
def test_the_novelty_benchmark_prints_its_tables():
    assert "known" in run("studies.beliefs.novelty", "--data-sets", "1", "--episodes", "4")


@pytest.mark.slow
def test_commands_on_a_recording_are_measured(monkeypatch):
    """In a process of their own, whose peak is not that of this one."""
    monkeypatch.setattr(memory, "TAP", (6, 5, 3, 2))
    (found,) = memory.recordings([2e-5], [("convert", "taps.nc", "copy.nc")])

    assert (found.command, found.gigabytes) == ("convert taps.nc copy.nc", 2e-5)
    assert found.processor > 0
    assert 50 < found.mebibytes < 1000
    assert "| `solidtouch convert taps.nc copy.nc` | 2e-05 GB |" in memory.recording_table([found])
    with pytest.raises(RuntimeError, match=r"solidtouch inspect none.nc failed:\n.*no such file"):
        memory.recordings([2e-5], [("inspect", "none.nc")])


def test_a_recording_is_made_in_blocks(tmp_path):
    """Of all classes in turn, each with a shape of its own."""
    memory.write_recording(tmp_path / "taps.nc", 205, 6, 5, 3, 2)
    taps = TapSet.load(tmp_path / "taps.nc")
    where, what = taps.indices(taps.grid())

    assert taps.taps.shape == (205, 6, 5)
    assert np.ravel_multi_index((where, what), (3, 2)).tolist() == [n % 6 for n in range(205)]
    mean = [taps.select((where == 1) & (what == m)).taps.mean(axis=0) for m in range(2)]
    assert np.abs(mean[1] - 2 * mean[0]).max() < 1.5
    assert mean[1].max() > 1
