"""Novelty: scores of training taps, p-values of new ones, and the test over an episode."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from slow_cases import slow_but
from solidtouch.hardware.replay import ReplayRig
from solidtouch.hardware.simulator.model_rig import draw_taps
from solidtouch.inference.engines.engine import make_engine
from solidtouch.inference.episode import steps
from solidtouch.inference.moves.control import fixation
from solidtouch.inference.novelty import EXPONENTS, Novelty, Promise, UnknownTest, can_tell
from solidtouch.inference.reference import bin_index
from solidtouch.models.errors import InputError
from solidtouch.models.io.model_file import load_model
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.measurement.novelty import calibrating, misfit, misfits, own_excess
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings


def refitted(model, edges_of, taps, kept):
    """Occupation numbers of the taps kept, by a loop with the reference's bins, shape (L, M, K, B)."""
    counts = np.zeros(model.counts.shape)
    where, what = taps.indices(model.grid)
    for n in np.flatnonzero(kept):
        for k in range(counts.shape[2]):
            edges = edges_of if edges_of.ndim == 1 else edges_of[k]
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
    return model.with_scores(train)


@pytest.mark.parametrize("value_range", ["global", "taxel"])
@pytest.mark.parametrize(("sessions", "pseudocount"), [(1, 0.3), (2, 0.01), (3, 0.0)])
def test_scores_are_those_of_a_model_that_knows_no_calibration_tap(make_taps, value_range, sessions, pseudocount):
    """Bins and histograms are those of the reference taps alone."""
    taps = make_taps(L=2, M=3, sessions=sessions, repeats=4)
    settings = {"bins": 7, "pseudocount": pseudocount, "value_range": value_range}
    model = fit(taps, taps.grid(), **settings)
    scores = model.with_scores(taps).novelty
    where, what = taps.indices(model.grid)
    calibrates = calibrating(where * model.grid.M + what, taps.session)
    alone = fit(taps.select(~calibrates), taps.grid(), **settings)
    expected = []
    for n in np.flatnonzero(calibrates):
        own = refitted(alone, alone.edges, taps, np.arange(len(taps)) == n)[where[n], what[n]]
        expected.append(plain_misfit(own, alone.counts[where[n], what[n]], pseudocount or 0.01))

    assert 0 < calibrates.sum() < len(taps)
    np.testing.assert_array_equal(scores.reference, alone.counts)
    np.testing.assert_array_equal(scores.edges, alone.edges)
    np.testing.assert_allclose(scores.misfit, expected, rtol=1e-12)
    np.testing.assert_array_equal(scores.cell, (where * model.grid.M + what)[calibrates])


def test_every_second_tap_or_session_of_a_class_calibrates():
    """Sessions from the first on, taps from the second on, so that every class has a reference."""
    cell = np.array([0, 1, 0, 0, 1, 0, 2, 3, 3, 3])
    session = np.array([0, 0, 0, 0, 0, 0, 5, 2, 4, 7])

    assert calibrating(cell, session).tolist() == [
        *(False, False, True, False, True, True),
        *(False, True, False, True),
    ]


def test_a_tap_alone_in_its_class_is_reference_and_bets_nothing(make_taps):
    """Nothing is known of misfits to it, so nothing speaks against it."""
    taps = make_taps(L=2, M=2, sessions=1, repeats=6)
    where, what = taps.indices(taps.grid())
    alone = (where == 1) & (what == 1)
    alone[np.flatnonzero(alone)[0]] = False
    few = taps.select(~alone)
    model = fit(few, few.grid())
    scores = model.with_scores(few).novelty
    won = Novelty(replace(model, novelty=scores)).log_bets(np.full((2, 2), 1e9))

    assert len(scores.misfit) == 9
    assert 3 not in scores.cell
    assert scores.reference[1, 1].any()
    assert (won[:, 1, 1] == 0).all()
    assert (won[:, 0, 0] > 0).all()


def test_taps_outside_the_grid_have_no_score(make_taps):
    taps = make_taps(L=3, M=2)
    grid = taps.grid().select([0, 1], [0])
    scores = fit(taps, grid).with_scores(taps).novelty

    assert len(scores.misfit) + scores.reference[:, :, 0].sum() / taps.taps.shape[1] == np.sum(
        np.minimum(*taps.indices(grid)) >= 0
    )


def test_the_misfit_is_the_logarithm_by_which_own_histograms_are_likelier(make_model, draw_samples):
    """1/J of it, as Eq. 1 has it."""
    model = make_model()
    tap = draw_samples(model, 1)
    counts = (model.bins(tap)[0][..., None] == np.arange(model.counts.shape[3])).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        best = np.nansum(counts * np.log(counts / len(tap[0]))) / len(tap[0])
    values = misfit(np.broadcast_to(counts, model.counts.shape), model.counts, model.pseudocount)

    share = counts.reshape(1, -1) / len(tap[0])

    np.testing.assert_allclose(values, best - model.log_likelihood(tap)[0], rtol=1e-10)
    np.testing.assert_allclose(
        misfits(share, model.log_prob.reshape(-1, share.shape[1]))[0], values.ravel(), rtol=1e-10
    )


def test_scores_survive_the_file(calibrated, tmp_path):
    _, model = calibrated
    model.save(tmp_path / "model.nc")
    loaded = load_model(tmp_path / "model.nc")

    for found, given in zip(loaded.novelty, model.novelty, strict=True):
        np.testing.assert_array_equal(found, given)


def test_scores_without_a_reference_are_none(calibrated, tmp_path):
    """Those of earlier versions were of taps left out in turn, which allow no promise."""
    _, model = calibrated
    model.save(tmp_path / "model.nc")
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as file:
        tree = file.load()
    tree["constant_data"] = tree["constant_data"].to_dataset().drop_vars(["novelty_reference", "novelty_edges"])
    tree.to_netcdf(tmp_path / "old.nc", engine="h5netcdf")

    assert load_model(tmp_path / "old.nc").novelty is None


def test_a_file_without_scores_is_a_model_that_cannot_tell(make_model, tmp_path):
    """As those of earlier versions."""
    make_model().save(tmp_path / "old.nc")
    model = load_model(tmp_path / "old.nc")

    assert model.novelty is None
    assert not can_tell(model)
    with pytest.raises(InputError, match="no novelty scores, which --unknown requires; fit it again"):
        Novelty(model)


@pytest.mark.parametrize(
    ("name", "value"),
    slow_but(
        [("novelty_reference", -1), ("novelty_cell", 99)],
        [
            ("novelty_misfit", np.nan),
            ("novelty_reference", -1),
            ("novelty_edges", 99),
            ("novelty_cell", 99),
            ("novelty_cell", -1),
        ],
    ),
)
def test_damaged_scores_are_refused(calibrated, tmp_path, name, value):
    _, model = calibrated
    model.save(tmp_path / "model.nc")
    with xr.open_datatree(tmp_path / "model.nc", engine="h5netcdf") as file:
        tree = file.load()
    tree["constant_data"][name][0] = value
    tree.to_netcdf(tmp_path / "bad.nc", engine="h5netcdf")

    with pytest.raises(InputError, match=r"bad\.nc: damaged: novelty scores"):
        load_model(tmp_path / "bad.nc")


def test_too_few_scores_are_refused(make_model):
    source = make_model(L=1, M=1)
    train = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 8, 1)
    model = source.with_scores(train)

    assert not can_tell(model)
    with pytest.raises(InputError, match="has 4 novelty scores, but --unknown requires 5"):
        Novelty(model)


@pytest.mark.parametrize("name", ["profile", "session", "session:gaussian"])
def test_other_models_cannot_tell(make_taps, name):
    """P-values are those of histograms without states, whatever scores a model carries."""
    taps = make_taps(L=2, M=3)
    scores = fit(taps, taps.grid()).with_scores(taps).novelty
    model = replace(fit_model(name, taps, taps.grid(), FitSettings(bins=9)).model, novelty=scores)

    assert not can_tell(model)
    with pytest.raises(InputError, match=f"--unknown requires a fitted histogram model, got {name}"):
        Novelty(model)


@pytest.mark.parametrize("repeats", [16, 50])
def test_p_values_of_known_taps_are_honest(make_model, repeats):
    """Where the class is known, P(p <= a) is a for taps that fulfil the model, averaged over the classes."""
    source = make_model(L=4, M=3, K=3, J=20, B=6, taps=50, seed=2)
    model = learned(source, repeats)
    novelty = Novelty(model)
    new = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 60, 7)
    where, what = new.indices(source.grid)
    p = novelty.p_values(novelty.misfit(new.taps))[np.arange(len(new)), where, what]

    for level in (0.05, 0.2, 0.5, 0.8):
        assert np.mean(p <= level) == pytest.approx(level, abs=0.08)


def test_excess_is_over_the_mean_of_the_others():
    """Against one that knows the tap itself an excess would be smaller; classes of few share the mean of all."""
    root = np.array([1.0, 2.0, 3.0, 4.0, 10.0, 7.0, 8.0])
    cell = np.array([0, 0, 0, 0, 0, 1, 1])

    np.testing.assert_allclose(own_excess(root**2, cell), [*(root[:5] - (20 - root[:5]) / 4), 2.0, 3.0])


def test_a_class_explains_its_own_taps_only(calibrated, draw_samples):
    """The same tap is usual for its own class and unusual for another."""
    source, model = calibrated
    novelty = Novelty(model)
    p = novelty.p_values(novelty.misfit(draw_samples(source, 20, where=0, what=0)))

    assert np.median(p[:, 0, 0]) > 0.3
    assert np.median(p[:, 3, 2]) < 0.02


def test_an_untrained_class_explains_nothing(calibrated):
    """It has the smallest p-value that there is; an episode cannot begin there, and taps there are no evidence."""
    source, _ = calibrated
    train = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 25, 1)
    where, what = train.indices(source.grid)
    train = train.select((where != 1) | (what != 2))
    model = fit(train, source.grid, bins=12)
    novelty = Novelty(model.with_scores(train))
    misfit = novelty.misfit(train.taps)
    p, test = novelty.p_values(misfit), UnknownTest(novelty, 0.1)
    for arrived in (0, 1):
        test.add(train.taps[0], arrived)

    assert (p[:, 1, 2] == novelty.smallest).all()
    assert novelty.smallest == 1 / (12 * 11 + 1)
    assert p[:, 1, 1].max() > 0.5
    assert test.log_wealth[1, 2] == np.inf
    assert test.log_wealth[0, 2] == pytest.approx(wealth(novelty.log_bets(misfit[0])[:, 0, 2]))


def test_a_tap_without_contact_is_unusual_though_likely(make_model):
    """All samples in the most frequent bin of a class: no tap is likelier, none fits worse."""
    source = make_model(L=2, M=2, K=4, J=40, B=5, taps=50, seed=3)
    model = learned(source, 60)
    k, edges = np.arange(4), model.edges
    b = model.counts[0, 0].argmax(axis=1)
    still = np.tile((edges[b] + edges[b + 1])[k] / 2, (40, 1))
    novelty = Novelty(model)
    usual = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 5, 9).taps

    assert model.log_likelihood(still[None]).max() > model.log_likelihood(usual).max()
    assert novelty.p_values(novelty.misfit(still)).max() < 0.02


def test_a_constant_sensor_is_usual(make_taps):
    """All misfits are alike, and ties speak for the tap."""
    taps = make_taps(L=1, M=1, sessions=1, repeats=12)
    dataset = taps.dataset.copy(deep=True)
    dataset["taps"][:] = 3.0
    flat = type(taps)(dataset)
    model = fit(flat, flat.grid())
    novelty = Novelty(model.with_scores(flat))
    usual = novelty.misfit(flat.taps[0])

    assert novelty.p_values(usual) == 1
    assert (novelty.log_bets(usual) < 0).all()


def test_taps_of_another_size_are_refused(calibrated):
    _, model = calibrated
    with pytest.raises(InputError, match="must have 20 samples and 3 taxels"):
        Novelty(model).misfit(np.zeros((4, 3)))


def wealth(log_bets):
    """Logarithm of the mean over exponents, which are the first axis, written out."""
    return np.log(np.mean(np.exp(log_bets), axis=0))


def test_bets_win_nothing_on_average_given_the_calibration_taps(make_model):
    """In each class by itself, of each exponent: the mean over new taps is 1 at most, and they are real bets."""
    source = make_model(L=4, M=3, K=3, J=20, B=6, taps=50, seed=2)
    new = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 400, 7)
    where, what = new.indices(source.grid)
    for seed in range(3):
        novelty = Novelty(learned(source, 24, seed))
        won = np.exp(novelty.log_bets(novelty.misfit(new.taps)))[:, np.arange(len(new)), where, what]
        mean = won.reshape(len(EXPONENTS), 12, 400).mean(axis=2)

        assert won.max() > 1.3
        assert 0.05 < mean.min() < mean.max() <= 1.0


def test_a_tap_that_misfits_more_wins_more(calibrated):
    """Against each class: as rank among its calibration taps says, with the largest misfit first."""
    _, model = calibrated
    novelty = Novelty(model)
    own = np.sort(model.novelty.misfit[model.novelty.cell == 0])[::-1]
    won = [novelty.log_bets(np.full((4, 3), value))[:, 0, 0] for value in (own[0] + 1, own[0], own[1], own[2], own[-1])]

    assert len(own) == 12
    assert (won[0] > won[1]).all()
    assert (won[1] > won[2]).all()
    assert (won[2] == won[3]).all()
    assert (won[3] > won[4]).all()
    assert won[0].min() > 0 > won[4].max()


@pytest.mark.parametrize("moves", [[0, 0, 0, 0], [2, -1, -1, 3], [3, -3, 2, 0], [4, 0, -4, 0]])
def test_each_beginning_is_a_hypothesis_of_its_own(calibrated, moves):
    """The wealth against it is that of the classes that the real moves lead it through; outside, the most there is."""
    source, model = calibrated
    novelty = Novelty(model)
    test = UnknownTest(novelty, 0.05)
    taps = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 1, 4).taps[:5]
    arrivals = [0, *moves]
    for tap, arrived in zip(taps, arrivals, strict=True):
        test.add(tap, arrived)
    bets = [novelty.log_bets(novelty.misfit(tap)) for tap in taps]
    most = novelty.log_bets(np.full(model.grid.shape, 1e9)).max(axis=(1, 2))
    expected = np.zeros(model.grid.shape)
    for l, m in np.ndindex(model.grid.shape):
        places = l + np.cumsum(arrivals)
        seen = [bets[t][:, at, m] if 0 <= at < model.grid.L else most for t, at in enumerate(places)]
        expected[l, m] = wealth(np.sum(seen, axis=0))

    np.testing.assert_allclose(test.log_wealth, expected, rtol=1e-10)


def test_p_is_that_of_the_class_that_fits_best_of_those_left(calibrated):
    """Of all before the first tap; afterwards where the moves lead hypotheses that have not lost."""
    source, model = calibrated
    novelty = Novelty(model)
    test = UnknownTest(novelty)
    taps = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 20, 4)
    where, what = taps.indices(source.grid)
    there = taps.taps[(where == 3) & (what == 1)]
    first = novelty.p_values(novelty.misfit(there[0]))
    test.add(there[0], 0)

    assert test.p == first.max()
    assert first.min() < test.p
    for tap in there[1:]:
        test.add(tap, 0)
    left = test.log_wealth <= np.log(100)
    assert left.sum() < model.grid.L * model.grid.M / 2
    assert left[3, 1]
    last = novelty.p_values(novelty.misfit(there[-1]))
    assert test.p == last[left].max()
    strange = taps.taps[(where == 0) & (what == 0)][0]
    usual = novelty.p_values(novelty.misfit(strange))
    test.add(strange, 0)
    assert test.p < usual.max()


def test_every_hypothesis_must_have_lost(calibrated):
    """Wealth against all but one is no alarm."""
    _, model = calibrated
    test = UnknownTest(Novelty(model), 0.05)
    won = np.full(model.grid.shape, 9.0)
    won[2, 1] = -1.0
    test.log_wealth = won

    assert not test.unknown
    assert not test.doubtful
    test.log_wealth = np.where(won < 0, 2.9, won)
    assert not test.unknown
    assert test.doubtful
    test.log_wealth = np.where(won < 0, 3.0, won)
    assert test.unknown


def test_taps_of_a_known_object_are_seldom_unknown(calibrated):
    """At most alpha of the episodes, and p-values below their level at most so often."""
    source, model = calibrated
    novelty = Novelty(model)
    new = draw_taps(source.grid, source.probabilities, source.edges, source.preprocessing, 60, 7)
    unknown, p = [], []
    for run in range(200):
        generator = np.random.default_rng(run)
        rig = ReplayRig(new, source.grid, run % source.grid.L, run % source.grid.M, generator)
        test, arrived = UnknownTest(novelty, 0.1), 0
        for _ in range(8):
            test.add(rig.tap(), arrived)
            p.append(test.p)
            arrived = rig.move(int(generator.integers(-3, 4)))
            unknown.append(test.unknown)

    assert np.reshape(unknown, (200, 8)).any(axis=1).mean() <= 0.1
    for level in (0.01, 0.1, 0.5):
        assert np.mean(np.array(p) <= level) <= level + 0.02


def test_a_move_that_changes_nothing_is_new_where_places_differ(calibrated, draw_samples):
    """The same taps before and after a move: each fits a trained class, the sequence none."""
    source, _ = calibrated
    model = learned(source, 100)
    taps = draw_samples(source, 24, where=1, what=0)
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
        rig = ReplayRig(taps, source.grid, 0, 1, np.random.default_rng(3))
        return list(steps(rig, make_engine("numpy", model), 0.2, fixation(1), 20, asked))

    plain, waiting = run(None), run(doubt)

    assert len(plain) < 6
    assert [step.decision for step in waiting[:5]] == [None] * 5
    assert len(waiting) >= 6
    assert waiting[-1].decision is not None
    assert [arrived for _, arrived in heard] == [step.arrived for step in waiting]


@pytest.mark.parametrize("alpha", [0.0, 1.0, -1.0, float("nan")])
def test_a_rate_outside_0_to_1_is_refused(calibrated, alpha):
    with pytest.raises(InputError, match="rate of false alarms must be between 0 and 1"):
        UnknownTest(Novelty(calibrated[1]), alpha)


def test_the_promise_says_how_soon_and_what_would_be_enough(calibrated):
    """Bets against the class with the fewest calibration taps take longest."""
    source, model = calibrated
    promise = Novelty(model).promise(0.05)
    rich = Novelty(learned(source, 2 * promise.needed)).promise(0.05)
    poor = Novelty(learned(source, 2 * promise.needed - 2)).promise(0.05)

    assert promise.fewest == 12
    assert rich.soonest <= 10 < poor.soonest
    assert "in each class would allow it after 10 taps" in poor.sentence
    assert f"{rich.needed} in each class would allow it after 10 taps" in poor.power
    assert "half of its training taps." in rich.sentence
    assert "at most a fraction 0.05 of episodes at a trained object" in rich.sentence
    assert "impossible" in Promise(0.05, 0, None, 8).power


def test_an_alarm_comes_as_soon_as_promised(calibrated):
    """Of taps that misfit every class more than any calibration tap; not one tap sooner."""
    _, model = calibrated
    novelty = Novelty(model)
    test, taps = UnknownTest(novelty, 0.05), 0
    while not test.unknown:
        test.follow(np.full(model.grid.shape, 1e9), 0)
        taps += 1

    assert taps == novelty.promise(0.05).soonest
