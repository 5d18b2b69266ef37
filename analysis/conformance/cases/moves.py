"""Cases about the shift of the belief at every border, and whole episodes: Eq. 9 and all together."""

from collections.abc import Iterator

import numpy as np

from ....inference.reference import BORDERS
from ..case import Case
from .scene import Scene, make

_PLACES = 5
_SHIFTED = Scene(L=_PLACES, M=3, K=1, J=1, B=1)
_EDGES = np.array([0.0, 8.0])
_ALL = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)


_KNOWN = np.array([[1, 1, 0], [0, 1, 0], [1, 1, 1], [1, 0, 0], [0, 1, 0]], dtype=bool)
"""Classes of the cases with holes: one object with three of five places, one with all but one, one with one only."""


def cases() -> Iterator[Case]:
    """All of them."""
    for border in BORDERS:
        yield from _shifts(border)
        yield from _holes(border)
    yield from _episodes()


def _shifts(border: str) -> Iterator[Case]:
    word = border.replace("_", "-")
    weights = np.arange(1.0, 1.0 + 3 * _PLACES).reshape(_PLACES, 3) ** 2
    plain = {
        "prior": weights / weights.sum(),
        "probabilities": np.ones((_PLACES, 3, 1, 1)),
        "edges": _EDGES,
        "border": border,
    }
    yield make(
        f"shift-{word}",
        f"Moves to both ends under border {border}; taps tell nothing.",
        (9,),
        _SHIFTED,
        moves=[0, 1, -1, 2, -3, 4, -4],
        taps=7,
        **plain,
    )
    for name, move in (("up", _PLACES), ("down", -_PLACES), ("far", 7 * _PLACES + 2)):
        yield make(
            f"shift-{word}-{name}",
            f"A move by {move:+d} of {_PLACES} places under border {border}.",
            (9,),
            _SHIFTED,
            moves=[0, move],
            taps=2,
            **plain,
        )
    yield make(
        f"shift-{word}-one-place",
        f"A range of one place under border {border}.",
        (9,),
        Scene(L=1, M=3, K=2, J=2, B=4),
        border=border,
        moves=[0, 1, -2, 0],
        taps=4,
        start=(0, 1),
    )
    certain = np.zeros((_PLACES, 3))
    certain[_PLACES - 1, 2] = 1.0
    yield make(
        f"shift-{word}-certain",
        f"All belief leaves the range under border {border}, or none of it.",
        (9,),
        _SHIFTED,
        **(plain | {"prior": certain}),
        moves=[0, -2, 1, 3],
        taps=4,
    )


def _holes(border: str) -> Iterator[Case]:
    """Grids on which some classes were never trained."""
    word = border.replace("_", "-")
    weights = np.where(_KNOWN, np.arange(1.0, 1.0 + 3 * _PLACES).reshape(_PLACES, 3) ** 2, 0.0)
    yield make(
        f"shift-{word}-holes",
        f"Untrained classes, and moves under border {border}; taps tell nothing else.",
        (9,),
        _SHIFTED,
        prior=weights / weights.sum(),
        probabilities=np.where(_KNOWN[..., np.newaxis, np.newaxis], 1.0, 0.0),
        edges=_EDGES,
        border=border,
        moves=[0, 1, -1, 2, -3, 4, -4, 2 * _PLACES + 1, -_PLACES],
        taps=9,
    )
    yield make(
        f"episode-{word}-holes",
        f"Every second class is untrained; eight taps with their moves under border {border}.",
        _ALL,
        Scene(L=6, M=3, K=3, J=2, B=6),
        holes=[(l, m) for l in range(6) for m in range(3) if (l + m) % 2],
        start=(1, 1),
        border=border,
        own_moves=True,
        taps=8,
    )


def _episodes() -> Iterator[Case]:
    for border in BORDERS:
        yield make(
            f"episode-{border.replace('_', '-')}",
            f"Twelve taps with their moves under border {border}.",
            _ALL,
            border=border,
            own_moves=True,
            taps=12,
        )
    yield make("episode-passive", "Twelve taps without a move.", _ALL, theta_x=1.0, taps=12)
    yield make(
        "episode-other-moves",
        "Moves that the program would not have made, some past the ends.",
        _ALL,
        moves=[0, 2, 2, -1, -4, 1, 6, -6, 3, 0],
        taps=10,
    )
    yield make(
        "episode-product", "Twelve taps without a root.", _ALL, power="none", own_moves=True, taps=12, border="clamp"
    )
    yield make(
        "episode-uneven-places",
        "Places are unevenly spaced; moves count classes, not millimetres.",
        _ALL,
        where_value=(0.0, 0.5, 3.0, 3.25, 10.0),
        own_moves=True,
        taps=8,
    )
    yield make(
        "episode-uneven-prior",
        "An uneven prior, moves at belief above 0.4 only.",
        _ALL,
        theta_x=0.4,
        own_moves=True,
        taps=12,
        prior=_rising(5, 3),
    )
    yield make(
        "episode-long",
        "Two hundred taps that move.",
        _ALL,
        Scene(L=6, M=4, K=3, J=2, B=8),
        own_moves=True,
        taps=200,
        answered=(*range(1, 21), *range(40, 201, 20)),
    )
    yield make(
        "episode-paper-size",
        "The paper's sizes: 16 places, 5 objects, 12 taxels, 50 samples, 100 bins.",
        _ALL,
        Scene(L=16, M=5, K=12, J=50, B=100, training=4),
        own_moves=True,
        taps=10,
    )


def _rising(L: int, M: int) -> np.ndarray:
    weights = np.arange(1.0, L * M + 1).reshape(L, M)
    return weights / weights.sum()
