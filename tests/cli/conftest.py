"""Commands run as a person runs them, but in this process."""

import sys
from collections.abc import Callable
from typing import NamedTuple

import pytest
from solidtouch.analysis.page import figure_style
from solidtouch.analysis.page.figure_style import Drawing
from solidtouch.analysis.trials import spread
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


@pytest.fixture(autouse=True)
def _few_selected(monkeypatch) -> None:
    """Intervals of `trials` come from few trials on each selection of taps; tests of them set more."""
    monkeypatch.setattr(spread, "SELECTED_TRIALS", 50)
    monkeypatch.setattr(spread, "FRESH_TRIALS", 50)


@pytest.fixture
def sketched(monkeypatch) -> None:
    """Figures of a report are made but not drawn: their files hold an empty drawing.

    What figures look like is tested beside the code that draws them.
    """

    monkeypatch.setattr(figure_style, "drawing_of", lambda figure: Drawing(b"<svg/>", figure.get_figwidth(), bytes))


@pytest.fixture
def taps_file(tmp_path, make_taps):
    """A recording of two sessions."""
    make_taps().save(tmp_path / "taps.nc")
    return tmp_path / "taps.nc"
