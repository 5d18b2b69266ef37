"""Tap sets hold what they say, on disk too."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.models.errors import InputError
from solidtouch.models.io.joining import relabel
from solidtouch.models.preprocessing import Preprocessing
from solidtouch.models.taps import TapSet, check_compatible, concatenate


def drop(name):
    return lambda data: data.drop_vars(name)


def put(name, place, value):
    def change(data):
        values = data[name].values.copy()
        values[place] = value
        return (
            data.assign({name: (data[name].dims, values)})
            if name == "taps"
            else data.assign_coords({name: (data[name].dims, values, data[name].attrs)})
        )

    return change


BAD = {
    **{
        f"{name} missing": (drop(name), f"Missing array {name}")
        for name in ("taps", "what", "where", "session", "trial", "what_name", "where_value")
    },
    "axes": (lambda d: d.transpose("taxel", ..., "sample"), r"taps must have dims \('tap', 'sample', 'taxel'\)"),
    "label axes": (
        lambda d: d.drop_vars("what").assign_coords(what=("sample", np.zeros(6, int))),
        r"what must have dims \('tap',\), got \('sample',\)",
    ),
    "table without axis": (
        lambda d: d.drop_vars("what_name").assign_coords(what_name="a"),
        "what_name must have dims",
    ),
    "no tap": (lambda d: d.isel(tap=slice(0)), "taps must not be empty"),
    "nan": (put("taps", (3, 2, 1), np.nan), r"taps\[3, 2, 1\] is nan"),
    "where nan": (put("where", 3, np.nan), r"where\[3\] is nan"),
    "what above": (put("what", 3, 4), r"what\[3\] is 4, outside its table of 4 entries"),
    "what below": (put("what", 3, -1), r"what\[3\] is -1"),
    "what real": (lambda d: d.assign_coords(what=d["what"] * 1.0), "what must hold integers"),
    "session text": (lambda d: d.assign_coords(session=d["session"].astype(str)), "session must hold integers"),
    "names twice": (put("what_name", 1, "rod 2 mm"), "what_name has a repeated name"),
    "places fall": (put("where_value", 1, -1.0), "where_value must increase"),
    "edges": (lambda d: d.assign_coords(where_edges=("where_edge", np.arange(3.0))), "where_edges must have 4 values"),
    "extra nan": (lambda d: d.assign(depth=("tap", np.full(168, np.inf))), r"depth\[0\] is inf"),
    "record": (lambda d: d.assign_attrs(preprocessing="{}"), "Not a preprocessing record"),
    "record length": (
        lambda d: d.assign_attrs(preprocessing=Preprocessing(samples=5).to_json()),
        "has 5 samples, but taps have 6",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_a_dataset_that_contradicts_itself_is_refused(case, make_taps):
    change, message = BAD[case]
    with pytest.raises(InputError, match=message):
        TapSet(change(make_taps().dataset))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"session": np.zeros(5, int)}, "do not match"),
        ({"extra": {"depth": np.zeros((168, 3))}}, "do not match"),
        ({"extra": {"cube": np.zeros((168, 5, 2))}}, "cube must have"),
        ({"where": np.zeros((168, 1))}, r"where must have 1 axes, got shape \(168, 1\)"),
        ({"taxel_position": np.zeros(5)}, "taxel_position must have 2 axes"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(more, message, make_taps):
    with pytest.raises(InputError, match=message):
        make_taps(**more)


def test_samples_need_three_axes():
    with pytest.raises(InputError, match=r"three axes \(tap, sample, taxel\), got shape \(3, 2\)"):
        TapSet.from_arrays(np.zeros((3, 2)), np.zeros(3, int), ["a"], preprocessing=Preprocessing(samples=2))


def test_a_saved_tap_set_is_the_same(make_taps, tmp_path):
    taps = make_taps(
        what_value=[2.0, 4, 6, 8], what_unit="mm", taxel_position=np.ones((5, 2)), sensor="s", source="q", licence="l"
    )
    taps.save(tmp_path / "a.nc")
    read = TapSet.load(tmp_path / "a.nc")

    xr.testing.assert_identical(taps.dataset, read.dataset)
    assert read.preprocessing == taps.preprocessing


def test_units_that_name_a_time_stay_units(make_taps, tmp_path):
    """xarray would turn positions in minutes of arc into time spans."""
    make_taps(where_unit="minutes").save(tmp_path / "a.nc")
    read = TapSet.load(tmp_path / "a.nc")

    assert read.where_unit == "minutes"
    assert read.where.max() == 3.0


def test_an_existing_file_is_overwritten_only_by_force(make_taps, tmp_path):
    path = tmp_path / "a.nc"
    make_taps(repeats=1).save(path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"already exists; use --force to overwrite it"):
        make_taps().save(path)
    assert path.read_bytes() == before

    make_taps().save(path, force=True)

    assert len(TapSet.load(path)) == 168
    assert [p.name for p in tmp_path.iterdir()] == ["a.nc"]


@pytest.mark.parametrize(("name", "message"), [("no/a.nc", "no folder"), (".", "is a folder, expected a file")])
def test_a_place_that_cannot_be_written_is_refused(name, message, make_taps, tmp_path):
    with pytest.raises(InputError, match=message):
        make_taps().save(tmp_path / name)


@pytest.mark.parametrize("name", ["a.txt", "a.npz", "a"])
def test_a_name_that_no_loader_takes_for_netcdf_is_refused(name, make_taps, tmp_path):
    with pytest.raises(InputError, match=rf"{name}: the file name must end in \.nc\."):
        make_taps().save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_other_netcdf_is_no_tap_set(tmp_path):
    xr.Dataset({"x": ("y", [1.0])}).to_netcdf(tmp_path / "a.nc", engine="h5netcdf")

    with pytest.raises(InputError, match="not a tap set"):
        TapSet.load(tmp_path / "a.nc")
    with pytest.raises(InputError, match="no such file"):
        TapSet.load(tmp_path / "b.nc")


def test_a_damaged_label_is_reported_with_the_file(make_taps, tmp_path):
    data = put("where", 3, np.nan)(make_taps().dataset)
    data.to_netcdf(tmp_path / "a.nc", engine="h5netcdf")

    with pytest.raises(InputError, match=r"a\.nc: where\[3\] is nan"):
        TapSet.load(tmp_path / "a.nc")


def test_selected_taps_keep_their_labels_and_tables(make_taps):
    taps = make_taps()
    some = taps.select(taps.what == 2)

    assert len(some) == 42
    assert set(some.what) == {2}
    assert some.what_name == taps.what_name
    assert taps.select([5, 3]).trial.tolist() == [5, 3]
    assert taps.select(slice(2, 8, 3)).trial.tolist() == [2, 5]
    with pytest.raises(InputError, match="must not be empty"):
        taps.select(np.zeros(168, bool))


def test_parts_join_to_the_whole(make_taps):
    taps = make_taps(extra={"depth": np.arange(168.0)})
    whole = concatenate([taps.select(taps.session == s) for s in (0, 1)])

    xr.testing.assert_equal(taps.dataset, whole.dataset)


def test_samples_may_be_missing_where_they_may_in_a_part(make_taps):
    taps = make_taps()
    gaps = TapSet(put("taps", (3, slice(None), 1), np.nan)(taps.dataset).assign_attrs(missing="drop"))
    for parts in ([taps, gaps], [gaps, taps]):
        assert concatenate(parts).missing == "drop"


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"K": 7}, "TRAIN has 5 taxels and TEST has 7"),
        ({"where_unit": "cm"}, "TRAIN has positions in 'mm', TEST in 'cm'"),
        ({"preprocessing": Preprocessing(samples=6)}, r"differ in preprocessing: rate_hz is 50\.0 here and None there"),
    ],
)
def test_tap_sets_that_no_model_can_share_are_refused(other, message, make_taps):
    with pytest.raises(InputError, match=message):
        check_compatible(make_taps(), make_taps(**other))


def test_parts_with_other_objects_are_refused(make_taps):
    with pytest.raises(InputError, match="part 2: objects differ from those of part 1"):
        concatenate([make_taps(), make_taps(M=3)])
    with pytest.raises(InputError, match="There are no taps"):
        concatenate([])


def test_parts_bring_their_positions(make_taps):
    """Parts that have not all positions in their tables join to a set that has."""
    taps = make_taps(L=5)
    near = make_taps(L=3)
    whole = concatenate([near, taps])

    assert whole.dataset["where_value"].values.tolist() == taps.dataset["where_value"].values.tolist()
    assert len(whole) == len(near) + len(taps)


def test_cells_group_positions_and_sizes(make_taps):
    """1.5 mm positions in 3 mm cells; rods of 2, 4, 6, 8 mm in 4 mm cells, their size read from the name."""
    grid = make_taps(L=5).grid("3mm", "4mm")

    assert grid.shape == (3, 2)
    assert grid.where_value.tolist() == [0.75, 3.75, 6.0]
    assert grid.where_edges is not None
    assert grid.where_edges.tolist() == [0.0, 3.0, 6.0, 9.0]
    assert grid.what_name == ("rod 2 mm … rod 4 mm", "rod 6 mm … rod 8 mm")
    assert grid.what_value is not None
    assert grid.what_value.tolist() == [3.0, 7.0]


@pytest.mark.parametrize(
    ("where", "what", "message"),
    [
        ("3 N", None, r"\(--where-cell\) '3 N' cannot be converted to 'mm'"),
        ("-3mm", None, r"\(--where-cell\) must be a positive length"),
        ("0.5mm", None, "leaves a cell without a position"),
        (None, "wide", r"\(--what-cell\) must be a positive length"),
    ],
)
def test_widths_that_mean_nothing_are_refused(where, what, message, make_taps):
    with pytest.raises(InputError, match=message):
        make_taps().grid(where, what)


@pytest.fixture(scope="module")
def line():
    """Taps of two objects every 0.05 mm from 0.025 to 3.975 mm, in 4 classes of 1 mm."""
    place = 0.05 * (np.arange(80) + 0.5)
    return TapSet.from_arrays(
        np.random.default_rng(0).normal(size=(160, 3, 2)),
        np.repeat([0, 1], 80),
        ["cup", "ball"],
        preprocessing=Preprocessing(samples=3),
        where=np.tile(place, 2),
        where_value=[0.5, 1.5, 2.5, 3.5],
        where_edges=[0.0, 1, 2, 3, 4],
        where_unit="mm",
    )


@pytest.mark.parametrize("width", ["0.5mm", "500um", "0.1", "0.8mm", "0.16mm"])
def test_cells_narrower_than_the_classes_divide_the_range(line, width):
    """Also where they are no parts of the classes; each is reported as its centre and holds the taps inside."""
    grid = line.grid(width)
    step = {"500um": 0.5}.get(width) or float(width.rstrip("m"))
    where, _ = line.indices(grid)

    assert round(4 / step) == grid.L
    np.testing.assert_allclose(grid.where_edges, step * np.arange(grid.L + 1), atol=1e-12)
    np.testing.assert_allclose(grid.where_value, step * (np.arange(grid.L) + 0.5))
    np.testing.assert_array_equal(where, np.floor(line.where / step + 1e-9))
    assert set(where) == set(range(grid.L))


@pytest.mark.parametrize(("width", "L"), [("1mm", 4), ("2mm", 2), ("0.9999999mm", 4)])
def test_other_cells_are_as_they_were(line, width, L):
    """Those of the table, wider ones, and what rounding makes of them."""
    assert line.grid(width).shape == (L, 2)


def test_finer_cells_need_taps_in_touched_classes_only(line):
    """A class that nobody tapped may stay empty in all its parts."""
    some = line.select((line.where < 1) | (line.where > 2))
    grid = some.grid("0.25mm")

    assert grid.L == 16
    assert set(range(16)) - set(some.indices(grid)[0]) == {4, 5, 6, 7}


@pytest.mark.parametrize(
    ("width", "message"),
    [
        ("0.3mm", r"\(--where-cell\) 0.3mm does not divide the range of 4 mm into equal cells"),
        ("0.01mm", r"\(--where-cell\) 0.01mm leaves 320 of 400 cells without a tap: the taps have 80 positions"),
        ("1e-9mm", r"\(--where-cell\) 1e-9mm is too narrow for a range of 4 mm"),
        ("0.5kg", "cannot be converted to 'mm'"),
    ],
)
def test_finer_cells_that_cannot_be_are_refused(line, width, message):
    with pytest.raises(InputError, match=message):
        line.grid(width)


def test_taps_at_the_centres_of_their_classes_have_no_finer_places(line):
    dataset = line.dataset.assign_coords(where=("tap", np.floor(line.where) + 0.5, {"units": "mm"}))
    with pytest.raises(InputError, match="leaves 4 of 8 cells without a tap: the taps have 4 positions"):
        TapSet(dataset).grid("0.5mm")


def test_objects_without_size_are_not_grouped():
    taps = TapSet.from_arrays(np.zeros((2, 1, 1)), [0, 1], ["cup", "ball"], preprocessing=Preprocessing(samples=1))

    with pytest.raises(InputError, match="objects with sizes"):
        taps.grid(what_cell="3mm")


def test_new_attributes_leave_the_old_tap_set_alone(make_taps):
    taps = make_taps(what_value=[2.0, 4, 6, 8], what_unit="mm")
    new = relabel(taps, sensor="tip", units="counts", where_unit="cm", what_unit="in", rate_hz=10.0)

    assert (taps.where_unit, taps.dataset.attrs["sensor"], taps.preprocessing.rate_hz) == ("mm", "", 50.0)
    assert (new.where_unit, new.dataset.attrs["sensor"], new.preprocessing.rate_hz) == ("cm", "tip", 10.0)
    assert new.grid().where_unit == "cm"
    assert new.grid().what_unit == "in"
    assert new.dataset["taps"].attrs["units"] == "counts"
    assert new.dataset["time"].values.tolist() == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]


def test_a_unit_needs_sizes_and_a_rate_is_positive(make_taps):
    with pytest.raises(InputError, match=r"\(--what-unit\) was given, but the objects have no sizes"):
        relabel(make_taps(), what_unit="mm")
    with pytest.raises(InputError, match="rate_hz must be positive"):
        relabel(make_taps(), rate_hz=-1.0)
