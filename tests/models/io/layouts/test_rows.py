"""Which rows are a tap, and which are kept: the two together never join what is apart."""

import h5py
import numpy as np
import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


def taps_of(folder, rows, **how):
    """Taps of a table with the columns count, phase, a; one list of values each."""
    path = folder / "r.csv"
    path.write_text("count,phase,a\n" + "".join(f"{','.join(map(str, row))}\n" for row in rows))
    return load_mapped(path, TapMap(taxels="a", **how)).taps.taps[..., 0].tolist()


def refused(folder, rows, **how):
    with pytest.raises(InputError) as error:
        taps_of(folder, rows, **how)
    return str(error.value)


def test_taps_that_count_anew_end_where_they_do_although_those_rows_are_not_kept(tmp_path):
    """Of the first tap its begin is kept, of the second its end."""
    rows = [(0, "on", 1), (1, "on", 2), (2, "off", 3), (0, "off", 4), (3, "on", 5), (4, "on", 6)]
    assert taps_of(tmp_path, rows, tap="restart:count", keep="phase=on") == [[1, 2], [5, 6]]


def test_rows_that_are_not_kept_need_no_number(tmp_path):
    rows = [(0, "on", 1), (1, "on", 2), ("", "off", 3), (0, "on", 5), (1, "on", 6)]
    assert taps_of(tmp_path, rows, tap="restart:count", keep="phase=on") == [[1, 2], [5, 6]]
    rows = [(7, "on", 1), (7, "on", 2), ("", "off", 3), (9, "on", 5), (9, "on", 6)]
    assert taps_of(tmp_path, rows, tap="count", keep="phase=on") == [[1, 2], [5, 6]]
    for tap in ("count", "restart:count"):
        assert "line 4: tap (--tap)" in refused(tmp_path, rows, tap=tap)
        assert "--keep" in refused(tmp_path, rows, tap=tap)


def test_two_taps_of_one_number_are_not_joined_where_what_is_between_is_not_kept(tmp_path):
    rows = [(1, "on", 1), (1, "on", 2), (0, "off", 3), (1, "on", 5), (1, "on", 6)]
    assert "line 5: tap (--tap) count is 1 again after another tap" in refused(
        tmp_path, rows, tap="count", keep="phase=on"
    )


def test_each_stretch_of_rows_is_a_tap_where_the_column_of_taps_has_one_value_in_those_kept(tmp_path):
    rows = [
        ("a", "on", 1),
        ("a", "on", 2),
        ("", "off", 3),
        ("b", "on", 4),
        ("", "off", 9),
        ("a", "on", 5),
        ("a", "on", 6),
    ]
    long = {"length": "longest"}
    pairs = {"keep": "count=a", "tap": "count"}, {"keep": "phase=on", "tap": "phase", "length": 1}
    assert [taps_of(tmp_path, rows, **keys) for keys in pairs] == [[[1, 2], [5, 6]], [[1], [4], [5]]]
    for tap in ("phase", ("count", "phase"), ("phase", "count")):
        assert len(taps_of(tmp_path, rows, keep="phase", tap=tap, length=1)) == 3
    again = refused(tmp_path, rows, keep="phase=on", tap="count")
    assert "line 7: tap (--tap) count is a again after another tap" in again
    assert "If each stretch of rows that keep (--keep) keeps is a tap, name phase in tap (--tap) as well" in again
    rows[2] = ("", "in", 3)
    message = refused(tmp_path, rows, keep="phase!=off", tap="phase", **long)
    assert "Where keep (--keep) keeps one value of phase alone, each stretch of rows is a tap" in message


@pytest.mark.parametrize("signal", ["phase=on", "count<2", "phase!=off", "phase"])
def test_a_signal_may_be_a_condition(tmp_path, signal):
    """Also one that falls at a press."""
    rows = [(2, "off", 1), (1, "on", 2), (0, "on", 3), (3, "off", 4), (1, "on", 5), (1, "on", 6)]
    assert taps_of(tmp_path, rows, trigger="signal", signal=signal, window=2) == [[2, 3], [5, 6]]


def test_a_signal_of_texts_is_compared(tmp_path):
    rows = [(0, "idle", 1), (0, "press", 2), (0, "press", 3)]
    message = refused(tmp_path, rows, trigger="signal", signal="phase", window=2)
    assert (
        "signal (--signal) phase: must hold numbers or true and false, got 'idle'; texts are compared, as in "
        in message
    )
    assert taps_of(tmp_path, rows, trigger="signal", signal="phase=press", window=2) == [[2, 3]]


def test_ends_count_all_rows(tmp_path):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["a"], file["ends"] = np.arange(9.0)[:, np.newaxis], [4, 5, 9]
        file["good"] = [1, 1, 0, 0, 0, 0, 0, 1, 1]
    how = TapMap(taps="a", tap="ends:ends", keep="good")
    assert load_mapped(tmp_path / "r.h5", how).taps.taps[..., 0].tolist() == [[0, 1], [7, 8]]


def test_rows_are_kept_by_any_comparison_and_by_truth_in_words(tmp_path):
    rows = [(0, "True", 1), (1, "False", 2), (2, "True", 3), (3, "", 4)]
    for keep, found in (
        ("count>=2", [3, 4]),
        ("count<=1", [1, 2]),
        ("count==2", [3]),
        ("phase", [1, 3]),
        ("phase==True", [1, 3]),
        ("phase!=True", [2, 4]),
    ):
        assert taps_of(tmp_path, rows, tap="file", keep=keep) == [found]


ENCODER = "day,thing,at,press,p\n" + "".join(
    f"2026-01-0{1 + tap // 2}T10:00:0{sample},{'ab'[tap % 2]},{tap + sample / 1000},{tap // 2},{10 * tap + sample}\n"
    for tap in range(4)
    for sample in range(3)
)
KEYS = {"taxels": "p", "tap": ("thing", "press"), "what": "thing", "session": "date:day", "where": "at"}


def test_labels_that_are_measured_or_times_are_one_for_each_tap(tmp_path):
    """Where they are rounded, and of times the day."""
    (tmp_path / "a.csv").write_text(ENCODER, encoding="utf-8")
    taps = load_mapped(tmp_path / "a.csv", TapMap(**KEYS, where_round=1.0)).taps

    assert taps.taps[:, :, 0].tolist() == [[10 * tap + sample for sample in range(3)] for tap in range(4)]
    assert (taps.where.tolist(), taps.session.tolist()) == ([0, 1, 2, 3], [0, 0, 1, 1])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            {},
            r"line 3: where \(--where\) changes within a tap from 0.0 to 0.001; round it with",
        ),
        (
            {"where": None, "tap": "press"},
            r"line 5: what \(--what\) changes within a tap from a to b; if another",
        ),
        (
            {"where": None, "session": "day"},
            r"line 3: session \(--session\) changes within a tap from 2026-01-01T10",
        ),
        ({"where": None, "tap": ("thing", "pres")}, r"tap \(--tap\): no column pres; there is press"),
    ],
)
def test_labels_that_change_within_a_tap_do_not_divide_it(keys, message, tmp_path):
    (tmp_path / "a.csv").write_text(ENCODER, encoding="utf-8")

    with pytest.raises(InputError, match=message):
        load_mapped(tmp_path / "a.csv", TapMap(**(KEYS | keys)))


@pytest.mark.parametrize("tap", ["n", "ends:stop"])
def test_labels_may_be_one_for_each_tap(tap, tmp_path):
    """Though samples stand in rows."""
    frames, n = np.arange(10.0).reshape(5, 2), np.array([3, 3, 4, 4, 4])
    label, at = np.array(["a", "b"]), np.array([0.5, 1.5])
    np.savez(tmp_path / "a.npz", x=frames, n=n, stop=np.array([2, 5]), label=label, at=at)
    how = TapMap(taps="x", tap=tap, what="label", where="at", length="shortest")
    taps = load_mapped(tmp_path / "a.npz", how).taps

    assert taps.taps.tolist() == [[[0, 1], [2, 3]], [[4, 5], [6, 7]]]
    assert ([taps.what_name[m] for m in taps.what], taps.where.tolist()) == (["a", "b"], [0.5, 1.5])
    kept = load_mapped(tmp_path / "a.npz", how.changed(keep="n=4")).taps
    assert ([kept.what_name[m] for m in kept.what], kept.where.tolist()) == (["b"], [1.5])


@pytest.mark.parametrize("where", [None, "phase"])
def test_empty_cells_among_numbers_are_missing_numbers_to_a_comparison(tmp_path, where):
    """They are kept by none, also in a column of labels, which is read as texts."""
    rows = [(0, "3", 1), (1, "", 2), (2, "-1.0", 3), (3, "nan", 4), (4, "0", 5)]
    for keep, found in (
        ("phase>=0", [1, 5]),
        ("phase=-1", [3]),
        ("phase!=0", [1, 3]),
        ("phase<9", [1, 3, 5]),
    ):
        assert taps_of(tmp_path, rows, tap="row", keep=keep, where=where) == [[each] for each in found], keep


def test_empty_cells_among_words_are_texts_to_a_comparison(tmp_path):
    words = [(0, "a", 1), (1, "", 2), (2, "5", 3)]
    assert taps_of(tmp_path, words, tap="file", keep="phase!=5") == [[1, 2]]
    assert taps_of(tmp_path, words, tap="file", keep="phase!=") == [[1, 3]]
    assert "which have no order" in refused(tmp_path, words, tap="file", keep="phase>5")
