"""The study of own models tells what it is given."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from solidtouch.models.measurement.generic.contract import StoryFunction
from solidtouch.models.measurement.generic.story import at_prior, batch_of

import solidtouch as st
from benchmarks.page import check_block
from benchmarks.studies.results import own_models

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "own-models.md"


def test_its_blocks_have_a_place_in_the_page():
    check_block(PAGE, *own_models.BLOCKS)


def test_the_wrong_model_gives_all_classes_one_likelihood(make_taps):
    taps = make_taps(J=4, K=3)
    story = StoryFunction.of(own_models.labels_ignored, "labels_ignored")
    batch = batch_of(taps.grid(), taps.preprocessing, 3)
    form = at_prior(story, batch, np.random.default_rng(0), [np.random.default_rng(1)])
    table = form.table(np.linspace(-3, 3, 8))

    assert (table == table[:1, :1]).all()
    assert np.ptp(table) > 0


def test_few_classes_are_neighbours(make_taps):
    taps = make_taps(7, 4, K=5)
    few = own_models.small(taps)
    where, what = few.indices(few.grid())
    assert sorted({*zip(where.tolist(), what.tolist(), strict=True)}) == [(l, m) for l in (2, 3, 4) for m in (0, 1)]
    assert few.taps.shape[1:] == (taps.taps.shape[1], 3)


def test_a_place_is_the_worse_one_of_ties():
    scores = xr.Dataset({"accuracy_joint": ("model", [0.5, 0.1, 0.1, 0.9])}, {"model": ["a", "b", "c", "d"]})
    assert [own_models.place(scores, name) for name in "abcd"] == [2, 4, 4, 1]


def test_the_largest_difference_of_some_routes_is_shown():
    rows = [
        SimpleNamespace(routes=routes, largest=value) for routes, value in (("a", 1e-12), ("b", 3e-11), ("a", 2e-13))
    ]
    check = SimpleNamespace(rows=rows)
    assert [own_models.largest(check, routes) for routes in ([*"ab"], ["a"], ["c"])] == ["3e-11", "1e-12", "–"]


@pytest.fixture(scope="module")
def report(make_taps):
    """Two models compared on two sessions."""
    taps = make_taps(3, 2, 4, 2, sessions=2, repeats=8)
    return own_models.comparison(own_models.DataSet([taps]), ["histogram", "gaussian"])


@pytest.mark.slow
def test_a_comparison_has_a_row_for_each_model_and_says_where_the_wrong_one_ends(report):
    lines = own_models.compared(report, "gaussian").splitlines()
    cells = [cell.strip() for cell in lines[3].split("|")]

    assert [line.split(" | ")[0] for line in lines[2:4]] == ["| histogram", "| gaussian"]
    accuracy = float(report.classes["accuracy_joint"].sel(model="gaussian")[0])
    assert cells[5].startswith(f"{accuracy:.1f}"[:3])
    place = own_models.place(report.classes.isel(contacts=0), "gaussian")
    assert f"`gaussian` is {place} of 2 after 1 tap" in lines[5]
    assert "chance is 0.167" in lines[5]


@pytest.mark.slow
def test_an_episode_is_followed_by_a_second_engine(make_taps):
    taps = make_taps(3, 2, 4, 2, sessions=2, repeats=8)
    row = own_models.episode_row("gaussian", st.fit(taps, "gaussian"), taps)
    assert row[0] == "gaussian"
    assert int(row[2]) >= 1
