"""Plans name objects and places, and say which key is wrong."""

from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.hardware.recording.plan import load_plan, parse_plan
from solidtouch.hardware.rig.settings import RangeSettings, load_rig
from solidtouch.models.errors import InputError

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
OBJECTS = "\nobjects = [{ name = 'thin' }, { name = 'thick' }, { name = 'cone' }]"


def test_the_example_is_the_papers_plan_and_fits_the_example_rig():
    """5 rods, 320 positions each, none on the border of a class; sec. 2.3 of the paper."""
    plan = load_plan(EXAMPLES / "plan.toml")
    plan.check_range(load_rig(EXAMPLES / "rig.toml").range)
    taps = list(plan.taps())

    assert [thing.size_mm for thing in plan.objects] == [4, 6, 8, 10, 12]
    assert len(taps) == 5 * 320
    assert [tap.where_mm for tap in taps[:3]] == [0.025, 0.075, 0.125]
    assert taps[319].where_mm == 15.975
    assert [tap.trial for tap in taps] == list(range(1600))


def test_positions_may_be_a_list():
    plan = parse_plan("session = 6\ntaps_per_position = 2\npositions = [3, 1.5]" + OBJECTS)
    taps = list(plan.taps())

    assert [(tap.what, tap.where_mm) for tap in taps[:5]] == [(0, 3), (0, 3), (0, 1.5), (0, 1.5), (1, 3)]
    assert {tap.session for tap in taps} == {6}


@given(seed=st.integers(0, 2**40), repeats=st.integers(1, 3))
def test_a_shuffled_plan_has_the_same_taps_object_by_object(seed, repeats):
    """The order is that of the seed, and differs from object to object."""
    text = f"seed = {seed}\ntaps_per_position = {repeats}\npositions = {list(range(30))}" + OBJECTS
    forward, shuffled = parse_plan(text), parse_plan("order = 'shuffled'\n" + text)
    taps = list(shuffled.taps())

    assert Counter((tap.what, tap.where_mm) for tap in taps) == Counter(
        (tap.what, tap.where_mm) for tap in forward.taps()
    )
    assert [tap.what for tap in taps] == sorted(tap.what for tap in taps)
    assert taps == list(shuffled.taps())
    another = parse_plan("order = 'shuffled'\nsession = 1\n" + text)
    assert [tap.where_mm for tap in taps] != [tap.where_mm for tap in another.taps()]
    first, second = ([tap.where_mm for tap in taps if tap.what == what] for what in (0, 1))
    assert first != sorted(first)
    assert first != second


SPACED = "positions = {{ start_mm = {}, end_mm = {}, spacing_mm = {} }}"
BAD = {
    "no objects": ("positions = [1]", "missing key `objects`"),
    "empty objects": ("positions = [1]\nobjects = []", r"^objects: must be a list of length 1 or more, got"),
    "no name": (
        "positions = [1]\nobjects = [{ name = '' }]",
        r"^objects\[0\]\.name: must be a text of length 1 or more, got",
    ),
    "unknown key": ("positions = [1]\nspeed = 3" + OBJECTS, "unknown key `speed`"),
    "twice": ("positions = [1]\nobjects = [{ name = 'a' }, { name = 'a' }]", "two objects have the same name"),
    "size of one": (
        "positions = [1]\nobjects = [{ name = 'a', size_mm = 1 }, { name = 'b' }]",
        "give it for all or none",
    ),
    "size nan": (
        "positions = [1]\nobjects = [{ name = 'a', size_mm = nan }]",
        "size_mm: must be a number from .* got nan",
    ),
    "size infinite": (
        "positions = [1]\nobjects = [{ name = 'a', size_mm = inf }]",
        "size_mm: must be a number from .* got inf",
    ),
    "size negative": (
        "positions = [1]\nobjects = [{ name = 'a', size_mm = -8 }]",
        r"size_mm: must be a number from 0\.0001 .* got -8",
    ),
    "no positions": ("positions = []" + OBJECTS, "^positions: must list at least one number"),
    "position inf": (
        "positions = [inf]" + OBJECTS,
        r"^positions\[0\]: must be a number from -10,000 to 10,000, got inf",
    ),
    "half a spacing": (SPACED.format(0, 1, 0.4) + OBJECTS, "a whole number of spacings, 1 to 1000000, got 2.5"),
    "backwards": (SPACED.format(1, 0, 0.5) + OBJECTS, "a whole number of spacings, 1 to 1000000, got -2"),
    "endless": (
        SPACED.format("-1e308", "1e308", 1e-3) + OBJECTS,
        "start_mm: must be a number from -10,000 to 10,000, got -1e",
    ),
    "spacing 0": (SPACED.format(0, 1, 0) + OBJECTS, r"^positions\.spacing_mm: must be a number from 0\.0001"),
    "start nan": (SPACED.format("nan", 1, 1) + OBJECTS, r"^positions\.start_mm: must be a number from .* got nan"),
    "taps": (
        "taps_per_position = 0\npositions = [1]" + OBJECTS,
        "^taps_per_position: must be an integer from 1 to .* got 0",
    ),
    "ages": ("taps_per_position = 5_000_001\npositions = [1, 2]" + OBJECTS, "plan has .* taps, at most 10000000"),
    "order": ("order = 'random'\npositions = [1]" + OBJECTS, "^order: must be forward or shuffled, got 'random'"),
    "no toml": ("positions = [1", "not TOML"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_plan_is_refused_by_its_key(case):
    text, message = BAD[case]
    with pytest.raises(InputError, match=message):
        parse_plan(text)


def test_the_file_is_named(tmp_path):
    path = tmp_path / "plan.toml"
    with pytest.raises(InputError, match=r"plan\.toml: cannot read: No such file"):
        load_plan(path)
    path.write_text("x = 1")
    with pytest.raises(InputError, match=r"plan\.toml: unknown key"):
        load_plan(path)
    path.write_bytes(b"\xff")
    with pytest.raises(InputError, match=r"plan\.toml: cannot read: not UTF-8"):
        load_plan(path)


@pytest.mark.parametrize("place", [-0.1, 4.0, 4.1])
def test_a_position_without_a_where_class_is_refused(place):
    """The upper end belongs to no class."""
    plan = parse_plan(f"positions = [1, {place}]" + OBJECTS)

    with pytest.raises(InputError, match=f"positions: {place:g} mm is outside the range of the rig, 0 mm up to"):
        plan.check_range(RangeSettings(start_mm=0, end_mm=4, cell_mm=2))
