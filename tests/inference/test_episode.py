"""One perception episode, step by step, with a scripted sensor."""

from itertools import pairwise

import numpy as np
import pytest
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.simulator.model_rig import ModelRig
from solidtouch.hardware.simulator.rig import SimulatedRig
from solidtouch.inference import reference
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import DEADLINE, collect, perceive, steps
from solidtouch.inference.moves.control import fixation, passive
from solidtouch.models.errors import InputError
from solidtouch.models.preprocessing import Preprocessing


class ScriptedSensor:
    """Gives taps in turn, moves as told beforehand, and keeps what was done to it."""

    room = (0, 0)
    step = 1.5

    def __init__(self, model, taps, realised=0):
        self.preprocessing = model.preprocessing
        self.done = []
        self._taps = iter(taps)
        self._realised = realised

    def tap(self):
        self.done.append("tap")
        return next(self._taps)

    def move(self, delta):
        self.done.append(delta)
        return self._realised


@pytest.fixture
def model(make_model):
    return make_model(L=5, M=3, seed=8)


@pytest.fixture
def engine(model):
    return make_engine("numpy", model)


@pytest.fixture
def taps(model, draw_samples):
    return draw_samples(model, 12, where=1, what=2)


def test_taps_and_moves_alternate_until_the_deadline(model, engine, taps):
    """No move follows the last tap, which no later tap would profit from."""
    sensor = ScriptedSensor(model, taps)
    moves = iter([1, -4, 0])
    episode = perceive(sensor, engine, 1.0, lambda *_: next(moves), deadline=4)

    assert sensor.done == ["tap", 1, "tap", -4, "tap", 0, "tap"]
    assert (episode.taps, episode.stopped) == (4, False)
    assert (episode.moves.tolist(), episode.realised.tolist()) == ([1, -4, 0], [0, 0, 0])
    assert episode.log_beliefs.shape == (4, 5, 3)
    assert episode.log_evidence.shape == (4,)


def test_the_belief_follows_the_commanded_move(model, engine, taps):
    """Not the realised one, which would tell where the sensor stood."""
    sensor = ScriptedSensor(model, taps, realised=-1)
    moves = iter([2, 3])
    episode = perceive(sensor, engine, 1.0, lambda *_: next(moves), deadline=3)

    log_belief = engine.model.log_prior
    for t, delta in enumerate([2, 3, 0]):
        log_belief, log_evidence = engine.update(log_belief, taps[t])
        np.testing.assert_array_equal(episode.log_beliefs[t], log_belief)
        assert episode.log_evidence[t] == log_evidence
        log_belief = engine.shift(log_belief, delta)
    assert episode.realised.tolist() == [-1, -1]


def test_policies_see_the_belief_after_the_tap(model, engine, taps):
    """As probabilities, before the shift."""
    seen = []

    def policy(belief, _):
        seen.append(belief)
        return 1

    episode = perceive(ScriptedSensor(model, taps), engine, 1.0, policy, deadline=3)

    np.testing.assert_array_equal(np.exp(episode.log_beliefs[:2]), seen)


def test_the_stop_test_comes_before_the_move(model, engine, taps):
    """An episode that is sure enough ends without a further move, at the first tap if need be."""
    sensor = ScriptedSensor(model, taps)
    episode = perceive(sensor, engine, 0.0, fixation(2))

    assert sensor.done == ["tap"]
    assert (episode.taps, episode.stopped, len(episode.moves)) == (1, True, 0)


@pytest.mark.parametrize("theta", [0.4, 0.7, 0.9, 0.99])
def test_the_first_belief_above_the_threshold_stops(model, engine, taps, theta):
    """It, and no belief before it, exceeds the threshold; decisions are those of the last belief."""
    episode = perceive(ScriptedSensor(model, taps), engine, theta, passive(), deadline=12)
    what = np.exp(episode.log_beliefs).sum(axis=1)

    assert episode.stopped
    assert (what[:-1].max(axis=1, initial=0.0) <= theta).all()
    assert what[-1].max() > theta
    assert episode.what == what[-1].argmax()
    assert episode.where == np.exp(episode.log_beliefs[-1]).sum(axis=1).argmax()


def test_a_threshold_that_is_met_exactly_goes_on(model, engine, taps):
    """The comparison is strict."""
    first, _ = engine.update(engine.model.log_prior, taps[0])
    theta = float(reference.what_marginal(np.exp(first)).max())
    episode = perceive(ScriptedSensor(model, taps), engine, theta, passive())

    assert episode.taps > 1
    assert perceive(ScriptedSensor(model, taps), engine, np.nextafter(theta, 0.0), passive()).taps == 1


def test_a_decision_at_the_deadline_counts_as_stopped(model, engine, taps):
    """The threshold has been crossed, on time."""
    reference_episode = perceive(ScriptedSensor(model, taps), engine, 0.9, passive())
    on_time = perceive(ScriptedSensor(model, taps), engine, 0.9, passive(), deadline=reference_episode.taps)
    too_late = perceive(ScriptedSensor(model, taps), engine, 0.9, passive(), deadline=reference_episode.taps - 1)

    assert reference_episode.taps > 1
    assert (on_time.taps, on_time.stopped) == (reference_episode.taps, True)
    assert (too_late.taps, too_late.stopped) == (reference_episode.taps - 1, False)


def test_a_threshold_of_one_runs_to_the_deadline(model, engine, draw_samples):
    """However sure it is."""
    taps = draw_samples(model, DEADLINE, where=1, what=2)
    episode = perceive(ScriptedSensor(model, taps), engine, 1.0, passive())

    assert (episode.taps, episode.stopped, episode.what, episode.where) == (DEADLINE, False, 2, 1)


def test_an_object_is_found_on_a_rig_that_fulfils_the_model(model, engine):
    """Active perception ends at the fixation point with the right object."""
    rig = ModelRig(model.grid, model.probabilities, model.edges, model.preprocessing, 4, 1, np.random.default_rng(0))
    episode = perceive(rig, engine, 0.999, fixation(2))

    assert (episode.what, episode.where, rig.where_index) == (1, 2, 2)


@pytest.mark.parametrize("deadline", [0, -1])
def test_a_deadline_below_one_tap_is_refused(model, engine, deadline):
    """Before any tap."""
    sensor = ScriptedSensor(model, [])
    with pytest.raises(InputError, match=f"deadline must be an integer of at least 1, got {deadline}"):
        perceive(sensor, engine, 0.5, passive(), deadline)
    assert sensor.done == []


@pytest.mark.parametrize("name", ["numpy", "numpyro", "filter"])
def test_an_impossible_tap_ends_the_episode_undecided(make_model, name):
    """With what was believed before it; the finger stays and whoever doubts is told of the tap."""
    model = make_model(1, 2, 1, 1, 2, pseudocount=0.0)
    model.counts[0] = [[[1, 0]], [[0, 1]]]
    doubted = []
    sensor = ScriptedSensor(model, [np.array([[-1.0]]), np.array([[1.0]])])
    *_, last = steps(sensor, make_engine(name, model), 1.0, passive(), doubt=lambda *tap: bool(doubted.append(tap)))
    episode = collect(iter([last]))

    assert last.no_class_left
    assert (last.number, last.decision, last.move, last.log_evidence) == (2, None, None, -np.inf)
    assert last.what_marginal.tolist() == [1.0, 0.0]
    assert len(doubted) == 2
    assert (episode.no_class_left, episode.stopped, episode.what, episode.gave_up) == (True, False, 0, False)


def test_a_sensor_that_prepares_its_taps_otherwise_is_refused(model, engine, taps):
    """Before the first tap, with the difference in words."""
    sensor = ScriptedSensor(model, taps)
    sensor.preprocessing = Preprocessing(samples=model.preprocessing.samples, rate_hz=40.0)
    with pytest.raises(InputError, match=r"differ in preprocessing: rate_hz is None in the model and 40\.0 in"):
        perceive(sensor, engine, 0.9, passive())

    assert sensor.done == []


def test_arguments_are_checked_before_the_first_step(model, engine, taps):
    """By the call itself, whoever asks for steps or not."""
    sensor = ScriptedSensor(model, taps)
    with pytest.raises(InputError, match="deadline must be an integer"):
        steps(sensor, engine, 0.9, passive(), 0)
    with pytest.raises(InputError, match="got nan"):
        steps(sensor, engine, np.nan, passive())
    sensor.preprocessing = Preprocessing(samples=3)
    with pytest.raises(InputError, match="differ in preprocessing"):
        steps(sensor, engine, 0.9, passive())

    assert sensor.done == []


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (2.0, r"The sensor moves in steps of 2, but the model's positions are 1\.5 apart"),
        ([1.5, 1.5, 1.0, 1.5], "moves in steps of 1, but"),
        ([1.5, 1.5], "The sensor has 3 positions, the model 5"),
        (np.nan, "steps of nan"),
    ],
    ids=str,
)
def test_a_sensor_whose_steps_are_not_the_models_is_refused(model, engine, taps, step, said):
    sensor = ScriptedSensor(model, taps)
    sensor.step = step
    with pytest.raises(InputError, match=said):
        steps(sensor, engine, 0.9, passive())

    sensor.step = np.full(4, 1.5)
    assert next(steps(sensor, engine, 0.9, passive())).number == 1


def test_the_rigs_know_their_steps(model, engine, make_taps):
    """Of a simulated rig one length, of recorded taps the distance of each pair of positions."""
    other = make_taps(L=4, J=5, K=2, preprocessing=model.preprocessing)
    rig = ReplayRig(other, other.grid(), 0, 1, iter([0.5]))
    with pytest.raises(InputError, match="The sensor has 4 positions, the model 5"):
        perceive(rig, engine, 0.9, passive())
    assert rig.step.tolist() == [1.5] * 3
    assert SimulatedRig("paper", 0, 0, 2.3, 1).step == 1.0
    tables = model.probabilities, model.edges, model.preprocessing
    assert ModelRig(model.grid, *tables, 0, 0, np.random.default_rng(0)).step.tolist() == [1.5] * 4


def test_a_step_moves_only_when_the_next_is_asked_for(model, engine, taps):
    """Who stops asking leaves the sensor where it stands."""
    sensor = ScriptedSensor(model, taps, realised=-1)
    going = steps(sensor, engine, 1.0, lambda *_: 3, deadline=3)
    first = next(going)

    assert (first.number, first.move, first.arrived, first.decision) == (1, 3, 0, None)
    assert sensor.done == ["tap"]
    assert next(going).arrived == -1
    assert sensor.done == ["tap", 3, "tap"]
    going.close()
    assert sensor.done == ["tap", 3, "tap"]


def test_steps_tell_what_was_believed_before_the_tap(model, engine, taps):
    """The prior first, the shifted belief later; the tap itself is in the step."""
    whole = list(steps(ScriptedSensor(model, taps), engine, 1.0, lambda *_: 2, deadline=3))

    np.testing.assert_array_equal(whole[0].log_predicted, engine.model.log_prior)
    for before, after in pairwise(whole):
        np.testing.assert_array_equal(after.log_predicted, engine.shift(before.log_belief, 2))
    for t, step in enumerate(whole):
        np.testing.assert_array_equal(step.tap, taps[t])
        posterior, evidence = engine.update(step.log_predicted, step.tap)
        np.testing.assert_array_equal(step.log_belief, posterior)
        assert step.log_evidence == evidence
        assert step.what == step.what_marginal.argmax()
        assert step.where == step.where_marginal.argmax()
    assert [step.move for step in whole] == [2, 2, None]
