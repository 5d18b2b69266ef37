"""Beliefs of pymdp 1.0.4, by a Python that has it: `python pymdp_beliefs.py GIVEN.npz FOUND.npy`.

pymdp requires an older JAX than this project. `GIVEN.npz` has A (K, B, N), B (N, N, U), D (N,), observed (T, K, B) and
action (T,); `FOUND.npy` gets beliefs in the N states after each observation, shape (T, N).
"""

import sys
from importlib.metadata import version

import jax.numpy as jnp
import numpy as np
from pymdp.agent import Agent  # pyright: ignore[reportMissingImports]


def main() -> None:
    """Infers states one observation after the other."""
    if version("inferactively-pymdp") != "1.0.4":
        sys.exit("this needs inferactively-pymdp 1.0.4; versions before 1 take the log of a mean for the mean of logs")
    given = np.load(sys.argv[1])
    agent = Agent(
        A=[jnp.asarray(table)[None] for table in given["A"]],
        B=[jnp.asarray(given["B"])[None]],
        D=[jnp.asarray(given["D"])[None]],
        categorical_obs=True,
        batch_size=1,
    )
    prior, found = agent.D, []
    for observed, action in zip(given["observed"], given["action"], strict=True):
        qs = agent.infer_states([jnp.asarray(row)[None] for row in observed], empirical_prior=prior)
        found.append(np.asarray(qs[0]).reshape(-1))
        prior = agent.update_empirical_prior(jnp.array([[int(action)]]), qs)
    np.save(sys.argv[2], np.array(found))


if __name__ == "__main__":
    main()
