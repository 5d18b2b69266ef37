"""Ranks of models at the levels of a comparison, and the best ones beside others."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.compare.page import best_models
from solidtouch.analysis.compare.ranking import Criterion, best_rows, headline, levels, point_fits, rank_rows
from solidtouch.analysis.page.page import Brief, Page
from solidtouch.analysis.page.terminal import as_text


def level(title: str, values: dict[str, float], *, larger: bool = True) -> Criterion:
    """A level whose intervals are of width 2 around differences to the first model, and of width 4 to the next one."""
    base = next(iter(values.values()))
    difference = {name: (value - base - 1, value - base + 1) for name, value in values.items()}
    ascending = sorted(values, key=values.__getitem__)
    gaps = {name: values[name] - values[below] for below, name in itertools.pairwise(ascending)}
    step = {name: (gap - 2, gap + 2) for name, gap in gaps.items()}
    return Criterion(title, f"being best at {title}", "nat", larger, values, difference, step)


TAPS = level("taps", {"a": -10.0, "b": -8.0, "c": -9.0})
ENDS = tuple(f"_{kind}_{end}" for kind in ("difference", "step") for end in ("low", "high"))
ERROR = level("active error", {"a": 0.4, "b": 0.9}, larger=False)


def test_ranks_follow_the_direction_of_the_level():
    """Larger scores and smaller errors are better; a model without a value has no rank."""
    rows = rank_rows([TAPS, ERROR], ["a", "b", "c"])
    ranks = [[cell and cell["rank"] for cell in row["levels"]] for row in rows]
    assert ranks == [[3, 1], [1, 2], [2, None]]


def row_of(level, reference="a"):
    (row,) = best_rows([level], reference)
    return row


def test_equal_models_share_the_better_rank():
    """Two winners are both first, the next is third, and both are named; no step says how they differ from others."""
    tied = level("taps", {"a": -9.0, "b": -8.0, "c": -8.0, "d": -10.0})
    assert [tied.rank(name) for name in "abcd"] == [3, 1, 1, 4]
    row = row_of(tied, "d")
    assert (row["best"], row["value"], row["second"]) == (["b", "c"], -8.0, "a")
    assert row["less_second"] == [1.0, None, None]
    assert row["less_reference"] == [2.0, *tied.difference["b"]]
    assert headline([tied], "d") == (
        "b and c are equally best in being best at taps. The difference from the second has no interval in being best "
        "at taps."
    )


BY_ROUNDING = {
    "log beliefs near 0": ({"a": -6.16e-14, "b": -1.85e-13, "c": -5.29e-7}, "nat", True, [1, 1, 3]),
    "log probabilities": ({"a": -253.0, "b": -253.0 - 1e-8, "c": -253.001}, "nat per tap", True, [1, 1, 3]),
    "errors": ({"a": 0.1 + 0.2, "b": 0.3, "c": 0.31}, "mm", False, [1, 1, 3]),
    "small errors": ({"a": 3e-12, "b": 2e-12, "c": 1e-12}, "m", False, [3, 2, 1]),
}


@pytest.mark.parametrize(("values", "unit", "larger", "ranks"), BY_ROUNDING.values(), ids=BY_ROUNDING)
def test_models_that_are_equal_but_for_rounding_share_a_rank(values, unit, larger, ranks):
    """And the headline says that they are equal."""
    one = level("it", values, larger=larger)._replace(unit=unit)

    assert [one.rank(name) for name in values] == ranks
    assert ("a and b are equally best" in headline([one], "c")) == (ranks[:2] == [1, 1])
    both = headline([level("x", {"c": 1.0, "a": 0.0}), one], "c")
    assert ("; a and b equally in being best at it." in both) == (ranks[:2] == [1, 1])


def test_the_best_is_compared_with_the_second_and_the_reference():
    """By the step to the second, and by the difference to the reference."""
    row = row_of(TAPS)
    assert (row["best"], row["second"], row["second_value"]) == (["b"], "c", -9.0)
    assert row["less_second"] == [1.0, -1.0, 3.0]
    assert row["less_reference"] == [2.0, 1.0, 3.0]
    assert (row["title"], row["unit"]) == ("taps", "nat")


def test_a_reference_that_wins_is_compared_with_the_second_best():
    """By the interval of the difference to it with the opposite sign; a single model is compared with none."""
    row = row_of(level("taps", {"a": -7.0, "b": -12.0, "c": -8.0}))
    assert (row["best"], row["second"]) == (["a"], "c")
    assert row["less_second"] == [1.0, 0.0, 2.0]
    assert row["less_reference"] is None
    skewed = Criterion("error", "errors", "mm", False, {"a": 1.0, "b": 3.0}, {"b": (0.5, 2.5)}, {})
    assert row_of(skewed)["less_second"] == [-2.0, -2.5, -0.5]
    assert best_rows([level("taps", {"a": -7.0})], "a") == []


def test_a_second_that_is_the_reference_is_compared_once():
    row = row_of(ERROR, "b")
    assert row["less_second"] == row["less_reference"] == [-0.5, *ERROR.difference["a"]]


def test_a_reference_that_shares_the_win_is_the_one_compared():
    """Intervals are those of differences to it, and so of no other winner."""
    values, difference = {"a": 0.0, "b": 0.0, "c": 0.5}, {"a": (-0.1, 0.1), "c": (0.2, 0.8)}
    tied = Criterion("x", "errors", "mm", False, values, difference, {"b": (-0.3, 0.3), "c": (0.1, 0.9)})
    row = row_of(tied, "b")
    assert row["best"] == ["a", "b"]
    assert row["less_second"] == [-0.5, -0.8, -0.2]
    assert row["less_reference"] is None


def test_the_best_error_is_compared_with_the_second_by_the_step_of_that_one():
    """The step of an error leads from the best up to the second, so its ends change sign and order."""
    values, difference = {"a": 3.0, "b": 1.0, "c": 2.0}, {"b": (-3.0, -1.5), "c": (-2.0, 0.1)}
    row = row_of(Criterion("x", "errors", "mm", False, values, difference, {"a": (0.0, 2.0), "c": (0.7, 1.2)}))
    assert row["less_second"] == [-1.0, -1.2, -0.7]
    assert row["less_reference"] == [-2.0, -3.0, -1.5]


def test_where_all_are_equal_there_is_no_second():
    row = row_of(level("taps", {"a": -7.0, "b": -7.0}))
    assert row["second"] is row["less_second"] is row["less_reference"] is None


def test_a_difference_without_an_interval_has_no_ends():
    row = row_of(Criterion("x", "errors", "mm", False, {"a": 3.0, "b": 1.0}, {}, {}))
    assert row["less_second"] == row["less_reference"] == [-2.0, None, None]


def sure(title: str, values: dict[str, float]) -> Criterion:
    """A level whose differences are all significant."""
    one = level(title, values)
    return one._replace(
        difference={name: (value - values["a"],) * 2 for name, value in values.items()},
        step={name: (high - 2,) * 2 for name, (_, high) in one.step.items()},
    )


def test_the_headline_names_who_is_best_at_what():
    """Models that are best at several levels once, in the order of the levels; levels of one model are left out."""
    taps, error = (sure(one.title, one.values) for one in (TAPS, ERROR._replace(values={"a": 0.9, "b": 0.4})))
    third, alone = sure("belief", {"a": -2.0, "b": -1.0}), sure("more", {"a": 1.0})
    assert headline([taps, error, third, alone], "a") == (
        "No model is best at all levels: b is best in being best at taps and being best at belief; a in being best at "
        "active error."
    )
    assert headline([taps, taps], "a") == "b is best at all levels."
    assert headline([error], "a") == "a is best in being best at active error."
    assert headline([alone], "a") == headline([], "a") == ""


def test_the_headline_says_where_the_best_may_be_no_better():
    """A difference whose interval holds 0, its ends included, is not significant; one without an interval is named."""
    taps, unknown = sure("taps", {"a": 0.0, "b": 1.0}), sure("x", {"a": 0.0, "b": 2.0})._replace(difference={}, step={})
    touching = sure("y", {"a": 0.0, "b": 2.0})._replace(difference={"b": (0.0, 4.0)})
    said = headline([taps, unknown, touching, level("z", {"a": 0.0, "b": 0.5})], "a")
    assert said == (
        "b is best at all levels. The difference from the second is not significant in being best at y and being best "
        "at z and has no interval in being best at x."
    )
    assert headline([level("z", {"a": 1.0, "b": 1.0})], "a") == "a and b are equally best in being best at z."


def test_equal_winners_are_named_together_and_a_common_winner_alone():
    tied = level("x", {"a": 1.0, "b": 1.0, "c": 0.0})
    assert headline([tied, TAPS], "a").startswith("b is best at all levels. ")
    assert headline([tied, level("y", {"a": 0.0, "b": 0.0, "c": 1.0})], "a").startswith(
        "No model is best at all levels: a and b are equally best in being best at x; c in"
    )


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


def test_the_best_models_are_broken_into_lines_where_the_terminal_is_narrow():
    """Many names of equal models do not make the table wide; its numbers stay whole."""
    names = ["profile", "profile-ar", "profile-mvn", "matrix-normal", "smooth"]
    row = {"title": "passive object error at 1.5 taps", "unit": "mm", "best": names, "value": 0.0, "second": "gaussian"}
    row |= {"second_value": 0.0086, "less_second": [-0.0086, -0.01, 0.0], "less_reference": [-0.13, -0.27, 0.01]}
    page = Page("", [Brief(best_models({"reference": "histogram", "best": [row]}))], [])
    text = as_text(page, 80)

    assert max(map(len, text.splitlines())) < 100
    assert "−0.13 [−0.27, 0.01]" in text
    assert all(name in text for name in names)
