"""The store of a sweep is whole at any moment."""

import contextlib
import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from slow_cases import slow_but
from solidtouch.analysis.sweep.cells import CellGrid
from solidtouch.analysis.sweep.result import open_sweep
from solidtouch.analysis.sweep.store import DONE, FAILED, PENDING, QUANTITIES, create_store, locked, read_about
from solidtouch.analysis.tasks.task import Outcome
from solidtouch.models.errors import InputError

THRESHOLDS = (0.5, 0.95)
GRID = CellGrid(
    (
        *(("a", "b"), ("histogram",), (10,), ("global",), (0.01, 1.0)),
        *(("J", 0.5), ("uniform", "clamp"), ("passive", "active"), (1, 2, 3), (0,), (0,)),
    )
)


def make(path: Path, grid: CellGrid = GRID, **about):
    return create_store(path, grid, THRESHOLDS, dict.fromkeys(grid.axes[0], ("mm", "deg")), {"title": "t"} | about)


def done(number: int, value: float = 1.5) -> Outcome:
    values = {name: np.array([value, value + 1]) for name in QUANTITIES if name != "seconds"}
    return Outcome(number, values, 0.25)


def failed(number: int) -> Outcome:
    return Outcome(number, {}, 0.25, "Traceback: é went wrong")


def test_an_empty_store_has_every_axis_and_only_pending_cells(tmp_path):
    store = make(tmp_path / "s.zarr")

    dataset = open_sweep(tmp_path / "s.zarr")

    assert not store.status().any()
    assert dict(dataset["taps"].sizes) == {
        "data": 2, "model": 1, "bins": 1, "value_range": 1, "pseudocount": 2, "power": 2, "border": 2, "policy": 2,
        "fixation": 3, "seed": 1, "resample": 1, "theta": 2,
    }  # fmt: skip
    assert dataset["power"].values.tolist() == ["J", "0.5"]
    assert np.isnan(dataset["taps"]).all()
    assert (dataset["status"] == PENDING).all()


def test_a_cell_is_read_where_it_belongs_and_nowhere_else(tmp_path):
    store = make(tmp_path / "s.zarr")
    active = next(n for n in GRID.distinct if GRID.cell(int(n)).policy == "active")
    store.write(done(int(active)))
    cell = GRID.cell(int(active))

    dataset = open_sweep(tmp_path / "s.zarr").load()
    there = dataset.sel(
        data=cell.data, pseudocount=cell.pseudocount, power=cell.power, border=cell.border, policy=cell.policy,
        fixation=cell.fixation,
    ).squeeze()  # fmt: skip

    assert there["what_error"].sel(theta=0.95) == 2.5
    assert there["seconds"].sel(theta=0.5) == 0.25
    assert (dataset["status"] == DONE).sum() == 1
    assert np.isfinite(dataset["belief"]).sum() == 2
    assert dataset["where_error"].attrs["units"] == "deg"
    assert dataset["seconds"].attrs["units"] == "s"


def test_plain_xarray_reads_the_store(tmp_path):
    make(tmp_path / "s.zarr").write(done(0))

    stored = xr.open_zarr(tmp_path / "s.zarr", consolidated=False)

    assert stored["result"].dims[-2:] == ("quantity", "theta")
    assert stored["result"].sel(quantity="taps", theta=0.5).isel(seed=0).max() == 1.5
    assert stored["status"].attrs["flag_meanings"] == "pending done failed"
    assert stored["status"].attrs["flag_values"] == [PENDING, DONE, FAILED] == [0, 1, 2]
    assert stored.attrs["title"] == "t"


def test_a_passive_cell_is_at_all_borders_and_fixation_points(tmp_path):
    store = make(tmp_path / "s.zarr")
    store.write(done(0))

    passive = open_sweep(tmp_path / "s.zarr")["taps"].sel(policy="passive", data="a", pseudocount=0.01, power="J")

    assert (passive.sel(theta=0.5) == 1.5).all()
    assert passive.sel(theta=0.5).size == 6
    assert store.status()[GRID.distinct].sum() == 1


def test_a_failed_cell_keeps_its_traceback_until_it_is_done(tmp_path):
    store = make(tmp_path / "s.zarr")
    store.write(failed(0))
    assert store.status()[0] == FAILED
    dataset = open_sweep(tmp_path / "s.zarr")
    assert dataset["traceback"].values.ravel()[0] == "Traceback: é went wrong"

    store.write(done(0))

    assert store.status()[0] == DONE
    assert not any(text for text in open_sweep(tmp_path / "s.zarr")["traceback"].values.ravel())


class _Stop(BaseException):
    """Ends the program as a kill would."""


@pytest.mark.parametrize("before", [pytest.param((), marks=pytest.mark.slow), (failed(0),)], ids=["pending", "failed"])
def test_a_store_stopped_at_any_file_is_whole(tmp_path, monkeypatch, before):
    """Whatever was moved into place before the end, a cell that counts as done is there at all of its places."""
    replace, moved = Path.replace, 0

    def stopping(self, target):
        nonlocal moved
        if not moved:
            raise _Stop
        moved -= 1
        return replace(self, target)

    seen = set()
    for most in range(2 * len(GRID.places(0)) + 1):
        path = tmp_path / f"{most}.zarr"
        store = make(path)
        for outcome in before:
            store.write(outcome)
        monkeypatch.setattr(Path, "replace", stopping)
        moved = most
        with contextlib.suppress(_Stop):
            store.write(done(0))
        monkeypatch.setattr(Path, "replace", replace)
        status = store.status()[0]
        seen.add(int(status))
        if status == DONE:
            dataset = open_sweep(path).sel(policy="passive", data="a", pseudocount=0.01, power="J")
            assert np.isfinite(dataset["taps"]).all()
            assert (dataset["status"] == DONE).all()
        store.write(done(0))
        assert store.status()[0] == DONE
    assert seen == {DONE, FAILED if before else PENDING}


def test_reading_the_status_opens_no_chunk_of_a_done_cell(tmp_path, monkeypatch):
    store = make(tmp_path / "s.zarr")
    for number in GRID.distinct:
        store.write(done(int(number)))
    opened = []
    monkeypatch.setattr(Path, "read_bytes", opened.append)

    assert (store.status() == DONE).all()
    assert not opened


def test_a_store_of_one_cell_and_one_threshold_is_a_store(tmp_path):
    model = ("histogram",), (1,), ("global",), (0.0,), ("none",)
    grid = CellGrid((("a",), *model, ("prior",), (0.5,), (None,), (9,), (0,)))
    store = create_store(tmp_path / "s.zarr", grid, (0.9,), {"a": ("P(wrong)", "mm")}, {})
    store.write(Outcome(0, {name: np.array([math.nan]) for name in QUANTITIES}, 1.0))

    assert open_sweep(tmp_path / "s.zarr")["fixation"].values.tolist() == ["middle"]
    assert store.status().tolist() == [DONE]


def test_two_programs_cannot_write_at_once(tmp_path):
    make(tmp_path / "s.zarr")

    with (
        locked(tmp_path / "s.zarr"),
        pytest.raises(InputError, match="is being written by another sweep"),
        locked(tmp_path / "s.zarr"),
    ):
        pass
    with locked(tmp_path / "s.zarr"):
        pass


def test_a_store_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match=r"s\.zarr cannot be written: No such file"):
        make(tmp_path / "missing" / "s.zarr")
    with pytest.raises(InputError, match=r"none\.zarr cannot be written"), locked(tmp_path / "none.zarr"):
        pass
    store = make(tmp_path / "s.zarr")
    (tmp_path / "s.zarr" / "status" / ".writing").mkdir()
    with pytest.raises(InputError, match=r"s\.zarr cannot be written: Is a directory"):
        store.write(done(0))


def test_a_folder_that_is_no_store_is_refused(tmp_path):
    (tmp_path / "zarr.json").write_text("{}", encoding="utf-8")

    with pytest.raises(InputError, match="exists and is no sweep of format 1"):
        read_about(tmp_path)


ABOUT = {"study": "", "settings": '{"grid": {}}', "data_keys": "{}", "code": "{}"}


@pytest.mark.parametrize(
    "change",
    slow_but(
        [{"study": 3}, {"settings": "[" * 5000}, {"code": "{"}],
        [
            {"study": 3},
            {"settings": "{}"},
            {"settings": "[" * 5000},
            {"data_keys": '["a"]'},
            {"code": None},
            {"code": "{"},
        ],
    ),
)
def test_a_store_with_damaged_attributes_is_refused(tmp_path, change):
    make(tmp_path / "s.zarr", **ABOUT)
    assert read_about(tmp_path / "s.zarr")["settings"] == {"grid": {}}
    make(tmp_path / "t.zarr", **ABOUT | change)

    with pytest.raises(InputError, match=r"t\.zarr exists and is no sweep of format 1, or is damaged"):
        read_about(tmp_path / "t.zarr")


@pytest.mark.parametrize("name", ["c.0", "c.9.9.9.9.9.9.9.9.9.9", "c.a"])
def test_a_file_of_no_cell_is_named(tmp_path, name):
    store = make(tmp_path / "s.zarr")
    (tmp_path / "s.zarr/status" / name).touch()

    with pytest.raises(InputError, match=r"s\.zarr: damaged sweep"):
        store.status()


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [(b"\xff\xff\xff\x7f", "reading it takes .*damaged"), (b"", "not a sweep, or damaged")],
)
def test_damaged_results_are_refused(tmp_path, damage, sentence):
    """Zarr 3.1 makes as many texts as a chunk says that it holds."""
    make(tmp_path / "s.zarr")
    names = xr.Dataset(coords={"data": np.array(["a", "b"], dtype=object)})
    shutil.rmtree(tmp_path / "s.zarr/data")
    names.to_zarr(tmp_path / "s.zarr", mode="a", encoding={"data": {"compressors": None}}, consolidated=False)
    assert open_sweep(tmp_path / "s.zarr")["data"].values.tolist() == ["a", "b"]
    (chunk,) = (tmp_path / "s.zarr/data/c").iterdir()
    chunk.write_bytes(damage)

    with pytest.raises(InputError, match=rf"s\.zarr: {sentence}"):
        open_sweep(tmp_path / "s.zarr")


def test_a_store_that_cannot_be_built_leaves_nothing_behind(tmp_path, monkeypatch):
    def refuse(self, target):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "rename", refuse)

    with pytest.raises(InputError, match="cannot be written: Permission denied"):
        make(tmp_path / "s.zarr")
    assert not list(tmp_path.iterdir())
