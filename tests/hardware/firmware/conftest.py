"""One board for the tests of a file, with the stage driver on it."""

import pytest
from firmware_board import QUICK, Board, build
from solidtouch.hardware.link.loop import Loop
from solidtouch.hardware.rig.settings import StageSettings
from solidtouch.hardware.stage.stage import Stage
from stage_script import Notes, X, Y


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    """The firmware, or a skip."""
    return build(tmp_path_factory.mktemp("firmware"))


@pytest.fixture(scope="module")
def board(program, tmp_path_factory):
    made = Board(program, tmp_path_factory.mktemp("board"), values=QUICK)
    yield made
    made.remove()


@pytest.fixture
def journal():
    return Notes()


@pytest.fixture
def loop(board):
    return Loop(board.clock)


@pytest.fixture
def unhomed(board, loop, journal):
    """A stage on a controller that was just switched on, not connected."""
    board.line.close()
    board.line.keep()
    board.start()
    settings = StageSettings(port=board.line.address, x=X, y=Y, boot_s=2.0, homing_s=20.0)
    yield Stage(settings, loop, journal, board.line)
    board.press("")
    board.line.close()


@pytest.fixture
def stage(unhomed, board):
    """A stage at the origin of the rig frame, which knows it."""
    board.home((X.machine_mm(0.0), Y.machine_mm(0.0), -1.0))
    unhomed.connect()
    return unhomed
