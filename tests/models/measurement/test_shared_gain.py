"""Unknown gains and offsets: their grid, and how far training sessions show them to differ."""

import numpy as np
import pytest
from scipy import stats
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.measurement.shared_gain import GAINS, OFFSETS, SessionSpread, session_spread, state_grid
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.settings import FitSettings
from solidtouch.models.taps import TapSet

L, M, J, K, N = 4, 3, 6, 5, 9
EDGES = np.linspace(-10.0, 15.0, 51)  # bins of half a unit


@pytest.fixture(scope="module")
def sessions():
    """A function that makes sessions of taps with gains and offsets of their own."""

    def make(gains, offsets, noise=0.3, repeats=N, seed=0):
        rng = np.random.default_rng(seed)
        shape = 3 * rng.normal(size=(L, M, J, K)) + 2
        session, _, where, what = (i.ravel() for i in np.indices((len(gains), repeats, L, M)))
        samples = shape[where, what] + noise * rng.normal(size=(len(where), J, K))
        samples = np.asarray(gains)[session, None, None] * samples + np.asarray(offsets)[session, None, None]
        return TapSet.from_arrays(
            samples,
            what,
            [f"rod {m}" for m in range(M)],
            preprocessing=Preprocessing(samples=J),
            where=where.astype(float),
            session=session,
        )

    return make


# The grid


def test_the_grid_has_normal_weights_over_log_gain_and_offset():
    """Seven gains by three offsets, to two standard deviations; weights sum to one."""
    states = state_grid(0.1, 0.4)
    z = np.stack([np.log(states.gain) / 0.1, states.offset / 0.4], axis=1)

    assert len(states.gain) == 21
    assert np.exp(states.log_prior).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.unique(np.round(z[:, 0], 12)), np.linspace(-2, 2, 7), atol=1e-12)
    np.testing.assert_allclose(np.unique(np.round(z[:, 1], 12)), [-2, 0, 2], atol=1e-12)
    np.testing.assert_allclose(np.ptp(states.log_prior + 0.5 * (z**2).sum(axis=1)), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("spread", "points", "left"), [((0.0, 0.4), (7, 3), 21), ((0.1, 0.0), (5, 3), 15), ((0.0, 0.0), (7, 3), 1)]
)
def test_what_does_not_vary_leaves_its_points_to_the_other(spread, points, left):
    states = state_grid(*spread, *points)

    assert len(np.unique(np.stack(states[:2]), axis=1).T) == left
    assert spread[0] > 0 or (states.gain == 1).all()
    assert spread[1] > 0 or (states.offset == 0).all()
    assert left == 1 or np.abs(np.log(states.gain) / (spread[0] or 1) + states.offset / (spread[1] or 1)).max() == (
        pytest.approx(2.5)
    )


@pytest.mark.parametrize("arguments", [(-0.1, 0.1), (0.1, -0.1), (np.nan, 0.1), (0.1, np.inf), (0.1, 0.1, 0)])
def test_spreads_below_0_are_refused(arguments):
    with pytest.raises(InputError, match="gain_sd and offset_sd must not be negative, got"):
        state_grid(*arguments)


# Their spread


@pytest.mark.parametrize("noise", [0.1, 3.0])
def test_planted_spreads_are_recovered(sessions, noise):
    """Over 40 sessions, within a third, also where a tap is as much noise as signal."""
    rng = np.random.default_rng(3)
    gains, offsets = np.exp(0.08 * rng.normal(size=40)), 0.5 * rng.normal(size=40)
    gain_sd, offset_sd, *_ = session_spread(sessions(gains, offsets, noise), sessions(gains, offsets).grid(), EDGES)

    assert gain_sd == pytest.approx(0.08, rel=0.34)
    assert offset_sd == pytest.approx(0.5, rel=0.34)


@pytest.mark.parametrize("count", [2, 5])
def test_noise_is_not_taken_for_a_gain(sessions, count):
    """Sessions that differ by noise alone have gains within a few per cent, though noise flattens a plain line."""
    found = [
        session_spread(taps := sessions([1.0] * count, [0.0] * count, 3.0, seed=seed), taps.grid(), EDGES)[0]
        for seed in range(6)
    ]

    assert np.mean(found) < 0.06


def test_two_sessions_differ_by_root_two_times_their_spread(sessions):
    """Log gains of plus and minus g are a spread of root two times g with the mean known to be 0."""
    taps = sessions([np.exp(0.1), np.exp(-0.1)], [0.0, 0.0], 0.01)

    assert session_spread(taps, taps.grid(), EDGES)[0] == pytest.approx(np.sqrt(2) * 0.1, rel=0.01)


def test_a_single_session_has_spreads_that_stand_in(sessions):
    """Five per cent and half a bin; the same where no class is in two sessions, or no class has two taps."""
    one = sessions([1.3], [0.0])
    two = sessions([1.3, 1.0], [0.0, 1.0])
    apart = two.select((two.session == 0) == (two.what == 0))
    single = sessions([1.3, 1.0], [0.0, 1.0], repeats=1)

    for taps in (one, apart, single):
        assert session_spread(taps, two.grid(), EDGES)[:2] == pytest.approx((0.05, 0.25))


def test_constant_taps_have_an_offset_and_no_gain(sessions):
    """Which a line could not tell apart."""
    taps = sessions([1.0, 1.0], [0.0, 0.0])
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"][:] = np.where(taps.session == 0, 4.0, 5.0)[:, None, None]
    gain_sd, offset_sd, *_ = session_spread(TapSet(dataset), taps.grid(), EDGES)

    assert gain_sd == 0
    assert offset_sd == pytest.approx(np.sqrt(0.5))


def test_the_model_takes_the_spread_of_its_training_sessions(sessions):
    """Unless it is given one; one alone is completed by what agrees with the sessions."""
    taps = sessions([1.1, 0.9, 1.0], [0.3, -0.3, 0.0])
    spread = session_spread(taps, taps.grid(), EDGES)

    def states(**given):
        return fit_model("session:gaussian", taps, taps.grid(), FitSettings(edges=EDGES, **given)).model.states

    for found, expected in zip(states(), spread.states(spread.layout()), strict=True):
        np.testing.assert_array_equal(found, expected)
    for found, expected in zip(states(gain_sd=0.2, offset_sd=0.0), state_grid(0.2, 0.0), strict=True):
        np.testing.assert_array_equal(found, expected)
    far = np.sqrt(1 + 1 / 3) * stats.t.ppf(stats.norm.cdf(2.5), 2)  # what is estimated is that of a fourth session
    assert np.log(states(offset_sd=0.0).gain).max() == pytest.approx(far * spread.about_zero(None, 0.0)[0])
    assert states(gain_sd=0.0).offset.max() == pytest.approx(far * spread.offset_sd)


# The level about which gains are


def test_the_zero_point_of_samples_does_not_matter(sessions):
    """Taps and edges moved by 1000 have the same likelihoods, with three sessions and with one."""
    for gains, offsets in (([1.1, 0.9, 1.0], [0.3, -0.3, 0.1]), ([1.0], [0.0])):
        taps = sessions(gains, offsets)
        moved = TapSet(taps.dataset.assign(taps=taps.dataset["taps"] + 1000))
        one, other = (
            fit_model("session", each, taps.grid(), FitSettings(edges=edges)).model.log_likelihood(each.taps)
            for each, edges in ((taps, EDGES), (moved, EDGES + 1000))
        )

        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_alike_sessions_have_small_offsets_far_from_zero(sessions):
    """Sampling errors of gain and offset, which cancel at the mean level, are not taken for differences."""
    found = [
        session_spread(taps := sessions([1.0] * 5, [100.0] * 5, 3.0, seed=seed), taps.grid(), EDGES + 100)
        for seed in range(6)
    ]

    # The mean of 540 taps of 30 samples with deviation 3 has an error of 0.05.
    assert np.mean([one.offset_sd for one in found]) < 0.05
    assert np.mean([one.gain_sd for one in found]) < 0.02


def test_gains_about_zero_are_found_far_from_it(sessions):
    """They move the mean level with the gain, and their states have hardly an offset."""
    gains = np.exp(0.08 * np.random.default_rng(3).normal(size=20))
    taps = sessions([1.0] * 20, [50.0] * 20)
    moved = TapSet(taps.dataset.assign(taps=taps.dataset["taps"] * gains[taps.session][:, None, None]))
    spread = session_spread(moved, taps.grid(), EDGES + 50)
    states = spread.states(spread.layout())

    assert spread.gain_sd == pytest.approx(0.08, rel=0.34)
    assert spread.correlation > 0.95
    assert np.abs(states.offset).max() < 0.05 * spread.level * np.ptp(states.gain)
    assert spread.about_zero(None, 0.0)[0] == pytest.approx(spread.gain_sd, rel=0.05)
    assert spread.about_zero(spread.gain_sd, None)[1] < 0.4 * spread.offset_sd


def test_two_sessions_say_nothing_of_a_correlation(sessions):
    """Two points are on a line whatever they are."""
    taps = sessions([1.1, 0.9], [0.5, -0.5])

    assert session_spread(taps, taps.grid(), EDGES).correlation == 0


def test_samples_of_a_tap_need_not_be_independent(sessions):
    """An error that all samples of a tap share is no offset of the session."""
    found = []
    for seed in range(6):
        taps = sessions([1.0] * 5, [0.0] * 5, seed=seed)
        shared = 3 * np.random.default_rng(seed).normal(size=(len(taps), 1, 1))
        together = TapSet(taps.dataset.assign(taps=taps.dataset["taps"] + shared))
        found.append(session_spread(together, taps.grid(), EDGES).offset_sd)

    # Means of 108 taps with deviation 3 have one of 0.29.
    assert np.mean(found) < 0.2


@pytest.mark.parametrize(("offset_sd", "correlation", "fewest"), [(0.5, 0.6, 7), (4.0, 0.99, 21)])
def test_states_have_the_covariance_of_sessions(offset_sd, correlation, fewest):
    """About the mean level, as closely as the grid has it; a short axis gives its points to the other."""
    spread = SessionSpread(0.1, offset_sd, correlation, 20.0, 5.0, sessions=10000)
    states = spread.states(spread.layout())
    found = np.stack([np.log(states.gain), states.offset + 20 * (states.gain - 1)])
    covariance = found * np.exp(states.log_prior) @ found.T

    assert len(states.gain) == GAINS * OFFSETS
    assert len(np.unique(found[1].round(9))) >= fewest
    assert np.exp(states.log_prior).sum() == pytest.approx(1.0)
    np.testing.assert_allclose(covariance, spread.covariance, rtol=0.25)


def test_few_sessions_have_wider_states():
    """As Student's t distribution has, which is normal with many sessions."""
    few, many = (SessionSpread(0.1, 0.0, sessions=n).layout().z.max() for n in (3, 10000))

    assert few > 10
    assert many == pytest.approx(2.5, rel=1e-3)


# The model behind


def noise_of(name, taps, **settings):
    """Mean standard deviation of samples of a class and time, in the unit of the samples."""
    model = fit_model(name, taps, taps.grid(), FitSettings(edges=EDGES, **settings)).model
    return float((np.sqrt(model.parameters["variance"]) * model.scaling.unit).mean())


@pytest.fixture(scope="module")
def apart(sessions):
    """Eight sessions whose gains and offsets differ much more than their taps."""
    rng = np.random.default_rng(5)
    return sessions(np.exp(0.2 * rng.normal(size=8)), 2 * rng.normal(size=8))


def test_variances_are_those_within_sessions(apart):
    """But for what the distance of states leaves of the differences."""
    within = np.mean([noise_of("profile", apart.select(apart.session == number)) for number in range(8)])
    pooled = noise_of("profile", apart)

    assert pooled > 4 * within
    assert within < noise_of("session:profile", apart) < within + 0.3 * (pooled - within)


def test_what_states_do_not_hold_stays_in_the_model_behind(sessions):
    """Offsets stay without states for offsets, gains without states for gains."""
    offsets = sessions([1.0] * 6, [-2.0, 2.0, -1.0, 1.0, 0.5, -0.5])
    gains = sessions(np.exp([-0.4, 0.4, -0.2, 0.2, 0.1, -0.1]), [0.0] * 6)

    for taps, without, enough in ((offsets, {"offset_sd": 0.0}, {"gain_sd": 0.0}), (gains, {"gain_sd": 0.0}, {})):
        left = noise_of("session:profile", taps, **without)
        assert left > 0.8 * noise_of("profile", taps)
        assert noise_of("session:profile", taps, **enough) < 0.5 * left


def test_sessions_of_unequal_size_come_to_rest_at_one_level(sessions):
    """Whatever their sizes, differences between them shrink alike."""
    taps = sessions([1.0] * 4, [3.0, 0.0, 1.0, -3.0], repeats=20)
    taps = taps.select((taps.session == 0) | (taps.trial % (7 * L * M) < L * M))
    spread = session_spread(taps, taps.grid(), EDGES)
    rest = spread.at_rest(taps, spread.layout())
    before, after = (np.ptp([each.taps[each.session == s].mean() for s in range(4)]) for each in (taps, rest))

    assert len(taps.select(taps.session == 0)) > 5 * len(taps.select(taps.session == 1))
    assert after < 0.25 * before


def test_alike_sessions_hardly_move(sessions):
    """By less than the errors of their means; a single session not at all."""
    alike, single = sessions([1.0] * 5, [0.0] * 5), sessions([1.0], [0.0])
    spread = session_spread(alike, alike.grid(), EDGES)

    np.testing.assert_allclose(spread.at_rest(alike, spread.layout()).taps, alike.taps, atol=0.3 / np.sqrt(N * L * M))
    assert spread.own.keys() == set(range(5))
    assert noise_of("session:profile", single) == noise_of("profile", single)


def test_the_unit_of_samples_does_not_matter(apart):
    """Taps and edges times 1000 have the same likelihoods."""
    larger = TapSet(apart.dataset.assign(taps=1000 * apart.dataset["taps"]))
    one, other = (
        fit_model("session", taps, taps.grid(), FitSettings(edges=edges)).model.log_likelihood(taps.taps)
        for taps, edges in ((apart, EDGES), (larger, 1000 * EDGES))
    )

    np.testing.assert_allclose(one, other, rtol=1e-9)


def test_samples_too_large_for_sums_of_squares_are_refused(apart):
    larger = TapSet(apart.dataset.assign(taps=1e120 * apart.dataset["taps"]))
    with np.errstate(all="ignore"), pytest.raises(InputError, match="too large to compare sessions"):
        session_spread(larger, larger.grid(), 1e120 * EDGES)


def test_default_bins_and_digests_are_those_of_the_taps_as_recorded(apart):
    """So other models have the same bins, and taps that trained are known."""
    grid = apart.grid()
    plain, fitted = (fit_model(name, apart, grid, FitSettings()).model for name in ("histogram", "session"))

    np.testing.assert_array_equal(fitted.edges, plain.edges)
    assert fitted.trained_with(apart) == len(apart)


def test_large_recordings_have_the_same_model(apart, tmp_path, monkeypatch):
    """Samples that stay on disk are moved block by block."""
    apart.save(tmp_path / "taps.nc")
    monkeypatch.setattr(storage, "ON_DISK", 1000)
    large = TapSet.load(tmp_path / "taps.nc")
    one, other = (
        fit_model("session:gaussian", taps, taps.grid(), FitSettings(edges=EDGES)).model.log_likelihood(apart.taps[:5])
        for taps in (apart, large)
    )

    assert large.scanned is not None
    np.testing.assert_allclose(one, other, rtol=1e-9)


# What says nothing of sessions


def test_levels_too_close_to_tell_a_gain_have_none(sessions):
    """Where the noise of mean taps is as large as what a gain acts on."""
    found = []
    for seed in range(12):
        taps = sessions([1.0] * 3, [0.0] * 3, noise=20.0, repeats=3, seed=seed)
        found.append(session_spread(taps, taps.grid(), EDGES).gain_sd)

    assert max(found) < 0.3


def test_a_dead_taxel_says_nothing_of_offsets(sessions):
    """And is named."""
    taps = sessions([1.0] * 5, [-2.0, 2.0, -1.0, 1.0, 0.0])
    dead = TapSet(taps.dataset.assign(taps=taps.dataset["taps"].where(taps.dataset["taps"].taxel != 1, 4.0)))
    spread, alive = (session_spread(each, each.grid(), EDGES) for each in (dead, taps))
    warnings = [fit_model("session", each, each.grid(), FitSettings()).convergence.warning for each in (dead, taps)]

    assert spread.offset_sd == pytest.approx(alive.offset_sd, rel=0.1)
    assert "Taxel 1 is constant in every training session, but states move it" in warnings[0]
    assert not warnings[1]


def test_a_guess_is_called_so(sessions):
    single, several = sessions([1.0], [0.0]), sessions([1.0, 1.1], [0.0, 0.0])

    for taps, given, guess in ((single, {}, True), (single, {"gain_sd": 0.1}, False), (several, {}, False)):
        told = fit_model("session", taps, taps.grid(), FitSettings(**given)).convergence.sentence
        assert ("a guess" in told) == guess
