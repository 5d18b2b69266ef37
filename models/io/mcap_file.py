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
    from mcap.records import Chunk, Footer, McapRecord
    from mcap.stream_reader import StreamReader, breakup_chunk
    from mcap.writer import MCAP0_MAGIC


class McapFile:
    """Reads the records of a file in order, up to its end or unreadable damage.

    Args:
        path: The file.

    Attributes:
        path: The file.
        finished: Once read: whether the file was closed properly.
        lost_bytes: Once read: number of bytes at the end after the last complete record.

    Raises:
        InputError: The file cannot be read or is not an MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.finished = False
        self.lost_bytes = 0
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
            whole = 0
            for record in _until_damage(self.path, file, size):
                whole = file.tell()
                self.finished = isinstance(record, Footer)
                yield record
            self.lost_bytes = max(0, size - whole - (len(MCAP0_MAGIC) if self.finished else 0))


def _until_damage(path: Path, file: IO[bytes], size: int) -> Iterator[McapRecord]:
    records = iter(StreamReader(file, record_size_limit=size, emit_chunks=True).records)
    while True:
        try:
            record = next(records)
            if isinstance(record, Chunk):
                with naming(path):
                    check_size(path, record.uncompressed_size)
            found = breakup_chunk(record, validate_crc=True) if isinstance(record, Chunk) else [record]
        except InputError:
            raise
        except Exception:  # on damaged bytes the library raises almost any exception
            return
        yield from found
