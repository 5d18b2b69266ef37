"""Recorded taps for tests of a fitted model, without its training taps."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...models.measurement.model import TapModel
    from ...models.taps import TapSet


def untrained(model: "TapModel", taps: "TapSet", keep: bool) -> "TapSet":
    """Taps that did not train the model; reports on standard error which did.

    Args:
        model: The fitted model.
        taps: Recorded taps.
        keep: Whether to keep training taps, as with `--training-taps`.

    Raises:
        InputError: No tap is left, or the taps do not fit the model.
    """
    from ...models.splits import missing_sentence
    from ...models.training import untrained_taps

    model.check_tapset(taps)
    rest, sentence = untrained_taps(taps, model.training, keep)
    lacking = missing_sentence([rest], "recorded taps")
    for told in filter(None, (sentence, lacking and f"Note: {lacking}")):
        print(told, file=sys.stderr)
    return rest
