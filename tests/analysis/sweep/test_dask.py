"""Sweeps on a Dask cluster: a scheduler and two workers as processes of their own."""

import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from dask_cluster import Cluster, wait_for
from solidtouch.analysis.sweep.result import open_sweep
from solidtouch.analysis.sweep.run import SweepProgress, sweep
from solidtouch.analysis.tasks import dask as task_dask
from solidtouch.analysis.tasks.dask import on_cluster
from solidtouch.analysis.tasks.local import in_this_process
from solidtouch.models.errors import InputError

pytestmark = [
    pytest.mark.slow,
    # A connection that a process at the other end has dropped without a word is found by the garbage collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]

GRID = 'policy = ["active"]\nseed = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11]\npseudocount = [0.01, 1]'
CELLS = 24
TRIALS = 100_000
OTHER_VERSION = """
import solidtouch.analysis.tasks.code as task_code
real = task_code.code()
task_code.code = lambda: real | {"numba": "0.1"}
"""

WITHOUT = """
import sys
class Without:
    def find_spec(self, name, *more):
        if name.startswith("solidtouch"):
            raise ModuleNotFoundError(f"No module named {name!r}")
sys.meta_path.insert(0, Without())
"""


@pytest.fixture
def cluster(tmp_path_factory) -> Iterator[Cluster]:
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        yield made
    finally:
        made.end()


def run(
    path: Path, cluster: Cluster, progress: Callable[[SweepProgress], None] = lambda _: None, patience: float = 120.0
):
    """Runs a study and gives its results."""
    notes = []
    out = path.with_suffix(".zarr")
    tally = sweep(path, out, on_cluster(cluster.address, patience, notes.append), progress=progress)
    return tally, open_sweep(out).load().drop_vars("seconds"), notes


def alone(path: Path) -> xr.Dataset:
    """The same study in this process."""
    out = path.with_suffix(".alone.zarr")
    sweep(path, out, in_this_process)
    return open_sweep(out).load().drop_vars("seconds")


def test_a_worker_killed_in_the_middle_changes_nothing(make_study, cluster):
    path = make_study(GRID, trials=TRIALS)
    cluster.scheduler()
    victim, _ = cluster.worker(), cluster.worker()

    def kill(tally: SweepProgress) -> None:
        if tally.done == 4:
            victim.kill()

    tally, dataset, _ = run(path, cluster, kill)

    assert victim.poll() is not None
    assert tally == SweepProgress(CELLS, CELLS, 0)
    xr.testing.assert_identical(dataset, alone(path))


def test_a_scheduler_that_comes_back_is_given_what_is_left(make_study, cluster):
    path = make_study(GRID, trials=TRIALS)
    cluster.scheduler(), cluster.worker(), cluster.worker()
    seen = []

    def restart(tally: SweepProgress) -> None:
        seen.append(tally.done)
        if tally.done == 4:
            cluster.end()
            cluster.scheduler(), cluster.worker(), cluster.worker()

    tally, dataset, notes = run(path, cluster, restart)

    assert tally == SweepProgress(CELLS, CELLS, 0)
    assert seen == list(range(CELLS + 1))
    assert any("is lost; waiting for it to come back" in note for note in notes)
    xr.testing.assert_identical(dataset, alone(path))


@pytest.mark.parametrize(
    ("lost", "sentence"),
    [
        ("all", r"^There is no Dask scheduler at tcp://127\.0\.0\.1:\d+ after 5 s"),
        ("silent", r"^There is no Dask scheduler at tcp://127\.0\.0\.1:\d+ after 5 s"),
        ("workers", r"^The scheduler at tcp://127\.0\.0\.1:\d+ has no worker after 5 s"),
    ],
)
def test_a_cluster_that_stays_away_ends_the_sweep_which_goes_on_later(make_study, cluster, monkeypatch, lost, sentence):
    monkeypatch.setattr(task_dask, "_ANSWER_S", 5.0)
    path = make_study(GRID, trials=TRIALS)
    scheduler = cluster.scheduler()
    wait_for(cluster.port)
    worker = cluster.worker()

    def stop(tally: SweepProgress) -> None:
        if tally.done == 4:
            {"all": cluster.end, "silent": lambda: scheduler.send_signal(signal.SIGSTOP), "workers": worker.kill}[
                lost
            ]()

    with pytest.raises(InputError, match=sentence):
        run(path, cluster, stop, patience=5.0)
    done = int((open_sweep(path.with_suffix(".zarr"))["status"] == 1).sum())

    assert 4 <= done < CELLS
    assert sweep(path, path.with_suffix(".zarr"), in_this_process) == SweepProgress(CELLS, CELLS, 0)


def test_a_cell_that_raises_does_not_stop_the_others(make_study, cluster):
    path = make_study('power = ["J", "learned"]\nseed = [0, 1, 2]')
    cluster.scheduler(), cluster.worker(), cluster.worker()

    tally, dataset, _ = run(path, cluster)

    assert tally[:3] == (12, 6, 6)
    failed = dataset.sel(policy="active", power="learned").squeeze()
    assert all("got session 0 only" in text for text in failed["traceback"].values)
    assert np.isfinite(dataset["taps"].sel(power="J")).all()


@pytest.mark.parametrize(
    ("where", "code", "sentence"),
    [
        ("worker", OTHER_VERSION, r"The worker tcp://.* other software than this client: numba 0\.1 instead of"),
        ("worker", WITHOUT, r"The worker tcp://.* cannot run this solidtouch: .*No module named"),
        ("scheduler", WITHOUT, r"The scheduler at tcp://.* cannot run this solidtouch: .*No module named"),
    ],
    ids=["other", "without", "scheduler_without"],
)
def test_a_cluster_without_the_same_software_is_refused(make_study, cluster, where, code, sentence):
    preload = cluster.folder / "preload.py"
    preload.write_text(code, encoding="utf-8")
    words = {where: ("--preload", preload)}
    cluster.scheduler(*words.get("scheduler", ())), cluster.worker(*words.get("worker", ()))

    with pytest.raises(InputError, match=sentence):
        run(make_study(), cluster)


def test_a_worker_with_other_software_that_comes_late_is_refused(make_study, cluster):
    preload = cluster.folder / "other.py"
    preload.write_text(OTHER_VERSION, encoding="utf-8")
    cluster.scheduler(), cluster.worker()

    def join(tally: SweepProgress) -> None:
        if tally.done == 1:
            cluster.worker("--preload", preload)

    with pytest.raises(InputError, match=r"other software than this client: numba 0\.1 instead of"):
        run(
            make_study(GRID.replace("seed = [", f"seed = [{', '.join(map(str, range(20, 90)))}, "), TRIALS),
            cluster,
            join,
        )


def test_a_scheduler_without_workers_is_named(make_study, cluster):
    cluster.scheduler()
    wait_for(cluster.port)

    with pytest.raises(InputError, match="has no worker after 1 s"):
        run(make_study(), cluster, patience=1.0)


def test_a_scheduler_that_says_nothing_is_not_waited_for():
    """As of a process that was stopped, or behind a network that drops what is sent."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(InputError, match=f"There is no Dask scheduler at {address} after 2 s"):
            list(on_cluster(address, 2.0, print)(iter([((1,), 2)]), abs, abs))

    assert time.monotonic() - begun < 20
