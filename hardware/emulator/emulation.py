"""An emulated bench with something before the finger, and the orders that it takes.

Orders are small mappings, as JSON has them:

- `{"object": 2}` puts an object before the finger, by number or name; `{"object": null}` takes it away
- `{"on": "unplug", "port": "sensor", "times": 1, "seconds": 2.0}` switches a fault on
- `{"off": "unplug"}` switches it off again, `{"off": null}` all of them
- `{}` changes nothing

Each is answered with the state of the bench.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from ...models.errors import InputError
from ..link.shared_clock import Advanced
from .bench import Bench
from .faults import Switches


class Touching(Protocol):
    """A finger with something before it."""

    @property
    def what(self) -> int | None:
        """Index of the object before it, None for nothing."""
        ...

    @what.setter
    def what(self, what: int | None) -> None: ...


class Emulation:
    """What a shared clock is connected to when the devices are in this process.

    Args:
        bench: The devices and their time.
        switches: Faults.
        finger: What touches.
        place_mm: Where the finger truly stands in the rig frame at a time.
        objects: Names of the objects.

    Attributes:
        bench: The devices and their time.
        switches: Faults; those of a port that nobody has open begin with the next order or when time goes on.
        finger: What touches.
        objects: Names of the objects.
    """

    def __init__(
        self,
        bench: Bench,
        switches: Switches,
        finger: Touching,
        place_mm: Callable[[float], tuple[float, float]],
        objects: Sequence[str],
    ) -> None:
        self.bench = bench
        self.switches = switches
        self.finger = finger
        self.objects = tuple(objects)
        self._place_mm = place_mm

    def advance(self, until_s: float, sent: Mapping[str, int]) -> Advanced:
        """Lets time go on until a device writes, and to `until_s` at the latest.

        Raises:
            InputError: There is no such port, or no such time.
        """
        return self.bench.advance(until_s, sent)

    def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Carries out an order and answers with the state.

        Raises:
            InputError: There is no such order, object or fault.
        """
        match dict(order):
            case {"object": what, **rest} if not rest:
                self.finger.what = None if what is None else self._object(what)
            case {"on": str(name), **parameters}:
                self._switch_on(name, parameters)
            case {"off": str(name), **rest} if not rest:
                self.switches.off(name)
            case {"off": None, **rest} if not rest:
                self.switches.clear()
            case rest if rest:
                raise InputError(f"The emulator knows no order {dict(order)}, only object, on and off.")
        self.bench.settle()
        return self.state()

    def state(self) -> dict[str, Any]:
        """Time, true place, object and what went wrong so far, as JSON has it."""
        what, links = self.finger.what, self.bench.links
        return {
            "now_s": self.bench.now_s,
            "place_mm": list(self._place_mm(self.bench.now_s)),
            "object": what,
            "object_name": None if what is None else self.objects[what],
            "objects": list(self.objects),
            "faults": list(self.switches),
            "struck": dict(self.switches.tally()),
            "open": {link.name: link.is_open for link in links},
            "overrun": {link.name: link.terminal.overrun for link in links},
        }

    def _object(self, what: Any) -> int:
        if what in self.objects:
            return self.objects.index(what)
        if isinstance(what, int) and not isinstance(what, bool) and 0 <= what < len(self.objects):
            return what
        raise InputError(f"There is no object {what!r}; the objects are {', '.join(self.objects)}, counted from 0.")

    def _switch_on(self, name: str, parameters: dict[str, Any]) -> None:
        try:
            self.switches.on(name, **parameters)
        except TypeError as error:
            raise InputError(f"Fault {name}: {parameters} are no parameters for it.") from error
