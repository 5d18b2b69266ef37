"""Maps that `--look` prints: what they say of layouts with known truth, and whether they give those taps."""

import h5py
import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.first_look.guess_names import name_pattern
from solidtouch.models.io.layouts.first_look.look import look
from solidtouch.models.io.layouts.mapping import TapMap, load_map
from solidtouch.models.io.layouts.tap_set import load_mapped

TAPS = np.random.default_rng(5).normal(size=(12, 7, 4)).round(3)
OBJECTS = np.tile(["cup", "rod"], 6)


def looked(folder, source):
    """The text, and the map that it is."""
    text = look([source], TapMap())
    (folder / "map.toml").write_text(text)
    return text, load_map(folder / "map.toml")


def converted(folder, source, how):
    """Taps in the order of the truth, and their objects by name."""
    taps, _ = load_mapped([source], how, "refuse", folder)
    samples, named = np.asarray(taps.samples), np.asarray(taps.what_name)[np.asarray(taps.what)]
    order = [int(np.abs(samples - tap[None, : samples.shape[1]]).max((1, 2)).argmin()) for tap in TAPS]
    np.testing.assert_allclose(samples[order], TAPS[:, : samples.shape[1]], atol=1e-6)
    return taps, order, named[order]


def tables(folder, names, header="s1,s2,s3,s4"):
    """A table of one tap for each name."""
    for name, tap in zip(names, TAPS, strict=True):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("\n".join([header, *(",".join(map(str, row)) for row in tap)]) + "\n")


@pytest.mark.parametrize("ragged", [False, True])
def test_arrays_in_groups_of_objects_are_taps_with_their_attributes(ragged, tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for n, tap in enumerate(TAPS):
            longer = np.vstack([tap, np.full((n % 3 * ragged, 4), 9.0)])
            file[f"{OBJECTS[n]}/trial_{n // 2:03d}"] = longer
            file[f"{OBJECTS[n]}/trial_{n // 2:03d}"].attrs["x_mm"] = n // 2 % 3 * 2.0
    text, how = looked(tmp_path, tmp_path / "r.h5")
    taps, order, named = converted(tmp_path, tmp_path / "r.h5", how)

    assert (how.taps, how.tap, how.axes) == ("{what}/trial_{trial}", "file", "sample,taxel")
    assert ("check which axis is which" in text) is not ragged
    assert how.length == ("shortest" if ragged else None)
    assert (named == OBJECTS).all()
    assert taps.where[order].tolist() == [n // 2 % 3 * 2.0 for n in range(12)]


def test_arrays_of_taxels_and_samples_are_told_by_their_lengths(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for n in range(5):
            file[f"trial{n + 1}"] = np.zeros((4, 7 + n))

    assert looked(tmp_path, tmp_path / "r.h5")[1].axes == "taxel,sample"


def test_labels_of_as_many_arrays_as_an_axis_is_long_are_those_of_the_arrays(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for n, tap in enumerate(TAPS):
            file[f"trial{n + 1}"] = np.repeat(tap, 3, axis=1)
        file["labels"] = OBJECTS.astype("S")
    text, how = looked(tmp_path, tmp_path / "r.h5")

    assert (how.taps, how.tap, how.axes, how.what) == ("trial{trial}", "file", "sample,taxel", None)
    assert "labels has one value for each, and may be a label" in text
    assert "12 taps, 7 samples x 12 taxels" in text


def test_groups_of_other_quantities_and_of_parts_are_no_objects(tmp_path):
    with h5py.File(tmp_path / "quantities.h5", "w") as file:
        for group in ("pressure", "position"):
            file[f"{group}/trial_1"] = TAPS[0]
            file[f"{group}/trial_2"] = TAPS[1]
    with h5py.File(tmp_path / "parts.h5", "w") as file:
        for group in ("train", "test"):
            file[f"{group}/taps"], file[f"{group}/label"] = TAPS, np.tile([0, 1], 6)
    quantities = looked(tmp_path, tmp_path / "quantities.h5")[1]
    parts = looked(tmp_path, tmp_path / "parts.h5")[1]

    assert quantities.taps == "position/trial_{trial}"
    assert (parts.taps, parts.what) == ("{session}/taps", "{session}/label")


def test_an_array_in_each_file_is_a_tap(tmp_path):
    folder = tmp_path / "in"
    for n, tap in enumerate(TAPS):
        (folder / OBJECTS[n]).mkdir(parents=True, exist_ok=True)
        np.save(folder / OBJECTS[n] / f"{n // 2}.npy", tap)
    text, how = looked(tmp_path, folder)

    assert (how.files, how.tap, how.axes) == ("{what}/{trial}.npy", "file", "sample,taxel")
    assert "check which axis is which" in text
    assert (converted(tmp_path, folder, how)[2] == OBJECTS).all()


def test_an_array_for_each_taxel_is_beside_the_others(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for k in range(4):
            file[f"taxel_{k + 1}"] = TAPS[:, :, k]
        file["label"], file["time"] = np.tile([0, 1], 6), np.arange(7) * 0.01
    _, how = looked(tmp_path, tmp_path / "r.h5")
    taps, _, named = converted(tmp_path, tmp_path / "r.h5", how)

    assert (how.taps, how.axes, how.what, how.time) == ("taxel_{taxel}", "tap,sample", "label", "time")
    assert named.tolist() == ["0", "1"] * 6
    assert taps.preprocessing.rate_hz == pytest.approx(100.0)


def test_a_file_for_each_finger_is_beside_the_others(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for n, tap in enumerate(TAPS):
        for finger, columns in (("thumb", tap[:, :2]), ("index", tap[:, 2:])):
            rows = "\n".join(",".join(map(str, row)) for row in columns)
            (folder / f"{OBJECTS[n]}_{n // 2}_{finger}.csv").write_text(f"s1,s2\n{rows}\n")
    text, how = looked(tmp_path, folder)

    assert how.files == "{what}_{trial}_{taxel}.csv"
    assert "12 taps, 7 samples x 4 taxels, 2 objects" in text


@pytest.mark.parametrize("named", [False, True])
def test_the_column_of_taxels_of_a_long_table_is_no_signal(named, tmp_path):
    rows = [f"{n},{j * 0.01},{'t' * named}{k + 1},{TAPS[n, j, k]},{OBJECTS[n]}" for n, j, k in np.ndindex(TAPS.shape)]
    (tmp_path / "r.csv").write_text("\n".join(["tap_id,t,taxel,value,object", *rows]))
    _, how = looked(tmp_path, tmp_path / "r.csv")

    taps, _, found = converted(tmp_path, tmp_path / "r.csv", how)

    assert (how.tap, how.time, how.what) == ("tap_id", "t", "object")
    assert (how.taxel, how.taxels) == ("taxel", ("value",))
    assert (found == OBJECTS).all()
    assert taps.preprocessing.rate_hz == pytest.approx(100.0)


def test_texts_of_times_are_times_and_days_sessions(tmp_path):
    start = np.datetime64("2024-01-31T10:00:00.000")
    rows = []
    for n, tap in enumerate(TAPS):
        for j, values in enumerate(tap):
            time = start + np.timedelta64(n // 6 * 86_400_000 + n * 5000 + 10 * j, "ms")
            rows.append(",".join([str(time).replace("T", " "), str(n), OBJECTS[n], *map(str, values)]))
    (tmp_path / "r.csv").write_text("\n".join(["time,tap,obj,s1,s2,s3,s4", *rows]))
    text, how = looked(tmp_path, tmp_path / "r.csv")
    taps, order, named = converted(tmp_path, tmp_path / "r.csv", how)

    assert (how.time, how.what, how.session) == ("time", "obj", "date:time")
    assert "it increases by 0.01, with 11 gaps" in text
    assert (named == OBJECTS).all()
    assert taps.session[order].tolist() == [0] * 6 + [1] * 6


def test_times_that_give_no_rate_of_a_sensor_are_doubtful(tmp_path):
    """A column `Time` in milliseconds of which nothing says so."""
    rows = [f"{10 * n},{n // 20},{n},{n % 7}" for n in range(100)]
    (tmp_path / "r.csv").write_text("\n".join(["Time,tap,s1,s2", *rows]))
    text, _ = looked(tmp_path, tmp_path / "r.csv")

    assert "it increases by 10; in s it gives 0.1 Hz, but 100 Hz in ms or 100000 Hz in us; check time_unit" in text


def test_texts_that_hardly_repeat_are_no_object(tmp_path):
    rows = [f"photo_{n}.png,{n % 5},{n}" for n in range(20)]
    (tmp_path / "r.csv").write_text("\n".join(["image,s1,s2", *rows]))

    assert looked(tmp_path, tmp_path / "r.csv")[1].what is None


@pytest.mark.parametrize("date", ["{0}-{1}-{2}", "{2}.{1}.{0}", "{0}{1}{2}"])
def test_dates_in_names_are_sessions(date, tmp_path):
    folder = tmp_path / "in"
    days = [date.format("2024", "01", "31"), date.format("2024", "02", "01")]
    tables(folder, [f"{days[n // 6]}_{'AB'[n % 2]}_{n % 3}_{n}.csv" for n in range(12)])
    _, how = looked(tmp_path, folder)
    taps, order, named = converted(tmp_path, folder, how)

    assert (how.files, how.session) == ("{session}_{what}_{where}_{trial}.csv", "date:{session}")
    assert named.tolist() == ["A", "B"] * 6
    assert taps.where[order].tolist() == [0, 1, 2] * 4
    assert taps.session[order].tolist() == [0] * 6 + [1] * 6


@pytest.mark.parametrize(
    ("names", "pattern"),
    [
        (["A_x0_y2_4.csv", "B_x1.5_y0_5.csv"], "{what}_x{x}_y{y}_{trial}.csv"),
        (["A_x-5mm_0.csv", "B_x2.5mm_1.csv"], "{what}_x{where}_{trial}.csv"),
        (["20240101_100030_A.csv", "20240102_100130_B.csv"], "{session}_{trial}_{what}.csv"),
        (["S_2024-01-31_1.csv", "S_2023-12-24_2.csv"], "S_{session}_{trial}.csv"),
        (["2024_01_31_A_1.csv", "2024_02_01_B_2.csv"], "????_??_??_{what}_{trial}.csv"),
        (["obj0_1.csv", "obj1_2.csv"], "{what}_{trial}.csv"),
        (["ch1.npy", "ch2.npy"], "ch{taxel}.npy"),
        (["cup_ch1.npy", "rod_ch2.npy"], "{what}_ch{trial}.npy"),
        (["big box/1.csv", "big box/2.csv", "cup/1.csv", "cup/2.csv"], "{what}/{trial}.csv"),
        (["big box.csv", "cup.csv"], ""),
        (["a/1.csv", "2.csv"], ""),
    ],
)
def test_patterns_of_names(names, pattern):
    assert name_pattern(names)[0] == pattern


def test_places_in_names_are_in_a_plane(tmp_path):
    folder = tmp_path / "in"
    tables(folder, [f"{'AB'[n % 2]}_x{n // 2 % 3 * 1.5:g}_y{n // 6 * 2}_{n}.csv" for n in range(12)])
    text, how = looked(tmp_path, folder)

    assert how.files == "{what}_x{x}_y{y}_{trial}.csv"
    assert "12 taps, 7 samples x 4 taxels, 2 objects, 6 positions" in text


def test_axes_are_doubted_that_nothing_tells_apart(tmp_path):
    for name, beside in (("free", {}), ("timed", {"time": np.arange(4) * 0.1})):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["data"], file["label"] = TAPS, np.tile([0, 1], 6)
            for key, values in beside.items():
                file[key] = values
    text, free = looked(tmp_path, tmp_path / "free.h5")
    timed_text, timed = looked(tmp_path, tmp_path / "timed.h5")

    assert 'axes = "tap,sample,taxel"  # shape 12 x 7 x 4; check which axis is which' in text
    assert free.time is None
    assert (timed.axes, timed.time) == ("tap,taxel,sample", "time")
    assert "check which axis" not in timed_text


@pytest.mark.parametrize("decimals", [1, 3])
def test_decimal_commas_are_seen(decimals, tmp_path):
    rows = [
        ";".join([str(n), OBJECTS[n], *(f"{value:.{decimals}f}".replace(".", ",") for value in row)])
        for n, tap in enumerate(TAPS)
        for row in tap
    ]
    (tmp_path / "r.csv").write_text("\n".join(["tap;obj;s1;s2;s3;s4", *rows]))
    text, how = looked(tmp_path, tmp_path / "r.csv")

    assert (how.decimal, how.taxels) == (",", "s*")
    assert "12 taps, 7 samples x 4 taxels, 2 objects" in text


def test_columns_called_alike_are_not_left_out_for_how_their_numbers_are_written(tmp_path):
    (tmp_path / "r.csv").write_text("tap;s1;s2\n0;1.005,00;2,5\n0;1,5;2,5\n1;1,5;2,5\n1;1,5;2,5\n")
    _, how = looked(tmp_path, tmp_path / "r.csv")

    assert (how.decimal, how.taxels) == (",", "s*")


def test_long_lists_of_attributes_are_cut_with_their_number(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["x"] = TAPS
        for n in range(15):
            file.attrs[f"note{n:02d}"] = n
    text = look([tmp_path / "r.h5"], TapMap())

    assert text.count("#   attribute ") == 12
    assert "#   ... and 3 more attributes\n" in text


@pytest.mark.parametrize("first", [0, 1])
def test_a_list_of_names_beside_an_array(first, tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    np.savez(folder / "r.npz", taps=TAPS, label=np.tile([first, first + 1], 6))
    (folder / "objects.txt").write_text("cup\nrod\n")
    (folder / "notes.txt").write_text("one\ntwo\n")
    _, how = looked(tmp_path, folder)

    assert (how.files, how.what_names, how.one_based) == ("**/*.npz", "objects.txt", first == 1)
    assert (converted(tmp_path, folder, how)[2] == OBJECTS).all()


def test_a_list_of_other_length_names_no_objects(tmp_path):
    np.save(tmp_path / "r.npy", TAPS.reshape(2, 6, 7, 4))
    (tmp_path / "objects.txt").write_text("cup\nrod\npen\n")

    assert looked(tmp_path, tmp_path / "r.npy")[1].what_names is None


def test_doubtful_maps_are_called_so(tmp_path):
    np.savez(tmp_path / "vectors.npz", x=TAPS[:, :, 0], label=np.arange(12))
    np.savez(tmp_path / "whole.npz", x=TAPS, label=np.tile([0, 1], 6))

    assert "Doubtful: each tap has 1 taxel and there are as many objects as taps." in look(
        [tmp_path / "vectors.npz"], TapMap()
    )
    assert "Doubtful" not in look([tmp_path / "whole.npz"], TapMap())


def test_a_column_with_a_missing_cell_is_still_a_taxel(tmp_path):
    (tmp_path / "r.csv").write_text("tap,s1,s2\n0,1,2\n0,,3\n1,2,3\n1,2,4\n")
    text, how = looked(tmp_path, tmp_path / "r.csv")

    assert how.taxels == "s*"
    assert "With this map: " in text
    assert "line 3" in text.splitlines()[-1]


def test_names_of_positions_are_listed(tmp_path):
    rows = [f"{n},{OBJECTS[n]},{['left', 'mid'][n // 6]},{a}" for n, tap in enumerate(TAPS) for a, *_ in tap]
    (tmp_path / "r.csv").write_text("\n".join(["tap,material,position,s1", *rows]))
    _, how = looked(tmp_path, tmp_path / "r.csv")

    assert (how.what, how.where, how.where_values) == ("material", "position", ("left", "mid"))


def test_names_of_as_many_objects_as_an_axis_is_long(tmp_path):
    np.savez(tmp_path / "r.npz", taps=np.stack([TAPS[::2], TAPS[1::2]]), names=np.array(["cup", "rod"]))
    _, how = looked(tmp_path, tmp_path / "r.npz")

    assert (how.axes, how.what, how.what_names) == ("what,tap,sample,taxel", None, "names")
    assert (converted(tmp_path, tmp_path / "r.npz", how)[2] == OBJECTS).all()


def test_tables_without_a_header(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    for n, tap in enumerate(TAPS):
        np.savetxt(folder / f"{OBJECTS[n]}_{n}.txt", tap, "%g", ",")
    _, how = looked(tmp_path, folder)

    assert (how.header, how.files, how.tap) == (False, "{what}_{trial}.txt", "file")
    assert (converted(tmp_path, folder, how)[2] == OBJECTS).all()


def test_whole_numbers_of_a_table_without_a_header_are_taps_and_objects(tmp_path):
    rows = [f"{n},{n % 2},{','.join(map(str, values))}" for n, tap in enumerate(TAPS) for values in tap]
    (tmp_path / "r.csv").write_text("\n".join(rows))
    _, how = looked(tmp_path, tmp_path / "r.csv")

    assert (how.header, how.tap, how.what, how.taxels) == (False, "0", "1", ("2", "3", "4", "5"))
    assert converted(tmp_path, tmp_path / "r.csv", how)[2].tolist() == ["0", "1"] * 6


@pytest.mark.parametrize("none", ["-1", ""])
def test_rows_between_taps_are_left_out(none, tmp_path):
    rows = [
        line
        for n, tap in enumerate(TAPS)
        for line in (f"{none},idle,0,0,0,0", *(f"{n},{OBJECTS[n]},{','.join(map(str, values))}" for values in tap))
    ]
    (tmp_path / "r.csv").write_text("\n".join(["press,obj,s1,s2,s3,s4", *rows]))
    _, how = looked(tmp_path, tmp_path / "r.csv")

    assert how.keep == "press>=0"
    assert (converted(tmp_path, tmp_path / "r.csv", how)[2] == OBJECTS).all()


def test_a_table_that_cannot_be_read_is_refused_as_before(tmp_path):
    (tmp_path / "r.csv").write_text("s1,s2\n" + "1,2\n" * 40 + "3\n")
    with pytest.raises(InputError, match="line 42: 1 cell"):
        look([tmp_path / "r.csv"], TapMap())
