"""The evidence of a tap is what a model that has not seen it says."""

from dataclasses import replace

import numpy as np
import pytest
from solidtouch.analysis.stats.evidence import evidence, halves, rivals
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.likelihood.bins import find_bins
from solidtouch.models.taps import TapSet, concatenate

BINS, PSEUDOCOUNT = 9, 0.2


def sets(make_taps, number=2, repeats=5, **more):
    return [make_taps(sessions=1, repeats=repeats, seed=seed, **more) for seed in range(number)]


def judged(train, *others, pseudocount=PSEUDOCOUNT):
    grid = train.grid()
    taps = concatenate([train, *others])
    return taps, evidence(train, taps, grid, fit(train, grid, bins=BINS, pseudocount=pseudocount))


def by_hand(train, taps, tap):
    """Evidence of one tap, by loops: half, tables of the other half, least divergence, log ratio."""
    grid, M = train.grid(), len(train.what_name)
    edges = fit(train, grid, bins=BINS).edges
    bins = find_bins(taps.taps, edges)
    K = taps.taps.shape[2]
    place = np.searchsorted(train.dataset["where_value"].values, taps.where)

    def half_of(i):
        same = [
            j
            for j in range(len(taps))
            if (j < len(train)) == (i < len(train)) and (place[j], taps.what[j]) == (place[i], taps.what[i])
        ]
        return same.index(i) % 2

    judges = [i for i in range(len(train)) if half_of(i) != half_of(tap)]
    table = {}
    for l in range(grid.L):
        for m in range(M):
            members = [i for i in judges if (place[i], taps.what[i]) == (l, m)]
            counts = np.array([np.bincount(bins[members, :, k].ravel(), minlength=BINS) for k in range(K)])
            table[l, m] = (counts + PSEUDOCOUNT) / (counts + PSEUDOCOUNT).sum(axis=1, keepdims=True)
    own = place[tap], taps.what[tap]
    others = [one for one in table if one[1] != own[1]]
    divergence = [(table[own] * np.log(table[own] / table[one])).sum() for one in others]
    rival = others[int(np.argmin(divergence))]
    ratio = np.log(table[own] / table[rival])
    return half_of(tap), rival[0] * M + rival[1], ratio[np.arange(K), bins[tap]]


def test_evidence_is_that_of_equations_written_out(make_taps):
    """Half, rival and every value of training taps and others, by loops."""
    train, other = sets(make_taps)
    taps, found = judged(train, other)
    np.testing.assert_array_equal(found.tap, np.arange(len(taps)))
    for tap in range(0, len(taps), 13):
        half, rival, values = by_hand(train, taps, tap)
        assert found.half[tap] == half
        assert found.rival[half, found.own[tap]] == rival
        np.testing.assert_allclose(found.values[tap], values, atol=1e-12)


def test_a_tap_is_not_judged_by_itself(make_taps):
    """A training tap that moves changes neither its own half's judge nor its own rival."""
    train, other = sets(make_taps)
    _, before = judged(train, other)
    moved = train.taps.copy()
    moved[11] = train.taps[11, ::-1]
    changed = TapSet(train.dataset.assign(taps=(("tap", "sample", "taxel"), moved)))
    _, after = judged(changed, other)
    same = before.half == before.half[11]
    same[11] = False
    np.testing.assert_array_equal(before.values[same], after.values[same])
    np.testing.assert_array_equal(np.sort(before.values[11], axis=0), np.sort(after.values[11], axis=0))


def test_names_of_classes_and_taxels_do_not_matter(make_taps, rng):
    """Objects in another order, and taxels in another order, give the same evidence."""
    train, other = sets(make_taps)
    _, plain = judged(train, other)
    objects, taxels = rng.permutation(4), rng.permutation(5)

    def renamed(taps):
        place = np.argsort(objects)[taps.what]
        return TapSet.from_arrays(
            taps.taps[:, :, taxels],
            place,
            [taps.what_name[m] for m in objects],
            where=taps.where,
            where_unit="mm",
            session=taps.session,
            trial=taps.trial,
            preprocessing=taps.preprocessing,
        )

    _, other_way = judged(renamed(train), renamed(other))
    np.testing.assert_allclose(other_way.values, plain.values[:, :, taxels], atol=1e-12)


def test_rivals_have_the_least_divergence(make_model):
    """Of trained classes with another object; a class that does not count has none and is none."""
    model = make_model(untrained=[(1, 2)])
    M = model.grid.M
    found = rivals(model, model.trained)
    p = model.probabilities
    for l in range(model.grid.L):
        for m in range(M):
            if (l, m) == (1, 2):
                assert found[l * M + m] == -1
                continue
            divergence = {
                a * M + b: (p[l, m] * np.log(p[l, m] / p[a, b])).sum()
                for a in range(model.grid.L)
                for b in range(M)
                if b != m and (a, b) != (1, 2)
            }
            assert found[l * M + m] == min(divergence, key=divergence.get)


def test_with_one_object_rivals_are_other_positions(make_model):
    """Never the class itself; and with one class alone there is none."""
    model = make_model(M=1)
    found = rivals(model, model.trained)
    assert set(found) <= {0, 1, 2}
    assert (found != np.arange(3)).all()
    assert rivals(make_model(L=1, M=1), np.ones((1, 1), dtype=bool)).tolist() == [-1]


def test_many_taps_of_a_class_are_halved_by_quarters(make_taps):
    """First, second, first, second; fewer than eight take turns."""
    grid = make_taps().grid()
    eight, seven = make_taps(sessions=1, repeats=8), make_taps(sessions=1, repeats=7)
    one = [(taps.what == 0) & (taps.where == 0) for taps in (eight, seven)]
    assert halves(eight, grid)[one[0]].tolist() == [0, 0, 1, 1, 0, 0, 1, 1]
    assert halves(seven, grid)[one[1]].tolist() == [0, 1, 0, 1, 0, 1, 0]


def test_single_taps_are_halved_by_session(make_taps):
    """Where sessions hold one tap of a class each, sessions take turns."""
    taps = make_taps(sessions=5, repeats=1)
    assert halves(taps, taps.grid())[(taps.what == 0) & (taps.where == 0)].tolist() == [0, 1, 0, 1, 0]


def test_evidence_is_finite_without_a_pseudocount(make_taps):
    """Bins that the judges never saw count as a very small probability."""
    train, other = sets(make_taps)
    _, found = judged(train, other, pseudocount=0.0)
    assert np.isfinite(found.values).all()
    assert found.values.min() < -10


def test_taps_of_classes_that_one_half_does_not_know_are_left_out(make_taps):
    """A class with one training tap is neither judged nor a rival; unknown objects are left out likewise."""
    train, other = sets(make_taps)
    lonely = np.flatnonzero((train.what == 1) & (train.where == 0))
    train = train.select(np.setdiff1d(np.arange(len(train)), lonely[1:]))
    taps, found = judged(train, other)
    left = (taps.what == 1) & (taps.where == 0)
    np.testing.assert_array_equal(found.tap, np.flatnonzero(~left))
    assert (found.rival[:, 1] == -1).all()
    assert not (found.rival == 1).any()


def test_single_training_taps_cannot_be_judged(make_taps):
    """Nor can taps of a class without a rival."""
    train, other = sets(make_taps, repeats=1)
    with pytest.raises(InputError, match="no class has two training taps"):
        judged(train, other)
    train, other = sets(make_taps, L=1, M=1)
    with pytest.raises(InputError, match="No tap belongs to a class with two training taps and a rival"):
        judged(train, other)


def test_other_samples_of_the_same_taps_are_judged_alike(make_taps):
    """The judge gives the values again, and its response is the mean difference over the step."""
    taps, found = judged(*sets(make_taps))
    samples = taps.taps.astype(float)
    np.testing.assert_array_equal(found.judge(samples), found.values)
    way, step = np.ones_like(samples), 0.7
    classes, response = found.judge.response(samples, way, step)
    np.testing.assert_array_equal(classes, np.arange(12))
    members = found.own == 5
    change = (found.judge(samples + step) - found.judge(samples - step))[members] / (2 * step)
    np.testing.assert_allclose(response[5], change.mean(axis=0), atol=1e-12)


def test_power_of_the_model_does_not_matter(make_taps):
    """Evidence is that of single samples, whatever root the model in use takes."""
    train, other = sets(make_taps)
    grid, taps = train.grid(), concatenate([train, other])
    model = fit(train, grid, bins=BINS, pseudocount=PSEUDOCOUNT)
    values = [evidence(train, taps, grid, replace(model, power=power)).values for power in ("J", 0.3)]
    np.testing.assert_array_equal(*values)
