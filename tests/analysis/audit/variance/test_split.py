"""What the taps of one class and session share."""

import numpy as np
from numpy.testing import assert_allclose
from solidtouch.analysis.audit.variance.classes import EvidenceClass
from solidtouch.analysis.audit.variance.split import SharedEvidence

SESSIONS, TAPS = 4, 12


def one_class():
    """Four sessions of twelve taps whose halves are quarters in turn; nothing is explained."""
    session = np.repeat(np.arange(SESSIONS), TAPS)
    half = np.tile(np.arange(TAPS) // 3 % 2, SESSIONS)
    stratum, member = 2 * session + half, np.arange(len(session))
    return EvidenceClass(0, member, stratum, session, half, stratum, member, np.zeros((len(session), 0)))


def test_taps_are_compared_within_their_session_and_half():
    """The halves of the training session judge each other, so a pair of both would be alike in it for that alone."""
    one = one_class()
    far, near = SharedEvidence.of(one).forms
    first, second = np.nonzero(far | near)
    assert len(first)
    assert (one.half[first] == one.half[second]).all()
    assert (one.session[first] == one.session[second]).all()
    distance = np.abs(first - second)
    assert (distance[far[first, second]] >= TAPS / 4).all()
    assert (distance[near[first, second]] < TAPS / 4).all()
    only = SharedEvidence.of(one, 1).forms.any(axis=0)
    assert (one.half[np.nonzero(only)[0]] == 1).all()


def test_the_variance_between_sessions_is_right_on_average():
    """Of sessions with variance 4 and taps with variance 1; neighbours share nothing more."""
    one, generator = one_class(), np.random.default_rng(1)
    shared = SharedEvidence.of(one)
    totals = 2.0 * generator.standard_normal((4000, SESSIONS))[:, one.session]
    totals += generator.standard_normal(totals.shape)
    session, serial = np.mean([shared.variances(total, 1.0) for total in totals], axis=0)
    assert_allclose(session, 4.0, rtol=0.06)
    assert_allclose(serial, 0.0, atol=0.03)
