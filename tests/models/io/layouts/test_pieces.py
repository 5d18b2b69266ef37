"""Samples of files as a map describes them: where a bad one stands, and what is kept beside them."""

import numpy as np
import pytest
from solidtouch.models import blocks, storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.mapping import TapMap
from solidtouch.models.io.layouts.tap_set import load_mapped
from solidtouch.models.taps import TapSet

TABLE = "t,part,f1,f2\n0,a,1,2\n1,a,3,4\n\n2,b,5,{}\n3,a,7,8\n"
TAPS = np.arange(24.0).reshape(4, 3, 2)
BAD = {
    "a row of a stream": (TABLE, {"taxels": "f*", "time": "t"}, "line 5, column f2 is nan"),
    "a row of a tap": (TABLE, {"taxels": "f*", "tap": "file"}, "line 5, column f2 is nan"),
    "a row after others": (TABLE, {"taxels": "f*", "tap": "row", "keep": "part=b"}, "line 5, column f2 is nan"),
    "columns as samples": (TABLE, {"taxels": "f*", "axes": "tap,sample"}, "line 5, column f2 is nan"),
    "taps": (TAPS, {"taps": "x"}, "tap 2, sample 1, taxel 0 of x is nan"),
    "other axes": (TAPS, {"taps": "x", "axes": "taxel,sample,tap"}, "tap 0, sample 1, taxel 2 of x is nan"),
    "frames": (TAPS[:, 1], {"taps": "x", "axes": "sample,taxel", "tap": "row"}, "frame 2, taxel 1 of x is nan"),
}


def written(folder, content):
    if isinstance(content, str):
        (folder / "a.csv").write_text(content.format(""), encoding="utf-8")
        return folder / "a.csv"
    content = content.copy()
    content[(2, 1, 0)[: content.ndim]] = np.nan
    np.savez(folder / "a.npz", x=content, other=np.zeros(2))
    return folder / "a.npz"


@pytest.mark.parametrize(("content", "keys", "place"), BAD.values(), ids=BAD)
def test_a_bad_sample_is_told_with_its_file_and_place(content, keys, place, tmp_path):
    path = written(tmp_path, content)

    with pytest.raises(InputError) as caught:
        load_mapped(path, TapMap(**keys))

    assert str(caught.value).startswith(f"{path}: {place}; NaN")


def test_a_bad_sample_that_is_not_kept_does_no_harm(tmp_path):
    taps = load_mapped(written(tmp_path, TABLE), TapMap(taxels="f*", tap="row", keep="part=a")).taps

    assert taps.taps.tolist() == [[[1, 2]], [[3, 4]], [[7, 8]]]


def test_of_ragged_taps_a_bad_sample_is_told_too(tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text('{"x": [[1], [2]]}\n{"x": [[3], [1e999], [5]]}\n', encoding="utf-8")

    with pytest.raises(InputError, match=r"a\.jsonl: tap 1, sample 1, taxel 0 of x is inf"):
        load_mapped(path, TapMap(taps="x", length="shortest"))


def test_further_columns_may_be_called_like_labels(tmp_path):
    """Like a part of a position, the time of rows, or an array of a tap set."""
    path = tmp_path / "a.csv"
    path.write_text("x,y,px,py,time,t,a\n7,7,0,1,5,0,1\n7,7,0,1,5,0.5,2\n8,8,2,3,6,1,3\n8,8,2,3,6,1.5,4\n")
    how = TapMap(taxels="a", tap="x", where=("px", "py"), time="t", extra=("x", "y", "time"))
    taps = load_mapped(path, how).taps

    assert taps.preprocessing.rate_hz == 2
    assert taps.dataset["where_place"].values.tolist() == [[0, 1], [2, 3]]
    assert [taps.dataset[name].values.tolist() for name in ("x", "y", "recorded_time")] == [[7, 8], [7, 8], [5, 6]]


def test_samples_of_a_large_file_are_scaled_there(tmp_path, monkeypatch):
    np.savez(tmp_path / "a.npz", x=TAPS)
    monkeypatch.setattr(storage, "ON_DISK", 0)
    monkeypatch.setattr(blocks, "BLOCK", 48)
    with monkeypatch.context() as patched:
        patched.setattr(TapSet, "taps", property(lambda _: pytest.fail("all samples were asked for")))
        taps = load_mapped(tmp_path / "a.npz", TapMap(taps="x", scale=0.5)).taps
    assert taps.scanned is not None
    assert taps.taps.tolist() == (TAPS / 2).tolist()


def of_fingers(folder, what, trial, fingers):
    """Files of one press, one for each finger."""
    (folder / what).mkdir(exist_ok=True)
    for finger, (header, rows) in fingers.items():
        text = "\n".join([header, *(",".join(map(str, row)) for row in rows)])
        (folder / what / f"press_{trial}_{finger}.csv").write_text(text, encoding="utf-8")


FINGERS = TapMap(files="{what}/press_{trial}_{taxel}.csv", taxels="f*", tap="file")


def test_files_of_the_same_taps_are_side_by_side(tmp_path):
    """In the natural order of their names, whatever their columns are called."""
    for what, trial in (("rod", 1), ("rod", 2), ("ball", 1)):
        at = 100 * trial + 10 * (what == "rod")
        fingers = {"f10": ("force,f1", [[at, at + 1], [at + 2, at + 3]]), "f9": ("force", [[at + 4], [at + 5]])}
        of_fingers(tmp_path, what, trial, fingers)
    taps = load_mapped(tmp_path, FINGERS).taps

    assert [taps.what_name[w] for w in taps.what] == ["ball", "rod", "rod"]
    assert taps.trial.tolist() == [1, 1, 2]
    assert (taps.taps - taps.taps[:, :1, 1:2]).tolist() == [[[4, 0, 1], [5, 2, 3]]] * 3


TWO = {"left": ("force", [[1], [2]]), "right": ("force", [[3], [4]])}
APART = {
    "one is missing": (TWO, {"left": TWO["left"]}, {}, "taxel right is either beside this file or beside"),
    "other lengths": (TWO, TWO | {"right": ("force", [[3]])}, {}, "differ in their numbers of taps or samples"),
    "twice": (TWO, TWO, {"files": "*/press_*_{taxel}.csv"}, "are both taxel left of the same taps; what tells"),
    "other numbers": (
        TWO,
        {"left": ("n,force", [[1, 1], [2, 2]]), "right": ("n,force", [[2, 3], [1, 4]])},
        {"tap": "n", "files": "{what}/press_2_{taxel}.csv"},
        r"press_2_right\.csv: tap \(--tap\) differs from that of .*press_2_left\.csv beside it",
    ),
    "other times": (
        TWO,
        {"left": ("t,force", [[0, 1], [1, 2]]), "right": ("t,force", [[0, 3], [1.6, 4]])},
        {"tap": None, "trigger": "clock", "window": 1, "time": "t", "files": "{what}/press_2_{taxel}.csv"},
        r"press_2_right\.csv: time \(--time\) differs from that of .*press_2_left\.csv beside it",
    ),
    "other labels": (
        TWO,
        {"left": ("force,at", [[1, 0], [2, 0]]), "right": ("force,at", [[3, 0], [4, 1]])},
        {"tap": "row", "where": "at", "files": "{what}/press_2_{taxel}.csv"},
        r"where \(--where\) differs from that of .*press_2_left\.csv beside it",
    ),
}


@pytest.mark.parametrize(("first", "second", "keys", "message"), APART.values(), ids=APART)
def test_files_that_do_not_go_together_are_named(first, second, keys, message, tmp_path):
    of_fingers(tmp_path, "rod", 1, first)
    of_fingers(tmp_path, "rod", 2, second)

    with pytest.raises(InputError, match=message):
        load_mapped(tmp_path, FINGERS.changed(**keys))


def test_arrays_of_the_same_taps_are_side_by_side(tmp_path):
    np.savez(tmp_path / "a.npz", left_pads=TAPS, right_pads=-TAPS, label=np.array(["a", "b", "a", "b"]))
    taps = load_mapped(tmp_path / "a.npz", TapMap(taps="{taxel}_pads", what="label")).taps

    assert taps.taps.tolist() == np.concatenate([TAPS, -TAPS], axis=2).tolist()
    assert taps.what_name == ["a", "b"]
