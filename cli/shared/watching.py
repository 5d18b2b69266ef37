"""`--view` and `--save-episode`: episodes of a live command on a page and in a file."""

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ...models.errors import InputError
from .interrupt import ended_by_interrupt

if TYPE_CHECKING:
    from ...analysis.live.ending import Ending
    from ...analysis.live.feed import EpisodeFeed
    from ...analysis.live.saved import EpisodeHeader
    from ...analysis.live.server import PageServer
    from ...analysis.live.view import Seen
    from .showing import Show

_BROWSER_S, _PROGRAM_S = 20.0, 5.0  # for a browser that was opened to come, and for a program that reads the address
_STOPPED_S = 2.0


class Watching(NamedTuple):
    """What is to be watched.

    Attributes:
        view: Whether there is a page.
        port: Its port; 0 takes a free one.
        browser: Whether to open it.
        file: File of the episodes, or `None`.
        force: Whether an existing file may be replaced.
    """

    view: bool
    port: int
    browser: bool
    file: Path | None
    force: bool

    @classmethod
    def checked(cls, view: bool, port: int | None, no_browser: bool, file: Path | None, force: bool) -> "Watching":
        """From options.

        Raises:
            InputError: An option requires another, or the file cannot be written.
        """
        from ...analysis.live.saved import check_episode_file
        from ...models.storage import check_writable

        for option, given in (("--view-port", port is not None), ("--no-browser", no_browser)):
            if given and not view:
                raise InputError(f"{option} requires --view.")
        if file is not None:
            check_episode_file(file)
            check_writable(file, force)
        if view:
            from ...analysis.live import server  # noqa: F401 - nothing may be imported while a finger is on its way
        return cls(view, port or 0, not no_browser, file, force)


class WatchedShow:
    """Shows taps and decisions as another one does, on a page and for a file as well."""

    def __init__(self, shown: "Show", feed: "EpisodeFeed") -> None:
        self._shown, self._feed, self._episode = shown, feed, 1

    def start(self, header: "EpisodeHeader") -> None:
        """Takes what holds for all taps."""
        self._feed.start(header)

    def note(self, text: str) -> None:
        """Shows a remark."""
        self._shown.note(text)

    def tap(self, seen: "Seen") -> None:
        """Shows a tap, the page first: a terminal is slower."""
        self._feed.tap(self._episode, seen)
        self._shown.tap(seen)

    def end(self, episode: int, ending: "Ending") -> None:
        """Shows the end of an episode."""
        self._feed.end(episode, ending)
        self._shown.end(episode, ending)
        self._episode = episode + 1


@contextmanager
def watching(shown: "Show", wish: Watching) -> Iterator[WatchedShow]:
    """The same show, watched as wished; the page is served when the block has ended.

    The file is written however it ends: an episode that is interrupted keeps its taps.

    Raises:
        InputError: The port is taken, or the file cannot be written.
    """
    from ...analysis.live.feed import EpisodeFeed, finish_data, open_page, page_server

    if not wish.view:
        with _kept(shown, EpisodeFeed(None, keep=wish.file is not None), wish) as watched:
            yield watched
        return

    server = page_server(wish.port, stop_program)
    try:
        feed = EpisodeFeed(server, keep=wish.file is not None)
        shown.note(f"Page: {server.url}")
        opened = wish.browser and open_page(server.url)
        try:
            with _kept(shown, feed, wish) as watched:
                yield watched
        except BaseException as error:
            stopped = isinstance(error, KeyboardInterrupt | SystemExit)
            server.publish_last(finish_data("the program was stopped" if stopped else f"the program failed: {error}"))
            server.wait_until_served(0.0, _STOPPED_S)
            raise
        server.publish_last(finish_data("the program has ended; this page keeps what it has"))
        served_out(server, shown, opened)
    finally:
        server.close()


def served_out(server: "PageServer", shown: "Show", opened: bool) -> None:
    """Waits until a viewer has everything: in a terminal for any time, else a few seconds for the first one."""
    terminal = sys.stdout.isatty()
    if terminal and not server.seen:
        shown.note("Waiting for a browser to open the page; Ctrl-C ends.")
    with ended_by_interrupt():
        server.wait_until_served(float("inf") if terminal else _BROWSER_S if opened else _PROGRAM_S)


def stop_program() -> None:
    """Interrupts the program as Ctrl-C does, from another thread."""
    main = threading.main_thread().ident
    if main is not None and hasattr(signal, "pthread_kill"):  # which also ends what the thread waits for
        signal.pthread_kill(main, signal.SIGINT)
    else:
        _thread.interrupt_main()


@contextmanager
def _kept(shown: "Show", feed: "EpisodeFeed", wish: Watching) -> "Iterator[WatchedShow]":
    from ...analysis.live.saved import save_episodes

    try:
        yield WatchedShow(shown, feed)
    finally:
        if wish.file is not None and feed.has_taps:
            save_episodes(feed.content, wish.file, wish.force)
            shown.note(f"Episodes: {wish.file}; `solidtouch view` plays them.")
