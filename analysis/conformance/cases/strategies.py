"""Cases about the next move by expected information: which position tells most about object, position or both."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..case import Case
from ..information import STRATEGIES
from .scene import Scene, make, numbers

_SCENE = Scene(L=5, M=3, K=3, J=2, B=8)
_SMALL = Scene(L=3, M=2, K=1, J=1, B=4)
_POOL = 9


def cases() -> Iterator[Case]:
    """All of them."""
    for strategy in STRATEGIES:
        about = f"The next move is the one of most expected {_ABOUT[strategy]}."
        yield _case(strategy, about, strategy, power="JK")  # so that beliefs stay open
    for border in ("uniform_what", "clamp", "circular"):
        name = f"info-what-{border.replace('_', '-')}"
        yield _case(name, f"Information about the object after moves with border {border}.", "info-what", border=border)
    yield _case(
        "info-holes",
        "Classes are untrained: belief does not move into them, and no tap comes from them.",
        "info-joint",
        holes=[(0, 1), (2, 0), (4, 2), (4, 1)],
        start=(1, 2),
    )
    yield _case(
        "info-product", "Taps of the pool have likelihoods without a root, nearly 0 or 1.", "info-joint", power="none"
    )
    yield _case(
        "info-normal",
        "The pool has probabilities of normal distributions.",
        "info-where",
        mean=_levels("info-normal"),
        sd=np.full((_SCENE.L, _SCENE.M, _SCENE.K), 1.5),
        power="JK",
    )
    yield _case(
        "info-pool-of-one",
        "One tap alone can come, so no move tells anything; rounding may favour any.",
        "info-joint",
        pool=_taps("info-pool-of-one", 1),
    )
    yield from _impossible()


_ABOUT = {
    "info-what": "information about the object",
    "info-where": "information about the position",
    "info-joint": "information about object and position together",
}


def _case(name: str, about: str, strategy: str, **changes: Any) -> Case:
    given = {"moves": [0, 1, -1, 2], "taps": 4, "pool": _taps(name, _POOL), **changes}
    return make(name, about, (5, 9), _SCENE, strategy=strategy, **given)


def _taps(name: str, count: int) -> np.ndarray:
    """Taps of different classes."""
    random = numbers(f"{name} pool")
    return np.array([_SCENE.tap(n % _SCENE.L, n % _SCENE.M, random) for n in range(count)])


def _levels(name: str) -> np.ndarray:
    random = numbers(f"{name} mean")
    taps = [_SCENE.tap(l, m, random).mean(axis=0).round(3) for l, m in np.ndindex(_SCENE.L, _SCENE.M)]
    return np.reshape(taps, (_SCENE.L, _SCENE.M, _SCENE.K))


def _impossible() -> Iterator[Case]:
    """No tap of the pool is possible in some classes; belief in them is left out."""
    tables = np.array(
        [
            [[0.5, 0.25, 0.25, 0.0], [0.0, 0.0, 0.25, 0.75]],
            [[0.25, 0.5, 0.0, 0.25], [0.0, 0.125, 0.125, 0.75]],
            [[0.0, 0.0, 0.5, 0.5], [0.375, 0.125, 0.25, 0.25]],
        ]
    ).reshape(3, 2, 1, 4)
    yield make(
        "info-impossible-pool",
        "No tap of the pool can come from some classes; belief in them is left out of the information.",
        (5, 9),
        _SMALL,
        probabilities=tables,
        prior=np.array([[0.25, 0.125], [0.1875, 0.125], [0.1875, 0.125]]),
        taps=[[[5.0]], [[7.0]], [[5.0]]],
        moves=[0, 1, -1],
        strategy="info-what",
        pool=np.array([[[1.0]], [[3.0]]]),
    )
