"""The reference posteriors in the folder `data`: what is known of each, and its files for other programs."""

import json
import shutil
from collections.abc import Mapping
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...models.errors import InputError
from ...models.measurement.registry import NAMES
from ...models.storage import complete_folder
from .files import Draws, read_draws
from .quantities import Scale

VERSION = "1.1.0"
"""Of the reference posteriors, apart from that of the software; `data/README.md` has the rules and the changes."""


class Number(NamedTuple):
    """What is known of one number of a posterior.

    Attributes:
        name: Such as `level.1.2.1`.
        scale: On which it is compared.
        mean: On that scale.
        mcse_mean: Monte Carlo standard error of the mean, 0 if it is exact.
        variance: On that scale.
        mcse_variance: Monte Carlo standard error of the variance.
        sd_square: Standard deviation of the squared distance from the mean; 0 for classes.
    """

    name: str
    scale: Scale
    mean: float
    mcse_mean: float
    variance: float
    mcse_variance: float
    sd_square: float


class ReferencePosterior(NamedTuple):
    """A posterior that draws are compared with.

    Attributes:
        name: Of the model.
        model: Its prior and likelihood, in lines of text.
        method: How its moments were found: `exact` or `nuts`.
        numbers: All that are compared.
        diagnostics: Of the chains, by name; none if it is exact.
        data: Taps and constants of the priors, by the names of Stan's data.
        draws: 10 chains of 100, shape (chain, draw) by the name of the number.
    """

    name: str
    model: tuple[str, ...]
    method: str
    numbers: tuple[Number, ...]
    diagnostics: Mapping[str, float] | None

    def __repr__(self) -> str:
        return f"<ReferencePosterior {self.name}: {len(self.numbers)} numbers, {self.method}>"

    @property
    def data(self) -> dict[str, Any]:  # noqa: D102 - an attribute
        given: dict[str, Any] = json.loads(_text(f"{self.name}.data.json"))
        return {name: np.array(value) if isinstance(value, list) else value for name, value in given.items()}

    @property
    def draws(self) -> Draws:  # noqa: D102 - an attribute
        with as_file(_folder() / f"{self.name}.csv.gz") as path:
            read = read_draws([path])
        return {name: values for name, values in read.items() if name != "chain"}


@cache
def posterior(name: str) -> ReferencePosterior:
    """A reference posterior.

    Raises:
        InputError: There is none of this name.
    """
    if name not in NAMES:
        raise InputError(f"There is no reference posterior {name!r}; choose from {', '.join(NAMES)}.")
    about: dict[str, Any] = json.loads(_text(f"{name}.json"))
    numbers = tuple(Number(**row) for row in about["summary"])
    return ReferencePosterior(name, tuple(about["model"]), about["method"], numbers, about["diagnostics"])


def export(folder: str | Path, force: bool = False) -> int:
    """Writes all files of the reference posteriors, all or none.

    Returns:
        Their number.

    Raises:
        InputError: The folder cannot be written, exists and `force` is not set, or is not there and has the name of a
            reference posterior.
    """
    if str(folder) in NAMES and not Path(folder).exists():
        raise InputError(
            f"{folder} is the name of a reference posterior; give the name of a folder, into which all of them are "
            "written."
        )
    with as_file(_folder()) as source, complete_folder(folder, force) as temporary:
        found = sorted(
            path for path in source.iterdir() if path.suffix in {".gz", ".json", ".md", ""} and path.is_file()
        )
        for path in found:
            shutil.copyfile(path, temporary / path.name)
    return len(found)


def _text(name: str) -> str:
    return _folder().joinpath(name).read_text(encoding="utf-8")


def _folder() -> Any:
    return files(__package__ or "") / "data"
