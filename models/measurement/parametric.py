"""Fitted models other than the histogram: parameters of a story and the form that follows from them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..grid import ClassGrid
from ..preprocessing import Preprocessing
from .likelihood import shapes
from .likelihood.forms import Form
from .likelihood.shapes import Measure, Parameters
from .model import TapModel
from .novelty import NoveltyScores
from .scaling import Scaling
from .states import ONE_STATE, States

FORMS: dict[str, Callable[[Parameters, Measure], Form]] = {
    "gaussian": shapes.gaussian_form,
    "student": shapes.student_form,
    "profile": shapes.profile_form,
    "profile-ar": shapes.profile_ar_form,
    "profile-mvn": shapes.profile_mvn_form,
    "matrix-normal": shapes.matrix_normal_form,
    "smooth": shapes.smooth_form,
}
"""From parameters to probabilities of bins, by the name of the model."""


_CELL = ("where", "what", "sample", "taxel")
DIMS: dict[str, dict[str, tuple[str, ...]]] = {
    "gaussian": {"level": ("where", "what", "once", "taxel"), "variance": ("where", "what", "once", "taxel")},
    "student": {
        "level": ("where", "what", "once", "taxel"),
        "scale": ("where", "what", "once", "taxel"),
        "freedom": ("taxel",),
    },
    "profile": {"level": _CELL, "variance": _CELL},
    "profile-ar": {"rho": ("taxel",), "level": _CELL, "variance": _CELL},
    "profile-mvn": {"slope": ("where", "what", "taxel", "from_taxel"), "level": _CELL, "variance": _CELL},
    "matrix-normal": {
        "level": _CELL,
        "time_covariance": ("sample", "other_sample"),
        "taxel_covariance": ("where", "what", "taxel", "other_taxel"),
    },
    "smooth": {"weight": ("what", "sample", "taxel", "basis"), "variance": _CELL},
}
"""Dims of the parameters, by the name of the model."""


@dataclass(frozen=True, eq=False, repr=False)
class ParametricModel(TapModel):
    """A fitted model of the catalogue; see `TapModel` for what all have in common.

    Attributes:
        story: Name of its story in the catalogue.
        grid: The classes.
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        scaling: Units of the parameters.
        basis: Basis functions at Q places in each where class, shape (Q, L, D), or (0, 0, 0).
        parameters: With which it decides, as `stories` names them.
        covered: Which classes it can speak about, shape (L, M).
        power: Root of the likelihood in Eq. 1.
        preprocessing: How the taps were prepared.
        left_out: Names of the classes that it cannot speak about.
        trained_on: Which taps trained it, in words.
        version: Version of this software that fitted it.
        novelty: None; p-values of new taps need the histogram model.
        training: Digests of the training taps.
        states: What all taps of an episode share, see `session`.
        saturation: How many taps' evidence an episode carries at most.
    """

    story: str
    grid: ClassGrid
    edges: NDArray[np.float64]
    scaling: Scaling
    basis: NDArray[np.float64]
    parameters: Parameters
    covered: NDArray[np.bool_]
    power: str | float
    preprocessing: Preprocessing
    left_out: tuple[str, ...] = ()
    trained_on: str = ""
    version: str = ""
    novelty: NoveltyScores | None = None
    training: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    states: States = ONE_STATE
    saturation: float = np.inf

    @property
    def kind(self) -> str:
        """Its story."""
        return self.story

    @property
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""
        return len(self.scaling.unit)

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        """Which classes it can speak about, shape (L, M)."""
        return self.covered

    @property
    def frame(self) -> Measure:
        """What its form needs beside parameters."""
        return Measure(self.scaling, self.edges, self.basis)

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Those of its story."""
        return DIMS[self.story]

    def groups(self) -> dict[str, xr.Dataset]:
        """With its parameters and what they are measured in."""
        groups = super().groups()
        own: dict[str, Any] = {
            "centre": ("taxel", self.scaling.centre),
            "unit": ("taxel", self.scaling.unit),
            "covered": (("where", "what"), self.covered),
        }
        if self.basis.size:
            own["basis"] = (("place", "where", "basis_function"), self.basis)
        parameters = {name: (dims, self.parameters[name]) for name, dims in self.dims.items()}
        return groups | {
            "constant_data": groups["constant_data"].assign(own),
            "parameters": xr.Dataset(parameters, self.grid.coords()),
        }

    @cached_property
    def plain_form(self) -> Form:
        """What the parameters mean for bins."""
        return FORMS[self.story](self.parameters, self.frame)
