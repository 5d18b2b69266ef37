"""The table of implementations says what a report of the conformance kit says."""

from functools import partial

from solidtouch.analysis.conformance.front import run, run_engine

from benchmarks.checks.implementations import Implementation, row


def test_a_row_counts_the_cases_and_names_the_levels_that_pass():
    """A level passes if all of its cases were asked."""
    some = row(Implementation("mine", partial(run_engine, "numpy", ["root-j", "ties"]), "Python"))
    level = row(Implementation("mine", partial(run_engine, "numpy", levels=["episodes"]), "Python"))
    wrong = row(Implementation("mine", partial(run, lambda _: [], ["root-j"]), "Python"))

    assert (some[0], some[1], some[3:5]) == ("mine", "Python", ["none", "2 pass"])
    assert level[3:5] == ["episodes", "7 pass"]
    assert wrong[4] == "1 differs"
