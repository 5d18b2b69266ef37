"""Episodes on their way to a page and a file, each record encoded once for both."""

import json
import os
import sys
import threading
import webbrowser
from collections.abc import Callable
from typing import TYPE_CHECKING

from .ending import Ending
from .saved import (
    EndRecord,
    EpisodeHeader,
    Episodes,
    TapRecord,
    encoded,
    encoded_file,
    ending_record,
    tap_record,
)
from .view import Seen

if TYPE_CHECKING:
    from .server import PageServer  # loads tornado, which only a page needs


class EpisodeFeed:
    """Takes episodes tap by tap.

    Args:
        server: Where a page follows them, or `None`.
        keep: Whether to keep them for a file.
    """

    def __init__(self, server: "PageServer | None", keep: bool) -> None:
        self._server, self._keep = server, keep
        self._header = b""
        self._taps: list[bytes] = []
        self._ends: list[bytes] = []

    def start(self, header: EpisodeHeader) -> None:
        """Takes what holds for all taps."""
        self._header = encoded(header)
        if self._server is not None:
            self._server.publish("start", start_data(self._header, stoppable=self._server.stop is not None))

    def tap(self, episode: int, seen: Seen) -> None:
        """Takes a tap; `episode` counts from 1."""
        self._pass_on("tap", lambda: tap_record(episode, seen), self._taps)

    def end(self, episode: int, ending: Ending) -> None:
        """Takes the end of an episode."""
        self._pass_on("end", lambda: ending_record(episode, ending), self._ends)

    @property
    def has_taps(self) -> bool:
        """Whether there is something to write."""
        return bool(self._taps)

    @property
    def content(self) -> bytes:
        """The file of all episodes so far."""
        return encoded_file(self._header, self._taps, self._ends)

    def _pass_on(self, kind: str, made: Callable[[], TapRecord | EndRecord], kept: list[bytes]) -> None:
        if self._server is None and not self._keep:
            return  # nobody watches, and a large belief takes milliseconds
        data = encoded(made())
        if self._server is not None:
            self._server.publish(kind, data)
        if self._keep:
            kept.append(data)


def page_server(port: int = 0, stop: Callable[[], object] | None = None) -> "PageServer":
    """A `server.PageServer`.

    Raises:
        InputError: As there.
    """
    from .server import PageServer  # noqa: PLC0415

    return PageServer(port, stop)


def start_data(header: bytes, *, stoppable: bool = False, saved: bool = False) -> bytes:
    """Data of the first event of a page; a saved episode is played from its first tap."""
    return b'{"header":%s,"stoppable":%s,"saved":%s}' % (header, *(json.dumps(x).encode() for x in (stoppable, saved)))


def finish_data(text: str, *, saved: bool = False) -> bytes:
    """Data of the last event."""
    return json.dumps({"text": text, "saved": saved}).encode()


def serve_saved(episodes: Episodes, port: int = 0) -> "PageServer":
    """Server of a page with recorded episodes.

    Raises:
        InputError: As `PageServer`.
    """
    server = page_server(port)
    server.publish("start", start_data(encoded(episodes.header), saved=True))
    for kind, records in (("tap", episodes.taps), ("end", episodes.ends)):
        for one in records:
            server.publish(kind, encoded(one))
    server.publish_last(finish_data("saved episodes", saved=True))
    return server


def open_page(url: str) -> bool:
    """Opens a page in the browser, without waiting for it; returns whether there are a display and a browser."""
    if sys.platform not in ("win32", "darwin") and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
        return False
    try:
        webbrowser.get()
    except webbrowser.Error:
        return False
    threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()
    return True
