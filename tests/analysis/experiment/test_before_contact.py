"""Where classes do not part at the beginning of taps."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.analysis.experiment.before_contact import leading_samples
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import ICUB_FINGERTIP, PAPER_RODS, preset

M, J, K, N = 4, 7, 5, 12


def drifting(contact, noise, n=40):
    """Taps and objects; objects differ by their level throughout, and from sample `contact` on by touch."""
    rng = np.random.default_rng(11)
    what = np.repeat(np.arange(M), n)
    level, touch = rng.normal(size=(2, M, 1, K))
    pressed = (np.arange(J) >= contact)[:, None]
    return noise * rng.normal(size=(len(what), J, K)) + 3 * level[what] + pressed * (8 + 8 * touch[what]), what


@pytest.mark.parametrize("contact", [2, 3, 5])
@pytest.mark.parametrize("noise", [0.01, 0.3, 1.0])
def test_samples_before_contact_end_where_classes_part(contact, noise):
    """A fifth earlier, to be sure; noise does not move the place, and neither does a level that objects start from."""
    lead = leading_samples(*drifting(contact, noise))

    assert (lead.samples, lead.kind) == (np.ceil(0.8 * contact), "stretch")
    assert lead.class_change[contact] > 0.3
    assert np.abs(lead.class_change[:contact]).max() < 1e-3


def test_a_press_that_rises_at_once_leaves_the_first_sample(rng):
    """Classes part from the second sample on, a little at a time."""
    what = np.repeat(np.arange(M), N)
    rise = np.arange(9.0)[:, None] * rng.normal(size=(M, 1, K))[what]
    lead = leading_samples(rise + 0.01 * rng.normal(size=rise.shape), what)

    assert (lead.samples, lead.kind) == (1, "first sample")


def test_exchangeable_samples_have_none_before_contact(rng):
    """So it is with taps drawn from a model of the paper's kind, and with one sample per tap."""
    what = np.repeat(np.arange(M), N)
    samples = rng.normal(size=(M * N, 6, K)) + 5.0 * what[:, None, None]

    assert leading_samples(samples, what)[:2] == (0, "none")
    assert leading_samples(samples[:, :1], what)[:2] == (0, "none")
    assert leading_samples(np.ones_like(samples), what)[:2] == (0, "none")


def test_without_repeated_classes_noise_counts_as_change(rng):
    """A stretch is then found too short rather than too long."""
    samples = 0.1 * rng.normal(size=(8, 6, K))
    samples[:, 4:] += 10.0

    assert leading_samples(samples, np.arange(8))[:2] == (4, "stretch")
    assert leading_samples(samples + 2 * rng.normal(size=samples.shape), np.arange(8)).samples < 4


def test_contact_of_the_rig_begins_after_the_leading_samples():
    """The finger touches after 0.25 s, which is sample 12.5."""
    rig = replace(preset("paper"), rods=PAPER_RODS[::2], taxels=ICUB_FINGERTIP[::2], start_mm=6.0, end_mm=10.0)
    for changes in ({}, {"highpass_hz": 0.0}, {"common_noise_counts": 6.0}):
        taps = simulate_session(replace(rig, **changes), 4, 0)
        where, what = taps.indices(taps.grid())
        assert 5 <= leading_samples(taps.taps, where * 3 + what).samples <= 12
