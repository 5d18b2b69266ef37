"""Fitted tables as JSON, for robots and other programs.

The keys are those of the header of a conformance case, see docs/reference/conformance/README.md, so a
program that reads a case reads a model; docs/how-to/exported-models.md describes the other keys. `io.export_reader`
reads it back.
"""

import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..measurement.histogram import HistogramModel
from ..measurement.likelihood.bins import TableForm
from ..measurement.model import TapModel
from ..measurement.table import TableModel
from ..storage import complete_file

FORMAT = 1
_SMALLEST_LOG = np.log(sys.float_info.min)


class Decisions(NamedTuple):
    """Parameters for decisions and moves.

    Attributes:
        border: Interpretation of Eq. 9 at the ends of the range.
        threshold: Belief in an object needed to decide, theta_W.
        theta_x: Belief in a position needed for a move; 1 never moves.
        fixation: Index of the fixation point.
    """

    border: str
    threshold: float
    theta_x: float
    fixation: int


def log_tables(model: TapModel) -> NDArray[np.float64]:
    """Natural logs of the factors of Eq. 1, -inf for untrained classes, shape (L, M, K, B).

    Raises:
        InputError: The model has no such tables.
    """
    if model.states.gain.tolist() != [1.0] or model.states.offset.tolist() != [0.0]:
        raise InputError(f"Cannot export a {model.name} model: it carries a state from tap to tap.")
    form = model.plain_form
    if not isinstance(form, TableForm):
        raise InputError(f"Cannot export a {model.name} model: it has no tables of single samples.")
    return np.where(model.trained[:, :, np.newaxis, np.newaxis], form.log_prob, -np.inf)


def prior(model: TapModel) -> NDArray[np.float64]:
    """Belief before the first tap, uniform over the trained classes, shape (L, M)."""
    return model.trained / model.trained.sum()


def exported(model: TapModel, decisions: Decisions, case: str) -> dict[str, Any]:
    """Content of the file as a JSON object.

    Args:
        model: Model to export.
        decisions: Parameters for decisions and moves.
        case: Name of the case in the answers of programs.

    Raises:
        InputError: The model has no tables, or the probabilities in them are too small for double precision.
    """
    L, M, K, B = log_tables(model).shape
    return {
        "format": FORMAT,
        "kind": model.kind,
        "case": case,
        "L": L,
        "M": M,
        "K": K,
        "J": model.preprocessing.samples,
        "B": B,
        "where_value": model.grid.where_value.tolist(),
        "where_unit": model.grid.where_unit,
        "what_name": list(model.grid.what_name),
        "edges": model.edges.tolist(),
        **_tables(model),
        "prior": prior(model).tolist(),
        "power": model.power,
        "border": decisions.border,
        "thresholds": [decisions.threshold],
        "theta_x": decisions.theta_x,
        "fixation": decisions.fixation,
        "saturation": None if np.isinf(model.saturation) else model.saturation,
        "preprocessing": model.preprocessing.to_dict(),
        "grid": model.grid.to_dict(),
        "trained_on": model.trained_on,
        "version": model.version,
    }


def save_exported(
    model: TapModel, path: str | Path, decisions: Decisions, case: str = "model", force: bool = False
) -> None:
    """Writes a model as one line of JSON, atomically; numbers are read back exactly.

    Args:
        model: Model to export.
        path: The file.
        decisions: Parameters for decisions and moves.
        case: Name of the case in the answers of programs.
        force: Whether to overwrite an existing file.

    Raises:
        InputError: The model cannot be exported, or the file cannot be written.
    """
    text = json.dumps(exported(model, decisions, case), allow_nan=False, ensure_ascii=False)
    with complete_file(path, force) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def _tables(model: TapModel) -> dict[str, Any]:
    """Counts if they suffice, else probabilities, with zeros for untrained classes."""
    if isinstance(model, HistogramModel) and model.trained.all():
        return {"counts": model.counts.tolist(), "pseudocount": model.pseudocount}
    log_prob = log_tables(model)
    if (log_prob[np.isfinite(log_prob)] < _SMALLEST_LOG).any():
        raise InputError(
            f"Cannot export this {model.name} model as JSON: some bins are so improbable (1e{_decade(log_prob)}) "
            f"that they underflow double precision; use the C header (--format c-header), which has logarithms."
        )
    return {"probabilities": _probabilities(model, log_prob).tolist()}


def _probabilities(model: TapModel, log_prob: NDArray[np.float64]) -> NDArray[np.float64]:
    """Probabilities, those of the model itself if it has them, so that their logs are read back exactly."""
    if isinstance(model, HistogramModel | TableModel):
        return np.where(np.isfinite(log_prob), model.probabilities, 0.0)
    return np.exp(log_prob)


def _decade(log_prob: NDArray[np.float64]) -> int:
    return int(np.floor(log_prob[np.isfinite(log_prob)].min() / np.log(10)))
