"""Runs tasks on this machine: in this process, or in a pool whose processes may die.

Workers are fresh interpreters, so nothing of this process leaks into them; each has a pipe, holds the data of one
name at a time and is sent the next when it needs them. They end with this process, however it ends.
"""

import gc
import os
import signal
import sys
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from multiprocessing import connection, get_context, parent_process
from multiprocessing.connection import Connection
from types import ModuleType
from typing import Any

from ...models.errors import InputError
from .batches import Batch, TaskQueue
from .task import Load, Outcome, Runner, Task, Work, attempt

_BATCH_S = 0.2


def in_this_process(tasks: Iterator[Task], work: Work, load: Load) -> Generator[Outcome]:
    """Runs one task after the other."""
    for task in tasks:
        yield attempt(task, work, load(task.data))


def in_processes(workers: int) -> Runner:
    """A runner with this many processes.

    Raises:
        InputError: A process ends before it is ready to work.
    """

    def run(tasks: Iterator[Task], work: Work, load: Load) -> Generator[Outcome]:
        queue = TaskQueue(tasks, _BATCH_S)
        crew: list[_Worker] = []
        try:
            while True:
                if queue and len(crew) < workers:
                    crew.append(_Worker(work))
                    continue
                for worker in crew:
                    if worker.idle and queue:
                        worker.give(queue.take(), load)
                if not queue and not any(worker.batch for worker in crew):
                    return
                for worker in _heard(crew):
                    try:
                        outcomes = worker.hear()
                    except (EOFError, OSError):
                        crew.remove(worker)
                        outcomes = _mourn(worker, queue, alone=not any(other.ready for other in crew))
                    else:
                        queue.finished(outcomes)
                    yield from outcomes
        finally:
            for worker in crew:
                worker.end()

    return run


class _Worker:
    """One process and what it is at."""

    def __init__(self, work: Work) -> None:
        context = get_context("spawn")
        self.batch: Batch | None = None
        self.ready = False
        self._data = ""
        self.pipe, other = context.Pipe()
        self._process = context.Process(target=_work, args=(other, work, gc.get_threshold()), daemon=True)
        try:
            with _without_interrupts(), _another_main():
                self._process.start()
        finally:
            other.close()

    @property
    def idle(self) -> bool:
        """Whether it waits for work."""
        return self.ready and self.batch is None

    def give(self, batch: Batch, load: Load) -> None:
        """Sends a batch, and its data where the worker holds others."""
        data = load(batch.data) if batch.data != self._data else None
        self.batch, self._data = batch, batch.data
        with suppress(ConnectionError):  # a worker that has died is noticed when nothing comes back
            self.pipe.send((batch.tasks, data))

    def hear(self) -> list[Outcome]:
        """What it has sent: that it is ready, or the outcomes of its batch.

        Raises:
            EOFError: It has died.
            OSError: Likewise.
        """
        outcomes = self.pipe.recv()
        self.ready, self.batch = True, None
        return outcomes

    def end(self) -> int | None:
        """Ends the process, whatever it does; returns its exit code."""
        self._process.kill()
        self._process.join()
        code = self._process.exitcode
        self.pipe.close()
        self._process.close()
        return code


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes that start inside ignore Ctrl-C, which reaches all of a terminal; it is dealt with here alone."""
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def _another_main() -> Iterator[None]:
    """Processes started within the block do not import the script that is running, which would start the work again.

    Workers need nothing of it, and `multiprocessing` asks `sys.modules` which it is.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _heard(crew: list[_Worker]) -> list[_Worker]:
    """Workers that have sent something or died; waits for one."""
    pipes = connection.wait([worker.pipe for worker in crew if not worker.idle])
    return [worker for worker in crew if worker.pipe in pipes]


def _mourn(worker: _Worker, queue: TaskQueue, *, alone: bool) -> list[Outcome]:
    """What becomes of the work of a process that died; one that was killed while others work is replaced.

    Raises:
        InputError: It ended before it was ready, and nobody killed it or no other is ready.
    """
    code = worker.end()
    killed = code is not None and code < 0
    if not worker.ready and (alone or not killed):
        raise InputError(f"A worker process ended before it was ready to work, exit code {code}.")
    how = f"signal {-(code or 0)}" if killed else f"exit code {code}"
    if worker.batch is None:
        return []
    return queue.died(worker.batch, f"The worker process died ({how}); the machine may have run out of memory.")


def _work(pipe: Connection, work: Work, collected: tuple[int, int, int]) -> None:
    """The life of a worker process, which collects garbage as often as the other process."""
    gc.set_threshold(*collected)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    held: list[Any] = []
    with suppress(EOFError, OSError):  # the other end has died
        pipe.send([])
        while True:
            tasks, sent = pipe.recv()
            held = [sent] if sent is not None else held
            pipe.send([attempt(task, work, held[0]) for task in tasks])


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
    os._exit(1)
