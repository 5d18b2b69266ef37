"""Lines to emulated controllers that know where they stand, or do not."""

import pytest
from grbl_line import Line
from solidtouch.hardware.emulator.grbl.controller import ControllerSettings


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def unhomed():
    return Line(ControllerSettings())
