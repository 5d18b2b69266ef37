"""The study of `unknown` measures what `perceive` does."""

import numpy as np
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.novelty import UnknownTest
from solidtouch.models.measurement.histogram import fit

from benchmarks.studies.beliefs import unknown


def test_alarms_come_when_the_test_gives_them(make_model):
    """The study computes all taps of an episode at once; `UnknownTest` goes tap by tap."""
    source = make_model(L=4, M=3, K=3, J=20, B=6, taps=50, seed=2)
    train = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 40, 1)
    novelty = unknown.Novelty(fit(train, source.grid, bins=12).with_scores(train))
    where, what = train.indices(source.grid)
    found = []
    for seed in range(12):
        generator = np.random.default_rng(seed)
        objects = generator.integers(3, size=30) if seed % 2 else np.ones(30, dtype=int)
        pools = [[np.flatnonzero((where == l) & (what == m)) for m in objects] for l in range(4)]
        misfit = novelty.misfit(train.taps[[[generator.choice(pool) for pool in row] for row in pools]])
        places = generator.integers(4, size=30)
        test, alarm = UnknownTest(novelty, unknown.ALPHA), 0
        for t, place in enumerate(places):
            test.follow(misfit[place, t], int(place - places[t - 1]) if t else 0)
            if test.unknown:
                alarm = t + 1
                break
        found.append(unknown.alarm(novelty, misfit, places))
        assert found[-1] == alarm

    assert len(set(found[1::2])) > 3
    assert max(found[::2]) == 0


def test_rules_that_pool_or_do_without_bounds_bet_otherwise(make_model):
    """Pooled ones the same at all places; those without bounds win more on the most unusual taps."""
    source = make_model(L=4, M=3, K=3, J=20, B=6, taps=50, seed=2)
    train = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 40, 1)
    model = fit(train, source.grid, bins=12).with_scores(train)
    strange = np.full((4, 3), 1e9)
    won = {name: rule(model).log_bets(strange) for name, rule in unknown.RULES.items()}

    assert (won["object"] == won["object"][:, :1]).all()
    assert (won["object"] > won["class"]).all()
    assert (won["no bounds"] > won["class"]).all()


def test_moves_follow_the_most_probable_place():
    """Taps that speak for the place where it is lead to the middle and stay there."""
    L, T = 5, 6
    likelihood = np.zeros((L, T, L, 2))
    likelihood[np.arange(L), :, np.arange(L), 1] = 4.0

    for start in range(L):
        assert unknown.path(likelihood, start, 2).tolist() == [start] + [2] * (T - 1)
