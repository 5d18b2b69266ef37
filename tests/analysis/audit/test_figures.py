"""Figures of an audit: what stands on them, for odd sizes and where something cannot be told."""

from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.colors import to_hex
from numpy.testing import assert_array_equal
from solidtouch.analysis.audit import figures
from solidtouch.analysis.audit.dependence.taxels import TESTS, taxel_dependence
from solidtouch.analysis.audit.dependence.times import time_dependence
from solidtouch.analysis.audit.leakage.run import leakage
from solidtouch.analysis.audit.remedy_scores import Scored
from solidtouch.analysis.audit.variance.causes import PART_WORDS, PARTS
from solidtouch.analysis.page.figure_style import ACTIVE, DECIDED, TRUE
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet


def split_of(**shares: float) -> xr.Dataset:
    """Shares of parts, 0 where nothing is said, known to 0.1 either way."""
    share = np.array([shares.get(part, 0.0) for part in PARTS])
    parts = {"": share, "_low": share - 0.1, "_high": share + 0.1, "_sure": share - 0.15}
    data = {f"share{end}": ("part", values) for end, values in parts.items()}
    return xr.Dataset(data, {"part": list(PARTS)}, {"taps": 7, "classes": 12})


def words(axes) -> list[str]:
    """The labels of the rows."""
    return [label.get_text().replace("\n", " ") for label in axes.get_yticklabels()]


def test_causes_stand_in_the_order_of_their_shares():
    """The one named first is orange, those that may be none are pale, and the axis says of what the shares are."""
    figure = figures.causes(split_of(gain=0.5, noise=0.3, common=0.05, independent=0.4, session=-0.2))
    (axes,) = figure.axes
    figure.canvas.draw()
    expected = ["gain", "independent", "noise", "common"]

    assert words(axes)[:4] == [PART_WORDS[part] for part in expected]
    assert words(axes)[-1] == PART_WORDS["session"]
    assert [to_hex(bar.get_facecolor()) for bar in axes.patches[:3]] == [DECIDED, "#a0a0a0", TRUE]
    assert to_hex(axes.patches[3].get_facecolor()) not in (DECIDED, TRUE)
    assert [bar.get_width() for bar in axes.patches[:4]] == pytest.approx([50, 40, 30, 5])
    assert "evidence of 7 taps (%)" in axes.get_xlabel()
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "main cause",
        "cause",
        "not significant or below 5%",
        "not a cause",
    ]


@pytest.mark.parametrize(("named", "orange"), [(None, 1), ("noise", 1), ("", 0)])
def test_another_cause_can_be_named(named, orange):
    """The mark is where the caller says, or nowhere."""
    (axes,) = figures.causes(split_of(gain=0.5, noise=0.3), named).axes
    marked = [bar for bar in axes.patches if to_hex(bar.get_facecolor()) == DECIDED]

    assert len(marked) == orange
    assert [bar.get_width() for bar in marked] == pytest.approx([30.0 if named else 50.0] * orange)


def test_what_the_verdict_does_not_call_a_cause_is_pale():
    """Sessions that their test does not support, what is below 5%, and all where shares are unknown or classes few."""

    def causes_of(split, **known):
        (axes,) = figures.causes(split, "", **known).axes
        return [round(bar.get_width()) for bar in axes.patches if to_hex(bar.get_facecolor()) == TRUE]

    split = split_of(session=0.65, noise=0.3, gain=0.04)
    split["share_sure"] = split["share"] - 0.01

    assert causes_of(split) == [65, 30]
    assert causes_of(split, without=["session"]) == [30]
    assert causes_of(split.assign_attrs(classes=3)) == [65]
    assert causes_of(split.assign(share_high=split["share"] + 2)) == []


def test_a_cause_that_cannot_be_told_is_last_and_says_so():
    """NaN is not zero, and without any share there is no figure."""
    split = split_of(gain=0.5, timing=np.nan)
    figure = figures.causes(split)
    (axes,) = figure.axes
    figure.canvas.draw()

    assert words(axes)[-1] == PART_WORDS["timing"]
    assert "not estimable" in [text.get_text() for text in axes.texts]
    assert len(axes.patches) == len(PARTS) - 1
    assert figures.causes(split * np.nan) is None


@pytest.mark.parametrize(("K", "dead"), [(2, []), (5, [2]), (66, [0, 7, 8])])
def test_maps_show_effects_below_the_diagonal_and_survivors_above_it(K, dead):
    """A panel per test counts its pairs, dead taxels are hatched, and all values are within the colours."""
    rng = np.random.default_rng(K)
    taps = rng.normal(size=(16, 2, K))
    taps[:, :, K - 1] += 4 * taps[:, :, K - 2]
    taps[:, :, dead] = 0.1
    found = taxel_dependence(taps, np.repeat([0, 1], 8), permutations=99, samples=1)
    figure = figures.taxel_map(found)
    figure.canvas.draw()
    panels, bars = figure.axes[: len(TESTS)], figure.axes[len(TESTS) :]
    pairs = (K - len(dead)) * (K - len(dead) - 1) // 2

    for panel, bar, test in zip(panels, bars, TESTS, strict=True):
        one = found.sel(test=test)
        rejected = np.triu(one["rejected"].values, 1)
        assert panel.get_title() == f"{rejected.sum()} of {pairs} pair{'s' * (pairs > 1)}"
        shown = np.asarray(panel.images[0].get_array())
        assert (np.tril(shown[..., 3] == 1, -1).sum(), np.triu(shown[..., 3] == 1, 1).sum()) == (pairs, pairs)
        assert_array_equal(np.triu((shown == (0, 0, 0, 1)).all(axis=2), 1), rejected)
        low, high = bar.get_xlim()
        assert np.nanmax(one["effect"].values) <= high
        assert -low == high if test == "rank" else low == 0
    key = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("constant taxel or not tested" in key) == bool(dead)
    assert "dependent, false discovery rate 5%" in key


def test_a_test_without_a_result_says_why():
    """Three taps are too few for two of the tests."""
    found = taxel_dependence(np.random.default_rng(0).normal(size=(3, 2, 4)), np.zeros(3), permutations=9)
    figure = figures.taxel_map(found)
    figure.canvas.draw()

    assert [len(panel.texts) for panel in figure.axes[:3]] == [0, 1, 1]
    assert "no stratum has 4 taps" in figure.axes[1].texts[0].get_text().replace("\n", " ")


@pytest.mark.parametrize("shape", [(8, 3, 1), (1, 3, 4)])
def test_without_a_pair_there_is_no_map(shape):
    """One taxel, or one tap, has no pair."""
    assert figures.taxel_map(taxel_dependence(np.ones(shape), np.zeros(shape[0]), permutations=9)) is None


@pytest.mark.parametrize(("J", "rate_hz"), [(2, None), (9, 40.0), (90, 50.0)])
def test_lags_begin_at_one_in_seconds_where_the_rate_is_known(J, rate_hz):
    """Two panels, autocorrelation and partial autocorrelation, with a line at zero."""
    taps = np.random.default_rng(J).normal(size=(12, J, 2)).cumsum(axis=1)
    found = time_dependence(taps, np.repeat([0, 1], 6), permutations=9)
    figure = figures.times(found, rate_hz)
    figure.canvas.draw()
    whole, partial = figure.axes
    unit = rate_hz or 1.0

    assert whole.get_xlabel() == ("lag (s)" if rate_hz else "lag (samples)")
    assert (whole.get_ylabel(), partial.get_ylabel()) == ("autocorrelation", "partial autocorrelation")
    assert f"{J} samples are worth" in whole.get_title()
    for panel, name in ((whole, "autocorrelation"), (partial, "partial")):
        zero, line = panel.lines
        assert set(zero.get_ydata()) == {0}
        np.testing.assert_allclose(line.get_xdata(), np.arange(1, J) / unit)
        np.testing.assert_allclose(line.get_ydata(), found[name].values[1:])


def test_one_sample_has_no_lag():
    """Taps of one sample, and taps that never vary, leave no figure."""
    rng = np.random.default_rng(0)
    assert figures.times(time_dependence(rng.normal(size=(8, 1, 3)), np.zeros(8), permutations=9)) is None
    assert figures.times(time_dependence(np.ones((8, 4, 3)), np.zeros(8), permutations=9)) is None


def scored(name: str, gain=None, change=None, place=None, factor=(None, None, None)) -> Scored:
    return Scored(name, (-1.0, -1.2, -0.8), gain, None, None, change, place, 9.0, factor)


def measured(*scores: Scored, unit: str = "mm") -> dict[str, Any]:
    """What `remedies` reads of a measurement."""
    played = xr.Dataset({"what_error": ((), 0.0, {"units": unit}), "where_error": ((), 0.0, {"units": "cm"})})
    return {"scores": list(scores), "n": 5, "taps": 8.25, "played": played}


BASE = scored("current setting", factor=(20.0, 10.0, np.inf))
BETTER = scored("better", (1.0, 0.5, 1.5), (-0.5, -0.7, -0.3), factor=(1.1, 0.9, 1.4))
WORSE = scored("worse", (-1.0, -1.5, -0.5), (0.5, 0.3, 0.7), factor=(0.0, 0.0, 0.2))
SAME = scored("same", (0.1, -0.5, 0.5))


def test_remedies_share_rows_with_the_setting_as_it_is_on_top():
    """Gains are per tap, units stand on the axes, and what is better is blue in both panels."""
    figure = figures.remedies(**measured(BASE, BETTER, WORSE, SAME))
    figure.canvas.draw()
    gain, error, factor = figure.axes

    assert words(gain) == ["current setting", "better", "worse", "same"]
    assert gain.get_ylim()[0] > gain.get_ylim()[1]
    assert gain.get_xlabel() == "gain in log score\nafter 5 taps (nats per tap)"
    assert error.get_xlabel() == "change of object error (mm)\nat 8.25 taps on average"
    dots = [(line.get_xdata()[0], line.get_color()) for line in gain.lines if line.get_marker() in ("o", "s")]
    assert dots == [(0, ACTIVE), (0.2, TRUE), (-0.2, DECIDED), (0.02, "#707070")]
    dots = [(line.get_xdata()[0], line.get_color()) for line in error.lines if line.get_marker() in ("o", "s")]
    assert dots == [(0, ACTIVE), (-0.5, TRUE), (0.5, DECIDED)]
    assert [text.get_text() for text in error.texts] == ["not known"]
    assert [text.get_text() for text in factor.texts] == ["no decision"]
    low, high = factor.get_xlim()
    assert low < 0.9
    assert 20 < high < np.inf
    assert 1 in factor.get_xticks()


def test_an_infinite_factor_ends_at_the_axis():
    """And is called so."""
    endless = scored("endless", (0.1, -0.5, 0.5), factor=(np.inf, np.inf, np.inf))
    factor = figures.remedies(**measured(BASE, endless)).axes[-1]

    (mark,) = (line for line in factor.lines if line.get_marker() == ">")
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (factor.get_xlim()[1], 1)
    assert [text.get_text() for text in factor.texts] == ["infinite"]


def test_a_factor_beyond_the_axis_is_a_mark_at_its_end():
    """With the part of its interval that the axis holds."""
    large = scored("large", factor=(1e7, 3.0, 1e14))
    factor = figures.remedies(**measured(BASE, large)).axes[-1]
    most = factor.get_xlim()[1]
    lines = [(line.get_marker(), line.get_xdata().tolist()) for line in factor.lines if line.get_ydata()[0] == 1]

    assert most == 1000
    assert (">", [most]) in lines
    assert ("None", [3, most]) in lines
    assert len(lines) == 2
    assert not factor.texts


def test_one_tap_is_no_plural():
    """In the label of the errors, however it is rounded."""
    one = measured(BASE, BETTER) | {"taps": 1.0004}
    assert figures.remedies(**one).axes[1].get_xlabel().endswith("at 1 tap on average")


def test_without_errors_two_panels_are_left():
    """A single remedy of which only the gain is known is drawn without its error."""
    gain, factor = figures.remedies(**measured(BASE, SAME)).axes

    assert gain.get_xlabel().startswith("gain")
    assert factor.get_xscale() == "log"
    assert figures.remedies(**measured()) is None


def test_where_no_object_can_be_wrong_the_position_error_is_shown():
    """With one object its error is always zero, and the position's unit stands on the axis."""
    zero = (0.0, 0.0, 0.0)
    remedy = scored("finer grid", (0.1, -0.1, 0.2), zero, (-0.2, -0.3, -0.1))
    _, error, _ = figures.remedies(**measured(BASE, remedy)).axes

    assert error.get_xlabel().startswith("change of position error (cm)")
    assert [line.get_xdata()[0] for line in error.lines if line.get_marker() == "o"] == [0, -0.2]


def test_a_share_of_wrong_decisions_keeps_its_name():
    """Where objects have no size the error is P(wrong)."""
    _, error, _ = figures.remedies(**measured(BASE, BETTER, unit="P(wrong)")).axes

    assert error.get_xlabel().startswith("change of P(wrong)\n")


def drifting(M: int, places: int) -> TapSet:
    """Taps whose level before contact tells the object; contact begins at the fourth of six samples."""
    rng = np.random.default_rng(5)
    _, what, where = (index.ravel() for index in np.indices((12, M, places)))
    order = np.argsort(what, kind="stable")
    what, where = what[order], where[order]
    taps = rng.normal(size=(len(what), 6, 3)) * 0.2 + what[:, None, None]
    taps[:, 3:] += 2.0 * where[:, None, None] + 1.0
    record = Preprocessing(samples=6)
    return TapSet.from_arrays(
        taps,
        what,
        [f"object {m}" for m in range(M)],
        where=1.0 * where,
        where_value=np.arange(1.0 * places),
        preprocessing=record,
    )


@pytest.mark.parametrize(
    ("M", "places", "titles"),
    [(3, 2, ["object", "position", "object and position"]), (3, 1, ["object"]), (1, 4, ["position"])],
)
def test_leaks_stand_beside_whole_taps_and_chance(M, places, titles):
    """A panel for each quantity, a row for each source that there is, and the accuracies where they belong."""
    taps = drifting(M, places)
    result = leakage(taps, taps, taps.grid(), pre=2)
    figure = figures.leakage(result)
    figure.canvas.draw()
    told = result.told.isel(source=np.isfinite(result.told["accuracy"].values).any(axis=1))
    sources = [str(name) for name in told["source"].values]

    assert [axes.get_title() for axes in figure.axes] == titles
    assert words(figure.axes[0]) == [*sources, "chance"]
    for axes, name in zip(figure.axes, told["quantity"].values, strict=True):
        dots = [line.get_xdata()[0] for line in axes.lines if line.get_marker() in ("o", "s")]
        assert dots == told["accuracy"].sel(quantity=name).values.tolist()
        assert f"inferred without touch: {result.explains[str(name)]}" in axes.get_xlabel().replace("\n", " ")


def test_without_anything_before_contact_no_verdict_is_given():
    """Whole taps and chance are two rows, and the axis says no more than what it shows."""
    rng = np.random.default_rng(1)
    what = np.tile([0, 1], 20)
    taps = TapSet.from_arrays(
        rng.normal(size=(40, 1, 2)) + what[:, None, None], what, ["a", "b"], preprocessing=Preprocessing(samples=1)
    )
    (axes,) = figures.leakage(leakage(taps, taps, taps.grid())).axes

    assert words(axes) == ["whole taps", "chance"]
    assert axes.get_xlabel() == "fraction correct after one tap"
