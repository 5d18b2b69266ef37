"""Fits of generative models from files: the code of a user does not run because a file is opened."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ...errors import InputError
from ..likelihood.bins import TableForm
from ..model import TapModel
from . import source
from .story import GenericStory

_WORKS = "Name the right one, fit again, or leave it out: the tables of the fit still work."


class StoryError(InputError):
    """The function of a fit is not known, or is another than that which was fitted."""


def read_generic(
    attributes: Mapping[str, Any],
    data: xr.Dataset,
    parameters: xr.Dataset,
    common: dict[str, Any],
    story: Callable[..., Any] | str | None,
) -> TapModel:
    """Model from the groups of a file, with its function if that is known, else by its tables.

    Args:
        attributes: Attributes of the file.
        data: Group `constant_data`.
        parameters: Group `parameters`.
        common: What all models have, as arguments.
        story: The function, or where it is, as FILE.py:FUNCTION; default one of its name that was named before.

    Raises:
        StoryError: There is no such function, or another than that of the fit is given, or none and the fit has no
            tables or wrong ones.
    """
    name = attributes["kind"]
    try:
        known = source.registered(name) if story is None else source.function_of(story)
    except InputError as error:
        raise StoryError(f"this fit is of {name}. {error}") from error
    if known is not None and source.digest(known) == attributes["digest"]:
        if "session" in known.wanted and "training_sessions" not in attributes:
            raise StoryError(f"this fit of {name} does not say which sessions trained it; fit again.")
        return GenericStory(known).read(attributes, data, parameters, common)
    if story is not None:
        raise StoryError(
            f"{known.name if known else story} is not what was fitted, {name}: it is another function, or its code has "
            f"changed since. {_WORKS if 'table' in data else 'Name the right one, or fit again.'}"
        )
    if "table" not in data or common["draws"]:
        place = attributes.get("place", "") or "FILE.py:FUNCTION, if it is in a file"
        raise StoryError(
            f"this fit needs the code of {name}, which opening a file does not run; name it in Python with "
            f"load_model(path, story=...), or with --story {place}."
        )
    table, covered = data["table"].values, data["covered"].values.astype(bool)
    if (wrong := np.isnan(table).any(axis=(2, 3)) & covered).any():
        l, m = np.argwhere(wrong)[0]
        raise StoryError(f"the table of this fit of {name} is not a number for position {l} and object {m}; fit again.")
    return OpenedModel(name_of_function=name, table=table, **common)


@dataclass(frozen=True, eq=False, repr=False)
class OpenedModel(TapModel):
    """A fit of a generative model whose code did not run: its tables decide as before, draws need the code.

    Attributes:
        name_of_function: Name of the function.
        table: Log probability of every bin, shape (L, M, K, B); NaN for untrained classes.
    """

    name_of_function: str
    table: NDArray[np.float64]

    @property
    def kind(self) -> str:
        """Name of the function."""
        return self.name_of_function

    @property
    def dims(self) -> dict[str, tuple[str, ...]]:
        """Empty, as its latent variables are not read."""
        return {}

    @property
    def K(self) -> int:  # noqa: N802
        """Number of taxels."""
        return self.table.shape[2]

    @cached_property
    def trained(self) -> NDArray[np.bool_]:
        """Mask of the classes with training taps, shape (L, M)."""
        return ~np.isnan(self.table).any(axis=(2, 3))

    @cached_property
    def plain_form(self) -> TableForm:
        """The tables; flat for untrained classes, which have prior 0."""
        return TableForm(np.where(np.isnan(self.table), -np.log(self.table.shape[3]), self.table))

    def groups(self) -> dict[str, xr.Dataset]:
        """Always raises, as it would lose the latent variables.

        Raises:
            InputError: Always.
        """
        raise InputError(
            f"save() and to_datatree() need the code of {self.kind}, without which this fit was opened; name it with "
            "load_model(path, story=...)."
        )
