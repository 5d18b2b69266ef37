"""Faults of a bench, as switches that emulated devices query.

Numbers refer to the table in docs/reference/faults.md, which says how the driver handles each.
"""

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

from ...models.errors import InputError
from ...models.seeds import Purpose, generator


class Fault(NamedTuple):
    """Description of a fault.

    Attributes:
        number: Its row in docs/reference/faults.md.
        where: `"port"` for either port, `"stage"` or `"sensor"`.
        meaning: Effect, with the parameters.
        parameters: Names of the parameters; all are numbers.
    """

    number: int
    where: str
    meaning: str
    parameters: tuple[str, ...] = ()


FAULTS: dict[str, Fault] = {
    "split": Fault(1, "port", "output comes in pieces of `size` bytes, `delay_s` apart", ("size", "delay_s")),
    "drop_bytes": Fault(2, "port", "`count` bytes of an output are missing", ("count",)),
    "merge": Fault(3, "port", "a line end is missing"),
    "flip_bits": Fault(4, "port", "`count` bits of an output are flipped", ("count",)),
    "garbage": Fault(4, "port", "all output is noise, as at a wrong baud rate"),
    "torn_status": Fault(5, "stage", "a message interrupts a status report"),
    "unplug": Fault(6, "port", "the port vanishes for `seconds`", ("seconds",)),
    "renumber": Fault(
        7, "port", "the port vanishes for `seconds` and returns as another device under the same link", ("seconds",)
    ),
    "stale_input": Fault(8, "port", "old output arrives after the port was opened"),
    "reset_on_open": Fault(9, "stage", "opening the port resets the controller"),
    "brown_out": Fault(10, "stage", "the controller restarts by itself"),
    "second_reader": Fault(11, "port", "another program takes half of an output, or `count` bytes of it", ("count",)),
    "busy_port": Fault(12, "port", "another program has the port for `seconds` and leaves text in it", ("seconds",)),
    "lost_ok": Fault(13, "stage", "an `ok` is missing"),
    "extra_ok": Fault(14, "stage", "an `ok` comes twice"),
    "refuse_move": Fault(15, "stage", "a move is answered with the error `code`", ("code",)),
    "limit_alarm": Fault(16, "stage", "a limit switch is hit in a move"),
    "silent_status": Fault(17, "stage", "status requests are not answered"),
    "false_idle": Fault(
        18, "stage", "status reports Idle at the old position for `seconds` after a move was accepted", ("seconds",)
    ),
    "deaf": Fault(21, "port", "the device reads nothing for `seconds`", ("seconds",)),
    "no_acks": Fault(22, "sensor", "the adapter answers no command, like stock CANable firmware"),
    "bell": Fault(22, "sensor", "the adapter answers a command with a bell"),
    "left_open": Fault(23, "sensor", "an earlier program left the adapter open and streaming"),
    "lost_frames": Fault(24, "sensor", "the adapter loses both halves of `count` readings", ("count",)),
    "lost_half": Fault(25, "sensor", "the adapter loses one half of a reading"),
    "swapped_halves": Fault(25, "sensor", "the tail comes before the head"),
    "silent_sensor": Fault(26, "sensor", "no readings come"),
    "stuck": Fault(27, "sensor", "readings repeat the same values"),
    "taxel_error": Fault(28, "sensor", "the board reports an error and the taxels in `mask` read 0", ("mask",)),
    "recalibrate": Fault(29, "sensor", "the board recalibrates by itself, even under load"),
    "drift": Fault(30, "sensor", "all taxels drift by `counts_per_s`", ("counts_per_s",)),
    "old_class": Fault(31, "sensor", "the board sends class 3"),
    "foreign": Fault(31, "sensor", "another board and another triangle also send"),
    "late": Fault(32, "port", "output comes up to `delay_s` late", ("delay_s",)),
    "overload": Fault(28, "sensor", "the taxels in `mask` saturate", ("mask",)),
}
"""Rows 19 (receive buffer of 128 bytes) and 20 (writing a setting loses bytes) are not switches: they always hold."""


_WHOLE = {"count", "size", "code", "mask"}
_LEAST = {"count": 1, "size": 1, "code": 1, "mask": 1, "counts_per_s": -1e6}


class Struck(NamedTuple):
    """A fault that occurred.

    Attributes:
        time_s: Rig time in seconds.
        name: Name of the fault.
    """

    time_s: float
    name: str


PORTS = ("stage", "sensor")
"""Ports at which faults can occur."""


class _Switch(NamedTuple):
    left: int | None
    rate: float
    port: str | None
    parameters: dict[str, Any]


class Switches:
    """Faults that are switched on; devices call `strikes` whenever a fault could occur.

    Args:
        seed: Random seed.

    Attributes:
        generator: Random numbers for faults, such as the bit to flip.
        struck: Faults that occurred, in order.
    """

    def __init__(self, seed: int = 0) -> None:
        self.generator = generator(seed, Purpose.FAULTS)
        self.struck: list[Struck] = []
        self._on: dict[str, _Switch] = {}

    def on(
        self, name: str, times: int | None = None, rate: float = 1.0, port: str | None = None, **parameters: Any
    ) -> None:
        """Switches a fault on.

        Args:
            name: A key of `FAULTS`.
            times: Number of occurrences after which it switches off; None for no limit.
            rate: Probability at each opportunity.
            port: Port at which it occurs, one of `PORTS`; either by default. For faults of a port only.
            parameters: Its parameters, as named in its meaning.

        Raises:
            InputError: The fault or a parameter is unknown, or a number is out of range.
        """
        if name not in FAULTS:
            raise InputError(f"Unknown fault {name!r}; choose from {', '.join(FAULTS)}.")
        if not 0 <= rate <= 1 or (times is not None and times < 1):
            raise InputError(f"Fault {name}: rate={rate} must be between 0 and 1, and times={times} at least 1.")
        if port is not None and (port not in PORTS or FAULTS[name].where != "port"):
            raise InputError(f"Fault {name}: port={port} must be stage or sensor, and is for faults of a port only.")
        for key, value in parameters.items():
            _check_parameter(name, key, value)
        self._on[name] = _Switch(times, rate, port, parameters)

    def off(self, name: str) -> None:
        """Switches a fault off if it is on."""
        self._on.pop(name, None)

    def clear(self) -> None:
        """Switches all faults off."""
        self._on.clear()

    def is_on(self, name: str) -> bool:
        """Whether a fault is on; leaves its count unchanged."""
        return name in self._on

    def strikes(self, name: str, time_s: float, port: str | None = None) -> dict[str, Any] | None:
        """Parameters of a fault if it occurs now, else None; the occurrence is recorded and counted.

        Args:
            name: A key of `FAULTS`.
            time_s: Current rig time.
            port: Port at which it could occur, for faults of a port.
        """
        switch = self._on.get(name)
        if switch is None or switch.port not in (None, port):
            return None
        if switch.rate < 1 and self.generator.random() >= switch.rate:
            return None
        self.struck.append(Struck(time_s, name))
        if switch.left == 1:
            del self._on[name]
        elif switch.left is not None:
            self._on[name] = switch._replace(left=switch.left - 1)
        return switch.parameters

    def tally(self) -> Counter[str]:
        """Number of occurrences of each fault."""
        return Counter(struck.name for struck in self.struck)

    def __iter__(self) -> Iterator[str]:
        """Names of the faults that are on."""
        return iter(tuple(self._on))


def _check_parameter(name: str, key: str, value: Any) -> None:
    known = FAULTS[name].parameters
    if key not in known:
        raise InputError(f"Fault {name}: unknown parameter {key!r}; known: {', '.join(known) or 'none'}.")
    least = _LEAST.get(key, 0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < math.inf:
        raise InputError(f"Fault {name}: {key} must be a number of at least {least:g}, got {value!r}.")
    if key in _WHOLE and value != int(value):
        raise InputError(f"Fault {name}: {key} must be an integer, got {value!r}.")
