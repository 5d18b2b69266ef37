"""What several folders of tests share: one random generator, recorded data, and small tap sets."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(2013)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recorded data beside the repository, or a skip."""
    folder = Path(__file__).parents[1].parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder ../shared/data with recorded taps is not there")
    return folder


@pytest.fixture(scope="session")
def make_taps() -> Callable[..., TapSet]:
    """A function that makes small random tap sets with pairwise different sizes, classes interleaved."""

    def make(
        L: int = 3, M: int = 4, J: int = 6, K: int = 5, sessions: int = 2, repeats: int = 7, seed: int = 0, **more
    ) -> TapSet:
        rng = np.random.default_rng(seed)
        session, _, where, what = (index.reshape(-1) for index in np.indices((sessions, repeats, L, M)))
        taps = rng.normal(size=(len(what), J, K)) + where[:, None, None] + 3 * what[:, None, None]
        arguments = {
            "where": 1.5 * where,
            "where_value": 1.5 * np.arange(L),
            "where_unit": "mm",
            "session": session,
            "trial": np.concatenate([np.arange(L * M * repeats)] * sessions),
            "preprocessing": Preprocessing(samples=J, rate_hz=50.0),
            **more,
        }
        return TapSet.from_arrays(taps, what, [f"rod {2 + 2 * m} mm" for m in range(M)], **arguments)

    return make
