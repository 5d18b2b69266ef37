"""Random tables of taps, however far apart their likelihoods are, and random plans of trials on them."""

import numpy as np
from solidtouch.inference.trials.records import TapTable, TrialPlan
from solidtouch.models.grid import tap_pool


def random_table(rng, L, M, depth, impossible, N, empty=0.0, S=1):
    """Taps of most classes in S sessions, log-likelihoods down to `depth`; some are impossible, classes untrained."""
    log_likelihood = -depth * rng.exponential(size=(N, L, M)) - rng.choice([0.0, 700.0, 1e5])
    log_likelihood[rng.random(log_likelihood.shape) < impossible] = -np.inf
    prior = rng.normal(size=(L, M)) * rng.choice([0.0, 1.0, 300.0])
    holes = rng.random((L, M)) < empty
    if not holes.all():
        prior[holes] = log_likelihood[:, holes] = -np.inf
    return TapTable(
        log_likelihood,
        tap_pool(rng.integers(L, size=N), rng.integers(M, size=N), (L, M), rng.integers(S, size=N)),
        prior - np.logaddexp.reduce(prior.ravel()),
    )


def random_plan(rng, table, trials):
    session, held = rng.choice(np.argwhere(table.pool.count.any(axis=1)), size=trials).T
    L = len(table.log_prior)
    return TrialPlan(
        rng.integers(L, size=trials),
        held,
        rng.integers(L, size=trials),
        rng.integers(2**40, size=trials),
        session,
    )
