"""Figures of a report, drawn while its study goes on: by a process of their own, or on threads, one at a time."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from importlib import import_module
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

from ...models.threads import other_threads
from ..tasks.beside import NotDone, SideProcess, side_process
from . import drawing_process

if TYPE_CHECKING:
    from .figure_style import Drawing

type _Drawings = dict[tuple[Any, ...], tuple[Any, Drawing | None]]

_WAITING = 16  # of those that wait for what they draw, so that others are drawn meanwhile


class Later(NamedTuple):
    """A function of a module that is loaded when the function is called; equal to others of that name."""

    module: str
    name: str

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Calls the function."""
        return getattr(import_module(self.module), self.name)(*args, **kwargs)


class _LaterModule:
    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Later:
        return Later(self._name, name)


def later(package: str, *names: str) -> tuple[Any, ...]:
    """Modules of a package, each of whose functions is a `Later`."""
    return tuple(_LaterModule(f"{package}.{name}") for name in names)


class _Ahead:
    """What is drawn, and by whom."""

    def __init__(self, threads: Executor, process: SideProcess | None) -> None:
        self.drawings: _Drawings = {}
        self.begun: list[Future[None]] = []
        self._taken: set[tuple[Any, ...]] = set()
        self._take, self._turn = Lock(), Lock()
        self._threads, self._process, self._wanted = threads, process, True
        self.beside = process is not None  # whether no thread has drawn

    def begin(self, draws: Iterable[Callable[[], Any]]) -> None:
        self.begun.append(self._threads.submit(self._draw, draws))

    def stop(self) -> None:
        """Draws no further figure."""
        self._wanted = False
        if self._process is not None:
            self._process.kill()

    def _draw(self, draws: Iterable[Callable[[], Any]]) -> None:
        for draw in draws:
            key = key_of(draw)
            with self._take:
                first = key not in self._taken
                self._taken.add(key)
            if first:
                with suppress(Exception):  # drawn again for the page, which says why it fails
                    self.drawings[key] = draw, self._drawing(draw)

    def _drawing(self, draw: Callable[[], Any]) -> "Drawing | None":
        from .figure_style import Drawing, drawn  # noqa: PLC0415 - loads NumPy

        process = self._process
        if process is not None:
            try:
                found = process.ask(drawing_process.draw, draw)
            except NotDone:
                if not self._wanted:
                    raise CancelledError from None
            else:
                if found is None:
                    return None
                number, svg, inches, curves = found
                return Drawing(svg, inches, partial(_pixels, process, number, draw), curves)
        self.beside = False
        with self._turn:
            return drawn(draw)


def _pixels(process: SideProcess, number: int, draw: Callable[[], Any]) -> bytes:
    from .figure_style import drawing_of  # noqa: PLC0415

    try:
        return process.ask(drawing_process.png, number)
    except NotDone:
        return drawing_of(draw()).png()


_AHEAD: ContextVar[_Ahead | None] = ContextVar("ahead", default=None)


@contextmanager
def drawing_ahead() -> Iterator[None]:
    """Has `draw_ahead` draw figures of the report that is made and saved in the block.

    A process of their own draws them where this one has no threads yet.
    """
    with side_process(drawing_process.load) as process, other_threads(_WAITING) as threads:
        ahead = _Ahead(threads, process)
        token = _AHEAD.set(ahead)
        try:
            yield
        except BaseException:
            ahead.stop()
            raise
        finally:
            _AHEAD.reset(token)


def draw_ahead(draws: Iterable[Callable[[], Any]]) -> None:
    """Draws figures of a page while the study goes on, if it runs in `drawing_ahead`.

    Args:
        draws: As in `Picture.draw`, with the same arguments, one after the other; taken on a thread of their own, so
            they may wait for them.
    """
    ahead = _AHEAD.get()
    if ahead is not None:
        ahead.begin(draws)


def drawn_ahead(draw: Callable[[], Any]) -> "tuple[Any, Drawing | None] | None":
    """What `draw_ahead` drew by a function, with the function; `None` if it draws nothing by it.

    As matplotlib draws on one thread at a time, nothing else may be drawn before this is `None`; until then, and where
    a thread draws, all of it is waited for.
    """
    ahead = _AHEAD.get()
    if ahead is None:
        return None
    key = key_of(draw)
    if key not in ahead.drawings or not ahead.beside:
        for begun in ahead.begun:
            begun.result()
    return ahead.drawings.get(key)


def key_of(draw: Callable[[], Any]) -> tuple[Any, ...]:
    """A function with its arguments, which need not be hashable."""
    if not isinstance(draw, partial):
        return (draw,)
    return draw.func, *map(_key, draw.args), *((name, _key(value)) for name, value in draw.keywords.items())


def _key(value: Any) -> Any:
    if isinstance(value, partial):
        return key_of(value)
    return value if isinstance(value, str | float) else id(value)
