"""Elements of latent variables on which taps depend: a new session must not depend on any that no tap could train."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from numpyro.handlers import seed, substitute, trace

from ...errors import InputError
from .fit import Fit, latents_from_prior, running
from .programs import compiled_once
from .runs import density_of_taps
from .structure import feasible

_CLASSES = 8  # that are looked at
_POINTS, _NEAR = 3, 1e-3  # values of the latent variables, nearly alike: else one part of a mixture hides the others


def check_sessions(fit: Fit) -> str:
    """Looks at what a new session depends on.

    Returns:
        Sentences where the training taps tell nothing of it; empty otherwise.

    Raises:
        InputError: Latent variables have elements for a new session although their number is constant.
    """
    if "session" not in fit.story.wanted:
        return ""
    S, by_session = int(fit.batch.session.max()) + 1, fit.structure.by_session
    trained, used = _depended_on(_some(fit, range(S))), _depended_on(_some(fit, [S]))
    shared = [name for name in used if name not in by_session]
    untrained = [name for name in shared if (used[name] & ~trained[name]).any()]
    # From one session nothing is known of a slope over sessions either, which is no mistake.
    if untrained and (S > 1 or any((trained[name] & ~used[name]).any() for name in shared)):
        raise InputError(
            f"{fit.story.name} takes elements of the latent variable {untrained[0]!r} for a new session, {S}, that no "
            "training session takes; draw what belongs to sessions in a plate of size int(session.max()) + 1, not of a "
            "constant size."
        )
    idle = [name for name in by_session if not used[name].any()]
    told = [f"No sample depends on {name!r}, a latent variable of sessions of {fit.story.name}." for name in idle]
    untrained += [name for name in by_session if S == 1 and name not in idle]
    if untrained:
        told.append(
            f"How a new session differs from the one that trained {fit.story.name} ({', '.join(untrained)}) is known "
            "from the prior alone; train with several sessions."
        )
    return " ".join(told)


def _some(fit: Fit, sessions: Sequence[int]) -> Fit:
    """The fit on a tap of some of its classes in each of these sessions."""
    _, first = np.unique(np.column_stack([fit.batch.where, fit.batch.what]), axis=0, return_index=True)
    rows = np.tile(first[:: -(-len(first) // _CLASSES)], len(sessions))
    batch = replace(
        fit.batch,
        where=fit.batch.where[rows],
        what=fit.batch.what[rows],
        session=np.repeat(sessions, len(rows) // len(sessions)),
    )
    present = None if fit.present is None else fit.present[rows]
    return fit._replace(batch=batch, samples=fit.samples[rows], present=present)


def _depended_on(fit: Fit) -> dict[str, NDArray[np.bool_]]:
    """Masks of the elements of continuous latent variables on which taps or other latent variables depend."""

    def density(change: Any, data: Any) -> jax.Array:
        def given(site: dict[str, Any]) -> Any:
            value = feasible(site)
            if value is None or change.get(site["name"], value).shape != value.shape:  # in a scan
                return value
            return jax.lax.stop_gradient(value) + change[site["name"]] * jnp.where(value == 0, 1.0, value)

        story = substitute(seed(lambda: fit.run(*data), 0), substitute_fn=given)
        sites = trace(story).get_trace()
        prior = (sites[name]["fn"].log_prob(jax.lax.stop_gradient(sites[name]["value"])).sum() for name in change)
        return density_of_taps(fit.structure, story) + sum(prior)

    gradient = compiled_once(jax.grad(density))
    with running(fit):
        latents: Any = jax.eval_shape(lambda: latents_from_prior(fit))
        masks = {name: np.zeros(values.shape, dtype=bool) for name, values in latents.items()}
        ends = np.cumsum([mask.size for mask in masks.values()])
        for number in range(1, 1 + _POINTS):
            each = np.split(_NEAR * np.cos(number * np.arange(1, 1 + ends[-1])), ends[:-1])  # all different
            change = {name: part.reshape(masks[name].shape) for name, part in zip(masks, each, strict=True)}
            for name, values in gradient(change, fit.data).items():
                masks[name] |= np.asarray(values) != 0
    return masks
