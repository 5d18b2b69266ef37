"""The compiled trials on an emulated AArch64 processor: the decisions and beliefs of this one."""

from itertools import product

import numpy as np
import pytest
from random_trials import random_plan, random_table
from solidtouch.inference.reference import BORDERS
from solidtouch.inference.trials import kernel
from solidtouch.inference.trials.run import run_trials
from solidtouch.models.settings import PlaySettings

pytest.importorskip("unicorn", reason="unicorn, an emulator of processors, is not installed")

from emulated_arm import EmulatedArm

HERE = kernel.play
TRIALS, DEADLINE, THRESHOLDS = 30, 20, (0.3, 0.9, 1.0, 0.999)
SHAPES = (1, 1), (2, 3), (5, 2), (9, 7), (16, 5), (37, 3)
THETA_X = 0.0, 0.4, 1.0
ALL = list(product(range(len(SHAPES)), BORDERS, THETA_X))
PAIRS = [run for run in ALL if (run[0] + BORDERS.index(run[1]) + THETA_X.index(run[2])) % 3 == 0]
EXACT = "taps", "what", "where", "true_where", "stopped", "clamped", "substituted", "used_up", "no_class_left"


@pytest.mark.slow
@pytest.mark.parametrize("runs", [PAIRS, ALL], ids=["pairs", "all"])
def test_trials_are_those_of_this_processor(runs, monkeypatch):
    """Tables of every size of rows, with evidence down to thousands of nats, impossible taps and untrained classes.

    A third of the runs have every pair of a table, a border and a threshold of positions.
    """
    emulated = []

    def play(*arguments):
        if not emulated:
            emulated.append(EmulatedArm(HERE, arguments))
        emulated[0](*arguments)

    for seed, border, theta_x in runs:
        L, M = SHAPES[seed]
        rng = np.random.default_rng(seed)
        depth, empty, saturation = (rng.choice(values) for values in ([0.1, 1, 30, 1e4], [0, 0.2], [np.inf, 2.0]))
        table = random_table(rng, L, M, depth, 0.05, 40, empty, S=2)._replace(saturation=float(saturation))
        plan, settings = (
            random_plan(rng, table, TRIALS),
            PlaySettings(theta_x=theta_x, border=border, deadline=DEADLINE),
        )
        options = {"play": settings, "seed": seed, "fresh": seed % 2 == 1, "workers": 1}
        here = run_trials(table, plan, THRESHOLDS, **options)
        with monkeypatch.context() as patched:
            patched.setattr(kernel, "play", play)
            there = run_trials(table, plan, THRESHOLDS, **options)

        for name in EXACT:
            np.testing.assert_array_equal(getattr(there, name), getattr(here, name), f"{name}, {(L, M, border)}")
        np.testing.assert_allclose(there.belief, here.belief, atol=1e-12)

    assert emulated
