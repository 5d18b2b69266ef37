"""The cross-check as it is printed."""

import io

import pytest
from rich.console import Console
from solidtouch.analysis.correctness.page import crosscheck_page
from solidtouch.analysis.experiment.crosscheck import CrossCheck, RouteDifference
from solidtouch.analysis.page.terminal import show
from solidtouch.models.splits import Split


@pytest.mark.parametrize(("largest", "verdict"), [(0.0, "All routes agree."), (1e-6, "The routes DISAGREE.")])
def test_the_verdict_is_printed(largest, verdict):
    """Below a table of every difference and the notes."""
    row = RouteDifference("posterior", "numpy, filter", largest, 1e-10)
    text = io.StringIO()
    check = CrossCheck((row,), 2, 6, 0, 0, 0, 0, ("A note.",))
    page = crosscheck_page({"histogram": check}, {}, Split((), "parity", "Every other tap."))
    show(page, Console(file=text, width=120))

    assert text.getvalue().rstrip().endswith(f"A note.\n{verdict}")
    assert ("FAILED" in text.getvalue()) == bool(largest)
    assert "2 episodes of 6 taps, the first 0 also enumerated as whole sequences" in text.getvalue()
