"""Seeds and random generators for every purpose, all derived from one `--seed`.

A `numpy.random.SeedSequence` takes the seed as entropy and the purpose with its numbers as spawn key, so streams of
different seeds, purposes or numbers are independent, and none depends on the order of calls. Lists such as
`default_rng([seed, n])` do not guarantee this: trailing zeros are ignored and the lists of two purposes can be equal.
"""

from enum import IntEnum, unique

import numpy as np

from .errors import check_count


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
    PARAMETERS = 14  # draws from a posterior; number of the draw
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
    CLUSTERS = 30  # of compare, resampled
    COMPONENTS = 31
    ALIKE = 36  # permutations of several strata; their label
    SUSPECTS = 37  # session and half, how many numbers came before
    CONTACT_SCORES = 38  # of compare; contacts, the taps as they are or resampled
    REMEDY_SCORES = 39
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
