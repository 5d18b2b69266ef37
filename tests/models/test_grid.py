"""Labels and values to class indices and back, and the taps of each class."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models.errors import InputError
from solidtouch.models.grid import (
    ClassGrid,
    episode_sessions,
    group,
    nearest_trained,
    parse_length,
    tap_pool,
    values_from_names,
)


def grid(where=(0.0, 1.0, 4.0), edges=None, members=(("a",), ("b", "c")), value=None, unit="mm"):
    return ClassGrid(
        np.asarray(where, dtype=float),
        unit,
        None if edges is None else np.asarray(edges, dtype=float),
        members,
        None if value is None else np.asarray(value, dtype=float),
        "" if value is None else "mm",
    )


SPACINGS = st.lists(st.floats(0.01, 100.0), min_size=1, max_size=12)
STARTS = st.floats(-1e3, 1e3)


@given(start=STARTS, spacings=SPACINGS)
def test_the_class_of_a_class_centre_is_the_class(start, spacings):
    """Listed values of any spacing, and the middles between any edges."""
    edges = start + np.cumsum([0.0, *spacings])
    centres = (edges[1:] + edges[:-1]) / 2
    expected = list(range(len(spacings)))

    assert grid(centres).where_index(centres).tolist() == expected
    assert grid(centres, edges).where_index(centres).tolist() == expected


@given(start=STARTS, width=st.floats(0.01, 50.0), cells=st.integers(1, 20))
def test_a_lower_edge_belongs_to_the_class_above_it(start, width, cells):
    edges = start + width * np.arange(cells + 1)
    index = grid(edges[:-1] + width / 2, edges).where_index(edges)

    assert index.tolist() == [*range(cells), -1]


@given(start=STARTS, spacings=SPACINGS)
def test_a_grid_survives_its_dictionary(start, spacings):
    edges = start + np.cumsum([0.0, *spacings])
    for given_edges in (None, edges):
        original = grid((edges[1:] + edges[:-1]) / 2, given_edges, value=(2, 5))
        read = ClassGrid.from_dict(original.to_dict())

        assert not original.differences(read)
        assert read.to_dict() == original.to_dict()


def test_values_beside_the_classes_have_none():
    assert grid().where_index([-1e-3, 0.5, 1.001, 4.0, 9.0]).tolist() == [-1, -1, -1, 2, -1]
    assert grid(edges=[-1, 0.5, 2, 6]).where_index([-1.01, -1, 0.49, 0.5, 5.99, 6]).tolist() == [-1, 0, 0, 1, 2, -1]
    assert grid().what_index(["c", "d", "a", "b"]).tolist() == [1, -1, 0, 1]


def test_one_class_finds_itself():
    assert grid([0.0]).where_index([0.0, 0.5]).tolist() == [0, -1]
    assert grid([7.5]).shape == (1, 2)


def test_errors_are_distances_or_whether_wrong():
    assert grid().where_error([0, 2, 1], [0, 0, 2]).tolist() == [0.0, 4.0, 3.0]
    assert grid(value=(2, 9)).what_error([0, 1], [1, 1]).tolist() == [7.0, 0.0]
    assert grid().what_error([0, 1], [1, 1]).tolist() == [1.0, 0.0]
    assert (grid().what_error_unit, grid(value=(2, 9)).what_error_unit) == ("P(wrong)", "mm")


def test_labels_leave_out_remarks_behind_the_unit():
    assert grid(unit="mm (x axis)").where_label(2) == "4 mm"
    assert grid(unit="encoder counts, 4th column").where_label(1) == "1 encoder counts"
    assert grid(unit="").where_label(1) == "1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"where": ()}, "at least one position and one object, got 0 and 2"),
        ({"members": ()}, "got 3 and 0"),
        ({"where": (0, 2, 2)}, "must increase"),
        ({"edges": (0, 1, 2)}, "3 position classes need 4 increasing edges"),
        ({"edges": (0, 1, 1, 2)}, "need 4 increasing edges"),
        ({"members": (("a",), ("a",))}, "is in two classes"),
        ({"value": (1, 2, 3)}, r"2 object classes need 2 values, got shape \(3,\)"),
    ],
)
def test_grids_that_contradict_themselves_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        grid(**arguments)


def test_other_dictionaries_are_no_grid():
    for fields in ({}, {**grid().to_dict(), "what_members": 3}, {**grid().to_dict(), "where_value": ["x"]}):
        with pytest.raises(InputError, match="Not a class grid"):
            ClassGrid.from_dict(fields)


def test_classes_can_be_left_out():
    some = grid(edges=[-1, 0.5, 2, 6], value=(2, 9)).select([1, 2], [1])

    assert some.where_edges is not None
    assert (some.where_value.tolist(), some.where_edges.tolist()) == ([1.0, 4.0], [0.5, 2.0, 6.0])
    assert some.what_members == (("b", "c"),)
    assert grid().select([0, 2], [0]).where_value.tolist() == [0.0, 4.0]
    with pytest.raises(InputError, match="Cannot leave out positions between others"):
        grid(edges=[-1, 0.5, 2, 6]).select([0, 2], [0])


def test_grids_of_other_classes_differ():
    for other, phrase in (
        (grid((0, 1)), "3 x 2 classes here and 2 x 2 there"),
        (grid((0, 1, 5)), "the positions differ"),
        (grid(unit="cm"), "the positions differ"),
        (grid(members=(("a",), ("b",))), "the objects differ"),
    ):
        assert grid().differences(other) == [phrase]


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [("3mm", "mm", 3.0), (" 3 mm ", "mm (x axis)", 3.0), ("3", "N", 3.0), ("0.3cm", "mm", 3.0), ("3e3um", "mm", 3.0)],
)
def test_lengths_are_converted(text, unit, expected):
    assert parse_length(text, unit, "--w") == pytest.approx(expected)


@pytest.mark.parametrize("text", ["", "mm", "-3mm", "0mm", "1.2.3mm", "nan", "inf", "1e999mm"])
def test_what_is_no_positive_length_is_refused(text):
    with pytest.raises(InputError, match="--w must be a positive length"):
        parse_length(text, "mm", "--w")


def test_lengths_of_another_unit_are_refused():
    for text, unit in (("3mm", ""), ("3mm", "counts"), ("3N", "mm")):
        with pytest.raises(InputError, match="cannot be converted"):
            parse_length(text, unit, "--w")


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["rod 4 mm", "rod 12 mm"], ([4.0, 12.0], "mm")),
        (["y=0mm", "y=1.5mm"], ([0.0, 1.5], "mm")),
        (["ball_1", "ball_2"], None),
        (["rod 4 mm", "ball 4 mm"], None),
        (["rod 4 mm", "rod 4 cm"], None),
        (["rod 4 mm", "cup"], None),
    ],
)
def test_sizes_are_read_from_names_that_spell_them(names, expected):
    found = values_from_names(names)

    assert (found if found is None else (found[0].tolist(), found[1])) == expected


@given(width=st.floats(0.01, 10.0), cells=st.lists(st.integers(0, 40), min_size=1))
def test_multiples_of_the_width_begin_their_own_cell(width, cells):
    values = width * np.array([0, *cells])

    assert group(values, width).tolist() == [0, *cells]


def test_pool_lists_taps_class_by_class_in_file_order(rng):
    """Every tap inside the grid stands once in the pool, in its class, in the order of the file."""
    where, what = rng.integers(-1, 4, 60), rng.integers(-1, 3, 60)
    pool = tap_pool(where, what, (4, 3))

    for l in range(4):
        for m in range(3):
            expected = np.flatnonzero((where == l) & (what == m))
            assert expected.tolist() == pool.taps(l, m).tolist()
    assert pool.count.sum() == len(pool.order)


def test_nearest_class_is_the_lower_of_two_equally_near():
    """Classes with taps are their own nearest; an object without a tap has none."""
    pool = tap_pool([0, 4, 2], [0, 0, 2], (5, 3))

    assert pool.nearest[0, :, 0].tolist() == [0, 0, 0, 4, 4]
    assert pool.nearest[0, :, 1].tolist() == [-1] * 5
    assert pool.nearest[0, :, 2].tolist() == [2] * 5


def test_sessions_of_a_pool_stand_apart(rng):
    """Each has the counts and nearest classes of its taps alone, and every tap stands in its class."""
    where, what, session = rng.integers(-1, 4, 80), rng.integers(-1, 3, 80), rng.integers(0, 3, 80)
    pool = tap_pool(where, what, (4, 3), session)
    for s in range(3):
        alone = tap_pool(np.where(session == s, where, -1), what, (4, 3))
        np.testing.assert_array_equal(pool.count[s], alone.count[0])
        np.testing.assert_array_equal(pool.nearest[s], alone.nearest[0])
        for l, m in np.argwhere(alone.per_class > 0):
            assert pool.pick(l, m, 0.7, s) == alone.pick(l, m, 0.7)
    whole = tap_pool(where, what, (4, 3))
    np.testing.assert_array_equal(pool.per_class, whole.per_class)
    for l, m in np.ndindex(4, 3):
        assert sorted(pool.taps(l, m)) == whole.taps(l, m).tolist()


@pytest.mark.parametrize(
    ("taps", "lost", "apart"), [(10, 0, True), (9, 0, False), (10, 1, True), (10, 2, False), (30, 0, True)]
)
def test_episodes_stay_in_a_session_that_can_stand_alone(taps, lost, apart):
    """Ten taps of a class in it, at most one class in ten in a single session; taps outside do not count."""
    cell, session = (index.ravel() for index in np.indices((10, 3 * taps)))
    session = session % 3
    keep = (cell >= lost) | (session == 0)
    where, what, session = np.append(cell[keep] // 2, -1), np.append(cell[keep] % 2, 0), np.append(session[keep], 9)
    expected = np.append(session[:-1], 0) if apart else np.zeros(len(session), int)
    np.testing.assert_array_equal(episode_sessions(where, what, 4 * session + 1), expected)


def test_a_pool_without_a_tap_is_refused():
    """Taps that all lie outside the grid are no pool."""
    with pytest.raises(InputError, match="No tap belongs to a class of the grid"):
        tap_pool([-1, 0], [0, -1], (5, 3))


@given(data=st.data(), L=st.integers(1, 9), M=st.integers(1, 4))
def test_nearest_trained_classes_by_all_distances(data, L, M):
    trained = np.array(data.draw(st.lists(st.lists(st.booleans(), min_size=M, max_size=M), min_size=L, max_size=L)))
    distance = np.abs(np.subtract.outer(np.arange(L), np.arange(L))).astype(float)

    expected = np.where(trained.T, distance[:, np.newaxis], np.inf).argmin(axis=-1)  # the first of equals

    np.testing.assert_array_equal(nearest_trained(trained), expected)
