"""`solidtouch sweep` from study file to store."""

import time

import pytest
from solidtouch.analysis.sweep import dask as sweep_dask
from solidtouch.analysis.sweep.result import open_sweep
from solidtouch.models.errors import InputError


def test_a_study_becomes_a_store_beside_it(command, make_study, tmp_path):
    done = command("sweep", make_study(), "--workers", 1)

    assert done.code == 0
    assert "study.zarr: 2 of 2 cells." in " ".join(done.out.split())
    assert (open_sweep(tmp_path / "study.zarr")["status"] == 1).all()


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
        (("--workers", 2, "--scheduler", "tcp://127.0.0.1:1"), "--workers goes without --scheduler"),
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

    monkeypatch.setattr(sweep_dask, "Client", refuse)
    monkeypatch.setattr(sweep_dask.time, "sleep", lambda _: pytest.fail("It goes on waiting."))
    with pytest.raises(InputError, match="There is no Dask scheduler at nowhere"):
        sweep_dask._client("nowhere", time.monotonic() + patience_s, patience_s)


def test_a_study_that_is_not_there_is_one_sentence(command, tmp_path):
    done = command("sweep", tmp_path / "none.toml")

    assert done.code == 2
    assert "none.toml: cannot read" in done.err
