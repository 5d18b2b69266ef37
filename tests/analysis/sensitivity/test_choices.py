"""The catalogue of open choices, and measurement models under them."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from solidtouch.analysis.experiment.sources import simulated_source
from solidtouch.analysis.sensitivity.choices import CHOICES, Option, Reading, applicable, changed
from solidtouch.analysis.sensitivity.model import histograms, impossible_share, with_reading
from solidtouch.models.errors import InputError
from solidtouch.models.measurement.histogram import fit
from solidtouch.models.taps import TapSet

RECORDS = Path(__file__).parents[3] / "docs" / "decisions"


def read_model(reading, train, grid):
    return with_reading(reading, histograms(reading, train, grid))


@pytest.fixture(scope="module")
def taps(make_taps):
    return make_taps(sessions=1)


@pytest.fixture(scope="module")
def others(make_taps):
    """Others of the same classes, some of them beyond the training range."""
    taps = make_taps(sessions=1, seed=5)
    return TapSet(taps.dataset.assign(taps=1.4 * taps.dataset["taps"] - 2))


def scaled(taps, factor):
    """The same taps with each taxel in a unit of its own."""
    return TapSet(taps.dataset.assign(taps=taps.dataset["taps"] * factor + 3 * factor))


def test_each_field_belongs_to_one_choice():
    """Options of different choices combine, and every field of a reading is a choice."""
    owner = [(choice.name, {name for option in choice.options for name in option.changes}) for choice in CHOICES]
    names = [name for _, own in owner for name in own]
    assert sorted(names) == sorted(field.name for field in fields(Reading))
    assert all(len(own) == 1 for _, own in owner)


@pytest.mark.parametrize("choice", CHOICES, ids=lambda choice: choice.name)
def test_options_differ_from_the_default_and_are_recorded(choice):
    """An option is another reading, no two have the same name, and a note says why the default is as it is."""
    readings = [changed([option]) for option in choice.options]
    assert len(set(readings)) == len(readings)
    assert Reading() not in readings
    names = [choice.default, *(option.name for option in choice.options), *(name for name, _ in choice.not_run)]
    assert len(set(names)) == len(names)
    assert (RECORDS / choice.record).is_file()
    assert choice.paper.endswith(".")


def test_options_that_cannot_be_told_from_the_default_are_left_out_with_a_reason(make_taps):
    """Small grids have fewer neighbours, taps of one sample no root, one position nowhere to move."""
    grid = make_taps(L=4, M=2).grid()
    found = applicable(grid, 1, simulated=False)
    reasons = {(choice, option): reason for choice, option, reason in found.skipped}
    assert reasons["fixation point", "one class below"] == "it is the first class here"
    assert reasons["fixation point", "two classes above"] == "it is the last class here"
    assert reasons["root of the likelihood", "none"] == "taps of one sample have no root"
    assert ("high-pass", "none") in reasons
    assert "high-pass" not in [choice.name for choice in found.choices]
    two = {option: reason for _, option, reason in applicable(make_taps(L=2, M=2).grid(), 5, simulated=True).skipped}
    assert two["first class"] == "it is the default here"
    assert two["one class below"] == "there are only 2 positions"
    alone = applicable(make_taps(L=1, M=2).grid(), 5, simulated=True)
    names = {choice.name for choice in alone.choices}
    assert not names & {choice.name for choice in CHOICES if choice.active_only}
    assert "position error" not in names
    assert len(found.options) + len(found.skipped) == sum(len(choice.options) for choice in CHOICES)


def test_a_fixation_point_outside_the_range_is_refused():
    assert Reading(fixation="last").fixation_index(4) == 3
    assert Reading(fixation="first").fixation_index(4) == 0
    assert Reading().fixation_index(16) == 7
    with pytest.raises(InputError, match=r"no where class \+9 from the middle one of 4"):
        Reading(fixation=9).fixation_index(4)


@pytest.mark.parametrize("L", [3, 4, 5, 6, 11, 16])
def test_fixation_points_are_the_neighbours_of_the_default_and_say_where(make_taps, L):
    """On every grid; each is another class, and its name has the place of that class with unit."""
    grid = make_taps(L=L, M=2).grid()
    (choice,) = (one for one in applicable(grid, 5, simulated=False).choices if one.name == "fixation point")
    middle = Reading().fixation_index(L)
    index = [changed([option]).fixation_index(L) for option in choice.options]
    assert sorted(index) == sorted({0, middle - 1, middle + 1, min(middle + 2, L - 1), L - 1})
    assert [option.name.split(" (")[1] for option in choice.options] == [f"{grid.where_label(i)})" for i in index]
    assert choice.default == f"middle, the lower one ({grid.where_label(middle)})"


def test_the_fixation_points_of_the_paper_are_told_in_mm():
    """16 classes of 1 mm, of which the one from 7 to 8 mm is the default."""
    source = simulated_source("paper", 1, 0)
    catalogue = applicable(source.grid, source.samples, simulated=True)
    (choice,) = (one for one in catalogue.choices if one.name == "fixation point")
    assert choice.default == "middle, the lower one (7.5 mm)"
    assert [option.name for option in choice.options] == [
        "first class (0.5 mm)",
        "one class below (6.5 mm)",
        "one class above (8.5 mm)",
        "two classes above (9.5 mm)",
        "last class (15.5 mm)",
    ]


def test_the_default_is_the_histogram_of_the_paper(taps, others):
    grid = taps.grid()
    model = read_model(Reading(), taps, grid)
    np.testing.assert_array_equal(model.log_likelihood(others.taps), fit(taps, grid).log_likelihood(others.taps))


def slow_log_likelihood(train, test, reading, bins):
    """Eq. 1 and 2 by loops over classes, taxels and samples."""
    grid = train.grid()
    where, what = train.indices(grid)
    low, high = train.taps.min(), train.taps.max()
    width = (high - low) / bins
    J, K = test.taps.shape[1:]
    found = np.zeros((len(test), *grid.shape))
    for l, m in np.ndindex(*grid.shape):
        own = train.taps[(where == l) & (what == m)]
        for k in range(K):
            at = np.minimum(((own[:, :, k].ravel() - low) / width).astype(int), bins - 1)
            counts = np.bincount(at, minlength=bins).astype(float)
            total = counts.sum()
            if reading.added == "all":
                counts += reading.pseudocount
            else:
                counts[counts == 0] = reading.pseudocount
            total = total if reading.added == "empty, not normalised" else counts.sum()
            for i in range(len(test)):
                for value in test.taps[i, :, k]:
                    b = int(np.clip(np.floor((value - low) / width), 0, bins - 1))
                    p = counts[b] / total
                    if not low <= value <= high:
                        p = {"end bin": p, "empty bin": reading.pseudocount / total, "left out": 1.0}[reading.outside]
                    found[i, l, m] += np.log(p) / J
    return found


@pytest.mark.parametrize("outside", ["end bin", "empty bin", "left out"])
@pytest.mark.parametrize("added", ["all", "empty", "empty, not normalised"])
def test_tables_are_those_of_loops(taps, others, added, outside):
    """Where the pseudocount goes and what a sample beyond the range counts as, against loops over everything."""
    reading = Reading(bins=7, pseudocount=0.3, added=added, outside=outside)
    few = others.select(np.arange(3, 12))
    assert few.taps.max() > taps.taps.max()
    assert few.taps.min() < taps.taps.min()
    model = read_model(reading, taps, taps.grid())
    np.testing.assert_allclose(model.log_likelihood(few.taps), slow_log_likelihood(taps, few, reading, 7), rtol=1e-10)


def test_far_samples_fall_into_the_outer_bins(taps):
    """However far: what a sample beyond the range counts as does not depend on how far beyond."""
    model = read_model(Reading(outside="left out"), taps, taps.grid())
    near, far = taps.taps[:1].copy(), taps.taps[:1].copy()
    near[0, 0, 0], far[0, 0, 0] = taps.taps.max() + 1e-3, 1e30
    np.testing.assert_array_equal(model.log_likelihood(near), model.log_likelihood(far))


def test_standardised_taxels_have_no_unit(taps, others):
    """Other units for each taxel change nothing where taxels are standardised, and much where they are not."""
    factor = 2.0 ** np.arange(taps.dataset.sizes["taxel"])
    grid = taps.grid()
    for value_range, same in (("standardised", True), ("taxel", True), ("global", False)):
        reading = Reading(bins=9, value_range=value_range)
        plain = read_model(reading, taps, grid).log_likelihood(others.taps)
        other = read_model(reading, scaled(taps, factor), grid).log_likelihood(scaled(others, factor).taps)
        assert np.allclose(plain, other, rtol=1e-6) is same


def test_a_constant_taxel_can_be_standardised(make_taps):
    taps = make_taps(sessions=1)
    values = taps.taps.copy()
    values[:, :, 0] = 4.0
    taps = TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, values)))
    model = read_model(Reading(value_range="standardised"), taps, taps.grid())
    assert np.isfinite(model.log_likelihood(taps.taps)).all()


def test_impossible_taps_are_counted(taps, others):
    """Without a pseudocount some are impossible under their own class, with one none is, and no training tap is."""
    grid = taps.grid()
    raw = read_model(Reading(pseudocount=0.0), taps, grid)
    assert 0 < impossible_share(raw, others) <= 1
    assert impossible_share(raw, taps) == 0
    assert impossible_share(read_model(Reading(), taps, grid), others) == 0


def test_untrained_classes_stay_impossible(taps):
    """Under every treatment of empty bins and samples beyond the range."""
    grid = taps.grid()
    where, what = taps.indices(grid)
    some = taps.select((where != 1) | (what != 2))
    for change in ({"added": "empty"}, {"outside": "left out"}, {"outside": "empty bin", "added": "empty"}):
        model = read_model(replace(Reading(), **change), some, grid)
        assert np.isneginf(model.log_prior[1, 2])
        assert np.isneginf(model.log_likelihood(taps.taps)[:, 1, 2]).all()


def test_options_combine():
    first, second = Option("a", {"bins": 50}), Option("b", {"power": "none"})
    assert changed([first, second]) == changed([second, first]) == Reading(bins=50, power="none")
