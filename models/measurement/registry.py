"""Registry of measurement models by name, and their fit.

A built-in model is one file of this folder, whose `MODEL` holds all that is known of it: its story, its fits, what its
parameters mean for the bins of a tap, and what it refuses. A further one is a file more and its name here. Files are
imported when their model is asked for. Models of users are functions, see `generic.source`.
"""

import re
from collections import Counter
from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from importlib import import_module
from math import inf
from typing import TYPE_CHECKING, Any

from ..errors import InputError, NotConvergedError, check_numbers
from ..progress import Progress, no_progress
from ..threads import one_blas_thread
from .generic import source

if TYPE_CHECKING:
    from collections.abc import Callable

    from ..grid import ClassGrid
    from ..settings import FitSettings
    from ..taps import TapSet
    from .model import Fitted, MeasurementModel, Row

PAPER = "histogram"
"""The paper's model."""
KINDS = (PAPER, "gaussian", "student", "profile", "profile-ar", "profile-mvn", "matrix-normal", "smooth")
"""Names of the models, each a file name with a minus for an underscore; the paper's first."""
SESSION = "session"
NAMES = (*KINDS, SESSION)
"""Names of the models and `session`, short for `session:histogram`; `session:` may precede any other name."""


type AnyModel = "str | Callable[..., Any]"
"""A model given by its name or as a NumPyro function, see docs/how-to/your-own-model.md."""


def split_name(name: str) -> tuple[str, bool]:
    """Kind of a model name, and whether it has states.

    Raises:
        InputError: The model is unknown.
    """
    wrapper, colon, kind = str(name).partition(":")
    in_states = wrapper == SESSION
    if not in_states:
        kind = str(name)
    elif not colon:
        kind = PAPER
    if kind not in KINDS and not source.has_name(kind):
        names = ", ".join((*NAMES, *source.known()))
        raise InputError(f"Unknown model {name!r}; choose from {names}, session:NAME and FILE.py:FUNCTION.")
    return kind, in_states


def register(function: "Callable[..., Any]", name: str | None = None) -> str:
    """Makes a NumPyro function a measurement model of this process, under a name that all studies take.

    >>> import solidtouch as st
    >>> def constant(where, what, taps=None, *, L, M, J, K): ...
    >>> st.register(constant)
    'constant'

    Args:
        function: The function, see docs/how-to/your-own-model.md.
        name: Its name; default that of the function.

    Returns:
        The name.

    Raises:
        InputError: The function does not keep the contract, or the name is none or that of another model.
    """
    name = str(getattr(function, "__name__", "")) if name is None else name
    if name in NAMES or not re.fullmatch(r"[\w.-]+", name):
        why = "is a built-in model" if name in NAMES else "cannot be the name of a model"
        told = f"{name!r} {why}" if name else f"A {type(function).__name__} without a name cannot be a model"
        raise InputError(f'{told}; register the function under another name: st.register(function, "my-model").')
    source.add(function, name)
    return name


def model_name(model: AnyModel) -> str:
    """Name of a model that is given by name, which is looked up, or as a function, registered under its own name.

    Raises:
        InputError: As `register`, or the model is unknown.
    """
    if not (isinstance(model, str) or callable(model)):
        raise InputError(f"A model is a name or a NumPyro function, got {model!r}.")
    if not isinstance(model, str):
        return register(model)
    measurement_model(split_name(model)[0])
    return model


def model_names(models: "AnyModel | Iterable[AnyModel]") -> list[str]:
    """Names of one or more models, as `model_name`.

    Raises:
        InputError: As `model_name`, or two functions have the same name.
    """
    if isinstance(models, str) or callable(models):
        models = [models]
    elif not isinstance(models, Iterable):
        raise InputError(f"models must be names or NumPyro functions, got {models!r}.")
    models = list(models)
    functions = {id(model): getattr(model, "__name__", "") for model in models if callable(model)}
    for name, count in Counter(functions.values()).items():
        if count > 1:
            raise InputError(
                f"{count} functions are named {name!r}; register all but one under another name: "
                'st.register(function, "my-model").'
            )
    return [model_name(model) for model in models]


def measurement_model(kind: str) -> "MeasurementModel":
    """Model of a name without `session`."""
    if kind in KINDS:
        return import_module(f".{kind.replace('-', '_')}", __package__).MODEL
    story = source.named(kind)
    if story is None:
        raise InputError(f"Unknown model {kind!r}.")
    from .generic.story import GenericStory

    return GenericStory(story)


def row(name: str) -> "Row":
    """Difference of a model from the paper's assumptions.

    Raises:
        InputError: The model is unknown.
    """
    kind, in_states = split_name(name)
    return import_module(".shared_gain", __package__).ROW if in_states else measurement_model(kind).row


def check_states(name: str, taps: "TapSet", grid: "ClassGrid") -> bool:
    """Checks that a name with `session:` is that of a model without latent variables of sessions.

    Args:
        name: Name of the model.
        taps: Training taps.
        grid: The classes.

    Returns:
        Whether samples of the model may be any real numbers, so that taps can be moved.

    Raises:
        InputError: The model has some, or is unknown.
    """
    kind, in_states = split_name(name)
    if not in_states or kind in KINDS:
        return True
    story: Any = measurement_model(kind)
    structure = story.structure(taps, grid)
    if own := structure.by_session:
        raise InputError(
            f"{kind} has latent variables of sessions ({', '.join(own)}), which take the place of session:; name it "
            "without."
        )
    return not structure.bounded


def fit_model(
    name: str,
    taps: "TapSet",
    grid: "ClassGrid",
    settings: "FitSettings",
    trained_on: str = "",
    progress: Progress = no_progress,
) -> "Fitted":
    """Fitted measurement model, with its posterior and convergence.

    Args:
        name: Name of the model.
        taps: Training taps.
        grid: The classes.
        settings: How.
        trained_on: Description of the training taps.
        progress: Called with the name of a stage and its number of steps; returns the function that advances it.

    Raises:
        InputError: The model is unknown, the taps are not sufficient, or an argument is out of range.
        NotConvergedError: The fit did not converge, and `unconverged` is not set.
    """
    kind, in_states = split_name(name)
    at_rest = check_states(name, taps, grid)
    settings = _checked(settings, taps)
    shared = None
    if in_states:
        shared = import_module(".shared_gain", __package__).SharedGain.of(taps, grid, settings, at_rest)
        taps, settings = shared.taps, settings.changed(edges=shared.edges)
    with one_blas_thread(), _on(settings, kind):
        fitted = measurement_model(kind).fit(taps, grid, settings, trained_on, progress)
    if not (fitted.convergence.converged or settings.unconverged):
        told = f"{fitted.convergence.sentence} {fitted.convergence.warning}".rstrip()
        more = " Allow more steps with --steps (steps=)." if takes_steps(kind, settings) else ""
        raise NotConvergedError(
            f"{name} did not converge: {told}{more} Use it anyway with --allow-unconverged (unconverged=True)."
        )
    fitted = fitted._replace(model=replace(fitted.model, missing=taps.missing, seed=settings.seed))
    if settings.integrate:
        fitted = fitted.integrated(settings.integrate, settings.seed)
    return fitted if shared is None else shared.behind(fitted)


def _on(settings: "FitSettings", kind: str) -> AbstractContextManager[None]:
    """The device of a fit; fast fits do without JAX."""
    if not takes_steps(kind, settings):
        return nullcontext()
    return import_module(".fits.device", __package__).on_device(settings.device)


def takes_steps(kind: str, settings: "FitSettings") -> bool:
    """Whether the number of steps of a fit can be set: for models of users, and for chains."""
    return kind not in KINDS or settings.method == "nuts"


def suited(name: str, settings: "FitSettings") -> "FitSettings":
    """Settings of a study for one model: built-in models have their fast fit there, functions the method set."""
    return settings.changed(method="closed", device="cpu") if split_name(name)[0] in KINDS else settings


def _checked(settings: "FitSettings", taps: "TapSet") -> "FitSettings":
    """Settings with valid edges, and with the number of bins that these define."""
    if settings.edges is None:
        return settings
    edges, K = check_numbers(settings.edges, "edges").astype(float), taps.dataset.sizes["taxel"]
    if edges.shape[:-1] not in {(), (K,)} or edges.ndim == 0 or edges.shape[-1] < 2:
        raise InputError(f"edges must have shape (B + 1,) or ({K}, B + 1), got {edges.shape}.")
    if not ((abs(edges) < inf).all() and (edges[..., 1:] > edges[..., :-1]).all()):
        raise InputError("edges must be finite and increase.")
    return settings.changed(edges=edges, bins=edges.shape[-1] - 1)
