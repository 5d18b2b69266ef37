"""Episodes of `solidtouch perceive`: from the first tap to the decision, at a pace that one can watch."""

import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...models.errors import InputError

if TYPE_CHECKING:
    from ...analysis.live.ending import Ending
    from ...hardware.named_rigs import PlaceableRig, Placed
    from ...inference.engines.engine import Engine
    from ...inference.episode import Step
    from ...inference.novelty import Novelty
    from .moving import Moves
    from .showing import Show
    from .stopping import Ends
    from .watching import WatchedShow

_WATCHED_S = 0.5


def default_pace(rig: str, as_json: bool, view: bool) -> float:
    """Minimum time between taps in seconds: one can watch a rig that needs no time itself.

    Args:
        rig: Name of the rig.
        as_json: Whether a program reads the taps.
        view: Whether a page shows them.
    """
    watched = (view or sys.stdout.isatty()) and not as_json
    return _WATCHED_S if watched and not rig.endswith(".toml") else 0.0


def warmed_up(engine: "Engine", as_json: bool) -> float:
    """Compiles the engine, says so in a terminal, and returns the time in seconds."""
    from ...inference.engines.latency import warm_up

    if sys.stdout.isatty() and not as_json:
        print(f"Compiling engine {engine.name} ...", flush=True)
    return warm_up(engine)


class TapPace:
    """Keeps taps apart.

    Args:
        seconds: Least time between the beginnings of two taps.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds, self._next = seconds, 0.0

    def taps(self, made: Iterator["Step"]) -> Iterator["Step"]:
        """The same steps, each begun no sooner than its time; it goes on from one episode to the next."""
        while True:
            time.sleep(max(0.0, self._next - time.monotonic()))
            self._next = time.monotonic() + self._seconds
            step = next(made, None)
            if step is None:
                return
            yield step
            if step.move is None:
                return


class EpisodeRun:
    """Runs episodes with fixed engine, strategy and stopping rule."""

    def __init__(
        self,
        engine: "Engine",
        ends: "Ends",
        moves: "Moves",
        seed: int,
        deadline: int,
        novelty: "Novelty | None",
        alpha: float | None,
        pace: TapPace,
    ) -> None:
        self._engine, self._ends, self._moves, self._seed = engine, ends, moves, seed
        self._deadline, self._novelty, self._alpha, self._pace = deadline, novelty, alpha, pace

    def episodes(self, source: "PlaceableRig", number: int, shown: "WatchedShow") -> "list[Ending]":
        """Runs so many episodes on a rig, and shows them."""
        from ...analysis.live.saved import header_of

        model, heading = self._engine.model, f"{source.name}, engine {self._engine.name}"
        header = header_of(
            heading,
            model.grid,
            model.preprocessing,
            model.K,
            theta=self._ends.theta,
            rule=self._ends.name,
            fixation=self._moves.fixation,
            deadline=self._deadline,
            taxel_mm=source.taxel_mm,
            reading_unit=source.units,
            seed=self._seed,
        )
        shown.start(header)
        endings = []
        for episode in range(number):
            named = heading + f", episode {episode + 1}" * (number > 1)
            endings.append(self._episode(source.place(episode), shown, named, episode))
            shown.end(episode + 1, endings[-1])
        return endings

    def _episode(self, placed: "Placed", shown: "Show", heading: str, number: int) -> "Ending":
        """Taps until the stopping rule, the deadline or the answer `unknown`."""
        from ...analysis.live.ending import ending_of
        from ...analysis.live.view import Seen
        from ...inference.episode import steps
        from ...inference.novelty import UnknownTest
        from .moving import chances

        test = None if self._novelty is None else UnknownTest(self._novelty, self._alpha)
        doubt = None if test is None else test.add
        seen = None
        (policy, point), ends = self._moves, self._ends
        chance, watch = chances(self._seed, number, self._deadline), ends.watch
        made = steps(placed.sensor, self._engine, ends.rule, policy, self._deadline, doubt, chance=chance, watch=watch)
        for step in self._pace.taps(made):
            p, alarm = (None, False) if test is None else (test.p, test.unknown)
            seen = Seen(step, self._engine.model.grid, ends.theta, point, p, alarm, heading, ends.name)
            shown.tap(seen)
            if alarm:
                break
        if seen is None:
            raise InputError("--deadline must be at least 1 tap.")
        return ending_of(seen, placed.truth())
