"""Stages of long work with progress bars and durations, and timed checks."""

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

from ...models.progress import Progress
from ...models.threads import one_core


class Check(NamedTuple):
    """A check of `validate`, one line of its table."""

    name: str
    against: str
    found: str
    passed: bool
    seconds: float


@dataclass
class StageClock:
    """Stages with their progress bars and seconds."""

    progress: Progress
    elapsed_s: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, total: int = 1) -> Iterator[Callable[[int], None]]:
        """Times one stage; gives the function that advances its bar, which is full when the stage has ended."""
        with self._timed(name, total, self._begun(name, total)) as advance:
            yield advance

    def beside[T](
        self, threads: Executor, name: str, work: Callable[[Callable[[int], None]], T], total: int = 1
    ) -> Future[T]:
        """Does the work of a stage on another thread and one core; it is given the function that advances its bar."""
        told = self._begun(name, total)

        def timed() -> T:
            with one_core(), self._timed(name, total, told) as advance:
                return work(advance)

        return threads.submit(timed)

    def _begun(self, name: str, total: int) -> Callable[[int], None]:
        """The function that advances the bar of a stage, whose time is listed behind those begun before."""
        self.elapsed_s[name] = 0.0
        return self.progress(name, total)

    @contextmanager
    def _timed(self, name: str, total: int, told: Callable[[int], None]) -> Iterator[Callable[[int], None]]:
        began, left = time.perf_counter(), total

        def advance(done: int) -> None:
            nonlocal left
            left -= done
            told(done)

        yield advance
        if left > 0:
            told(left)
        self.elapsed_s[name] = round(time.perf_counter() - began, 2)


def timed_check(name: str, against: str, work: Callable[[], tuple[str, bool]]) -> Check:
    """Does the work of a check, which gives what it found and whether that is as it must be."""
    began = time.monotonic()
    found, passed = work()
    return Check(name, against, found, passed, time.monotonic() - began)


def counted[T](results: Iterable[T], advance: Callable[[int], object]) -> Iterator[T]:
    """The same results, each counted when it comes."""
    for result in results:
        advance(1)
        yield result
