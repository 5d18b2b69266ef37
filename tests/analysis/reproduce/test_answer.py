"""The first sentence of a page: active against passive perception."""

import doctest

import pytest
from solidtouch.analysis.reproduce import answer as module
from solidtouch.analysis.reproduce.answer import answer

UNITS = {"what_error": "mm", "where_error": "mm", "taps": "taps"}


def rows(**differences):
    """Rows of a side with these intervals of passive minus active; quantities without one have none."""
    found = {
        policy: {"policy": policy, "what_error": what, "where_error": 0.2, "taps": 9.0}
        for policy, what in (("passive", 1.5), ("active", 0.5), ("passive - active", 1.0))
    }
    for name, ends in differences.items():
        found["passive - active"] |= dict(zip((f"{name}_low", f"{name}_high"), ends, strict=True))
    return list(found.values())


LOWER, OPEN, HIGHER = (0.1, 2.0), (-0.1, 2.0), (-2.0, -0.1)


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        (LOWER, "a lower object error (0.5 against 1.5 mm)"),
        (HIGHER, "a higher object error (0.5 against 1.5 mm)"),
        (OPEN, "an object error that does not differ significantly (0.5 against 1.5 mm)"),
        ((None, None), "an object error whose difference cannot be tested (0.5 against 1.5 mm)"),
    ],
    ids=["lower", "higher", "open", "no interval"],
)
def test_only_significant_differences_are_called_so(ends, words):
    sentence, *_ = answer(0.95, rows(what_error=ends, taps=LOWER), [], UNITS)
    assert sentence.startswith("At threshold 0.95, compared with passive perception, active perception has " + words)
    assert sentence.endswith("and a shorter reaction time (9 against 9 taps).")


@pytest.mark.parametrize(
    ("stored", "fresh", "words"),
    [
        ({"taps": LOWER}, {"taps": LOWER}, ["this difference remains significant."]),
        ({"taps": LOWER, "what_error": LOWER}, {"taps": OPEN, "what_error": OPEN}, ["error and reaction time are not"]),
        ({"taps": LOWER, "what_error": LOWER}, {"taps": OPEN, "what_error": LOWER}, ["in reaction time is not"]),
        ({"taps": OPEN}, {"taps": LOWER}, []),
        ({"taps": HIGHER}, {"taps": LOWER}, ["in reaction time is significant in the opposite direction."]),
        ({"taps": LOWER}, {}, ["in reaction time cannot be tested."]),
    ],
    ids=["kept", "none kept", "one kept", "none found", "reversed", "no interval"],
)
def test_it_is_said_whether_differences_hold_on_fresh_taps(stored, fresh, words):
    _, *more = answer(0.95, rows(**stored), rows(**fresh), UNITS)
    assert [end in sentence for sentence, end in zip(more, words, strict=True)] == [True] * len(words)


def test_one_policy_is_not_compared():
    sentence = answer(0.5, rows()[:1], [], {"what_error": "P(wrong)", "taps": "taps"})
    assert sentence == [
        "At threshold 0.5, passive perception has an object error of 1.5 P(wrong) and a reaction time of 9 taps."
    ]


def test_the_example_of_the_docstring_holds():
    assert doctest.testmod(module).failed == 0
