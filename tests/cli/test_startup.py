"""Short commands import little: what they load is counted here, not how long that takes."""

import json
import subprocess
import sys
from typing import NamedTuple

import pytest

SLOW = {
    *("jax", "numpyro", "funsor", "numba", "matplotlib", "arviz", "scipy", "dask", "distributed", "pyarrow", "zarr"),
    "sklearn",
}
MODELS = ("histogram", "profile", "session")

RUN = """
import contextlib, io, json, sys
from solidtouch.cli.main import run

for name, sys.argv[1:] in json.loads(sys.argv[1]).items():
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        try:
            run()
        except SystemExit as stopped:
            code = stopped.code
    loaded = [name for name, module in sys.modules.items() if module is not None]
    print(json.dumps([name, code, loaded, printed.getvalue()]), flush=True)
"""


class Ran(NamedTuple):
    """Exit code, the modules that were loaded by the end of a command, and what it printed."""

    code: int
    modules: set[str]
    printed: str


def run_all(commands, before="", after=""):
    """Runs commands one after the other in a process of their own; code may run before and after."""
    done = subprocess.run(
        [sys.executable, "-c", before + RUN + after, json.dumps(commands)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    lines = map(json.loads, done.stdout.splitlines())
    return {name: Ran(code, set(modules), printed) for name, code, modules, printed in lines}


@pytest.fixture(scope="module")
def data(make_taps, tmp_path_factory):
    """A small tap set as netCDF."""
    path = tmp_path_factory.mktemp("data") / "taps.nc"
    make_taps().save(path)
    return path


@pytest.fixture(scope="module")
def ran(data):
    """Commands of one process; those that load least come first, as each finds what the ones before it have loaded.

    Dask, which only the first of them could hide, is hidden from all.
    """
    folder, taps = data.parent, str(data)
    simulating = ["simulate", "--out", str(folder), "--sessions", "1", "--preset", "ideal"]
    fitting = {
        name: ["fit", taps, "--out", str(folder / f"{name}.nc"), "--model", name, "--draws", "1"] for name in MODELS
    }
    commands = {
        "help": ["--help"],
        "convert": ["convert", taps, str(folder / "copy.nc")],
        "simulate": simulating,
    }
    return run_all(commands | fitting, before="import sys; sys.modules['dask'] = None")


def test_help_loads_no_data_library(ran):
    assert ran["help"].code == 0
    assert "inspect" in ran["help"].printed
    assert not ran["help"].modules & (SLOW | {"numpy", "xarray", "pandas", "h5py"})


def test_inspect_loads_nothing_beside_xarray(data):
    """Dask is hidden during the command only: a program that runs one in its own process can import it afterwards."""
    inspect = run_all({"inspect": ["inspect", str(data)]}, after="import dask.base")["inspect"]

    assert inspect.code == 0
    assert "Taps per cell" in inspect.printed
    assert "xarray" in inspect.modules
    assert not inspect.modules & SLOW


def test_convert_loads_nothing_beside_xarray(ran):
    assert ran["convert"].code == 0
    assert "168 taps" in ran["convert"].printed
    assert not ran["convert"].modules & SLOW


def test_simulate_loads_no_jax(ran):
    assert ran["simulate"].code == 0
    assert not ran["simulate"].modules & {"jax", "numpyro", "matplotlib", "scipy.signal"}


@pytest.mark.parametrize("model", MODELS)
def test_fit_loads_no_jax(ran, model):
    """It counts in compiled loops, and posteriors in closed form need no more."""
    assert ran[model].code == 0
    assert "numba" in ran[model].modules
    assert not ran[model].modules & {"jax", "numpyro", "matplotlib"}


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems draw on a thread")
def test_another_process_draws_the_figures_of_studies(tmp_path, make_taps):
    """This one does not even load what draws them, nor JAX, of which the histogram makes no use."""
    make_taps(sessions=2, repeats=8).save(tmp_path / "taps.nc")
    some = [str(tmp_path / "taps.nc"), "--quick", "--bins", "10", "--out"]
    comparing = ["compare", *some, str(tmp_path / "compare"), "--models", "histogram"]
    ran = run_all({"audit": ["audit", *some, str(tmp_path / "audit")], "compare": comparing})
    audit, compare = ran["audit"], ran["compare"]

    assert audit.code == 0
    assert (tmp_path / "audit" / "remedies.svg").exists()
    assert "numba" in audit.modules
    assert not audit.modules & {"matplotlib", "jax", "numpy.f2py", "cffi"}
    assert compare.code == 0
    assert "arviz_stats" in compare.modules
    assert not compare.modules & {"matplotlib", "jax", "numpyro"}


def test_a_program_that_has_loaded_xarray_can_run_a_command(data):
    """xarray has found dask by then, which is not hidden from it any more."""
    inspect = run_all({"inspect": ["inspect", str(data)]}, before="import xarray")["inspect"]

    assert inspect.code == 0
    assert "Taps per cell" in inspect.printed
    assert "dask" in inspect.modules
