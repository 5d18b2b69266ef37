"""Sessions of the data collection and the live rig: what they share and what differs."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.hardware.simulator.rig import SimulatedRig
from solidtouch.hardware.simulator.session import TapStream, cut_session, session_counts, simulate_session
from solidtouch.hardware.simulator.settings import PAPER_RODS, PRESETS, Rod, preset
from solidtouch.hardware.simulator.signal_chain import session_nuisances
from solidtouch.models.errors import InputError
from solidtouch.models.seeds import Purpose

MIDDLE = 6
"""The taxel nearest to the best position."""


def same_taps(first, second):
    return np.array_equal(first.taps, second.taps)


def test_a_session_has_the_sizes_of_the_paper():
    """Five rods times 320 taps every 0.05 mm, 50 samples of 12 taxels, 20 taps in each of the 80 classes."""
    taps = simulate_session(PRESETS["paper"], 0, 3)
    grid = taps.grid()
    where, what = taps.indices(grid)

    assert taps.taps.shape == (1600, 50, 12)
    assert grid.shape == (16, 5)
    assert (np.bincount(where * 5 + what) == 20).all()
    assert np.arange(0.5, 16).tolist() == grid.where_value.tolist()
    assert taps.where[:2].tolist() == pytest.approx([0.025, 0.075])
    assert "10 mm rod" in taps.what_name
    assert set(taps.session) == {3}
    assert "simulated" in taps.dataset.attrs["source"]


def test_sizes_follow_the_settings(small):
    """Other rods, ranges and rates give other sizes."""
    taps = simulate_session(replace(small, taxels=small.taxels[:7]), 0, 0)

    assert taps.taps.shape == (40, 10, 7)
    assert taps.grid().shape == (4, 2)


def test_taps_made_in_pieces_are_the_taps_made_together(small):
    """A stream carries all its state."""
    position = np.linspace(6.1, 9.9, 7)
    whole = TapStream(small, 2, 1, Purpose.LIVE, 0).tap(position, 1)
    stream = TapStream(small, 2, 1, Purpose.LIVE, 0)
    pieces = [stream.tap(part, 1) for part in np.split(position, [1, 4])]

    np.testing.assert_allclose(whole, np.concatenate(pieces), rtol=0, atol=1e-9)


def test_the_same_counts_serve_every_high_pass(small):
    counts = session_counts(small, 2, 1)
    found = []
    for hz in (0.0, 0.5, 3.0):
        settings = replace(small, highpass_hz=hz)
        found.append(cut_session(settings, 2, 1, counts))

        assert found[-1].dataset.identical(simulate_session(settings, 2, 1).dataset)
    assert not same_taps(found[0], found[1])


def test_a_seed_reproduces_a_session_and_others_differ(small):
    """Seed and session number decide everything, in any order and number of calls."""
    later = simulate_session(small, 7, 1)
    simulate_session(small, 7, 0)

    assert same_taps(later, simulate_session(small, 7, 1))
    assert not same_taps(later, simulate_session(small, 7, 0))
    assert not same_taps(later, simulate_session(small, 8, 1))


def test_nuisances_do_not_depend_on_how_much_is_tapped(small):
    """Gains and mounting stay the same when there are more taps or further rods."""
    more = replace(small, spacing_mm=0.1, rods=PAPER_RODS)
    few, many = session_nuisances(small, 0, 1), session_nuisances(more, 0, 1)

    np.testing.assert_array_equal(few.gain_counts_per_mm, many.gain_counts_per_mm)
    np.testing.assert_array_equal(few.mounting_x_mm, many.mounting_x_mm[:2])
    np.testing.assert_array_equal(few.mounting_y_mm, many.mounting_y_mm[:2])


def test_ideal_rig_without_noise_is_deterministic(exact):
    """What is left is the sensor, the same in every session."""
    assert same_taps(simulate_session(exact, 0, 0), simulate_session(exact, 0, 1))


def test_sessions_differ_by_gain_and_mounting_only(small):
    """With drift, gains and mounting change and the sensor's rails stay; without, nothing changes."""
    steady = replace(
        small, session_gain_log_sd=0.0, session_taxel_gain_log_sd=0.0, mounting_x_mm=0.0, mounting_y_mm=0.0
    )
    drifting, other = session_nuisances(small, 0, 0), session_nuisances(small, 0, 1)

    np.testing.assert_array_equal(drifting.rail_counts, other.rail_counts)
    assert (drifting.gain_counts_per_mm != other.gain_counts_per_mm).all()
    assert (drifting.mounting_x_mm != other.mounting_x_mm).all()
    for first, second in zip(session_nuisances(steady, 0, 0), session_nuisances(steady, 0, 1), strict=True):
        np.testing.assert_array_equal(first, second)


def test_nuisances_are_as_large_as_their_settings_say(small):
    """Standard deviations over sessions; twice of them is twice the displacement and the square of the gain."""
    names = ("mounting_x_mm", "mounting_y_mm", "rail_sd_counts")
    names += ("sensitivity_log_sd", "session_gain_log_sd", "session_taxel_gain_log_sd")
    one = replace(small, **{name: 0.1 * (i + 1) for i, name in enumerate(names)})
    two = replace(one, **{name: 2 * getattr(one, name) for name in names})
    a, b = session_nuisances(one, 0, 1), session_nuisances(two, 0, 1)

    np.testing.assert_allclose(b.mounting_x_mm, 2 * a.mounting_x_mm)
    np.testing.assert_allclose(b.mounting_y_mm, 2 * a.mounting_y_mm)
    np.testing.assert_allclose(b.rail_counts - one.rail_counts, 2 * (a.rail_counts - one.rail_counts))
    relative_a, relative_b = (n.gain_counts_per_mm / one.gain_counts_per_mm for n in (a, b))
    np.testing.assert_allclose(relative_b, relative_a**2)
    sessions = [session_nuisances(one, 0, session) for session in range(400)]
    assert np.std([n.mounting_x_mm for n in sessions]) == pytest.approx(one.mounting_x_mm, rel=0.1)
    assert np.std([n.mounting_y_mm for n in sessions]) == pytest.approx(one.mounting_y_mm, rel=0.1)


def session_contrast(name):
    """Mean squared difference of the middle taxel's class means between two sessions, over that between halves."""
    settings = replace(PRESETS[name], rods=PAPER_RODS[2:3], start_mm=5.0, end_mm=11.0, position_spread_mm=0.0)
    taps = np.array([[simulate_session(settings, seed, r).taps[..., MIDDLE] for r in range(2)] for seed in range(4)])
    half = taps.reshape(4, 2, 6, 10, 2, 50).mean(axis=3)
    between = np.mean((half.mean(axis=3)[:, 0] - half.mean(axis=3)[:, 1]) ** 2)
    within = np.mean((half[:, :, :, 0] - half[:, :, :, 1]) ** 2)
    return between / within


def test_nodrift_sessions_agree_within_noise_and_drifting_ones_do_not():
    """Class means differ between sessions of `nodrift` no more than between odd and even taps of one session."""
    assert session_contrast("nodrift") < 1
    assert session_contrast("paper") > 2


def test_live_rig_taps_like_the_session_it_names():
    """At the centre of a class, live taps have the mean of the collected ones of this session and not of another."""
    settings = replace(PRESETS["paper"], rods=PAPER_RODS[:3], position_spread_mm=0.0, session_gain_log_sd=0.2)
    rig = SimulatedRig(settings, 3, session=1, position_mm=8.2, what=2)
    live = np.array([rig.tap() for _ in range(15)])

    def distance(session):
        taps = simulate_session(settings, 3, session)
        settled = taps.taps[(taps.what == 2) & (taps.where == 8.5)][5:]
        error = np.sqrt(live.var(axis=0) / len(live) + settled.var(axis=0) / len(settled) + 0.01)
        return np.abs((live.mean(axis=0) - settled.mean(axis=0)) / error)[:, MIDDLE].mean()

    assert distance(1) < 2
    assert distance(2) > 5


def test_live_noise_is_not_that_of_the_data_collection(small):
    """A live run never repeats the recorded taps of its session."""
    collected = TapStream(small, 0, 0, Purpose.COLLECTION, 1).tap([7.0], 1)

    assert not np.array_equal(collected, TapStream(small, 0, 0, Purpose.LIVE, 1).tap([7.0], 1))


def test_runs_differ_in_noise_only(small):
    """Two runs of one session tap differently, with the same sensor and mounting."""
    settings = replace(small, walk_counts=0.0)
    taps = [SimulatedRig(settings, 0, 0, 8.0, 1, run=run).tap() for run in (0, 1)]

    assert 0 < np.abs(taps[0] - taps[1]).mean() < 5


def test_noise_may_have_a_seed_of_its_own(small):
    """The sensor is then the same, and its noise that of another run."""
    rigs = [SimulatedRig(small, 5, 0, 8.0, 1, noise_seed=seed) for seed in (None, 5, 6)]
    exact = replace(small, white_counts=0.0, taxel_noise_counts=0.0, common_noise_counts=0.0, walk_counts=0.0)
    still = replace(exact, tap_depth_log_sd=0.0, tap_time_samples=0.0, tap_position_mm=0.0)
    taps = [rig.tap() for rig in rigs]
    quiet = [SimulatedRig(still, 5, 0, 8.0, 1, noise_seed=seed).tap() for seed in (5, 6)]

    np.testing.assert_array_equal(taps[0], taps[1])
    assert not np.array_equal(taps[0], taps[2])
    np.testing.assert_array_equal(quiet[0], quiet[1])


def test_settling_forgets_the_former_place(exact):
    """After a move the settled rig taps as if it had always stood there; unsettled, it remembers."""

    def tap_after_a_move(settling_taps):
        rig = SimulatedRig(exact, 0, 0, 4.0, 1, settling_taps=settling_taps)
        rig.tap()
        rig.place(8.0)
        return rig.tap()

    always = SimulatedRig(exact, 0, 0, 8.0, 1, settling_taps=20).tap()

    assert np.abs(tap_after_a_move(None) - always).max() < 2
    assert np.abs(tap_after_a_move(0) - always).max() > 10
    assert replace(exact, highpass_hz=0.0).settling_taps == 0


def test_rig_keeps_its_place_inside_the_class(small):
    """Moves are whole cells from a continuous position; placing changes position, rod, or both."""
    rig = SimulatedRig(small, 0, 0, 6.35, 0)
    rig.move(2)

    assert rig.position_mm == pytest.approx(8.35)
    assert rig.room == (2, 1)

    rig.place(9.9, 1)

    assert (rig.position_mm, rig.what) == (9.9, 1)

    rig.place(10.0)

    assert rig.where_index == 3


@pytest.mark.parametrize(("spread", "inside"), [(1.0, [6.1, 6.5, 6.9]), (0.5, [6.3, 6.5, 6.7]), (0.0, [6.5] * 3)])
def test_position_spread_draws_taps_to_the_centre_of_their_class(small, spread, inside):
    """A spread of 0 leaves one position per class, 1 mm leaves positions as they are."""
    settings = replace(small, position_spread_mm=spread)

    np.testing.assert_allclose(settings.spread([6.1, 6.5, 6.9]), inside)
    assert (np.bincount(settings.where_index(settings.nominal_mm)) == 5).all()
    assert (simulate_session(settings, 0, 0).where == np.tile(settings.nominal_mm, 2)).all()


@pytest.mark.parametrize(
    ("position", "what", "message"),
    [
        (5.9, 0, "outside the range"),
        (10.1, 0, "outside the range"),
        (np.nan, 0, "outside"),
        (8.0, 2, "Unknown object 2"),
    ],
)
def test_places_off_the_rig_are_refused(small, position, what, message):
    """A rig says where it ends and how many rods it has."""
    with pytest.raises(InputError, match=message):
        SimulatedRig(small, 0, 0, position, what)


BAD_SETTINGS = {
    "negative size": ({"white_counts": -1.0}, "white_counts must not be negative"),
    "not a number": ({"lag_s": np.nan}, "lag_s must not be negative"),
    "zero rate": ({"rate_hz": 0.0}, "rate_hz must be positive"),
    "broken cells": ({"cell_mm": 3.0, "position_spread_mm": 1.0}, "number of positions .* must be an integer"),
    "broken taps": ({"spacing_mm": 0.3}, "number of taps .* must be an integer"),
    "empty range": ({"end_mm": 0.0}, "number of positions .* must be an integer"),
    "half samples": ({"rate_hz": 50.5}, "number of samples per tap .* must be an integer"),
    "spread too wide": ({"position_spread_mm": 1.1}, "exceeds cell_mm"),
    "noise that grows": ({"noise_correlation": 1.0}, "noise_correlation must be below 1"),
    "no rod": ({"rods": ()}, "at least one taxel and one rod"),
    "flat rod": ({"rods": (Rod("wire", 0.0),)}, "diameters must be positive"),
}


@pytest.mark.parametrize(("changes", "message"), BAD_SETTINGS.values(), ids=BAD_SETTINGS.keys())
def test_impossible_settings_are_refused(changes, message):
    """Settings are checked when they are made."""
    with pytest.raises(InputError, match=message):
        replace(PRESETS["paper"], **changes)


def test_presets_are_found_by_name():
    """An unknown name is answered with the known ones."""
    assert preset("hold2").hold_samples == 2
    with pytest.raises(InputError, match="'papr'; choose from paper, ideal, broken, hold2, nodrift, model"):
        preset("papr", ["model"])


def test_settings_describe_what_differs_from_the_paper():
    """The description stands in the data's source."""
    assert PRESETS["paper"].describe() == "paper settings"
    assert PRESETS["broken"].describe() == "paper settings with common_noise_counts=6.0"
