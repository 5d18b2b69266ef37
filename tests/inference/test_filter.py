"""The belief of an episode in a loop of one's own."""

import numpy as np
import pytest
from solidtouch.hardware.replay import ReplayRig
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import perceive
from solidtouch.inference.filter import Filter
from solidtouch.inference.fit import fit
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.reference import ZeroEvidenceError
from solidtouch.models.errors import InputError


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(sessions=2)


@pytest.fixture(scope="module", params=["histogram", "session", "profile"])
def model(taps, request):
    return fit(taps, request.param, bins=12, saturation=3.0)


@pytest.mark.parametrize("engine", ["numpy", "filter"])
def test_a_loop_by_hand_gives_the_beliefs_of_an_episode(model, taps, engine):
    """Tap by tap, with saturation and states."""
    engine = make_engine(engine, model)
    rig = ReplayRig(taps, model.grid, 0, 1, iter(np.random.default_rng(0).random(9)))
    episode = perceive(rig, engine, 1.0, fixation(1), deadline=8)
    rig = ReplayRig(taps, model.grid, 0, 1, iter(np.random.default_rng(0).random(9)))
    belief = Filter(engine)
    for t in range(8):
        if t:
            rig.move(int(episode.moves[t - 1]))
            belief.move(int(episode.moves[t - 1]))
        assert belief.update(rig.tap()) == episode.log_evidence[t]
        np.testing.assert_array_equal(belief.log_belief, episode.log_beliefs[t])

    assert belief.taps == 8
    assert belief.belief.dims == ("where", "what")
    assert belief.belief.sel(what=model.grid.what_name[1]).sizes == {"where": model.grid.L}
    assert float(belief.belief.sum()) == pytest.approx(1)
    assert np.logaddexp.reduce(belief.log_states) == pytest.approx(0, abs=1e-12)


def test_an_episode_takes_a_model_by_itself(model, taps):
    rigs = [ReplayRig(taps, model.grid, 0, 1, iter(np.random.default_rng(0).random(40))) for _ in range(2)]
    given, alone = (
        perceive(rig, one, 0.9, fixation(1))
        for rig, one in zip(rigs, [make_engine("filter", model), model], strict=True)
    )

    np.testing.assert_array_equal(given.log_beliefs, alone.log_beliefs)


def test_it_decides_above_the_threshold_and_begins_anew(taps):
    model = fit(taps, bins=12)
    belief = Filter(model, stop=0.5)
    assert belief.decision is None
    assert "0 taps" in repr(belief)
    for tap in taps.taps[(np.asarray(taps.indices(model.grid)) == [[0], [1]]).all(axis=0)]:
        belief.update(tap)
    assert belief.decision == 1
    assert model.grid.what_name[1] in repr(belief)
    belief.stop = 1.0
    assert belief.decision is None
    belief.reset()
    np.testing.assert_array_equal(belief.log_belief, model.log_prior)


def test_an_impossible_tap_leaves_the_belief(taps):
    model = fit(taps, bins=12, pseudocount=0.0)
    belief = Filter(model)
    lowest, highest = taps.taps.min(), taps.taps.max()
    flat = np.where(np.arange(taps.taps[0].size).reshape(taps.taps[0].shape) % 2, lowest, highest)
    with pytest.raises(ZeroEvidenceError):
        belief.update(flat)

    assert belief.taps == 0
    np.testing.assert_array_equal(belief.log_belief, model.log_prior)


def test_settings_that_are_none_are_named(taps):
    with pytest.raises(InputError, match="Unknown fit setting 'bin'; choose from bins, pseudocount"):
        fit(taps, bin=3)
    with pytest.raises(InputError, match="histgram"):
        fit(taps, "histgram")


@pytest.mark.parametrize("setting", [{"gain_sd": 0.1}, {"offset_sd": 0.0}])
def test_settings_of_session_models_are_refused_by_others(taps, setting):
    with pytest.raises(InputError, match="require a session model, got profile"):
        fit(taps, "profile", **setting)
    assert fit(taps, "session", bins=12, **setting).name == "session"


@pytest.mark.parametrize("name", ["histogram", "session"])
def test_an_exact_fit_has_no_use_for_nuts(taps, name):
    with pytest.raises(InputError, match="fit of the histogram model is exact; method 'nuts'"):
        fit(taps, name, method="nuts")


def test_a_learned_power_is_that_of_the_command(taps):
    """It is told apart from a given one, and taps of one object missing drop that object."""
    learned = fit(taps, bins=12, power="learned")
    assert isinstance(learned.power, float)
    assert fit(taps, bins=12, power="0.25").power == 0.25
    first = taps.select(np.asarray(taps.indices(taps.grid())[1]) != 0)
    assert fit(first, bins=12).grid.M == taps.grid().M - 1


def test_what_is_fitted_is_written_as_it_stands(taps, tmp_path):
    import xarray as xr

    model = fit(taps, bins=12)
    model.save(tmp_path / "model.nc")
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as tree:
        assert set(tree.children) == set(model.to_datatree().children)
        assert tree.attrs["name"] == model.to_datatree().attrs["name"] == "histogram"


@pytest.mark.parametrize("engine", ["numpy", "filter"])
def test_what_is_refused_leaves_the_belief(taps, engine):
    model = fit(taps, bins=12)
    belief = Filter(make_engine(engine, model))
    for wrong in (taps.taps[:1], taps.taps[0][:-1], 1.0):
        with pytest.raises(InputError, match="A tap must have shape"):
            belief.update(wrong)
    for value in (np.nan, np.inf, -np.inf):
        tap = taps.taps[0].copy()
        tap[2, 1] = value
        with pytest.raises(InputError, match="Samples must not be NaN or infinite"):
            belief.update(tap)
        with pytest.raises(InputError, match="Samples must not be NaN or infinite"):
            model.log_likelihood(tap[np.newaxis])
    with pytest.raises(InputError, match=r"integer number of positions, got 1\.5"):
        belief.move(1.5)
    belief.move(np.float64(0))
    with pytest.raises(InputError, match="got nan"):
        Filter(model, stop=np.nan)
    with pytest.raises(InputError, match="border cannot be set"):
        Filter(make_engine(engine, model), border="clamp")

    np.testing.assert_array_equal(belief.log_belief, model.log_prior)


def test_what_is_read_may_be_written_to(taps):
    """It is nobody else's: neither the model's nor the next reader's."""
    model = fit(taps, bins=12)
    belief = Filter(model)
    belief.log_belief[:] = 0

    assert np.exp(belief.log_belief).sum() == pytest.approx(1)
    assert np.exp(model.log_prior).sum() == pytest.approx(1)


def test_a_decision_outlasts_the_move_after_it(taps):
    model = fit(taps, bins=12)
    belief = Filter(model, stop=0.4)
    while belief.decision is None:
        belief.update(taps.taps[0])
    before = belief.decision
    belief.move(10 * model.grid.L)
    assert belief.decision == before


def test_given_edges_say_how_many_bins_there_are(taps):
    """Whatever `bins` is; edges that are none are refused."""
    even = fit(taps, bins=12)
    given = fit(taps, edges=even.edges.tolist())
    np.testing.assert_array_equal(given.log_likelihood(taps.taps[:3]), even.log_likelihood(taps.taps[:3]))
    for edges in ([0.0], [2.0, 1.0], [0.0, np.nan], 3.0, np.zeros((2, 2, 4))):
        with pytest.raises(InputError, match="edges must"):
            fit(taps, edges=edges)


def test_sessions_may_come_apart(taps):
    """Several sets are as one; objects that nobody touched are named."""
    parts = [taps.select(np.asarray(taps.session) == session) for session in (0, 1)]
    np.testing.assert_array_equal(fit(parts, bins=12).counts, fit(taps, bins=12).counts)
    one = fit(taps.select(np.asarray(taps.indices(taps.grid())[1]) == 0), bins=12)
    assert one.left_out == taps.grid().what_name[1:]
    assert len(repr(one)) < 120
