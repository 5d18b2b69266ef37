"""What holds for every rig, whatever stands behind it."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.simulator.model_rig import ModelRig
from solidtouch.hardware.simulator.rig import SimulatedRig
from solidtouch.hardware.simulator.session import simulate_session
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.models.preprocessing import Preprocessing

L, K, START = 4, 12, 2
SETTINGS = replace(PRESETS["paper"], start_mm=6.0, end_mm=10.0, spacing_mm=0.2)


def simulated(name):
    settings = replace(PRESETS[name], start_mm=SETTINGS.start_mm, end_mm=SETTINGS.end_mm)
    return lambda seed: SimulatedRig(settings, seed, session=1, position_mm=8.3, what=3)


def replayed(seed):
    taps = simulate_session(SETTINGS, seed, session=1)
    return ReplayRig(taps, taps.grid(), START, 3, np.random.default_rng(seed))


def drawn(seed):
    grid = simulate_session(SETTINGS, 0, 0).grid()
    tables = np.random.default_rng(5).dirichlet(np.ones(7), size=(*grid.shape, K))
    record = Preprocessing(samples=3, rate_hz=50.0)
    return ModelRig(grid, tables, np.linspace(-10, 90, 8), record, START, 3, np.random.default_rng(seed))


RIGS = {**{name: simulated(name) for name in PRESETS}, "replay": replayed, "model": drawn}


@pytest.fixture(params=RIGS.values(), ids=RIGS.keys())
def make(request):
    return request.param


def test_taps_are_finite_and_keep_their_shape(make):
    """A tap has the samples that the preprocessing record promises, before and after moves."""
    rig = make(0)
    taps = [rig.tap()]
    for delta in (0, 1, -2):
        rig.move(delta)
        taps.append(rig.tap())

    assert {(rig.preprocessing.samples, K)} == {tap.shape for tap in taps}
    assert all(np.isfinite(tap).all() and tap.dtype == np.float64 for tap in taps)


def test_room_spans_the_range(make):
    """The room to both sides adds up to the number of where classes less one, wherever the rig stands."""
    rig = make(0)

    assert rig.room == (START, L - 1 - START)

    rig.move(-1)

    assert rig.room == (START - 1, L - START)


@pytest.mark.parametrize(("delta", "steps"), [(0, 0), (1, 1), (9, 1), (-1, -1), (-2, -2), (-50, -2)])
def test_a_move_is_clipped_and_returns_the_steps_made(make, delta, steps):
    """A move ends at the end of the range, and moves cut short are counted."""
    rig = make(0)

    assert steps == rig.move(delta)
    assert (START + steps, L - 1 - START - steps) == rig.room
    assert rig.where_index == START + steps
    assert int(steps != delta) == rig.clamped


def test_there_and_back_returns_the_room(make):
    """Steps made and taken back leave the rig where it was."""
    rig = make(0)
    room = rig.room

    assert rig.move(-rig.move(-2)) == 2
    assert room == rig.room


def test_a_seed_reproduces_every_tap(make):
    """Rigs of one seed give the same taps along the same moves, rigs of another seed others."""

    def history(rig):
        taps = []
        for delta in (0, 1, -3):
            rig.move(delta)
            taps.append(rig.tap())
        return np.array(taps)

    first = history(make(3))

    np.testing.assert_array_equal(first, history(make(3)))
    assert not np.array_equal(first, history(make(4)))
