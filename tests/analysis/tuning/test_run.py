"""What is said of a tuning: which thresholds are alike, which digits are shown, and errors that never occurred."""

import numpy as np
import pytest
from solidtouch.analysis.stats.target_error import threshold_grid
from solidtouch.analysis.tuning.page import threshold_table
from solidtouch.analysis.tuning.run import Price, shown_threshold, tune_parts
from solidtouch.inference.trials.resampling import share_beyond
from solidtouch.inference.tuning.held_out import Estimate, held_out, with_repeats, with_unseen
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.setting_file import Setting
from solidtouch.models.settings import PlaySettings
from solidtouch.models.taps import TapSet, concatenate

import solidtouch as st

THETA = (0.6, 0.7, 0.8, 0.9, 0.95)


@pytest.fixture(scope="module")
def parts(make_taps):
    """Three sessions, each held out."""
    taps = make_taps(sessions=3)
    return held_out(taps, taps.grid(), lambda part, grid: fit(part, grid, bins=6, pseudocount=0.5))


@pytest.fixture(scope="module")
def found(parts):
    """A tuning from few trials."""
    return tune_parts(parts, Setting(play=PlaySettings(deadline=20)), Price(), thresholds=THETA, trials=100)


ALIKE = {
    "all": ([1, 1, 1, 1, 1], "; thresholds between 0.6 and 0.95 do not differ significantly in cost."),
    "a run": ([0, 1, 1, 1, 0], "; thresholds between 0.7 and 0.9 do not differ significantly in cost."),
    "with a gap": (
        [0, 1, 1, 0, 1],
        "; 3 of the 5 thresholds do not differ significantly in cost, among them all thresholds between 0.7 and 0.8.",
    ),
    "alone before a gap": ([1, 0, 1, 0, 0], "; 2 of the 5 thresholds do not differ significantly in cost."),
    "none": ([0, 0, 1, 0, 0], "; all other thresholds cost significantly more."),
}


@pytest.mark.parametrize(("alike", "end"), ALIKE.values(), ids=ALIKE)
def test_the_sentence_and_the_table_say_of_the_same_thresholds_that_they_are_alike(found, alike, end):
    """A range is only said where all in it are alike."""
    choice = found.threshold._replace(alike=np.array(alike, dtype=bool), chosen=2)
    told = found._replace(threshold=choice, chosen=2)

    assert told.sentences[1].endswith(f"taps for an error of 1{end}")
    marks = [row[-1] for row in threshold_table(told).rows]
    assert [mark != "" for mark in marks] == choice.alike.tolist()
    assert marks[2] == "chosen"


def test_the_caption_counts_the_rows(found):
    """The chosen threshold has a row besides those at equal distances."""
    theta = threshold_grid(4)
    rows, choice = len(theta), found.threshold
    of = {name: Estimate(*(np.zeros(rows) for _ in range(4))) for name in ("error", "taps", "cost", "excess")}
    many = choice._replace(theta=theta, alike=np.ones(rows, dtype=bool), chosen=1, **of)
    table = threshold_table(found._replace(threshold=many, chosen=1))

    assert f", {len(table.rows)} of {rows} tried" in table.caption
    assert len(table.rows) == 17


def test_thresholds_that_differ_look_different():
    """And none looks like 1."""
    shown = [shown_threshold(theta) for theta in threshold_grid(2)]

    assert len(set(shown)) == len(shown)
    assert [shown_threshold(theta) for theta in (0.5, 0.67712, 0.95, 0.9999876, 0.9999924, 1 - 1e-9, 1.0)] == [
        "0.5",
        "0.6771",
        "0.95",
        "0.999988",
        "0.9999924",
        "0.999999999",
        "1",
    ]


def test_a_position_that_is_as_good_as_the_best_is_said_to_be(found):
    """Without a difference of nothing."""
    zero = Estimate(*(np.zeros(3) for _ in range(4)))
    alike = found.fixation._replace(excess=zero, alike=np.ones(3, dtype=bool), best=0, chosen=1)

    assert ", as low as at " in found._replace(fixation=alike).sentences[0]


def test_no_error_does_not_mean_that_there_are_none(parts):
    """Its interval reaches to that of a proportion without a case, among the decisions that the taps allow."""
    error = Estimate(*(np.array(values) for values in ([0.0, 0.1], [0.0, 0.02], [0.0, 0.05], [0.0, 0.15])))
    seen = with_unseen(error, np.array([2.0, 4.0]), parts, wrong=True)
    taps = sum(len(part.taps) for part in parts.parts)

    assert seen.low.tolist() == [0.0, 0.05]
    assert seen.high == pytest.approx([share_beyond(taps / 2), 0.15])
    sizes = parts.grid.what_value
    if sizes is not None:
        least = np.diff(np.sort(sizes)).min()
        assert with_unseen(error, 2.0, parts, wrong=False).high[0] == pytest.approx(least * share_beyond(taps / 2))


def test_both_curves_have_such_intervals(found):
    for error in (found.fixation.error, found.threshold.error):
        assert (error.high > 0).all()


def test_a_report_has_intervals_of_sessions_that_also_train(make_taps):
    """Those of `with_repeats`, not those of the same models."""
    taps = [make_taps(sessions=1, seed=s) for s in range(4)]
    taps = [TapSet(one.dataset.assign_coords(session=("tap", np.full(len(one), s)))) for s, one in enumerate(taps)]
    report = st.tune(*taps, trials=50, thresholds=[0.5, 0.9])
    known, fitted = concatenate(taps[:3]), report.training.settings.fitted
    parts = held_out(known, report.training.grid, fitted)
    repeated, same = (
        tune_parts(one, Setting(), Price(), thresholds=(0.5, 0.9), trials=50).threshold.taps
        for one in (with_repeats(parts, known, fitted), parts)
    )
    np.testing.assert_array_equal(report.found.threshold.taps.error, repeated.error)
    np.testing.assert_array_equal(repeated.mean, same.mean)
    assert (repeated.error > same.error).any()
