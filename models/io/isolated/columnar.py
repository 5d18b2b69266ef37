"""Reads all of a Parquet, Arrow or Feather file, to find out whether that crashes or hangs."""

from pathlib import Path

import pyarrow as pa
import pyarrow.ipc
import pyarrow.parquet as pq

_PARQUET, _IPC = b"PAR1", b"ARROW1"


def read(path: str) -> None:
    """Reads and checks a file.

    Raises:
        Exception: What pyarrow raises on damaged bytes.
    """
    with Path(path).open("rb") as file:
        begin = file.read(len(_IPC))
    if begin.startswith(_PARQUET):
        with pq.ParquetFile(path, pre_buffer=False) as table:
            for batch in table.iter_batches(use_threads=False):
                batch.validate(full=True)
        return
    how = pa.ipc.IpcReadOptions(use_threads=False)
    with pa.OSFile(path) as source:
        if begin != _IPC:
            for batch in pa.ipc.open_stream(source, options=how):
                batch.validate(full=True)
            return
        table = pa.ipc.open_file(source, options=how)
        for i in range(table.num_record_batches):
            table.get_batch(i).validate(full=True)
