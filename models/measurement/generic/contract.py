"""The contract of a generative model: one NumPyro function of known classes.

    def laplace(where, what, taps=None, *, L, M, J, K): ...

`where` and `what` are the class indices of N taps, and the function observes their samples (N, J, K) at its site
`taps`. It is called with known taps to train, without them to simulate, and with every class in turn to judge a tap.
"""

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from ...errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

SIZES = ("L", "M", "J", "K")
OPTIONAL = ("where_value", "what_value", "session", "time_s")
"""Arguments that are filled in where a function names them."""


def measurement_model(
    function: Callable[..., Any] | None = None, /, *, raw: bool = False, guide: Callable[..., Any] | None = None
) -> Callable[..., Any]:
    """Decorator of a NumPyro function that is to be a measurement model; one without options needs none.

    >>> import solidtouch as st
    >>> @st.measurement_model(raw=True)
    ... def counts(where, what, taps=None, *, L, M, J, K): ...
    >>> counts.raw
    True

    Args:
        function: The function, where the decorator has no parentheses.
        raw: Whether samples are given as they are; by default each taxel has mean 0, and 1 is its standard deviation
            within classes and times.
        guide: Guide of `--fit svi`, called as the function; default a normal distribution of each unconstrained
            latent variable.
    """

    def mark(function: Callable[..., Any]) -> Callable[..., Any]:
        marked: Any = function
        marked.raw, marked.guide = raw, guide
        return function

    return mark if function is None else mark(function)


@dataclass(frozen=True)
class StoryCall:
    """Taps of known class, as arguments of a generative model.

    Attributes:
        where: Position index of each tap, shape (N,).
        what: Object index of each tap, shape (N,).
        shape: (L, M, J, K).
        where_value: Value of each position, shape (L,).
        what_value: Value of each object, shape (M,), if objects have one.
        session: Index of each tap's session, shape (N,).
        time_s: Time of each sample, shape (J,), if the sampling rate is known.
    """

    where: Any
    what: Any
    shape: tuple[int, int, int, int]
    where_value: "NDArray[np.float64] | None" = None
    what_value: "NDArray[np.float64] | None" = None
    session: Any = None
    time_s: "NDArray[np.float64] | None" = None

    def arguments(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Keyword arguments of these names.

        Raises:
            InputError: The taps have no such value.
        """
        known = dict(zip(SIZES, self.shape, strict=True))
        known |= {name: getattr(self, name) for name in OPTIONAL}
        for name in names:
            if known[name] is None:
                missing = {"what_value": "the objects have no sizes", "time_s": "the sampling rate is unknown"}[name]
                raise InputError(f"The model asks for {name}, but {missing}.")
        return {name: known[name] for name in names}


@dataclass(frozen=True)
class StoryFunction:
    """A generative model that keeps the contract.

    Attributes:
        function: The NumPyro function.
        name: How it is named in settings, files and tables.
        wanted: Names of the keyword arguments to fill in.

    Raises:
        InputError: Its arguments are not those of the contract.
    """

    function: Callable[..., Any]
    name: str
    wanted: tuple[str, ...]

    @classmethod
    def of(cls, function: Callable[..., Any], name: str) -> "StoryFunction":
        """Function under a name, its arguments checked."""
        if not callable(function):
            raise InputError(f"{name} is no function but of type {type(function).__name__}.")
        if inspect.iscoroutinefunction(function):
            raise InputError(f"{name} is an async function; a model is one that is called, by def alone.")
        parameters = list(inspect.signature(function).parameters.values())
        first, rest = parameters[:3], parameters[3:]
        if [p.name for p in first] != ["where", "what", "taps"] or first[2].default is not None:
            raise InputError(f"{name} must begin with the arguments where, what, taps=None.")
        known = (*SIZES, *OPTIONAL)
        for parameter in rest:
            if parameter.name not in known and parameter.default is inspect.Parameter.empty:
                raise InputError(
                    f"{name} has an argument {parameter.name!r} that nothing fills in; give it a default, or choose "
                    f"from {', '.join(known)}."
                )
        return cls(function, name, tuple(p.name for p in rest if p.name in known))

    @property
    def code(self) -> Callable[..., Any]:
        """The function without decorators and given arguments."""
        function = self.function
        while isinstance(function, partial):
            function = function.func
        return inspect.unwrap(function)

    @property
    def raw(self) -> bool:
        """Whether it describes samples as they are."""
        return bool(self._mark("raw"))

    @property
    def guide(self) -> Callable[..., Any] | None:
        """Its own guide."""
        return self._mark("guide")

    def _mark(self, name: str) -> Any:
        return getattr(self.function, name, None) or getattr(self.code, name, None)

    @property
    def sentence(self) -> str:
        """First line of its docstring, or its name."""
        return (inspect.getdoc(self.code) or self.name).splitlines()[0].rstrip(".")

    def __call__(self, batch: StoryCall, taps: Any = None, **more: Any) -> Any:
        """Runs the function on taps of known class, or without samples; `more` are arguments of its own."""
        return self.function(batch.where, batch.what, taps, **batch.arguments(self.wanted), **more)

    def guide_of(self, batch: StoryCall, taps: Any = None) -> Any:
        """Runs its own guide."""
        if self.guide is None:
            raise TypeError(f"{self.name} has no guide.")
        return self.guide(batch.where, batch.what, taps, **batch.arguments(self.wanted))
