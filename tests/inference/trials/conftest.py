"""Taps for trials: of unequal classes."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from solidtouch.models.measurement.histogram import HistogramModel
from solidtouch.models.taps import TapSet


@pytest.fixture(scope="session")
def taps_of_counts(draw_samples) -> Callable[[HistogramModel, NDArray[np.int64]], TapSet]:
    """A function that draws so many taps of each class, in an order in which no class is together."""

    def draw(model: HistogramModel, count: NDArray[np.int64]) -> TapSet:
        cells = np.repeat(np.argwhere(count >= 0), count.ravel(), axis=0)
        cells = np.random.default_rng(0).permutation(cells)
        return TapSet.from_arrays(
            np.concatenate([draw_samples(model, 1, i, l, m) for i, (l, m) in enumerate(cells)]),
            cells[:, 1],
            model.grid.what_name,
            preprocessing=model.preprocessing,
            where=model.grid.where_value[cells[:, 0]],
            where_value=model.grid.where_value,
            where_unit="mm",
        )

    return draw
