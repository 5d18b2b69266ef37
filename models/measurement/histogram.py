"""The paper's measurement model: one histogram of sample values per class and taxel.

Two views of the same thing. `story` is the generative model in NumPyro, a Dirichlet prior over the bins of every class
and taxel; `fit` is its conjugate posterior in closed form, whose mean is Eq. 2 of the paper with the
pseudocount as the Dirichlet concentration. The order of samples drops out of Eq. 1, so the log-likelihood of many
taps is one matrix product of their bin counts with the log tables.

Reference: Lepora, Martinez-Hernandez and Prescott, "A SOLID case for active Bayesian perception in robot touch" (2013).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.metadata import version
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import gammaln

from ..errors import InputError
from ..grid import ClassGrid
from ..progress import Progress, no_progress
from ..settings import FitSettings, likelihood_exponent
from ..taps import TapSet
from .fits.posterior import EXACT, ByClass, Convergence
from .likelihood.bins import TableForm, bin_edges, class_counts, count_taps
from .likelihood.forecasts import LeftOut
from .likelihood.shapes import Parameters
from .likelihood.true_class import Own
from .model import Fitted, Row, TapModel
from .novelty import novelty_scores

_EDGES = np.linspace(-5.0, 5.0, 41)  # of bins where none are given, in deviations within classes


def story(
    where: Any,
    what: Any,
    taps: Any = None,
    *,
    L: int,
    M: int,
    J: int,
    K: int,
    edges: Any = _EDGES,
    pseudocount: float = 1.0,
) -> None:
    """Generative model: samples fall into bins by Eq. 1 at power 1, with Dirichlet priors on the histograms of Eq. 2.

    Samples are uniform within the bins of `edges`, shape (B + 1,) or (K, B + 1). The posterior is Dirichlet again, with
    the counts added, and its mean is Eq. 2 with the `pseudocount`, the concentration of every bin.
    """
    from .fits.story_parts import Histogram, dist, numpyro, plates

    with plates(("L", L, -3), ("M", M, -2), ("K", K, -1)):
        p: Any = numpyro.sample("p", dist.Dirichlet(np.full(np.shape(edges)[-1] - 1, pseudocount)))
    with plates(("tap", len(where), -3), ("J", J, -2), ("taxel", K, -1)):
        numpyro.sample("taps", Histogram(p[where, what][:, None], edges), obs=taps)


@dataclass(frozen=True, eq=False, repr=False)
class HistogramModel(TapModel):
    """A fitted histogram for every class and taxel.

    Attributes:
        counts: Occupation numbers h_k(b) of every class, shape (L, M, K, B).
        pseudocount: Added to every bin, in counts.
    """

    counts: NDArray[np.int64]
    pseudocount: float

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes with a training tap, shape (L, M)."""
        return self.counts.sum(axis=(2, 3)) > 0

    @cached_property
    def probabilities(self) -> NDArray[np.float64]:
        """P_k(b | class), shape (L, M, K, B); Eq. 2, flat where a class has no training sample of a taxel."""
        smoothed = self.counts + float(self.pseudocount)
        smoothed[self.counts.sum(axis=-1) == 0] = 1.0
        return smoothed / smoothed.sum(axis=-1, keepdims=True)

    @cached_property
    def log_prob(self) -> NDArray[np.float64]:
        """Logarithm of `probabilities`, -inf for empty bins without pseudocount, shape (L, M, K, B)."""
        with np.errstate(divide="ignore"):
            return np.log(self.probabilities)

    @cached_property
    def plain_form(self) -> TableForm:
        """Log tables of the histograms."""
        return TableForm(self.log_prob)

    def form_of(self, parameters: Parameters) -> TableForm:
        """Log tables of other histograms."""
        return TableForm(parameters["log_prob"])

    def integrated(
        self,
        posterior: "HistogramPosterior",
        taps: NDArray[np.floating],
        own: Own,
        generator: np.random.Generator,  # noqa: ARG002 - as all models
        gain: float,
        offset: float,
    ) -> NDArray[np.float64]:
        """Dirichlet-multinomial log probability; in a state, concentrations are moved between bins like probability."""
        alpha = posterior.concentration
        if (gain, offset) != (1.0, 0.0):
            total = alpha.sum(axis=-1, keepdims=True)
            alpha = total * np.exp(TableForm(np.log(alpha / total)).in_state(gain, offset, self.edges).log_prob)
        known, tap, _, rows, times = self._in_cells(taps, own, alpha)
        with np.errstate(divide="ignore"):
            gained = np.where(rows > 0, gammaln(rows + times) - gammaln(np.maximum(rows, 1e-300)), -np.inf)
        total = alpha.sum(axis=-1)[own]
        return (gammaln(total) - gammaln(total + known)).sum(axis=-1) + np.bincount(tap, gained, minlength=len(taps))

    def leave_out(self, posterior: "HistogramPosterior", taps: NDArray[np.floating], own: Own) -> LeftOut:
        """Left-out training taps by subtraction of their counts, also at the mean of the posterior."""
        alpha = posterior.concentration
        known, tap, taxel, rows, times = self._in_cells(taps, own, alpha)
        rest, total = np.maximum(rows - times, np.finfo(float).tiny), alpha.sum(axis=-1)[own]
        gained = np.bincount(tap, gammaln(rest + times) - gammaln(rest), minlength=len(taps))
        plug_in = np.bincount(tap, times * np.log(rest / (total - known)[tap, taxel]), minlength=len(taps))
        return LeftOut((gammaln(total - known) - gammaln(total)).sum(axis=-1) + gained, plug_in)

    def _in_cells(
        self, taps: NDArray[np.floating], own: Own, alpha: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        """Samples of each taxel (N, K); and tap, taxel, `alpha` and samples of each cell that a tap occupies."""
        K, B = alpha.shape[2:]
        parts = [
            (
                np.repeat(np.arange(which.start, which.stop), np.diff(first)),
                cell[: first[-1]].copy(),
                times[: first[-1]].copy(),
            )
            for which, (first, cell, times) in count_taps(taps, self.edges)
        ]
        tap, cell, times = (np.concatenate(column) for column in zip(*parts, strict=True))
        rows = alpha.reshape(*alpha.shape[:2], K * B)[own[0][tap], own[1][tap], cell]
        return (~np.isnan(taps)).sum(axis=1), tap, cell // B, rows, times

    def prior(self, posterior: "HistogramPosterior") -> "DirichletPrior":
        """Prior of the histograms."""
        return DirichletPrior(posterior.counts.shape, self.pseudocount)

    @property
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""
        return self.counts.shape[2]

    @property
    def kind(self) -> str:
        """Name in the registry."""
        return "histogram"

    @property
    def name(self) -> str:
        """Name in the registry; `session` with several states."""
        return self.kind if len(self.states.gain) == 1 else "session"

    @property
    def keeps_posterior(self) -> bool:
        """Whether there is a posterior: the counts and the pseudocount are all of it."""
        return self.posterior is not None

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Dims of the log tables."""
        return {"log_prob": ("where", "what", "taxel", "bin")}

    def groups(self) -> dict[str, xr.Dataset]:
        """Groups of the file, with counts, and with probabilities for other readers."""
        groups = super().groups()
        bins = self.dims["log_prob"]
        own = {"counts": (bins, self.counts), "probabilities": (bins, self.probabilities)}
        return groups | {
            "/": groups["/"].assign_attrs(pseudocount=self.pseudocount),
            "constant_data": groups["constant_data"].assign(own),
        }

    def with_scores(self, taps: TapSet) -> "HistogramModel":
        """Model with the novelty scores of its training taps; unchanged with several states or missing samples."""
        if len(self.states.gain) > 1 or taps.lacking.any():
            return self
        B, value_range = self.counts.shape[-1], "global" if self.edges.ndim == 1 else "taxel"
        return replace(self, novelty=novelty_scores(taps, self.grid, B, value_range, self.pseudocount))


def fit(
    taps: TapSet,
    grid: ClassGrid,
    *,
    bins: int = 100,
    pseudocount: float = 0.01,
    power: str | float = "J",
    saturation: float = np.inf,
    value_range: Literal["global", "taxel"] = "global",
    edges: NDArray[np.float64] | None = None,
    trained_on: str = "",
) -> HistogramModel:
    """Histograms of training taps; Eq. 2.

    Args:
        taps: Training taps.
        grid: The classes to tell apart. A class without a training tap stays in the grid as an untrained class,
            which is impossible; `trim` takes whole empty objects and ends of the range out of a grid.
        bins: `B`, equal-width bins across the range; given edges say it themselves.
        pseudocount: Added to every bin, in counts. The paper has none, and then a quarter to a half of
            simulated test taps are impossible under their own class; later work adds a small constant.
        power: Root of Eq. 1, see `inference.reference.exponent`.
        saturation: How many taps' evidence an episode carries at most, see `inference.filter`.
        value_range: Whether bins span the range of all taxels together or of each.
        edges: Bin edges to use instead, shape (B + 1,) or (K, B + 1).
        trained_on: Description of the training taps, for the model's file.

    Returns:
        The fitted model, with the untrained classes by name.

    Raises:
        InputError: No tap lies in the grid, or an argument is out of range.
    """
    if bins < 1:
        raise InputError(f"bins must be at least 1, got {bins}.")
    if not (np.isfinite(pseudocount) and pseudocount >= 0):
        raise InputError(f"The pseudocount must be finite and not negative, got {pseudocount}.")
    K = taps.dataset.sizes["taxel"]
    likelihood_exponent(power, taps.preprocessing.samples, K)
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    if not inside.any():
        raise InputError("No training tap belongs to a class of the grid.")
    used = taps if inside.all() else taps.select(inside)
    edges = bin_edges(used.extremes, bins, value_range) if edges is None else edges
    own, shape = (where * grid.M + what)[inside], (*grid.shape, K, edges.shape[-1] - 1)
    counts = class_counts(used.samples, edges, own, shape)
    return HistogramModel(
        grid=grid,
        edges=edges,
        counts=counts,
        pseudocount=float(pseudocount),
        power=power,
        preprocessing=taps.preprocessing,
        left_out=grid.untouched(counts.sum(axis=(2, 3)) > 0),
        trained_on=trained_on,
        source=taps.source,
        version=version("solidtouch"),
        training=used.digests,
        saturation=float(saturation),
    )


def trim(grid: ClassGrid, taps: Sequence[TapSet]) -> tuple[ClassGrid, tuple[str, ...]]:
    """Grid without the classes that have no tap, and their names.

    Objects without any tap are dropped; where classes only at both ends of the range, so that one class stays one
    step. Empty cells between others stay and are left out by `fit`, as impossible classes.

    Args:
        grid: The classes.
        taps: The training taps, in one or several sets.

    Raises:
        InputError: No tap lies in the grid.
    """
    touched = np.zeros(grid.shape, dtype=bool)
    for part in taps:
        where, what = part.indices(grid)
        inside = (where >= 0) & (what >= 0)
        touched[where[inside], what[inside]] = True
    if not touched.any():
        raise InputError("No training tap belongs to a class of the grid.")
    objects = np.flatnonzero(touched.any(axis=0)).tolist()
    positions = np.flatnonzero(touched.any(axis=1))
    kept = range(int(positions[0]), int(positions[-1]) + 1)
    dropped = [grid.what_name[m] for m in range(grid.M) if m not in objects]
    dropped += [grid.where_label(l) for l in range(grid.L) if l not in kept]
    return grid.select(kept, objects), tuple(dropped)


class HistogramPosterior(NamedTuple):
    """Dirichlet posterior of the histograms; exact.

    Attributes:
        counts: Samples in every bin, shape (L, M, K, B).
        pseudocount: Concentration of the prior.
    """

    counts: NDArray[np.int64]
    pseudocount: float

    @property
    def concentration(self) -> NDArray[np.float64]:
        """Concentration of every bin, shape (L, M, K, B)."""
        return self.counts.astype(np.float64) + self.pseudocount

    @classmethod
    def of(cls, model: HistogramModel) -> "HistogramPosterior":
        """Posterior of a fitted histogram model; improper without a pseudocount.

        Raises:
            InputError: There is no pseudocount.
        """
        if model.pseudocount == 0:
            raise InputError("Without a pseudocount the histogram model has no posterior: its prior is improper.")
        return cls(model.counts, model.pseudocount)

    def point(self) -> Parameters:
        """Log probabilities by Eq. 2."""
        concentration = self.concentration
        return {"log_prob": np.log(concentration / concentration.sum(axis=-1, keepdims=True))}

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Draw of the log probabilities of bins; many are far below the range of plain numbers."""
        alpha = self.concentration
        log_gamma = np.log(generator.standard_gamma(alpha + 1)) - generator.standard_exponential(alpha.shape) / alpha
        log_gamma -= log_gamma.max(axis=-1, keepdims=True)
        log_gamma -= np.log(np.exp(log_gamma).sum(axis=-1, keepdims=True))
        return {"log_prob": log_gamma}

    def convergence(self) -> Convergence:
        """Convergence: always exact."""
        return EXACT


class DirichletPrior(NamedTuple):
    """Symmetric Dirichlet prior of the histograms.

    Attributes:
        shape: (L, M, K, B).
        pseudocount: Concentration of every bin.
    """

    shape: tuple[int, ...]
    pseudocount: float

    def draw(self, generator: np.random.Generator) -> Parameters:
        """Draw of the log probabilities of bins."""
        return HistogramPosterior(np.zeros(self.shape, np.int64), self.pseudocount).draw(generator)

    def log_density(self, parameters: Parameters) -> ByClass:
        """Log density of the probabilities of each class."""
        a, B = self.pseudocount, self.shape[-1]
        density = gammaln(B * a) - B * gammaln(a) + (a - 1) * parameters["log_prob"].sum(axis=-1)
        return {"log_prob": (("where", "what"), density.sum(axis=-1))}


class _Histogram(NamedTuple):
    """The paper's model as an entry of the registry."""

    row: Row = Row("nothing", "one histogram per class and taxel, as in the paper")

    def fit(
        self,
        taps: TapSet,
        grid: ClassGrid,
        settings: FitSettings,
        trained_on: str = "",
        progress: Progress = no_progress,  # noqa: ARG002 - counting takes no time
    ) -> Fitted:
        """Fit with its posterior, which is `None` without a pseudocount, as the prior is improper."""
        same = {name: getattr(settings, name) for name in ("bins", "pseudocount", "power", "value_range", "edges")}
        model = fit(taps, grid, **same, saturation=settings.limit, trained_on=trained_on)
        return Fitted(model, HistogramPosterior.of(model) if settings.pseudocount > 0 else None, EXACT)

    def read(
        self, attributes: Mapping[str, Any], data: xr.Dataset, _: xr.Dataset, common: dict[str, Any]
    ) -> HistogramModel:
        """Model from the groups of a file, see `MeasurementModel.read`."""
        counts, pseudocount = data["counts"].values, float(attributes["pseudocount"])
        common["posterior"] = HistogramPosterior(counts, pseudocount) if pseudocount else None
        model = HistogramModel(counts=counts, pseudocount=pseudocount, **common)
        shape = model.counts.shape
        fits = len(shape) == 4 and model.edges.shape in ((shape[3] + 1,), (shape[2], shape[3] + 1))
        if not fits or shape[:2] != model.grid.shape:
            raise ValueError(f"counts have shape {shape}, edges {model.edges.shape}.")
        if (model.counts < 0).any() or not 0 <= model.pseudocount < np.inf:
            raise ValueError("counts or the pseudocount are negative or infinite.")
        return model


MODEL = _Histogram()
