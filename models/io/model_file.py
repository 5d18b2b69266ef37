"""Fitted models as netCDF files: trees of groups that ArviZ opens.

=====================  =====================================================================================
group                  content
=====================  =====================================================================================
root                   attributes: ``kind``, ``format``, settings, class grid, how the fit converged
``constant_data``      bin edges, training data needed by the model, states, digests of the taps
``parameters``         parameters for decisions (not for the histogram, whose counts are data)
``posterior``          draws of the parameters, dims (chain, draw, ...), if requested; see `arviz_tree`
``closed_form``        posterior in closed form; that of the histogram is its counts. Draws are made when asked for
``integrated``         parameters over which decisions are integrated, dims (integrated, ...), if requested and there
                       is no posterior in closed form to draw them from
``sample_stats``       convergence statistics of the fit
``log_likelihood``     ``taps``: of each training tap under its own class at power 1, dims (chain, draw, tap)
further groups         ``prior``, ``log_prior``, ``posterior_predictive`` and ``observed_data``, if requested
=====================  =====================================================================================

Files of format 1, from versions with the histogram model only, can also be read, and files without a saturation, which
then is unlimited.
"""

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ..errors import InputError, check_format
from ..grid import ClassGrid
from ..measurement.fits.closed_form import GROUP
from ..measurement.fits.posterior import EXACT, Convergence
from ..measurement.generic.opened import StoryError, read_generic
from ..measurement.model import FORMAT, Fitted, TapModel
from ..measurement.novelty import NoveltyScores
from ..measurement.registry import KINDS, PAPER, measurement_model
from ..measurement.states import ONE_STATE, States
from ..preprocessing import Preprocessing
from ..settings import Missing, parse_power
from ..storage import read_groups, write_groups
from .export_reader import load_exported

type ModelSource = TapModel | str | Path
"""A fitted model or its file."""

_FIRST_FORMAT = 1
_ROUNDING = 1e-9


def save_model(
    model: TapModel,
    path: str | Path,
    force: bool = False,
    groups: Mapping[str, xr.Dataset] | None = None,
    convergence: Convergence | None = None,
) -> None:
    """Writes a model as netCDF, atomically.

    Args:
        model: The model.
        path: The file.
        force: Whether to overwrite an existing file.
        groups: Groups to store with it, see `arviz_tree`.
        convergence: Convergence statistics to store with it.

    Raises:
        InputError: The file cannot be written, or exists and `force` is not set, or the model cannot be stored.
    """
    written = model.groups() | dict(groups or {})
    if convergence is not None:
        ended = {"converged": str(convergence.converged), "fit": convergence.sentence}
        written["/"] = written["/"].assign_attrs(ended)
        stats = {name: (("step",) * np.ndim(value), value) for name, value in convergence.stats.items()}
        written["sample_stats"] = xr.Dataset(stats)
    write_groups(written, path, force)


def load_model(
    path: str | Path, story: Callable[..., Any] | str | None = None, missing: Missing = "refuse"
) -> TapModel:
    """Fitted model from a file; names ending in `.json` are exported models.

    The code of a model that is a function of the user's is not run to open its fit. Where its samples are exchangeable,
    the tables of the fit decide without it; otherwise it must be named.

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import solidtouch as st
    >>> with TemporaryDirectory() as folder:
    ...     st.fit(st.simulate("paper", seed=4)).save(Path(folder, "model.nc"))
    ...     load_model(Path(folder, "model.nc"))
    <histogram model: 16 x 5 classes, 50 samples of 12 taxels, 100 bins, power J>

    Args:
        path: The file.
        story: Function of the user's that was fitted, or where it is, as "FILE.py:FUNCTION".
        missing: What the model does with samples that are NaN, see `TapModel`.

    Raises:
        InputError: The file is missing, damaged or not a fitted model, or needs a function that is not named or has
            changed since the fit.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"A model is a fitted model or the path of its file, got {type(path).__name__}.")
    if Path(path).suffix.lower() == ".json":
        return load_exported(path).with_missing(missing)
    groups = _read(Path(path))
    try:
        model = _model(groups, story)
    except KeyError as error:
        raise InputError(f"{path}: damaged: missing {error}.") from error
    except StoryError as error:
        raise InputError(f"{path}: {error}") from error
    except (TypeError, ValueError, ArithmeticError, RecursionError) as error:
        raise InputError(f"{path}: damaged: {error}") from error
    return model.with_missing(missing)


def model_of(
    source: ModelSource, missing: Missing = "refuse", story: Callable[..., Any] | str | None = None
) -> TapModel:
    """The model itself, loaded if it is named by its file, as by `load_model`; `missing="drop"` also of a model.

    Raises:
        InputError: As `load_model`.
    """
    if isinstance(source, TapModel):
        return source if missing == "refuse" else source.with_missing(missing)
    return load_model(source, story, missing)


def _read(path: Path) -> dict[str, xr.Dataset]:
    """Groups of a file by name; draws that do not decide are left on disk."""
    groups = read_groups(path, ("/", "constant_data", "parameters", GROUP, "integrated"))
    attributes = groups["/"].attrs
    version = attributes.get("format")
    if attributes.get("kind") == PAPER and version == _FIRST_FORMAT:
        return groups | {"constant_data": groups["/"]}
    if "kind" in attributes:
        check_format(version, f"{path}: a fitted model", FORMAT, _FIRST_FORMAT)
    if (attributes.get("kind") not in KINDS and "digest" not in attributes) or version != FORMAT:
        other = ", but a tap set" if "taps" in groups["/"] else ""
        raise InputError(f"{path}: not a fitted model of format {FORMAT} or {_FIRST_FORMAT}{other}.")
    return groups


def _draws(draws: xr.Dataset) -> tuple[dict[str, NDArray[np.float64]], ...]:
    """Parameters over which decisions are integrated."""
    if not draws:
        return ()
    return tuple(
        {str(name): values.values[d] for name, values in draws.data_vars.items()}
        for d in range(draws.sizes["integrated"])
    )


def _model(groups: Mapping[str, xr.Dataset], story: Callable[..., Any] | str | None) -> TapModel:
    attributes, data, parameters = groups["/"].attrs, groups["constant_data"], groups["parameters"]
    grid = ClassGrid.from_dict(json.loads(attributes["grid"]))
    common: dict[str, Any] = {
        "grid": grid,
        "edges": data["edges"].values,
        "power": parse_power(attributes["power"]),
        "saturation": float(attributes.get("saturation", np.inf)),
        "preprocessing": Preprocessing.from_json(attributes["preprocessing"]),
        "left_out": tuple(json.loads(attributes["left_out"])),
        "trained_on": str(attributes["trained_on"]),
        "source": str(attributes.get("source", "")),
        "version": attributes["version"],
        "novelty": _novelty(data),
        "training": data["training"].values if "training" in data else np.empty(0, np.uint64),
        "states": _states(data),
        "draws": _draws(groups["integrated"]),
        "posterior": groups[GROUP],
        "seed": int(attributes.get("seed", 0)),
    }
    if attributes["kind"] in KINDS:
        if story is not None:
            raise StoryError(f"the {attributes['kind']} model is built in and takes no function (--story).")
        model = measurement_model(attributes["kind"]).read(attributes, data, parameters, common)
    else:
        model = read_generic(attributes, data, parameters, common | {"posterior": None}, story)
    if "integrate" in attributes:
        model = Fitted(model, model.posterior, EXACT).integrated(int(attributes["integrate"]), model.seed).model
    elif model.draws:  # from older versions, whose seed is not known
        without: Any = model  # every kind is a dataclass
        model = replace(without, posterior=None)
    if not (np.diff(model.edges) > 0).all():
        raise ValueError("edges do not increase.")
    return model


def _states(data: xr.Dataset) -> States:
    if "state_gain" not in data:
        return ONE_STATE
    states = States(data["state_gain"].values, data["state_offset"].values, data["state_log_prior"].values)
    if not states.gain.shape == states.offset.shape == states.log_prior.shape or states.gain.ndim != 1:
        raise ValueError("states must have a gain, an offset and a probability each.")
    if not all(np.isfinite(values).all() and len(values) for values in states) or (states.gain <= 0).any():
        raise ValueError("states must be finite, with gains above 0.")
    if abs(np.logaddexp.reduce(states.log_prior)) > _ROUNDING:
        raise ValueError("probabilities of the states do not sum to 1.")
    return states


def _novelty(data: xr.Dataset) -> NoveltyScores | None:
    """Novelty scores of a model file; files of older versions have none, or none with their own reference."""
    if "novelty_reference" not in data:
        return None
    names = ("novelty_reference", "novelty_edges", "novelty_misfit", "novelty_cell")
    reference, edges, misfit, cell = (data[name].values for name in names)
    scores = NoveltyScores(reference, edges, misfit, cell.astype(np.intp))
    cells = data.sizes["where"] * data.sizes["what"]
    finite = np.isfinite(scores.misfit).all() and (scores.misfit >= 0).all() and np.isfinite(scores.edges).all()
    if not finite or ((scores.cell < 0) | (scores.cell >= cells)).any():
        raise ValueError("novelty scores are not finite or do not match the classes.")
    if (scores.reference < 0).any() or not (np.diff(scores.edges) > 0).all():
        raise ValueError("novelty scores have a negative reference or edges that do not increase.")
    return scores
