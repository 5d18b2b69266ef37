"""Beliefs over hypotheses folded into objects."""

import numpy as np
import pytest
from solidtouch.models.measurement.states import fold, log_fold


@pytest.mark.parametrize("states", [1, 4])
def test_states_of_an_object_add_up(rng, states):
    L, M = 3, 2
    belief = rng.random((5, L, states * M))
    folded = np.zeros((5, L, M))
    for h in range(states * M):
        folded[:, :, h % M] += belief[:, :, h]

    np.testing.assert_allclose(fold(belief, M), folded)
    np.testing.assert_allclose(np.exp(log_fold(np.log(belief), M)), folded)
