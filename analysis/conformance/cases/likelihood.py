"""Cases about bins, histograms and the likelihood of a tap: Eq. 1 and 2."""

from collections.abc import Iterator

import numpy as np

from ..case import Case
from .scene import Scene, make, numbers

_WHOLE = Scene(L=3, M=2, K=2, J=3, B=4, training=5)
_EDGES = np.array([0.0, 1.0, 2.0, 4.0, 8.0])
_COUNTS = np.arange(48).reshape(3, 2, 2, 4) * 7 % 11 + 1


def cases() -> Iterator[Case]:
    """All of them."""
    yield from _roots()
    yield from _bins()
    yield from _histograms()
    yield from _tables()
    yield from _fits()


def _roots() -> Iterator[Case]:
    yield make("root-j", "The likelihood is the J-th root of the product, as printed.", (1,), power="J")
    yield make("root-jk", "The likelihood is the root over samples and taxels.", (1,), power="JK")
    yield make("root-none", "The likelihood is the product itself.", (1,), power="none")
    yield make("root-number", "The exponent is a number.", (1,), power=0.37)


def _bins() -> Iterator[Case]:
    def on(name: str, about: str, samples: list[list[float]], **changes: object) -> Case:
        taps = [[[value, 3.0], [3.0, value], [5.0, 0.5]] for row in samples for value in row]
        return make(name, about, (2,), _WHOLE, **({"edges": _EDGES, "counts": _COUNTS, "taps": taps} | changes))

    yield on(
        "bins-on-edges",
        "A sample on an edge belongs to the bin above, on the last edge to the last.",
        [_EDGES.tolist()],
    )
    yield on("bins-outside", "Samples outside the range go to the end bins.", [[-0.5, -1e300, 8.5, 1e300, 9.0]])
    yield on(
        "bins-beside-edges", "The next double below an edge is below it.", [np.nextafter(_EDGES[1:], 0.0).tolist()]
    )
    yield on(
        "bins-negative",
        "Ranges may lie below zero.",
        [[-8.0, -7.5, -0.1, 0.0]],
        edges=np.array([-8.0, -6.0, -3.0, -0.25, 0.0]),
    )
    yield on(
        "bins-of-each-taxel",
        "Edges may be given for each taxel.",
        [[0.5, 1.5, 3.0, 7.0]],
        edges=np.array([[0.0, 1.0, 2.0, 4.0, 8.0], [0.0, 2.5, 2.75, 6.5, 10.0]]),
    )


def _histograms() -> Iterator[Case]:
    gaps = _COUNTS * (_COUNTS % 3 > 0)
    samples = [[[0.5, 1.5], [3.0, 0.5], [5.0, 0.5]], [[1.5, 3.0], [0.5, 5.0], [3.0, 3.0]]]
    fields = {"edges": _EDGES, "taps": samples}
    yield make(
        "empty-bins",
        "Empty bins have the pseudocount.",
        (1, 2),
        _WHOLE,
        counts=gaps,
        pseudocount=0.01,
        power="none",
        **fields,
    )
    yield make(
        "empty-bins-as-printed",
        "Without a pseudocount a sample in an empty bin makes its class impossible, and it stays so.",
        (1, 2, 3),
        _WHOLE,
        counts=_with_one_possible(gaps),
        pseudocount=0.0,
        **fields,
    )
    yield make(
        "large-pseudocount",
        "The pseudocount is added to every bin, not to the sum.",
        (2,),
        _WHOLE,
        counts=gaps,
        pseudocount=10.0,
        **fields,
    )
    yield make(
        "small-pseudocount",
        "Empty bins have a pseudocount of 1e-12, and no other least probability.",
        (2,),
        _WHOLE,
        counts=gaps,
        pseudocount=1e-12,
        **fields,
    )
    hollow = _COUNTS.copy()
    hollow[1, 0, 1] = 0
    yield make(
        "empty-histogram",
        "A histogram without a sample is flat.",
        (2,),
        _WHOLE,
        counts=hollow,
        pseudocount=0.5,
        **fields,
    )
    classes = 10 ** np.arange(6).reshape(3, 2, 1, 1)
    yield make(
        "uneven-classes",
        "Classes have 10 to a million training samples; each histogram is divided by its own sum.",
        (2,),
        _WHOLE,
        counts=_COUNTS * classes,
        **fields,
    )
    yield make("large-counts", "Counts up to 10^12.", (2,), _WHOLE, counts=_COUNTS * 10**11, **fields)


def _with_one_possible(counts: np.ndarray) -> np.ndarray:
    """The counts with class (0, 0) filled."""
    filled = counts.copy()
    filled[0, 0] += 1
    return filled


def _tables() -> Iterator[Case]:
    random = numbers("tables")
    weights = np.array([random.uniform(0.05, 1.0) for _ in range(48)]).reshape(3, 2, 2, 4)
    fields = {"edges": _EDGES, "taps": [[[0.5, 1.5], [3.0, 0.5], [5.0, 0.5]]]}
    yield make(
        "tables",
        "Probabilities are given.",
        (1,),
        _WHOLE,
        probabilities=weights / weights.sum(axis=-1, keepdims=True),
        **fields,
    )
    yield make(
        "tables-as-given",
        "Tables that do not sum to one are used as they are.",
        (1,),
        _WHOLE,
        probabilities=weights,
        **fields,
    )
    tiny = weights / weights.sum(axis=-1, keepdims=True)
    tiny[..., 0], tiny[1, :, :, 1] = 1e-30, 1e-300
    tiny /= tiny.sum(axis=-1, keepdims=True)
    yield make(
        "tables-tiny",
        "Probabilities of about 1e-30 and 1e-300 are no zeros.",
        (1,),
        _WHOLE,
        probabilities=tiny,
        power="none",
        **fields,
    )
    close = 0.25 + 1e-9 * (weights - weights.mean(axis=-1, keepdims=True))
    yield make(
        "tables-nearly-equal",
        "Classes differ by a part in 10^9, for 30 taps.",
        (1, 3),
        _WHOLE,
        probabilities=close,
        power="none",
        edges=_EDGES,
        taps=fields["taps"] * 30,
    )


def _fits() -> Iterator[Case]:
    scene = Scene(L=3, M=2, K=3, J=2, B=5, training=3)
    random = numbers("fit")
    training = scene.fit_taps(random)
    low, high = training.taps.min(), training.taps.max()
    yield make(
        "fit", "Edges and counts come from taps: one range over all taxels and classes.", (2,), scene, training=training
    )
    outside = [scene.tap(1, 1, random) + shift for shift in (0.0, high - low, low - high)]
    yield make(
        "fit-outside", "Later taps leave the range of the training taps.", (2,), scene, training=training, taps=outside
    )
    apart = training.taps.copy()
    highest, lowest = (
        np.flatnonzero((training.where == l) & (training.what == m))[0] for l, m in ((0, 1), (scene.L - 2, 0))
    )
    apart[highest, 1, 0], apart[lowest, 0, scene.K - 2] = 11.0, -3.0
    yield make(
        "fit-range",
        "The largest and the smallest training sample are of different taxels, places and objects.",
        (2,),
        scene,
        training=training._replace(taps=apart),
    )
    whole = np.round((training.taps - low) / (high - low) * 8.0)
    yield make(
        "fit-on-edges",
        "Training samples lie on edges, smallest and largest among them.",
        (2,),
        scene,
        training=training._replace(taps=whole),
        bins=8,
        taps=[whole[3], whole[7]],
    )
