"""Results of the tasks of a study, in order, from threads of this process or a Dask cluster."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from functools import partial
from typing import Any, NamedTuple, Protocol

from ...models.errors import InputError
from ...models.extras import extra
from ...models.threads import cores, in_order
from .task import Runner

PATIENCE_S = 300.0
"""Time in seconds to wait for a lost scheduler or lost workers."""


class Crew(Protocol):
    """Whatever gives the results of tasks."""

    def __call__[I, S, T](
        self,
        work: Callable[[I, S], T],
        items: Iterable[I],
        shared: S,
        advance: Callable[[int], object] = lambda done: None,  # noqa: ARG005
    ) -> Iterator[T]:
        """Results in the order of the items; on a cluster they equal those of this process.

        Args:
            work: Gives the result of an item; a function of a module, which changes nothing.
            items: One for each task.
            shared: What all tasks need.
            advance: Called with 1 after each task.

        Raises:
            InputError: As `work`, or there is no cluster, or a task kills the workers that it runs on.
        """
        ...


def crew_of(scheduler: str | None, workers: int | None, patience_s: float = PATIENCE_S) -> Crew:
    """Threads of this process, or the cluster with a scheduler.

    Args:
        scheduler: Address of a Dask scheduler, or `None`.
        workers: Number of threads; `None` for one per core.
        patience_s: Time in seconds to wait for a lost scheduler or lost workers.

    Raises:
        InputError: Both are given, or distributed is not installed.
    """
    if scheduler is None:
        return on_threads(workers)
    return on_runner(cluster(scheduler, workers, patience_s, partial(print, file=sys.stderr)))


def cluster(scheduler: str, workers: int | None, patience_s: float, note: Callable[[str], object]) -> Runner:
    """A runner on the cluster with a scheduler, see `dask.on_cluster`.

    Raises:
        InputError: A number of workers is given as well, or distributed is not installed.
    """
    if workers is not None:
        raise InputError("--workers cannot be combined with --scheduler; the cluster has its own workers.")
    with extra("distributed"):
        from .dask import on_cluster  # noqa: PLC0415 - Dask takes long to import
    return on_cluster(scheduler, patience_s, note)


def on_threads(
    workers: int | None = None,
    alone: Callable[[Any], bool] = lambda item: False,  # noqa: ARG005
    ahead: int | None = None,
) -> Crew:
    """Tasks on threads of this process, or one after the other.

    Args:
        workers: Number of threads, by default one per core.
        alone: Items whose tasks must run in the thread that takes the results.
        ahead: See `in_order`.
    """

    def results(
        work: Callable[[Any, Any], Any],
        items: Iterable[Any],
        shared: Any,
        advance: Callable[[int], object] = lambda done: None,  # noqa: ARG005
    ) -> Iterator[Any]:
        tasks = (partial(work, item, shared) for item in items)
        for result in in_order(tasks, cores(workers), lambda task: alone(task.args[0]), ahead):
            advance(1)
            yield result

    return results


THREADS, ONE_BY_ONE = on_threads(), on_threads(1)


def on_runner(run: Runner) -> Crew:
    """Tasks on a runner, whose data are what they share."""

    def results(
        work: Callable[[Any, Any], Any],
        items: Iterable[Any],
        shared: Any,
        advance: Callable[[int], object] = lambda done: None,  # noqa: ARG005
    ) -> Iterator[Any]:
        tasks = (_Item(number, item) for number, item in enumerate(items))
        early: dict[int, Any] = {}
        wanted = 0
        with closing(run(tasks, partial(_result, work), lambda _: shared)) as outcomes:
            for number, values, _, failure in outcomes:
                if failure:
                    raise RuntimeError(failure) if "\n" in failure else InputError(failure)
                result, refusal = values
                if refusal is not None:
                    raise refusal
                advance(1)
                early[number] = result
                while wanted in early:
                    yield early.pop(wanted)
                    wanted += 1

    return results


def check_crew(crew: Crew) -> None:
    """Checks that a cluster answers, where its tasks come late.

    Raises:
        InputError: There is none.
    """
    list(crew(_nothing, [None], None))


def _nothing(item: None, shared: None) -> None:
    """A task that shows that there is somebody to do it."""


class _Item(NamedTuple):
    """A task whose data all share."""

    number: int
    item: Any
    data: str = "shared"


def _result(work: Callable[[Any, Any], Any], task: _Item, shared: Any) -> tuple[Any, InputError | None]:
    """The result of an item, or why it is refused."""
    try:
        return work(task.item, shared), None
    except InputError as error:
        return None, error
