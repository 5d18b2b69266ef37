"""Options that home the stage, and the question before it moves."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from ...models.errors import InputError

Home = Annotated[
    bool, typer.Option("--home", help="Home the stage first; it moves to its limit switches, and asks before.")
]
Yes = Annotated[bool, typer.Option("--yes", help="With --home: do not ask.")]


def confirm_homing(path: str | Path, home: bool, yes: bool) -> None:
    """Asks whether the path of the stage is clear, but of an emulated one.

    Args:
        path: Settings file of the rig; another rig does not move.
        home: Whether the stage is to be homed.
        yes: Whether the answer is known.

    Raises:
        InputError: The answer is no, or nobody can give one.
    """
    from ...hardware.rig.settings import load_rig

    if yes and not home:
        raise InputError("--yes requires --home.")
    if not home or yes or Path(path).suffix != ".toml" or (rig := load_rig(path)).emulator is not None:
        return
    if not sys.stdin.isatty():
        raise InputError("--home asks whether the path of the stage is clear; where nobody can answer, use --yes.")
    question = f"{rig.name}: homing moves the stage to its limit switches, unwatched. Is its path clear?"
    if not typer.confirm(question, err=True):
        raise InputError("--home was not confirmed; nothing moved.")
