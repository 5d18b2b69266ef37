"""Tables with a row for each sample of each taxel."""

import pytest
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped

ROWS = [(n, t, k, 100 * n + 10 * t + k) for n in (1, 2) for t in (0, 1) for k in (9, 10)]
HOW = TapMap(taxels="v", taxel="pad", tap="n", what="n")


def loaded(folder, rows, how=HOW, name="a.csv"):
    text = "n,t,pad,v\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    (folder / name).write_text(text, encoding="utf-8")
    return load_mapped(folder / name, how).taps


@pytest.mark.parametrize("order", [range(8), (0, 2, 1, 3, 5, 4, 7, 6), (1, 0, 3, 2, 5, 7, 4, 6)])
def test_taxels_are_in_natural_order(order, tmp_path):
    """Whether a sample or a taxel is complete first."""
    taps = loaded(tmp_path, [ROWS[row] for row in order], HOW.changed(time="t"))

    assert taps.taps.tolist() == [[[109, 110], [119, 120]], [[209, 210], [219, 220]]]
    assert taps.what_name == ["1", "2"]


@pytest.mark.parametrize(
    ("rows", "keys", "message"),
    [
        (ROWS[:-1], {}, r"taxel \(--taxel\): 10 has 3 rows, 9 4; each needs one for each sample"),
        (
            [ROWS[0], ROWS[3], ROWS[2], ROWS[1], *ROWS[4:]],
            {"time": "t"},
            r"line 3: taxel \(--taxel\) 10 has t 1, 9 0, in row 1 of each; samples of all taxels must be in the same",
        ),
        ([*ROWS[:5], (2, 0, 10, ""), *ROWS[6:]], {}, "line 7, column v is nan"),
        (ROWS, {"taxels": ("v", "t")}, r"taxel \(--taxel\): a table .* has one column in taxels \(--taxels\), not 2"),
        (ROWS, {"axes": "tap,taxel"}, r"has no axes \(--axes\)"),
        (ROWS, {"taxel": "pat"}, r"taxel \(--taxel\): no column pat; there is pad"),
    ],
)
def test_rows_that_do_not_go_together_are_named(rows, keys, message, tmp_path):
    with pytest.raises(InputError, match=message):
        loaded(tmp_path, rows, HOW.changed(**keys))


def test_files_have_the_same_taxels(tmp_path):
    for number, pads in enumerate([(1, 2), (2, 3)]):
        loaded(tmp_path, [(1, 0, k, k) for k in pads], name=f"{number}.csv")

    with pytest.raises(InputError, match=r"1\.csv: taxel \(--taxel\): taxels are 2, 3, of the first file 1, 2"):
        load_mapped(tmp_path, HOW)


def test_several_columns_may_tell_the_taxel(tmp_path):
    """Where one alone would put the fingers one after the other in time."""
    rows = [(tap, finger, pad, t) for tap in (0, 1) for finger in ("thumb", "index") for pad in (1, 2) for t in (0, 1)]
    lines = "".join(f"{tap},{finger},{pad},{t},{n}\n" for n, (tap, finger, pad, t) in enumerate(rows))
    (tmp_path / "a.csv").write_text(f"tap,finger,pad,t,v\n{lines}")
    how = TapMap(taxels="v", taxel=("finger", "pad"), tap="tap", time="t")

    taps = load_mapped(tmp_path / "a.csv", how).taps

    assert taps.taps.tolist() == [[[4, 6, 0, 2], [5, 7, 1, 3]], [[12, 14, 8, 10], [13, 15, 9, 11]]]
    with pytest.raises(
        InputError, match=r"line 6: time .* falls within a tap, from 1 to 0 s; .* taxel \(--taxel\) must"
    ):
        load_mapped(tmp_path / "a.csv", how.changed(taxel="pad"))
