"""Random numbers of trials: the published generator, the same in every form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from solidtouch.models import seeds

WORDS = st.integers(0, 2**32 - 1)

# Known answers that the authors of the generator publish with it (Random123, kat_vectors, philox4x32 10).
KNOWN = [
    ((0, 0, 0, 0, 0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 6, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344, 0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


@pytest.mark.parametrize(("given_words", "expected"), KNOWN)
def test_the_generator_gives_the_published_answers(given_words, expected):
    words = [np.uint64(word) for word in given_words]

    assert tuple(int(word) for word in seeds.philox(*words)) == expected


@given(st.tuples(*[WORDS] * 6))
def test_on_arrays_it_is_the_same(given_words):
    words = [np.uint64(word) for word in given_words]
    expected = tuple(int(word) for word in seeds.philox(*words))

    with jax.enable_x64(True):
        assert tuple(int(word) for word in seeds.philox(*(jnp.asarray(word) for word in words))) == expected


def test_words_do_not_depend_on_how_many_are_asked_for():
    """Streams and numbers can be cut anywhere that is a multiple of a block."""
    streams = np.array([0, 3, 2**32 - 1, 2**32, 2**40 + 5])
    whole = seeds.words(7, streams, seeds.TAPS, 0, 23)

    assert whole.shape == (5, 23)
    np.testing.assert_array_equal(seeds.words(7, streams[2:], seeds.TAPS, 8, 5), whole[2:, 8:13])
    np.testing.assert_array_equal(seeds.words(7, 3, seeds.TAPS, 0, 1), whole[[1], :1])


def test_seeds_streams_purposes_and_taps_have_numbers_of_their_own():
    """Among 2^15 words of 32 bits a handful may be equal by chance."""
    parts = [
        seeds.words(seed, streams, purpose, 0, 16)
        for seed in (0, 1, 2**32, 2**63)
        for purpose in (seeds.TAPS, seeds.STARTS)
        for streams in (np.arange(128), np.arange(128) + 2**32)
    ]
    words = np.concatenate([part.ravel() for part in parts])

    assert len(np.unique(words)) > len(words) - 8


@given(WORDS, st.integers(1, 2**21))
def test_a_number_below_a_count_is_that_of_the_uniform(word, count):
    """`floor(u * count)` in floating point and the integer product agree exactly."""
    below = int(seeds.below(np.uint64(word), np.uint64(count)))

    assert 0 <= below < count
    assert below == int(seeds.uniform(np.float64(word)) * count)


def test_numbers_are_uniform():
    """Chi-square over 20 values stays below its 99.99% point of 53."""
    words = seeds.words(3, np.arange(5000), seeds.TAPS, 0, 4)
    counts = np.bincount(seeds.below(words, np.uint64(20)).ravel().astype(int), minlength=20)

    assert ((counts - 1000.0) ** 2 / 1000.0).sum() < 53
