"""Operations on runs of numbers against NumPy, at every length around the parts that runs are cut into."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError
from solidtouch.models import seeds, vectors
from solidtouch.models.compiled import compiled

LENGTHS = [*range(1, 35), 47, 64, 100]
WORD = st.integers(0, 2**32 - 1)


@compiled
def multiply_rows(values, factors, first, sums):
    return vectors.multiply_rows(values, factors, first, values.shape[0], values.shape[1], sums)


@compiled
def multiply_narrow_rows(values, factors, first, sums, columns):
    return vectors.multiply_narrow_rows(values, factors, first, values.shape[0], sums, columns)


@compiled
def sum_rows(values, first, rows, sums):
    vectors.sum_rows(values, first, rows, values.shape[1], sums)


@compiled
def largest(values, length):
    return vectors.largest(values, length)


@compiled
def copy(target, to, source, first, length):
    vectors.copy(target, to, source, first, length)


@compiled
def negate(values):
    run = vectors.flat(values)
    for i in range(len(run)):
        run[i] = -run[i]


@compiled
def random_blocks(words, first, c1, c2, c3, k0, k1):
    vectors.random_blocks(words, first, c1, c2, c3, k0, k1)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("length", LENGTHS)
def test_rows_are_multiplied_and_summed(rng, length):
    values, factors, sums = rng.random((3, length)), rng.random((4, 3, length)), np.full(4, 7.0)
    expected = values * factors[2]

    total = multiply_rows(values, factors, 6 * length, sums)

    np.testing.assert_array_equal(values, expected)
    np.testing.assert_allclose(sums, [*expected.sum(axis=1), 7.0], rtol=1e-14)
    assert total == pytest.approx(expected.sum(), rel=1e-14)


@pytest.mark.parametrize("length", LENGTHS)
def test_some_rows_are_added_up(rng, length):
    values, sums = rng.random((5, length)), np.full(length + 1, 7.0)

    sum_rows(values, length, 3, sums)

    np.testing.assert_allclose(sums, [*values[1:4].sum(axis=0), 7.0], rtol=1e-14)


def test_rows_of_one_part_are_multiplied_and_summed_both_ways_at_once(rng):
    """As one after the other, but for products that are rounded together with a sum."""
    values, factors = rng.random((5, vectors.PART)), rng.random((2, 5, vectors.PART))
    sums, columns = np.full((2, 6), 7.0), np.full((2, vectors.PART + 1), 7.0)
    expected = values.copy()
    totals = [multiply_rows(expected, factors, 5 * vectors.PART, sums[0])]
    sum_rows(expected, 0, 5, columns[0])

    totals += [multiply_narrow_rows(values, factors, 5 * vectors.PART, sums[1], columns[1])]

    np.testing.assert_array_equal(values, expected)
    assert totals[0] == pytest.approx(totals[1], rel=1e-15)
    np.testing.assert_allclose(*sums, rtol=1e-15)
    np.testing.assert_allclose(*columns, rtol=1e-15)


@pytest.mark.parametrize("length", LENGTHS)
def test_the_first_of_the_largest_is_found(rng, length):
    values = np.zeros(-(-length // vectors.PART) * vectors.PART)
    for most in (1, 2, 100):
        values[:length] = rng.integers(most, size=length) * 1e-300

        assert largest(values, length) == values.argmax()


@pytest.mark.parametrize("length", LENGTHS)
def test_a_run_is_copied_and_nothing_beside_it(rng, length):
    source, target = rng.integers(1, 9, size=length + 3), np.zeros(length + 5, np.int64)

    copy(target, 2, source, 3, length)

    np.testing.assert_array_equal(target, [0, 0, *source[3:], 0, 0, 0])


def test_a_run_is_the_array_itself(rng):
    values = rng.normal(size=(3, 4, 2))
    expected = -values

    negate(values)

    np.testing.assert_array_equal(values, expected)
    with pytest.raises(TypingError, match="side by side"):
        negate(values.T)


@given(first=st.integers(0, 2**20), others=st.tuples(*[WORD] * 5))
def test_random_blocks_are_those_of_the_generator(first, others):
    words = np.empty(vectors.WORDS, np.uint64)
    others = [np.uint64(word) for word in others]

    random_blocks(words, np.uint64(first), *others)

    expected = seeds.philox(np.arange(first, first + vectors.BLOCKS, dtype=np.uint64), *others)
    np.testing.assert_array_equal(words.reshape(seeds.PER_BLOCK, vectors.BLOCKS), expected)
