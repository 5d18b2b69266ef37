"""Runs every command at small sizes and compares its output with that of another version.

`python -m benchmarks.checks.freeze OUT` runs the commands on synthetic taps, seed 0, and keeps everything they print
and write. With `--against BEFORE` it then compares with the output of another version: numbers up to rounding, names
and texts exactly, figures pixel by pixel. Times, paths and versions are ignored.
"""

import argparse
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.image import imread

WHERE, WHAT, TAXELS, SAMPLES, TAPS, SESSIONS = 6, (4.0, 7.0, 12.0), 4, 12, 12, 3
STUDY = """
name = "frozen"
trials = 50
thresholds = [0.5, 0.9]
deadline = 20
[[data]]
name = "made"
files = ["session-0.nc", "session-1.nc"]
[grid]
pseudocount = [0.01, 0.1]
policy = ["passive", "active"]
"""
SMALL = "--trials 120"
BOTH = "session-0.nc session-1.nc"
FITS = {name: f"fit session-0.nc --model {name}" for name in ("profile", "profile-ar", "matrix-normal", "smooth")}
FITS |= {
    "histogram": "fit session-0.nc",
    "session": "fit all.nc --train 0,1 --model session",
    "learned": "fit all.nc --train 0,1 --power learned",
}
COMMANDS = {
    "convert": "convert session-0.npz session-1.npz session-2.npz all.nc",
    **{f"convert-{i}": f"convert session-{i}.npz session-{i}.nc" for i in range(SESSIONS)},
    "inspect": "inspect all.nc",
    **{f"fit-{name}": f"{words} --draws 20 --out {name}.nc" for name, words in FITS.items()},
    "export-json": "export-model histogram.nc --format json",
    "export-header": "export-model histogram.nc --format c-header",
    "simulate": "simulate --preset model --model profile.nc --sessions 1 --out simulated",
    "trials": "trials histogram.nc session-1.nc --trials 2000 --out trials.nc",
    "crosscheck": f"crosscheck {BOTH} --episodes 4",
    "perceive": "perceive histogram.nc --rig replay:session-1.nc --episodes 5 --engine numpy --json",
    "perceive-shadow": "perceive histogram.nc --rig replay:session-1.nc --shadow --json",
    "reproduce": f"reproduce --data {BOTH} --out reproduced {SMALL}",
    "reproduce-simulated": f"reproduce --data-sets 2 --out simulated-reproduced {SMALL}",
    "compare": f"compare {BOTH} --models histogram,profile,smooth,session --draws 100 --bins 20 "
    f"--thresholds 0.3,0.6,0.9 --out compared {SMALL}",
    "audit": f"audit {BOTH} session-2.nc --permutations 99 --bins 20 --out audited {SMALL}",
    "sensitivity": f"sensitivity {BOTH} --quick --out sensitivity {SMALL}",
    "strategies": f"strategies {BOTH} --quick --out strategies {SMALL}",
    "tune": f"tune {BOTH} --out setting.json {SMALL}",
    "sweep": "sweep study.toml --out swept.zarr --workers 1",
    "conformance": "conformance list",
    "validate": "validate",
}
"""By name, in the order in which each finds the files it needs."""
_TOLERANCE = 1e-9
_VARIES = re.compile(r"^code$|elapsed|seconds|version|created|command|written|history|date|path|digest", re.IGNORECASE)
_TIMES = re.compile(r"\b\d+(\.\d+)? (s|ms|seconds?|minutes?)\b")


def make_taps() -> Iterator[tuple[str, dict[str, Any]]]:
    """Made-up sessions of taps: bumps whose place and height tell the class, in noise that a session shares."""
    for session in range(SESSIONS):
        rng = np.random.default_rng([0, session])
        where, what, _ = (a.ravel() for a in np.indices((WHERE, len(WHAT), TAPS)))
        centre = np.linspace(0, WHERE - 1, TAXELS)
        size = np.array(WHAT)[what][:, None, None]
        course = np.sin(np.pi * np.arange(SAMPLES) / SAMPLES)[None, :, None]
        gain = 1 + 0.05 * rng.standard_normal()
        bump = np.exp(-((where[:, None, None] - centre) ** 2) / size)
        noise = rng.standard_normal((len(where), SAMPLES, TAXELS)) + rng.standard_normal((len(where), 1, TAXELS))
        yield (
            f"session-{session}.npz",
            {
                "taps": 3 * gain * course * bump * np.sqrt(size) + 2 * noise,
                "where": where.astype(float),
                "where_unit": np.array("mm"),
                "what": what,
                "what_names": np.array([f"{size:g} mm rod" for size in WHAT]),
                "what_values": np.array(WHAT),
                "what_unit": np.array("mm"),
                "session": np.full(len(where), session),
            },
        )


def run(folder: Path, only: str | None) -> None:
    """Runs the commands in a new folder; what they print goes to NAME.out, with the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, arrays in make_taps():
        np.savez(folder / name, **arrays)
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    surroundings = os.environ | {"COLUMNS": "160", "NO_COLOR": "1"}
    for name, words in COMMANDS.items():
        if only and not re.search(only, name):
            continue
        print(name, file=sys.stderr, flush=True)
        done = subprocess.run(  # noqa: S603 - this program itself
            [sys.executable, "-m", "solidtouch.cli", *words.split()],
            cwd=folder,
            env=surroundings,
            capture_output=True,
            text=True,
            check=False,
        )
        said = [line for line in done.stderr.splitlines() if "━" not in line]
        text = "\n".join([f"exit {done.returncode}", done.stdout, *said, ""])
        (folder / f"{name}.out").write_text(text, encoding="utf-8")


def differences(before: Path, after: Path) -> Iterator[str]:
    """What differs between two folders, a line each."""
    names = [{str(path.relative_to(folder)) for path in _files(folder)} for folder in (before, after)]
    for name in sorted(names[0] ^ names[1]):
        yield f"{name}: only {'before' if name in names[0] else 'after'}"
    for name in sorted(names[0] & names[1]):
        one, other = before / name, after / name
        match one.suffix:
            case ".json":
                found = _of_values(*(json.loads(path.read_text(encoding="utf-8")) for path in (one, other)))
            case ".nc" | ".zarr":
                found = _of_trees(one, other)
            case ".png":
                found = _of_pictures(one, other)
            case ".out" | ".h":
                found = _of_texts(one, other)
            case _:
                found = iter(())
        yield from (f"{name}{place}" for place in found)


def _files(folder: Path) -> Iterator[Path]:
    for path in sorted(folder.iterdir()):
        if path.is_dir() and path.suffix != ".zarr":
            yield from _files(path)
        else:
            yield path


def _of_values(one: Any, other: Any, place: str = "") -> Iterator[str]:
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        for key in sorted(one.keys() ^ other.keys()):
            yield f"{place}/{key}: only {'before' if key in one else 'after'}"
        for key in one.keys() & other.keys():
            if not _VARIES.search(str(key)):
                yield from _of_values(one[key], other[key], f"{place}/{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for i, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from _of_values(a, b, f"{place}[{i}]")
    elif isinstance(one, float) and isinstance(other, float):
        if not math.isclose(one, other, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE) and not (
            math.isnan(one) and math.isnan(other)
        ):
            yield f"{place}: {one} before, {other} after"
    elif one != other:
        yield f"{place}: {one!r} before, {other!r} after"


def _of_trees(one: Path, other: Path) -> Iterator[str]:
    how: dict[str, Any] = {"engine": "zarr", "consolidated": False} if one.suffix == ".zarr" else {}
    with xr.open_datatree(one, **how) as a, xr.open_datatree(other, **how) as b:
        groups = [{node.path: _timeless(node.to_dataset(inherit=False)) for node in tree.subtree} for tree in (a, b)]
        for path in sorted(groups[0].keys() ^ groups[1].keys()):
            yield f"{path}: only {'before' if path in groups[0] else 'after'}"
        for path in sorted(groups[0].keys() & groups[1].keys()):
            yield from _of_datasets(groups[0][path], groups[1][path], path)


def _timeless(data: xr.Dataset) -> xr.Dataset:
    return data.drop_sel(quantity="seconds") if "seconds" in data.get("quantity", ()) else data


def _of_datasets(one: xr.Dataset, other: xr.Dataset, place: str) -> Iterator[str]:
    yield from _of_values(_plain(one.attrs), _plain(other.attrs), f"{place}@")
    for name in sorted(map(str, one.variables.keys() ^ other.variables.keys())):
        yield f"{place}/{name}: only {'before' if name in one.variables else 'after'}"
    for name in map(str, one.variables.keys() & other.variables.keys()):
        a, b = one[name].values, other[name].values
        if _VARIES.search(name):
            continue
        if a.shape != b.shape or a.dtype.kind != b.dtype.kind:
            yield f"{place}/{name}: shape {a.shape} of {a.dtype} before, {b.shape} of {b.dtype} after"
        elif a.dtype.kind in "fc":
            if not np.allclose(a, b, _TOLERANCE, _TOLERANCE, equal_nan=True):
                yield f"{place}/{name}: differs by up to {np.nanmax(np.abs(a - b)):.2g}"
        elif not (a == b).all():
            yield f"{place}/{name}: differs in {(a != b).sum()} places"


def _plain(attributes: Mapping[Any, Any]) -> dict[str, Any]:
    return {str(key): value.tolist() if hasattr(value, "tolist") else value for key, value in attributes.items()}


def _of_pictures(one: Path, other: Path) -> Iterator[str]:
    a, b = imread(one), imread(other)
    if a.shape != b.shape:
        yield f": {a.shape} before, {b.shape} after"
    elif (different := (np.abs(a - b).max(axis=-1) > 0).mean()) > 0:
        yield f": {100 * different:.2g} % of the pixels differ"


def _of_texts(one: Path, other: Path) -> Iterator[str]:
    a, b = (_TIMES.sub("TIME", path.read_text(encoding="utf-8")).splitlines() for path in (one, other))
    if a != b:
        line = next((i for i, pair in enumerate(zip(a, b, strict=False)) if pair[0] != pair[1]), min(len(a), len(b)))
        yield f", line {line + 1}: {a[line : line + 1]} before, {b[line : line + 1]} after"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="output folder")
    parser.add_argument("--against", type=Path, help="output folder of another version to compare with")
    parser.add_argument("--only", help="run only commands whose names match this pattern")
    parser.add_argument("--ran", action="store_true", help="compare existing output without running commands")
    options = parser.parse_args()
    if not options.ran:
        run(options.folder, options.only)
    if options.against is not None:
        found = list(differences(options.against, options.folder))
        print("\n".join(found) or "Nothing differs.")
        sys.exit(bool(found))
