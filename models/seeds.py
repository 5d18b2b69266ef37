"""Seeds, random generators and counter-based random numbers for every purpose, all derived from one `--seed`.

A `numpy.random.SeedSequence` takes the seed as entropy and the purpose with its numbers as spawn key, so streams of
different seeds, purposes or numbers are independent, and none depends on the order of calls. Lists such as
`default_rng([seed, n])` do not guarantee this: trailing zeros are ignored and the lists of two purposes can be equal.

The numbers of trials do not depend on the order of computation either: the counter of their generator (`philox`) holds
the number of the block, what the numbers are for and the stream of the trial, its key is the seed, so any processor can
make any number at any time.
"""

from enum import IntEnum, unique
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, check_count


@unique
class Purpose(IntEnum):
    """Purpose of random numbers, the first number of the spawn key. Values never change and are never reused."""

    # hardware: keys are session and number of the rod, stream or run
    SENSOR = 0
    SESSION = 1
    MOUNTING = 2
    COLLECTION = 3
    LIVE = 4
    MODEL = 5
    EMULATED = 6
    FAULTS = 7
    ORDER = 8  # of positions in a collection; session, object
    # seeds of their own
    DATA_SET = 9  # number of the data set, from 1
    TARGETS = 10  # of learned targets; number of the table
    CELL = 11  # of a sweep; digest of the data set's name
    REPEAT = 12  # of a study in benchmarks; number of the repetition
    # models and inference
    CHAINS = 13
    INTEGRATED = 40  # draws over which decisions are integrated; number of the draw
    NEW_SESSION = 41  # of a model that decides at one value; number of the draw
    SHARED_SESSION = 46  # taps of a session by which draws of new ones are judged
    CENTRE = 42  # of draws of a guide; number of the draw
    PARAMETERS = 14  # draws from a posterior; number of the draw
    PRIOR = 44  # draws from a prior; number of the draw
    PREDICTED = 45  # taps like known ones; number of the draw
    SEQUENCES = 15  # for learned powers; taps of a sequence, session
    ARM = 16  # of an online learner; episode
    SYMBOLS = 17
    RESAMPLES = 0x5A3B  # of test taps
    RIGHT_MODEL = 0x7219  # data drawn from it; number of the data set
    RIGHT_EXPONENT = 0x7E8D  # data drawn to tune exponents on; number of the data set
    # analysis
    EPISODES = 18  # of the cross-check
    CALIBRATION = 19  # route, policy
    CONTACTS = 20  # resample, number of contacts
    LEAKAGE = 21
    CAUSES = 22
    COVARIATE = 23
    HALVES = 24  # of the training session; half
    PERMUTATIONS = 25  # stratum
    STRATA = 26  # resampled; how many
    REPLICATES = 27  # of the audit; replicate
    CHECKS = 28  # of compare; draw
    SCORES = 29  # of compare, drawn with
    SINGLE_TAPS = 43  # of compare, by which importance sampling is judged
    ALIKE = 36  # permutations of several strata; their label
    SUSPECTS = 37  # session and half, how many numbers came before
    CONTACT_SCORES = 38  # of compare; contacts, the taps as they are or resampled
    REMEDY_SCORES = 39
    QUICK_FIT = 47  # of inspect
    # live episodes; episode
    START = 32
    OBJECT = 33
    REPLAY = 34
    # benchmarks
    STUDY = 35


def seed_sequence(seed: int, purpose: Purpose, *key: int) -> np.random.SeedSequence:
    """Entropy for one purpose of one seed.

    Args:
        seed: 0 or more.
        purpose: What the random numbers are for.
        key: Numbers that tell streams of this purpose apart, from 0 to 2^32 - 1; always as many for one purpose.

    Raises:
        InputError: The seed is no integer of at least 0.
    """
    check_count(seed, "seed", 0)
    return np.random.SeedSequence(seed, spawn_key=(int(purpose), *key))


def generator(seed: int, purpose: Purpose, *key: int) -> np.random.Generator:
    """Random numbers for one purpose of one seed; arguments as for `seed_sequence`."""
    return np.random.default_rng(seed_sequence(seed, purpose, *key))


def derived_seed(seed: int, purpose: Purpose, *key: int) -> int:
    """A seed from 0 to 2^63 - 1 for one purpose of a seed; arguments as for `seed_sequence`.

    It can be given to `--seed`. Two of n derived seeds are equal with probability n^2 / 2^64.
    """
    return int(seed_sequence(seed, purpose, *key).generate_state(1, np.uint64)[0] >> np.uint64(1))


def data_set_seed(seed: int, number: int) -> int:
    """The seed of a data set, or of a fold of recorded taps: it makes the taps and plays the trials.

    Data set 0 of a seed has the seed itself, so it is what a command with this `--seed` simulates.
    """
    return seed if number == 0 else derived_seed(seed, Purpose.DATA_SET, number)


TAPS, STARTS, CHANCE = np.uint64(0), np.uint64(1), np.uint64(2)
"""What the numbers of a trial are for; each has its own."""

LOW, HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
_ROUNDS = 10
_MULTIPLIER0, _MULTIPLIER1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_INCREMENT0, _INCREMENT1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)

PER_BLOCK = 4
MOST_SEED, MOST_STREAM = 2**64 - 1, 2**63 - 1


def philox(c0: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> tuple[Any, Any, Any, Any]:
    """Four random 32-bit words from four counter words and two key words, all held in unsigned 64-bit numbers.

    Philox4x32-10 of Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011. It runs as
    it stands on NumPy and JAX arrays and, compiled, on single numbers.
    """
    for _ in range(_ROUNDS):
        p0, p1 = _MULTIPLIER0 * c0, _MULTIPLIER1 * c2
        c0, c1, c2, c3 = (p1 >> HALF) ^ c1 ^ k0, p1 & LOW, (p0 >> HALF) ^ c3 ^ k1, p0 & LOW
        k0, k1 = (k0 + _INCREMENT0) & LOW, (k1 + _INCREMENT1) & LOW
    return c0, c1, c2, c3


def key(seed: int) -> tuple[np.uint64, np.uint64]:
    """Two key words of a seed.

    Raises:
        InputError: It is not a whole number from 0 to 2^64 - 1.
    """
    if int(seed) != seed or not 0 <= seed <= MOST_SEED:
        raise InputError(f"The seed must be an integer from 0 to {MOST_SEED}, got {seed}.")
    word = np.uint64(int(seed))
    return word & LOW, word >> HALF


def words(seed: int, stream: ArrayLike, purpose: np.uint64, first: int, count: int) -> NDArray[np.uint64]:
    """Random 32-bit words number `first` to `first + count - 1` of streams.

    Args:
        seed: From 0 to 2^64 - 1.
        stream: Numbers of the streams, shape (n,).
        purpose: `TAPS`, `STARTS` or `CHANCE`.
        first: A multiple of `PER_BLOCK`.
        count: How many.

    Returns:
        Shape (n, count), values below 2^32.
    """
    stream = np.atleast_1d(np.asarray(stream)).astype(np.uint64)[:, np.newaxis]
    block = np.arange(first // PER_BLOCK, -(-(first + count) // PER_BLOCK)).astype(np.uint64)
    parts = philox(block, purpose, stream & LOW, stream >> HALF, *key(seed))
    return np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(len(stream), -1)[:, :count]


def below(word: Any, count: Any) -> Any:
    """Integer from 0 to `count` - 1 from a 32-bit word, uniform to within count / 2^32."""
    return (word * count) >> HALF


def uniform(word: Any) -> Any:
    """Number in [0, 1) from a 32-bit word, such that `floor(u * count)` is `below(word, count)`."""
    return word / 2.0**32
