"""Records of MCAP files, complete or damaged, whoever wrote them.

A killed process leaves a file without a summary, and a power failure one with arbitrary bytes at its end. Everything
before the damage is read.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import IO

from ..errors import InputError
from ..extras import extra
from .recording import naming
from .untrusted import check_size

with extra("mcap"):
    from mcap.records import (
        AttachmentIndex,
        Chunk,
        ChunkIndex,
        DataEnd,
        Footer,
        Header,
        McapRecord,
        MessageIndex,
        MetadataIndex,
        Statistics,
        SummaryOffset,
    )
    from mcap.stream_reader import StreamReader, breakup_chunk
    from mcap.writer import MCAP0_MAGIC

_SUMMARY = AttachmentIndex, ChunkIndex, MetadataIndex, Statistics, SummaryOffset


class McapFile:
    """Reads the records of a file in order, up to its end or unreadable damage.

    Args:
        path: The file.

    Attributes:
        path: The file.
        finished: Once read: whether the file was closed properly.
        lost_bytes: Once read: number of bytes at the end after the last complete record.
        misplaced: Once read: number of records left out that cannot be where they are, so they were others once.

    Raises:
        InputError: The file cannot be read or is not an MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.finished = False
        self.lost_bytes = self.misplaced = 0
        try:
            with self.path.open("rb") as file:
                begin = file.read(len(MCAP0_MAGIC))
        except OSError as error:
            raise InputError(f"{path}: cannot read: {error.strerror or error}.") from error
        if not MCAP0_MAGIC.startswith(begin):
            raise InputError(f"{path}: not an MCAP file.")

    def records(self) -> Iterator[McapRecord]:
        """Records, those in chunks as well.

        Raises:
            InputError: A chunk would unpack to too much.
        """
        with self.path.open("rb") as file:
            size = self.path.stat().st_size
            whole = self.misplaced = 0
            before: set[type[McapRecord]] = set()
            for record in _until_damage(self.path, file, size):
                whole = file.tell()
                self.finished = isinstance(record, Footer)
                if _is_misplaced(record, before):
                    self.misplaced += 1
                elif not isinstance(record, Chunk):
                    yield record
                before.add(type(record))
            self.lost_bytes = max(0, size - whole - (len(MCAP0_MAGIC) if self.finished else 0))


def _is_misplaced(record: McapRecord, before: set[type[McapRecord]]) -> bool:
    """Whether a record cannot come after others of these types."""
    if isinstance(record, MessageIndex):
        return Chunk not in before
    return (isinstance(record, _SUMMARY) and DataEnd not in before) or (isinstance(record, Header) and Header in before)


def _until_damage(path: Path, file: IO[bytes], size: int) -> Iterator[McapRecord]:
    """Records, those in chunks behind their chunk."""
    records = iter(StreamReader(file, record_size_limit=size, emit_chunks=True).records)
    while True:
        try:
            record = next(records)
            if isinstance(record, Chunk):
                with naming(path):
                    check_size(path, record.uncompressed_size)
            found = [record, *breakup_chunk(record, validate_crc=True)] if isinstance(record, Chunk) else [record]
        except InputError:
            raise
        except Exception:  # on damaged bytes the library raises almost any exception
            return
        yield from found
