"""Taps drawn from fitted models, which satisfy every assumption of their likelihood.

With the paper's histograms, the bin of each sample is drawn independently given the class (the model of Eq. 1 without
its root); other models draw as they define. The class is given by the position of the sensor and its object. Error
levels and guarantees of perception can be checked on such data only.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...models import seeds
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.measurement.generic.source import function_of
from ...models.measurement.generic.story import at_prior, batch_of
from ...models.measurement.histogram import HistogramModel
from ...models.measurement.model import TapModel
from ...models.preprocessing import Preprocessing
from ...models.taps import TapSet
from ..sensor import check_class, clipped_move


class BinTables(NamedTuple):
    """Histograms prepared for sampling.

    Attributes:
        cumulative: Cumulative probability of the bins, shape (L, M, K, B).
        centre: Sample value of each bin, shape (K, B).
    """

    cumulative: NDArray[np.float64]
    centre: NDArray[np.float64]

    def values(self, where: int, what: int, uniform: NDArray[np.float64]) -> NDArray[np.float64]:
        """Samples of one class from independent uniform numbers in [0, 1), both of shape (..., K)."""
        columns = [
            centre[np.searchsorted(cumulative, uniform[..., k], side="right")]
            for k, (cumulative, centre) in enumerate(zip(self.cumulative[where, what], self.centre, strict=True))
        ]
        return np.stack(columns, axis=-1)


def bin_tables(probabilities: ArrayLike, edges: ArrayLike, shape: tuple[int, int]) -> BinTables:
    """Sampling tables from the probabilities and edges of a fitted model.

    Args:
        probabilities: P_k(b | class), normalised or not, shape (L, M, K, B).
        edges: Increasing bin edges, shape (B + 1,), or (K, B + 1) for each taxel.
        shape: (L, M) of the class grid.

    Raises:
        InputError: Shapes do not match, a histogram has zero or negative weight, or edges do not increase.
    """
    p, edges = np.asarray(probabilities, dtype=np.float64), np.asarray(edges, dtype=np.float64)
    if p.ndim != 4 or p.shape[:2] != shape:
        raise InputError(f"The grid has {shape[0]} x {shape[1]} classes, but the tables have shape {p.shape}.")
    K, B = p.shape[2:]
    if edges.shape not in ((B + 1,), (K, B + 1)):
        raise InputError(f"{K} taxels with {B} bins need {B + 1} edges, got shape {edges.shape}.")
    if not (np.diff(edges) > 0).all():
        raise InputError("Bin edges must increase.")
    if not (p >= 0).all() or not (p.sum(axis=-1) > 0).all():
        raise InputError("Every histogram needs non-negative weights that are not all zero.")
    cumulative = np.cumsum(p, axis=-1)
    centre = np.broadcast_to((edges[..., :-1] + edges[..., 1:]) / 2, (K, B))
    return BinTables(cumulative / cumulative[..., -1:], centre)


class ModelRig:
    """A `TouchSensor` whose taps are drawn from fitted histograms; moves stop at the ends of the grid.

    Args:
        grid: Class grid.
        probabilities: P_k(b | class), shape (L, M, K, B).
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        preprocessing: Preprocessing attributed to the taps; sets `J`.
        start: Index of the first position.
        what: Index of the object.
        generator: Random number generator.

    Attributes:
        where_index: Index of the current position.
        clamped: Number of moves cut short at the end of the range.

    Raises:
        InputError: The tables do not match the grid or each other, or the start lies outside the grid.
    """

    def __init__(
        self,
        grid: ClassGrid,
        probabilities: ArrayLike,
        edges: ArrayLike,
        preprocessing: Preprocessing,
        start: int,
        what: int,
        generator: np.random.Generator,
    ) -> None:
        check_class(grid, start, what)
        self._tables = bin_tables(probabilities, edges, grid.shape)
        self._preprocessing = preprocessing
        self._last = grid.L - 1
        self._step = np.diff(grid.where_value)
        self._what = what
        self._generator = generator
        self.where_index = start
        self.clamped = 0

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing attributed to the taps."""
        return self._preprocessing

    @property
    def step(self) -> NDArray[np.float64]:
        """Distances of neighbouring positions in the unit of the grid, shape (L - 1,)."""
        return self._step

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to either end of the range."""
        return self.where_index, self._last - self.where_index

    def tap(self) -> NDArray[np.float64]:
        """Samples of one tap as bin centres, shape (J, K)."""
        uniform = self._generator.random((self._preprocessing.samples, len(self._tables.centre)))
        return self._tables.values(self.where_index, self._what, uniform)

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range; returns the steps made."""
        steps = clipped_move(delta, self.room)
        self.clamped += steps != delta
        self.where_index += steps
        return steps


def draw_taps(
    grid: ClassGrid,
    probabilities: ArrayLike,
    edges: ArrayLike,
    preprocessing: Preprocessing,
    taps_per_class: int,
    seed: int,
    session: int = 0,
    trained: NDArray[np.bool_] | None = None,
) -> TapSet:
    """A session of taps drawn from fitted histograms.

    Args:
        grid: Class grid.
        probabilities: P_k(b | class), shape (L, M, K, B).
        edges: Bin edges, shape (B + 1,) or (K, B + 1).
        preprocessing: Preprocessing attributed to the taps; sets `J`.
        taps_per_class: Number of taps of each class.
        seed: Seed of the data set.
        session: Number of the session; sessions are independent.
        trained: Classes to draw from, shape (L, M); default: all.

    Returns:
        Taps class by class, labelled with the values of their classes.

    Raises:
        InputError: The tables do not match the grid or each other, no class is trained, or no tap is requested.
    """
    tables = bin_tables(probabilities, edges, grid.shape)
    classes = _classes(grid, taps_per_class, trained)
    generator = seeds.generator(seed, seeds.Purpose.MODEL, session)
    shape = taps_per_class, preprocessing.samples, len(tables.centre)
    taps = np.concatenate([tables.values(l, m, generator.random(shape)) for l, m in classes])
    told = f"every sample drawn independently from a fitted model, seed {seed}, session {session}"
    return _session(grid, classes, taps, preprocessing, session, "fitted histograms (no real sensor)", told)


def draw_session(
    model: TapModel, taps_per_class: int, seed: int, session: int = 0, samples: int | None = None
) -> TapSet:
    """A session of taps drawn from any fitted model, all in the same state.

    Args:
        model: Fitted model; taps are drawn from its trained classes.
        taps_per_class: Number of taps of each class.
        seed: Seed of the data set.
        session: Number of the session; sessions are independent. With a model that has states, a session has one
            state, drawn from their probabilities before any tap.
        samples: Number of samples of a tap; default: that of the model.

    Raises:
        InputError: No class is trained, no tap is requested, or the model depends on time and `samples` differs from
            its own.
    """
    record = model.preprocessing if samples is None else model.preprocessing.of_length(samples)
    if isinstance(model, HistogramModel) and model.form is model.plain_form:
        return draw_taps(
            model.grid, model.probabilities, model.edges, record, taps_per_class, seed, session, model.trained
        )
    if not model.form.exchangeable and record.samples != model.preprocessing.samples:
        raise InputError(
            f"The {model.name} model describes taps of {model.preprocessing.samples} samples; cannot draw taps of "
            f"{samples}."
        )
    classes = _classes(model.grid, taps_per_class, model.trained)
    generator = seeds.generator(seed, seeds.Purpose.MODEL, session)
    state = int(generator.choice(len(model.states.gain), p=np.exp(model.states.log_prior)))
    where, what = np.repeat(classes, taps_per_class, axis=0).T
    taps = model.form.sample(where, state * model.grid.M + what, model.edges, record.samples, generator)
    told = f"drawn from a fitted {model.name} model, seed {seed}, session {session}{_state(model, state)}"
    return _session(model.grid, classes, taps, record, session, "fitted model (no real sensor)", told)


def draw_from_prior(
    story: Callable[..., Any] | str, like: TapSet, taps_per_class: int, seed: int, session: int = 0
) -> TapSet:
    """A session of taps drawn from the prior of a generative model.

    Args:
        story: A NumPyro function that keeps the contract of docs/how-to/your-own-model.md, or its name.
        like: Taps of the same classes, samples and taxels.
        taps_per_class: Number of taps of each class.
        seed: Seed of the data set, whose sessions share all latent variables but those of sessions.
        session: Number of the session.

    Returns:
        Taps in the units in which the model describes samples.

    Raises:
        InputError: The function does not keep the contract or fails, or no tap is requested.
    """
    grid, record, function = like.grid(), like.preprocessing, function_of(story)
    generators = [seeds.generator(seed, seeds.Purpose.MODEL, number) for number in range(session + 1)]
    shared = seeds.generator(seed, seeds.Purpose.PRIOR, 0)
    form = at_prior(function, batch_of(grid, record, like.dataset.sizes["taxel"]), shared, generators)
    classes = _classes(grid, taps_per_class, None)
    where, what = np.repeat(classes, taps_per_class, axis=0).T
    taps = form.sample(where, what, np.empty(0), record.samples, generators[-1])
    told = f"drawn from the prior of {function.name}, seed {seed}, session {session}"
    return _session(grid, classes, taps, record, session, "generative model (no real sensor)", told)


def _state(model: TapModel, number: int) -> str:
    """State of a session, as a phrase; empty for a model without gains and offsets."""
    if len(model.states.apart().gain) == 1:
        return ""
    return f", gain {model.states.gain[number]:.4g} and offset {model.states.offset[number]:.4g}"


def _classes(grid: ClassGrid, taps_per_class: int, trained: NDArray[np.bool_] | None) -> NDArray[np.intp]:
    """Position and object indices of the classes to draw from, shape (n, 2)."""
    if taps_per_class < 1:
        raise InputError(f"taps_per_class must be at least 1, got {taps_per_class}.")
    classes = np.argwhere(np.ones(grid.shape, dtype=bool) if trained is None else trained)
    if not len(classes):
        raise InputError("The model has no trained class to draw from.")
    return classes


def _session(
    grid: ClassGrid,
    classes: NDArray[np.intp],
    taps: NDArray[np.float64],
    preprocessing: Preprocessing,
    session: int,
    sensor: str,
    told: str,
) -> TapSet:
    """Taps of the given classes, equally many of each, as a tap set."""
    each = len(taps) // len(classes)
    where, what = np.repeat(classes, each, axis=0).T
    return TapSet.from_arrays(
        taps,
        what,
        grid.what_name,
        preprocessing=preprocessing,
        where=grid.where_value[where],
        where_value=grid.where_value,
        where_edges=grid.where_edges,
        where_place=grid.where_place,
        where_unit=grid.where_unit,
        what_value=grid.what_value,
        what_unit=grid.what_unit,
        session=np.full(len(where), session),
        trial=np.tile(np.arange(each), len(classes)),
        sensor=sensor,
        source=f"simulated: {told}",
        licence="none needed: simulated data",
    )
