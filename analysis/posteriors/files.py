"""Reads draws: CSV of Stan and others (one file for each chain or a column `chain`), JSON, netCDF of ArviZ, arrays."""

import csv
import gzip
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.storage import read_groups
from .quantities import flattened

type Draws = dict[str, NDArray[np.float64]]
"""Numbers by name, each of shape (chain, draw)."""
_CHAIN = ("chain", ".chain", "chain__")
_MOST_BYTES = 1 << 28


def read_draws(paths: Sequence[str | Path]) -> Draws:
    """Draws of one posterior.

    Args:
        paths: One netCDF file with the group `posterior` or, without groups, the parameters; JSON files, each a list
            of chains, which are objects with the draws of each number; or CSV files, each of one chain unless it has a
            column `chain`. `.gz` is read as well. Names are `level.1.2` or `level[1,2]`, with an underscore behind
            the word where a language reserves it; lines that begin with # are left out.

    Raises:
        InputError: A file cannot be read or is larger than 256 MiB, or chains differ in length or names.
    """
    if not paths:
        raise InputError("There is no file with draws.")
    if any(str(path).endswith(".nc") for path in paths):
        if len(paths) > 1:
            raise InputError("A netCDF file with draws must hold all chains and be the only file.")
        return _of_netcdf(Path(paths[0]))
    chains = [chain for path in paths for chain in _chains(Path(path))]
    names, lengths = [set(chain) for chain in chains], {len(next(iter(chain.values()))) for chain in chains}
    if any(own != names[0] for own in names) or len(lengths) > 1:
        raise InputError(f"The chains in {', '.join(map(str, paths))} differ in names or numbers of draws.")
    return {name: np.stack([chain[name] for chain in chains]) for name in chains[0]}


def _name(text: str) -> str:
    """Name such as `level.1.2`, without an underscore at the end of the word."""
    return re.sub(r"[\[\],.\s]+", ".", re.sub(r"_+(?=[\[.]|$)", "", text.strip())).strip(".")


def _of_netcdf(path: Path) -> Draws:
    groups = read_groups(path, ("posterior", "/"))
    return _of_dataset(groups["posterior"] if groups["posterior"].sizes else groups["/"], str(path))


def _of_dataset(data: Any, source: str) -> Draws:
    if not {"chain", "draw"} <= set(data.sizes):
        raise InputError(
            f"{source} has no variables with the dims chain and draw, in a group posterior or without groups."
        )
    every: Draws = {}
    for name, variable in data.data_vars.items():
        if {"chain", "draw"} <= set(variable.dims) and variable.dtype.kind in "biuf":
            _add(every, flattened(_name(str(name)), variable.transpose("chain", "draw", ...).values), source)
    return every


def _add(every: Draws, more: Draws, source: str) -> None:
    if twice := every.keys() & more.keys():
        raise InputError(f"{source} has {min(twice)} twice.")
    every |= more


def named_draws(draws: Any) -> Draws:
    """Draws that a program in Python holds.

    Args:
        draws: Arrays of shape (chain, draw, ...) by name, a data set of xarray, or ArviZ's groups with `posterior`.

    Raises:
        InputError: They have another shape or type.
    """
    group = getattr(draws, "posterior", draws)
    for data in (group, draws):
        if hasattr(data, "data_vars"):
            return _of_dataset(data, "The object with draws")
    if not isinstance(draws, Mapping):
        raise InputError(f"Draws must be arrays by name, an xarray data set or files, not {type(draws).__name__}.")
    every: Draws = {}
    for name, values in draws.items():
        try:
            array = np.asarray(values)
        except (TypeError, ValueError):
            array = np.array("")
        if array.dtype.kind not in "biuf":
            raise InputError(f"Draws of {name} are not real numbers of shape (chain, draw, ...).")
        if array.ndim < 2:
            raise InputError(f"Draws of {name} have shape {array.shape} instead of (chain, draw, ...).")
        _add(every, flattened(_name(str(name)), array), "The mapping with draws")
    if len({values.shape for values in every.values()}) > 1:
        raise InputError("Draws have different numbers of chains or of draws.")
    return every


def _chains(path: Path) -> Iterator[Draws]:
    """The chains of a file."""
    form = "JSON" if ".json" in path.suffixes[-2:] else "CSV"
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise InputError(f"{path} is larger than {_MOST_BYTES >> 20} MiB, the most that a file with draws may be.")
        text = data.decode()
    except (OSError, EOFError, UnicodeDecodeError, zlib.error) as error:
        found = (
            f"cannot read: {error.strerror}"
            if isinstance(error, OSError) and error.strerror
            else f"not {form}: {error}"
        )
        raise InputError(f"{path}: {found}.") from error
    yield from _of_json(path, text) if form == "JSON" else _of_csv(path, text)


def _of_json(path: Path, text: str) -> Iterator[Draws]:
    try:
        chains = msgspec.json.decode(text, type=list[dict[str, list[float]]])
    except (msgspec.MsgspecError, RecursionError) as error:
        raise InputError(f"{path} is not a list of chains with the draws of each number: {error}.") from None
    if not chains or not all(chain and len({*map(len, chain.values())}) == 1 for chain in chains):
        raise InputError(f"{path} has no chain, or one without or with different numbers of draws.")
    for chain in chains:
        every: Draws = {}
        for name, values in chain.items():
            _add(every, {_name(name): np.array(values)}, str(path))
        yield every


def _of_csv(path: Path, text: str) -> Iterator[Draws]:
    rows = [row for row in csv.reader(line for line in text.splitlines() if line.strip() and line[:1] != "#") if row]
    if len(rows) < 2:
        raise InputError(f"{path} has no draws: a line of names and a line for each draw are due.")
    if any(text.count("[") != text.count("]") for text in rows[0]):
        raise InputError(f"{path}: names with commas between brackets need quotation marks.")
    names = [_name(text) for text in rows[0]]
    if twice := {name for name in names if names.count(name) > 1}:
        raise InputError(f"{path} has {min(twice)} twice.")
    for number, row in enumerate(rows[1:], 1):
        if len(row) != len(names):
            raise InputError(f"{path}: draw {number} has {len(row)} instead of {len(names)} numbers.")
    try:
        table = np.array(rows[1:], dtype=np.float64)
    except ValueError:
        raise InputError(f"{path}: {_no_number(rows)}.") from None
    column = next((rows[0].index(name) for name in _CHAIN if name in rows[0]), None)
    if column is None:
        yield dict(zip(names, table.T, strict=True))
        return
    for chain in np.unique(table[:, column]):
        yield dict(zip(names, table[table[:, column] == chain].T, strict=True))


def _no_number(rows: Sequence[Sequence[str]]) -> str:
    """The first cell of a table of numbers, below its names, that holds something else."""
    cells = ((i, j, text) for i, row in enumerate(rows[1:], 1) for j, text in enumerate(row, 1))
    draw, column, text = next(cell for cell in cells if not _is_number(cell[2]))
    return f"draw {draw}, column {column}: {text[:40]!r} is not a number"


def _is_number(text: str) -> bool:
    try:
        np.array(text, dtype=np.float64)
    except ValueError:
        return False
    return True
