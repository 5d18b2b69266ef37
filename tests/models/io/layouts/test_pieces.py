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
