"""Programs that fits share."""

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.generic import programs
from solidtouch.models.measurement.generic.programs import compiled_once
from solidtouch.models.measurement.registry import fit_model, model_name
from solidtouch.models.settings import FitSettings


@pytest.fixture
def compiled(monkeypatch):
    """How often something is compiled, from an empty memory."""
    monkeypatch.setattr(programs, "_KEPT", {})
    count = []
    compile_ = jax.stages.Lowered.compile
    monkeypatch.setattr(jax.stages.Lowered, "compile", lambda lowered: count.append(1) or compile_(lowered))
    return count


def times(factor):
    return compiled_once(lambda values: {"product": factor * values})


def test_functions_that_do_the_same_share_a_program(compiled):
    first, second = times(2.0), times(2.0)
    for function in (first, second, first):
        np.testing.assert_array_equal(function(np.arange(3.0))["product"], [0.0, 2.0, 4.0])

    assert len(compiled) == 1


@pytest.mark.parametrize("size", [1, 5000])
def test_other_constants_and_shapes_make_another_program(compiled, size):
    """Also long arrays that differ in one place."""
    long = np.zeros(size)
    for factor in (long, np.where(np.arange(size) == size // 2, 1.0, 0.0)):
        np.testing.assert_array_equal(times(factor)(np.ones(size))["product"], factor)
    assert len(compiled) == 2
    times(1.0)(np.ones(size + 1))
    times(1.0)(np.ones(size + 2))
    assert len(compiled) == 4


def test_arguments_that_are_not_used_make_another_program(compiled):
    first, second = (compiled_once(function) for function in (lambda a, _: a, lambda _, b: b))
    pair = np.zeros(2), np.ones(2)
    assert (first(*pair).sum(), second(*pair).sum()) == (0.0, 2.0)
    longer = compiled_once(lambda a, _: a)
    assert longer(np.zeros(2), np.ones(3)).shape == (2,)
    assert len(compiled) == 3


def level(where, what, taps=None, *, L, M, J, K):
    with numpyro.plate("L", L, dim=-2), numpyro.plate("M", M, dim=-1):
        loc = numpyro.sample("loc", dist.Normal(0.0, 3.0))
    with numpyro.plate("tap", len(where), dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("K", K, dim=-1):
        numpyro.sample("taps", dist.Normal(loc[where, what][:, None, None], 1.0), obs=taps)


def test_fits_of_folds_of_equal_size_share_their_programs(compiled, make_taps, monkeypatch):
    """Whatever their classes are; and each finds its own levels."""
    monkeypatch.setattr(fits, "STEPS", 200)
    monkeypatch.setattr(fits, "_AT_ONCE", 200)
    taps = make_taps(2, 2, 3, 2)
    turned = taps.__class__(taps.dataset.assign(what=("tap", 1 - taps.dataset["what"].values)))
    settings = FitSettings(bins=9, power="none", method="map", unconverged=True, steps=200)
    one, other = (
        fit_model(model_name(level), each, taps.grid(), settings).model.parameters["loc"] for each in (taps, turned)
    )

    assert len(compiled) == 3  # what looks at the prior, begins and goes on
    np.testing.assert_allclose(other, one[:, ::-1], atol=0.4)
    assert np.abs(np.diff(one, axis=1)).min() > 1.5


def test_the_latest_programs_are_kept(compiled, monkeypatch):
    monkeypatch.setattr(programs, "_MOST", 2)
    for factor in (1.0, 2.0, 1.0, 3.0, 1.0):
        times(factor)(np.ones(2))
    assert len(compiled) == 3
    times(2.0)(np.ones(2))
    assert len(compiled) == 4
