"""Grid of classes, positions (where) times objects (what), and which taps belong to each class.

Letters are the paper's throughout: `L` positions, `M` objects, `N = L M` joint classes,
`K` taxels, `J` samples of a tap, `B` histogram bins, `T` taps of a sequence. Arrays over classes have the axes
(L, M) in this order and count from 0.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InputError, check_numbers, printable, printable_name

_LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}
_MOST_CELLS = 1e6
_ROUNDING = 1e-6  # in cells: a value this close below an edge counts as above it
FEW_TAPS = 10
"""Fewest taps per class with reliable intervals, see docs/explanation/intervals.md."""
_LOST = 10  # there must be so many classes for each that only one session holds


@dataclass(frozen=True, eq=False)
class ClassGrid:
    """`L` positions times `M` objects, with their labels and values.

    >>> grid = ClassGrid([0.5, 1.5, 2.5], "mm", None, ["ball", "rod"])
    >>> grid.shape, grid.what_name, grid.where_label(1)
    ((3, 2), ('ball', 'rod'), '1.5 mm')

    Lists are accepted for arrays and tuples, and a name for an object class with one name.

    Attributes:
        where_value: Reported value of each position class (its centre), shape (L,), increasing.
        where_unit: Unit of `where_value` and `where_edges`.
        where_edges: Class `l` covers `[where_edges[l], where_edges[l + 1])`, shape (L + 1,); `None` if the classes
            are the listed values themselves.
        what_members: Names of the objects in each object class, `M` tuples; see `errors.printable_name`.
        what_value: Reported value of each object class, shape (M,), or `None` if objects have no size.
        what_unit: Unit of `what_value`.
        where_place: Places in a plane that the positions are, x and y in `where_unit` and perhaps an angle, shape
            (L, 2) or (L, 3); `where_value` then numbers them. `None` for positions on a line.

    Raises:
        InputError: Sizes do not match, values are no numbers or do not increase, or a name is in two classes.
    """

    where_value: NDArray[np.float64]
    where_unit: str
    where_edges: NDArray[np.float64] | None
    what_members: tuple[tuple[str, ...], ...]
    what_value: NDArray[np.float64] | None = None
    what_unit: str = ""
    where_place: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Makes arrays and tuples, and checks the sizes."""
        for name in ("where_value", "where_edges", "what_value"):
            object.__setattr__(self, name, _numbers(getattr(self, name), name))
        object.__setattr__(self, "what_members", _members(self.what_members))
        for name in ("where_unit", "what_unit"):
            if not isinstance(unit := getattr(self, name), str):
                raise InputError(f"{name} of a class grid must be text, got {unit!r}.")
            object.__setattr__(self, name, printable(unit))
        if self.L < 1 or self.M < 1:
            raise InputError(f"A class grid needs at least one position and one object, got {self.L} and {self.M}.")
        if not np.all(np.diff(self.where_value) > 0):
            raise InputError("where_value of a class grid must increase.")
        if self.where_edges is not None and (
            self.where_edges.shape != (self.L + 1,) or not np.all(np.diff(self.where_edges) > 0)
        ):
            raise InputError(f"{self.L} position classes need {self.L + 1} increasing edges.")
        names = [name for members in self.what_members for name in members]
        if len(set(names)) != len(names):
            raise InputError(f"An object name is in two classes: {sorted(names)}.")
        if self.what_value is not None and self.what_value.shape != (self.M,):
            raise InputError(f"{self.M} object classes need {self.M} values, got shape {self.what_value.shape}.")
        if self.where_place is not None:
            place = check_numbers(self.where_place, "where_place of a class grid").astype(np.float64)
            if place.ndim != 2 or len(place) != self.L or place.shape[1] not in (2, 3) or not np.isfinite(place).all():
                raise InputError(f"where_place must have shape ({self.L}, 2) or ({self.L}, 3), got {place.shape}.")
            object.__setattr__(self, "where_place", place)

    @property
    def L(self) -> int:  # noqa: N802
        """Number of positions."""
        return len(self.where_value)

    @property
    def M(self) -> int:  # noqa: N802
        """Number of objects."""
        return len(self.what_members)

    @property
    def shape(self) -> tuple[int, int]:
        """(L, M)."""
        return self.L, self.M

    @property
    def what_name(self) -> tuple[str, ...]:
        """Printable name of each object class."""
        return tuple(m[0] if len(m) == 1 else f"{m[0]} … {m[-1]}" for m in self.what_members)

    def where_label(self, l: int) -> str:
        """Printable name of position `l`, for example `"7.5 mm"`; remarks after the unit are omitted."""
        unit = re.split(r"[,(;]", self.where_unit, maxsplit=1)[0]
        if self.where_place is None:
            return f"{self.where_value[l]:g} {unit}".strip()
        x, y, *angle = (f"{value:g}" for value in self.where_place[l])
        return " at ".join([f"({x}, {y}) {unit}".strip(), *angle])

    @property
    def axis_unit(self) -> str:
        """Unit of `where_value`: none where it numbers places in a plane."""
        return self.where_unit if self.where_place is None else ""

    def where_index(self, values: ArrayLike) -> NDArray[np.intp]:
        """Position index of each value, -1 if outside; same shape as `values`."""
        values = np.asarray(values, dtype=np.float64)
        if self.where_edges is not None:
            slack = _ROUNDING * np.diff(self.where_edges).min()
            index = np.searchsorted(self.where_edges, values + slack, side="right") - 1
            return np.where((index >= 0) & (index < self.L), index, -1)
        above = np.searchsorted(self.where_value, values).clip(max=self.L - 1)
        below = np.maximum(above - 1, 0)
        nearest = np.where(values - self.where_value[below] <= self.where_value[above] - values, below, above)
        spacing = np.diff(self.where_value).min() if self.L > 1 else max(1.0, abs(float(self.where_value[0])))
        return np.where(np.abs(values - self.where_value[nearest]) <= _ROUNDING * spacing, nearest, -1)

    def what_index(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Object index of each object name, -1 if unknown; shape (len(names),)."""
        table = {name: m for m, members in enumerate(self.what_members) for name in members}
        return np.array([table.get(str(name), -1) for name in names], dtype=np.intp)

    def where_error(self, decided: ArrayLike, true: ArrayLike) -> NDArray[np.float64]:
        """Distance between positions in `where_unit` (decisions are classes, so 0 or at least one cell).

        In a plane it is that of x and y; an angle does not count.
        """
        if self.where_place is None:
            return np.abs(self.where_value[np.asarray(decided)] - self.where_value[np.asarray(true)])
        apart = self.where_place[np.asarray(decided), :2] - self.where_place[np.asarray(true), :2]
        return np.hypot(apart[..., 0], apart[..., 1])

    def what_error(self, decided: ArrayLike, true: ArrayLike) -> NDArray[np.float64]:
        """Distance between objects in `what_unit`; without values 1 if they differ, else 0."""
        decided, true = np.asarray(decided), np.asarray(true)
        if self.what_value is None:
            return (decided != true).astype(np.float64)
        return np.abs(self.what_value[decided] - self.what_value[true])

    @property
    def what_error_unit(self) -> str:
        """Unit of `what_error`: that of the values, or `"P(wrong)"` without values."""
        return "P(wrong)" if self.what_value is None else self.what_unit

    def select(self, where: Sequence[int], what: Sequence[int]) -> Self:
        """The grid with these positions and objects only, in this order.

        Edges are kept only if the remaining positions are neighbours; otherwise positions are listed by value.
        """
        where, what = list(where), list(what)
        contiguous = where == list(range(where[0], where[0] + len(where))) if where else False
        edges = self.where_edges
        if edges is not None:
            if not contiguous:
                raise InputError("Cannot leave out positions between others of a grid with edges.")
            edges = edges[where[0] : where[-1] + 2]
        return type(self)(
            where_value=self.where_value[where],
            where_unit=self.where_unit,
            where_edges=edges,
            what_members=tuple(self.what_members[m] for m in what),
            what_value=None if self.what_value is None else self.what_value[what],
            what_unit=self.what_unit,
            where_place=None if self.where_place is None else self.where_place[where],
        )

    def untouched(self, touched: NDArray[np.bool_]) -> tuple[str, ...]:
        """Names of the classes that are not in mask (L, M): whole objects, whole positions, then single cells."""
        objects, positions = ~touched.any(axis=0), ~touched.any(axis=1)
        names = [self.what_name[m] for m in np.flatnonzero(objects)]
        names += [self.where_label(l) for l in np.flatnonzero(positions).tolist()]
        cells = np.argwhere(~touched & ~objects & ~positions[:, np.newaxis]).tolist()
        return (*names, *(f"{self.what_name[m]} at {self.where_label(l)}" for l, m in cells))

    def differences(self, other: Self) -> list[str]:
        """Differences of `other` as phrases; empty if both grids have the same classes."""
        phrases = []
        if self.shape != other.shape:
            phrases.append(f"{self.L} x {self.M} classes here and {other.L} x {other.M} there")
        elif not np.array_equal(self.where_value, other.where_value) or self.where_unit != other.where_unit:
            phrases.append("the positions differ")
        elif not _same(self.where_place, other.where_place):
            phrases.append("the places of the positions differ")
        elif self.what_members != other.what_members:
            phrases.append("the objects differ")
        return phrases

    def coords(self) -> dict[str, Any]:
        """Coordinates of datasets over the classes."""
        return {
            "where": ("where", self.where_value, {"units": self.axis_unit}),
            "what": ("what", np.asarray(self.what_name, dtype=np.str_)),
        }

    def to_dict(self) -> dict[str, Any]:
        """The grid as plain lists and strings, for JSON and file attributes."""
        return {
            "where_value": self.where_value.tolist(),
            "where_unit": self.where_unit,
            "where_edges": None if self.where_edges is None else self.where_edges.tolist(),
            "what_members": [list(members) for members in self.what_members],
            "what_value": None if self.what_value is None else self.what_value.tolist(),
            "what_unit": self.what_unit,
            **({} if self.where_place is None else {"where_place": self.where_place.tolist()}),
        }

    @classmethod
    def from_dict(cls, fields: dict[str, Any]) -> Self:
        """Grid from the result of `to_dict`.

        Raises:
            InputError: A field is missing or has the wrong size.
        """
        try:
            return cls(
                where_value=np.asarray(fields["where_value"], dtype=np.float64),
                where_unit=fields["where_unit"],
                where_edges=None
                if fields["where_edges"] is None
                else np.asarray(fields["where_edges"], dtype=np.float64),
                what_members=tuple(tuple(members) for members in fields["what_members"]),
                what_value=None if fields["what_value"] is None else np.asarray(fields["what_value"], dtype=np.float64),
                what_unit=fields["what_unit"],
                where_place=fields.get("where_place"),
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"Not a class grid: {error}.") from error


def _same(here: NDArray[np.float64] | None, there: NDArray[np.float64] | None) -> bool:
    return np.array_equal(here, there) if here is not None and there is not None else here is there


def _numbers(values: ArrayLike | None, name: str) -> NDArray[np.float64] | None:
    """Finite numbers, shape (n,).

    Raises:
        InputError: They are none.
    """
    if values is None:
        return None
    numbers = check_numbers(values, f"{name} of a class grid").astype(np.float64)
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise InputError(f"{name} of a class grid must be a list of finite numbers, got {values!r}.")
    return numbers


def _members(objects: Sequence[str | Sequence[str]]) -> tuple[tuple[str, ...], ...]:
    """Names of the objects in each object class.

    Raises:
        InputError: They are no names.
    """
    try:
        members = tuple((names,) if isinstance(names, str) else tuple(names) for names in objects)
    except TypeError:
        members = ((),)
    if isinstance(objects, str) or not all(names and all(isinstance(name, str) for name in names) for names in members):
        raise InputError(f"what_members of a class grid must be the names of the objects, got {objects!r}.")
    return tuple(tuple(map(printable_name, names)) for names in members)


def parse_length(text: str, unit: str, option: str) -> float:
    """Positive number in `unit` from text with an optional unit, such as `"3mm"`.

    Args:
        text: The text.
        unit: Unit of the result; lengths are converted, other units must match.
        option: Name of the argument, for messages.

    Raises:
        InputError: The text is not a positive number, or its unit cannot be converted.
    """
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][-+]?\d+)?)\s*(\S*)\s*", str(text))
    try:
        number = float(match[1]) if match else 0.0
    except ValueError:
        number = 0.0
    if match is None or not number > 0 or not np.isfinite(number):
        raise InputError(f"{option} must be a positive length such as 3mm, got {text!r}.")
    given, wanted = match[2], unit.split(maxsplit=1)[0].rstrip(",;") if unit else ""
    if not given or given == wanted:
        return number
    if given in _LENGTHS_M and wanted in _LENGTHS_M:
        return number * _LENGTHS_M[given] / _LENGTHS_M[wanted]
    raise InputError(f"{option} {text!r} cannot be converted to {unit!r}, the unit of these data.")


def values_from_names(names: Sequence[str]) -> tuple[NDArray[np.float64], str] | None:
    """Values and unit contained in object names, such as `"rod 4 mm"`; `None` if they contain none.

    All names must be one number between the same words; names without a unit after the number (`"ball_1"`) are
    numbering, not sizes.
    """
    matches = [re.fullmatch(r"(.*?)(-?\d+(?:\.\d+)?)\s*([a-zA-Zµ]+)", str(name)) for name in names]
    parts = [m.groups() for m in matches if m is not None]
    if len(parts) != len(names) or len({(before, unit) for before, _, unit in parts}) != 1:
        return None
    return np.array([float(number) for _, number, _ in parts]), parts[0][2]


def group(values: NDArray[np.float64], width: float, start: float | None = None) -> NDArray[np.intp]:
    """Cell index of each value for cells of `width` from `start` (default: the lowest value) upwards.

    Raises:
        InputError: More than a million cells would result.
    """
    start = float(values.min()) if start is None else start
    if not (values.max() - start) / width < _MOST_CELLS:
        raise InputError(f"Cells of width {width:g} are too narrow for values up to {values.max():g}.")
    return np.floor((values - start) / width + _ROUNDING).astype(np.intp)


def can_act(grid: ClassGrid) -> bool:
    """Whether active perception means anything: there is somewhere to move and something to tell apart."""
    return grid.L > 1 and grid.M > 1


def policies(grid: ClassGrid) -> tuple[str, ...]:
    """The policies that mean anything; the last one is the one that comparisons are about."""
    return ("passive", "active") if can_act(grid) else ("passive",)


def nearest_trained(trained: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Nearest trained position of the same object, the lower of two equally near; shape (L, M).

    0 for objects without a trained class.
    """
    L, l = len(trained), np.arange(len(trained))[:, np.newaxis]
    below = np.maximum.accumulate(np.where(trained, l, -2 * L), axis=0)
    above = np.minimum.accumulate(np.where(trained, l, 3 * L)[::-1], axis=0)[::-1]
    return np.where(trained.any(axis=0), np.where(l - below <= above - l, below, above), 0)


class TapPool(NamedTuple):
    """Tap indices by session and class.

    An episode draws taps of one session. Those of class (l, m) in session s are
    `order[first[s, l, m] : first[s, l, m] + count[s, l, m]]`, in the order of the file.

    Attributes:
        order: Tap indices, class by class in each session, shape (taps inside the grid,).
        first: Index in `order` of the first tap of each class, shape (S, L, M).
        count: Number of taps of each class, shape (S, L, M).
        nearest: Nearest position with a tap of the object in the session (the lower of two equally near), -1 if the
            object has no tap there, shape (S, L, M).
    """

    order: NDArray[np.intp]
    first: NDArray[np.intp]
    count: NDArray[np.intp]  # pyright: ignore[reportIncompatibleMethodOverride]
    nearest: NDArray[np.intp]

    @property
    def shape(self) -> tuple[int, int]:
        """(L, M)."""
        _, L, M = self.count.shape
        return L, M

    @property
    def per_class(self) -> NDArray[np.intp]:
        """Number of taps of each class in all sessions, shape (L, M)."""
        return self.count.sum(axis=0)

    def taps(self, l: int, m: int) -> NDArray[np.intp]:
        """Indices of the taps of a class in all sessions."""
        parts = zip(self.first[:, l, m], self.count[:, l, m], strict=True)
        return np.concatenate([self.order[first : first + count] for first, count in parts])

    def pick(self, where: int, what: int, uniform: float, session: int = 0) -> int:
        """Index of the tap of a class that a uniform number in [0, 1) selects; the class must have a tap."""
        at = session, where, what
        return int(self.order[self.first[at] + int(uniform * self.count[at])])


def tap_pool(where: ArrayLike, what: ArrayLike, shape: tuple[int, int], session: ArrayLike = 0) -> TapPool:
    """Pool of taps with these classes.

    Args:
        where: Position index of each tap, -1 for taps outside the grid, shape (N,).
        what: Object index of each tap, likewise.
        shape: (L, M).
        session: Number of the session, from 0 on, that episodes on each tap stay in, shape (N,) or (); see
            `episode_sessions`.

    Raises:
        InputError: No tap lies inside the grid.
    """
    where, what = np.asarray(where, dtype=np.intp), np.asarray(what, dtype=np.intp)
    L, M = shape
    inside = np.flatnonzero((where >= 0) & (what >= 0))
    if not len(inside):
        raise InputError("No tap belongs to a class of the grid.")
    s = np.broadcast_to(np.asarray(session, dtype=np.intp), where.shape)[inside]
    return pool_of(inside, (s * L + where[inside]) * M + what[inside], (int(s.max()) + 1, L, M))


def pool_of(taps: NDArray[np.intp], cell: NDArray[np.intp], shape: tuple[int, int, int]) -> TapPool:
    """Pool of some taps, possibly with repetitions.

    Args:
        taps: Tap indices, shape (n,).
        cell: Session and class of each as (s L + l) M + m, shape (n,).
        shape: (S, L, M).
    """
    count = np.bincount(cell, minlength=np.prod(shape)).reshape(shape)
    first = np.cumsum(count).reshape(shape) - count
    nearest = np.stack([nearest_trained(one > 0) for one in count])
    nearest = np.where(count.any(axis=1, keepdims=True), nearest, -1)
    return TapPool(taps[np.argsort(cell, kind="stable")], first, count, nearest)


def sessions_alike(cell: NDArray[np.intp], session: NDArray[np.integer]) -> bool:
    """Whether the sessions of taps hold the same classes.

    They do where at least nine tenths of the classes remain without any one of them; otherwise sessions cannot be told
    from classes.

    Args:
        cell: Class of each tap, shape (n,).
        session: Its session, shape (n,).
    """
    held = [np.unique(cell[session == s]) for s in np.unique(session)]
    sessions_with = np.bincount(np.concatenate(held))
    lost = max(np.count_nonzero(sessions_with[classes] == 1) for classes in held)
    return bool(_LOST * lost <= np.count_nonzero(sessions_with))


def episode_sessions(where: NDArray[np.intp], what: NDArray[np.intp], session: NDArray[np.integer]) -> NDArray[np.intp]:
    """Number of the session, from 0 on, that episodes on each tap stay in.

    0 for all taps where a session cannot stand alone: sessions hold different classes, or a class has fewer than
    `FEW_TAPS` taps in one (median). Episodes then draw taps of all.

    Args:
        where: Position index of each tap, -1 for taps outside the grid, shape (N,).
        what: Object index of each tap, likewise.
        session: Recorded session of each tap, shape (N,).
    """
    number, inside = np.zeros(len(where), np.intp), (where >= 0) & (what >= 0)
    if not inside.any():
        return number
    names, own = np.unique(session[inside], return_inverse=True)
    cell = where[inside] * (what.max() + 1) + what[inside]
    taps = np.unique(np.stack([own, cell]), axis=1, return_counts=True)[1]
    if len(names) > 1 and np.median(taps) >= FEW_TAPS and sessions_alike(cell, own):
        number[inside] = own
    return number
