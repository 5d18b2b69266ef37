"""What is refused is refused in one sentence that names the key of the map and its option."""

import h5py
import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

TABLE = "n,a,b,thing,phase\n" + "".join(f"{i // 4},{i},{-i},{'xy'[i // 4 % 2]},{'pq'[i % 2]}\n" for i in range(16))


@pytest.fixture
def table(tmp_path):
    """Four taps of four samples and two taxels, and tables of labels and events."""
    (tmp_path / "r.csv").write_text(TABLE)
    (tmp_path / "labels.csv").write_text("c,d\n1,2\n")
    (tmp_path / "others.csv").write_text("file,thing\nz.csv,5\n")
    (tmp_path / "events.csv").write_text("at\n0.5\n")
    return tmp_path / "r.csv"


@pytest.fixture
def arrays(tmp_path):
    """Five taps of four samples and three taxels, and frames."""
    with h5py.File(tmp_path / "h.h5", "w") as file:
        file["taps"], file["frames"] = np.arange(60.0).reshape(5, 4, 3), np.arange(30.0).reshape(10, 3)
        file["four"], file["two_axes"], file["three"] = np.arange(4), np.zeros((5, 2)), np.zeros((3, 4, 3))
        file["side"] = [b"left", b"mid", b"right", b"left", b"mid"]
        file["nan"], file["complex"] = [0, 1, np.nan, 3, 4.0], np.zeros((5, 4, 3), complex)
        file["large"] = np.full(5, 1e20)
        file["half_ends"], file["nan_ends"], file["word_ends"] = [4.5, 10], [4, np.nan, 10], [b"a", b"b"]
    return tmp_path / "h.h5"


def refused(source, **keys):
    with pytest.raises(InputError) as error:
        load_mapped(source, TapMap(**keys))
    return str(error.value).replace(f"{source.parent}/", "")


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"taxels": "q"}, "r.csv: taxels (--taxels): no column q; there is n, a"),
        ({"what": "q"}, "r.csv: what (--what): no column q; there is n, a"),
        ({"where": ["q", "n"]}, "r.csv: where (--where) x: no column q"),
        ({"what": "thing", "what_value": "q"}, "r.csv: what_value (--what-value): no column q"),
        ({"extra": "q"}, "r.csv: extra (--extra) q: no column q"),
        ({"extra": "a"}, "r.csv: line 3: extra (--extra) a changes within a tap from 0 to 1"),
        ({"session": "date:thing"}, "session (--session): date: no date in 'x'"),
        ({"session": "gap:1"}, "session (--session): gap: needs time (--time), one for each tap or row"),
        (
            {"what": "n", "what_names": ("u", "v")},
            "what (--what) is 2 for tap 2 of r.csv, which is no index of the 2 ent",
        ),
        (
            {"what": "thing", "what_names": ("x", "z")},
            "what (--what): 'y' of tap 1 of r.csv is not in what_names (--what",
        ),
        ({"what": "thing", "what_names": ("x", "y", "x")}, "what_names (--what-names) has a name twice: x, y, x."),
        ({"what": "n", "what_names": ("u", "u")}, "what_names (--what-names) has a name twice: u, u."),
        ({"what": "labels.csv:c"}, "what (--what): labels.csv: 1 row for 4 taps; labels.csv:c:KEY=OWN compares its"),
        ({"length": 9}, "length (--length): no tap is left of 4. 4 taps left out: shorter than 9 samples."),
        ({"align": "contact", "level": 1e9}, "align (--align): no tap is left of 4. 4 taps left out: without a sample"),
        ({"keep": "a>99"}, "r.csv: no taps that keep (--keep) 'a>99' keeps."),
        ({"session": "date:q"}, "r.csv: session (--session): no column q"),
        ({"what": "labels.csv:q"}, "r.csv: what (--what): labels.csv: no column q; there is c, d."),
        ({"what": "nope.csv:q"}, "r.csv: what (--what): nope.csv: no such table"),
        ({"what": "others.csv:thing"}, "r.csv: what (--what): others.csv has no row for this file."),
        (
            {"where": "thing"},
            "where (--where): 'x' of tap 0 of r.csv is not one number; list the names of positions in th",
        ),
        (
            {"what": "thing", "what_value": "thing"},
            "what_value (--what-value): 'x' of tap 0 of r.csv is not one number",
        ),
        (
            {"keep": "phase"},
            "keep (--keep) phase: must hold numbers or true and false",
        ),
        ({"keep": "phase<1"}, "keep (--keep): phase holds texts such as 'p', which have no order"),
        ({"keep": "a>=5x"}, "keep (--keep): a holds numbers, but '5x' is none"),
        ({"tap": "restart:phase"}, "tap (--tap): 'p' of tap 0 is not one number"),
        (
            {"tap": None, "trigger": "events", "events": "events.csv:q", "window": 2},
            "events (--events): events.csv: no co",
        ),
        (
            {"tap": None, "trigger": "events", "events": "events.csv:at", "window": 2},
            "events (--events): events: numbers",
        ),
        ({"tap": "n", "trigger": "clock", "window": 2}, "trigger (--trigger) clock: the taps are already cut"),
    ],
)
def test_of_a_table(keys, message, table):
    assert message in refused(table, **{"taxels": ("a", "b"), "tap": "n"} | keys)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"taxels": "9:12"}, "h.h5: taxels (--taxels) chooses none of 3 taxels."),
        ({"taps": ("taps", "three")}, "h.h5: taps (--taps): taps and three differ in their numbers of taps"),
        ({"taps": "side", "axes": "sample"}, "h.h5: taps (--taps): array side must hold real numbers"),
        ({"what": "two_axes"}, "h.h5: what (--what): two_axes has shape (5, 2), expected one value for each tap."),
        ({"where": "side"}, "where (--where): 'left' of tap 0 of h.h5 is not one number"),
        ({"taps": "q"}, "h.h5: taps (--taps): no array q"),
        ({"taps": ("taps", "q")}, "h.h5: taps (--taps): no array q"),
        ({"trial": "large"}, "trial (--trial) is 1e+20 for tap 0 of h.h5, not an integer of up to 15 digits."),
        ({"time": "four", "taps": "frames", "tap": "file"}, "h.h5: time (--time): four has shape (4,), expected one"),
        ({"time": "two_axes", "taps": "frames", "tap": "file"}, "h.h5: time (--time): two_axes has shape (5, 2), exp"),
        ({"where": "nan"}, "where (--where): 'nan' of tap 2 of h.h5 is not one number."),
        ({"where": ["nan", "side"]}, "where (--where) x: 'nan' of tap 2 of h.h5 is not one number."),
        (
            {"taps": "frames", "tap": "ends:half_ends"},
            "h.h5: tap (--tap) 'half_ends': its whole numbers must rise",
        ),
        ({"taps": "frames", "tap": "ends:nan_ends"}, "h.h5: tap (--tap): 'nan' of entry 1 is not one number"),
        ({"taps": "frames", "tap": "ends:word_ends"}, "h.h5: tap (--tap): 'a' of entry 0 is not one number"),
        (
            {"taps": "frames", "trigger": "signal", "signal": "four", "window": 2},
            "signal (--signal) four: has shape (4,), expected one value for each of 10 frames.",
        ),
    ],
)
def test_of_arrays(keys, message, arrays):
    assert message in refused(arrays, **{"taps": "taps"} | keys)


def test_a_comma_that_may_separate_thousands_is_refused(tmp_path):
    (tmp_path / "r.csv").write_text('a,pos\n1,"1,250 mm"\n')
    keys = {"taxels": "a", "tap": "row", "where": "pos"}
    assert "where (--where): '1,250 mm' of tap 0 of r.csv has a comma that may be" in refused(
        tmp_path / "r.csv", **keys
    )
    (tmp_path / "r.csv").write_text('a,pos\n1,"1,250.5 mm"\n2,"0,125 mm"\n3,"1,250,000 mm"\n4,"1250,125mm"\n')
    found = load_mapped(tmp_path / "r.csv", TapMap(**keys)).taps
    assert found.where.tolist() == [1250.5, 0.125, 1250000, 1250.125]


@pytest.mark.parametrize(
    ("texts", "where", "unit"),
    [
        (("\u22123 mm", "+2mm"), [-3, 2], "mm"),
        (("3 \u00b5m", "4 \u03bcm"), [3, 4], "\u00b5m"),
        (("3\u00b0", "-4.5 \u00b0"), [3, -4.5], "\u00b0"),
    ],
)
def test_signs_and_units_of_any_keyboard(texts, where, unit, tmp_path):
    (tmp_path / "r.csv").write_text("a;pos\n" + "".join(f"1;{text}\n" for text in texts), encoding="utf-8")
    taps = load_mapped(tmp_path / "r.csv", TapMap(taxels="a", tap="row", where="pos")).taps
    assert (taps.where.tolist(), taps.where_unit) == (where, unit)


@pytest.mark.parametrize("text", ["1_000", "nan", "inf", "1,2,3", "1.000,5"])
def test_texts_that_python_takes_for_numbers_are_none(text, tmp_path):
    (tmp_path / "r.csv").write_text(f'a;pos\n1;2 mm\n1;"{text}"\n')
    message = refused(tmp_path / "r.csv", taxels="a", tap="row", where="pos")
    assert f"{text!r} of tap 1 of r.csv is not one number" in message


@pytest.mark.parametrize(
    ("name", "message"),
    [
        (
            "bag.db3",
            "rosbag2 in SQLite is not read; ros2 bag convert -i IN -o OUT.yaml, with storage_id: mcap, or mcap conv",
        ),
        ("bag_0.db3.zstd", "rosbag2 in SQLite is not read"),
        ("run.bag", "messages of ROS 1 are not read; rosbags-convert --src IN.bag --dst OUT --dst-storage mcap makes"),
    ],
)
def test_bags_say_what_makes_an_mcap_file_of_them(name, message, tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / name).write_bytes(b"bag")
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    assert refused(folder / name, taps="/skin").startswith(f"{name}: {message}")
    assert refused(folder, taps="/skin").startswith(f"bag: {message}")


@pytest.mark.parametrize(
    ("name", "way_out"),
    [("a.xlsx", "save the sheet as CSV"), ("a.csv.gz", "unpack it"), ("a.pkl", "save its arrays with np.savez")],
)
def test_files_that_are_never_read_have_a_way_out(name, way_out, tmp_path):
    (tmp_path / name).write_bytes(b"1")

    assert way_out in refused(tmp_path / name, taxels="a")
    assert way_out in refused(tmp_path, taxels="a")
