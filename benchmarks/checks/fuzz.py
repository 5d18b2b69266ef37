"""Feeds a million random and mutated inputs to the protocol decoders; `make fuzz`.

No input may raise an exception or make a decoder's buffer grow beyond its limit. Mutations start from valid lines, so
damaged input gets past the first checks.
"""

import argparse
import random
import sys
from collections.abc import Callable
from typing import NamedTuple

from solidtouch.hardware.skin import icub as icub_skin
from solidtouch.hardware.skin import line_sensor as line_frames
from solidtouch.hardware.skin import slcan
from solidtouch.hardware.stage import grbl


class Target(NamedTuple):
    """A decoder under fire.

    Attributes:
        make: A new decoder.
        lines: Lines it understands.
        most_kept: Bytes that it may keep.
        use: What a driver does with a unit.
    """

    make: Callable[[], slcan.SlcanDecoder | grbl.GrblDecoder | line_frames.LineDecoder]
    lines: list[bytes]
    most_kept: int
    use: Callable[[object], object]


SLCAN_LINES = [
    b"t4E0840F5F4F3F2F1F0EF\r", b"t4E08C0F5F4F3F2F10000\r", b"T1FFFFFFF1AB\r", b"r1238\r", b"\r", b"z\r", b"\a",
    b"V1013\r", b"NA123\r", b"F0A\r", b"t2E081C0B0102030400011A2B\r", b"b158aa7 github.com/x/canable-fw.git\r",
]  # fmt: skip
GRBL_LINES = [
    b"ok\r\n", b"error:9\r\n", b"ALARM:1\r\n", b"\r\nGrbl 1.1h ['$' for help]\r\n", b"$110=500.000\r\n",
    b"[MSG:'$H'|'$X' to unlock]\r\n", b">G54:ok\r\n",
    b"<Idle|MPos:-10.000,-5.250,0.000|FS:0,0|WCO:0.000,0.000,0.000>\r\n",
    b"<Hold:1|WPos:0.0000,0.0000,0.0000|Bf:15,128|Pn:XY|Ov:100,100,100|A:S>\r\n",
]  # fmt: skip
SENSOR_LINES = [b"# solidtouch-lines K=3 rate_hz=50\n", b"20,1,2,3\n", b"40,1.5,-2,3\r\n", b"4294967295,0,0,0\n"]


def _skin(unit: object) -> object:
    return icub_skin.decode(unit) if isinstance(unit, slcan.SlcanFrame | slcan.RemoteFrame) else None


TARGETS = {
    "slcan": Target(slcan.SlcanDecoder, SLCAN_LINES, slcan.LONGEST_LINE, _skin),
    "slcan without stamps": Target(lambda: slcan.SlcanDecoder("never"), SLCAN_LINES, slcan.LONGEST_LINE, _skin),
    "grbl": Target(grbl.GrblDecoder, GRBL_LINES, grbl.LONGEST_LINE, repr),
    "lines": Target(lambda: line_frames.LineDecoder(3), SENSOR_LINES, line_frames.longest_line(3), repr),
}


def fuzz(target: Target, inputs: int, generator: random.Random) -> int:
    """Pushes that many inputs into one decoder; returns the units that came out.

    Raises:
        AssertionError: The decoder kept more than it may.
    """
    decoder, units = target.make(), 0
    for _ in range(inputs):
        data = generator.randbytes(generator.randrange(40)) if generator.random() < 0.3 else _mutated(target, generator)
        for unit in decoder.push(data):
            target.use(unit)
            units += 1
        if decoder.lines.pending > target.most_kept:
            raise AssertionError(f"{decoder.lines.pending} bytes are kept, {target.most_kept} are allowed.")
    return units


def _mutated(target: Target, generator: random.Random) -> bytes:
    data = bytearray(b"".join(generator.choices(target.lines, k=generator.randint(1, 3))))
    for _ in range(generator.randrange(4)):
        place = generator.randrange(len(data)) if data else 0
        kind = generator.randrange(4)
        if kind == 0 and data:
            data[place] ^= 1 << generator.randrange(8)
        elif kind == 1:
            del data[place : place + generator.randint(1, 5)]
        elif kind == 2:
            data[place:place] = generator.randbytes(generator.randint(1, 8))
        else:
            data[place:place] = data[place : place + generator.randint(1, 200)]
    return bytes(data)


def main() -> None:
    """Fuzzes every decoder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="total number of inputs")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    arguments = parser.parse_args()
    generator = random.Random(arguments.seed)  # noqa: S311 - no secret
    share = -(-arguments.inputs // len(TARGETS))
    for name, target in TARGETS.items():
        units = fuzz(target, share, generator)
        print(f"{name}: {share} inputs, {units} units, no exception, at most {target.most_kept} bytes kept")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
