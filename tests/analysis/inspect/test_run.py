"""What may mislead is named, and nothing else is."""

import io

import numpy as np
import pytest
from rich.console import Console
from solidtouch.analysis.experiment.data_warnings import in_blocks, recorded_order
from solidtouch.analysis.inspect.page import inspection_page
from solidtouch.analysis.inspect.run import count_taps, inspect_taps
from solidtouch.analysis.page.terminal import show
from solidtouch.models.blocks import extreme_samples
from solidtouch.models.cutting.taxels import constant_taxels
from solidtouch.models.cutting.taxels import saturated_taxels as saturated
from solidtouch.models.io.load import load_taps
from solidtouch.models.taps import TapSet, concatenate


def saturated_taxels(samples):
    return saturated(samples, extreme_samples(samples))


def warnings_of(taps, **cells):
    return " ".join(inspect_taps(taps, taps.grid(**cells)).warnings)


def test_good_data_give_no_warning(make_taps):
    """Two sessions, every cell filled with seven distinct taps in each, classes interleaved, all taxels alive."""
    taps = make_taps()

    assert inspect_taps(taps, taps.grid()).warnings == ()


def test_counts_are_per_session_and_class(make_taps):
    taps = make_taps()
    taps = taps.select(~((taps.session == 1) & (taps.what == 3) & (taps.where == 1.5) & (taps.trial > 30)))
    counts = count_taps(taps, taps.grid())

    assert counts.shape == (2, 3, 4)
    assert counts.sum() == len(taps)
    assert counts[1, 1, 3] == 2
    assert counts[0, 1, 3] == 7


def test_empty_cells_and_classes_are_named(make_taps):
    taps = make_taps()
    few = taps.select(~((taps.what == 3) | (taps.where == 3.0) | ((taps.what == 1) & (taps.where == 1.5))))
    warnings = warnings_of(few)

    assert "Objects without any tap: “rod 8 mm”." in warnings
    assert "Positions without any tap: 3 mm." in warnings
    assert "1 of 12 (position, object) classes have no tap: (1.5 mm, rod 4 mm)." in warnings


def test_a_long_list_is_cut_with_its_length(make_taps):
    taps = make_taps(L=4, M=5)
    diagonal = taps.select(taps.where / 1.5 == taps.what)

    assert "12 of 20 (position, object) classes have no tap" in warnings_of(diagonal)
    assert "and 6 more" in warnings_of(diagonal)


def test_a_cell_that_is_missing_in_one_session_is_named(make_taps):
    taps = make_taps()
    taps = taps.select(~((taps.session == 1) & (taps.what == 2) & (taps.where == 0)))

    assert "no tap in some sessions: (0 mm, rod 6 mm) in session 1." in warnings_of(taps)


def test_single_contacts_cannot_accumulate(make_taps):
    taps = make_taps(sessions=3, repeats=1)

    assert "Each class has one tap per session, so evidence cannot accumulate over distinct contacts" in warnings_of(
        taps
    )
    assert "12 of 12 classes with taps have fewer than 5 distinct taps ((0 mm, rod 2 mm): 3," in warnings_of(taps)


def test_taps_with_equal_extremes_are_no_copies(make_taps):
    """Their samples are compared, here of taps and of the same taps played backwards."""
    taps = make_taps(repeats=5)
    backwards = TapSet(taps.dataset.assign(taps=(taps.dataset["taps"].dims, taps.taps[:, ::-1])))
    both = concatenate([taps, backwards])

    assert "exact copies" not in warnings_of(both)
    assert "120 taps are exact copies" in warnings_of(concatenate([both, backwards]))


def test_copies_do_not_count_as_distinct_taps(make_taps):
    taps = make_taps(repeats=1)
    copied = taps.select(np.repeat(np.arange(len(taps)), 6))

    assert "120 taps are exact copies" in warnings_of(copied)
    assert "Each class has one tap per session" in warnings_of(copied)


def test_one_session_is_named(make_taps):
    assert "only one" in warnings_of(make_taps(sessions=1))
    assert "only one" not in warnings_of(make_taps(sessions=2))


def test_taps_outside_the_classes_are_counted(make_taps):
    taps = make_taps(where=np.linspace(0, 3, 168))

    assert "of 168 taps lie outside all classes" in warnings_of(taps)


def test_blocks_of_objects_and_of_positions_are_told_apart(make_taps):
    taps = make_taps()
    by_object = taps.select(np.lexsort((taps.trial, taps.what, taps.session)))
    by_place = taps.select(np.lexsort((taps.trial, taps.where, taps.session)))
    for ordered, name in ((by_object, "object"), (by_place, "position")):
        data = ordered.dataset.assign_coords(trial=("tap", np.arange(168)))
        warnings = warnings_of(type(taps)(data))

        assert f"Recorded in blocks: in sessions 0, 1 the taps of each {name} are consecutive" in warnings
        assert warnings.count("Recorded in blocks") == 1


def test_blocks_of_cells_alone_are_found(make_taps):
    """Every cell is visited once, in a shuffled order of cells."""
    taps = make_taps(L=5, M=6, sessions=1)
    cell = (taps.where / 1.5 * 6 + taps.what).astype(int)
    shuffled = np.random.default_rng(1).permutation(30)[cell]
    data = taps.select(np.argsort(shuffled, kind="stable")).dataset.assign_coords(trial=("tap", np.arange(len(taps))))

    assert "the taps of each (position, object) class are consecutive" in warnings_of(type(taps)(data))


def test_trials_order_a_session_only_where_they_number_it():
    """Numbers that repeat count within a class and say nothing about the order of classes."""
    assert recorded_order(np.array([3, 1, 2])).tolist() == [1, 2, 0]
    assert recorded_order(np.array([1, 0, 1])).tolist() == [0, 1, 2]


@pytest.mark.parametrize(
    ("classes", "expected"),
    [
        ([0, 0, 1, 1], True),
        ([0, 0, 1, 1, 1, 2, -1], True),
        ([0, 1, 0, 1], False),
        ([0, 0, 1, 1, 0, 0], False),
        ([0, 0, 0], False),
        ([0, 1, 2, 3], False),
        ([0, 1, 1, 2], False),
        ([-1, -1, -1], False),
    ],
)
def test_blocks_need_two_classes_with_two_taps_each_in_one_run(classes, expected):
    assert in_blocks(classes) is expected


def press(n=20, j=30, limit=np.inf, seed=0):
    """Taps that rise from idle 0 to about 10 and fall again, shape (n, j, 1), cut off at `limit`."""
    rng = np.random.default_rng(seed)
    strength = rng.uniform(6, 14, size=(n, 1))
    shape = np.sin(np.linspace(0, np.pi, j))
    return np.minimum(np.round(strength * shape + rng.normal(0, 0.1, (n, j)), 2), limit)[:, :, np.newaxis]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("offset", [0.0, 200.0])
def test_a_taxel_that_stays_at_its_limit_is_saturated(sign, offset):
    """At the upper or the lower end, wherever the idle level lies."""
    taps = np.concatenate([press(), press(limit=8.0)], axis=2)

    assert saturated_taxels(sign * taps + offset) == (1,)


def test_a_taxel_at_its_idle_level_is_not_saturated():
    """An untouched taxel of an inverted 8-bit sensor rests at 255 and cannot rise above."""
    assert saturated_taxels(255 - np.maximum(press(), 0)) == ()


def test_coarse_steps_and_quiet_taxels_are_not_taken_for_a_limit():
    coarse = np.round(press() / 4)
    noise = np.random.default_rng(3).integers(0, 2, size=(20, 30, 1)) * 0.5

    assert saturated_taxels(coarse) == ()
    assert saturated_taxels(np.concatenate([press(), noise], axis=2)) == ()


def test_single_samples_can_show_saturation():
    samples = np.concatenate([np.linspace(0, 4, 50), np.full(30, 9.0)]).reshape(-1, 1, 1)

    assert saturated_taxels(samples) == (0,)
    assert saturated_taxels(np.linspace(0, 9, 80).reshape(-1, 1, 1)) == ()


def test_constant_taxels_are_dead_and_not_saturated(make_taps):
    taps = np.concatenate([press(), np.full((20, 30, 1), 3.0)], axis=2)

    assert constant_taxels(extreme_samples(taps)) == (1,)
    assert saturated_taxels(taps) == ()
    assert saturated_taxels(np.zeros((4, 3, 2))) == ()
    data = make_taps().dataset
    dead = data.assign(taps=data["taps"] * np.array([1, 1, 0, 1, 1]))
    assert "1 of 5 taxels are constant: 2." in warnings_of(type(make_taps())(dead))


def shown(taps, width=100, **cells):
    console = Console(file=io.StringIO(), width=width)
    show(inspection_page(inspect_taps(taps, taps.grid(**cells)), "a.nc"), console)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def test_the_tables_show_sizes_units_preparation_and_counts(make_taps):
    text = shown(make_taps(units="counts", sensor="[tip]", extra={"depth": np.zeros(168)}))

    for part in (
        "168 of 6 samples from 5 taxels",
        "mm",
        "counts",
        "[tip]",
        "rate_hz 50.0",
        "depth",
        "7+7",
        "No data-quality warnings.",
    ):
        assert part in text


def test_a_large_grid_is_condensed(make_taps):
    text = shown(make_taps(L=9, M=10, sessions=1, repeats=1))

    assert "90 of 90" in text
    assert "fewest" in text


def test_a_single_class_of_either_kind_is_shown(make_taps):
    assert "7+7" in shown(make_taps(L=1))
    assert "7+7" in shown(make_taps(M=1))


EXPECTED = {
    "barrett_ballcyl": ("Each class has one tap per session", "Recorded in blocks"),
    "barrett_boxes": (
        "Each class has one tap per session",
        "classes have no tap",
        "in some sessions",
        "Recorded in blocks",
    ),
    "eflesh_grid": (),
    "icub_grasp": ("Objects without any tap: “none”.", "Recorded in blocks"),
    "braille_icub": ("Recorded in blocks",),
}


@pytest.mark.parametrize("name", EXPECTED)
def test_recorded_data_are_warned_of_as_they_were_recorded(name, shared_data):
    """icub_grasp and braille_icub came in blocks, eflesh_grid interleaves, barrett has single contacts."""
    taps = load_taps(shared_data / f"{name}.npz")
    warnings = warnings_of(taps)

    for part in EXPECTED[name]:
        assert part in warnings
    if name == "eflesh_grid":
        assert warnings == ""
        assert warnings_of(taps, where_cell="3mm", what_cell="3mm") == ""
    assert "saturated" not in warnings
    assert "Single contact" not in warnings or name.startswith("barrett")


def test_uneven_positions_are_named(make_taps):
    """Moves are counted in classes, so steps of unequal length are worth knowing; even ones are not mentioned."""
    even = make_taps(L=3)
    uneven = make_taps(L=3, where_value=None, where=even.where**2)

    assert "unevenly spaced, by 2.25 to 6.75 mm" in " ".join(inspect_taps(uneven, uneven.grid()).warnings)
    assert "unevenly" not in " ".join(inspect_taps(even, even.grid()).warnings)


def test_one_object_is_named(make_taps):
    """It cannot be confused with another; a second one takes the warning away."""
    taps = make_taps()
    warnings = warnings_of(taps.select(taps.what == 1))

    assert "All taps are of one object, “rod 4 mm”" not in warnings
    assert "All taps are of one object, rod 4 mm: it cannot be confused with another" in warnings
    assert "one object" not in warnings_of(taps.select(taps.what < 2))
