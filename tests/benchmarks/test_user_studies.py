"""The studies of users' models run, and tell what they should from what they are given."""

import jax
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpyro.contrib.funsor import enum, log_density
from numpyro.handlers import block, substitute
from scipy.special import logsumexp
from scipy.stats import laplace, norm
from solidtouch.models.measurement.generic import fit as fits
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings

from benchmarks.studies.models import new_sessions, recovery, sbc, svi_rule, user_sbc, user_stories


def test_draws_of_new_sessions_are_judged_by_exact_integrals():
    """Where an episode tells nothing there is no error."""
    found = new_sessions.errors(2, 0, ratios=(1e-9, 2.0), draws=(64, 16))

    own = [(far, ratio, draws) for far in (False, True) for ratio in (1e-9, 2.0) for draws in (64, 16)]
    assert [one[1:4] for one in found] == own
    assert max(one.error for one in found if one.ratio < 1) < 1e-9
    assert max(one.said for one in found if one.ratio < 1) < 0.2
    assert 0 < found[2].error < found[3].error < 1
    assert "| 2 | drawn | 2 |" in new_sessions.shown(found)
    assert "times as large" in new_sessions.within(found)


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


@pytest.mark.slow
def test_a_session_is_integrated_over_its_shift(shifted, rng, monkeypatch):
    """As by quadrature, and not tap by tap."""
    fitted, taps = shifted
    model, values = fitted.model, known(None, None).values
    session = taps.select(taps.session == 1)
    own = session.indices(model.grid)
    shifts = np.linspace(-4, 4, 81)

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


@pytest.mark.slow
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


# Simulation-based calibration --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", user_sbc.STORIES)
def test_the_log_density_by_hand_is_that_of_the_story(name):
    begun = user_sbc.fit_of(name, user_sbc.SIZES)
    drawn, samples = sbc.from_story(lambda: begun.story(begun.batch), 3, 1)
    parameters = {key: drawn[key][0].astype(float) for key in begun.names}
    found = user_sbc.quantities((begun.batch.where, begun.batch.what), parameters, samples[0])
    with jax.enable_x64(True), enum(first_available_dim=-8):
        own = block(substitute(begun.summed, data=parameters), hide=list(begun.names))
        expected = log_density(own, (samples[0].astype(float),), {}, {})[0]

    assert found["log likelihood"] == pytest.approx(float(expected), rel=1e-9)


@pytest.mark.slow
def test_weighted_draws_from_the_prior_have_the_moments_of_the_posterior(rng, monkeypatch):
    """As by quadrature, for each of two cells."""
    monkeypatch.setattr(user_sbc, "WEIGHTED", 200_000)
    sizes = sbc.Sizes(L=1, M=2, J=5, K=1, repeats=3)
    own = sbc.own_classes(sizes)
    samples = rng.laplace(np.where(own[1] == 0, 1.0, -2.0)[:, None, None], 0.8, size=(6, 5, 1))
    found = user_sbc.Weighted.of(user_sbc.prior_of_cell("laplace"), own, sizes, samples)
    loc, log_scale = np.meshgrid(np.linspace(-6, 6, 601), np.linspace(-4, 4, 401), indexing="ij")
    drawn = [found.draw(rng) for _ in range(1000)]
    for m in range(2):
        x = samples[own[1] == m].ravel()
        density = norm.logpdf(loc, 0, 3) + norm.logpdf(log_scale)
        density += sum(laplace.logpdf(value, loc, np.exp(log_scale)) for value in x)
        weight = np.exp(density - logsumexp(density))
        mean = (weight * loc).sum()
        spread = np.sqrt((weight * (loc - mean) ** 2).sum())
        assert found.point()["loc"][0, m, 0] == pytest.approx(mean, abs=0.03)
        each = np.array([one["loc"][0, m, 0] for one in drawn])
        assert each.mean() == pytest.approx(mean, abs=0.1 * spread + 0.03)
        assert each.std() == pytest.approx(spread, rel=0.15)
    assert found.convergence().converged


@pytest.mark.slow
@pytest.mark.parametrize("method", user_sbc.METHODS)
def test_ranks_of_a_users_model_are_those_of_its_fit(method, monkeypatch):
    """And one program serves all data sets."""
    monkeypatch.setattr(sbc, "DRAWS", 19)
    converged = []
    study = user_sbc.study("laplace", method, user_sbc.SIZES, converged)
    result = sbc.run(study, 30, 5)
    band = sbc.simultaneous_band(30)

    assert all(sbc.p_values(rank, band)[0] > 1e-4 for rank in result.rank.values())
    assert np.mean(converged) > 0.8
    assert [len(rank) for rank in user_sbc.only(result, np.arange(30) < 20).rank.values()] == [20] * 5


# The rule of variational fits --------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_fit_that_has_hardly_begun_is_far_from_the_long_one(monkeypatch):
    for name, value in {"_AT_ONCE": 20, "TRIED": 20, "STEPS": 40, "_WINDOW": 10, "RUNS": 2, "STARTS": 1}.items():
        monkeypatch.setattr(fits, name, value)
    monkeypatch.setattr(svi_rule, "LONG", 6)
    first, second = svi_rule.run(svi_rule.from_prior("walk", svi_rule.FEW, 1, 2), 2)

    assert [len(one.gap) for one in (first, second)] == [2, 2]
    assert first.gap != second.gap
    for one in (first, second):
        assert 0 < one.gap[1] < one.gap[0]
        assert 0 < one.distance[1] < one.distance[0]


def ended(change, gap):
    return svi_rule.Ended("a", "prior", change, 0.15, gap, [2.0, 1.0])


def test_what_the_rule_calls_is_counted():
    """Rightly converged, too early, and converged but not called so."""
    right, early, late = ended([0.1, 0.1], [0.05, 0.1]), ended([0.9, 0.1], [2.0, 0.7]), ended([0.8, 0.4], [0.3, 0.02])
    line = svi_rule.result_table([right, early, late]).splitlines()[-1]
    none, half, two_thirds = "0.000 [0.000, 0.658]", "0.500 [0.095, 0.905]", "0.667 [0.208, 0.939]"

    assert [(one.end, one.converged) for one in (right, early, late)] == [(0, True), (1, True), (1, False)]
    assert [part.strip() for part in line.split("|")[3:-1]] == [
        *("3", two_thirds, half, half, half),
        *("1.7", "0.375, 0.70", "1.00"),
    ]
    assert none in svi_rule.result_table([right, right]).splitlines()[-1]


def test_a_looser_limit_ends_fits_earlier():
    former, now, half = svi_rule.limits_table([ended([0.4, 0.1], [0.9, 0.05])]).splitlines()[2:]

    assert "| 1.0 | 0.900, 0.90 | 2.00 |" in former
    assert "| 2.0 | 0.050, 0.05 | 1.00 |" in now
    assert "0.000 [0.000, 0.793]" in half
