"""Cases at the limits of floating point: long sequences, tiny beliefs, and limits of 32 bits."""

from collections.abc import Iterator

import numpy as np

from ..case import Case
from .scene import Scene, make

_PAIR = Scene(L=3, M=2, K=1, J=1, B=4)
_PAIR_EDGES = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
_TABLES = np.array(
    [
        [[0.60, 0.20, 0.15, 0.05], [0.05, 0.15, 0.30, 0.50]],
        [[0.40, 0.30, 0.20, 0.10], [0.10, 0.20, 0.30, 0.40]],
        [[0.35, 0.35, 0.20, 0.10], [0.10, 0.15, 0.35, 0.40]],
    ]
).reshape(3, 2, 1, 4)


def cases() -> Iterator[Case]:
    """All of them."""
    yield from _long()
    yield from _tiny()
    yield from _single()


def _long() -> Iterator[Case]:
    returns = [[[1.0]]] * 600 + [[[7.0]]] * 900
    yield make(
        "long-and-back",
        "600 taps speak for one object and 900 for the other: beliefs fall to e^-1400 and come back.",
        (3,),
        _PAIR,
        probabilities=_TABLES,
        edges=_PAIR_EDGES,
        taps=returns,
        answered=(1, 10, 100, 599, *range(600, 1501, 50)),
    )
    longest = [[[1.0]]] * 4000 + [[[7.0]]] * 6000
    yield make(
        "ten-thousand-taps",
        "10 000 taps: beliefs fall to e^-10000 and come back.",
        (3,),
        _PAIR,
        probabilities=_TABLES,
        edges=_PAIR_EDGES,
        taps=longest,
        answered=(1, 10, 100, 1000, *range(4000, 10001, 500)),
    )
    back_and_forth = [0, *([1, -1] * 500)][:1000]
    for border in ("clamp", "uniform_what", "circular"):
        yield make(
            "thousand-moves" if border == "clamp" else f"thousand-moves-{border.replace('_', '-')}",
            f"A thousand taps, each behind a move, with border {border}.",
            (3, 9),
            _PAIR,
            probabilities=_TABLES,
            edges=_PAIR_EDGES,
            taps=[[[1.0]]] * 500 + [[[7.0]]] * 500,
            moves=back_and_forth,
            border=border,
            answered=(1, 10, 100, *range(500, 1001, 50)),
        )


def _tiny() -> Iterator[Case]:
    scene = Scene(L=3, M=2, K=6, J=150, B=4)
    tables = np.repeat(_TABLES, 6, axis=2)
    yield make(
        "tap-underflows",
        "One tap of 900 samples without a root: its likelihood is below e^-745 under every class.",
        (1,),
        scene,
        probabilities=tables,
        edges=_PAIR_EDGES,
        power="none",
        taps=[np.full((150, 6), 3.0), np.full((150, 6), 5.0)],
    )
    rising = np.reshape([[0.04, 0.32, 0.32, 0.32], [0.94, 0.02, 0.02, 0.02]], (2, 1, 4))
    tiny = np.array([[1.0, 5e-324], [1e-320, 1e-310], [2e-308, 0.0]])
    yield make(
        "subnormal-prior",
        "Priors below the smallest normal double; taps bring the smallest to the top.",
        (3,),
        _PAIR,
        prior=tiny,
        probabilities=np.broadcast_to(rising, (3, 2, 1, 4)),
        edges=_PAIR_EDGES,
        taps=[[[1.0]]] * 260,
        answered=(1, 2, 50, 100, *range(200, 261, 10)),
    )
    deep = np.array([[1.0, 1e-200], [1e-250, 1e-300], [1e-100, 1e-150]])
    yield make(
        "tiny-marginals",
        "Beliefs of 1e-100 to 1e-300 within a marginal.",
        (5, 6),
        _PAIR,
        prior=deep / deep.sum(),
        probabilities=_TABLES,
        edges=_PAIR_EDGES,
        taps=[[[3.0]], [[7.0]]],
    )


def _single() -> Iterator[Case]:
    edge = 2.0 + 2.0**-40
    yield make(
        "single-edges",
        "Samples lie nearer to an edge than 32 bits can tell.",
        (2,),
        _PAIR,
        probabilities=_TABLES,
        edges=np.array([0.0, edge, 4.0, 6.0, 8.0]),
        taps=[[[2.0]], [[edge]], [[2.0 + 2.0**-39]]],
    )
    yield make(
        "single-range",
        "A prior below the smallest number of 32 bits, and taps that bring it back.",
        (3,),
        _PAIR,
        prior=np.array([[1.0, 1e-60], [0.0, 0.0], [0.0, 0.0]]),
        probabilities=_TABLES,
        edges=_PAIR_EDGES,
        taps=[[[7.0]]] * 90,
        answered=(1, 2, *range(10, 91, 10)),
    )
