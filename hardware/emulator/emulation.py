"""Emulated bench with an object in front of the finger, controlled by orders.

Orders are mappings that JSON can hold:

- `{"object": 2}` puts an object in front of the finger, by number or name; `{"object": null}` removes it
- `{"on": "unplug", "port": "sensor", "times": 1, "seconds": 2.0}` switches a fault on
- `{"off": "unplug"}` switches it off, `{"off": null}` switches all faults off; a port that has vanished comes back
- `{}` changes nothing

Each is answered with the state of the bench.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from ...models.errors import InputError
from .bench import Bench
from .faults import Switches
from .shared_clock import Advanced


class Touching(Protocol):
    """A finger that may face an object."""

    @property
    def what(self) -> int | None:
        """Index of the object in front of it, or None."""
        ...

    @what.setter
    def what(self, what: int | None) -> None: ...


class Emulation:
    """Emulated devices in this process, as a connection of a shared clock.

    Args:
        bench: The devices and their time.
        switches: Faults.
        finger: The finger.
        place_mm: True position of the finger in the rig frame, by time.
        objects: Names of the objects.

    Attributes:
        bench: The devices and their time.
        switches: Faults; those of a closed port start with the next order or when time advances.
        finger: The finger.
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

    @property
    def place_mm(self) -> tuple[float, float]:
        """True position (x, y) of the finger in the rig frame."""
        return self._place_mm(self.bench.now_s)

    def advance(self, until_s: float, sent: Mapping[str, int]) -> Advanced:
        """Advances time until a device writes, at most to `until_s`.

        Raises:
            InputError: The port is unknown or the time is not finite or in the past.
        """
        return self.bench.advance(until_s, sent)

    def control(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Executes an order and returns the state.

        Raises:
            InputError: The order, object or fault is unknown.
        """
        match dict(order):
            case {"object": what, **rest} if not rest:
                self.finger.what = None if what is None else self._object(what)
            case {"on": str(name), **parameters}:
                self._switch_on(name, parameters)
            case {"off": str(name), **rest} if not rest:
                self.switches.off(name)
                self._plug()
            case {"off": None, **rest} if not rest:
                self.switches.clear()
                self._plug()
            case rest if rest:
                raise InputError(f"Unknown order {dict(order)}; choose object, on or off.")
        self.bench.settle()
        return self.state()

    def state(self) -> dict[str, Any]:
        """Time, true position, object and faults so far, as JSON values."""
        what, links = self.finger.what, self.bench.links
        return {
            "now_s": self.bench.now_s,
            "place_mm": list(self.place_mm),
            "object": what,
            "object_name": None if what is None else self.objects[what],
            "objects": list(self.objects),
            "faults": list(self.switches),
            "struck": dict(self.switches.tally()),
            "open": {link.name: link.is_open for link in links},
            "overrun": {link.name: link.terminal.overrun for link in links},
        }

    def _plug(self) -> None:
        """Puts plugs back in whose faults are off: time, which would do it, goes on only while a program waits."""
        if not {"unplug", "renumber"} & set(self.switches):
            for link in self.bench.links:
                link.come_back()

    def _object(self, what: Any) -> int:
        if what in self.objects:
            return self.objects.index(what)
        if isinstance(what, int) and not isinstance(what, bool) and 0 <= what < len(self.objects):
            return what
        raise InputError(f"Unknown object {what!r}; choose from {', '.join(self.objects)}, or an index from 0.")

    def _switch_on(self, name: str, parameters: dict[str, Any]) -> None:
        try:
            self.switches.on(name, **parameters)
        except TypeError as error:
            raise InputError(f"Fault {name}: invalid parameters {parameters}.") from error
