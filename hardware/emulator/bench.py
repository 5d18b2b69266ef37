"""Rig time on an emulated bench; advanced here only, event by event."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...models.errors import InputError
from .link import Link
from .shared_clock import Advanced


class Bench:
    """Devices behind their ports, sharing one clock.

    Args:
        links: The devices.

    Attributes:
        links: The devices.
        now_s: Rig time in seconds, from 0 on.
    """

    def __init__(self, links: Sequence[Link]) -> None:
        self.links = tuple(links)
        self.now_s = 0.0
        self._known: dict[str, Link] = {}

    def advance(self, until_s: float, sent: Mapping[str, int]) -> Advanced:
        """Reads what programs wrote, then advances time until a device writes, at most to `until_s`.

        Args:
            until_s: Rig time in seconds.
            sent: Bytes written to each open port since it was opened, by address; waits for all of them.

        Raises:
            InputError: The port is unknown or the time is not finite or in the past.
        """
        if not math.isfinite(until_s):
            raise InputError(f"Cannot advance rig time to {until_s} s.")
        addresses = {self._link(address): address for address in sent}
        for link in self.links:
            link.listen(self.now_s, sent[addresses[link]] if link in addresses else None)
        wrote = self._run(until_s)
        return Advanced(self.now_s, {addresses.get(link, str(link.terminal.link)): n for link, n in wrote.items()})

    def catch_up(self, time_s: float) -> None:
        """Advances time to a moment, whatever the devices write, then reads what programs wrote."""
        while self.now_s < time_s:
            self._run(time_s)
        self.settle()

    def settle(self) -> None:
        """Handles what programs did, without advancing time."""
        for link in self.links:
            link.listen(self.now_s)

    def close(self) -> None:
        """Removes all ports."""
        for link in self.links:
            link.close()

    def _run(self, until_s: float) -> dict[Link, int]:
        wrote = self._deliver()
        while not wrote and self.now_s < until_s:
            next_s = min((link.next_event_s() for link in self.links), default=until_s)
            self.now_s = max(self.now_s, min(until_s, next_s))
            for link in self.links:
                link.step(self.now_s)
            wrote = self._deliver()
        return wrote

    def _deliver(self) -> dict[Link, int]:
        return {link: n for link in self.links if (n := link.deliver(self.now_s))}

    def _link(self, address: str) -> Link:
        if (link := self._known.get(address)) is not None:
            return link
        path = Path(address)
        for link in self.links:
            own = link.terminal.link
            if path.parent.resolve() / path.name == own.parent.resolve() / own.name:
                self._known[address] = link
                return link
            if path.resolve() == own.resolve():  # the terminal's own name, which changes with every reconnection
                return link
        known = ", ".join(str(link.terminal.link) for link in self.links)
        raise InputError(f"{address}: unknown port of the emulator; known: {known}.")
