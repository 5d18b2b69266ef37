"""Server of the live page: one program, one page, any number of viewers on this machine.

It listens on the loopback interface only, under an address with a random token. Each record is encoded once and kept;
a viewer is a position in what is kept, so that a reload, a second tab and a reconnection read the same records without
a gap, and a slow viewer lags without holding up the program.
"""

import asyncio
import re
import secrets
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler

from ...models.errors import InputError, check_count
from ...models.storage import reason
from .assets import PAGE_FILES, page_file

HOST = "127.0.0.1"
_HOSTS = re.compile(r"(127\.0\.0\.1|localhost)(:\d+)?")
_KEPT_BYTES = 1 << 28
_CHUNK_BYTES = 1 << 18
_HEARTBEAT_S = 15.0
_STUCK_S = 10.0  # after which a viewer that reads nothing is dropped; it reconnects by itself
_LOOK_S = 0.02
_LAST_PORT = 65535
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class _Kept(NamedTuple):
    """Consecutive events for a viewer.

    Attributes:
        data: The events as they are sent.
        position: Number of the last one.
    """

    data: bytes
    position: int


class EventLog:
    """Events as they are sent, numbered from 1; beyond a quarter GiB the oldest but the first are dropped.

    Events are appended by one thread and read by the server's.
    """

    def __init__(self, limit: int = _KEPT_BYTES) -> None:
        self._lock = threading.Lock()
        self._events: list[bytes] = []
        self._dropped, self._bytes, self._limit = 0, 0, limit

    def __len__(self) -> int:
        return self._dropped + len(self._events)

    def append(self, kind: str, data: bytes) -> None:
        """Adds an event; the data are one line."""
        with self._lock:
            event = b"id: %d\nevent: %s\ndata: %s\n\n" % (len(self) + 1, kind.encode(), data)
            self._events.append(event)
            self._bytes += len(event)
            surplus = 0
            while self._bytes > self._limit and surplus < len(self._events) - 2:
                surplus += 1
                self._bytes -= len(self._events[surplus])
            del self._events[1 : 1 + surplus]  # the first is the header
            self._dropped += surplus

    def after(self, position: int) -> _Kept:
        """The next events after the one with this number, as many as make a chunk; none at the end."""
        with self._lock:
            first = position - self._dropped if position else 0
            taken, size = max(first, min(position, 1)), 0
            start = taken
            while taken < len(self._events) and size < _CHUNK_BYTES:
                size += len(self._events[taken])
                taken += 1
            end = taken + self._dropped if taken > 1 else taken
            return _Kept(b"".join(self._events[start:taken]), max(position, end))


class PageServer:
    """Serves the page and its events until it is closed, in a thread of its own.

    Args:
        port: Port to listen on; 0 takes a free one.
        stop: Called, in the server's thread, when a viewer asks to stop the program; `None` refuses.

    Attributes:
        url: Address of the page.

    Raises:
        InputError: The port is taken or not allowed.
    """

    def __init__(self, port: int = 0, stop: Callable[[], object] | None = None) -> None:
        if check_count(port, "Port of the page", 0) > _LAST_PORT:
            raise InputError(f"Port of the page must be at most {_LAST_PORT}, got {port}.")
        try:
            self._socket = socket.create_server((HOST, port))
        except OSError as error:
            raise InputError(f"Port {port} of the page: {reason(error)}.") from None
        self._socket.setblocking(False)
        token = secrets.token_urlsafe(18)
        self.url = f"http://{HOST}:{self._socket.getsockname()[1]}/{token}/"
        self.events, self.stop = EventLog(), stop
        self._positions: dict[object, int] = {}  # of the viewers
        self._served, self._ended = 0, False
        self._loop = asyncio.new_event_loop()
        self._changed, self._closing = asyncio.Event(), asyncio.Event()
        self._application = Application(
            [(f"/{token}/events", _Events, {"server": self}), (f"/{token}/stop", _Stop, {"server": self})]
            + [(f"/{token}/{'' if name == 'index.html' else name}", _File, {"name": name}) for name in PAGE_FILES],
            default_handler_class=_Nothing,
            log_function=lambda _: None,
        )
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()

    def publish(self, kind: str, data: bytes) -> None:
        """Sends an event to all viewers, at once and without waiting for any; the data are one line of JSON."""
        self.events.append(kind, data)
        self._wake()

    def publish_last(self, data: bytes) -> None:
        """Sends the event `finished`, after which viewers need no connection."""
        self.publish("finished", data)
        self._ended = True
        self._wake()

    def wait_until_served(self, first_s: float, last_s: float = 10.0) -> bool:
        """Waits, after the last event, until all viewers have everything; returns whether there was one.

        Args:
            first_s: How long to wait for the first viewer.
            last_s: How long to wait, once there is one, until all have everything.
        """
        began = time.monotonic()
        while not self.seen and time.monotonic() < began + first_s:
            time.sleep(_LOOK_S)
        began = time.monotonic()
        while self._positions and time.monotonic() < began + last_s:
            time.sleep(_LOOK_S)
        return self.seen

    def wait(self) -> None:
        """Waits until another thread closes the server, or for an interrupt."""
        while self._thread.is_alive():
            self._thread.join(1.0)

    def close(self) -> None:
        """Ends all connections and the thread."""
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._closing.set)
        self._thread.join(_STUCK_S)

    @property
    def seen(self) -> bool:
        """Whether a viewer is connected, or one has had all events."""
        return bool(self._positions or self._served)

    def _wake(self) -> None:
        self._loop.call_soon_threadsafe(self._changed.set)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
            self._loop.run_until_complete(self._loop.shutdown_asyncgens())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        server = HTTPServer(self._application, max_body_size=1024, max_header_size=16384, idle_connection_timeout=60)
        server.add_socket(self._socket)
        await self._closing.wait()
        server.stop()
        self._changed.set()
        await asyncio.sleep(0)
        await server.close_all_connections()
        others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def follow(self, viewer: "_Events", position: int) -> None:
        """Sends a viewer all events after one, and new ones, until the last or until it is gone."""
        self._positions[viewer] = position
        try:
            await asyncio.wait_for(viewer.flush(), _STUCK_S)
            while not self._closing.is_set():
                ended = self._ended
                data, position = self.events.after(position)
                self._positions[viewer] = position
                if data:
                    viewer.write(data)
                    await asyncio.wait_for(viewer.flush(), _STUCK_S)
                elif ended:
                    self._served += 1
                    return
                else:
                    await self._news(viewer, position)
        except (StreamClosedError, TimeoutError):
            viewer.drop()
        finally:
            self._positions.pop(viewer, None)

    async def _news(self, viewer: "_Events", position: int) -> None:
        """Waits for an event after one; tells the viewer now and then that the program is there."""
        self._changed.clear()
        if len(self.events) > position or self._ended:
            return
        try:
            await asyncio.wait_for(self._changed.wait(), _HEARTBEAT_S)
        except TimeoutError:
            viewer.write(b": still here\n\n")
            await asyncio.wait_for(viewer.flush(), _STUCK_S)


class _Guarded(RequestHandler):
    """Refuses requests that name another host or come from another page."""

    def initialize(self, server: PageServer | None = None, name: str = "") -> None:
        """Takes what the route gives."""
        self.server, self.name = server, name

    def set_default_headers(self) -> None:
        """Headers of every answer."""
        self.clear_header("Server")
        for name, value in _HEADERS.items():
            self.set_header(name, value)

    def prepare(self) -> None:
        """Checks host and origin: a page elsewhere may resolve its own name to this machine, or send forms to it."""
        if not _HOSTS.fullmatch(self.request.host):
            raise HTTPError(404)
        origin = self.request.headers.get("Origin")
        if origin is not None and origin != f"http://{self.request.host}":
            raise HTTPError(403)

    def write_error(self, status_code: int, **_: Any) -> None:
        """One line of text."""
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{status_code} {self._reason}\n")

    def log_exception(self, typ: Any, value: Any, tb: Any) -> None:
        """Reports errors of this program, and no refused requests."""
        if not isinstance(value, HTTPError):
            super().log_exception(typ, value, tb)


class _Nothing(_Guarded):
    def prepare(self) -> None:
        """Refuses all."""
        super().prepare()
        raise HTTPError(404)


class _File(_Guarded):
    def get(self) -> None:
        """Sends a file of the page."""
        content, kind = page_file(self.name)
        self.set_header("Content-Type", kind)
        self.finish(content)

    def head(self) -> None:
        """Sends its headers."""
        self.get()


class _Stop(_Guarded):
    def post(self) -> None:
        """Stops the program, in the way that Ctrl-C does."""
        if self.server is None or self.server.stop is None:
            raise HTTPError(405)
        self.set_status(202)
        self.finish()
        self.server.stop()


class _Events(_Guarded):
    async def get(self) -> None:
        """Sends all events after the last one that the viewer has, and new ones as they come."""
        last = self.request.headers.get("Last-Event-ID", "0")
        if self.server is None or not (last.isascii() and last.isdigit() and len(last) < 16):
            raise HTTPError(400)
        self.set_header("Content-Type", "text/event-stream; charset=utf-8")
        self.write(b"retry: 500\n\n")
        await self.server.follow(self, min(int(last), len(self.server.events)))

    def drop(self) -> None:
        """Closes the connection of a viewer that reads nothing."""
        self.request.connection.close()  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
