"""Replay of recorded taps behind the interface of a rig, as in the paper's tests (sec. 3.2)."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ..models.errors import InputError
from ..models.grid import ClassGrid, tap_pool
from ..models.io.load import TapSource, taps_of
from ..models.preprocessing import Preprocessing
from ..models.taps import TapSet
from .sensor import check_class, clipped_move

type Chance = Iterator[float] | np.random.Generator
"""Uniform random numbers in [0, 1), or a generator of them."""


def as_uniforms(chance: Chance | None) -> Iterator[float]:
    """Uniform random numbers in [0, 1): those given, or endless ones of a generator, by default seeded 0.

    Raises:
        InputError: It is neither.
    """
    if isinstance(chance, Iterator):
        return _checked(chance)
    generator = np.random.default_rng(0) if chance is None else chance
    if not isinstance(generator, np.random.Generator):
        raise InputError(f"Random numbers are an iterator or a NumPy generator, got {type(chance).__name__}.")
    return iter(generator.random, None)


def _checked(numbers: Iterator[float]) -> Iterator[float]:
    """The same numbers.

    Raises:
        InputError: On reading: one lies outside [0, 1), or none is left.
    """
    for number in numbers:
        if not 0 <= number < 1:
            raise InputError(f"Random numbers must lie in [0, 1), got {number!r}.")
        yield number
    raise InputError("There are fewer random numbers than taps or moves.")


class ReplayRig:
    """A `TouchSensor` that draws recorded taps of its current class, with replacement.

    If a class has no tap, the sensor moves to the nearest position with a tap of the same object.

    >>> import solidtouch as st
    >>> (taps,) = st.simulate("paper", seed=4)
    >>> rig = st.ReplayRig(taps, taps.grid(), start=3, what=1)
    >>> rig.tap().shape, rig.move(+2), rig.where_index
    ((50, 12), 2, 5)

    Args:
        taps: The recording or its file.
        grid: Class grid.
        start: Index of the first position.
        what: Index of the object.
        uniforms: Numbers in [0, 1), one per tap, or a NumPy generator of them, by default one seeded 0: `u` selects tap
            `floor(u * count)` of the class in the order of the file.
        session: Recorded session whose taps are drawn; `None` for those of all.

    Attributes:
        where_index: Index of the current position.
        clamped: Number of moves cut short at the end of the range.
        substituted: Number of times that a class without a tap was replaced, including the start.

    Raises:
        InputError: The start lies outside the grid, there is no such session or the object has no tap in it.
    """

    def __init__(
        self,
        taps: TapSource,
        grid: ClassGrid,
        start: int,
        what: int,
        uniforms: Chance | None = None,
        *,
        session: int | None = None,
    ) -> None:
        check_class(grid, start, what)
        self._taps = taps = taps if isinstance(taps, TapSet) else taps_of(taps)
        self._last = grid.L - 1
        self._step = np.diff(grid.where_value)
        where, held = taps.indices(grid)
        if session is not None:
            where = np.where(taps.session == session, where, -1)
            if not (where >= 0).any():
                raise InputError(f"The recording has no tap of session {session} inside the class grid.")
        self._pool = tap_pool(where, held, grid.shape)
        self._what = what
        self._uniforms = as_uniforms(uniforms)
        self.clamped = 0
        self.substituted = 0
        self._nearest = self._pool.nearest[0, :, what]
        if self._nearest[start] < 0:
            place = "inside the class grid" if session is None else f"in session {session}"
            raise InputError(f"The recording has no tap of {grid.what_name[what]} {place}.")
        self.where_index = self._stand(start)

    @property
    def preprocessing(self) -> Preprocessing:
        """Preprocessing of the recorded taps."""
        return self._taps.preprocessing

    @property
    def step(self) -> NDArray[np.float64]:
        """Distances of neighbouring positions in the unit of the grid, shape (L - 1,)."""
        return self._step

    @property
    def units(self) -> str:
        """Unit of the samples; empty where the recording has none."""
        return self._taps.units

    @property
    def taxel_mm(self) -> NDArray[np.float64] | None:
        """Places of the taxels in mm, shape (K, 2) or (K, 3), or `None` where the recording has none."""
        return self._taps.taxel_mm

    @property
    def room(self) -> tuple[int, int]:
        """Steps left to either end of the range."""
        return self.where_index, self._last - self.where_index

    def tap(self) -> NDArray[np.float64]:
        """Samples of a recorded tap of the current class, shape (J, K)."""
        index = self._pool.pick(self.where_index, self._what, next(self._uniforms))
        return self._taps.taps[index].astype(np.float64)

    def move(self, delta: int) -> int:
        """Moves by `delta` positions, at most to the end of the range.

        Returns:
            Steps actually made, including those to the nearest class with a tap.
        """
        before = self.where_index
        steps = clipped_move(delta, self.room)
        self.clamped += steps != delta
        if steps:
            self.where_index = self._stand(before + steps)
        return self.where_index - before

    def _stand(self, where: int) -> int:
        nearest = int(self._nearest[where])
        self.substituted += nearest != where
        return nearest
