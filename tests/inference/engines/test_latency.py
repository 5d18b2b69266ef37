"""Timing of engines."""

from itertools import product

import numpy as np
import pytest
from slow_cases import slow_but
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.engines.latency import TimedEngine, _likely_tap, warm_up
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings


@pytest.mark.parametrize("name", ["numpy", "numpyro", "filter"])
@pytest.mark.parametrize("options", [{}, {"pseudocount": 0.0, "value_range": "taxel"}, {"untrained": [(0, 0)]}])
def test_every_model_can_be_warmed_up(make_model, name, options):
    """With a tap that no model holds for impossible."""
    assert warm_up(make_engine(name, make_model(**options))) > 0


@pytest.mark.parametrize(
    ("kind", "name"),
    slow_but(
        [("profile-mvn", "numpy"), ("session", "filter"), ("session:profile", "numpyro")],
        [
            *product(["gaussian", "profile-mvn", "session", "session:profile"], ["numpy", "filter"]),
            ("session:profile", "numpyro"),  # compiled for every form; tables are warmed up above
        ],
    ),
)
def test_models_of_the_catalogue_can_be_warmed_up(make_taps, name, kind):
    """With a tap that the first class finds likely, so that no evidence is far from the training taps'."""
    taps = make_taps(J=5, K=4, L=3, M=2)
    model = fit_model(kind, taps, taps.grid(), FitSettings(bins=9)).model
    likely = model.log_likelihood(_likely_tap(model)[None]).max()

    assert likely > model.log_likelihood(taps.taps).max(axis=(1, 2)).max()
    assert warm_up(make_engine(name, model)) > 0


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
