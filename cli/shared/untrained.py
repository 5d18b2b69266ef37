"""Recorded taps that a fitted model is played on, without those that trained it."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...models.measurement.model import TapModel
    from ...models.taps import TapSet


def untrained(model: "TapModel", taps: "TapSet", keep: bool) -> "TapSet":
    """The taps that did not train the model; says on standard error which did.

    Args:
        model: The fitted model.
        taps: Recorded taps.
        keep: What `--training-taps` says: whether to play those that did all the same.

    Raises:
        InputError: No tap is left.
    """
    from ...models.training import untrained_taps

    rest, sentence = untrained_taps(taps, model.training, keep)
    if sentence:
        print(sentence, file=sys.stderr)
    return rest
