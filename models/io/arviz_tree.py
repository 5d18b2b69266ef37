"""Fitted models as trees that the functions of ArviZ take.

The observed variable has the name `taps` in every group, so that no function needs to be told which one it is. It is
one number per tap, a statistic of its samples, as taps have hundreds of these. Draws of models that are fitted in
closed form are independent and make one chain.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from math import prod
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import InputError, check_count
from ..measurement.draws import Chosen, Draws, by_numpyro, replicated_bins, threads_of
from ..measurement.fits.posterior import ByClass
from ..measurement.likelihood.bins import find_bins
from ..measurement.likelihood.shapes import Parameters
from ..measurement.likelihood.true_class import OwnTaps
from ..measurement.model import Fitted, TapModel
from ..seeds import Purpose, generator
from ..taps import TapSet
from ..threads import in_order, one_blas_thread
from .load import TapSource, all_taps_of

TAPS = "taps"
_SAMPLED = ("chain", "draw")
_ALONG = {"sample": "time", "other_sample": "other_time"}  # ArviZ has a dimension `sample` of its own

type Statistic = str | Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""A name of `STATISTICS`, or a function of taps (N, J, K), shape (N,)."""
STATISTICS = {
    "mean": "mean of the samples of a tap",
    "peak": "largest sample of a tap",
    "log_score": "log probability of the bins of a tap under its class",
    "samples": "samples",
}
"""Statistics of taps by name; `log_score` is at the parameters that decide, `samples` is all of a tap."""


def to_arviz(
    model: TapModel,
    taps: TapSource | Sequence[TapSource],
    *,
    draws: int = 100,
    statistic: Statistic = "mean",
    var_names: Sequence[str] | None = None,
    coords: Mapping[str, Any] | None = None,
    seed: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> xr.DataTree:
    """A model of `fit` as a tree for ArviZ; docs/how-to/arviz.md lists what can be done with it.

    >>> import solidtouch as st
    >>> taps = st.simulate("paper", seed=4)
    >>> tree = to_arviz(st.fit(taps, bins=20), taps, draws=2, coords={"taxel": [0]})
    >>> sorted(tree.children)
    ['log_likelihood', 'log_prior', 'observed_data', 'posterior', 'posterior_predictive', 'prior']
    >>> dict(tree["posterior_predictive"].sizes)
    {'chain': 1, 'draw': 2, 'tap': 1600}

    Args:
        model: The model; from a file, one whose posterior has a closed form.
        taps: Its training taps or some of them, as given to `fit`; those outside its classes are left out.
        draws: How many of parameters and of predicted taps; of Markov chains, how many at most.
        statistic: What is predicted and observed of a tap.
        var_names: Names of the parameters to keep; default all.
        coords: Labels of the parameters to keep by dimension, such as `{"what": ["6 mm rod"], "taxel": [0, 3]}`;
            default all.
        seed: Random seed; default that of the fit.
        progress: Called with the number of draws since the last call.

    Raises:
        InputError: The model has no posterior, or an argument is out of range.
    """
    if not isinstance(model, TapModel):
        raise InputError(f"A model for ArviZ is one that fit returns, got {type(model).__name__}.")
    groups = arviz_groups(
        model,
        all_taps_of(taps),
        draws=draws,
        statistic=statistic,
        var_names=var_names,
        coords=coords,
        seed=model.seed if seed is None else seed,
        progress=progress,
    )
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = dict(tree["posterior"].attrs)
    return tree


def arviz_groups(
    model: TapModel,
    taps: TapSet,
    *,
    draws: int,
    statistic: Statistic = "mean",
    var_names: Sequence[str] | None = None,
    coords: Mapping[str, Any] | None = None,
    seed: int = 0,
    progress: Callable[[int], None] | None = None,
) -> dict[str, xr.Dataset]:
    """Groups of the tree of `to_arviz` by name."""
    check_count(draws, "draws", 1)
    if model.posterior is None:
        raise InputError(
            f"This {model.name} model has no posterior: its prior is improper, or it comes from a file that keeps "
            "none. Fit it again, or store draws with it by solidtouch fit --arviz."
        )
    _check_dims(model, coords)
    used = model.usable(taps)
    if np.isnan(used.taps).any():
        raise InputError("Taps with missing samples have no groups for ArviZ; leave out --arviz.")
    chosen = Chosen.of(model.posterior, 1, draws, seed)
    predicted = _Predicted.of(model, used, statistic)
    prior, keep = model.prior(model.posterior), partial(_labelled, model, var_names, coords)
    parts: dict[str, list[xr.Dataset]] = {}
    for number, drawn in enumerate(_each(model, chosen, partial(predicted.of_draw, seed))):
        before = prior.draw(generator(seed, Purpose.PRIOR, number))
        found = {
            "posterior": keep(drawn.parameters),
            "prior": keep(before),
            "log_likelihood": xr.Dataset({TAPS: ("tap", drawn.log_likelihood)}),
            "posterior_predictive": xr.Dataset({TAPS: (predicted.dims, drawn.predicted)}),
            "log_prior": _selected(_masked(model, prior.log_density(drawn.parameters)), coords),
        }
        for name, part in found.items():
            parts.setdefault(name, []).append(part)
        if progress is not None:
            progress(1)
    known = tap_coords(model, used)
    groups = {name: _joined(each, chosen.shape) for name, each in parts.items()}
    groups["observed_data"] = xr.Dataset({TAPS: (predicted.dims, predicted.observed)})
    for name in groups.keys() & {"log_likelihood", "posterior_predictive", "observed_data"}:
        groups[name] = groups[name].assign_coords(known)
    for name in ("posterior_predictive", "observed_data"):
        groups[name][TAPS].attrs["long_name"] = predicted.told
    attributes = _attributes(model, model.posterior)
    return {name: group.assign_attrs(attributes) for name, group in groups.items() if group.data_vars}


def draw_groups(fitted: Fitted, taps: TapSet, draws: Draws) -> dict[str, xr.Dataset]:
    """Groups `posterior` and `log_likelihood` of draws that were made before.

    Args:
        fitted: The model and its posterior.
        taps: Its training taps, as given to `posterior_draws`.
        draws: Draws of its parameters, and log-likelihoods.
    """
    model = fitted.model
    numbers = dict(zip(_SAMPLED, map(np.arange, draws.log_likelihood.shape[:2]), strict=True))
    parameters = {name: ((*_SAMPLED, *model.dims[name]), values) for name, values in draws.parameters.items()}
    known = numbers | tap_coords(model, model.usable(taps))
    groups = {
        "posterior": _renamed(xr.Dataset(parameters, model.grid.coords() | numbers)),
        "log_likelihood": xr.Dataset({TAPS: ((*_SAMPLED, "tap"), draws.log_likelihood)}, known),
    }
    return {name: group.assign_attrs(_attributes(model, fitted.posterior)) for name, group in groups.items()}


def tap_coords(model: TapModel, taps: TapSet) -> dict[str, Any]:
    """Coordinates of known taps: number, class and session."""
    where, what = taps.indices(model.grid)
    return {
        "tap": np.arange(len(taps)),
        "where": ("tap", model.grid.where_value[where], {"units": model.grid.where_unit}),
        "what": ("tap", np.asarray(model.grid.what_name, dtype=np.str_)[what]),
        "session": ("tap", taps.session),
    }


class _Drawn(NamedTuple):
    """What belongs to one draw of the parameters."""

    parameters: Parameters
    log_likelihood: NDArray[np.float32]
    predicted: NDArray[np.float32]


def _each(model: TapModel, chosen: Chosen, follow: Callable[[int, Parameters], _Drawn]) -> Iterator[_Drawn]:
    """What follows from each draw, in order."""
    tasks = (partial(lambda n: follow(n, chosen.at(n)), n) for n in range(prod(chosen.shape)))
    with one_blas_thread():
        yield from in_order(tasks, threads_of(model))


def _joined(parts: Sequence[xr.Dataset], shape: tuple[int, int]) -> xr.Dataset:
    """Datasets of all draws in one, with chain and draw in front."""
    first, numbers = parts[0], dict(zip(_SAMPLED, map(np.arange, shape), strict=True))
    values = {
        name: (
            (*_SAMPLED, *first[name].dims),
            np.stack([part[name].values for part in parts]).reshape(*shape, *first[name].shape),
        )
        for name in first.data_vars
    }
    return xr.Dataset(values, {**first.coords, **numbers})


class _Predicted(NamedTuple):
    """A statistic of known taps, and of taps like them.

    Attributes:
        model: The model.
        taps: Known taps.
        own: Their log probabilities under their own classes.
        statistic: Of taps (N, J, K) at the centres of their bins.
        told: What it is.
        dims: Its dims.
        observed: Its values for the known taps.
    """

    model: TapModel
    taps: TapSet
    own: OwnTaps
    statistic: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    told: str
    dims: tuple[str, ...]
    observed: NDArray[np.float32]

    @classmethod
    def of(cls, model: TapModel, taps: TapSet, statistic: Statistic) -> "_Predicted":
        """Statistic of known taps.

        Raises:
            InputError: There is no such statistic, or it does not give one number per tap.
        """
        own = model.training_hypotheses(taps)
        known = OwnTaps(taps.taps, own, model.edges, model.states)
        named: dict[Any, Any] = {
            "mean": lambda values: values.mean(axis=(1, 2)),
            "peak": lambda values: values.max(axis=(1, 2)),
            "log_score": lambda v: OwnTaps(v, own, model.edges, model.states).log_probability(model.training_form()),
            "samples": lambda values: values,
        }
        of: Any = named.get(statistic, statistic)
        if not callable(of):
            raise InputError(f"statistic must be a function or one of {', '.join(STATISTICS)}, got {statistic!r}.")
        observed = _numbers(of(_centres(model, find_bins(taps.taps, model.edges))), "tap")
        whole = statistic == "samples"
        if observed.shape != (taps.taps.shape if whole else (len(taps),)):
            raise InputError(f"statistic must give one number per tap, shape ({len(taps)},), got {observed.shape}.")
        told = STATISTICS[statistic] if isinstance(statistic, str) else getattr(of, "__name__", "statistic")
        return cls(model, taps, known, cast(Any, of), told, ("tap", "time", "taxel") if whole else ("tap",), observed)

    def of_draw(self, seed: int, number: int, parameters: Parameters) -> _Drawn:
        """Log-likelihood of the known taps, and the statistic of taps drawn at these parameters."""
        chance = generator(seed, Purpose.PREDICTED, number)
        bins = replicated_bins(parameters, self.model, self.taps, chance)
        log_likelihood = self.own.log_probability(self.model.training_form(parameters))
        predicted = _numbers(self.statistic(_centres(self.model, bins)), "tap drawn like tap")
        return _Drawn(parameters, log_likelihood.astype(np.float32), predicted)


def _numbers(values: Any, tap: str) -> NDArray[np.float32]:
    """Values of a statistic.

    Raises:
        InputError: One is NaN.
    """
    numbers = np.asarray(values, dtype=np.float32)
    if (wrong := np.argwhere(np.isnan(numbers))).size:
        raise InputError(f"statistic must give a number for each tap, got NaN for {tap} {wrong[0][0]}.")
    return numbers


def _centres(model: TapModel, bins: NDArray[np.integer]) -> NDArray[np.float64]:
    """Samples at the centres of their bins, which is all that models of bins know of them."""
    edges = np.broadcast_to(model.edges, (model.K, model.edges.shape[-1]))
    centres = 0.5 * (edges[:, :-1] + edges[:, 1:])
    return centres[np.arange(model.K), bins]


def _labelled(
    model: TapModel, var_names: Sequence[str] | None, coords: Mapping[str, Any] | None, parameters: Parameters
) -> xr.Dataset:
    """Parameters with their dims and labels, as far as they are wanted.

    Raises:
        InputError: A name or label is none of the model.
    """
    wanted = list(model.dims) if var_names is None else [var_names] if isinstance(var_names, str) else list(var_names)
    if unknown := [name for name in wanted if name not in model.dims]:
        raise InputError(
            f"The {model.name} model has no parameter {unknown[0]!r}; choose from {', '.join(model.dims)}."
        )
    values = {n: (model.dims[n], np.asarray(parameters[n], np.float32)) for n in wanted if n in parameters}
    labels = {
        name: label for name, label in model.grid.coords().items() if any(name in dims for dims, _ in values.values())
    }
    return _selected(_renamed(xr.Dataset(values, labels)), coords)


def _renamed(parameters: xr.Dataset) -> xr.Dataset:
    """Parameters with dims that ArviZ takes."""
    renamed = parameters.rename({old: new for old, new in _ALONG.items() if old in parameters.dims})
    return renamed.isel(once=0) if "once" in renamed.dims else renamed


def _check_dims(model: TapModel, coords: Mapping[str, Any] | None) -> None:
    """Refuses labels of a dimension that no parameter has.

    Raises:
        InputError: There is one.
    """
    dims = dict.fromkeys(_ALONG.get(dim, dim) for dims in model.dims.values() for dim in dims if dim != "once")
    if coords is not None and not isinstance(coords, Mapping):
        raise InputError(f"coords must be labels by dimension, such as {{'taxel': [0]}}, got {coords!r}.")
    if unknown := [dim for dim in coords or {} if dim not in dims]:
        raise InputError(
            f"coords: the {model.name} model has no dimension {unknown[0]!r}; choose from {', '.join(dims)}."
        )


def _selected(values: xr.Dataset, coords: Mapping[str, Any] | None) -> xr.Dataset:
    """Values at labels of those dims that they have.

    Raises:
        InputError: There is no such label.
    """
    for dim, label in (coords or {}).items():
        if dim not in values.dims:
            continue
        try:
            values = values.sel({dim: np.atleast_1d(label)})
        except (KeyError, IndexError):
            there = values[dim].values.tolist()
            raise InputError(f"coords: {dim} has no {label!r}; it has {there}.") from None
    return values


def _masked(model: TapModel, densities: ByClass) -> xr.Dataset:
    """Log densities of the prior by name; 0 for classes without a training tap."""
    trained = xr.DataArray(model.trained, model.grid.coords(), ("where", "what"))
    values = xr.Dataset(dict(densities), {name: trained[name] for name in trained.dims})
    return xr.Dataset({n: v.where(trained, 0.0) if {"where", "what"} <= set(v.dims) else v for n, v in values.items()})


def _attributes(model: TapModel, posterior: Any) -> dict[str, str]:
    """Attributes that ArviZ gives every group."""
    library = "numpyro" if getattr(posterior, "sizes", None) or by_numpyro(model) else "solidtouch"
    return {
        "created_at": datetime.now(UTC).isoformat(),
        "creation_library": "solidtouch",
        "creation_library_version": version("solidtouch"),
        "inference_library": library,
        "inference_library_version": version(library),
    }
