"""What holds for every decoder of a stream of bytes, whatever its units are."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

type Stream = Sequence[tuple[Any, bytes]]
"""Units and the bytes of each."""


def assert_any_split_gives_the_same_units(decoder: Callable[[], Any], wire: bytes, cuts: Sequence[int]) -> None:
    whole, split = decoder(), decoder()
    cuts = [0, *sorted(cuts), len(wire)]

    assert whole.push(wire) == [unit for start, stop in pairwise(cuts) for unit in split.push(wire[start:stop])]
    assert (whole.lines.dropped, whole.lines.pending) == (split.lines.dropped, split.lines.pending)


def assert_garbage_touches_only_the_unit_behind_it(
    decoder: Callable[[], Any], before: Stream, garbage: bytes, after: Stream, ends: bytes
) -> None:
    """Units before it are kept; those after too, but for the first unless the garbage ends in one of these bytes."""
    units = decoder().push(wire_of(before) + garbage + wire_of(after))
    kept = [unit for unit, _ in (after if garbage[-1:] in ends else after[1:])]

    assert [unit for unit, _ in before] == units[: len(before)]
    assert kept == units[len(units) - len(kept) :]
    assert len(units) >= len(before) + len(kept)


def assert_no_bytes_fill_the_memory(decoder: Any, chunks: Sequence[bytes], longest: int) -> None:
    for chunk in chunks:
        decoder.push(chunk)
        assert decoder.lines.pending <= longest


def wire_of(stream: Stream) -> bytes:
    return b"".join(wire for _, wire in stream)
