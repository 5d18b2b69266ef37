"""Work in pieces on the threads of this process; compiled loops run on all of them at once."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event

from .errors import InputError


def cores(workers: int | None) -> int:
    """How many threads to use: as many as there are cores unless said.

    Raises:
        InputError: Less than one.
    """
    if workers is None:
        workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if workers < 1:
        raise InputError(f"There must be at least one worker, got {workers}.")
    return workers


def in_order[T](tasks: Iterable[Callable[[], T]], workers: int, unwanted: Event | None = None) -> Iterator[T]:
    """The results of tasks in their order, a few of them in progress at a time.

    Args:
        tasks: What to do.
        workers: How many threads.
        unwanted: Set when no more results are wanted, as after Ctrl-C; long tasks look at it, as they are waited for.
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
    """Keeps linear algebra to one thread: for many small matrices more of them are several times slower."""
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    with threadpool_limits(1):
        yield
