"""Runs tasks on a Dask cluster.

The scheduler holds few batches at a time, however many tasks there are, and sees to workers that die. When it dies
itself, its successor at the same address is given what was not finished. Data that tasks share go to the scheduler
once and from there to the workers that need them.
"""

import logging
import time
from collections.abc import Callable, Generator, Iterator
from concurrent import futures
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any
from uuid import uuid4

import numpy as np
from dask import config
from distributed import Client, Future, KilledWorker, get_worker
from distributed.protocol import pickle

from ...models.errors import InputError
from ...models.threads import one_blas_thread, one_core
from .batches import Batch, TaskQueue
from .code import code, differences
from .task import Load, Outcome, Runner, Task, Work, attempt

_SECONDS_PER_THREAD = 0.01  # batches that take this long for each thread of the cluster come back 100 times a second
_LEAST_S = 0.5
_LOOK_S = 1.0
_ANSWER_S = 30.0
_GRACE_S = 1.0  # for what ends by a time limit of its own
_LOSSES = 5


class WrongCode(Exception):
    """A worker runs other software than the client."""


class _Lost(Exception):
    """The scheduler is gone, or has forgotten what it was told."""


def on_cluster(address: str, patience_s: float, note: Callable[[str], object]) -> Runner:
    """A runner on the Dask scheduler at this address.

    Args:
        address: Such as `tcp://10.0.0.1:8786`.
        patience_s: Time in seconds to wait for a scheduler and a worker, at the start and whenever they are lost.
        note: Called with a sentence when they are.

    Raises:
        InputError: There is no scheduler or no worker in that time, a worker runs other software, a task cannot be
            sent, or the scheduler is lost again and again before it has finished one.
    """
    # What these libraries log about a lost connection is pages long; `note` says it in a sentence.
    for library in ("distributed", "tornado", "asyncio"):
        logging.getLogger(library).setLevel(logging.CRITICAL)

    def run(tasks: Iterator[Task], work: Work, load: Load) -> Generator[Outcome]:
        queue, losses = TaskQueue(tasks, _LEAST_S), 0
        while queue:
            try:
                with (
                    _connected(address, patience_s) as client,
                    closing(_Session(client, queue, work, load, patience_s).outcomes()) as outcomes,
                ):
                    for outcome in outcomes:
                        losses = 0
                        yield outcome
            except _Lost as lost:
                losses += 1
                if losses == _LOSSES:
                    why = "" if lost.__cause__ is None else f" The last time: {_told(lost.__cause__)}."
                    raise InputError(
                        f"The scheduler at {address} lost its tasks {_LOSSES} times before one was finished.{why}"
                    ) from lost
                note(f"The connection to the scheduler at {address} is lost; waiting for it to come back.")

    return run


@contextmanager
def _connected(address: str, patience_s: float) -> Iterator[Client]:
    """A client of a scheduler with workers of the same software."""
    deadline = time.monotonic() + patience_s
    client = _client(address, deadline, patience_s)
    try:
        _await_worker(client, address, deadline, patience_s)
        yield client
    finally:
        with suppress(Exception):  # a scheduler that is gone cannot be told goodbye
            client.close(timeout=2)


def _client(address: str, deadline: float, patience_s: float) -> Client:
    while True:
        left = deadline - time.monotonic()
        begin = partial(Client, address, timeout=max(min(left, 5.0), 0.1), set_as_default=False)
        try:
            return _within(left, begin)
        except (OSError, ValueError) as error:
            if isinstance(error, ValueError):
                raise InputError(
                    f"There is no Dask scheduler at {address}; name it as tcp://10.0.0.1:8786, with its port."
                ) from error
            if time.monotonic() > deadline:
                raise InputError(f"There is no Dask scheduler at {address} after {patience_s:g} s.") from error
            time.sleep(0.2)


def _await_worker(client: Client, address: str, deadline: float, patience_s: float) -> None:
    try:
        client.wait_for_workers(1, timeout=max(deadline - time.monotonic(), 0.1))
        found: Any = _within(deadline - time.monotonic(), partial(client.run, code, on_error="return"))
        _within(deadline - time.monotonic(), partial(client.run_on_scheduler, code))
    except ImportError as error:
        raise InputError(f"The scheduler at {address} cannot run this solidtouch: {_told(error)}.") from error
    except TimeoutError as error:
        raise _no_worker(address, patience_s) from error
    except (OSError, CancelledError) as error:
        raise _Lost from error
    for worker, theirs in found.items():
        _check(worker, code(), theirs)


def _no_worker(address: str, patience_s: float) -> InputError:
    return InputError(f"The scheduler at {address} has no worker after {patience_s:g} s.")


def _within[T](seconds: float, work: Callable[[], T]) -> T:
    """What some work of a client gives, which may wait for good for a scheduler that is there but silent.

    Raises:
        TimeoutError: It takes longer; what waits is left behind.
    """
    result = futures.Future[T]()

    def run() -> None:
        try:
            result.set_result(work())
        except BaseException as error:
            result.set_exception(error)

    Thread(target=run, daemon=True).start()
    return result.result(timeout=max(seconds, 0.0) + _GRACE_S)


def _check(worker: str, expected: dict[str, str], found: Any) -> None:
    """Refuses a worker with other software.

    Raises:
        InputError: The sentence says which worker and what.
    """
    if isinstance(found, BaseException):
        raise InputError(f"The worker {worker} cannot run this solidtouch: {type(found).__name__}: {found}") from found
    if different := differences(expected, found):
        raise InputError(f"The worker {worker} runs other software than this client: {', '.join(different)}.")


class _Session:
    """What a scheduler has been given, until all is done or it is lost.

    Args:
        client: Of the scheduler.
        queue: Tasks to do.
        work: What each of them does.
        load: Gives data by name.
        patience_s: Time in seconds to wait for the scheduler to answer, and for a worker where all are gone.
    """

    def __init__(self, client: Client, queue: TaskQueue, work: Work, load: Load, patience_s: float) -> None:
        self._client = client
        self._queue = queue
        self._work = work
        self._load = load
        self._patience_s = patience_s
        self._name = uuid4().hex[:8]
        self._submitted = 0
        self._out: dict[Future, Batch] = {}
        self._data: dict[str, Future] = {}
        self._ended: SimpleQueue[Future] = SimpleQueue()
        self._looked = -_LOOK_S
        self._worked = time.monotonic()
        self._limit = 0

    def outcomes(self) -> Generator[Outcome]:
        """Outcomes as tasks finish.

        Raises:
            _Lost: The scheduler has to be found anew; what it had goes back to the queue.
            InputError: A worker runs other software, all workers are gone for too long, or a task cannot be sent.
        """
        try:
            while self._queue or self._out:
                self._fill()
                try:
                    future = self._ended.get(timeout=_LOOK_S)
                except Empty:
                    continue
                outcomes = self._received(future, self._out[future])
                del self._out[future]
                yield from outcomes
        finally:
            for batch in self._out.values():
                self._queue.lost(batch)
            with suppress(Exception):
                _within(_GRACE_S, partial(self._client.cancel, [*self._out, *self._data.values()], force=True))

    def _fill(self) -> None:
        """Keeps the workers in work."""
        if time.monotonic() - self._looked > _LOOK_S:
            with _asking():
                workers: Any = _within(max(self._patience_s, _ANSWER_S), self._client.nthreads)
            threads = sum(workers.values())
            self._looked, self._limit = time.monotonic(), 3 * threads + 2
            if threads:
                self._worked = self._looked
            elif self._looked - self._worked > self._patience_s:
                scheduler: Any = self._client.scheduler
                raise _no_worker(scheduler.address, self._patience_s)
            self._queue.seconds = max(_LEAST_S, _SECONDS_PER_THREAD * threads)
        while self._queue and len(self._out) < self._limit:
            batch = self._queue.take()
            self._submitted += 1
            # A name for each data lets the scheduler see their batches as one group and hand them to any worker.
            key = f"tasks-{self._name}-{batch.data}", self._submitted
            try:
                future = self._submit(_work, (batch, self._work), self._given(batch.data), code(), key=key)
            except _Lost:
                self._queue.lost(batch)
                raise
            self._out[future] = batch
            future.add_done_callback(self._ended.put)

    def _given(self, name: str) -> Future:
        """The data on the cluster; those no batch needs are dropped there."""
        if name not in self._data:
            needed = {batch.data for batch in self._out.values()}
            self._data = {other: future for other, future in self._data.items() if other in needed}
            # As an argument the scheduler keeps it, and can give it to another worker when one dies with it.
            self._data[name] = self._submit(_unpacked, self._load(name), key=f"data-{self._name}-{name}")
        return self._data[name]

    def _submit(self, function: Callable[..., Any], sent: Any, *others: Any, key: Any) -> Future:
        try:
            packed = _packed(sent)
        except Exception as error:
            raise InputError(f"A task cannot be sent to the cluster: {_told(error)}.") from error
        with _asking(), config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
            return self._client.submit(function, packed, *others, key=key, pure=False)

    def _received(self, future: Future, batch: Batch) -> list[Outcome]:
        """The outcomes of a batch that has ended one way or the other."""
        if future.status == "finished":
            with _asking():
                packed: Any = self._client.gather(future, direct=False)
            outcomes = _unpacked(packed)
            self._queue.finished(outcomes)
            return outcomes
        # A scheduler that cannot read data forgets the batches that need them.
        failed = next((one for one in (future, self._data[batch.data]) if one.status == "error"), None)
        if failed is None:
            raise _Lost
        with _asking():
            error: Any = failed.exception(timeout=_ANSWER_S)
        if isinstance(error, WrongCode):
            raise InputError(str(error)) from error
        if isinstance(error, KilledWorker):
            return self._queue.died(batch, "The workers that it ran on died; they may have run out of memory.")
        return self._queue.died(batch, f"The cluster could not run it: {_told(error)}.")


@contextmanager
def _asking() -> Iterator[None]:
    """Takes any error of the client for a lost scheduler: a client that is closed raises others than a connection."""
    try:
        yield
    except Exception as error:
        raise _Lost from error


def _told(error: BaseException) -> str:
    """An exception in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(".: ")


@dataclass(frozen=True)
class _Packed:
    """A pickled object. The scheduler does not unpickle it, so it needs neither the modules nor the files of users."""

    head: bytes
    buffers: list[Any]


def _packed(value: Any) -> _Packed:
    """The object, pickled without copying its arrays."""
    buffers: list[Any] = []
    head = pickle.dumps(value, buffer_callback=lambda buffer: buffers.append(np.asarray(buffer.raw())))
    return _Packed(head, buffers)


def _unpacked(packed: _Packed) -> Any:
    return pickle.loads(packed.head, buffers=packed.buffers)


def _work(packed: _Packed, data: Any, expected: dict[str, str]) -> _Packed:
    """The outcomes of a batch, on a worker."""
    try:
        _check(get_worker().address, expected, code())
    except InputError as error:
        raise WrongCode(str(error)) from error
    batch, work = _unpacked(packed)
    with one_core(), one_blas_thread():
        return _packed([attempt(task, work, data) for task in batch.tasks])
