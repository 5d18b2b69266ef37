"""What is said of a finger at rest, and of one that could not be lifted."""

from typing import Any

from ...models.extras import MissingPackageError
from ..errors import NotAtRest, RigError


def still_pressing(trouble: BaseException, worse: RigError) -> NotAtRest:
    """Error for a finger that could not be lifted after a failure."""
    first = str(trouble).rstrip(".") if isinstance(trouble, Exception) else "Interrupted"
    again = "" if str(worse) == str(trouble) else f" {worse}"
    return NotAtRest(f"{first or type(trouble).__name__}. The finger may still be pressing; lift it by hand.{again}")


def never_opened(trouble: BaseException, rig: Any) -> bool:
    """Whether no device of a `Rig` was opened, as a package is missing, so that nothing has moved."""
    return isinstance(trouble, MissingPackageError) and rig.stage.report is None


def resting_place(position_mm: tuple[float, float] | None = None, may_press: bool = True, touches: bool = False) -> str:
    """Where the finger is, as a sentence.

    Args:
        position_mm: x and y in the rig frame; `None` if that is not known.
        may_press: Whether it is nearer to the object than `tap.clear_mm`.
        touches: Whether its last readings are those of a finger that touches something.
    """
    if position_mm is None:
        return "Finger position unknown: switch the power off before touching it."
    place = f"at y = {position_mm[1]:z.1f} mm"
    if may_press:
        return f"Finger {place}, beyond tap.clear_mm: it may press on the object."
    if touches:
        return f"Finger {place}, where its readings are those of a touch."
    return f"Finger off the object {place}."
