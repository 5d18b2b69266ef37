"""Damages every byte of every command line of a collection, one at a time, and watches the emulated stage.

A case is one run of one action of a collection with one byte that is lost, added, or has one bit flipped on its way to
the controller. Every 10 ms the true position is compared with the commanded path. After an error the stage is stopped
and the finger lifted, as a rig does.

A case fails if the stage strays from its path by more than 2 mm or for more than 0.3 s, if an action that the driver
reports as done was not done as commanded, if the finger stays on the object without an error that says so, or if
anything moves afterwards.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.table import Table
from solidtouch.hardware.emulator.rig_file import emulated_rig
from solidtouch.hardware.errors import RigError
from solidtouch.hardware.rig.settings import RigFile
from solidtouch.hardware.simulator.settings import PRESETS
from solidtouch.hardware.stage.stage import Stage
from solidtouch.models import seeds

from .watched_stage import Bench, EmulatedStage

CORRIDOR_MM, CORRIDOR_S = 2.0, 0.3
_POLLS = 6
_AWAY_MM = 0.1
ADDED = b"?!~\x18\x84\x85\x90\x91\x95\x99\xa0\x00\n\r\t ();/%0123456789.-+$=#*GMXYZFNPHCIJRST\x7f\xff"
"""Bytes to add everywhere: all real-time commands in kind, signs, digits, and letters that mean something."""
KINDS = ("lost", "flipped", "added")

Make = Callable[[RigFile, tuple[float, float] | None], Bench]
"""Makes a bench at a start in the rig frame, None for a controller that must be homed."""


class Damage(NamedTuple):
    """One damaged byte.

    Attributes:
        write: Number of the write within the action.
        kind: One of `KINDS`.
        at: Index of the byte, or of the byte before which one is added.
        value: Bit that flips, or byte that is added.
    """

    write: int
    kind: str
    at: int
    value: int

    def apply(self, data: bytes) -> bytes:
        """The bytes with the damage."""
        head, tail = data[: self.at], data[self.at :]
        if self.kind == "lost":
            return head + tail[1:]
        if self.kind == "flipped":
            return head + bytes([tail[0] ^ 1 << self.value]) + tail[1:]
        return head + bytes([self.value]) + tail


def damages(writes: list[bytes], generator: np.random.Generator) -> Iterator[Damage]:
    """All damages of these writes, with four random bytes added beside `ADDED` at each place.

    Of the status requests in a row only every `_POLLS`th is damaged.
    """
    polls = 0
    for number, data in enumerate(writes):
        polls = polls + 1 if data == b"?" else 0
        if polls % _POLLS > 1:
            continue
        for at in range(len(data)):
            yield Damage(number, "lost", at, 0)
            yield from (Damage(number, "flipped", at, bit) for bit in range(8))
        for at in range(len(data) + 1):
            added = {*ADDED, *generator.integers(256, size=4).tolist()}
            yield from (Damage(number, "added", at, byte) for byte in sorted(added))


class Action(NamedTuple):
    """One command of a collection.

    Attributes:
        name: Its name.
        start: Start in the rig frame; None for a controller that must be homed.
        prepare: What is done before it, undamaged.
        act: The action.
        path: Commanded path in the rig frame after the start.
    """

    name: str
    start: tuple[float, float] | None
    prepare: Callable[[Stage], object]
    act: Callable[[Stage], object]
    path: tuple[tuple[float, float], ...] = ()


def collection(rig: RigFile, positions: int) -> list[Action]:
    """Actions of a collection.

    Args:
        rig: Its settings.
        positions: Number of positions, evenly over the range.
    """
    clear, depth = rig.tap.clear_mm, rig.tap.depth_mm
    speed = rig.tap.speed_mm_s or rig.stage.y.speed_mm_s
    middle = (rig.range.start_mm + rig.range.end_mm) / 2
    low, high = rig.range.start_mm + 0.5, rig.range.end_mm - 0.5
    places = [low + (high - low) * i / max(1, positions - 1) for i in range(positions)]
    away = high, clear - 4.0
    home = rig.stage.x.rig_mm(-1.0), rig.stage.y.rig_mm(-1.0)
    actions = [
        Action("connect, homed", (middle, clear), lambda _: None, Stage.connect),
        Action("connect, not homed", None, lambda _: None, Stage.connect),
        Action("home", None, lambda stage: stage.connect(will_home=True), Stage.home, (home,)),
        Action("clear", away, Stage.connect, lambda stage: stage.move(y_mm=clear), ((away[0], clear),)),
    ]
    here = middle
    for x in places:
        go = Action("go", (here, clear), Stage.connect, lambda stage, x=x: stage.move(x_mm=x), ((x, clear),))
        tap = Action(
            "tap",
            (x, clear),
            Stage.connect,
            lambda stage, x=x: stage.path([(x, depth, speed), (x, clear, speed)]),
            ((x, depth), (x, clear)),
        )
        actions += [go, tap]
        here = x
    return actions


@dataclass
class Tally:
    """Counts of cases.

    Attributes:
        cases: Cases by kind.
        done: Actions reported as done by kind; all were.
        errors: Errors by class.
        failed: Cases that failed, by reason.
        examples: An example of each reason.
        strayed_mm: Largest distance from the commanded path.
        strayed_s: Longest time off it in motion.
    """

    cases: Counter[str] = field(default_factory=Counter)
    done: Counter[str] = field(default_factory=Counter)
    errors: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)
    examples: dict[str, str] = field(default_factory=dict)
    strayed_mm: float = 0.0
    strayed_s: float = 0.0


def reference(rig: RigFile, action: Action, make: Make = EmulatedStage) -> tuple[list[bytes], Bench]:
    """Writes of an action without damage, and the bench after it."""
    bench, error = _run(rig, action, None, make)
    if error is not None or _wrong(bench, action, None):
        raise RuntimeError(f"{action.name} without damage: {error or _wrong(bench, action, None)}")
    return bench.port.writes, bench


def _run(rig: RigFile, action: Action, damage: Damage | None, make: Make) -> tuple[Bench, RigError | None]:
    bench = make(rig, action.start)
    action.prepare(bench.stage)
    bench.watch.paths = [[bench.place, *(bench.machine(*place) for place in action.path)]]
    if action.name == "home":
        bench.watch.paths[0][-1] = (-1.0, -1.0, -1.0)
    bench.port.keep(lambda number, data: damage.apply(data) if damage and number == damage.write else data)
    try:
        action.act(bench.stage)
    except RigError as error:
        return bench, error
    return bench, None


def check(
    rig: RigFile, action: Action, damage: Damage, sound: Bench, data: bytes, tally: Tally, make: Make = EmulatedStage
) -> None:
    """Runs a case and counts it."""
    bench, error = _run(rig, action, damage, make)
    watch = bench.watch
    tally.cases[damage.kind] += 1
    reasons = []
    if error is None:
        tally.done[damage.kind] += 1
        reasons.append(_wrong(bench, action, sound))
    else:
        tally.errors[type(error).__name__] += 1
        reasons.append(_retracted(bench, action))
    if not bench.rest():
        reasons.append("something moves afterwards")
    if watch.strayed_mm > CORRIDOR_MM:
        reasons.append(f"strayed by more than {CORRIDOR_MM:g} mm")
    if watch.strayed_s > CORRIDOR_S:
        reasons.append(f"strayed for more than {CORRIDOR_S:g} s")
    tally.strayed_mm, tally.strayed_s = max(tally.strayed_mm, watch.strayed_mm), max(tally.strayed_s, watch.strayed_s)
    for reason in filter(None, reasons):
        tally.failed[reason] += 1
        tally.examples.setdefault(reason, f"{action.name}: {data!r} became {damage.apply(data)!r} ({error})")


def _wrong(bench: Bench, action: Action, sound: Bench | None) -> str:
    """Why an action that is reported as done was not, or an empty text."""
    end = bench.watch.paths[0][-1]
    if math.dist(bench.place, end) > bench.right_mm:
        return f"{action.name} reported as done, but is elsewhere"
    if action.name == "tap" and sound is not None:
        (depth, lasted_s), (depth_0, lasted_0_s) = _press(bench), _press(sound)
        if abs(depth - depth_0) > bench.right_mm:
            return "tap of another depth accepted"
        if abs(lasted_s - lasted_0_s) > bench.right_s:
            return "tap of another duration accepted"
    return ""


def _press(bench: Bench) -> tuple[float, float]:
    """Depth of a tap in mm, and time in seconds that the finger was away from its clear position."""
    (_, start), *_ = trace = bench.watch.trace
    ways = [math.dist(start, at) for _, at in trace]
    away = [time_s for (time_s, _), mm in zip(trace, ways, strict=True) if mm > _AWAY_MM]
    return max(ways), (away[-1] - away[0] if away else 0.0)


def _retracted(bench: Bench, action: Action) -> str:
    """Stops the stage and lifts the finger; why it is still on the object without an error, or an empty text."""
    if action.name in {"connect, homed", "connect, not homed", "home"}:
        return ""
    clear_mm = bench.rig.tap.clear_mm
    try:
        bench.stage.stop()
        x_mm, _, z_mm = bench.place
        bench.watch.paths.append([bench.place, (x_mm, bench.machine(0.0, clear_mm)[1], z_mm)])
        bench.stage.move(y_mm=clear_mm)
    except RigError:
        return ""  # the rig then reports `NotAtRest`
    y_mm = bench.rig.stage.y.rig_mm(bench.place[1])
    return "" if abs(y_mm - clear_mm) <= bench.right_mm else "finger not lifted"


def paper_rig() -> RigFile:
    """Settings of the emulated rig."""
    return emulated_rig(Path("/"), PRESETS["paper"], "icub")


def run(
    positions: int, stride: int, progress: Callable[[int], None] = lambda _: None, make: Make = EmulatedStage
) -> Tally:
    """Runs every `stride`th case of a collection."""
    rig, tally = paper_rig(), Tally()
    generator = seeds.generator(0, seeds.Purpose.STUDY)
    number = 0
    for action in collection(rig, positions):
        writes, sound = reference(rig, action, make)
        for damage in damages(writes, generator):
            if number % stride == 0:
                check(rig, action, damage, sound, writes[damage.write], tally, make)
                progress(1)
            number += 1
    return tally


def count(positions: int, stride: int) -> int:
    """Number of cases that `run` takes."""
    rig, generator = paper_rig(), seeds.generator(0, seeds.Purpose.STUDY)
    actions = collection(rig, positions)
    cases = sum(len(list(damages(reference(rig, action)[0], generator))) for action in actions)
    return -(-cases // stride)


def sentence(tally: Tally) -> str:
    """What came of the cases that were not done, and of those that failed."""
    errors = ", ".join(f"{name} {n}" for name, n in tally.errors.most_common())
    failed = "".join(f"\nFailed: {reason} {n}, such as {tally.examples[reason]}" for reason, n in tally.failed.items())
    return (
        f"Errors: {errors}. Largest distance from the commanded path {tally.strayed_mm:.2f} mm, longest time off it in "
        f"motion {tally.strayed_s:.2f} s.{failed or ' None of the cases failed.'}"
    )


def table(tally: Tally) -> Table:
    """Counts as a table."""
    shown = Table(title="One damaged byte in a command", title_justify="left")
    for name in ("", *KINDS):
        shown.add_column(name, justify="left" if not name else "right")
    shown.add_row("cases", *(str(tally.cases[kind]) for kind in KINDS))
    shown.add_row("done as commanded", *(str(tally.done[kind]) for kind in KINDS))
    shown.add_row("stopped or refused", *(str(tally.cases[kind] - tally.done[kind]) for kind in KINDS))
    return shown
