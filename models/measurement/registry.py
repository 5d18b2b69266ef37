"""Registry of measurement models by name.

A model is one file of this folder, whose `MODEL` holds all that is known of it: its story, its fits, what its
parameters mean for the bins of a tap, and what it refuses. A further model is a file more and its name here. Files are
imported when their model is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from .model import MeasurementModel, Row

PAPER = "histogram"
"""The paper's model."""
KINDS = (PAPER, "gaussian", "student", "profile", "profile-ar", "profile-mvn", "matrix-normal", "smooth")
"""Names of the models, each a file name with a minus for an underscore; the paper's first."""
SESSION = "session"
NAMES = (*KINDS, SESSION)
"""Names of the models and `session`, short for `session:histogram`; `session:` may precede any other name."""


def split_name(name: str) -> tuple[str, bool]:
    """Kind of a model name, and whether it has states.

    Raises:
        InputError: The model is unknown.
    """
    wrapper, colon, kind = str(name).partition(":")
    in_states = wrapper == SESSION
    if not in_states:
        kind = str(name)
    elif not colon:
        kind = PAPER
    if kind not in KINDS:
        raise InputError(f"Unknown model {name!r}; choose from {', '.join(NAMES)} and session:NAME.")
    return kind, in_states


def measurement_model(kind: str) -> "MeasurementModel":
    """Model of a name without `session`."""
    return import_module(f".{kind.replace('-', '_')}", __package__).MODEL


def row(name: str) -> "Row":
    """Difference of a model from the paper's assumptions.

    Raises:
        InputError: The model is unknown.
    """
    kind, in_states = split_name(name)
    return import_module(".shared_gain", __package__).ROW if in_states else measurement_model(kind).row
