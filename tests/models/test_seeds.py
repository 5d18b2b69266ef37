"""Seeds derived from one seed: distinct for all purposes and data sets, and the only source of random numbers."""

import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from solidtouch.models import seeds
from solidtouch.models.seeds import Purpose, data_set_seed, derived_seed, generator

ROOT = Path(__file__).parents[2]
SEEDS = range(51)
EXEMPT = {
    "models/seeds.py",
    "hardware/simulator/signal_chain.py",  # from spawned sequences, as the next three
    "hardware/simulator/session.py",
    "hardware/emulator/finger.py",
    "hardware/emulator/skin_board.py",
    "models/measurement/student.py",  # the start of an optimisation, and a key drawn from a generator
    "models/measurement/generic/runs.py",  # a key drawn from a generator
    "inference/bayes_risk/problem.py",  # hashing
    "hardware/replay.py",  # the default for callers in Python
}


def test_all_derived_seeds_differ():
    """Of 51 data sets of 51 seeds, and of all other purposes with and without numbers."""
    others = [purpose for purpose in Purpose if purpose is not Purpose.DATA_SET]
    found = [data_set_seed(*key) for key in product(SEEDS, SEEDS)]
    found += [derived_seed(*key) for key in product(SEEDS, others)]
    found += [derived_seed(*key) for key in product(SEEDS, others, range(2))]

    assert len(set(found)) == len(found)
    assert all(0 <= seed < 2**63 for seed in found)


def test_purposes_of_a_data_set_differ_from_those_of_all_others():
    """The seed of a data set is a seed like any other."""
    sets = [data_set_seed(seed, number) for seed, number in product(range(8), range(8))]
    found = {derived_seed(seed, purpose, 1) for seed, purpose in product(sets, Purpose)}

    assert len(found) == len(sets) * len(Purpose)


def test_the_first_data_set_has_the_seed_itself():
    """So `simulate --seed` gives what other commands with this seed begin with."""
    assert [data_set_seed(seed, 0) for seed in (0, 7, 2**63 - 1)] == [0, 7, 2**63 - 1]


def test_seeds_are_the_same_on_every_machine_and_in_every_version():
    """Results can be made again."""
    assert data_set_seed(0, 1) == derived_seed(0, Purpose.DATA_SET, 1) == 4757611914559946779
    assert data_set_seed(7, 11) == 4450906522389087561
    assert derived_seed(2**63 - 1, Purpose.TARGETS, 0) == 1706533844913403638
    assert generator(3, Purpose.REPLAY, 2).integers(1000, size=3).tolist() == [52, 1, 682]


def test_streams_of_neighbouring_seeds_purposes_and_numbers_share_no_numbers():
    """Trailing zeros count too."""
    keys = [(), (0,), (1,), (0, 0), (0, 1), (1, 0)]
    numbers = [
        generator(data_set_seed(seed, number), purpose, *key).integers(2**62, size=20)
        for seed, number, purpose, key in product(range(3), range(2), list(Purpose)[::5], keys)
    ]

    assert len(np.unique(numbers)) == np.size(numbers)


def test_trials_of_neighbouring_seeds_share_no_numbers():
    """Two 32-bit words together, at all streams and for all purposes of trials."""
    numbers = [
        seeds.words(data_set_seed(seed, number), np.arange(30), purpose, 0, 40).reshape(-1, 2) @ (2**32, 1)
        for seed, number, purpose in product(range(4), range(4), (seeds.TAPS, seeds.STARTS, seeds.CHANCE))
    ]

    assert len(np.unique(numbers)) == np.size(numbers)


@pytest.mark.parametrize(
    "folder", ["models", "hardware", "inference", "analysis", "cli", "benchmarks/studies/beliefs/unknown.py"]
)
def test_no_other_source_of_random_numbers_is_used(folder):
    """No generator from a seed or a list, and no arithmetic with seeds, examples in docstrings apart."""
    example = re.compile(r"^ *>>> .*$", flags=re.MULTILINE)
    source = re.compile(r"default_rng\(|random\.key\((?!derived_seed)|RandomState|\bseed \+|\+ (\w+\.)?seed\b")
    found = {
        str(path.relative_to(ROOT))
        for path in ([ROOT / folder] if folder.endswith(".py") else (ROOT / folder).rglob("*.py"))
        if source.search(example.sub("", path.read_text(encoding="utf-8")))
    }

    assert found <= EXEMPT
