"""Tables whose columns differ from file to file, and columns that are numbers with a decimal comma."""

import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped


def loaded(folder, *tables, **how):
    for number, table in enumerate(tables):
        (folder / f"{number}.csv").write_text(table)
    return load_mapped(folder, TapMap(**{"tap": "file"} | how)).taps


def test_columns_in_another_order_are_the_same_taxels(tmp_path):
    tables = "t,s1,s2\n0,1,2\n", "s2,t,s1\n20,0,10\n"
    for taxels in ("s*", ("s1", "s2")):
        assert loaded(tmp_path, *tables, taxels=taxels).taps[:, 0].tolist() == [[1, 2], [10, 20]]
    with pytest.raises(InputError, match=r"1\.csv: columns of taxels are in another order"):
        loaded(tmp_path, "s1,s2\n1,2\n", "s2,s1\n1,2\n", taxels="0:2")


def test_other_columns_are_refused_but_by_number(tmp_path):
    tables = "s1,s2\n1,2\n", "s1,s3\n10,20\n"
    with pytest.raises(InputError, match=r"1\.csv: taxels \(--taxels\): .* differ in 's3'"):
        loaded(tmp_path, *tables, taxels="s*")
    assert loaded(tmp_path, *tables, taxels="0:2").taps[:, 0].tolist() == [[1, 2], [10, 20]]
    with pytest.raises(InputError, match=r"differ in 's \[mN\]'"):
        loaded(tmp_path, "s [N],x\n1,2\n", "s [mN],x\n10,20\n", taxels="s*")


def test_decimal_commas_in_times_counters_and_conditions(tmp_path):
    table = "t;force;s\n0,00;0,1;1,5\n0,01;0,5;2,5\n0,02;0,6;3,5\n"
    taps = loaded(tmp_path, table, taxels="s", decimal=",", time="t", keep="force>0.2")
    assert taps.taps[0, :, 0].tolist() == [2.5, 3.5]
    assert taps.preprocessing.rate_hz == 100


def test_a_table_of_labels_in_the_folder_is_no_recording(tmp_path):
    (tmp_path / "labels.csv").write_text("file,thing\n1,rod\n0,cup\n")
    taps = loaded(tmp_path, "s\n1\n", "s\n2\n", taxels="s", what="labels.csv:thing")
    assert [taps.what_name[m] for m in taps.what] == ["cup", "rod"]


def refused(folder, *tables, **how):
    with pytest.raises(InputError) as error:
        loaded(folder, *tables, **how)
    return str(error.value)


def test_a_repeated_name_counts_as_a_column(tmp_path):
    assert loaded(tmp_path, "x,x,a,b\n1,2,3,4\n", taxels="2:4").taps[0].tolist() == [[3, 4]]
    assert loaded(tmp_path, "x,x,a,b\n1,2,3,4\n", taxels="0:2").taps[0].tolist() == [[1, 2]]
    assert "column x is repeated; say which: x.0, x.1" in refused(tmp_path, "x,x,a,b\n1,2,3,4\n", taxels="x")


def test_units_that_differ_are_refused(tmp_path):
    assert "where (--where) is in cm and mm" in refused(
        tmp_path, "pos [mm],s\n1,1\n", "pos [cm],s\n1,1\n", taxels="s", where="pos"
    )
    assert "where (--where): units differ, cm and mm" in refused(
        tmp_path, "pos,s\n10mm,1\n1cm,1\n", taxels="s", where="pos", tap="row", files="0.csv"
    )


def test_labels_that_are_missing_are_refused_with_their_file(tmp_path):
    tables = "what,pos,s\na,1,1\n", "what,pos,s\na,1,1\n,,1\n"
    assert refused(tmp_path, *tables, taxels="s", tap="row", what="what").endswith(
        "tap 1 of " + str(tmp_path / "1.csv") + "."
    )
    assert "session (--session) is missing for tap 1 of " in refused(
        tmp_path, *tables, taxels="s", tap="row", session="what"
    )
    assert "'' of tap 1 of " in refused(tmp_path, *tables, taxels="s", tap="row", where="pos")


def test_a_time_that_is_missing_does_not_hide_the_rate(tmp_path):
    taps = loaded(tmp_path, "t,s\n0,1\n0.1,2\n,3\n0.3,4\n0.4,5\n", taxels="s", time="t")
    assert taps.preprocessing.rate_hz == 10


def test_digits_with_underscores_are_no_number(tmp_path):
    assert "line 2, column s: '1_000' is not a number" in refused(tmp_path, "s\n1_000\n", taxels="s")


def test_a_link_to_the_folder_itself_is_not_followed(tmp_path):
    (tmp_path / "loop").symlink_to(tmp_path)
    assert len(loaded(tmp_path, "s\n1\n", taxels="s").taps) == 1


def test_no_pattern_takes_labels_for_taxels(tmp_path):
    """Nor numbers of taps and times; a name or a number does."""
    table = "time,tap,thing,s1,s2\n0,1,7,1,2\n0,2,8,3,4\n"
    how = {"tap": "tap", "what": "thing", "time": "time"}
    assert loaded(tmp_path, table, taxels="*", **how).taps.tolist() == [[[1, 2]], [[3, 4]]]
    assert loaded(tmp_path, table, taxels=("t*", "s1"), **how | {"what": None}).taps.tolist() == [[[7, 1]], [[8, 3]]]
    assert loaded(tmp_path, table, taxels=("thing", "s1"), **how).taps.tolist() == [[[7, 1]], [[8, 3]]]


@pytest.mark.parametrize(
    ("name", "times", "rate"),
    [
        ("time_ms", "0 10 20", 100),
        ("t.us", "0 10 20", 1e5),
        ("clock", "2026-11-26T10:00:00 2026-11-26T10:00:00.25 2026-11-26T10:00:00.50", 4),
        ("times", "0 10 20", 0.1),
    ],
)
def test_times_in_units_of_their_name_and_as_dates(name, times, rate, tmp_path):
    rows = "".join(f"{time},{n}\n" for n, time in enumerate(times.split()))
    assert loaded(tmp_path, f"{name},s\n{rows}", taxels="s", time=name).preprocessing.rate_hz == rate
    with pytest.raises(InputError, match=r"time \(--time\): t holds texts such as noon, not numbers or times such as"):
        loaded(tmp_path, "t,s\nnoon,1\n", taxels="s", time="t")


def test_positions_in_the_unit_of_their_name(tmp_path):
    assert loaded(tmp_path, "at_mm,s\n3,1\n", taxels="s", where="at_mm").where_unit == "mm"
    assert loaded(tmp_path, "at_home,s\n3,1\n", taxels="s", where="at_home").where_unit == ""


WIDE = "thing,s0_t1,s0_t2,s0_t10,s1_t2,s1_t1,s1_t10\na,1,2,3,5,4,6\nb,7,8,9,11,10,12\n"


@pytest.mark.parametrize("tap", [None, "row"])
def test_columns_of_samples_and_taxels(tap, tmp_path):
    """One row for each tap, columns in any order."""
    taps = loaded(tmp_path, WIDE, taxels="s{sample}_t{taxel}", what="thing", tap=tap).taps
    assert taps.tolist() == [[[1, 2, 3], [4, 5, 6]], [[7, 8, 9], [10, 11, 12]]]


@pytest.mark.parametrize(
    ("table", "taxels", "message"),
    [
        (WIDE.replace("11", ""), "s{sample}_t{taxel}", "line 3, column s1_t2 is nan"),
        (
            WIDE,
            "x{sample}_{taxel}",
            r"no column matches taxels \(--taxels\) 'x{sample}_{taxel}'; columns: thing",
        ),
        (WIDE.replace("s1_t2", "s1_t3"), "s{sample}_t{taxel}", "no column has sample 0 of taxel 3"),
        (WIDE, "s{sample}_t{taxel}_{what}", r"unknown field {what}; fields are sample, taxel"),
    ],
)
def test_columns_of_samples_and_taxels_that_are_not_whole(table, taxels, message, tmp_path):
    with pytest.raises(InputError, match=message):
        loaded(tmp_path, table, taxels=taxels, tap="row")


@pytest.mark.parametrize(
    ("table", "keys", "taps"),
    [
        ("thing,v10,v9\na,2,1\nb,4,3\n", {"taxels": "v{sample}", "what": "thing"}, [[[1], [2]], [[3], [4]]]),
        ("thing,0.05,0.1\na,1,2\n", {"taxels": "{sample}"}, [[[1], [2]]]),
        ("7,1,2\n8,3,4\n", {"taxels": "{sample}", "what": "0", "header": False}, [[[1], [2]], [[3], [4]]]),
        ("t,no 2,no 1\n0,5,1\n1,6,2\n", {"taxels": "no {trial}", "time": "t"}, [[[1], [2]], [[5], [6]]]),
        ("a,b,t\n1,5,0\n2,6,1\n", {"taxels": "{tap}", "time": "t"}, [[[1], [2]], [[5], [6]]]),
        ("1_b,1_a,2_a,2_b\n2,1,5,6\n4,3,7,8\n", {"taxels": "{tap}_{taxel}"}, [[[1, 2], [3, 4]], [[5, 6], [7, 8]]]),
        ("s2,s1,x\n2,1,0\n4,3,0\n", {"taxels": "s{taxel}", "tap": "file"}, [[[2, 1], [4, 3]]]),
    ],
)
def test_columns_of_samples_or_taps_alone(table, keys, taps, tmp_path):
    assert loaded(tmp_path, table, **({"tap": None} | keys)).taps.tolist() == taps


def test_columns_number_the_taps_of_each_file(tmp_path):
    """Which may be more in one file than in another; a key for the number outweighs the name."""
    (tmp_path / "rod.csv").write_text("t,trial 1,trial 3\n0,1,2\n0.5,3,4\n")
    (tmp_path / "cup.csv").write_text("t,trial 2\n0,5\n0.5,6\n")
    how = TapMap(taxels="trial {trial}", time="t", files="{what}.csv")
    taps = load_mapped(tmp_path, how).taps

    assert [taps.what_name[m] for m in taps.what] == ["cup", "rod", "rod"]
    assert taps.trial.tolist() == [2, 1, 3]
    assert taps.preprocessing.rate_hz == 2
    assert load_mapped(tmp_path, how.changed(trial="=4")).taps.trial.tolist() == [4, 4, 4]


@pytest.mark.parametrize(
    "keys",
    [{"taxels": "no {trial}"}, {"taxels": ["no 1", "no 2"], "axes": "sample,tap"}, {"taxels": "no *", "tap": "file"}],
)
def test_missing_samples_have_their_place_whatever_the_columns_are(keys, tmp_path):
    with pytest.raises(InputError, match="line 4, column no 2 is nan"):
        loaded(tmp_path, "no 1,no 2\n1,2\n3,4\n5,\n", **({"tap": None} | keys))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"taxels": "{sample}_{tap}"}, "has {sample} and {tap}; columns are either"),
        ({"taxels": "no{tap}", "tap": "file"}, "has an axis of taps; leave it out"),
        ({"taxels": "no{tap}_{taxel}"}, "no column has tap 2 of taxel a"),
    ],
)
def test_columns_of_samples_or_taps_that_do_not_fit(keys, message, tmp_path):
    with pytest.raises(InputError, match=message):
        loaded(tmp_path, "no1_a,no1_b,no2_b\n1,2,3\n", **({"tap": None} | keys))
