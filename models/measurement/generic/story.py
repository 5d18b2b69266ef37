"""A generative model that keeps the contract, as a measurement model: its fit, and the fitted model."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...errors import InputError
from ...progress import Progress, no_progress
from ...seeds import Purpose, generator
from ...settings import FitSettings
from ..fits.priors import filled
from ..fitted_parameters import ModelOfParameters, training
from ..likelihood.any_form import Form
from ..likelihood.bins import TableForm
from ..likelihood.mixture import mean_form
from ..likelihood.shapes import Parameters
from ..missing import refuse_missing
from ..model import Fitted, Row
from ..scaling import Scaling
from ..states import States
from . import source
from .contract import StoryCall, StoryFunction
from .session_draws import FEWEST, enough_sessions, error_of_mean

if TYPE_CHECKING:
    from ...grid import ClassGrid
    from ...taps import TapSet
    from ..fits.posterior import Posterior, Prior
    from ..likelihood.true_class import Own
    from .form import GenericForm
    from .runs import Program
    from .structure import Structure


@dataclass(frozen=True, eq=False)
class GenericStory:
    """A generative model as an entry of the registry, see `MeasurementModel`.

    Attributes:
        function: The model.
    """

    function: StoryFunction

    @property
    def row(self) -> Row:
        """Its own first sentence."""
        return Row("as its author says", self.function.sentence)

    def structure(self, taps: "TapSet", grid: "ClassGrid") -> "Structure":
        """What it consists of for taps of this kind.

        Raises:
            InputError: The function does not keep the contract or fails.
        """
        from .structure import structure_of

        batch = batch_of(grid, taps.preprocessing, taps.dataset.sizes["taxel"])
        return structure_of(self.function, batch, len(np.unique(taps.session)))

    def fit(
        self,
        taps: "TapSet",
        grid: "ClassGrid",
        settings: FitSettings,
        trained_on: str = "",
        progress: Progress = no_progress,
    ) -> Fitted:
        """Model fitted to training taps.

        Raises:
            InputError: The function does not keep the contract or fails, the taps cannot carry it, or an argument is
                out of range.
        """
        from .fit import Fit, check_prior, posterior
        from .influence import check_sessions
        from .known import known_classes
        from .runs import Program
        from .sessions import InNewSessions
        from .structure import check_names, structure_of

        if settings.integrate and settings.method == "map":
            raise InputError("A fit by map has one value and no draws to integrate over; use svi, nuts or laplace.")
        used, known, kept = training(taps, grid, settings, trained_on)
        K = known.samples.shape[2]
        scaling = Scaling(np.zeros(K), np.ones(K)) if self.function.raw else Scaling.of(known, kept["edges"])
        batch = batch_of(grid, taps.preprocessing, K)
        numbers, session = np.unique(used.session, return_inverse=True)
        structure = structure_of(self.function, batch, len(numbers))
        check_names(self.function, structure)
        full = replace(batch, where=known.where, what=known.what, session=session)
        if not structure.independent:
            refuse_missing(self.function.name, known.samples)
        samples, present = filled(scaling.scaled(known).samples)
        fit = Fit(self.function, structure, full, samples, settings.seed, settings.steps, progress, present)
        warning = f"{check_sessions(fit)} {check_prior(fit)}".strip()
        found: Posterior = posterior(fit, "svi" if settings.method == "closed" else settings.method)
        program, parameters = Program(self.function, structure, batch, len(numbers)), found.point()
        kept["covered"] = known_classes(program, parameters, kept["covered"])
        model = GenericModel(
            story=self,
            program=program,
            sessions=tuple(numbers.tolist()),
            scaling=scaling,
            parameters=parameters,
            left_out=grid.untouched(kept["covered"]),
            **kept,
        )
        if structure.exchangeable and not structure.by_session:
            _ = model.plain_form  # refuses wrong probabilities before anything is decided by them
        if structure.by_session:
            found = InNewSessions(found, program)
            model, told = enough_sessions(Fitted(model, found, found.convergence()), settings, known, session)
            warning = f"{warning} {told}".strip()
        return Fitted(model, found, found.convergence()._replace(warning=warning))

    def read(
        self, attributes: Mapping[str, Any], data: xr.Dataset, parameters: xr.Dataset, common: dict[str, Any]
    ) -> "GenericModel":
        """Model from the groups of a file, see `MeasurementModel.read`."""
        from .runs import Program
        from .structure import structure_of

        scaling = Scaling(data["centre"].values, data["unit"].values)
        batch = batch_of(common["grid"], common["preprocessing"], len(scaling.unit))
        sessions = tuple(np.atleast_1d(attributes.get("training_sessions", 0)).tolist())
        structure = structure_of(self.function, batch, len(sessions))
        return GenericModel(
            story=self,
            program=Program(self.function, structure, batch, len(sessions)),
            sessions=sessions,
            scaling=scaling,
            parameters={name: parameters[name].values for name in structure.dims},
            covered=data["covered"].values.astype(bool),
            **common,
        )


def batch_of(grid: "ClassGrid", preprocessing: Any, K: int) -> StoryCall:
    """Arguments of a generative model for taps of this kind, with no tap.

    Values are arrays of JAX, as those of NumPy cannot be indexed by classes that are traced.
    """
    import jax
    import jax.numpy as jnp

    none, J, rate = np.zeros(0, dtype=np.intp), preprocessing.samples, preprocessing.rate_hz
    times = None if rate is None else np.arange(J) / rate
    with jax.enable_x64(True):
        where, what, times = jax.tree.map(jnp.asarray, (grid.where_value, grid.what_value, times))
    return StoryCall(none, none, (*grid.shape, J, K), where, what, none, times)


@dataclass(frozen=True, eq=False, repr=False)
class GenericModel(ModelOfParameters):
    """A generative model of the contract at fitted latent variables.

    Attributes:
        story: The model as it was named.
        program: The same with its sites.
        sessions: Numbers of the training sessions, in increasing order.
    """

    story: GenericStory
    program: "Program"
    sessions: tuple[int, ...]

    def __post_init__(self) -> None:
        """Adds states, one for each draw of a new session."""
        super().__post_init__()
        if not self.program.structure.by_session:
            return
        from .sessions import session_points

        states = self.states
        if not self.draws:
            number, scrambler = max(FEWEST, len(states.gain)), generator(0, Purpose.NEW_SESSION, 0)
            states = States.weighted(session_points(self.program, self.parameters, number, scrambler, tails=True)[1])
        elif len(states.gain) != len(self.draws):
            states = States.alike(len(self.draws))
        object.__setattr__(self, "states", states)

    @property
    def name(self) -> str:
        """Name of the function; `session:` and this with several gains or offsets."""
        return self.kind if self.program.structure.by_session else super().name

    @property
    def kind(self) -> str:
        """Name of the function."""
        return self.story.function.name

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Dims of the latent variables."""
        return self.program.structure.dims

    @property
    def measure(self) -> str:
        """See `observed`."""
        return self.program.structure.measure

    @property
    def runs_story(self) -> bool:
        """Whether it has no table."""
        return not self.program.structure.exchangeable

    @cached_property
    def plain_form(self) -> Form:
        """Likelihood form of the parameters; of a model with sessions, the mean over new ones."""
        return mean_form(list(self._forms_of(self._in_new_sessions(tails=False))))

    def deciding_by(self, posterior: "Posterior", generators: Sequence[np.random.Generator]) -> Self:
        """As the base class; rare new sessions are among the draws, with their weights."""
        from .sessions import InNewSessions

        if not isinstance(posterior, InNewSessions):
            return super().deciding_by(posterior, generators)
        each, log_weight = posterior.with_tails(generators)
        return replace(self, draws=tuple(each), states=States.weighted(log_weight))

    def over_states(self, parts: Sequence[Form]) -> Form:
        """Form over positions and hypotheses; what is drawn with a new session is one state."""
        if not self.program.structure.by_session:
            return super().over_states(parts)
        first: Any = parts[0]
        return first.joined(parts)

    @property
    def deciding_forms(self) -> Sequence[Form]:
        """Likelihood forms of the draws, or of the parameters; with sessions one for each state."""
        if not self.program.structure.by_session:
            return super().deciding_forms
        return list(self._forms_of(self.decides_at))

    def integration_error(self, taps: NDArray[np.float64], own: "Own", episodes: Sequence[NDArray[np.intp]]) -> float:
        """Mean error of the log evidence of episodes in a new session, in nats, see `error_of_mean`.

        Args:
            taps: Shape (N, J, K).
            own: Their classes.
            episodes: Indices of the taps of each episode.
        """
        from ..likelihood.true_class import OwnTaps

        rows, where = np.unique(np.concatenate(episodes), return_inverse=True)
        part = np.split(where, np.cumsum([len(one) for one in episodes])[:-1])
        known = OwnTaps(taps[rows], (own[0][rows], own[1][rows]), self.edges, self.states)
        each = np.stack([known.log_probability(form) for form in self._forms_of(self.decides_at)])
        evidence = self.exponent * np.stack([each[:, rows].sum(axis=1) for rows in part], axis=1)
        return error_of_mean(evidence + self.states.log_prior[:, None] + np.log(len(evidence)))

    def by_story(self, parameters: Parameters) -> list["GenericForm"]:
        """The form that runs the function for every tap."""
        from .form import GenericForm
        from .runs import Given

        return [GenericForm(self.program, (Given(dict(parameters)),), self.scaling)]

    @cached_property
    def decides_at(self) -> Sequence[Parameters]:
        """The draws, or the parameters, with new sessions if the model has sessions."""
        return self.draws or self._in_new_sessions()

    def training_form(self, parameters: Parameters | None = None) -> Form:
        """Form over the hypotheses of all training sessions, if the function asks for the session."""
        from .form import GenericForm
        from .runs import Given

        if "session" not in self.story.function.wanted:
            return super().training_form(parameters)
        latents = dict(self._in_new_sessions()[0] if parameters is None else parameters)
        return self._checked(GenericForm.in_sessions(self.program, Given(latents), self.scaling))

    def training_hypotheses(self, taps: "TapSet") -> "Own":
        """As the base class; objects in the session of each tap."""
        where, what = super().training_hypotheses(taps)
        if "session" not in self.story.function.wanted:
            return where, what
        unknown = np.setdiff1d(taps.session, self.sessions)
        if unknown.size:
            raise InputError(f"No tap of session {unknown[0]} trained {self.name}, which tells sessions apart.")
        return where, np.searchsorted(self.sessions, taps.session) * self.grid.M + what

    def _in_new_sessions(self, *, tails: bool = True) -> Sequence[Parameters]:
        """The parameters with new sessions, those of the states or, without tails, such as weigh the same."""
        from .sessions import in_new_sessions, session_points

        if not self.program.structure.by_session:
            return [self.parameters]
        draws = FEWEST if self.draws else len(self.states.gain)
        generators = [generator(0, Purpose.NEW_SESSION, number) for number in range(draws)]
        points, _ = session_points(self.program, self.parameters, draws, generators[0], tails)
        return list(in_new_sessions(self.program, [self.parameters] * draws, generators, points))

    def form_of(self, parameters: Parameters) -> Form:
        """Likelihood form of other parameters; their last session is the one at perception."""
        (form,) = self.by_story(parameters)
        return self._checked(form)

    def _forms_of(self, each: Sequence[Parameters]) -> Iterator[Form]:
        """Likelihood forms of several parameters; their tables are made together."""
        forms = [form for parameters in each for form in self.by_story(parameters)]
        if not self.program.structure.exchangeable or len(forms) == 1:
            yield from map(self._checked, forms)
            return
        for tables in forms[0].tables([form.given[0] for form in forms], self.edges):
            self._refuse_wrong(tables)
            yield from map(TableForm, tables)

    def _checked(self, form: "GenericForm") -> Form:
        """The form, as a table where samples are exchangeable."""
        if not self.program.structure.exchangeable:
            return form
        table = form.table(self.edges)
        self._refuse_wrong(table)
        return TableForm(table)

    def _refuse_wrong(self, tables: NDArray[np.float64]) -> None:
        """See `refuse_wrong`; of tables (..., L, H, K, B)."""
        from .runs import refuse_wrong

        (L, H), M = tables.shape[-4:-2], self.grid.M
        known = np.where(np.tile(self.covered, H // M)[:, :, None, None], tables, 0.0)
        refuse_wrong(self.program, known, np.arange(L)[:, None, None, None], (np.arange(H) % M)[:, None, None])

    def prior(self, posterior: Any) -> "Prior":  # noqa: ARG002 - as all models
        """Prior of its latent variables."""
        return _prior(self.program)

    def groups(self) -> dict[str, xr.Dataset]:
        """Groups of the file, with a table where there is one, and the digest of the code."""
        groups = super().groups()
        table = {}
        if not self.draws and isinstance(self.plain_form, TableForm):
            known = np.where(self.covered[:, :, None, None], self.plain_form.log_prob, np.nan)
            table["table"] = (("where", "what", "taxel", "bin"), known)
        return groups | {
            "/": groups["/"].assign_attrs(
                measure=self.measure,
                digest=source.digest(self.story.function),
                place=source.place(self.story.function),
                training_sessions=np.array(self.sessions),
            ),
            "constant_data": groups["constant_data"].assign(table),
        }


def at_prior(
    story: StoryFunction, batch: StoryCall, shared: np.random.Generator, own: Sequence[np.random.Generator]
) -> "GenericForm":
    """A generative model at a draw from its prior, in the units in which it describes samples, in the last session.

    Args:
        story: The model.
        batch: Taps of the kind that it is for; how many does not matter.
        shared: Draws all latent variables.
        own: Draw those of each session, given the sessions before it.

    Raises:
        InputError: The function does not keep the contract or fails.
    """
    from .form import GenericForm
    from .runs import Given, Program
    from .sessions import with_new_session
    from .structure import structure_of

    last, K = len(own) - 1, batch.shape[3]
    program = Program(story, structure_of(story, batch, last), batch, last)
    latents = dict(_prior(replace(program, sessions=0)).draw(shared))
    if axes := program.structure.by_session:
        latents |= {name: np.delete(latents[name], -1, axis) for name, axis in axes.items()}
        for generator in own:
            latents = with_new_session(program, latents, generator)
    return GenericForm(program, (Given(latents),), Scaling(np.zeros(K), np.ones(K)))


def _prior(program: "Program") -> "Prior":
    """Prior of the latent variables, with a new session."""
    from ..fits.prior import StoryPrior

    structure = program.structure
    which = np.arange(program.sessions + 1)
    taps = program.of(0 * which, 0 * which, which)
    return StoryPrior(
        lambda: program.story(taps),
        ("taps", *structure.enumerated),
        lambda drawn: drawn,
        lambda sites: sites,
        structure.by_session,
    )
