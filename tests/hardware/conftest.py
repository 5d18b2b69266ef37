"""Small rigs: sizes pairwise different, so that a swapped axis cannot pass."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.presets import PRESETS
from solidtouch.hardware.simulation_settings import PAPER_RODS
from solidtouch.models.classes import ClassGrid

WITHOUT_NOISE = {"white_counts": 0.0}


@pytest.fixture
def small():
    """The paper's rig with 2 rods, 4 where classes around the centre and 5 taps of 10 samples in each."""
    return replace(
        PRESETS["paper"], rods=PAPER_RODS[:2], start_mm=6.0, end_mm=10.0, spacing_mm=0.2, rate_hz=10.0, lag_s=0.02
    )


@pytest.fixture
def exact():
    """The preset `ideal` without its white noise."""
    return replace(PRESETS["ideal"], **WITHOUT_NOISE)


@pytest.fixture
def grid():
    """5 where classes of 1 mm and 2 what classes."""
    edges = np.arange(6.0)
    return ClassGrid(edges[:-1] + 0.5, "mm", edges, (("thin",), ("thick",)), np.array([4.0, 12.0]), "mm")


@pytest.fixture
def rng():
    return np.random.default_rng(20)
