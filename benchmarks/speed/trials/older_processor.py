"""This project's trials with fewer vector instructions than the processor has, each in a process of its own."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from multiprocessing import get_context
from platform import machine
from typing import Any
from unittest.mock import patch

from benchmarks.speed.trials.job import Decisions, Job, ours

PROCESSORS = {"AVX2": "haswell", "SSE2": "x86-64"}
"""What numba compiles for, by the vector instructions that it has."""
_held: list[Job] = []


def _hold(job: Job) -> None:
    _held.append(job)


def _play(told: bool) -> Decisions | None:
    found = ours(_held[0])
    return found if told else None


@contextmanager
def older_processors(job: Job) -> Iterator[dict[str, Callable[[bool], Any]]]:
    """Ways to play a job by their vector instructions, which tell decisions on request; none but on x86-64."""
    found: dict[str, Callable[[bool], Any]] = {}
    with ExitStack() as stack:
        for name, processor in PROCESSORS.items() if machine() in ("x86_64", "AMD64") else ():
            process = stack.enter_context(ProcessPoolExecutor(1, get_context("spawn"), _hold, (job,)))
            found[name] = lambda told, process=process: process.submit(_play, told).result()
            with patch.dict(os.environ, NUMBA_CPU_NAME=processor, NUMBA_CPU_FEATURES=""):
                found[name](False)  # starts the process, which compiles
        yield found
