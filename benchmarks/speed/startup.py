"""Start-up time of commands that do little, next to the imports they cannot avoid."""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import preset

from benchmarks.speed.rows import Row, interleaved
from benchmarks.speed.trials.job import SEED

WORK = "starting a command"
UNIT = "command"


def rows(quick: bool = False) -> list[Row]:
    """Seconds from the start of a process to its end."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "taps.nc"
        simulate_session(preset("paper"), SEED, 0).save(path)
        ways = {
            "python -c 'import xarray'": _command("-c", "import xarray"),
            "python -c 'import numpy'": _command("-c", "import numpy"),
            "solidtouch --help": _command("-m", "solidtouch.cli", "--help"),
            "solidtouch inspect": _command("-m", "solidtouch.cli", "inspect", str(path)),
        }
        for run in ways.values():
            run()  # files come into memory
        seconds = interleaved(ways, 1 if quick else 7)
    return [Row(WORK, method, seconds[method], UNIT) for method in ways]


def _command(*words: str) -> Callable[[], object]:
    return lambda: subprocess.run([sys.executable, *words], check=True, capture_output=True)  # noqa: S603
