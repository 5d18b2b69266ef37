"""Measurements: rows of times from interleaved rounds, and the machine they were taken on."""

import os
import platform
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

LIMIT = "limit: "
"""How the method of a row begins that shows what the machine can do."""

ALL_CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [*range(os.cpu_count() or 1)]
PACKAGES = (
    *("solidtouch", "numpy", "scipy", "numba", "jax", "jaxlib", "numpyro", "xarray", "dask", "zarr"),
    *("dynamax", "hmmlearn", "scikit-learn"),
)


class Row(NamedTuple):
    """One way of doing some work.

    The first row of a work is its baseline; a row whose method begins with `LIMIT` is what the machine can do.

    Attributes:
        work: What is done; rows of the same work are compared.
        method: How.
        seconds: Time of one unit in each round, empty where the method could not be run.
        unit: What is counted, such as "tap-update".
        note: What a reader has to know.
    """

    work: str
    method: str
    seconds: list[float]
    unit: str
    note: str = ""


class Machine(NamedTuple):
    """What the times were taken on.

    Attributes:
        cpu: Model name.
        cores: Cores that this process may use.
        caches: Size of each cache of the first core, by name.
        vectors: Vector instructions, of those that matter here.
        system: Operating system.
        python: Version.
        compiler: The C compiler, what it says of itself; empty where there is none.
        packages: Version of each package, "not installed" where it is not.
    """

    cpu: str
    cores: int
    caches: dict[str, str]
    vectors: list[str]
    system: str
    python: str
    compiler: str
    packages: dict[str, str]


def machine() -> Machine:
    """This machine; what the system does not tell is left empty."""
    facts = _read(Path("/proc/cpuinfo"))
    model = re.search(r"model name\s*: (.*)", facts)
    flags = re.search(r"flags\s*: (.*)", facts)
    vectors = re.findall(r"\b(?:avx2|fma|avx512\w*|amx\w*)\b", flags[1]) if flags else []
    return Machine(
        cpu=model[1] if model else platform.processor(),
        cores=len(ALL_CORES),
        caches=_caches(),
        vectors=vectors,
        system=platform.platform(),
        python=platform.python_version(),
        compiler=_compiler_version(),
        packages={name: _version(name) for name in PACKAGES},
    )


def c_compiler() -> str | None:
    """The C compiler, or `None` where there is none."""
    return shutil.which(os.environ.get("CC", "cc"))


def interleaved(methods: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, list[float]]:
    """Seconds of each method in each round; every round runs all of them, beginning with another one."""
    names = list(methods)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    for turn in range(rounds):
        start = turn % len(names)
        for name in names[start:] + names[:start]:
            began = time.perf_counter()
            methods[name]()
            seconds[name].append(time.perf_counter() - began)
    return seconds


def per_unit(seconds: Sequence[float], units: float) -> list[float]:
    """Seconds of one unit in each round."""
    return [time_ / units for time_ in seconds]


@contextmanager
def on_cores(count: int) -> Iterator[None]:
    """This thread, and those it starts, run on so many cores, where the system can be told so."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, ALL_CORES[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def _caches() -> dict[str, str]:
    found = {}
    for folder in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, kind = _read(folder / "level").strip(), _read(folder / "type").strip()
        found[f"L{level}{kind[:1].lower() if level == '1' else ''}"] = _read(folder / "size").strip()
    return found


def _compiler_version() -> str:
    program = c_compiler()
    if program is None:
        return ""
    told = subprocess.run([program, "--version"], capture_output=True, text=True, check=False)  # noqa: S603
    return told.stdout.partition("\n")[0]


def _read(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
