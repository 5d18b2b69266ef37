"""Cases with normal distributions in place of histograms: the probability of a bin is an integral over it."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..case import Case
from .scene import Scene, make, numbers

_SCENE = Scene(L=4, M=3, K=2, J=2, B=16)
_FINE = Scene(L=3, M=2, K=2, J=3, B=64)
_ALL = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)


def cases() -> Iterator[Case]:
    """All of them."""
    yield make(
        "normal",
        "Samples are normal, with a mean and a standard deviation of each class and taxel.",
        (1,),
        _SCENE,
        **_normal("normal", _SCENE),
    )
    yield make(
        "normal-ends",
        "The end bins reach to infinity, and samples beyond the range go to them.",
        (1, 2),
        _SCENE,
        **_normal("normal-ends", _SCENE),
        taps=[[[-3.0, 9.0], [0.0, 8.0]], [[8.5, -0.25], [7.75, 0.25]], [[100.0, -100.0], [0.25, 7.5]]],
    )
    yield make(
        "normal-tails",
        "Bins lie up to 160 standard deviations from a mean: logarithms of probabilities down to -13 000.",
        (1, 3),
        _FINE,
        **_normal("normal-tails", _FINE, sd=(0.05, 0.06)),
        power="none",
    )
    yield make(
        "normal-far",
        "Means lie far below or above the range, so that all inner bins are in a tail.",
        (1,),
        _SCENE,
        **(_normal("normal-far", _SCENE, sd=(1.5, 2.5)) | {"mean": _far(_SCENE)}),
    )
    yield make(
        "normal-wide",
        "Standard deviations are a thousand times the range: inner bins differ by a part in a million.",
        (1,),
        _SCENE,
        **_normal("normal-wide", _SCENE, sd=(8e3, 9e3)),
        taps=12,
    )
    edges = np.array([[8.0 * b / 16 for b in range(17)], [8.0 * (b / 16) ** 2 for b in range(17)]])
    yield make(
        "normal-of-each-taxel",
        "Edges are given for each taxel, unevenly; the root is over samples and taxels.",
        (1, 2),
        _SCENE,
        **_normal("normal-of-each-taxel", _SCENE),
        edges=edges,
        power="JK",
    )
    yield make(
        "normal-episode",
        "Ten taps with moves, some past the ends, with border clamp.",
        _ALL,
        _SCENE,
        **_normal("normal-episode", _SCENE, sd=(0.8, 1.4)),
        border="clamp",
        moves=[0, 1, 1, -2, 3, 1, -1, -4, 0, 2],
        taps=10,
    )


def _normal(name: str, scene: Scene, sd: tuple[float, float] = (0.5, 1.5)) -> dict[str, Any]:
    """Means near those of a scene and standard deviations in a range, all with few digits."""
    random, shape = numbers(f"{name} normal"), (scene.L, scene.M, scene.K)
    means = [scene.tap(l, m, random).mean(axis=0).round(3) for l, m in np.ndindex(shape[:2])]
    deviations = [round(random.uniform(*sd), 4) for _ in range(np.prod(shape))]
    return {"mean": np.reshape(means, shape), "sd": np.reshape(deviations, shape)}


def _far(scene: Scene) -> np.ndarray:
    """Means 20 to 40 below or above the middle of the range."""
    l, m, k = np.indices((scene.L, scene.M, scene.K))
    return 4.0 + np.where((m + k) % 2, 20.0 + 2 * l, -25.0 - 3 * l - m)
