"""Parallel work on threads of this process, for compiled loops."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event

from .errors import InputError


def cores(workers: int | None) -> int:
    """Number of threads to use, by default one per core.

    Raises:
        InputError: The number is below 1.
    """
    if workers is None:
        workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if workers < 1:
        raise InputError(f"The number of workers must be at least 1, got {workers}.")
    return workers


def in_order[T](tasks: Iterable[Callable[[], T]], workers: int, unwanted: Event | None = None) -> Iterator[T]:
    """Results of tasks in their order, computed a few at a time.

    Args:
        tasks: The tasks.
        workers: Number of threads.
        unwanted: Set when no more results are wanted, as after Ctrl-C; long tasks should check it.
    """
    if workers == 1:
        yield from (task() for task in tasks)
        return
    waiting: deque[Future[T]] = deque()
    with ThreadPoolExecutor(workers) as executor:
        try:
            for task in tasks:
                waiting.append(executor.submit(task))
                if len(waiting) > 2 * workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            if unwanted is not None:
                unwanted.set()
            for future in waiting:
                future.cancel()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limits linear algebra to one thread, as more are several times slower for many small matrices."""
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    with threadpool_limits(1):
        yield
