"""Data sets of a sweep: named at once, loaded or simulated when their first cell runs."""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ...hardware.simulator.session import simulate_session
from ...hardware.simulator.settings import preset
from ...models.errors import InputError
from ...models.grid import ClassGrid
from ...models.io.recording import naming
from ...models.settings import Division
from ...models.splits import Fold, Split, load_experiment
from .study import DataEntry, StudyFile


@dataclass(frozen=True, eq=False)
class DataSet:
    """Taps that train and taps that test; equal where the key is.

    Attributes:
        name: As in the result.
        key: Which taps these are: preset and seed, or a digest of the files, and the cells.
        fold: The taps.
        grid: The classes.
    """

    name: str
    key: str
    fold: Fold
    grid: ClassGrid

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DataSet) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True)
class DataSetSource:
    """A data set that can be loaded.

    Attributes:
        name: As in the result.
        key: As `DataSet.key`.
        entry: Where it stands in the study.
        paths: Its files; none where it is simulated.
        number: Seed of a simulated, fold of a recorded one.
        note: What its split cannot show, and which taps were left out; empty if nothing.
    """

    name: str
    key: str
    entry: DataEntry
    paths: tuple[Path, ...]
    number: int
    note: str = ""

    def load(self) -> DataSet:
        """The taps.

        Raises:
            InputError: They cannot be used.
        """
        from ...models.measurement.histogram import trim  # noqa: PLC0415 - NumPyro takes seconds to import

        with naming(f"data {self.name}"):
            if self.paths:
                parts, grid = _recorded(self.entry, self.paths)
                folds = parts.folds
            else:
                folds, grid = _simulated(self.entry, self.number)
            grid, _ = trim(grid, [fold.train for fold in folds])
        return DataSet(self.name, self.key, folds[self.number if self.paths else 0], grid)


class Sources:
    """All data sets of a study, in order; the last one used stays in memory.

    Args:
        study: The study.
        folder: What its paths are relative to.

    Raises:
        InputError: A file cannot be read or split, or two data sets have the same name.
    """

    def __init__(self, study: StudyFile, folder: Path) -> None:
        found = [source for entry in study.data for source in _sources(entry, folder)]
        self._sources = {source.name: source for source in found}
        self._last: DataSet | None = None
        if len(self._sources) < len(found):
            raise InputError("data: two data sets have the same name.")

    @property
    def notes(self) -> tuple[str, ...]:
        """What there is to say of data sets, one sentence or more for each entry of the study."""
        return tuple({f"Data {one.entry.name}: {one.note}": None for one in self._sources.values() if one.note})

    @property
    def keys(self) -> dict[str, str]:
        """Names and what they stand for."""
        return {source.name: source.key for source in self._sources.values()}

    @cached_property
    def grids(self) -> dict[str, ClassGrid]:
        """The classes of each data set; simulated ones of one entry have the same."""
        known: dict[str, ClassGrid] = {}
        for source in self._sources.values():
            if source.entry.name not in known:
                known[source.entry.name] = self.load(source.name).grid
        return {source.name: known[source.entry.name] for source in self._sources.values()}

    def load(self, name: str) -> DataSet:
        """The data set of this name.

        Raises:
            InputError: As `DataSetSource.load`.
        """
        if self._last is None or self._last.name != name:
            self._last = self._sources[name].load()
        return self._last


def _sources(entry: DataEntry, folder: Path) -> list[DataSetSource]:
    cells = f"cells {entry.where_cell} {entry.what_cell}"
    if entry.preset is not None:
        names = {seed: f"{entry.name}-{seed}" for seed in entry.seeds} if entry.seeds else {0: entry.name}
        return [
            DataSetSource(n, f"preset {entry.preset} seed {seed} {cells}", entry, (), seed) for seed, n in names.items()
        ]
    paths = tuple(folder / file for file in entry.files or ())
    with naming(f"data {entry.name}"):
        parts, _ = _recorded(entry, paths)
        kept = " with training taps" * bool(entry.training_taps)
        content = f"files {_digest(paths)} {entry.split} {entry.train} {entry.test}{kept} {cells}"
    names = [entry.name] if len(parts.folds) == 1 else [f"{entry.name}, {fold.name}" for fold in parts.folds]
    return [DataSetSource(name, f"{content} fold {i}", entry, paths, i, parts.warning) for i, name in enumerate(names)]


def _simulated(entry: DataEntry, seed: int) -> tuple[tuple[Fold, ...], ClassGrid]:
    settings = preset(entry.preset or "")
    train, test = (simulate_session(settings, seed, session) for session in (0, 1))
    return (Fold(train, test, f"seed {seed}"),), train.grid(entry.where_cell, entry.what_cell)


def _recorded(entry: DataEntry, paths: tuple[Path, ...]) -> tuple[Split, ClassGrid]:
    train, test = (None if given is None else ",".join(map(str, given)) for given in (entry.train, entry.test))
    division = Division(
        where_cell=entry.where_cell,
        what_cell=entry.what_cell,
        split=entry.split,
        train=train,
        test=test,
        training_taps=bool(entry.training_taps),
    )
    return load_experiment(paths, division)


def _digest(paths: tuple[Path, ...]) -> str:
    """Of the content of files, and of all files in folders."""
    digest = hashlib.sha256()
    for path in paths:
        files = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
        for file in files:
            digest.update(f"{file.name} ".encode())
            with file.open("rb") as content:
                digest.update(hashlib.file_digest(content, "sha256").digest())
    return digest.hexdigest()[:16]
