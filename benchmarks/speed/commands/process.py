"""One process from its start to its end: time, processor time, memory, and how busy others kept the machine."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

_LAUNCH = """
import json, os, sys, time
began = time.perf_counter()
process = os.posix_spawn(sys.argv[2], sys.argv[2:], os.environ)
_, status, used = os.wait4(process, 0)
measured = time.perf_counter() - began, used.ru_utime + used.ru_stime, used.ru_maxrss, os.waitstatus_to_exitcode(status)
with open(sys.argv[1], "w") as file:
    json.dump(measured, file)
"""
"""A small process between this one and the measured one, whose peak memory would otherwise begin with that of this."""
_NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"
_MAXRSS = 1 if sys.platform == "darwin" else 1024  # bytes


class Spent(NamedTuple):
    """What a process took.

    Attributes:
        seconds: From its start to its end.
        processor_s: On all cores, with the processes that it started and waited for.
        peak: Memory in bytes of the largest of them.
        others: Share of the machine's processor time that other processes took meanwhile; NaN if unknown.
    """

    seconds: float
    processor_s: float
    peak: float
    others: float


def spent(
    words: Sequence[str], folder: Path, variables: Mapping[str, str] | None = None, inside: bool = False
) -> Spent:
    """Runs a program in a folder; Python keeps its bytecode, as it does in an installation.

    Args:
        words: Path of the program and its arguments.
        folder: Where it runs.
        variables: Environment variables beside those of this process.
        inside: Whether the program's last line tells its own `seconds` and `processor_s`, to be taken instead.

    Raises:
        RuntimeError: It ends with another exit code than 0.
    """
    surroundings = {name: value for name, value in os.environ.items() if name != _NO_BYTECODE}
    with tempfile.TemporaryDirectory() as beside:
        report = Path(beside) / "measured.json"
        launch = [sys.executable, "-I", "-S", "-c", _LAUNCH, str(report), *words]
        busy, began = _busy_s(), time.perf_counter()
        done = subprocess.run(  # noqa: S603
            launch, cwd=folder, env=surroundings | dict(variables or {}), capture_output=True, text=True, check=True
        )
        taken, busy = time.perf_counter() - began, _busy_s() - busy
        seconds, processor_s, peak, code = json.loads(report.read_text(encoding="utf-8"))
    if code:
        raise RuntimeError(f"{' '.join(words)} ended with exit code {code}:\n{done.stdout}{done.stderr}")
    others = max(0.0, busy - processor_s) / (taken * (os.cpu_count() or 1))
    if inside:
        own = json.loads(done.stdout.splitlines()[-1])
        seconds, processor_s = own["seconds"], own["processor_s"]
    return Spent(seconds, processor_s, peak * _MAXRSS, others)


def _busy_s() -> float:
    """Seconds that all processors have worked for anybody since the machine started."""
    try:
        _, user, nice, system, _, _, irq, softirq, *_ = (
            Path("/proc/stat").read_text(encoding="utf-8").partition("\n")[0].split()
        )
    except (OSError, ValueError):
        return float("nan")
    return sum(map(int, (user, nice, system, irq, softirq))) / os.sysconf("SC_CLK_TCK")
