"""A viewer of the live page, and what it may ask, without a browser."""

import asyncio
import http.client
import json
import sys
import time
from contextlib import closing, contextmanager

SOON_S = 5.0


def ask(url, path="", method="GET", **headers):
    """Status, headers and content of an answer; underscores in names of headers are hyphens."""
    place, _, token = url.removeprefix("http://").partition("/")
    path = path if path.startswith("/") else f"/{token}{path}"
    with closing(http.client.HTTPConnection(place, timeout=SOON_S)) as connection:
        connection.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()


@contextmanager
def viewer(url, last=None):
    """A function that returns the next events of a viewer, as id, kind and data."""
    place, _, token = url.removeprefix("http://").partition("/")
    with closing(http.client.HTTPConnection(place, timeout=SOON_S)) as connection:
        connection.request("GET", f"/{token}events", headers={} if last is None else {"Last-Event-ID": str(last)})
        answer = connection.getresponse()
        assert answer.getheader("Content-Type") == "text/event-stream; charset=utf-8"

        def read(number):
            events = []
            while len(events) < number:
                fields = {}
                while (line := answer.readline().decode().rstrip("\n")) != "":
                    name, _, value = line.partition(": ")
                    fields[name] = value
                if "id" in fields:
                    events.append((int(fields["id"]), fields["event"], json.loads(fields["data"])))
                elif not fields and not line:
                    assert not answer.isclosed(), f"the stream ended after {events}"
            return events

        yield read


async def _follow(url: str) -> list[tuple[int, float]]:
    """Number and time of arrival of all events of one viewer."""
    place, _, token = url.removeprefix("http://").partition("/")
    host, _, port = place.partition(":")
    reader, writer = await asyncio.open_connection(host, int(port), limit=1 << 24)
    writer.write(f"GET /{token}events HTTP/1.1\r\nHost: {place}\r\n\r\n".encode())
    arrived = []
    while not (line := await reader.readline()).startswith(b"event: finished"):
        assert line, "the stream ended"
        if line.startswith(b"id: "):
            arrived.append((int(line[4:]), time.time()))
    writer.close()
    return arrived


async def _follow_all(url: str, viewers: int) -> list[list[tuple[int, float]]]:
    return await asyncio.gather(*(_follow(url) for _ in range(viewers)))


if __name__ == "__main__":
    sys.stdout.write(json.dumps(asyncio.run(_follow_all(sys.argv[1], int(sys.argv[2])))))
