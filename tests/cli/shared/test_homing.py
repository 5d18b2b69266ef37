"""Homing is asked for, but of emulated rigs."""

import io
import sys
from pathlib import Path

import pytest
from solidtouch.cli.shared.homing import confirm_homing
from solidtouch.models.errors import InputError

RIG = Path(__file__).parents[3] / "docs" / "examples" / "rig.toml"


class Terminal(io.StringIO):
    """What a person types."""

    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (Terminal("n\n"), "--home was not confirmed; nothing moved"),
        (io.StringIO("y\n"), "nobody can answer, use --yes"),
    ],
)
def test_no_answer_or_a_no_refuses_it(monkeypatch, answer, sentence):
    monkeypatch.setattr(sys, "stdin", answer)
    with pytest.raises(InputError, match=sentence):
        confirm_homing(RIG, home=True, yes=False)


def test_a_yes_is_enough_and_is_asked_once_for_a_real_rig_alone(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(sys, "stdin", Terminal("y\n"))
    confirm_homing(RIG, home=True, yes=False)
    assert "bench: homing moves the stage to its limit switches, unwatched." in capsys.readouterr().err

    emulated = tmp_path / "rig.toml"
    emulated.write_text(RIG.read_text() + '\n[emulator]\ncontrol = "control"\n')
    for path, home, yes in (
        (RIG, True, True),
        (RIG, False, False),
        (emulated, True, False),
        ("simulated", True, False),
    ):
        confirm_homing(path, home, yes)
    assert capsys.readouterr().err == ""
    with pytest.raises(InputError, match="--yes requires --home"):
        confirm_homing(RIG, home=False, yes=True)
