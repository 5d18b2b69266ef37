"""Rig time on a bench of small devices, and what faults of a port do to a program."""

import re

import pytest
from solidtouch.hardware.errors import PortBusy, PortError, PortLost, WriteTimeout
from solidtouch.hardware.link.port import Port
from solidtouch.models.errors import InputError


def test_time_stands_still_until_someone_waits(small_bench):
    small_bench.stage.open()
    small_bench.stage.write(b"a")

    assert 0.0 == small_bench.clock.now() == small_bench.bench.now_s


def test_an_answer_comes_after_the_delay_of_the_device(small_bench):
    small_bench.stage.open()
    small_bench.stage.write(b"hello")

    assert small_bench.collect(small_bench.stage, 1.0) == [(0.01, b"hello")]
    assert small_bench.clock.now() == 1.0


def test_opens_and_closes_reach_the_device(small_bench):
    small_bench.stage.open()
    small_bench.clock.wait([], 0.5)
    small_bench.stage.close()
    small_bench.clock.wait([], 1.0)

    assert small_bench.echo.log == [(0.0, "opened"), (0.5, "closed")]


def test_bytes_written_before_a_close_reach_the_device(small_bench):
    small_bench.stage.open()
    small_bench.clock.wait([small_bench.stage], 0.1)
    small_bench.stage.write(b"C\r")
    small_bench.stage.close()
    small_bench.clock.wait([], 0.2)

    assert small_bench.echo.seen == ["opened", b"C\r", "closed"]


@pytest.mark.parametrize("old", [0, 3, 8])
@pytest.mark.parametrize("new", [0, 3, 8])
def test_a_port_closed_and_opened_without_time_going_on_is_noticed_if_bytes_tell(small_bench, old, new):
    stage = small_bench.stage
    stage.open()
    stage.write(b"x" * 5)
    small_bench.clock.wait([stage], 0.1)
    stage.read()
    stage.write(b"o" * old)
    stage.close()
    stage.open()
    stage.write(b"n" * new)
    small_bench.clock.wait([stage], 0.2)
    before, after = ([b"o" * old] if old else []), ([b"n" * new] if new else [])

    assert ["opened", b"xxxxx", *before, "closed", "opened", *after] == small_bench.echo.seen


def test_two_devices_share_one_time(small_bench):
    small_bench.stage.open()
    small_bench.sensor.open()
    small_bench.stage.write(b"a")
    ports, seen = [small_bench.stage, small_bench.sensor], []
    while small_bench.clock.now() < 0.05:
        small_bench.clock.wait(ports, 0.05)
        seen += [(small_bench.clock.now(), data) for port in ports if (data := port.read())]

    assert [(pytest.approx(t), data) for t, data in seen] == [(0.01, b"a"), (0.02, b"1\n"), (0.04, b"2\n")]


def test_a_wait_returns_at_once_while_something_is_unread(small_bench):
    small_bench.sensor.open()
    small_bench.clock.wait([small_bench.sensor], 1.0)
    small_bench.clock.wait([small_bench.sensor], 1.0)

    assert small_bench.clock.now() == 0.02
    assert small_bench.sensor.read() == b"1\n"


def test_output_for_nobody_is_gone(small_bench):
    small_bench.sensor.open()
    small_bench.clock.wait([small_bench.sensor], 1.0)
    small_bench.sensor.close()
    small_bench.clock.wait([], 2.0)
    small_bench.sensor.open()
    small_bench.clock.wait([small_bench.sensor], 2.5)

    assert small_bench.sensor.read() == b"2\n"


def test_a_port_that_is_not_of_this_bench_is_named(small_bench, tmp_path):
    other = tmp_path / "other"
    other.symlink_to((tmp_path / "stage").readlink())
    small_bench.bench.advance(0.1, {str(other): 0})  # the same terminal by another name
    with pytest.raises(InputError, match=re.escape("/dev/null: unknown port of the emulator; known:")):
        small_bench.bench.advance(0.2, {"/dev/null": 0})


@pytest.mark.parametrize("until_s", [float("inf"), float("nan")])
def test_time_cannot_go_on_for_ever(small_bench, until_s):
    with pytest.raises(InputError, match="Cannot advance rig time to"):
        small_bench.bench.advance(until_s, {})


def test_a_promise_that_cannot_be_met_costs_one_wait_only(small_bench, host):
    small_bench.stage.open()
    small_bench.bench.advance(0.1, {small_bench.stage.address: 1000})
    start = host.now()
    for i in range(2, 6):
        small_bench.bench.advance(0.1 * i, {small_bench.stage.address: 1000})

    assert host.now() - start < 0.15


def test_a_run_repeats_itself_to_the_byte(small_bench):
    def run():
        small_bench.switches.on("late", delay_s=0.03)
        small_bench.sensor.open()
        parts = small_bench.collect(small_bench.sensor, 2.0)
        small_bench.sensor.close()
        return parts

    random = small_bench.switches.generator.bit_generator
    state = random.state
    first = run()
    small_bench.clock.wait([], small_bench.clock.now() + 1.0)
    random.state = state
    small_bench.ticker.number = 0
    offset = small_bench.clock.now()
    second = run()

    assert [data for _, data in first] == [data for _, data in second]
    assert [t for t, _ in first] == pytest.approx([t - offset for t, _ in second])


def test_an_unplugged_port_is_lost_and_comes_back(small_bench):
    sensor = small_bench.sensor
    sensor.open()
    small_bench.heard(sensor, 0.1)
    small_bench.switches.on("unplug", times=1, port="sensor", seconds=2.0)

    with pytest.raises(PortLost, match="finger: lost the port while reading"):
        small_bench.heard(sensor, 1.0)

    assert pytest.approx(small_bench.clock.now()) == 0.12
    with pytest.raises(PortError, match="finger: cannot open the port: no such port"):
        sensor.open()

    small_bench.clock.wait([], small_bench.clock.now() + 2.0)
    sensor.open()

    assert small_bench.heard(sensor, 0.1)
    assert small_bench.ticker.seen == ["opened", "closed", "opened"]


def test_a_port_comes_back_when_its_fault_is_switched_off(small_bench):
    """Time, which brings it back otherwise, goes on only while a program waits."""
    sensor, control = small_bench.sensor, small_bench.clock.control
    sensor.open()
    control({"on": "unplug", "port": "sensor"})
    with pytest.raises(PortLost):
        small_bench.heard(sensor, 1.0)
    control({"off": "late"})
    with pytest.raises(PortError):
        sensor.open()
    control({"off": "unplug"})
    sensor.open()

    assert small_bench.heard(sensor, 0.1)


def test_a_write_to_an_unplugged_port_loses_it(small_bench):
    small_bench.stage.open()
    small_bench.stage.write(b"a")
    small_bench.switches.on("unplug", times=1)
    small_bench.clock.wait([small_bench.stage], 1.0)

    with pytest.raises(PortLost, match="stage: lost the port while writing"):
        small_bench.stage.write(b"b")


def test_nobody_waits_for_bytes_sent_to_an_unplugged_port(small_bench, host):
    small_bench.stage.open()
    small_bench.stage.write(b"a")
    small_bench.switches.on("unplug", times=1)
    small_bench.clock.wait([small_bench.stage], 1.0)
    start = host.now()
    small_bench.bench.advance(0.5, {small_bench.stage.address: 77})

    assert host.now() - start < 0.1


def test_a_renumbered_port_keeps_its_link(small_bench, tmp_path):
    before = (tmp_path / "finger").readlink()
    small_bench.sensor.open()
    small_bench.switches.on("renumber", times=1)
    with pytest.raises(PortLost):
        small_bench.heard(small_bench.sensor, 1.0)
    small_bench.clock.wait([], small_bench.clock.now() + 1.0)
    small_bench.sensor.open()

    assert before != (tmp_path / "finger").readlink()
    assert small_bench.heard(small_bench.sensor, 0.1)


def test_a_busy_port_cannot_be_opened_for_a_while(small_bench):
    small_bench.clock.control({"on": "busy_port", "times": 1, "seconds": 3.0})

    with pytest.raises(PortBusy, match="stage: another program has the port open"):
        small_bench.stage.open()

    small_bench.clock.wait([], 3.0)
    small_bench.stage.open()
    small_bench.stage.write(b"mine")

    assert small_bench.heard(small_bench.stage, 1.0).endswith(b"mine")
    assert b"AT" in small_bench.echo.seen[1]


def test_the_text_of_the_other_program_is_answered_to_the_next_one(small_bench):
    small_bench.clock.control({"on": "busy_port", "times": 1, "seconds": 1.0})
    small_bench.clock.wait([], 2.0)
    small_bench.stage.open()

    assert b"AT" in small_bench.heard(small_bench.stage, 1.0)


def test_a_second_reader_takes_some_of_the_output(small_bench):
    small_bench.sensor.open()
    small_bench.switches.on("second_reader", count=1)

    assert small_bench.heard(small_bench.sensor, 0.105) == b"\n" * 5


def test_old_output_arrives_after_an_open(small_bench):
    small_bench.switches.on("stale_input", times=1)
    small_bench.sensor.open()
    got = small_bench.heard(small_bench.sensor, 0.05)

    assert got.endswith(b"1\n2\n")
    assert len(got) > 4


def test_a_deaf_device_reads_later_what_was_sent(small_bench):
    small_bench.stage.open()
    small_bench.heard(small_bench.stage, 0.1)
    small_bench.switches.on("deaf", times=1, seconds=0.5)
    small_bench.stage.write(b"a")

    assert [(pytest.approx(0.61), b"a")] == small_bench.collect(small_bench.stage, 1.0)


def test_writing_to_a_deaf_device_ends_in_time(small_bench, monkeypatch):
    monkeypatch.setattr("solidtouch.hardware.link.port.WRITE_TIMEOUT_S", 0.05)
    small_bench.stage.open()
    small_bench.switches.on("deaf")
    with pytest.raises(WriteTimeout, match=r"stage: the device took no bytes for 0.05 s"):
        small_bench.stage.write(bytes(1_000_000))

    small_bench.clock.wait([small_bench.stage], 0.1)

    assert small_bench.stage.is_open


@pytest.mark.parametrize("fault", ["split", "drop_bytes", "flip_bits", "garbage", "merge", "late"])
def test_faults_of_the_wire_happen_between_device_and_program(small_bench, fault):
    small_bench.sensor.open()
    small_bench.switches.on(fault, port="sensor")
    got = small_bench.heard(small_bench.sensor, 0.3)

    assert small_bench.switches.tally()[fault] > 0
    assert got or fault == "drop_bytes"


def test_overrun_is_counted_when_nobody_reads(small_bench):
    sensor = small_bench.sensor
    sensor.open()
    small_bench.ticker.step = lambda time_s: setattr(small_bench.ticker, "next_s", time_s + 0.02) or bytes(1000)
    small_bench.bench.advance(0.0, {})
    for i in range(60):
        small_bench.bench.advance(0.02 * (i + 1), {sensor.address: 0})

    assert small_bench.emulation.state()["overrun"]["sensor"] > 0


def test_orders_change_the_object(small_bench):
    control = small_bench.clock.control

    assert (control({"object": 1})["object_name"], small_bench.finger.what) == ("b", 1)
    assert control({"object": "a"})["object"] == 0
    assert control({"object": None})["object"] is None


def test_orders_switch_faults(small_bench):
    control = small_bench.clock.control

    assert control({"on": "late"})["faults"] + control({"on": "unplug", "times": 2})["faults"][1:] == ["late", "unplug"]
    assert control({"off": "late"})["faults"] == ["unplug"]
    assert control({"off": None})["faults"] == []


def test_the_state_tells_time_place_and_ports(small_bench):
    small_bench.stage.open()
    small_bench.clock.wait([], 2.0)
    state = small_bench.clock.control({})

    assert (state["now_s"], state["place_mm"], state["objects"]) == (2.0, [2.0, 0.0], ["a", "b"])
    assert state["open"] == {"stage": True, "sensor": False}


@pytest.mark.parametrize(
    ("order", "sentence"),
    [
        ({"object": 2}, "Unknown object 2; choose from a, b"),
        ({"object": True}, "Unknown object True"),
        ({"object": "c"}, "Unknown object 'c'"),
        ({"object": [1]}, r"Unknown object \[1\]"),
        ({"object": 1, "off": "late"}, "Unknown order"),
        ({"jump": 1}, "Unknown order"),
        ({"on": "jump"}, "Unknown fault 'jump'"),
        ({"on": "late", "times": "x"}, "Fault late: "),
        ({"on": "late", "name": "x"}, "Fault late: "),
        ({"on": 7}, "Unknown order"),
        ({"on": "lost_ok", "port": "stage"}, "is for faults of a port only"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused(small_bench, order, sentence):
    with pytest.raises(InputError, match=sentence):
        small_bench.clock.control(order)


def test_a_program_that_opens_a_port_twice_meets_the_lock(small_bench):
    small_bench.stage.open()
    with pytest.raises(PortBusy, match="another program has the port open"):
        Port(small_bench.stage.address).open()
