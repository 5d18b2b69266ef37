"""A Dask cluster of processes for tests."""

import os
import socket
import subprocess
import sys
import time
from pathlib import Path


class Cluster:
    """A scheduler on a port of its own, and workers."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder = folder
        self.processes: list[subprocess.Popen] = []

    @property
    def address(self) -> str:
        """Of the scheduler."""
        return f"tcp://127.0.0.1:{self.port}"

    def scheduler(self, *words: object) -> subprocess.Popen:
        return self._start("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard", *words)

    def worker(self, *words: object) -> subprocess.Popen:
        return self._start("worker", self.address, "--nthreads", "1", "--no-nanny", "--no-dashboard", *words)

    def end(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()

    def _start(self, *words: object) -> subprocess.Popen:
        call = [sys.executable, "-m", "dask", *map(str, words)]
        environment = os.environ | {
            "PYTHONPATH": str(Path(__file__).parent),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            "DASK_LOGGING__DISTRIBUTED": "error",
            # Programs that this process optimizes less, see `conftest.py`, would round differently there.
            "JAX_DISABLE_MOST_OPTIMIZATIONS": str(_optimizes_little()),
        }
        self.processes.append(
            subprocess.Popen(
                call, cwd=self.folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
        )
        return self.processes[-1]


def _optimizes_little() -> bool:
    return "jax" in sys.modules and sys.modules["jax"].config.read("jax_disable_most_optimizations")


def wait_for(port: int) -> None:
    """Until a program listens on a port."""
    for _ in range(300):
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            time.sleep(0.1)
        else:
            return
    raise TimeoutError(port)
