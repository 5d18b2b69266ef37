"""Studies on a Dask cluster of two processes, against the same in this process."""

import json
import sys
from types import ModuleType

import pytest
import xarray as xr
from dask_cluster import Cluster
from solidtouch.analysis.compare.report import compare
from solidtouch.analysis.sensitivity.report import sensitivity
from solidtouch.analysis.strategies.report import strategies
from solidtouch.analysis.tasks.crew import crew_of
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.generic import source
from solidtouch.models.settings import FitSettings
from task_runners import slow_square

pytestmark = [
    pytest.mark.slow,
    # A connection that a process at the other end has dropped without a word is found by the garbage collector.
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    try:
        made.scheduler(), made.worker(), made.worker()
        yield made
    finally:
        made.end()


@pytest.fixture
def parts(make_taps):
    """Training taps of two sessions, and test taps of a third."""
    taps = make_taps(L=3, M=2, J=4, K=2, sessions=3, repeats=6)
    return taps.select(taps.session < 2), taps.select(taps.session == 2)


def numbers(report):
    """All numbers of a summary that do not tell the time."""
    models = [{**row, "seconds": None} for row in report.summary.get("models", [])]
    return json.dumps({**report.summary, "models": models, "elapsed_s": None})


def counting(told):
    """Progress that adds up what is left in each stage."""

    def stage(name, total):
        told[name] = told.get(name, 0) + total

        def advance(done):
            told[name] -= done

        return advance

    return stage


@pytest.mark.parametrize("models", [["histogram", "gaussian", "student"], ["session:profile"]], ids=["three", "one"])
def test_a_comparison_is_the_same(cluster, parts, models):
    few = {"models": models, "fit": FitSettings(bins=10), "draws": 100, "trials": 40, "thresholds": [0.5, 0.9]}
    here, told = compare(*parts, **few), {}
    there = compare(*parts, **few, scheduler=cluster.address, progress=counting(told))

    assert numbers(here) == numbers(there)
    for name, group in here.tree.subtree_with_keys:
        xr.testing.assert_identical(group.to_dataset().drop_attrs(), there.tree[name].to_dataset().drop_attrs())
    assert set(told.values()) == {0}


def test_functions_go_to_workers_where_a_comparison_names_them(cluster, parts, monkeypatch):
    """Which must have the modules that they need."""
    module = ModuleType("not_on_workers")

    def heavy(where, what, taps=None, *, L, M, J, K): ...

    module.heavy = heavy
    heavy.__module__, heavy.__qualname__ = module.__name__, "heavy"
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(source, "_registered", {})
    source.add(heavy, "heavy")
    few = {"draws": 0, "trials": 40, "thresholds": [0.9], "scheduler": cluster.address}

    assert compare(*parts, models="gaussian", **few).summary["models"]
    with pytest.raises(InputError, match=r"^The cluster could not run it: ModuleNotFoundError: .*'not_on_workers'"):
        compare(*parts, models=["gaussian", "heavy"], **few)


def test_a_sensitivity_study_is_the_same(cluster, parts):
    """Of data sets, and of a single one, whose options are the tasks."""
    few = {"data_sets": 2, "trials": 50, "strongest": 2}
    here, told = sensitivity(parts[0], **few), {}
    there = sensitivity(parts[0], **few, scheduler=cluster.address, progress=counting(told))

    assert numbers(here) == numbers(there)
    assert set(told.values()) == {0}


def test_strategies_are_the_same_though_a_worker_is_killed(cluster, parts):
    """What it was at is done by others, once, and no number changes."""
    few = {"presets": ["ideal"], "data_sets": 2, "trials": 20, "regret": 8}
    victim, told = cluster.worker(), {}
    stage = counting(told)

    def killing(name, total):
        advance = stage(name, total)

        def and_kill(done):
            victim.kill()
            advance(done)

        return and_kill

    here = strategies(parts[0], **few)
    there = strategies(parts[0], **few, scheduler=cluster.address, progress=killing)

    assert victim.wait() < 0
    assert numbers(here) == numbers(there)
    assert set(told.values()) == {0}


def test_a_killed_worker_costs_its_task_only(cluster, tmp_path):
    """Every other task is begun once; the one that the worker was at is begun again."""
    victim, killed = cluster.worker(), []

    def kill(_):
        mine = [path.name.split("-")[0] for path in tmp_path.glob(f"*-{victim.pid}")]
        if mine and not killed:
            victim.kill()
            killed.append(victim.wait())

    results = list(crew_of(cluster.address, None, 60.0)(slow_square, range(12), tmp_path, kill))

    assert results == [item * item for item in range(12)]
    assert killed == [-9]
    begun = [path.name for path in tmp_path.iterdir()]
    lost = [name.split("-")[0] for name in begun if name.endswith(f"-{victim.pid}")]
    times = {item: sum(name.startswith(f"{item}-") for name in begun) for item in range(12)}
    assert sum(times.values()) <= 12 + len(lost)
    assert {item for item, count in times.items() if count > 1} <= set(map(int, lost))
    assert max(times.values()) == 2
