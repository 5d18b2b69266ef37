"""Likelihood models that a sweep can compare, by name."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from ..models.classes import ClassGrid
    from ..models.histogram import HistogramModel
    from ..models.taps import TapSet


class FitSettings(NamedTuple):
    """The axes of a sweep that decide the likelihoods of a data set.

    Attributes:
        model: Name of the likelihood model.
        bins: Histogram bins.
        value_range: Whether bins span all taxels together or each.
        pseudocount: Counts added to every bin.
        power: Root of the likelihood.
    """

    model: str
    bins: int
    value_range: Any
    pseudocount: float
    power: str | float


def _histogram(taps: "TapSet", grid: "ClassGrid", settings: FitSettings) -> "HistogramModel":
    from ..models.histogram import fit  # noqa: PLC0415 - NumPyro takes seconds to import

    return fit(
        taps,
        grid,
        bins=settings.bins,
        pseudocount=settings.pseudocount,
        power=settings.power,
        value_range=settings.value_range,
    )


MODELS: dict[str, Callable[["TapSet", "ClassGrid", FitSettings], "HistogramModel"]] = {"histogram": _histogram}
"""Functions that fit a model to training taps."""
