"""C code, compiled for this processor when a benchmark asks for it."""

import ctypes
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from benchmarks.speed.rows import c_compiler

NO_COMPILER = "no C compiler that takes limit.c"
# Sums in any order, as -ffast-math has it, but without what that changes for the whole process when linking.
_FLAGS = (
    *("-O3", "-march=native", "-shared", "-fPIC", "-std=c11", "-fassociative-math", "-fno-signed-zeros"),
    *("-fno-trapping-math", "-fno-math-errno"),
)


@cache
def compiled_c(source: Path, *definitions: str) -> ctypes.CDLL | None:
    """A C file compiled for this processor with definitions such as "L=16"; `None` if that fails."""
    program = c_compiler()
    if program is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "limit.so"
        words = [f"-D{definition}" for definition in definitions]
        command = [program, *_FLAGS, *words, str(source), "-o", str(target)]
        if subprocess.run(command, check=False).returncode != 0:  # noqa: S603
            return None
        return ctypes.CDLL(str(target))
