"""The study of the tests of dependence runs, and its tables say what was found."""

import numpy as np
from numpy.testing import assert_array_equal

from benchmarks.page import write_block
from benchmarks.studies.audit import bounds, drift, levels


def test_a_common_mode_is_found_across_taxels_and_in_time():
    found = levels.outcome(levels.rig_taps(levels.rig_with("common_noise_counts", 2.0), 1), 19, 1)
    assert_array_equal(found.found, 1.0)
    assert found.effect[0] > 0.3
    page = levels.power_page({("common_noise_counts", 2.0): [found, found]})
    assert "| common_noise_counts | 2 | 2 |" in page
    assert page.count("| 1.00 ") == 5


def test_one_sample_has_no_row_of_time():
    found = [levels.outcome(levels.model_taps(levels.fitted_model(), 1, 6, seed), 19, seed) for seed in (1, 2)]
    assert np.isnan(found[0].found[3:]).all()
    page = levels.level_page({1: found})
    assert "| 1 | table | 2 |" in page
    assert "lag" not in page.split("| --- |")[1]


def test_the_figure_has_a_curve_for_every_knob():
    """Each panel draws the rate at every value of a knob against the effect there, and the point without any."""
    outcomes = [levels.Outcome([0.1] * 3, [1.0, 0.0, 1.0, 0.0, 1.0], [0.0] * 3, [0.2, 0.1, 0.0, 0.3, 1.0, 1.0])] * 2
    points = [(levels.NOTHING, 0.0), *((knob, value) for knob, values in levels.KNOBS.items() for value in values)]
    panels = levels.power_panels(levels.points_of(dict.fromkeys(points, outcomes)))
    assert list(panels) == list(levels.EFFECTS)
    for curves, rate in zip(panels.values(), (1.0, 0.0, 1.0, 0.0), strict=True):
        assert [len(curve.rate) for curve in curves] == [1 + len(values) for values in levels.KNOBS.values()]
        assert all((curve.rate == rate).all() and (curve.low <= curve.high).all() for curve in curves)
    figure = levels.power_figure(panels, levels.ALPHA)
    assert len(figure.axes) == len(levels.EFFECTS)


def test_the_figure_is_redrawn_from_the_table_of_the_page(tmp_path):
    """The table holds what the figure shows, with three digits."""
    outcomes = [
        levels.Outcome([0.1] * 3, [float(hit), 0.0, 1.0, 0.0, 1.0], [0.0] * 3, [0.25, -0.0012, 0.0, 0.3, 1.0, 1.0])
        for hit in (0, 1, 1, 1)
    ]
    found = {(levels.NOTHING, 0.0): outcomes, ("tap_depth_log_sd", 0.01): outcomes}
    page = tmp_path / "page.md"
    page.write_text("<!-- begin audit-power -->\n<!-- end audit-power -->\n")
    write_block(page, "audit-power", levels.power_page(found))

    read, played = levels.points_in(page), levels.points_of(found)
    assert [knob for knob, _ in read] == [knob for knob, _ in played] == ["none", "tap_depth_log_sd"]
    for (_, ours), (_, theirs) in zip(read, played, strict=True):
        assert [(point.hits, point.data_sets) for point in ours] == [(point.hits, 4) for point in theirs]
        np.testing.assert_allclose([p.effect for p in ours], [p.effect for p in theirs], atol=6e-4)


def test_a_drift_of_each_taxel_is_found_by_whole_taps_only():
    """Rows of the table say how often; contrasts see noise that taxels share."""
    line, shared = drift.Course("line", 3.0, "in turns"), drift.Course("none", 0.0, "in turns", 2.0)
    found = {one: [drift.taxels(one, seed) for seed in (1, 2)] for one in (line, shared)}
    assert_array_equal([whole for whole, _ in found[line]], 1.0)
    assert np.sum([by_contrasts for _, by_contrasts in found[line]]) <= 2
    assert_array_equal([by_contrasts[0] for _, by_contrasts in found[shared]], 1.0)
    page = drift.taxel_page(found)
    assert "reach down to 0.05 in 1 of 1 rows" in page
    assert "| line, 3 | in turns | - | 2 | 1.000" in page


def test_an_operator_that_acts_is_a_row_of_its_own():
    """It is named first."""
    one = drift.Suspicion(1.0, 0.0, 0.0)
    outcome = drift.suspects(one, 1)
    assert outcome[0][0] <= 0.01
    assert outcome[1] == "covariate operator"
    assert "| 1 | 0 | 0 | 1 | 1.000" in drift.suspect_page({one: [outcome]})


def test_bounds_are_compared_with_as_many_data_sets_as_each_test_takes():
    """What lies far above all of them is found by both tests, alone and as that of all objects."""
    right = np.random.default_rng(0).normal(size=(400, 6))
    observed = np.zeros((10, 6))
    observed[:4, 3] = 9.0
    observed[8:, 0] = 9.0
    found = bounds.rejections(observed, right)

    assert list(found) == [*bounds.SIMULATIONS]
    for any_bound, of_all in found.values():
        assert any_bound.tolist() == [True] * 4 + [False] * 4 + [True] * 2
        assert of_all.tolist() == [False] * 8 + [True] * 2
