"""The bench behind a socket: the same answers as in the same process, for one client after another."""

import json
import socket
import threading

import pytest
from solidtouch.hardware.emulator.service import Service
from solidtouch.hardware.emulator.shared_clock import SharedClock, SocketConnection
from solidtouch.hardware.errors import PortBusy, PortError, PortLost
from solidtouch.models.errors import InputError


class Running:
    """A service in a thread."""

    def __init__(self, emulation, path, real_time=False):
        self.service = Service(emulation, path, real_time)
        self.stopping = threading.Event()
        self.thread = threading.Thread(target=self.service.run, args=(self.stopping.is_set,))
        self.thread.start()

    def stop(self):
        self.stopping.set()
        self.thread.join()
        self.service.close()


@pytest.fixture
def path(tmp_path):
    return tmp_path / "control"


@pytest.fixture
def running(small_bench, path):
    running = Running(small_bench.emulation, path)
    yield running
    running.stop()


@pytest.fixture
def connection(running, path):
    with SocketConnection(path) as connection:
        yield connection


def ask(path, *lines):
    """The answers to raw lines."""
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))
        client.sendall(b"".join(line + b"\n" for line in lines))
        client.shutdown(socket.SHUT_WR)
        answers = b""
        while data := client.recv(4096):
            answers += data
    return [json.loads(line) for line in answers.splitlines()]


def test_bytes_and_time_are_the_same_as_in_one_process(small_bench, connection):
    small_bench.clock = SharedClock(connection)
    small_bench.stage.open()
    small_bench.stage.write(b"hello")

    assert small_bench.collect(small_bench.stage, 1.0) == [(0.01, b"hello")]
    assert small_bench.clock.now() == 1.0


def test_time_goes_on_where_the_last_client_left_it(small_bench, path, connection):
    SharedClock(connection).wait([], 2.5)
    connection.close()
    with SocketConnection(path) as next_one:
        assert SharedClock(next_one).now() == 2.5


def test_one_program_lets_time_go_on_until_it_goes_away(path, connection):
    """A second one would make the devices of the first look silent; it is told so and nothing happens."""
    SharedClock(connection).wait([], 1.0)
    with SocketConnection(path) as second:
        with pytest.raises(PortBusy, match="control: another program drives the emulated rig"):
            second.advance(30.0, {})

        assert second.control({})["now_s"] == 1.0

        connection.close()
        second.control({})

        assert second.advance(2.0, {}).now_s == 2.0


def test_a_second_connection_takes_orders_while_the_first_has_the_clock(small_bench, path, connection):
    clock = SharedClock(connection)
    with SocketConnection(path) as other:
        assert other.control({"object": "b"})["object"] == 1
    clock.wait([], 0.5)

    assert small_bench.finger.what == 1
    assert clock.control({})["now_s"] == 0.5


def test_what_the_bench_refuses_is_said_on_the_other_side(connection):
    with pytest.raises(InputError, match="Unknown object 9"):
        connection.control({"object": 9})
    with pytest.raises(InputError, match="/dev/null: unknown port of the emulator"):
        connection.advance(1.0, {"/dev/null": 0})

    assert connection.advance(1.0, {}).now_s == 1.0


def test_an_answer_that_nobody_waited_for_is_passed_over(running, connection):
    connection._number += 1
    connection._socket.sendall(b'{"number": 1, "order": {}}\n')

    assert connection.advance(0.25, {}) == (0.25, {})


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (b"", "Invalid request"),
        (b"[1]", "Invalid request"),
        (b"\xff\x00", "Invalid request"),
        (b'{"number": "\xff"}', "Invalid request"),
        (b'{"number": 3}', "A request needs advance and sent, or order"),
        (b'{"number": 3, "advance": "x", "sent": {}}', "A request needs advance and sent, or order"),
        (b'{"number": 3, "advance": 1, "sent": {"a": "b"}}', "Invalid request"),
        (b'{"number": 3, "advance": 1e999, "sent": {}}', "Invalid request|Cannot advance rig time"),
        (b'{"number": 3, "order": 5}', "A request needs advance and sent, or order"),
    ],
)
def test_a_question_that_makes_no_sense_is_answered_and_the_next_one_too(path, running, line, sentence):
    answers = ask(path, line, b'{"number": 4, "order": {}}')

    assert any(part in answers[0]["error"] for part in sentence.split("|"))
    assert answers[1]["number"] == 4
    assert "now_s" in answers[1]


def test_a_client_that_vanishes_does_not_matter(path, running, connection):
    for part in (b"", b'{"number"', b'{"number": 1, "order": {}}\n' * 100):
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(path))
            client.sendall(part)

    assert connection.control({})["now_s"] == 0.0


def test_an_emulator_that_ends_is_said_in_a_sentence(small_bench, running, connection):
    clock = SharedClock(connection)
    running.stop()

    for _ in range(2):
        with pytest.raises(PortLost, match="control: the emulator ended"):
            clock.wait([], 1.0)


def test_no_emulator_is_said_in_a_sentence(tmp_path):
    with pytest.raises(PortError, match="none: no emulator answers; start one with `solidtouch emulate`"):
        SocketConnection(tmp_path / "none")


def test_a_path_too_long_for_a_socket_is_refused(small_bench, tmp_path):
    path = tmp_path / ("x" * 120)
    for start in (SocketConnection, lambda path: Service(small_bench.emulation, path)):
        with pytest.raises(InputError, match="a socket path may have at most 107 bytes, this one has"):
            start(path)


def test_two_emulators_do_not_serve_at_one_place(small_bench, path, running):
    with pytest.raises(InputError, match="control: another emulator is running there"):
        Service(small_bench.emulation, path)


def test_a_socket_left_behind_is_replaced(small_bench, path):
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    Service(small_bench.emulation, path).close()

    assert not path.exists()


def test_a_file_of_that_name_is_not_replaced(small_bench, path):
    path.write_text("mine")
    with pytest.raises(InputError, match="control: cannot create the socket"):
        Service(small_bench.emulation, path)

    assert path.read_text() == "mine"


def test_in_real_time_the_clock_of_the_host_serves(small_bench, path, host):
    running = Running(small_bench.emulation, path, real_time=True)
    try:
        small_bench.clock = host
        small_bench.sensor.open()
        start = host.now()
        got = small_bench.heard(small_bench.sensor, 0.3)
        with SocketConnection(path) as connection:
            assert abs(connection.control({})["now_s"] - (host.now() - start)) < 0.2
            with pytest.raises(InputError, match="The emulator runs in real time"):
                connection.advance(9.0, {})
    finally:
        running.stop()

    assert 10 <= got.count(b"\n") <= 15


def test_in_real_time_an_unplugged_port_comes_back(small_bench, path, host):
    running = Running(small_bench.emulation, path, real_time=True)
    try:
        small_bench.clock = host
        small_bench.stage.open()
        small_bench.emulation.switches.on("unplug", times=1, seconds=0.05)
        small_bench.stage.write(b"a")
        with pytest.raises(PortLost):
            small_bench.heard(small_bench.stage, 2.0)
        host.wait([], host.now() + 0.2)
        small_bench.stage.open()
        small_bench.stage.write(b"b")

        assert small_bench.heard(small_bench.stage, 0.1) == b"b"
    finally:
        running.stop()
