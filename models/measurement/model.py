"""Interface of all measurement models, before and after a fit.

A model gives the likelihood of a tap under each class through its form (see `likelihood`). Everything behind it,
engines, trials, sweeps and comparisons, knows models by this file only.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..blocks import over_blocks
from ..errors import InputError
from ..progress import Progress, no_progress
from ..seeds import Purpose, generator
from ..settings import Missing, check_missing, check_saturation, likelihood_exponent
from ..storage import write_groups
from ..training import training_taps
from .fits.posterior import several
from .likelihood.bins import NOT_FINITE, find_bins
from .likelihood.mixture import mean_form
from .missing import dependent
from .states import ONE_STATE, States

if TYPE_CHECKING:
    from ..grid import ClassGrid
    from ..preprocessing import Preprocessing
    from ..settings import FitSettings
    from ..taps import TapSet
    from .fits.posterior import Convergence, Posterior, Prior
    from .likelihood.any_form import Form, Prepared
    from .likelihood.forecasts import LeftOut
    from .likelihood.shapes import Parameters
    from .likelihood.true_class import Own
    from .novelty import NoveltyScores

BINS = "bins"
FORMAT = 2
"""Format number of model files."""


@dataclass(frozen=True, eq=False, repr=False)
class TapModel(ABC):
    """A fitted measurement model; all that perception needs from the training data.

    Attributes:
        grid: The classes.
        edges: Bin edges, shape (B + 1,) for all taxels or (K, B + 1) for each; they are the measure on which all
            models give probabilities.
        power: Root of the likelihood in Eq. 1: `"J"`, `"JK"`, `"none"` or an exponent.
        preprocessing: How the taps were prepared.
        left_out: Names of the classes without a training tap.
        trained_on: Description of the training taps.
        source: Origin of the training taps, as `TapSet.source`; empty where a file of an older version has none.
        version: Version of this software that fitted it.
        novelty: How badly the training taps fit their classes; without it no tap can be called new.
        training: Digests of the training taps, none where a file of an older version has none; see
            `blocks.tap_digests`.
        states: What all taps of an episode share and nobody knows before it; one state for most models.
        draws: Parameters from the posterior over which decisions are integrated; none to decide at one value.
        saturation: How many taps' evidence the taps of an episode carry at most, see `inference.filter`.
        posterior: Posterior of its parameters, if it was fitted in this process or has a closed form, which files
            keep; no pickle has it.
        seed: Random seed of the fit, and of draws from its posterior where no other is named.
        missing: What to do with samples that are NaN: `"refuse"` the tap, or `"drop"` them, so that the likelihood is
            that of the other samples; the exponent stays that of a whole tap. No file has it.

    Raises:
        InputError: The saturation is not above 0.
    """

    grid: "ClassGrid"
    edges: NDArray[np.float64]
    power: str | float
    preprocessing: "Preprocessing"
    _: KW_ONLY
    left_out: tuple[str, ...] = ()
    trained_on: str = ""
    source: str = ""
    version: str = ""
    novelty: "NoveltyScores | None" = None
    training: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    states: States = ONE_STATE
    saturation: float = np.inf
    draws: "tuple[Parameters, ...]" = ()
    posterior: "Posterior | None" = None
    seed: int = 0
    missing: Missing = "refuse"

    def __getstate__(self) -> dict[str, Any]:
        """All but the posterior, which may hold compiled programs."""
        return {**vars(self), "posterior": None}

    def __post_init__(self) -> None:
        """Checks the saturation and `missing`."""
        check_saturation(self.saturation)
        check_missing(self.missing)

    def __repr__(self) -> str:
        L, M = self.grid.shape
        B, J = self.edges.shape[-1] - 1, self.preprocessing.samples
        return f"<{self.name} model: {L} x {M} classes, {J} samples of {self.K} taxels, {B} bins, power {self.power}>"

    @property
    @abstractmethod
    def kind(self) -> str:
        """Name in the registry, without states."""

    @property
    @abstractmethod
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Dims of the parameters, and of their draws, by name."""

    @property
    def keeps_posterior(self) -> bool:
        """Whether its file keeps the posterior, so that draws are made when they are asked for."""
        return False

    @property
    def name(self) -> str:
        """Name in the registry; `session:` and the kind with several states."""
        return self.kind if len(self.states.gain) == 1 else f"session:{self.kind}"

    @cached_property
    @abstractmethod
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes with training taps, or with parameters from other classes, shape (L, M)."""

    @cached_property
    @abstractmethod
    def plain_form(self) -> "Form":
        """Likelihood form in the state of gain 1 and offset 0, at power 1."""

    def form_of(self, parameters: "Parameters") -> "Form":  # noqa: ARG002
        """Likelihood form of other parameters, as `plain_form`.

        Raises:
            TypeError: It has no parameters.
        """
        raise TypeError(f"A model of type {type(self).__name__} has no draws.")

    def prior(self, posterior: Any) -> "Prior":  # noqa: ARG002
        """Prior of its parameters, given what the fit with this posterior found that all classes share.

        Raises:
            TypeError: It has no parameters.
        """
        raise TypeError(f"A model of type {type(self).__name__} has no prior.")

    def deciding_by(self, posterior: "Posterior", generators: "Sequence[np.random.Generator]") -> Self:
        """The same with draws from its posterior, one for each generator, by the mean over which it decides."""
        model: Any = self  # every kind is a dataclass
        return replace(model, draws=tuple(several(posterior, generators)))

    def integrated(
        self,
        posterior: Any,  # noqa: ARG002
        taps: NDArray[np.floating],  # noqa: ARG002
        own: "Own",  # noqa: ARG002
        generator: np.random.Generator,  # noqa: ARG002
        gain: float,  # noqa: ARG002
        offset: float,  # noqa: ARG002
    ) -> NDArray[np.float64]:
        """Predictive log probability in one state of the bins of taps (N, J, K), shape (N,).

        Args:
            posterior: Posterior of its parameters.
            taps: Taps that did not train it.
            own: Their classes.
            generator: Random generator of draws from the posterior.
            gain: Gain of the state.
            offset: Offset of the state.

        Raises:
            TypeError: It has no posterior.
        """
        raise TypeError(f"{type(self).__name__} has no predictive distribution.")

    def leave_out(
        self,
        posterior: Any,  # noqa: ARG002
        taps: NDArray[np.floating],  # noqa: ARG002
        own: "Own",  # noqa: ARG002
    ) -> "LeftOut | None":
        """Log probability of training taps (N, J, K) of classes `own` given all others; `None` if unknown."""
        return None

    @cached_property
    def form(self) -> "Form":
        """Likelihood form over positions and hypotheses, at power 1, integrated over the draws if there are any."""
        return self.over_states(self.deciding_forms)

    @property
    def deciding_forms(self) -> Sequence["Form"]:
        """Likelihood forms of the draws, or of the parameters."""
        return [self.form_of(parameters) for parameters in self.draws] or [self.plain_form]

    def over_states(self, parts: Sequence["Form"]) -> "Form":
        """Form over positions and hypotheses from forms over classes that count equally."""
        return in_states(mean_form(parts), self.states, self.edges)

    def training_form(self, parameters: "Parameters | None" = None) -> "Form":
        """Form under which training taps are judged, each under its hypothesis of `training_hypotheses`.

        Args:
            parameters: A draw of its parameters; default those that decide.
        """
        return self.plain_form if parameters is None else self.form_of(parameters)

    def training_hypotheses(self, taps: "TapSet") -> "Own":
        """Position and hypothesis of each training tap, both of shape (N,).

        Raises:
            InputError: The model tells sessions apart, and a tap is of a session that did not train it.
        """
        return taps.indices(self.grid)

    @cached_property
    def prepared(self) -> "Prepared":
        """Precomputed form; untrained classes are impossible."""
        return self.form.prepare(np.isneginf(self.log_prior))

    @property
    @abstractmethod
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""

    @cached_property
    def tap_shape(self) -> tuple[int, int]:
        """Numbers of samples and taxels of a tap, (J, K)."""
        return self.preprocessing.samples, self.K

    @cached_property
    def log_prior(self) -> NDArray[np.float64]:
        """Log belief before the first tap, uniform over the trained classes, shape (L, H); see `states`."""
        trained = np.where(self.trained, -np.log(self.trained.sum()), -np.inf)
        return np.concatenate([trained + log_prior for log_prior in self.states.log_prior], axis=1)

    @property
    def measure(self) -> str:
        """What its likelihoods are: probabilities of `bins`, or `density` times the widths of bins."""
        return BINS

    @property
    def runs_story(self) -> bool:
        """Whether its likelihoods are those of its generative model, run for every tap."""
        return False

    @cached_property
    def exponent(self) -> float:
        """Exponent of the likelihood, from `power`."""
        return likelihood_exponent(self.power, *self.tap_shape)

    def bins(self, taps: ArrayLike) -> NDArray[np.intp]:
        """Histogram bin of each sample, in the shape of `taps` (..., J, K); -1 for one that is missing.

        Values beyond the edges are in the end bins.

        Raises:
            InputError: As `check_samples`.
        """
        taps = np.asarray(taps)
        self.check_samples(taps)
        return find_bins(taps, self.edges)

    def check_samples(self, taps: NDArray[np.floating]) -> None:
        """Checks the shape and values of samples.

        Args:
            taps: Prepared samples, shape (..., J, K).

        Raises:
            InputError: Numbers of samples or taxels are not those of the training data, a sample is infinite, or one is
                NaN and not to be dropped.
        """
        self._check_shape(taps)
        self._check_missing(taps)
        if np.isinf(taps).any():
            raise InputError(NOT_FINITE)

    def _check_missing(self, taps: NDArray[np.floating]) -> None:
        if not (np.isnan(taps.sum()) and np.isnan(taps).any()):  # a sum takes less time
            return
        if self.missing == "refuse":
            raise InputError(NOT_FINITE)
        if not self.form.independent:
            raise InputError(dependent(self.name))

    def with_missing(self, missing: Missing) -> Self:
        """Model that refuses or drops samples that are NaN.

        Raises:
            InputError: `missing` is neither `refuse` nor `drop`.
        """
        model: Any = self  # every kind is a dataclass
        return self if missing == self.missing else replace(model, missing=missing)

    def judging(self, taps: "TapSet") -> Self:
        """Model that drops samples that are NaN if these taps do."""
        return self.with_missing("drop") if taps.missing == "drop" else self

    def _check_shape(self, taps: NDArray[np.floating] | xr.Variable) -> None:
        J, K = self.tap_shape
        if taps.shape[-2:] != (J, K):
            raise InputError(f"Taps must have {J} samples and {K} taxels as in the model, got shape {taps.shape}.")

    def log_likelihood(self, taps: ArrayLike | xr.Variable, out: Any = None) -> NDArray[np.float64]:
        """Log-likelihoods of taps, shape (N, L, H), -inf for untrained classes; Eq. 1.

        Args:
            taps: Prepared samples, shape (N, J, K); also a memory-mapped array, or `TapSet.samples`, which are read
                in blocks.
            out: Array of shape (N, L, H) to write to, such as a memory-mapped or a Zarr one; default a new one.

        Returns:
            `out`.

        Raises:
            InputError: `taps` has not three axes, or is refused as by `check_samples`; or `out` has another shape.
        """
        in_blocks = isinstance(taps, xr.Variable) and not self.runs_story  # NumPyro compiles for each shape
        samples: Any = taps if in_blocks else np.asarray(taps)
        self._check_shape(samples)
        if samples.ndim != 3:
            raise InputError(f"Taps must have three axes (tap, sample, taxel), got shape {samples.shape}.")
        shape = (len(samples), *self.form.shape)
        out = np.empty(shape) if out is None else out
        if out.shape != shape:
            raise InputError(f"out must have shape {shape}, got {out.shape}.")
        prepared = self.prepared

        def write(block: NDArray[np.floating], out: Any) -> Any:
            self._check_missing(block)
            prepared.log_likelihood(block, self.edges, self.exponent, out)
            return out

        if not in_blocks:
            return write(samples, out)
        at_once = isinstance(out, np.ndarray)  # others, such as Zarr arrays, take what was computed elsewhere

        def of_block(block: NDArray[np.floating], which: slice) -> tuple[slice, Any]:
            return which, write(block, out[which] if at_once else np.empty((len(block), *shape[1:])))

        for which, part in over_blocks(samples, of_block):
            if not at_once:
                out[which] = part
        return out

    def check_taps(self, preprocessing: "Preprocessing") -> None:
        """Checks that taps were preprocessed as the training taps.

        Raises:
            InputError: The records differ; the message says how.
        """
        differences = self.preprocessing.differences(preprocessing, "in the model", "in the taps")
        if differences:
            raise InputError(
                f"The taps and the model differ in preprocessing: {'; '.join(differences)}."
                f"{self.preprocessing.advice(preprocessing)}"
            )

    def check_tapset(self, taps: "TapSet") -> None:
        """Checks that taps were preprocessed as the training taps and have as many taxels.

        Raises:
            InputError: They were not, or have not.
        """
        self.check_taps(taps.preprocessing)
        self._check_shape(taps.samples)

    def trained_with(self, taps: "TapSet") -> int:
        """Number of these taps that trained the model, as far as known; see `training.training_taps`."""
        return int(training_taps(taps, self.training).sum())

    def usable(self, taps: "TapSet") -> "TapSet":
        """Taps whose class was trained.

        Raises:
            InputError: There is none, or as `check_tapset`.
        """
        self.check_tapset(taps)
        known = self.known(taps)
        if not known.any():
            raise InputError("No tap left: none belongs to a class with training taps.")
        return taps if known.all() else taps.select(known)

    def known(self, taps: "TapSet") -> NDArray[np.bool_]:
        """Mask of the taps whose class was trained, shape (N,)."""
        where, what = taps.indices(self.grid)
        known = (where >= 0) & (what >= 0)
        known[known] = self.trained[where[known], what[known]]
        return known

    def with_scores(self, taps: "TapSet") -> "TapModel":  # noqa: ARG002 - histograms alone can use them
        """Model with the novelty scores of its training taps, if its kind supports them."""
        return self

    def groups(self) -> dict[str, xr.Dataset]:
        """Groups of its file, except draws and convergence, see `model_file`; models add their own.

        Raises:
            InputError: Files hold no such model.
        """
        attributes = {
            "kind": self.kind,
            "name": self.name,
            "format": FORMAT,
            "power": str(self.power),
            "saturation": float(self.saturation),
            "preprocessing": self.preprocessing.to_json(),
            "grid": json.dumps(self.grid.to_dict()),
            "left_out": json.dumps(self.left_out),
            "trained_on": self.trained_on,
            "source": self.source,
            "version": self.version,
            "seed": self.seed,
        }
        edge = ("edge",) if self.edges.ndim == 1 else ("taxel", "edge")
        data: dict[str, Any] = {
            "edges": (edge, self.edges),
            "training": ("digest", self.training),
            "state_gain": ("state", self.states.gain),
            "state_offset": ("state", self.states.offset),
            "state_log_prior": ("state", self.states.log_prior),
        }
        if self.novelty is not None:
            data |= {
                "novelty_misfit": ("calibration_tap", self.novelty.misfit, {"units": "nat"}),
                "novelty_cell": ("calibration_tap", self.novelty.cell),
                "novelty_reference": (("where", "what", "taxel", "bin"), self.novelty.reference),
                "novelty_edges": (edge, self.novelty.edges),
            }
        groups = {"/": xr.Dataset(attrs=attributes), "constant_data": xr.Dataset(data, self.grid.coords())}
        if self.draws and self.keeps_posterior:
            groups["/"].attrs["integrate"] = len(self.draws)
        elif self.draws:
            stacked = {
                name: (("integrated", *dims), np.stack([draw[name] for draw in self.draws]))
                for name, dims in self.dims.items()
            }
            groups["integrated"] = xr.Dataset(stacked, self.grid.coords())
        return groups

    def to_datatree(self) -> xr.DataTree:
        """The model as a labelled tree of datasets, as in its file.

        Raises:
            InputError: Files hold no such model.
        """
        return xr.DataTree.from_dict(self.groups())

    def save(self, path: str | Path, force: bool = False) -> None:
        """Writes the model as netCDF, atomically; see `model_file`.

        Raises:
            InputError: The file cannot be written, or exists and `force` is not set.
        """
        write_groups(self.groups(), path, force)


def in_states(form: "Form", states: States, edges: NDArray[np.float64]) -> "Form":
    """Form over hypotheses (L, S M) from one over objects (L, M) and S states."""
    if len(states.gain) == 1 and states.gain[0] == 1 and states.offset[0] == 0:
        return form
    pairs = zip(states.gain.tolist(), states.offset.tolist(), strict=True)
    parts: list[Any] = [form.in_state(gain, offset, edges) for gain, offset in pairs]
    return form.joined(parts)


class Fitted(NamedTuple):
    """Result of a fit.

    Attributes:
        model: What decides.
        posterior: Posterior of its parameters; `None` where the prior is improper, a histogram without pseudocount.
        convergence: How it was found.
    """

    model: TapModel
    posterior: "Posterior | None"
    convergence: "Convergence"

    def leave_out(self, taps: "TapSet") -> "LeftOut | None":
        """Log probability of training taps given all others; `None` where no closed form exists."""
        if self.posterior is None or len(self.model.states.gain) > 1:
            return None
        return self.model.leave_out(self.posterior, taps.taps, taps.indices(self.model.grid))

    def integrated(self, draws: int, seed: int) -> Self:
        """Fit whose model decides by the mean over draws from its posterior.

        Raises:
            InputError: It has no posterior.
        """
        posterior = self.posterior
        if posterior is None:
            raise InputError(
                f"A {self.model.name} model without a pseudocount has no posterior to integrate over: its prior is "
                "improper."
            )
        each = [generator(seed, Purpose.INTEGRATED, number) for number in range(draws)]
        return self._replace(model=self.model.deciding_by(posterior, each))


class Row(NamedTuple):
    """Difference of a model from the paper's assumptions.

    Attributes:
        relaxes: Which assumption of the paper it does without.
        how: What it says instead.
    """

    relaxes: str
    how: str


class MeasurementModel(Protocol):
    """A measurement model before its fit, as an entry of the registry."""

    @property
    def row(self) -> Row:
        """Difference from the paper's assumptions."""
        ...

    def fit(
        self,
        taps: "TapSet",
        grid: "ClassGrid",
        settings: "FitSettings",
        trained_on: str = "",
        progress: Progress = no_progress,
    ) -> Fitted:
        """Model fitted to training taps; `trained_on` describes them, `progress` is called by fits of many steps.

        Raises:
            InputError: The taps cannot carry it, or an argument is out of range.
        """
        ...

    def read(
        self, attributes: Mapping[str, Any], data: xr.Dataset, parameters: xr.Dataset, common: dict[str, Any], /
    ) -> TapModel:
        """Model from the groups of a file, see `TapModel.groups`.

        Args:
            attributes: Attributes of the file.
            data: Group `constant_data`.
            parameters: Group `parameters`.
            common: What all models have, as arguments; `posterior` is the group of a posterior in closed form.

        Raises:
            KeyError: Something is missing.
            ValueError: Something is damaged.
        """
        ...
