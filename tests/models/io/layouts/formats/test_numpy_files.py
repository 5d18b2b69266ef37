"""Files of NumPy: fields of structured arrays, texts, times, and what is refused."""

import zipfile

import numpy as np
import pytest
from solidtouch.models import storage
from solidtouch.models.errors import InputError
from solidtouch.models.io.layouts.formats.contents import TextTable
from solidtouch.models.io.layouts.formats.numpy_files import open_npy, open_npz

TABLE = np.array(
    [(1.5, ([1, 2], "left"), b"r\xc3\xb6d"), (2.5, ([3, 4], "right"), b"ball")],
    dtype=[("force", "f4"), ("at", [("xy", "i2", (2,)), ("name", "U5")]), ("what", "S8")],
)


def archive(tmp_path, *unnamed, **named):
    np.savez(tmp_path / "a.npz", *unnamed, **named)
    return open_npz(tmp_path / "a.npz", TextTable())


def test_names_of_numpy_are_kept(tmp_path):
    contents = archive(tmp_path, np.arange(3), np.ones((2, 2)))
    assert contents.variables.keys() == {"arr_0", "arr_1"}
    np.testing.assert_array_equal(contents.read(["arr_1"])[0]["arr_1"], np.ones((2, 2)))


@pytest.mark.parametrize("limit", [storage.ON_DISK, 10], ids=["in memory", "mapped"])
@pytest.mark.parametrize("kind", ["npz", "npy"])
def test_fields_are_variables(kind, limit, tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "ON_DISK", limit)
    np.save(tmp_path / "data.npy", TABLE)
    contents = archive(tmp_path, data=TABLE) if kind == "npz" else open_npy(tmp_path / "data.npy", TextTable())
    found, columns = contents.read(list(contents.variables), ["data.force"])

    assert {name: (each.shape, each.dtype.kind) for name, each in contents.variables.items()} == {
        "data.force": ((2,), "f"),
        "data.at.xy": ((2, 2), "i"),
        "data.at.name": ((2,), "U"),
        "data.what": ((2,), "U"),
    }
    assert found["data.at.xy"].tolist() == [[1, 2], [3, 4]]
    assert found["data.at.name"].tolist() == ["left", "right"]
    assert found["data.what"].tolist() == ["röd", "ball"]
    assert columns.tolist() == [[1.5], [2.5]]


def test_times_are_seconds(tmp_path):
    dates = np.array(["1970-01-02", "NaT"], "M8[D]")
    contents = archive(tmp_path, date=dates, since=np.array([1500, -1], "m8[ms]"))
    found, _ = contents.read(["date", "since"])

    assert {each.unit for each in contents.variables.values()} == {"s"}
    np.testing.assert_array_equal(found["date"], [86400, np.nan])
    np.testing.assert_array_equal(found["since"], [1.5, -0.001])


def test_a_large_file_is_mapped(tmp_path, monkeypatch):
    monkeypatch.setattr(storage, "ON_DISK", 100)
    values = np.asfortranarray(np.arange(600.0).reshape(20, 30))
    np.save(tmp_path / "a.npy", values)
    found = open_npy(tmp_path / "a.npy", TextTable()).read(["data"])[0]["data"]

    assert isinstance(found, np.memmap)
    np.testing.assert_array_equal(found, values)


REFUSED = {
    "pickled": (
        np.array([{}, None]),
        r"it holds pickled objects, which are refused; save its elements as plain arrays",
    ),
    "pickled fields": (np.zeros(2, [("a", "O")]), "it holds pickled objects"),
    "complex": (np.zeros(2, complex), "it holds complex numbers; save the real and the imaginary part as arrays"),
    "raw": (np.zeros(2, "V3"), "it holds raw bytes, which are neither numbers nor texts"),
}


@pytest.mark.parametrize(("values", "sentence"), REFUSED.values(), ids=REFUSED)
def test_what_is_neither_numbers_nor_texts_is_refused(values, sentence, tmp_path):
    """But only if it is asked for."""
    contents = archive(tmp_path, x=values, y=np.arange(3))
    assert contents.read(["y"])[0]["y"].tolist() == [0, 1, 2]
    with pytest.raises(InputError, match=f"array x cannot be read: {sentence}"):
        contents.read(["x"])


def test_a_field_that_cannot_be_read_leaves_the_others(tmp_path):
    contents = archive(tmp_path, x=np.ones(2, [("z", "c8"), ("n", "i4")]))
    assert contents.read(["x.n"])[0]["x.n"].tolist() == [1, 1]
    with pytest.raises(InputError, match=r"array x\.z cannot be read: it holds complex numbers"):
        contents.read(["x.z"])


def test_a_member_that_is_no_array_is_refused(tmp_path):
    archive(tmp_path, y=np.arange(3))
    with zipfile.ZipFile(tmp_path / "a.npz", "a") as file:
        file.writestr("readme.txt", "taps")
    contents = open_npz(tmp_path / "a.npz", TextTable())

    assert list(contents.variables) == ["y"]
    with pytest.raises(InputError, match=r"array readme\.txt cannot be read: it is not an array of NumPy"):
        contents.read(["readme.txt"])


@pytest.mark.parametrize(
    ("open_file", "sentence"),
    [(open_npy, r"not an array of NumPy \(\.npy\), or damaged"), (open_npz, "not an npz archive, or truncated")],
)
def test_another_file_is_refused(open_file, sentence, tmp_path):
    (tmp_path / "a").write_text("time,force\n0,1\n")
    with pytest.raises(InputError, match=sentence):
        open_file(tmp_path / "a", TextTable())


def test_a_header_that_says_more_than_there_is_is_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(30))
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-8])
    with pytest.raises(InputError, match=r"array data is damaged \(its header says 240 bytes, not 232 bytes"):
        open_npy(tmp_path / "a.npy", TextTable())
