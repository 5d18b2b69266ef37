"""Feeds damaged files to every reader; `make fuzz`.

Valid small files are changed at random: bits, truncation, insertion, loss, exchanged blocks, extreme numbers. A reader
works in a process of its own, and must accept a file or refuse it by `InputError`, within 10 s and 1 GB. Files that it
does not are kept.
"""

import argparse
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import traceback
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from queue import Empty, Queue
from tempfile import TemporaryDirectory
from threading import Thread
from typing import Any

from solidtouch.models.errors import InputError

from benchmarks.page import table

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
ENDS = ("accepted", "refused", "traceback", "crash", "hang", "memory")
_SECONDS, _BYTES, _START = 10.0, 1 << 30, 120.0
_EXTREMES = ("1e308", "-1", "nan", "1e-320", "9" * 400, "0", "", "1" * 18, "[", '"', "true")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?")


def write_files(folder: Path) -> dict[str, Path]:
    """A valid file or store of each format."""
    import json  # noqa: PLC0415

    import h5py  # noqa: PLC0415
    import numpy as np  # noqa: PLC0415
    from scipy.io import savemat  # noqa: PLC0415
    from solidtouch.models.io.export import Decisions, save_exported  # noqa: PLC0415
    from solidtouch.models.io.load import load_taps  # noqa: PLC0415
    from solidtouch.models.setting_file import Setting  # noqa: PLC0415

    import solidtouch as st  # noqa: PLC0415

    n, names = np.arange(12), np.array(["thin", "thick"])
    arrays: dict[str, Any] = {
        "taps": np.sin(n[:, None, None] + np.arange(4)[:, None] * np.arange(1, 4)).round(3),
        "what": n % 2,
        "where": n // 2 % 3,
        "session": n // 6,
        "where_values": np.arange(3.0),
    }
    files = {name: folder / f"taps.{name}" for name in ("npz", "nc", "zarr", "csv")}
    files |= {name: folder / f"{name}.mat" for name in ("mat5", "mat73")}
    np.savez_compressed(files["npz"], **arrays, what_names=names, meta=np.array(json.dumps({"rate_hz": 50})))
    savemat(files["mat5"], arrays | {"what_names": names.astype(object), "where_unit": "mm"}, oned_as="column")
    with h5py.File(files["mat73"], "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=np.atleast_2d(values).astype(float).T, compression="gzip")
        cells = [file.create_dataset(f"#refs#/{name}", data=[[ord(letter)] for letter in name]) for name in names]
        for cell in cells:
            cell.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("what_names", data=np.array([[cell.ref for cell in cells]], dtype=h5py.ref_dtype))
        file["what_names"].attrs["MATLAB_class"] = np.bytes_("cell")
    taps = load_taps(files["npz"])
    taps.save(files["nc"])
    taps.dataset.to_zarr(files["zarr"], consolidated=False)
    head = "tap,what,where,session,taxel_0,taxel_1,taxel_2\n"
    rows = [(i, names[i % 2], i // 2 % 3, i // 6, *frame) for i in n for frame in arrays["taps"][i]]
    files["csv"].write_text(head + "\n".join(",".join(map(str, row)) for row in rows) + "\n", encoding="utf-8")
    model = st.fit(taps)
    files |= {"model": folder / "model.nc", "export": folder / "model.json", "setting": folder / "setting.json"}
    model.save(files["model"])
    save_exported(model, files["export"], Decisions("uniform", 0.9, 0.9, 1))
    Setting().save(files["setting"])
    for name in ("rig", "plan", "study"):
        files[name] = folder / f"{name}.toml"
        shutil.copy(EXAMPLES / f"{name}.toml", files[name])
    return files


def reader(name: str) -> Callable[[Path], object]:
    """What reads a format."""
    if name in ("rig", "plan", "study"):
        from solidtouch.analysis.sweep.study import load_study  # noqa: PLC0415
        from solidtouch.hardware.recording.plan import load_plan  # noqa: PLC0415
        from solidtouch.hardware.rig.settings import load_rig  # noqa: PLC0415

        return {"rig": load_rig, "plan": load_plan, "study": load_study}[name]
    from solidtouch.models.io.load import load_taps  # noqa: PLC0415
    from solidtouch.models.io.model_file import load_model  # noqa: PLC0415
    from solidtouch.models.setting_file import load_setting  # noqa: PLC0415

    return {"model": load_model, "export": load_model, "setting": load_setting}.get(name, load_taps)


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
    if source.suffix == ".npz" and generator.random() < 0.8:  # with checksums that match
        with zipfile.ZipFile(source) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = generator.choice(list(members))
        with zipfile.ZipFile(target, "w") as archive:
            for each, content in members.items():
                archive.writestr(each, mutated(content, generator) if each == name else content)
        return
    target.write_bytes(mutated(source.read_bytes(), generator))


class ReadingProcess:
    """A process that reads files of a format and is replaced when it fails."""

    def __init__(self, name: str) -> None:
        command = [sys.executable, "-m", "benchmarks.checks.fuzz_files", "--read", name]
        how: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
        self._process: Any = subprocess.Popen(command, **how)  # noqa: S603
        self._lines: Queue[str] = Queue()
        Thread(target=self._listen, daemon=True).start()
        self._answer(_START)

    def _listen(self) -> None:
        for line in self._process.stdout:
            self._lines.put(line.strip())
        self._lines.put("crash")

    def _answer(self, seconds: float) -> str:
        try:
            return self._lines.get(timeout=seconds)
        except Empty:
            return "hang"

    def read(self, path: Path) -> str:
        """How reading a file ended, one of `ENDS`, for a traceback with what was raised."""
        self._process.stdin.write(f"{path}\n")
        self._process.stdin.flush()
        return self._answer(_SECONDS)

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.communicate()


def answer(name: str) -> None:
    """Reads the files whose paths come in, one a line, and prints how each ended."""
    read = reader(name)
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
    """Most bytes that this process or one of its children has held; `getrusage` counts those of its parent, too."""
    children = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    own = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
    return max(children, 1024 * int(own[1]) if own else 0)


def fuzz(name: str, source: Path, number: int, generator: random.Random, kept: Path) -> Counter[str]:
    """How reading that many damaged files of a format ended; the files of bad ends are kept."""
    ends: Counter[str] = Counter()
    process = ReadingProcess(name)
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
                process = ReadingProcess(name)
    finally:
        process.close()
    return ends


def main() -> int:
    """Prints a table; 1 if a reader failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1_000, help="number of files of each format")
    parser.add_argument("--formats", help="formats, separated by commas; default: all")
    parser.add_argument("--seed", type=int, default=0, help="random seed")
    parser.add_argument("--kept", type=Path, default=Path("fuzzed"), help="folder for files that were not read well")
    parser.add_argument("--read", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.read:
        answer(arguments.read)
        return 0
    with TemporaryDirectory() as folder:
        files = write_files(Path(folder))
        names = arguments.formats.split(",") if arguments.formats else list(files)
        generator = random.Random(arguments.seed)  # noqa: S311 - no secret
        ends = {name: fuzz(name, files[name], arguments.files, generator, arguments.kept) for name in names}
    print(table(("format", *ENDS), [(name, *(str(counts[end]) for end in ENDS)) for name, counts in ends.items()]))
    return int(any(counts[end] for counts in ends.values() for end in ENDS[2:]))


if __name__ == "__main__":
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    sys.exit(main())
