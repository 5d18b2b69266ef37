"""A model whose likelihoods a test writes down, and its taps."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from solidtouch.models.grid import ClassGrid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet

type Classes = Sequence[int] | NDArray[np.int64]


@dataclass(frozen=True)
class NumberedTaps:
    """A measurement model of M objects that knows N taps by their number, which is all that they hold."""

    known: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    M: int
    preprocessing = Preprocessing(samples=1)
    saturation, tap_shape = np.inf, (1, 1)

    @cached_property
    def grid(self) -> ClassGrid:
        where = 1.5 * np.arange(self.known.shape[1])
        return ClassGrid(where, "mm", None, tuple((f"object {m}",) for m in range(self.M)))

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        return np.ones(self.grid.shape, dtype=bool)

    def log_likelihood(self, taps: ArrayLike) -> NDArray[np.float64]:
        return self.known[np.asarray(taps)[:, 0, 0].astype(int)]

    def judging(self, _: TapSet) -> Self:
        return self

    def check_taps(self, preprocessing: Preprocessing) -> None:
        assert preprocessing == self.preprocessing

    def taps_of(self, where: Classes, what: Classes) -> TapSet:
        """The first taps, of these classes."""
        return TapSet.from_arrays(
            np.arange(len(where), dtype=float)[:, np.newaxis, np.newaxis],
            np.asarray(what),
            self.grid.what_name,
            preprocessing=self.preprocessing,
            where=self.grid.where_value[np.asarray(where)],
            where_value=self.grid.where_value,
            where_unit="mm",
        )
