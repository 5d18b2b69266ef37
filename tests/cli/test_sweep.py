"""`solidtouch sweep` from study file to store."""

import subprocess
import sys
import time

import pytest
import xarray as xr
from solidtouch.analysis.sweep.result import open_sweep
from solidtouch.analysis.tasks import dask as task_dask
from solidtouch.models.errors import InputError
from sweep_study import results

import solidtouch as st


def test_a_study_becomes_a_store_beside_it(command, make_study, tmp_path):
    done = command("sweep", make_study(), "--workers", 1)

    assert done.code == 0
    assert "study.zarr: 2 of 2 cells." in " ".join(done.out.split())
    assert (open_sweep(tmp_path / "study.zarr")["status"] == 1).all()


def test_the_function_writes_what_the_command_does(command, make_study, tmp_path):
    """And resumes it; a report of the store alone says the same."""
    study, heard, counted = make_study("pseudocount = [0.01, 1]"), [], []

    def stop(found):
        heard.append(found)
        if found.done == 3:
            raise KeyboardInterrupt

    done = command("sweep", study, "--workers", 1)
    with pytest.raises(KeyboardInterrupt):
        st.sweep(study, tmp_path / "function.zarr", workers=1, hear=stop)
    assert st.SweepReport.open(tmp_path / "function.zarr").found[:3] == (4, 3, 0)
    report = st.sweep(study, tmp_path / "function.zarr", workers=1, progress=lambda *_: counted.append)

    assert done.code == 0
    assert [found.done for found in heard] == [0, 1, 2, 3]
    assert counted == [3, 1]
    xr.testing.assert_identical(results(report.path), results(tmp_path / "study.zarr"))
    assert repr(st.SweepReport.open(report.path)) == repr(report)
    assert "4 of 4 cells." in repr(report)
    assert "pseudocount" in report._repr_html_()


@pytest.mark.slow
def test_a_script_needs_no_guard(make_study, tmp_path):
    """Its processes do not run it again, which a faster test of `analysis/sweep` sees, too."""
    script = tmp_path / "script.py"
    script.write_text(f"import solidtouch as st\nprint(st.sweep({str(make_study())!r}, workers=2).found.counts)\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, timeout=60)

    assert (done.returncode, done.stdout, done.stderr) == (0, "2 of 2 cells\n", "")


def test_means_over_data_sets_come_with_intervals(make_study):
    report = st.sweep(make_study("power = [0.3, 1]", head="resamples = 5"), workers=1)
    at = report.results.sel(theta=0.5, policy="passive")
    found = report.over_data(at).squeeze()
    gain = report.over_data((at["belief"].sel(power=1) - at["belief"].sel(power=0.3)).to_dataset(name="gain"), ["gain"])

    assert (found["belief_low"] < found["belief"]).all()
    assert gain["gain"].item() == pytest.approx(found["belief"].sel(power=1) - found["belief"].sel(power=0.3))


def test_a_store_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(st.InputError, match=r"none\.zarr: no such store\."):
        st.SweepReport.open(tmp_path / "none.zarr")


def test_failed_cells_are_said_and_give_exit_code_1(command, make_study):
    done = command("sweep", make_study('power = ["J", "learned"]'), "--workers", 1)

    assert done.code == 1
    assert "2 of 4 cells, 2 failed." in " ".join(done.out.split())
    assert "Failed with: solidtouch.models.errors.InputError:" in " ".join(done.out.split())
    assert "2 of 4 cells, 2 failed" in done.err
    assert "--retry-failed" in done.out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--workers", 2, "--scheduler", "tcp://127.0.0.1:1"), "--workers cannot be combined with --scheduler"),
        (("--scheduler", "tcp://127.0.0.1:1", "--patience", 0.2), "There is no Dask scheduler at tcp://127.0.0.1:1"),
        (("--scheduler", "nowhere:x", "--patience", 0.2), "There is no Dask scheduler at nowhere:x"),
    ],
)
def test_what_cannot_be_used_is_one_sentence(command, make_study, words, sentence):
    done = command("sweep", make_study(), *words)

    assert done.code == 2
    assert sentence in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(("error", "patience_s"), [(OSError, -1.0), (ValueError, 60.0)])
def test_a_scheduler_is_not_waited_for_when_time_is_up_or_its_address_is_none(monkeypatch, error, patience_s):
    def refuse(*_, **__):
        raise error

    monkeypatch.setattr(task_dask, "Client", refuse)
    monkeypatch.setattr(task_dask.time, "sleep", lambda _: pytest.fail("It goes on waiting."))
    with pytest.raises(InputError, match="There is no Dask scheduler at nowhere"):
        task_dask._client("nowhere", time.monotonic() + patience_s, patience_s)


def test_a_study_that_is_not_there_is_one_sentence(command, tmp_path):
    done = command("sweep", tmp_path / "none.toml")

    assert done.code == 2
    assert "none.toml: cannot read" in done.err
