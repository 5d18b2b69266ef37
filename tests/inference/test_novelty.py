"""Novelty: scores of training taps, p-values of new ones, and the test over an episode."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.model_rig import draw_taps
from solidtouch.hardware.replay import ReplayRig, uniforms
from solidtouch.inference.control import fixation
from solidtouch.inference.engine import make_engine
from solidtouch.inference.episode import steps
from solidtouch.inference.novelty import Novelty, UnknownTest, can_tell, log_wealth
from solidtouch.inference.reference import bin_index
from solidtouch.models.catalogue import FitSettings, fit_model
from solidtouch.models.errors import InputError
from solidtouch.models.histogram import fit
from solidtouch.models.model_file import load_model
from solidtouch.models.novelty import NoveltyScores, misfit, novelty_scores


def refitted(model, taps, kept):
    """Occupation numbers of the taps kept, by a loop with the reference's bins, shape (L, M, K, B)."""
    counts = np.zeros(model.counts.shape)
    where, what = taps.indices(model.grid)
    for n in np.flatnonzero(kept):
        for k in range(counts.shape[2]):
            edges = model.edges if model.edges.ndim == 1 else model.edges[k]
            for b in bin_index(taps.taps[n][:, k], edges):
                counts[where[n], what[n], k, b] += 1
    return counts


def plain_misfit(own, occupation, pseudocount):
    """The divergence written out."""
    total = 0.0
    for k in range(len(own)):
        p = (occupation[k] + pseudocount) / (occupation[k] + pseudocount).sum()
        for b in np.flatnonzero(own[k]):
            share = own[k, b] / own[k].sum()
            total += share * np.log(share / p[b])
    return total


@pytest.fixture(scope="module")
def calibrated(make_model):
    """A model of random histograms, fitted again to taps drawn from it."""
    source = make_model(L=4, M=3, K=3, J=20, B=6, taps=50, seed=2)
    return source, learned(source, 25)


def learned(source, taps_per_class, seed=1):
    train = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, taps_per_class, seed)
    model = fit(train, source.grid, bins=12)
    return replace(model, novelty=novelty_scores(model, train))


@pytest.mark.parametrize("value_range", ["global", "taxel"])
@pytest.mark.parametrize(("sessions", "pseudocount"), [(1, 0.3), (2, 0.01), (3, 0.0)])
def test_scores_are_those_of_refitting_without_the_tap(make_taps, value_range, sessions, pseudocount):
    """Without the tap where there is one session, without its session where there are several."""
    taps = make_taps(L=2, M=3, sessions=sessions, repeats=3)
    model = fit(taps, taps.grid(), bins=7, pseudocount=pseudocount, value_range=value_range)
    scores = novelty_scores(model, taps)
    where, what = taps.indices(model.grid)
    expected, roots = [], []
    for n in range(len(taps)):
        kept = taps.session != taps.session[n] if sessions > 1 else np.arange(len(taps)) != n
        own = refitted(model, taps, np.arange(len(taps)) == n)[where[n], what[n]]
        rest = refitted(model, taps, kept)
        to = [plain_misfit(own, rest[l, m], pseudocount or 0.01) for l, m in np.ndindex(model.grid.shape)]
        expected.append(to[where[n] * model.grid.M + what[n]])
        roots.append(np.sqrt(to))
    cell = where * model.grid.M + what
    best = []
    for n, root in enumerate(roots):
        alike = cell == cell[n]
        centre = [np.sqrt(np.array(expected)[cell == c]).mean() for c in range(len(root))]
        centre[cell[n]] = np.sqrt(np.array(expected)[alike & (np.arange(len(taps)) != n)]).mean()
        if alike.sum() < 5:
            centre = np.full(len(root), np.sqrt(expected).mean())
        best.append((root - centre).min())

    np.testing.assert_allclose(scores.misfit, expected, rtol=1e-12)
    np.testing.assert_array_equal(scores.cell, cell)
    np.testing.assert_allclose(scores.best, best, atol=1e-12)


def test_a_tap_alone_in_its_class_has_no_score(make_taps):
    """Nothing is left to compare it with."""
    taps = make_taps(L=2, M=2, sessions=1, repeats=3)
    where, what = taps.indices(taps.grid())
    alone = (where == 1) & (what == 1)
    alone[np.flatnonzero(alone)[0]] = False
    few = taps.select(~alone)
    scores = novelty_scores(fit(few, few.grid()), few)

    assert len(scores.misfit) == 9
    assert 3 not in scores.cell


def test_taps_outside_the_grid_have_no_score(make_taps):
    taps = make_taps(L=3, M=2)
    grid = taps.grid().select([0, 1], [0])
    scores = novelty_scores(fit(taps, grid), taps)

    assert len(scores.misfit) == np.sum(np.minimum(*taps.indices(grid)) >= 0)


def test_the_misfit_is_the_logarithm_by_which_own_histograms_are_likelier(make_model, draw_samples):
    """1/J of it, as Eq. 1 has it."""
    model = make_model()
    tap = draw_samples(model, 1)
    counts = (model.bins(tap)[0][..., None] == np.arange(model.counts.shape[3])).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.nansum(counts * np.log(counts / len(tap[0]))) / len(tap[0])
    values = misfit(np.broadcast_to(counts, model.counts.shape), model.counts, model.pseudocount)

    np.testing.assert_allclose(values, best - model.log_likelihood(tap)[0], rtol=1e-10)


def test_scores_survive_the_file(calibrated, tmp_path):
    _, model = calibrated
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    np.testing.assert_array_equal(loaded.novelty.misfit, model.novelty.misfit)
    np.testing.assert_array_equal(loaded.novelty.cell, model.novelty.cell)


def test_a_file_without_scores_is_a_model_that_cannot_tell(make_model, tmp_path):
    """As those of earlier versions."""
    make_model().save(tmp_path / "old.nc")
    model = load_model(tmp_path / "old.nc")

    assert model.novelty is None
    assert not can_tell(model)
    with pytest.raises(InputError, match="no novelty scores to tell new things by; fit it again"):
        Novelty(model)


@pytest.mark.parametrize(
    ("name", "value"),
    [("novelty_misfit", np.nan), ("novelty_best", np.inf), ("novelty_cell", 99), ("novelty_cell", -1)],
)
def test_damaged_scores_are_refused(calibrated, tmp_path, name, value):
    _, model = calibrated
    model.save(tmp_path / "model.nc")
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as file:
        tree = file.load()
    tree["constant_data"][name][0] = value
    tree.to_netcdf(tmp_path / "bad.nc", engine="h5netcdf")

    with pytest.raises(InputError, match=r"bad\.nc is damaged: its novelty scores"):
        load_model(tmp_path / "bad.nc")


def test_too_few_scores_are_refused(make_model):
    few = NoveltyScores(np.ones(4), np.zeros(4, dtype=int), np.ones(4))
    model = replace(make_model(), novelty=few)

    assert not can_tell(model)
    with pytest.raises(InputError, match="has 4 novelty scores and 5 are needed"):
        Novelty(model)


@pytest.mark.parametrize("name", ["profile", "session", "session:gaussian"])
def test_other_models_cannot_tell(make_taps, name):
    """P-values are those of histograms without states, whatever scores a model carries."""
    taps = make_taps(L=2, M=3)
    scores = novelty_scores(fit(taps, taps.grid()), taps)
    model = replace(fit_model(name, taps, taps.grid(), FitSettings(bins=9)).model, novelty=scores)

    assert not can_tell(model)
    with pytest.raises(InputError, match=f"--unknown needs a fitted histogram model .* this one is {name}"):
        Novelty(model)


def test_p_values_before_anything_is_known_are_honest(calibrated):
    """The best of all classes is compared with the best of all classes."""
    source, model = calibrated
    novelty = Novelty(model)
    new = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 60, 7)
    p = np.array([novelty.of_any(novelty.excess(tap)) for tap in new.taps])

    for level in (0.05, 0.2, 0.5, 0.8):
        assert np.mean(p <= level) == pytest.approx(level, abs=0.08)


@pytest.mark.parametrize("repeats", [2, 25])
def test_p_values_of_known_taps_are_honest(make_model, repeats):
    """Where the class is known, P(p <= a) is a for taps that fulfil the model; less with two training taps per class.

    A class without one of its two taps is known much worse than with both.
    """
    source = make_model(L=4, M=3, K=3, J=20, B=6, taps=50, seed=2)
    model = learned(source, repeats)
    novelty = Novelty(model)
    new = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 60, 7)
    where, what = new.indices(source.grid)
    p = np.array([novelty.of_class(novelty.excess(tap))[l, m] for tap, l, m in zip(new.taps, where, what, strict=True)])

    for level in (0.05, 0.2, 0.5, 0.8):
        share = np.mean(p <= level)
        assert share <= level + 0.05
        assert repeats == 2 or share == pytest.approx(level, abs=0.08)


def test_a_class_explains_its_own_taps_only(calibrated, draw_samples):
    """The same tap is usual before anything is known and unusual for another class."""
    source, model = calibrated
    taps = draw_samples(source, 20, where=0, what=0)
    novelty = Novelty(model)
    excesses = [novelty.excess(tap) for tap in taps]

    assert np.median([novelty.of_any(excess) for excess in excesses]) > 0.3
    assert np.median([novelty.of_class(excess)[0, 0] for excess in excesses]) > 0.3
    assert np.median([novelty.of_class(excess)[3, 2] for excess in excesses]) < 0.02


def test_an_untrained_class_explains_nothing(calibrated):
    """Its p-values are the smallest that there are."""
    source, _ = calibrated
    train = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 25, 1)
    where, what = train.indices(source.grid)
    train = train.select((where != 1) | (what != 2))
    model = fit(train, source.grid, bins=12)
    novelty = Novelty(replace(model, novelty=novelty_scores(model, train)))
    p = np.array([novelty.of_class(novelty.excess(tap)) for tap in train.taps])

    assert (p[:, 1, 2] == novelty.smallest).all()
    assert novelty.smallest == 1 / (len(train) + 1)
    assert p[:, 1, 1].max() > 0.5


def test_a_tap_without_contact_is_unusual_though_likely(make_model):
    """All samples in the most frequent bin of a class: no tap is likelier, none fits worse."""
    source = make_model(L=2, M=2, K=4, J=40, B=5, taps=50, seed=3)
    model = learned(source, 30)
    k, edges = np.arange(4), model.edges
    b = model.counts[0, 0].argmax(axis=1)
    still = np.tile((edges[b] + edges[b + 1])[k] / 2, (40, 1))
    novelty = Novelty(model)
    usual = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 5, 9).taps

    assert model.log_likelihood(still[None]).max() > model.log_likelihood(usual).max()
    assert novelty.of_any(novelty.excess(still)) < 0.02


def test_a_constant_sensor_has_p_values(make_taps):
    """All misfits are alike."""
    taps = make_taps(L=1, M=1, sessions=1)
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"][:] = 3.0
    flat = type(taps)(dataset)
    model = fit(flat, flat.grid())
    novelty = Novelty(replace(model, novelty=novelty_scores(model, flat)))

    assert novelty.of_any(novelty.excess(flat.taps[0])) > 0.1


def test_taps_of_another_size_are_refused(calibrated):
    _, model = calibrated
    with pytest.raises(InputError, match="taps of 20 samples and 3 taxels"):
        Novelty(model).excess(np.zeros((4, 3)))


@given(st.integers(1, 60), st.integers(1, 2))
def test_bets_start_at_1_and_win_nothing_on_average(n, taps):
    """Over all p-values i / (n + 1) of taps that are as usual as n others, in every combination."""
    surprise = -np.log(np.arange(1, n + 2) / (n + 1))
    if taps == 2:
        surprise = np.add.outer(surprise, surprise)

    assert log_wealth(np.zeros(()), 0) == pytest.approx(0, abs=1e-12)
    assert np.exp(log_wealth(surprise, taps)).mean() <= 1 + 1e-9


@given(st.lists(st.floats(1e-6, 1), min_size=1, max_size=20), st.floats(0.01, 1))
def test_a_smaller_p_value_never_wins_less(p, factor):
    """Usual taps lose, however usual: the wealth falls but stays positive."""
    surprise = -np.log(p).sum()

    assert log_wealth(surprise - np.log(factor), len(p)) >= log_wealth(surprise, len(p))
    assert -np.inf < log_wealth(np.zeros(()), len(p)) < 0


def test_usual_taps_never_sum_up_to_a_new_thing():
    """Uniform p-values: over 2000 episodes of 50 taps, at most alpha of them ever end with an alarm."""
    surprise = -np.log(np.random.default_rng(0).uniform(size=(2000, 50))).cumsum(axis=1)
    highest = np.max([log_wealth(surprise[:, t], t + 1) for t in range(50)], axis=0)
    alarms = np.mean(highest >= -np.log(0.1))

    assert 0 < alarms <= 0.1 + 3 * np.sqrt(0.1 * 0.9 / 2000)


def test_rather_small_p_values_that_persist_sum_up():
    """One in ten is nothing unusual; nine in a row are."""
    persistent = [log_wealth(-t * np.log(np.float64(0.1)), t) for t in range(1, 10)]

    assert persistent[0] < np.log(2)
    assert persistent[-1] > -np.log(0.05)
    assert (np.diff(persistent) > 0).all()


@pytest.mark.parametrize("moves", [[0, 0, 0, 0], [2, -1, -1, 3], [3, -3, 2, 0], [4, 0, -4, 0]])
def test_each_beginning_is_a_hypothesis_of_its_own(calibrated, moves):
    """The wealth against it is that of the classes that the real moves lead it through; outside, of the smallest p."""
    source, model = calibrated
    novelty = Novelty(model)
    test = UnknownTest(novelty, 0.05)
    taps = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 1, 4).taps[:5]
    arrivals = [0, *moves]
    for tap, arrived in zip(taps, arrivals, strict=True):
        test.add(tap, arrived)
    p = [novelty.of_class(novelty.excess(tap)) for tap in taps]
    expected = np.zeros(model.grid.shape)
    for l, m in np.ndindex(model.grid.shape):
        places = l + np.cumsum(arrivals)
        seen = [p[t][at, m] if 0 <= at < model.grid.L else novelty.smallest for t, at in enumerate(places)]
        expected[l, m] = np.log(np.mean([np.prod(a * np.array(seen) ** (a - 1)) for a in np.arange(0.05, 1, 0.1)]))

    np.testing.assert_allclose(test.log_wealth, expected, rtol=1e-10)


def test_taps_of_a_known_object_are_seldom_unknown(calibrated):
    """At most alpha of the episodes, and p-values below their level at most so often."""
    source, model = calibrated
    novelty = Novelty(model)
    new = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 60, 7)
    unknown, p = [], []
    for run in range(200):
        generator = np.random.default_rng(run)
        rig = ReplayRig(new, source.grid, run % source.grid.L, run % source.grid.M, uniforms(generator))
        test, arrived = UnknownTest(novelty, 0.1), 0
        for _ in range(8):
            test.add(rig.tap(), arrived)
            p.append(test.p)
            arrived = rig.move(int(generator.integers(-3, 4)))
            unknown.append(test.unknown)

    assert np.reshape(unknown, (200, 8)).any(axis=1).mean() <= 0.15
    for level in (0.01, 0.1, 0.5):
        assert np.mean(np.array(p) <= level) <= level + 0.02


def test_a_move_that_changes_nothing_is_new_where_places_differ(calibrated, draw_samples):
    """The same taps before and after a move: each fits a trained class, the sequence none."""
    source, model = calibrated
    taps = draw_samples(source, 8, where=1, what=0)
    staying, moving = UnknownTest(Novelty(model), 0.05), UnknownTest(Novelty(model), 0.05)
    for number, tap in enumerate(taps):
        staying.add(tap, 0)
        moving.add(tap, 0 if number == 0 else (-1) ** number)

    assert not staying.unknown
    assert moving.unknown
    assert moving.p < 0.02


def test_without_alpha_nothing_is_doubted(calibrated):
    """P-values are given all the same."""
    source, model = calibrated
    test = UnknownTest(Novelty(model))
    strange = np.zeros((20, 3)) + source.edges.max()

    assert not any(test.add(strange, 0) for _ in range(20))
    assert not test.unknown
    assert test.p < 0.05


def test_a_decision_waits_while_the_bets_win(calibrated):
    """A doubted tap never decides; without doubt the first certain one does."""
    source, model = calibrated
    taps = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 10, 7)
    heard = []

    def doubt(tap, arrived):
        heard.append((tap, arrived))
        return len(heard) < 6

    def run(asked):
        rig = ReplayRig(taps, source.grid, 0, 1, uniforms(np.random.default_rng(3)))
        return list(steps(rig, make_engine("numpy", model), 0.2, fixation(1), 20, asked))

    plain, waiting = run(None), run(doubt)

    assert len(plain) < 6
    assert [step.decision for step in waiting[:5]] == [None] * 5
    assert len(waiting) >= 6
    assert waiting[-1].decision is not None
    assert [arrived for _, arrived in heard] == [step.arrived for step in waiting]


@pytest.mark.parametrize("alpha", [0.0, 1.0, -1.0, float("nan")])
def test_a_rate_outside_0_to_1_is_refused(calibrated, alpha):
    with pytest.raises(InputError, match="rate of false alarms must lie between 0 and 1"):
        UnknownTest(Novelty(calibrated[1]), alpha)
