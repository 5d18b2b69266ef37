"""Exponentials and logarithms of compiled loops against NumPy."""

import numpy as np
import pytest
from solidtouch.models.compiled import compiled
from solidtouch.models.elementary import LEAST, exponential, log_one_plus, logarithm


@compiled
def exponentials(x, out):
    for i in range(x.size):
        out[i] = exponential(x[i])


@compiled
def logarithms(x, out):
    for i in range(x.size):
        out[i] = logarithm(x[i])


@compiled
def logarithms_of_one_plus(x, out):
    for i in range(x.size):
        out[i] = log_one_plus(x[i])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_exponentials_are_those_of_numpy(rng):
    """From the least to 1, and close to 0."""
    x = np.concatenate([[LEAST, 0.0], rng.uniform(LEAST, 700, 5000), rng.normal(size=5000)])
    out = np.empty_like(x)
    exponentials(x, out)

    assert (np.abs(out / np.exp(x) - 1) <= (4 + np.abs(x)) * 1e-16).all()


def test_logarithms_are_those_of_numpy(rng):
    """From the smallest normal number on, and around 1."""
    ends = [np.finfo(float).tiny, 1.0, np.finfo(float).max]
    x = np.concatenate([ends, np.exp(rng.uniform(-708, 709, 5000)), rng.uniform(0.5, 2, 5000)])
    out = np.empty_like(x)
    logarithms(x, out)

    np.testing.assert_allclose(out, np.log(x), rtol=4e-16, atol=0)


def test_logarithms_of_one_plus_small_numbers_keep_their_digits(rng):
    x = np.concatenate([[0.0, 1e-300, 1e300], np.exp(rng.uniform(-700, 700, 5000)), rng.uniform(0, 2, 5000)])
    out = np.empty_like(x)
    logarithms_of_one_plus(x, out)

    np.testing.assert_allclose(out, np.log1p(x), rtol=4e-16, atol=0)
