"""What a generative model consists of, found by running it on a few made-up taps.

A wrong site is refused here, in one sentence, before a fit spends time on it.
"""

import inspect
from collections.abc import Collection
from dataclasses import replace
from itertools import chain
from traceback import extract_tb
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jax import errors
from jax.experimental import checkify
from numpyro.distributions import ImproperUniform, MaskedDistribution, biject_to
from numpyro.handlers import seed, substitute, trace

from ...errors import InputError
from ..fits.present import layers, peeled
from .contract import StoryCall, StoryFunction
from .interval import CENSORED, is_bounded
from .observed import elementwise, measure_of

OBSERVED = "taps"
"""The site of the samples."""
_DIMS = {"L": "where", "M": "what", "J": "sample", "K": "taxel"}


class Structure(NamedTuple):
    """Sites of a generative model.

    Attributes:
        dims: Dims of each latent variable by name.
        swapped: Whether the observed site has taxels before times.
        measure: See `observed`.
        exchangeable: Whether all samples of a taxel are independent and have one distribution.
        independent: Whether all samples of a tap are independent.
        enumerated: Names of the discrete latent variables of single taps, which are summed over.
        by_session: Axis of sessions of the latent variables that have one, by name.
        family: Name of the distribution of the samples.
        bounded: Whether it excludes some real numbers.
    """

    dims: dict[str, tuple[str, ...]]
    swapped: bool
    measure: str
    exchangeable: bool
    independent: bool
    enumerated: tuple[str, ...]
    by_session: dict[str, int]
    family: str = "distribution"
    bounded: bool = False


def structure_of(story: StoryFunction, batch: StoryCall, sessions: int = 1) -> Structure:
    """Structure of a generative model.

    Args:
        story: The model.
        batch: Taps of the kind that it is for; how many does not matter.
        sessions: Number of training sessions, the index of the session at perception.

    Raises:
        InputError: The function fails, has no site `taps` or one of another shape, or latent variables that cannot be
            fitted.
    """
    few = _traced(story, _some(batch, 2), 2, run=False)  # the classes of two taps are among those of three
    more = _traced(story, _some(batch, 3), 3)
    _check_rest(story, more.sites)
    latents = {name: s for name, s in more.sites.items() if s["type"] == "sample" and not s["is_observed"]}
    enumerated = []
    for name, latent in latents.items():
        local = np.shape(few.sites[name]["value"]) != np.shape(latent["value"])
        discrete = latent["fn"].support.is_discrete
        _check_latent(story, name, latent, local, discrete)
        if discrete:
            enumerated.append(name)
    if len(enumerated) == len(latents):
        raise InputError(f"{story.name} has no latent variable to fit; a model needs at least one.")
    _check_drawn(story, _some(batch, 2), np.shape(few.sites[OBSERVED]["value"]))
    kept = {name: latent for name, latent in latents.items() if name not in enumerated}
    return Structure(
        {name: _dims(name, latent, batch.shape) for name, latent in kept.items()},
        more.swapped,
        more.measure,
        not enumerated and not more.swapped and more.alike and not more.looks_back,
        not more.looks_back and not peeled(more.sites[OBSERVED]["fn"]).event_dim,
        tuple(enumerated),
        _session_axes(story, batch, kept, more.sites, sessions),
        _family(more.sites[OBSERVED]["fn"]),
        is_bounded(more.sites[OBSERVED]["fn"]),
    )


def shapes_of(story: StoryFunction, batch: StoryCall) -> dict[str, tuple[int, ...]]:
    """Shapes of the latent variables of taps in one session, by name, but of discrete ones.

    Raises:
        InputError: The function fails, for example as an index is beyond an axis of fixed size.
    """
    sites = _traced(story, _some(batch, 2), 2).sites
    latents = {name: site for name, site in sites.items() if site["type"] == "sample" and not site["is_observed"]}
    return {name: np.shape(s["value"]) for name, s in latents.items() if not s["fn"].support.is_discrete}


def _some(batch: StoryCall, n: int) -> StoryCall:
    """StoryCall of n taps of its classes in turn, from the last one back."""
    L, M, _, _ = batch.shape
    index = -1 - np.arange(n)
    return StoryCall(**{**vars(batch), "where": index % L, "what": index % M, "session": np.zeros(n, dtype=np.intp)})


def _probe(batch: StoryCall, n: int) -> Any:
    """Made-up samples, all different."""
    _, _, J, K = batch.shape
    return np.arange(1.0, 1.0 + n * J * K).reshape(n, J, K)


class _Traced(NamedTuple):
    """What a run of a generative model shows.

    Attributes:
        sites: Its sites by name; of their values and parameters only the shapes are known, as nothing is computed.
        swapped: See `Structure`; false where it was not run.
        measure: Likewise.
        alike: Whether samples are independent and no parameter varies along a tap.
        looks_back: Whether the distribution of samples depends on samples, as in a forecast from those before.
    """

    sites: dict[str, Any]
    swapped: bool
    measure: str
    alike: bool
    looks_back: bool


def _traced(story: StoryFunction, batch: StoryCall, n: int, run: bool = True) -> _Traced:
    """Traces a generative model on n made-up taps, so that none of its operations is compiled.

    Classes are traced, too, as they are where taps are judged under all of them. Where it is to `run`, what it observes
    is compiled as a whole, and indices beyond an axis are found.
    """
    seen: dict[str, Any] = {}

    def observed(taps: Any, where: Any, what: Any) -> tuple[Any, list[Any]]:
        made = replace(batch, where=where, what=what)
        sites = trace(substitute(seed(story, 0), substitute_fn=feasible)).get_trace(made, taps)
        site = _observed(story, sites, batch.shape, n)
        seen.update(sites=sites, measure=measure_of(site["fn"]), alike=_is_alike(site))
        return site["value"], jax.tree.leaves(site["fn"])

    probe, swapped = _probe(batch, n), False
    try:
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            program = jax.make_jaxpr(observed)(probe, batch.where, batch.what).jaxpr
            if run:
                checked = checkify.checkify(lambda *made: observed(*made)[0], checkify.index_checks)
                wrong, value = jax.jit(checked)(probe, batch.where, batch.what)
                if beyond := wrong.get_exception():
                    raise beyond.with_traceback(beyond.traceback_info.as_python_traceback())
                swapped = _is_swapped(story, np.asarray(value), probe)
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # whatever a user's function raises
        raise InputError(f"{story.name} failed when it was tried on {n} taps{told_in(story, error)}") from error
    return _Traced(swapped=swapped, looks_back=_looks_back(program), **seen)


def feasible(site: dict[str, Any]) -> Any:
    """Value of a continuous latent variable that its support allows."""
    if site["type"] != "sample" or site["is_observed"] or site["name"] == OBSERVED or site["fn"].support.is_discrete:
        return None
    to_support = biject_to(site["fn"].support)
    return to_support(jnp.zeros(site["kwargs"]["sample_shape"] + to_support.inverse_shape(site["fn"].shape())))


def _looks_back(program: Any) -> bool:
    """Whether a parameter of the observed distribution, any result but the first, is made from the samples."""
    reached = {id(program.invars[0])}
    for operation in program.eqns:
        if not reached.isdisjoint(map(id, operation.invars)):
            reached.update(map(id, operation.outvars))
    return not reached.isdisjoint(map(id, program.outvars[1:]))


def told_in(story: StoryFunction, error: BaseException) -> str:
    """Where an error arose in the file of a function, and what it says."""
    file = inspect.getsourcefile(story.code)
    lines = [frame.lineno for frame in extract_tb(error.__traceback__) if frame.filename == file]
    place = f", line {lines[-1]} of its file" if lines else ""
    if isinstance(error, errors.TracerArrayConversionError | errors.TracerIntegerConversionError):
        return f"{place}: NumPy cannot compute with values that JAX traces; use jax.numpy, also for arrays to index."
    if isinstance(error, errors.ConcretizationTypeError | errors.NonConcreteBooleanIndexError):
        return f"{place}: a condition, size or number depends on values that JAX traces; use jnp.where or the like."
    said = (str(error).splitlines() or [""])[0].strip()
    if "Incompatible shapes" in said:
        said += "; parameters of (tap, taxel) need an axis for samples, as in loc[where, what][:, None]"
    return f"{place}: {type(error).__name__}: {said}"


def _observed(story: StoryFunction, sites: dict[str, Any], sizes: tuple[int, int, int, int], n: int) -> dict[str, Any]:
    """The observed site, of the right shape."""
    site = sites.get(OBSERVED)
    if site is None or site["type"] != "sample" or not site["is_observed"]:
        names = ", ".join(name for name, s in sites.items() if s["type"] == "sample") or "none"
        there = f"; its site {OBSERVED!r} is not observed" if site is not None and site["type"] == "sample" else ""
        raise InputError(
            f"{story.name} must observe the samples at a site {OBSERVED!r} with obs=taps{there}; its sites: {names}."
        )
    _, _, J, K = sizes
    shape = tuple(site["fn"].batch_shape) + tuple(site["fn"].event_shape)
    if shape not in {(n, J, K), (n, K, J)}:
        raise InputError(
            f"The site {OBSERVED!r} of {story.name} has shape {shape} for {n} taps, expected ({n}, {J}, {K}): tap, "
            "sample, taxel."
        )
    return site


def _is_swapped(story: StoryFunction, value: Any, probe: Any) -> bool:
    for swapped, expected in ((False, probe), (True, probe.swapaxes(1, 2))):
        if value.shape == expected.shape and np.allclose(value, expected):
            return swapped
    raise InputError(f"The site {OBSERVED!r} of {story.name} must observe taps themselves, not values made from them.")


def _check_drawn(story: StoryFunction, batch: StoryCall, shape: tuple[int, ...]) -> None:
    """Refuses a model that draws no taps of the shape that it observes."""

    def drawn() -> Any:
        sites = trace(substitute(seed(story, 0), substitute_fn=feasible)).get_trace(batch)
        return sites.get(OBSERVED, {"value": None})["value"]

    try:
        with jax.enable_x64(True), numpyro.validation_enabled(False):
            found = jax.eval_shape(drawn)
    except (Exception, SystemExit) as error:  # whatever a user's function raises
        told = told_in(story, error)
        raise InputError(f"{story.name} failed when it was tried with taps=None, to draw 2{told}") from error
    if np.shape(found) != shape:
        raise InputError(f"{story.name} with taps=None must draw taps of shape {shape} at its site {OBSERVED!r}.")


def _check_rest(story: StoryFunction, sites: dict[str, Any]) -> None:
    """Refuses what would be known to the fit alone, and neither to the likelihood of a tap nor to draws."""
    for name, site in sites.items():
        if site["type"] == "param":
            raise InputError(
                f"{story.name} has a parameter {name!r} without a prior, by numpyro.param; make it a latent variable, "
                "by numpyro.sample."
            )
        if site["type"] == "sample" and site["is_observed"] and name != OBSERVED:
            raise InputError(
                f"{story.name} has a second observed site {name!r}, by obs= or numpyro.factor; all that a model "
                f"observes are the samples at {OBSERVED!r}."
            )


def _check_latent(story: StoryFunction, name: str, latent: dict[str, Any], local: bool, discrete: bool) -> None:
    if discrete and not local:
        raise InputError(
            f"The discrete latent variable {name!r} of {story.name} is shared by several taps; put a continuous one in "
            "its place, such as a level whose prior is a mixture, by numpyro.distributions.MixtureSameFamily."
        )
    if discrete and not latent["fn"].has_enumerate_support:
        raise InputError(
            f"The discrete latent variable {name!r} of {story.name} cannot be enumerated; sum it out in the model, for "
            "example by numpyro.distributions.MixtureSameFamily."
        )
    if local and not discrete:
        raise InputError(
            f"The latent variable {name!r} of {story.name} has a value for every tap, so that no tap could be judged "
            "without a fit; integrate it out in the model, or let it depend on class, taxel or session."
        )
    if is_improper(latent["fn"]):
        raise InputError(
            f"The latent variable {name!r} of {story.name} has no proper prior, so that nothing can be drawn from it; "
            "give it one."
        )


def check_names(story: StoryFunction, structure: Structure) -> None:
    """Checks that latent variables can be arrays of a file and of a tree for ArviZ.

    Raises:
        InputError: One of them has the name of an axis, or one with a slash.
    """
    axes = {"where", "what", "chain", "draw", "integrated", *chain(*structure.dims.values())}
    axes |= {"time"} if "sample" in axes else set()  # as ArviZ has a dimension `sample` of its own
    for name in structure.dims:
        if "/" in name:
            raise InputError(
                f"The latent variable {name!r} of {story.name} has a / in its name, which files cannot hold; rename "
                'it, or give numpyro.handlers.scope divider=".".'
            )
        if name in axes or name in {"", "."}:
            raise InputError(
                f"The latent variable {name!r} of {story.name} needs another name; an axis of files has this one."
                if name
                else f"A latent variable of {story.name} has no name; give it one."
            )


def is_improper(prior: Any) -> bool:
    """Whether a prior is flat, whatever plates, masks and event dimensions do to it."""
    while hasattr(prior, "base_dist"):
        prior = prior.base_dist
    return isinstance(prior, ImproperUniform)


def _dims(name: str, latent: dict[str, Any], shape: tuple[int, int, int, int]) -> tuple[str, ...]:
    """Dims of a latent variable, from its plates."""
    sizes = dict(zip(_DIMS, shape, strict=True))
    value, event = np.shape(latent["value"]), latent["fn"].event_dim
    dims = [f"{name}_dim_{axis}" for axis in range(len(value))]
    for frame in latent["cond_indep_stack"]:
        axis = len(value) - event + frame.dim
        if 0 <= axis < len(value) and value[axis] == frame.size:
            known = sizes.get(frame.name) == frame.size
            dims[axis] = _DIMS[frame.name] if known else f"{name}_{frame.name}".replace("/", ".")
    return tuple(dims)


def _family(distribution: Any) -> str:
    base = peeled(distribution)
    of = f" of {_family(base.base_dist)}" if hasattr(base, "base_dist") else ""
    return type(base).__name__ + of


def _is_alike(site: dict[str, Any]) -> bool:
    base = peeled(site["fn"])
    same = len(base.batch_shape) < 2 or base.batch_shape[-2] == 1
    cut = any(isinstance(part, (MaskedDistribution, *CENSORED)) for part in layers(site["fn"]))
    return site.get("scale") is None and elementwise(site["fn"]) and same and not cut


def _session_axes(
    story: StoryFunction, batch: StoryCall, latents: dict[str, Any], names: Collection[str], sessions: int
) -> dict[str, int]:
    """Axis of sessions of each latent variable that has one; a new session can be drawn along it.

    Args:
        story: The model.
        batch: As in `structure_of`.
        latents: Sites of the latent variables.
        names: Names of all sites.
        sessions: As in `structure_of`.

    Raises:
        InputError: The function fails with a new session, or cannot draw one given the others.
    """
    if "session" not in story.wanted:
        return {}
    which = np.arange(max(sessions, 1) + 1)
    try:
        sites = _traced(story, replace(_some(batch, len(which)), session=which), len(which)).sites
    except InputError as error:
        raise InputError(
            f"{error} The last session, {which[-1]}, is a new one, as at perception; size what belongs to sessions by "
            "int(session.max()) + 1."
        ) from error
    bad, axes = [name for name, site in sites.items() if name not in names and site["type"] == "sample"], {}
    for name, latent in latents.items():
        one, several, site = np.shape(latent["value"]), np.shape(sites[name]["value"]), sites[name]
        if one != several:
            axis = next(axis for axis, (a, b) in enumerate(zip(one, several, strict=True)) if a != b)
            in_plate = axis < len(several) - peeled(site["fn"]).event_dim and "_control_flow_done" not in site
            bad += [] if in_plate and (one[axis], several[axis]) == (1, len(which)) else [name]
            axes[name] = axis
    if bad:
        raise InputError(
            f"The latent variable {bad[0]!r} of {story.name} has sessions that no new one can be added to; draw all at "
            "one site, in a plate of size int(session.max()) + 1, and make them dependent afterwards, such as a random "
            "walk by jnp.cumsum."
        )
    return axes
