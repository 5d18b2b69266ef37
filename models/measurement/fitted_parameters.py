"""Fitted models that decide with parameters of a generative model, whoever wrote it."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import InputError
from ..grid import ClassGrid
from ..settings import FitSettings, likelihood_exponent
from ..taps import TapSet
from .fits.posterior import several
from .fits.priors import Taps
from .likelihood.bins import bin_edges
from .likelihood.forecasts import log_mean
from .likelihood.shapes import Parameters
from .likelihood.true_class import Own, OwnTaps
from .model import TapModel
from .scaling import Scaling
from .states import States

if TYPE_CHECKING:
    from .generic.form import GenericForm


def training(
    taps: TapSet, grid: ClassGrid, settings: FitSettings, trained_on: str, in_blocks: bool = False
) -> tuple[TapSet, Taps, dict[str, Any]]:
    """Training taps of the classes of a grid, the same as arrays in their own unit, and what their models keep of them.

    With `in_blocks`, samples of a large recording stay on disk, see `ScaledSamples`.

    Raises:
        InputError: There is none, or an argument is out of range.
    """
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    if not inside.any():
        raise InputError("No training tap belongs to a class of the grid.")
    used = taps if inside.all() else taps.select(inside)
    samples = used.doubles if in_blocks else used.taps.astype(np.float64)
    known = Taps(samples, where[inside], what[inside], grid.shape, used.where)
    likelihood_exponent(settings.power, *known.samples.shape[1:])
    if settings.bins < 1:
        raise InputError(f"bins must be at least 1, got {settings.bins}.")
    covered = np.zeros(grid.shape, dtype=bool)
    covered[known.where, known.what] = True
    kept = {
        "grid": grid,
        "edges": bin_edges(used.extremes, settings.bins, settings.value_range)
        if settings.edges is None
        else settings.edges,
        "covered": covered,
        "power": settings.power,
        "preprocessing": taps.preprocessing,
        "trained_on": trained_on,
        "source": taps.source,
        "version": version("solidtouch"),
        "training": used.digests,
        "saturation": settings.limit,
    }
    return used, known, kept


_MANY_DRAWS = 100  # where nothing is integrated exactly


@dataclass(frozen=True, eq=False, repr=False)
class ModelOfParameters(TapModel):
    """A generative model at fitted parameters, see `TapModel`.

    Attributes:
        scaling: Units of the samples in the generative model.
        parameters: With which it decides, by name.
        covered: Which classes it can speak about, shape (L, M).
    """

    scaling: Scaling
    parameters: Parameters
    covered: NDArray[np.bool_]

    @abstractmethod
    def by_story(self, parameters: Parameters) -> "list[GenericForm]":
        """Likelihood forms that run the generative model at these parameters; they count equally."""

    @cached_property
    def decides_at(self) -> Sequence[Parameters]:
        """Parameters with which it decides, integrated over if there are several."""
        return self.draws or (self.parameters,)

    @property
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""
        return len(self.scaling.unit)

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes with parameters, shape (L, M)."""
        return self.covered

    def integrated(
        self,
        posterior: Any,
        taps: NDArray[np.floating],
        own: Own,
        generator: np.random.Generator,
        gain: float,
        offset: float,
    ) -> NDArray[np.float64]:
        """Predictive log probability, averaged over draws."""
        known = OwnTaps(taps, own, self.edges, States(np.array([gain]), np.array([offset]), np.zeros(1)))
        forms = map(self.form_of, several(posterior, [generator] * _MANY_DRAWS))
        return log_mean([known.log_probability(form) for form in forms])

    def groups(self) -> dict[str, xr.Dataset]:
        """Groups of the file, with parameters and their scaling."""
        groups = super().groups()
        own: dict[str, Any] = {
            "centre": ("taxel", self.scaling.centre),
            "unit": ("taxel", self.scaling.unit),
            "covered": (("where", "what"), self.covered),
        }
        parameters = {name: (dims, self.parameters[name]) for name, dims in self.dims.items()}
        return groups | {
            "constant_data": groups["constant_data"].assign(own),
            "parameters": xr.Dataset(parameters, self.grid.coords()),
        }
