"""Measurement model with given, not fitted, probabilities: one table over the bins per class and taxel."""

from dataclasses import dataclass
from functools import cached_property
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .likelihood.bins import TableForm
from .model import TapModel


@dataclass(frozen=True, eq=False, repr=False)
class TableModel(TapModel):
    """Given tables P_k(b | class) instead of the histograms of Eq. 2; Eq. 1 is unchanged.

    It has no file of its own kind; what it was made from is kept instead.

    Attributes:
        probabilities: P_k(b | class) as they enter Eq. 1, shape (L, M, K, B); tables that do not sum to one stay so,
            and a class whose tables are all zero is impossible.

    Raises:
        InputError: Shapes contradict each other, edges do not increase, or a probability is negative or not finite.
    """

    probabilities: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Checks shapes and values."""
        super().__post_init__()
        shape = self.probabilities.shape
        if len(shape) != 4 or shape[:2] != self.grid.shape or 0 in shape:
            raise InputError(f"Tables of {self.grid.L} x {self.grid.M} classes have shape (L, M, K, B), not {shape}.")
        if self.edges.shape not in ((shape[3] + 1,), (shape[2], shape[3] + 1)) or not (np.diff(self.edges) > 0).all():
            raise InputError(f"{shape[3]} bins need {shape[3] + 1} increasing edges, got shape {self.edges.shape}.")
        if not (np.isfinite(self.probabilities) & (self.probabilities >= 0)).all():
            raise InputError("A probability is negative or not finite.")

    @property
    def kind(self) -> str:
        """Name of the model, which is not in the registry."""
        return "table"

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Empty, as it has no file."""
        return {}

    def groups(self) -> NoReturn:
        """Always raises, as it has no file.

        Raises:
            InputError: Always; netCDF files hold fitted models.
        """
        raise InputError("A TableModel cannot be saved; netCDF files contain fitted models only.")

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes with a probability above zero, shape (L, M)."""
        return self.probabilities.any(axis=(2, 3))

    @cached_property
    def plain_form(self) -> TableForm:
        """Log tables; flat for impossible classes, which have prior 0."""
        tables = np.where(self.trained[:, :, np.newaxis, np.newaxis], self.probabilities, 1.0)
        with np.errstate(divide="ignore"):
            return TableForm(np.log(tables))

    @property
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""
        return self.probabilities.shape[2]
