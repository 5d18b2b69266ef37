"""Cross-check of the engines on the first data set, in a process beside this one where there is one."""

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from contextvars import ContextVar
from importlib import import_module

from ...models.threads import other_threads
from ..experiment.crosscheck import CrossCheck
from ..page.stages import StageClock
from ..tasks.beside import SideProcess, side_process

type Check = Callable[..., CrossCheck]
"""`crosscheck_model` with all arguments but `progress`, and no more than it needs, as they are sent to a process."""

STAGE = "Cross-checking engines"
_AHEAD: "ContextVar[tuple[SideProcess, Executor] | None]" = ContextVar("check_ahead", default=None)


@contextmanager
def checking_ahead() -> Iterator[None]:
    """Has `check_ahead` compare engines while the study in the block goes on, if this process can fork."""
    with side_process(_load) as process, other_threads(1) as thread:
        token = _AHEAD.set(None if process is None else (process, thread))
        try:
            yield
        except BaseException:
            if process is not None:
                process.kill()
            raise
        finally:
            _AHEAD.reset(token)


def _load() -> None:
    """Loads JAX and NumPyro, which takes longer than the first data set."""
    import_module("...inference.engines.enumeration", __package__)


def check_ahead(work: Check, episodes: int, clock: StageClock) -> Future[CrossCheck] | None:
    """Begins a comparison in the process beside this one; `None` where there is none.

    The result raises `NotDone` if the process is killed or fails.
    """
    ahead = _AHEAD.get()
    if ahead is None:
        return None
    process, thread = ahead
    return clock.beside(thread, STAGE, lambda advance: process.ask(_told, work, told=advance), episodes)


def check(work: Check, episodes: int, clock: StageClock) -> CrossCheck:
    """Makes a comparison."""
    with clock.stage(STAGE, episodes) as advance:
        return _told(work, advance)


def _told(work: Check, tell: Callable[[int], object]) -> CrossCheck:
    return work(progress=lambda: tell(1))
