"""Feeds damaged files to every reader; `make fuzz`.

Valid small files are changed at random: bits, truncation, insertion, loss, exchanged blocks, extreme numbers. A reader
works in a process of its own, and must accept a file or refuse it by `InputError`, within 10 s and 1 GB. What it lets
further processes read has limits there. Files that it neither accepts nor refuses are kept.
"""

import argparse
import random
import re
import shutil
import signal
import subprocess
import sys
import traceback
import zipfile
import zlib
from collections import Counter
from contextlib import suppress
from pathlib import Path
from pkgutil import resolve_name
from queue import Empty, Queue
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

from solidtouch.models.errors import InputError

from benchmarks.page import check_block, table, write_rows

READERS = {
    "model": "solidtouch.models.io.model_file:load_model",
    "export": "solidtouch.models.io.model_file:load_model",
    "setting": "solidtouch.models.setting_file:load_setting",
    "rig": "solidtouch.hardware.rig.settings:load_rig",
    "plan": "solidtouch.hardware.recording.plan:load_plan",
    "study": "solidtouch.analysis.sweep.study:load_study",
    "targets": "solidtouch.inference.moves.table:load_table",
    "learner": "solidtouch.inference.tuning.online:load_learner",
    "resumed": "benchmarks.checks.fuzz_files:resume",
    "sweep": "benchmarks.checks.fuzz_files:sweep_again",
    "answers": "benchmarks.checks.fuzz_files:check",
}
"""Of formats that are no taps."""
MAPS = {
    "parquet": {"taps": "signal", "what": "object", "where": "place"},
    "arrow": {"taps": "signal", "what": "object", "where": "place"},
    "jsonl": {"taps": "signal", "what": "object", "where": "place"},
    "txt": {"taxels": "s*", "tap": "press", "what": "object", "where": "place", "time": "t"},
    "npy": {"axes": "tap,sample,taxel"},
    "h5": {"taps": "run_{session}/taps", "what": "run_{session}/object", "where": "run_{session}/place"},
}
"""Of formats of other people's layouts, by the ending of the file."""
READERS |= dict.fromkeys(MAPS, "benchmarks.checks.fuzz_files:convert")
ENDS = ("accepted", "refused", "traceback", "crash", "hang", "memory")
_BYTES, _START, _LOOK = 1 << 30, 120.0, 0.1
_EXTREMES = ("1e308", "-1", "nan", "1e-320", "9" * 400, "0", "", "1" * 18, "[", '"', "true")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")


def resume(path: Path) -> None:
    """Resumes a recording, and ends it."""
    from solidtouch.hardware.recording.recording import Recorder  # noqa: PLC0415

    Recorder.resume(path).finish()


def sweep_again(path: Path) -> None:
    """Continues a sweep, and opens its results."""
    from solidtouch.analysis.sweep.report import SweepReport  # noqa: PLC0415
    from solidtouch.analysis.sweep.run import sweep  # noqa: PLC0415
    from solidtouch.analysis.tasks.local import in_this_process  # noqa: PLC0415

    sweep(path.with_name("swept.toml"), path, in_this_process)
    _ = SweepReport.open(path).results


def check(path: Path) -> None:
    """Checks the answers of a program."""
    from solidtouch.analysis.conformance.front import run_files  # noqa: PLC0415

    run_files(path, ["root-j"])


def convert(path: Path) -> None:
    """Reads taps through a map."""
    from solidtouch.models.io.layouts.mapping import TapMap  # noqa: PLC0415
    from solidtouch.models.io.layouts.tap_set import load_mapped  # noqa: PLC0415

    load_mapped(path, TapMap(**MAPS[path.suffix[1:]]))


def mutated(content: bytes, generator: random.Random) -> bytes:
    """The bytes with one to eight changes."""
    data = bytearray(content)
    for _ in range(generator.choice((1, 1, 2, 4, 8))):
        place, length = generator.randrange(len(data) or 1), generator.choice((1, 4, 8, 64))
        other = generator.randrange(len(data) or 1)
        match generator.randrange(7):
            case 0 if data:
                data[place] ^= 1 << generator.randrange(8)
            case 1:
                del data[place : place + length]
            case 2:
                data[place:place] = generator.randbytes(length)
            case 3:
                data[place : place + length], data[other : other + length] = (
                    data[other : other + length],
                    data[place : place + length],
                )
            case 4:
                data[place : place + 8] = generator.choice((0, 1, 2**31 - 1, 2**63 - 1, 2**64 - 1)).to_bytes(
                    8, "little"
                )
            case 5 if numbers := list(_NUMBER.finditer(data)):
                found = generator.choice(numbers)
                data[found.start() : found.end()] = generator.choice(_EXTREMES).encode()
            case 6 if generator.random() < 0.2:
                del data[place:]
            case _:
                data[place:place] = data[place : place + 200]
    return bytes(data)


def damaged(source: Path, target: Path, generator: random.Random) -> None:
    """Writes a changed copy of a file, or of a store with one changed file."""
    if source.is_dir():
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(source, target)
        target /= generator.choice(sorted(path for path in source.rglob("*") if path.is_file())).relative_to(source)
        source = target
    if source.suffix == ".mcap" and generator.random() < 0.8:  # with checksums that match
        damage_recording(source, target, generator)
    elif source.suffix == ".npz" and generator.random() < 0.8:  # with checksums that match
        with zipfile.ZipFile(source) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = generator.choice(list(members))
        with zipfile.ZipFile(target, "w") as archive:
            for each, content in members.items():
                archive.writestr(each, mutated(content, generator) if each == name else content)
    else:
        target.write_bytes(mutated(source.read_bytes(), generator))


def damage_recording(source: Path, target: Path, generator: random.Random) -> None:
    """Writes a recording with a damaged message."""
    from mcap.writer import CompressionType, Writer  # noqa: PLC0415
    from solidtouch.models.io.rig_reader import RecordingReader  # noqa: PLC0415

    entries = list(RecordingReader(source))
    topic = generator.choice(sorted({entry.topic for entry in entries}))
    chosen = generator.choice([i for i, entry in enumerate(entries) if entry.topic == topic])
    crc = 0
    with target.open("wb") as file:
        writer = Writer(file, use_chunking=False, compression=CompressionType.NONE)
        writer.start()
        channels: dict[str, int] = {}
        for i, entry in enumerate(entries):
            data, time_ns = entry.data, entry.log_time_ns
            if entry.topic == "/tap":
                data, crc = re.sub(rb'"crc":\d+', b'"crc":%d' % crc, data), 0
            if i == chosen:
                data = mutated(data, generator)
                time_ns = generator.choice((time_ns, 0, 1 << 63, (1 << 64) - 1))
            if entry.topic != "/tap":
                crc = zlib.crc32(data, crc)
            if entry.topic not in channels:
                channels[entry.topic] = writer.register_channel(entry.topic, "json", 0)
            writer.add_message(channels[entry.topic], time_ns, data, time_ns)
        writer.finish()


class ReadingProcess:
    """A process that reads files of a format, each in so many seconds, and is replaced when it fails."""

    def __init__(self, name: str, seconds: float) -> None:
        self._seconds = seconds
        command = [sys.executable, "-m", "benchmarks.checks.fuzz_files", "--read", name]
        how: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        self._process: Any = subprocess.Popen(command, **how)  # noqa: S603
        self._lines: Queue[str] = Queue()
        Thread(target=self._listen, daemon=True).start()
        if (end := self._answer(_START)) != "ready":
            raise RuntimeError(f"the reader of {name} does not start: {end}")

    def _listen(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line.strip())
        self._lines.put("crash")

    def _answer(self, seconds: float) -> str:
        for _ in range(round(seconds / _LOOK)):  # counted, as a computer that sleeps meanwhile is no hang
            with suppress(Empty):
                return self._lines.get(timeout=_LOOK)
        return "hang"

    def read(self, path: Path) -> str:
        """How reading a file ended, one of `ENDS`, for a traceback with what was raised."""
        self._process.stdin.write(f"{path}\n")
        self._process.stdin.flush()
        return self._answer(self._seconds)

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.communicate()


def answer(name: str) -> None:
    """Reads the files whose paths come in, one a line, and prints how each ended."""
    read: Any = resolve_name(READERS.get(name, "solidtouch.models.io.load:load_taps"))
    out, sys.stdout = sys.stdout, sys.stderr
    print("ready", file=out, flush=True)
    for line in sys.stdin:
        try:
            read(Path(line.strip()))
            end = "accepted"
        except InputError:
            end = "refused"
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            end = f"traceback {type(error).__name__} at {Path(place.filename).name}:{place.lineno}"
        print("memory" if _peak() > _BYTES else end, file=out, flush=True)


def _peak() -> int:
    """Most bytes that this process has held; `getrusage` counts those of its parent, too."""
    own = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    return 1024 * int(own[1]) if own else 0


def fuzz(
    name: str, source: Path, number: int, generator: random.Random, kept: Path, seconds: float = 10.0
) -> Counter[str]:
    """How reading that many damaged files of a format ended; the files of bad ends are kept."""
    ends: Counter[str] = Counter()
    process = ReadingProcess(name, seconds)
    try:
        for i in range(number):
            case = source.with_name(f"case-{i}{source.suffix}")
            damaged(source, case, generator)
            end = process.read(case)
            ends[end.partition(" ")[0]] += 1
            if end not in ("accepted", "refused"):
                kept.mkdir(parents=True, exist_ok=True)
                shutil.move(case, kept / f"{name}-{i}-{end.partition(' ')[0]}{source.suffix}")
                print(f"{name} {i}: {end}", flush=True)
            elif case.is_dir():
                shutil.rmtree(case)
            else:
                case.unlink()
            if end in ("crash", "hang", "memory"):
                process.close()
                process = ReadingProcess(name, seconds)
    finally:
        process.close()
    return ends


def main() -> int:
    """Prints a table; 1 if a reader failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1_000, help="number of files of each format")
    parser.add_argument("--formats", help="formats, separated by commas; default: all")
    parser.add_argument("--seconds", type=float, default=10.0, help="most of a file; more where other programs work")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--kept", type=Path, default=Path("fuzzed"), help="folder for files that were not read well")
    parser.add_argument("--read", help=argparse.SUPPRESS)
    parser.add_argument("--document", type=Path, help="page whose table to update")
    arguments = parser.parse_args()
    if arguments.read:
        answer(arguments.read)
        return 0
    check_block(arguments.document, "files")
    from benchmarks.checks.fuzz_sources import write_files  # noqa: PLC0415 - what this imports readers do without

    with TemporaryDirectory() as folder:
        files = write_files(Path(folder))
        names = arguments.formats.split(",") if arguments.formats else list(files)
        generator = random.Random(arguments.seed)  # noqa: S311 - no secret
        ends = {
            name: fuzz(name, files[name], arguments.files, generator, arguments.kept, arguments.seconds)
            for name in names
        }
    rows = [(name, *(str(counts[end]) for end in ENDS)) for name, counts in ends.items()]
    print(table(("format", *ENDS), rows))
    write_rows(arguments.document, "files", ("format", *ENDS), rows)
    return int(any(counts[end] for counts in ends.values() for end in ENDS[2:]))


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    sys.exit(main())
