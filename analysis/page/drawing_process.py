"""What a process beside this one does to draw figures, so that matplotlib is loaded there alone."""

import gc
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .figure_style import Drawing

_drawings: "list[Drawing]" = []


def load() -> None:
    """Loads what draws."""
    from .figure_style import draw_nothing  # noqa: PLC0415 - loads matplotlib

    draw_nothing()
    gc.disable()  # figures stay until the end


def draw(what: Callable[[], Any]) -> tuple[int, bytes, float, Any] | None:
    """Draws a figure: its number, SVG, width in inches and curves, or `None` where there is nothing to draw."""
    from .figure_style import drawn  # noqa: PLC0415 - loads matplotlib

    drawing = drawn(what)
    if drawing is None:
        return None
    _drawings.append(drawing)
    return len(_drawings) - 1, drawing.svg, drawing.inches, drawing.curves


def png(number: int) -> bytes:
    """A figure that was drawn before, in pixels."""
    return _drawings[number].png()
