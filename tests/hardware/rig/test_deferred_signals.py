"""Signals inside the block wait until its end."""

import signal
import threading

import pytest
from solidtouch.hardware.rig.deferred_signals import signals_deferred


def interrupted(done, error=None):
    with signals_deferred():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        done.append(True)
        if error is not None:
            raise error


def test_ctrl_c_is_delivered_after_the_block():
    done = []
    with pytest.raises(KeyboardInterrupt):
        interrupted(done)

    assert done == [True]


def test_handlers_are_as_before():
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with signals_deferred():
        assert before != (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM))

    assert before == (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM))


def test_an_exception_inside_is_not_replaced():
    with pytest.raises(KeyboardInterrupt) as caught:
        interrupted([], ValueError("inside"))

    assert str(caught.value.__context__) == "inside"


def test_other_threads_are_left_alone():
    seen = []

    def work():
        with signals_deferred():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()

    assert [signal.default_int_handler] == seen
