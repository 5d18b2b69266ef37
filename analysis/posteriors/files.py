"""Reads draws from files: CSV of Stan and others, one file for each chain or a column `chain`, and netCDF of ArviZ."""

import csv
import gzip
import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...models.errors import InputError
from ...models.storage import read_groups
from .quantities import flattened

type Draws = dict[str, NDArray[np.float64]]
"""Numbers by name, each of shape (chain, draw)."""
_CHAIN = ("chain", ".chain", "chain__")


def read_draws(paths: Sequence[str | Path]) -> Draws:
    """Draws of one posterior.

    Args:
        paths: One netCDF file with the group `posterior`, or CSV files, each of one chain unless it has a column
            `chain`; `.gz` is read as well. Names are `level.1.2` or `level[1,2]`, with an underscore behind the word
            where a language reserves it; lines that begin with # are left out.

    Raises:
        InputError: A file cannot be read, or chains differ in length or names.
    """
    if len(paths) == 1 and str(paths[0]).endswith(".nc"):
        return _of_netcdf(Path(paths[0]))
    chains = [chain for path in paths for chain in _of_csv(Path(path))]
    names, lengths = [set(chain) for chain in chains], {len(next(iter(chain.values()))) for chain in chains}
    if any(own != names[0] for own in names) or len(lengths) > 1:
        raise InputError(f"The chains in {', '.join(map(str, paths))} differ in names or numbers of draws.")
    return {name: np.stack([chain[name] for chain in chains]) for name in chains[0]}


def _name(text: str) -> str:
    """Name such as `level.1.2`, without an underscore at the end of the word."""
    return re.sub(r"[\[\],.\s]+", ".", re.sub(r"_+(?=[\[.]|$)", "", text.strip())).strip(".")


def _of_netcdf(path: Path) -> Draws:
    data = read_groups(path, ("posterior",)).get("posterior")
    if data is None or not {"chain", "draw"} <= set(data.sizes):
        raise InputError(f"{path} has no group posterior with the dims chain and draw.")
    every = {}
    for name, variable in data.data_vars.items():
        if {"chain", "draw"} <= set(variable.dims) and variable.dtype.kind in "biuf":
            every |= flattened(_name(str(name)), variable.transpose("chain", "draw", ...).values)
    return every


def _of_csv(path: Path) -> Iterator[Draws]:
    """The chains of a file."""
    try:
        data = path.read_bytes()
        text = (gzip.decompress(data) if path.suffix == ".gz" else data).decode()
    except (OSError, EOFError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read as CSV: {error}.") from error
    rows = [row for row in csv.reader(line for line in text.splitlines() if line.strip() and line[:1] != "#") if row]
    if len(rows) < 2:
        raise InputError(f"{path} has no draws: a line of names and a line for each draw are due.")
    names = [_name(text) for text in rows[0]]
    try:
        table = np.array(rows[1:], dtype=np.float64)
    except ValueError as error:
        raise InputError(
            f"{path} has a line with another number of columns than {len(names)}, or no number."
        ) from error
    if table.shape[1:] != (len(names),):
        raise InputError(f"{path} has {table.shape[1]} columns of numbers and {len(names)} names.")
    column = next((rows[0].index(name) for name in _CHAIN if name in rows[0]), None)
    if column is None:
        yield dict(zip(names, table.T, strict=True))
        return
    for _, own in groupby(table, key=lambda row: row[column]):
        yield dict(zip(names, np.array(list(own)).T, strict=True))
