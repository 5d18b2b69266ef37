"""The studies of models run, and tell what they should from what they are given."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm
from solidtouch.hardware.simulator.settings import preset
from solidtouch.models.measurement.registry import fit_model
from solidtouch.models.settings import FitSettings

from benchmarks.page import check_block, publish, write_block, write_rows
from benchmarks.studies.models import figures, plates, recovery, sbc, session_states, sessions
from benchmarks.study import until_interrupted

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module", autouse=True)
def _few_draws():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sbc, "DRAWS", 19)
        yield


# Recovery ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def few():
    """Sources of few taps by name, and the sizes: 4 positions, 3 rods, 5 samples, 2 taxels."""
    sizes = recovery.Sizes(positions=4, rods=3, step=10, every=6, sessions=2, repeats=6)
    names = ["histogram", "gaussian", "profile", "profile-ar", "smooth", "session:profile"]
    return {source.name: source for source in recovery.sources(names, sizes, 1)}, sizes


def test_a_model_far_from_the_others_is_recognised(few):
    """Correlated samples are forecast best by the model that has them."""
    sources, sizes = few
    found = recovery.replicate(sources["profile-ar"], ["gaussian", "profile", "profile-ar"], sizes, 3, 0)
    assert max(found.scores, key=found.scores.__getitem__) == "profile-ar"
    assert found.taps == 4 * 3 * 6
    assert set(found.covered) == {"mean", "deviation", "slope in time"}


@pytest.mark.parametrize("name", ["histogram", "gaussian", "profile", "profile-ar", "smooth", "session:profile"])
def test_taps_of_a_source_have_the_mean_and_spread_that_its_parameters_say(few, rng, name):
    source, _ = few[0][name], few[1]
    model = source.fitted.model
    if name == "session:profile":
        one = fit_model("profile", source.template, source.grid, FitSettings())
        source = source._replace(fitted=one)
    truth = source.fitted.posterior.point()
    taps = recovery.simulated(source, truth, 800, 5, rng)
    own = np.flatnonzero(np.all(np.stack(taps.indices(source.grid)) == [[2], [1]], axis=0))
    expected = recovery.quantities(source.fitted, truth)
    samples = taps.taps[own]
    if name == "histogram":
        samples = (samples - model.edges[0]) / np.diff(model.edges)[0] - 0.5
    mean, deviation = expected["mean"], expected["deviation"]
    mean, deviation = (mean.mean(axis=0)[2, 1], deviation[2, 1]) if mean.ndim == 5 else (mean[2, 1], deviation[2, 1])
    shown = samples.mean(axis=(0, 1)) if mean.ndim == 1 else samples.mean(axis=0)
    assert set(taps.session) == {5}
    assert_allclose(shown - mean, 0, atol=0.25 * np.max(deviation))
    if name not in ("profile-ar", "smooth"):
        axes = (0, 1) if deviation.ndim == 1 or len(deviation) == 1 else 0
        assert_allclose(samples.std(axis=axes), np.squeeze(deviation), rtol=0.15)


def test_all_taps_of_a_session_are_in_one_state(few, rng):
    """Sums over taps come before the sum over states."""
    source = few[0]["session:profile"]
    fitted, taps = source.fitted, source.template.select(slice(0, 9))
    states = fitted.model.states
    own = taps.indices(source.grid)
    from dataclasses import replace

    from solidtouch.models.measurement.draws import integrated
    from solidtouch.models.measurement.states import States

    each = []
    for s in range(len(states.gain)):
        one = States(states.gain[[s]], states.offset[[s]], np.zeros(1))
        plain = fitted._replace(model=replace(fitted.model, states=one))
        each.append(states.log_prior[s] + integrated(plain, taps.taps, own, rng).sum())
    together = recovery.session_score(fitted, taps, rng)
    assert together == pytest.approx(np.log(np.exp(np.array(each) - max(each)).sum()) + max(each))
    assert together > integrated(fitted, taps.taps, own, rng).sum() - 50
    assert together != pytest.approx(integrated(fitted, taps.taps, own, rng).sum())


def test_winners_and_margins_are_counted_by_source():
    one = recovery.Replicate("a", {"a": -5.0, "b": -7.0, "c": -9.0}, 4, {"mean": (9, 10)}, [])
    two = recovery.Replicate("a", {"a": -6.0, "b": -5.0, "c": -9.0}, 4, {"mean": (7, 10)}, ["c"])
    models = ["a", "b", "c"]
    assert recovery.wins([one, two], models).tolist() == [[1, 1, 0], [0, 0, 0], [0, 0, 0]]
    count, names = recovery.wins_in(f"Sizes.\n\n{recovery.tables([one, two], models)}")
    assert names == models
    assert count.tolist() == [[1, 1, 0], [0, 0, 0], [0, 0, 0]]
    assert "| a | 4 | b: 0.5 ± 1.5 | c: 3.5 ± 0.5 |" in recovery.margins_table([one, two], models)
    assert "0.800 [0.584, 0.919] of 20" in recovery.coverage_table([one, two], models)


# Simulation-based calibration --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    """All fits under test by name."""
    sizes = sbc.Sizes(L=2, M=1, J=4, K=3, B=5, repeats=6)
    return {study.name: study for study in sbc.studies(sizes)}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["histogram", "profile-ar"])
def test_ranks_of_exact_posteriors_are_uniform(small, name):
    result = sbc.run(small[name], 60, 4)
    band = sbc.simultaneous_band(60)
    for quantity, rank in result.rank.items():
        assert len(rank) == 60, quantity
        assert sbc.p_values(rank, band)[0] > 1e-4, quantity


@pytest.mark.slow
@pytest.mark.parametrize("name", ["profile-mvn", "matrix-normal"])
def test_factorised_fits_run(small, name):
    rank = sbc.run(small[name], 3, 4).rank
    assert all(((values >= 0) & (values <= sbc.DRAWS)).all() for values in rank.values())


@pytest.mark.slow
def test_samples_of_a_story_with_forecasts_follow_from_those_before(small):
    """Innovations of taps told in passes are normal with the variances of the story."""
    truth, samples = small["profile-ar"].draw(7, 200)
    level, rho, variance = (truth[name] for name in ("level", "rho", "variance"))
    where = np.repeat([0, 1], 6)
    before = np.zeros_like(samples)
    before[:, :, 1:] = samples[:, :, :-1]
    gap = samples - level[:, where, 0] - rho[:, None, None] * before
    z = gap / np.sqrt(variance[:, where, 0])
    assert abs(z.mean()) < 0.03
    assert abs(z.std() - 1) < 0.03
    assert abs((z[:, :, 1:] * z[:, :, :-1]).mean()) < 0.03


@pytest.mark.slow
def test_a_posterior_that_is_too_narrow_or_biased_fails(small):
    class Wrong:
        def __init__(self, posterior, shift, shrink):
            self.posterior, self.shift, self.shrink = posterior, shift, shrink

        def draw(self, generator):
            drawn, point = self.posterior.draw(generator), self.posterior.point()
            return drawn | {"level": point["level"] + self.shift + self.shrink * (drawn["level"] - point["level"])}

    study, band = small["profile"], sbc.simultaneous_band(60)
    drawn = study.draw(4, 60)
    for shift, shrink in ((0.3, 1.0), (0.0, 0.3)):
        wrong = study._replace(
            draw=lambda *_: drawn, fit=lambda samples, a=shift, b=shrink: Wrong(study.fit(samples), a, b)
        )
        rank = sbc.run(wrong, 60, 4).rank["level, mean"]
        assert sbc.p_values(rank, band)[0] < 1e-3


def test_uniform_ranks_leave_the_band_as_often_as_it_says(rng):
    band = sbc.simultaneous_band(70)
    outside = 0
    for _ in range(600):
        curve = sbc.distribution(rng.integers(0, 20, size=70))
        outside += bool(((curve < band.low - 1e-12) | (curve > band.high + 1e-12)).any())
    assert 0.02 < outside / 600 < 0.09


# Sessions ----------------------------------------------------------------------------------------------------------


def test_sequences_are_disjoint_and_of_one_class_and_session(make_taps):
    taps = make_taps(L=3, M=4, J=6, K=5, sessions=2, repeats=7)
    model = fit_model("histogram", taps, taps.grid(), FitSettings()).model
    number = np.arange(len(taps), dtype=np.float64)
    log_likelihood = np.zeros((len(taps), 3, 4))
    log_likelihood[:, 0, 0], log_likelihood[:, 0, 1] = 2.0 ** (number % 24), taps.session
    sums, where, what = sessions.sequences(model, taps, log_likelihood, 3)
    assert len(sums) == 3 * 4 * 2 * 2
    assert set(sums[:, 0, 1]) == {0.0, 3.0}
    own = taps.indices(taps.grid())
    for l, m in np.ndindex(3, 4):
        assert ((where == l) & (what == m)).sum() == ((own[0] == l) & (own[1] == m)).sum() // 7 * 2


def test_scores_of_certain_and_of_even_beliefs():
    """Of 3 x 2 classes."""
    where, what = np.array([2, 0]), np.array([1, 0])
    sure = np.full((2, 3, 2), -50.0)
    sure[[0, 1], where, what] = 0.0
    found = sessions.score(sure, where, what, 2)
    assert found["accuracy_joint"] == found["accuracy_what"] == 1
    assert found["log_score_joint"] == pytest.approx(0, abs=1e-12)
    assert found["calibration_what"] == pytest.approx(0, abs=1e-12)
    even = sessions.score(np.zeros((2, 3, 2)), where, what, 2)
    assert even["log_score_joint"] == pytest.approx(-np.log(6))


def test_beliefs_are_summed_over_states():
    log_joint = np.log(np.array([[[0.1, 0.2, 0.3, 0.05], [0.05, 0.1, 0.1, 0.1]]]))
    assert_allclose(np.exp(sessions.log_belief(log_joint, 2))[0], [[0.4, 0.25], [0.15, 0.2]])


def test_calibration_error_is_the_mean_gap_of_the_bins():
    belief, right = np.repeat([0.3, 0.9], 50), np.tile([True, False], 50)
    assert sessions.calibration_error(belief, right) == pytest.approx(0.5 * (0.2 + 0.4))


def test_a_likelihood_that_counts_too_much_gets_a_small_exponent(make_taps):
    """Taps repeated ten times say no more than once, so that the best exponent is some tenth."""
    taps = make_taps(L=3, M=4, J=6, K=5, sessions=2, repeats=7)
    grid = taps.grid()
    model = fit_model("gaussian", taps, grid, FitSettings(power="none")).model
    once = sessions.fitted_exponent(model, taps, 1)
    repeated = taps.select(np.repeat(np.arange(len(taps)), 10))
    order = np.concatenate([np.arange(i, len(repeated), 10) for i in range(10)])
    trials = sessions.fitted_exponent(model, repeated.select(order), 1)
    assert trials == once


@pytest.mark.slow
def test_both_models_of_a_pair_are_compared_on_a_data_set(monkeypatch):
    monkeypatch.setattr(sessions, "CONTACTS", (1, 3))
    pair = sessions.Pair("gaussian", "session:gaussian", step=10, positions=3)
    result = sessions.compare("paper", preset("paper"), pair, 5)
    assert result.gain_sd > 0
    assert set(result.exponents) == {"gaussian", "session:gaussian"}
    assert len(result.scores) == 4
    for scores in result.scores.values():
        assert all(0 <= value <= 1 for value in scores["accuracy_joint"])
        assert all(np.log(1e-9) < value < 0 for value in scores["log_score_joint"])
    gain = sessions.gains([result], "log_score_joint", "power J", "gaussian")
    a, b = (np.array(result.scores[f"power J, {name}"]["log_score_joint"]) for name in (pair.name, pair.plain))
    assert_allclose(gain[0], a - b)


# What all share ----------------------------------------------------------------------------------------------------


def test_an_observer_integrates_over_gains_and_offsets(rng):
    """As the densities of all samples say."""
    level = rng.normal(size=(session_states.M, session_states.K))
    taps = session_states.draw(rng, level, 3, 2, 0.3, 1.0)
    found, log_prior = session_states.observed(taps, level, 0.3, 1.0, width=0.1)
    gain, offset = np.exp(0.3 * 4.0), -4.0  # the first offset of the last gain
    state = (len(session_states._POINTS) - 1) * len(session_states._POINTS)
    expected = norm.logpdf(taps.taps, gain * level[2] + offset, gain).sum(axis=(1, 2)) + 6 * np.log(0.1)

    assert_allclose(found[:, 0, state * session_states.M + 2], expected, rtol=1e-9)
    assert_allclose(np.exp(log_prior).sum(), 1)


@pytest.mark.slow
def test_session_states_come_near_an_observer_who_knows_all():
    """With ten training sessions, where a model without states is far off."""
    found = [session_states.measured(3, 10, session_states.TRUTHS[2], number) for number in range(3)]

    for one in found:
        plain, states = (one.tap[name] - one.tap[session_states.KNOWN] for name in session_states.MODELS)
        assert plain < -1
        assert -0.5 < states < 0.05


def test_a_block_of_a_page_is_replaced_and_nothing_else(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- begin a -->\nold\n<!-- end a -->\nafter\n", encoding="utf-8")
    check_block(page, "a")
    write_block(page, "a", "new \\1")
    assert page.read_text(encoding="utf-8") == "before\n<!-- begin a -->\nnew \\1\n<!-- end a -->\nafter\n"
    with pytest.raises(ValueError, match="has no lines <!-- begin b -->"):
        check_block(page, "b")


def test_an_interrupted_study_keeps_what_is_finished(capsys):
    def stop():
        raise KeyboardInterrupt

    assert list(until_interrupted("name", [lambda: 1, lambda: 2, stop, lambda: 3])) == [1, 2]
    assert "Interrupted" in capsys.readouterr().err


def test_rows_of_a_table_are_replaced_by_name(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# x\n<!-- begin a -->\n<!-- end a -->\nrest\n", encoding="utf-8")
    write_rows(page, "a", ("name", "n"), [("one", "1"), ("two", "2")])
    write_rows(page, "a", ("name", "n"), [("two", "3"), ("three", "4")])

    assert page.read_text(encoding="utf-8").splitlines()[1:-2] == [
        "<!-- begin a -->",
        "| name | n |",
        "| --- | --- |",
        "| one | 1 |",
        "| two | 3 |",
        "| three | 4 |",
    ]


def test_the_page_has_a_place_for_every_study():
    page = ROOT / "docs" / "explanation" / "model-studies.md"
    own = "own-recovery", "user-sbc", "svi-rule", "new-sessions"
    for name in ("recovery", "sbc", "session-states", "sessions", *own):
        check_block(page, name)


def test_figures_are_drawn(rng):
    """With as many panels as there is something to show."""
    assert len(figures.recovery_figure(np.eye(3, dtype=int), ["a", "b", "c"]).axes) == 1
    band = sbc.simultaneous_band(30)
    curves = {"level": sbc.distribution(rng.integers(0, 20, size=30))}
    panel = figures.RankPanel("a", band.z, band.low, band.high, curves)
    shown = figures.rank_figure([panel] * 3)
    assert [axes.get_visible() for axes in shown.axes] == [True, True, True, False]
    rule = figures.RulePanel("c", 0.5, {"a": rng.exponential(size=(2, 4, 3))})
    assert len(figures.rule_figure([rule, rule]).axes[1].lines) == 2
    gain = figures.Gain("b", np.array([1, 5]), {"power J": rng.normal(size=(4, 2))})
    assert figures.session_figure([gain], "log score").axes[0].get_title() == "b"


def test_a_figure_stands_beside_the_page_as_one_file(tmp_path, monkeypatch):
    monkeypatch.setattr("benchmarks.page.OUT", tmp_path / "out")
    figure = figures.recovery_figure(np.eye(2, dtype=int), ["a", "b"])
    publish(figure, tmp_path / "page.md", "wins")
    assert [path.name for path in (tmp_path / "images").iterdir()] == ["wins.svg"]
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".svg"}


def test_plate_diagrams_show_every_site_with_its_distribution():
    """Names and plates come from the model's own relations."""
    relations = {
        "sample_sample": {"mean": [], "scale": [], "x": ["mean", "scale"]},
        "plate_sample": {"K": ["mean"], "tap": ["x"]},
        "observed": ["x"],
        "sample_dist": {"mean": "Normal", "scale": "HalfNormal", "x": "Normal"},
    }
    axes, other = plates.plates([plates.Story("small", relations)]).axes
    texts = {text.get_text() for text in axes.texts}
    assert {"mean\nNormal", "scale\nHalfNormal", "x\nNormal", "K", "tap"} <= texts
    assert not other.get_visible()
