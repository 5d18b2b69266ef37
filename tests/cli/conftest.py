"""Commands run as a person runs them, but in this process."""

import sys
from collections.abc import Callable
from typing import NamedTuple

import pytest
from solidtouch.cli.main import run


class Done(NamedTuple):
    """Exit code and what was printed."""

    code: int
    out: str
    err: str


@pytest.fixture
def command(monkeypatch, capsys) -> Callable[..., Done]:
    """A function that runs `solidtouch` with some words."""

    def call(*words: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["solidtouch", *map(str, words)])
        try:
            run()
            code = 0
        except SystemExit as stopped:
            code = int(stopped.code or 0)
        return Done(code, *capsys.readouterr())

    return call
