"""The studies of users' models run, and tell what they should from what they are given."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from scipy.stats import norm
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings

from benchmarks.studies.models import recovery, user_stories


class Known:
    """A posterior of one value."""

    def __init__(self, values):
        self.values = values

    def point(self):
        return self.values

    def draw(self, _):
        return self.values

    def convergence(self):
        return fits.Convergence(True, "Known.", {})


def known(_, __):
    """In place of a fit: 2 positions, 1 object, 1 taxel, 2 sessions."""
    return Known(
        {
            "loc": np.array([[[0.3]], [[-0.5]]]),
            "scale": np.array([[[0.8]], [[1.2]]]),
            "drift": np.array(0.9),
            "shift": np.array([[0.4], [-0.2]]),
        }
    )


@pytest.fixture(scope="module")
def shifted(make_taps):
    """A model of shifted sessions at known values, and taps."""
    user_stories.registered()
    taps = make_taps(L=2, M=1, J=3, K=1, sessions=2, repeats=5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fits, "posterior", known)
        patch.setattr(fits, "check_prior", lambda _: "")
        return fit_model("shifted", taps, taps.grid(), FitSettings(bins=30)), taps


# Recovery ----------------------------------------------------------------------------------------------------------


def test_a_session_is_integrated_over_its_shift(shifted, rng, monkeypatch):
    """As by quadrature, and not tap by tap."""
    fitted, taps = shifted
    model, values = fitted.model, known(None, None).values
    session = taps.select(taps.session == 1)
    own = session.indices(model.grid)
    shifts = np.linspace(-4, 4, 241)

    def at(shift):
        latents = values | {"shift": np.append(values["shift"], [[shift]], axis=0)}
        return model.by_story(latents)[0].own(session.taps, model.edges, *own)

    each, step = np.array([at(shift) for shift in shifts]), np.log(shifts[1] - shifts[0])
    prior = norm.logpdf(shifts, 0, 0.9) + step
    expected = logsumexp(each.sum(axis=1) + prior)
    monkeypatch.setattr(user_stories, "_DRAWS", 2)
    monkeypatch.setattr(user_stories, "_STATES", 300)

    assert recovery.session_score(fitted, session, rng) == pytest.approx(expected, abs=0.1)
    assert abs(logsumexp(each + prior[:, None], axis=0).sum() - expected) > 1


def test_a_simulated_session_has_one_shift_for_all_classes(shifted, rng):
    fitted, taps = shifted
    source = recovery.Source("shifted", fitted, taps, taps.grid())
    truth = user_stories.own_quantities(fitted.model, fitted.posterior.point())
    shifts = []
    for number in range(4):
        drawn = recovery.simulated(source, fitted.posterior.point(), 200, number, rng)
        where, _ = drawn.indices(taps.grid())
        mean = np.array([drawn.taps[where == l].mean() for l in range(2)])
        shifts.append((mean - truth["loc"].ravel()) / truth["drift"])

    assert set(truth) == {"loc", "scale", "drift"}
    assert_allclose(*np.transpose(shifts), atol=0.2)
    assert np.std(shifts) > 0.2


@pytest.mark.slow
def test_taps_of_a_users_model_are_won_by_it():
    names = user_stories.registered()
    sizes = recovery.Sizes(positions=2, rods=2, step=10, every=6, sessions=2, repeats=6)
    (source,) = recovery.sources(["walk"], sizes, 1)
    found = recovery.replicate(source, [*names[::2], "gaussian"], sizes, 1, 0)

    assert max(found.scores, key=found.scores.__getitem__) == "walk"
    assert found.covered["scale"][1] == 2 * 2 * 2
