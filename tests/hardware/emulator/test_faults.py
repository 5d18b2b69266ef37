"""Switches of faults: when they strike, how often, and where."""

import pytest
from solidtouch.hardware.emulator.faults import FAULTS, PORTS, Switches
from solidtouch.models.errors import InputError


@pytest.fixture
def switches():
    return Switches(seed=2)


def strikes(switches, name, tries, **more):
    return sum(switches.strikes(name, float(i), **more) is not None for i in range(tries))


def test_all_are_off_at_first(switches):
    assert not any(switches.is_on(name) or strikes(switches, name, 1) for name in FAULTS)
    assert switches.struck == []


def test_one_that_is_on_strikes_for_ever_with_its_parameters(switches):
    switches.on("late", delay_s=0.2)

    assert switches.strikes("late", 1.0) == {"delay_s": 0.2}
    assert strikes(switches, "late", 100) == 100


def test_it_strikes_as_often_as_said(switches):
    switches.on("unplug", times=2)

    assert strikes(switches, "unplug", 5) == 2
    assert not switches.is_on("unplug")
    assert switches.tally() == {"unplug": 2}
    assert [struck.time_s for struck in switches.struck] == [0.0, 1.0]


def test_it_strikes_at_its_rate(switches):
    switches.on("lost_frames", rate=0.3)

    assert 230 < strikes(switches, "lost_frames", 1000) < 370


def test_one_for_a_port_is_neither_seen_nor_used_up_on_the_other(switches):
    switches.on("unplug", times=1, port="sensor")

    assert strikes(switches, "unplug", 3, port="stage") == 0
    assert switches.is_on("unplug")
    assert strikes(switches, "unplug", 3, port="sensor") == 1


def test_one_for_either_port_strikes_on_both(switches):
    switches.on("late")

    assert [strikes(switches, "late", 1, port=port) for port in PORTS] == [1, 1]


def test_off_is_off(switches):
    switches.on("late")
    switches.on("drift")
    switches.off("late")
    switches.off("late")

    assert list(switches) == ["drift"]

    switches.clear()

    assert list(switches) == []


def test_the_same_seed_strikes_at_the_same_times():
    both = Switches(4), Switches(4)
    for switches in both:
        switches.on("late", rate=0.5)
        strikes(switches, "late", 50)

    assert both[0].struck == both[1].struck


@pytest.mark.parametrize(
    ("name", "how", "sentence"),
    [
        ("jump", {}, "Unknown fault 'jump'; choose from split, "),
        ("late", {"rate": 1.5}, "Fault late: rate=1.5 must be between 0 and 1"),
        ("late", {"times": 0}, "times=0 at least 1"),
        ("late", {"port": "door"}, "Fault late: port=door must be stage or sensor"),
        ("late", {"delay": 1.0}, "Fault late: unknown parameter 'delay'; known: delay_s"),
        ("merge", {"count": 1}, "Fault merge: unknown parameter 'count'; known: none"),
        ("late", {"delay_s": "x"}, "Fault late: delay_s must be a number of at least 0, got 'x'"),
        ("late", {"delay_s": float("nan")}, "delay_s must be a number of at least 0"),
        ("split", {"size": 0}, "size must be a number of at least 1, got 0"),
        ("split", {"size": 1.5}, "size must be an integer, got 1.5"),
        ("unplug", {"seconds": float("inf")}, "seconds must be a number of at least 0"),
        ("lost_ok", {"port": "stage"}, "is for faults of a port only"),
    ],
)
def test_what_makes_no_sense_is_refused(switches, name, how, sentence):
    with pytest.raises(InputError, match=sentence):
        switches.on(name, **how)
