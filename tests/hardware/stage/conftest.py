"""Stages on ports with a script."""

import pytest
from solidtouch.hardware.stage.stage import Stage
from stage_script import READY, SETTINGS, Notes


@pytest.fixture
def journal():
    return Notes()


@pytest.fixture
def plugged(scripted, loop, journal):
    """A function that makes a stage on a port with a script."""

    def make(*exchanges, settings=SETTINGS):
        return Stage(settings, loop, journal, scripted(*exchanges))

    return make


@pytest.fixture
def ready(plugged):
    """A function that makes a stage that stands at the origin of the rig frame and knows it."""

    def make(*exchanges):
        stage = plugged(*READY, *exchanges)
        stage.connect()
        return stage

    return make
