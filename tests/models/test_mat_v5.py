"""The reader of MATLAB v5 files agrees with SciPy's on whole files."""

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.io import loadmat, savemat
from scipy.sparse import csc_array
from solidtouch.models.errors import InputError
from solidtouch.models.mat_v5 import read_v5

NUMBERS = st.sampled_from(["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "?"]).flatmap(
    lambda kind: hnp.arrays(kind, hnp.array_shapes(min_dims=2, max_dims=4, min_side=0, max_side=4))
)


def written(variables, **options):
    file = io.BytesIO()
    savemat(file, variables, **options)
    return file.getvalue()


@given(values=NUMBERS, compressed=st.booleans())
@settings(deadline=None)
def test_numbers_of_any_type_and_shape_are_those_that_scipy_reads(values, compressed):
    content = written({"a": values, "after": [1.5]}, do_compression=compressed)
    read, expected = read_v5(content), loadmat(io.BytesIO(content))

    np.testing.assert_array_equal(expected["a"], read["a"])
    assert expected["a"].dtype == np.asarray(read["a"]).dtype
    np.testing.assert_array_equal([[1.5]], read["after"])


@given(texts=st.lists(st.text("abc µΩ€", max_size=6).map(str.rstrip), min_size=1, max_size=4))
@settings(deadline=None)
def test_cells_of_text_are_read_without_padding(texts):
    read = read_v5(written({"a": np.array([*texts, "end"], dtype=object)}))["a"]

    assert np.asarray(read).tolist() == [*texts, "end"]


def test_character_matrices_lose_their_padding():
    read = read_v5(written({"a": np.array(["a", "bb b"]), "b": "mm", "c": ""}))

    assert {name: np.asarray(value).tolist() for name, value in read.items()} == {
        "a": ["a", "bb b"],
        "b": ["mm"],
        "c": [],
    }


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        ({"b": 1.0}, "struct"),
        (csc_array(np.eye(3)), "sparse matrix"),
        (np.array([[1j]]), "complex array"),
        (np.array(["a", 2.0], dtype=object), "cell with something else"),
    ],
)
def test_kinds_without_a_plain_array_are_named(value, kind):
    read = read_v5(written({"a": value, "b": [3.0]}))

    assert str(read["a"]).startswith(kind)
    np.testing.assert_array_equal([[3.0]], read["b"])


@pytest.mark.parametrize("compressed", [True, False])
def test_no_end_of_a_file_is_mistaken_for_the_end_of_its_data(compressed):
    """A truncated file is refused, or ends between two variables."""
    content = written({"a": np.arange(12.0), "b": "text", "c": [1]}, do_compression=compressed)
    whole = read_v5(content)
    for end in range(len(content)):
        try:
            part = read_v5(content[:end])
        except InputError:
            continue
        assert len(part) < len(whole)
