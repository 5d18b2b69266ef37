"""Commands run as a person runs them, but in this process."""

import sys
from collections.abc import Callable
from typing import NamedTuple

import pytest
from solidtouch.analysis.page import html
from solidtouch.analysis.page.figure_style import styled
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


@pytest.fixture
def sketched(monkeypatch) -> None:
    """Figures of a report are drawn once and coarsely, without the layout; their drawings stay empty.

    What figures look like, and that both formats are written, is tested beside the code that draws them.
    """

    @styled
    def sketch(figure, folder, name):
        figure.set_layout_engine("none")
        figure.savefig(folder / f"{name}.png", dpi=30)
        (folder / f"{name}.svg").write_text("<svg/>")
        return folder / f"{name}.png", folder / f"{name}.svg"

    monkeypatch.setattr(html, "save", sketch)
