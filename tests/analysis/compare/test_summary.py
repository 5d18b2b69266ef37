"""What the summary of a comparison says of calibration."""

import numpy as np
import pytest
import xarray as xr
from solidtouch.analysis.compare.summary import overconfident

PROFILE = (13.6, 3.66, 46.7)
SESSION = (2.4, 0.2, 60.5)
LIMIT = (3.0, 1.0, 8.0)
NO_DOUBT = (np.inf, np.inf, np.inf)
NONE_WRONG = (np.nan,) * 3
NO_INTERVAL = (5.0, np.nan, np.nan)


def curves(factors):
    """Factors with intervals at threshold 0.95, by policy and model; at the other every model is overconfident."""
    values = np.full((len(factors), 3, 2, 3), 9.0)
    values[:, :, 1] = list(factors.values())
    dims, models = ("policy", "model", "theta"), np.array(["first", "own.py", "other"])
    names = [f"miscalibration{end}" for end in ("", "_low", "_high")]
    coords = {"policy": np.array(list(factors)), "model": models, "theta": [0.8, 0.95]}
    return xr.Dataset({name: (dims, values[..., i]) for i, name in enumerate(names)}, coords)


@pytest.mark.parametrize(
    ("factors", "said"),
    {
        "own": ({"active": [SESSION, PROFILE, NONE_WRONG]}, "imply: active with own.py (13.6 [3.7, 46.7] times)."),
        "largest first": (
            {"active": [PROFILE, NO_DOUBT, LIMIT]},
            "imply: active with own.py (infinite times) and first (13.6 [3.7, 46.7] times).",
        ),
        "passive, too": (
            {"passive": [SESSION, SESSION, PROFILE], "active": [PROFILE, SESSION, SESSION]},
            "imply: active with first (13.6 [3.7, 46.7] times); passive with other (13.6 [3.7, 46.7] times).",
        ),
    }.values(),
    ids=["own", "largest first", "passive, too"],
)
def test_models_with_a_factor_surely_above_one_are_called_overconfident(factors, said):
    """At the threshold that is shown, the largest first."""
    sentence = overconfident(curves(factors))

    assert sentence.startswith("Overconfident: decisions at threshold 0.95 are wrong more often than the beliefs ")
    assert said in sentence


def test_no_model_is_called_overconfident_without_an_interval_above_one():
    """Not where the interval reaches 1, where there is none, and where no decision is wrong."""
    assert overconfident(curves({"active": [LIMIT, NO_INTERVAL, NONE_WRONG]})) == ""
