"""Roles that names of columns, arrays and files must not be given, parts that must not be left out, times and rates."""

import json

import h5py
import numpy as np
import pytest
from scipy.io import savemat
from solidtouch.models.io.layouts.first_look.guess_names import name_pattern
from solidtouch.models.io.layouts.first_look.look import look
from solidtouch.models.io.layouts.mapping import TapMap, load_map

RNG = np.random.default_rng(7)


def looked(path, content=None):
    """The text and the map that it is."""
    if content is not None:
        path.write_text(content)
    text = look([path], TapMap())
    (path.parent / "map.toml").write_text(text)
    return text, load_map(path.parent / "map.toml")


def csv(header, rows):
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


def taps_of(columns, extra=()):
    """Rows of six taps of ten samples."""
    return [
        (n, "ab"[n % 2], *(f(j) for f in extra), *RNG.random(columns).round(3)) for n in range(6) for j in range(10)
    ]


def test_columns_called_pressure_are_taxels(tmp_path):
    header = "series_id,object," + ",".join(f"pressure_{i}" for i in range(6))
    _, how = looked(tmp_path / "r.csv", csv(header, taps_of(6)))

    assert (how.tap, how.keep, how.taxels) == ("series_id", None, "pressure_*")


def test_all_axes_of_taxels_are_taken_and_the_rest_is_told(tmp_path):
    header = "grasp_id,object,force_N," + ",".join(f"t{k}_{axis}" for k in range(1, 5) for axis in "xyz")
    text, how = looked(tmp_path / "r.csv", csv(header, taps_of(13)))

    assert (how.tap, how.taxels) == ("grasp_id", "t*_*")
    assert "6 taps, 10 samples x 12 taxels" in text
    assert "# Not used: force_N.\n" in text


def test_taxels_in_one_unit(tmp_path):
    _, how = looked(tmp_path / "r.csv", csv("tap,object,Kraft [N],Sensor 1 [mV],Sensor 2 [mV]", taps_of(3)))

    assert how.taxels == "Sensor * [mV]"


def test_the_other_axis_of_a_nested_position(tmp_path):
    places = [{"x_mm": x, "y_mm": y} for x in (0, 1) for y in (0, 2)]
    taps = [
        {"object": o, "pose": pose, "fs": 120, "tactile": RNG.random((5, 3)).tolist()} for o in "ab" for pose in places
    ]
    _, how = looked(tmp_path / "r.jsonl", "\n".join(map(json.dumps, taps)))

    assert how.where == ("pose.x_mm", "pose.y_mm")
    assert how.rate == 120


def test_columns_numbered_as_taps_are_taps(tmp_path):
    rows = [(j / 100, *RNG.random(8).round(3)) for j in range(50)]
    text, how = looked(tmp_path / "r.csv", csv("time_s," + ",".join(f"trial {n}" for n in range(1, 9)), rows))

    assert (how.taxels, how.tap, how.trial) == ("trial {trial}", None, None)
    assert "8 taps, 50 samples x 1 taxel" in text


@pytest.mark.parametrize("smooth", [False, True])
def test_rows_with_labels_and_no_time_are_taps(smooth, tmp_path):
    values = np.cumsum(RNG.normal(size=(30, 16)), axis=1) if smooth else RNG.normal(size=(30, 16))
    rows = [(*row.round(4), RNG.integers(1, 4), "train") for row in values]
    text, how = looked(tmp_path / "r.csv", csv(",".join(f"f{i}" for i in range(16)) + ",label,split", rows))

    assert (how.tap, how.taxels, how.what) == ("row", "0:16", "label")
    assert ("30 taps, 16 samples x 1 taxel" if smooth else "30 taps, 1 sample x 16 taxels") in text


def test_rows_with_columns_of_samples_and_taxels(tmp_path):
    rows = [(*RNG.random(15).round(3), "ab"[n % 2]) for n in range(12)]
    names = [f"taxel{k}_t{j}" for k in (1, 2, 3) for j in range(5)]
    text, how = looked(tmp_path / "r.csv", csv(",".join(names) + ",object", rows))

    assert (how.tap, how.taxels) == ("row", "taxel{taxel}_t{sample}")
    assert "12 taps, 5 samples x 3 taxels" in text


def test_a_first_row_of_numbers_is_no_header(tmp_path):
    (tmp_path / "in").mkdir()
    for n, name in enumerate("aabb"):
        rows = [f"2022-05-01 14:02:{11 + j / 40:06.3f},{j % 7 + 490},{n},{7 * j % 5}" for j in range(24)]
        (tmp_path / f"in/{name}_{n}.txt").write_text("\n".join(rows))
    text, how = looked(tmp_path / "in")

    assert (how.header, how.time, how.taxels) == (False, "0", ("1", "2", "3"))
    assert "4 taps, 24 samples x 3 taxels" in text


@pytest.mark.parametrize(("name", "unit"), [("ms", "ms"), ("t_ms", None), ("Time [ms]", None), ("us", "us")])
def test_units_of_times(name, unit, tmp_path):
    text, how = looked(tmp_path / "r.csv", csv(f"tap,object,{name},s0,s1", taps_of(2, [lambda j: 10 * j])))

    assert (how.time, how.time_unit) == (name, unit)
    assert "check time_unit" not in text


def test_a_rate_in_the_file(tmp_path):
    np.savez(tmp_path / "r.npz", X=RNG.random((6, 9, 4)), y=np.tile([0, 1], 3), fs=1000)

    assert looked(tmp_path / "r.npz")[1].rate == 1000


def test_fields_of_a_struct_called_trials_are_no_trials(tmp_path):
    trials = np.zeros((1, 8), dtype=[("tactile", "O"), ("object", "O"), ("pos_mm", "O"), ("valid", "O")])
    for i in range(8):
        trials[0, i] = (RNG.random((9 + i % 2, 3)), "ab"[i % 2], float(i // 4), np.bool_(i != 3))
    savemat(tmp_path / "r.mat", {"trials": trials, "cfg": {"fs": 300.0}})
    text, how = looked(tmp_path / "r.mat")

    assert (how.what, how.where, how.trial) == ("trials.object", "trials.pos_mm", None)
    assert (how.keep, how.rate) == ("trials.valid", 300)
    assert "it keeps 7 of 8 taps" in text
    assert "With this map: 7 taps" in text


def test_objects_in_names_of_structs(tmp_path):
    data = {name: {f"trial{k}": RNG.random((9, 3)) for k in range(1, 5)} for name in ("cork", "felt")}
    savemat(tmp_path / "r.mat", {"data": data})
    text, how = looked(tmp_path / "r.mat")

    assert how.taps == "data.{what}.trial{trial}"
    assert "8 taps, 9 samples x 3 taxels, 2 objects" in text


def test_grids_of_groups_of_trials_with_attributes_of_the_groups(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for n in range(12):
            group = file.create_group(f"session_{n // 6}/trial_{n:03d}")
            group["tactile"], group["force"] = RNG.random((9, 2, 3)), RNG.random(9)
            group.attrs["object"], group.attrs["position_mm"] = "ab"[n % 2], n % 3
    text, how = looked(tmp_path / "r.h5")

    assert how.axes == "sample,taxel,taxel"
    assert how.where == "session_{session}/trial_{trial}@position_mm"
    assert "12 taps, 9 samples x 6 taxels, 2 objects, 3 positions, 2 sessions" in text


def test_the_axis_of_samples_is_smooth_and_that_of_repeated_labels_one_of_taps(tmp_path):
    smooth = np.cumsum(RNG.normal(size=(12, 4, 40)), axis=2)
    np.savez(tmp_path / "r.npz", X=smooth, y=np.tile([0, 1, 2], 4))
    np.savez(tmp_path / "grid.npz", X=smooth.reshape(12, 2, 2, 40), label=np.tile([1, 2, 3], 4))

    assert looked(tmp_path / "r.npz")[1].axes == "tap,taxel,sample"
    assert looked(tmp_path / "grid.npz")[1].axes == "tap,taxel,taxel,sample"


def test_a_column_of_contact_cuts_streams(tmp_path):
    rows = [(j / 100, *RNG.random(3).round(3), int(j % 30 >= 10)) for j in range(300)]
    text, how = looked(tmp_path / "r.csv", csv("t,p0,p1,p2,contact", rows))

    assert (how.trigger, how.signal, how.window, how.taxels) == ("signal", "contact", 20, "p*")
    assert "9 taps, 20 samples x 3 taxels" in text or "10 taps, 20 samples x 3 taxels" in text


def test_labels_that_change_within_a_file_make_it_a_stream(tmp_path):
    (tmp_path / "in").mkdir()
    for n in range(3):
        rows = [(*RNG.random(2).round(3), "ab"[j // 20]) for j in range(40)]
        (tmp_path / f"in/log_{n}.csv").write_text(csv("p0,p1,object", rows))
    text, how = looked(tmp_path / "in")

    assert (how.files, how.tap) == ("log_{session}.csv", None)
    assert "120 frames of streams" in text


@pytest.mark.parametrize(
    ("names", "pattern"),
    [
        (
            [f"P0{n}/{o}_{k}.csv" for n in (1, 2) for o in ("cork", "felt") for k in (1, 2)],
            "{session}/{what}_{trial}.csv",
        ),
        ([f"sub-0{n}_ses-{k}.csv" for n in (1, 2) for k in (1, 2)], "sub-{session}_ses-{trial}.csv"),
        (
            [f"rod{d}mm_{a}deg_rep{k}.csv" for d in ("12.5", "25") for a in ("0045", "0090") for k in (1, 2)],
            "{what}_{where}_rep{trial}.csv",
        ),
        ([f"0{n}_{o}/exp{k}.csv" for n, o in ((1, "cork"), (2, "felt")) for k in (1, 2)], "??_{what}/exp{trial}.csv"),
        ([f"{w}_{k}.mat" for w in ("black_foam_112", "steel_702") for k in (1, 2)], "{what}_???_{trial}.mat"),
        (["data/black_foam_01.mat", "data/black_foam_02.mat", "data/steel_01.mat"], "data/{what}_{trial}.mat"),
        ([f"run_{n:03d}.npy" for n in range(20)], "run_{trial}.npy"),
        (["run_1.npy", "run_2.npy"], "run_{session}.npy"),
    ],
)
def test_patterns_of_names(names, pattern):
    assert name_pattern(names)[0] == pattern


def test_parts_of_names_that_no_field_takes_are_told(tmp_path):
    for what in ("cork", "felt"):
        for depth in ("0p5", "1p0"):
            (tmp_path / what / depth).parent.mkdir(exist_ok=True)
            (tmp_path / what / f"d{depth}mm_r1.csv").write_text("s0,s1\n1,2\n3,5\n")

    assert "# not used: d0p5mm, d1p0mm in names" in look([tmp_path], TapMap())


def test_dates_with_underscores_are_sessions(tmp_path):
    for day in (25, 26):
        folder = tmp_path / f"in/bag_2026_11_{day}-10_00_00"
        folder.mkdir(parents=True)
        for name in "ab":
            (folder / f"{name}_1.csv").write_text("s0,s1\n1,2\n3,5\n")
    text, how = looked(tmp_path / "in")

    assert how.session == "date:{session}"
    assert "4 taps, 2 samples x 2 taxels, 2 objects, 1 position, 2 sessions" in text


@pytest.mark.parametrize(
    ("header", "rows", "doubt"),
    [
        ("tap,s0,s1", [(n // 5, n, 2) for n in range(20)], "nothing tells objects apart"),
        ("tap,object,s0,s1", [(n // 5, ["cork", "Cork"][n // 10], n, 2) for n in range(20)], "objects are called cork"),
        ("tap,object,x,s0,s1", [(n // 2, "ab"[n % 4 // 2], n // 2 % 2 * 5 + n // 8 * 0.01, n, 2) for n in range(16)],
         "some positions are 0.01 apart, others 5: where_round rounds them"),
    ],
)  # fmt: skip
def test_doubts(header, rows, doubt, tmp_path):
    assert doubt in looked(tmp_path / "r.csv", csv(header, rows))[0]


def test_a_phase_called_press_is_a_tap(tmp_path):
    rows = [(j / 100, "press" if j % 25 >= 10 else "idle", *RNG.random(2).round(3)) for j in range(250)]
    text, how = looked(tmp_path / "r.csv", csv("t,phase,s0,s1", rows))

    assert (how.tap, how.keep) == ("phase", "phase=press")
    assert "10 taps, 15 samples x 2 taxels" in text


def test_a_list_of_taxels_for_each_time(tmp_path):
    rows = [{"t": n * 0.01, "touch_id": n // 20, "taxels": RNG.random(3).tolist()} for n in range(120)]
    text, how = looked(tmp_path / "r.jsonl", "\n".join(map(json.dumps, rows)))

    assert (how.taps, how.tap, how.axes) == ("taxels", "touch_id", "sample,taxel")
    assert "6 taps, 20 samples x 3 taxels" in text


def test_lists_of_sessions_of_taps(tmp_path):
    taps = [{"object": "ab"[n % 2], "depth_mm": n // 2, "samples": RNG.random((6, 3)).tolist()} for n in range(4)]
    document = {"fs": 90, "sessions": [{"date": f"2023-0{s}-11", "taps": taps} for s in (1, 2)]}
    text, how = looked(tmp_path / "r.json", json.dumps(document))

    assert (how.taps, how.axes, how.rate) == ("sessions.taps.samples", "session,tap,sample,taxel", 90)
    assert (how.what, how.where) == ("sessions.taps.object", "sessions.taps.depth_mm")
    assert "8 taps, 6 samples x 3 taxels, 2 objects, 2 positions, 2 sessions" in text


def test_a_column_of_objects_outweighs_names_of_files(tmp_path):
    (tmp_path / "in").mkdir()
    for day in ("monday", "tuesday"):
        rows = [(n, ["ball", "cube"][n % 2], *RNG.random(2).round(3)) for n in range(4) for _ in range(6)]
        (tmp_path / f"in/{day}.csv").write_text(csv("tap,object,s0,s1", rows))
    _, how = looked(tmp_path / "in")

    assert (how.files, how.what) == ("{session}.csv", "object")


def test_a_pattern_of_arrays_takes_no_others(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        for finger in ("F0", "F1"):
            file[f"{finger}pac"], file[f"{finger}pdc"] = RNG.random((22, 90)), RNG.random(90)
    text, how = looked(tmp_path / "r.h5")

    assert how.taps == "F0pac"
    assert "# Not used: F0pdc, F1pac, F1pdc.\n" in text


def test_objects_in_groups_that_differ_between_files(tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("brush", "spool"):
        with h5py.File(tmp_path / f"in/data_{name}.h5", "w") as file:
            for n in range(4):
                file[f"{name}/Pose{n // 2}/Exp{n}/raw"] = RNG.random((3, 2, 40 + n))
    text, how = looked(tmp_path / "in")

    assert (how.taps, how.axes) == ("{what}/{session}/Exp{trial}/raw", "taxel,taxel,sample")
    assert "8 taps, 40 samples x 6 taxels, 2 objects" in text


def test_long_files_are_streams_unless_someone_says_so(tmp_path):
    (tmp_path / "in").mkdir()
    for n, name in enumerate("abab"):
        (tmp_path / f"in/{name}_{n}.csv").write_text(csv("s0,s1", RNG.random((400, 2)).round(3)))
    text, how = looked(tmp_path / "in")

    assert how.tap is None
    assert '# Perhaps: tap = "file" (if each file is one tap)' in text


def test_taps_of_about_one_length_are_cut_to_the_shortest(tmp_path):
    (tmp_path / "in").mkdir()
    for n, name in enumerate("abab"):
        (tmp_path / f"in/{name}_{n}.csv").write_text(csv("s0,s1", RNG.random((40 + n, 2)).round(3)))
    text, how = looked(tmp_path / "in")

    assert how.length == "shortest"
    assert "taps have 40 to 43 samples" in text


@pytest.mark.parametrize("low", [0, 5])
def test_a_signal_of_two_levels_needs_the_samples_of_a_tap(low, tmp_path):
    """The end of a trigger is not that of a tap; it may be low while a finger presses."""
    levels = [abs((0 if j % 30 < 22 else 5) - low) + RNG.normal(0, 0.02) for j in range(300)]
    rows = [(j / 100, *RNG.random(3).round(3), round(level, 3)) for j, level in enumerate(levels)]
    text, how = looked(tmp_path / "r.csv", csv("t,p0,p1,p2,switch", rows))

    assert (how.trigger, how.window, how.taxels) == ("signal", None, "p*")
    assert how.signal == "switch" if low == 0 else how.signal is not None and how.signal.startswith("switch<2.")
    assert "trigger (--trigger) signal requires window (--window)" in text


def test_a_column_that_counts_anew_divides_taps(tmp_path):
    rows = [("ab"[n % 2], j + 1, *RNG.random(2).round(3)) for n in range(6) for j in range(20 + n)]
    text, how = looked(tmp_path / "r.csv", csv("gesture,frame,ch1,ch2", rows))

    assert (how.tap, how.length, how.taxels) == ("restart:frame", "shortest", "ch*")
    assert "6 taps, 20 samples x 2 taxels, 2 objects" in text


@pytest.mark.parametrize(
    ("header", "begin"),
    [
        ("Datum/Zeit,Nr.,Objekt,Kanal 1,Kanal 2", "01.03.2020 10:00:"),
        ("Temps,Essai,Objet,Capteur 1,Capteur 2", "10:00:"),
    ],
)
def test_words_and_times_of_other_languages(header, begin, tmp_path):
    rows = [
        (f"{begin}{10 * n + j:02d}.5", n, "ab"[n % 2], *RNG.random(2).round(3)) for n in range(5) for j in range(10)
    ]
    text, how = looked(tmp_path / "r.csv", csv(header, rows))

    assert [how.time, how.tap, how.what] == header.split(",")[:3]
    assert "5 taps, 10 samples x 2 taxels, 2 objects" in text


def test_arrays_beside_the_samples_of_a_file_are_no_labels_without_names_of_such(tmp_path):
    (tmp_path / "in").mkdir()
    for n, name in enumerate("abab"):
        beside = {key: RNG.random((1, 50)) for key in ("JPos", "JVel")}
        savemat(tmp_path / f"in/{name}_{n}.mat", {"electrodes": RNG.random((19, 50)), **beside})
    text, how = looked(tmp_path / "in")

    assert (how.files, how.tap) == ("{what}_{trial}.mat", "file")
    assert "4 taps" in text
    assert "# Not used: JPos, JVel.\n" in text


def test_sizes_of_objects_may_look_like_positions(tmp_path):
    (tmp_path / "in").mkdir()
    for name in ("cube_20mm", "cube_30mm", "ball_20mm"):
        for n in (1, 2):
            (tmp_path / f"in/{name}_{n}.csv").write_text("s0,s1\n1,2\n3,5\n")

    assert "check whether these are positions, or sizes of objects: not all objects have all" in look(
        [tmp_path], TapMap()
    )


def test_an_array_of_contact_beside_a_stream_cuts_it(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["raw/tactile"], file["raw/t"] = RNG.random((300, 4)), np.arange(300) / 100
        file["sync/contact"] = (np.arange(300) % 30 >= 10).astype("u1")
    text, how = looked(tmp_path / "r.h5")

    assert (how.trigger, how.signal, how.window) == ("signal", "sync/contact", 20)
    assert "taps, 20 samples x 4 taxels" in text
