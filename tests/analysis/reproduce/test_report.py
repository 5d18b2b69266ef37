"""The report of a reproduction: results cost the experiment, the rest is computed for those who read the page."""

import pytest

import solidtouch as st

EXPERIMENT = ["Playing trials"]
PAGE = ["Cross-checking engines", "Following single episodes"]


@pytest.mark.slow
def test_what_only_the_page_needs_is_computed_when_it_is_asked_for(make_taps):
    stages = []

    def progress(name, total):
        stages.append(name)
        return lambda _: None

    options = {"trials": 20, "thresholds": [0.5], "episodes": 1, "sequence_taps": 2}
    report = st.reproduce(make_taps(), **options, progress=progress)
    assert set(report.decisions.policy.values) == {"passive", "active"}
    assert report.plot("fig7").axes
    assert {"fig4", "fig6"} < set(report.figures)
    assert stages == EXPERIMENT

    assert set(report.summary["elapsed_s"]) == {*EXPERIMENT, *PAGE}
    assert report.passed
    assert stages == EXPERIMENT + PAGE
