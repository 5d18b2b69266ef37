"""Sweeps on this machine: the numbers do not depend on where and when cells are computed, and nothing is done twice."""

import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t
from solidtouch.analysis.stats.resampled_units import spread_of_taps, units_of
from solidtouch.analysis.stats.tallied import tally_means
from solidtouch.analysis.sweep import cell as sweep_cell
from solidtouch.analysis.sweep import code as sweep_code
from solidtouch.analysis.sweep import run as sweep_module
from solidtouch.analysis.sweep.batches import DEATHS, Batch, CellQueue
from solidtouch.analysis.sweep.cell import Outcome, run_cell, try_cell
from solidtouch.analysis.sweep.cells import CellGrid, Effort
from solidtouch.analysis.sweep.data import Sources
from solidtouch.analysis.sweep.local import in_processes, in_this_process
from solidtouch.analysis.sweep.quantities import QUANTITIES
from solidtouch.analysis.sweep.result import open_sweep, over_data
from solidtouch.analysis.sweep.run import SweepProgress, sweep
from solidtouch.analysis.sweep.store import DONE, SweepStore
from solidtouch.analysis.sweep.study import load_study
from solidtouch.inference.information import tap_outcomes
from solidtouch.inference.moves.strategies import make_policy
from solidtouch.inference.moves.table_learning import held_out_tables, learn_table
from solidtouch.inference.stopping.recorded import stops
from solidtouch.inference.stopping.stopping import what_above
from solidtouch.inference.trials.lockstep import play
from solidtouch.inference.trials.lockstep_tally import tally_policy
from solidtouch.inference.trials.plan import plan_trials, tap_table
from solidtouch.inference.trials.resampling import Spread
from solidtouch.inference.trials.run import run_trials
from solidtouch.inference.tuning.tempering import learn_power
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.catalogue import fit_model
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.settings import FitSettings, PlaySettings

GRID = """
pseudocount = [0.01, 1]
policy = ["passive", "active", 0.5]
fixation = [0, 2]
border = ["uniform", "clamp"]
"""
DISTINCT = 2 * (1 + 2 * 2 * 2)


def results(path: Path) -> xr.Dataset:
    """Everything but how long it took."""
    return open_sweep(path).load().drop_vars("seconds").drop_attrs()


def first_cell(path: Path):
    """The first cell of a study, its effort and its data."""
    study = load_study(path)
    sources = Sources(study, path.parent)
    cell = CellGrid.of(study, tuple(sources.keys)).cell(0)
    return cell, Effort(study.trials, study.thresholds, study.deadline), sources.load(cell.data)


def test_a_cell_holds_the_means_of_its_trials(make_study):
    path = make_study('policy = ["active"]\nfixation = [2]\npower = [0.3]', trials=50)
    cell, effort, data = first_cell(path)

    values = run_cell(cell, effort, data)

    model = fit(data.fold.train, data.grid, power=0.3)
    table = tap_table(model, model.usable(data.fold.test))
    seed = sweep_cell._trial_seed(cell)
    plan = plan_trials(table.pool, 50, seed, 2)
    trials = run_trials(table, plan, effort.thresholds, play=PlaySettings(theta_x=0.0, deadline=20), seed=seed)
    error = data.grid.where_error(trials.where, trials.true_where)
    np.testing.assert_allclose(values["taps"], trials.taps.mean(axis=0))
    np.testing.assert_allclose(values["where_error"], error.mean(axis=0))
    np.testing.assert_allclose(values["where_error_se"], error.std(axis=0, ddof=1) / np.sqrt(50), atol=1e-12)
    np.testing.assert_allclose(values["what_wrong"], (trials.what != plan.what[:, None]).mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(values["belief"], trials.belief.mean(axis=0))
    assert values["trials"].tolist() == [50, 50]


@pytest.mark.parametrize("policy", ["random", "step:2", "info-what", "info-joint-per-mm", "info-where-per-s", "table"])
def test_a_cell_plays_any_strategy(make_study, policy):
    """Those that learn are given the training taps of the fold, and no others."""
    cell, effort, data = first_cell(make_study(f'policy = ["{policy}"]\nborder = ["clamp"]\nbins = [9]'))

    values = run_cell(cell, effort, data)

    model = fit(data.fold.train, data.grid, bins=9)
    outcomes = tap_outcomes(model.log_likelihood(model.usable(data.fold.train).taps))
    held_out = held_out_tables(data.fold.train, data.grid, lambda taps, grid: fit(taps, grid, bins=9))
    targets = learn_table(held_out, data.grid, border="clamp")
    strategy = make_policy(policy, data.grid, border="clamp", outcomes=outcomes, table=targets)
    table = tap_table(model, model.usable(data.fold.test))
    seed = sweep_cell._trial_seed(cell)
    plan = plan_trials(table.pool, 30, seed)
    record = play(table, plan, strategy, border="clamp", deadline=20, seed=seed)
    for h, threshold in enumerate(effort.thresholds):
        taps = stops(what_above(threshold), record).taps
        at = np.arange(30), taps - 1
        assert values["taps"][h] == pytest.approx(taps.mean())
        assert values["what_wrong"][h] == pytest.approx((record.what[at] != plan.what).mean(), abs=1e-12)
        assert values["where_error"][h] == pytest.approx(data.grid.where_error(record.where[at], record.at[at]).mean())


def test_active_cells_are_those_of_the_strategy_by_its_name(make_study):
    """Compiled or in step, the same trials."""
    cell, effort, data = first_cell(make_study('policy = ["active"]', trials=80))
    table, seed = sweep_cell._table(data, cell.fit_settings), sweep_cell._trial_seed(cell)
    counts = tally_policy(table, effort.thresholds, 80, make_policy("fixation", data.grid), deadline=20, seed=seed)

    values = run_cell(cell, effort, data)

    for name, mean in tally_means(counts, data.grid).items():
        np.testing.assert_allclose(values[name], mean, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("name", ["profile", "session:gaussian"])
def test_any_model_of_the_catalogue_is_swept(make_study, name):
    path = make_study(f'model = ["{name}"]\nbins = [9]\npolicy = ["passive"]')
    cell, effort, data = first_cell(path)

    values = run_cell(cell, effort, data)

    model = fit_model(name, data.fold.train, data.grid, FitSettings(bins=9)).model
    table = tap_table(model, model.usable(data.fold.test))
    seed = sweep_cell._trial_seed(cell)
    plan = plan_trials(table.pool, 30, seed, 1)
    trials = run_trials(table, plan, effort.thresholds, play=PlaySettings(theta_x=1.0, deadline=20), seed=seed)
    np.testing.assert_allclose(values["taps"], trials.taps.mean(axis=0))
    np.testing.assert_allclose(values["what_wrong"], (trials.what != plan.what[:, None]).mean(axis=0), atol=1e-12)


def test_a_power_is_learned_in_a_cell(make_study, make_taps):
    path = make_study('power = ["learned:2"]\nbins = [9]')
    make_taps(sessions=3, repeats=3).save(path.parent / "taps.nc", force=True)
    cell, _, data = first_cell(path)

    table = sweep_cell._table(data, cell.fit_settings)

    power = learn_power("histogram", data.fold.train, data.grid, FitSettings(bins=9), 2, 0).power
    model = fit(data.fold.train, data.grid, bins=9, power=power)
    np.testing.assert_array_equal(table.log_likelihood, model.log_likelihood(data.fold.test.taps))


def test_a_cell_whose_power_cannot_be_learned_fails_with_the_reason(make_study):
    """One training session leaves none to be left out."""
    cell, effort, data = first_cell(make_study('power = ["learned"]'))

    assert "two training sessions or more" in try_cell(cell, effort, data).traceback


def test_one_trial_has_no_standard_error(make_study):
    values = run_cell(*first_cell(make_study(trials=1)))

    assert np.isnan(values["taps_se"]).all()
    assert np.isfinite(values["taps"]).all()


def test_data_sets_do_not_share_random_numbers_and_models_do(make_study):
    cell, _, _ = first_cell(make_study())

    assert sweep_cell._trial_seed(cell) != sweep_cell._trial_seed(cell._replace(data="others"))
    assert sweep_cell._trial_seed(cell) != sweep_cell._trial_seed(cell._replace(seed=1))
    assert sweep_cell._trial_seed(cell) == sweep_cell._trial_seed(cell._replace(pseudocount=7.0, number=9))


def test_likelihoods_are_shared_between_cells_of_one_fit(make_study, tmp_path, monkeypatch):
    fits = []
    fitted = sweep_cell.fit_cell
    monkeypatch.setattr(sweep_cell, "fit_cell", lambda *a: fits.append(a) or fitted(*a))
    sweep_cell._model.cache_clear()
    sweep_cell._table.cache_clear()

    sweep(make_study(GRID), tmp_path / "s.zarr", in_this_process)

    assert len(fits) == 2


def test_resampled_taps_give_intervals_for_one_data_set(make_study, tmp_path):
    """Every cell once more on each resample, the same for all settings; the taps as they are come first."""
    path, plain = (
        make_study("power = [0.3, 1]", head="resamples = 5"),
        make_study("power = [0.3, 1]", name="plain.toml"),
    )
    sweep(path, tmp_path / "s.zarr", in_this_process)
    sweep(plain, tmp_path / "p.zarr", in_this_process)
    result, without = results(tmp_path / "s.zarr"), results(tmp_path / "p.zarr")
    assert result.sizes["resample"] == 6
    assert result["resample_sessions"] == 1
    xr.testing.assert_identical(result.sel(resample=[0]).drop_vars(["resample_factor", "resample_sessions"]), without)
    assert len(np.unique(result["belief"].sel(power=1, theta=0.5, policy="passive"))) == 6

    data = Sources(load_study(path), tmp_path).load("rods")
    opened = open_sweep(tmp_path / "s.zarr")
    found = over_data(opened)
    belief = opened["belief"].sel(theta=0.5, policy="passive")
    gain = belief.sel(power=1) - belief.sel(power=0.3)
    gained = over_data(gain.to_dataset(name="gain"), ["gain"]).squeeze()
    how = spread_of_taps(data.fold.test, data.grid)
    values = result["taps"].sel(power=1, theta=0.5, policy="passive").squeeze().values
    units = units_of(list(values), how)
    half = t.ppf(0.975, len(units) - 1) * units.std(ddof=1) / len(units) ** 0.5
    at = found.sel(power=1, theta=0.5, policy="passive").squeeze()
    assert float(at["taps"]) == pytest.approx(values[0])
    assert float(at["taps_low"]) == pytest.approx(values[0] - half)
    assert float(at["taps_high"]) == pytest.approx(values[0] + half)
    assert float(gained["gain"]) == pytest.approx(gain.sel(resample=0).item())
    assert gained["gain_low"] < gained["gain"] < gained["gain_high"]


@pytest.mark.parametrize(
    ("repeats", "sessions", "sentence"),
    [(5, 4, "resamples: 3 sessions test, .* so it takes 3 or more"), (1, 2, "one test tap of most classes")],
)
def test_resamples_that_tell_nothing_are_refused(make_study, make_taps, tmp_path, repeats, sessions, sentence):
    path = make_study(data="train = [0]", head="resamples = 2")
    make_taps(repeats=repeats, sessions=sessions).save(tmp_path / "taps.nc", force=True)
    with pytest.raises(InputError, match=sentence):
        sweep(path, tmp_path / "s.zarr", in_this_process)


def test_resamples_have_trials_of_their_own(make_study, tmp_path):
    """The chance of trials is in the spread of resamples, and settings pair on each."""
    study = load_study(make_study("power = [0.3, 1]", head="resamples = 3"))
    grid = CellGrid.of(study, ("rods",))
    cells = [grid.cell(number) for number in range(len(grid))]
    assert len({sweep_cell._trial_seed(cell) for cell in cells}) == 4
    assert len({(sweep_cell._trial_seed(cell), cell.resample) for cell in cells}) == 4


def test_resamples_of_several_data_sets_are_refused(make_study, tmp_path):
    path = make_study(data='split = "leave-one-session-out"', head="resamples = 5")
    with pytest.raises(InputError, match="resamples: with 2 data sets these are the units of intervals"):
        sweep(path, tmp_path / "s.zarr", in_this_process)
    assert not (tmp_path / "s.zarr").exists()


def test_a_sweep_counts_its_cells(make_study, tmp_path):
    tallies = []

    tally = sweep(make_study(GRID), tmp_path / "s.zarr", in_this_process, progress=tallies.append)

    assert tally == SweepProgress(DISTINCT, DISTINCT, 0)
    assert tallies == [SweepProgress(DISTINCT, n, 0) for n in range(DISTINCT + 1)]


def test_a_stopped_sweep_goes_on_without_repeating_a_cell(make_study, tmp_path):
    path = make_study(GRID)
    sweep(path, tmp_path / "whole.zarr", in_this_process)

    def stop(tally):
        if tally.done == 7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(path, tmp_path / "s.zarr", in_this_process, progress=stop)
    again = []
    sweep(path, tmp_path / "s.zarr", in_this_process, progress=again.append)

    assert again[0].done == 7
    assert len(again) == DISTINCT - 7 + 1
    xr.testing.assert_identical(results(tmp_path / "s.zarr"), results(tmp_path / "whole.zarr"))


def test_a_finished_sweep_starts_nothing(make_study, tmp_path):
    path = make_study()
    sweep(path, tmp_path / "s.zarr", in_this_process)

    def nothing(cells, effort, load):
        assert not list(cells)
        yield from ()

    assert sweep(path, tmp_path / "s.zarr", nothing) == SweepProgress(2, 2, 0)


def test_a_failing_cell_is_recorded_and_the_rest_goes_on(make_study, tmp_path):
    path = make_study('power = ["J", "learned"]')

    tally = sweep(path, tmp_path / "s.zarr", in_this_process)

    assert tally[:3] == (4, 2, 2)
    assert all("InputError: " in cause for cause in tally.causes)
    dataset = open_sweep(tmp_path / "s.zarr").squeeze()
    text = str(dataset["traceback"].sel(policy="active", power="learned").values)
    assert text.startswith("Traceback")
    assert "and there is session 0 only" in text
    assert np.isfinite(dataset["taps"].sel(power="J")).all()


def test_failed_cells_are_tried_again_only_when_asked(make_study, tmp_path):
    path = make_study('power = ["J", "learned"]')
    for tried in (1, 0):
        tallies = []
        sweep(path, tmp_path / "s.zarr", in_this_process, progress=tallies.append)
        assert tallies[0].failed == 2 * (1 - tried)
    tallies = []

    tally = sweep(path, tmp_path / "s.zarr", in_this_process, retry_failed=True, progress=tallies.append)

    assert [seen[:3] for seen in tallies] == [(4, 2, 0), (4, 2, 1), (4, 2, 2)]
    assert tally.failed == 2


def test_fixation_points_outside_the_positions_are_refused_before_any_work(make_study, tmp_path):
    with pytest.raises(InputError, match=r"grid\.fixation: 99 lies outside the positions 0 to 2 of the data set rods"):
        sweep(make_study("fixation = [1, 99]"), tmp_path / "s.zarr", in_this_process)
    assert not (tmp_path / "s.zarr").exists()


def test_another_study_is_refused(make_study, tmp_path):
    sweep(make_study(), tmp_path / "s.zarr", in_this_process)

    with pytest.raises(InputError, match=r"another study: trials is 30 there and 31 in study\.toml"):
        sweep(make_study(trials=31), tmp_path / "s.zarr", in_this_process)
    with pytest.raises(InputError, match=r"another study: bins is \[100\] there and \[5, 100\] in study\.toml"):
        sweep(make_study("bins = [5, 100]"), tmp_path / "s.zarr", in_this_process)


def test_a_comment_does_not_make_another_study(make_study, tmp_path):
    path = make_study()
    sweep(path, tmp_path / "s.zarr", in_this_process)
    path.write_text(f"# said later\n{path.read_text(encoding='utf-8')}", encoding="utf-8")

    assert sweep(path, tmp_path / "s.zarr", in_this_process).done == 2


def test_other_taps_are_refused(make_study, make_taps, tmp_path):
    path = make_study()
    sweep(path, tmp_path / "s.zarr", in_this_process)
    make_taps(seed=1).save(tmp_path / "taps.nc", force=True)

    with pytest.raises(InputError, match="other taps in the data set rods"):
        sweep(path, tmp_path / "s.zarr", in_this_process)


def test_other_software_is_refused(make_study, tmp_path, monkeypatch):
    path = make_study()
    sweep(path, tmp_path / "s.zarr", in_this_process)
    other = sweep_code.code() | {"numba": "0.1"}
    monkeypatch.setattr("solidtouch.analysis.sweep.run.code", lambda: other)

    with pytest.raises(InputError, match=r"begun with other software; now there is numba 0\.1 instead of"):
        sweep(path, tmp_path / "s.zarr", in_this_process)


def test_a_folder_with_other_things_is_not_written_to(make_study, tmp_path):
    with pytest.raises(InputError, match="exists and is no sweep"):
        sweep(make_study(), tmp_path, in_this_process)


def test_several_processes_give_the_same_bits_as_one(make_study, tmp_path):
    """The second time, one of the workers is killed while it works."""
    path = make_study(GRID, trials=200)
    sweep(path, tmp_path / "one.zarr", in_this_process)
    killed = []

    def kill(tally):
        children = multiprocessing.active_children()
        if tally.done == 3 and children and not killed:
            os.kill(children[0].pid, signal.SIGKILL)
            killed.append(children[0].pid)

    tally = sweep(path, tmp_path / "two.zarr", in_processes(2), progress=kill)

    assert killed
    assert tally == SweepProgress(DISTINCT, DISTINCT, 0)
    assert not multiprocessing.active_children()
    xr.testing.assert_identical(results(tmp_path / "two.zarr"), results(tmp_path / "one.zarr"))


def test_a_worker_that_is_killed_before_it_is_ready_is_replaced(make_study, tmp_path):
    """While another one works; alone it would be killed again and again."""
    killed = []

    def kill_the_other(tally):
        for child in multiprocessing.active_children():
            if tally.done == 1 and not killed:
                os.kill(child.pid, signal.SIGKILL)
                killed.append(child.pid)

    late = make_study(GRID, trials=50)
    assert sweep(late, tmp_path / "s.zarr", in_processes(2), progress=kill_the_other) == SweepProgress(
        DISTINCT, DISTINCT, 0
    )
    assert killed


def cells(make_study, grid="seed = [0, 1, 2, 3, 4, 5]\npolicy = [0.5]"):
    path = make_study(grid)
    whole = CellGrid.of(load_study(path), ("rods",))
    return [whole.cell(number) for number in range(len(whole))]


def test_batches_grow_until_they_take_as_long_as_wanted(make_study):
    queue = CellQueue(cells(make_study), 0.75)
    first = queue.take()
    assert len(first.cells) == 1
    queue.finished([Outcome(0, {}, 0.25)])

    assert [len(queue.take().cells) for _ in range(2)] == [3, 2]
    assert not queue


def test_a_batch_has_one_data_set(make_study):
    one = cells(make_study)
    queue = CellQueue([*one, *(cell._replace(data="others") for cell in one)], 100.0)
    queue.finished([Outcome(0, {}, 0.25)])

    assert [(batch.data, len(batch.cells)) for batch in (queue.take(), queue.take())] == [("rods", 6), ("others", 6)]


def test_only_the_cell_that_kills_its_workers_is_given_up(make_study):
    queue = CellQueue((), 1.0)
    one, other, *_ = cells(make_study)
    assert not queue.died(Batch((one, other)), "It died.")
    assert queue.take().cells == (one,)
    batch, outcomes = queue.take(), []
    assert batch.cells == (other,)

    for death in range(1, DEATHS + 1):
        outcomes = queue.died(batch, "It died.")
        assert bool(outcomes) == (death == DEATHS)
        if not outcomes:
            batch = queue.take()

    assert not queue
    assert [outcome.number for outcome in outcomes] == [other.number]
    assert outcomes[0].traceback == f"It died. It was tried {DEATHS} times."


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

    def numbered(todo, effort, _load):
        """The outcome of a cell is its number."""
        for cell in todo:
            computed.append(cell.number)
            value = np.full(len(effort.thresholds), float(cell.number))
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
        assert re.search(r"holds \d of 4 cells; the same command goes on with the rest\.", " ".join(errors.split()))
        assert "Traceback" not in errors


def test_resamples_of_unequal_sessions_are_enlarged_for_their_fewer_degrees_of_freedom(monkeypatch):
    """Results over them take as many degrees of freedom as there are sessions, less one."""
    how = Spread(2.0, freedom=1.5, sessions=5)
    monkeypatch.setattr(sweep_module, "_of_trained_classes", lambda data: data)
    monkeypatch.setattr(sweep_module, "spread_of_taps", lambda _, __: how)
    sources = SimpleNamespace(keys=["one"], load=lambda _: SimpleNamespace(grid=None))
    found = sweep_module._resampled(sources, 10)
    assert found["resample_factor"] == pytest.approx(2.0 * t.isf(0.025, 1.5) / t.isf(0.025, 4))
    assert found["resample_sessions"] == 5
