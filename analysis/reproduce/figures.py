"""The figures of a report, by name; each function makes one, `save` writes it.

The functions named `plot_...` in the modules behind this one draw single panels into axes of the caller's own
figure.
"""

from ..page.figure_confusion import confusion
from ..page.figure_episodes import BeliefCase, beliefs, trajectories
from ..page.figure_style import save
from .figure_errors import acuity, contacts, errors_by_fixation, errors_by_position
from .figure_taps import pressure

__all__ = [
    "BeliefCase",
    "acuity",
    "beliefs",
    "confusion",
    "contacts",
    "errors_by_fixation",
    "errors_by_position",
    "pressure",
    "save",
    "trajectories",
]
