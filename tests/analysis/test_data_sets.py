"""Simulated data sets and their trials: neighbouring seeds share nothing."""

import pytest
from slow_cases import slow_but
from solidtouch.analysis.experiment.sources import simulated_source
from solidtouch.analysis.reproduce import report as reproduce
from solidtouch.analysis.sensitivity import run as sensitivity
from solidtouch.analysis.strategies import run as strategies_study
from solidtouch.analysis.strategies.data import RIGHT, simulated_bench
from solidtouch.analysis.tasks.kept import Kept
from solidtouch.models.blocks import tap_digests
from solidtouch.models.seeds import data_set_seed


def of_reproduce(seed):
    """Taps of two data sets of `reproduce`."""
    return [taps for fold in reproduce.simulated_split("ideal", 2, seed).folds for taps in (fold.train, fold.test)]


def of_sensitivity(seed):
    """Taps of two data sets of `sensitivity`."""
    folds = map(simulated_source("ideal", 2, seed).load, range(2), (0.0, 0.0))
    return [taps for fold in folds for taps in (fold.train, fold.test)]


def of_strategies(seed):
    """Taps of two data sets of `strategies`."""
    units = map(simulated_bench("ideal", 2, seed).load, range(2))
    return [taps for unit in units for taps in (unit.train, unit.test, unit.tune)]


def of_a_right_model(seed):
    """Taps of two data sets of `strategies` drawn from their models."""
    units = map(simulated_bench(RIGHT, 2, seed).load, range(2))
    return [taps for unit in units for taps in (unit.train, unit.test)]


@pytest.mark.parametrize(
    "load", slow_but([of_reproduce, of_a_right_model], [of_reproduce, of_sensitivity, of_strategies, of_a_right_model])
)
def test_data_sets_share_no_taps(load):
    """Of one seed or of neighbouring ones; a few taps of four binned samples are equal by chance."""
    digests = [digest for seed in (3, 4) for taps in load(seed) for digest in tap_digests(taps.taps).tolist()]

    assert len(set(digests)) > 0.999 * len(digests)


class _EnoughError(Exception):
    """The seed is known."""


@pytest.fixture
def seen(monkeypatch):
    """Seeds that trials are played with; they end there."""
    seeds = []

    def reading(reading, table, test, grid, theta_x, trials, seed, first_stream=0):
        seeds.append(seed)
        raise _EnoughError

    def plan(pool, trials, seed, **_):
        seeds.append(seed)
        raise _EnoughError

    monkeypatch.setattr(sensitivity, "play_reading", reading)
    monkeypatch.setattr(strategies_study, "plan_trials", plan)
    return seeds


def test_trials_of_sensitivity_have_the_seed_of_their_data_set(seen):
    """The first that of the command, in every reading."""
    source, settings = simulated_source("ideal", 2, 3), sensitivity.SensitivitySettings(trials=10, seed=3)
    for number in range(2):
        tried = sensitivity._Tried(source, [sensitivity.Reading()], settings, Kept())
        with pytest.raises(_EnoughError):
            sensitivity._play_fold((number, [0]), tried)

    assert seen == [3, data_set_seed(3, 1)]


def test_trials_of_strategies_have_the_seed_of_their_data_set(seen):
    """With all that is learned for them."""
    bench, settings = simulated_bench(RIGHT, 2, 3), strategies_study.StrategySettings(trials=2, seed=3)
    for number in range(2):
        shared = strategies_study._Shared(bench, settings, Kept(), Kept())
        with pytest.raises(_EnoughError):
            strategies_study._play_strategies((number, "none", ("passive",)), shared)

    assert seen == [3, data_set_seed(3, 1)]
