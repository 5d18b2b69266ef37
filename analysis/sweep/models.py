"""Measurement models that a sweep can compare, by name."""

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from ...models.grid import ClassGrid
    from ...models.measurement.model import TapModel
    from ...models.taps import TapSet


class FitAxes(NamedTuple):
    """The axes of a sweep that decide the likelihoods of a data set.

    Attributes:
        model: Name of the likelihood model.
        bins: Bins of the histogram, by which all models are judged.
        value_range: Whether bins span all taxels together or each.
        pseudocount: Counts added to every bin of the histogram.
        power: Root of the likelihood, or how it is learned, see `models.settings`.
    """

    model: str
    bins: int
    value_range: Any
    pseudocount: float
    power: str | float


def fit_cell(taps: "TapSet", grid: "ClassGrid", settings: FitAxes) -> "TapModel":
    """The model of training taps.

    Raises:
        InputError: As `inference.tuning.tempering.fit_tempered`.
    """
    from ...inference.tuning import tempering  # noqa: PLC0415 - SciPy takes long to import
    from ...models.settings import FitSettings  # noqa: PLC0415

    more = settings._asdict()
    fitted, _ = tempering.fit_tempered(more.pop("model"), taps, grid, FitSettings(**more))
    return fitted.model
