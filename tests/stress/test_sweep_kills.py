"""Sweeps that are killed lose nothing, repeat nothing and leave no process."""

import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.sweep.cells import CellGrid
from solidtouch.analysis.sweep.run import SweepProgress, sweep
from solidtouch.analysis.sweep.store import DONE, QUANTITIES, SweepStore
from solidtouch.analysis.sweep.study import load_study
from solidtouch.analysis.tasks.local import in_this_process
from solidtouch.analysis.tasks.task import Outcome
from sweep_study import DISTINCT, GRID, results


def command(path: Path, out: Path, *words: str) -> list[str]:
    return [sys.executable, "-m", "solidtouch.cli", "sweep", str(path), "--out", str(out), *words]


class Killed(BaseException):
    """What SIGKILL would do here."""


def finished(out: Path, grid: CellGrid) -> set[int]:
    """Numbers of the distinct cells that are done in a store."""
    done = SweepStore(out, grid).status()[grid.distinct] == DONE
    return set(grid.distinct[done].tolist())


def chunks(out: Path, grid: CellGrid) -> dict[str, tuple[int, int]]:
    """Which writing the files of finished cells come from; of cells that stand for several places the one computed.

    The other places of a cell are written before its own, so a resumed sweep may write them again.
    """
    done = finished(out, grid) if out.exists() else ()
    names = ["c." + ".".join(map(str, grid.index(number))) for number in done]
    files = [out / name for chunk in names for name in (f"status/{chunk}", f"result/{chunk}.0.0")]
    return {str(file): ((stat := file.stat()).st_ino, stat.st_mtime_ns) for file in files}


def test_a_sweep_killed_at_any_write_loses_and_repeats_nothing(make_study, tmp_path, monkeypatch):
    """A cell is done with its last file, and never computed or written again from then on; the passive one has four."""
    path = make_study('policy = ["passive", "active"]\nfixation = [0, 2]\nborder = ["uniform", "clamp"]')
    grid, replace = CellGrid.of(load_study(path), ("rods",)), Path.replace
    computed: list[int] = []
    left = 0

    def numbered(todo, work, _load):
        """The outcome of a cell is its number."""
        for cell in todo:
            computed.append(cell.number)
            value = np.full(len(work.keywords["effort"].thresholds), float(cell.number))
            yield Outcome(cell.number, dict.fromkeys(QUANTITIES, value), 0.5)

    def dying(temporary, target):
        nonlocal left
        left -= 1
        if left < 0:
            temporary.write_bytes(temporary.read_bytes()[:1])
            raise Killed
        return replace(temporary, target)

    sweep(path, tmp_path / "empty.zarr", lambda *_: (cell for cell in ()))
    monkeypatch.setattr(Path, "replace", dying)
    assert (len(grid), len(grid.distinct)) == (8, 5)
    for writes in range(2 * len(grid)):
        out = shutil.copytree(tmp_path / "empty.zarr", tmp_path / f"{writes}.zarr")
        computed.clear()
        left = writes
        with pytest.raises(Killed):
            sweep(path, out, numbered)
        done, before = finished(out, grid), chunks(out, grid)
        assert done == set(computed[:-1])
        computed.clear()
        left = 2 * len(grid)
        assert sweep(path, out, numbered) == SweepProgress(5, 5, 0)
        assert computed == sorted(set(grid.distinct.tolist()) - done)
        assert before.items() <= chunks(out, grid).items()
        for number in grid.distinct.tolist():
            for place in grid.places(number):
                file = out / "result" / ("c." + ".".join(map(str, grid.index(place))) + ".0.0")
                assert np.frombuffer(file.read_bytes())[0] == number
        assert SweepStore(out, grid).status().tolist() == [DONE] * len(grid)


DIES = """
import os, signal, sys
from solidtouch.analysis.sweep.store import SweepStore
from solidtouch.cli.main import run
write, left = SweepStore.write, [int(sys.argv.pop(1))]
def dying(store, outcome):
    if not left[0]:
        os.kill(os.getpid(), signal.SIGKILL)
    left[0] -= 1
    write(store, outcome)
SweepStore.write = dying
run()
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_sweep_killed_again_and_again_loses_and_repeats_nothing(make_study, tmp_path, workers):
    """The command itself, killed after 3, 4 and 5 more cells; its workers end with it."""
    path, out, before = make_study(GRID, trials=20000), tmp_path / "s.zarr", {}
    grid = CellGrid.of(load_study(path), ("rods",))
    for more in (3, 4, 5, DISTINCT):
        done = len(before) // 2
        words = [sys.executable, "-c", DIES, str(more), *command(path, out, f"--workers={workers}")[3:]]
        code = subprocess.run(words, capture_output=True, check=False, timeout=120).returncode
        after = chunks(out, grid)
        assert code == (0 if more == DISTINCT else -signal.SIGKILL)
        assert len(after) // 2 == (DISTINCT if more == DISTINCT else done + more)
        assert before.items() <= after.items()
        before = after
    sweep(path, tmp_path / "whole.zarr", in_this_process)

    xr.testing.assert_identical(results(out), results(tmp_path / "whole.zarr"))


def alive(pid: str) -> bool:
    """Whether a process runs; one that only waits to be buried does not."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGKILL, -9)])
def test_workers_do_not_outlive_a_stopped_sweep(make_study, tmp_path, number, code):
    """However it ends: told by the terminal or by another program, or killed, while cells of a minute run."""
    path = make_study("seed = [0, 1]", trials=10_000_000)
    process = subprocess.Popen(
        command(path, tmp_path / "s.zarr", "--workers=2"), stderr=subprocess.PIPE, text=True, stdout=subprocess.DEVNULL
    )
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    while len(workers := children.read_text().split()) < 3:  # two workers and what tracks their resources
        time.sleep(0.05)
    time.sleep(4)

    process.send_signal(number)
    errors = process.communicate(timeout=10)[1]

    assert process.returncode == code
    time.sleep(0.5)
    assert not [pid for pid in workers if alive(pid)]
    if number != signal.SIGKILL:
        assert re.search(r": \d of 4 cells; run the same command to continue\.", " ".join(errors.split()))
        assert "Traceback" not in errors
