"""The paper's measurement model: one histogram of sample values per class and taxel.

Two views of the same thing. `histogram_model` is the generative story in NumPyro, a Dirichlet prior over the bins of
every class and taxel; `fit` is its conjugate posterior in closed form, whose mean is Eq. 2 of the paper with the
pseudocount as the Dirichlet concentration. The order of samples drops out of Eq. 1, so the log-likelihood of many
taps is one matrix product of their bin counts with the log tables.

Reference: Lepora, Martinez-Hernandez and Prescott, "A SOLID case for active Bayesian perception in robot touch" (2013).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.metadata import version
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from ..digest import tap_digests
from ..errors import InputError
from ..grid import ClassGrid
from ..power import likelihood_exponent
from ..preprocessing import Preprocessing
from ..taps import TapSet
from .likelihood.bins import bin_edges, count_taps
from .likelihood.forms import TableForm
from .model import TapModel
from .novelty import NoveltyScores, novelty_scores
from .states import ONE_STATE, States


def histogram_model(
    bins: ArrayLike, where: ArrayLike, what: ArrayLike, shape: tuple[int, int, int, int], pseudocount: float
) -> None:
    """Bins of taps of known class; Eq. 1 at power 1 with a Dirichlet prior on every histogram of Eq. 2.

    The posterior is Dirichlet again, with the counts added, and its mean is Eq. 2 with the pseudocount.

    Args:
        bins: Bin of every sample, shape (N, J, K).
        where: Where class of every tap, shape (N,).
        what: What class of every tap, shape (N,).
        shape: (L, M, K, B).
        pseudocount: Dirichlet concentration of every bin.
    """
    import numpyro  # noqa: PLC0415
    import numpyro.distributions as dist  # noqa: PLC0415

    L, M, K, B = shape
    bins, where, what = np.asarray(bins), np.asarray(where), np.asarray(what)
    N, J, _ = bins.shape
    with numpyro.plate("L", L, dim=-3), numpyro.plate("M", M, dim=-2), numpyro.plate("K", K, dim=-1):
        p: Any = numpyro.sample("p", dist.Dirichlet(np.full(B, pseudocount)))
    with numpyro.plate("tap", N, dim=-3), numpyro.plate("J", J, dim=-2), numpyro.plate("taxel", K, dim=-1):
        numpyro.sample("bins", dist.CategoricalProbs(probs=p[where, what][:, None]), obs=bins)


@dataclass(frozen=True, eq=False, repr=False)
class HistogramModel(TapModel):
    """A fitted histogram for every class and taxel.

    Attributes:
        grid: The classes.
        edges: Bin edges, shape (B + 1,) for all taxels or (K, B + 1) for each.
        counts: Occupation numbers h_k(b) of every class, shape (L, M, K, B).
        pseudocount: Added to every bin, in counts.
        power: Root of the likelihood in Eq. 1: `"J"`, `"JK"`, `"none"` or an exponent.
        preprocessing: How the taps were prepared.
        left_out: Names of the classes without a training tap.
        trained_on: Which taps trained it, in words.
        version: Version of this software that fitted it.
        novelty: How badly the training taps fit their classes; without it no tap can be called new.
        training: Digests of the training taps, see `tap_digests`; none where a file of an older version has none.
        states: What all taps of an episode share, see `session`.
        saturation: How many taps' evidence an episode carries at most.
    """

    grid: ClassGrid
    edges: NDArray[np.float64]
    counts: NDArray[np.int64]
    pseudocount: float
    power: str | float
    preprocessing: Preprocessing
    left_out: tuple[str, ...] = ()
    trained_on: str = ""
    version: str = ""
    novelty: NoveltyScores | None = None
    training: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))
    states: States = ONE_STATE
    saturation: float = np.inf

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        """Which classes have a training tap, shape (L, M)."""
        return self.counts.sum(axis=(2, 3)) > 0

    @cached_property
    def probabilities(self) -> NDArray[np.float64]:
        """P_k(b | class), shape (L, M, K, B); Eq. 2, flat for a class without a training tap."""
        smoothed = self.counts + float(self.pseudocount)
        smoothed[~self.trained] = 1.0
        return smoothed / smoothed.sum(axis=-1, keepdims=True)

    @cached_property
    def log_prob(self) -> NDArray[np.float64]:
        """Logarithm of `probabilities`, -inf for empty bins without pseudocount, shape (L, M, K, B)."""
        with np.errstate(divide="ignore"):
            return np.log(self.probabilities)

    @cached_property
    def plain_form(self) -> TableForm:
        """The log tables."""
        return TableForm(self.log_prob)

    @property
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""
        return self.counts.shape[2]

    @property
    def kind(self) -> str:
        """What the catalogue calls it."""
        return "histogram"

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Those of the log tables."""
        return {"log_prob": ("where", "what", "taxel", "bin")}

    def groups(self) -> dict[str, xr.Dataset]:
        """With its counts, which say all, and for readers the probabilities."""
        groups = super().groups()
        bins = self.dims["log_prob"]
        own = {"counts": (bins, self.counts), "probabilities": (bins, self.probabilities)}
        return {
            "/": groups["/"].assign_attrs(pseudocount=self.pseudocount),
            "constant_data": groups["constant_data"].assign(own),
        }

    def with_scores(self, taps: TapSet) -> "HistogramModel":
        """With the scores of its training taps, if it has one state."""
        if len(self.states.gain) > 1:
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
    """The histograms of training taps; Eq. 2.

    Args:
        taps: Training taps.
        grid: The classes to tell apart. A class without a training tap stays in the grid as an untrained class,
            which is impossible; `trim` takes whole empty objects and ends of the range out of a grid.
        bins: `B`, equal-width bins across the range; given edges say it themselves.
        pseudocount: Added to every bin, in counts. The paper has none, and then a quarter to a half of
            simulated test taps are impossible under their own class; later work adds a small constant.
        power: Root of Eq. 1, see `inference.reference.exponent`.
        saturation: How many taps' evidence an episode carries at most, see `inference.saturation`.
        value_range: Whether bins span the range of all taxels together or of each.
        edges: Bin edges to use instead, shape (B + 1,) or (K, B + 1).
        trained_on: Which taps these are, in words, for the model's file.

    Returns:
        The fitted model, with the untrained classes by name.

    Raises:
        InputError: No tap lies in the grid, or an argument is out of range.
    """
    if bins < 1:
        raise InputError(f"A histogram needs at least one bin, got bins={bins}.")
    if not (np.isfinite(pseudocount) and pseudocount >= 0):
        raise InputError(f"The pseudocount must be finite and not negative, got {pseudocount}.")
    K = taps.dataset.sizes["taxel"]
    likelihood_exponent(power, taps.preprocessing.samples, K)
    where, what = taps.indices(grid)
    inside = (where >= 0) & (what >= 0)
    if not inside.any():
        raise InputError("No training tap belongs to a class of the grid.")
    samples = taps.taps if inside.all() else taps.taps[inside]
    edges = bin_edges(samples, bins, value_range) if edges is None else edges
    counts = _class_counts(samples, edges, where[inside], what[inside], (*grid.shape, K, edges.shape[-1] - 1))
    return HistogramModel(
        grid=grid,
        edges=edges,
        counts=counts,
        pseudocount=float(pseudocount),
        power=power,
        preprocessing=taps.preprocessing,
        left_out=untouched(grid, counts.sum(axis=(2, 3)) > 0),
        trained_on=trained_on,
        version=version("solidtouch"),
        training=tap_digests(samples),
        saturation=float(saturation),
    )


def trim(grid: ClassGrid, taps: Sequence[TapSet]) -> tuple[ClassGrid, tuple[str, ...]]:
    """The grid without classes that no tap belongs to, and their names.

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


def _class_counts(
    samples: NDArray[np.floating],
    edges: NDArray[np.float64],
    where: NDArray[np.intp],
    what: NDArray[np.intp],
    shape: tuple[int, int, int, int],
) -> NDArray[np.int64]:
    from .likelihood.counting import add  # noqa: PLC0415

    L, M, K, B = shape
    counts, group = np.zeros((L * M, K * B), dtype=np.int64), where * M + what
    for which, part in count_taps(samples, edges):
        add(*part, group[which], counts)
    return counts.reshape(shape)


def untouched(grid: ClassGrid, touched: NDArray[np.bool_]) -> tuple[str, ...]:
    """Names of the classes without a tap: whole objects, whole positions, then single cells."""
    objects, positions = ~touched.any(axis=0), ~touched.any(axis=1)
    names = [grid.what_name[m] for m in np.flatnonzero(objects)]
    names += [grid.where_label(l) for l in np.flatnonzero(positions).tolist()]
    cells = np.argwhere(~touched & ~objects & ~positions[:, np.newaxis]).tolist()
    return (*names, *(f"{grid.what_name[m]} at {grid.where_label(l)}" for l, m in cells))
