"""Small recorded episodes, made with the equations in plain NumPy."""

import numpy as np
import pytest
from solidtouch.analysis.live.ending import ending_of
from solidtouch.analysis.live.saved import header_of, recorded
from solidtouch.analysis.live.view import Seen
from solidtouch.hardware.named_rigs import Truth
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import steps
from solidtouch.inference.moves.control import fixation

HOSTILE = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="session")
def seen_episodes(make_taps, make_model):
    """A function that plays episodes and returns the steps of each, with endings and header."""

    def make(L=4, M=3, J=6, K=5, episodes=2, deadline=5, names=None, theta=1.0, **more):
        model = make_model(L, M, K, J)
        grid = model.grid
        if names is not None:
            grid = type(grid)(grid.where_value, grid.where_unit, None, tuple((name,) for name in names))
        taps, endings = [], []
        rng = np.random.default_rng(L + M + K)
        for number in range(episodes):
            recording = make_taps(L, M, J, K, repeats=2, seed=number, preprocessing=model.preprocessing)
            rig = ReplayRig(recording, recording.grid(), L - 1, number % M)
            made = steps(rig, make_engine("numpy", model), theta, fixation(L // 2), deadline)
            own = [Seen(step, grid, theta, L // 2, float(rng.uniform(0.001, 1))) for step in made]
            taps.append(own)
            endings.append(
                ending_of(own[-1], Truth(grid.what_name[number % M], float(grid.where_value[rig.where_index])))
            )
        header = header_of(
            "a rig, engine numpy", grid, model.preprocessing, K, theta=0.95, fixation=L // 2, deadline=deadline, **more
        )
        return header, taps, endings

    return make


@pytest.fixture(scope="session")
def episodes(seen_episodes):
    """Two recorded episodes of five taps, 4 x 3 classes, one name of which contains HTML."""
    return recorded(*seen_episodes(names=["ball", HOSTILE, "rod"], seed=3))
