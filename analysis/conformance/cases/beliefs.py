"""Cases about Bayes' rule, marginals, decisions and the program's own move: Eq. 3 to 8 and 10."""

from collections.abc import Iterator

import numpy as np

from ..case import Case
from .scene import Scene, make

_SMALL = Scene(L=4, M=3, K=2, J=2, B=6)
_FLAT = Scene(L=3, M=2, K=1, J=1, B=2)
_FLAT_EDGES = np.array([0.0, 1.0, 2.0])
_CROSSED = np.array([[0.30, 0.02], [0.03, 0.27], [0.12, 0.26]])  # cell (0, 0) is the largest, place 2 and object 1 are


def cases() -> Iterator[Case]:
    """All of them."""
    yield from _priors()
    yield from _impossible()
    yield from _decisions()
    yield from _ties()
    yield from _moves()
    yield from _single_sizes()


def _priors() -> Iterator[Case]:
    uneven = np.arange(1.0, 13.0).reshape(4, 3)
    yield make("prior-uneven", "The prior is not uniform.", (3, 4), _SMALL, prior=uneven / uneven.sum(), taps=5)
    holes = np.where(uneven % 4 > 0, uneven, 0.0)
    yield make("prior-holes", "Classes with prior 0 stay impossible.", (3,), _SMALL, prior=holes / holes.sum(), taps=5)
    certain = np.zeros((4, 3))
    certain[2, 1] = 1.0
    yield make(
        "prior-certain",
        "One class is certain from the start; a belief of 1 exceeds no threshold of 1.",
        (3, 7),
        _SMALL,
        prior=certain,
        thresholds=(0.0, 0.999, 1.0),
    )


def _impossible() -> Iterator[Case]:
    def tables(rows: list[list[float]]) -> dict[str, object]:
        return {"probabilities": np.array(rows).reshape(3, 2, 1, 2), "edges": _FLAT_EDGES}

    first = tables([[1.0, 0.0]] * 6)
    yield make(
        "impossible-tap",
        "The first tap is impossible under every class.",
        (3,),
        _FLAT,
        taps=[[[1.5]], [[0.5]]],
        **first,
    )
    later = tables([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0], [1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])
    yield make(
        "impossible-later",
        "The second tap leaves one class, the third contradicts it.",
        (3,),
        _FLAT,
        taps=[[[0.5]], [[1.5]], [[1.5]]],
        prior=np.array([[0.2, 0.0], [0.3, 0.1], [0.1, 0.3]]),
        **later,
    )
    yield make(
        "impossible-by-prior",
        "A tap is possible only under a class with prior 0.",
        (3,),
        _FLAT,
        taps=[[[1.5]]],
        prior=np.array([[0.5, 0.5], [0.0, 0.0], [0.0, 0.0]]),
        **tables([[1.0, 0.0], [1.0, 0.0], [0.5, 0.5], [0.5, 0.5], [0.5, 0.5], [0.5, 0.5]]),
    )


def _decisions() -> Iterator[Case]:
    flat = {"probabilities": np.full((3, 2, 1, 2), 0.5), "edges": _FLAT_EDGES}
    yield make(
        "marginals-not-joint",
        "The most probable joint class is in neither the most probable place nor object.",
        (5, 6, 7, 8),
        _FLAT,
        prior=_CROSSED,
        taps=[[[0.5]]],
        thresholds=(0.3, 0.5, 0.6),
        fixation=2,
        **flat,
    )
    yield make(
        "evidence",
        "All classes are alike: the belief stays, and the evidence of a tap is its likelihood.",
        (4,),
        _FLAT,
        prior=_CROSSED,
        probabilities=np.tile([0.25, 0.75], (3, 2, 1, 1)),
        edges=_FLAT_EDGES,
        taps=[[[0.5]], [[1.5]], [[0.5]]],
        thresholds=(1.0,),
        theta_x=1.0,
    )
    yield make(
        "marginals",
        "The belief is that of the prior; nothing is decided and nothing moves.",
        (5, 6),
        _FLAT,
        prior=_CROSSED,
        taps=[[[0.5]]],
        thresholds=(1.0,),
        theta_x=1.0,
        **flat,
    )
    for word, step in (("below", -1e-8), ("above", 1e-8)):
        yield make(
            f"thresholds-just-{word}",
            f"Thresholds lie {word} the belief in the object (0.55) and in the place (0.38) by 1e-8.",
            (7, 8),
            _FLAT,
            prior=_CROSSED,
            taps=[[[0.5]]],
            thresholds=(0.55 + step,),
            theta_x=0.38 + step,
            fixation=0,
            **flat,
        )
    yield make(
        "thresholds",
        "Many thresholds, in no order, one of them 0 and one 1; the belief ends at 1.",
        (7,),
        Scene(L=4, M=3, K=4, J=2, B=6),
        thresholds=(0.9, 0.0, 0.2, 1.0, 0.5, 0.99999),
        power="none",
        taps=30,
    )
    yield make(
        "thresholds-undone",
        "The belief in an object rises above thresholds and falls again.",
        (7,),
        _FLAT,
        probabilities=np.array([[0.9, 0.1], [0.2, 0.8]] * 3).reshape(3, 2, 1, 2),
        edges=_FLAT_EDGES,
        taps=[[[0.5]]] * 3 + [[[1.5]]] * 4,
        thresholds=(0.5, 0.9, 0.95),
    )
    yield make(
        "threshold-reached",
        "A belief equals the threshold exactly; rounding may put it above or below.",
        (7,),
        _FLAT,
        taps=[[[0.5]]],
        thresholds=(0.5, 0.25, 0.75),
        theta_x=1 / 3,
        **flat,
    )


def _ties() -> Iterator[Case]:
    alike = np.full((3, 2), 1 / 6)
    tables = np.array([[0.5, 0.5], [0.5, 0.5], [0.25, 0.75], [0.25, 0.75], [0.5, 0.5], [0.5, 0.5]]).reshape(3, 2, 1, 2)
    yield make(
        "ties",
        "Objects are alike, and two places are; of equal beliefs the lowest index counts.",
        (7, 8),
        _FLAT,
        prior=alike,
        probabilities=tables,
        edges=_FLAT_EDGES,
        taps=[[[0.5]], [[0.5]]],
        thresholds=(0.25, 0.4),
        fixation=2,
        strict_ties=True,
    )
    near = alike * np.array([[1.0, 1.0 + 1e-12], [1.0, 1.0], [1.0, 1.0]])
    yield make(
        "near-ties",
        "Beliefs differ by a part in 10^12; any of them may count.",
        (7, 8),
        _FLAT,
        prior=near / near.sum(),
        probabilities=np.full((3, 2, 1, 2), 0.5),
        edges=_FLAT_EDGES,
        taps=[[[0.5]]],
        thresholds=(0.25, 0.4),
    )


def _moves() -> Iterator[Case]:
    yield make(
        "move-always",
        "theta_X is 0: there is always a move to the fixation point.",
        (8, 10),
        _SMALL,
        theta_x=0.0,
        fixation=2,
    )
    yield make(
        "move-never",
        "theta_X is 1: there is never a move, how certain the place may be.",
        (8,),
        _SMALL,
        theta_x=1.0,
        power="none",
        fixation=3,
        taps=12,
    )
    yield make(
        "move-sometimes",
        "theta_X lies between, and is always exceeded.",
        (8, 10),
        _SMALL,
        theta_x=0.55,
        fixation=3,
        taps=6,
    )
    yield make(
        "move-undone",
        "The belief in a place rises above theta_X and falls again, twice.",
        (8, 10),
        _FLAT,
        probabilities=np.repeat([[0.9, 0.1], [0.5, 0.5], [0.1, 0.9]], 2, axis=0).reshape(3, 2, 1, 2),
        edges=_FLAT_EDGES,
        taps=[[[0.5]]] * 2 + [[[1.5]]] * 4,
        thresholds=(0.8,),
        theta_x=0.72,
        fixation=2,
    )
    for name, about, theta_x in (
        ("move-not-by-object", "theta_X lies between the beliefs in the place (0.38) and in the object (0.55).", 0.45),
        (
            "move-not-by-joint",
            "theta_X lies between the beliefs in the class (0.30) and in the place (0.38).",
            0.35,
        ),
    ):
        yield make(
            name,
            about,
            (8,),
            _FLAT,
            prior=_CROSSED,
            probabilities=np.full((3, 2, 1, 2), 0.5),
            edges=_FLAT_EDGES,
            taps=[[[0.5]]],
            theta_x=theta_x,
            fixation=0,
        )
    yield make("fixation-first", "The fixation point is the first place.", (10,), _SMALL, fixation=0, start=(3, 1))
    yield make("fixation-last", "The fixation point is the last place.", (10,), _SMALL, fixation=3, start=(0, 1))


def _single_sizes() -> Iterator[Case]:
    sizes = {"L": 5, "M": 3, "K": 4, "J": 2, "B": 8}
    names = {"L": "place", "M": "object", "K": "taxel", "J": "sample", "B": "bin"}
    for letter, word in names.items():
        yield make(
            f"one-{word}",
            f"There is one {word}.",
            (1, 3, 7, 10),
            Scene(**(sizes | {letter: 1})),
            thresholds=(0.5, 1.0),
            own_moves=True,
            taps=5,
            start=(0, 0),
        )
    yield make(
        "one-of-all",
        "There is one class, taxel, sample and bin.",
        (1, 3, 7, 10),
        Scene(L=1, M=1, K=1, J=1, B=1),
        thresholds=(0.0, 0.5, 1.0),
        taps=3,
        start=(0, 0),
    )
