"""What the packages themselves find for their examples, and examples that they draw."""

import logging
import os
import subprocess
import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray
from solidtouch.models.seeds import Purpose, generator

from benchmarks.peers.examples import Active, Example

PYMDP = "SOLIDTOUCH_PYMDP_PYTHON"
"""Variable with the Python that has pymdp."""


def by_hmmlearn(example: Example) -> dict[str, NDArray[np.float64]]:
    """Quantities of `States` that hmmlearn computes."""
    from hmmlearn import hmm  # noqa: PLC0415 - an optional package

    assert example.trained is not None  # noqa: S101 - of such examples alone
    (S, _, B), (T, J, _) = example.trained.shape, example.taps.shape
    seen, coefficient = example.taps[:, 0].astype(int), np.zeros(T)
    model: Any = hmm.CategoricalHMM(S, n_features=B)
    if J > 1:
        seen = (example.taps[:, :, 0, None] == np.arange(B)).sum(axis=1)
        coefficient = _log_orders(seen)
        logging.getLogger("hmmlearn").setLevel(logging.ERROR)  # it warns that it has changed since
        model = hmm.MultinomialHMM(S, n_trials=J)
        model.n_features = B
    model.startprob_, model.transmat_ = example.start, example.transition
    model.emissionprob_ = (example.trained / example.trained.sum(axis=-1, keepdims=True))[:, 0]
    log_path, path = model.decode(seen)
    return {
        "belief": np.array([model.predict_proba(seen[: t + 1])[-1] for t in range(T)]),
        "smoothed": model.predict_proba(seen),
        "log_evidence": np.array(model.score(seen) - coefficient.sum()),
        "path": path,
        "log_path": np.array(log_path - coefficient.sum()),
    }


def _log_orders(bags: NDArray[np.integer]) -> NDArray[np.float64]:
    """Log of the number of orders of the symbols of each bag, shape (T,)."""
    from scipy.special import gammaln  # noqa: PLC0415

    return gammaln(bags.sum(axis=1) + 1) - gammaln(bags + 1).sum(axis=1)


def by_dynamax(example: Example) -> dict[str, NDArray[np.float64]]:
    """Quantities of `States` that dynamax computes."""
    with warnings.catch_warnings(action="ignore"), jax.enable_x64(True):
        from dynamax import hidden_markov_model as peer  # noqa: PLC0415 - an optional package

        start, log_likelihood = (jax.numpy.asarray(part) for part in (example.start, example.log_likelihood))
        matrix = jax.numpy.asarray(example.transition)
        found = peer.hmm_smoother(start, matrix, log_likelihood)
        return {
            "pairs" if example.transition.ndim == 3 else "changes": np.asarray(found.trans_probs),
            "belief": np.asarray(found.filtered_probs),
            "predicted": np.asarray(found.predicted_probs),
            "smoothed": np.asarray(found.smoothed_probs),
            "log_evidence": np.asarray(found.marginal_loglik),
            "path": np.asarray(peer.hmm_posterior_mode(start, matrix, log_likelihood)),
        }


def drawn_by_dynamax(name: str, test: str, T: int, S: int, *, in_time: bool = False) -> Example:
    """The arguments that a test of dynamax draws with key 0: T observations of S states, with matrices that change."""
    keys = jax.random.split(jax.random.PRNGKey(0), 3)
    start = np.array(jax.random.uniform(keys[0], (S,)), np.float64)
    if in_time:
        matrix = np.array([jax.random.uniform(key, (S, S)) for key in jax.random.split(keys[1], T - 1)], np.float64)
    else:
        matrix = np.array(jax.random.uniform(keys[1], (S, S)), np.float64)
    log_likelihood = np.array(jax.random.normal(keys[2], (T, S)), np.float64)
    return Example(
        name=name,
        package="dynamax 1.0.2",
        source=f"dynamax/hidden_markov_model/inference_test.py: {test}",
        start=start / start.sum(),
        transition=matrix / matrix.sum(axis=-1, keepdims=True),
        taps=np.zeros((T, 1, 1)),
        likelihood=np.exp(log_likelihood),
    )


def casino_of_dynamax(first: Example, rolls: int = 300) -> Example:
    """The casino with all rolls of dynamax's notebook, which its own `sample` draws.

    JAX drew other numbers in its day.
    """
    from dynamax.hidden_markov_model import CategoricalHMM  # noqa: PLC0415 - an optional package

    assert first.trained is not None  # noqa: S101 - it has
    emission = first.trained / first.trained.sum(axis=-1, keepdims=True)
    partitionable = jax.config.jax_threefry_partitionable
    jax.config.update("jax_threefry_partitionable", False)
    try:
        with warnings.catch_warnings(action="ignore"):
            model = CategoricalHMM(*emission.shape)
            parameters, _ = model.initialize(
                initial_probs=jax.numpy.asarray(first.start, dtype="float32"),
                transition_matrix=jax.numpy.asarray(first.transition, dtype="float32"),
                emission_probs=jax.numpy.asarray(emission, dtype="float32"),
            )
            _, seen = model.sample(parameters, jax.random.PRNGKey(42), rolls)
    finally:
        jax.config.update("jax_threefry_partitionable", partitionable)
    expected = {"log_evidence": np.array(-517.95)}
    taps = np.asarray(seen, dtype=np.float64)[:, None]
    return replace(
        first, name=f"casino, all {rolls} rolls", taps=taps, expected=expected, within={"log_evidence": 5e-3}
    )


def constant_state(T: int = 10_000, S: int = 100, scale: float = 50.0) -> Example:
    """As large as dynamax's test of stability, with a state that stays; the log-likelihoods are half as far apart."""
    rng = generator(0, Purpose.REPEAT, 24)
    log_likelihood = scale * rng.normal(size=(T, S))
    return Example(
        name=f"{T:,} taps of {S} constant states",
        package="dynamax 1.0.2",
        source="dynamax/hidden_markov_model/inference_test.py: test_hmm_smoother_stability, with identity transitions",
        start=np.full(S, 1 / S),
        transition=np.eye(S),
        taps=np.zeros((T, 1, 1)),
        likelihood=np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True)),
    )


def by_pymdp(example: Example | Active) -> NDArray[np.float64]:
    """Beliefs of pymdp in the states, shape (T, S), or in places and objects, shape (T, L, M).

    Raises:
        FileNotFoundError: The variable `PYMDP` names no Python.
    """
    T, J, K = example.taps.shape
    assert example.trained is not None  # noqa: S101 - of such examples alone
    B = example.trained.shape[-1]
    counts = example.trained.reshape(-1, K, B)
    if isinstance(example, Active):
        L, M = example.trained.shape[:2]
        start = np.eye(L)[example.start].repeat(M) / M
        places = np.broadcast_to(np.eye(L)[:, :, None], (L, L, L))  # an action leads to its place from everywhere
        kernels = np.stack([np.kron(place, np.eye(M)) for place in places], axis=-1)
        actions = [*example.visited[1:], 0]
    else:
        start, kernels, actions = example.start, example.transition.T[..., None], [0] * T
    given = {
        "A": np.moveaxis(counts / counts.sum(axis=-1, keepdims=True), 0, -1),
        "B": kernels,
        "D": start,
        "observed": (example.taps[..., None] == np.arange(B)).sum(axis=1) / J,
        "action": actions,
    }
    found = run_pymdp(given)
    return found.reshape(T, *example.trained.shape[:2]) if isinstance(example, Active) else found


def run_pymdp(given: dict[str, Any]) -> NDArray[np.float64]:
    """What `pymdp_beliefs.py` finds.

    Raises:
        FileNotFoundError: As `by_pymdp`.
    """
    python = os.environ.get(PYMDP)
    if not python:
        raise FileNotFoundError(f"{PYMDP} does not name a Python with inferactively-pymdp 1.0.4.")
    script = Path(__file__).with_name("pymdp_beliefs.py")
    environment = {**os.environ, "JAX_ENABLE_X64": "1", "JAX_PLATFORMS": "cpu"}
    with TemporaryDirectory() as folder:
        paths = Path(folder, "given.npz"), Path(folder, "found.npy")
        np.savez(paths[0], **given)
        subprocess.run([python, script, *paths], env=environment, check=True)  # noqa: S603 - named by the user
        return np.load(paths[1])
