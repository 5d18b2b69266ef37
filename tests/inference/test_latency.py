"""Timing of engines."""

import numpy as np
import pytest
from solidtouch.inference.engine import make_engine
from solidtouch.inference.latency import TimedEngine, warm_up


@pytest.mark.parametrize("name", ["numpy", "numpyro", "filter"])
@pytest.mark.parametrize("options", [{}, {"pseudocount": 0.0, "value_range": "taxel"}, {"untrained": [(0, 0)]}])
def test_every_model_can_be_warmed_up(make_model, name, options):
    """With a tap that no model holds for impossible."""
    assert warm_up(make_engine(name, make_model(**options))) > 0


def test_a_model_of_one_class_can_be_warmed_up(make_model):
    assert warm_up(make_engine("filter", make_model(L=1, M=1, K=1, J=1, B=1))) > 0


def test_timing_changes_no_belief(make_model, draw_samples):
    """A tap is its update and the shift after it."""
    model = make_model()
    engine, timed = make_engine("numpy", model), TimedEngine(make_engine("numpy", model))
    log_belief = model.log_prior
    for tap in draw_samples(model, 4):
        expected, evidence = engine.update(log_belief, tap)
        log_belief, timed_evidence = timed.update(log_belief, tap)
        np.testing.assert_array_equal(log_belief, expected)
        assert timed_evidence == evidence
        log_belief = timed.shift(log_belief, 1)
    latency = timed.latency()

    assert (timed.name, timed.model, latency.taps) == ("numpy", model, 4)
    assert 0 < latency.median_ms <= latency.high_ms
