"""Parallel work on threads of this process, for compiled loops."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from threading import Event, RLock, Thread, local
from typing import Any

from .errors import InputError


class _Here(local):
    """What holds in this thread: whether it has one core, and what says that its results are no longer wanted."""

    one_core = False
    unwanted: tuple[Event, ...] = ()


_here, _numpyro = _Here(), RLock()
_PATIENCE_S = 1.0


@contextmanager
def one_core() -> Iterator[None]:
    """Has work in the block use one core by default, as others are busy with work of the same kind."""
    before, _here.one_core = _here.one_core, True
    try:
        yield
    finally:
        _here.one_core = before


def cores(workers: int | None) -> int:
    """Number of threads to use, by default one per core.

    Raises:
        InputError: The number is below 1.
    """
    if workers is None and _here.one_core:
        return 1
    if workers is None:
        workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if workers < 1:
        raise InputError(f"The number of workers must be at least 1, got {workers}.")
    return workers


def in_order[T](
    tasks: Iterable[Callable[[], T]],
    workers: int,
    alone: Callable[[Any], bool] = lambda task: False,  # noqa: ARG005
    ahead: int | None = None,
) -> Iterator[T]:
    """Results of tasks in their order, computed a few at a time; long ones should call `check_wanted`.

    Args:
        tasks: The tasks.
        workers: Number of threads.
        alone: Tasks that must run in the thread that takes the results.
        ahead: How many tasks are begun or wait behind the first without a result; default twice the threads.
    """
    if workers == 1:
        for task in tasks:
            check_wanted()
            yield task()
        return
    waiting: deque[Future[T] | Callable[[], T]] = deque()
    unwanted = *_here.unwanted, Event()

    def work(task: Callable[[], T]) -> T:
        _here.unwanted = unwanted
        check_wanted()
        return task()

    def result() -> T:
        first = waiting.popleft()
        return first.result() if isinstance(first, Future) else first()

    with other_threads(workers) as executor:
        try:
            for task in tasks:
                waiting.append(task if alone(task) else executor.submit(work, task))
                if len(waiting) > (2 * workers if ahead is None else ahead):
                    yield result()
            while waiting:
                yield result()
        finally:
            unwanted[-1].set()


@contextmanager
def other_threads(workers: int) -> Iterator[ThreadPoolExecutor]:
    """Threads for work beside that of this one.

    If the block fails, as by Ctrl-C, what has not begun is dropped, and what goes on is waited for a second at most.
    """
    executor = ThreadPoolExecutor(workers, initializer=_on_own_cores(workers))
    try:
        yield executor
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        ending = Thread(target=executor.shutdown, daemon=True)
        ending.start()
        ending.join(_PATIENCE_S)
        raise
    executor.shutdown()


def _on_own_cores(workers: int) -> Callable[[], None] | None:
    """What each thread of a pool calls first: where there are as many as cores, it moves to one of its own.

    Linux may start them on the same core, as new threads wait for the interpreter, and take milliseconds to part them;
    later it moves them as it likes.
    """
    if not hasattr(os, "sched_setaffinity"):
        return None
    free = os.sched_getaffinity(0)
    if workers != len(free):
        return None
    each = iter(free)

    def begin() -> None:
        with suppress(OSError):  # the cores of the process may have changed
            os.sched_setaffinity(0, {next(each)})
            os.sched_setaffinity(0, free)

    return begin


@contextmanager
def one_numpyro() -> Iterator[None]:
    """Waits while another thread is in such a block, as NumPyro has one stack of handlers for all threads."""
    with _numpyro:
        yield


def check_wanted(_: int = 0) -> None:
    """Ends a task of `in_order` whose results are no longer wanted, as after Ctrl-C.

    Raises:
        CancelledError: They are not.
    """
    if any(unwanted.is_set() for unwanted in _here.unwanted):
        raise CancelledError


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limits linear algebra to one thread, as more are several times slower for many small matrices."""
    from threadpoolctl import threadpool_limits  # noqa: PLC0415

    with threadpool_limits(1):
        yield
