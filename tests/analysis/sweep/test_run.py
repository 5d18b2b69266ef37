"""Sweeps on this machine: the numbers do not depend on where and when cells are computed, and nothing is done twice."""

import multiprocessing
import os
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import t
from solidtouch.analysis.stats.resampled_units import spread_of_taps, units_of
from solidtouch.analysis.sweep import cell as sweep_cell
from solidtouch.analysis.sweep import run as sweep_module
from solidtouch.analysis.sweep.cells import CellGrid
from solidtouch.analysis.sweep.data import Sources
from solidtouch.analysis.sweep.result import open_sweep, over_data
from solidtouch.analysis.sweep.run import SweepProgress, sweep
from solidtouch.analysis.sweep.study import load_study
from solidtouch.analysis.tasks import code as task_code
from solidtouch.analysis.tasks.local import in_processes, in_this_process
from solidtouch.inference.trials.resampling import Spread
from solidtouch.models.errors import InputError
from sweep_study import DISTINCT, GRID, results
from threadpoolctl import threadpool_info, threadpool_limits


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
    values = result["taps"].sel(power=0.3, theta=0.95, policy="passive").squeeze().values
    units = units_of(list(values), how)
    half = t.ppf(0.975, len(units) - 1) * units.std(ddof=1) / len(units) ** 0.5
    at = found.sel(power=0.3, theta=0.95, policy="passive").squeeze()
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


def test_sessions_of_a_recording_are_known_as_such(make_study, tmp_path):
    """Only where several were left out in turn; differences keep it."""
    sweep(make_study(), tmp_path / "one.zarr", in_this_process)
    sweep(make_study(data='split = "leave-one-session-out"'), tmp_path / "two.zarr", in_this_process)
    assert "recording" not in open_sweep(tmp_path / "one.zarr").coords
    two = open_sweep(tmp_path / "two.zarr")
    assert len(set(two["recording"].values.tolist())) == 1
    assert "recording" in (two["taps"] - two["what_error"]).coords


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


def test_cells_are_computed_with_one_thread_each(make_study, tmp_path):
    """Also by libraries that are loaded already, and in processes that start."""
    seen = []

    def look(cells, effort, load):
        seen.extend([pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"])
        seen.append(int(os.environ["OMP_NUM_THREADS"]))
        yield from ()

    before = os.environ.get("OMP_NUM_THREADS")
    with threadpool_limits(2):
        sweep(make_study(), tmp_path / "s.zarr", look)
        assert max(pool["num_threads"] for pool in threadpool_info()) == 2
    assert len(seen) > 1
    assert set(seen) == {1}
    assert os.environ.get("OMP_NUM_THREADS") == before


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
    assert "got session 0 only" in text
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
    other = task_code.code() | {"numba": "0.1"}
    monkeypatch.setattr("solidtouch.analysis.sweep.run.code", lambda: other)

    with pytest.raises(InputError, match=r"begun with other software; now there is numba 0\.1 instead of"):
        sweep(path, tmp_path / "s.zarr", in_this_process)


def test_a_folder_with_other_things_is_not_written_to(make_study, tmp_path):
    with pytest.raises(InputError, match="exists and is no sweep"):
        sweep(make_study(), tmp_path, in_this_process)


def test_several_processes_give_the_same_bits_as_one(make_study, tmp_path, monkeypatch):
    """Although the oldest worker is killed, which works, and then the newest, which is not ready yet.

    None of them runs the script that is running.
    """
    script, main = tmp_path / "script.py", ModuleType("__main__")
    script.write_text(f"open({str(tmp_path / 'run again')!r}, 'w')\n", encoding="utf-8")
    main.__file__ = str(script)
    monkeypatch.setitem(sys.modules, "__main__", main)
    path = make_study(GRID, trials=200)
    sweep(path, tmp_path / "one.zarr", in_this_process)
    killed, others = {}, set(multiprocessing.active_children())

    def started(child):  # as a number; those of the system begin again at some point
        return int(child.name.rpartition("-")[2])

    def kill(tally):
        chosen = {1: min, 3: max}.get(tally.done)
        if chosen and tally.done not in killed:
            killed[tally.done] = chosen({*multiprocessing.active_children()} - others, key=started)
            killed[tally.done].kill()

    tally = sweep(path, tmp_path / "two.zarr", in_processes(2), progress=kill)

    assert set(killed) == {1, 3}
    assert tally == SweepProgress(DISTINCT, DISTINCT, 0)
    assert {*multiprocessing.active_children()} <= others
    assert not (tmp_path / "run again").exists()
    xr.testing.assert_identical(results(tmp_path / "two.zarr"), results(tmp_path / "one.zarr"))


def test_resamples_of_unequal_sessions_are_enlarged_for_their_fewer_degrees_of_freedom(monkeypatch):
    """Results over them take as many degrees of freedom as there are sessions, less one."""
    how = Spread(2.0, freedom=1.5, sessions=5)
    monkeypatch.setattr(sweep_module, "_of_trained_classes", lambda data: data)
    monkeypatch.setattr(sweep_module, "spread_of_taps", lambda _, __: how)
    sources = SimpleNamespace(keys=["one"], load=lambda _: SimpleNamespace(grid=None))
    found = sweep_module._resampled(sources, 10)
    assert found["resample_factor"] == pytest.approx(2.0 * t.isf(0.025, 1.5) / t.isf(0.025, 4))
    assert found["resample_sessions"] == 5
