"""A second engine that follows the first."""

from dataclasses import dataclass

import numpy as np
import pytest
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.engines.shadow import EnginesDisagree, ShadowEngine
from solidtouch.inference.episode import perceive
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.reference import ZeroEvidenceError


@pytest.fixture
def model(make_model):
    return make_model(L=5, M=3, seed=8)


@dataclass
class Skewed:
    """The reference with a belief that drifts by a factor each tap or move."""

    model: object
    per_tap: float = 0.0
    per_move: float = 0.0
    fails: bool = False
    name: str = "skewed"

    def update(self, log_belief, tap):
        if self.fails:
            raise ZeroEvidenceError("impossible")
        posterior, evidence = make_engine("numpy", self.model).update(log_belief, tap)
        return self._skew(posterior, self.per_tap), evidence

    def shift(self, log_belief, delta):
        return self._skew(make_engine("numpy", self.model).shift(log_belief, delta), self.per_move)

    @staticmethod
    def _skew(log_belief, by):
        skewed = log_belief.copy()
        skewed[0, 0] += by
        return skewed


def follow(engine, taps, deltas):
    log_belief = engine.model.log_prior
    for t, tap in enumerate(taps):
        log_belief, _ = engine.update(log_belief, tap)
        if t < len(deltas):
            log_belief = engine.shift(log_belief, deltas[t])
    return log_belief


def follow_moves(engine, log_belief, n):
    for _ in range(n):
        log_belief = engine.shift(log_belief, 0)


@pytest.mark.parametrize("second", ["numpyro", "filter"])
def test_engines_that_agree_answer_as_the_first(model, draw_samples, second):
    """Beliefs are those of the first, bit by bit, over several episodes."""
    first = make_engine("numpy", model)
    shadow = ShadowEngine(first, make_engine(second, model))
    for seed in range(2):
        taps = draw_samples(model, 6, seed=seed)
        np.testing.assert_array_equal(follow(shadow, taps, [1, -2, 0, 4]), follow(first, taps, [1, -2, 0, 4]))
    assert shadow.name == f"numpy shadowed by {second}"


def test_a_posterior_that_differs_is_named(model, draw_samples):
    """Tap, class and both values."""
    taps = draw_samples(model, 3, where=0, what=0)
    shadow = ShadowEngine(make_engine("numpy", model), Skewed(model, per_tap=1e-3))

    with pytest.raises(EnginesDisagree, match=r"after tap 1: belief in object 0 at 0 mm is 0\.\d+ by numpy and 0\.\d+"):
        follow(shadow, taps, [])


def test_a_shift_that_differs_is_named(model, draw_samples):
    taps = draw_samples(model, 3)
    shadow = ShadowEngine(make_engine("numpy", model), Skewed(model, per_move=0.1))

    with pytest.raises(EnginesDisagree, match="disagree after the move that follows tap 1"):
        follow(shadow, taps, [1])


def test_small_differences_add_up(model, draw_samples):
    """A drift below the tolerance in each step is found once it has grown: the second goes on from its own belief."""
    shadow = ShadowEngine(make_engine("numpy", model), Skewed(model, per_move=4e-9))
    log_belief = model.log_prior
    for _ in range(2):
        log_belief = shadow.shift(log_belief, 0)

    with pytest.raises(EnginesDisagree, match="after the move"):
        follow_moves(shadow, log_belief, 20)


def test_a_new_episode_starts_from_the_same_belief(model, draw_samples):
    """What drifted before is forgotten, and taps are counted anew."""
    taps = draw_samples(model, 2)
    second = Skewed(model)
    shadow = ShadowEngine(make_engine("numpy", model), second)
    follow(shadow, taps, [1])
    second.per_tap = 0.5

    with pytest.raises(EnginesDisagree, match="after tap 1"):
        follow(shadow, taps, [1])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_belief_that_is_no_number_disagrees(model, draw_samples, value):
    with pytest.raises(EnginesDisagree, match="disagree after tap 1"):
        follow(ShadowEngine(make_engine("numpy", model), Skewed(model, per_tap=value)), draw_samples(model, 1), [])


@pytest.mark.parametrize("first", [True, False])
def test_an_impossible_tap_for_one_of_them_disagrees(model, draw_samples, first):
    engines = (make_engine("numpy", model), Skewed(model, fails=True))
    with pytest.raises(EnginesDisagree, match="Tap 1 is impossible for engine skewed, but not for numpy"):
        follow(ShadowEngine(*engines[:: -1 if first else 1]), draw_samples(model, 1), [])


def test_an_impossible_tap_for_both_is_no_disagreement(model, draw_samples):
    shadow = ShadowEngine(Skewed(model, fails=True), Skewed(model, fails=True))
    with pytest.raises(ZeroEvidenceError, match="impossible"):
        follow(shadow, draw_samples(model, 1), [])


def test_an_episode_runs_with_a_shadow(model, draw_samples):
    """As with any engine."""

    class Sensor:
        preprocessing = model.preprocessing
        room = (0, 0)
        step = 1.5

        def __init__(self):
            self.taps = iter(draw_samples(model, 20, where=1, what=2))

        def tap(self):
            return next(self.taps)

        def move(self, _):
            return 0

    alone = perceive(Sensor(), make_engine("numpy", model), 0.9, fixation(2), 20)
    shadow = ShadowEngine(make_engine("numpy", model), make_engine("filter", model))
    followed = perceive(Sensor(), shadow, 0.9, fixation(2), 20)

    np.testing.assert_array_equal(alone.log_beliefs, followed.log_beliefs)
