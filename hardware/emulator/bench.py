"""Rig time on an emulated bench: the only place where it goes on, event by event."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...models.errors import InputError
from ..link.shared_clock import Advanced
from .link import Link


class Bench:
    """Devices behind their ports, and one time for all.

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
        """Takes what programs wrote, then lets time go on until a device writes, and to `until_s` at the latest.

        Args:
            until_s: Rig time in seconds.
            sent: Bytes written to each open port since it was opened, by address; those are waited for.

        Raises:
            InputError: There is no such port, or no such time.
        """
        if not math.isfinite(until_s):
            raise InputError(f"Rig time cannot go on until {until_s}.")
        addresses = {self._link(address): address for address in sent}
        for link in self.links:
            link.listen(self.now_s, sent[addresses[link]] if link in addresses else None)
        wrote = self._run(until_s)
        return Advanced(self.now_s, {addresses.get(link, str(link.terminal.link)): n for link, n in wrote.items()})

    def catch_up(self, time_s: float) -> None:
        """Lets time go on to a moment, whatever the devices write, and then takes what programs wrote."""
        while self.now_s < time_s:
            self._run(time_s)
        self.settle()

    def settle(self) -> None:
        """Sees what programs did, without time going on."""
        for link in self.links:
            link.listen(self.now_s)

    def close(self) -> None:
        """Takes all ports away."""
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
            if path.resolve() == own.resolve():  # the terminal's own name, which changes when it is plugged in anew
                return link
        known = ", ".join(str(link.terminal.link) for link in self.links)
        raise InputError(f"{address}: the emulator has no such port, only {known}.")
