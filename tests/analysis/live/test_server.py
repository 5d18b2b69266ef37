"""The server of the page: who is answered, and what viewers get."""

import socket
import threading
import time
from contextlib import closing

import pytest
from event_viewer import SOON_S, ask, viewer
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.analysis.live import server as server_module
from solidtouch.analysis.live.assets import PAGE_FILES
from solidtouch.analysis.live.feed import serve_saved
from solidtouch.analysis.live.server import EventLog, PageServer
from solidtouch.models.errors import InputError


@pytest.fixture
def server():
    made = PageServer()
    yield made
    made.close()
    assert not made._thread.is_alive()


@pytest.mark.parametrize("name", PAGE_FILES)
def test_files_of_the_page_are_served_under_the_token_alone(server, name):
    path = "" if name == "index.html" else name
    status, headers, content = ask(server.url, path)

    assert status == 200
    assert content == server_module.page_file(name)[0]
    assert headers["Content-Type"] == server_module.page_file(name)[1]
    for wrong in (f"/{path}", f"/wrong/{path}", f"/{path}x"):
        assert ask(server.url, wrong)[0] == 404


@pytest.mark.parametrize("path", ["", "events", "stop", "none"])
@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 404),
        ({"Host": "127.0.0.1.evil.example:80"}, 404),
        ({"Host": "evil.example:80@127.0.0.1"}, 400),
        ({"Host": "[::1"}, 404),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": "http://127.0.0.1:1"}, 403),
    ],
)
def test_other_hosts_and_origins_are_refused(path, method, headers, status):
    stopped = []
    made = PageServer(stop=lambda: stopped.append(1))
    try:
        answer = ask(made.url, path, method, **headers)
    finally:
        made.close()

    assert answer[0] == status
    assert stopped == []
    assert status == 400 or "default-src 'none'" in answer[1]["Content-Security-Policy"]


def test_every_answer_forbids_what_the_page_does_not_need(server):
    for path in ("", "player.js", "/wrong/"):
        headers = ask(server.url, path)[1]
        policy = dict(part.split(" ", 1) for part in headers["Content-Security-Policy"].split("; "))
        assert policy.pop("default-src") == "'none'"
        assert set(policy.values()) == {"'self'", "'none'"}
        assert (policy["script-src"], policy["form-action"], policy["frame-ancestors"]) == (
            "'self'",
            "'none'",
            "'none'",
        )
        assert headers["Cache-Control"] == "no-store"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert "Server" not in headers


def test_it_listens_on_this_machine_alone_and_by_a_long_token():
    """Another one has another token."""
    one, two = PageServer(), PageServer()
    try:
        assert one._socket.getsockname()[0] == "127.0.0.1"
        tokens = [each.url.split("/")[3] for each in (one, two)]
        assert min(map(len, tokens)) >= 24
        assert tokens[0] != tokens[1]
    finally:
        one.close()
        two.close()


def test_a_port_that_is_taken_is_named(server):
    port = int(server.url.split(":")[2].split("/")[0])
    with pytest.raises(InputError, match=f"Port {port} of the page: Address already in use"):
        PageServer(port)
    with pytest.raises(InputError, match="Port of the page must be at most 65535, got 70000"):
        PageServer(70000)


def test_the_program_is_stopped_by_a_post_with_the_token():
    stopped = threading.Event()
    made = PageServer(stop=stopped.set)
    try:
        own = made.url.removesuffix("/").rpartition("/")[0]
        assert ask(made.url, "stop")[0] == 405
        assert not stopped.is_set()
        assert ask(made.url, "stop", "POST", Origin=own)[0] == 202
        assert stopped.wait(SOON_S)
    finally:
        made.close()


def test_a_page_without_a_program_stops_none(server):
    assert ask(server.url, "stop", "POST")[0] == 405
    assert ask(server.url, "", "POST")[0] == 405


def publish(server, first, last):
    for number in range(first, last + 1):
        server.publish("tap", b"%d" % number)


def test_late_and_returning_viewers_get_all_events_once(server):
    """In their order, as they come."""
    publish(server, 1, 3)
    with viewer(server.url) as first:
        assert [number for number, _, _ in first(3)] == [1, 2, 3]
        publish(server, 4, 5)
        assert first(2) == [(4, "tap", 4), (5, "tap", 5)]
        with viewer(server.url, last=4) as back, viewer(server.url) as late:
            assert back(1) == [(5, "tap", 5)]
            assert [number for number, _, _ in late(5)] == [1, 2, 3, 4, 5]
            server.publish_last(b'"done"')
            for read in (first, back, late):
                assert read(1) == [(6, "finished", "done")]
    assert server.wait_until_served(0.0)


def test_who_knows_later_events_than_there_are_gets_the_next(server):
    """As after a program that ran under the same address."""
    publish(server, 1, 1)
    with viewer(server.url, last=99) as read:
        publish(server, 2, 2)
        assert read(1) == [(2, "tap", 2)]


@pytest.mark.parametrize("last", ["-1", "x", "1.5", "9" * 30, "\u0663".encode().decode("latin1")])
def test_a_number_that_is_none_is_refused(server, last):
    assert ask(server.url, "events", Last_Event_ID=last)[0] == 400


def test_events_come_at_once(server):
    with viewer(server.url) as read:
        server.publish("tap", b"0")
        read(1)
        waits = []
        for _ in range(20):
            began = time.monotonic()
            server.publish("tap", b"1")
            read(1)
            waits.append(time.monotonic() - began)
    assert sorted(waits)[10] < 0.02


def test_a_viewer_that_reads_nothing_holds_nobody_up(server, monkeypatch):
    """It is dropped; memory holds each event once."""
    monkeypatch.setattr(server_module, "_STUCK_S", 0.3)
    large = b'"%s"' % (b"x" * 200_000)
    place, _, token = server.url.removeprefix("http://").partition("/")
    host, _, port = place.partition(":")
    with closing(socket.create_connection((host, int(port)))) as dead, viewer(server.url) as alive:
        dead.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        dead.sendall(f"GET /{token}events HTTP/1.1\r\nHost: {place}\r\n\r\n".encode())
        slowest = 0.0
        for _ in range(60):
            began = time.monotonic()
            server.publish("tap", large)
            slowest = max(slowest, time.monotonic() - began)
            alive(1)
        deadline = time.monotonic() + SOON_S
        while len(server._positions) > 1 and time.monotonic() < deadline:
            time.sleep(0.02)

        assert slowest < 0.2
        assert len(server._positions) == 1
        server.publish("tap", b"0")
        assert alive(1) == [(61, "tap", 0)]


def test_nobody_is_waited_for_who_does_not_come(server):
    server.publish_last(b"0")
    began = time.monotonic()

    assert not server.wait_until_served(0.1)
    assert time.monotonic() - began < 1


def test_a_server_can_be_closed_while_viewers_wait_and_twice():
    made = PageServer()
    with viewer(made.url) as read:
        made.publish("tap", b"1")
        read(1)
        made.close()
        made.close()
        assert not made._thread.is_alive()


def test_saved_episodes_are_served_whole(episodes):
    made = serve_saved(episodes)
    try:
        with viewer(made.url) as read:
            (_, start, data), *taps, _, _, (_, finished, last) = read(1 + 10 + 2 + 1)
    finally:
        made.close()

    assert (start, finished, data["saved"], data["stoppable"], last["saved"]) == (
        "start",
        "finished",
        True,
        False,
        True,
    )
    assert [tap["tap"] for _, _, tap in taps] == [1, 2, 3, 4, 5] * 2


@given(st.lists(st.integers(0, 60), max_size=40), st.integers(50, 900), st.lists(st.integers(0, 45), max_size=10))
def test_what_is_kept_is_read_from_any_position(sizes, limit, positions):
    """The header and the newest events, in order and without a gap; never many more bytes than allowed."""
    log = EventLog(limit)
    for size in sizes:
        log.append("tap", b"x" * size)

    assert len(log) == len(sizes)
    for position in (0, *positions):
        numbers, at = [], min(position, len(log))
        while True:
            data, after = log.after(at)
            if not data:
                break
            numbers += [int(part.split(b"\n")[0][4:]) for part in data.split(b"\n\n")[:-1]]
            assert after == numbers[-1]
            at = after
        newest = numbers[1:] if numbers[:1] == [1] else numbers
        assert newest == list(range(newest[0], len(sizes) + 1)) if newest else position >= len(log) or len(sizes) < 2
        assert numbers[:1] == [1] or position > 0 or not sizes
        if position and numbers:
            assert numbers[0] > min(position, len(log)) or numbers[0] == 1
    assert log._bytes <= max(limit, sum(sorted(map(len, log._events))[-3:]))
