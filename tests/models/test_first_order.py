"""Filters of first order against SciPy's."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import butter, lfilter, lfilter_zi
from solidtouch.models.first_order import FirstOrder


@given(rate_hz=st.floats(1.0, 1e4), share=st.floats(1e-4, 0.49), seed=st.integers(0, 99))
def test_the_highpass_filter_is_the_butterworth_filter(rate_hz, share, seed):
    """From its steady state at the first sample on."""
    signal = np.random.default_rng(seed).normal(size=(20, 3))
    b, a = butter(1, share * rate_hz, "highpass", fs=rate_hz)
    expected, end = lfilter(b, a, signal, axis=0, zi=lfilter_zi(b, a)[:, np.newaxis] * signal[0])
    highpass = FirstOrder.highpass(share * rate_hz, rate_hz)
    state = highpass.before * signal[0]

    np.testing.assert_allclose(highpass(signal, state), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state, end[0], rtol=0, atol=1e-12)


@given(cut=st.integers(0, 20), decay=st.floats(0.0, 1.0))
def test_a_signal_may_be_cut_anywhere(cut, decay):
    signal = np.random.default_rng(0).normal(size=(20, 2))
    recursion, state, other = FirstOrder(1 - decay, 0.0, decay), np.zeros(2), np.zeros(2)
    whole = recursion(signal, state)

    parts = [recursion(part, other) for part in (signal[:cut], signal[cut:])]

    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(state, other)
    np.testing.assert_array_equal(whole, lfilter([1 - decay], [1.0, -decay], signal, axis=0))
