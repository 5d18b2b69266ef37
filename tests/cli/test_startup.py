"""Short commands import little: what they load is counted here, not how long that takes."""

import subprocess
import sys

import pytest

SLOW = {"jax", "numpyro", "funsor", "numba", "matplotlib", "arviz", "scipy", "dask", "distributed", "zarr", "sklearn"}

RUN = """
import sys
from solidtouch.cli.main import run

try:
    run()
finally:
    print(*sorted(name for name, module in sys.modules.items() if module is not None), file=sys.stderr)
"""


def loaded(*words, before="", after=""):
    """The modules that a command has loaded when it ends well, and what it printed; code may run before and after."""
    code = f"{before}{RUN}    {after}"
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True, timeout=60)
    return set(done.stderr.split()), done.stdout


@pytest.fixture(scope="module")
def data(make_taps, tmp_path_factory):
    """A small tap set as netCDF and as arrays."""
    path = tmp_path_factory.mktemp("data") / "taps.nc"
    make_taps().save(path)
    return path


def test_help_loads_no_data_library():
    modules, printed = loaded("--help")

    assert "inspect" in printed
    assert not modules & (SLOW | {"xarray", "pandas", "h5py"})


def test_inspect_loads_nothing_beside_xarray(data):
    modules, printed = loaded("inspect", str(data))

    assert "Taps per cell" in printed
    assert "xarray" in modules
    assert not modules & SLOW


def test_convert_loads_nothing_beside_xarray(data, tmp_path):
    modules, printed = loaded("convert", str(data), str(tmp_path / "copy.nc"))

    assert "168 taps" in printed
    assert not modules & SLOW


@pytest.mark.parametrize("model", ["histogram", "profile", "session"])
def test_fit_loads_no_jax(data, tmp_path, model):
    """It counts in compiled loops, and posteriors in closed form need no more."""
    modules, _ = loaded("fit", str(data), "--out", str(tmp_path / "model.nc"), "--model", model, "--draws", "1")

    assert "numba" in modules
    assert not modules & {"jax", "numpyro", "matplotlib", "dask"}


def test_simulate_loads_no_jax(tmp_path):
    modules, _ = loaded("simulate", "--out", str(tmp_path), "--sessions", "1", "--preset", "ideal")

    assert not modules & {"jax", "numpyro", "matplotlib", "dask", "numba"}


def test_dask_is_hidden_during_a_command_only(data):
    """A program that runs one in its own process can import it afterwards."""
    modules, printed = loaded("inspect", str(data), after="import dask.base; print(dask.base.__name__)")

    assert "dask" not in modules
    assert printed.endswith("dask.base\n")


def test_a_program_that_has_loaded_xarray_can_run_a_command(data):
    """xarray has found dask by then, which is not hidden from it any more."""
    modules, printed = loaded("inspect", str(data), before="import xarray")

    assert "Taps per cell" in printed
    assert "dask" in modules
