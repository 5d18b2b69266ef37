"""Ranks of models at the levels of a comparison, and the sentences about them."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.compare.ranking import Criterion, findings, levels, point_fits, rank_rows


def level(title: str, values: dict[str, float], *, larger: bool = True) -> Criterion:
    """A level whose intervals are of width 2 around differences to the first model, and of width 4 to the next one."""
    base = next(iter(values.values()))
    difference = {name: (value - base - 1, value - base + 1) for name, value in values.items()}
    ascending = sorted(values, key=values.__getitem__)
    gaps = {name: values[name] - values[below] for below, name in itertools.pairwise(ascending)}
    step = {name: (gap - 2, gap + 2) for name, gap in gaps.items()}
    return Criterion(title, f"is best at {title}", "nat", larger, values, difference, step)


TAPS = level("taps", {"a": -10.0, "b": -8.0, "c": -9.0})
ENDS = tuple(f"_{kind}_{end}" for kind in ("difference", "step") for end in ("low", "high"))
ERROR = level("active error", {"a": 0.4, "b": 0.9}, larger=False)


def test_ranks_follow_the_direction_of_the_level():
    """Larger scores and smaller errors are better; a model without a value has no rank."""
    rows = rank_rows([TAPS, ERROR], ["a", "b", "c"])
    ranks = [[cell and cell["rank"] for cell in row["levels"]] for row in rows]
    assert ranks == [[3, 1], [1, 2], [2, None]]


def test_equal_models_share_the_better_rank():
    """Two winners are both first, the next is third, and the sentence names both."""
    tied = level("taps", {"a": -9.0, "b": -8.0, "c": -8.0, "d": -10.0})
    assert [tied.rank(name) for name in "abcd"] == [3, 1, 1, 4]
    assert tied.best == ["b", "c"]
    assert findings([tied], "a")[0].startswith(
        "b is best at taps: −8 nat (equally good: c), compared with −9 nat for a"
    )


def test_sentences_name_the_best_and_what_it_costs_elsewhere():
    """The best at taps is followed through the other levels, the reference is given beside every winner."""
    sentences = findings([TAPS, ERROR], "a")
    assert sentences[0] == (
        "b is best at taps: −8 nat, compared with −9 nat for c; difference 1.0 (−1.0 to 3.0), not significant; and "
        "with −10 nat for a; difference 2.0 (1.0 to 3.0)."
    )
    assert (
        "a is best at active error: 0.4 nat, compared with 0.9 nat for b, which predicts taps best; difference "
        "−0.5 (−1.5 to 0.5), not significant."
    ) in sentences
    assert "No model is best at all levels" in sentences[-1]


def test_a_reference_that_wins_is_compared_with_the_second_best():
    """By the interval of the difference to it with the opposite sign; a single model is compared with none."""
    second = "a is best at taps: −7 nat, compared with −8 nat for c; difference 1.0 (0.0 to 2.0), not significant."
    assert findings([level("taps", {"a": -7.0, "b": -12.0, "c": -8.0})], "a") == [second]
    skewed = Criterion("error", "is best", "mm", False, {"a": 1.0, "b": 3.0}, {"b": (0.5, 2.5)}, {})
    assert findings([skewed], "a") == ["a is best: 1 mm, compared with 3 mm for b; difference −2.0 (−2.5 to −0.5)."]
    assert findings([level("taps", {"a": -7.0})], "a") == ["a is best at taps: −7 nat."]


def test_a_reference_that_shares_the_win_is_the_one_compared():
    """Intervals are those of differences to it, and so of no other winner."""
    values, difference = {"a": 0.0, "b": 0.0, "c": 0.5}, {"a": (-0.1, 0.1), "c": (0.2, 0.8)}
    tied = Criterion("x", "is best", "mm", False, values, difference, {"b": (-0.3, 0.3), "c": (0.1, 0.9)})
    (sentence,) = findings([tied], "b")
    assert sentence == (
        "b is best: 0 mm (equally good: a), compared with 0.5 mm for c; difference −0.5 (−0.8 to −0.2)."
    )


def test_the_best_error_is_compared_with_the_second_by_the_step_of_that_one():
    """The step of an error leads from the best up to the second, so its ends change sign and order."""
    values, difference = {"a": 3.0, "b": 1.0, "c": 2.0}, {"b": (-3.0, -1.5), "c": (-2.0, 0.1)}
    steps = {"a": (0.0, 2.0), "c": (0.7, 1.2)}
    (sentence,) = findings([Criterion("x", "is best", "mm", False, values, difference, steps)], "a")
    assert sentence == (
        "b is best: 1 mm, compared with 2 mm for c; difference −1.00 (−1.20 to −0.70); and with 3 mm for a; "
        "difference −2.0 (−3.0 to −1.5)."
    )


def test_own_models_are_in_every_sentence():
    """With their value where they are neither best, nor second, nor the reference."""
    four = level("taps", {"a": -10.0, "b": -8.0, "c": -9.0, "mine": -11.0})
    (sentence,) = findings([four], "a", ["mine"])
    assert sentence.endswith("; mine has −11 nat.")
    assert "mine" not in findings([four], "a")[0]


def test_the_first_level_is_named_by_what_it_ranks():
    """Without groups to leave out nothing predicts taps."""
    first = TAPS._replace(title="class after 1 tap", said="infers the class after 1 tap best")
    assert "b, which infers the class after 1 tap best;" in findings([first, ERROR], "a")[1]


@pytest.mark.parametrize(("worse", "words"), [(-8.5, "0.5 (−0.5 to 1.5), not significant"), (-9.5, "1.5 (0.5 to 2.5)")])
def test_differences_that_may_be_none_are_called_so(worse, words):
    assert findings([level("taps", {"a": worse, "b": -8.0})], "a")[0].endswith(f"for a; difference {words}.")


def test_agreement_is_not_called_disagreement():
    """With one winner no sentence speaks of different orders."""
    assert not any("No model is best at all levels" in sentence for sentence in findings([TAPS, TAPS], "a"))


@pytest.mark.parametrize("levels", [[], [ERROR]])
def test_missing_levels_are_left_out(levels):
    """Without sessions to leave out there is no level of taps, and the rest still speaks."""
    assert len(findings(levels, "a")) == len(levels)


def compared(scores: dict, equal: xr.Dataset, means: xr.Dataset | None = None) -> SimpleNamespace:
    """What is ranked of a comparison of the models a and b."""
    classes = xr.Dataset(scores, {"model": ["a", "b"], "contacts": [1]})
    grid = SimpleNamespace(what_error_unit="mm")
    return SimpleNamespace(left_out_groups=means, missing=[], classes=classes, grid=grid, equal=equal)


@pytest.mark.parametrize(("integrated", "by"), [([-8.0, -11.0], "integrated"), ([-8.0, -10.0], "plug_in")])
def test_a_model_without_a_posterior_is_compared_by_points(integrated, by):
    """An integral over a posterior predicts better than a point, so it is no merit of the model that has one."""
    values = {"integrated": integrated, "plug_in": [-12.0, -10.0]}
    ends = {"": 0.0, **dict.fromkeys(ENDS, 1.0)}
    means = xr.Dataset(
        {
            f"{name}{end}": ("model", np.add(value, more))
            for name, value in values.items()
            for end, more in ends.items()
        },
        {"model": ["a", "b"]},
        {"unit": "session"},
    )
    nothing = {f"log_score_joint{end}": (("model", "contacts"), np.full((2, 1), np.nan)) for end in ends}
    (taps,) = levels(compared(nothing, xr.Dataset(coords={"policy": [], "model": ["a", "b"]}), means))

    assert taps.values == dict(zip("ab", values[by], strict=True))
    assert ("plug-in" in taps.said) == (by == "plug_in")
    assert point_fits(means) == ["b"] * (by == "plug_in")


def test_errors_are_ranked_at_the_longest_time_that_most_models_reach():
    """Not at the shortest, where all have hardly learned, nor at one that a single model reaches."""
    error = np.array([[0.6, 0.5, 0.3, 0.2], [0.5, 0.4, 0.1, np.nan]])
    coords = {"model": ["a", "b"], "policy": ["active"], "taps": [1.0, 2.0, 5.0, 9.0]}
    dims = ("model", "policy", "taps")
    errors = {f"what_error{end}": (dims, error[:, None]) for end in ("", *ENDS)}
    scores = {f"log_score_joint{end}": (("model", "contacts"), error[:, :1]) for end in ("", *ENDS)}
    comparison = compared(scores, xr.Dataset(errors, coords))
    assert levels(comparison)[-1].title == "active object error at 5 taps"
    assert levels(comparison)[-1].values == {"a": 0.3, "b": 0.1}
